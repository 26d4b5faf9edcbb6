/** Directions of corrected readings: a hundred cells of equal area, and the tiles that are drawn. */

import { apply } from "./linear.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./heading.js").Surface} Surface */

/**
 * Readings after correction, three numbers each, in units of the field.
 * @param {Float64Array} field
 * @param {Surface} surface
 * @returns {Float64Array}
 */
export function corrected(field, { centre, inverse }) {
    const out = new Float64Array(field.length);
    for (let i = 0; i < field.length; i += 3) {
        const local = [field[i] - centre[0], field[i + 1] - centre[1], field[i + 2] - centre[2]];
        out.set(apply(inverse, local), i);
    }
    return out;
}

/**
 * Readings in each of the hundred cells.
 * @param {Float64Array} vectors Of any length.
 * @param {EngineData} data
 * @returns {Float64Array}
 */
export function cellCounts(vectors, { bands }) {
    const counts = new Float64Array(100);
    for (let i = 0; i < vectors.length; i += 3) counts[cellOf(vectors[i], vectors[i + 1], vectors[i + 2], bands)]++;
    return counts;
}

/**
 * @param {number} x
 * @param {number} y
 * @param {number} z
 * @param {number[]} bands Cells of each band, from the north.
 * @returns {number}
 */
function cellOf(x, y, z, bands) {
    const height = z / (Math.hypot(x, y, z) || 1);
    let [band, start] = [0, 0];
    while (band < bands.length - 1 && height < 1 - 0.02 * (start + bands[band])) start += bands[band++];
    const turn = Math.atan2(y, x) / (2 * Math.PI);
    return start + Math.min(Math.floor((turn - Math.floor(turn)) * bands[band]), bands[band] - 1);
}

/**
 * Readings in each tile: that with the nearest centre.
 * @param {Float64Array} vectors
 * @param {number[]} centres Three numbers a tile.
 * @returns {number[]}
 */
export function tileCounts(vectors, centres) {
    const counts = new Array(centres.length / 3).fill(0);
    for (let i = 0; i < vectors.length; i += 3) counts[tileOf(vectors, i, centres)]++;
    return counts;
}

/**
 * @param {Float64Array} vectors
 * @param {number} at
 * @param {number[]} centres
 * @returns {number}
 */
function tileOf(vectors, at, centres) {
    const [x, y, z] = [vectors[at], vectors[at + 1], vectors[at + 2]];
    let [nearest, largest] = [0, -Infinity];
    for (let tile = 0; tile < centres.length; tile += 3) {
        const cosine = x * centres[tile] + y * centres[tile + 1] + z * centres[tile + 2];
        if (cosine > largest) [nearest, largest] = [tile / 3, cosine];
    }
    return nearest;
}

/**
 * Numbers in threes.
 * @param {ArrayLike<number>} numbers
 * @returns {number[][]}
 */
export function threes(numbers) {
    return Array.from({ length: numbers.length / 3 }, (_, i) => [numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]]);
}
