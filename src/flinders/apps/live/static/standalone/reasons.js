/** Reasons against a calibration in addition to its verdict. */

import { correctedVectors, threes } from "./coverage.js";
import { dot, unit } from "../../../../static/views/vectors.js";
import { figures, general, groupText } from "./numbers.js";
import { adviceOf, firstCauses, plainValues } from "./findings.js";
import { phrase } from "../language.js";

/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./fit.js").Refusal} Refusal */
/** @typedef {import("./outliers.js").Outlier} Outlier */
/** @typedef {import("./findings.js").Finding} Finding */
/** @typedef {{field: Float64Array, time: Float64Array}} Readings */

const DEG = 180 / Math.PI;
/** Duration, s, and number of equal readings after which a sensor counts as stopped. */
const [STALE_S, STALE_ROWS] = [2, 10];
/** Duration, s, and number of readings after which a constant axis is reported. */
const [FROZEN_S, FROZEN_ROWS] = [2, 20];
/** Smallest share of earlier readings in which that axis had changed; a coarse axis is often constant for a while. */
const MIN_CHANGES_SHARE = 0.9;
/** Smallest motion of the other axes in that time, as a share of their range so far. */
const MIN_MOTION_SHARE = 0.1;
/** Duration without a turn, s, after which the user is reminded, and smallest angle of a turn, degrees. */
const [STILL_S, STILL_DEG] = [2, 5];
/**
 * Findings of a fit are shown once its error in targets is small enough, or enough of the sphere is covered, or after
 * enough seconds of readings.
 */
const [CONVERGED, CONVERGED_FRACTION, CONVERGED_S] = [5, 0.7, 30];
/** Smallest share of outliers in an interval to be left out, and largest number of such intervals. */
const [DENSE, OFFERED] = [0.5, 3];
/** Alarms that further turning cannot end. */
export const AT_ONCE = ["saturated", "soft-iron-changed"];
/** Alarms that may end if the intervals with most outliers are left out. */
const DISTURBED = ["field-changed", "outliers"];
/** Findings that are shown at once and are not warnings. */
const INFORMATION = ["stale-repeats", "mirrored-axes"];
/** Factors of readings in another unit that are treated as µT. */
const OTHER_UNITS = { T: 1e-6, mT: 1e-3, G: 1e-2, mG: 10, nT: 1e3 };

/**
 * @param {string} code
 * @param {string} advice
 * @param {Reason["severity"]} severity
 * @param {Reason["spans"]} spans
 * @param {Reason["values"]} values  of its sentence in another language
 * @returns {Reason}
 */
function reason(code, advice, severity = "warning", spans = [], values = {}) {
    return { code, advice, severity, spans, values };
}

/**
 * Reasons for a refusal; too few readings are not a fault.
 * @param {Refusal} refusal
 * @returns {Reason[]}
 */
export function ofRefusal({ code, words }) {
    if (code === "stuck-axis" || code === "out-of-scale") return [reason(code, words, "warning", [], { refusal: code })];
    return [reason(code === "unmoved" ? "no-rotation" : code, words, "info", [], { refusal: code })];
}

/**
 * Reasons by the findings of a fit; none at the beginning.
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @param {Readings} readings
 * @returns {Reason[]}
 */
export function ofFit(fit, findings, { time }) {
    const { rows } = fit.data;
    const isConverged =
        fit.headingError.worst < CONVERGED * fit.targetDeg ||
        fit.record.coverage >= CONVERGED_FRACTION ||
        time[time.length - 1] - time[0] >= CONVERGED_S;
    const spans = disturbedSpans(fit, findings);
    const isAlarm = new Set(rows.filter(({ alarm }) => alarm).map(({ code }) => code));
    const reasons = firstCauses(fit).flatMap((finding) => {
        const { code, severity } = finding;
        if (isAlarm.has(code) && severity !== "note" && (isConverged || AT_ONCE.includes(code))) {
            const of = DISTURBED.includes(code) ? spans : [];
            return [ofFinding(finding, fit, of.length ? "info" : "warning", of)];
        }
        return INFORMATION.includes(code) ? [ofFinding(finding, fit, "info")] : [];
    });
    const isFlat = findings.some(({ code }) => code === "one-plane");
    return isConverged && !isFlat ? [...reasons, ...ofUnit(fit)] : reasons;
}

/**
 * @param {Finding} finding
 * @param {Fit} fit
 * @param {Reason["severity"]} severity
 * @param {Reason["spans"]} [spans]
 * @returns {Reason}
 */
function ofFinding(finding, { data }, severity, spans = []) {
    const { code, number, limit } = finding;
    return reason(code, adviceOf(finding, data), severity, spans, { number, limit, values: plainValues(finding) });
}

/**
 * The longest intervals of outliers; none if outliers are few.
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @returns {[number, number][]}
 */
function disturbedSpans({ left: { outliers } }, findings) {
    if (findings.every(({ code, severity }) => code !== "outliers" || severity === "note")) return [];
    const runs = joinRuns(outliers).filter(({ start, end }) => start < end);
    const longest = runs.sort((one, other) => other.end - other.start - (one.end - one.start)).slice(0, OFFERED);
    return longest.map(({ start, end }) => /** @type {[number, number]} */ ([start, end])).sort(([one], [other]) => one - other);
}

