/**
 * The session of a page without a server: sources in the browser, and the functions of the server.
 *
 * Readings of a source are queued, and added to the session about twenty times a second.
 */

import { bytesOf, Refusal } from "../dom.js";
import { degrees, sourceTitle } from "../views/words.js";
import { SessionLink, tableOf } from "./running.js";
import { seriesOf } from "./session.js";
import { readLog } from "./lines.js";
import { reportPage } from "./report_page.js";
import { send } from "./sending.js";
import { Board, unitOf } from "./sources.js";
import { sessionState } from "./state.js";
import { Unclear, Unreadable } from "./tables.js";
import { calibrationFile, exported, NotExportable, readCalibration, targetsOf } from "./targets.js";
import { inEnglish, phrase } from "../language.js";

/** @typedef {import("./running.js").Finished} Finished */
/** @typedef {import("./running.js").Listener} Listener */
/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").SourceState} SourceState */
/** @typedef {import("../messages.d.ts").Command} Command */
/** @typedef {import("./fitter.js").Fitter} Fitter */
/** @typedef {import("./keeper.js").Keeper} Keeper */
/** @typedef {import("./session.js").Unit} Unit */
/** @typedef {import("./sources.js").Source} Source */

/**
 * Data of the page, written by `flinders.apps.live.standalone.package.page_data`.
 * @typedef {object} PageData
 * @property {string} version
 * @property {import("./sources.js").Simulation} simulated
 * @property {import("./data.d.ts").EngineData} engine
 * @property {import("./geomag.js").Model} model  of the earth's field
 * @property {Record<string, string>} unfit  reasons why a calibration cannot be renewed
 * @property {import("./patterns.js").Rules} lines  with patterns as objects
 * @property {import("./columns.js").ChipSetting[]} chips  of which a count is so much
 * @property {any} targets
 * @property {[name: string, description: string][]} bodies  that carry a sensor
 * @property {import("../plan.js").PlannedRecording[]} plans  for each body at some levels of noise
 */

/**
 * The user's choice of the magnetometer's columns; null without a choice.
 * @typedef {(unclear: import("./tables.js").Unclear) => Promise<import("./tables.js").Choice | null>} Choose
 */

const UPLOAD_BYTES = 64 << 20;
const IN_BROWSER = "this browser";
/** Style of a report. */
const SHEET = "static/report.css";
/** Target for sending to a board. */
const PACKET = "motioncal";
/** Kinds of sources whose readings cannot be repeated. */
const ONCE = ["serial", "phone"];
/** @type {SourceState} */
const NO_SOURCE = { name: "no source", kind: "simulated", link: "waiting", words: "" };

export class OwnLink extends SessionLink {
    /**
     * @param {Listener} listener
     * @param {PageData} data
     * @param {Fitter} fitter
     * @param {Keeper} keeper
     */
    constructor(listener, data, fitter, keeper) {
        super(listener, fitter, data);
        this.data = data;
        this.keeper = keeper;
        /** @type {Source | null} */
        this.source = null;
        /** @type {import("./buffer.js").Rows[]} */
        this.queue = [];
        this.unit = this.session.live.unit;
        /** Number of readings that the user has saved. */
        this.saved = 0;
        /**
         * The latest calibration.
         * @type {{evaluated: import("./session.js").Evaluated, shown: Finished, calibration: import("./targets.js").Calibration | null} | null}
         */
        this.made = null;
        /** @type {Choose} */
        this.choose = async () => null;
        /** Called after a change of the source or the opening of a log. */
        this.onChange = () => {};
        keeper.onFull = () => {
            this.session.recording = "";
            this.tell(phrase("link.full", "The browser's storage is full: save the readings with Finish, Readings."), "error");
        };
        queueMicrotask(() => this.renew());
    }

    /** Whether closing the page would lose readings of a sensor. */
    get isUnsaved() {
        return ONCE.includes(this.session.source.kind) && this.session.live.buffer.total > this.saved;
    }

    /** Whether the page has a source or readings. */
    get isUsed() {
        return this.source !== null || this.session.shown.buffer.total > 0;
    }

    // Requests of the page -------------------------------------------------------------------------------------------

    retry() {}

    get greeting() {
        return { version: this.data.version, targets: targetsOf(this.data), limits: { upload_bytes: UPLOAD_BYTES } };
    }

    /** @param {Command} message */
    send(message) {
        if (message.type === "clear" && this.session.opened === null) this.forget();
        if (message.type === "back_to_live") queueMicrotask(() => this.onChange());
        const isHeard = super.send(message);
        if (ONCE.includes(this.session.source.kind)) this.keeper.note(this.session.edits);
        return isHeard;
    }

