/** Runs fits in a worker, so that they do not block drawing. */

import { phrase } from "../language.js";

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
        this.worker.addEventListener("message", ({ data }) => this.#onAnswer(data));
        this.worker.addEventListener("error", (event) => this.#fail(event.message || "its script cannot be loaded"));
        this.worker.postMessage({ address, data });
    }

    /**
     * Fit a task; returns the result and its duration. An internal error becomes a refusal.
     * @param {Task} task
     * @returns {Promise<Timed>}
     */
    fit(task) {
        if (this.failure) return Promise.resolve(refusalResult(task, this.failure));
        const number = ++this.asked;
        return new Promise((done) => {
            this.running.set(number, { task, done });
            this.worker.postMessage({ number, task });
        });
    }

    /** @param {{number: number, fault?: string} & Timed} answer */
    #onAnswer({ number, fault, evaluated, seconds }) {
        const asked = this.running.get(number);
        if (!asked) return;
        this.running.delete(number);
        asked.done(fault === undefined ? { evaluated, seconds } : refusalResult(asked.task, faultOf(fault)));
    }

    /** @param {string} words  reason why the worker cannot run */
    #fail(words) {
        this.failure = faultOf(words);
        for (const { task, done } of this.running.values()) done(refusalResult(task, this.failure));
        this.running.clear();
    }
}

/** @param {string} words @returns {string} Message for an internal error. */
function faultOf(words) {
    return phrase("state.not-fitted", "these readings could not be fitted in this browser ({error}): save them, and use flinders calibrate", { error: words });
}

/**
 * @param {Task} task
 * @param {string} refusal
 * @returns {Timed}
 */
function refusalResult({ key }, refusal) {
    const evaluated = { key, view: null, refusal, refusalCode: "", reasons: [], used: 0, rejected: 0, coverage: 0, alarms: [], record: null, previous: null };
    return { evaluated, seconds: 1 };
}
