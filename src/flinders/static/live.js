/** The live page of `flinders live`: its session is the server's. */

import { start } from "./app.js";
import { Connection } from "./connection.js";

const address = new URL("socket", window.location.href);
address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
start((listener) => new Connection(address.href, listener));
