/**
 * The C engine in the browser: readings in, the record of a fit out, with the same numbers as the library.
 *
 * The module imports nothing. Its data is in its memory after `__heap_base`: options, a record, and for each call
 * readings, times and a workspace. The layouts of structs are data, taken from flinders.h when the page is made.
 */

/**
 * Layout of a struct: its size in bytes, and offset, kind (u1, i4, i8, f8) and count of each field.
 * @typedef {{size: number, fields: Record<string, [number, "u1" | "i4" | "i8" | "f8", number]>}} Layout
 */

/**
 * @typedef {"record" | "options" | "request" | "judgement" | "belief" | "goal" | "advice" | "route" | "outlier" | "change" |
 *     "coverage" | "site" | "vertical" | "earlier" | "calibrated" | "difference"} Struct
 * @typedef {Record<Struct, Layout>} Layouts
 */

/**
 * Result of a fit: the fields of `flinders_record` by name. Fields with several numbers are arrays.
 * @typedef {Record<string, number> & Record<ArrayField, number[]>} Fitted
 * @typedef {"end_counts" | "swaps" | "first_swap" | "centre" | "shape" | "covariance" | "textbook" | "majority_centre" |
 *     "majority_shape" | "mean" | "principal_variances" | "lowest" | "highest" | "hole" | "drift_offset" |
 *     "nonlinearity" | "axis_lag" | "sums" | "sums_origin"} ArrayField
 */

/**
 * Options of a fit that differ from their defaults.
 * @typedef {object} FitOptions
 * @property {number} [dipDeg] Inclination of the field, -89 to 89.
 * @property {number} [robust] Reject outliers: 0 never, 1 if residuals indicate them, 2 always.
 * @property {boolean} [hasStatistics] Compute statistics of the whole recording, too.
 * @property {number} [level] Detect a level turn: 0 no, 1 yes, 2 an accelerometer shows one.
 */

/**
 * An estimate with its covariance, from which advice on further readings is computed; as `flinders_belief`.
 * @typedef {{centre: number[], shape: number[], covariance: ArrayLike<number>, variance: number, readings: number}} Belief
 *
 * Goal of further readings, as `flinders_goal`.
 * @typedef {{is_attitude: number, dip_deg: number, down: number[], target_deg: number}} Wanted
 */

/**
 * Axes that changed their sign or their place while a recording was made.
 * @typedef {object} AxisSwap
 * @property {string} axes
 * @property {number[]} rows Readings, counted from 0, at which the swap begins or ends.
 * @property {number} gain Factor by which undoing the swap reduces the residuals.
 */

/** @typedef {[weakest: number, strongest: number]} Strengths Limits of the field strength, in the unit of the readings; 0 and infinity if unknown. */

/**
 * Inputs for the judgement of a fit, as `flinders_request`.
 * @typedef {{target_deg: number, field_strength: number, is_strength_known: number, is_microtesla: number,
 *     shrinks: number}} Asked
 *
 * Judgement of a fit, as `flinders_judgement`.
 * @typedef {object} Judgement
 * @property {number} verdict
 * @property {number} conditions
 * @property {number} asks
 * @property {number[]} severities Of each finding.
 * @property {number[]} causes 1 + the finding that each follows from, or itself for a cause; 0 for others.
 * @property {number[]} shown Severities of findings that follow from no other.
 * @property {number[]} order These findings, the most important first.
 * @property {number[]} quantities
 * @property {number} rms_deg
 * @property {number} worst_deg
 * @property {number} bound_deg
 * @property {number} structure_deg
 * @property {number[]} covariance
 */

/** @typedef {{readings: number[], share: number, upright: number, hole_deg: number, hole: number[]}} Coverage */
/**
 * Prior from an earlier calibration for a sensor whose hard iron has changed.
 * @typedef {Surface & {covariance: number[] | null, distortion: number}} Earlier
 */

/**
 * A calibration to compare; zero covariance means exact, and a strength of 0 means unknown.
 * @typedef {Surface & {covariance: ArrayLike<number>, strength: number}} Calibrated
 *
 * Difference of two calibrations, as `flinders_difference`.
 * @typedef {{worst_deg: number, sigma_deg: number, bound_deg: number, p_value: number, freedom: number}} Difference
 */

