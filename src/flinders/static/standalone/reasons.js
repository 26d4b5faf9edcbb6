/** What speaks against a calibration beside its verdict: `flinders.live.evaluation`, with the same sentences. */

import { corrected, threes } from "./coverage.js";
import { dot } from "./linear.js";
import { figures, general } from "./numbers.js";
import { adviceOf, firstCauses } from "./findings.js";
import { counted, filled } from "./wording.js";

/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./fit.js").Refusal} Refusal */
/** @typedef {import("./outliers.js").Outlier} Outlier */
/** @typedef {import("./findings.js").Finding} Finding */
/** @typedef {{field: Float64Array, time: Float64Array}} Readings */

const DEG = 180 / Math.PI;

/**
 * @param {string} code
 * @param {string} advice
 * @param {Reason["severity"]} severity
 * @param {Reason["spans"]} spans
 * @returns {Reason}
 */
function reason(code, advice, severity = "warning", spans = []) {
    return { code, advice, severity, spans };
}

/**
 * Why there is no fit; that there are too few readings yet is no fault.
 * @param {Refusal} refusal
 * @returns {Reason[]}
 */
export function ofRefusal({ code, words }) {
    if (code === "stuck-axis" || code === "out-of-scale") return [reason(code, words)];
    return [reason(code === "unmoved" ? "no-rotation" : code, words, "info")];
}

/**
 * What the findings of a fit say is wrong; of one that is only beginning, nothing yet.
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @param {Readings} readings
 * @returns {Reason[]}
 */
export function ofFit(fit, findings, { time }) {
    const { numbers, rows, at_once, disturbed, informative } = fit.data;
    const isConverged =
        fit.headingError.worst < numbers.CONVERGED * fit.targetDeg ||
        fit.record.coverage >= numbers.CONVERGED_FRACTION ||
        time[time.length - 1] - time[0] >= numbers.CONVERGED_S;
    const spans = disturbedSpans(fit, findings);
    const isAlarm = new Set(rows.filter(({ alarm }) => alarm).map(({ code }) => code));
    const reasons = firstCauses(fit).flatMap((finding) => {
        const { code, severity } = finding;
        if (isAlarm.has(code) && severity !== "note" && (isConverged || at_once.includes(code))) {
            return [reason(code, adviceOf(finding, fit.data), "warning", disturbed.includes(code) ? spans : [])];
        }
        return informative.includes(code) ? [reason(code, adviceOf(finding, fit.data), "info")] : [];
    });
    const isFlat = findings.some(({ code }) => code === "one-plane");
    return isConverged && !isFlat ? [...reasons, ...ofUnit(fit)] : reasons;
}

/**
 * The longest intervals that outliers fill; none where these are few.
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @returns {[number, number][]}
 */
function disturbedSpans({ left: { outliers }, data: { numbers } }, findings) {
    if (findings.every(({ code, severity }) => code !== "outliers" || severity === "note")) return [];
    const runs = joined(outliers, numbers.DENSE).filter(({ start, end }) => start < end);
    const longest = runs.sort((one, other) => other.end - other.start - (one.end - one.start)).slice(0, numbers.OFFERED);
    return longest.map(({ start, end }) => /** @type {[number, number]} */ ([start, end])).sort(([one], [other]) => one - other);
}

/**
 * Runs joined where most readings from the first to the last are outliers.
 * @param {Outlier[]} outliers
 * @param {number} dense
 * @returns {Outlier[]}
 */
function joined(outliers, dense) {
    return outliers.reduce((/** @type {Outlier[]} */ runs, run) => {
        const before = runs.at(-1);
        if (!before || before.rows + run.rows <= dense * (run.last - before.first + 1)) return [...runs, run];
        const whole = { ...run, first: before.first, start: before.start, rows: before.rows + run.rows };
        return [...runs.slice(0, -1), whole];
    }, []);
}

/**
 * Whether the field is none of the earth's, and which other unit would explain it.
 * @param {Fit} fit
 * @returns {Reason[]}
 */
function ofUnit({ unit, surface: { radius }, data: { numbers, said, other_units } }) {
    const [low, high] = [numbers.EARTH_WEAKEST, numbers.EARTH_STRONGEST];
    if (unit === "counts" || (low <= radius && radius <= high)) return [];
    const likely = Object.entries(other_units).find(([, factor]) => low <= radius / factor && radius / factor <= high);
    const hint = likely ? filled(said["other-unit"], () => likely[0]) : said["no-unit"];
    const values = { radius: figures(radius, 3), low: general(low), high: general(high), hint };
    return [reason("wrong-unit", filled(said["wrong-unit"], (name) => values[/** @type {"hint"} */ (name)]))];
}

