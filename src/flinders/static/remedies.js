/** What the page can do itself about what it says: leave a stretch of time out, take the dip from a place. */

import { byId, element, setList } from "./dom.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./messages.d.ts").ToServer} ToServer */

/**
 * Show a button for each stretch of time that the first fault names.
 * @param {HTMLElement} host
 * @param {State} state
 * @param {(message: ToServer) => void} send
 */
export function showRemedies(host, { phase, reasons }, send) {
    const named = reasons.find(({ severity, spans }) => severity === "warning" && spans.length > 0);
    const spans = phase === "wrong" && named ? named.spans : [];
    host.hidden = spans.length === 0;
    setList(host, spans, ([start_s, end_s]) => {
        const button = element("button", `Leave out ${start_s.toFixed(1)}–${end_s.toFixed(1)} s`);
        button.setAttribute("type", "button");
        button.addEventListener("click", () => send({ type: "exclude", start_s, end_s }));
        return button;
    });
}

/**
 * Let a person give the place, whose dip and strength are those of the World Magnetic Model of today.
 * @param {(message: ToServer) => void} send
 */
export function listenForPlace(send) {
    const panel = byId("place-panel", HTMLDialogElement);
    byId("place", HTMLElement).addEventListener("click", () => panel.showModal());
    byId("place-form", HTMLFormElement).addEventListener("submit", (event) => {
        event.preventDefault(); // nothing is sent over HTTP
        const [latitude_deg, longitude_deg] = ["latitude", "longitude"].map((id) => byId(id, HTMLInputElement).valueAsNumber);
        send({ type: "place", latitude_deg, longitude_deg, year: yearOf(new Date()) });
        panel.close();
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
