/** Whether axes changed their sign or their place while a recording was made: `flinders.diagnostics.axis_swap`. */

import { apply } from "./linear.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Engine} Engine */

/**
 * @typedef {object} AxisSwap
 * @property {string} axes
 * @property {number[]} rows Readings, counted from 0, from each of which on it is so, or is so no longer.
 * @property {number} gain How many times closer to an ellipsoid all readings lie once it is undone.
 */

/**
 * Look for the moments at which axes were swapped; null where nothing was, or nothing that can be told.
 * @param {Engine} engine
 * @param {Float64Array} field
 * @param {number} noise Of the fit.
 * @param {EngineData} data
 * @returns {AxisSwap | null}
 */
export function axisSwapOf(engine, field, noise, data) {
    const { numbers } = data;
    if (field.length < 3 * numbers.SWAP_FEWEST) return null;
    const moments = Object.entries(momentsOf(field, data)).filter(([, rows]) => rows.length);
    if (!moments.length) return null;
    const [axes, rows] = moments.reduce((most, one) => (one[1].length > most[1].length ? one : most));
    const putRight = fitted(engine, undone(field, rows, data.swaps[axes]));
    const before = fitted(engine, field)?.noise ?? Infinity;
    if (!putRight) return null;
    const most = Math.min(numbers.SWAP_GAIN * noise, numbers.SWAP_MOST_NOISE * putRight.radius);
    if (!(putRight.noise <= most)) return null;
    const gain = Math.min(before / Math.max(putRight.noise, Number.MIN_VALUE), numbers.SWAP_MOST);
    const independent = putRight.rows / (putRight.correlation_time * putRight.excess_variance);
    const isEvident = gain > numbers.SWAP_GAIN && !(independent * Math.log(gain) < numbers.SWAP_LEAST_EVIDENCE);
    return isEvident ? { axes, rows, gain } : null;
}

/**
 * First rows behind a break that a swap mends, by its name.
 * @param {Float64Array} field
 * @param {EngineData} data
 * @returns {Record<string, number[]>}
 */
function momentsOf(field, { swaps, numbers }) {
    const broken = breaksOf(field, numbers.SWAP_BROKEN);
    const mended = (/** @type {number[]} */ swap) =>
        broken.filter(({ at, usual }) => isMended(field, at, swap, numbers.SWAP_LIKE * usual)).map(({ at }) => at + 2);
    return Object.fromEntries(Object.entries(swaps).map(([name, swap]) => [name, mended(swap)]));
}

/**
 * Places at which the path breaks, and how far it usually is from straight there.
 * @param {Float64Array} field
 * @param {number} limit Times that.
 * @returns {{at: number, usual: number}[]}
 */
function breaksOf(field, limit) {
    const count = field.length / 3 - 3;
    const sizes = Float64Array.from({ length: count }, (_, i) => apart(onward(field, i), back(field, i)));
    const three = (/** @type {number} */ i) => Math.max(sizes[i], sizes[i + 1], sizes[i + 2]);
    const places = Array.from({ length: Math.max(count - 8, 0) }, (_, i) => i + 4);
    const looked = places.map((at) => ({ at, usual: Math.max(three(at - 4), three(at + 2)) }));
    return looked.filter(({ at, usual }) => sizes[at] > limit * usual);
}

/**
 * Where the two readings behind a place come from.
 * @param {Float64Array} field
 * @param {number} at
 * @returns {number[]}
 */
function onward(field, at) {
    return [0, 1, 2].map((axis) => 1.5 * field[3 * (at + 2) + axis] - 0.5 * field[3 * (at + 3) + axis]);
}

/**
 * What the two readings before it lead to.
 * @param {Float64Array} field
 * @param {number} at
 * @returns {number[]}
 */
function back(field, at) {
    return [0, 1, 2].map((axis) => 1.5 * field[3 * (at + 1) + axis] - 0.5 * field[3 * at + axis]);
}

/**
 * @param {number[]} one
 * @param {number[]} other
 * @returns {number}
 */
function apart(one, other) {
    return Math.max(...one.map((part, axis) => Math.abs(part - other[axis])));
}

/**
 * @param {Float64Array} field
 * @param {number} at
 * @param {number[]} swap
 * @param {number} limit
 * @returns {boolean}
 */
function isMended(field, at, swap, limit) {
    return apart(apply(swap, onward(field, at)), back(field, at)) <= limit;
}

/**
 * Readings with a swap undone behind every second of these rows.
 * @param {Float64Array} field
 * @param {number[]} rows
 * @param {number[]} swap
 * @returns {Float64Array}
 */
function undone(field, rows, swap) {
    const out = field.slice();
    rows.forEach((row, i) => {
        if (i % 2) return;
        const end = rows[i + 1] ?? field.length / 3;
        for (let j = row; j < end; j++) out.set(apply(swap, field.subarray(3 * j, 3 * j + 3)), 3 * j);
    });
    return out;
}

/**
 * The record of readings as they are; null where there is no ellipsoid.
 * @param {Engine} engine
 * @param {Float64Array} field
 */
function fitted(engine, field) {
    const record = engine.fit(field, null, { robust: 0, hasStatistics: false });
    return record.status ? null : record;
}
