/** Writes numbers exactly as Python does: rounds half to even, where JavaScript rounds away from zero. */

/**
 * `f"{value:.{digits}g}"`
 * @param {number} value
 * @param {number} digits
 */
export function general(value, digits = 6) {
    if (!Number.isFinite(value)) return Number.isNaN(value) ? "nan" : value > 0 ? "inf" : "-inf";
    if (value === 0) return Object.is(value, -0) ? "-0" : "0";
    const [mantissa, power] = roundText(value, digits).split("e");
    const exponent = Number(power);
    const sign = value < 0 ? "-" : "";
    const figure = mantissa.replace(/[-.]/g, "").replace(/0+$/, "");
    if (exponent < -4 || exponent >= digits) {
        const rest = figure.slice(1);
        return `${sign}${figure[0]}${rest ? `.${rest}` : ""}${exponentOf(exponent)}`;
    }
    if (exponent < 0) return `${sign}0.${"0".repeat(-exponent - 1)}${figure}`;
    const padded = figure.padEnd(exponent + 1, "0");
    const rest = padded.slice(exponent + 1);
    return `${sign}${padded.slice(0, exponent + 1)}${rest ? `.${rest}` : ""}`;
}

/**
 * `f"{value:.{digits - 1}e}"`
 * @param {number} value
 * @param {number} digits
 */
export function exponential(value, digits) {
    const [mantissa, power] = roundText(value, digits).split("e");
    return `${mantissa}${exponentOf(Number(power))}`;
}

/**
 * A number with significant digits and an exponent.
 * @param {number} value
 * @param {number} digits
 */
function roundText(value, digits) {
    const exact = value.toExponential(60);
    const [mantissa, power] = exact.split("e");
    const end = mantissa.indexOf(".") + digits;
    const isTie = /^50*$/.test(mantissa.slice(end)) && "02468".includes(mantissa[end - 1]);
    return isTie ? `${mantissa.slice(0, end)}e${power}` : value.toExponential(digits - 1);
}

/** @param {number} exponent */
function exponentOf(exponent) {
    return `e${exponent < 0 ? "-" : "+"}${String(Math.abs(exponent)).padStart(2, "0")}`;
}

/** @param {string} text */
export function withPoint(text) {
    return /[.en]/.test(text) ? text : `${text}.0`;
}

/**
 * The fewest digits that are read back the same, as `repr`.
 * @param {number} value
 */
export function shortest(value) {
    const digits = value.toExponential().split("e")[0].replace(/[-.]/g, "").length;
    const exponent = value === 0 ? 0 : Number(value.toExponential().split("e")[1]);
    return withPoint(exponent >= 16 || exponent < -4 ? general(value, digits) : general(value, Math.max(digits, exponent + 1)));
}

/**
 * As `flinders.errors.figures`.
 * @param {number} value
 * @param {number} [digits]
 */
export function figures(value, digits = 2) {
    const size = Math.abs(value);
    if (!(size >= 1e-4 && size < 1e7)) return general(value, digits);
    return groupText(value, Math.max(digits - 1 - Math.floor(Math.log10(size)), 0));
}

/**
 * `f"{value:,.{places}f}"`
 * @param {number} value
 * @param {number} places
 */
export function groupText(value, places = 0) {
    return fixedText(value, places).replace(/\B(?=(\d{3})+(?!\d))(?<!\.\d*)/g, ",");
}

/**
 * `f"{value:.{places}f}"`
 * @param {number} value
 * @param {number} places
 */
export function fixedText(value, places) {
    const exact = value.toFixed(Math.min(places + 60, 100));
    const end = exact.indexOf(".") + 1 + places;
    const isTie = /^50*$/.test(exact.slice(end)) && "02468".includes(exact[end - 1] === "." ? exact[end - 2] : exact[end - 1]);
    return isTie ? exact.slice(0, places ? end : end - 1) : value.toFixed(places);
}
