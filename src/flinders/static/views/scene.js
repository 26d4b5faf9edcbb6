/**
 * The 3-D view: what is known in each direction, and the readings before and after correction.
 *
 * This is its door. `picture.js` draws; where a browser has no WebGL the host says so in words, and all calls do nothing.
 *
 * @typedef {import("./colours.js").Theme} Theme
 * @typedef {import("./picture.js").Mode} Mode
 * @typedef {import("./picture.js").Points} Points
 * @typedef {import("./picture.js").Shown} Shown
 * @typedef {import("./picture.js").Options} Options
 */

import { palette } from "./colours.js";
import { Picture } from "./picture.js";

const MISSING = "This browser cannot draw in 3-D: WebGL is missing or switched off. All other views work.";
const LOST = "The graphics driver stopped the 3-D view. It comes back by itself, or after a reload of the page.";

export class Scene {
    /** @type {Picture | null} */
    #picture = null;

    /**
     * @param {HTMLElement} host  is filled; its size is followed
     * @param {Options} options
     */
    constructor(host, { interactive = true, target_deg = 1, wheel = "zoom", ...options }) {
        if (getComputedStyle(host).position === "static") host.style.position = "relative";
        this.notice = document.createElement("p");
        this.notice.className = "scene-notice";
        this.notice.setAttribute("role", "status");
        Object.assign(this.notice.style, { position: "absolute", inset: "0", display: "none", margin: "0", padding: "10%" });
        Object.assign(this.notice.style, { placeItems: "center", textAlign: "center", pointerEvents: "none" });
        host.append(this.notice);
        const canvas = document.createElement("canvas");
        const context = canvas.getContext("webgl2", { alpha: true, antialias: false });
        if (context === null) {
            this.#say(MISSING, options.theme);
            return;
        }
        canvas.addEventListener("webglcontextlost", () => this.#say(LOST, options.theme));
        canvas.addEventListener("webglcontextrestored", () => this.#say("", options.theme));
        this.#picture = new Picture(host, canvas, context, { interactive, target_deg, wheel, ...options });
    }

    /** Whether this browser can draw in three dimensions. */
    get available() {
        return this.#picture !== null;
    }

    /** Show these readings, and forget the ones before. @param {Points} points */
    setPoints(points) {
        this.#picture?.setPoints(points);
    }

    /**
     * Readings were added to those shown. The arrays may be larger ones.
     *
     * @param {Points} points
     * @param {number} from  the first new point
     */
    appendPoints(points, from) {
        this.#picture?.appendPoints(points, from);
    }

    /** Show what is known from a fit; null where there is none. @param {Shown | null} view */
    setView(view) {
        this.#picture?.setView(view);
    }

    /** The newest reading, raw. @param {{raw: ArrayLike<number>} | null} now */
    setNow(now) {
        this.#picture?.setNow(now);
    }

    /** @param {Mode} mode */
    setMode(mode) {
        this.#picture?.setMode(mode);
    }

    /** @param {Theme} theme */
    setTheme(theme) {
        this.notice.style.color = palette(theme).dim;
        this.#picture?.setTheme(theme);
    }

    /** What error is asked for: the colours hang on it. @param {number} target_deg */
    setTarget(target_deg) {
        this.#picture?.setTarget(target_deg);
    }

    /**
     * What is left out, and is drawn so.
     *
     * @param {[number, number][]} excludedSpans  seconds: by the user
     * @param {[number, number][]} rejectedRuns  reading numbers, both ends included: by the fit
     * @param {number} stride  point j is reading j · stride
     */
    setMask(excludedSpans, rejectedRuns, stride) {
        this.#picture?.setMask(excludedSpans, rejectedRuns, stride);
    }

    /** Look at everything again, from where the view began. */
    resetCamera() {
        this.#picture?.resetCamera();
    }

    /** Draw soon: many calls make one picture. */
    redraw() {
        this.#picture?.redraw();
    }

    dispose() {
        this.#picture?.dispose();
        this.#picture = null;
        this.notice.remove();
    }

    /** @param {string} words @param {Theme} theme */
    #say(words, theme) {
        this.notice.textContent = words;
        this.notice.style.display = words ? "grid" : "none";
        this.notice.style.color = palette(theme).dim;
    }
}
