/**
 * A session without a server: what `flinders.live.session` decides, for one page.
 *
 * It knows no clock, source or worker: each event carries its time. `tests/agreement/test_page_sessions.py` holds it and
 * the server's to one table of events.
 */

import { Exclusions, merged, ReadingBuffer, Timeline } from "./buffer.js";

/** @typedef {import("./buffer.js").Rows} Rows */
/** @typedef {import("./buffer.js").Span} Span */
/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("../messages.d.ts").SourceState} SourceState */
/** @typedef {import("../messages.d.ts").ToServer} ToServer */
/** @typedef {import("../messages.d.ts").View} View */

/**
 * The numbers that the server decides by, from `flinders.standalone.session`.
 * @typedef {object} Rules
 * @property {number} capacity
 * @property {number} shown
 * @property {number} frame_points
 * @property {number} fitted
 * @property {number} share
 * @property {number} fastest_s
 * @property {number} rate_s
 * @property {number} enough_fits
 * @property {number} sure_s
 * @property {number} whole
 * @property {number} settled_s
 * @property {number} lasting_s
 * @property {number} silent_s
 * @property {number} silent_steps
 * @property {number} level_deg
 * @property {number} assumed_dip_deg
 * @property {number} largest_dip_deg
 */

/**
 * The unit that readings are in, the one they were recorded in, and what one of that is in the first.
 * @typedef {{inside: string, recorded: string, scale: number}} Unit
 */

/** @type {Unit} */
const COUNTS = { inside: "counts", recorded: "counts", scale: 1 };

/**
 * A calibration from before, by the name of its file.
 * @typedef {{name: string, calibration: import("./targets.js").Calibration}} Previous
 */

/**
 * Result of a fit.
 * @typedef {object} Evaluated
 * @property {number} key  of the series that was fitted
 * @property {View | null} view
 * @property {string} refusal
 * @property {string} refusalCode
 * @property {Reason[]} reasons
 * @property {number} used
 * @property {number} rejected
 * @property {number} coverage  share of the sphere that has been seen
 * @property {string[]} alarms  codes of reasons that more turning may end
 * @property {object | null} record  the part `fit` of a calibration file
 * @property {import("../messages.d.ts").PreviousState | null} previous
 */

/**
 * What is to be fitted.
 * @typedef {object} Task
 * @property {number} key
 * @property {Float64Array} field
 * @property {Float64Array | null} time
 * @property {Uint32Array} numbers  which reading of the session each of them is
 * @property {string} unit
 * @property {number} targetDeg
 * @property {number} dipDeg
 * @property {boolean} dipAssumed
 * @property {"heading" | "attitude"} goal
 * @property {Previous | null} previous
 * @property {boolean} [isFollowed]  somebody turns the sensor just now, and may be led
 */

/** @type {Evaluated} */
const NO_FIT = { key: -1, view: null, refusal: "", refusalCode: "", reasons: [], used: 0, rejected: 0, coverage: 0, alarms: [], record: null, previous: null };
const A_LOG = "a log is shown, and nothing arrives in it: go back to the sensor first";
const NO_PLACE = "this page has no model of the earth's field: look up the inclination at your place, and type it as dip";

/** Readings that are fitted together: those of the sensor, or of a log. */
export class Series {
    /**
     * @param {number} capacity
     * @param {Unit} unit
     * @param {boolean} isTimed
     */
    constructor(capacity, unit = COUNTS, isTimed = true) {
        this.buffer = new ReadingBuffer(capacity);
        this.unit = unit;
        this.isTimed = isTimed;
        this.exclusions = new Exclusions();
        /** @type {number | null} since when what arrives is left out */
        this.pausedAt = null;
        this.generation = 1;
        /** Changes with all that a fit depends on; no fit with a key below `since` is of these readings. */
        this.key = 0;
        this.since = 0;
        this.evaluated = NO_FIT;
        /** @type {number | null} when the first of the fits in a row was made that have alarms; -Infinity for good */
        this.alarmedAt = null;
        /** @type {number[]} when the fits in a row were done that are within the target, the first of them */
        this.within = [];
    }

    /** Excluded stretches, with the present pause. */
    get excluded() {
        const { spans } = this.exclusions;
        const { seconds } = this.buffer;
        if (this.pausedAt === null || seconds < this.pausedAt) return spans;
        return merged([...spans, [this.pausedAt, seconds]]);
    }
}

