/**
 * Where names stand of a header that has another number of them than lines have fields. As `readers/_heading.py`, but for
 * what takes a sphere through columns: where only that tells, nothing is taken.
 */

import { counted, median } from "./patterns.js";

/** @typedef {import("./clocks.js").Clock} Clock */
/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {import("./patterns.js").Rules} Rules */

/**
 * A name for each column, nothing where it has none; all nothing where values leave it open.
 * @param {Rules} rules
 * @param {Names} known
 * @param {string[]} names
 * @param {number[][]} values
 * @param {readonly Clock[]} clocks
 * @returns {string[]}
 */
export function shifted(rules, known, names, values, clocks) {
    const { WORSE } = rules.heading;
    const told = clocks.flatMap(({ cells }) => cells);
    const columns = (values[0] ?? []).map((_, place) => values.map((row) => row[place]));
    /** @type {Map<string, {doubts: number, header: string[], cells: number[]}>} */
    const places = new Map();
    for (const header of headers(names, columns.length)) {
        const cells = known.magnetometer(header)?.cells ?? [];
        const doubts = doubtsOf(rules, known, header, columns, cells, told);
        const before = places.get(cells.join())?.doubts ?? WORSE - 1;
        if (cells.length && doubts <= before) places.set(cells.join(), { doubts, header, cells });
    }
    const least = Math.min(...[...places.values()].map(({ doubts }) => doubts));
    const best = [...places.values()].filter(({ doubts }) => doubts === least);
    const alike = best.filter(({ cells }) => areAlike(rules.likeness, cells.map((cell) => columns[cell])));
    const one = best.length > 1 ? alike : best;
    return one.length === 1 ? one[0].header : [];
}

/**
 * All ways to leave out columns, or names, in one place; the last leaves the names in place from the left.
 * @param {string[]} names
 * @param {number} width
 */
function headers(names, width) {
    const over = width - names.length;
    const gap = Array.from({ length: Math.max(over, 0) }, () => "");
    const ways = over > 0 ? names.length + 1 : width + 1;
    return Array.from({ length: ways }, (_, at) => [...names.slice(0, at), ...gap, ...names.slice(at + Math.max(-over, 0))]);
}

/**
 * How badly values agree with names; 0 where nothing speaks against them.
 * @param {Rules} rules
 * @param {Names} known
 * @param {string[]} header
 * @param {number[][]} columns
 * @param {number[]} field
 * @param {number[]} told Places of times that are no numbers, and of their dates.
 */
function doubtsOf({ heading, likeness, names }, known, header, columns, field, told) {
    const { WORSE, BAD } = heading;
    let doubts = WORSE * field.filter((place) => told.includes(place) || isNoAxis(likeness, columns[place])).length;
    if (Math.max(...field) - Math.min(...field) >= field.length) doubts += BAD;
    let isTimed = false;
    for (const [place, name] of header.entries()) {
        const kind = name && !field.includes(place) ? known.meaning(name).kind : "";
        const ofTime = told.includes(place) ? 0 : doubtsOfTime(likeness, BAD, columns[place]);
        const isText = columns[place].filter(Number.isNaN).length > 0.5 * columns[place].length;
        if ([names.FIELD, names.ACCELERATION, names.RATE].includes(kind) && isText) doubts++;
        if (kind !== names.TIME) continue;
        isTimed = true;
        doubts += known.isLetterOfTime(name) ? Math.min(ofTime, 1) : ofTime;
    }
    return doubts + Number(!isTimed);
}

/**
 * How badly a column agrees with the name of a time: it is to rise, and to count no rows.
 * @param {Constants} likeness
 * @param {number} bad
 * @param {number[]} column
 */
function doubtsOfTime(likeness, bad, column) {
    const values = column.filter((value) => Math.abs(value) < likeness.LARGEST);
    return ascends(values) ? Number(stepsOf(values).every((step) => step === 1)) : bad;
}

/**
 * Whether a column can be no axis beside others that can: words, a clock, a counter, a state or a constant.
 * @param {Constants} likeness
 * @param {number[]} column
 */
function isNoAxis(likeness, column) {
    const { LARGEST, FEWEST, SELDOM } = likeness;
    const values = column.filter((value) => Math.abs(value) < LARGEST);
    if (values.length < 0.5 * column.length || column.length < FEWEST) return true;
    const steps = stepsOf(values);
    const [rising, falling] = [steps.filter((step) => step > 0), steps.filter((step) => step < 0)];
    return (
        !rising.length || !falling.length || beginsAgain(likeness, rising, falling) || rising.length + falling.length <= SELDOM * steps.length
    );
}

/**
 * Whether a clock or a counter begins again and again: it rises by even steps, and falls by larger ones.
 * @param {Constants} likeness
 * @param {number[]} rising
 * @param {number[]} falling
 */
function beginsAgain({ EVEN, MOSTLY }, rising, falling) {
    if (falling.length >= rising.length) return false;
    const usual = median(rising);
    const even = rising.filter((step) => Math.abs(step - usual) <= EVEN * usual).length;
    return even >= MOSTLY * rising.length && falling.every((step) => -step > (1 + EVEN) * usual);
}

/**
 * Whether a column rises from row to row, through so many as only a clock or a counter does.
 * @param {Constants} likeness
 * @param {number[]} column
 */
export function onlyRises({ SURE, LARGEST }, column) {
    const values = column.filter((value) => Math.abs(value) < LARGEST);
    return values.length >= SURE && ascends(values);
}

/**
 * Whether columns are written alike, as axes of one sensor are.
 * @param {Constants} likeness
 * @param {number[][]} columns
 */
function areAlike(likeness, columns) {
    const rows = columns[0].flatMap((_, i) => (columns.every((column) => Number.isFinite(column[i])) ? [i] : []));
    const written = columns.map((column) => writtenOf(likeness, rows.map((row) => column[row])));
    const steps = written.map(([, step]) => step).filter(Boolean);
    return counted(written.map(([decimals]) => decimals)).size === 1 && counted(steps).size < 2;
}

/**
 * Decimals, and the step between numbers in the last one, 0 for few different numbers.
 * @param {Constants} likeness
 * @param {number[]} values
 * @returns {[number, number]}
 */
function writtenOf({ FEW, MANY_DECIMALS, LARGEST_WRITTEN }, values) {
    const distinct = [...new Set(values)];
    const decimals = Math.max(...distinct.map((value) => (`${value}`.split(".")[1] ?? "").length));
    if (decimals >= MANY_DECIMALS || distinct.some((value) => Math.abs(value) >= LARGEST_WRITTEN)) return [MANY_DECIMALS, 1];
    const all = distinct.map((value) => Math.round(value * 10 ** decimals));
    const step = all.reduce((divisor, value) => greatestDivisor(divisor, Math.abs(value - all[0])), 0);
    return [decimals, all.length >= FEW ? step : 0];
}

/**
 * @param {number} one
 * @param {number} other
 * @returns {number}
 */
function greatestDivisor(one, other) {
    return other ? greatestDivisor(other, one % other) : one;
}

/** @param {number[]} values */
export function ascends(values) {
    return values.length > 1 && values.every((value, i) => i === 0 || value > values[i - 1]);
}

/** @param {number[]} values */
export function stepsOf(values) {
    return values.slice(1).map((value, i) => value - values[i]);
}
