/**
 * How far the calibration from before is off the present one: the headings of a level vehicle, as `flinders.comparison`
 * has them. What chance explains of that is left to `flinders compare`.
 */

import { degrees } from "../views/words.js";
import { apply, inverted, product, transposed } from "./linear.js";

/** @typedef {import("../messages.d.ts").PreviousState} PreviousState */
/** @typedef {import("../messages.d.ts").View} View */
/** @typedef {import("./session.js").Previous} Previous */

const HEADINGS = 72;
const NEWTON_STEPS = 30;
const CHANGED = "something near the sensor has changed, or one of both is not good";

/** An ellipsoid: its middle, by which symmetric matrix a direction becomes a reading, the inverse of that, and its size. */
/** @typedef {{centre: number[], shape: number[], inverse: number[], size: number}} Surface */

/**
 * @param {Previous} previous
 * @param {View | null} view
 * @param {{dipDeg: number, targetDeg: number, unit: string}} asked
 * @returns {PreviousState}
 */
export function compared({ name, calibration }, view, { dipDeg, targetDeg, unit }) {
    const without = (/** @type {string} */ words) => ({ name, change_deg: null, words });
    if (!view?.offset || !view.matrix || view.field_strength === null) return without("nothing to compare with yet");
    if ((calibration.unit === "counts") !== (unit === "counts")) return without(`it is for readings in ${calibration.unit}, these are in ${unit}`);
    const isKnown = calibration.fieldStrengthKnown && view.field_strength_known;
    const first = surfaceOf(calibration.matrix, calibration.offset, calibration.fieldStrength, isKnown);
    const second = surfaceOf(view.matrix, view.offset, view.field_strength, isKnown);
    const worst = worstHeadingDeg(first, second, dipDeg);
    const meaning = worst <= targetDeg ? "within the target" : `more than the target: ${CHANGED}`;
    return { name, change_deg: worst, words: `headings differ by ${degrees(worst)} at the worst, ${meaning}` };
}

/**
 * @param {number[][]} matrix
 * @param {number[]} offset
 * @param {number} strength
 * @param {boolean} isKnown  the strength is that of the field; else the mean radius is the size
 * @returns {Surface}
 */
function surfaceOf(matrix, offset, strength, isKnown) {
    const rows = matrix.flat();
    const rotation = rotationOf(rows);
    const { inverse: unmade, determinant } = inverted(rows);
    const shape = product(unmade, rotation).map((part) => strength * part);
    const inverse = product(transposed(rotation), rows).map((part) => part / strength);
    return { centre: offset, shape, inverse, size: isKnown ? strength : strength / Math.cbrt(Math.abs(determinant)) };
}

/**
 * The rotation in a matrix: of its polar decomposition, by Newton's iteration (N. J. Higham, SIAM J. Sci. Stat. Comput. 7
 * (1986) 1160).
 * @param {number[]} matrix
 * @returns {number[]}
 */
function rotationOf(matrix) {
    let rotation = matrix;
    for (let i = 0; i < NEWTON_STEPS; i++) {
        const other = transposed(inverted(rotation).inverse);
        rotation = rotation.map((part, k) => (part + other[k]) / 2);
    }
    return rotation;
}

/**
 * The worst difference in heading over a level turn, its mean removed, both ways.
 * @param {Surface} first
 * @param {Surface} second
 * @param {number} dipDeg
 * @returns {number}
 */
export function worstHeadingDeg(first, second, dipDeg) {
    const common = Math.sqrt(first.size * second.size);
    return Math.max(...[[first, second], [second, first]].map(([from, to]) => {
        const turns = levelTurn(dipDeg).map((field) => {
            const reading = apply(from.shape, field).map((part, i) => (part * common) / from.size + from.centre[i] - to.centre[i]);
            const seen = apply(to.inverse, reading);
            return Math.atan2(field[1], field[0]) - Math.atan2(seen[1], seen[0]);
        });
        const mean = Math.atan2(sum(turns.map(Math.sin)), sum(turns.map(Math.cos)));
        return Math.max(...turns.map((turn) => Math.abs(wrapped(turn - mean)))) * (180 / Math.PI);
    }));
}

/**
 * Fields that a level vehicle meets in a full turn.
 * @param {number} dipDeg
 * @returns {number[][]}
 */
function levelTurn(dipDeg) {
    const dip = dipDeg * (Math.PI / 180);
    return Array.from({ length: HEADINGS }, (_, k) => {
        const heading = (2 * Math.PI * k) / HEADINGS;
        return [Math.cos(dip) * Math.cos(heading), -Math.cos(dip) * Math.sin(heading), Math.sin(dip)];
    });
}

/** @param {number[]} numbers */
function sum(numbers) {
    return numbers.reduce((all, number) => all + number, 0);
}

/** @param {number} angle  in rad @returns {number} From −π to π. */
function wrapped(angle) {
    return Math.atan2(Math.sin(angle), Math.cos(angle));
}
