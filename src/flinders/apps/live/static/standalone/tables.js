/** Tables: delimiter, decimal sign and header, and which columns are the magnetometer and the time. Like `readers/_layout.py`. */

import { clocksOf, midnights } from "./clocks.js";
import { countKeys, largest, median, replaceAll, stripLetters, whole } from "./patterns.js";

/** @typedef {import("./clocks.js").Clock} Clock */
/** @typedef {import("./names.js").Meaning} Meaning */
/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Rules} Rules */
/** @typedef {import("./printed.js").Prints} Prints */

/**
 * The columns to read.
 * @typedef {object} Columns
 * @property {number[]} field Places of x, y and z.
 * @property {string[]} names Names of these columns, or their numbers from 1.
 * @property {string} unit The recorded unit: `uT`, `mG` … or `counts`.
 * @property {number} [scale] µT of a count, if the user states it.
 * @property {number[] | null} acceleration Places of the acceleration.
 * @property {Sensor | null} only The rows to read, if a column names the sensor of each row.
 * @property {{cell: number, name: string, factor: number, start: number, fraction: number | null, clock: Clock | null} | null} time
 *     The time column: its place and name, seconds in one unit, first time, place of a column of nanoseconds, and clock of
 *     times of day; null without times.
 */

/**
 * A column with the sensor of each row, and its word for the magnetometer.
 * @typedef {{cell: number, word: string}} Sensor
 */

/**
 * Format of a table.
 * @typedef {object} Layout
 * @property {string} delimiter
 * @property {string} decimal
 * @property {number} width Cells in each line; 0 if lines differ.
 * @property {string[]} header
 * @property {string} headerText
 * @property {Columns} columns
 */

/**
 * The user's choice of the magnetometer's columns: places of x, y and z, and their unit.
 * @typedef {{field: number[], unit: string, scale?: number}} Choice
 */

/**
 * Names and first rows of a table, shown for the choice.
 * @typedef {{names: string[], rows: string[][]}} Asked
 */

/** Hint at commands that read more formats. */
export const MORE_WITH = "`flinders calibrate FILE` reads more, and so does `flinders live --replay FILE`";

/** A text without recognised readings; the message states the reason and a remedy. */
export class Unreadable extends Error {}

/** Lines of several sensors without a clear choice. */
export class Several extends Unreadable {}

/** A table with ambiguous columns, which the user can choose. */
export class Unclear extends Unreadable {
    /**
     * @param {string} message
     * @param {readonly string[]} names Empty without a header.
     */
    constructor(message, names) {
        super(message);
        this.names = names;
        /** @type {string[][]} The first rows, if known. */
        this.rows = [];
    }

    /** @returns {Asked} */
    get question() {
        const names = this.names.length ? [...this.names] : (this.rows[0] ?? []).map((_, place) => `${place + 1}`);
        return { names, rows: this.rows.slice(0, SHOWN_ROWS) };
    }
}

/** Rows to show for the choice. */
const SHOWN_ROWS = 5;
/** Largest number of words in a column's name. */
const MAX_NAME_WORDS = 3;

export class Tables {
    /**
     * @param {Rules} rules
     * @param {Prints} prints
     */
    constructor(rules, prints) {
        this.rules = rules;
        this.layout = rules.layout;
        /** @type {[string, string][]} Delimiter and decimal sign. */
        this.signs = rules.layout.SIGNS;
        this.prints = prints;
        this.names = prints.names;
    }

    /**
     * Layout of a table, from its first lines.
     * @param {string[]} texts
     * @param {Choice | null} [choice]
     * @param {string[]} [every] All lines.
     * @returns {Layout}
     */
    layoutOf(texts, choice = null, every = texts) {
        const lines = texts.flatMap((text, place) => (text.trim() && !this.prints.isComment(text) ? [{ text, place }] : []));
        if (!lines.length) throw new Unreadable("it holds no lines of numbers: need one reading a line");
        for (const some of [lines.slice(0, this.layout.TRIED_LINES), lines]) {
            const cuts = this.signsOf(some).map((signs) => this.cutAt(some, signs));
            const best = largest(cuts, ({ rows, numbers }) => [rows.size, numbers]);
            if (best?.rows.size) return this.table(texts, best, choice, every);
        }
        const isHeader = (/** @type {string} */ text) =>
            this.signs.some(([sign]) => this.names.magnetometer(this.prints.split(text, sign)));
        if (lines.slice(0, this.layout.MAX_LINES_ABOVE).some(({ text }) => isHeader(text))) throw new Unreadable(`it has a header and no readings below it: record again, or check what was saved; ${MORE_WITH}`);
        const [{ place, text }] = lines;
        throw new Unreadable(
            `no readings are recognised (line ${place + 1}: '${text.trim().slice(0, 60)}'): need three columns of numbers, ` +
                `or labels such as 'X: -20.8 Y: -20.2 Z: 26.1 uT'; ${MORE_WITH}`,
        );
    }

