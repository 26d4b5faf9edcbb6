/** The live page of `flinders live`. */

import { start } from "./app.js";
import { byId } from "./dom.js";
import { layPlan } from "./plan.js";
import { RelayLink } from "./relay.js";

start((listener, /** @type {import("./relay.js").ServedData} */ data, fitter) => {
    const socket = new URL("socket", document.baseURI).href.replace(/^http/, "ws");
    const link = new RelayLink(socket, listener, fitter, data);
    layPlan(byId("empty", HTMLElement), data.bodies, async (body, noise) => {
        const answer = await link.connection.ask(`plan?${new URLSearchParams({ body, noise: String(noise) })}`);
        return answer.json();
    });
    return link;
});
