/** The length of each reading over time: flat after a good correction. Spans of time can be marked in it. */

import { Brush, xOf } from "./brush.js";
import { chartOf, crosses, drawChart, nothing, tick } from "./charts.js";
import { Exclusion } from "./exclusion.js";
import { mark, REJECTED, USED } from "../../../../static/views/marks.js";
import { nearestOf } from "../../../../static/views/nearest.js";
import { quantiles, roundUp, themeColour, tickDecimals, ticks } from "./plot.js";
import { clock, fixedText } from "./words.js";
import { phrase } from "../language.js";

/** @typedef {import("./brush.js").Place} Place */
/** @typedef {import("./charts.js").Chart} Chart */
/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/view.d.ts").Points} Points */
/** @typedef {import("../../../../static/view.d.ts").Shown} Shown */
/** @typedef {import("./plot.js").Panel} Panel */
/** @typedef {import("./plot.js").Span} Span */

/**
 * Readings of the drawing: lengths, which of them count, and the scales of time and length.
 * @typedef {object} Drawn
 * @property {Points} points
 * @property {Uint8Array} kinds
 * @property {Float32Array} raw
 * @property {Float32Array | null} corrected
 * @property {Place} place
 * @property {(t: number) => number} toX
 * @property {(v: number) => number} toY
 */

/**
 * The length of each reading over time, raw and corrected; rejected ones are crossed, excluded spans are hatched.
 * @param {Chart} chart
 * @param {Points} points
 * @param {View | null} view
 * @param {State | null} state
 * @returns {Place | null}
 */
function drawStrength(chart, points, view, state) {
    const { panel } = chart;
    const shown = view?.shown ?? null;
    const unit = view?.unit ?? state?.unit ?? "";
    const kinds = new Uint8Array(points.count);
    mark(kinds, points, view?.rejected ?? [], state?.excluded ?? []);
    const raw = lengths(points, null);
    const corrected = shown && lengths(points, shown);
    const span = strengthSpan(raw, kinds, shown);
    const said = points.count > 0 ? phrase("strength.raw", ", raw from {low} to {high} {unit}", { low: fixedText(span.raw[0], 1), high: fixedText(span.raw[1], 1), unit }) : "";
    const meant = shown ? phrase("strength.corrected", ", corrected about {strength} {unit}", { strength: fixedText(shown.strength, 1), unit }) : "";
    if (!panel.begin(`${phrase("strength.label", "Field strength over time")}${said}${meant}`)) return null;
    const place = placeIn(panel, points);
    const toX = (/** @type {number} */ t) => xOf(place, t);
    const toY = (/** @type {number} */ v) => place.bottom - ((place.bottom - place.top) * (v - span.low)) / (span.high - span.low);
    const drawn = { points, kinds, raw, corrected, place, toX, toY };
    chart.places = (j) => [raw, corrected].flatMap((each) => (each ? [[toX(points.time[j]), toY(each[j])]] : []));
    chart.nearest = (x) => nearestOf(raw.length, (j) => Math.abs(toX(points.time[j]) - x));
    if (points.count > 0) timeAxis(panel, place, toX, toY, span, { unit, isTimed: state?.seconds !== null });
    else nothing(panel, phrase("plot.no-readings", "no readings yet"));
    paintReadings(chart, drawn);
    crossRejected(panel, drawn);
    hatchExcluded(panel, drawn, state?.excluded ?? []);
    panel.show();
    return place;
}

/**
 * The place of a chart in its panel, and the times that it spans.
 * @param {Panel} panel
 * @param {Points} points
 * @returns {Place}
 */
function placeIn({ em, width, height }, { time, count }) {
    const end = count > 0 ? Math.max(time[count - 1], time[0] + 1e-3) : 10;
    const start = count > 0 && time[0] > 0.05 * end ? time[0] : 0;
    return { left: 3.3 * em, right: width - 0.6 * em, top: 1.1 * em, bottom: height - 1.5 * em, start, end };
}

/**
 * @param {Chart} chart
 * @param {Drawn} drawn
 */