    /**
     * Whether lines are a table with column names, separated by more than spaces.
     * @param {string[]} texts
     */
    isTable(texts) {
        try {
            const { header, delimiter } = this.layoutOf(texts.slice(0, this.layout.TRIED_LINES));
            return header.length > 0 && delimiter !== this.rules.tokenizer.SPACES;
        } catch (error) {
            if (error instanceof Unreadable) return error instanceof Several || (error instanceof Unclear && error.names.length > 0);
            throw error;
        }
    }

    /**
     * Delimiters and decimal signs that lines may have.
     * @param {{text: string}[]} lines
     * @returns {[string, string][]}
     */
    signsOf(lines) {
        const has = (/** @type {string} */ sign) => lines.some(({ text }) => text.includes(sign));
        return this.signs.filter(([delimiter, decimal]) => decimal === "." || has(delimiter === "," ? '"' : ","));
    }

    /**
     * Lines split at a delimiter that hold three numbers, and more numbers than words.
     * @param {{text: string, place: number}[]} lines
     * @param {[string, string]} signs
     */
    cutAt(lines, [delimiter, decimal]) {
        /** @type {Map<number, string[]>} */
        const rows = new Map();
        let total = 0;
        for (const { text, place } of lines) {
            const cells = this.prints.split(text, delimiter);
            const filled = cells.filter((cell) => cell.trim());
            const numbers = filled.filter((cell) => this.prints.number(cell, decimal) !== null).length;
            if (numbers < 3 || 2 * numbers < filled.length) continue;
            rows.set(place, cells);
            total += numbers;
        }
        return { delimiter, decimal, rows, numbers: total };
    }

    /**
     * @param {string[]} texts
     * @param {{delimiter: string, decimal: string, rows: Map<number, string[]>}} cut
     * @param {Choice | null} choice
     * @param {string[]} every
     * @returns {Layout}
     */
    table(texts, { delimiter, decimal, rows: all }, choice, every) {
        const only = this.sensorOf([...all.values()]);
        const rows = only ? new Map([...all].filter(([, cells]) => this.isOf(only, cells))) : all;
        const widths = countKeys([...rows.values()].map((cells) => cells.length));
        let width = /** @type {number} */ (largest([...widths.keys()], (each) => [widths.get(each) ?? 0]));
        const often = widths.get(width) ?? 0;
        if (width > this.layout.MAX_COLUMNS) {
            throw new Unreadable(`it has ${width} columns: cut the magnetometer's out, with its time`);
        }
        const alike = [...rows.values()].filter((cells) => cells.length === width);
        const start = Math.min(...[...rows].filter(([, cells]) => cells.length === width).map(([place]) => place));
        const isEmpty = (/** @type {number} */ place) => alike.every((cells) => !cells[place].trim());
        let filled = width;
        while (filled > 0 && isEmpty(filled - 1)) filled--;
        const { place, names } = this.header(texts.slice(0, start), delimiter, filled, width);
        width = filled <= names.length && names.length <= width ? names.length : filled;
        const cut = alike.map((cells) => cells.slice(0, width));
        const units = place < 0 ? [] : this.units(texts.slice(place + 1, start), delimiter, names.length);
        const columns = this.columns(names, cut, decimal, choice, { units, only });
        this.refuseSeveral(names, () => every.map((text) => this.prints.split(text, delimiter)), only);
        this.refuseThousands(alike, columns, decimal);
        const isEven = names.length > 0 || often >= this.layout.MIN_SAME_WIDTH_SHARE * rows.size;
        const headerText = place < 0 ? "" : texts[place];
        return { delimiter, decimal, width: isEven ? width : 0, header: names, headerText, columns };
    }

