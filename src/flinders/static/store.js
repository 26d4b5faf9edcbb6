/**
 * What the page knows: the last state, fit and hello of its session, and the readings shown. Nothing is decided here.
 */

/** @typedef {import("./messages.d.ts").Hello} Hello */
/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./messages.d.ts").View} View */
/** @typedef {import("./messages.d.ts").FromSession} FromSession */

const MAGIC = 0x464c4e44;
const HEADER_BYTES = 32;
const NOW_NUMBERS = 6;
const FIRST_ROOM = 4096;

/**
 * Readings, as the page keeps them. The arrays may be longer than `count`.
 * @typedef {object} Points
 * @property {number} count
 * @property {Float32Array} time Seconds since the session began.
 * @property {Float32Array} field Three numbers a reading, raw.
 * @property {Float32Array | null} acceleration
 * @property {number} stride Point j is reading number j · stride.
 */

/**
 * The newest reading.
 * @typedef {object} Now
 * @property {[number, number, number]} raw
 * @property {[number, number, number] | null} acceleration
 */

/** Raised for a frame that does not follow on what is here: the page then asks its session for all of it. */
export class Gap extends Error {}

/**
 * The errors that count for what the calibration is for.
 * @param {View | null} view
 * @param {string} goal
 * @returns {{rms: number | null, worst: number | null}}
 */
export function errors(view, goal) {
    const pair = goal === "attitude" ? view?.any_attitude_deg : view?.heading_error_deg;
    return { rms: pair?.rms ?? null, worst: pair?.worst ?? null };
}

/**
 * Whether somebody can still turn the sensor: neither a log nor a playback that has ended.
 * @param {State} state
 * @returns {boolean}
 */
export function goesOn({ opened, source }) {
    return opened === null && source.link !== "ended" && source.kind !== "file";
}

export class Store {
    constructor() {
        /** @type {Hello | null} */
        this.hello = null;
        /** @type {State | null} */
        this.state = null;
        /** @type {View | null} */
        this.view = null;
        /** @type {Now | null} */
        this.now = null;
        /** @type {number | null} point that the pointer is at, in any of the views */
        this.hovered = null;
        this.generation = -1;
        /** @type {Points} */
        this.points = noPoints();
    }

    /**
     * Take a message of the session.
     * @param {FromSession} message
     */
    take(message) {
        if (message.type === "hello") {
            this.hello = message;
            this.state = message.state;
            this.view = message.view;
            this.generation = -1;
            Object.assign(this.points, noPoints());
            this.now = null;
        } else if (message.type === "state") {
            this.state = message;
        } else if (message.type === "fit") {
            this.view = message.view;
        }
    }

    /**
     * Take a frame of readings.
     * @param {ArrayBuffer} frame
     * @returns {number} The first point that is new; 0 where all of them are.
     * @throws {Gap} Where readings are missing before those of the frame, or it is no frame.
     */
    takeFrame(frame) {
        if (frame.byteLength < HEADER_BYTES + 4 * NOW_NUMBERS) throw new Gap("the frame is too short");
        const [magic, generation, first, count, flags, stride] = new Uint32Array(frame, 0, 8);
        const accelerated = (flags & 1) === 1;
        const numbers = new Float32Array(frame, HEADER_BYTES);
        if (magic !== MAGIC || numbers.length !== NOW_NUMBERS + count * (accelerated ? 7 : 4)) {
            throw new Gap("the frame is not one of readings");
        }
        let from = first;
        if (generation !== this.generation) {
            this.generation = generation;
            this.hovered = null;
            Object.assign(this.points, noPoints()); // the same object, which charts that were drawn before look into
            from = 0;
        }
        if (stride !== this.points.stride) {
            if (this.points.count > 0) from = 0;
            this.thin(stride);
        }
        if (first > this.points.count) throw new Gap("readings are missing");
        this.now = newest(numbers);
        const points = this.points;
        reserve(points, first + count, accelerated);
        const time = NOW_NUMBERS;
        points.time.set(numbers.subarray(time, time + count), first);
        points.field.set(numbers.subarray(time + count, time + 4 * count), 3 * first);
        if (accelerated) points.acceleration?.set(numbers.subarray(time + 4 * count), 3 * first);
        points.count = Math.max(points.count, first + count);
        return from;
    }

    /**
     * Keep every so many points when the session shows fewer of them.
     * @param {number} stride
     */
    thin(stride) {
        this.hovered = null;
        const { points } = this;
        const every = stride / points.stride;
        if (points.count > 0 && (!Number.isInteger(every) || every < 1)) points.count = 0;
        const left = Math.ceil(points.count / Math.max(1, every));
        for (let j = 1; j < left; j++) {
            points.time[j] = points.time[j * every];
            for (let axis = 0; axis < 3; axis++) {
                points.field[3 * j + axis] = points.field[3 * j * every + axis];
                if (points.acceleration) points.acceleration[3 * j + axis] = points.acceleration[3 * j * every + axis];
            }
        }
        points.count = left;
        points.stride = stride;
    }
}

/** @returns {Points} */
function noPoints() {
    return {
        count: 0,
        time: new Float32Array(FIRST_ROOM),
        field: new Float32Array(3 * FIRST_ROOM),
        acceleration: null,
        stride: 1,
    };
}

/**
 * Make room for so many points; room doubles, so that appending stays cheap.
 * @param {Points} points
 * @param {number} count
 * @param {boolean} accelerated
 */
function reserve(points, count, accelerated) {
    let room = points.time.length;
    while (room < count) room *= 2;
    if (room > points.time.length) {
        points.time = grown(points.time, room);
        points.field = grown(points.field, 3 * room);
        if (points.acceleration) points.acceleration = grown(points.acceleration, 3 * room);
    }
    if (accelerated && !points.acceleration) points.acceleration = new Float32Array(3 * room).fill(NaN);
}

/**
 * @param {Float32Array} numbers
 * @param {number} length
 * @returns {Float32Array}
 */
function grown(numbers, length) {
    const larger = new Float32Array(length);
    larger.set(numbers);
    return larger;
}

/**
 * @param {Float32Array} numbers
 * @returns {Now | null}
 */
function newest(numbers) {
    const [x, y, z, a, b, c] = numbers;
    if (!Number.isFinite(x + y + z)) return null;
    return { raw: [x, y, z], acceleration: Number.isFinite(a + b + c) ? [a, b, c] : null };
}