/** Ellipsoid of readings. @typedef {{centre: number[], shape: number[]}} Surface */

const ALIGNED = 16;
const FRAMES = { vehicle: 0, sensor: 1 }; // axes for the names of attitudes
const PAGE = 65_536;
const TURN = 72; // headings of a turn
const WIDTHS = { u1: 1, i4: 4, i8: 8, f8: 8 };

/** @type {Record<string, (view: DataView, at: number) => number>} */
const READ = {
    u1: (view, at) => view.getUint8(at),
    i4: (view, at) => view.getInt32(at, true),
    i8: (view, at) => Number(view.getBigInt64(at, true)),
    f8: (view, at) => view.getFloat64(at, true),
};

/** @type {Record<string, (view: DataView, at: number, number: number) => void>} */
const WRITE = {
    i4: (view, at, number) => view.setInt32(at, number, true),
    i8: (view, at, number) => view.setBigInt64(at, BigInt(number), true),
    f8: (view, at, number) => view.setFloat64(at, number, true),
};

/**
 * Load the engine.
 * @param {URL | ArrayBuffer | Uint8Array<ArrayBuffer>} source Address of the module, or its bytes.
 * @param {Layouts} layouts
 * @returns {Promise<Engine>}
 */
export async function loadEngine(source, layouts) {
    const bytes = source instanceof URL ? await fetchBytes(source) : source;
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Engine(instance, layouts);
}

/**
 * @param {URL} address
 * @returns {Promise<ArrayBuffer>}
 */
async function fetchBytes(address) {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(`the engine cannot be loaded: ${address.pathname} gave ${answer.status}`);
    return answer.arrayBuffer();
}

export class Engine {
    /**
     * @param {WebAssembly.Instance} instance
     * @param {Layouts} layouts
     */
    constructor(instance, layouts) {
        const exports = /** @type {any} */ (instance.exports);
        exports._initialize();
        /** @type {Record<string, (...numbers: number[]) => number>} */
        this.call = exports;
        /** @type {WebAssembly.Memory} */
        this.memory = exports.memory;
        this.layouts = layouts;
        if (exports.flinders_record_size() !== layouts.record.size || exports.flinders_judgement_size() !== layouts.judgement.size) {
            throw new Error("the engine is of another release than the page: load the page anew");
        }
        this.free = alignAddress(exports.__heap_base.value);
        /** Address of each struct. */
        this.at = Object.fromEntries(Object.entries(layouts).map(([name, { size }]) => [name, this.#reserve(size)]));
    }

    /**
     * Fit one recording.
     * @param {Float64Array} field Three numbers a reading.
     * @param {Float64Array | null} time Seconds, or null.
     * @param {FitOptions} [options]
     * @returns {Fitted} With `status` 0, or the reason for no fit, see `message`.
     */
    fit(field, time, options = {}) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, timeAt, workspace] = this.#lend(field, time ?? 0, size);
        this.#choose(options);
        this.call.flinders_fit(fieldAt, time ? timeAt : 0, rows, this.at.options, workspace, size, this.at.record);
        return this.#decode("record");
    }

    /**
     * Renew an earlier calibration: fit one recording with its soft iron.
     * @param {Float64Array} field Three numbers a reading.
     * @param {Float64Array | null} time Seconds, or null.
     * @param {Earlier} earlier
     * @param {FitOptions} [options]
     * @returns {Fitted}
     */
    refresh(field, time, { centre, shape, covariance, distortion }, options = {}) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [centreAt, shapeAt, covarianceAt] = this.#lend(centre, shape, covariance ?? 0);
        this.call.flinders_earlier_of(centreAt, shapeAt, covariance ? covarianceAt : 0, distortion, 1, 0, this.at.earlier);
        const [fieldAt, timeAt, workspace] = this.#lend(field, time ?? 0, size);
        this.#choose(options);
        const given = [fieldAt, time ? timeAt : 0, rows, this.at.options, this.at.earlier];
        this.call.flinders_refresh(...given, workspace, size, this.at.record);
        return this.#decode("record");
    }

