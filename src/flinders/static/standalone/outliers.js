/** Runs of readings that a fit left out, in words: `flinders.estimators.outliers`. */

import { grouped } from "./numbers.js";
import { counted } from "./wording.js";

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
 * A run in words.
 * @param {Outlier} run
 * @returns {string}
 */
function runWords({ first, last, rows, fitted, start, end }) {
    const many = rows > 1 ? `${grouped(rows)} readings${fitted === 1 ? " at rest" : ""}` : "a reading";
    if (start <= end) {
        return rows === 1 ? `${start.toFixed(1)} s: ${many}` : `${start.toFixed(1)}–${end.toFixed(1)} s: ${many}`;
    }
    return first === last ? `reading ${first}` : `readings ${first}–${last}: ${many}`;
}

/**
 * The three longest runs in words.
 * @param {Outlier[]} runs
 * @returns {string}
 */
export function longestRuns(runs) {
    const worst = [...runs].sort((one, other) => other.rows - one.rows).slice(0, 3);
    return worst.map(runWords).join("; ") + (runs.length > worst.length ? "; …" : "");
}

/**
 * How many readings they are, each rest as one or none.
 * @param {Outlier[]} runs
 * @returns {string}
 */
export function outlierCount(runs) {
    return counted(outlierRows(runs), "reading");
}

/**
 * Readings of runs, each rest as one or none.
 * @param {Outlier[]} runs
 * @returns {number}
 */
export function outlierRows(runs) {
    return runs.reduce((sum, run) => sum + run.fitted, 0);
}
