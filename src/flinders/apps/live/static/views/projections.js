/** Readings seen along each axis, before and after correction: XY, XZ and YZ. */

import { crosses, drawChart, tick } from "./charts.js";
import { EXCLUDED, mark, REJECTED, USED } from "../../../../static/views/marks.js";
import { nearestOf } from "../../../../static/views/nearest.js";
import { path, quantiles, roundUp, themeColour, tickDecimals, ticks } from "./plot.js";
import { correctReading, determinant, dot, inverseOf } from "../../../../static/views/vectors.js";
import { fixedText } from "./words.js";
import { phrase } from "../language.js";

/** @typedef {import("./charts.js").Chart} Chart */
/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/view.d.ts").Points} Points */
/** @typedef {import("../../../../static/view.d.ts").Shown} Shown */
/** @typedef {import("./plot.js").Panel} Panel */

const PAIRS = /** @type {const} */ ([
    [0, 1, "x", "y"],
    [0, 2, "x", "z"],
    [1, 2, "y", "z"],
]);

/** Largest number of readings used to find the extent of the axes. */
const EXTENT_SAMPLES = 1500;

/**
 * Draw XY, XZ and YZ: raw readings with the outline of their ellipsoid, corrected readings with the circle that bounds
 * them. A tall host has a row before and a row after correction; a flat one has both in each square.
 * @param {Chart} chart
 * @param {Points} points
 * @param {View | null} view
 * @param {State | null} state
 */
function drawProjections(chart, points, view, state) {
    const { panel } = chart;
    const shown = view?.shown ?? null;
    const label = shown
        ? phrase("projections.both", "Readings seen along each axis, raw and corrected, with the circle they should lie in")
        : phrase("projections.raw", "Readings seen along each axis, raw with no correction yet");
    if (!panel.begin(label)) return;
    const kinds = new Uint8Array(points.count);
    mark(kinds, points, view?.rejected ?? [], state?.excluded ?? []);
    const image = panel.pixels();
    const unit = view?.unit ?? state?.unit ?? "";
    const isWide = panel.width >= 32 * panel.em;
    const rows = isWide && panel.height > 0.5 * panel.width && shown ? ["before", "after"] : ["both"];
    const domain = rows.map((row) => extents(points, kinds, shown, row));
    const [columns, lines] = isWide ? [3, rows.length] : [1, 3];
    const left = 3.1 * panel.em;
    const tall = panel.height / lines;
    const side = Math.max(16, Math.min((panel.width - 2) / columns - left, tall - 2.4 * panel.em));
    const cell = Math.min((panel.width - 2) / columns, side + 5.5 * panel.em);
    const begin = (panel.width - columns * cell) / 2;
    /** @type {Square[]} */
    const squares = [];
    rows.forEach((row, i) => {
        PAIRS.forEach((pair, k) => {
            const [column, line] = isWide ? [k, i] : [0, k];
            const box = { x: begin + column * cell + (cell + left - side) / 2, y: 0.8 * panel.em + line * tall, side };
            squares.push(drawSquare(chart, image, box, pair, domain[i], { points, kinds, shown, row, unit }));
        });
    });
    panel.show();
    chart.places = (j) => squares.flatMap(({ places }) => places(j));
    chart.nearest = (x, y) => {
        const square = squares.find(({ box }) => x > box.x && x < box.x + box.side && y > box.y && y < box.y + box.side);
        if (!square) return null;
        const far = (/** @type {number} */ j) => Math.min(...square.places(j).map(([a, b]) => Math.hypot(a - x, b - y)));
        return nearestOf(points.count, far, panel.em);
    };
}

/**
 * A square, and the places of a reading in it.
 * @typedef {{box: {x: number, y: number, side: number}, places: (reading: number) => import("./charts.js").Place[]}} Square
 */

/** @typedef {{centre: number[], half: number}} Domain */

/**
 * Extent of the squares of a row, with one scale for all three.
 * @param {Points} points
 * @param {Uint8Array} kinds
 * @param {Shown | null} shown
 * @param {string} row
 * @returns {Domain}
 */
function extents(points, kinds, shown, row) {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    const widen = (/** @type {number} */ axis, /** @type {number} */ value) => {
        low[axis] = Math.min(low[axis], value);
        high[axis] = Math.max(high[axis], value);
    };
    const shape = shown ? inverse(shown.matrix) : null;
    const every = Math.max(1, Math.floor(points.count / EXTENT_SAMPLES));
    for (let axis = 0; axis < 3; axis++) {
        if (shown && row !== "before") [-1.12, 1.12].forEach((sign) => widen(axis, sign * shown.strength));
        if (row === "after" && shown) continue;
        const used = [];
        for (let j = 0; j < points.count; j += every) if (kinds[j] === USED) used.push(points.field[3 * j + axis]);
        const [a, b] = quantiles(used, [0.01, 0.99]);
        if (Number.isFinite(a)) [a - 0.06 * (b - a), b + 0.06 * (b - a)].forEach((value) => widen(axis, value));
        if (!shown) continue;
        widen(axis, 0);
        const reach = shape ? shown.strength * Math.sqrt(dot(shape[axis], shape[axis])) : Infinity;
        if (reach < 1.5 * (b - a)) [-1.04, 1.04].forEach((sign) => widen(axis, shown.offset[axis] + sign * reach));
    }
    if (!Number.isFinite(low[0])) return { centre: [0, 0, 0], half: 1 };
    const step = roundUp(Math.max(...low.map((value, axis) => (high[axis] - value) / 2), 1e-9)) / 10;
    const centre = low.map((value, axis) => Math.round((value + high[axis]) / 2 / step) * step);
    const half = roundUp(Math.max(...centre.map((value, axis) => Math.max(high[axis] - value, value - low[axis])), 1e-9));
    return { centre, half };
}

