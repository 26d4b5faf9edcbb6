/** Readings of a fit, with each rest as one reading or none; as `flinders.estimators.rests`. */

/**
 * Rests (intervals of still readings) found by the engine.
 * @typedef {object} Rests
 * @property {[number, number][]} bounds First row of each, and the row after its last.
 * @property {boolean} areLeftOut Whether a fit leaves rests out; otherwise it uses the mean of each.
 */

/**
 * @typedef {object} Once
 * @property {Float64Array} field Three numbers a reading.
 * @property {number[]} first First row of each reading.
 * @property {number[]} last Last row of each reading.
 */

/** @type {Rests} */
export const NO_RESTS = { bounds: [], areLeftOut: false };

/**
 * Readings used by a fit.
 * @param {Float64Array} field
 * @param {Rests} rests
 * @returns {Once}
 */
export function fittedOnce(field, { bounds, areLeftOut }) {
    const rows = field.length / 3;
    const begins = Array.from({ length: rows }, (_, row) => row);
    if (!bounds.length) return { field, first: begins, last: begins };
    for (const [begin, end] of bounds) begins.fill(areLeftOut ? -1 : begin, begin, end);
    const first = begins.filter((begin, row) => begin === row);
    const last = areLeftOut ? first : first.map((_, i) => (first[i + 1] ?? rows) - 1);
    const means = first.flatMap((begin, i) => meanOf(field, begin, last[i] + 1));
    return { field: Float64Array.from(means), first, last };
}

/**
 * The three longest rests: first and last reading, first and last time of each.
 * @param {Rests} rests
 * @param {Float64Array | null} time
 * @returns {number[][]}
 */
export function longestRests({ bounds }, time) {
    const longest = [...bounds].sort((one, other) => one[0] - one[1] - (other[0] - other[1])).slice(0, 3);
    return longest.map(([begin, end]) => [begin + 1, end, ...(time ? [time[begin], time[end - 1]] : [NaN, NaN])]);
}

/**
 * A rest in words.
 * @param {number[]} rest
 * @returns {string}
 */
export function restWords([first, last, start, end]) {
    return start <= end ? `${start.toFixed(1)}–${end.toFixed(1)} s` : `readings ${first}–${last}`;
}

/**
 * @param {Float64Array} field
 * @param {number} begin
 * @param {number} end
 * @returns {number[]}
 */
function meanOf(field, begin, end) {
    const sum = [0, 0, 0];
    for (let i = 3 * begin; i < 3 * end; i++) sum[i % 3] += field[i];
    return sum.map((part) => part / (end - begin));
}