export class Session {
    /** @param {Rules} rules */
    constructor(rules) {
        this.rules = rules;
        /** @type {SourceState} */
        this.source = { name: "no source", kind: "simulated", link: "waiting", words: "" };
        this.live = new Series(rules.capacity);
        this.timeline = new Timeline();
        /** @type {Series | null} */
        this.opened = null;
        this.openedName = "";
        this.targetDeg = 1;
        /** @type {number | null} */
        this.dipDeg = null;
        /** @type {"heading" | "attitude"} */
        this.goal = "heading";
        /** @type {Previous | null} */
        this.previous = null;
        this.recording = "";
        this.revision = 0;
        this.keys = 0;
        this.generations = 1;
        this.isFitting = false;
        this.fitFrom = 0;
        this.dueAt = 0;
        this.at = 0;
        this.arrivedAt = 0;
        /** @type {[number, number, number][]} of the last two seconds and the one before: when, time of the last, how many */
        this.arrivals = [];
    }

    /** The series that the page shows and commands act on. */
    get shown() {
        return this.opened ?? this.live;
    }

    /** @returns {[number, boolean]} The dip that is judged at, and whether it is assumed. */
    get judgedDip() {
        return this.dipDeg === null ? [this.rules.assumed_dip_deg, true] : [this.dipDeg, false];
    }

    /** @param {number} at */
    ticked(at) {
        this.at = at;
    }

    /**
     * Add readings to those of the sensor; also while a log is shown.
     * @param {number} at
     * @param {Rows} rows
     * @param {Unit} unit
     */
    arrived(at, rows, unit) {
        this.at = at;
        const { length } = rows.time;
        if (length === 0) return;
        const { live } = this;
        live.buffer.extend({ time: this.timeline.take(rows.time), field: rows.field });
        live.unit = unit;
        if (live.pausedAt === null) live.key = ++this.keys;
        if (this.source.link !== "connected") this.source = { ...this.source, link: "connected", words: "" };
        const old = this.arrivals.filter(([when]) => when <= at - this.rules.rate_s).length;
        this.arrivals = [...this.arrivals.slice(Math.max(old - 1, 0)), [at, this.timeline.at, length]];
        this.arrivedAt = at;
        this.revision += 1;
    }

    /**
     * Note that the link has changed, and say so.
     * @param {number} at
     * @param {SourceState["link"]} link
     * @param {string} words
     * @returns {Notice[]}
     */
    linked(at, link, words) {
        this.at = at;
        if (link === this.source.link && words === this.source.words) return [];
        this.source = { ...this.source, link, words };
        this.revision += 1;
        return words && link !== "ended" ? [notice(words, link === "gone" ? "warning" : "info")] : [];
    }

    /**
     * Show a log in place of the sensor.
     * @param {number} at
     * @param {string} name
     * @param {Series} series
     */
    openedLog(at, name, series) {
        this.at = at;
        series.generation = ++this.generations;
        this.opened = series;
        this.openedName = name;
        this.#alone();
    }

    /**
     * Take a calibration to compare with.
     * @param {number} at
     * @param {Previous} previous
     */
    gotPrevious(at, previous) {
        this.at = at;
        this.previous = previous;
        this.#refit();
    }

    /**
     * Carry out a command; one that changes nothing is no step.
     * @param {number} at
     * @param {ToServer} command
     * @returns {Notice[]}
     */
    requested(at, command) {
        this.at = at;
        switch (command.type) {
            case "target":
                return this.#wish("targetDeg", command.deg);
            case "dip":
                return this.#wish("dipDeg", command.deg);
            case "goal":
                return this.#wish("goal", command.goal);
            case "previous_clear":
                return this.#wish("previous", null);
            case "place":
                return [notice(NO_PLACE, "warning")];
            case "exclude":
                return this.#exclude(command.start_s, command.end_s);
            case "restore":
                return this.#edit((exclusions) => exclusions.restoring([command.start_s, command.end_s]));
            case "undo":
                return this.#edit((exclusions) => exclusions.undone());
            case "redo":
                return this.#edit((exclusions) => exclusions.redone());
            case "pause":
                return this.#pause(command.paused);
            case "clear":
                return this.#clear();
            case "back_to_live":
                return this.#backToLive();
            default:
                return [];
        }
    }

