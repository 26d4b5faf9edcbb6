/**
 * Fit and judgement of one recording, as `flinders.fitting.calibrate` for a magnetometer alone. The engine does both.
 */

import { inverseOf } from "./linear.js";
import { NO_RESTS, fittedOnce } from "./rests.js";
import { general } from "./numbers.js";
import { fillTemplate } from "./wording.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./engine.js").Fitted} Fitted */
/** @typedef {import("./engine.js").Judgement} Judgement */
/** @typedef {import("./outliers.js").Outlier} Outlier */

/**
 * Inputs of a fit.
 * @typedef {object} Request
 * @property {Float64Array} field Three numbers a reading, µT or counts.
 * @property {Float64Array | null} time Seconds, ascending.
 * @property {Float64Array | null} [acceleration] Acceleration with each reading, NaN if missing.
 * @property {string} unit "µT" or "counts".
 * @property {number} targetDeg
 * @property {number} dipDeg
 * @property {boolean} dipAssumed
 * @property {import("./session.js").Site | null} [site] Known field of the place.
 * @property {import("./previous.js").Renewed | null} [renewed] Earlier calibration whose soft iron is kept.
 */

/** @typedef {{code: string, words: string}} Refusal */
/** @typedef {{axis: number, end: "lowest" | "highest", value: number, share: number}} Rail */

/** An ellipsoid; matrices are nine numbers, row by row. @typedef {import("./engine.js").Surface & {inverse: number[], radius: number}} Surface */

/** Codes of `flinders.errors` by the engine's status. */
const CODES = ["", "too-few-samples", "not-finite", "out-of-scale", "stuck-axis", "unmoved", "not-an-ellipsoid", "undetermined"];
const ASKS_SWAP = 2;
/** Whether z points down in a level turn, by `z_axis` of a record; null if unknown. */
const Z_DOWN = [true, false, null];
const REFRESHED = 8;
const UNMOVED = 5;

/**
 * Fitted readings, and readings left out.
 * @typedef {object} Left
 * @property {Float64Array} near Fitted readings close to the surface and at no end of an axis.
 * @property {import("./engine.js").Coverage} coverage Directions of the fitted readings without outliers.
 * @property {Outlier[]} outliers
 * @property {import("./rests.js").Rests} rests Rests of the readings at no end of an axis.
 * @property {Float64Array | null} when Times of the readings at no end of an axis, s.
 * @property {Uint8Array} isOut For each reading of the request, whether it was left out.
 * @property {Uint8Array} isRail For each reading of the request, whether it is at an end of an axis.
 * @property {boolean} isAlone The record of all readings shows a turn out of one plane, and no place is known.
 */

/** A judged fit. */
export class Fit {
    /**
     * @param {Request} request
     * @param {Fitted} record With its final covariance.
     * @param {Judgement} judgement
     * @param {Left} left
     * @param {EngineData} data
     * @param {Engine} engine
     */
    constructor({ unit, targetDeg, dipDeg, dipAssumed, time, renewed }, record, judgement, left, data, engine) {
        this.engine = engine;
        this.data = data;
        this.unit = unit;
        this.targetDeg = targetDeg;
        this.dipDeg = dipDeg;
        this.dipAssumed = dipAssumed;
        this.isTimed = time !== null;
        this.record = record;
        this.judgement = judgement;
        this.left = left;
        this.renewed = renewed ?? null;
        /** @type {"" | "xy"} Plane of the level turn of the fit; empty otherwise. */
        this.plane = record.plane ? "xy" : "";
        this.zDown = Z_DOWN[record.z_axis];
        this.method = this.renewed ? "refresh" : this.plane ? "level" : record.is_robust ? "robust" : "likelihood";
        this.isShrunk = record.is_shrunk > 0;
        this.surface = surfaceOf(record.centre, record.shape);
        this.covariance = record.covariance;
        this.noise = record.noise;
        this.samples = record.used;
        this.counts = left.coverage.readings;
        const strength = strengthOf(engine, record, this.renewed);
        this.isStrengthKnown = strength !== null;
        /** Length of corrected readings. */
        this.strength = strength ?? this.surface.radius;
        this.rails = railsOf(record);
        this.structureDeg = judgement.structure_deg;
        this.headingError = { rms: judgement.rms_deg, worst: judgement.worst_deg, dipDeg: record.dip_deg };
        this.claimed = judgement.covariance;
        /** Bound on the error of a level heading, 95 %, to the digits of a file. */
        this.headingBoundDeg = Number(judgement.bound_deg.toPrecision(4));
        this.quantities = Object.fromEntries(data.quantities.map((name, i) => [name, judgement.quantities[i]]));
        /** @type {import("./engine.js").AxisSwap | null} */
        this.swap = null;
        /** @type {number | null} */
        this.limit = null;
    }