    /**
     * Difference of two calibrations of one sensor.
     * @param {Calibrated} first
     * @param {Calibrated} second
     * @param {number} dipDeg
     * @returns {Difference}
     */
    compare(first, second, dipDeg) {
        const { size } = this.layouts.calibrated;
        const [other] = this.#lend(size);
        this.#write("calibrated", second);
        new Uint8Array(this.memory.buffer).copyWithin(other, this.at.calibrated, this.at.calibrated + size);
        this.#write("calibrated", first);
        this.call.flinders_compare(this.at.calibrated, other, dipDeg, this.at.difference);
        return this.#decode("difference");
    }

    /**
     * Whether the difference of two calibrations is within a target.
     * @param {Difference} apart
     * @param {number} targetDeg
     * @returns {number} Index in the answers of the program's data.
     */
    answer({ worst_deg, sigma_deg, bound_deg, p_value }, targetDeg) {
        return this.call.flinders_holds(worst_deg, sigma_deg, bound_deg, p_value, targetDeg);
    }

    /**
     * Covariance with added structure error, given as an error of the level heading.
     * @param {number[]} shape
     * @param {ArrayLike<number>} covariance
     * @param {number} structureDeg
     * @param {number} dipDeg
     * @returns {number[]}
     */
    withStructure(shape, covariance, structureDeg, dipDeg) {
        const [shapeAt, covarianceAt, out] = this.#lend(shape, covariance, 8 * 81);
        this.call.flinders_with_structure(shapeAt, covarianceAt, structureDeg, dipDeg, out);
        return this.#numbers(out, 81);
    }

    /**
     * Largest angle of readings from their mean, with a known shape.
     * @param {Float64Array} field
     * @param {number[]} shape
     * @returns {number}
     */
    turnDeg(field, shape) {
        const [fieldAt, shapeAt] = this.#lend(field, shape);
        return this.call.flinders_turn_deg(fieldAt, field.length / 3, shapeAt);
    }

