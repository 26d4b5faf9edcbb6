/** Legend of the 3-D view: each colour with its meaning. */

import { element } from "./dom.js";
import { legend, palette } from "../../../static/views/colours.js";
import { svg } from "./views/plot.js";
import { numeral, phrase } from "./language.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("../../../static/views/colours.js").Theme} Theme */
/** @typedef {import("../../../static/views/scene.js").Mode} Mode */
/** @typedef {{kind: "tile" | "dot" | "cross" | "hatch", colour: string, words: string}} LegendRow */

/** @type {Readonly<Record<LegendRow["kind"], (colour: string) => SVGElement[]>>} */
const PATCHES = Object.freeze({
    tile: (fill) => [svg("rect", { width: 14, height: 14, rx: 3, fill })],
    dot: (fill) => [svg("circle", { cx: 7, cy: 7, r: 4, fill })],
    cross: (stroke) => [svg("path", { d: "M3 3L11 11M11 3L3 11", stroke, "stroke-width": 2 })],
    hatch: (stroke) => [
        svg("rect", { width: 13, height: 13, x: 0.5, y: 0.5, rx: 3, fill: "none", stroke }),
        svg("path", { d: "M2 12L12 2M2 7L7 2M7 12L12 7", stroke }),
    ],
});

/**
 * Rows of the legend: tiles, or readings before and after correction; and readings left out.
 * @param {State | null} state
 * @param {View | null} view
 * @param {Mode} mode
 * @param {Theme} theme
 * @returns {LegendRow[]}
 */
export function legendOf(state, view, mode, theme) {
    const isSphere = mode === "sphere" && Boolean(view?.shown);
    const drawn = isSphere ? tiles(state?.target_deg ?? 1, view, theme) : clouds(Boolean(view?.shown), mode, theme);
    return [...drawn, ...leftOut(state, theme)];
}

/** @param {number} target_deg @param {View | null} view @param {Theme} theme @returns {LegendRow[]} */
function tiles(target_deg, view, theme) {
    /** @type {LegendRow[]} */
    const rows = legend(target_deg, theme).map(({ colour, words }) => ({ kind: "tile", colour, words: markWords(words) }));
    const hasUnknown = (view?.level_deg ?? view?.tiles_deg)?.some((deg) => deg === null);
    if (hasUnknown) rows.push({ kind: "tile", colour: palette(theme).unknown, words: phrase("legend.unknown", "not known") });
    rows.push({ kind: "hatch", colour: "currentColor", words: phrase("legend.unvisited", "not visited") });
    return rows;
}

/**
 * Words at a colour of the legend in the page's language: "0.5° or less".
 * @param {string} words
 */
function markWords(words) {
    const [deg, ...end] = words.split(" ");
    const angle = numeral(deg);
    if (!end.length) return angle;
    return end[1] === "less" ? phrase("legend.less", "{angle} or less", { angle }) : phrase("legend.more", "{angle} or more", { angle });
}

/** @param {boolean} isKnown  there is a correction @param {Mode} mode @param {Theme} theme @returns {LegendRow[]} */
function clouds(isKnown, mode, theme) {
    const { raw, corrected } = palette(theme);
    /** @type {LegendRow[]} */
    const rows = [];
    if (!isKnown || mode !== "corrected") rows.push({ kind: "dot", colour: raw, words: phrase("plot.raw", "raw") });
    if (isKnown && mode !== "raw") rows.push({ kind: "dot", colour: corrected, words: phrase("plot.corrected", "corrected") });
    return rows;
}

/** @param {State | null} state @param {Theme} theme @returns {LegendRow[]} */
function leftOut(state, theme) {
    const { rejected, excluded } = palette(theme);
    /** @type {LegendRow[]} */
    const rows = [];
    if (state?.rejected) rows.push({ kind: "cross", colour: rejected, words: phrase("plot.outliers", "outliers") });
    if (state?.excluded_readings) rows.push({ kind: "dot", colour: excluded, words: phrase("legend.left-out", "left out") });
    return rows;
}

/** @param {LegendRow} row @returns {HTMLElement} */
export function legendRow({ kind, colour, words }) {
    const patch = svg("svg", { viewBox: "0 0 14 14", "aria-hidden": "true" }, PATCHES[kind](colour));
    const [, first = "", rest] = /^(\S+°)?(.*)$/.exec(words) ?? [words, "", words];
    return element("p", [patch, element("span", [first, element("span", rest, first ? "rest" : "")])]);
}
