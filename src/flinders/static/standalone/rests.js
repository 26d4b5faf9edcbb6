/** Readings with each rest as one, its mean: `flinders.estimators.rests`. */

/**
 * @typedef {object} Averaged
 * @property {Float64Array} field Three numbers a reading.
 * @property {number[]} first Row at which each reading begins, before rests were averaged, and …
 * @property {number[]} last … at which it ends.
 */

/**
 * Average each rest.
 * @param {Float64Array} field
 * @param {[number, number][]} rests First row of each, and the row behind its last.
 * @returns {Averaged}
 */
export function averaged(field, rests) {
    const rows = field.length / 3;
    const first = Array.from({ length: rows }, (_, row) => row);
    for (const [begin, end] of rests) first.fill(begin, begin, end);
    const begins = first.filter((begin, row) => begin === row);
    const last = begins.map((_, i) => (begins[i + 1] ?? rows) - 1);
    const means = begins.flatMap((begin, i) => meanOf(field, begin, last[i] + 1));
    return { field: Float64Array.from(means), first: begins, last };
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
