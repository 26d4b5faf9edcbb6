/** The live page of `flinders live`. */

import { start } from "./app.js";
import { byId, setText } from "./dom.js";
import { RelayLink } from "./relay.js";
import { Fitter } from "./standalone/fitter.js";

/** @param {string} path @returns {URL} */
const address = (path) => new URL(path, document.baseURI);

async function begin() {
    const answer = await fetch(address("page.json"));
    if (!answer.ok) throw new Error(`page.json gave ${answer.status}`);
    const data = await answer.json();
    const fitter = new Fitter(address("static/worker.js").href, address("flinders.wasm").href, data.engine);
    const socket = address("socket");
    socket.protocol = socket.protocol === "https:" ? "wss:" : "ws:";
    start((listener) => new RelayLink(socket.href, listener, fitter, data));
}

/** @param {unknown} error  why there is no page */
function failed(error) {
    byId("lost", HTMLElement).hidden = false;
    setText(byId("lost-words", HTMLElement), `This page could not be loaded: ${error instanceof Error ? error.message : error}.`);
    byId("retry", HTMLElement).addEventListener("click", () => window.location.reload());
}

begin().catch(failed);
