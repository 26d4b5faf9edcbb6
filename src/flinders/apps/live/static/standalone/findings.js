/**
 * Findings of a judged fit with the values of their sentences, and the sentences of the catalogue, as in
 * `flinders.fitting.verdict` and `flinders.findings.words`.
 */

import { nextMovement } from "./advice.js";
import { longestRuns, outlierRows, runWords } from "./outliers.js";
import { figures, general, groupText } from "./numbers.js";
import { longestRests, restWords } from "./rests.js";
import { angle, countWords, fillTemplate, UPSIDE_DOWN } from "./wording.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./data.d.ts").Severity} Severity */
/** @typedef {import("./fit.js").Fit} Fit */
/** Numbers, names, and lists of either, by name. @typedef {Record<string, any>} Values */

/**
 * A finding on a fit.
 * @typedef {object} Finding
 * @property {string} code
 * @property {Severity} severity
 * @property {number} number
 * @property {number} limit
 * @property {Values} values Values of its sentence.
 * @property {string | null} follows_from Code of its cause.
 */

/** Names of values that the plain words of findings take. */
const IN_PLAIN_WORDS = ["next_movement", "next_step", "corrected_length", "unit"];
const TILTS = [10, 30, 90];
/** Severities by the engine's numbers. @type {("" | Severity)[]} */
const SEVERITIES = ["", "note", "limits", "refuses"];
/** @type {("good" | "limited" | "refused")[]} */
const VERDICTS = ["good", "good", "limited", "refused"];

/**
 * Findings of a fit, the most severe first.
 * @param {Fit} fit
 * @returns {Finding[]}
 */
export function findingsOf(fit) {
    const { severities } = fit.judgement;
    const found = Array.from(severities.keys()).filter((rule) => severities[rule]);
    return found.sort((one, other) => severities[other] - severities[one]).map((rule) => stated(fit, rule, severities[rule]));
}

/**
 * Findings that follow from no other, causes first; a cause has the severity of its consequences.
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
 * Sentence on a finding and its remedy.
 * @param {Finding} finding
 * @param {EngineData} data
 * @returns {string}
 */
export function adviceOf({ code, values }, data) {
    const said = data.rows.find((row) => row.code === code)?.said ?? code;
    return fillTemplate(said, (name) => (WORDS[name] ? WORDS[name](values, data) : values[name]));
}

/**
 * Sentence on the effect of a finding for the user of the compass.
 * @param {Finding} finding
 * @param {EngineData} data
 * @returns {string}
 */
export function whyOf(finding, data) {
    return fillWords(finding, data.rows.find(({ code }) => code === finding.code)?.why ?? finding.code, data);
}

/**
 * Sentence on the user's remedy; empty without one.
 * @param {Finding} finding
 * @param {EngineData} data
 * @returns {string}
 */
export function remedyOf(finding, data) {
    const words = fillWords(finding, data.rows.find(({ code }) => code === finding.code)?.remedy ?? "", data);
    return words && `${words.charAt(0).toUpperCase()}${words.slice(1).replace(/\.$/, "")}.`;
}

/**
 * Fill the plain words of a finding with its number and limit.
 * @param {Finding} finding
 * @param {string} words
 * @param {EngineData} data
 * @returns {string}
 */
function fillWords({ number, limit, values }, words, data) {
    /** @type {Values} */
    const findingOf = { ...values, number, limit, angle: angle(number), seconds: figures(number) };
    return fillTemplate(words, (name) => (WORDS[name] ? WORDS[name](values, data) : findingOf[name]));
}

/**
 * Values that the plain words of a finding take beside number and limit.
 * @param {Finding} finding
 * @returns {Record<string, unknown>}
 */
export function plainValues({ values }) {
    return Object.fromEntries(IN_PLAIN_WORDS.filter((name) => name in values).map((name) => [name, values[name]]));
}

/**
 * @param {Fit} fit
 * @param {number} rule
 * @param {number} severity
 * @returns {Finding}
 */
