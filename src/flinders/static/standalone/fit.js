/**
 * One recording fitted, and all that is known of the fit before it is judged: `flinders.fitting.calibrate`, for a
 * magnetometer alone.
 */

import { shrunk, widening } from "./claim.js";
import { attitudeLimitDeg, levelRoot, levelError, rawTurn, surfaceOf, tiltedError, withStructure } from "./heading.js";
import { NO_RESTS, fittedOnce } from "./rests.js";
import { general } from "./numbers.js";
import { filled } from "./wording.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Engine} Engine */
/** @typedef {import("./engine.js").Fitted} Fitted */
/** @typedef {import("./heading.js").Surface} Surface */
/** @typedef {import("./outliers.js").Outlier} Outlier */

/**
 * What is asked of a fit.
 * @typedef {object} Request
 * @property {Float64Array} field Three numbers a reading, µT or counts.
 * @property {Float64Array | null} time Seconds, ascending.
 * @property {string} unit "µT" or "counts".
 * @property {number} targetDeg
 * @property {number} dipDeg
 * @property {boolean} dipAssumed
 */

/** @typedef {{code: string, words: string}} Refusal */
/** @typedef {{axis: number, end: "lowest" | "highest", value: number, share: number}} Rail */
/** @typedef {{offset: number[], headingDeg: number, byChance: number}} Drift */
/** @typedef {{headingDeg: number, byChance: number, share: number, axis: string}} Fault */

const DEG = 180 / Math.PI;
/** Codes of statuses of the engine, as `flinders.errors` has them. */
const CODES = ["", "too-few-samples", "not-finite", "out-of-scale", "stuck-axis", "unmoved", "not-an-ellipsoid", "undetermined"];

/**
 * Readings that were fitted, with what was left out of them.
 * @typedef {object} Left
 * @property {Float64Array} near Those close to the surface, and at no end of an axis, of those that a fit goes by.
 * @property {number[]} counts Those that a fit goes by in each of a hundred cells of the sphere, but for outliers.
 * @property {Outlier[]} outliers
 * @property {import("./rests.js").Rests} rests Of those at no end of an axis, and …
 * @property {Float64Array | null} when … their times.
 * @property {Uint8Array} isOut Of each reading of the request, whether it was left out, and …
 * @property {Uint8Array} isRail … whether it is at an end of an axis.
 * @property {boolean} hidesPlane Without outliers they may be those of a level turn, which the program then calibrates.
 * @property {boolean} wasTurned The record of all readings shows a turn out of one plane.
 */

/** @typedef {{rows: number, repeats: number, distinct: number}} Counted Readings, and of them … */

/** A fit before it is judged. */
export class Fit {
    /**
     * @param {Request} request
     * @param {Fitted} whole Record of all readings.
     * @param {Fitted} record Record of those at no end of an axis.
     * @param {Left} left
     * @param {EngineData} data
     */
    constructor(request, whole, record, left, data) {
        const counted = countedBy(whole, record);
        const { repetition, factor } = widening(record, counted.rows, counted.distinct);
        const surface = surfaceOf(record.centre, record.shape);
        const claimed = record.covariance.map((part) => part * factor);
        const nearer = shrunk(surface, claimed, data);
        this.data = data;
        this.unit = request.unit;
        this.targetDeg = request.targetDeg;
        this.dipDeg = request.dipDeg;
        this.dipAssumed = request.dipAssumed;
        this.whole = whole;
        this.record = record;
        this.left = left;
        this.method = record.is_robust ? "robust" : "likelihood";
        this.isShrunk = nearer !== null;
        this.surface = nearer?.surface ?? surface;
        this.covariance = nearer?.covariance ?? Float64Array.from(claimed);
        this.textbook = nearer ? null : record.textbook;
        this.noise = record.noise;
        this.samples = record.used || counted.rows;
        this.correlation = correlationOf(record);
        this.independent = independentOf(this.correlation, counted, repetition);
        this.distortion = this.correlation?.direction ?? 0;
        this.statistics = statisticsOf(request, whole, record, counted);
        /** Whether the engine's record of readings in memory is all that the program looks at: not of what may be one plane. */
        this.isPlain = left.wasTurned && !left.hidesPlane;
        const showsAxes = this.isPlain && !record.unobserved;
        this.nonlinearity = showsAxes ? nonlinearityIn(record, data) : null;
        this.axisLag = showsAxes ? lagIn(record, data) : null;
        const alone = nearer
            ? levelError(this.surface, this.covariance, record.dip_deg)
            : { rms: Math.sqrt(factor) * record.level_rms_deg, worst: Math.sqrt(factor) * record.level_worst_deg };
        this.structureDeg = this.#structureDeg();
        this.headingError = {
            rms: Math.hypot(alone.rms, this.structureDeg),
            worst: Math.hypot(alone.worst, this.structureDeg),
            dipDeg: record.dip_deg,
        };
        const sigma = (this.structureDeg / DEG) * Math.cos(record.dip_deg / DEG);
        this.claimed = withStructure(this.surface, this.covariance, sigma);
        /** Readings in each of a hundred cells. */
        this.counts = left.counts;
        /** @type {Drift | null} */
        this.drift = null;
        /** @type {import("./engine.js").AxisSwap | null} */
        this.swap = null;
        /** @type {number | null} */
        this.limit = null;
        /** What a level heading errs by at most, with a probability of 95 %, to the digits that a file has. */
        this.headingBoundDeg = NaN;
    }