    /**
     * The numbers of the first rows, and the columns that are times of day, whose seconds are among them.
     * @param {readonly string[][]} rows
     * @param {string} decimal
     */
    numbersOf(rows, decimal) {
        const some = rows.slice(0, this.layout.SAMPLED_ROWS);
        const values = some.map((cells) => cells.map((cell) => this.prints.number(cell, decimal) ?? NaN));
        const isText = (/** @type {number} */ place) =>
            values.filter((row) => Number.isFinite(row[place])).length < 0.5 * values.length;
        const clocks = clocksOf(this.rules.clock, some, [...(values[0] ?? []).keys()].filter(isText));
        for (const { cell, seconds } of clocks) {
            const past = midnights();
            values.forEach((row, i) => (row[cell] = past(seconds(some[i]))));
        }
        return { values, clocks };
    }

    /**
     * The nearest line above the readings that names a magnetometer, else any columns.
     * @param {string[]} above
     * @param {string} delimiter
     * @param {number} filled Number of non-empty cells of a line.
     * @param {number} width Number of all cells.
     * @returns {{place: number, names: string[]}}
     */
    header(above, delimiter, filled, width) {
        /** @type {{place: number, names: string[]}} */
        let other = { place: -1, names: [] };
        for (let place = above.length - 1; place >= 0; place--) {
            const all = this.namesIn(above[place], delimiter);
            if (!this.prints.fits(all, width) && !(filled <= all.length && all.length < width)) continue;
            const names = all.slice(0, width);
            if (names.every((name) => !name || this.names.isUnit(name))) continue;
            if (this.names.magnetometer(names)) return { place, names };
            const couldName = this.couldName(names, delimiter) && !this.prints.isComment(above[place]);
            if (!other.names.length && couldName) other = { place, names };
        }
        return other;
    }

    /**
     * Cells of a line of names, also in a comment.
     * @param {string} text
     * @param {string} delimiter
     */
    namesIn(text, delimiter) {
        const bare = text.trimStart();
        const sign = this.rules.tokenizer.COMMENTS.find((/** @type {string} */ each) => bare.startsWith(each));
        const line = sign ? bare.slice(sign.length).trimStart() : text;
        return this.prints.split(line, delimiter).map((cell) => cell.trim());
    }

    /**
     * Whether names are a header, and not a sentence.
     * @param {string[]} names
     * @param {string} delimiter
     */
    couldName(names, delimiter) {
        const isName = (/** @type {string} */ name) => this.prints.number(name) === null && name.split(" ").length <= MAX_NAME_WORDS;
        const isText = names.some(Boolean) && names.every((name) => !name || isName(name));
        return isText && (delimiter !== this.rules.tokenizer.SPACES || names.some((name) => this.names.meaning(name).kind));
    }

    /**
     * Row of units, one a column, between the header and the readings.
     * @param {string[]} below
     * @param {string} delimiter
     * @param {number} width
     * @returns {string[]}
     */
    units(below, delimiter, width) {
        for (const text of below) {
            const cells = this.namesIn(text, delimiter).map((cell) => cell.replace(/^[[\]()]+|[[\]()]+$/g, ""));
            const units = cells.map((cell) => (this.names.isUnit(cell) ? cell : ""));
            const least = Math.max(3, cells.filter(Boolean).length / 2);
            if (this.prints.fits(cells, width) && units.filter(Boolean).length >= least) return units;
        }
        return [];
    }

    /**
     * Columns to read of a table with some names, or none, and first rows.
     * @param {readonly string[]} names
     * @param {readonly string[][]} rows
     * @param {string} decimal
     * @param {Choice | null} choice
     * @param {{units?: readonly string[], only: Sensor | null}} known Units from a row below the header.
     * @returns {Columns}
     * @throws {Unclear} If names are ambiguous, and no choice is given.
     */
    columns(names, rows, decimal, choice, { units = [], only }) {
        const { values, clocks } = this.numbersOf(rows, decimal);
        try {
            const scale = choice?.scale;
            if (!names.length) return { ...this.byPlace(values, clocks, choice, only), only, scale };
            const columns = this.byName(names, values, units, clocks, choice);
            return { ...columns, only, scale, unit: scale ? columns.unit : this.unitInColumn(names, rows, columns.unit) };
        } catch (error) {
            if (error instanceof Unclear) error.rows = rows.slice(0, SHOWN_ROWS);
            throw error;
        }
    }

