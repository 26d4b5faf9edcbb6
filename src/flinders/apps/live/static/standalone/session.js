/**
 * A session: readings, the user's edits, and fits. `edits` is the part shared with servers and other pages.
 *
 * A session uses no clock, source or worker: each event has its time, so that tests are lists of events.
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

/** Limits and periods of a session. */
export const RULES = Object.freeze({
    /** Largest numbers of readings in memory, shown, and in a fit. */
    capacity: 1 << 20,
    shown: 40_000,
    fitted: 20_000,
    /** Largest share of a processor core for fits, and shortest time between fits, s. */
    share: 0.03,
    fastest_s: 0.25,
    rate_s: 2,
    /** Number of consecutive fits within the target, or time between two such fits, s, after which it is reported. */
    enough_fits: 3,
    sure_s: 1,
    /** Coverage and duration, s, after which findings become alarms; and the duration without regard to coverage. */
    whole: 0.95,
    settled_s: 5,
    lasting_s: 75,
    /** Time without a reading after which that is reported, s, or in steps of a slow sensor. */
    silent_s: 3,
    silent_steps: 5,
    /** Duration of worse fits, s, after which a change since the kept fit is reported. */
    changed_s: 2,
    /** Tilt, degrees, up to which a calibration within the target needs no remark on tilt. */
    level_deg: 89,
    assumed_dip_deg: 60,
    /** Uncertainties of the field at a place: typical gain errors of sensors, and the dip of the model. */
    gain_sigma: 0.05,
    inclination_sigma_deg: 1,
});

/**
 * The unit of readings, the recorded unit, and the size of the latter in the former.
 * @typedef {{inside: string, recorded: string, scale: number}} Unit
 */

/** @type {Unit} */
export const MICROTESLA = { inside: "uT", recorded: "uT", scale: 1 };
/** @type {Unit} */
export const COUNTS = { inside: "counts", recorded: "counts", scale: 1 };

/**
 * An earlier calibration, with the name of its file.
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
 * @property {number} coverage  covered share of the sphere
 * @property {string[]} alarms  codes of reasons that further turning may end
 * @property {object | null} record  the part `fit` of a calibration file
 * @property {import("../messages.d.ts").PreviousState | null} previous
 */

/**
 * Inputs of a fit.
 * @typedef {object} Task
 * @property {number} key
 * @property {Float64Array} field
 * @property {Float64Array | null} time
 * @property {Float64Array | null} acceleration  of each reading, if recorded
 * @property {"sensor" | "vehicle"} frame  of the advice
 * @property {string} axes  of the readings, as for `--axes`
 * @property {Uint32Array} numbers  of the readings in the session
 * @property {string} unit
 * @property {number} targetDeg
 * @property {number} dipDeg
 * @property {boolean} dipAssumed
 * @property {"heading" | "attitude"} goal
 * @property {boolean} isFollowed  the user is turning the sensor and can be guided
 * @property {Previous | null} previous
 * @property {Site | null} site  known field of the place
 * @property {boolean} isRenewed  keep the soft iron of `previous`, and estimate the hard iron again
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
 * A kept fit of the readings up to a time.
 * @typedef {{evaluated: Evaluated, view: View, seconds: number}} Kept
 */

/** @type {Evaluated} */
const NO_FIT = { key: -1, view: null, refusal: "", refusalCode: "", reasons: [], used: 0, rejected: 0, coverage: 0, alarms: [], record: null, previous: null };
/** A time later than all others, s. */
const END = 1e9;
const MAX_DIP_DEG = 89;

