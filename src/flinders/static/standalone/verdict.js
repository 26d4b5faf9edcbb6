/**
 * Is this calibration fit for use? Rules and sentences are the catalogue of the program (`flinders.findings`); what they
 * compare and state is calculated here as in `flinders.fitting.verdict`.
 */

import { movement } from "./advice.js";
import { longestRuns, outlierCount, outlierRows } from "./outliers.js";
import { figures, general, grouped } from "./numbers.js";
import { longestRests } from "./rests.js";
import { angle, counted, filled } from "./wording.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./data.d.ts").Row} Row */
/** @typedef {import("./data.d.ts").Rule} Rule */
/** @typedef {import("./data.d.ts").Severity} Severity */
/** @typedef {import("./fit.js").Fit} Fit */

/**
 * Something to know about a fit.
 * @typedef {{code: string, severity: Severity, number: number, limit: number, advice: string}} Finding
 */

const DEG = 180 / Math.PI;
const UPSIDE_DOWN = 180;
const TILTS = [10, 30, 90];
/** @type {Severity[]} */
const SEVERITIES = ["refuses", "limits", "note"];
/** @type {Record<string, (one: number, other: number) => boolean>} */
const COMPARISONS = { "<": (one, other) => one < other, ">": (one, other) => one > other, ">=": (one, other) => one >= other };

/**
 * Say what there is to know about a fit, the most severe first.
 * @param {Fit} fit
 * @returns {Finding[]}
 */
export function judge(fit) {
    const record = quantities(fit);
    const valueOf = (/** @type {string} */ name) => record[name] ?? words(fit, name);
    const findings = fit.data.rows.flatMap((row) => {
        const severity = severityOf(row.rule, record);
        return severity ? [{ row, finding: stated(row, severity, record, valueOf) }] : [];
    });
    const isFlat = findings.some(({ finding }) => finding.code === "one-plane");
    const shown = findings.filter(({ row }) => !isFlat || row.is_of_recording || row.code === "one-plane");
    return bySeverity(shown.map(({ finding }) => finding));
}

/**
 * The verdict that findings come to.
 * @param {Finding[]} findings
 * @returns {"good" | "limited" | "refused"}
 */
export function verdictOf(findings) {
    const has = (/** @type {Severity} */ severity) => findings.some((finding) => finding.severity === severity);
    return has("refuses") ? "refused" : has("limits") ? "limited" : "good";
}

/**
 * @param {Finding[]} findings
 * @returns {Finding[]}
 */
function bySeverity(findings) {
    return [...findings].sort((one, other) => SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity));
}

/**
 * How severe a rule finds a record; null where it does not hold.
 * @param {Rule} rule
 * @param {Record<string, number>} record
 * @returns {Severity | null}
 */
function severityOf({ quantity, comparison, grades, needs }, record) {
    const limit = (/** @type {number} */ factor, /** @type {string} */ of) => (of ? factor * record[of] : factor);
    /** @type {Severity | null} */
    let severity = null;
    for (const [worse, factor, of] of grades) {
        if (!COMPARISONS[comparison](record[quantity], limit(factor, of))) break;
        severity = worse;
    }
    const isNeeded = needs.every(([name, compares, factor, of]) => COMPARISONS[compares](record[name], limit(factor, of)));
    return isNeeded ? severity : null;
}

/**
 * @param {Row} row
 * @param {Severity} severity
 * @param {Record<string, number>} record
 * @param {(name: string) => number | string} valueOf
 * @returns {Finding}
 */
function stated({ code, rule, said }, severity, record, valueOf) {
    const [factor, of] = rule.limit ?? [rule.grades[0][1], rule.grades[0][2]];
    const limit = of ? factor * record[of] : factor;
    return { code, severity, number: record[rule.number || rule.quantity], limit, advice: filled(said, valueOf) };
}

/**
 * Findings that follow from no other, causes first; a cause is as severe as what follows from it.
 * @param {Finding[]} findings
 * @param {EngineData} data
 * @returns {Finding[]}
 */
export function firstCauses(findings, { causes }) {
    const rank = (/** @type {{severity: Severity}} */ { severity }) => SEVERITIES.indexOf(severity);
    /** @type {Finding[]} */
    const shown = [];
    let left = findings;
    for (const cause of causes) {
        const own = left.filter((finding) => finding.code === cause.code && rank(finding) <= rank(cause));
        if (!own.length || findings.some((finding) => finding.code === cause.unless)) continue;
        const hidden = left.filter((finding) => cause.consequences.includes(finding.code));
        const worst = Math.min(...[...own, ...hidden].map(rank));
        shown.push(...own.map((finding) => ({ ...finding, severity: SEVERITIES[worst] })));
        left = left.filter((finding) => !own.includes(finding) && !hidden.includes(finding));
    }
    return bySeverity([...shown, ...left]);
}

