/** Deviation of a level compass over heading, before and after correction. */

import { element } from "../dom.js";
import { drawChart, nothing, tick } from "./charts.js";
import { freest, path, roundUp } from "./plot.js";
import { compassPoints, degrees } from "./words.js";
import { numeral, phrase } from "../language.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./plot.js").Panel} Panel */

/** @typedef {NonNullable<View["turn"]>} Turn */
/** @typedef {{top: number, bottom: number, left: number, right: number}} Box */

/**
 * Draw a level turn: deviation of the raw compass over heading, or its uncertainty after correction (1 σ).
 * @param {Panel} panel
 * @param {View | null} view
 * @param {number | null} target
 * @param {boolean} isRaw
 */
function drawDeviation(panel, view, target, isRaw) {
    const turn = view?.turn ?? null;
    const largest = turn ? Math.max(...turn.before_deg.map(Math.abs)) : NaN;
    const worst = turn ? largestOf(turn.sigma_deg ?? []) : NaN;
    const said = turn
        ? phrase("deviation.known", "Deviation over heading: raw compass off by up to {raw}, after correction {corrected} at the worst", { raw: degrees(largest), corrected: degrees(worst) })
        : phrase("deviation.none", "Deviation over heading, none yet");
    if (!panel.begin(said)) return;
    const box = { left: 3.3 * panel.em, right: panel.width - 0.9 * panel.em, top: 1.1 * panel.em, bottom: panel.height - 1.5 * panel.em };
    const toX = (/** @type {number} */ heading) => box.left + ((box.right - box.left) * heading) / 360;
    [...compassPoints(), compassPoints()[0]].forEach((name, i) => {
        panel.draw("path", { class: "grid", d: `M${toX(90 * i)} ${box.top}V${box.bottom}` });
        tick(panel, toX(90 * i), box.bottom + 1.15 * panel.em, name, "middle");
    });
    if (!turn) nothing(panel, phrase("plot.after-fit", "after the first fit"));
    else if (isRaw) drawRaw(panel, turn, box, toX);
    else drawLeft(panel, turn, target, box, toX);
}

/**
 * Draw the deviation of the raw compass.
 * @param {Panel} panel
 * @param {Turn} turn
 * @param {Box} box
 * @param {(heading: number) => number} toX
 */
function drawRaw(panel, turn, box, toX) {
    const largest = Math.max(...turn.before_deg.map(Math.abs));
    const toY = degreeAxis(panel, box, [Math.min(roundUp(1.05 * Math.max(largest, 1e-3)), 180)], true);
    const raw = closeCurve(turn.before_deg).flatMap((value, i, all) => {
        const wraps = i > 0 && Math.abs((value ?? 0) - (all[i - 1] ?? 0)) > 180;
        const point = /** @type {const} */ ([toX(headingsOf(turn)[i]), toY(value ?? NaN)]);
        return wraps ? [/** @type {const} */ ([NaN, NaN]), point] : [point];
    });
    panel.draw("path", { class: "raw", d: path(raw) });
    tick(panel, box.left, 0.75 * panel.em, phrase("plot.raw", "raw"), "start", "name");
}

/**
 * Draw the uncertainty after correction, with the target.
 * @param {Panel} panel
 * @param {Turn} turn
 * @param {number | null} target
 * @param {Box} box
 * @param {(heading: number) => number} toX
 */
function drawLeft(panel, turn, target, box, toX) {
    const sigmas = turn.sigma_deg ?? [];
    const top = Math.max(largestOf(sigmas), target ?? 0);
    const end = roundUp(1.2 * (Number.isFinite(top) && top > 0 ? top : 1));
    const toY = degreeAxis(panel, box, target && target > 0.4 * end ? [target, end] : [end], false);
    const curve = closeCurve(sigmas).map((value, i) => /** @type {const} */ ([toX(headingsOf(turn)[i]), toY(value ?? NaN)]));
    if (sigmas.length > 0 && !sigmas.some((value) => value === null)) {
        panel.draw("path", { class: "band", d: `${path(curve)}L${box.right} ${toY(0)}L${box.left} ${toY(0)}Z` });
        panel.draw("path", { class: "corrected", d: path(curve) });
    }
    tick(panel, box.left, 0.75 * panel.em, phrase("plot.corrected-sigma", "corrected, 1 σ"), "start", "name");
    if (!target) return;
    const level = toY(target);
    panel.draw("path", { class: "target", d: `M${box.left} ${level}H${box.right}` });
    const lines = [level - 0.3 * panel.em, level + 1.05 * panel.em];
    const within = lines.filter((y) => y - 0.6 * panel.em >= box.top && y <= box.bottom - 0.2 * panel.em);
    const place = freest(places(panel, box, within, phrase("plot.target", "target")), curve);
    if (place) tick(panel, place.x + place.wide / 2, place.y, place.words, "middle", "aim");
}

