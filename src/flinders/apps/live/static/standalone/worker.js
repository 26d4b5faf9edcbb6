/** Worker with the engine, which runs one task after the other. */

import { loadEngine } from "./engine.js";
import { evaluate } from "./evaluate.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./session.js").Task} Task */
/** @typedef {{address: string, data: EngineData}} Start */
/** @typedef {{number: number, task: Task}} Fit */

/** @type {Promise<{engine: import("./engine.js").Engine, data: EngineData}>} */
let ready;

self.addEventListener("message", async (/** @type {MessageEvent<Start | Fit>} */ { data: asked }) => {
    if ("number" in asked) {
        self.postMessage(await answerTask(asked));
        return;
    }
    ready = loadParts(asked);
    ready.catch(() => {}); // the answer to each task reports it
});

/** @param {Start} start */
async function loadParts({ address, data }) {
    return { engine: await loadEngine(new URL(address), data.layouts), data };
}

/**
 * Answer a task; an internal error is answered with its message.
 * @param {Fit} fit
 */
async function answerTask({ number, task }) {
    try {
        const { engine, data } = await ready;
        const begin = performance.now();
        const evaluated = evaluate(engine, data, task);
        return { number, evaluated: { ...evaluated, key: task.key }, seconds: (performance.now() - begin) / 1000 };
    } catch (error) {
        return { number, fault: String(error) };
    }
}
