/**
 * A session: readings, what a person does to them, and the fits of them. `edits` is what others have to know of it.
 *
 * It knows no clock, source or worker: each event carries its time, so that a list of events is a test.
 */

import { Exclusions, mergeSpans, ReadingBuffer, Timeline } from "./buffer.js";
import { siteField } from "./geomag.js";
import { fixedText, general } from "./numbers.js";
import { fillTemplate } from "./wording.js";
import { numeral, phrase } from "../language.js";

/** @typedef {import("./buffer.js").Rows} Rows */
/** @typedef {import("./buffer.js").Span} Span */
/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("../messages.d.ts").SourceState} SourceState */
/** @typedef {import("../messages.d.ts").Command} Command */
/** @typedef {import("../wire.d.ts").Edits} Edits */
/** @typedef {import("../../../../static/view.d.ts").View} View */

/** Numbers that a session decides by. */
export const RULES = Object.freeze({
    /** Readings in memory, shown, and of a fit, at most. */
    capacity: 1 << 20,
    shown: 40_000,
    fitted: 20_000,
    /** Of a core, that fits take, and seconds from one to the next, at the least. */
    share: 0.03,
    fastest_s: 0.25,
    rate_s: 2,
    /** Fits in a row that have to be within the target before that is said, or two of them so many seconds apart. */
    enough_fits: 3,
    sure_s: 1,
    /** Share of the sphere beyond which findings that last so many seconds are an alarm, and seconds after which any are. */
    whole: 0.95,
    settled_s: 5,
    lasting_s: 75,
    /** Seconds without a reading after which that is said; or so many usual steps of a slow sensor. */
    silent_s: 3,
    silent_steps: 5,
    /** Seconds of worse fits after which something is said to have changed since a fit that is kept. */
    changed_s: 2,
    /** A calibration that is good to so much tilt needs no word about tilt. */
    level_deg: 89,
    assumed_dip_deg: 60,
    /** Of the field that the model has at a place: what gains are usually off by, and the dip of a place. */
    gain_sigma: 0.05,
    inclination_sigma_deg: 1,
});

/**
 * The unit that readings are in, the one they were recorded in, and what one of that is in the first.
 * @typedef {{inside: string, recorded: string, scale: number}} Unit
 */

/** @type {Unit} */
export const MICROTESLA = { inside: "uT", recorded: "uT", scale: 1 };
/** @type {Unit} */
export const COUNTS = { inside: "counts", recorded: "counts", scale: 1 };

/**
 * A calibration from before, by the name of its file.
 * @typedef {{name: string, calibration: import("./targets.js").Known}} Previous
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
 * @property {Float64Array | null} acceleration  beside each of them, where it was recorded
 * @property {"sensor" | "vehicle"} frame  whose axes advice is given in
 * @property {string} axes  that readings are in, as `--axes` takes them
 * @property {Uint32Array} numbers  which reading of the session each of them is
 * @property {string} unit
 * @property {number} targetDeg
 * @property {number} dipDeg
 * @property {boolean} dipAssumed
 * @property {"heading" | "attitude"} goal
 * @property {boolean} isFollowed  somebody turns the sensor just now, and may be led
 * @property {Previous | null} previous
 * @property {Site | null} site  what counts of the place
 * @property {boolean} isRenewed  its soft iron is kept, and its hard iron found anew
 */

/**
 * The field at a place, and the sensor's mounting, named as in `flinders_site`; null where unknown.
 * @typedef {object} Site
 * @property {number | null} [strength]
 * @property {number | null} [gain_sigma]
 * @property {number | null} [inclination_deg]
 * @property {number | null} [inclination_sigma_deg]
 * @property {number | null} [alignment_sigma_deg]
 * @property {boolean} [z_down]
 */

/**
 * A fit that is kept: of the readings up to a time, whatever comes later.
 * @typedef {{evaluated: Evaluated, view: View, seconds: number}} Kept
 */

