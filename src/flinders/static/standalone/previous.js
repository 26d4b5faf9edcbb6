/**
 * How far the calibration from before is off the present one: the headings of a level vehicle, as `flinders.comparison`
 * has them. What chance explains of that is left to `flinders compare`.
 */

import { degrees } from "../views/words.js";
import { levelTurn } from "./heading.js";
import { apply, diagonal, eigen, multiply, transposed } from "./linear.js";

/** @typedef {import("../messages.d.ts").PreviousState} PreviousState */
/** @typedef {import("../messages.d.ts").View} View */
/** @typedef {import("./session.js").Previous} Previous */

const CHANGED = "something near the sensor has changed, or one of both is not good";

/** An ellipsoid: its middle, by which symmetric matrix a direction becomes a reading, the inverse of that, and its size. */
/** @typedef {{centre: number[], shape: Float64Array, inverse: Float64Array, size: number}} Surface */

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
    const { values, vectors } = eigen(multiply(transposed(rows, 3, 3), rows, 3, 3, 3), 3);
    const axes = vectors.flat();
    /** @type {(entry: (value: number) => number) => Float64Array} */
    const symmetric = (entry) => multiply(transposed(axes, 3, 3), multiply(diagonal(3, (i) => entry(values[i])), axes, 3, 3, 3), 3, 3, 3);
    const shape = symmetric((value) => strength / Math.sqrt(value));
    const inverse = symmetric((value) => Math.sqrt(value) / strength);
    const radius = strength / (values[0] * values[1] * values[2]) ** (1 / 6);
    return { centre: offset, shape, inverse, size: isKnown ? strength : radius };
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
        const turns = levelTurn(dipDeg).map(({ field }) => {
            const reading = apply(from.shape, field).map((part, i) => (part * common) / from.size + from.centre[i] - to.centre[i]);
            const seen = apply(to.inverse, reading);
            return Math.atan2(field[1], field[0]) - Math.atan2(seen[1], seen[0]);
        });
        const mean = Math.atan2(sum(turns.map(Math.sin)), sum(turns.map(Math.cos)));
        return Math.max(...turns.map((turn) => Math.abs(wrapped(turn - mean)))) * (180 / Math.PI);
    }));
}

/** @param {number[]} numbers */
function sum(numbers) {
    return numbers.reduce((all, number) => all + number, 0);
}

/** @param {number} angle  in rad @returns {number} From −π to π. */
function wrapped(angle) {
    return Math.atan2(Math.sin(angle), Math.cos(angle));
}