/** Readings of the sensor, or of a log, with their edits and fits. */
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
        /** Number that the server gave to a log. */
        this.number = "";
        /** @type {"sensor" | "vehicle"} frame of the readings */
        this.frame = "sensor";
        /** Mapping of the recorded axes, as for `--axes`. */
        this.axes = "x,y,z";
        /** @type {number | null} time of a restart: readings up to it are discarded */
        this.begunS = null;
        this.exclusions = new Exclusions();
        /** @type {Site | null} site of the recording */
        this.site = null;
        /** @type {number | null} start of a pause, during which readings are left out */
        this.pausedAt = null;
        /** @type {number | null} time of the last reading of the finished calibration; later readings wait */
        this.finishedS = null;
        this.generation = 1;
        /** Number that rises with each change of the inputs of a fit. Fits below `firstKey` are of other readings. */
        this.key = 0;
        this.firstKey = 0;
        this.evaluated = NO_FIT;
        /** @type {number | null} start of the first of consecutive fits with alarms; -Infinity for a permanent alarm */
        this.alarmedAt = null;
        /** @type {number[]} times of the first consecutive fits within the target */
        this.within = [];
        /** @type {Kept | null} the best fit within the target */
        this.kept = null;
        /** @type {number | null} time of the first of consecutive fits worse than the kept one */
        this.lostAt = null;
    }

    /** Excluded spans, with the present pause. */
    get excluded() {
        const { spans } = this.exclusions;
        const { seconds } = this.buffer;
        if (this.pausedAt === null || seconds < this.pausedAt) return spans;
        return mergeSpans([...spans, [this.pausedAt, seconds]]);
    }

    /** Spans that a fit leaves out: excluded ones, and the time after Finish. */
    get leftOut() {
        return this.finishedS === null ? this.excluded : mergeSpans([...this.excluded, [nextAfter(this.finishedS), END]]);
    }

    /** Number of readings since Finish. */
    get since() {
        return this.finishedS === null ? 0 : this.buffer.countWithin([[nextAfter(this.finishedS), END]]);
    }
}

