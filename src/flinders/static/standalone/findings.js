/** What there is to say of a judged fit: the sentences of the catalogue of findings, with their words. */

import { movement } from "./advice.js";
import { longestRuns, outlierCount } from "./outliers.js";
import { figures, general, grouped } from "./numbers.js";
import { longestRests } from "./rests.js";
import { angle, counted, filled } from "./wording.js";

/** @typedef {import("./data.d.ts").Severity} Severity */
/** @typedef {import("./fit.js").Fit} Fit */

/**
 * Something to know about a fit.
 * @typedef {{code: string, severity: Severity, number: number, limit: number, advice: string}} Finding
 */

const UPSIDE_DOWN = 180;
const TILTS = [10, 30, 90];
/** By the engine's numbers. @type {("" | Severity)[]} */
const SEVERITIES = ["", "note", "limits", "refuses"];
/** @type {("good" | "limited" | "refused")[]} */
const VERDICTS = ["good", "good", "limited", "refused"];

/**
 * What there is to say about a fit, the most severe first.
 * @param {Fit} fit
 * @returns {Finding[]}
 */
export function findingsOf(fit) {
    const { severities } = fit.judgement;
    const found = Array.from(severities.keys()).filter((rule) => severities[rule]);
    return found.sort((one, other) => severities[other] - severities[one]).map((rule) => stated(fit, rule, severities[rule]));
}

/**
 * Findings that follow from no other, causes first; a cause is as severe as what follows from it.
 * @param {Fit} fit
 * @returns {Finding[]}
 */
export function firstCauses(fit) {
    const { order, shown } = fit.judgement;
    return order.filter((rule) => rule < shown.length).map((rule) => stated(fit, rule, shown[rule]));
}

/**
 * The verdict on a fit.
 * @param {Fit} fit
 * @returns {"good" | "limited" | "refused"}
 */
export function verdictOf(fit) {
    return VERDICTS[fit.judgement.verdict];
}

/**
 * @param {Fit} fit
 * @param {number} rule
 * @param {number} severity
 * @returns {Finding}
 */
function stated(fit, rule, severity) {
    const { code, said, number, limit: [factor, of] } = fit.data.rows[rule]; // prettier-ignore
    const { quantities } = fit;
    return {
        code,
        severity: /** @type {Severity} */ (SEVERITIES[severity]),
        number: quantities[number],
        limit: of ? factor * quantities[of] : factor,
        advice: filled(said, (name) => quantities[name] ?? WORDS[name](fit)),
    };
}

/** @type {Record<string, (fit: Fit) => string>} */
const WORDS = {
    attitudes,
    movement,
    remedy: movement,
    why: () => "",
    unit: ({ unit }) => unit,
    length: ({ surface, unit }) => `${figures(surface.radius, 4)} ${unit}`,
    rings: ({ record }) => (record.unobserved === 1 ? ", as two rings of readings would" : ""),
    where_flat: whereFlat,
    independent_readings: independentReadings,
    correlation: correlationWords,
    nonlinear_axis: nonlinearAxis,
    axis_lag: lagWords,
    swap: swapWords,
    halves: () => "",
    leave,
    outliers: ({ left }) => outlierCount(left.outliers),
    runs: ({ left }) => longestRuns(left.outliers),
    again,
    rests: ({ left: { rests, when } }) => longestRests(rests, when),
    rests_count: ({ left }) => (left.rests.areLeftOut ? "are left out" : "count as one reading each"),
    rails: ({ rails }) => rails.map(railWords).join(", "),
    often: ({ record: { backward_steps: times } }) => (times === 1 ? "once" : `${grouped(times)} times`),
};

/** Words that sentences may take, beside the quantities. */
export const NAMES = Object.keys(WORDS);

/**
 * Up to which tilt the heading is within the target, and how fast it degrades beyond.
 * @param {Fit} fit
 * @returns {string}
 */
