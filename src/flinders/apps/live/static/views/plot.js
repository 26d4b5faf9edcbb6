/**
 * Parts of the charts: a panel with a canvas (many points) under an SVG (axes and words), round ticks, and a raster of the
 * density of points.
 */

import { rgbOf } from "../../../../static/views/colours.js";

const SVG = "http://www.w3.org/2000/svg";

/** @typedef {readonly [number, number, number]} Rgb Red, green and blue, 0 to 255. */
/** @typedef {{low: number, high: number}} Span */

/**
 * Ticks at 1, 2 or 5 times a power of ten, at most `most` of them, inside a span.
 * @param {Span} span
 * @param {number} most
 * @returns {number[]} At least one tick; the middle for a span without length.
 */
export function ticks({ low, high }, most) {
    const width = high - low;
    if (!(width > 0) || !Number.isFinite(width)) return [low];
    const rough = width / Math.max(1, most);
    const decade = 10 ** Math.floor(Math.log10(rough));
    const step = decade * ([1, 2, 5, 10].find((factor) => factor * decade >= rough * (1 - 1e-9)) ?? 10);
    const values = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) values.push(i * step);
    return values.length > 0 ? values : [(low + high) / 2];
}

/**
 * Number of decimals that distinguishes ticks.
 * @param {readonly number[]} values
 * @returns {number}
 */
export function tickDecimals(values) {
    const step = values.length > 1 ? Math.abs(values[1] - values[0]) : Math.abs(values[0]) || 1;
    return Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)));
}

/**
 * The next larger of a series of round numbers about 25 % apart, so that an axis that grows does so in few steps.
 * @param {number} value
 * @returns {number}
 */
export function roundUp(value) {
    if (!(value > 0) || !Number.isFinite(value)) return 1;
    const decade = 10 ** Math.floor(Math.log10(value));
    return decade * ([1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find((n) => n * decade >= value * (1 - 1e-9)) ?? 10);
}

/**
 * Quantiles of some numbers; of many numbers, by a sample.
 * @param {ArrayLike<number>} values
 * @param {readonly number[]} shares
 * @returns {number[]} NaN where there are no finite numbers.
 */
export function quantiles(values, shares) {
    const step = Math.max(1, Math.floor(values.length / 1500));
    /** @type {number[]} */
    const sample = [];
    for (let i = 0; i < values.length; i += step) if (Number.isFinite(values[i])) sample.push(values[i]);
    sample.sort((a, b) => a - b);
    return shares.map((share) =>
        sample.length > 0 ? sample[Math.min(sample.length - 1, Math.floor(share * sample.length))] : NaN,
    );
}

/**
 * Create an SVG element with attributes; text is inserted as text.
 * @param {string} name
 * @param {Record<string, string | number>} attributes
 * @param {string | readonly SVGElement[]} content
 * @returns {SVGElement}
 */
export function svg(name, attributes = {}, content = []) {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) {
        element.setAttribute(key, typeof value === "number" ? String(Math.round(value * 100) / 100) : value);
    }
    element.append(...[content].flat());
    return element;
}

/**
 * A line through points, as the `d` of a path. Points that are NaN break it.
 * @param {Iterable<readonly [number, number]>} points
 * @param {boolean} [closed]
 * @returns {string}
 */
export function path(points, closed = false) {
    let pen = "M";
    let d = "";
    for (const [x, y] of points) {
        if (!Number.isFinite(x) || !Number.isFinite(y)) {
            pen = "M";
            continue;
        }
        d += `${pen}${x.toFixed(1)} ${y.toFixed(1)}`;
        pen = "L";
    }
    return closed && d ? `${d}Z` : d;
}

/** @typedef {{x: number, y: number, wide: number, high: number, words: string}} Place Of words: left, foot, size. */

/**
 * The place farthest from all lines; of equal places, the first.
 * @param {readonly Place[]} places
 * @param {readonly (readonly [number, number])[]} line Points; NaN breaks the line.
 * @returns {Place | null}
 */
export function freest(places, line) {
    const STEPS = 8;
    const room = (/** @type {Place} */ { x, y, wide, high }) => {
        let least = Infinity;
        for (let i = 1; i < line.length; i++) {
            for (let step = 0; step <= STEPS; step++) {
                const px = line[i - 1][0] + (step / STEPS) * (line[i][0] - line[i - 1][0]);
                const py = line[i - 1][1] + (step / STEPS) * (line[i][1] - line[i - 1][1]);
                if (!Number.isFinite(px + py)) break;
                least = Math.min(least, Math.hypot(Math.max(x - px, 0, px - x - wide), Math.max(y - high - py, 0, py - y)));
            }
        }
        return least;
    };
    let [best, most] = [/** @type {Place | null} */ (null), -1];
    for (const place of places) {
        const free = room(place);
        if (free > most) [best, most] = [place, free];
    }
    return best;
}

/**
 * Red, green and blue of a colour of the theme, 0 to 255.
 * @param {Element} element
 * @param {string} name Of a CSS variable with a value like #1d4ed8.
 * @returns {Rgb}
 */
export function themeColour(element, name) {
    const [red, green, blue] = rgbOf(getComputedStyle(element).getPropertyValue(name).trim() || "#808080");
    return [255 * red, 255 * green, 255 * blue];
}

