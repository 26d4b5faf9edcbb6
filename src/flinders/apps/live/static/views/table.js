/** Offset and matrix of a calibration as a table, each number to the digits that its uncertainty leaves. */

import { element } from "../dom.js";
import { measuredText } from "./words.js";
import { phrase } from "../language.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */

const AXES = ["x", "y", "z"];

/**
 * Put the table into a host; nothing where there are no numbers.
 * @param {HTMLElement} host
 * @param {View} view
 */
export function table(host, { unit, offset, offset_sigma, matrix, matrix_sigma }) {
    if (!offset || !matrix) {
        host.replaceChildren();
        return;
    }
    const caption = element("caption", phrase("table.caption", "corrected = matrix · (raw − offset), ± 1 σ"));
    const head = element("tr", [header("", "col"), header(phrase("table.offset", "offset, {unit}", { unit }), "col"), header(phrase("table.matrix", "matrix"), "colgroup", 3)]);
    const rows = AXES.map((axis, i) => {
        const cells = matrix[i].map((value, j) => cell(value, matrix_sigma?.[i]?.[j]));
        return element("tr", [header(axis, "row"), cell(offset[i], offset_sigma?.[i]), ...cells]);
    });
    host.replaceChildren(element("table", [caption, element("thead", [head]), element("tbody", rows)], "parameters"));
}

/**
 * @param {string} text
 * @param {string} scope
 * @param {number} [span]
 * @returns {HTMLElement}
 */
function header(text, scope, span = 1) {
    const made = element(text === "" ? "td" : "th", text);
    if (text !== "") made.setAttribute("scope", scope);
    if (span > 1) made.setAttribute("colspan", String(span));
    return made;
}

/**
 * @param {number} value
 * @param {number | null | undefined} sigma
 * @returns {HTMLElement}
 */
function cell(value, sigma) {
    const shown = measuredText(value, sigma);
    const about = shown.sigma ? [element("span", ` ± ${shown.sigma}`, "sigma")] : [];
    return element("td", [element("span", shown.value, "value"), ...about], "number");
}
