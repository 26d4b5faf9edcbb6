/**
 * The session of the live page: the server sends the readings, and stores the user's edits and passes them to other
 * pages. The server makes the final calibration from all readings of the file.
 */

import { Connection } from "./connection.js";
import { Refusal } from "./dom.js";
import { passedIn } from "./standalone/passed.js";
import { SessionLink, tableOf } from "./standalone/running.js";
import { Series, Session, knownSite } from "./standalone/session.js";
import { Unreadable } from "./standalone/tables.js";
import { readCalibration } from "./standalone/targets.js";
import { phrase } from "./language.js";

/** @typedef {import("./messages.d.ts").Command} Command */
/** @typedef {import("./wire.d.ts").FromServer} FromServer */
/** @typedef {import("./wire.d.ts").Welcome} Welcome */
/** @typedef {import("./standalone/data.d.ts").EngineData} EngineData */
/** @typedef {import("./standalone/fitter.js").Fitter} Fitter */
/** @typedef {import("./standalone/running.js").Finished} Finished */
/** @typedef {import("./standalone/running.js").Listener} Listener */

/** @typedef {{engine: EngineData, model: import("./standalone/geomag.js").Model, unfit: Record<string, string>, targets: {schema: number}, bodies: [name: string, description: string][]}} ServedData */

export class RelayLink extends SessionLink {
    /**
     * @param {string} address
     * @param {Listener} listener
     * @param {Fitter} fitter
     * @param {ServedData} data
     */
    constructor(address, listener, fitter, data) {
        super(listener, fitter, data);
        this.data = data;
        /** @type {Welcome | null} */
        this.welcome = null;
        /** Generation of the server's readings; those of an earlier one are dropped. */
        this.generation = -1;
        /** Readings from before the page was opened are arriving. */
        this.isBehind = true;
        /** Messages sent on this connection. */
        this.sent = 0;
        /** All messages and readings so far have arrived, so the page is up to date. */
        this.isHeard = false;
        /** The edits that the server has stored, as JSON. */
        this.told = "";
        /** Number of the server's earlier calibration. */
        this.comparedWith = "";
        /** Number of the finished calibration. */
        this.finished = "";
        this.connection = new Connection(address, {
            onLink: (state, seconds) => this.#onLink(state, seconds),
            onMessage: (message) => this.#onMessage(message),
            onFrame: (frame) => this.#onFrame(frame),
        });
    }

    get greeting() {
        const { version, targets, limits } = /** @type {Welcome} */ (this.welcome);
        return { version, targets, limits };
    }

    say() {
        if (this.isHeard) super.say();
    }

    retry() {
        this.connection.retry();
    }

    /** @param {Command} message */
    send(message) {
        if (!this.isHeard || !this.connection.isOpen) return false; // the page may show another session
        if (message.type === "previous_clear") this.#say({ type: "previous", name: "", text: "", number: "" });
        super.send(message);
        this.#tellEdits();
        return true;
    }

    /** @param {string} name @param {Blob} content */
    async open(name, content) {
        const answer = await this.connection.ask(`open?${new URLSearchParams({ name })}`, { method: "POST", body: content });
        this.#open(await answer.arrayBuffer());
    }

    /** @param {string} name @param {Blob} content */
    async previous(name, content) {
        await this.connection.ask(`previous?${new URLSearchParams({ name })}`, { method: "POST", body: content });
    }

    /** @param {string} target @returns {Promise<import("./standalone/running.js").Preview>} */
    async exported(target) {
        const headers = { Accept: "application/json" };
        const answer = await this.connection.ask(`export/${encodeURIComponent(target)}?of=${this.finished}`, { headers });
        const { refusal, ...preview } = await answer.json();
        if (refusal) throw new Refusal(refusal);
        return preview;
    }

