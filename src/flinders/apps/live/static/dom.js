/** Helpers for the document. Text from the server is inserted as text, never as markup. */

import { svg } from "./views/plot.js";

/**
 * The element with an id; throws unless it exists and has the given type.
 * @template {Element} T
 * @param {string} id
 * @param {new () => T} kind
 * @returns {T}
 */
export function byId(id, kind) {
    const element = document.getElementById(id);
    if (!(element instanceof kind)) throw new TypeError(`the page has no ${kind.name} #${id}`);
    return element;
}

/** Matches a space between a number and its unit. */
const BEFORE_A_UNIT = /(\d) (?=[%°µσ]|(?:k?Hz|kB|Mi?B|mG|nT|uT|min|[hsmg])\b)/g;

/**
 * Text with non-breaking spaces between numbers and units.
 * @param {string} text
 */
function joinUnits(text) {
    return text.replace(BEFORE_A_UNIT, "$1\u00a0");
}

/**
 * Set a text, if it has changed.
 * @param {Element} element
 * @param {string} text
 */
export function setText(element, text) {
    const shown = joinUnits(text);
    if (element.textContent !== shown) element.textContent = shown;
}

/**
 * @param {string} name
 * @param {string | readonly (string | Node)[]} [content]
 * @param {string} [kind]  its class
 * @returns {HTMLElement}
 */
export function element(name, content = "", kind = "") {
    const made = document.createElement(name);
    if (content) made.append(...[content].flat().map((part) => (typeof part === "string" ? joinUnits(part) : part)));
    if (kind) made.className = kind;
    return made;
}

/**
 * Read a value from the browser's storage; null if absent or storage is off.
 * @param {string} key
 * @returns {string | null}
 */
export function recall(key) {
    try {
        return localStorage.getItem(key);
    } catch {
        return null;
    }
}

/**
 * Write a value to the browser's storage, if that is on.
 * @param {string} key
 * @param {string} value
 */
export function remember(key, value) {
    try {
        localStorage.setItem(key, value);
    } catch {
        // Storage is off: the value lasts as long as the page.
    }
}

/**
 * An icon of the page, one of the symbols at its top.
 * @param {string} name
 * @returns {SVGElement}
 */
export function icon(name) {
    return svg("svg", { class: "icon", "aria-hidden": "true" }, [svg("use", { href: `#i-${name}` })]);
}

/**
 * Change the icon in an element.
 * @param {Element} inside
 * @param {string} name
 */
export function setIcon(inside, name) {
    const use = inside.querySelector(".icon use");
    const href = `#i-${name}`;
    if (use && use.getAttribute("href") !== href) use.setAttribute("href", href);
}

/**
 * Rebuild a list only if its content has changed, so that a selection or reading aloud continues.
 * @template T
 * @param {HTMLElement} list
 * @param {readonly T[]} rows
 * @param {(row: T) => HTMLElement} build
 */
export function setList(list, rows, build) {
    const key = JSON.stringify(rows);
    if (list.dataset.key === key) return;
    list.dataset.key = key;
    list.replaceChildren(...rows.map(build));
}

/**
 * Save a file with the browser.
 * @param {Blob} content
 * @param {string} name
 */
export function save(content, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(content);
    link.download = name;
    link.click();
    window.setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** @param {string} base64 */
export function bytesOf(base64) {
    return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
}

/**
 * Add rules of style to the page.
 * @param {string} css
 */
export function adopt(css) {
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(css);
    document.adoptedStyleSheets = [...document.adoptedStyleSheets, sheet];
}

/** A refused request, with a message to show. */
export class Refusal extends Error {}