/** @type {Evaluated} */
const NO_FIT = { key: -1, view: null, refusal: "", refusalCode: "", reasons: [], used: 0, rejected: 0, coverage: 0, alarms: [], record: null, previous: null };
/** A time after all others, s. */
const END = 1e9;
const LARGEST_DIP_DEG = 89;

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
        /** Number of a log that a server holds. */
        this.number = "";
        /** @type {"sensor" | "vehicle"} whose axes readings are in */
        this.frame = "sensor";
        /** The recorded axes that these are, as `--axes` takes them. */
        this.axes = "x,y,z";
        /** @type {number | null} it was begun anew then: readings up to that time are left behind */
        this.begunS = null;
        this.exclusions = new Exclusions();
        /** @type {Site | null} where it was recorded */
        this.site = null;
        /** @type {number | null} since when what arrives is left out */
        this.pausedAt = null;
        /** @type {number | null} time of the last reading of a calibration that is finished: later ones wait */
        this.finishedS = null;
        this.generation = 1;
        /** Changes with all that a fit depends on; no fit with a key below `firstKey` is of these readings. */
        this.key = 0;
        this.firstKey = 0;
        this.evaluated = NO_FIT;
        /** @type {number | null} when the first of the fits in a row was made that have alarms; -Infinity for good */
        this.alarmedAt = null;
        /** @type {number[]} when the fits in a row were done that are within the target, the first of them */
        this.within = [];
        /** @type {Kept | null} the best fit that was within the target */
        this.kept = null;
        /** @type {number | null} when the first of the fits in a row was done that are worse than the kept one */
        this.lostAt = null;
    }

    /** Excluded stretches, with the present pause. */
    get excluded() {
        const { spans } = this.exclusions;
        const { seconds } = this.buffer;
        if (this.pausedAt === null || seconds < this.pausedAt) return spans;
        return mergeSpans([...spans, [this.pausedAt, seconds]]);
    }

    /** All that a fit does without: what is excluded, and what came after Finish. */
    get leftOut() {
        return this.finishedS === null ? this.excluded : mergeSpans([...this.excluded, [nextAfter(this.finishedS), END]]);
    }

    /** How many readings came after Finish. */
    get since() {
        return this.finishedS === null ? 0 : this.buffer.countWithin([[nextAfter(this.finishedS), END]]);
    }
}

export class Session {
    /**
     * @param {{model?: import("./geomag.js").Model | null, unfit?: Record<string, string>}} data  the model of the earth's
     *   field, and why a calibration cannot be renewed, by reason
     */
    constructor({ model = null, unfit = {} } = {}, rules = RULES) {
        this.model = model;
        this.unfit = unfit;
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
        /** Its soft iron is kept, and its hard iron found anew. */
        this.refreshes = false;
        this.recording = "";
        /** Why what arrives cannot be written down; nothing where it can. */
        this.unrecorded = "";
        /** The source is a board that takes a calibration. */
        this.hasBoard = false;
        this.revision = 0;
        this.keys = 0;
        this.generations = 1;
        this.isFitting = false;
        this.fitFrom = 0;
        this.fitTo = 0;
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

    /** The fit that is kept, where the newest is worse; none once the calibration is finished. */
    get keptInstead() {
        const { lostAt, kept, finishedS } = this.shown;
        return lostAt === null || finishedS !== null ? null : kept;
    }

    /** The newest fit, or the one that is kept in its place. */
    get held() {
        return this.keptInstead?.evaluated ?? this.shown.evaluated;
    }

    /** What the page shows of it. */
    get view() {
        return this.held.view;
    }

    /** Whether the newest fits have been worse than the kept one for long enough to say that something changed. */
    get isChanged() {
        const { lostAt } = this.shown;
        return this.keptInstead !== null && lostAt !== null && (this.at - lostAt >= this.rules.changed_s || this.isOver);
    }

    /** Whether the calibration from before is renewed. */
    get isRenewed() {
        return this.refreshes && this.previous !== null;
    }

    /** @returns {[number, boolean]} The dip that is judged at, and whether it is assumed. */
    get judgedDip() {
        const known = this.dipDeg ?? this.shown.site?.inclination_deg ?? null;
        return known === null ? [this.rules.assumed_dip_deg, true] : [known, false];
    }

    /** Whether somebody turns the sensor just now, and may be led. */
    get isFollowed() {
        const { pausedAt, finishedS } = this.live;
        return this.opened === null && pausedAt === null && finishedS === null && this.source.link === "connected";
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
        if (this.source.link !== "connected") this.source = { ...this.source, link: "connected", words: "" };
        const before = live.buffer.seconds;
        live.buffer.extend({ ...rows, time: this.timeline.take(rows.time) });
        live.unit = unit;
        this.#came(at, length, before);
    }

    /**
     * Take readings that a server passes on, by its own timeline; those that came before this page are `isOld`.
     * @param {number} at
     * @param {import("./buffer.js").Passed} passed
     * @param {Unit} unit
     * @param {boolean} isOld
     */
    received(at, passed, unit, isOld) {
        this.at = at;
        const { live } = this;
        const { total, seconds } = live.buffer;
        live.buffer.follow(passed);
        live.unit = unit;
        this.timeline.at = live.buffer.seconds;
        this.#came(at, isOld ? 0 : live.buffer.total - total, seconds);
    }

    /** Forget the readings of the sensor, which come once more; what was done to them stands. */
    restart() {
        const { live } = this;
        live.buffer = new ReadingBuffer(live.buffer.most);
        this.arrivals = [];
        live.generation = ++this.generations;
        live.key = ++this.keys;
    }

    /**
     * Note that so many readings came; 0 of those that came long ago.
     * @param {number} at
     * @param {number} length
     * @param {number} before  time of the last reading before them
     */
    #came(at, length, before) {
        const { live } = this;
        const isPast = live.finishedS !== null && before >= live.finishedS;
        if (live.pausedAt === null && !isPast) live.key = ++this.keys;
        this.revision += 1;
        if (length === 0) return;
        const old = this.arrivals.filter(([when]) => when <= at - this.rules.rate_s).length;
        this.arrivals = [...this.arrivals.slice(Math.max(old - 1, 0)), [at, this.timeline.at, length]];
        this.arrivedAt = at;
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
        this.refreshes = false;
        this.#refit();
    }