    /**
     * Open a log in place of the sensor.
     * @param {string} name
     * @param {Blob} content
     */
    async open(name, content) {
        const bytes = new Uint8Array(await content.arrayBuffer());
        const log = await this.read(name, bytes);
        const series = seriesOf(this.session.rules, { ...log, unit: unitOf(log) });
        this.session.openedLog(this.now, name, series);
        this.isUrgent = true;
        this.tell(log.words.join("; "));
        this.step();
        this.onChange();
    }

    /**
     * Read a log; the user chooses its columns if names are ambiguous.
     * @param {string} name
     * @param {Uint8Array} bytes
     */
    async read(name, bytes) {
        try {
            return readLog(this.data, name, bytes);
        } catch (error) {
            const choice = error instanceof Unclear ? await this.choose(error) : null;
            return readable(() => readLog(this.data, name, bytes, choice));
        }
    }

    /**
     * Store a calibration file to compare with.
     * @param {string} name
     * @param {Blob} content
     */
    async previous(name, content) {
        const text = await content.text();
        const calibration = readable(() => readCalibration(text, this.data), `${name}: `);
        this.session.gotPrevious(this.now, { name, calibration });
        this.isUrgent = true;
        this.step();
    }

    /** @param {string} target */
    async exported(target) {
        const calibration = this.calibrationMade();
        try {
            return exported(this.data, target, calibration);
        } catch (error) {
            throw error instanceof NotExportable ? new Refusal(error.message) : error;
        }
    }

    /**
     * @param {import("./running.js").FileName} name
     * @returns {Promise<[Blob, string]>}
     */
    async file(name) {
        if (name === "calibration.json") return [this.calibration(), name];
        if (name === "report.html") return [await this.report(), name];
        const { shown, opened } = this.session;
        if (opened === null) this.saved = shown.buffer.total;
        return [tableOf(shown), "readings.csv"];
    }

    /** The file of the latest calibration. */
    calibration() {
        const { isRenewed, previous } = this.session;
        const files = isRenewed && previous ? previous.calibration.files : [];
        const provenance = { flinders: this.data.version, date: new Date().toISOString().replace(/\.\d+Z$/, "Z"), files };
        return new Blob([calibrationFile(this.data, this.calibrationMade(), { fit: this.made?.evaluated.record ?? null, provenance })]);
    }

    /** The report of the latest calibration. */
    async report() {
        const finished = this.made?.shown;
        if (!finished?.view) throw new Refusal(finished?.refusal || noneYet());
        const sheet = await fetch(SHEET);
        if (!sheet.ok) throw new Refusal(phrase("link.no-sheet", "The page's {file} cannot be had ({status}): load the page again.", { file: SHEET, status: sheet.status }));
        const { field } = this.session.task(Infinity);
        const style = await sheet.text();
        return inEnglish(() => new Blob([reportPage({ finished, state: sessionState(this.session), field, version: this.data.version }, style)]));
    }

    /** Send the calibration to the board of the readings. */
    async sendToBoard() {
        if (!(this.source instanceof Board) || this.session.opened) throw new Refusal(phrase("link.no-board", "This source cannot receive a calibration: save it, or paste the export."));
        const packet = exported(this.data, PACKET, this.calibrationMade()).binary_base64 ?? "";
        return `${this.source.name}: ${await send(this.source, bytesOf(packet))}`;
    }

    /** Fit all readings in memory that are not left out. @returns {Promise<Finished>} */
    async finish() {
        this.freeze();
        const { openedName, source, shown: { unit } } = this.session;
        const { evaluated } = await this.fitter.fit(this.session.task(Infinity));
        const shown = { name: openedName || source.name, view: evaluated.view, refusal: evaluated.refusal };
        this.made = { evaluated, shown, calibration: calibrationOf(evaluated.view, unit, shown.name) };
        return shown;
    }

    /** Return the latest calibration. */
    calibrationMade() {
        if (!this.made?.calibration) throw new Refusal(this.made?.shown.refusal || noneYet());
        return this.made.calibration;
    }

    // Sources ----------------------------------------------------------------------------------------------------------