    /** Tilt up to which the worst heading error is within the target. */
    get attitudeLimitDeg() {
        this.limit ??= attitudeLimitDeg(this.surface, this.claimed, this.headingError.dipDeg, this.targetDeg);
        return this.limit;
    }

    /** What the heading of the same vehicle errs by without the calibration. */
    get uncorrected() {
        return rawTurn(this.surface, this.headingError.dipDeg);
    }

    /** What the covariance for independent residuals would claim. */
    get textbookWorstDeg() {
        return this.textbook ? levelError(this.surface, this.textbook, this.headingError.dipDeg).worst : null;
    }

    /**
     * Worst heading error of a vehicle that is tilted.
     * @param {number} tiltDeg
     * @returns {number}
     */
    tiltedWorstDeg(tiltDeg) {
        return tiltedError(this.surface, this.claimed, this.headingError.dipDeg, tiltDeg).worst;
    }

    /** Axes that are proven not to be linear or late; of two that look alike the likelier one. */
    get faults() {
        const proven = [this.nonlinearity, this.axisLag].filter((fault) => fault !== null && fault.isProven);
        const faults = /** @type {ProvenFault[]} */ (proven).sort((one, other) => one.byChance - other.byChance);
        const { ALIKE } = this.data.numbers;
        return faults.filter((fault, i) => i === 0 || faults[0].headingDeg < ALIKE * fault.headingDeg);
    }

    /** Heading error from what belongs to the direction. */
    #structureDeg() {
        const across = this.distortion / (this.surface.radius * Math.cos(this.record.dip_deg / DEG));
        const proven = [this.nonlinearity, this.axisLag].map((fault) => (fault?.isProven ? fault.headingDeg : 0));
        return Math.max(DEG * across, ...proven);
    }
}

/** @typedef {Fault & {isProven: boolean}} ProvenFault */

/**
 * Fit readings, or say why there is no fit.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Request} request
 * @returns {Fit | Refusal}
 */
export function fitOf(engine, data, request) {
    const { field, time, unit, dipDeg } = request;
    const whole = engine.fit(field, time, { dipDeg });
    const { EARTH_WEAKEST, EARTH_STRONGEST } = data.numbers;
    /** @type {import("./engine.js").Strengths} */
    const strengths = unit === "counts" ? [0, Infinity] : [EARTH_WEAKEST, EARTH_STRONGEST];
    const wasTurned = engine.wasTurned(strengths);
    if (whole.status || !wasTurned) {
        const angle = engine.unmovedDeg(field, strengths);
        if (angle !== null) return { code: "unmoved", words: unmovedWords(angle, data) };
    }
    const isFree = freeOf(field, whole);
    const [some, when] = whole.rails ? [chosen(field, isFree, 3), time && chosen(time, isFree, 1)] : [field, time];
    const record = whole.rails ? engine.fit(some, when, { dipDeg }) : whole;
    if (record.status) return { code: CODES[record.status] ?? "", words: engine.message(record.status) };
    const left = { ...leftOf(engine, data, record, { some, when, isFree }), wasTurned };
    const fit = new Fit(request, whole, record, left, data);
    const root = levelRoot(fit.surface, fit.claimed, fit.headingError.dipDeg);
    fit.headingBoundDeg = Number(engine.headingBound(root).toPrecision(4));
    fit.drift = driftOf(fit, engine);
    if (mayBeSwapped(fit)) fit.swap = engine.axisSwap(some, fit.noise, data);
    return fit;
}

