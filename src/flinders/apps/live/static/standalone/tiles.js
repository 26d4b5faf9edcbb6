/** Divides the sphere into 642 near-hexagonal tiles, in the order of `geometry/sphere.py`. */

import { cross, dot, minus, unit } from "../../../../static/views/vectors.js";

/** @typedef {import("../../../../static/view.d.ts").TilesView} TilesView */
/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {[number, number, number]} Triangle  Numbers of its vertices, anticlockwise seen from outside. */

const BISECTIONS = 3;
/** Number of moves of all centres to their centroids. */
const ROUNDS = 20;

/** @type {TilesView | null} */
let made = null;

/** @returns {TilesView} The tiles, always the same. */
export function tiles() {
    return (made ??= makeTiles());
}

/** @returns {TilesView} */
function makeTiles() {
    let [centres, triangles] = icosahedron();
    for (let i = 0; i < BISECTIONS; i++) [centres, triangles] = bisect(centres, triangles);
    const rings = ringsOf(centres, triangles);
    const cornersOf = () => {
        const all = triangles.map(([a, b, c]) => unit(cross(minus(centres[b], centres[a]), minus(centres[c], centres[a]))));
        return rings.map((ring) => ring.map((place) => all[place]));
    };
    for (let i = 0; i < ROUNDS; i++) {
        const corners = cornersOf();
        centres = centres.map((centre, tile) => centroid(centre, corners[tile]));
    }
    return { centres: centres.flat(), corners: cornersOf().map((corners) => corners.flat()) };
}

/** @returns {[Vector[], Triangle[]]} Vertices and triangles. */
function icosahedron() {
    const golden = (1 + Math.sqrt(5)) / 2;
    const rectangle = [[1, 1], [1, -1], [-1, 1], [-1, -1]].map(([a, b]) => unit([0, a, b * golden]));
    const vertices = [0, 1, 2].flatMap((turn) => rectangle.map((point) => [0, 1, 2].map((axis) => point[(axis + 3 - turn) % 3])));
    const areNear = (/** @type {number} */ a, /** @type {number} */ b) => dot(vertices[a], vertices[b]) > 0.4;
    /** @type {Triangle[]} */
    const triangles = [];
    for (let a = 0; a < 12; a++) {
        for (let b = a + 1; b < 12; b++) {
            for (let c = b + 1; c < 12; c++) {
                if (!areNear(a, b) || !areNear(a, c) || !areNear(b, c)) continue;
                const isOutward = dot(vertices[a], cross(vertices[b], vertices[c])) > 0;
                triangles.push(isOutward ? [a, b, c] : [a, c, b]);
            }
        }
    }
    return [vertices, triangles];
}

/**
 * Bisect all edges, so that each triangle becomes four.
 * @param {Vector[]} vertices
 * @param {Triangle[]} triangles
 * @returns {[Vector[], Triangle[]]}
 */
function bisect(vertices, triangles) {
    const keyOf = (/** @type {number} */ a, /** @type {number} */ b) => Math.min(a, b) * vertices.length + Math.max(a, b);
    const keys = triangles.flatMap(([a, b, c]) => [keyOf(a, b), keyOf(b, c), keyOf(c, a)]);
    const edges = [...new Set(keys)].sort((one, other) => one - other);
    const places = new Map(edges.map((key, i) => [key, vertices.length + i]));
    const middles = edges.map((key) => {
        const [one, other] = [vertices[Math.floor(key / vertices.length)], vertices[key % vertices.length]];
        return unit(one.map((value, axis) => value + other[axis]));
    });
    const middle = (/** @type {number} */ a, /** @type {number} */ b) => places.get(keyOf(a, b)) ?? 0;
    const smaller = triangles.flatMap(([a, b, c]) => {
        const [p, q, r] = [middle(a, b), middle(b, c), middle(c, a)];
        return /** @type {Triangle[]} */ ([[a, p, r], [p, b, q], [r, q, c], [p, q, r]]);
    });
    return [[...vertices, ...middles], smaller];
}

/**
 * The triangles around each vertex, anticlockwise.
 * @param {Vector[]} vertices
 * @param {Triangle[]} triangles
 * @returns {number[][]}
 */
function ringsOf(vertices, triangles) {
    /** @type {Map<number, number>[]} */
    const after = vertices.map(() => new Map());
    const at = new Map(triangles.flatMap(([a, b, c], place) => [[`${a} ${b}`, place], [`${b} ${c}`, place], [`${c} ${a}`, place]]));
    for (const [a, b, c] of triangles) {
        for (const [vertex, from, to] of [[a, b, c], [b, c, a], [c, a, b]]) after[vertex].set(from, to);
    }
    return after.map((next, vertex) => {
        const [first] = next.keys();
        const ring = [first];
        for (let one = next.get(first) ?? first; one !== first; one = next.get(one) ?? first) ring.push(one);
        return ring.map((one) => at.get(`${vertex} ${one}`) ?? 0);
    });
}

/**
 * @param {Vector} centre
 * @param {Vector[]} corners
 * @returns {Vector} The unit vector to the centroid of a tile.
 */
function centroid(centre, corners) {
    const sum = [0, 0, 0];
    corners.forEach((corner, i) => {
        const next = corners[(i + 1) % corners.length];
        const around = 1 + dot(centre, corner) + dot(centre, next) + dot(corner, next); // van Oosterom and Strackee
        const angle = Math.atan2(dot(centre, cross(corner, next)), around);
        const middle = unit([0, 1, 2].map((axis) => centre[axis] + corner[axis] + next[axis]));
        for (let axis = 0; axis < 3; axis++) sum[axis] += angle * middle[axis];
    });
    return unit(sum);
}