    /**
     * @param {readonly string[]} names
     * @param {number[][]} values
     * @param {readonly string[]} units
     * @param {readonly Clock[]} clocks
     * @param {Choice | null} choice
     * @returns {Omit<Columns, "only">}
     */
    byName(names, values, units, clocks, choice) {
        if (!choice) this.refusePulses(names);
        const meanings = this.meaningsOf(names, values, units, clocks);
        const found = choice ? null : this.names.magnetometer(names, meanings);
        if (!found && !choice) throw new Unclear(`no magnetometer among the columns ${namesText(names)}`, names);
        const field = choice?.field ?? /** @type {import("./names.js").Vector} */ (found).cells;
        const own = field.map((cell) => names[cell].trim());
        if (!choice) this.refuseUnclear(names, own);
        const stated = new Set(field.map((cell) => meanings[cell].unit));
        const told = (stated.size === 1 && [...stated][0]) || this.unitByConvention(names, own[0]) || this.rules.units.COUNTS;
        const time = this.timeOf(names, meanings, values, field, clocks);
        return { field, names: own, unit: choice?.unit || told, time, acceleration: this.accelerationOf(names, meanings, field) };
    }

    /**
     * @param {readonly string[]} names
     * @param {number[][]} values
     * @param {readonly string[]} units
     * @param {readonly Clock[]} clocks
     */
    meaningsOf(names, values, units, clocks) {
        const meanings = names.map((name, place) => {
            const own = this.names.meaning(name);
            return units[place] && !own.unit ? this.names.meaning(`${name} (${units[place]})`) : own;
        });
        const { TIME } = this.rules.names;
        const { UNNAMED_TIME_RANK } = this.rules.columns;
        for (const { cell } of clocks) {
            const { kind, rank } = meanings[cell];
            meanings[cell] = { kind: TIME, axis: "", unit: "s", rank: kind === TIME ? rank + 2 : UNNAMED_TIME_RANK };
        }
        const isOpen = (/** @type {number} */ place) => !meanings[place].kind || this.names.isBare(names[place]);
        const isAbscissa = meanings.flatMap(({ axis }, place) => (axis && isOpen(place) ? [axis] : [])).join(" ") === "x";
        const isUnnamed = (/** @type {number} */ place) => isOpen(place) && (!names[place].trim() || (isAbscissa && meanings[place].axis));
        const unnamed = names.findIndex((_, place) => isUnnamed(place) && isClock(values.map((row) => row[place])));
        if (unnamed >= 0) meanings[unnamed] = { kind: TIME, axis: "", unit: "", rank: UNNAMED_TIME_RANK };
        return meanings;
    }

    /**
     * The accelerometer to read with a magnetometer.
     * @param {readonly string[]} names
     * @param {readonly Meaning[]} meanings
     * @param {number[]} field
     */
    accelerationOf(names, meanings, field) {
        const { ACCELERATION } = this.rules.names;
        const free = meanings.map((meaning, place) => (field.includes(place) ? { ...meaning, kind: "" } : meaning));
        return this.names.best(names, this.names.vectors(names, ACCELERATION, free))?.cells ?? null;
    }

    /**
     * @param {number[][]} values
     * @param {readonly Clock[]} clocks
     * @param {Choice | null} choice
     * @param {Sensor | null} only
     * @returns {Omit<Columns, "only">}
     */
    byPlace(values, clocks, choice, only) {
        const width = values[0]?.length ?? 0;
        const column = (/** @type {number} */ place) => values.map((row) => row[place]);
        const [clock] = clocks;
        const isDate = (/** @type {number} */ place) => place + 1 === clock?.cell && !column(place).some(Number.isFinite);
        const free = [...Array(width).keys()].filter((place) => place !== clock?.cell && place !== only?.cell && !isDate(place));
        const isTimed = free.length === 4 && ascends(column(free[0]).filter(Number.isFinite));
        const field = choice?.field ?? free.slice(isTimed ? 1 : 0);
        if (field.length !== 3) {
            throw new Unclear(`it has ${width} columns and no header: need three, x y z, or four with the time first`, []);
        }
        if (!choice && isClock(column(field[0])) && !isClock(column(field[1])) && !isClock(column(field[2]))) {
            throw new Unclear(`column ${field[0] + 1} only rises, as a clock does and no axis: need three others, x y z`, []);
        }
        const isAhead = isTimed || isClock(column(0));
        const first = clock?.cell ?? (isAhead && field[0] > free[0] ? free[0] : -1);
        const time = first < 0 ? null : { ...this.timeColumn(first, `${first + 1}`, clock ? "s" : "", values), clock: clock ?? null };
        const names = field.map((cell) => `${cell + 1}`);
        const isCut = first >= 0 && this.isCut(column(first));
        return { field, names, unit: choice?.unit || this.rules.units.COUNTS, time: isCut ? null : time, acceleration: null };
    }

