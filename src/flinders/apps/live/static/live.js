/** The live page of `flinders live`. */

import { start } from "./app.js";
import { RelayLink } from "./relay.js";

start((listener, /** @type {import("./relay.js").ServedData} */ data, fitter) => {
    const socket = new URL("socket", document.baseURI).href.replace(/^http/, "ws");
    return new RelayLink(socket, listener, fitter, data);
});