/**
 * Runs merged if most readings from the first to the last are outliers.
 * @param {Outlier[]} outliers
 * @returns {Outlier[]}
 */
function joinRuns(outliers) {
    return outliers.reduce((/** @type {Outlier[]} */ runs, run) => {
        const before = runs.at(-1);
        if (!before || before.rows + run.rows <= DENSE * (run.last - before.first + 1)) return [...runs, run];
        const whole = { ...run, first: before.first, start: before.start, rows: before.rows + run.rows };
        return [...runs.slice(0, -1), whole];
    }, []);
}

/**
 * Reason if the strength differs from the earth's field, with a unit that would explain it.
 * @param {Fit} fit
 * @returns {Reason[]}
 */
function ofUnit({ unit, surface: { radius }, data: { numbers } }) {
    const [low, high] = [numbers.EARTH_WEAKEST, numbers.EARTH_STRONGEST];
    if (unit === "counts" || (low <= radius && radius <= high)) return [];
    const likely = Object.entries(OTHER_UNITS).find(([, factor]) => low <= radius / factor && radius / factor <= high);
    const values = { strength: figures(radius, 3), low: general(low), high: general(high), unit: likely?.[0] ?? "" };
    const words = likely
        ? phrase(
              "reason.other-unit",
              "the field is {strength} µT, and the earth's {low} to {high} µT: as readings in {unit} would be; try {unit} as their " +
                  "unit. Headings do not depend on it",
              values,
          )
        : phrase(
              "reason.wrong-unit",
              "the field is {strength} µT, and the earth's {low} to {high} µT: check unit and scale. Headings do not depend on it",
              values,
          );
    return [reason("wrong-unit", words, "warning", [], likely ? { ...values, phrase: "other-unit" } : values)];
}

/**
 * Reasons if the newest readings do not change, or do not turn.
 * @param {Readings} readings
 * @param {Fit | null} fit
 * @param {boolean} isFlat
 * @returns {Reason[]}
 */
export function ofMotion({ field, time }, fit, isFlat) {
    const count = time.length;
    if (!count) return [];
    const last = time[count - 1];
    const same = equalAtTheEnd(field, [0, 1, 2]);
    if (same >= STALE_ROWS && last - time[count - same] >= STALE_S) return [stale(groupText(same))];
    const frozen = frozenAxis({ field, time });
    if (frozen) return [frozenReason(frozen)];
    if (!fit || isFlat || !(last - time[0] > STILL_S)) return [];
    const newest = field.filter((_, i) => time[Math.floor(i / 3)] >= last - STILL_S);
    if (newest.length <= 9 || widestDeg(correctedVectors(newest, fit.surface)) >= STILL_DEG) return [];
    return [still({ seconds: general(STILL_S) })];
}

/** @param {string} count  of readings @returns {Reason} */
function stale(count) {
    const words = phrase(
        "reason.stale",
        "the last {count} readings are all the same: the sensor has stopped measuring, or a loop prints faster than it is read; " +
            "check its wiring and its mode",
        { count },
    );
    return reason("stale", words, "warning", [], { count });
}

/** @param {{axis: string, seconds: string}} frozen @returns {Reason} */
function frozenReason(frozen) {
    const words = phrase(
        "reason.frozen-axis",
        "axis {axis} has been the same for {seconds} s while the others change: turn the sensor another way, and where that does " +
            "not wake it, the sensor or its wiring is at fault; then start again",
        frozen,
    );
    return reason("frozen-axis", words, "warning", [], frozen);
}

/** @param {{seconds: string}} values @returns {Reason} */
function still(values) {
    return reason("no-rotation", phrase("reason.no-rotation", "it has not been turned for {seconds} s", values), "info", [], values);
}

/**
 * Axis that is constant in the newest readings while the others move, with the duration in seconds; null without one.
 * @param {Readings} readings
 * @returns {{axis: string, seconds: string} | null}
 */
function frozenAxis({ field, time }) {
    const count = time.length;
    const range = (/** @type {number} */ axis, /** @type {number} */ from) => rangeOf(field, axis, from, count);
    for (const axis of [0, 1, 2]) {
        const run = equalAtTheEnd(field, [axis]);
        const seconds = time[count - 1] - time[count - run];
        if (run < FROZEN_ROWS || run >= count || seconds < FROZEN_S) continue;
        const others = [0, 1, 2].filter((other) => other !== axis);
        const isMoving = others.every((other) => range(other, count - run) >= MIN_MOTION_SHARE * range(other, 0));
        if (isMoving && changesBefore(field, axis, count - run) >= MIN_CHANGES_SHARE) {
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
 * Share of changes in the steps of an axis up to a reading.
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
 * Number of readings at the end that are equal in some axes.
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
 * Largest angle of directions from their mean, degrees.
 * @param {Float64Array} vectors
 * @returns {number}
 */
function widestDeg(vectors) {
    const directions = threes(vectors).map(unit);
    const mean = unit([0, 1, 2].map((axis) => directions.reduce((sum, direction) => sum + direction[axis], 0)));
    const lowest = directions.reduce((least, direction) => Math.min(least, dot(direction, mean)), 1);
    return DEG * Math.acos(Math.max(lowest, -1));
}