    /**
     * Time column of a table; null without a usable one.
     * @param {readonly string[]} names
     * @param {readonly Meaning[]} meanings
     * @param {number[][]} values
     * @param {number[]} field
     * @param {readonly Clock[]} clocks
     * @returns {Columns["time"]}
     */
    timeOf(names, meanings, values, field, clocks) {
        const isTime = (/** @type {number} */ place) =>
            meanings[place].kind === this.rules.names.TIME && !meanings[place].axis && !field.includes(place);
        const places = [...meanings.keys()].filter(isTime);
        const parted = places.filter((place) => this.isParted(names, place, values));
        for (const place of places.toSorted((one, other) => meanings[one].rank - meanings[other].rank)) {
            const clock = clocks.find(({ cell }) => cell === place) ?? null;
            const { unit } = meanings[place];
            const time = { ...this.timeColumn(place, names[place].trim() || `${place + 1}`, unit, values), clock };
            if (parted.includes(place)) return { ...time, fraction: place + 1 };
            const column = values.map((row) => row[place]);
            const known = column.filter(Number.isFinite);
            const isNumeric = known.length >= column.length / 2;
            const falling = stepsOf(known).filter((step) => step < 0).length;
            const isNone = !unit && (2 * falling > known.length / 10 || known[0] === known[known.length - 1]);
            if (!parted.includes(place - 1) && isNumeric && !isNone && !this.isCut(column)) return time;
        }
        return null;
    }

    /**
     * Whether a column has whole seconds, and the next one their nanoseconds.
     * @param {readonly string[]} names
     * @param {number} place
     * @param {number[][]} values
     */
    isParted(names, place, values) {
        const match = place + 1 < names.length ? whole(this.rules.columns.NANOSECONDS, names[place + 1].trim()) : null;
        if (!match || values.filter((row) => Number.isFinite(row[place + 1])).length < values.length / 2) return false;
        const [, stem, seconds, rest] = match;
        const own = names[place].trim().toLowerCase();
        return own === `${stem}${seconds}${rest}`.toLowerCase() || (!stem && own.endsWith(` ${seconds}`.toLowerCase()));
    }

    /**
     * Whether times have too few digits, so that many readings share each.
     * @param {number[]} column
     */
    isCut(column) {
        const { MIN_READINGS_PER_TIME } = this.rules.columns;
        const values = column.filter(Number.isFinite);
        const changes = values.flatMap((value, i) => (i > 0 && value !== values[i - 1] ? [i] : []));
        const lengths = [0, ...changes].map((change, i) => (changes[i] ?? values.length) - change);
        const inside = lengths.length > 2 ? lengths.slice(1, -1) : lengths;
        return values.length >= 2 * MIN_READINGS_PER_TIME && median(inside) >= MIN_READINGS_PER_TIME;
    }

    /**
     * @param {number} cell
     * @param {string} name
     * @param {string} unit
     * @param {number[][]} values
     */
    timeColumn(cell, name, unit, values) {
        const { FACTORS, TIME } = this.rules.names;
        const times = values.map((row) => row[cell]).filter(Number.isFinite);
        const factor = unit ? FACTORS[TIME][unit] : this.secondsInOne(times);
        const first = times[0] ?? 0;
        return { cell, name, factor, start: Math.abs(first) * factor > this.rules.columns.MIN_EPOCH_S ? first : 0, fraction: null, clock: null };
    }

