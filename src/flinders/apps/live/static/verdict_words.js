/**
 * Sentences about a fit in the page's language, made from its numbers. In English, and without a translation, the
 * sentence that comes with the fit.
 */

import { languageCode, numeral, phrase, translation } from "./language.js";
import { headline } from "./standalone/headline.js";
import { figures } from "./standalone/numbers.js";
import { angle, fillTemplate } from "./standalone/wording.js";
import { sentence } from "./views/words.js";

/** @typedef {import("./standalone/data.d.ts").EngineData} EngineData */
/** @typedef {import("./messages.d.ts").Reason} Reason */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("../../../static/view.d.ts").FindingView} Finding */
/** @typedef {import("./messages.d.ts").PreviousState} PreviousState */
/** A view, or a part of one, that a verdict is said of. @typedef {Pick<View, "verdict" | "findings" | "attitude_limit_deg" | "sentence"> & {heading_error_deg: {worst: number, bound_95: number, target_deg: number} | null}} Judged */
/** A finding, or a reason: values of its sentence by name. @typedef {{code: string, advice: string, values?: Record<string, any> | null}} Said */

/** Places of tilts in the table of reaches. */
const REACHES = ["level", "tilt", "any"];
/** Attitudes of a sensor, as the program names them in English. */
export const POSES = Object.freeze({
    side: "with its {one} side down",
    edge: "with the edge between its {one} and {two} sides down",
    lowered: "with its {one} side down and its {two} side lowered by 30°",
    corner: "with the corner of its {one}, {two} and {three} sides down",
});
/** Reasons for no fit, by the code of the refusal. The English reasons come from the engine, with numbers. */
export const REFUSALS = Object.freeze({
    "too-few-samples": "There are too few readings: keep turning the sensor.",
    "not-finite": "Some readings are no numbers.",
    "out-of-scale": "The readings are larger or smaller than those of any magnetometer: check the columns and the unit.",
    "stuck-axis": "An axis of the sensor never changes: check its wiring.",
    unmoved: "The sensor was hardly turned: turn it slowly through all directions.",
    "not-an-ellipsoid": "The readings cover too few directions: turn the sensor upside down and onto each of its sides.",
    undetermined: "The sensor was turned in too few ways: turn it about all three of its axes.",
});
const PATTERNS = Object.entries(POSES).map(([name, english]) => ({ name, pattern: new RegExp(`^${english.replace(/\{(\w+)\}/g, "(?<$1>\\S+?)")}$`) }));

/** @type {EngineData | null} */
let tables = null;

/**
 * Set the tables of the program with the kinds and the English sentences of findings.
 * @param {EngineData} data
 */
export function useVerdictTables(data) {
    tables = data;
}

/**
 * The first sentence of a verdict.
 * @param {Judged} view
 * @returns {string}
 */
export function sentenceOf(view) {
    const { verdict, findings, heading_error_deg: error, attitude_limit_deg: limit } = view;
    if (!tables || !translation("lead.good")) return view.sentence;
    const [first] = verdict === "good" ? [] : findings;
    const cause = first ? causeOf(first, tables) : null;
    if (first && !cause) return view.sentence;
    const claim = { worstDeg: error?.worst ?? NaN, boundDeg: error?.bound_95 ?? NaN, targetDeg: error?.target_deg ?? NaN, limitDeg: limit ?? NaN };
    const { leads, reaches, numbers, said } = tables;
    return headline(claim, cause, verdict, {
        leads: Object.fromEntries(Object.entries(leads).map(([kind, english]) => [kind, translation(`lead.${kind}`) ?? english])),
        reaches: reaches.map(([end, reach, beyond], i) => [end, phrase(`reach.${REACHES[i]}`, reach), beyond && phrase(`beyond.${REACHES[i]}`, beyond)]),
        leftOut: phrase("verdict.left-out", said["left-out"]),
        smallErrorDeg: numbers.SMALL_ERROR_DEG,
    });
}

/**
 * Cause of a verdict in the page's language; null without a translation.
 * @param {Finding} finding
 * @param {EngineData} data
 */
function causeOf(finding, { rows }) {
    const plain = plainWords(finding);
    if (!plain) return null;
    const affects = rows.find(({ code }) => code === finding.code)?.affects ?? "claim";
    return { affects, why: plain.split(". ")[0], remedy: remedyOf(finding) };
}

/**
 * Condition on which a verdict rests, in a few words; empty for none.
 * @param {View} view
 * @returns {string}
 */
