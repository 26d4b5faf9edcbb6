/** By how much a level compass is off at each heading, before and after correction. */

import { drawChart, nothing, tick } from "./charts.js";
import { freest, path, roundUp } from "./plot.js";
import { degrees } from "./words.js";

/** @typedef {import("../messages.d.ts").View} View */
/** @typedef {import("./plot.js").Panel} Panel */

/**
 * A level turn: by how much the raw compass is off at each heading, and what is left open after correction (1 σ), each
 * on a scale of its own, with the target.
 * @param {Panel} panel
 * @param {View | null} view
 * @param {number | null} target
 */
function drawDeviation(panel, view, target) {
    const turn = view?.turn ?? null;
    const largest = turn ? Math.max(...turn.before_deg.map(Math.abs)) : NaN;
    const sigmas = (turn?.sigma_deg ?? []).filter((value) => value !== null).map(Number);
    const worst = sigmas.length > 0 ? Math.max(...sigmas) : NaN;
    const said = turn ? `: raw compass off by up to ${degrees(largest)}, after correction ${degrees(worst)} at the worst` : ", none yet";
    if (!panel.begin(`Deviation over heading${said}`)) return;
    const [left, right] = [3.3 * panel.em, panel.width - 0.9 * panel.em];
    const middle = 0.25 * panel.em + (panel.height - 1.6 * panel.em) * 0.55;
    const bottom = panel.height - 1.5 * panel.em;
    const toX = (/** @type {number} */ heading) => left + ((right - left) * heading) / 360;
    ["N", "E", "S", "W", "N"].forEach((name, i) => {
        panel.draw("path", { class: "grid", d: `M${toX(90 * i)} ${0.3 * panel.em}V${bottom}` });
        tick(panel, toX(90 * i), bottom + 1.15 * panel.em, name, "middle");
    });
    if (!turn) return nothing(panel, "after the first fit");
    const closed = (/** @type {readonly (number | null)[]} */ values) => [...values, values[0]];
    const headings = [...turn.heading_deg, 360];
    const upper = degreeAxis(panel, { top: 0.3 * panel.em, bottom: middle - 0.9 * panel.em, left, right }, [Math.min(roundUp(1.05 * Math.max(largest, 1e-3)), 180)], true);
    const raw = closed(turn.before_deg).flatMap((value, i, all) => {
        const wraps = i > 0 && Math.abs((value ?? 0) - (all[i - 1] ?? 0)) > 180;
        const point = /** @type {const} */ ([toX(headings[i]), upper(value ?? NaN)]);
        return wraps ? [/** @type {const} */ ([NaN, NaN]), point] : [point];
    });
    panel.draw("path", { class: "raw", d: path(raw) });
    const top = Math.max(worst, target ?? 0);
    const end = roundUp(1.2 * (Number.isFinite(top) && top > 0 ? top : 1));
    const marked = target && target > 0.4 * end ? [target, end] : [end];
    const lower = degreeAxis(panel, { top: middle, bottom, left, right }, marked, false);
    const left_open = closed(turn.sigma_deg ?? []).map(
        (value, i) => /** @type {const} */ ([toX(headings[i]), lower(value ?? NaN)]),
    );
    if (sigmas.length === turn.heading_deg.length) {
        const floor = lower(0);
        panel.draw("path", { class: "band", d: `${path(left_open)}L${right} ${floor}L${left} ${floor}Z` });
        panel.draw("path", { class: "corrected", d: path(left_open) });
    }
    if (!target) return;
    const level = lower(target);
    panel.draw("path", { class: "target", d: `M${left} ${level}H${right}` });
    const lines = [level - 0.3 * panel.em, level + 1.05 * panel.em];
    const within = lines.filter((y) => y - 0.6 * panel.em >= middle && y <= bottom - 0.2 * panel.em);
    const place = freest(places(panel, { left, right }, within, "target"), left_open);
    if (place) tick(panel, place.x + place.wide / 2, place.y, place.words, "middle", "aim");
}

/** @typedef {import("./plot.js").Place} Place */

/**
 * Where a word could stand: at the left, in the middle and at the right of lines of text.
 * @param {Panel} panel
 * @param {{left: number, right: number}} box
 * @param {readonly number[]} lines Where the feet of the letters are.
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
 * @param {{top: number, bottom: number, left: number, right: number}} box
 * @param {readonly number[]} marked Degrees to be marked; the last is the end of the strip.
 * @param {boolean} both
 * @returns {(deg: number) => number} Where a number of degrees lies.
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
 * @returns {string} With no more digits than it has.
 */
function shortest(deg) {
    return `${String(Number(deg.toPrecision(4))).replace("-", "\u2212")}°`;
}

/** @type {import("../widgets.js").Widget} */
export const deviation = {
    name: "deviation",
    title: "Deviation, level",
    place: "side",
    on: ["view", "state"],
    legend: [
        ["raw line", "raw"],
        ["corrected line", "after, 1 σ"],
    ],
    enlarges: "the deviation",
    draw({ host }, { view, state }) {
        const target = state?.target_deg ?? view?.heading_error_deg?.target_deg ?? null;
        drawChart(host, ({ panel }) => drawDeviation(panel, view, target));
    },
    css: `
        .plot .band { fill: var(--corrected); fill-opacity: 0.22; }
        .plot .target { stroke: var(--ink); stroke-width: 0.125em; stroke-dasharray: 0.17em 0.33em; }
        .deviation .head, .deviation .key { gap: 0.5rem; }
        @media (max-width: 699px) { .deviation .host { min-height: 12rem; } }
    `,
};