    /** Largest tilt with a worst heading error within the target. */
    get attitudeLimitDeg() {
        this.limit ??= this.engine.attitudeLimitDeg(this.surface.shape, this.claimed, this.headingError.dipDeg, this.targetDeg);
        return this.limit;
    }

    /** A level turn without the calibration, and with it. */
    get turn() {
        return this.engine.levelTurn(this.surface, this.claimed, this.headingError.dipDeg);
    }

    /** Worst heading error by the covariance for independent residuals; NaN for readings corrected before. */
    get textbookWorstDeg() {
        return this.engine.tiltedWorstDeg(this.surface.shape, this.record.textbook, this.headingError.dipDeg, 0);
    }

    /**
     * Worst heading error of a vehicle that is tilted.
     * @param {number} tiltDeg
     * @returns {number}
     */
    tiltedWorstDeg(tiltDeg) {
        return this.engine.tiltedWorstDeg(this.surface.shape, this.claimed, this.headingError.dipDeg, tiltDeg);
    }
}

/**
 * Ellipsoid with a centre and a shape.
 * @param {number[]} centre
 * @param {number[]} shape Its entries 11, 22, 33, 12, 13, 23.
 * @returns {Surface}
 */
export function surfaceOf(centre, shape) {
    const [a, b, c, d, e, f] = shape;
    const { inverse, determinant } = inverseOf([a, d, e, d, b, f, e, f, c]);
    return { centre, shape, inverse, radius: Math.cbrt(determinant) };
}

/**
 * Fit readings; returns a refusal if there is no fit.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Request} request
 * @returns {Fit | Refusal}
 */
export function fitOf(engine, data, request) {
    const { field, time, acceleration, unit, dipDeg, renewed } = request;
    const level = acceleration ? engine.levelness(acceleration) : 1;
    /** @type {(field: Float64Array, time: Float64Array | null) => Fitted} */
    const fit = (field, time) =>
        renewed ? engine.refresh(field, time, renewed, { dipDeg }) : engine.fit(field, time, { dipDeg, level });
    const whole = fit(field, time);
    const { EARTH_WEAKEST, EARTH_STRONGEST } = data.numbers;
    /** @type {import("./engine.js").Strengths} */
    const strengths = unit === "counts" ? [0, Infinity] : [EARTH_WEAKEST, EARTH_STRONGEST];
    const wasTurned = !renewed && engine.wasTurned(strengths);
    if (renewed && whole.status === UNMOVED) {
        return { code: "unmoved", words: unmovedWords(engine.turnDeg(field, renewed.shape), data.said["to-all-sides"], data) };
    }
    if (!renewed && (whole.status || !wasTurned)) {
        const angle = engine.unmovedDeg(field, strengths);
        if (angle !== null) return { code: "unmoved", words: unmovedWords(angle, data.said["every-way"], data) };
    }
    const isFree = freeOf(field, whole);
    const [some, when] = whole.rails ? [chosenRows(field, isFree, 3), time && chosenRows(time, isFree, 1)] : [field, time];
    const fitted = whole.rails ? fit(some, when) : whole;
    if (fitted.status) return { code: CODES[fitted.status] ?? "", words: engine.message(fitted.status) };
    const rests = fitted.rests ? engine.rests(some) : NO_RESTS;
    const once = fittedOnce(some, rests);
    const felt = acceleration && fitted.plane ? fittedOnce(chosenRows(acceleration, isFree, 3), rests).field : null;
    const isPlaced = !renewed && Boolean(request.site || felt);
    const record = isPlaced ? engine.atSite(once.field, fitted, request.site ?? {}, felt) : fitted;
    const isAlone = wasTurned && !isPlaced;
    const left = { ...leftOf(engine, data, record, { some, when, isFree, rests, once }), isAlone };
    return judgeFit(engine, data, request, withWhole(record, whole, left, engine, data), left, some);
}