function stated(fit, rule, severity) {
    const { code, number, limit: [factor, of], values: names } = fit.data.rows[rule]; // prettier-ignore
    const values = Object.fromEntries(names.map((name) => [name, valueOf(fit, name)]));
    const cause = fit.judgement.causes[rule];
    return {
        code,
        severity: /** @type {Severity} */ (SEVERITIES[severity]),
        number: values[number],
        limit: of ? factor * values[of] : factor,
        values,
        follows_from: cause && cause !== rule + 1 ? fit.data.rows[cause - 1].code : null,
    };
}

/**
 * A quantity of the judgement, or another value; NaN if missing.
 * @param {Fit} fit
 * @param {string} name
 * @returns {any}
 */
function valueOf(fit, name) {
    const quantity = fit.quantities[name] ?? NaN;
    return Number.isNaN(quantity) && VALUES[name] ? VALUES[name](fit) : quantity;
}

/** Values of findings in addition to the quantities. @type {Record<string, (fit: Fit) => any>} */
const VALUES = {
    attitude_limit_deg: ({ attitudeLimitDeg }) => attitudeLimitDeg,
    tilted: tiltedErrors,
    next_movement: nextMovement,
    next_step: nextStep,
    corrected_length: ({ strength }) => strength,
    previous: ({ renewed }) => renewed?.name ?? "",
    unit: ({ unit }) => unit,
    plane: ({ plane }) => plane,
    is_placed: ({ covariance, surface, data: { numbers } }) => Number(Math.sqrt(covariance[20]) < numbers.MAX_OFFSET_SIGMA * surface.radius),
    is_skewed: isSkewed,
    z_down: ({ zDown }) => (zDown === null ? NaN : Number(zDown)),
    autocorrelation: ({ record: { lag_one: lagOne } }) => lagOne,
    textbook_deg: ({ isShrunk, textbookWorstDeg }) => (isShrunk ? NaN : textbookWorstDeg),
    nonlinear_axis: nonlinearAxis,
    late_axis: ({ record: { axis_lag: lags } }) => "xyz"[mostLate(lags)],
    late_by: ({ record: { axis_lag: lags } }) => 1.5 * lags[mostLate(lags)],
    is_timed: ({ isTimed }) => Number(isTimed),
    swapped_axes: ({ swap }) => swap?.axes ?? "",
    swap_row: ({ swap }) => (swap ? swap.rows[0] + 1 : NaN),
    swap_count: ({ swap }) => swap?.rows.length ?? NaN,
    is_better: isBetter,
    is_covered: (fit) => Number(isCovered(fit)),
    outlier_count: ({ left }) => outlierRows(left.outliers),
    outlier_runs: ({ left }) => longestRuns(left.outliers),
    outlier_run_count: ({ left }) => left.outliers.length,
    rail_ends: ({ rails }) => rails.map(({ axis, end, value, share }) => ["xyz"[axis], end, value, share]),
    rest_spans: ({ left: { rests, when } }) => longestRests(rests, when),
    rest_count: ({ left }) => left.rests.bounds.length,
    are_rests_left_out: ({ left }) => Number(left.rests.areLeftOut),
};

