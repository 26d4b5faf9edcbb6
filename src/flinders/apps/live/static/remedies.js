/** Buttons of the page's own remedies: collect more, leave out a span of time, use the dip of a place. */

import { byId, element, setList } from "./dom.js";
import { canCollect } from "./store.js";
import { numeral, phrase } from "./language.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./messages.d.ts").Command} Command */

/**
 * Show a button for each remedy.
 * @param {HTMLElement} host
 * @param {State} state
 * @param {(message: Command) => void} send
 */
export function showRemedies(host, state, send) {
    const remedies = remediesOf(state);
    host.hidden = remedies.length === 0;
    setList(host, remedies, ([words, command]) => button(words, () => send(command)));
}

/**
 * Remedies with their names; spans of time to leave out come from the first fault.
 * @param {State} state
 * @returns {[string, Command][]}
 */
function remediesOf(state) {
    const { phase, reasons, kept } = state;
    if (kept?.is_changed) return [[phrase("remedy.use-all", "Use all readings"), { type: "use_all" }]];
    const spans = phase === "good" ? [] : (reasons.find((reason) => reason.spans.length > 0)?.spans ?? []);
    /** @type {[string, Command][]} */
    const exclusions = spans.map(([start_s, end_s]) => [phrase("remedy.leave-out", "Leave out {start}–{end} s", { start: numeral(start_s.toFixed(1)), end: numeral(end_s.toFixed(1)) }), { type: "exclude", start_s, end_s }]);
    return canCollect(state) ? [[phrase("collect", "Collect more"), { type: "collect" }], ...exclusions] : exclusions;
}

/**
 * @param {string} words
 * @param {() => void} act
 * @returns {HTMLElement}
 */
function button(words, act) {
    const made = element("button", words);
    made.setAttribute("type", "button");
    made.addEventListener("click", act);
    return made;
}

/**
 * Let the user enter a place; dip and strength come from the World Magnetic Model at today's date.
 * @param {(message: Command) => void} send
 */
export function listenForPlace(send) {
    const panel = byId("place-panel", HTMLDialogElement);
    byId("place", HTMLElement).addEventListener("click", () => panel.showModal());
    byId("place-form", HTMLFormElement).addEventListener("submit", () => {
        const [latitude_deg, longitude_deg] = ["latitude", "longitude"].map((id) => byId(id, HTMLInputElement).valueAsNumber);
        send({ type: "place", latitude_deg, longitude_deg, year: yearOf(new Date()) });
    });
}

/**
 * @param {Date} date
 * @returns {number} With its fraction.
 */
function yearOf(date) {
    const year = date.getFullYear();
    const [begin, end] = [new Date(year, 0).getTime(), new Date(year + 1, 0).getTime()];
    return year + (date.getTime() - begin) / (end - begin);
}
