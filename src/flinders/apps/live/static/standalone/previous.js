/**
 * Comparison of an earlier calibration with the present one, as `flinders.comparison`, and its renewal, as
 * `flinders.fitting.refreshing`. The engine does both.
 */

import { surfaceOf } from "./fit.js";
import { inverseOf, product, transpose } from "./linear.js";
import { figures, general } from "./numbers.js";
import { fillTemplate } from "./wording.js";

/** @typedef {import("../messages.d.ts").PreviousState} PreviousState */
/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./session.js").Previous} Previous */

/**
 * Prior from an earlier calibration.
 * @typedef {import("./engine.js").Earlier & {name: string, strength: number | null, dipDeg: number, dipAssumed: boolean}} Renewed
 */

const ASSUMED_DIP_DEG = 60;
const DEG = 180 / Math.PI;
const NEWTON_STEPS = 30;
const ROUND = [1, 1, 1, 0, 0, 0]; // a sphere
const MIN_SHOWN_DEG = 0.001; // a smaller difference is not shown as a number
/** Words of a comparison by code; `other-unit` and `other-axes` come with the engine's data. */
export const COMPARED = Object.freeze({
    "nothing-yet": "nothing to compare with yet",
    holds: "it still holds: headings differ by less than the target, with 95 % ({difference} of heading at the worst)",
    fails: "it no longer holds: headings differ by more than the target, something near the sensor has changed ({difference} of heading at the worst)",
    "cannot-tell": "too little is known yet to tell whether it holds ({difference} of heading at the worst)",
    renewed: "its soft iron is kept; the offset has moved by {distance} {unit}, which turns headings by up to {worst}°",
});

/**
 * Reason why an earlier calibration does not fit the readings; empty if it does.
 * @param {Previous} previous
 * @param {{unit: string, axes?: string}} readings  with the unit of the page
 * @param {EngineData} data
 * @returns {string}
 */
export function otherRecording(previous, readings, { said }) {
    const found = otherOf(previous, readings);
    return found ? fillTemplate(said[found.code === "other-unit" ? "other-recording" : "other-axes"], (each) => found.values[each]) : "";
}

/**
 * Unit or axes in which an earlier calibration and the readings differ; null for none.
 * @param {Previous} previous
 * @param {{unit: string, axes?: string}} readings
 * @returns {{code: string, values: Record<string, string>} | null}
 */
function otherOf({ name, calibration }, { unit, axes = "x,y,z" }) {
    const isOther = (calibration.unit === "counts") !== (unit === "counts");
    if (!isOther && calibration.axes === axes) return null;
    const other = isOther ? (calibration.raw?.unit ?? calibration.unit) : calibration.axes;
    return { code: isOther ? "other-unit" : "other-axes", values: { source: "this recording", unit, axes, name, other } };
}

/**
 * @param {string} name
 * @param {number | null} change_deg
 * @param {keyof typeof COMPARED} code
 * @param {Record<string, string>} [values]
 * @returns {PreviousState}
 */
function compared(name, change_deg, code, values = {}) {
    return { name, change_deg, words: fillTemplate(COMPARED[code], (each) => values[each]), code, values };
}

/**
 * Prior from an earlier calibration.
 * @param {Previous} previous
 * @returns {Renewed}
 */
export function renewedOf({ name, calibration }) {
    const { fieldStrength, fieldStrengthKnown, offset: centre } = calibration;
    const { structureDeg, dipDeg, dipAssumed, covariance } = claimOf(calibration);
    const shape = shapeOf(calibration);
    const distortion = (structureDeg / DEG) * Math.cos(dipDeg / DEG) * surfaceOf(centre, shape).radius;
    const strength = fieldStrengthKnown ? fieldStrength : null;
    return { name, centre, shape, covariance, distortion, strength, dipDeg: Math.abs(dipDeg), dipAssumed };
}

/**
 * Difference of an earlier calibration from the present one, or the change since then if it is renewed.
 * @param {Previous} previous
 * @param {Fit | null} fit
 * @param {EngineData} data
 * @param {{unit: string, axes?: string}} readings
 * @returns {PreviousState}
 */
