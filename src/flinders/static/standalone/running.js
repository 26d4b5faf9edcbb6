/**
 * Runs a session: takes readings, fits the newest in a worker, one fit at a time, and tells the page what has changed.
 * Subclasses provide the source of the readings, and what is done with a calibration.
 */

import { notice, Session } from "./session.js";
import { Cursor, sessionState } from "./state.js";
import { tiles } from "./tiles.js";

/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").Greeting} Greeting */
/** @typedef {import("../messages.d.ts").FromSession} FromSession */
/** @typedef {import("../messages.d.ts").Command} Command */
/** @typedef {import("../messages.d.ts").View} View */
/** @typedef {import("./fitter.js").Fitter} Fitter */

/**
 * What a page is told.
 * @typedef {object} Listener
 * @property {(message: FromSession) => void} onMessage
 * @property {(frame: ArrayBuffer) => void} onFrame
 * @property {(link: "open" | "lost" | "trying", seconds: number) => void} onLink
 *   Lost: `seconds` until the next attempt. Told each second while waiting.
 */

/**
 * The calibration of all readings that were here when it was made.
 * @typedef {{name: string, view: View | null, refusal: string}} Finished
 */

/**
 * What the page needs of its session.
 * @typedef {object} Link
 * @property {(message: Command) => boolean} send  Whether it was heard.
 * @property {(address: string, options?: RequestInit) => Promise<Response>} ask
 *   As over HTTP, of the calibration that was finished; throws a `Refusal` with words to show, whatever went wrong.
 * @property {() => Promise<Finished>} finish  Make the calibration of all readings.
 * @property {() => void} retry  Try now, and do not wait.
 * @property {() => void} renew  Say everything again.
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
        this.cursor = new Cursor();
        /** @type {View | null} that was said */
        this.view = null;
        this.begun = performance.now();
        this.statedAt = -1;
        this.statedRevision = -1;
        this.isUrgent = false;
        /** @type {import("./session.js").Evaluated | null}  of all readings */
        this.made = null;
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
        this.cursor = new Cursor();
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
        const frame = this.cursor.frame(session);
        if (frame) listener.onFrame(frame);
    }
}