/**
 * Whether the newest readings still change, and turn.
 * @param {Readings} readings
 * @param {Fit | null} fit
 * @param {boolean} isFlat
 * @param {EngineData} data
 * @returns {Reason[]}
 */
export function ofMotion({ field, time }, fit, isFlat, { numbers, said }) {
    const count = time.length;
    if (!count) return [];
    const last = time[count - 1];
    const same = equalAtTheEnd(field, [0, 1, 2]);
    if (same >= numbers.STALE_ROWS && last - time[count - same] >= numbers.STALE_S) {
        return [reason("stale", filled(said.stale, () => counted(same, "reading")))];
    }
    const frozen = frozenAxis({ field, time }, numbers);
    if (frozen) {
        return [reason("frozen-axis", filled(said["frozen-axis"], (name) => frozen[/** @type {"axis"} */ (name)]))];
    }
    if (!fit || isFlat || !(last - time[0] > numbers.STILL_S)) return [];
    const newest = field.filter((_, i) => time[Math.floor(i / 3)] >= last - numbers.STILL_S);
    if (newest.length <= 9 || widestDeg(corrected(newest, fit.surface)) >= numbers.STILL_DEG) return [];
    return [reason("no-rotation", filled(said["no-rotation"], () => general(numbers.STILL_S)), "info")];
}

/**
 * Which axis has stopped in the newest readings while the others move, and since how many seconds.
 * @param {Readings} readings
 * @param {Record<string, number>} numbers
 * @returns {{axis: string, seconds: string} | null}
 */
function frozenAxis({ field, time }, numbers) {
    const count = time.length;
    const range = (/** @type {number} */ axis, /** @type {number} */ from) => rangeOf(field, axis, from, count);
    for (const axis of [0, 1, 2]) {
        const run = equalAtTheEnd(field, [axis]);
        const seconds = time[count - 1] - time[count - run];
        if (run < numbers.FROZEN_ROWS || run >= count || seconds < numbers.FROZEN_S) continue;
        const others = [0, 1, 2].filter((other) => other !== axis);
        const isMoving = others.every((other) => range(other, count - run) >= numbers.MOVING * range(other, 0));
        if (isMoving && changesBefore(field, axis, count - run) >= numbers.LIVELY) {
            return { axis: "xyz"[axis], seconds: seconds.toFixed(1) };
        }
    }
    return null;
}

/**
 * @param {Float64Array} field
 * @param {number} axis
 * @param {number} from
 * @param {number} to
 * @returns {number}
 */
function rangeOf(field, axis, from, to) {
    let [low, high] = [Infinity, -Infinity];
    for (let i = from; i < to; i++) {
        low = Math.min(low, field[3 * i + axis]);
        high = Math.max(high, field[3 * i + axis]);
    }
    return high - low;
}

/**
 * Share of the steps of an axis up to a reading that are changes.
 * @param {Float64Array} field
 * @param {number} axis
 * @param {number} last
 * @returns {number}
 */
function changesBefore(field, axis, last) {
    let changes = 0;
    for (let i = 0; i < last; i++) changes += Number(field[3 * i + axis] !== field[3 * i + 3 + axis]);
    return changes / last;
}

/**
 * How many readings, counted from the end, are the same in some axes.
 * @param {Float64Array} field
 * @param {number[]} axes
 * @returns {number}
 */
function equalAtTheEnd(field, axes) {
    const count = field.length / 3;
    const isSame = (/** @type {number} */ i) => axes.every((axis) => field[3 * i + axis] === field[3 * (count - 1) + axis]);
    let first = count;
    while (first > 0 && isSame(first - 1)) first--;
    return count - first;
}

/**
 * How far directions are from their mean, at the most.
 * @param {Float64Array} vectors
 * @returns {number}
 */
function widestDeg(vectors) {
    const unit = (/** @type {number[]} */ vector) => vector.map((part) => part / (Math.hypot(...vector) || 1));
    const directions = threes(vectors).map(unit);
    const mean = unit([0, 1, 2].map((axis) => directions.reduce((sum, direction) => sum + direction[axis], 0)));
    const lowest = directions.reduce((least, direction) => Math.min(least, dot(direction, mean)), 1);
    return DEG * Math.acos(Math.max(lowest, -1));
}