/** A canvas with an SVG over it that fills its host, with a callback for changes of size. */
export class Panel {
    /** @param {HTMLElement} host Has a height of its own. */
    constructor(host) {
        this.host = host;
        this.root = document.createElement("div");
        this.root.className = "plot";
        this.root.setAttribute("role", "img");
        this.canvas = document.createElement("canvas");
        this.canvas.setAttribute("aria-hidden", "true");
        this.front = /** @type {SVGSVGElement} */ (svg("svg", { "aria-hidden": "true" }));
        this.root.append(this.canvas, this.front);
        host.replaceChildren(this.root);
        /** @type {() => void} */
        this.onresize = () => {};
        new ResizeObserver(() => this.onresize()).observe(host);
        this.width = 0;
        this.height = 0;
        this.ratio = 1;
        this.em = 16;
        /** @type {ImageData | null} */
        this.image = null;
    }

    /**
     * Take the size of the host and empty the SVG.
     * @param {string} label Text of the chart for screen readers.
     * @returns {boolean} Whether there is room to draw.
     */
    begin(label) {
        const box = this.host.getBoundingClientRect();
        this.width = Math.floor(box.width);
        this.height = Math.floor(box.height);
        this.em = Number.parseFloat(getComputedStyle(this.host).fontSize) || 16;
        // A dot is three pixels of the raster wide, about a fifth of a letter on any screen.
        this.ratio = Math.min(window.devicePixelRatio || 1, 2, 18 / this.em);
        if (this.root.getAttribute("aria-label") !== label) this.root.setAttribute("aria-label", label);
        if (this.width < 24 || this.height < 24) return false;
        const wide = Math.round(this.width * this.ratio);
        const high = Math.round(this.height * this.ratio);
        if (this.canvas.width !== wide || this.canvas.height !== high) {
            this.canvas.width = wide;
            this.canvas.height = high;
        }
        this.front.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
        this.front.replaceChildren();
        return true;
    }

    /**
     * The pixels of the canvas, all clear.
     * @returns {ImageData}
     */
    pixels() {
        const { width, height } = this.canvas;
        if (this.image === null || this.image.width !== width || this.image.height !== height) {
            this.image = new ImageData(width, height);
        } else {
            this.image.data.fill(0);
        }
        return this.image;
    }

    /** Put the pixels on the canvas. */
    show() {
        if (this.image) this.canvas.getContext("2d")?.putImageData(this.image, 0, 0);
    }

    /**
     * Add an element to the SVG.
     * @param {string} name
     * @param {Record<string, string | number>} attributes
     * @param {string} [text]
     * @returns {SVGElement}
     */
    draw(name, attributes, text) {
        const element = svg(name, attributes, text);
        this.front.append(element);
        return element;
    }
}

/**
 * Density of points in a rectangle of pixels. A point is a soft dot; many dots add up, and a single one stays visible.
 * Drawing 20,000 points takes a few milliseconds, also without graphics hardware.
 */
export class Density {
    constructor() {
        this.width = 0;
        this.height = 0;
        this.points = 0;
        this.weights = new Float32Array(0);
    }

    /**
     * Forget all points.
     * @param {number} width In pixels.
     * @param {number} height
     */
    clear(width, height) {
        const size = width * height;
        if (this.weights.length < size) this.weights = new Float32Array(size);
        else this.weights.fill(0, 0, size);
        this.width = width;
        this.height = height;
        this.points = 0;
    }

    /**
     * Add a point; outside of the rectangle it is left out.
     * @param {number} x In pixels.
     * @param {number} y
     */
    add(x, y) {
        const i = Math.round(x);
        const j = Math.round(y);
        if (!(i >= 1 && j >= 1 && i < this.width - 1 && j < this.height - 1)) return;
        const at = j * this.width + i;
        const w = this.weights;
        w[at] += 1;
        w[at - 1] += 0.55;
        w[at + 1] += 0.55;
        w[at - this.width] += 0.55;
        w[at + this.width] += 0.55;
        w[at - this.width - 1] += 0.25;
        w[at - this.width + 1] += 0.25;
        w[at + this.width - 1] += 0.25;
        w[at + this.width + 1] += 0.25;
        this.points++;
    }

    /**
     * Lay the points over an image.
     * @param {ImageData} image
     * @param {number} left Where the rectangle begins, in pixels.
     * @param {number} top
     * @param {Rgb} colour
     */
    paint(image, left, top, colour) {
        if (this.points === 0) return;
        const { width, height, weights } = this;
        const gain = this.gain();
        const [red, green, blue] = colour;
        for (let j = 0; j < height; j++) {
            let to = 4 * ((top + j) * image.width + left);
            for (let at = j * width, end = at + width; at < end; at++, to += 4) {
                const weight = weights[at];
                if (weight === 0) continue;
                over(image.data, to, red, green, blue, 0.4 * Math.min(1, weight) + 0.6 * (1 - Math.exp(-gain * weight)));
            }
        }
    }

    /** Opacity per point: smaller if pixels hold many points on average, so that structure stays visible. */
    gain() {
        let sum = 0;
        let filled = 0;
        for (let at = 0, end = this.width * this.height; at < end; at++) {
            const weight = this.weights[at];
            if (weight > 0) {
                sum += weight;
                filled++;
            }
        }
        return Math.min(0.8, (0.7 * filled) / sum);
    }
}

/**
 * Lay a colour over a pixel of an image that is not premultiplied.
 * @param {Uint8ClampedArray} pixels
 * @param {number} at
 * @param {number} red
 * @param {number} green
 * @param {number} blue
 * @param {number} alpha 0 to 1.
 */
function over(pixels, at, red, green, blue, alpha) {
    const below = (pixels[at + 3] / 255) * (1 - alpha);
    const all = alpha + below;
    pixels[at] = (red * alpha + pixels[at] * below) / all;
    pixels[at + 1] = (green * alpha + pixels[at + 1] * below) / all;
    pixels[at + 2] = (blue * alpha + pixels[at + 2] * below) / all;
    pixels[at + 3] = 255 * all;
}
