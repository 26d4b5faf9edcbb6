/**
 * Numbers and times in words, without access to the page.
 *
 * Numbers have the digits that their uncertainty supports: measuredText(-12.3456, 0.042) is "−12.346" and "0.042".
 */

import { numeral, phrase, pluralForm } from "../language.js";

const MINUS = "\u2212";
const NONE = "\u2013";

/**
 * A number with fixed decimals and a true minus sign; a dash for no number.
 * @param {number | null | undefined} value
 * @param {number} decimals
 * @returns {string}
 */
export function fixedText(value, decimals) {
    if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
    const text = value.toFixed(Math.max(0, Math.min(decimals, 12)));
    return numeral((Number(text) === 0 ? text.replace("-", "") : text).replace("-", MINUS));
}

/**
 * Decimals for two significant digits of an uncertainty, or for four of a value without one.
 * @param {number | null | undefined} value
 * @param {number | null | undefined} sigma
 * @returns {number}
 */
export function decimals(value, sigma) {
    const known = sigma !== null && sigma !== undefined && Number.isFinite(sigma) && sigma > 0;
    const size = Math.abs(known ? Number(sigma) : Number(value));
    if (!(size > 0) || !Number.isFinite(size)) return 3;
    const digits = known ? 2 : 4;
    return Math.max(0, Math.min(9, digits - 1 - Math.floor(Math.log10(size) + 1e-9)));
}

/**
 * A number with its uncertainty (1 σ), two digits of it.
 * @param {number | null | undefined} value
 * @param {number | null | undefined} sigma
 * @returns {{value: string, sigma: string}} The uncertainty is empty if unknown.
 */
export function measuredText(value, sigma) {
    const places = decimals(value, sigma);
    const known = sigma !== null && sigma !== undefined && Number.isFinite(sigma);
    return { value: fixedText(value, places), sigma: known ? fixedText(sigma, places) : "" };
}

/**
 * A number to so many significant digits, without uncertainty.
 * @param {number | null | undefined} value
 * @param {number} digits
 * @returns {string}
 */
export function significant(value, digits) {
    if (!value || !Number.isFinite(value)) return fixedText(value, 0);
    return fixedText(value, digits - 1 - Math.floor(Math.log10(Math.abs(value)) + 1e-9));
}

/**
 * An angle to two significant digits, as in the sentences of the server: 0.084°, 0.42°, 2.1°, 23°. An error above 90°
 * says nothing more.
 * @param {number | null | undefined} deg
 * @returns {string}
 */
export function degrees(deg) {
    if (deg === null || deg === undefined || !Number.isFinite(deg)) return NONE;
    return Math.abs(deg) > 90 ? "> 90°" : `${significant(deg, 2)}°`;
}

/**
 * A compass heading in whole degrees, 000° to 359°.
 * @param {number | null} deg
 * @returns {string}
 */
export function compass(deg) {
    if (deg === null || !Number.isFinite(deg)) return NONE;
    const whole = ((Math.round(deg) % 360) + 360) % 360;
    return `${String(whole).padStart(3, "0")}°`;
}

/**
 * A count with commas between thousands, as everywhere in Flinders.
 * @param {number} count
 * @returns {string}
 */
export function countText(count) {
    return numeral(String(Math.round(count)).replace(/\B(?=(\d{3})+$)/g, ","));
}

/**
 * A number of things: "1 reading", "3,000 readings".
 * @param {number} count
 * @param {string} thing
 * @returns {string}
 */
export function things(count, thing) {
    const form = pluralForm(`things.${thing}`, count);
    return form?.replace("{count}", countText(count)) ?? `${countText(count)} ${thing}${count === 1 ? "" : "s"}`;
}

/**
 * Words with a capital at the start.
 * @param {string} words
 * @returns {string}
 */
export function capital(words) {
    return words.charAt(0).toUpperCase() + words.slice(1);
}

/**
 * Words with a capital at the start and a full stop at the end.
 * @param {string} words
 * @returns {string}
 */
export function sentence(words) {
    const isWord = /^\p{Ll}+[ ,:;]/u.test(words); // and no file name
    const whole = isWord ? capital(words) : words;
    return whole === "" || /[.!?…]$/.test(whole) ? whole : `${whole}.`;
}

/**
 * Split a sentence into its text and a long list in brackets, such as of times.
 * @param {string} words
 * @returns {[string, string]} The list is empty if there is none.
 */
export function brief(words) {
    const [, before, list, after] = /^([^]*?) \(([^()]{25,})\)([^]*)$/.exec(words) ?? ["", words, "", ""];
    return [before + after, list];
}

/**
 * Seconds as a clock shows them: 9 s, 2:05 min, 1:02:05 h.
 * @param {number} seconds
 * @returns {string}
 */
export function duration(seconds) {
    if (!Number.isFinite(seconds) || seconds < 0) return NONE;
    if (seconds < 60) return `${Math.floor(seconds)} s`;
    return `${clock(seconds)} ${seconds < 3600 ? "min" : "h"}`;
}

/**
 * @param {number} seconds
 * @returns {string} 2:30, or 1:02:30.
 */
export function clock(seconds) {
    const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
    const [minutes, rest] = [Math.floor(seconds / 60), Math.floor(seconds % 60)];
    if (minutes < 60) return `${minutes}:${two(rest)}`;
    return `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${two(rest)}`;
}

/**
 * Sentence on the session after Finish; empty before.
 * @param {import("../messages.d.ts").SessionState} state
 * @returns {string}
 */
