/**
 * Growing buffer of readings with bounded memory, and the spans of time that the user has excluded. The choice of readings
 * in memory depends on their count only.
 */

/** @typedef {[number, number]} Span */

/**
 * Readings of one batch.
 * @typedef {object} Rows
 * @property {ArrayLike<number>} time  (N) seconds; NaN without a time.
 * @property {ArrayLike<number>} field  3 N
 * @property {ArrayLike<number> | null} [acceleration]  3 N
 *
 * Readings in another buffer's memory from number `first` on: of `total` received, one of `stride`.
 * @typedef {Rows & {first: number, stride: number, total: number, latest: ArrayLike<number>}} Passed
 */

const INITIAL_CAPACITY = 4096;
/** Largest number of steps that can be undone, and of excluded spans. */
const MAX_UNDO_STEPS = 200;
const MAX_SPANS = 1000;

/**
 * Smallest power of two by which `total` readings are thinned to at most `most`.
 * @param {number} total
 * @param {number} most
 * @returns {number}
 */
export function strideFor(total, most) {
    let stride = 1;
    while (stride * most < total) stride *= 2;
    return stride;
}

/** Converts the times of a source to the times of a session, which never decrease. */
export class Timeline {
    constructor() {
        this.last = NaN;
        this.shift = 0;
        this.at = -Infinity;
    }

    /**
     * Times of the session for times of the source. After the clock was set back, the session's time continues from its
     * last time. A reading without a time has that of the reading before.
     * @param {ArrayLike<number>} times
     * @returns {Float64Array}
     */
    take(times) {
        if (times.length > 0 && Number.isNaN(this.last)) this.last = Number.isFinite(times[0]) ? times[0] : 0;
        return Float64Array.from(times, (time) => {
            const known = Number.isFinite(time) ? time : this.last;
            this.shift += Math.max(this.last - known, 0);
            this.last = known;
            this.at = Math.max(this.at, known + this.shift);
            return this.at;
        });
    }
}

export class ReadingBuffer {
    /** @param {number} most  Readings in memory; of more, every second one is dropped. */
    constructor(most) {
        this.most = most;
        this.total = 0;
        this.stride = 1;
        this.count = 0;
        this.times = new Float64Array(INITIAL_CAPACITY);
        this.fields = new Float64Array(3 * INITIAL_CAPACITY);
        /** @type {Float64Array | null} */
        this.accelerations = null;
        /** The newest reading with its acceleration, even if not in memory. */
        this.latest = new Float64Array(6).fill(NaN);
        /** Time of the newest reading, s; 0 before the first. */
        this.seconds = 0;
    }

    /** Times in memory, ascending; reading j is number j · `stride`. */
    get time() {
        return this.times.subarray(0, this.count);
    }

    /** Readings in memory, three numbers each. */
    get field() {
        return this.fields.subarray(0, 3 * this.count);
    }

    /** Accelerations in memory, three numbers each, NaN if missing; null if all are missing. */
    get acceleration() {
        return this.accelerations && this.accelerations.subarray(0, 3 * this.count);
    }

    /** @param {Rows} rows */
    extend(rows) {
        const { time, field, acceleration } = rows;
        const { length } = time;
        if (length === 0) return;
        const before = this.total;
        this.total += length;
        this.#thin(strideFor(this.total, this.most));
        this.#put(rows, (this.stride - (before % this.stride)) % this.stride, this.stride);
        const last = 3 * (length - 1);
        for (let axis = 0; axis < 3; axis++) {
            this.latest[axis] = field[last + axis];
            this.latest[3 + axis] = acceleration ? acceleration[last + axis] : NaN;
        }
        this.seconds = time[length - 1];
    }

    /**
     * Add readings of another buffer; known ones, and those after a gap, have no effect.
     * @param {Passed} passed
     */
    follow(passed) {
        const { first, stride, total, latest } = passed;
        this.#thin(stride);
        if (first !== this.count) return;
        this.total = total;
        this.#put(passed, 0, 1);
        for (let i = 0; i < 6; i++) this.latest[i] = latest[1 + i];
        this.seconds = total > 0 ? latest[0] : 0;
    }

