/**
 * Runs a session: adds readings, fits them in a worker, one fit at a time, and sends changes to the page. Subclasses
 * provide the source of the readings, and the use of a calibration.
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
 * Callbacks of a page.
 * @typedef {object} Listener
 * @property {(message: FromSession) => void} onMessage
 * @property {(series: import("./session.js").Series, stride: number) => void} onReadings  one of `stride` readings is shown
 * @property {(link: "open" | "lost" | "trying", seconds: number) => void} onLink
 *   Lost: `seconds` until the next attempt, called each second while waiting.
 */

/**
 * A finished calibration of all readings at its time.
 * @typedef {{name: string, view: View | null, refusal: string}} Finished
 */

/** @typedef {"calibration.json" | "report.html" | "session.csv"} FileName */

/**
 * Preview of an export.
 * @typedef {object} Preview
 * @property {string} text
 * @property {string} filename
 * @property {string[]} warnings
 * @property {string | null} [binary_base64]
 */

/**
 * Interface of a session for the page. Failures are thrown as a `Refusal` with a message to show.
 * @typedef {object} Link
 * @property {(message: Command) => boolean} send  Returns whether it was sent.
 * @property {(name: string, content: Blob) => Promise<void>} open  Show a log in place of the sensor.
 * @property {(name: string, content: Blob) => Promise<void>} previous  Compare with the calibration of a file.
 * @property {() => Promise<Finished>} finish  Make the calibration of the readings so far.
 * @property {boolean} isFinished  Whether the latest calibration is up to date with the session.
 * @property {(target: string) => Promise<Preview>} exported  The finished calibration for a target.
 * @property {(name: FileName) => Promise<[Blob, string]>} file  A file to save, and its name.
 * @property {() => Promise<string>} sendToBoard  Send the finished calibration; returns the board's confirmation.
 * @property {() => void} retry  Reconnect at once.
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
        /** @type {View | null} last sent view */
        this.view = null;
        this.begun = performance.now();
        this.statedAt = -1;
        this.statedRevision = -1;
        this.isUrgent = false;
        /** Fingerprint of the session at the calibration. */
        this.fingerprint = "";
        window.setInterval(() => this.step(), TICK_MS);
    }

    /** Seconds since the page was opened. */
    get now() {
        return (performance.now() - this.begun) / 1000;
    }

    /** First message to the page. @returns {Greeting} */
    get greeting() {
        throw new Error("a session has no greeting");
    }

    /** Send all state again. */
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

    /** Hold later readings back, and note the inputs of the calibration. */
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

    /** Add queued readings to the session. */
    drain() {}

    /** Add queued readings, start a fit if due, and send changes. */
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

    /** Send changes of fit, state and points. */
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
 * Readings of a series in memory, as a table in the recorded unit.
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