    /**
     * Use a source from now on. Readings of another kind of source are dropped.
     * @param {Source} source
     * @throws {Refusal} If readings would be lost.
     */
    async use(source) {
        const { session } = this;
        this.drain();
        const isOther = source.kind !== session.source.kind || source.name !== session.source.name;
        if (isOther && this.isUnsaved) {
            throw new Refusal(phrase("link.unsaved", "There are readings of {name}: save them with Finish, Readings, and press Start again first.", { name: sourceTitle(session.source.name) }));
        }
        if (this.source) {
            await this.source.stop();
            this.linked("ended", "");
        }
        if (session.opened) session.requested(this.now, { type: "back_to_live" });
        if (isOther) this.empty();
        await this.start(source);
        this.show({ name: source.name, kind: source.kind, link: "waiting", words: "" });
    }

    /**
     * Start a source, which is used until another one replaces it.
     * @param {Source} source
     */
    async start(source) {
        this.source = source;
        const isNow = () => this.source === source;
        try {
            await source.start({
                take: (rows, unit) => isNow() && this.take(rows, unit),
                link: (link, words) => isNow() && this.linked(link, words),
                tell: (words, severity) => isNow() && this.tell(words, severity),
                choose: (unclear) => this.choose(unclear),
            });
        } catch (error) {
            this.source = null;
            throw error;
        }
    }

    /** @param {SourceState} source  its state */
    show(source) {
        this.session.source = source;
        this.session.hasBoard = source.kind === "serial";
        this.session.recording = ONCE.includes(source.kind) && this.keeper.isOpen ? IN_BROWSER : "";
        this.isUrgent = true;
        this.step();
        this.onChange();
    }

    /**
     * Show the stored readings from before the page was reloaded.
     * @returns {Promise<void>}
     */
    async restore() {
        const [kept, edits] = [await this.keeper.readings(), await this.keeper.edits()];
        if (kept === null) return;
        const { name, kind, unit } = kept;
        if (edits) this.session.adopt(this.now, edits);
        this.session.arrived(this.now, kept, unit);
        const words = phrase("link.kept", "these are the readings of {name} from before this page was loaded again: choose it as source to go on", { name: sourceTitle(name) });
        this.show({ name, kind, link: "ended", words });
        this.tell(words);
    }

    /** @param {{time: ArrayLike<number>, field: ArrayLike<number>}} rows @param {Unit} unit */
    take(rows, unit) {
        this.queue.push(rows);
        this.unit = unit;
    }

    /** @param {SourceState["link"]} link @param {string} words */
    linked(link, words) {
        this.drain();
        for (const said of this.session.linked(this.now, link, words)) this.listener.onMessage(said);
        this.isUrgent = true;
    }

    /** Start again without readings. */
    empty() {
        this.session.requested(this.now, { type: "clear" });
        this.forget();
    }

    /** Delete stored readings that the page has dropped. */
    forget() {
        this.saved = 0;
        this.keeper.clear();
        if (this.source === null) this.show(NO_SOURCE);
    }

    /** Add queued readings to the session. */
    drain() {
        const { source, live } = this.session;
        const { unit } = this;
        const before = live.buffer.total;
        if (this.queue.length === 0) return;
        for (const rows of this.queue.splice(0)) this.session.arrived(this.now, rows, unit);
        if (ONCE.includes(source.kind)) this.keeper.add({ name: source.name, kind: source.kind, unit }, live.buffer, before);
    }
}

/**
 * Content of a file; throws a refusal with a message if it cannot be read.
 * @template T
 * @param {() => T} read
 * @param {string} before  prefix of the message
 * @returns {T}
 */
function readable(read, before = "") {
    try {
        return read();
    } catch (error) {
        throw error instanceof Unreadable ? new Refusal(before + error.message) : error;
    }
}

/**
 * Calibration of a fit for export; null without one.
 * @param {import("../../../../static/view.d.ts").View | null} view
 * @param {Unit} unit
 * @param {string} name  of the recording
 * @returns {import("./targets.js").Calibration | null}
 */
function calibrationOf(view, unit, name) {
    if (!view?.offset || !view.matrix || view.field_strength === null) return null;
    const { verdict, findings, sentence } = view;
    const limits = findings.slice(1).filter(({ severity }) => severity === "limits").map(({ advice }) => `limited: ${advice}`);
    return {
        matrix: view.matrix,
        offset: view.offset,
        fieldStrength: view.field_strength,
        fieldStrengthKnown: view.field_strength_known,
        unit: unit.inside === "uT" ? "uT" : "counts",
        raw: { unit: unit.recorded, scale: unit.scale },
        about: [`from ${name}`, `the calibration is ${verdict}. ${sentence}`, ...limits],
    };
}

/** @returns {string} */
function noneYet() {
    return phrase("line.none-yet", "There is no calibration yet.");
}