    /**
     * Add every `step`-th of some rows, from `first` on.
     * @param {Rows} rows
     * @param {number} first
     * @param {number} step
     */
    #put({ time, field, acceleration }, first, step) {
        this.#reserve(this.count + Math.ceil(time.length / step));
        if (acceleration) this.accelerations ??= new Float64Array(this.fields.length).fill(NaN);
        for (let j = first; j < time.length; j += step) {
            const [from, to] = [3 * j, 3 * this.count];
            this.times[this.count] = time[j];
            for (let axis = 0; axis < 3; axis++) {
                this.fields[to + axis] = field[from + axis];
                if (this.accelerations) this.accelerations[to + axis] = acceleration ? acceleration[from + axis] : NaN;
            }
            this.count += 1;
        }
    }

    /** @param {number} stride */
    #thin(stride) {
        const every = stride / this.stride;
        if (every === 1) return;
        const left = Math.ceil(this.count / every);
        for (let j = 1; j < left; j++) {
            this.times[j] = this.times[j * every];
            this.fields.copyWithin(3 * j, 3 * j * every, 3 * j * every + 3);
            this.accelerations?.copyWithin(3 * j, 3 * j * every, 3 * j * every + 3);
        }
        this.count = left;
        this.stride = stride;
    }

    /** @param {number} count */
    #reserve(count) {
        if (count <= this.times.length) return;
        const room = Math.max(count, Math.min(2 * this.times.length, this.most));
        this.times = enlarge(this.times, room);
        this.fields = enlarge(this.fields, 3 * room);
        if (this.accelerations) this.accelerations = enlarge(this.accelerations, 3 * room);
    }

    /**
     * Ranges of the readings in memory within spans, ends included.
     * @param {readonly Span[]} spans
     * @returns {[number, number][]}  first, and the one after the last
     */
    places(spans) {
        return spans.map(([start, end]) => [firstFrom(this.time, start, false), firstFrom(this.time, end, true)]);
    }

    /** @param {number} seconds @returns {number} Number of readings in memory up to a time. */
    countUpTo(seconds) {
        return firstFrom(this.time, seconds, true);
    }

    /**
     * Number of readings within disjoint spans; of a thinned session to within a stride.
     * @param {readonly Span[]} spans
     * @returns {number}
     */
    countWithin(spans) {
        const count = this.places(spans).reduce((sum, [first, last]) => sum + last - first, 0);
        return Math.min(count * this.stride, this.total);
    }

    /**
     * Indices of the readings in memory outside of spans.
     * @param {readonly Span[]} spans  ascending, apart from each other
     * @returns {Uint32Array}
     */
    outside(spans) {
        const places = this.places(spans);
        const left = new Uint32Array(this.count - places.reduce((sum, [first, last]) => sum + last - first, 0));
        let at = 0;
        let from = 0;
        for (const [first, last] of [...places, [this.count, this.count]]) {
            for (let j = from; j < first; j++) left[at++] = j;
            from = Math.max(from, last);
        }
        return left;
    }
}

/**
 * @param {Float64Array} numbers
 * @param {number} length
 */
function enlarge(numbers, length) {
    const larger = new Float64Array(length);
    larger.set(numbers);
    return larger;
}

/**
 * First index of ascending numbers that are not below a value or, with `above`, above it.
 * @param {Float64Array} numbers
 * @param {number} value
 * @param {boolean} above
 * @returns {number}
 */
function firstFrom(numbers, value, above) {
    let [low, high] = [0, numbers.length];
    while (low < high) {
        const middle = (low + high) >> 1;
        if (numbers[middle] < value || (above && numbers[middle] === value)) low = middle + 1;
        else high = middle;
    }
    return low;
}

/**
 * Sort spans, and merge those that touch.
 * @param {readonly Span[]} spans
 * @returns {Span[]}
 */
export function mergeSpans(spans) {
    /** @type {Span[]} */
    const united = [];
    for (const [start, end] of [...spans].sort(([a, b], [c, d]) => a - c || b - d)) {
        const last = united.at(-1);
        if (last && start <= last[1]) last[1] = Math.max(last[1], end);
        else united.push([start, end]);
    }
    return united;
}

/**
 * @param {readonly Span[]} spans
 * @param {Span} hole
 * @returns {Span[]}
 */
function without(spans, hole) {
    /** @type {(span: Span) => Span[]} */
    const around = ([start, end]) => [[start, Math.min(end, hole[0])], [Math.max(start, hole[1]), end]];
    return spans.flatMap(around).filter(([start, end]) => start < end);
}

/** Excluded spans, ascending and disjoint, with the history of steps. Each step is a new value. */
export class Exclusions {
    /**
     * @param {Span[]} spans
     * @param {Span[][]} past  the last is the nearest
     * @param {Span[][]} future  the last is the nearest
     */
    constructor(spans = [], past = [], future = []) {
        this.spans = spans;
        this.past = past;
        this.future = future;
    }

    /** Whether the largest number of spans is reached. */
    get isFull() {
        return this.spans.length >= MAX_SPANS;
    }

    /** @param {Span} span */
    excluding(span) {
        return this.#then(mergeSpans([...this.spans, span]));
    }

    /** @param {Span} span */
    restoring(span) {
        return this.#then(without(this.spans, span));
    }

    /** Adopt the spans of another page as one step. @param {Span[]} spans */
    replaceSpans(spans) {
        const isSame = (/** @type {Exclusions} */ step) => JSON.stringify(step.spans) === JSON.stringify(spans);
        return [this.undo(), this.redo()].find(isSame) ?? this.#then(spans);
    }

    undo() {
        const before = this.past.at(-1);
        return before ? new Exclusions(before, this.past.slice(0, -1), [...this.future, this.spans]) : this;
    }

    redo() {
        const after = this.future.at(-1);
        return after ? new Exclusions(after, [...this.past, this.spans], this.future.slice(0, -1)) : this;
    }

    /** @param {Span[]} spans @returns {Exclusions} */
    #then(spans) {
        if (JSON.stringify(spans) === JSON.stringify(this.spans) || spans.length > MAX_SPANS) return this;
        return new Exclusions(spans, [...this.past, this.spans].slice(-MAX_UNDO_STEPS));
    }
}