export class Session {
    /**
     * @param {{model?: import("./geomag.js").Model | null, unfit?: Record<string, string>}} data  the model of the earth's
     *   field, and sentences on calibrations that cannot be renewed, by reason
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
        /** Whether to keep the soft iron of `previous`, and estimate the hard iron again. */
        this.refreshes = false;
        this.recording = "";
        /** Reason why readings cannot be recorded; empty if they are. */
        this.unrecorded = "";
        /** Whether the source is a board that can receive a calibration. */
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
        /** @type {[number, number, number][]} batches of the last two seconds and the one before: arrival, time of the last reading, count */
        this.arrivals = [];
    }

    /** The series that the page shows and commands act on. */
    get shown() {
        return this.opened ?? this.live;
    }

    /** The kept fit if the newest is worse; none once the calibration is finished. */
    get keptInstead() {
        const { lostAt, kept, finishedS } = this.shown;
        return lostAt === null || finishedS !== null ? null : kept;
    }

    /** The newest fit, or the kept fit in its place. */
    get held() {
        return this.keptInstead?.evaluated ?? this.shown.evaluated;
    }

    /** View of this fit. */
    get view() {
        return this.held.view;
    }

    /** Whether the newest fits have been worse than the kept one long enough to report a change. */
    get isChanged() {
        const { lostAt } = this.shown;
        return this.keptInstead !== null && lostAt !== null && (this.at - lostAt >= this.rules.changed_s || this.isOver);
    }

    /** Whether the earlier calibration is renewed. */
    get isRenewed() {
        return this.refreshes && this.previous !== null;
    }

    /** @returns {[number, boolean]} Dip of the judgement, and whether it is assumed. */
    get judgedDip() {
        const known = this.dipDeg ?? this.shown.site?.inclination_deg ?? null;
        return known === null ? [this.rules.assumed_dip_deg, true] : [known, false];
    }

    /** Whether the user is turning the sensor and can be guided. */
    get isFollowed() {
        const { pausedAt, finishedS } = this.live;
        return this.opened === null && pausedAt === null && finishedS === null && this.source.link === "connected";
    }

    /** @param {number} at */
    ticked(at) {
        this.at = at;
    }

    /**
     * Add readings of the sensor, also while a log is shown.
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
     * Add readings from a server, on its timeline; `isOld` marks those from before this page.
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

    /** Drop the readings of the sensor, which will arrive again; the edits stay. */
    restart() {
        const { live } = this;
        live.buffer = new ReadingBuffer(live.buffer.most);
        this.arrivals = [];
        live.generation = ++this.generations;
        live.key = ++this.keys;
    }

    /**
     * Note the arrival of readings; a length of 0 for old ones.
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
     * Note a change of the link, and return notices.
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
     * Set the calibration to compare with.
     * @param {number} at
     * @param {Previous} previous
     */
    gotPrevious(at, previous) {
        this.at = at;
        this.previous = previous;
        this.refreshes = false;
        this.#refit();
    }

    /** Edits of the sensor's readings, for storage. @returns {Edits} */
    get edits() {
        return this.#editsOf(this.live);
    }

    /** Edits of the shown readings, for the final calibration. @returns {Edits} */
    get finishing() {
        return this.#editsOf(this.shown);
    }

    /** Fingerprint of a calibration's inputs, unchanged as long as these are. */
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
     * Adopt the edits of another page, or stored ones.
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
     * Carry out a command; one without effect is not a step.
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
                return this.#edit((exclusions) => exclusions.restoring([command.start_s, command.end_s]));
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

    /** Fit the shown series again, and reject fits that began before. */
    #alone() {
        this.#refit();
        this.shown.firstKey = this.keys;
    }

    /**
     * Change a setting of the calibration.
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
     * Set dip and strength of a place.
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
        if (Math.abs(dipDeg) > MAX_DIP_DEG) {
            return [notice(phrase("session.steep", "the dip there is {dip}°: no compass works where it is beyond {limit}°", { dip: numeral(general(dipDeg)), limit: MAX_DIP_DEG }), "warning")];
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
     * Known field of the place: its strength for readings in µT, and its dip unless the user gave one.
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
     * Renew the earlier calibration, or calibrate without it.
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
        if (exclusions === this.shown.exclusions) return exclusions.isFull ? [notice(phrase("session.full", "too many stretches are left out: leave out one longer stretch over several, or put some back"), "warning")] : [];
        this.shown.exclusions = exclusions;
        this.#useAll();
        this.#refit();
        return [];
    }

    /**
     * Exclude a span up to the newest reading; later readings are never excluded.
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
     * Begin or end a pause, an exclusion of new readings that can be undone.
     * @param {boolean} paused
     */
    #pause(paused) {
        const { live } = this;
        if (this.opened !== null) return [notice(phrase("session.log", "a log is shown, which receives no readings: go back to the sensor first"), "warning")];
        if (live.finishedS !== null) return [notice(phrase("session.finished", "the calibration is finished: press Collect more first"), "warning")];
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

    /**
     * Finish the calibration with the readings so far, or with those up to the kept fit.
     */
    #finish() {
        const { live, held, keptInstead } = this;
        if (this.opened !== null || live.finishedS !== null || live.buffer.total === 0) return [];
        live.finishedS = keptInstead?.seconds ?? live.buffer.seconds;
        live.evaluated = held;
        this.#refit();
        return [];
    }

    /** Include the readings since Finish, and continue. */
    #collect() {
        const { live } = this;
        if (live.finishedS === null) return [];
        live.finishedS = null;
        this.#pause(false);
        this.#refit();
        return [];
    }

    /** Edits for a kept fit: the session's edits without pause, Finish and later exclusions. @param {Edits} edits */
    #ofKept({ excluded, paused_s: _, finished_s: __, ...others }) {
        const until = this.live.kept?.seconds ?? -Infinity;
        return JSON.stringify([others, excluded.filter(([start]) => start <= until).map(([start, end]) => [start, Math.min(end, until)])]);
    }

    /** Drop the kept fit, so that the newest one counts. */
    #useAll() {
        if (this.shown.kept) this.revision += 1;
        Object.assign(this.shown, { kept: null, lostAt: null });
        return [];
    }

    /** Restart without readings. */
    #clear() {
        if (this.opened !== null) return [notice(phrase("session.log-again", "a log is shown, which cannot be started again: go back to the sensor first"), "warning")];
        const { buffer, begunS } = this.live;
        this.#begin(buffer.total > 0 ? buffer.seconds : begunS);
        return [notice(phrase("session.started", "started again"), "info")];
    }

    /** @param {number | null} begunS  time of the last discarded reading */
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
     * Whether to start a fit: inputs changed, none is running, and one is due or the source has ended.
     * @param {number} at
     * @returns {boolean}
     */
    wantsFit(at) {
        const { buffer, evaluated, key } = this.shown;
        const isNew = buffer.total > 0 && evaluated.key !== key;
        return isNew && !this.isFitting && (at >= this.dueAt || this.source.link === "ended");
    }

    /**
     * Start a fit: return the task with the readings that are not left out, thinned evenly to a limit.
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
     * Store a finished fit, unless it is of another series than the shown one.
     * @param {number} at
     * @param {Evaluated} evaluated
     * @param {number} seconds  duration of the fit
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
     * Keep a fit within the target that consecutive fits confirm, or that is finished, unless the kept one is better; note the
     * time since which fits are worse.
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

    /** Whether several consecutive fits were within the target. */
    get isRepeated() {
        const { within } = this.shown;
        const { enough_fits, sure_s } = this.rules;
        return within.length >= enough_fits || (within.at(-1) ?? -Infinity) - (within[0] ?? 0) >= sure_s;
    }

    /**
     * Start of the first of consecutive fits with alarms; a permanent alarm stays.
     * @param {number} begun
     * @param {Evaluated} evaluated
     */
    #alarmedAt(begun, { alarms }) {
        if (alarms.length === 0) return null;
        return this.#isAlarmed(begun) ? -Infinity : (this.shown.alarmedAt ?? begun);
    }

    /** @param {number} at @returns {boolean} Whether alarms have lasted long enough to be permanent. */
    #isAlarmed(at) {
        const { alarmedAt, evaluated } = this.shown;
        const { whole, settled_s, lasting_s } = this.rules;
        return alarmedAt !== null && at - alarmedAt >= (evaluated.coverage >= whole ? settled_s : lasting_s);
    }

    /** Whether the newest fit is final: of a log, after Finish, in a pause, or of a silent sensor. */
    get isOver() {
        const { shown, source } = this;
        const hasEnded = shown.finishedS !== null || shown.pausedAt !== null || ["ended", "gone"].includes(source.link);
        const isSilent = hasEnded || this.at - this.arrivedAt >= this.rules.sure_s;
        return shown.evaluated.key === shown.key && (this.opened !== null || isSilent);
    }

    /** @param {string} code @returns {boolean} Whether further turning cannot end a reason. */
    isSettled(code) {
        return !this.shown.evaluated.alarms.includes(code) || this.isOver || this.#isAlarmed(this.at);
    }

    /** @param {View} view @returns {number | null} The error to compare with the target. */
    worstDeg({ heading_error_deg: error, guidance }) {
        if (error === null || guidance === null) return null;
        return this.goal === "heading" ? error.worst : Math.max(error.worst, guidance.worst_deg);
    }

    /** @param {Evaluated} evaluated @returns {boolean} Whether the target is reached without reasons against it. */
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
 * Reason to refuse a place; empty if valid.
 * @param {number} latitude
 * @param {number} longitude
 * @returns {string}
 */
