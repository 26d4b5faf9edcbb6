/**
 * Two compass roses: the heading of the raw and of the corrected sensor.
 *
 * Axes are forward, right, down. The heading is ψ = atan2(−m_y, m_x) of the field in level axes; where there is an
 * acceleration (specific force, at rest −g on z), level is found from it, and otherwise the sensor is taken as level.
 */

import { element, setText } from "../dom.js";
import { svg } from "./plot.js";
import { correctReading, cross } from "../../../../static/views/vectors.js";
import { compass, compassPoints } from "./words.js";
import { phrase } from "../language.js";

/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */

/**
 * A heading, and the tilt of the sensor.
 * @typedef {object} Heading
 * @property {number | null} deg Clockwise from magnetic north, 0 to 360; null if undefined.
 * @property {number | null} tilt_deg Null without acceleration.
 */

/**
 * Heading of a field vector.
 *
 * East is down × field and north is east × down; the forward axis seen in those two is the heading.
 * @param {Vector} field
 * @param {Vector | null} acceleration
 * @returns {Heading}
 */
function headingOf(field, acceleration) {
    const force = acceleration ? Math.hypot(...acceleration) : 0;
    if (!acceleration || !(force > 0) || !Number.isFinite(force)) {
        const flat = Math.hypot(field[0], field[1]);
        return { deg: flat > 0 ? positiveDegrees(Math.atan2(-field[1], field[0])) : null, tilt_deg: null };
    }
    const down = /** @type {[number, number, number]} */ (acceleration.map((part) => -part / force));
    const east = cross(down, field);
    const north = cross(east, down);
    const tilt_deg = (Math.acos(Math.min(1, Math.max(-1, down[2]))) * 180) / Math.PI;
    if (!(Math.hypot(...east) > 0)) return { deg: null, tilt_deg };
    // Both have the length of the horizontal field, so that their ratio is the tangent of the heading.
    return { deg: Math.hypot(east[0], north[0]) > 0 ? positiveDegrees(Math.atan2(east[0], north[0])) : null, tilt_deg };
}

/**
 * Difference of two headings, −180 to 180 degrees.
 * @param {number} from
 * @param {number} to
 * @returns {number}
 */
function difference(from, to) {
    return ((to - from + 540) % 360) - 180;
}

/**
 * @param {number} angle Radians.
 * @returns {number} Degrees, 0 to 360.
 */
function positiveDegrees(angle) {
    return (((angle * 180) / Math.PI) % 360 + 360) % 360;
}

/**
 * Draw both roses, or turn their needles.
 * @param {HTMLElement} host
 * @param {{raw_deg: number | null, corrected_deg: number | null, tilt: number | null}} headings
 */
function dial(host, { raw_deg, corrected_deg, tilt }) {
    if (!host.querySelector(".rose")) host.replaceChildren(rose("raw", phrase("mode.raw", "Raw")), rose("corrected", phrase("mode.corrected", "Corrected")), element("p", "", "tilt"));
    point(host, "raw", raw_deg);
    point(host, "corrected", corrected_deg);
    const words = host.querySelector(".tilt");
    const level = tilt === null ? phrase("heading.level", "taken as level") : phrase("heading.tilt", "tilt {tilt}°, removed", { tilt: Math.round(tilt) });
    const off =
        raw_deg === null || corrected_deg === null
            ? ""
            : phrase("heading.off", "raw is {off}° off", { off: Math.abs(Math.round(difference(corrected_deg, raw_deg))) });
    const said = raw_deg === null ? "" : [off, level].filter(Boolean).join(" · ");
    if (words) setText(words, said);
}

/**
 * @param {string} kind
 * @param {string} title
 * @returns {HTMLElement}
 */