/** Words made from values, by their names in sentences. @type {Record<string, (values: Values, data: EngineData) => string>} */
const WORDS = {
    attitudes,
    movement: ({ next_movement: next }, data) => stepWords(next, data),
    remedy: ({ next_step: next }, data) => stepWords(next, data),
    why_large: ({ next_step: [name] }, { reasons }) => reasons[name],
    because: causeWords,
    length: ({ corrected_length: strength, unit }) => `${figures(strength, 4)} ${unit}`,
    rings: ({ unobserved }) => (unobserved === 1 ? ", as for two rings of readings" : ""),
    where_flat: whereFlat,
    plane_axes: ({ plane }) => [...plane].join(" and "),
    where_placed: ({ is_placed: isPlaced }) => (isPlaced ? "and, with the field of the site, z" : "only"),
    assumed: ({ is_placed: isPlaced, z_down: zDown }) =>
        isPlaced ? ` (with ${zDown ? "z down, and " : ""}the floor level unless an accelerometer was recorded)` : "",
    where_z_points: ({ z_down: zDown }, { said }) => (Number.isNaN(zDown) ? said["z-open"] : zDown ? "" : said["z-elsewhere"]),
    mounting: ({ is_skewed: isSkewed, is_placed: isPlaced }) =>
        isSkewed && isPlaced ? "say how well the mounting is known, or " : "",
    independent_readings: independentReadings,
    correlation,
    axis_lag: lagWords,
    swap: swapWords,
    halves: () => "",
    leave: remedyWords,
    outliers: ({ outlier_count: count }) => countWords(count, "reading"),
    runs: ({ outlier_runs: runs, outlier_run_count: count }) => listSome(runs.map(runWords), count),
    again,
    rests: ({ rest_spans: rests, rest_count: count }) => listSome(rests.map(restWords), count),
    rests_treated: ({ are_rests_left_out: areOut }) => (areOut ? "are left out" : "count as one reading each"),
    rails: ({ rail_ends: ends }) => ends.map(railWords).join(", "),
    often: ({ backward_steps: times }) => (times === 1 ? "once" : `${groupText(times)} times`),
};

/** Names of further values in sentences. */
export const NAMES = { values: Object.keys(VALUES), words: Object.keys(WORDS) };

/**
 * First tilt with a heading error beyond the target, and the last tilt, with the worst error at each.
 * @param {Fit} fit
 * @returns {number[][]}
 */
function tiltedErrors(fit) {
    const beyond = [...TILTS, UPSIDE_DOWN].filter((tilt) => tilt > fit.attitudeLimitDeg);
    const ends = beyond.length ? [...new Set([beyond[0], beyond[beyond.length - 1]])] : [];
    return ends.map((tilt) => [tilt, fit.tiltedWorstDeg(tilt)]);
}

/**
 * Whether the shape across the plane of a turn is unknown.
 * @param {Fit} fit
 */
function isSkewed({ covariance, surface, data: { numbers } }) {
    const sigma = Math.sqrt(Math.max(...[6, 7, 8].map((i) => covariance[10 * i])));
    return Number(sigma > numbers.MIN_SHAPE_SIGMA * surface.radius);
}

/** @param {Fit} fit */
function nonlinearAxis({ record: { nonlinearity } }) {
    const sizes = [0, 1, 2].map((axis) => Math.abs(nonlinearity[axis]) + Math.abs(nonlinearity[3 + axis]));
    return "xyz"[sizes.indexOf(Math.max(...sizes))];
}

/**
 * The axis that differs most from the others.
 * @param {number[]} lags
 * @returns {number}
 */
function mostLate(lags) {
    return lags.reduce((most, lag, i) => (Math.abs(lag) > Math.abs(lags[most]) ? i : most), 0);
}

/** @param {Fit} fit */
function isBetter({ quantities, data: { numbers } }) {
    return Number(quantities.uncorrected_deg > numbers.MIN_IMPROVEMENT_SIGMAS * quantities.worst_deg);
}

/**
 * Words on the largest tilt within the target, and the errors beyond.
 * @param {Values} values
 * @returns {string}
 */
function attitudes({ attitude_limit_deg: limit, target_deg: target, worst_deg: worst, tilted }) {
    if (limit >= UPSIDE_DOWN) return `within ${general(target)}° at any attitude`;
    const at = (/** @type {number} */ tilt) => (tilt === UPSIDE_DOWN ? "upside down" : `at ${tilt}°`);
    const worse = tilted.map((/** @type {number[]} */ [tilt, error]) => `${angle(error)} ${at(tilt)}`).join(", ");
    if (limit < 1) return `good to ${angle(worst)} while level; tilted, ${worse}`;
    return `within ${general(target)}° up to ${limit.toFixed(0)}° of tilt; ${worse}`;
}

/**
 * @param {[string] | [string, number]} next
 * @param {EngineData} data
 * @returns {string}
 */
export function stepWords([name, pose], { steps, poses }) {
    return steps[name].replace("{}", pose === undefined ? "" : poses.sensor[pose]);
}