    /**
     * @param {import("./standalone/running.js").FileName} name
     * @returns {Promise<[Blob, string]>}
     */
    async file(name) {
        const { opened, openedName } = this.session;
        if (name === "session.csv" && opened) return [tableOf(opened), `${openedName.replace(/\.[^.]*$/, "")}-readings.csv`];
        const answer = await this.connection.ask(`${name}?of=${this.finished}`);
        const named = /filename="([^"/\\]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1];
        return [await answer.blob(), named ?? name];
    }

    async sendToBoard() {
        const answer = await this.connection.ask(`send?of=${this.finished}`, { method: "POST" });
        return (await answer.json()).words;
    }

    /** @returns {Promise<Finished>} */
    async finish() {
        this.freeze();
        const { shown, finishing } = this.session;
        const of = new URLSearchParams({ ...(shown.number && { log: shown.number }), ...(finishing.refreshing && { previous: this.comparedWith }) });
        const answer = await this.connection.ask(`finish?${of}`, { method: "POST", body: JSON.stringify(finishing) });
        const { number, name, view, refusal } = await answer.json();
        this.finished = number;
        return { name, view, refusal };
    }

    /** @param {"open" | "lost" | "trying"} state @param {number} seconds */
    #onLink(state, seconds) {
        if (state === "open") return; // wait for the readings
        this.isHeard = false;
        this.listener.onLink(state, seconds);
    }

    /** @param {FromServer} message */
    #onMessage(message) {
        switch (message.type) {
            case "welcome":
                this.#onWelcome(message);
                break;
            case "kept":
                if (message.heard >= this.sent) this.#adopt(message.edits);
                break;
            case "source":
                this.session.source = message.source;
                this.session.revision += 1;
                break;
            case "unrecorded":
                this.session.unrecorded = message.words;
                this.tell(message.words || phrase("link.recorded-again", "what arrives is recorded again"), message.words ? "error" : "info");
                break;
            case "previous":
                this.#compareWith(message);
                break;
            default:
                this.listener.onMessage(message);
        }
        this.isUrgent = true;
        this.step();
    }

    /** @param {Welcome} welcome */
    #onWelcome(welcome) {
        if (this.welcome && this.welcome.session !== welcome.session) this.#forget();
        this.welcome = welcome;
        this.sent = 0;
        const { session } = this;
        Object.assign(session, { source: welcome.source, recording: welcome.recording, unrecorded: welcome.unrecorded, hasBoard: welcome.has_board });
        if (session.arrivedAt) session.arrivedAt = this.now; // no reading could arrive meanwhile
        this.#compareWith(welcome.previous);
        this.#adopt(welcome.edits); // the edits state whether it is renewed
        this.generation = -1;
    }

    /** Drop the session of an ended server, as the next one may have another sensor. */
    #forget() {
        this.session = new Session(this.data);
        this.comparedWith = "";
    }

    /** @param {import("./wire.d.ts").Edits} edits  stored by the server */
    #adopt(edits) {
        const { session } = this;
        const kept = JSON.stringify({ ...edits, site: edits.site && knownSite(edits.site) });
        if (kept !== JSON.stringify(session.edits)) session.adopt(this.now, edits);
        this.told = JSON.stringify(session.edits);
    }

    /** @param {import("./wire.d.ts").Previous} previous  an unreadable one counts as none */
    #compareWith({ name, text, number }) {
        if (number === this.comparedWith) return;
        this.comparedWith = number;
        try {
            if (text) this.session.gotPrevious(this.now, { name, calibration: readCalibration(text, this.data) });
            else this.session.requested(this.now, { type: "previous_clear" });
        } catch (error) {
            this.session.requested(this.now, { type: "previous_clear" });
            this.tell(error instanceof Unreadable ? `${name}: ${error.message}` : String(error), "error");
        }
    }

    /** @param {ArrayBuffer} bytes */
    #onFrame(bytes) {
        const { passed, unit, frame, generation, isLast } = passedIn(bytes);
        if (generation > this.generation) {
            this.session.restart();
            this.isBehind = true;
        }
        this.generation = generation;
        Object.assign(this.session.live, { frame, axes: this.welcome?.axes });
        this.session.received(this.now, passed, unit, this.isBehind);
        if (isLast) this.isBehind = false;
        if (!this.isHeard) {
            this.isHeard = true;
            this.renew();
        }
        this.step();
    }

    /** @param {ArrayBuffer} bytes  of a log read by the server */
    #open(bytes) {
        const length = Number(new BigUint64Array(bytes, 0, 1)[0]);
        const about = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, length)));
        const { passed, unit, frame } = passedIn(bytes, 8 + length);
        const series = new Series(this.session.rules.capacity, unit, about.is_timed);
        Object.assign(series, { number: about.number, frame, site: about.site, axes: about.axes });
        series.buffer.follow(passed);
        this.session.openedLog(this.now, about.name, series);
        this.tell(about.words);
        this.isUrgent = true;
        this.step();
    }

    /** Send the edits to the server. */
    #tellEdits() {
        const edits = JSON.stringify(this.session.edits);
        if (edits === this.told) return;
        this.told = edits;
        this.#say(this.session.edits);
    }

    /** @param {import("./wire.d.ts").Edits | import("./wire.d.ts").Previous} message */
    #say(message) {
        if (this.connection.send(message)) this.sent += 1;
    }
}
