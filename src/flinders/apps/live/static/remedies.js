/** What the page can do itself about what it says: collect more, leave a stretch of time out, take the dip from a place. */

import { byId, element, setList } from "./dom.js";
import { canCollect } from "./store.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./messages.d.ts").Command} Command */

/**
 * Show a button for each thing that can be done.
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
 * What can be done, and what it is called: a stretch of time is left out that the first fault names.
 * @param {State} state
 * @returns {[string, Command][]}
 */
function remediesOf(state) {
    const { phase, reasons, kept } = state;
    if (kept?.is_changed) return [["Use all readings", { type: "use_all" }]];
    const spans = phase === "good" ? [] : (reasons.find((reason) => reason.spans.length > 0)?.spans ?? []);
    /** @type {[string, Command][]} */
    const exclusions = spans.map(([start_s, end_s]) => [`Leave out ${start_s.toFixed(1)}–${end_s.toFixed(1)} s`, { type: "exclude", start_s, end_s }]);
    return canCollect(state) ? [["Collect more", { type: "collect" }], ...exclusions] : exclusions;
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
 * Let a person give the place, whose dip and strength are those of the World Magnetic Model of today.
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
