/** By how much a level compass is off at each heading, before and after correction. */

import { chartOf, nothing, tick } from "./charts.js";
import { path, roundUp } from "./plot.js";
import { degrees } from "./words.js";

/** @typedef {import("./charts.js").ChartView} ChartView */
/** @typedef {import("./plot.js").Panel} Panel */

/**
 * A level turn: by how much the raw compass is off at each heading, and what is left open after correction (1 σ), each
 * on a scale of its own, with the target.
 * @param {HTMLElement} host
 * @param {ChartView | null} view
 * @param {string} [theme]
 * @param {number | null} [target_deg]
 */
export function deviation(host, view, theme = "", target_deg = null) {
    const chart = chartOf(host);
    chart.draw = () => drawDeviation(chart.panel, view, target_deg ?? view?.heading_error_deg?.target_deg ?? null);
    chart.draw();
}

/**
 * @param {Panel} panel
 * @param {ChartView | null} view
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
    const upper = lane(panel, { top: 0.3 * panel.em, bottom: middle - 0.9 * panel.em, left, right }, [Math.min(roundUp(1.05 * Math.max(largest, 1e-3)), 180)], true);
    const raw = closed(turn.before_deg).flatMap((value, i, all) => {
        const wraps = i > 0 && Math.abs((value ?? 0) - (all[i - 1] ?? 0)) > 180;
        const point = /** @type {const} */ ([toX(headings[i]), upper(value ?? NaN)]);
        return wraps ? [/** @type {const} */ ([NaN, NaN]), point] : [point];
    });
    panel.draw("path", { class: "raw", d: path(raw) });
    tick(panel, right, 0.3 * panel.em + 0.85 * panel.em, "raw", "end", "before");
    const top = Math.max(worst, target ?? 0);
    const end = roundUp(1.2 * (Number.isFinite(top) && top > 0 ? top : 1));
    const marked = target && target > 0.4 * end ? [target, end] : [end];
    const lower = lane(panel, { top: middle, bottom, left, right }, marked, false);
    const left_open = closed(turn.sigma_deg ?? []).map(
        (value, i) => /** @type {const} */ ([toX(headings[i]), lower(value ?? NaN)]),
    );
    if (sigmas.length === turn.heading_deg.length) {
        const floor = lower(0);
        panel.draw("path", { class: "band", d: `${path(left_open)}L${right} ${floor}L${left} ${floor}Z` });
        panel.draw("path", { class: "corrected", d: path(left_open) });
    }
    if (target) {
        panel.draw("path", { class: "target", d: `M${left} ${lower(target)}H${right}` });
        tick(panel, left + 0.3 * panel.em, lower(target) - 0.3 * panel.em, "target", "start", "aim");
    }
    const line = target ? lower(target) + 0.15 * panel.em : middle;
    tick(panel, right, Math.min(line + 0.9 * panel.em, bottom - 0.3 * panel.em), "after, 1 σ", "end", "after");
}

/**
 * A strip of a chart with an axis of degrees, from minus to plus or from zero.
 * @param {Panel} panel
 * @param {{top: number, bottom: number, left: number, right: number}} box
 * @param {readonly number[]} marked Degrees to be marked; the last is the end of the strip.
 * @param {boolean} both
 * @returns {(deg: number) => number} Where a number of degrees lies.
 */
function lane(panel, box, marked, both) {
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