function paintReadings({ panel, before, after }, { points, kinds, raw, corrected, place, toX, toY }) {
    const image = panel.pixels();
    const { ratio } = panel;
    const [left, top] = [Math.round(place.left * ratio), Math.round(place.top * ratio)];
    const wide = Math.min(Math.floor((place.right - place.left) * ratio) + 2, image.width - left);
    const high = Math.min(Math.floor((place.bottom - place.top) * ratio), image.height - top);
    if (wide <= 3 || high <= 3) return;
    before.clear(wide, high);
    after.clear(wide, high);
    for (let j = 0; j < points.count; j++) {
        if (kinds[j] !== USED) continue;
        const x = toX(points.time[j]) * ratio - left;
        before.add(x, toY(raw[j]) * ratio - top);
        if (corrected) after.add(x, toY(corrected[j]) * ratio - top);
    }
    before.paint(image, left, top, themeColour(panel.host, "--raw"));
    after.paint(image, left, top, themeColour(panel.host, "--corrected"));
}

/**
 * @param {Panel} panel
 * @param {Drawn} drawn
 */
function crossRejected(panel, { points, kinds, raw, corrected, place, toX, toY }) {
    /** @type {[number, number][]} */
    const rejected = [];
    kinds.forEach((kind, j) => {
        if (kind !== REJECTED) return;
        const y = toY((corrected ?? raw)[j]);
        rejected.push([toX(points.time[j]), Math.min(Math.max(y, place.top + 3), place.bottom - 3)]);
    });
    if (rejected.length > 0) crosses(panel, rejected);
}

/**
 * @param {Panel} panel
 * @param {Drawn} drawn
 * @param {readonly [number, number][]} spans
 */
function hatchExcluded(panel, { place: { start, end, top, bottom }, toX }, spans) {
    for (const [from, to] of spans) {
        const x = toX(Math.max(start, from));
        const width = toX(Math.min(end, to)) - x;
        if (width <= 0) continue;
        panel.draw("rect", { class: "excluded", x, y: top, width, height: bottom - top });
        panel.draw("path", { class: "excluded-edge", d: hatch(x, width, top, bottom, 0.5 * panel.em) });
    }
}

/**
 * Slanted lines that hatch a rectangle, as the `d` of a path.
 * @param {number} x
 * @param {number} width
 * @param {number} top
 * @param {number} bottom
 * @param {number} step
 * @returns {string}
 */
function hatch(x, width, top, bottom, step) {
    let d = "";
    const high = bottom - top;
    for (let at = step - high; at < width; at += step) {
        const [from, to] = [Math.max(at, 0), Math.min(at + high, width)];
        if (to > from) d += `M${(x + from).toFixed(1)} ${(bottom - (from - at)).toFixed(1)}L${(x + to).toFixed(1)} ${(bottom - (to - at)).toFixed(1)}`;
    }
    return d;
}

/**
 * Length of each reading, raw or under a calibration.
 * @param {Points} points
 * @param {Shown | null} shown
 * @returns {Float32Array}
 */
function lengths(points, shown) {
    const norms = new Float32Array(points.count);
    const { field } = points;
    for (let j = 0, i = 0; j < points.count; j++, i += 3) {
        if (!shown) {
            norms[j] = Math.sqrt(field[i] ** 2 + field[i + 1] ** 2 + field[i + 2] ** 2);
            continue;
        }
        const [x, y, z] = [field[i] - shown.offset[0], field[i + 1] - shown.offset[1], field[i + 2] - shown.offset[2]];
        const [r, s, t] = shown.matrix;
        const a = r[0] * x + r[1] * y + r[2] * z;
        const b = s[0] * x + s[1] * y + s[2] * z;
        const c = t[0] * x + t[1] * y + t[2] * z;
        norms[j] = Math.sqrt(a * a + b * b + c * c); // Math.hypot is much slower
    }
    return norms;
}

/**
 * Span of the axis of field strength: nearly all of the used readings, so that a single outlier does not flatten it.
 * @param {Float32Array} raw
 * @param {Uint8Array} kinds
 * @param {Shown | null} shown
 * @returns {{low: number, high: number, raw: [number, number]}}
 */
function strengthSpan(raw, kinds, shown) {
    const used = raw.filter((_, j) => kinds[j] === USED);
    const [a, b] = quantiles(used, [0.005, 0.995]);
    if (!Number.isFinite(a)) return { low: 0, high: 1, raw: [0, 1] };
    const low = shown ? Math.min(a, 0.95 * shown.strength) : a;
    const high = shown ? Math.max(b, 1.05 * shown.strength) : b;
    const margin = Math.max(0.06 * (high - low), 1e-3 * Math.abs(high), 1e-9);
    const step = roundUp((high - low) / 20);
    return {
        low: Math.max(0, Math.floor((low - margin) / step) * step),
        high: Math.ceil((high + margin) / step) * step,
        raw: [a, b],
    };
}