function attitudes(fit) {
    const { attitudeLimitDeg: limit, targetDeg } = fit;
    if (limit >= UPSIDE_DOWN) return `within ${general(targetDeg)}° at any attitude`;
    const beyond = [...TILTS, UPSIDE_DOWN].filter((tilt) => tilt > limit);
    const at = (/** @type {number} */ tilt) => (tilt === UPSIDE_DOWN ? "upside down" : `at ${tilt}°`);
    const worse = [...new Set([beyond[0], beyond[beyond.length - 1]])].map(
        (tilt) => `${angle(fit.tiltedWorstDeg(tilt))} ${at(tilt)}`,
    );
    if (limit < 1) return `good to ${angle(fit.headingError.worst)} while level; tilted, ${worse.join(", ")}`;
    return `within ${general(targetDeg)}° up to ${limit.toFixed(0)}° of tilt; ${worse.join(", ")}`;
}

/** @param {Fit} fit */
function whereFlat({ quantities }) {
    return quantities.breadth > quantities.flatness_limit
        ? "in one plane, as in a level turn, and tell nothing of the direction across it"
        : "on one line, as of two attitudes, and tell nothing of the directions across it";
}

/** @param {Fit} fit */
function independentReadings({ quantities: { independent, samples } }) {
    const alike = "the others repeat them, or err alike, as where the field is not the same everywhere";
    const others = independent === samples ? "" : ` (of ${grouped(samples)}: ${alike})`;
    return `${counted(independent, "independent reading")}${others}`;
}

/** @param {Fit} fit */
function correlationWords({ record: { lag_one: lagOne }, isShrunk, textbookWorstDeg }) {
    const next = Number.isNaN(lagOne) ? "" : `each with the next by ${lagOne.toFixed(2)}`;
    const claim = isShrunk ? "" : `without regard to it ${figures(textbookWorstDeg)}° would be claimed`;
    const parts = [next, claim].filter(Boolean);
    return parts.length ? ` (${parts.join("; ")})` : "";
}

/** @param {Fit} fit */
function nonlinearAxis({ record: { nonlinearity } }) {
    const sizes = [0, 1, 2].map((axis) => Math.abs(nonlinearity[axis]) + Math.abs(nonlinearity[3 + axis]));
    return "xyz"[sizes.indexOf(Math.max(...sizes))];
}

/** @param {Fit} fit */
function lagWords({ record: { axis_lag: lags }, isTimed }) {
    const axis = lags.reduce((most, lag, i) => (Math.abs(lag) > Math.abs(lags[most]) ? i : most), 0);
    const apart = 1.5 * lags[axis];
    const amount = isTimed ? `${Math.abs(apart * 1000).toFixed(0)} ms` : `${Math.abs(apart).toFixed(2)} readings`;
    return `axis ${"xyz"[axis]} is read ${amount} ${apart > 0 ? "later" : "earlier"} than the others`;
}

/** @param {Fit} fit */
function swapWords({ swap }) {
    if (!swap) return "";
    const { axes, rows } = swap;
    const what = axes.length === 1 ? `the sign of ${axes} turned` : `${axes[0]} and ${axes[1]} changed places`;
    const again = rows.length > 1 ? ` and back and forth, ${counted(rows.length - 1, "time")} more` : "";
    return `${grouped(rows[0] + 1)} on ${what}${again}:`;
}

/** @param {Fit} fit */
function leave({ quantities, record, data: { numbers } }) {
    if (quantities.uncorrected_deg > numbers.NOT_BY_CHANCE * quantities.worst_deg) return "the calibration is worth having";
    const isCovered = record.hole_deg <= numbers.COVERAGE_LIMIT;
    return isCovered ? "leave them as they are" : "leave them as they are, or turn the sensor further";
}

/** @param {Fit} fit */
function again({ quantities, data: { numbers } }) {
    return quantities.outlier_share > numbers.OUTLIERS_LIMIT ? "; see what it was, and record again without" : "";
}

/** @param {import("./fit.js").Rail} rail */
function railWords({ share, end, axis, value }) {
    return `${(100 * share).toFixed(1)}% sit at the ${end} value of ${"xyz"[axis]} (${general(value)})`;
}
