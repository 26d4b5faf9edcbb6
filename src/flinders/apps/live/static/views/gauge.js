/**
 * The gauge: predicted heading error on a logarithmic arc that runs from twenty targets down to a quarter of one.
 * Its colours are those of the sphere, so it is the sphere's legend too.
 */

import { cssOf, errorColour } from "../../../../static/views/colours.js";
import { path, svg } from "./plot.js";
import { degrees } from "./words.js";
import { numeral, phrase } from "../language.js";

const LEFT_DEG = -112;
const RIGHT_DEG = 112;
const MAX_RATIO = 20;
const MIN_RATIO = 0.25;
const SEGMENTS = 56;
const STOPS = [10, 5, 2, 1, 0.5];
const [MIDDLE_X, MIDDLE_Y, RADIUS, THICK] = [160, 144, 121, 14];

/**
 * Values of the gauge; null while unknown.
 * @typedef {object} Reading
 * @property {number | null} rms Degrees, 1 σ.
 * @property {number | null} worst
 * @property {number} target
 */

/**
 * Angle on the dial, degrees from the top, of an error.
 * @param {number} deg
 * @param {number} target
 * @returns {number}
 */
function gaugeAngle(deg, target) {
    const ratio = Math.min(Math.max(deg / target, MIN_RATIO), MAX_RATIO);
    return LEFT_DEG + ((RIGHT_DEG - LEFT_DEG) * Math.log(MAX_RATIO / ratio)) / Math.log(MAX_RATIO / MIN_RATIO);
}

/** Widths of characters of the large type, in its size; all others are digits. */
const WIDTHS = /** @type {Readonly<Record<string, number>>} */ ({ ".": 0.37, ",": 0.37, " ": 0.33, ">": 0.82 });
const [DIGIT, DEGREE] = [0.67, 0.33];

/**
 * Width of a number with its degree sign, in sizes of the large type.
 * @param {string} number As "0.043", without the sign.
 * @returns {number}
 */
export function ems(number) {
    return Array.from(number).reduce((sum, letter) => sum + (WIDTHS[letter] ?? DIGIT), DEGREE);
}

/**
 * Draw the gauge, or move its pointers. The number itself is set by the page, in text.
 * @param {HTMLElement} host
 * @param {Reading} reading
 * @param {"dark" | "light"} [theme]
 */
export function gauge(host, { rms, worst, target }, theme = "dark") {
    const key = `${target} ${theme}`;
    if (host.dataset.drawn !== key) {
        host.dataset.drawn = key;
        host.replaceChildren(dial(target, theme));
    }
    const said =
        worst === null
            ? phrase("gauge.unknown", "Predicted heading error unknown")
            : phrase("gauge.known", "Predicted heading error {worst} at the worst heading, {rms} rms; target {target}", { worst: degrees(worst), rms: degrees(rms), target: degrees(target) });
    host.setAttribute("role", "img");
    host.setAttribute("aria-label", said);
    turn(host, ".worst", worst, target);
    turn(host, ".rms", rms, target);
    for (const element of host.querySelectorAll(".segment")) {
        const deg = Number(element.getAttribute("data-deg"));
        element.classList.toggle("ahead", worst === null || deg < worst);
    }
}

/**
 * @param {HTMLElement} host
 * @param {string} name
 * @param {number | null} deg
 * @param {number} target
 */
function turn(host, name, deg, target) {
    const pointer = /** @type {SVGElement | null} */ (host.querySelector(name));
    if (!pointer) return;
    pointer.classList.toggle("unknown", deg === null);
    const angle = deg === null ? LEFT_DEG : gaugeAngle(deg, target);
    pointer.style.transform = `rotate(${angle.toFixed(2)}deg)`;
}

/**
 * The arc with its numbers, pointers at rest.
 * @param {number} target
 * @param {"dark" | "light"} theme
 * @returns {SVGElement}
 */
function dial(target, theme) {
    const root = svg("svg", { viewBox: "0 0 320 202", "aria-hidden": "true" });
    const step = (RIGHT_DEG - LEFT_DEG) / SEGMENTS;
    for (let i = 0; i < SEGMENTS; i++) {
        const [from, to] = [LEFT_DEG + i * step, LEFT_DEG + (i + 1) * step - 0.55];
        const deg = target * MAX_RATIO * (MIN_RATIO / MAX_RATIO) ** ((i + 0.5) / SEGMENTS);
        const part = svg("path", { class: "segment", d: ring(from, to), "data-deg": deg.toPrecision(6) });
        part.setAttribute("fill", cssOf(errorColour(deg, target, theme)));
        root.append(part);
    }
    for (const stop of STOPS) {
        const angle = gaugeAngle(stop * target, target);
        const [x, y] = at(angle, RADIUS + 14);
        const [[x1, y1], [x2, y2]] = [at(angle, RADIUS + 1), at(angle, RADIUS + 6)];
        root.append(svg("path", { class: stop === 1 ? "mark aim" : "mark", d: `M${x1} ${y1}L${x2} ${y2}` }));
        const anchor = angle < -20 ? "end" : angle > 20 ? "start" : "middle";
        root.append(svg("text", { class: stop === 1 ? "aim" : "stop", x, y: y + 4, "text-anchor": anchor }, number(stop * target)));
    }
    const inside = RADIUS - THICK;
    const transform = `translate(${MIDDLE_X} ${MIDDLE_Y})`;
    const rms = svg("path", { class: "rms pointer", d: `M0 ${-inside - 1}L-4 ${-inside + 8}L4 ${-inside + 8}Z` });
    const worst = svg("path", { class: "worst pointer", d: `M0 ${-inside + 4}L-5.5 ${-inside + 15}H5.5ZM-2.2 ${-RADIUS - 3}H2.2V${-inside + 5}H-2.2Z` });
    root.append(svg("g", { transform }, [rms]), svg("g", { transform }, [worst]));
    return root;
}

/**
 * @param {number} deg
 * @returns {string} An angle without trailing zeros: 0.5°, 1°, 10°.
 */
function number(deg) {
    return numeral(`${Number(deg.toPrecision(2))}°`);
}

/**
 * @param {number} angle Degrees from the top, clockwise.
 * @param {number} radius
 * @returns {[number, number]} Place at an angle and a distance from the middle of the dial.
 */
function at(angle, radius) {
    const turned = (angle * Math.PI) / 180;
    return [MIDDLE_X + radius * Math.sin(turned), MIDDLE_Y - radius * Math.cos(turned)];
}

/**
 * @param {number} from
 * @param {number} to
 * @returns {string} A piece of a ring, as the `d` of a path.
 */
function ring(from, to) {
    const arc = (/** @type {number} */ radius, /** @type {number} */ a, /** @type {number} */ b) => [0, 0.5, 1].map((s) => at(a + s * (b - a), radius));
    return path([...arc(RADIUS, from, to), ...arc(RADIUS - THICK, to, from)], true);
}