/**
 * One square of a projection.
 * @param {Chart} chart
 * @param {ImageData} image
 * @param {{x: number, y: number, side: number}} box
 * @param {readonly [number, number, string, string]} pair Axes across and up, and their names.
 * @param {Domain} domain
 * @param {{points: Points, kinds: Uint8Array, shown: Shown | null, row: string, unit: string}} what
 * @returns {Square}
 */
function drawSquare(chart, image, box, pair, domain, what) {
    const { panel } = chart;
    const [across, up] = pair;
    const scale = box.side / (2 * domain.half);
    const toX = (/** @type {number} */ value) => box.x + box.side / 2 + (value - domain.centre[across]) * scale;
    const toY = (/** @type {number} */ value) => box.y + box.side / 2 - (value - domain.centre[up]) * scale;
    const left_out = rasterSquare(chart, image, box, pair, { toX, toY }, what);

    panel.draw("rect", { class: "frame", x: box.x, y: box.y, width: box.side, height: box.side });
    const clip = `inside-${Math.round(box.x)}-${Math.round(box.y)}`;
    const defs = panel.draw("clipPath", { id: clip });
    defs.append(panel.draw("rect", { x: box.x, y: box.y, width: box.side, height: box.side }));
    const inside = panel.draw("g", { "clip-path": `url(#${clip})` });
    const most = Math.max(3, Math.floor(box.side / (3.2 * panel.em)));
    const spanX = { low: domain.centre[across] - domain.half, high: domain.centre[across] + domain.half };
    const spanY = { low: domain.centre[up] - domain.half, high: domain.centre[up] + domain.half };
    const marksX = what.points.count > 0 ? ticks(spanX, most) : [];
    const marksY = what.points.count > 0 ? ticks(spanY, most) : [];
    const name = what.unit ? `${pair[2]}, ${what.unit}` : pair[2];
    for (const value of marksX) {
        const number = fixedText(value, tickDecimals(marksX));
        inside.append(panel.draw("path", { class: value === 0 ? "zero" : "grid", d: `M${toX(value)} ${box.y}v${box.side}` }));
        const near = box.x + box.side - toX(value) < (0.4 + 0.66 * name.length + 0.33 * number.length) * panel.em;
        if (!near) tick(panel, toX(value), box.y + box.side + 0.95 * panel.em, number, "middle");
    }
    for (const value of marksY) {
        inside.append(panel.draw("path", { class: value === 0 ? "zero" : "grid", d: `M${box.x} ${toY(value)}h${box.side}` }));
        const isLow = box.y + box.side - toY(value) < 0.5 * panel.em;
        if (!isLow) tick(panel, box.x - 0.4 * panel.em, toY(value) + 0.28 * panel.em, fixedText(value, tickDecimals(marksY)), "end");
    }
    outlines(panel, inside, across, up, { toX, toY }, what);
    if (left_out.length > 0) inside.append(crosses(panel, left_out));
    tick(panel, box.x + box.side, box.y + box.side + 0.95 * panel.em, name, "end", "name");
    tick(panel, box.x + 0.4 * panel.em, box.y + panel.em, pair[3], "start", "name");
    if (what.row !== "both") tick(panel, box.x + box.side - 0.4 * panel.em, box.y + panel.em, phrase(`plot.${what.row}`, what.row), "end", what.row);
    const { field } = what.points;
    const places = (/** @type {number} */ j) => {
        const raw = [field[3 * j], field[3 * j + 1], field[3 * j + 2]];
        const drawn = [];
        if (what.row !== "after") drawn.push(raw);
        if (what.shown && what.row !== "before") drawn.push(correctReading(raw, what.shown));
        return drawn.map((vector) => /** @type {const} */ ([toX(vector[across]), toY(vector[up])]));
    };
    return { box, places };
}

/**
 * Put the points of a square into the image.
 * @param {Chart} chart
 * @param {ImageData} image
 * @param {{x: number, y: number, side: number}} box
 * @param {readonly [number, number, string, string]} pair
 * @param {{toX: (value: number) => number, toY: (value: number) => number}} to
 * @param {{points: Points, kinds: Uint8Array, shown: Shown | null, row: string}} what
 * @returns {[number, number][]} Places of rejected readings, for crosses.
 */
