/** Offset and matrix of a calibration as a table, each number to the digits that its uncertainty leaves. */

import { measured } from "./words.js";

const AXES = ["x", "y", "z"];

/**
 * What the table needs of a view (see messages.d.ts). Null where a refused fit gives no numbers.
 * @typedef {object} Parameters
 * @property {string} unit
 * @property {readonly number[] | null} offset
 * @property {readonly number[] | null} offset_sigma
 * @property {readonly (readonly number[])[] | null} matrix
 * @property {readonly (readonly number[])[] | null} matrix_sigma
 */

/**
 * Put the table into a host; nothing where there are no numbers.
 * @param {HTMLElement} host
 * @param {Parameters} parameters
 */
export function table(host, { unit, offset, offset_sigma, matrix, matrix_sigma }) {
    if (!offset || !matrix) {
        host.replaceChildren();
        return;
    }
    const root = element("table", "parameters");
    const caption = element("caption", "", "corrected = matrix · (raw − offset), ± 1 σ");
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
 * @param {string} name
 * @param {string} [kind]
 * @param {string} [text]
 * @returns {HTMLElement}
 */
function element(name, kind = "", text) {
    const made = document.createElement(name);
    if (kind) made.className = kind;
    if (text !== undefined) made.textContent = text;
    return made;
}

/**
 * @param {string} text
 * @param {string} scope
 * @param {number} [span]
 * @returns {HTMLElement}
 */
function header(text, scope, span = 1) {
    const made = document.createElement(text === "" ? "td" : "th");
    made.textContent = text;
    if (text !== "") made.setAttribute("scope", scope);
    if (span > 1) made.colSpan = span;
    return made;
}

/**
 * @param {number} value
 * @param {number | null | undefined} sigma
 * @returns {HTMLElement}
 */
function cell(value, sigma) {
    const shown = measured(value, sigma);
    const made = element("td", "number");
    made.append(element("span", "value", shown.value));
    if (shown.sigma) made.append(element("span", "sigma", ` ± ${shown.sigma}`));
    return made;
}