/**
 * @param {readonly (number | null)[]} values
 * @returns {number} NaN where none is known.
 */
function largestOf(values) {
    const known = values.filter((value) => value !== null).map(Number);
    return known.length > 0 ? Math.max(...known) : NaN;
}

/** @param {readonly (number | null)[]} values Values with the first one repeated at the end. */
const closeCurve = (values) => [...values, values[0]];

/** @param {Turn} turn */
const headingsOf = (turn) => [...turn.heading_deg, 360];

/** @typedef {import("./plot.js").Place} Place */

/**
 * Possible places of words: left, middle and right of lines of text.
 * @param {Panel} panel
 * @param {{left: number, right: number}} box
 * @param {readonly number[]} lines Baselines of the text.
 * @param {string} words
 * @returns {Place[]}
 */
function places(panel, { left, right }, lines, words) {
    const wide = 0.62 * panel.em * words.length;
    const gap = 0.3 * panel.em;
    return [right - wide - gap, left + gap, (left + right - wide) / 2].flatMap((x) =>
        lines.map((y) => ({ x, y, wide, high: 0.75 * panel.em, words })),
    );
}

/**
 * A strip of a chart with an axis of degrees, from minus to plus or from zero.
 * @param {Panel} panel
 * @param {Box} box
 * @param {readonly number[]} marked Degrees to be marked; the last is the end of the strip.
 * @param {boolean} both
 * @returns {(deg: number) => number} Position of a number of degrees.
 */
function degreeAxis(panel, box, marked, both) {
    const end = marked[marked.length - 1];
    const low = both ? -end : 0;
    const toY = (/** @type {number} */ value) => box.bottom - ((box.bottom - box.top) * (value - low)) / (end - low);
    let below = Infinity;
    for (const value of both ? [-end, 0, end] : [0, marked[0]]) {
        panel.draw("path", { class: value === 0 ? "zero" : "grid", d: `M${box.left} ${toY(value)}H${box.right}` });
        if (below - toY(value) < panel.em) continue;
        below = toY(value);
        tick(panel, box.left - 0.4 * panel.em, below + 0.28 * panel.em, shortest(value), "end");
    }
    return toY;
}

/**
 * @param {number} deg
 * @returns {string} Without trailing zeros.
 */
function shortest(deg) {
    return numeral(`${String(Number(deg.toPrecision(4))).replace("-", "\u2212")}°`);
}

/**
 * Draw the newest turn again.
 * @type {WeakMap<HTMLElement, () => void>}
 */
const redraws = new WeakMap();

/** @type {import("../widgets.js").Widget} */
export const deviation = {
    name: "deviation",
    title: "Deviation, level",
    place: "side",
    on: ["view", "state"],
    enlarges: "the deviation",
    begin({ head, host }) {
        const button = element("button", phrase("mode.raw", "Raw"));
        button.setAttribute("type", "button");
        button.setAttribute("aria-pressed", "false");
        button.addEventListener("click", () => {
            const isRaw = host.classList.toggle("raw");
            button.setAttribute("aria-pressed", String(isRaw));
            redraws.get(host)?.();
        });
        head.lastElementChild?.before(button);
    },
    draw({ host }, { view, state }) {
        const target = state?.target_deg ?? view?.heading_error_deg?.target_deg ?? null;
        const redraw = () => drawChart(host, ({ panel }) => drawDeviation(panel, view, target, host.classList.contains("raw")));
        redraws.set(host, redraw);
        redraw();
    },
    css: `
        .plot .band { fill: var(--corrected); fill-opacity: 0.22; }
        .plot .target { stroke: var(--ink); stroke-width: 0.125em; stroke-dasharray: 0.17em 0.33em; }
        .deviation .head { gap: 0.25rem; }
        @media (max-width: 699px) { .deviation .host { min-height: 12rem; } }
    `,
};
