/**
 * Shapes of the 3-D view as arrays of numbers, without WebGL.
 *
 * @typedef {{centres: number[], corners: number[][]}} Tiles  3 numbers for each centre; 3 for each corner of each tile
 * @typedef {ArrayLike<number>} Vector  three numbers
 *
 * @typedef {object} TileMesh  a fan of triangles for each tile
 * @property {Float32Array} position  3 for each vertex, on the unit sphere
 * @property {Float32Array} local  2 for each vertex: position on its tile, 1 at the rim; for hatching
 * @property {Float32Array} edge  distance from the rim of the tile, 0 on it
 * @property {Float32Array} tile  number of the vertex's tile
 * @property {Uint16Array | Uint32Array} index  3 for each triangle, counter-clockwise from outside
 *
 * @typedef {object} Strokes  straight pieces of lines
 * @property {Float32Array} start  3 for each piece
 * @property {Float32Array} end  3 for each piece
 * @property {Float32Array} alpha  2 for each piece: opacity at its start and end
 * @property {Float32Array} width  2 for each piece, in widths of the line
 * @property {number} count  pieces in use
 */

import { between, rotated, rotation } from "./turn.js";
import { cross, dot, minus, unit } from "./vectors.js";

/**
 * @param {Tiles} tiles
 * @returns {TileMesh}
 */
export function tileMesh(tiles) {
    const rims = tiles.corners.map((corners) => (2 * corners.length) / 3);
    const vertices = rims.reduce((sum, rim) => sum + rim + 1, 0);
    const triangles = vertices - rims.length;
    const mesh = {
        position: new Float32Array(3 * vertices),
        local: new Float32Array(2 * vertices),
        edge: new Float32Array(vertices),
        tile: new Float32Array(vertices),
        index: vertices > 65535 ? new Uint32Array(3 * triangles) : new Uint16Array(3 * triangles),
    };
    let [vertex, written] = [0, 0];
    tiles.corners.forEach((corners, tile) => {
        const centre = tiles.centres.slice(3 * tile, 3 * tile + 3);
        const [east, north] = tangents(centre);
        const rim = rimOf(corners, centre);
        const reach = Math.hypot(...minus(rim.slice(0, 3), centre));
        const inner = distanceFromRim(rim, centre);
        const middle = vertex;
        for (let k = -1; k < rim.length / 3; k += 1) {
            const point = k < 0 ? centre : rim.slice(3 * k, 3 * k + 3);
            mesh.position.set(point, 3 * vertex);
            mesh.local.set([dot(minus(point, centre), east) / reach, dot(minus(point, centre), north) / reach], 2 * vertex);
            mesh.edge[vertex] = k < 0 ? inner : 0;
            mesh.tile[vertex] = tile;
            vertex += 1;
        }
        for (let k = 0; k < rim.length / 3; k += 1) {
            mesh.index.set([middle, middle + 1 + k, middle + 1 + ((k + 1) % (rim.length / 3))], written);
            written += 3;
        }
    });
    return mesh;
}

/**
 * Corners of a tile and the middles between them, on the unit sphere, counter-clockwise from outside.
 *
 * @param {number[]} corners
 * @param {number[]} centre
 * @returns {number[]}
 */
function rimOf(corners, centre) {
    const rim = [];
    const count = corners.length / 3;
    for (let k = 0; k < count; k += 1) {
        const here = corners.slice(3 * k, 3 * k + 3);
        const next = corners.slice((3 * (k + 1)) % corners.length).slice(0, 3);
        rim.push(unit(here), unit([here[0] + next[0], here[1] + next[1], here[2] + next[2]]));
    }
    if (dot(cross(minus(rim[0], centre), minus(rim[2], centre)), centre) < 0) rim.reverse();
    return rim.flat();
}

/** @param {number[]} rim @param {number[]} centre @returns {number} */
function distanceFromRim(rim, centre) {
    let least = Infinity;
    for (let k = 0; k < rim.length; k += 3) least = Math.min(least, Math.hypot(...minus(rim.slice(k, k + 3), centre)));
    return least;
}

/**
 * The tile whose centre is nearest to a direction.
 *
 * @param {Tiles} tiles
 * @param {Vector} direction
 * @returns {number}
 */
