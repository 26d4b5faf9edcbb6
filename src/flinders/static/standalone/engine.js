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

/** @typedef {{record: Layout, options: Layout, outlier: Layout & {room: number}, change: Layout,
 *     coverage: Layout}} Layouts */

/**
 * Axes that changed their sign or their place while a recording was made.
 * @typedef {object} AxisSwap
 * @property {string} axes
 * @property {number[]} rows Readings, counted from 0, from each of which on it is so, or is so no longer.
 * @property {number} gain How many times closer to an ellipsoid all readings lie once it is undone.
 */

/** @typedef {[weakest: number, strongest: number]} Strengths Of the field, in the unit of the readings; 0 and infinity: unknown. */

const ALIGNED = 16;
const PAGE = 65_536;

/** @type {Record<string, (view: DataView, at: number) => number>} */
const READ = {
    i4: (view, at) => view.getInt32(at, true),
    i8: (view, at) => Number(view.getBigInt64(at, true)),
    f8: (view, at) => view.getFloat64(at, true),
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
        this.options = aligned(exports.__heap_base.value);
        this.record = aligned(this.options + layouts.options.size);
        this.free = aligned(this.record + layouts.record.size);
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
        this.call.flinders_fit(fieldAt, time ? timeAt : 0, rows, this.options, workspace, size, this.record);
        return this.#decoded();
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
        this.call.flinders_drift(fieldAt, rows, surface, surface + 24, dipDeg, workspace, size, this.record);
        return this.#decoded();
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
        this.#put("centre", centre);
        this.#put("shape", shape);
        this.call.flinders_distances(fieldAt, rows, this.record, out);
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
     * Angle within which all readings of a sensor lie that was hardly turned; null of one that was.
     * @param {Float64Array} field
     * @param {Strengths} strengths
     * @returns {number | null}
     */
    unmovedDeg(field, [weakest, strongest]) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const [fieldAt, out, workspace] = this.#placed([field.byteLength, 8, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        this.call.flinders_unmoved(fieldAt, rows, weakest, strongest, workspace, size, out);
        const angle = new Float64Array(this.memory.buffer, out, 1)[0];
        return Number.isNaN(angle) ? null : angle;
    }

    /**
     * Whether the record of the last fit shows by itself a turn out of one plane, at no end of the sensor's range.
     * @param {Strengths} strengths
     * @returns {boolean}
     */
    wasTurned([weakest, strongest]) {
        const [out] = this.#placed([1]);
        this.call.flinders_turned(this.record, 1, weakest, strongest, out);
        return new Uint8Array(this.memory.buffer, out, 1)[0] === 1;
    }

    /**
     * Which readings a fit leaves out: those that are far, and those in a run of far ones and around it.
     * @param {Uint8Array} far 1 or 0 of each reading.
     * @param {number} dense Of the record.
     * @returns {Uint8Array}
     */
    leftOut(far, dense) {
        const [farAt, out] = this.#placed([far.length, far.length]);
        new Uint8Array(this.memory.buffer, farAt, far.length).set(far);
        this.call.flinders_left_out(farAt, far.length, dense, out);
        return new Uint8Array(this.memory.buffer, out, far.length).slice();
    }

    /**
     * The runs of what a fit leaves out.
     * @param {Float64Array} distances From the surface.
     * @param {Uint8Array} out Whether each reading is left out.
     * @param {import("./rests.js").Once} once First and last row of each reading.
     * @param {Float64Array | null} time Of the rows.
     * @returns {import("./outliers.js").Outlier[]}
     */
    outliers(distances, out, { first, last }, time) {
        const rows = distances.length;
        const { size, room } = this.layouts.outlier;
        const columns = [distances, ...(time ? [first, last].map((rows) => Float64Array.from(rows, (row) => time[row])) : [])];
        const [runs, outAt, firstAt, lastAt, ...columnsAt] = this.#placed([room * size, rows, ...Array(5).fill(8 * rows)]);
        new Uint8Array(this.memory.buffer, outAt, rows).set(out);
        new BigInt64Array(this.memory.buffer, firstAt, rows).set(first.map(BigInt));
        new BigInt64Array(this.memory.buffer, lastAt, rows).set(last.map(BigInt));
        columns.forEach((column, i) => new Float64Array(this.memory.buffer, columnsAt[i], rows).set(column));
        const [near, start, end] = columnsAt.map((at, i) => (i < columns.length ? at : 0));
        const count = this.call.flinders_list_outliers(near, outAt, rows, firstAt, lastAt, start, end, runs, 0);
        const listed = Array.from({ length: count }, (_, i) => this.#struct(this.layouts.outlier, runs + i * size));
        return listed.map((run) => ({ ...run, first: run.first + 1, last: run.last + 1 }));
    }

    /**
     * Look for the moments at which axes changed; null where nothing did, or nothing that can be told.
     * @param {Float64Array} field
     * @param {number} noise Of the fit.
     * @param {import("./data.d.ts").EngineData} data
     * @returns {AxisSwap | null}
     */
    axisSwap(field, noise, { swaps, numbers }) {
        const rows = field.length / 3;
        const size = this.call.flinders_swap_workspace_size(rows);
        const { change: layout } = this.layouts;
        const [fieldAt, moments, found, workspace] = this.#placed([field.byteLength, 8 * rows, layout.size, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        this.call.flinders_axis_swap(fieldAt, rows, noise, numbers.SWAP_MAX_NOISE, workspace, size, moments, found);
        const change = this.#struct(layout, found);
        if (change.swap < 0) return null;
        const behind = new BigInt64Array(this.memory.buffer, moments, change.moments);
        return { axes: swaps[change.swap], rows: Array.from(behind, Number), gain: change.gain };
    }

    /**
     * Readings in each of a hundred cells of the sphere, equal in area.
     * @param {Float64Array} field
     * @param {Fitted} record Of these readings; what it rejects is left out.
     * @returns {number[]}
     */
    cellCounts(field, { centre, shape, rejected_beyond: within }) {
        const rows = field.length / 3;
        const size = this.call.flinders_workspace_size(rows);
        const { coverage: layout } = this.layouts;
        const [fieldAt, surface, out, workspace] = this.#placed([field.byteLength, 72, layout.size, size]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        new Float64Array(this.memory.buffer, surface, 9).set([...centre, ...shape]);
        this.call.flinders_coverage_of(fieldAt, rows, surface, surface + 24, within, workspace, size, out);
        return this.#struct(layout, out).readings;
    }

    /**
     * Whether readings may be those of a level turn, but for the few that are farthest from its plane.
     * @param {Float64Array} field
     * @returns {boolean}
     */
    hidesPlane(field) {
        const [fieldAt, scratch, covariance] = this.#placed([field.byteLength, (5 * field.byteLength) / 3, 48]);
        new Float64Array(this.memory.buffer, fieldAt, field.length).set(field);
        this.call.flinders_trimmed_covariance(fieldAt, field.length / 3, scratch, covariance);
        return this.call.flinders_is_level(covariance, Infinity, 1) === 1;
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
        this.call.flinders_default_options(this.options);
        const { fields } = this.layouts.options;
        const view = new DataView(this.memory.buffer, this.options);
        if (dipDeg !== undefined) view.setFloat64(fields.dip_deg[0], dipDeg, true);
        if (robust !== undefined) view.setInt32(fields.robust[0], robust, true);
        if (hasStatistics !== undefined) view.setInt32(fields.statistics[0], Number(hasStatistics), true);
    }

    /**
     * @param {string} name
     * @param {number[]} numbers
     */
    #put(name, numbers) {
        new Float64Array(this.memory.buffer, this.record + this.layouts.record.fields[name][0], numbers.length).set(numbers);
    }

    /** @returns {Fitted} */
    #decoded() {
        return this.#struct(this.layouts.record, this.record);
    }

    /**
     * @param {Layout} layout
     * @param {number} at
     * @returns {any} Its fields by their names.
     */
    #struct(layout, at) {
        const view = new DataView(this.memory.buffer, at);
        const fields = Object.entries(layout.fields).map(([name, [offset, kind, count]]) => {
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