/**
 * Known strength of the field: of the place, or of the renewed calibration; else null.
 * @param {Engine} engine
 * @param {Fitted} record
 * @param {import("./previous.js").Renewed | null} renewed
 * @returns {number | null}
 */
function strengthOf(engine, record, renewed) {
    return renewed?.strength ?? (engine.usesStrength(record) ? record.site_strength : null);
}

/**
 * Judge a record, and again with the result of a search for swapped axes if needed.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Request} request
 * @param {Fitted} record
 * @param {Left} left
 * @param {Float64Array} some Readings at no end of an axis.
 * @returns {Fit}
 */
function judgeFit(engine, data, request, record, left, some) {
    const strength = strengthOf(engine, record, request.renewed ?? null);
    const known = strength === null ? {} : { field_strength: strength, is_strength_known: 1 };
    const asked = { target_deg: request.targetDeg, is_microtesla: Number(request.unit !== "counts"), ...known };
    const first = engine.judge(record, asked);
    if (!(first.judgement.asks & ASKS_SWAP)) return new Fit(request, first.record, first.judgement, left, data, engine);
    const swap = engine.axisSwap(some, record.noise, data);
    const looked = /** @type {any} */ ({ ...first.record, swap_gain: swap?.gain ?? -Infinity });
    const again = engine.judge(looked, { ...asked, shrinks: 0 });
    const fit = new Fit(request, again.record, again.judgement, left, data, engine);
    fit.swap = swap;
    return fit;
}

/** Fields of the record of all readings that describe the recording. */
const OF_RECORDING = /** @type {const} */ ([
    "rows", "repeats", "distinct", "rails", "end_counts", "lowest", "highest", "principal_variances", "step",
    "path_correlation", "start", "end", "longest_step", "backward_steps",
]); // prettier-ignore

/**
 * The record of a fit with fields of the whole recording, and with fields that are not computed in every fit.
 * @param {Fitted} record
 * @param {Fitted} whole
 * @param {Left} left
 * @param {Engine} engine
 * @param {EngineData} data
 * @returns {Fitted}
 */
function withWhole(record, whole, left, engine, data) {
    const ofAll = Object.fromEntries(OF_RECORDING.map((name) => [name, whole[name]]));
    const fitted = record.rests
        ? {}
        : { fitted: whole.rows, fitted_repeats: whole.repeats, fitted_distinct: whole.distinct };
    const isPlain = left.isAlone && !record.hides_plane && !record.unobserved;
    const faults = isPlain ? {} : { nonlinear_deg: NaN, lag_deg: NaN };
    const found = { ...faults, ...coverageOf(record, left), ...driftOf(record, left, engine, data), ...farthestOf(left) };
    return /** @type {Fitted} */ ({ ...record, ...ofAll, ...fitted, ...found });
}

/**
 * Coverage of directions, about the surface adjusted to a place.
 * @param {Fitted} record
 * @param {Left} left
 */
function coverageOf({ site_strength }, { coverage: { share, upright, hole_deg, hole } }) {
    return Number.isNaN(site_strength) ? {} : { coverage: share, upright, hole_deg, hole };
}

/**
 * Number of readings left out, and the farthest of them.
 * @param {Left} left
 */
function farthestOf({ outliers }) {
    if (!outliers.length) return {};
    return {
        rejected: outliers.reduce((sum, { fitted }) => sum + fitted, 0),
        farthest: Math.max(...outliers.map(({ farthest }) => farthest)),
    };
}

/**
 * A steady change of the field over the recording, found without the outliers.
 * @param {Fitted} record
 * @param {Left} left
 * @param {Engine} engine
 * @param {EngineData} data
 */
