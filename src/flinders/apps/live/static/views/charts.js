/**
 * Common parts of the flat charts.
 *
 * A chart is a function of a host element and of the data to draw. A further call with the same host redraws, and a change
 * of the host's size redraws as well. The host needs a height. Colours are the CSS variables --ink, --faint, --line, --raw,
 * --corrected, --reject and --panel, as #rrggbb. Raw and corrected data differ in colour and in style: hollow and filled,
 * or dashed and solid.
 */

import { Density, Panel } from "./plot.js";

/** Largest number of crosses in one chart. */
const MAX_CROSSES = 400;

/** @typedef {readonly [number, number]} Place  in pixels of the chart */

/**
 * A chart in its host: holds its panel, and redraws when the size changes. A chart of single readings gives their places,
 * and marks the reading under the pointer in any chart.
 */
export class Chart {
    /** @type {(reading: number) => Place[]} Places of a reading. */
    places = () => [];
    /** @type {(x: number, y: number) => number | null} The reading drawn nearest to a place. */
    nearest = () => null;

    /** @param {HTMLElement} host */
    constructor(host) {
        this.panel = new Panel(host);
        this.before = new Density();
        this.after = new Density();
        this.draw = () => {};
        /** @type {number | null} */
        this.hovered = null;
        this.panel.onresize = () => this.draw();
    }

    /** Clear the places of readings until the next drawing. */
    forget() {
        this.places = () => [];
        this.nearest = () => null;
    }
}

/**
 * Mark a reading in a chart; null removes the mark.
 * @param {Chart} chart
 * @param {number | null} reading
 */
export function markReading(chart, reading) {
    chart.hovered = reading;
    chart.panel.front.querySelectorAll(".hovered").forEach((mark) => mark.remove());
    if (reading === null) return;
    const r = 0.4 * chart.panel.em;
    for (const [cx, cy] of chart.places(reading)) chart.panel.draw("circle", { class: "hovered", cx, cy, r });
}

/** @type {WeakMap<HTMLElement, Chart>} */
const charts = new WeakMap();

/**
 * The chart that a host holds.
 * @param {HTMLElement} host
 * @returns {Chart}
 */
export function chartOf(host) {
    const known = charts.get(host);
    if (known) return known;
    const chart = new Chart(host);
    charts.set(host, chart);
    return chart;
}

/**
 * Draw a chart, now and whenever its host changes its size.
 * @param {HTMLElement} host
 * @param {(chart: Chart) => void} draw
 */
export function drawChart(host, draw) {
    const chart = chartOf(host);
    chart.draw = () => {
        chart.forget();
        draw(chart);
        markReading(chart, chart.hovered);
    };
    chart.draw();
}

/**
 * Draw words at a place of a chart.
 * @param {Panel} panel
 * @param {number} x
 * @param {number} y
 * @param {string} text
 * @param {string} anchor
 * @param {string} [kind]
 */
export function tick(panel, x, y, text, anchor, kind = "words") {
    panel.draw("text", { class: kind, x, y, "text-anchor": anchor }, text);
}

/**
 * Draw readings left out as crosses, in one path; of very many only some.
 * @param {Panel} panel
 * @param {readonly (readonly [number, number])[]} places
 * @returns {SVGElement}
 */
export function crosses(panel, places) {
    const r = 0.26 * panel.em;
    const step = Math.ceil(places.length / MAX_CROSSES);
    const shape = `l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`;
    const d = places.filter((_, i) => i % step === 0).map(([x, y]) => `M${(x - r).toFixed(1)} ${(y - r).toFixed(1)}${shape}`);
    return panel.draw("path", { class: "reject", d: d.join("") });
}

/**
 * Draw the reason why a chart is empty.
 * @param {Panel} panel
 * @param {string} words
 */
export function nothing(panel, words) {
    tick(panel, panel.width / 2, panel.height / 2, words, "middle", "nothing");
}
