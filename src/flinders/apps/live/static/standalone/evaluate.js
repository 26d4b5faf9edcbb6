/** Fit of the readings on the page, with its verdict and the reasons against it. */

import { withPath } from "./advice.js";
import { Fit, fitOf } from "./fit.js";
import { AT_ONCE, ofFit, ofMotion, ofRefusal } from "./reasons.js";
import { findingsOf, verdictOf } from "./findings.js";
import { comparePrevious, otherRecording, renewedOf } from "./previous.js";
import { viewOf } from "./view.js";

/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./findings.js").Finding} Finding */

/** Advice after a level turn that reaches the target, by goal; further level turns would not help. */
export const WHILE_LEVEL = {
    heading: "it is good while level",
    attitude: "it is good while level; for headings that hold when it is tilted, turn it tilted and upside down too",
};

/**
 * Settings for a fit: the user's, and those of the session.
 * @typedef {object} Wish
 * @property {import("./advice.js").Goal} goal
 * @property {ArrayLike<number> | null} [numbers] Numbers of the readings in the session.
 * @property {boolean} [isFollowed] The user is turning the sensor and can be guided.
 * @property {import("./advice.js").Frame} [frame] Frame of the advice.
 * @property {import("./session.js").Previous | null} [previous] Earlier calibration.
 * @property {boolean} [isRenewed] Keep its soft iron, and estimate its hard iron again.
 */

/**
 * Readings that are not excluded, with the user's settings.
 * @typedef {import("./fit.js").Request & Wish} Asked
 */

/**
 * Result of an evaluation.
 * @typedef {object} Evaluated
 * @property {View | null} view
 * @property {Reason[]} reasons Warnings first.
 * @property {string} refusal Reason for no fit.
 * @property {string} refusalCode Code of the refusal.
 * @property {string[]} alarms Codes of warnings that more turning may end.
 * @property {number} used
 * @property {number} rejected
 * @property {number} coverage Covered share of the sphere.
 * @property {object | null} record The part `fit` of a calibration file; null without a usable calibration.
 * @property {import("../messages.d.ts").PreviousState | null} previous Difference from the earlier calibration.
 */

/**
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Asked} asked
 * @returns {Evaluated}
 */
export function evaluate(engine, data, asked) {
    const { field, goal, numbers = null, isFollowed = false, frame = "sensor", previous = null, isRenewed = false } = asked;
    const time = asked.time ?? Float64Array.from({ length: field.length / 3 }, (_, i) => i);
    const fit = isRenewed && previous ? renewedFit(engine, data, asked, previous) : fitOf(engine, data, asked);
    const readings = { field, time };
    if (!(fit instanceof Fit)) {
        const reasons = ofRefusal(fit).concat(ofMotion(readings, null, false));
        const state = previous && comparePrevious(previous, null, data, asked);
        return { view: null, reasons: sortReasons(reasons), refusal: fit.words, refusalCode: fit.code, alarms: [], used: 0, rejected: 0, coverage: 0, record: null, previous: state };
    }
    const findings = findingsOf(fit);
    const view = viewOf(fit, findings, { field, numbers, goal, frame });
    const isFlat = findings.some(({ code }) => code === "one-plane");
    const found = ofFit(fit, findings, readings);
    const alarms = found.filter(({ severity, code }) => severity === "warning" && !AT_ONCE.includes(code));
    const used = view.tiles_seen.reduce((sum, count) => sum + count, 0) || time.length;
    return {
        view: whileLevel(isFollowed ? withPath(view, fit, readings, isFlat, goal, frame) : view, fit, goal),
        reasons: sortReasons([...ofMotion(readings, fit, isFlat), ...found]),
        refusal: "",
        refusalCode: "",
        alarms: alarms.map(({ code }) => code),
        used,
        rejected: time.length - used,
        coverage: fit.record.coverage,
        record: view.verdict === "refused" ? null : recordOf(fit, findings, view),
        previous: previous && comparePrevious(previous, view.verdict === "refused" ? null : fit, data, asked),
    };
}

/**
 * A fit with the soft iron of an earlier calibration, judged at the earlier dip unless the user gave one.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Asked} asked
 * @param {import("./session.js").Previous} previous
 */
function renewedFit(engine, data, asked, previous) {
    const words = otherRecording(previous, asked, data);
    if (words) return { code: "", words };
    const renewed = renewedOf(previous);
    const dip = asked.dipAssumed ? { dipDeg: renewed.dipDeg, dipAssumed: renewed.dipAssumed } : {};
    return fitOf(engine, data, { ...asked, ...dip, renewed });
}

/**
 * View of a level turn with its limits: good while level, and missing attitudes if these are the goal.
 * @param {View} view
 * @param {Fit} fit
 * @param {import("./advice.js").Goal} goal
 * @returns {View}
 */
function whileLevel(view, fit, goal) {
    const isDone = fit.plane && view.verdict === "limited" && fit.headingError.worst <= fit.targetDeg;
    if (!isDone || !view.guidance) return view;
    return { ...view, guidance: { ...view.guidance, words: WHILE_LEVEL[goal], code: `while-level-${goal}` } };
}

/**
 * @param {Reason[]} reasons
 * @returns {Reason[]}
 */
function sortReasons(reasons) {
    return reasons.sort((one, other) => Number(one.severity !== "warning") - Number(other.severity !== "warning"));
}

/**
 * Part of a calibration file on a fit, as `flinders.core.calibration_file.Fitted`; missing numbers are null.
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @param {View} view
 * @returns {object}
 */
function recordOf(fit, findings, view) {
    const { covariance, data, record } = fit;
    const [x, y, z] = record.hole.map((part) => Number(part.toFixed(4)));
    return {
        method: fit.method,
        samples: fit.samples,
        noise: fit.noise,
        covariance_of: data.parameters,
        covariance: data.parameters.map((_, i) => Array.from(covariance.slice(9 * i, 9 * i + 9))),
        verdict: verdictOf(fit),
        heading_error_deg: { ...view.heading_error_deg, structure_deg: fit.structureDeg },
        coverage: { fraction: record.coverage, hole_deg: Number(record.hole_deg.toFixed(3)), hole_x: x, hole_y: y, hole_z: z },
        findings,
        ...(view.condition ? { conditions: data.conditions.filter((_, i) => (fit.judgement.conditions >> i) & 1) } : {}),
        ...(fit.plane ? { plane: fit.plane, z_down: fit.zDown } : {}),
    };
}
