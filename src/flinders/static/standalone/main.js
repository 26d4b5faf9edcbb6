/** The page that needs no program: its session is its own, and it begins with a choice of where readings come from. */

import { start } from "../app.js";
import { byId, setText } from "../dom.js";
import { Choice } from "./choice.js";
import { ColumnDialog } from "./columns.js";
import { Fitter } from "./fitter.js";
import { Keeper } from "./keeper.js";
import { OwnLink } from "./link.js";

/** @param {string} path @returns {string} */
const address = (path) => new URL(path, document.baseURI).href;

async function begin() {
    const answer = await fetch(address("page.json"));
    if (!answer.ok) throw new Error(`page.json gave ${answer.status}`);
    const data = /** @type {import("./link.js").PageData} */ (await answer.json());
    const keeper = await Keeper.open();
    const fitter = new Fitter(address("static/worker.js"), address("flinders.wasm"), data.engine);
    /** @type {OwnLink[]} */
    const links = [];
    start((listener) => {
        links.push(new OwnLink(listener, data, fitter, keeper));
        return links[0];
    });
    const [link] = links;
    const choice = new Choice(link, data);
    const columns = new ColumnDialog(Object.keys(data.lines.units.PER_UNIT));
    link.choose = (unclear) => columns.ask(unclear.asked, unclear.message);
    const restored = async () => {
        await link.restore();
        choice.follow();
    };
    await restored();
    keeper.onOpen = () => {
        if (link.isUsed) keeper.database = null; // it has readings of another page
        else restored();
    };
    guard(link, keeper);
    navigator.serviceWorker?.register(address("sw.js")).catch(() => {}); // without it the page works, but not offline
}

/**
 * Ask before readings are lost, and write down what waits.
 * @param {OwnLink} link
 * @param {Keeper} keeper
 */
function guard(link, keeper) {
    window.addEventListener("beforeunload", (event) => {
        keeper.write();
        if (link.isUnsaved) event.preventDefault();
    });
    window.addEventListener("pagehide", () => keeper.write());
}

/** @param {unknown} error  why there is no page */
function failed(error) {
    const words = error instanceof Error ? error.message : String(error);
    byId("lost", HTMLElement).hidden = false;
    setText(byId("lost-words", HTMLElement), `This page could not be loaded: ${words}.`);
    byId("retry", HTMLElement).addEventListener("click", () => window.location.reload());
}

begin().catch(failed);