/**
 * What a fit left out: outliers, and what is at an end of an axis.
 * @param {Engine} engine
 * @param {EngineData} data
 * @param {Fitted} record
 * @param {{some: Float64Array, when: Float64Array | null, isFree: Uint8Array}} fitted
 * @returns {Omit<Left, "wasTurned">}
 */
function leftOf(engine, data, record, { some, when, isFree }) {
    const isRail = isFree.map((free) => 1 - free);
    const rests = record.rests ? engine.rests(some) : NO_RESTS;
    const once = fittedOnce(some, rests);
    const known = { isRail, rests, when, counts: engine.cellCounts(once.field, record) };
    if (!record.is_robust) return { ...known, near: once.field, hidesPlane: false, outliers: [], isOut: isRail };
    const limit = record.rejected_beyond;
    const distances = engine.distances(once.field, record.majority_centre, record.majority_shape);
    const out = engine.leftOut(Uint8Array.from(distances, (distance) => Number(Math.abs(distance) > limit)), record.dense);
    const own = engine.distances(once.field, record.centre, record.shape);
    const isOut = new Uint8Array(some.length / 3);
    once.first.forEach((first, i) => isOut.fill(out[i], first, once.last[i] + 1));
    const near = chosen(once.field, Uint8Array.from(own, (distance) => Number(Math.abs(distance) <= limit)), 3);
    const outliers = engine.outliers(distances, out, once, when);
    let next = 0;
    return {
        ...known,
        near,
        hidesPlane: outliers.length > 0 && near.length >= 3 * data.numbers.FEWEST_LEFT && engine.hidesPlane(near),
        outliers,
        isOut: isFree.map((free) => (free ? isOut[next++] : 1)),
    };
}

/**
 * Readings that are at no end of an axis at which the sensor was at its limit.
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
 * Those of some rows of numbers that are marked.
 * @param {Float64Array} numbers
 * @param {Uint8Array} isChosen
 * @param {number} width
 * @returns {Float64Array}
 */
function chosen(numbers, isChosen, width) {
    return numbers.filter((_, i) => isChosen[Math.floor(i / width)]);
}

/**
 * Where the sensor was at its limit.
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
 * What residuals say of each other; null where they were not looked at.
 * @param {Fitted} record
 * @returns {{lagOne: number, time: number, direction: number, excess: number, lasting: number, steps: number, isWhite: boolean} | null}
 */
function correlationOf(record) {
    const { lag_one: lagOne, correlation_time: time, distortion: direction, excess_variance: excess } = record;
    if (Number.isNaN(time)) return null;
    const isWhite = time === 1 && direction === 0 && excess === 1;
    return { lagOne, time, direction, excess, lasting: record.noise_lasts || 0, steps: record.steps_kurtosis, isWhite };
}

/**
 * How many independent readings say as much: no more than there are different ones.
 * @param {Fit["correlation"]} correlation
 * @param {Counted} counted
 * @param {number} repetition
 * @returns {number}
 */
function independentOf(correlation, counted, repetition) {
    if (!correlation) return Infinity;
    return Math.min(counted.rows / repetition / (correlation.time * correlation.excess), counted.distinct);
}

/**
 * Readings that a claim goes by: where there are rests, those at no end of an axis, each rest as one or none.
 * @param {Fitted} whole
 * @param {Fitted} record
 * @returns {Counted}
 */
function countedBy(whole, record) {
    if (!record.rests) return { rows: whole.rows, repeats: whole.repeats, distinct: whole.distinct };
    return { rows: record.fitted, repeats: record.fitted_repeats, distinct: record.fitted_distinct };
}

/**
 * What a verdict asks of the recording.
 * @param {Request} request
 * @param {Fitted} whole
 * @param {Fitted} record
 * @param {Counted} counted
 */