    /** What was done to the readings of the sensor, for whoever keeps it. @returns {Edits} */
    get edits() {
        return this.#editsOf(this.live);
    }

    /** What the calibration in the end is made by: what was done to the readings that are shown. @returns {Edits} */
    get finishing() {
        return this.#editsOf(this.shown);
    }

    /** What tells one calibration from another: the same as long as nothing that it is made of has changed. */
    get fingerprint() {
        const renewed = this.isRenewed && this.previous?.calibration.offset;
        return JSON.stringify([this.opened?.generation ?? null, this.finishing, renewed]);
    }

    /** @param {Series} series @returns {Edits} */
    #editsOf({ exclusions, pausedAt, finishedS, begunS, site }) {
        return {
            type: "edits",
            excluded: exclusions.spans,
            paused_s: pausedAt,
            finished_s: finishedS,
            begun_s: begunS,
            target_deg: this.targetDeg,
            dip_deg: this.dipDeg,
            goal: this.goal,
            site: site && knownSite(site),
            refreshing: this.isRenewed,
        };
    }

    /**
     * Take over what was done on another page, or before.
     * @param {number} at
     * @param {Edits} edits
     */
    adopt(at, edits) {
        const before = this.#ofKept(this.edits);
        this.at = at;
        if (edits.begun_s !== this.live.begunS) this.#begin(edits.begun_s);
        const { live } = this;
        live.exclusions = live.exclusions.replaceSpans(edits.excluded);
        live.pausedAt = edits.paused_s;
        live.finishedS = edits.finished_s;
        live.site = edits.site;
        this.targetDeg = edits.target_deg;
        this.dipDeg = edits.dip_deg;
        this.goal = edits.goal;
        this.refreshes = edits.refreshing;
        this.shown.within = [];
        if (this.#ofKept(this.edits) !== before) this.#useAll();
        this.#refit();
    }

    /**
     * Carry out a command; one that changes nothing is no step.
     * @param {number} at
     * @param {Command} command
     * @returns {Notice[]}
     */
    requested(at, command) {
        this.at = at;
        const refusal = refusalOf(command);
        if (refusal) return [notice(refusal, "error")];
        switch (command.type) {
            case "target":
                return this.#wish("targetDeg", command.deg);
            case "dip":
                return this.#wish("dipDeg", command.deg);
            case "goal":
                return this.#wish("goal", command.goal);
            case "previous_clear":
                return this.#wish("previous", null);
            case "refresh":
                return this.#refresh(command.refresh);
            case "place":
                return this.#place(command);
            case "exclude":
                return this.#exclude(command.start_s, command.end_s);
            case "restore":
                return this.#edit((exclusions) => exclusions.restore([command.start_s, command.end_s]));
            case "undo":
                return this.#edit((exclusions) => exclusions.undo());
            case "redo":
                return this.#edit((exclusions) => exclusions.redo());
            case "pause":
                return this.#pause(command.paused);
            case "clear":
                return this.#clear();
            case "use_all":
                return this.#useAll();
            case "finish":
                return this.#finish();
            case "collect":
                return this.#collect();
            case "back_to_live":
                return this.#backToLive();
            default:
                return [];
        }
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
        this.shown.firstKey = this.keys;
    }

    /**
     * Change what the calibration is compared with.
     * @template {"targetDeg" | "dipDeg" | "goal" | "previous" | "refreshes"} Name
     * @param {Name} name
     * @param {this[Name]} value
     * @returns {Notice[]}
     */
    #wish(name, value) {
        if (this[name] === value) return [];
        this[name] = value;
        this.shown.within = [];
        this.#useAll();
        this.#refit();
        return [];
    }

    /**
     * Take dip and strength of a place.
     * @param {Extract<Command, {type: "place"}>} place
     * @returns {Notice[]}
     */
    #place({ latitude_deg: latitude, longitude_deg: longitude, year }) {
        const { model, rules: { gain_sigma, inclination_sigma_deg } } = this;
        if (model === null) return [];
        const wrong = placeRefusal(latitude, longitude) || yearRefusal(model, year);
        if (wrong) return [notice(wrong, "warning")];
        const { strength, inclinationDeg } = siteField(model, latitude, longitude, year);
        const dipDeg = Number(fixedText(inclinationDeg, 1));
        if (Math.abs(dipDeg) > LARGEST_DIP_DEG) {
            return [notice(phrase("session.steep", "the dip there is {dip}°: no compass works where it is beyond {limit}°", { dip: numeral(general(dipDeg)), limit: LARGEST_DIP_DEG }), "warning")];
        }
        this.shown.site = { strength, gain_sigma, inclination_deg: inclinationDeg, inclination_sigma_deg };
        this.shown.within = [];
        this.#refit();
        this.#wish("dipDeg", inclinationDeg);
        const values = { latitude: general(latitude), longitude: general(longitude), dip: general(dipDeg), strength: fixedText(strength, 1) };
        const texts = Object.fromEntries(Object.entries(values).map(([name, text]) => [name, numeral(text)]));
        return [notice(phrase("session.place", "the dip at {latitude}°, {longitude}° is {dip}°, the strength of the field {strength} µT ({model})", { ...texts, model: model.name }), "info")];
    }

    /**
     * What counts of the place: its strength for readings in a true unit, and its dip unless another is given.
     * @returns {Site | null}
     */
    get #site() {
        const { site, unit } = this.shown;
        if (site === null) return null;
        const strength = unit.inside === "uT" ? site.strength : null;
        const isItsDip = this.dipDeg === null || this.dipDeg === site.inclination_deg;
        const inclination_deg = isItsDip ? site.inclination_deg : null;
        return strength === null && inclination_deg === null ? null : { ...site, strength, inclination_deg };
    }

    /**
     * Renew the calibration from before, or make one afresh.
     * @param {boolean} isWanted
     * @returns {Notice[]}
     */
    #refresh(isWanted) {
        const words = isWanted ? renewalRefusal(this.previous, this.unfit) : "";
        return words ? [notice(words, "error")] : this.#wish("refreshes", isWanted);
    }

    /**
     * @param {(exclusions: Exclusions) => Exclusions} edit
     * @returns {Notice[]}
     */
    #edit(edit) {
        const exclusions = edit(this.shown.exclusions);
        if (exclusions === this.shown.exclusions) return exclusions.isFull ? [notice(phrase("session.full", "no more stretches can be told apart: leave out one longer stretch over several, or put some back"), "warning")] : [];
        this.shown.exclusions = exclusions;
        this.#useAll();
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
        return span[0] > span[1] ? [] : this.#edit((exclusions) => exclusions.exclude(span));
    }

    /**
     * Exclude new readings from now on, or no longer: a pause is an exclusion that can be undone.
     * @param {boolean} paused
     */
    #pause(paused) {
        const { live } = this;
        if (this.opened !== null) return [notice(phrase("session.log", "a log is shown, and nothing arrives in it: go back to the sensor first"), "warning")];
        if (live.finishedS !== null) return [notice(phrase("session.finished", "the calibration is finished: press Collect more first"), "warning")];
        if (paused === (live.pausedAt !== null)) return [];
        const { total, seconds } = live.buffer;
        if (paused) {
            live.pausedAt = total > 0 ? nextAfter(seconds) : 0;
            this.revision += 1;
            return [];
        }
        if (live.pausedAt !== null && seconds > live.pausedAt) live.exclusions = live.exclusions.exclude([live.pausedAt, seconds]);
        live.pausedAt = null;
        this.#refit();
        return [];
    }

    /**
     * Finish the calibration: it is of the readings so far, or of those up to the fit that is kept, whatever comes later.
     */
    #finish() {
        const { live, held, keptInstead } = this;
        if (this.opened !== null || live.finishedS !== null || live.buffer.total === 0) return [];
        live.finishedS = keptInstead?.seconds ?? live.buffer.seconds;
        live.evaluated = held;
        this.#refit();
        return [];
    }

    /** Take in what came since Finish, and go on. */
    #collect() {
        const { live } = this;
        if (live.finishedS === null) return [];
        live.finishedS = null;
        this.#pause(false);
        this.#refit();
        return [];
    }

    /** What a kept fit depends on: a pause, Finish, and what is left out after it, are not of it. @param {Edits} edits */
    #ofKept({ excluded, paused_s: _, finished_s: __, ...others }) {
        const until = this.live.kept?.seconds ?? -Infinity;
        return JSON.stringify([others, excluded.filter(([start]) => start <= until).map(([start, end]) => [start, Math.min(end, until)])]);
    }

    /** Keep no earlier fit: the newest counts. */
    #useAll() {
        if (this.shown.kept) this.revision += 1;
        Object.assign(this.shown, { kept: null, lostAt: null });
        return [];
    }

    /** Begin anew without readings. */
    #clear() {
        if (this.opened !== null) return [notice(phrase("session.log-again", "a log is shown, which cannot be started again: go back to the sensor first"), "warning")];
        const { buffer, begunS } = this.live;
        this.#begin(buffer.total > 0 ? buffer.seconds : begunS);
        return [notice(phrase("session.started", "started again"), "info")];
    }

    /** @param {number | null} begunS  time of the last reading that is left behind */
    #begin(begunS) {
        const { unit, buffer, frame, axes, site } = this.live;
        this.live = new Series(buffer.most, unit);
        Object.assign(this.live, { begunS, frame, axes, site, generation: ++this.generations, key: ++this.keys, firstKey: this.keys });
        this.arrivals = [];
        this.revision += 1;
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
        this.fitTo = Math.min(this.shown.buffer.seconds, this.shown.finishedS ?? Infinity);
        return this.task(this.rules.fitted);
    }

    /**
     * @param {number} most
     * @returns {Task}
     */
    task(most) {
        const { shown } = this;
        const { time, field, acceleration, stride } = shown.buffer;
        const all = shown.buffer.outside(shown.leftOut);
        const step = Math.max(Math.ceil(all.length / most), 1);
        const used = all.filter((_, i) => i % step === 0);
        const [dipDeg, dipAssumed] = this.judgedDip;
        return {
            key: shown.key,
            field: rowsOf(field, used),
            acceleration: acceleration && rowsOf(acceleration, used),
            time: shown.isTimed ? Float64Array.from(used, (place) => time[place]) : null,
            numbers: used.map((place) => place * stride),
            unit: labelOf(shown.unit),
            frame: shown.frame,
            axes: shown.axes,
            targetDeg: this.targetDeg,
            dipDeg,
            dipAssumed,
            goal: this.goal,
            previous: this.previous,
            isFollowed: this.isFollowed,
            site: this.#site,
            isRenewed: this.isRenewed,
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
        if (key < Math.max(shown.firstKey, shown.evaluated.key + 1) || key > shown.key) return;
        shown.alarmedAt = this.#alarmedAt(begun, evaluated);
        shown.evaluated = evaluated;
        shown.within = this.#isWithin(evaluated) ? [...shown.within, at].slice(0, rules.enough_fits) : [];
        this.#keep(at, evaluated);
        this.revision += 1;
    }

    /**
     * Keep a fit within the target that several in a row confirm, or that is finished, and that is no worse than the kept
     * one; note since when fits are worse.
     * @param {number} at
     * @param {Evaluated} evaluated
     */
    #keep(at, evaluated) {
        const { shown } = this;
        const { kept, within, finishedS } = shown;
        const { view } = evaluated;
        const isWorse = within.length === 0 || (kept?.view.verdict === "good" && view?.verdict !== "good");
        if (kept && isWorse) {
            shown.lostAt ??= at;
            return;
        }
        shown.lostAt = null;
        const isConfirmed = this.isRepeated || (finishedS !== null && within.length > 0);
        if (view && isConfirmed) shown.kept = { evaluated, view, seconds: this.fitTo };
    }

    /** Whether several fits in a row were within the target. */
    get isRepeated() {
        const { within } = this.shown;
        const { enough_fits, sure_s } = this.rules;
        return within.length >= enough_fits || (within.at(-1) ?? -Infinity) - (within[0] ?? 0) >= sure_s;
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

    /** Whether the newest fit is of all readings, and no more count: of a log, after Finish, in a pause, of a silent sensor. */
    get isOver() {
        const { shown, source } = this;
        const hasEnded = shown.finishedS !== null || shown.pausedAt !== null || ["ended", "gone"].includes(source.link);
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
 * Why there is no such place; nothing where there is.
 * @param {number} latitude
 * @param {number} longitude
 * @returns {string}
 */
function placeRefusal(latitude, longitude) {
    const isSwapped = Math.abs(latitude) <= 180 && Math.abs(longitude) <= 90;
    const swapped = isSwapped ? "; the latitude comes first" : "";
    if (!(Math.abs(latitude) <= 90)) return `latitude is ${general(latitude)}°: need −90° to 90°${swapped}`;
    if (longitude >= -180 && longitude <= 360) return "";
    return `longitude is ${general(longitude)}°: need −180° to 180°, east positive`;
}

/**
 * Why a year is not that of the model; nothing where it is.
 * @param {import("./geomag.js").Model} model
 * @param {number} year
 * @returns {string}
 */
function yearRefusal({ name, epoch, years }, year) {
    if (year >= epoch && year <= epoch + years) return "";
    const begin = `${general(year)} lies outside ${name}, from ${general(epoch)} to ${general(epoch + years)}`;
    return `${begin}: look up the inclination at your place, and type it as dip`;
}

/**
 * Why a calibration cannot be renewed; nothing where it can.
 * @param {Previous | null} previous
 * @param {Record<string, string>} words By reason.
 * @returns {string}
 */
function renewalRefusal(previous, words) {
    if (previous === null) return words.none;
    const { fit, disturbances, isLinearized, rotation } = previous.calibration;
    const why = {
        refused: fit?.verdict === "refused",
        level: Boolean(fit?.plane),
        disturbed: disturbances.length > 0,
        linearized: isLinearized,
        turned: rotation !== "symmetric",
    };
    const found = Object.entries(why).find(([, is]) => is);
    const values = { name: previous.name, disturbances: disturbances.join(" and ") };
    return found ? fillTemplate(words[found[0]], (name) => values[/** @type {keyof typeof values} */ (name)]) : "";
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
 * A log as a series.
 * @param {typeof RULES} rules
 * @param {{time: ArrayLike<number> | null, field: ArrayLike<number>, acceleration: ArrayLike<number> | null, unit: Unit}} log
 * @returns {Series}
 */
export function seriesOf(rules, { time, field, acceleration, unit }) {
    const series = new Series(rules.capacity, unit, time !== null);
    const times = time ?? Float64Array.from({ length: field.length / 3 }, (_, i) => i);
    series.buffer.extend({ time: new Timeline().take(times), field, acceleration });
    return series;
}

/**
 * Some rows of three numbers.
 * @param {Float64Array} numbers
 * @param {Uint32Array} rows
 * @returns {Float64Array}
 */
function rowsOf(numbers, rows) {
    return Float64Array.from({ length: 3 * rows.length }, (_, i) => numbers[3 * rows[Math.floor(i / 3)] + (i % 3)]);
}

/** @param {Unit} unit @returns {string} As the page shows it. */
export function labelOf({ inside }) {
    return inside === "uT" ? "µT" : inside;
}

/**
 * What is known of a site, without what is not, by name: the same for the same site.
 * @param {Site} site
 * @returns {import("../wire.d.ts").Site}
 */
export function knownSite(site) {
    return Object.fromEntries(Object.entries(site).filter(([, value]) => value !== null).sort());
}

/**
 * Why a command cannot be meant.
 * @param {Command} command
 * @returns {string}
 */
function refusalOf(command) {
    if (command.type === "target" && !(command.deg > 0 && command.deg <= 180)) return phrase("session.target", "the target is an angle above 0°, up to 180°");
    if (command.type === "dip" && !(Math.abs(command.deg) <= LARGEST_DIP_DEG)) return phrase("session.dip", "the dip is an angle from −{limit}° to {limit}°", { limit: LARGEST_DIP_DEG });
    const hasSpan = command.type === "exclude" || command.type === "restore";
    return hasSpan && !(command.start_s < command.end_s) ? phrase("session.stretch", "a stretch that is left out needs a start before its end") : "";
}