    /**
     * Seconds in the unit of times, inferred from the size of times, then from their steps.
     * @param {number[]} times
     */
    secondsInOne(times) {
        const first = times[0] ?? 0;
        const step = times.length > 1 ? median(times.slice(1).map((time, i) => Math.abs(time - times[i]))) : 0;
        for (const [least, factor] of this.rules.columns.EPOCHS) {
            const isStep = step === 0 || (1e-5 <= step * factor && step * factor <= 10);
            if (least <= first && first < 4 * least && isStep) return factor;
        }
        return step < 2 ? 1 : step < 1e3 ? 1e-3 : step < 5e5 ? 1e-6 : 1e-9;
    }

    /**
     * Unit by convention of ROS messages and the app Sensor Logger.
     * @param {readonly string[]} names
     * @param {string} first
     */
    unitByConvention(names, first) {
        const folded = names.map((name) => name.trim().toLowerCase());
        const hasCovariance = names.some((name) => name.startsWith("magnetic_field_covariance"));
        const isPrinted = first.toLowerCase() === "magnetic_field x" && hasCovariance;
        const isOfRos = this.rules.columns.ROS_ENDINGS.some((/** @type {string} */ end) => first.toLowerCase().endsWith(end));
        if (isPrinted || isOfRos) return "T";
        return ["seconds_elapsed", "x", "y", "z"].every((name) => folded.includes(name)) ? "uT" : "";
    }

    /**
     * Refuse names with an ambiguous magnetometer, and readings that were already corrected.
     * @param {readonly string[]} names
     * @param {string[]} own
     */
    refuseUnclear(names, own) {
        const folded = names.map((name) => name.trim().toLowerCase());
        const bare = this.names.vectors(names, this.rules.names.FIELD).filter(({ cells }) => this.names.isBare(names[cells[0]]));
        if (this.names.isBare(own[0]) && (bare.length > 1 || folded.includes("w"))) {
            throw new Unclear(`names do not tell which columns are the magnetometer: ${namesText(names)}`, names);
        }
        if (own[0].toLowerCase().startsWith("magadc")) {
            throw new Unreadable("it is a blackbox log, whose readings may be corrected already: `flinders calibrate` reads it");
        }
    }

    /**
     * Refuse readings after set and after reset pulses.
     * @param {readonly string[]} names
     */
    refusePulses(names) {
        const trimmed = names.map((name) => name.trim());
        const folded = trimmed.map((name) => name.toLowerCase());
        const afterSet = trimmed.filter((name) => this.rules.names.SET_WORD.test(name));
        const reset = (/** @type {string} */ word) => word.replace(/set/i, "reset");
        const afterReset = afterSet.map((name) => replaceAll(this.rules.names.SET_WORD, reset, name).toLowerCase());
        if (afterReset.some((name) => folded.includes(name))) {
            throw new Unreadable("it has readings after set and after reset pulses: `flinders calibrate` takes both");
        }
    }

    /**
     * Unit from a column of words, if names do not state it.
     * @param {readonly string[]} names
     * @param {readonly string[][]} rows
     * @param {string} unit
     */
    unitInColumn(names, rows, unit) {
        const { COUNTS, SEPARATE_PREFIX, SPELLINGS } = this.rules.units;
        const place = names.findIndex((name) => whole(this.layout._UNITS, name.trim()));
        const [word, ...others] = new Set(place < 0 ? [] : rows.map((row) => row[place].trim()));
        if (unit !== COUNTS || !word || others.length || this.layout._OTHER_UNITS.includes(word)) return unit;
        return SPELLINGS[replaceAll(SEPARATE_PREFIX, "$1", word).toLowerCase()] ?? unit;
    }

    /**
     * Refuse a table with a column that names several devices.
     * @param {readonly string[]} names
     * @param {() => string[][]} every
     * @param {Sensor | null} only
     */
    refuseSeveral(names, every, only) {
        const { INSTANCE, CLOCK_OF_INSTANCES, MAX_DEVICES, MIN_READINGS } = this.rules.devices;
        for (const [place, name] of names.entries()) {
            const isInstance = name.trim() === INSTANCE && names.includes(CLOCK_OF_INSTANCES);
            if (place === only?.cell || !(isInstance || this.namesDevice(name))) continue;
            const rows = every().filter((row) => !only || this.isOf(only, row));
            const counts = countKeys(rows.map((row) => this.wordOf(row[place])));
            const often = [...counts.keys()].filter((word) => word && (counts.get(word) ?? 0) >= MIN_READINGS);
            if (often.length < 2 || counts.size > MAX_DEVICES) continue;
            throw new Several(`column ${name.trim()} says which sensor each line is of (${often.join(", ")}): keep the lines of one; ${MORE_WITH}`);
        }
    }

