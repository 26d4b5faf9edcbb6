/** Marks a span of time in a chart, by mouse, by finger (sideways), or by the arrow keys. */

import { phrase } from "../language.js";

/** @typedef {import("./charts.js").Chart} Chart */

/**
 * Area of times in a chart, in pixels; times run from `start` to `end`, s.
 * @typedef {{left: number, right: number, top: number, bottom: number, start: number, end: number}} Place
 */

/**
 * Position of a time, pixels.
 * @param {Place} place
 * @param {number} seconds
 * @returns {number}
 */
export function xOf({ left, right, start, end }, seconds) {
    return left + ((right - left) * (Math.min(Math.max(seconds, start), end) - start)) / (end - start);
}

/** A span of time being marked. */
export class Brush {
    /**
     * @param {Chart} chart
     * @param {(start_s: number | null, end_s: number | null) => void} tell
     */
    constructor(chart, tell) {
        this.chart = chart;
        this.tell = tell;
        /** @type {[number, number] | null} */
        this.span = null;
        /** @type {number | null} Start of the drag, s. */
        this.from = null;
        /** @type {Place | null} */
        this.place = null;
        /** @type {SVGElement[]} */
        this.drawn = [];
        const { root } = chart.panel;
        root.classList.add("brushable");
        root.tabIndex = 0;
        root.setAttribute("role", "application");
        root.setAttribute("aria-roledescription", phrase("plot.brush", "chart with a span of time to mark"));
        root.setAttribute("aria-keyshortcuts", "ArrowLeft ArrowRight Shift+ArrowLeft Shift+ArrowRight Escape");
        root.addEventListener("pointerdown", (event) => this.begin(event));
        root.addEventListener("pointermove", (event) => this.move(event));
        root.addEventListener("pointerup", (event) => this.finish(event));
        root.addEventListener("pointercancel", () => this.cancel());
        root.addEventListener("keydown", (event) => this.key(event));
    }

    /**
     * @param {PointerEvent} event
     * @returns {number} Seconds.
     */
    timeAt(event) {
        if (!this.place) return 0;
        const { left, right, start, end } = this.place;
        const x = event.clientX - this.chart.panel.root.getBoundingClientRect().left;
        return start + (Math.min(Math.max(x - left, 0), right - left) / (right - left)) * (end - start);
    }

    /** @param {PointerEvent} event */
    begin(event) {
        if (!this.place || event.button !== 0) return;
        this.from = this.timeAt(event);
        this.chart.panel.root.setPointerCapture(event.pointerId);
    }

    /** @param {PointerEvent} event */
    move(event) {
        if (this.from === null) return;
        const to = this.timeAt(event);
        this.span = [Math.min(this.from, to), Math.max(this.from, to)];
        this.redraw();
    }

    /** @param {PointerEvent} event */
    finish(event) {
        if (this.from === null) return;
        const to = this.timeAt(event);
        const wide = this.place ? Math.abs(xOf(this.place, to) - xOf(this.place, this.from)) : 0;
        this.span = wide < 3 ? null : [Math.min(this.from, to), Math.max(this.from, to)];
        this.from = null;
        this.notifySpan();
    }

    /** Cancel the mark, since the finger scrolls. */
    cancel() {
        this.from = null;
        this.span = null;
        this.notifySpan();
    }

    /** @param {KeyboardEvent} event */
    key(event) {
        if (!this.place || event.ctrlKey || event.metaKey || event.altKey) return;
        const { start, end } = this.place;
        const step = 0.01 * (end - start);
        const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        const [a, b] = this.span ?? [(start + end) / 2, (start + end) / 2 + 2 * step];
        if (event.key === "Escape" && this.span) this.span = null;
        else if (direction !== undefined && event.shiftKey) {
            this.span = [a, Math.min(Math.max(b + direction * step, a), end)];
        } else if (direction !== undefined) {
            const by = Math.min(Math.max(direction * step, start - a), end - b);
            this.span = [a + by, b + by];
        } else return;
        event.preventDefault();
        event.stopPropagation();
        this.notifySpan();
    }

    /**
     * @param {number | null} start_s
     * @param {number | null} end_s
     */
    set(start_s, end_s) {
        this.span = start_s === null || end_s === null ? null : [Math.min(start_s, end_s), Math.max(start_s, end_s)];
        this.redraw();
    }

    notifySpan() {
        this.redraw();
        if (this.span) this.tell(...this.span);
        else this.tell(null, null);
    }

    redraw() {
        if (this.place) this.draw(this.place);
    }

    /** @param {Place} place */
    draw(place) {
        this.place = place;
        for (const element of this.drawn) element.remove();
        this.drawn = [];
        if (!this.span) return;
        const { panel } = this.chart;
        const [x, to] = this.span.map((seconds) => xOf(place, seconds));
        this.drawn.push(
            panel.draw("rect", { class: "brush", x, y: place.top, width: Math.max(to - x, 1), height: place.bottom - place.top }),
            panel.draw("path", { class: "brush-edge", d: `M${x} ${place.top}V${place.bottom}M${to} ${place.top}V${place.bottom}` }),
        );
    }
}