function driftOf(record, left, engine, { numbers }) {
    if (left.isAlone && !left.outliers.length) return {};
    if (record.unobserved || record.is_white || Number.isNaN(record.correlation_time)) return { drift_deg: NaN };
    if (record.sources & REFRESHED) return { drift_deg: NaN };
    const stride = Math.max(Math.ceil(left.near.length / 3 / numbers.MAX_DRIFT_READINGS), 1);
    const thinned = left.near.filter((_, i) => Math.floor(i / 3) % stride === 0);
    const { drift_deg, drift_offset, drift_by_chance } = engine.drift(thinned, record.centre, record.shape, record.dip_deg);
    return { drift_deg, drift_offset, drift_by_chance };
}

/**
 * Readings left out of a fit: outliers, and readings at an end of an axis.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Fitted} record
 * @param {{some: Float64Array, when: Float64Array | null, isFree: Uint8Array, rests: import("./rests.js").Rests,
 *     once: import("./rests.js").Once}} fitted
 * @returns {Omit<Left, "isAlone">}
 */
function leftOf(engine, data, record, { some, when, isFree, rests, once }) {
    const isRail = isFree.map((free) => 1 - free);
    const known = { isRail, rests, when, coverage: engine.coverage(once.field, record) };
    if (!record.is_robust) return { ...known, near: once.field, outliers: [], isOut: isRail };
    const limit = record.rejected_beyond;
    const laid = record.plane ? laidFlat(once.field, record.majority_centre[2]) : once.field;
    const distances = engine.distances(laid, record.majority_centre, record.majority_shape);
    const out = engine.leftOut(Uint8Array.from(distances, (distance) => Number(Math.abs(distance) > limit)), record.dense);
    const own = engine.distances(once.field, record.centre, record.shape);
    const isOut = new Uint8Array(some.length / 3);
    once.first.forEach((first, i) => isOut.fill(out[i], first, once.last[i] + 1));
    const near = chosenRows(once.field, Uint8Array.from(own, (distance) => Number(Math.abs(distance) <= limit)), 3);
    const outliers = engine.outliers(distances, out, once, when, data.listed);
    let next = 0;
    return {
        ...known,
        near,
        outliers,
        isOut: isFree.map((free) => (free ? isOut[next++] : 1)),
    };
}

/**
 * Readings of a level turn moved to one height.
 * @param {Float64Array} field
 * @param {number} height
 * @returns {Float64Array}
 */
function laidFlat(field, height) {
    return field.map((part, i) => (i % 3 === 2 ? height : part));
}

/**
 * Marks of readings at no saturated end of an axis.
 * @param {Float64Array} field
 * @param {Fitted} record
 * @returns {Uint8Array}
 */
function freeOf(field, record) {
    const rails = railsOf(record);
    const isFree = new Uint8Array(field.length / 3).fill(1);
    for (let i = 0; i < isFree.length; i++) {
        if (rails.some(({ axis, value }) => field[3 * i + axis] === value)) isFree[i] = 0;
    }
    return isFree;
}

/**
 * Marked rows of an array.
 * @param {Float64Array} numbers
 * @param {Uint8Array} isChosen
 * @param {number} width
 * @returns {Float64Array}
 */
function chosenRows(numbers, isChosen, width) {
    return numbers.filter((_, i) => isChosen[Math.floor(i / width)]);
}

/**
 * Ends of axes at which the sensor was saturated.
 * @param {Fitted} record
 * @returns {Rail[]}
 */
function railsOf(record) {
    return [0, 1, 2, 3, 4, 5]
        .filter((end) => record.rails & (1 << end))
        .map((end) => ({
            axis: end % 3,
            end: end < 3 ? "lowest" : "highest",
            value: (end < 3 ? record.lowest : record.highest)[end % 3],
            share: record.end_counts[end] / record.rows,
        }));
}

/**
 * @param {number} angle
 * @param {string} how Words on turning the sensor.
 * @param {EngineData} data
 * @returns {string}
 */
function unmovedWords(angle, how, { said }) {
    return fillTemplate(said.unmoved, (name) => (name === "angle" ? roundedUp(angle) : how));
}

/**
 * Round an angle up to one digit below 1°, and to whole degrees above.
 * @param {number} angle
 * @returns {string}
 */
function roundedUp(angle) {
    const step = 10 ** Math.min(Math.floor(Math.log10(Math.max(angle, 0.01))), 0);
    return general(Math.max(Math.ceil(angle / step - 1e-6), 1) * step, 2);
}