function placeRefusal(latitude, longitude) {
    const isSwapped = Math.abs(latitude) <= 180 && Math.abs(longitude) <= 90;
    const swapped = isSwapped ? phrase("place.swapped", "; the latitude comes first") : "";
    if (!(Math.abs(latitude) <= 90)) {
        return phrase("place.no-latitude", "latitude is {latitude}°: need −90° to 90°{swapped}", { latitude: numeral(general(latitude)), swapped });
    }
    if (longitude >= -180 && longitude <= 360) return "";
    return phrase("place.no-longitude", "longitude is {longitude}°: need −180° to 180°, east positive", { longitude: numeral(general(longitude)) });
}

/**
 * Reason to refuse a year; empty if within the model.
 * @param {import("./geomag.js").Model} model
 * @param {number} year
 * @returns {string}
 */
function yearRefusal({ name, epoch, years }, year) {
    if (year >= epoch && year <= epoch + years) return "";
    const values = { year: general(year), model: name, from: general(epoch), to: general(epoch + years) };
    return phrase("place.other-year", "{year} lies outside {model}, from {from} to {to}: look up the inclination at your place, and type it as dip", values);
}

/**
 * Reason why a calibration cannot be renewed; empty if it can.
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
 * Next larger number after a non-negative one.
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

/** @param {Unit} unit @returns {string} Label of the unit on the page. */
export function labelOf({ inside }) {
    return inside === "uT" ? "µT" : inside;
}

/**
 * Known fields of a site, in a fixed order, so that equal sites give equal texts.
 * @param {Site} site
 * @returns {import("../wire.d.ts").Site}
 */
export function knownSite(site) {
    return Object.fromEntries(Object.entries(site).filter(([, value]) => value !== null).sort());
}

/**
 * Reason to refuse a command; empty if valid.
 * @param {Command} command
 * @returns {string}
 */
function refusalOf(command) {
    if (command.type === "target" && !(command.deg > 0 && command.deg <= 180)) return phrase("session.target", "the target is an angle above 0°, up to 180°");
    if (command.type === "dip" && !(Math.abs(command.deg) <= MAX_DIP_DEG)) return phrase("session.dip", "the dip is an angle from −{limit}° to {limit}°", { limit: MAX_DIP_DEG });
    const hasSpan = command.type === "exclude" || command.type === "restore";
    return hasSpan && !(command.start_s < command.end_s) ? phrase("session.stretch", "a stretch that is left out needs a start before its end") : "";
}
