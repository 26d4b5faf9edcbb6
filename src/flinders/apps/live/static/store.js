/**
 * Data of the page: the last state, fit and greeting of its session, and the readings shown.
 */

/** @typedef {import("./messages.d.ts").Hello} Hello */
/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("./messages.d.ts").FromSession} FromSession */
/** @typedef {import("../../../static/view.d.ts").Points} Points */
/** @typedef {import("../../../static/view.d.ts").Now} Now */

const INITIAL_CAPACITY = 4096;

/**
 * The errors that matter for the goal of the calibration.
 * @param {View | null} view
 * @param {string} goal
 * @returns {{rms: number | null, worst: number | null}}
 */
export function errors(view, goal) {
    const pair = goal === "attitude" ? view?.any_attitude_deg : view?.heading_error_deg;
    return { rms: pair?.rms ?? null, worst: pair?.worst ?? null };
}

/**
 * Whether further readings count: not for a log, an ended playback or a finished calibration.
 * @param {State} state
 * @returns {boolean}
 */
export function goesOn({ opened, source, finished }) {
    return opened === null && finished === null && source.link !== "ended" && source.kind !== "file";
}

/**
 * Whether a finished calibration can continue with further readings.
 * @param {State} state
 * @returns {boolean}
 */
export function canCollect({ finished, source }) {
    return finished !== null && (finished.since > 0 || source.link !== "ended");
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
        /** @type {number | null} point under the pointer, in any of the views */
        this.hovered = null;
        this.generation = -1;
        /** Number of readings at the newest of the points. */
        this.total = -1;
        /** One of so many readings in memory is shown; -1 before the first. */
        this.most = -1;
        /** @type {Points} */
        this.points = noPoints();
    }

    /**
     * Store a message of the session.
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
     * Add new readings of a series, one of `stride`; after Finish, only the newest.
     * @param {import("./standalone/session.js").Series} series
     * @param {number} stride
     * @returns {number} The first point that is new; Infinity where nothing is.
     */
    follow({ generation, buffer, finishedS }, stride) {
        const { points } = this;
        const isOther = generation !== this.generation;
        const isThinner = stride !== points.stride;
        const most = finishedS === null ? buffer.count : buffer.countUpTo(finishedS);
        if (!isOther && !isThinner && buffer.total === this.total && most === this.most) return Infinity;
        if (isOther) Object.assign(points, noPoints()); // keep the object, which charts refer to
        if (isOther || isThinner) this.hovered = null;
        thin(points, stride);
        const from = points.count;
        append(points, buffer, most);
        Object.assign(this, { generation, most, total: buffer.total, now: newest(buffer.latest) });
        return isOther || isThinner || points.count < from ? 0 : from;
    }
}

/** @returns {Points} */
function noPoints() {
    return {
        count: 0,
        time: new Float32Array(INITIAL_CAPACITY),
        field: new Float32Array(3 * INITIAL_CAPACITY),
        acceleration: null,
        stride: 1,
    };
}

/**
 * Keep one of `stride` readings.
 * @param {Points} points
 * @param {number} stride
 */
function thin(points, stride) {
    const every = stride / points.stride;
    points.count = every < 1 ? 0 : Math.ceil(points.count / every);
    points.stride = stride;
    if (every <= 1) return;
    for (let j = 1; j < points.count; j++) {
        points.time[j] = points.time[j * every];
        for (const numbers of [points.field, points.acceleration]) numbers?.copyWithin(3 * j, 3 * j * every, 3 * j * every + 3);
    }
}

/**
 * Add missing readings up to a count, and remove those beyond.
 * @param {Points} points
 * @param {import("./standalone/buffer.js").ReadingBuffer} buffer
 * @param {number} most
 */
function append(points, buffer, most) {
    const step = points.stride / buffer.stride;
    const { time, field, acceleration } = buffer;
    const count = Math.ceil(most / step);
    reserve(points, count, acceleration !== null);
    for (let j = points.count; j < count; j++) {
        points.time[j] = time[j * step];
        points.field.set(field.subarray(3 * j * step, 3 * j * step + 3), 3 * j);
        if (acceleration) points.acceleration?.set(acceleration.subarray(3 * j * step, 3 * j * step + 3), 3 * j);
    }
    points.count = count;
}

/**
 * Reserve capacity for points; it doubles, so that appending stays cheap.
 * @param {Points} points
 * @param {number} count
 * @param {boolean} accelerated
 */
function reserve(points, count, accelerated) {
    let room = points.time.length;
    while (room < count) room *= 2;
    if (room > points.time.length) {
        points.time = enlarge(points.time, room);
        points.field = enlarge(points.field, 3 * room);
        if (points.acceleration) points.acceleration = enlarge(points.acceleration, 3 * room);
    }
    if (accelerated && !points.acceleration) points.acceleration = new Float32Array(3 * room).fill(NaN);
}

/**
 * @param {Float32Array} numbers
 * @param {number} length
 * @returns {Float32Array}
 */
function enlarge(numbers, length) {
    const larger = new Float32Array(length);
    larger.set(numbers);
    return larger;
}

/**
 * @param {ArrayLike<number>} latest  reading and acceleration
 * @returns {Now | null}
 */
function newest(latest) {
    const [x, y, z, a, b, c] = Array.from(latest);
    if (!Number.isFinite(x + y + z)) return null;
    return { raw: [x, y, z], acceleration: Number.isFinite(a + b + c) ? [a, b, c] : null };
}