export function sinceWords({ finished, source, recording, reasons }) {
    if (!finished) return "";
    const { since } = finished;
    const readings = things(since, "reading");
    if (source.link === "ended") return since > 0 ? phrase("since.came", "{readings} came since.", { readings }) : "";
    const count = since > 0 ? phrase("since.count", ": {readings} since", { readings }) : "";
    const isRecorded = recording !== null && reasons.every(({ code }) => code !== "not-recorded");
    const what = isRecorded ? phrase("since.recording", "Recording") : phrase("since.reading", "Reading");
    return source.link === "gone"
        ? phrase("since.waits", "{what} waits for {name} to come back{count}.", { what, name: sourceTitle(source.name), count })
        : phrase("since.goes-on", "{what} goes on{count}.", { what, count });
}

/**
 * Readings a second: 50 Hz, 6.3 Hz.
 * @param {number} rate
 * @returns {string}
 */
export function frequency(rate) {
    return Number.isFinite(rate) && rate > 0 ? `${fixedText(rate, rate >= 9.95 ? 0 : 1)} Hz` : "";
}

/**
 * The title of each phase of a session.
 * @type {Readonly<Record<string, string>>}
 */
export const PHASES = Object.freeze({
    waiting: "Waiting",
    collecting: "Collecting",
    good: "Good",
    limited: "Limited",
    wrong: "Something is wrong",
});

/**
 * Faults by the code of a reason, short enough for a glance. The reason itself states the remedy.
 * @type {Readonly<Record<string, string>>}
 */
export const REASONS = Object.freeze({
    gone: "The sensor is disconnected.",
    "nothing-arrives": "No readings arrive.",
    stale: "The readings no longer change.",
    "stuck-axis": "An axis is stuck.",
    "frozen-axis": "An axis no longer changes.",
    saturated: "The sensor is at the end of its range.",
    "wrong-unit": "The unit seems wrong.",
    "like-gravity": "The readings look like gravity.",
    "field-changed": "The field has changed.",
    noise: "There is too much noise.",
    "lasting-noise": "There is slow noise.",
    "unsteady-field": "The field is unsteady.",
    "soft-iron-changed": "The soft iron no longer fits.",
    "recordings-differ": "The recordings differ.",
    "axis-swap": "An axis changed its sign or place.",
    alternating: "Readings alternate between two values.",
    "attitude-dependent": "Something magnetic moves with the attitude.",
    outliers: "Many readings are outliers.",
    structure: "The readings do not fit an ellipsoid.",
    "nonlinear-axis": "An axis of the sensor is not linear.",
    "axis-lag": "The axes are not read at the same time.",
    "axis-ratio": "One axis reads much more than another.",
});

/**
 * The title of each verdict of a fit.
 * @type {Readonly<Record<string, string>>}
 */
export const VERDICTS = Object.freeze({
    good: "Good",
    limited: "Limited",
    refused: "Refused",
});

/** Title of a fit that is limited only for tilted attitudes. */
const WHILE_LEVEL = "Good while level";

/**
 * Title of a phase in the page's language.
 * @param {string} phase
 */
export function phaseTitle(phase) {
    return phrase(`phase.${phase}`, PHASES[phase] ?? phase);
}

/**
 * Title of a verdict in the page's language.
 * @param {string} verdict
 */
export function verdictTitle(verdict) {
    return phrase(`verdict.${verdict}`, VERDICTS[verdict] ?? verdict);
}

/** @returns {string} Title of a fit that is limited only for tilted attitudes, in the page's language. */
export function whileLevelTitle() {
    return phrase("verdict.while-level", WHILE_LEVEL);
}

/**
 * A fault in a few words in the page's language; empty for a code without.
 * @param {string} code
 */
export function faultTitle(code) {
    return phrase(`fault.${code}`, REASONS[code] ?? "");
}

/**
 * Whether level headings are the goal and good, and only tilted attitudes are unknown.
 * @param {import("../../../../static/view.d.ts").View | null} view
 * @param {string} goal
 * @returns {boolean}
 */
export function isGoodWhileLevel(view, goal) {
    const error = view?.heading_error_deg;
    if (!view || !error || goal !== "heading" || view.verdict !== "limited" || error.worst > error.target_deg) return false;
    const limits = (view.findings ?? []).filter(({ severity }) => severity === "limits");
    return limits.length > 0 && limits.every(({ code }) => code === "level-plane");
}

/**
 * The icon (a symbol of the page) of each phase, verdict and severity of a finding or notice.
 * @type {Readonly<Record<string, string>>}
 */
export const ICONS = Object.freeze({
    waiting: "waiting",
    collecting: "collecting",
    good: "good",
    limited: "limited",
    wrong: "wrong",
    refused: "wrong",
    note: "info",
    limits: "limited",
    refuses: "wrong",
    info: "info",
    warning: "limited",
    error: "wrong",
});

/** Sources that the page names itself. */
export const SOURCES = Object.freeze({ board: "the board", phone: "the sensor of this phone", simulation: "simulation", none: "no source" });

/**
 * Name of a source in the page's language, where the page gave the name; else as it is.
 * @param {string} name
 */
export function sourceTitle(name) {
    const [key] = Object.entries(SOURCES).find(([, english]) => english === name) ?? [];
    return key ? phrase(`name.${key}`, name) : name;
}

/** Remarks of the simulated sensor, as the program makes them. */
export const REMARKS = Object.freeze({
    rocks: "the simulated hand only rocks the sensor, a common mistake: most directions of the sphere stay unknown",
    turns: "now it turns the sensor over, through all directions: the error falls",
});

/**
 * A remark in the page's language; words of any other origin as they are.
 * @param {string} words
 */
export function remarkWords(words) {
    const [key] = Object.entries(REMARKS).find(([, english]) => english === words) ?? [];
    return key ? phrase(`simulation.${key}`, words) : words;
}

/** @returns {string[]} North, east, south and west, as on a compass. */
export function compassPoints() {
    return phrase("compass.points", "N E S W").split(" ");
}