export function tileAt(tiles, direction) {
    let [best, most] = [0, -Infinity];
    for (let tile = 0; 3 * tile < tiles.centres.length; tile += 1) {
        const along =
            tiles.centres[3 * tile] * direction[0] +
            tiles.centres[3 * tile + 1] * direction[1] +
            tiles.centres[3 * tile + 2] * direction[2];
        if (along > most) [best, most] = [tile, along];
    }
    return best;
}

/**
 * Arrays for pieces of lines, with full opacity and width.
 *
 * @param {number} capacity
 * @returns {Strokes}
 */
export function strokes(capacity) {
    return {
        start: new Float32Array(3 * capacity),
        end: new Float32Array(3 * capacity),
        alpha: new Float32Array(2 * capacity).fill(1),
        width: new Float32Array(2 * capacity).fill(1),
        count: 0,
    };
}

/**
 * Lines through points, as pieces.
 *
 * @param {number[][]} lines  each the coordinates of its points, 3 for each
 * @returns {Strokes}
 */
function strokesAlong(lines) {
    const made = strokes(lines.reduce((sum, line) => sum + line.length / 3 - 1, 0));
    for (const line of lines) {
        for (let k = 3; k < line.length; k += 3) {
            made.start.set(line.slice(k - 3, k), 3 * made.count);
            made.end.set(line.slice(k, k + 3), 3 * made.count);
            made.count += 1;
        }
    }
    return made;
}

/**
 * Meridians and parallels of the unit sphere, 30° apart, with fewer meridians at the poles.
 *
 * @returns {Strokes}
 */
export function graticule() {
    const lines = [];
    for (let lon = 0; lon < 360; lon += 30) {
        const reach = lon % 90 === 0 ? 90 : 60;
        lines.push(sweepPoints(-reach, reach, 5, (lat) => onSphere(lon, lat)));
    }
    for (let lat = -60; lat <= 60; lat += 30) lines.push(sweepPoints(0, 360, 5, (lon) => onSphere(lon, lat)));
    return strokesAlong(lines);
}

/**
 * A circle on the unit sphere around +z.
 *
 * @param {number} radius
 * @returns {Strokes}
 */
export function circle(radius) {
    const height = (180 / Math.PI) * Math.acos(radius);
    return strokesAlong([sweepPoints(0, 360, 6, (lon) => onSphere(lon, height))]);
}

/** Number of pieces of `axes` outside of the unit sphere, which are the first ones. */
export const OUTSIDE = 12;

/**
 * The three axes from the origin, in pieces short enough to fade where the sphere hides them.
 *
 * @param {number} length  more than 1
 * @returns {Strokes}
 */
export function axes(length) {
    const pieces = OUTSIDE / 3;
    const outside = [0, 1, 2].map((axis) =>
        sweepPoints(0, pieces, 1, (k) => along(axis, 1 + ((length - 1) * k) / pieces)),
    );
    return strokesAlong([...outside, ...[0, 1, 2].map((axis) => [0, 0, 0, ...along(axis, 1)])]);
}

/** @param {number} axis @param {number} length @returns {number[]} */
function along(axis, length) {
    return [0, 1, 2].map((other) => (other === axis ? length : 0));
}

/**
 * @param {number} first
 * @param {number} last
 * @param {number} step
 * @param {(at: number) => number[]} point
 * @returns {number[]}
 */
function sweepPoints(first, last, step, point) {
    const line = [];
    for (let at = first; at <= last; at += step) line.push(...point(at));
    return line;
}

/** @param {number} lon degrees @param {number} lat degrees @returns {number[]} */
function onSphere(lon, lat) {
    const [u, v] = [(lon * Math.PI) / 180, (lat * Math.PI) / 180];
    return [Math.cos(v) * Math.cos(u), Math.cos(v) * Math.sin(u), Math.sin(v)];
}

/** Share of its length at which an arrow becomes visible, so that it does not cover its start. */
const CLEAR = 0.04;

/** Pieces of an arrow's shaft. */
export const SHAFT = 40;

/**
 * An arrow along the great circle between two directions, lifted off the sphere, its head a last piece that narrows.
 *
 * Between opposite directions any great circle will do. Writes into `out`, which has room for `SHAFT` + 1 pieces, and
 * allocates nothing.
 *
 * @param {Vector} from  unit vector
 * @param {Vector} to  unit vector
 * @param {Strokes} out
 * @returns {number}  the angle between them, radians
 */
