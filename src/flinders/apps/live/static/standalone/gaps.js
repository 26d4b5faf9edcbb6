/** Uncovered directions, by the tiles of the sphere. */

import { dot } from "../../../../static/views/vectors.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */

/**
 * The direction farthest from all covered ones, and its angle, rad.
 * @param {View} view
 * @param {readonly number[]} centres
 * @returns {{direction: Vector, far: number}}
 */
export function gapOf(view, centres) {
    const known = GAPS.get(view);
    if (known) return known;
    const found = gapAmong(view, centres);
    GAPS.set(view, found);
    return found;
}

/** Cache by view. @type {WeakMap<View, {direction: Vector, far: number}>} */
const GAPS = new WeakMap();

/** @param {View} view @param {readonly number[]} centres @returns {{direction: Vector, far: number}} */
function gapAmong(view, centres) {
    const seen = seenOf(view, centres);
    let [most, direction] = [-1, /** @type {Vector} */ ([0, 0, 1])];
    view.tiles_seen.forEach((count, tile) => {
        if (count) return;
        const here = middleOf(tile, centres);
        const far = farOf(here, seen);
        if (far > most) [most, direction] = [far, here];
    });
    return { direction, far: most };
}

/** @param {View} view @param {readonly number[]} centres @returns {Vector[]} Middles of the tiles with readings. */
export function seenOf({ tiles_seen: counts }, centres) {
    return counts.flatMap((count, tile) => (count ? [middleOf(tile, centres)] : []));
}

/** @param {Vector} direction @param {readonly Vector[]} seen @returns {number} Angle to the nearest. */
export function farOf(direction, seen) {
    const nearest = seen.reduce((most, one) => Math.max(most, dot(one, direction)), -1);
    return Math.acos(Math.min(nearest, 1));
}

/** @param {number} tile @param {readonly number[]} centres  three numbers a tile @returns {Vector} */
function middleOf(tile, centres) {
    return centres.slice(3 * tile, 3 * tile + 3);
}