    /**
     * Whether the name of a column is one for devices.
     * @param {string} name
     */
    namesDevice(name) {
        const words = this.names.splitName(name).words.map((word) => word.toLowerCase());
        const { kind, axis } = this.names.meaning(name);
        const { _OTHER_MEANINGS, _DEVICE, _SENSOR } = this.rules.devices;
        const isUnit = whole(this.layout._UNITS, name.trim());
        return !kind && !axis && !isUnit && words.some((word) => whole(_DEVICE, word) || whole(_SENSOR, word)) && !words.some((word) => whole(_OTHER_MEANINGS, word));
    }

    /**
     * Column of words that name a magnetometer in some rows and another sensor in others.
     * @param {readonly string[][]} rows
     * @returns {Sensor | null}
     */
    sensorOf(rows) {
        const { MAX_SENSORS, MIN_LETTERS } = this.rules.devices;
        const { FIELD } = this.rules.names;
        const isText = (/** @type {string} */ word) => word.length >= MIN_LETTERS && this.prints.number(word) === null;
        for (let cell = 0; cell < (rows[0]?.length ?? 0); cell++) {
            const words = [...new Set(rows.map((row) => this.wordOf(row[cell])))].filter(isText);
            if (!words.length || words.length > MAX_SENSORS) continue;
            const own = words.filter((word) => {
                const { kind, rank } = this.names.meaning(`${word} x`);
                return kind === FIELD && this.names.clearness(rank) === 0;
            });
            const best = this.names.magnetometer(own.flatMap((word) => ["x", "y", "z"].map((axis) => `${word} ${axis}`)));
            if (best && words.length > 1) return { cell, word: own[Math.floor(best.cells[0] / 3)] };
        }
        return null;
    }

    /**
     * Whether a row is of the sensor to read.
     * @param {Sensor} only
     * @param {readonly string[]} row
     */
    isOf({ cell, word }, row) {
        return this.wordOf(row[cell]) === word;
    }

    /** @param {string | undefined} cell  Normalised word, for comparison. */
    wordOf(cell) {
        return stripLetters(cell ?? "", this.rules.devices._AROUND);
    }

    /**
     * Refuse readings with thousands separators.
     * @param {string[][]} rows
     * @param {Columns} columns
     * @param {string} decimal
     */
    refuseThousands(rows, { field }, decimal) {
        const cells = rows.flatMap((row) => field.map((place) => row[place].trim()));
        const grouped = cells.filter((cell) => cell.includes(decimal));
        const plain = cells.flatMap((cell) => (cell.includes(decimal) ? [] : [Math.abs(this.prints.number(cell) ?? 0)]));
        const most = Math.max(0, ...plain.filter(Number.isFinite));
        if (grouped.length >= 3 && most >= 100 && most < 1000 && grouped.every((cell) => whole(this.layout._GROUPED_NUMBER, cell))) {
            const what = `numbers such as '${grouped[0]}' have '${decimal}' between thousands, it seems`;
            throw new Unreadable(`${what}: save it without a separator of thousands`);
        }
    }
}

/** @param {number[]} column Whether it ascends, and is not a counter of rows. */
function isClock(column) {
    const values = column.filter(Number.isFinite);
    return ascends(values) && stepsOf(values).some((step) => step !== 1);
}

/** @param {number[]} values */
function ascends(values) {
    return values.length > 1 && values.every((value, i) => i === 0 || value > values[i - 1]);
}

/** @param {number[]} values */
function stepsOf(values) {
    return values.slice(1).map((value, i) => value - values[i]);
}

/**
 * @param {readonly string[]} names
 * @returns {string}
 */
function namesText(names) {
    const more = names.length > 24 ? `, and ${names.length - 24} others` : "";
    return names.slice(0, 24).join(", ") + more;
}