    /**
     * The rests of a recording.
     * @param {Float64Array} field Three numbers a reading.
     * @returns {import("./rests.js").Rests}
     */
    rests(field) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, bounds, leftOut, workspace] = this.#lend(field, 4 * rows, 4, size);
        const count = this.call.flinders_rests(fieldAt, rows, 0, 0, workspace, size, bounds, leftOut);
        const found = new BigInt64Array(this.memory.buffer, bounds, 2 * count);
        return {
            bounds: Array.from({ length: count }, (_, i) => [Number(found[2 * i]), Number(found[2 * i + 1])]),
            areLeftOut: new Int32Array(this.memory.buffer, leftOut, 1)[0] === 1,
        };
    }

    /**
     * A steady change about a known ellipsoid: fills `drift_...` of a record.
     * @param {Float64Array} field
     * @param {number[]} centre
     * @param {number[]} shape
     * @param {number} dipDeg
     * @returns {Fitted}
     */
    drift(field, centre, shape, dipDeg) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, surface, workspace] = this.#lend(field, [...centre, ...shape], size);
        this.call.flinders_drift(fieldAt, rows, surface, surface + 24, dipDeg, workspace, size, this.at.record);
        return this.#decode("record");
    }

    /**
     * Distances of readings from an ellipsoid, outside positive.
     * @param {Float64Array} field
     * @param {number[]} centre
     * @param {number[]} shape
     * @returns {Float64Array}
     */
    distances(field, centre, shape) {
        const rows = field.length / 3;
        const [fieldAt, out] = this.#lend(field, 8 * rows);
        this.#write("record", { centre, shape });
        this.call.flinders_distances(fieldAt, rows, this.at.record, out);
        return new Float64Array(this.memory.buffer, out, rows).slice();
    }

    /**
     * Judge a fit; the returned record has the final covariance.
     * @param {Fitted} record
     * @param {Partial<Asked>} asked Values that differ from the defaults.
     * @returns {{record: Fitted, judgement: Judgement}}
     */
    judge(record, asked) {
        this.#write("record", record);
        this.call.flinders_default_request(this.at.request);
        this.#write("request", asked);
        this.call.flinders_judge(this.at.record, this.at.request, this.at.judgement);
        return { record: this.#decode("record"), judgement: this.#decode("judgement") };
    }

    /**
     * Heading error of a vehicle that is tilted, 1 σ, at the worst heading.
     * @param {number[]} shape
     * @param {ArrayLike<number>} covariance
     * @param {number} dipDeg
     * @param {number} tiltDeg
     * @returns {number}
     */
    tiltedWorstDeg(shape, covariance, dipDeg, tiltDeg) {
        const [shapeAt, covarianceAt, out] = this.#lend(shape, covariance, 16);
        this.call.flinders_tilted_error(shapeAt, covarianceAt, dipDeg, tiltDeg, 0, out, out + 8);
        return this.#numbers(out, 2)[1];
    }

    /**
     * Heading error of a level vehicle with raw readings, at the worst heading.
     * @param {Surface} surface
     * @param {number} dipDeg
     * @returns {number}
     */
    uncorrectedWorstDeg({ centre, shape }, dipDeg) {
        const [centreAt, shapeAt, out] = this.#lend(centre, shape, 16);
        this.call.flinders_uncorrected_error(centreAt, shapeAt, dipDeg, 0, out, out + 8);
        return this.#numbers(out, 2)[1];
    }

    /**
     * Largest tilt with a worst heading error within a limit.
     * @param {number[]} shape
     * @param {ArrayLike<number>} covariance
     * @param {number} dipDeg
     * @param {number} limitDeg
     * @returns {number}
     */
    attitudeLimitDeg(shape, covariance, dipDeg, limitDeg) {
        const [shapeAt, covarianceAt, out] = this.#lend(shape, covariance, 8);
        this.call.flinders_attitude_limit(shapeAt, covarianceAt, dipDeg, limitDeg, 0, out);
        return this.#numbers(out, 1)[0];
    }

    /**
     * Error of the direction of the corrected field, 1 σ, in the worst direction.
     * @param {Surface} surface
     * @param {ArrayLike<number>} covariance
     * @param {number} dipDeg
     * @returns {number}
     */
    directionWorstDeg({ centre, shape }, covariance, dipDeg) {
        this.#write("record", { centre, shape, covariance });
        this.call.flinders_heading_errors(this.at.record, dipDeg);
        return this.#decode("record").direction_worst_deg;
    }

    /**
     * A level turn: headings, the deviation of raw readings, and the heading error of the calibration at each.
     * @param {Surface} surface
     * @param {ArrayLike<number>} covariance
     * @param {number} dipDeg
     * @returns {{headingDeg: number[], deviationDeg: number[], sigmaDeg: number[]}}
     */
    levelTurn({ centre, shape }, covariance, dipDeg) {
        const [centreAt, shapeAt, covarianceAt, ...out] = this.#lend(centre, shape, covariance, 8 * TURN, 8 * TURN, 8 * TURN);
        this.call.flinders_level_turn(centreAt, shapeAt, covarianceAt, dipDeg, 0, ...out);
        const [headingDeg, deviationDeg, sigmaDeg] = out.map((at) => this.#numbers(at, TURN));
        return { headingDeg, deviationDeg, sigmaDeg };
    }

    /**
     * Heading errors for directions of the corrected field, at the worst attitude with that direction.
     * @param {number[]} shape
     * @param {ArrayLike<number>} covariance
     * @param {number} dipDeg
     * @param {ArrayLike<number>} directions Three numbers each.
     * @returns {number[]}
     */
    attitudeErrorsDeg(shape, covariance, dipDeg, directions) {
        const count = directions.length / 3;
        const [shapeAt, covarianceAt, towards, out] = this.#lend(shape, covariance, directions, 8 * count);
        this.call.flinders_attitude_errors(shapeAt, covarianceAt, dipDeg, towards, count, out);
        return this.#numbers(out, count);
    }

    /**
     * Standard deviations of the entries of a correction matrix, row by row, scaled to the field strength or the radius.
     * @param {ArrayLike<number>} matrix
     * @param {number[]} shape
     * @param {ArrayLike<number>} covariance
     * @param {boolean} isKnown The field strength is known.
     * @returns {number[]}
     */
    matrixSigmas(matrix, shape, covariance, isKnown) {
        const [matrixAt, shapeAt, covarianceAt, out] = this.#lend(matrix, shape, covariance, 72);
        this.call.flinders_matrix_sigmas(matrixAt, shapeAt, covarianceAt, Number(isKnown), out);
        return this.#numbers(out, 9);
    }

    /**
     * Estimate of a fit.
     * @param {{centre: number[], shape: number[]}} surface
     * @param {ArrayLike<number>} covariance
     * @param {number} noise
     * @param {ArrayLike<number>} counts Of its readings in each of the hundred cells.
     * @returns {Belief}
     */
    believe({ centre, shape }, covariance, noise, counts) {
        const [centreAt, shapeAt, covarianceAt, countsAt] = this.#lend(centre, shape, covariance, counts);
        this.call.flinders_believe(centreAt, shapeAt, covarianceAt, noise, countsAt, this.at.belief);
        return this.#decode("belief");
    }

    /**
     * A sphere through readings that are too few for a fit; null if its centre is undetermined.
     * @param {Float64Array} field
     * @returns {Belief | null}
     */
    rough(field) {
        const [fieldAt] = this.#lend(field);
        return this.call.flinders_rough(fieldAt, field.length / 3, this.at.belief) ? null : this.#decode("belief");
    }

    /**
     * Direction of the most useful next hundredth of the readings.
     * @param {Belief} belief
     * @param {Wanted} wanted
     * @returns {{direction: number[], worst_deg: number, after_deg: number}}
     */
    guidance(belief, wanted) {
        this.#write("belief", belief);
        this.#write("goal", wanted);
        this.call.flinders_guidance(this.at.belief, this.at.goal, 0, this.at.advice);
        return this.#decode("advice");
    }

    /**
     * The path of the field from its present direction.
     * @param {Belief} belief
     * @param {Wanted} wanted
     * @param {number[]} here
     * @param {number} readingsPerDeg
     * @returns {{count: number, waypoints: number[], worst_deg: number, after_deg: number}}
     */
    path(belief, wanted, here, readingsPerDeg) {
        const [hereAt] = this.#lend(here);
        this.#write("belief", belief);
        this.#write("goal", wanted);
        this.call.flinders_path(this.at.belief, this.at.goal, hereAt, readingsPerDeg, this.at.route);
        return this.#decode("route");
    }

    /**
     * Number of the simplest attitude with the field near a direction, in a frame.
     * @param {Wanted} wanted
     * @param {number[]} direction
     * @param {"sensor" | "vehicle"} frame
     * @returns {number}
     */
    pose(wanted, direction, frame) {
        const [directionAt] = this.#lend(direction);
        this.#write("goal", wanted);
        return this.call.flinders_pose_towards(FRAMES[frame], this.at.goal, directionAt);
    }

    /**
     * Angle that contains all readings of a sensor that was hardly turned; null if it was turned.
     * @param {Float64Array} field
     * @param {Strengths} strengths
     * @returns {number | null}
     */
    unmovedDeg(field, [weakest, strongest]) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, out, workspace] = this.#lend(field, 8, size);
        this.call.flinders_unmoved(fieldAt, rows, weakest, strongest, workspace, size, out);
        const angle = new Float64Array(this.memory.buffer, out, 1)[0];
        return Number.isNaN(angle) ? null : angle;
    }

    /**
     * Whether the record of the last fit shows a turn out of one plane, within the sensor's range.
     * @param {Strengths} strengths
     * @returns {boolean}
     */
    wasTurned([weakest, strongest]) {
        const [out] = this.#lend(1);
        this.call.flinders_turned(this.at.record, 1, weakest, strongest, out);
        return new Uint8Array(this.memory.buffer, out, 1)[0] === 1;
    }

    /**
     * Readings that a fit leaves out: far ones, and those inside and around a run of far ones.
     * @param {Uint8Array} far 1 or 0 of each reading.
     * @param {number} dense Of the record.
     * @returns {Uint8Array}
     */
    leftOut(far, dense) {
        const [farAt, out] = this.#lend(far.length, far.length);
        new Uint8Array(this.memory.buffer, farAt, far.length).set(far);
        this.call.flinders_left_out(farAt, far.length, dense, out);
        return new Uint8Array(this.memory.buffer, out, far.length).slice();
    }

    /**
     * Runs of readings that a fit leaves out.
     * @param {Float64Array} distances Distances of the readings from the surface.
     * @param {Uint8Array} out Whether each reading is left out.
     * @param {import("./rests.js").Once} once First and last row of each reading.
     * @param {Float64Array | null} time Times of the rows, s.
     * @param {number} listed Largest number of listed runs.
     * @returns {import("./outliers.js").Outlier[]}
     */
    outliers(distances, out, { first, last }, time, listed) {
        const rows = distances.length;
        const { size } = this.layouts.outlier;
        const columns = [distances, ...(time ? [first, last].map((rows) => Float64Array.from(rows, (row) => time[row])) : [])];
        const [runs, outAt, firstAt, lastAt, ...columnsAt] = this.#lend(listed * size, rows, 8 * rows, 8 * rows, ...columns);
        new Uint8Array(this.memory.buffer, outAt, rows).set(out);
        new BigInt64Array(this.memory.buffer, firstAt, rows).set(first.map(BigInt));
        new BigInt64Array(this.memory.buffer, lastAt, rows).set(last.map(BigInt));
        const [near, start = 0, end = 0] = columnsAt;
        const count = this.call.flinders_list_outliers(near, outAt, rows, firstAt, lastAt, start, end, runs, 0);
        const found = Array.from({ length: count }, (_, i) => this.#decode("outlier", runs + i * size));
        return found.map((run) => ({ ...run, first: run.first + 1, last: run.last + 1 }));
    }

    /**
     * Find moments at which axes changed; null without a detectable change.
     * @param {Float64Array} field
     * @param {number} noise Of the fit.
     * @param {import("./data.d.ts").EngineData} data
     * @returns {AxisSwap | null}
     */
    axisSwap(field, noise, { swaps, numbers }) {
        const rows = field.length / 3;
        const size = this.call.flinders_swap_workspace_size(rows);
        const [fieldAt, moments, workspace] = this.#lend(field, 8 * rows, size);
        this.call.flinders_axis_swap(fieldAt, rows, noise, numbers.SWAP_MAX_NOISE, workspace, size, moments, this.at.change);
        const change = this.#decode("change");
        if (change.swap < 0) return null;
        const behind = new BigInt64Array(this.memory.buffer, moments, change.moments);
        return { axes: swaps[change.swap], rows: Array.from(behind, Number), gain: change.gain };
    }

    /**
     * Evidence of accelerations on a level turn about z: 0 against it, 2 for it, 1 none.
     * @param {Float64Array} acceleration Three numbers a reading, NaN where they are missing.
     * @returns {number}
     */
    levelness(acceleration) {
        const [at] = this.#lend(acceleration);
        return this.call.flinders_levelness(at, acceleration.length / 3);
    }

    /**
     * Include the field of a place in a fit, before its judgement.
     * @param {Float64Array} field Readings of the fit.
     * @param {Fitted} record
     * @param {import("./session.js").Site} site
     * @param {Float64Array | null} [felt] Accelerations of the readings.
     * @returns {Fitted}
     */
    atSite(field, record, site, felt = null) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, feltAt, workspace] = this.#lend(field, felt ?? 0, size);
        this.#write("record", record);
        const vertical = felt ? this.at.vertical : 0;
        if (felt) {
            new Uint8Array(this.memory.buffer, vertical, this.layouts.vertical.size).fill(0);
            this.call.flinders_vertical_add(fieldAt, feltAt, rows, this.at.record, vertical);
        }
        this.call.flinders_default_site(this.at.site);
        const known = Object.entries(site).filter(([name]) => name in this.layouts.site.fields);
        this.#write("site", Object.fromEntries(known.map(([name, value]) => [name, Number(value ?? NaN)])));
        this.call.flinders_at_site(fieldAt, rows, vertical, this.at.site, workspace, size, this.at.record);
        return this.#decode("record");
    }

    /**
     * Whether a fit uses the strength of the field at a place.
     * @param {Fitted} record
     * @returns {boolean}
     */
    usesStrength({ site_strength, strength_sigmas }) {
        this.#write("record", { site_strength, strength_sigmas });
        return this.call.flinders_uses_strength(this.at.record) === 1;
    }

    /**
     * Readings in each of a hundred cells of the sphere, equal in area, and the largest gap between them.
     * @param {Float64Array} field
     * @param {Fitted} record Record of these readings; rejected ones are left out.
     * @returns {Coverage}
     */
    coverage(field, { centre, shape, rejected_beyond: within }) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, surface, workspace] = this.#lend(field, [...centre, ...shape], size);
        this.call.flinders_coverage_of(fieldAt, rows, surface, surface + 24, within, workspace, size, this.at.coverage);
        return this.#decode("coverage");
    }

    /**
     * A status in words.
     * @param {number} status
     * @returns {string}
     */
    message(status) {
        const bytes = new Uint8Array(this.memory.buffer, this.call.flinders_message(status));
        return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
    }

    /**
     * Address of a permanent part of memory.
     * @param {number} size
     * @returns {number}
     */
    #reserve(size) {
        const at = this.free;
        this.free = alignAddress(at + size);
        return at;
    }

    /**
     * Numbers at an address.
     * @param {number} at
     * @param {number} count
     * @returns {number[]}
     */
    #numbers(at, count) {
        return Array.from(new Float64Array(this.memory.buffer, at, count));
    }

    /**
     * Addresses of temporary parts of memory, valid until the next call: copies of arrays, or a number of bytes.
     * @param {(ArrayLike<number> | number)[]} parts
     * @returns {number[]}
     */
    #lend(...parts) {
        let end = this.free;
        const places = parts.map((part) => {
            const at = end;
            end = alignAddress(at + (typeof part === "number" ? part : 8 * part.length));
            return at;
        });
        const missing = end - this.memory.buffer.byteLength;
        if (missing > 0) this.memory.grow(Math.ceil(missing / PAGE));
        parts.forEach((part, i) => typeof part !== "number" && new Float64Array(this.memory.buffer, places[i], part.length).set(part));
        return places;
    }

    /** @param {FitOptions} options */
    #choose({ dipDeg, robust, hasStatistics, level }) {
        this.call.flinders_default_options(this.at.options);
        const { fields } = this.layouts.options;
        const view = new DataView(this.memory.buffer, this.at.options);
        if (dipDeg !== undefined) view.setFloat64(fields.dip_deg[0], dipDeg, true);
        if (robust !== undefined) view.setInt32(fields.robust[0], robust, true);
        if (hasStatistics !== undefined) view.setInt32(fields.statistics[0], Number(hasStatistics), true);
        if (level !== undefined) view.setInt32(fields.level[0], level, true);
    }

    /**
     * Fill fields of a struct.
     * @param {keyof Layouts} struct
     * @param {Record<string, number | ArrayLike<number>>} values
     */
    #write(struct, values) {
        const view = new DataView(this.memory.buffer, this.at[struct]);
        for (const [name, value] of Object.entries(values)) {
            const [offset, kind] = this.layouts[struct].fields[name];
            const width = WIDTHS[kind];
            const numbers = typeof value === "number" ? [value] : Array.from(value);
            numbers.forEach((number, i) => WRITE[kind](view, offset + i * width, number));
        }
    }

    /**
     * Fields of a struct by their names.
     * @param {keyof Layouts} struct
     * @param {number} [at] Its address.
     * @returns {any}
     */
    #decode(struct, at = this.at[struct]) {
        const view = new DataView(this.memory.buffer, at);
        const fields = Object.entries(this.layouts[struct].fields).map(([name, [offset, kind, count]]) => {
            const width = WIDTHS[kind];
            const numbers = Array.from({ length: count || 1 }, (_, i) => READ[kind](view, offset + i * width));
            return [name, count ? numbers : numbers[0]];
        });
        return Object.fromEntries(fields);
    }
}

/**
 * @param {number} address
 * @returns {number}
 */
function alignAddress(address) {
    return Math.ceil(address / ALIGNED) * ALIGNED;
}