function rasterSquare(chart, image, box, [across, up], { toX, toY }, { points, kinds, shown, row }) {
    const { panel, before, after } = chart;
    const ratio = panel.ratio;
    const [left, top] = [Math.round(box.x * ratio), Math.round(box.y * ratio)];
    const size = Math.min(Math.floor(box.side * ratio), image.width - left, image.height - top);
    if (size < 4) return [];
    before.clear(size, size);
    after.clear(size, size);
    /** @type {[number, number][]} */
    const left_out = [];
    const { field } = points;
    const [rowA, rowB] = shown ? [shown.matrix[across], shown.matrix[up]] : [[], []];
    const [b0, b1, b2] = shown ? shown.offset : [0, 0, 0];
    for (let j = 0; j < points.count; j++) {
        if (kinds[j] === EXCLUDED) continue;
        const i = 3 * j;
        if (kinds[j] === REJECTED) {
            if (row !== "after") left_out.push([toX(field[i + across]), toY(field[i + up])]);
            continue;
        }
        if (row !== "after") before.add(toX(field[i + across]) * ratio - left, toY(field[i + up]) * ratio - top);
        if (shown && row !== "before") {
            const [x, y, z] = [field[i] - b0, field[i + 1] - b1, field[i + 2] - b2];
            const a = rowA[0] * x + rowA[1] * y + rowA[2] * z;
            const b = rowB[0] * x + rowB[1] * y + rowB[2] * z;
            after.add(toX(a) * ratio - left, toY(b) * ratio - top);
        }
    }
    before.paint(image, left, top, themeColour(panel.host, "--raw"));
    after.paint(image, left, top, themeColour(panel.host, "--corrected"));
    return left_out;
}

/**
 * The shadow of the raw ellipsoid, the circle of the corrected sphere, and the offset from one to the other.
 * @param {Panel} panel
 * @param {SVGElement} inside
 * @param {number} across
 * @param {number} up
 * @param {{toX: (value: number) => number, toY: (value: number) => number}} to
 * @param {{shown: Shown | null, row: string}} what
 */
function outlines(panel, inside, across, up, { toX, toY }, { shown, row }) {
    if (!shown) return;
    const radius = Math.abs(toX(shown.strength) - toX(0));
    if (row !== "before") inside.append(panel.draw("circle", { class: "circle", cx: toX(0), cy: toY(0), r: radius }));
    if (row === "after") return;
    const shape = inverse(shown.matrix);
    if (!shape) return;
    const [p, q] = [shape[across], shape[up]];
    const points = [];
    // The outline of A·sphere seen along an axis: Lᵀ of the two rows' Gram matrix, times a circle.
    const [pp, pq, qq] = [dot(p, p), dot(p, q), dot(q, q)];
    const l11 = Math.sqrt(pp);
    const l21 = pq / l11;
    const l22 = Math.sqrt(Math.max(0, qq - l21 * l21));
    for (let i = 0; i <= 72; i++) {
        const [c, s] = [Math.cos((i * Math.PI) / 36), Math.sin((i * Math.PI) / 36)];
        points.push(
            /** @type {const} */ ([
                toX(shown.offset[across] + shown.strength * l11 * c),
                toY(shown.offset[up] + shown.strength * (l21 * c + l22 * s)),
            ]),
        );
    }
    inside.append(panel.draw("path", { class: "outline", d: path(points, true) }));
    const [x, y] = [toX(shown.offset[across]), toY(shown.offset[up])];
    inside.append(panel.draw("path", { class: "iron", d: `M${toX(0)} ${toY(0)}L${x} ${y}` }));
    inside.append(panel.draw("circle", { class: "iron-end", cx: x, cy: y, r: 0.2 * panel.em }));
}

/** @param {readonly (readonly number[])[]} matrix @returns {number[][] | null} Inverse; null of a singular matrix. */
function inverse(matrix) {
    return Math.abs(determinant(matrix)) > 1e-300 ? inverseOf(matrix) : null;
}

/** @type {import("../widgets.js").Widget} */
export const projections = {
    name: "projections",
    title: "Projections",
    place: "strip",
    on: ["points", "view", "state"],
    showsReadings: true,
    legend: [
        ["raw", "before"],
        ["corrected", "after"],
    ],
    enlarges: "the projections",
    draw({ host }, { points, view, state }) {
        drawChart(host, (chart) => drawProjections(chart, points, view, state));
    },
    css: `
        .plot .circle { stroke: var(--corrected); stroke-width: 0.125em; }
        .plot .outline { stroke: var(--raw); stroke-width: 0.125em; stroke-dasharray: 0.4em 0.33em; }
        .plot .iron { stroke: var(--ink); stroke-width: 0.125em; }
        .plot .iron-end { fill: var(--ink); }
        @media (max-width: 699px) { .projections .host { min-height: 50rem; } }
    `,
};
