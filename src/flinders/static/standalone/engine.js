/**
 * The C engine in the browser: readings in, the record of a fit out, the same numbers as those of the library.
 *
 * The module imports nothing. What it works on lies in its memory behind `__heap_base`: options, a record, and for each
 * call readings, times and a workspace. Where fields of a struct lie is data, taken from flinders.h when the page is made.
 */

/**
 * Where the fields of a struct lie: its bytes, and of each field the offset, the kind (i4, i8, f8) and the count.
 * @typedef {{size: number, fields: Record<string, [number, "i4" | "i8" | "f8", number]>}} Layout
 */

/** @typedef {Record<"record" | "options" | "belief" | "goal" | "advice" | "route", Layout>} Layouts */

/**
 * A record of the engine by the names of `flinders_record`; arrays where a field has several numbers.
 * @typedef {Record<string, number> & Record<ArrayField, number[]>} Fitted
 * @typedef {"end_counts" | "swaps" | "first_swap" | "centre" | "shape" | "covariance" | "textbook" | "majority_centre" |
 *     "majority_shape" | "mean" | "principal_variances" | "lowest" | "highest" | "hole" | "drift_offset" |
 *     "nonlinearity" | "axis_lag" | "sums" | "sums_origin"} ArrayField
 */

/**
 * Options of a fit that differ from their defaults.
 * @typedef {object} FitOptions
 * @property {number} [dipDeg] Inclination of the field, -89 to 89.
 * @property {number} [robust] Reject outliers: 0 never, 1 where residuals ask for it, 2 always.
 * @property {boolean} [hasStatistics] Look at the recording as a whole, too.
 */

/**
 * What is known before the next reading, as `flinders_belief`.
 * @typedef {{centre: number[], shape: number[], covariance: ArrayLike<number>, variance: number, readings: number}} Belief
 *
 * What further readings are for, as `flinders_goal`.
 * @typedef {{is_attitude: number, dip_deg: number, down: number[], target_deg: number}} Wanted
 */

const ALIGNED = 16;
const SENSOR = 1; // axes that attitudes are named in
const PAGE = 65_536;

/** @type {Record<string, (view: DataView, at: number) => number>} */
const READ = {
    i4: (view, at) => view.getInt32(at, true),
    i8: (view, at) => Number(view.getBigInt64(at, true)),
    f8: (view, at) => view.getFloat64(at, true),
};

/** @type {Record<string, (view: DataView, at: number, number: number) => void>} */
const WRITE = {
    i4: (view, at, number) => view.setInt32(at, number, true),
    f8: (view, at, number) => view.setFloat64(at, number, true),
};

/**
 * Load the engine.
 * @param {URL | ArrayBuffer | Uint8Array<ArrayBuffer>} source Address of the module, or its bytes.
 * @param {Layouts} layouts
 * @returns {Promise<Engine>}
 */
export async function loadEngine(source, layouts) {
    const bytes = source instanceof URL ? await fetched(source) : source;
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Engine(instance, layouts);
}

/**
 * @param {URL} address
 * @returns {Promise<ArrayBuffer>}
 */
