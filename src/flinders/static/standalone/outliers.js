/** Readings that a fit left out: `flinders.estimators.data.left_out` and `flinders.estimators.outliers`. */

import { grouped } from "./numbers.js";
import { counted } from "./wording.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./rests.js").Once} Once */

/**
 * A run of readings that do not belong to the rest.
 * @typedef {object} Outlier
 * @property {number} first
 * @property {number} last Counted from 1, of those at no end of an axis.
 * @property {number} rows Outliers among them.
 * @property {number} fitted Those of them that a fit would have gone by, each rest as one or none.
 * @property {number} start
 * @property {number} end Seconds; NaN without times.
 * @property {number} farthest Largest distance from the ellipsoid.
 */

/**
 * Which readings are far from a surface, or in a run of such and around it.
 * @param {Float64Array} distances Not below zero.
 * @param {number} limit
 * @param {number} dense Far readings of a window that make a run.
 * @param {EngineData} data
 * @returns {Uint8Array}
 */
export function leftOut(distances, limit, dense, { numbers }) {
    const far = Uint8Array.from(distances, (distance) => Number(distance > limit));
    const half = Math.floor(numbers.WINDOW / 2);
    const out = far.slice();
    let inside = 0;
    for (let i = -half; i < far.length; i++) {
        inside += (far[i + half] ?? 0) - (far[i - half - 1] ?? 0);
        if (far[i] && inside >= dense) out.fill(1, Math.max(i - numbers.MARGIN, 0), i + numbers.MARGIN + 1);
    }
    return out;
}

/**
 * The runs of what is left out of readings that a fit goes by.
 * @param {Uint8Array} out
 * @param {Float64Array} distances
 * @param {Float64Array | null} time Of all readings.
 * @param {Once} once
 * @param {EngineData} data
 * @returns {Outlier[]}
 */
export function runsOf(out, distances, time, { first, last }, { numbers }) {
    /** @type {(Outlier & {at: number})[]} */
    const runs = [];
    out.forEach((isOut, i) => {
        if (!isOut) return;
        const [start, end] = time ? [time[first[i]], time[last[i]]] : [NaN, NaN];
        const [rows, run] = [last[i] - first[i] + 1, runs.at(-1)];
        if (run && (i - run.at <= numbers.TOGETHER || runs.length >= numbers.LISTED)) {
            const farthest = Math.max(run.farthest, distances[i]);
            Object.assign(run, { at: i, last: last[i] + 1, rows: run.rows + rows, fitted: run.fitted + 1, end, farthest });
        } else {
            runs.push({ at: i, first: first[i] + 1, last: last[i] + 1, rows, fitted: 1, start, end, farthest: distances[i] });
        }
    });
    return runs;
}

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
