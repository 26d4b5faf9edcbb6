/** The page without a server: it runs its own session, and begins with the choice of a source. */

import { start } from "../app.js";
import { byId } from "../dom.js";
import { askTable, layPlan } from "../plan.js";
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
    layPlan(byId("start-plan", HTMLElement), data.bodies, askTable(data.plans));
    const columns = new ColumnDialog(Object.keys(data.lines.units.PER_UNIT), data.chips);
    link.choose = (unclear) => columns.ask(unclear.question, unclear.message);
    const restored = async () => {
        await link.restore();
        choice.follow();
    };
    keeper.onOpen = () => {
        if (link.isUsed) keeper.database = null; // the database has readings of another page
        else restored();
    };
    guard(link, keeper);
    navigator.serviceWorker?.register("sw.js").catch(() => {}); // without a worker, the page works only online
    restored();
    return link;
});

/**
 * Ask before closing the page would lose readings, and write queued readings.
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