/** @param {Values} values */
function whereFlat({ breadth, flatness_limit: limit }) {
    return breadth > limit
        ? "in one plane, as in a level turn, and tell nothing of the direction across it"
        : "on one line, as of two attitudes, and tell nothing of the directions across it";
}

/** @param {Values} values */
function independentReadings({ independent, samples }) {
    const alike = "the others repeat them or share their errors";
    const others = independent === samples ? "" : ` (of ${groupText(samples)}; ${alike})`;
    return `${countWords(independent, "independent reading")}${others}`;
}

/**
 * The next step to reduce the heading error, with the number of a pose.
 * @param {Fit} fit
 * @returns {[string] | [string, number]}
 */
function nextStep(fit) {
    const isOfCorrelation = !fit.plane && isCorrelated(fit.headingError.worst, VALUES.textbook_deg(fit), isCovered(fit));
    return isOfCorrelation ? ["record-longer"] : nextMovement(fit);
}

/**
 * Whether every direction is near a reading.
 * @param {Fit} fit
 */
function isCovered({ record, data: { numbers } }) {
    return record.hole_deg <= numbers.COVERAGE_LIMIT;
}

/**
 * Whether correlated residuals, and not missing directions, cause a large heading error.
 * @param {number} worst
 * @param {number} textbook
 * @param {boolean} isCovered
 */
function isCorrelated(worst, textbook, isCovered) {
    return isCovered && 2 * textbook < worst;
}

/** @param {Values} values */
function causeWords({ worst_deg: worst, structure_deg: structure, textbook_deg: textbook, is_covered: isCovered }) {
    if (2 * structure ** 2 > worst ** 2) return `, ${figures(structure)}° of it because residuals depend on the direction`;
    return isCorrelated(worst, textbook, Boolean(isCovered)) ? `, ${figures(textbook)}° if residuals were independent` : "";
}

/** @param {Values} values */
function correlation({ autocorrelation: lagOne, textbook_deg: textbook }) {
    const next = Math.abs(lagOne) >= 0.005 ? `each with the next by ${lagOne.toFixed(2)}` : "";
    const claim = Number.isNaN(textbook) ? "" : `the claim would be ${figures(textbook)}° if they were not`;
    const parts = [next, claim].filter(Boolean);
    return parts.length ? ` (${parts.join("; ")})` : "";
}

/** @param {Values} values */
function lagWords({ late_axis: axis, late_by: by, is_timed: isTimed }) {
    const amount = isTimed ? `${Math.abs(by * 1000).toFixed(0)} ms` : `${Math.abs(by).toFixed(2)} readings`;
    return `axis ${axis} is read ${amount} ${by > 0 ? "later" : "earlier"} than the others`;
}

/** @param {Values} values */
function swapWords({ swapped_axes: axes, swap_row: row, swap_count: count }) {
    const what = axes.length === 1 ? `the sign of ${axes} changed` : `${axes[0]} and ${axes[1]} changed places`;
    const repeatWords = count > 1 ? `, and again ${countWords(count - 1, "time")}` : "";
    return `${groupText(row)} on, ${what}${repeatWords}`;
}

/** @param {Values} values */
function remedyWords({ is_better: is, is_covered: isCovered }) {
    if (is) return "the calibration is worth having";
    return isCovered ? "leave them as they are" : "leave them as they are, or turn the sensor further";
}

/**
 * @param {Values} values
 * @param {EngineData} data
 */
function again({ outlier_share: share }, { numbers }) {
    return share > numbers.OUTLIERS_LIMIT ? "; find out what it was, and record again without it" : "";
}

/** @param {[string, string, number, number]} end */
function railWords([axis, end, value, share]) {
    return `${(100 * share).toFixed(1)}% sit at the ${end} value of ${axis} (${general(value)})`;
}

/**
 * Listed items with the number of the others.
 * @param {string[]} some
 * @param {number} count
 * @returns {string}
 */
function listSome(some, count) {
    return some.join("; ") + (count > some.length ? "; …" : "");
}