function statisticsOf({ time }, whole, record, counted) {
    const steps = time ? time.length - 1 : 0;
    return {
        rows: whole.rows,
        distinct: whole.distinct,
        rests: record.rests,
        atRest: record.at_rest,
        fitted: counted.rows,
        fittedRepeats: counted.repeats,
        extent: Math.max(...whole.highest.map((highest, axis) => highest - whole.lowest[axis])),
        rails: railsOf(whole),
        step: whole.step,
        isTimed: time !== null,
        pathCorrelation: whole.path_correlation,
        backwardSteps: time ? whole.backward_steps : 0,
        longestStep: time ? whole.longest_step : 0,
        usualStep: time ? (whole.end - whole.start) / Math.max(steps, 1) : 0,
    };
}

/**
 * Quadratic and cubic terms of the axes; null where nothing is known.
 * @param {Fitted} record
 * @param {EngineData} data
 * @returns {ProvenFault | null}
 */
function nonlinearityIn(record, data) {
    if (Number.isNaN(record.nonlinear_deg)) return null;
    const terms = record.nonlinearity.map(Math.abs);
    const sizes = [0, 1, 2].map((axis) => terms[axis] + terms[3 + axis]);
    const share = Math.max(...sizes);
    return { ...fault(record.nonlinear_deg, record.nonlinear_by_chance, data), share, axis: "xyz"[sizes.indexOf(share)] };
}

/**
 * Lags of the axes; null where nothing is known.
 * @param {Fitted} record
 * @param {EngineData} data
 * @returns {ProvenFault | null}
 */
function lagIn(record, data) {
    if (Number.isNaN(record.lag_deg)) return null;
    return { ...fault(record.lag_deg, record.lag_by_chance, data), share: 0, axis: "" };
}

/**
 * @param {number} headingDeg
 * @param {number} byChance
 * @param {EngineData} data
 * @returns {{headingDeg: number, byChance: number, isProven: boolean}}
 */
function fault(headingDeg, byChance, { numbers }) {
    return { headingDeg, byChance, isProven: byChance < numbers.BY_CHANCE };
}

/**
 * A steady change over the recording; null where nothing can be told of it.
 * @param {Fit} fit
 * @param {Engine} engine
 * @returns {Drift | null}
 */
function driftOf({ isPlain: isOfRecord, left, record, correlation, headingError, data }, engine) {
    if (isOfRecord && !left.outliers.length) return driftIn(record);
    if (record.unobserved || !correlation || correlation.isWhite) return null;
    const stride = Math.max(Math.ceil(left.near.length / 3 / data.numbers.LOOKED_AT), 1);
    const thinned = left.near.filter((_, i) => Math.floor(i / 3) % stride === 0);
    return driftIn(engine.drift(thinned, record.centre, record.shape, headingError.dipDeg));
}

/**
 * @param {Fitted} record
 * @returns {Drift | null}
 */
function driftIn(record) {
    if (Number.isNaN(record.drift_deg)) return null;
    return { offset: record.drift_offset, headingDeg: record.drift_deg, byChance: record.drift_by_chance };
}

/**
 * Whether the readings may have swapped axes: residuals are not white then.
 * @param {Fit} fit
 * @returns {boolean}
 */
function mayBeSwapped({ left, correlation, record, data: { numbers } }) {
    if (!record.swaps.some(Boolean)) return false;
    if (left.outliers.length) return true;
    const isLasting = correlation !== null && correlation.lagOne >= numbers.SWAP_LAG_ONE;
    return correlation !== null && !correlation.isWhite && (record.unobserved > 0 || isLasting);
}

/**
 * @param {number} angle
 * @param {EngineData} data
 * @returns {string}
 */
function unmovedWords(angle, { said }) {
    return filled(said.unmoved, (name) => (name === "angle" ? roundedUp(angle) : said["every-way"]));
}

/**
 * An angle as the next larger one of a single digit below 1°, of whole degrees above.
 * @param {number} angle
 * @returns {string}
 */
function roundedUp(angle) {
    const step = 10 ** Math.min(Math.floor(Math.log10(Math.max(angle, 0.01))), 0);
    return general(Math.max(Math.ceil(angle / step - 1e-6), 1) * step, 2);
}