    /** Whether somebody turns the sensor just now, and may be led. */
    get isFollowed() {
        return this.opened === null && this.live.pausedAt === null && this.source.link === "connected";
    }

    /** Mark the shown series as changed, so that it is fitted again soon. */
    #refit() {
        this.shown.key = ++this.keys;
        this.dueAt = Math.min(this.dueAt, this.at);
        this.revision += 1;
    }

    /** Fit the shown series anew, and accept no fit that was begun before. */
    #alone() {
        this.#refit();
        this.shown.since = this.keys;
    }

    /**
     * Change what the calibration is compared with.
     * @template {"targetDeg" | "dipDeg" | "goal" | "previous"} Name
     * @param {Name} name
     * @param {this[Name]} value
     * @returns {Notice[]}
     */
    #wish(name, value) {
        if (this[name] === value) return [];
        this[name] = value;
        this.shown.within = [];
        this.#refit();
        return [];
    }

    /**
     * @param {(exclusions: Exclusions) => Exclusions} edit
     * @returns {Notice[]}
     */
    #edit(edit) {
        const exclusions = edit(this.shown.exclusions);
        if (exclusions === this.shown.exclusions) return [];
        this.shown.exclusions = exclusions;
        this.#refit();
        return [];
    }

    /**
     * Exclude a stretch, as far as readings have come: later ones are never excluded.
     * @param {number} start
     * @param {number} end
     */
    #exclude(start, end) {
        const { buffer } = this.shown;
        if (buffer.total === 0) return [];
        /** @type {Span} */
        const span = [Math.max(start, Math.min(buffer.time[0], 0)), Math.min(end, buffer.seconds)];
        return span[0] > span[1] ? [] : this.#edit((exclusions) => exclusions.excluding(span));
    }

    /**
     * Exclude new readings from now on, or no longer: a pause is an exclusion that can be undone.
     * @param {boolean} paused
     */
    #pause(paused) {
        const { live } = this;
        if (this.opened !== null) return [notice(A_LOG, "warning")];
        if (paused === (live.pausedAt !== null)) return [];
        const { total, seconds } = live.buffer;
        if (paused) {
            live.pausedAt = total > 0 ? nextAfter(seconds) : 0;
            this.revision += 1;
            return [];
        }
        if (live.pausedAt !== null && seconds > live.pausedAt) live.exclusions = live.exclusions.excluding([live.pausedAt, seconds]);
        live.pausedAt = null;
        this.#refit();
        return [];
    }

    /** Begin anew without readings. */
    #clear() {
        if (this.opened !== null) return [notice("a log is shown, which cannot be started again: go back to the sensor first", "warning")];
        const { unit, buffer } = this.live;
        this.live = new Series(buffer.most, unit);
        this.live.generation = ++this.generations;
        this.live.key = this.live.since = ++this.keys;
        this.arrivals = [];
        this.revision += 1;
        return [notice("started again", "info")];
    }

    /** Close the log. */
    #backToLive() {
        if (this.opened === null) return [];
        this.opened = null;
        this.openedName = "";
        this.live.generation = ++this.generations;
        this.#alone();
        return [];
    }

    /**
     * Whether something changed since the last fit, none is running, and one is due, or the source has ended.
     * @param {number} at
     * @returns {boolean}
     */
    wantsFit(at) {
        const { buffer, evaluated, key } = this.shown;
        const isNew = buffer.total > 0 && evaluated.key !== key;
        return isNew && !this.isFitting && (at >= this.dueAt || this.source.link === "ended");
    }

    /**
     * Readings that are not left out, at most so many, spread evenly; a fit of them runs from now on.
     * @returns {Task}
     */
    beginFit() {
        this.isFitting = true;
        this.fitFrom = this.at;
        return { ...this.task(this.rules.fitted), isFollowed: this.isFollowed };
    }

    /**
     * @param {number} most
     * @returns {Task}
     */
    task(most) {
        const { shown } = this;
        const { time, field, stride } = shown.buffer;
        const all = shown.buffer.outside(shown.excluded);
        const step = Math.max(Math.ceil(all.length / most), 1);
        const used = all.filter((_, i) => i % step === 0);
        const [dipDeg, dipAssumed] = this.judgedDip;
        return {
            key: shown.key,
            field: Float64Array.from({ length: 3 * used.length }, (_, i) => field[3 * used[Math.floor(i / 3)] + (i % 3)]),
            time: Float64Array.from(used, (place) => time[place]),
            numbers: used.map((place) => place * stride),
            unit: labelOf(shown.unit),
            targetDeg: this.targetDeg,
            dipDeg,
            dipAssumed,
            goal: this.goal,
            previous: this.previous,
        };
    }

    /**
     * Take a fit over, unless it is of another series than the shown one.
     * @param {number} at
     * @param {Evaluated} evaluated
     * @param {number} seconds  that it took
     */
    fitDone(at, evaluated, seconds) {
        const { rules, shown } = this;
        const begun = this.fitFrom;
        this.at = at;
        this.isFitting = false;
        this.dueAt = at + Math.max(seconds / rules.share, rules.fastest_s);
        const { key } = evaluated;
        if (key < Math.max(shown.since, shown.evaluated.key + 1) || key > shown.key) return;
        shown.alarmedAt = this.#alarmedAt(begun, evaluated);
        shown.evaluated = evaluated;
        shown.within = this.#isWithin(evaluated) ? [...shown.within, at].slice(0, rules.enough_fits) : [];
        this.revision += 1;
    }

    /**
     * When the first of the fits in a row was made that have alarms; what has become one remains it.
     * @param {number} begun
     * @param {Evaluated} evaluated
     */
    #alarmedAt(begun, { alarms }) {
        if (alarms.length === 0) return null;
        return this.#isAlarmed(begun) ? -Infinity : (this.shown.alarmedAt ?? begun);
    }

    /** @param {number} at @returns {boolean} Whether alarms have lasted long enough, so that more turning would not end them. */
    #isAlarmed(at) {
        const { alarmedAt, evaluated } = this.shown;
        const { whole, settled_s, lasting_s } = this.rules;
        return alarmedAt !== null && at - alarmedAt >= (evaluated.coverage >= whole ? settled_s : lasting_s);
    }

    /** Whether the newest fit is of all readings, and no more come: of a log, in a pause, of a silent sensor. */
    get isOver() {
        const { shown, source } = this;
        const hasEnded = shown.pausedAt !== null || ["ended", "gone"].includes(source.link);
        const isSilent = hasEnded || this.at - this.arrivedAt >= this.rules.sure_s;
        return shown.evaluated.key === shown.key && (this.opened !== null || isSilent);
    }

    /** @param {string} code @returns {boolean} Whether more turning would not end what a reason says. */
    isSettled(code) {
        return !this.shown.evaluated.alarms.includes(code) || this.isOver || this.#isAlarmed(this.at);
    }

    /** @param {View} view @returns {number | null} The error that is compared with the target. */
    worstDeg({ heading_error_deg: error, guidance }) {
        if (error === null || guidance === null) return null;
        return this.goal === "heading" ? error.worst : Math.max(error.worst, guidance.worst_deg);
    }

    /** @param {Evaluated} evaluated @returns {boolean} Whether the target is reached, and nothing speaks against it. */
    #isWithin({ view, reasons }) {
        const worst = view && this.worstDeg(view);
        const isClean = reasons.every(({ severity }) => severity !== "warning");
        return view !== null && worst !== null && worst <= this.targetDeg && isClean && view.verdict !== "refused";
    }
}

/**
 * @param {string} words
 * @param {Notice["severity"]} severity
 * @returns {Notice}
 */
export function notice(words, severity) {
    return { type: "notice", severity, words };
}

/**
 * The next number above one that is not negative.
 * @param {number} value
 * @returns {number}
 */
function nextAfter(value) {
    const numbers = new Float64Array([value]);
    const bits = new BigInt64Array(numbers.buffer);
    bits[0] += value < 0 ? -1n : 1n;
    return numbers[0];
}

/**
 * A log as a series of its own; without times, a reading counts a second.
 * @param {Rules} rules
 * @param {{time: Float64Array | null, field: Float64Array, unit: Unit}} log
 * @returns {Series}
 */
export function seriesOf(rules, { time, field, unit }) {
    const series = new Series(rules.capacity, unit, time !== null);
    const times = time ?? Float64Array.from({ length: field.length / 3 }, (_, i) => i);
    series.buffer.extend({ time: new Timeline().take(times), field });
    return series;
}

/** @param {Unit} unit @returns {string} As the page shows it. */
export function labelOf({ inside }) {
    return inside === "uT" ? "µT" : inside;
}
