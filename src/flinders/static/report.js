/**
 * Interactive parts of a report: the 3-D view, the theme, and buttons to copy. The rest needs no script.
 *
 * `flinders.report.html_file` joins it with its imports into one script; a report without the bundle of three.js has
 * `plain.js` in its place.
 */

import { Scene } from "./views/scene.js";
import { copying, theming } from "./plain.js";

/** @typedef {import("./views/colours.js").Theme} Theme */
/** @typedef {import("./views/scene.js").Mode} Mode */

const host = document.getElementById("scene");
const text = document.getElementById("drawn")?.textContent;

/** @type {Scene | null} */
let scene = null;
const theme = theming((/** @type {Theme} */ chosen) => scene?.setTheme(chosen));
copying();

if (host && text) {
    const drawn = JSON.parse(text);
    const field = numbers(drawn.field);
    const points = { count: field.length / 3, time: new Float32Array(field.length / 3), field, stride: drawn.stride };
    document.documentElement.classList.add("moving");
    try {
        scene = new Scene(host, { tiles: drawn.tiles, theme: theme(), target_deg: drawn.target_deg, wheel: "focus" });
        scene.setMask([], drawn.rejected);
        scene.setPoints(points);
        scene.setView(drawn);
        choosing(scene);
    } catch (error) {
        console.warn("flinders: no 3-D view:", error);
        document.documentElement.classList.remove("moving");
    }
}

/**
 * Numbers of four bytes, little-endian, as base64.
 *
 * @param {string} coded
 * @returns {Float32Array}
 */
function numbers(coded) {
    const bytes = Uint8Array.from(atob(coded), (letter) => letter.charCodeAt(0));
    const seen = new DataView(bytes.buffer);
    return Float32Array.from({ length: bytes.length / 4 }, (_, place) => seen.getFloat32(4 * place, true));
}

/** Connect the switch above the view, and the button that resets the camera. @param {Scene} view */
function choosing(view) {
    for (const choice of document.querySelectorAll("input[name=mode]")) {
        choice.addEventListener("change", () => {
            if (choice instanceof HTMLInputElement) view.setMode(/** @type {Mode} */ (choice.value));
        });
        if (choice instanceof HTMLInputElement && choice.checked) view.setMode(/** @type {Mode} */ (choice.value));
    }
    document.getElementById("reset")?.addEventListener("click", () => view.resetCamera());
}