export function comparePrevious(previous, fit, data, readings) {
    const { name, calibration } = previous;
    if (fit === null) return compared(name, null, "nothing-yet");
    if (fit.renewed) return changeSince(fit, fit.renewed);
    const { engine } = fit;
    const words = otherRecording(previous, readings, data);
    if (words) return { name, change_deg: null, words, ...otherOf(previous, readings) };
    const { structureDeg, dipDeg, covariance } = claimOf(calibration);
    const shape = shapeOf(calibration);
    const claimed = engine.withStructure(shape, covariance ?? new Float64Array(81), structureDeg, dipDeg);
    const strength = calibration.fieldStrengthKnown ? calibration.fieldStrength : 0;
    const first = { centre: calibration.offset, shape, covariance: claimed, strength };
    const second = { centre: fit.surface.centre, shape: fit.surface.shape, covariance: fit.claimed, strength: 0 };
    const apart = engine.compare(first, second, fit.dipDeg);
    const worst = apart.worst_deg;
    const answer = data.answers[engine.answer(apart, fit.targetDeg)];
    if (worst >= MIN_SHOWN_DEG) return compared(name, worst, answer, { difference: `${figures(worst)}°` });
    const below = general(MIN_SHOWN_DEG);
    return compared(name, worst, answer, { difference: `less than ${below}°`, below });
}

/**
 * Change since a renewed calibration, and its effect on headings.
 * @param {Fit} fit
 * @param {Renewed} renewed
 * @returns {PreviousState}
 */
function changeSince({ engine, surface, unit, dipDeg }, { name, centre, shape }) {
    const moved = surface.centre.map((part, i) => part - centre[i]);
    const { inverse } = surfaceOf(centre, shape);
    const off = [0, 3, 6].map((row) => moved.reduce((sum, part, i) => sum + inverse[row + i] * part, 0));
    const worst = engine.uncorrectedWorstDeg({ centre: off, shape: ROUND }, dipDeg);
    return compared(name, worst, "renewed", { distance: figures(Math.hypot(...moved)), unit, worst: figures(worst) });
}

/**
 * Uncertainty of a calibration from its file.
 * @param {import("./targets.js").Known} calibration
 */
function claimOf({ fit }) {
    const error = fit?.heading_error_deg;
    /** @type {number[] | null} */
    const covariance = fit?.covariance ? orderedBy(fit.covariance_of, fit.covariance) : null;
    return {
        structureDeg: error?.structure_deg ?? 0,
        dipDeg: error?.dip_deg ?? ASSUMED_DIP_DEG,
        dipAssumed: error?.dip_assumed ?? false,
        covariance: covariance?.some((part) => part !== 0) ? covariance : null,
    };
}

const PARAMETERS = ["offset_x", "offset_y", "offset_z", "shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz"];

/**
 * Covariance of offset and shape, row by row; null if it is of other parameters.
 * @param {string[] | undefined} names Names of its rows.
 * @param {number[][]} covariance
 * @returns {number[] | null}
 */
function orderedBy(names = PARAMETERS, covariance) {
    const rows = PARAMETERS.map((name) => names.indexOf(name));
    return rows.some((row) => row < 0) ? null : rows.flatMap((row) => rows.map((column) => covariance[row][column]));
}

/**
 * The symmetric shape, which converts a direction to a reading.
 * @param {import("./targets.js").Calibration} calibration
 * @returns {number[]} Its entries 11, 22, 33, 12, 13, 23.
 */
function shapeOf({ matrix, fieldStrength }) {
    const rows = matrix.flat();
    const shape = product(inverseOf(rows).inverse, rotationOf(rows)).map((part) => fieldStrength * part);
    return [shape[0], shape[4], shape[8], (shape[1] + shape[3]) / 2, (shape[2] + shape[6]) / 2, (shape[5] + shape[7]) / 2];
}

/**
 * Rotation in the polar decomposition of a matrix, by Newton's iteration (N. J. Higham, SIAM J. Sci. Stat. Comput. 7
 * (1986) 1160).
 * @param {number[]} matrix
 * @returns {number[]}
 */
function rotationOf(matrix) {
    let rotation = matrix;
    for (let i = 0; i < NEWTON_STEPS; i++) {
        const other = transpose(inverseOf(rotation).inverse);
        rotation = rotation.map((part, k) => (part + other[k]) / 2);
    }
    return rotation;
}
