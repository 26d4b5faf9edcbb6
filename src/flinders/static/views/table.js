/** Offset and matrix of a calibration as a table, each number to the digits that its uncertainty leaves. */

import { element } from "../dom.js";
import { measured } from "./words.js";

/** @typedef {import("../messages.d.ts").View} View */

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
    const root = element("table", "", "parameters");
    const caption = element("caption", "corrected = matrix · (raw − offset), ± 1 σ");
    const head = element("tr");
    head.append(header("", "col"), header(`offset, ${unit}`, "col"), header("matrix", "colgroup", 3));
    const top = element("thead");
    top.append(head);
    const body = element("tbody");
    AXES.forEach((axis, i) => {
        const row = element("tr");
        row.append(header(axis, "row"), cell(offset[i], offset_sigma?.[i]));
        for (let j = 0; j < 3; j++) row.append(cell(matrix[i][j], matrix_sigma?.[i]?.[j]));
        body.append(row);
    });
    root.append(caption, top, body);
    host.replaceChildren(root);
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
    const shown = measured(value, sigma);
    const made = element("td", "", "number");
    made.append(element("span", shown.value, "value"));
    if (shown.sigma) made.append(element("span", ` ± ${shown.sigma}`, "sigma"));
    return made;
}
