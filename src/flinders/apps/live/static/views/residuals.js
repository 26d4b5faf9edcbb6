/** Histogram of the distances of readings from the sphere. */

import { element, setText } from "../dom.js";
import { drawChart, nothing, tick } from "./charts.js";
import { nearestOf } from "../../../../static/views/nearest.js";
import { path, tickDecimals, ticks } from "./plot.js";
import { correctReading } from "../../../../static/views/vectors.js";
import { fixedText, significant } from "./words.js";
import { phrase } from "../language.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./charts.js").Chart} Chart */
/** @typedef {import("../../../../static/view.d.ts").Points} Points */

/**
 * Distances of the readings from the sphere, with the bell curve that independent noise would give.
 * @param {Chart} chart
 * @param {View | null} view
 * @param {Points} points
 */
function drawHistogram(chart, view, points) {
    const { panel } = chart;
    const residuals = view?.residuals ?? null;
    const known = residuals !== null && residuals.counts.length > 0 && residuals.edges.length > residuals.counts.length;
    const noise = known ? (view?.noise ?? null) : null;
    const said = noise === null ? phrase("residuals.none", "none yet") : phrase("residuals.noise", "standard deviation {noise} {unit}", { noise: fixedText(noise, 3), unit: view?.unit ?? "" });
    if (!panel.begin(phrase("residuals.label", "Distances of the readings from the sphere, {noise}", { noise: said }))) return;
    const [left, right] = [0.5 * panel.em, panel.width - 0.5 * panel.em];
    const [top, bottom] = [0.5 * panel.em, panel.height - 1.5 * panel.em];
    panel.draw("path", { class: "axis", d: `M${left} ${bottom}H${right}` });
    if (!known || !residuals) return nothing(panel, phrase("plot.after-fit", "after the first fit"));
    const { edges, counts } = residuals;
    const reach = Math.max(Math.abs(edges[0]), Math.abs(edges[edges.length - 1])) || 1;
    const toX = (/** @type {number} */ value) => left + ((right - left) * (value + reach)) / (2 * reach);
    const placeOf = (/** @type {number} */ j) => toX(Math.min(Math.max(residualOf(j, points, view), -reach), reach));
    chart.places = (j) => [[placeOf(j), bottom]];
    chart.nearest = (x) => nearestOf(points.count, (j) => Math.abs(placeOf(j) - x));
    const total = counts.reduce((sum, count) => sum + count, 0);
    const bell = (/** @type {number} */ value) =>
        noise ? (total * (edges[1] - edges[0]) * Math.exp(-0.5 * (value / noise) ** 2)) / (noise * Math.sqrt(2 * Math.PI)) : 0;
    const most = Math.max(1, bell(0), ...counts);
    const toY = (/** @type {number} */ count) => bottom - ((bottom - top) * count) / most;
    counts.forEach((count, i) => {
        const [x, to] = [toX(edges[i]), toX(edges[i + 1])];
        panel.draw("rect", { class: "bar", x: x + 0.5, y: toY(count), width: Math.max(to - x - 1, 0.5), height: bottom - toY(count) });
    });
    if (noise) {
        const curve = Array.from({ length: 81 }, (_, i) => (i / 40 - 1) * reach);
        panel.draw("path", { class: "bell", d: path(curve.map((value) => /** @type {const} */ ([toX(value), toY(bell(value))]))) });
    }
    const values = ticks({ low: -reach, high: reach }, 4);
    for (const value of values) {
        tick(panel, toX(value), bottom + 1.15 * panel.em, fixedText(value, tickDecimals(values)), "middle");
        panel.draw("path", { class: "tick", d: `M${toX(value)} ${bottom}v${0.25 * panel.em}` });
    }
}

/**
 * Distance of a reading from the sphere.
 * @param {number} j
 * @param {Points} points
 * @param {View | null} view
 * @returns {number} 0 without a sphere.
 */
function residualOf(j, { field }, view) {
    const shown = view?.shown;
    if (!shown) return 0;
    return Math.hypot(...correctReading([field[3 * j], field[3 * j + 1], field[3 * j + 2]], shown)) - shown.strength;
}

/** @type {import("../widgets.js").Widget} */
export const residuals = {
    name: "residuals",
    title: "Residuals ",
    place: "side",
    on: ["view"],
    showsReadings: true,
    enlarges: "the residuals",
    begin({ title }) {
        const noise = element("span", "", "faint");
        noise.id = "residuals-noise";
        title.append(noise);
    },
    draw({ title, host }, { view, points }) {
        const noise = view?.noise ?? null;
        if (title.lastElementChild) setText(title.lastElementChild, noise === null ? "" : `σ ${significant(noise, 3)} ${view?.unit}`);
        drawChart(host, (chart) => drawHistogram(chart, view, points));
    },
    css: `
        .plot .bar { fill: var(--corrected); fill-opacity: 0.75; }
        .plot .bell { stroke: var(--ink); stroke-width: 0.125em; }
        @media (min-width: 700px) and (max-width: 1099px), (min-width: 1100px) and (max-height: 639px) { .residuals { grid-column: 1 / -1; } }
    `,
};