export function arrow(from, to, out) {
    const cosine = Math.min(Math.max(from[0] * to[0] + from[1] * to[1] + from[2] * to[2], -1), 1);
    const angle = Math.acos(cosine);
    out.count = 0;
    if (angle < 0.12) return angle;
    // (side = to − cos · from, made a unit vector, spans the great circle together with `from`.)
    let [x, y, z] = [to[0] - cosine * from[0], to[1] - cosine * from[1], to[2] - cosine * from[2]];
    let length = Math.hypot(x, y, z);
    if (length < 1e-6) {
        [x, y, z] = Math.abs(from[2]) < 0.9 ? [-from[1], from[0], 0] : [from[2], 0, -from[0]];
        length = Math.hypot(x, y, z);
    }
    [x, y, z] = [x / length, y / length, z / length];
    const head = Math.min(0.11, 0.4 * angle);
    const lift = 0.05 + 0.05 * Math.min(angle, 2);
    const end = angle - head;
    for (let k = 0; k <= SHAFT; k += 1) {
        const isHead = k === SHAFT;
        place(out.start, k, isHead ? end : (end * k) / SHAFT);
        place(out.end, k, isHead ? angle : (end * (k + 1)) / SHAFT);
        out.alpha[2 * k] = opacity(k / SHAFT);
        out.alpha[2 * k + 1] = opacity(Math.min((k + 1) / SHAFT, 1));
        out.width[2 * k] = isHead ? 3.4 : 1;
        out.width[2 * k + 1] = isHead ? 0.05 : 1;
    }
    out.count = SHAFT + 1;
    return angle;

    /** @param {Float32Array} array @param {number} k @param {number} turned */
    function place(array, k, turned) {
        const radius = 1.012 + lift * Math.sin((Math.PI * turned) / angle);
        const [c, s] = [radius * Math.cos(turned), radius * Math.sin(turned)];
        array[3 * k] = c * from[0] + s * x;
        array[3 * k + 1] = c * from[1] + s * y;
        array[3 * k + 2] = c * from[2] + s * z;
    }

    /** @param {number} share */
    function opacity(share) {
        return Math.min(Math.max((share - CLEAR) / 0.5, 0), 1) * 0.75 + (share > CLEAR ? 0.25 : 0);
    }
}

/**
 * A direction on the great circle to another, at most some radians away.
 *
 * @param {import("./vectors.js").Vector} from
 * @param {import("./vectors.js").Vector} to
 * @param {number} most
 * @returns {import("./vectors.js").Vector}
 */
export function towards(from, to, most) {
    const turn = between(from, to);
    return turn.angle > most ? rotated(rotation({ ...turn, angle: most }), from) : to;
}

/**
 * Extend the extent of a cloud by points; skips NaN.
 *
 * @typedef {{low: number[], high: number[]}} Extent
 * @param {Extent} extent
 * @param {Float32Array} field  3 for each point
 * @param {number} first
 * @param {number} count
 */
export function extend(extent, field, first, count) {
    for (let k = 3 * first; k < 3 * count; k += 1) {
        const axis = k % 3;
        if (field[k] < extent.low[axis]) extent.low[axis] = field[k];
        if (field[k] > extent.high[axis]) extent.high[axis] = field[k];
    }
}

/** @returns {Extent}  of no points */
export function emptyExtent() {
    return { low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] };
}

/**
 * Matrix that maps raw readings to the unit sphere, W (x − b) / F, as 16 numbers by columns.
 *
 * @param {{matrix: number[][], offset: number[], strength: number}} shown
 * @param {number[]} [out]
 * @returns {number[]}
 */
export function drawMatrix({ matrix, offset, strength }, out = new Array(16)) {
    for (let row = 0; row < 3; row += 1) {
        for (let column = 0; column < 3; column += 1) out[4 * column + row] = matrix[row][column] / strength;
        out[12 + row] = -dot(matrix[row], offset) / strength;
        out[4 * row + 3] = 0;
    }
    out[15] = 1;
    return out;
}

/** @param {number[]} centre @returns {[readonly number[], readonly number[]]} two perpendicular unit vectors */
function tangents(centre) {
    const across = unit(cross(Math.abs(centre[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], centre));
    return [across, cross(centre, across)];
}