/**
 * @param {Panel} panel
 * @param {Place} place
 * @param {(t: number) => number} toX
 * @param {(v: number) => number} toY
 * @param {Span} span
 * @param {{unit: string, isTimed: boolean}} how Without times, readings are numbered.
 */
function timeAxis(panel, place, toX, toY, span, { unit, isTimed }) {
    const values = ticks(span, Math.max(2, Math.floor((place.bottom - place.top) / (2.2 * panel.em))));
    for (const value of values) {
        panel.draw("path", { class: "grid", d: `M${place.left} ${toY(value)}H${place.right}` });
        tick(panel, place.left - 0.4 * panel.em, toY(value) + 0.28 * panel.em, fixedText(value, tickDecimals(values)), "end");
    }
    tick(panel, place.left + 0.2 * panel.em, 0.75 * panel.em, unit, "start");
    const most = Math.max(2, Math.floor((place.right - place.left) / (4.5 * panel.em)));
    const span_s = { low: place.start, high: place.end };
    const isLong = isTimed && place.end > 120;
    const times = isLong ? minuteTicks(span_s, most) : ticks(span_s, most);
    for (const value of times) {
        const x = toX(value);
        const anchor = x > place.right - 1.5 * panel.em ? "end" : "middle";
        panel.draw("path", { class: "tick", d: `M${x} ${place.bottom}v${0.25 * panel.em}` });
        const words = isLong ? clock(value) : `${fixedText(value, tickDecimals(times))}${isTimed ? " s" : ""}`;
        tick(panel, x, place.bottom + 1.15 * panel.em, words, anchor);
    }
    panel.draw("path", { class: "axis", d: `M${place.left} ${place.bottom}H${place.right}` });
}

/**
 * Ticks at whole parts of minutes or hours.
 * @param {Span} span
 * @param {number} most
 * @returns {number[]}
 */
function minuteTicks({ low, high }, most) {
    const steps = [1, 2, 5, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];
    const width = high - low;
    const step = steps.find((seconds) => width / seconds <= most) ?? 86400 * Math.ceil(width / 86400 / most);
    const times = [];
    for (let t = Math.ceil(low / step) * step; t <= high; t += step) times.push(t);
    return times;
}

/** @type {WeakMap<HTMLElement, Brush>} */
const brushes = new WeakMap();

/** @type {import("../widgets.js").Widget} */
export const strength = {
    name: "strength",
    title: "Field strength",
    place: "strip",
    on: ["points", "view", "state"],
    showsReadings: true,
    legend: [
        ["raw", "raw"],
        ["corrected", "corrected"],
        ["reject", "outliers"],
    ],
    enlarges: "the field strength",
    begin({ head, host }, page) {
        const exclusion = new Exclusion(head, page, (start_s, end_s) => brush.set(start_s, end_s));
        const brush = new Brush(chartOf(host), (start_s, end_s) => exclusion.showMark(start_s, end_s));
        brushes.set(host, brush);
        return exclusion;
    },
    draw({ host }, { points, view, state }) {
        drawChart(host, (chart) => {
            const place = drawStrength(chart, points, view, state);
            if (place) brushes.get(host)?.draw(place);
        });
    },
    css: `
        .plot .excluded { fill: var(--faint); fill-opacity: 0.12; }
        .plot .excluded-edge { stroke: var(--faint); stroke-opacity: 0.6; }
        .plot .brush { fill: var(--accent); fill-opacity: 0.2; }
        .plot .brush-edge { stroke: var(--accent); stroke-width: 0.17em; }
        .brushable { cursor: crosshair; touch-action: pan-y; border-radius: 0.25rem; }
        .head:has(.span:not([hidden])) .key { display: none; }
        .cut { display: flex; align-items: center; gap: 0.25rem; }
        .span { display: inline-flex; align-items: center; gap: 0.25rem; font-size: 0.8125rem; }
        .cut input[type="number"] { width: 4.25rem; min-height: 1.75rem; }
        @media (max-width: 699px) {
            .strength .head { flex-wrap: wrap; gap: 0.25rem 0.75rem; }
            .strength .cut { flex: 1 0 100%; flex-wrap: wrap; }
            .cut #exclude { margin-right: auto; }
            .strength .host { min-height: 12rem; }
        }
        @media (pointer: coarse) { .cut input[type="number"] { min-height: 2.75rem; } }
    `,
};
