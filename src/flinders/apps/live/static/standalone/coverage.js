/** Directions of corrected readings, and their tiles. */

import { apply } from "./linear.js";

/** @typedef {import("./fit.js").Surface} Surface */

/**
 * Readings after correction, three numbers each, in units of the field.
 * @param {Float64Array} field
 * @param {Surface} surface
 * @returns {Float64Array}
 */
export function correctedVectors(field, { centre, inverse }) {
    const out = new Float64Array(field.length);
    for (let i = 0; i < field.length; i += 3) {
        const [x, y, z] = apply(inverse, [field[i] - centre[0], field[i + 1] - centre[1], field[i + 2] - centre[2]]);
        out[i] = x;
        out[i + 1] = y;
        out[i + 2] = z;
    }
    return out;
}

/**
 * Readings in each tile.
 * @param {Float64Array} vectors
 * @param {number[]} centres Three numbers a tile.
 * @returns {number[]}
 */
export function tileCounts(vectors, centres) {
    const counts = new Array(centres.length / 3).fill(0);
    for (const tile of tilesOf(vectors, centres)) counts[tile]++;
    return counts;
}

/**
 * Tile of each direction, the one with the nearest centre.
 * @param {Float64Array} vectors
 * @param {number[]} centres Three numbers a tile.
 * @returns {number[]}
 */
export function tilesOf(vectors, centres) {
    const order = Array.from({ length: centres.length / 3 }, (_, tile) => tile);
    order.sort((one, other) => centres[3 * one + 2] - centres[3 * other + 2]);
    const ascending = Float64Array.from(order.flatMap((tile) => centres.slice(3 * tile, 3 * tile + 3)));
    const tiles = new Array(vectors.length / 3);
    for (let i = 0; i < tiles.length; i++) {
        tiles[i] = order[nearestOf(vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2], ascending)];
    }
    return tiles;
}

/** Largest difference in height (z) of a direction and the centre of its tile. */
const TILE_HEIGHT = 0.15;

/**
 * Index of the centre nearest to a direction.
 * @param {number} x
 * @param {number} y
 * @param {number} z
 * @param {Float64Array} centres By height.
 * @returns {number}
 */
function nearestOf(x, y, z, centres) {
    const height = z / (Math.sqrt(x * x + y * y + z * z) || 1);
    let low = 0;
    for (let high = centres.length / 3; low < high; ) {
        const middle = (low + high) >> 1;
        if (centres[3 * middle + 2] < height - TILE_HEIGHT) low = middle + 1;
        else high = middle;
    }
    let nearest = low;
    let largest = -Infinity;
    for (let at = 3 * low; at < centres.length && centres[at + 2] <= height + TILE_HEIGHT; at += 3) {
        const cosine = x * centres[at] + y * centres[at + 1] + z * centres[at + 2];
        if (cosine <= largest) continue;
        largest = cosine;
        nearest = at / 3;
    }
    return nearest;
}

/**
 * A flat array as rows of three numbers.
 * @param {ArrayLike<number>} numbers
 * @returns {number[][]}
 */
export function threes(numbers) {
    return Array.from({ length: numbers.length / 3 }, (_, i) => [numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]]);
}
