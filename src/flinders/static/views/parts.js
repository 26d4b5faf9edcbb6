/**
 * Objects of the 3-D view, with geometry and material.
 *
 * @typedef {import("./geometry.js").Strokes} Strokes
 * @typedef {import("./geometry.js").Tiles} Tiles
 * @typedef {Mesh<BufferGeometry, ShaderMaterial>} Part
 * @typedef {Dots<BufferGeometry, ShaderMaterial>} Cloud
 */

import {
    BufferAttribute,
    BufferGeometry,
    DynamicDrawUsage,
    Mesh,
    Points as Dots,
    ShaderMaterial,
} from "../vendor/three.js";
import { tileMesh } from "./geometry.js";
import { lineMaterial, markerMaterial, pointMaterial, tileMaterial } from "./materials.js";

/** The corners of a piece of a line: along it, across it, and 0. */
const CORNERS = [0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0];

/** Attributes of each piece at its corners, and their sizes. */
const ATTRIBUTES = /** @type {const} */ ([
    ["start", 3],
    ["end", 3],
    ["alpha", 2],
    ["width", 2],
]);

/** The unit sphere in tiles. `paint` gives them their colours. */
export class Ball {
    /** @param {Tiles} tiles */
    constructor(tiles) {
        const mesh = tileMesh(tiles);
        const vertices = mesh.tile.length;
        const geometry = new BufferGeometry();
        geometry.setAttribute("position", new BufferAttribute(mesh.position, 3));
        geometry.setAttribute("local", new BufferAttribute(mesh.local, 2));
        geometry.setAttribute("edge", new BufferAttribute(mesh.edge, 1));
        geometry.setAttribute("tile", new BufferAttribute(mesh.tile, 1));
        geometry.setIndex(new BufferAttribute(mesh.index, 1));
        this.before = new BufferAttribute(new Uint8Array(4 * vertices), 4, true).setUsage(DynamicDrawUsage);
        this.after = new BufferAttribute(new Uint8Array(4 * vertices), 4, true).setUsage(DynamicDrawUsage);
        geometry.setAttribute("before", this.before);
        geometry.setAttribute("after", this.after);
        this.tileOf = mesh.tile;
        this.part = inFront(new Mesh(geometry, tileMaterial()), 0);
        this.uniforms = this.part.material.uniforms;
        this.paint(new Uint8Array(4 * tiles.corners.length), false);
    }

    /**
     * @param {Uint8Array} tints  4 for each tile: red, green, blue, and 255 with readings, 128 without
     *     readings, 0 if unknown
     * @param {boolean} slowly  change from the present colours as the uniform `share` goes from 0 to 1
     */
    paint(tints, slowly) {
        const [before, after] = [this.before.array, this.after.array];
        const share = this.uniforms.share.value;
        for (let k = 0; k < after.length; k += 1) {
            before[k] += share * (after[k] - before[k]);
            after[k] = tints[4 * this.tileOf[k >> 2] + (k & 3)];
        }
        if (!slowly) before.set(after);
        this.before.needsUpdate = true;
        this.after.needsUpdate = true;
    }
}

/**
 * Two triangles for each piece of a line. (Not instances: software draws those one by one.)
 *
 * @param {Strokes} pieces
 * @param {Parameters<typeof lineMaterial>[0]} options
 * @param {number} order  later is in front
 * @returns {Part}
 */
export function lines(pieces, options, order) {
    const capacity = pieces.start.length / 3;
    const geometry = new BufferGeometry();
    const corners = new Float32Array(12 * capacity);
    const index = new Uint16Array(6 * capacity);
    for (let k = 0; k < capacity; k += 1) {
        corners.set(CORNERS, 12 * k);
        index.set([4 * k, 4 * k + 1, 4 * k + 2, 4 * k, 4 * k + 2, 4 * k + 3], 6 * k);
    }
    geometry.setAttribute("position", new BufferAttribute(corners, 3));
    geometry.setIndex(new BufferAttribute(index, 1));
    for (const [name, size] of ATTRIBUTES) {
        geometry.setAttribute(name, new BufferAttribute(new Float32Array(4 * size * capacity), size));
    }
    const part = inFront(new Mesh(geometry, lineMaterial(options)), order);
    rewrite(part, pieces);
    return part;
}

/** Replace the pieces, up to the capacity. @param {Part} part @param {Strokes} pieces */
export function rewrite(part, pieces) {
    for (const [name, size] of ATTRIBUTES) {
        const attribute = /** @type {BufferAttribute} */ (part.geometry.getAttribute(name));
        const [from, to] = [pieces[name], attribute.array];
        for (let piece = 0; piece < pieces.count; piece += 1) {
            for (let k = 0; k < 4 * size; k += 1) to[4 * size * piece + k] = from[size * piece + (k % size)];
        }
        attribute.needsUpdate = true;
    }
    drawFirst(part, pieces.count);
}

/** Draw only the first pieces. @param {Part} part @param {number} count */
export function drawFirst(part, count) {
    part.geometry.setDrawRange(0, 6 * count);
}

/** @param {BufferGeometry} geometry  of the readings, shared @returns {Cloud} */
export function cloud(geometry) {
    return inFront(new Dots(geometry, pointMaterial()), 1);
}

/** Two dots of one size on the screen. @param {BufferAttribute} places @returns {Cloud} */
export function marker(places) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", places);
    geometry.setAttribute("which", new BufferAttribute(new Float32Array([0, 1]), 1));
    return inFront(new Dots(geometry, markerMaterial()), 6);
}

/** @template {Part | Cloud} T @param {T} part @param {number} order @returns {T} */
function inFront(part, order) {
    part.renderOrder = order;
    part.frustumCulled = false;
    return part;
}
