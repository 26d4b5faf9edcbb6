/**
 * Colours of the views: one scale for predicted heading error, one palette for each theme.
 *
 * The scale runs over error ÷ target on a logarithm: teal where the target is met twice over, through green at the
 * target and amber at its double, to deep magenta. Lightness falls all the way, so that it reads in grey and in print;
 * and teal differs from amber in blue, which people who confuse red and green see. Mixing is done in OKLab (Björn
 * Ottosson, "A perceptual color space for image processing", 2020), where equal steps look equal.
 *
 * @typedef {"dark" | "light"} Theme
 * @typedef {[number, number, number]} Rgb  red, green, blue of sRGB, 0…1
 */

/** Error ÷ target, and lightness, chroma and hue (degrees) of OKLCH there. */
const STOPS = /** @type {const} */ ({
    dark: [
        [0.5, 0.84, 0.115, 184],
        [1.0, 0.79, 0.14, 160],
        [2.0, 0.73, 0.15, 76],
        [5.0, 0.575, 0.19, 33],
        [12.0, 0.42, 0.16, 2],
    ],
    light: [
        [0.5, 0.78, 0.105, 186],
        [1.0, 0.72, 0.135, 160],
        [2.0, 0.68, 0.145, 70],
        [5.0, 0.55, 0.19, 32],
        [12.0, 0.4, 0.165, 2],
    ],
});

/**
 * Colours by role. Points before and after correction differ in blue and in lightness; marks on the sphere are light with a
 * dark border in both themes, as they lie on any colour.
 */
const PALETTES = {
    dark: {
        ground: "#10161d",
        seam: "#0b1015",
        unknown: "#3b4550",
        ink: "#f3f6f9",
        dim: "#93a1b0",
        grid: "#5d6b7a",
        raw: "#f0a040",
        corrected: "#58c4f5",
        rejected: "#ff5fa8",
        excluded: "#76828f",
        reading: "#0b1015",
        halo: "#0b1015",
        mark: "#f6f8fa",
        casing: "#0b1015",
    },
    light: {
        ground: "#ffffff",
        seam: "#ffffff",
        unknown: "#c3cad2",
        ink: "#12181f",
        dim: "#55616e",
        grid: "#a3aeb9",
        raw: "#c46a00",
        corrected: "#0a72b8",
        rejected: "#c8006e",
        excluded: "#98a2ac",
        reading: "#10181f",
        halo: "#ffffff",
        mark: "#ffffff",
        casing: "#12181f",
    },
};

/** @typedef {keyof typeof PALETTES.dark} Role */

/** Marks of the legend: error ÷ target. */
export const LEGEND_STOPS = /** @type {const} */ ([0.5, 1, 2, 5, 12]);

/**
 * The colour of a predicted heading error.
 *
 * @param {number | null} deg  1 σ, degrees; null (or NaN) if unknown
 * @param {number} target_deg  target of the error, degrees
 * @param {Theme} theme
 * @returns {Rgb}  of sRGB, 0…1
 */
export function errorColour(deg, target_deg, theme) {
    if (deg === null || Number.isNaN(deg)) return rgbOf(PALETTES[theme].unknown);
    const stops = STOPS[theme];
    const ratio = Math.min(Math.max(deg / target_deg, stops[0][0]), stops[stops.length - 1][0]);
    let upper = 1;
    while (upper < stops.length - 1 && ratio > stops[upper][0]) upper += 1;
    const [below, above] = [stops[upper - 1], stops[upper]];
    const share = Math.log(ratio / below[0]) / Math.log(above[0] / below[0]);
    const [a, b] = [labOf(below[1], below[2], below[3]), labOf(above[1], above[2], above[3])];
    return rgbOfLab(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]));
}

/**
 * Marks of a legend, from good to bad: the error, its colour, and its text.
 *
 * @param {number} target_deg
 * @param {Theme} theme
 * @returns {{deg: number, colour: string, words: string}[]}
 */
export function legend(target_deg, theme) {
    return LEGEND_STOPS.map((ratio, place) => {
        const deg = ratio * target_deg;
        const end = place === 0 ? " or less" : place === LEGEND_STOPS.length - 1 ? " or more" : "";
        return { deg, colour: cssOf(errorColour(deg, target_deg, theme)), words: `${Number(deg.toPrecision(3))}°${end}` };
    });
}

/**
 * Colours of a theme by role, as CSS.
 *
 * @param {Theme} theme
 * @returns {Readonly<Record<Role, string>>}
 */
export function palette(theme) {
    return PALETTES[theme];
}

/**
 * @param {Rgb} colour
 * @returns {string}  for CSS and SVG
 */
export function cssOf(colour) {
    return `rgb(${colour.map((part) => Math.round(255 * part)).join(" ")})`;
}

/**
 * @param {string} hex  "#rrggbb"
 * @returns {Rgb}
 */
export function rgbOf(hex) {
    const whole = Number.parseInt(hex.slice(1), 16);
    return [((whole >> 16) & 255) / 255, ((whole >> 8) & 255) / 255, (whole & 255) / 255];
}

/**
 * @param {number} lightness
 * @param {number} chroma
 * @param {number} hue  degrees
 * @returns {Rgb}  L, a, b of OKLab
 */
function labOf(lightness, chroma, hue) {
    const turn = (hue * Math.PI) / 180;
    return [lightness, chroma * Math.cos(turn), chroma * Math.sin(turn)];
}

/**
 * @param {number} L
 * @param {number} a
 * @param {number} b
 * @returns {Rgb}  of sRGB, clipped to its range
 */
function rgbOfLab(L, a, b) {
    const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
    const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
    const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
    return [
        gamma(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
        gamma(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
        gamma(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
    ];
}

/** @param {number} linear @returns {number} */
function gamma(linear) {
    const cut = Math.min(Math.max(linear, 0), 1);
    return cut <= 0.0031308 ? 12.92 * cut : 1.055 * cut ** (1 / 2.4) - 0.055;
}
