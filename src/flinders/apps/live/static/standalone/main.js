/** The page that needs no program: its session is its own, and it begins with a choice of where readings come from. */

import { start } from "../app.js";
import { Choice } from "./choice.js";
import { ColumnDialog } from "./columns.js";
import { Keeper } from "./keeper.js";
import { OwnLink } from "./link.js";
import { layChoice } from "./start.js";

layChoice();
start(async (listener, /** @type {import("./link.js").PageData} */ data, fitter) => {
    const keeper = await Keeper.open();
    const link = new OwnLink(listener, data, fitter, keeper);
    const choice = new Choice(link, data);
    const columns = new ColumnDialog(Object.keys(data.lines.units.PER_UNIT));
    link.choose = (unclear) => columns.ask(unclear.question, unclear.message);
    const restored = async () => {
        await link.restore();
        choice.follow();
    };
    keeper.onOpen = () => {
        if (link.isUsed) keeper.database = null; // it has readings of another page
        else restored();
    };
    guard(link, keeper);
    navigator.serviceWorker?.register("sw.js").catch(() => {}); // without it the page works, but not offline
    restored();
    return link;
});

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