/**
 * What rules compare and sentences state; not a number where something does not apply.
 * @param {Fit} fit
 * @returns {Record<string, number>}
 */
export function quantities(fit) {
    const { surface, targetDeg, samples, record, noise } = fit;
    return {
        target_deg: targetDeg,
        samples,
        worst_deg: Number.isNaN(fit.headingError.worst) ? Infinity : fit.headingError.worst,
        uncorrected_deg: fit.isShrunk ? fit.uncorrected.worst : NaN,
        is_planar: 0,
        hole_deg: record.hole_deg,
        covered: record.coverage,
        unobserved: record.unobserved,
        prior_share: record.unobserved ? NaN : record.prior_influence,
        noise_share: noise / surface.radius,
        inflation: (2 * surface.axes[2]) / Math.max(fit.statistics.extent, Number.MIN_VALUE),
        ...flatness(fit),
        ...independence(fit),
        ...changes(fit),
        ...structure(fit),
        ...ofCalibration(fit),
        ...ofRecording(fit),
    };
}

/** @param {Fit} fit */
function flatness({ whole, noise, data }) {
    const [thickness, , width] = whole.principal_variances.map(Math.sqrt);
    return { flatness: width ? thickness / width : NaN, flatness_limit: width ? flatBelow(width, noise, data) / width : NaN };
}

/**
 * Thickness below which readings are flat.
 * @param {number} width
 * @param {number} noise
 * @param {EngineData} data
 * @returns {number}
 */
function flatBelow(width, noise, { numbers }) {
    return Math.min(Math.max(numbers.FLAT_NOISE * noise, numbers.FLAT * width), numbers.FLATTEST * width);
}

/** @param {Fit} fit */
function independence({ independent, samples, data }) {
    const least = Math.min(independent, samples);
    return {
        independent: least,
        independent_needed: least === samples ? data.numbers.ENOUGH : data.numbers.ENOUGH_CORRELATED,
        independent_share: least / Math.max(samples, 1),
    };
}

/** @param {Fit} fit */
function changes(fit) {
    const { drift, swap, correlation, statistics, noise, surface, headingError, samples } = fit;
    const { outliers } = fit.left;
    const next = correlation?.lagOne ?? 0;
    const repeated = statistics.fittedRepeats / Math.max(statistics.fitted, 1);
    const unlike = Math.max(next - repeated, 0) / Math.max(1 - repeated, Number.EPSILON);
    const level = surface.radius * Math.cos(headingError.dipDeg / DEG);
    const off = Math.sqrt(Math.max(-3 * next, 0)) * noise;
    const { ALTERNATING, UNSTEADY, SWITCHING, STEPS } = fit.data.numbers;
    const isSwitching = (correlation?.steps ?? NaN) > STEPS;
    return {
        drift_deg: drift?.headingDeg ?? NaN,
        drift_allowed_deg: fit.targetDeg,
        drift_by_chance: drift?.byChance ?? NaN,
        drift: drift ? Math.hypot(...drift.offset) : NaN,
        swap_gain: swap?.gain ?? NaN,
        noise_lasts: correlation?.lasting ?? 0,
        unlike_correlation: unlike,
        unsteady_deg: (DEG * noise * Math.sqrt(unlike)) / level,
        unsteady_limit_deg: fit.targetDeg * (isSwitching ? SWITCHING : UNSTEADY),
        next_correlation: next,
        alternating_limit: Math.min(ALTERNATING, -4 / Math.sqrt(Math.max(samples, 1))),
        alternating_deg: DEG * Math.atan2(off, level),
        outlier_share: outlierRows(outliers) / Math.max(statistics.fitted, 1),
        farthest: outliers.length ? Math.max(...outliers.map(({ farthest }) => farthest)) : NaN,
    };
}

/** @param {Fit} fit */
function structure({ faults, nonlinearity, axisLag, structureDeg, distortion, surface }) {
    const bent = nonlinearity && faults.includes(nonlinearity) ? nonlinearity : null;
    const late = axisLag && faults.includes(axisLag) ? axisLag : null;
    return {
        structure_deg: structureDeg,
        structure_share: bent ? NaN : distortion / surface.radius,
        nonlinear_deg: bent?.headingDeg ?? NaN,
        nonlinear_share: bent?.share ?? NaN,
        lag_deg: late?.headingDeg ?? NaN,
    };
}