function rose(kind, title) {
    const number = element("output", "", "number");
    number.setAttribute("aria-live", "off");
    const drawing = svg("svg", { viewBox: "-100 -100 200 200", "aria-hidden": "true" });
    drawing.append(svg("circle", { class: "edge", r: 92 }));
    for (let deg = 0; deg < 360; deg += 10) {
        const long = deg % 30 === 0;
        const mark = svg("path", { class: long ? "long" : "short", d: `M0 -88V${long ? -76 : -82}` });
        mark.setAttribute("transform", `rotate(${deg})`);
        drawing.append(mark);
    }
    compassPoints().forEach((name, i) => {
        const angle = (i * Math.PI) / 2;
        drawing.append(svg("text", { class: "point", x: 60 * Math.sin(angle), y: -60 * Math.cos(angle) + 9.5, "text-anchor": "middle" }, name));
    });
    const needle = [svg("path", { class: "ahead", d: "M0 -84L9 0H-9Z" }), svg("path", { class: "behind", d: "M0 56L7 0H-7Z" }), svg("circle", { class: "hub", r: 6 })];
    drawing.append(svg("g", { class: "needle" }, needle));
    return element("figure", [drawing, number, element("figcaption", title)], `rose ${kind}`);
}

/**
 * @param {HTMLElement} host
 * @param {string} kind
 * @param {number | null} deg
 */
function point(host, kind, deg) {
    const figure = host.querySelector(`.rose.${kind}`);
    const needle = figure?.querySelector(".needle");
    const number = figure?.querySelector(".number");
    figure?.classList.toggle("unknown", deg === null);
    needle?.setAttribute("transform", `rotate(${(deg ?? 0).toFixed(1)})`);
    const said = compass(deg);
    if (number) setText(number, said);
}

/** @type {import("../widgets.js").Widget} */
export const heading = {
    name: "heading",
    title: "Heading now",
    enlarges: "the heading",
    place: "side",
    host: "dial",
    on: ["now", "view"],
    draw({ host }, { now, view }) {
        const acceleration = now?.acceleration ?? null;
        const calibration = view?.offset && view.matrix ? { offset: view.offset, matrix: view.matrix } : null;
        const before = now ? headingOf(now.raw, acceleration) : null;
        const after = now && calibration ? headingOf(correctReading(now.raw, calibration), acceleration) : null;
        dial(host, { raw_deg: before?.deg ?? null, corrected_deg: after?.deg ?? null, tilt: before?.tilt_deg ?? null });
    },
    css: `
        .dial { display: grid; grid-template-columns: 1fr 1fr; gap: 0 0.75rem; grid-template-rows: minmax(0, 1fr) auto; justify-items: center; flex: 1; min-height: 0; }
        .rose { display: grid; grid-template: minmax(6.25rem, 1fr) auto / 1fr auto auto 1fr; gap: 0 0.5rem; align-items: baseline; width: 100%; min-height: 0; }
        .rose svg { grid-area: 1 / 1 / 2 / 5; width: 100%; height: 100%; max-height: 14rem; align-self: center; }
        .rose .number { grid-column: 2; }
        .rose .edge { fill: none; stroke: var(--line); stroke-width: 2; }
        .rose .short { stroke: var(--strong-line); stroke-width: 1.5; }
        .rose .long { stroke: var(--faint); stroke-width: 3; }
        .rose .point { font-size: 26px; font-weight: 600; fill: var(--faint); }
        .rose .number { font-size: 1.5rem; font-weight: 650; line-height: 1.1; }
        .rose figcaption { font-size: 0.8125rem; color: var(--faint); }
        .rose .hub { fill: var(--panel); stroke-width: 3; }
        .rose .behind { fill: var(--line); }
        .rose.raw .ahead { fill: none; stroke: var(--raw); stroke-width: 4; }
        .rose.raw .hub { stroke: var(--raw); }
        .rose.corrected .ahead { fill: var(--corrected); }
        .rose.corrected .hub { stroke: var(--corrected); }
        .rose.raw .number { color: var(--raw); }
        .rose.corrected .number { color: var(--corrected); }
        .rose.unknown .needle { opacity: 0; }
        .rose.unknown .number { color: var(--faint); }
        .enlarged .rose svg { max-height: none; }
        .enlarged .rose .number { font-size: 3rem; }
        .enlarged .dial :is(.tilt, figcaption) { font-size: 1.25rem; }
        @media (max-aspect-ratio: 1/1) { .enlarged .dial { grid-template: repeat(2, minmax(0, 1fr)) auto / 1fr; } }
        .dial .tilt { grid-column: 1 / -1; min-height: 1.25em; margin-top: 0.25rem; font-size: 0.8125rem; color: var(--faint); text-align: center; }
        @media (min-width: 1100px) and (min-height: 640px) { .panel.heading { grid-area: 1 / 3 / 2 / 4; } }
    `,
};
