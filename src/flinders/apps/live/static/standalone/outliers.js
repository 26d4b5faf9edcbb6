/** Words on runs of outliers, as `flinders.estimators.outliers`. */

import { groupText } from "./numbers.js";

/**
 * A run of outliers.
 * @typedef {object} Outlier
 * @property {number} first First row, counted from 1, among readings at no end of an axis.
 * @property {number} last Last row, counted in the same way.
 * @property {number} rows Number of outliers.
 * @property {number} fitted Number of outliers as the fit counts them, with each rest as one reading or none.
 * @property {number} start
 * @property {number} end Seconds; NaN without times.
 * @property {number} farthest Largest distance from the ellipsoid.
 */

/**
 * A run of outliers in words, as `flinders.findings.words.outlier_run`.
 * @param {number[]} run First and last reading, outliers, first and last time, outliers in the terms of the fit.
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
 * The three longest runs, for `runWords`.
 * @param {Outlier[]} runs
 * @returns {number[][]}
 */
export function longestRuns(runs) {
    const worst = [...runs].sort((one, other) => other.rows - one.rows).slice(0, 3);
    return worst.map(({ first, last, rows, start, end, fitted }) => [first, last, rows, start, end, fitted]);
}

/**
 * Number of readings in runs, with each rest as one or none.
 * @param {Outlier[]} runs
 * @returns {number}
 */
export function outlierRows(runs) {
    return runs.reduce((sum, run) => sum + run.fitted, 0);
}
