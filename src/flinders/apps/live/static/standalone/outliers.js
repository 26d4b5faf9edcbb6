/** Runs of readings that a fit left out, in words: `flinders.estimators.outliers`. */

import { groupText } from "./numbers.js";

/**
 * A run of readings that do not belong to the rest.
 * @typedef {object} Outlier
 * @property {number} first Row of the first one, and …
 * @property {number} last … of the last one, counted from 1, of those at no end of an axis.
 * @property {number} rows Outliers among them.
 * @property {number} fitted Those of them that a fit would have gone by, each rest as one or none.
 * @property {number} start
 * @property {number} end Seconds; NaN without times.
 * @property {number} farthest Largest distance from the ellipsoid.
 */

/**
 * A run in words: `flinders.findings.words.outlier_run`.
 * @param {number[]} run First and last reading, outliers, first and last time, those that a fit would have gone by.
 * @returns {string}
 */
export function runWords([first, last, rows, start, end, fitted]) {
    const many = rows > 1 ? `${groupText(rows)} readings${fitted === 1 ? " at rest" : ""}` : "a reading";
    if (start <= end) {
        return rows === 1 ? `${start.toFixed(1)} s: ${many}` : `${start.toFixed(1)}–${end.toFixed(1)} s: ${many}`;
    }
    return first === last ? `reading ${first}` : `readings ${first}–${last}: ${many}`;
}

/**
 * The three longest runs, as `runWords` takes them.
 * @param {Outlier[]} runs
 * @returns {number[][]}
 */
export function longestRuns(runs) {
    const worst = [...runs].sort((one, other) => other.rows - one.rows).slice(0, 3);
    return worst.map(({ first, last, rows, start, end, fitted }) => [first, last, rows, start, end, fitted]);
}

/**
 * Readings of runs, each rest as one or none.
 * @param {Outlier[]} runs
 * @returns {number}
 */
export function outlierRows(runs) {
    return runs.reduce((sum, run) => sum + run.fitted, 0);
}
