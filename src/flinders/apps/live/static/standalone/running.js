/**
 * Runs a session: takes readings, fits the newest in a worker, one fit at a time, and tells the page what has changed.
 * Subclasses provide the source of the readings, and what is done with a calibration.
 */

import { notice, Session } from "./session.js";
import { sessionState, shownStride } from "./state.js";
import { tiles } from "./tiles.js";

/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").Greeting} Greeting */
/** @typedef {import("../messages.d.ts").FromSession} FromSession */
/** @typedef {import("../messages.d.ts").Command} Command */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./fitter.js").Fitter} Fitter */

/**
 * What a page is told.
 * @typedef {object} Listener
 * @property {(message: FromSession) => void} onMessage
 * @property {(series: import("./session.js").Series, stride: number) => void} onReadings  of which one of so many is shown
 * @property {(link: "open" | "lost" | "trying", seconds: number) => void} onLink
 *   Lost: `seconds` until the next attempt. Told each second while waiting.
 */

/**
 * The calibration of all readings that were here when it was made.
 * @typedef {{name: string, view: View | null, refusal: string}} Finished
 */

/** @typedef {"calibration.json" | "report.html" | "session.csv"} FileName */

/**
 * What an export looks like.
 * @typedef {object} Preview
 * @property {string} text
 * @property {string} filename
 * @property {string[]} warnings
 * @property {string | null} [binary_base64]
 */

/**
 * What the page needs of its session. What goes wrong is thrown as a `Refusal` with words to show.
 * @typedef {object} Link
 * @property {(message: Command) => boolean} send  Whether it was heard.
 * @property {(name: string, content: Blob) => Promise<void>} open  Show a log in place of the sensor.
 * @property {(name: string, content: Blob) => Promise<void>} previous  Compare with the calibration of a file.
 * @property {() => Promise<Finished>} finish  Make the calibration of the readings so far; those that come later change nothing.
 * @property {boolean} isFinished  The calibration that was made last still is that of the session.
 * @property {(target: string) => Promise<Preview>} exported  The calibration that was finished, for a target.
 * @property {(name: FileName) => Promise<[Blob, string]>} file  A file to keep, and what it is called.
 * @property {() => Promise<string>} sendToBoard  Send the calibration that was finished; what the board has confirmed.
 * @property {() => void} retry  Try now, and do not wait.
 */

const TICK_MS = 50;
const STATE_S = 0.2;
const SILENT_STATE_S = 1;

export class SessionLink {
    /**
     * @param {Listener} listener
     * @param {Fitter} fitter
     * @param {{model: import("./geomag.js").Model, unfit: Record<string, string>}} data
     */
    constructor(listener, fitter, data) {
        this.listener = listener;
        this.fitter = fitter;
        this.session = new Session(data);
        /** @type {View | null} that was said */
        this.view = null;
        this.begun = performance.now();
        this.statedAt = -1;
        this.statedRevision = -1;
        this.isUrgent = false;
        /** Of the session when the calibration was made. */
        this.fingerprint = "";
        window.setInterval(() => this.step(), TICK_MS);
    }

    /** Seconds since the page was loaded. */
    get now() {
        return (performance.now() - this.begun) / 1000;
    }

    /** What the page is told first. @returns {Greeting} */
    get greeting() {
        throw new Error("a session has no greeting");
    }

    /** Say everything again. */
    renew() {
        this.view = this.session.view;
        this.listener.onLink("open", 0);
        this.listener.onMessage({ type: "hello", ...this.greeting, tiles: tiles(), state: sessionState(this.session), view: this.view });
    }

    /**
     * @param {Command} message
     * @returns {boolean}
     */
    send(message) {
        for (const words of this.session.requested(this.now, message)) this.listener.onMessage(words);
        this.isUrgent = true;
        this.step();
        return true;
    }

    /** Have what comes from now on wait, and note of what the calibration is made. */
    freeze() {
        this.send({ type: "finish" });
        this.fingerprint = this.session.fingerprint;
    }

    get isFinished() {
        return this.session.fingerprint === this.fingerprint;
    }

    /** @param {string} words @param {Notice["severity"]} severity */
    tell(words, severity = "info") {
        this.listener.onMessage(notice(words, severity));
    }

    /** Put what waits into the session. */
    drain() {}

    /** Take in what came, fit where that is due, and say what is new. */
    step() {
        this.drain();
        this.session.ticked(this.now);
        if (this.session.wantsFit(this.now)) this.fit();
        this.say();
    }

    async fit() {
        const { session } = this;
        const { evaluated, seconds } = await this.fitter.fit(session.beginFit());
        session.fitDone(this.now, evaluated, seconds);
        this.say();
    }

    /** Say what is new: fit, state and points. */
    say() {
        const { session, listener, now } = this;
        const { view } = session;
        if (view !== this.view) {
            this.view = view;
            listener.onMessage({ type: "fit", view });
        }
        const since = now - this.statedAt;
        if (this.isUrgent || since >= SILENT_STATE_S || (since >= STATE_S && session.revision !== this.statedRevision)) {
            this.isUrgent = false;
            this.statedAt = now;
            this.statedRevision = session.revision;
            listener.onMessage(sessionState(session));
        }
        listener.onReadings(session.shown, shownStride(session));
    }
}

/**
 * The readings of a series that are in memory, as a table in the recorded unit.
 * @param {import("./session.js").Series} series
 * @returns {Blob}
 */
export function tableOf({ buffer: { time, field, acceleration }, unit: { inside, recorded, scale } }) {
    const suffix = inside === "uT" ? `_${recorded}` : "";
    const names = ["x", "y", "z"];
    const rows = [["t_s", ...names.map((axis) => `mag_${axis}${suffix}`), ...(acceleration ? names.map((axis) => `accel_${axis}`) : [])].join()];
    time.forEach((at, j) => {
        const numbers = [...Array.from(field.subarray(3 * j, 3 * j + 3), (part) => part / scale), ...(acceleration?.subarray(3 * j, 3 * j + 3) ?? [])];
        rows.push([at.toFixed(4), ...numbers.map((number) => (Number.isFinite(number) ? Number(number.toPrecision(12)) : ""))].join());
    });
    return new Blob([`${rows.join("\n")}\n`]);
}