/** @param {Fit} fit */
function ofCalibration({ surface: { axes, radius }, unit, data: { numbers } }) {
    const nearest = Math.min(Math.max(radius, numbers.EARTH_WEAKEST), numbers.EARTH_STRONGEST);
    const isInCounts = unit === "counts";
    return {
        axis_ratio: axes[2] / axes[0],
        radius,
        nearest_earth: nearest,
        times_outside_earth: isInCounts ? NaN : Math.max(radius / nearest, nearest / radius),
        weakest: numbers.EARTH_WEAKEST,
        strongest: numbers.EARTH_STRONGEST,
        field_strength: radius,
        is_in_counts: Number(isInCounts),
        is_relative: 1,
        is_unaligned: 1,
        nothing: 0,
    };
}

/** @param {Fit} fit */
function ofRecording({ statistics }) {
    return {
        rows: statistics.rows,
        distinct: statistics.distinct,
        rail_share: Math.max(0, ...statistics.rails.map(({ share }) => share)),
        repeated_share: 1 - statistics.distinct / Math.max(statistics.rows, 1),
        at_rest_share: statistics.atRest / Math.max(statistics.rows, 1),
        step: statistics.step,
        path_correlation: statistics.isTimed ? NaN : statistics.pathCorrelation,
        backward_steps: statistics.backwardSteps,
        longest_step_s: statistics.longestStep,
        usual_step_s: statistics.usualStep,
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
    nonlinear_axis: ({ nonlinearity }) => nonlinearity?.axis ?? "",
    axis_lag: lagWords,
    swap: swapWords,
    halves: () => "",
    leave,
    outliers: ({ left }) => outlierCount(left.outliers),
    runs: ({ left }) => longestRuns(left.outliers),
    again,
    rests: ({ left: { rests, when } }) => longestRests(rests, when),
    rests_count: ({ left }) => (left.rests.areLeftOut ? "are left out" : "count as one reading each"),
    rails: ({ statistics }) => statistics.rails.map(railWords).join(", "),
    often: ({ statistics: { backwardSteps: times } }) => (times === 1 ? "once" : `${grouped(times)} times`),
};

/** Words that sentences may take, beside the quantities. */
export const NAMES = Object.keys(WORDS);

/**
 * A word of a sentence.
 * @param {Fit} fit
 * @param {string} name
 * @returns {string}
 */
function words(fit, name) {
    return WORDS[name](fit);
}

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
function whereFlat({ whole, noise, data }) {
    const [, middle, width] = whole.principal_variances.map(Math.sqrt);
    return middle > flatBelow(width, noise, data)
        ? "in one plane, as in a level turn, and tell nothing of the direction across it"
        : "on one line, as of two attitudes, and tell nothing of the directions across it";
}

/** @param {Fit} fit */
function independentReadings({ independent, samples }) {
    const least = Math.min(independent, samples);
    const alike = "the others repeat them, or err alike, as where the field is not the same everywhere";
    const others = least === samples ? "" : ` (of ${grouped(samples)}: ${alike})`;
    return `${counted(least, "independent reading")}${others}`;
}

/** @param {Fit} fit */
function correlationWords({ correlation, textbookWorstDeg }) {
    const next = correlation ? `each with the next by ${correlation.lagOne.toFixed(2)}` : "";
    const claim = textbookWorstDeg === null ? "" : `without regard to it ${figures(textbookWorstDeg)}° would be claimed`;
    const parts = [next, claim].filter(Boolean);
    return parts.length ? ` (${parts.join("; ")})` : "";
}

/** @param {Fit} fit */
function lagWords({ record: { axis_lag: lags }, statistics }) {
    const axis = lags.reduce((most, lag, i) => (Math.abs(lag) > Math.abs(lags[most]) ? i : most), 0);
    const apart = 1.5 * lags[axis];
    const amount = statistics.isTimed ? `${Math.abs(apart * 1000).toFixed(0)} ms` : `${Math.abs(apart).toFixed(2)} readings`;
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
function leave(fit) {
    if (fit.uncorrected.worst > fit.data.numbers.NOT_BY_CHANCE * fit.headingError.worst) {
        return "the calibration is worth having";
    }
    const isCovered = fit.record.hole_deg <= fit.data.numbers.COVERAGE_LIMIT;
    return isCovered ? "leave them as they are" : "leave them as they are, or turn the sensor further";
}

/** @param {Fit} fit */
function again({ left, statistics, data }) {
    const share = outlierRows(left.outliers) / Math.max(statistics.fitted, 1);
    return share > data.numbers.OUTLIERS_LIMIT ? "; see what it was, and record again without" : "";
}

/** @param {import("./fit.js").Rail} rail */
function railWords({ share, end, axis, value }) {
    return `${(100 * share).toFixed(1)}% sit at the ${end} value of ${"xyz"[axis]} (${general(value)})`;
}
