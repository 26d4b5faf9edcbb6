/** Fills templates of Python with numbers and words. */

import { figures, fixedText, general, groupText } from "./numbers.js";
import { numeral, phrase } from "../language.js";

/** Angle from which on a heading is undetermined, degrees. */
export const ANY_ANGLE_DEG = 90;
/** The largest tilt, degrees. */
export const UPSIDE_DOWN = 180;

/**
 * A count with its noun.
 * @param {number} number
 * @param {string} noun
 * @returns {string}
 */
export function countWords(number, noun) {
    return `${groupText(number)} ${noun}${Math.round(number) === 1 ? "" : "s"}`;
}

/**
 * An angle in words; at most 90°.
 * @param {number} degrees
 * @returns {string}
 */
export function angle(degrees) {
    return degrees < ANY_ANGLE_DEG ? `${numeral(figures(degrees))}°` : anyAngle();
}

/** @returns {string} Words for an undetermined angle. */
export function anyAngle() {
    return phrase("error.any-angle", "any angle");
}

/** @type {Record<string, (value: number, digits: number) => string>} */
const FORMATS = {
    "": (value) => figures(value),
    angle: (value) => angle(value),
    "%": (value, digits) => `${fixedText(100 * value, digits)}%`,
    f: (value, digits) => fixedText(value, digits),
    ",f": (value, digits) => groupText(value, digits),
    g: (value, digits) => general(value, digits),
};

/**
 * A number by a format specification of Python, such as `.1%`, `,.0f` or `g`; `angle` is the catalogue's own.
 * @param {number} value
 * @param {string} specification
 * @returns {string}
 */
function formatNumber(value, specification) {
    const [, comma, digits, kind] = /^(,?)(?:\.(\d+))?([%fg]?|angle)$/.exec(specification) ?? [];
    const format = FORMATS[`${comma}${kind}`];
    if (!format) throw new Error(`a sentence has the format ${specification}, which this page does not know`);
    return format(value, digits === undefined ? 6 : Number(digits));
}

/**
 * Fill a template of Python, whose braces name numbers and words.
 * @param {string} template
 * @param {(name: string) => number | string} valueOf
 * @returns {string}
 */
export function fillTemplate(template, valueOf) {
    return template.replace(/\{(\w+)(?:![rs])?(?::([^}]*))?\}/g, (_, name, specification = "") => {
        const value = valueOf(name);
        return typeof value === "string" ? value : numeral(formatNumber(value, specification));
    });
}
