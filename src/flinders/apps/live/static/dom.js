/** Small helpers for the page. Text from the server goes in as text, never as markup. */

import { svg } from "./views/plot.js";

/**
 * The element with an id, which must be there and of a kind.
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

/** A number before its unit. */
const BEFORE_A_UNIT = /(\d) (?=[%°µσ]|(?:k?Hz|kB|Mi?B|mG|nT|uT|min|[hsmg])\b)/g;

/**
 * A text in which numbers and their units stay on one line.
 * @param {string} text
 */
function joinUnits(text) {
    return text.replace(BEFORE_A_UNIT, "$1\u00a0");
}

/**
 * Set a text, if it is another.
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
 * What this browser was told to remember; null where it was not, or remembers nothing.
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
 * Have this browser remember something, where storage is not switched off.
 * @param {string} key
 * @param {string} value
 */
export function remember(key, value) {
    try {
        localStorage.setItem(key, value);
    } catch {
        // It then lasts as long as the page.
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
 * Build a list again only where what it says has changed, so that what is selected or read aloud stays.
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
 * Hand a file to the browser to save.
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

/** What was asked for and refused, in words to show. */
export class Refusal extends Error {}
