/** Fits in a worker of their own, so that none blocks drawing. */

/** @typedef {import("./session.js").Evaluated} Evaluated */
/** @typedef {import("./session.js").Task} Task */
/** @typedef {{evaluated: Evaluated, seconds: number}} Timed */

export class Fitter {
    /**
     * @param {string} script  address of the worker
     * @param {string} address  of the engine
     * @param {import("./data.d.ts").EngineData} data
     */
    constructor(script, address, data) {
        /** @type {Map<number, {task: Task, done: (timed: Timed) => void}>} */
        this.running = new Map();
        this.asked = 0;
        this.failure = "";
        this.worker = new Worker(script, { type: "module" });
        this.worker.addEventListener("message", ({ data: { number, evaluated, seconds } }) => this.#done(number, { evaluated, seconds }));
        this.worker.addEventListener("error", (event) => this.#fail(event.message || "its script cannot be loaded"));
        this.worker.postMessage({ address, data });
    }

    /**
     * Fit, and say how long that took. A fault of ours is a refusal that says so.
     * @param {Task} task
     * @returns {Promise<Timed>}
     */
    fit(task) {
        if (this.failure) return Promise.resolve(refused(task, this.failure));
        const number = ++this.asked;
        return new Promise((done) => {
            this.running.set(number, { task, done });
            this.worker.postMessage({ number, task });
        });
    }

    /**
     * @param {number} number
     * @param {Timed} timed
     */
    #done(number, timed) {
        this.running.get(number)?.done(timed);
        this.running.delete(number);
    }

    /** @param {string} words */
    #fail(words) {
        this.failure = `the engine does not run in this browser (${words}): load the page again, or use flinders calibrate`;
        for (const [number, { task }] of this.running) this.#done(number, refused(task, this.failure));
    }
}

/**
 * @param {Task} task
 * @param {string} refusal
 * @returns {Timed}
 */
function refused({ key }, refusal) {
    const evaluated = { key, view: null, refusal, reasons: [], used: 0, rejected: 0, coverage: 0, alarms: [], record: null };
    return { evaluated, seconds: 1 };
}