export function conditionOf({ condition }) {
    const bits = tables?.resting.indexOf(condition) ?? -1;
    if (!tables || bits <= 0 || !translation("condition.holds")) return condition;
    const parts = tables.conditions.filter((_, i) => (bits >> i) & 1).map((code) => translation(`condition.${code}`) ?? code);
    const list = new Intl.ListFormat(languageCode(), { type: "conjunction" });
    return phrase("condition.holds", "holds if {conditions}", { conditions: list.format(parts) });
}

/**
 * Sentence of a finding: its meaning and the remedy.
 * @param {Finding} finding
 * @returns {string}
 */
export function adviceOf(finding) {
    const plain = plainWords(finding);
    return plain ? [sentence(plain), remedyOf(finding)].filter(Boolean).join(" ") : finding.advice;
}

/**
 * Sentence of a reason against a calibration.
 * @param {Reason} reason
 * @returns {string}
 */
export function reasonWords(reason) {
    if (reason.values?.refusal) return refusalWords(reason.values.refusal, reason.advice);
    const words = translation(`reason.${reason.values?.phrase ?? reason.code}`);
    return (words && fillFrom(words, reason)) ?? adviceOf({ ...reason, severity: "note", number: null, limit: null, ...reason.values });
}

/**
 * Reason for no fit, in the page's language.
 * @param {string} code
 * @param {string} words  in English
 */
export function refusalWords(code, words) {
    return (code && translation(`refusal.${code}`)) || words;
}

/**
 * How an earlier calibration compares with the present one.
 * @param {PreviousState} previous
 * @returns {string}
 */
export function previousWords({ words, code, values }) {
    const said = code && translation(`earlier.${code}`);
    if (!said) return words;
    const local = Object.fromEntries(Object.entries(values ?? {}).map(([name, value]) => [name, localText(value) ?? ""]));
    if (values?.below) local.difference = phrase("earlier.below", "less than {limit}°", { limit: numeral(values.below) });
    if (values?.source) local.source = phrase("earlier.this", "this recording");
    return phrase(`earlier.${code}`, said, local);
}

/** @param {Said} finding @returns {string | null} Meaning of a finding in words; null without a translation. */
function plainWords(finding) {
    const words = translation(`findings.${finding.code}.plain`);
    return words && fillFrom(words, finding);
}

/** @param {Said} finding @returns {string} Remedy of a finding as a sentence; empty for none. */
function remedyOf(finding) {
    const words = translation(`findings.${finding.code}.remedy`);
    const filled = words && fillFrom(words, finding);
    return filled ? sentence(`${filled.charAt(0).toUpperCase()}${filled.slice(1)}`) : "";
}

/**
 * Fill a translated format with the numbers and words of a finding.
 * @param {string} words
 * @param {Said} finding
 * @returns {string | null} Null where the finding lacks a value.
 */
function fillFrom(words, finding) {
    let isWhole = true;
    const filled = fillTemplate(words, (name) => {
        const value = valueOf(name, finding);
        isWhole &&= value !== null;
        return value ?? "";
    });
    return isWhole ? filled : null;
}

/**
 * A number or word of a finding's sentence; null where it is not known.
 * @param {string} name
 * @param {Said & {number?: number | null, limit?: number | null}} finding
 * @returns {string | number | null}
 */
function valueOf(name, { number = null, limit = null, values }) {
    const { next_movement: movement, next_step: step, corrected_length: length, unit } = values ?? {};
    switch (name) {
        case "number": return number;
        case "limit": return limit;
        case "angle": return number === null ? null : angle(number);
        case "seconds": return numeral(number === null ? (values?.seconds ?? "") : figures(number));
        case "movement": return movement ? stepWords(movement) : null;
        case "remedy": return step ? stepWords(step) : null;
        case "why_large": return step ? phrase(`why-large.${step[0]}`, tables?.reasons[step[0]] ?? "") : null;
        case "length": return length ? `${numeral(figures(length, 4))} ${unit}` : null;
        default: return localText(values?.[name] ?? null);
    }
} // prettier-ignore

/** @param {string | number | null} value @returns {string | number | null} A number in text with the signs of the language. */
function localText(value) {
    return typeof value === "string" && /^[\d.,]+°?$/.test(value) ? numeral(value) : value;
}

/** @param {[string] | [string, number]} step @returns {string} The next step, as an instruction. */
function stepWords([name, pose]) {
    const words = phrase(`step.${name}`, tables?.steps[name].replace("{}", "{pose}") ?? "");
    return words.replace("{pose}", pose === undefined ? "" : poseWords(tables?.poses.sensor[Math.round(pose)] ?? ""));
}

/** @param {string} english @returns {string} Name of an attitude of the sensor. */
function poseWords(english) {
    for (const { name, pattern } of PATTERNS) {
        const found = pattern.exec(english);
        if (found) return phrase(`pose.${name}`, english, found.groups);
    }
    return english;
}
