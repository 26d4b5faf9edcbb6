/** Numbers and sentences as the program writes them: `flinders.errors.figures`, and formats of Python's templates. */

const ANY_ANGLE_DEG = 90;

/**
 * A number with commas between thousands.
 * @param {number} value
 * @param {number} decimals
 * @returns {string}
 */
export function grouped(value, decimals = 0) {
    const [whole, rest] = value.toFixed(decimals).split(".");
    const spaced = whole.replace(/\B(?=(\d{3})+$)/g, ",");
    return rest === undefined ? spaced : `${spaced}.${rest}`;
}

/**
 * Python's format `g`.
 * @param {number} value
 * @param {number} digits
 * @returns {string}
 */
export function general(value, digits = 6) {
    if (!Number.isFinite(value)) return Number.isNaN(value) ? "nan" : value > 0 ? "inf" : "-inf";
    if (value === 0) return "0";
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    const power = Number(exponent);
    const stripped = (/** @type {string} */ text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
    if (power >= -4 && power < digits) return stripped(value.toFixed(digits - 1 - power));
    return `${stripped(mantissa)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

/**
 * A number to so many significant digits or to the point.
 * @param {number} value
 * @param {number} digits
 * @returns {string}
 */
export function figures(value, digits = 2) {
    const size = Math.abs(value);
    if (!(size >= 1e-4 && size < 1e7)) return general(value, digits);
    return grouped(value, Math.max(digits - 1 - Math.floor(Math.log10(size)), 0));
}

/**
 * How many there are of something.
 * @param {number} number
 * @param {string} noun
 * @returns {string}
 */
export function counted(number, noun) {
    return `${grouped(number)} ${noun}${Math.round(number) === 1 ? "" : "s"}`;
}

/**
 * An angle; beyond a right one it says nothing.
 * @param {number} degrees
 * @returns {string}
 */
export function angle(degrees) {
    return degrees < ANY_ANGLE_DEG ? `${figures(degrees)}°` : "any angle";
}

/** @type {Record<string, (value: number, digits: number) => string>} */
const FORMATS = {
    "": (value) => figures(value),
    angle: (value) => angle(value),
    "%": (value, digits) => `${(100 * value).toFixed(digits)}%`,
    f: (value, digits) => value.toFixed(digits),
    ",f": (value, digits) => grouped(value, digits),
    g: (value, digits) => general(value, digits),
};

/**
 * A number by a format specification of Python, such as `.1%`, `,.0f` or `g`; `angle` is the catalogue's own.
 * @param {number} value
 * @param {string} specification
 * @returns {string}
 */
function formatted(value, specification) {
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
export function filled(template, valueOf) {
    return template.replace(/\{(\w+)(?:![rs])?(?::([^}]*))?\}/g, (_, name, specification = "") => {
        const value = valueOf(name);
        return typeof value === "string" ? value : formatted(value, specification);
    });
}
