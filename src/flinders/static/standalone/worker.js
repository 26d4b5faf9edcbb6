/** The worker that fits: it has the engine, and answers one task after the other. */

import { loadEngine } from "./engine.js";
import { evaluate } from "./evaluate.js";

/** @typedef {import("./session.js").Evaluated} Evaluated */
/** @typedef {import("./session.js").Task} Task */

/** @type {Promise<any>} */
let engine;
/** @type {any} */
let data;

self.addEventListener("message", async (event) => {
    if (event.data.engine) {
        data = event.data.data;
        engine = loadEngine(new URL(event.data.engine));
        return;
    }
    const { number, task } = /** @type {{number: number, task: Task}} */ (event.data);
    const ready = await engine;
    const begun = performance.now();
    const evaluated = fitted(ready, task);
    self.postMessage({ number, evaluated, seconds: (performance.now() - begun) / 1000 });
});

/**
 * @param {any} ready  the engine
 * @param {Task} task
 * @returns {Evaluated}
 */
function fitted(ready, task) {
    return { ...evaluate(ready, data, task), key: task.key };
}
