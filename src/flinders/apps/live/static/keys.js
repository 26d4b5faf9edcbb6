/** Keyboard shortcuts: one table, also shown in the help. */

import { element, remember, recall } from "./dom.js";
import { phrase } from "./language.js";

/**
 * A shortcut.
 * @typedef {object} Shortcut
 * @property {string[]} keys As `KeyboardEvent.key` gives them, lower case; with "shift+" or "ctrl+" before it.
 * @property {string} words
 * @property {() => void} act
 */

const STORE = "flinders-single-keys";
/** Names of keys that are no letters. @type {Readonly<Record<string, string>>} */
export const KEYS = Object.freeze({ delete: "Delete", escape: "Escape", shift: "Shift", ctrl: "Ctrl" });

/** Whether shortcuts of a single key are on; users of speech input can switch them off. */
export function singleKeys() {
    return recall(STORE) !== "off";
}

/** @param {boolean} on */
export function setSingleKeys(on) {
    remember(STORE, on ? "on" : "off");
}

/**
 * Listen for shortcuts.
 * @param {readonly Shortcut[]} shortcuts
 */
export function listen(shortcuts) {
    const acts = new Map(shortcuts.flatMap(({ keys, act }) => keys.map((key) => /** @type {const} */ ([key, act]))));
    window.addEventListener("keydown", (event) => {
        if (event.defaultPrevented || event.altKey || isTyping(event)) return;
        const control = event.ctrlKey || event.metaKey ? "ctrl+" : "";
        const shift = event.shiftKey && event.key.length === 1 && /[a-z]/i.test(event.key) ? "shift+" : "";
        const act = acts.get(`${control}${shift}${event.key.toLowerCase()}`);
        if (!act || (!control && event.key !== "Escape" && !singleKeys())) return;
        if (event.key !== "Escape") event.preventDefault(); // the browser closes dialogs with Escape
        act();
    });
}

/**
 * Whether a key press is input to a field, and so no shortcut.
 * @param {KeyboardEvent} event
 * @returns {boolean}
 */
function isTyping(event) {
    const target = event.target;
    if (!(target instanceof HTMLElement)) return false;
    if (target instanceof HTMLInputElement && ["checkbox", "radio"].includes(target.type)) return false;
    if (event.key === "Escape") return false;
    return target.matches("input, select, textarea");
}

/**
 * The rows of the help.
 * @param {readonly Shortcut[]} shortcuts
 * @returns {HTMLElement[]}
 */
export function rows(shortcuts) {
    return shortcuts.map(({ keys, words }) => {
        const head = element("dt");
        keys.slice(0, 2).forEach((key, i) => {
            if (i > 0) head.append(` ${phrase("keys.or", "or")} `);
            key.split("+").filter(Boolean).forEach((part, j) => {
                if (j > 0) head.append(" ");
                head.append(element("kbd", nameOf(part)));
            });
        });
        return element("div", [head, element("dd", words)]);
    });
}

/**
 * @param {string} key
 * @returns {string} Its name on a keyboard.
 */
function nameOf(key) {
    return KEYS[key] ? phrase(`key.${key}`, KEYS[key]) : key[0].toUpperCase() + key.slice(1);
}
