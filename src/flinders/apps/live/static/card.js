/** Picture of a result for sharing: the heading error before and after calibration. */

import { duration, things } from "./views/words.js";
import { phrase } from "./language.js";

const [WIDTH, HEIGHT, MARGIN] = [1200, 630, 72];
const FACE = "system-ui, -apple-system, 'Segoe UI', sans-serif";

/**
 * Texts of a card.
 * @typedef {object} Card
 * @property {string} name Name of the sensor.
 * @property {string} before The worst level heading error without calibration.
 * @property {string} after
 * @property {string} bound Bound on the error of all headings, 95 %.
 * @property {string} verdict
 * @property {number | null} seconds
 * @property {number} readings
 */

/**
 * Draw a card in the colours of the page.
 * @param {Card} card
 * @returns {Promise<Blob | null>} A PNG; null if the browser cannot make one.
 */
export function drawCard({ name, before, after, bound, verdict, seconds, readings }) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [WIDTH, HEIGHT];
    const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const style = getComputedStyle(document.documentElement);
    const colour = (/** @type {string} */ of) => style.getPropertyValue(`--${of}`);
    /** @type {(words: string, x: number, y: number, size: number, of: string, weight?: number) => number} */
    const write = (words, x, y, size, of, weight = 400) => {
        pen.font = `${weight} ${size}px ${FACE}`;
        pen.fillStyle = colour(of);
        pen.fillText(words, x, y, WIDTH - MARGIN - x);
        return x + pen.measureText(words).width;
    };
    pen.fillStyle = colour("panel");
    pen.fillRect(0, 0, WIDTH, HEIGHT);
    write(name, MARGIN, 120, 52, "ink", 650);
    const arrow = write(before, MARGIN, 330, 130, "raw", 700);
    const end = write(" → ", arrow, 330, 100, "faint");
    write(after, end, 330, 130, "corrected", 700);
    write(phrase("card.error", "worst level heading error, raw and calibrated"), MARGIN, 400, 34, "faint");
    write(phrase("card.verdict", "{verdict}: 95 % within {bound}", { verdict, bound }), MARGIN, 462, 34, "ink");
    const took = seconds === null ? things(readings, "reading") : phrase("card.took", "{readings} in {time}", { readings: things(readings, "reading"), time: duration(seconds) });
    write(`${took} · Flinders`, MARGIN, HEIGHT - MARGIN, 30, "faint");
    return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
}