async function fetched(address) {
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
        if (exports.flinders_record_size() !== layouts.record.size) {
            throw new Error("the engine is of another release than the page: load the page anew");
        }
        this.free = aligned(exports.__heap_base.value);
        /** Address of each struct. */
        this.at = Object.fromEntries(Object.entries(layouts).map(([name, { size }]) => [name, this.#reserved(size)]));
    }

    /**
     * Fit one recording.
     * @param {Float64Array} field Three numbers a reading.
     * @param {Float64Array | null} time Seconds, or null.
     * @param {FitOptions} [options]
     * @returns {Fitted} With `status` 0, or why there is none: see `message`.
     */
    fit(field, time, options = {}) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, timeAt, workspace] = this.#placed([field.byteLength, time?.byteLength ?? 0, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        if (time) new Float64Array(this.memory.buffer, timeAt, rows).set(time);
        this.#choose(options);
        this.call.flinders_fit(fieldAt, time ? timeAt : 0, rows, this.at.options, workspace, size, this.at.record);
        return this.#decoded("record");
    }

    /**
     * The rests of a recording.
     * @param {Float64Array} field Three numbers a reading.
     * @returns {import("./rests.js").Rests}
     */
    rests(field) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, bounds, leftOut, workspace] = this.#placed([field.byteLength, 4 * rows, 4, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
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
        const [fieldAt, surface, workspace] = this.#placed([field.byteLength, 72, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        new Float64Array(this.memory.buffer, surface, 9).set([...centre, ...shape]);
        this.call.flinders_drift(fieldAt, rows, surface, surface + 24, dipDeg, workspace, size, this.at.record);
        return this.#decoded("record");
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
        const [fieldAt, out] = this.#placed([field.byteLength, 8 * rows]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        this.#write("record", { centre, shape });
        this.call.flinders_distances(fieldAt, rows, this.at.record, out);
        return new Float64Array(this.memory.buffer, out, rows).slice();
    }

    /**
     * What the heading of a level vehicle errs by at most, at all headings, with a probability of 95 %.
     * @param {number[]} root 4 × 4, of the covariance of its four coefficients, in any unit.
     * @returns {number}
     */
    headingBound(root) {
        const [rootAt, out] = this.#placed([128, 8]);
        new Float64Array(this.memory.buffer, rootAt, 16).set(root);
        this.call.flinders_heading_bounds(rootAt, 1, out);
        return new Float64Array(this.memory.buffer, out, 1)[0];
    }

    /**
     * What a fit claims.
     * @param {{centre: number[], shape: number[]}} surface
     * @param {ArrayLike<number>} covariance
     * @param {number} noise
     * @param {ArrayLike<number>} counts Of its readings in each of the hundred cells.
     * @returns {Belief}
     */
    believe({ centre, shape }, covariance, noise, counts) {
        const [centreAt, shapeAt, covarianceAt, countsAt] = this.#lent([centre, shape, covariance, counts]);
        this.call.flinders_believe(centreAt, shapeAt, covarianceAt, noise, countsAt, this.at.belief);
        return this.#decoded("belief");
    }

    /**
     * A sphere through readings that no fit can do anything with yet; null where they do not tell its centre.
     * @param {Float64Array} field
     * @returns {Belief | null}
     */
    rough(field) {
        const [fieldAt] = this.#lent([field]);
        return this.call.flinders_rough(fieldAt, field.length / 3, this.at.belief) ? null : this.#decoded("belief");
    }

    /**
     * Where the next hundredth of the readings would tell most.
     * @param {Belief} belief
     * @param {Wanted} wanted
     * @returns {{direction: number[], worst_deg: number, after_deg: number}}
     */
    guidance(belief, wanted) {
        this.#write("belief", belief);
        this.#write("goal", wanted);
        this.call.flinders_guidance(this.at.belief, this.at.goal, 0, this.at.advice);
        return this.#decoded("advice");
    }

    /**
     * The path of the field from where it points now.
     * @param {Belief} belief
     * @param {Wanted} wanted
     * @param {number[]} here
     * @param {number} readingsPerDeg
     * @returns {{count: number, waypoints: number[], worst_deg: number, after_deg: number}}
     */
    path(belief, wanted, here, readingsPerDeg) {
        const [hereAt] = this.#lent([here]);
        this.#write("belief", belief);
        this.#write("goal", wanted);
        this.call.flinders_path(this.at.belief, this.at.goal, hereAt, readingsPerDeg, this.at.route);
        return this.#decoded("route");
    }

    /**
     * The simplest attitude of the sensor that meets the field near a direction, by its number.
     * @param {Wanted} wanted
     * @param {number[]} direction
     * @returns {number}
     */
    pose(wanted, direction) {
        const [directionAt] = this.#lent([direction]);
        this.#write("goal", wanted);
        return this.call.flinders_pose_towards(SENSOR, this.at.goal, directionAt);
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
     * Address of a part of memory that stays.
     * @param {number} size
     * @returns {number}
     */
    #reserved(size) {
        const at = this.free;
        this.free = aligned(at + size);
        return at;
    }

    /**
     * Addresses of numbers in memory.
     * @param {ArrayLike<number>[]} arrays
     * @returns {number[]}
     */
    #lent(arrays) {
        const places = this.#placed(arrays.map(({ length }) => 8 * length));
        places.forEach((at, i) => new Float64Array(this.memory.buffer, at, arrays[i].length).set(arrays[i]));
        return places;
    }

    /**
     * Addresses of parts of memory of so many bytes each, which are there then.
     * @param {number[]} sizes
     * @returns {number[]}
     */
    #placed(sizes) {
        let end = this.free;
        const places = sizes.map((size) => {
            const at = end;
            end = aligned(at + size);
            return at;
        });
        const missing = end - this.memory.buffer.byteLength;
        if (missing > 0) this.memory.grow(Math.ceil(missing / PAGE));
        return places;
    }

    /** @param {FitOptions} options */
    #choose({ dipDeg, robust, hasStatistics }) {
        this.call.flinders_default_options(this.at.options);
        const { fields } = this.layouts.options;
        const view = new DataView(this.memory.buffer, this.at.options);
        if (dipDeg !== undefined) view.setFloat64(fields.dip_deg[0], dipDeg, true);
        if (robust !== undefined) view.setInt32(fields.robust[0], robust, true);
        if (hasStatistics !== undefined) view.setInt32(fields.statistics[0], Number(hasStatistics), true);
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
            const width = kind === "i4" ? 4 : 8;
            const numbers = typeof value === "number" ? [value] : Array.from(value);
            numbers.forEach((number, i) => WRITE[kind](view, offset + i * width, number));
        }
    }

    /**
     * Fields of a struct by their names.
     * @param {keyof Layouts} struct
     * @returns {any}
     */
    #decoded(struct) {
        const view = new DataView(this.memory.buffer, this.at[struct]);
        const fields = Object.entries(this.layouts[struct].fields).map(([name, [offset, kind, count]]) => {
            const width = kind === "i4" ? 4 : 8;
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
function aligned(address) {
    return Math.ceil(address / ALIGNED) * ALIGNED;
}
