/**
 * Plays events into sessions of the page, each with its time: a line of JSON for each on standard input, an answer on
 * output. Fits are those of the worker of the page.
 */

import { createInterface } from "node:readline";
import { pathToFileURL } from "node:url";

const lines = createInterface({ input: process.stdin })[Symbol.asyncIterator]();
const { modules, wasm, data } = JSON.parse((await lines.next()).value);
const load = (name) => import(pathToFileURL(`${modules}/${name}`));

/** The worker of the page, in this thread. */
const ends = { hear: () => {}, answer: () => {} };
globalThis.self = {
    addEventListener: (_, heard) => (ends.hear = (data) => heard({ data })),
    postMessage: (data) => ends.answer(data),
};
globalThis.Worker = class {
    addEventListener(kind, heard) {
        if (kind === "message") ends.answer = (data) => heard({ data });
    }

    postMessage(data) {
        ends.hear(data);
    }
};
await load("worker.js");

const names = ["session.js", "state.js", "passed.js", "targets.js", "fitter.js", "../store.js"];
const [{ RULES, Series, Session }, { sessionState, shownStride }, { passedIn }, { readCalibration }, { Fitter }, { Store }] =
    await Promise.all(names.map(load));
const fitter = new Fitter("worker.js", `data:application/wasm;base64,${wasm}`, data.engine);
const fitted = async (task) => (await fitter.fit(task)).evaluated;

const bytes = (text) => Uint8Array.from(Buffer.from(text, "base64")).buffer;
const floats = (text) => text && new Float64Array(bytes(text));
const packed = (numbers) => Buffer.from(numbers.buffer, numbers.byteOffset, numbers.byteLength).toString("base64");

class Played {
    constructor({ rules, frame, ...changes }) {
        this.session = Object.assign(new Session(data, { ...RULES, ...rules }), changes);
        Object.assign(this.session.live, frame && { frame });
        this.stores = {};
        this.found = null;
    }

    arrived({ at, time, field, acceleration, unit }) {
        this.session.arrived(at, { time: floats(time), field: floats(field), acceleration: floats(acceleration) }, unit);
    }

    received({ at, frame, is_old: isOld }) {
        const { passed, unit } = passedIn(bytes(frame));
        this.session.received(at, passed, unit, isOld);
    }

    restarted() {
        this.session.restart();
    }

    adopted({ at, edits }) {
        this.session.adopt(at, edits);
    }

    linked({ at, link, words }) {
        return this.session.linked(at, link, words);
    }

    unrecorded({ words }) {
        this.session.unrecorded = words;
    }

    /** As `RelayLink` opens a log. */
    opened({ at, name, frame, about }) {
        const { passed, unit } = passedIn(bytes(frame));
        const series = Object.assign(new Series(this.session.rules.capacity, unit, about.is_timed), about);
        series.buffer.follow(passed);
        this.session.openedLog(at, name, series);
    }

    previous({ at, name, text }) {
        this.session.gotPrevious(at, { name, calibration: readCalibration(text, data) });
    }

    requested({ at, command }) {
        return this.session.requested(at, command);
    }

    ticked({ at }) {
        this.session.ticked(at);
    }

    async begun() {
        this.found = await fitted(this.session.beginFit());
    }

    done({ at, seconds }) {
        this.session.fitDone(at, this.found, seconds);
    }

    // What is asked

    wants({ at }) {
        return this.session.wantsFit(at);
    }

    evaluated() {
        return fitted(this.session.task(this.session.rules.fitted));
    }

    used() {
        const { numbers, field, site } = this.session.task(this.session.rules.fitted);
        return { numbers: Array.from(numbers), field: packed(field), site };
    }

    held() {
        const { total, stride, time, field } = this.session.live.buffer;
        return { total, stride, time: packed(time), field: packed(field) };
    }

    edits() {
        return this.session.edits;
    }

    finishing() {
        return this.session.finishing;
    }

    state() {
        return sessionState(this.session);
    }

    shown() {
        return this.session.shown.evaluated;
    }

    view() {
        return this.session.view;
    }

    points({ page }) {
        const store = (this.stores[page] ??= new Store());
        const first = store.follow(this.session.shown, shownStride(this.session));
        const { count, stride, time, acceleration } = store.points;
        return { first, stride, time: packed(time.subarray(0, count)), acceleration: acceleration && packed(acceleration.subarray(0, 3 * count)) };
    }
}

const played = new Map();
const answered = async ({ number, name, given }) => {
    if (name === "new") played.set(number, new Played(given));
    else if (name === "forget") played.delete(number);
    else return (await played.get(number)[name](given)) ?? null;
    return null;
};
for await (const line of lines) {
    const said = await answered(JSON.parse(line)).then((answer) => ({ answer }), ({ stack }) => ({ fault: stack }));
    process.stdout.write(`${JSON.stringify(said)}\n`);
}
