/** Tables: delimiter, decimal sign and header, and which columns are the magnetometer and the time. As `readers/_layout.py`. */

import { Clock, clocksOf } from "./clocks.js";
import { Devices } from "./devices.js";
import { ascends, onlyRises, shifted, stepsOf } from "./headings.js";
import { counted, largest, median, replaced, whole } from "./patterns.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Rules} Rules */
/** @typedef {import("./printed.js").Prints} Prints */

/**
 * The columns that are read.
 * @typedef {object} Columns
 * @property {number[]} field Places of x, y and z.
 * @property {string[]} names Of these, or their numbers from 1.
 * @property {string} unit The recorded one: `uT`, `mG` … or `counts`.
 * @property {{cell: number, name: string, factor: number, start: number, fraction: number | null,
 *     clock: import("./clocks.js").Clock | null} | null} time Its place, seconds in one unit, where it starts, the place of
 *     nanoseconds that belong to it, and how it is read where it is no number.
 * @property {import("./devices.js").Device[]} devices Those that another column tells apart; the rows of the first are read.
 */

/**
 * How a table is written.
 * @typedef {object} Layout
 * @property {string} delimiter
 * @property {string} decimal
 * @property {number} width Cells of a line; 0 where that differs.
 * @property {string[]} header
 * @property {string} headerText
 * @property {Columns} columns
 */

/** A text in which no readings are recognised: says why, and what to do. */
export class Unreadable extends Error {}

const MORE_WITH = "`flinders calibrate --columns` says which columns they are";

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
        this.devices = new Devices(rules.devices, prints);
    }

    /**
     * How a table is laid out, by its first lines.
     * @param {string[]} texts
     * @param {string[]} [every] All lines.
     * @returns {Layout}
     */
    laidOut(texts, every = texts) {
        texts = this.belowHeader(texts);
        const lines = texts.flatMap((text, place) => (text.trim() && !this.prints.isComment(text) ? [{ text, place }] : []));
        if (!lines.length) throw new Unreadable("it holds no lines of numbers: need one reading a line");
        for (const some of [lines.slice(0, this.layout.TRIED), lines]) {
            const cuts = this.signsOf(some).map((signs) => this.cutAt(some, signs));
            const best = largest(cuts, ({ rows, numbers }) => [rows.size, numbers]);
            if (best?.rows.size) return this.table(texts, best, every);
        }
        const isHeader = (/** @type {string} */ text) =>
            this.signs.some(([sign]) => this.names.magnetometer(this.prints.split(text, sign)));
        if (lines.slice(0, this.layout.MOST_ABOVE).some(({ text }) => isHeader(text))) throw new Unreadable("it has a header and no readings below it: record again, or check what was saved");
        const [{ place, text }] = lines;
        throw new Unreadable(
            `no readings are recognised (line ${place + 1}: '${text.trim().slice(0, 60)}'): need three columns of numbers, ` +
                "or labels such as 'X: -20.8 Y: -20.2 Z: 26.1 uT'",
        );
    }

    /**
     * Whether lines are a table though cells look like labels: below names, or with an address such as `b4:01`.
     * @param {string[]} texts
     */
    isTable(texts) {
        const tried = texts.slice(0, this.layout.TRIED);
        const addressed = tried.filter((text) => this.layout.ADDRESS_CELL.test(text)).length;
        return 2 * addressed > tried.length || this.namesColumns(texts);
    }

    /**
     * Lines without those up to one that says the end of a header, whose numbers are no readings.
     * @param {string[]} texts
     */
    belowHeader(texts) {
        const end = texts.slice(0, this.layout.TRIED).findLastIndex((text) => whole(this.layout._END_OF_HEADER, text));
        return end < 0 ? texts : texts.map((text, place) => (place > end ? text : ""));
    }

    /**
     * Whether lines are a table with names above its columns, parted by more than spaces.
     * @param {string[]} texts
     */
    namesColumns(texts) {
        const tried = texts.slice(0, this.layout.TRIED);
        const lines = tried.flatMap((text, place) => (text.trim() && !this.prints.isComment(text) ? [{ text, place }] : []));
        const signs = this.signsOf(lines).filter(([delimiter]) => delimiter !== this.rules.tokenizer.SPACES);
        const best = largest(signs.map((each) => this.cutAt(lines, each)), ({ rows, numbers }) => [rows.size, numbers]);
        if (!best || 2 * best.rows.size < lines.length || !best.rows.size) return false;
        const widths = counted([...best.rows.values()].map((cells) => cells.length));
        const width = /** @type {number} */ (largest([...widths.keys()], (each) => [widths.get(each) ?? 0]));
        const start = Math.min(...[...best.rows].filter(([, cells]) => cells.length === width).map(([place]) => place));
        return this.header(texts.slice(0, start), best.delimiter, width, width).place >= 0;
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
     * Lines cut at a delimiter, and of these the ones that hold three numbers, and more numbers than words.
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
     * @param {string[]} every
     * @returns {Layout}
     */
    table(texts, { delimiter, decimal, rows: all }, every) {
        const sensor = this.sensorOf([...all.values()], decimal);
        const rows = sensor ? new Map([...all].filter(([, cells]) => this.devices.isOf(sensor, cells))) : all;
        const widths = counted([...rows.values()].map((cells) => cells.length));
        let width = /** @type {number} */ (largest([...widths.keys()], (each) => [widths.get(each) ?? 0]));
        const often = widths.get(width) ?? 0;
        if (width > this.layout.MOST_COLUMNS) {
            throw new Unreadable(`it has ${width} columns: cut the magnetometer's out, with its time`);
        }
        const alike = [...rows.values()].filter((cells) => cells.length === width);
        const start = Math.min(...[...rows].filter(([, cells]) => cells.length === width).map(([place]) => place));
        const isEmpty = (/** @type {number} */ place) => alike.every((cells) => !cells[place].trim());
        let filled = width;
        while (filled > 0 && isEmpty(filled - 1)) filled--;
        const above = this.above(texts.slice(0, start), delimiter, sensor);
        const found = this.header(above, delimiter, filled, width);
        width = filled <= found.names.length && found.names.length <= width ? found.names.length : filled;
        const split = (/** @type {string} */ text) => this.prints.split(text, delimiter);
        const below = texts.slice(start).map(split);
        const cut = alike.map((cells) => cells.slice(0, width));
        const first = this.valued(cut, decimal, below);
        const { place, names } = found.names.length ? found : this.misfit(above, delimiter, first.values, first.clocks);
        const parted = names.length ? [] : this.secondsAndNanoseconds(first.values);
        const told = [...first.clocks.flatMap(({ cells }) => cells), ...parted];
        const devices = this.devicesOf(names, cut, told, () => every.map(split), sensor);
        const { values, clocks } = devices.length ? this.valued(this.ofFirst(devices, cut), decimal, below) : first;
        const units = place < 0 ? [] : this.units(texts.slice(place + 1, start), delimiter, names.length);
        if (!names.length) this.refuseMatrices(texts);
        if (!names.length && !sensor) this.refuseNameless(devices, width);
        const numbers = names.length ? values : this.longer(below, values, decimal);
        const named = this.columns(names, numbers, units, clocks, sensor);
        const columns = { ...this.inTold(named, names, alike, texts.slice(0, start)), devices };
        this.refuseOthers(names, alike, columns, decimal);
        this.refuseCoded(values, columns);
        const isEven = names.length > 0 || often >= this.layout.SAME_WIDTH * rows.size;
        const headerText = place < 0 ? "" : texts[place];
        return { delimiter, decimal, width: isEven ? width : 0, header: names, headerText, columns };
    }

    /**
     * The column that says which sensor a row is of; null where none does.
     * @param {readonly string[][]} rows
     * @param {string} decimal
     */
    sensorOf(rows, decimal) {
        const words = (rows[0] ?? []).flatMap((cell, place) => (this.prints.number(cell, decimal) === null ? [place] : []));
        return this.devices.sensorColumn(rows, words);
    }

    /**
     * Lines above the readings; of several headers those of the sensor that is read.
     * @param {string[]} texts
     * @param {string} delimiter
     * @param {import("./devices.js").SensorColumn | null} sensor
     */
    above(texts, delimiter, sensor) {
        const own = texts.map((text) => (sensor && this.devices.isOf(sensor, this.namesIn(text, delimiter)) ? text : ""));
        return own.some(Boolean) ? own : texts;
    }

    /**
     * Columns in the unit that a column of units, or a line above the readings, says; what names say stays.
     * @param {Columns} columns
     * @param {readonly string[]} header
     * @param {string[][]} rows
     * @param {string[]} above
     * @returns {Columns}
     */
    inTold(columns, header, rows, above) {
        const { _UNITS, _SAYS_UNIT, _OTHER_UNITS, MOST_ABOVE } = this.layout;
        const { COUNTS, PARTED, SPELLINGS } = this.rules.units;
        const places = header.flatMap((name, place) => (whole(_UNITS, name.trim()) ? [place] : []));
        const words = places.map((place) => new Set(rows.flatMap((row) => (place < row.length ? [row[place].trim()] : []))));
        const lines = above.slice(0, MOST_ABOVE).flatMap((text) => whole(_SAYS_UNIT, text)?.[1] ?? []);
        const said = [...words.flatMap((each) => (each.size === 1 ? [...each] : [])), ...lines];
        const known = said.filter((word) => !_OTHER_UNITS.includes(word)).map((word) => SPELLINGS[replaced(PARTED, "$1", word).toLowerCase()]);
        const unit = known.find(Boolean);
        return unit && columns.unit === COUNTS ? { ...columns, unit } : columns;
    }

    /**
     * The numbers of all rows, where an axis of a table without a header only rises through the first.
     * @param {string[][]} below
     * @param {number[][]} values
     * @param {string} decimal
     */
    longer(below, values, decimal) {
        const width = values[0].length;
        const three = [3, 2, 1].map((back) => values.map((row) => row[width - back]));
        if (![3, 4].includes(width) || !this.hasClock(three)) return values;
        const rows = below.filter((cells) => cells.length === width);
        return rows.map((cells) => cells.map((cell) => this.prints.number(cell, decimal) ?? NaN));
    }

    /**
     * The numbers of the first rows, and the columns that are times and no numbers, whose seconds are among them.
     * @param {string[][]} rows
     * @param {string} decimal
     * @param {string[][]} [below] All rows, which tell the day from the month where the first do not.
     */
    valued(rows, decimal, below = rows) {
        const { clock: rules, layout } = this.rules;
        const some = rows.slice(0, layout.SAMPLED);
        const values = some.map((cells) => cells.map((cell) => this.prints.number(cell, decimal) ?? NaN));
        const isText = (/** @type {number} */ place) =>
            values.filter((row) => Number.isFinite(row[place])).length < 0.5 * values.length;
        const words = [...(values[0] ?? []).keys()].filter(isText);
        const clocks = clocksOf(rules, some, words).map((clock) => (clock.isSettled ? clock : new Clock(rules, below, clock.cells)));
        for (const clock of clocks) {
            const past = clock.midnights();
            values.forEach((row, i) => (row[clock.cell] = past(clock.seconds(some[i]))));
        }
        return { values, clocks };
    }

    /**
     * The nearest line above the readings that names a magnetometer, or else columns at all.
     * @param {string[]} above
     * @param {string} delimiter
     * @param {number} filled Cells of a line that hold something.
     * @param {number} width All of them.
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
     * The nearest line above the readings that names a magnetometer by another number of names, or with another
     * delimiter.
     * @param {string[]} above
     * @param {string} own Delimiter of the lines.
     * @param {number[][]} values
     * @param {readonly Clock[]} clocks
     * @returns {{place: number, names: string[]}}
     */
    misfit(above, own, values, clocks) {
        const width = values[0].length;
        const most = width + this.layout.MOST_NAMES_OVER;
        const delimiters = new Set(this.signs.map(([delimiter]) => delimiter));
        for (let place = above.length - 1; place >= 0; place--) {
            for (const delimiter of delimiters) {
                const names = this.namesIn(above[place], delimiter).map((name) => name.replace(/[,;]+$/, ""));
                while (names.length && !names[names.length - 1]) names.pop();
                const filled = names.filter(Boolean);
                const isText = filled.every((name) => this.prints.number(name) === null) && new Set(filled).size === filled.length;
                const least = delimiter === this.rules.tokenizer.SPACES ? width / 2 : 3;
                const isClose = delimiter === own ? least <= names.length && names.length <= most : names.length === width;
                if (!isClose || !isText || !this.names.vectors(names, this.rules.names.FIELD).length) continue;
                const all = names.length === width ? names : shifted(this.rules, this.names, names, values, clocks);
                if (all.length) return { place, names: all };
                throw new Unreadable(`it has a header of ${names.length} names over ${width} fields, and values do not tell which are x, y and z: ${MORE_WITH}`);
            }
        }
        return { place: -1, names: [] };
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
     * Whether names are a header and no sentence.
     * @param {string[]} names
     * @param {string} delimiter
     */
    couldName(names, delimiter) {
        const isText = names.some(Boolean) && names.every((name) => !name || this.prints.number(name) === null);
        return isText && (delimiter !== this.rules.tokenizer.SPACES || names.some((name) => this.names.meaning(name).kind));
    }

    /**
     * A row of units between the header and the readings, one a column.
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
     * The columns that are read of a table with these names, or none, and first rows.
     * @param {readonly string[]} names
     * @param {number[][]} values
     * @param {readonly string[]} [units] Of a row below the header.
     * @param {readonly Clock[]} [clocks] Of times that are no numbers.
     * @param {import("./devices.js").SensorColumn | null} [sensor] A column says which one a row is of.
     * @returns {Columns}
     */
    columns(names, values, units = [], clocks = [], sensor = null) {
        return names.length ? this.byName(names, values, units, clocks) : this.byPlace(values, clocks, sensor);
    }

    /**
     * @param {readonly string[]} names
     * @param {number[][]} values
     * @param {readonly string[]} units
     * @param {readonly Clock[]} clocks
     * @returns {Columns}
     */
    byName(names, values, units, clocks) {
        this.refusePulses(names);
        const meanings = names.map((name, place) => {
            const own = this.names.meaning(name);
            return units[place] && !own.unit ? this.names.meaning(`${name} (${units[place]})`) : own;
        });
        const { TIME } = this.rules.names;
        for (const { cell, cells } of clocks) {
            const { kind, rank } = meanings[cell];
            for (const each of cells) meanings[each] = { kind: "", axis: "", unit: "", rank: 0 };
            meanings[cell] = { kind: TIME, axis: "", unit: "s", rank: kind === TIME ? rank + 2 : this.rules.columns.LAST };
        }
        const isClock = (/** @type {number} */ place) => {
            const column = values.map((row) => row[place]).filter(Number.isFinite);
            return ascends(column) && stepsOf(column).some((step) => step !== 1);
        };
        const isOpen = (/** @type {number} */ place) => !meanings[place].kind || this.names.isBare(names[place]);
        const isAbscissa = meanings.flatMap(({ axis }, place) => (axis && isOpen(place) ? [axis] : [])).join(" ") === "x";
        const isUnnamed = (/** @type {number} */ place) => isOpen(place) && (!names[place].trim() || (isAbscissa && meanings[place].axis));
        const unnamed = names.findIndex((_, place) => isUnnamed(place) && isClock(place));
        if (unnamed >= 0) meanings[unnamed] = { kind: TIME, axis: "", unit: "", rank: this.rules.columns.LAST };
        const field = this.names.magnetometer(names, meanings);
        if (!field) throw new Unreadable(`no magnetometer among the columns ${shown(names)}: ${MORE_WITH}`);
        const own = field.cells.map((cell) => names[cell].trim());
        this.refuseUnclear(names, own);
        const stated = new Set(field.cells.map((cell) => meanings[cell].unit));
        const unit = (stated.size === 1 && [...stated][0]) || this.unitByConvention(names, own[0]) || this.rules.units.COUNTS;
        const time = this.timeOf(names, meanings, values, field.cells, clocks);
        return { field: field.cells, names: own, unit, time, devices: [] };
    }

    /**
     * @param {number[][]} values
     * @param {readonly Clock[]} clocks
     * @param {import("./devices.js").SensorColumn | null} sensor
     * @returns {Columns}
     */
    byPlace(values, clocks, sensor) {
        const width = values[0]?.length ?? 0;
        const parted = this.secondsAndNanoseconds(values);
        const told = [...clocks.flatMap(({ cells }) => cells), ...parted];
        const free = [...(values[0] ?? []).keys()].filter((place) => !told.includes(place) && (!sensor || this.mayBeAxis(values, place)));
        if (parted.length && !clocks.length && free.length === 3) {
            const time = { ...this.timed(parted[0], parted.map((cell) => `${cell + 1}`).join(" and "), "s", values), fraction: parted[1] };
            return { field: free, names: free.map((cell) => `${cell + 1}`), unit: this.rules.units.COUNTS, time, devices: [] };
        }
        const [clock] = clocks;
        if (clock && free.length === 3) {
            const called = (/** @type {readonly number[]} */ cells) => cells.map((cell) => `${cell + 1}`);
            const isCut = this.isCut(values.map((row) => row[clock.cell]));
            const own = { ...this.timed(clock.cell, called(clock.cells).join(" and "), "s", values), clock };
            const time = isCut ? null : own;
            return { field: free, names: called(free), unit: this.rules.units.COUNTS, time, devices: [] };
        }
        if (sensor) return this.ofSensor(free, values);
        const first = values.map((row) => row[0]).filter(Number.isFinite);
        const isTimed = width === 4 && ascends(first);
        const field = isTimed ? [1, 2, 3] : [0, 1, 2];
        const three = field.map((cell) => values.map((row) => row[cell]));
        if ([3, 4].includes(width) && this.hasClock(three)) {
            const what = "columns that only rise are clocks or counters, and fewer than three are left";
            throw new Unreadable(`${what}: need three, x y z; two, of a level turn, are for \`flinders two-axis\``);
        }
        if (width !== 3 && !isTimed) {
            const need = "need three, x y z, or four with the time first";
            throw new Unreadable(`it has ${width} columns and no header: ${need}; ${MORE_WITH}`);
        }
        const isKnown = isTimed && !this.isTooFast(values.map((row) => row[0]), values, field);
        const time = isKnown ? this.timed(0, "1", "", values) : null;
        return { field, names: field.map((cell) => `${cell + 1}`), unit: this.rules.units.COUNTS, time, devices: [] };
    }

    /**
     * The columns of a table without a header whose rows say which sensor they are of.
     * @param {number[]} free Those that may be an axis, or the time.
     * @param {number[][]} values
     * @returns {Columns}
     */
    ofSensor(free, values) {
        const rises = (/** @type {number} */ place) => ascends(values.map((row) => row[place]).filter(Number.isFinite));
        const field = free.length === 4 && rises(free[0]) ? free.slice(1) : free;
        if (field.length !== 3) throw new Unreadable(`it has no header, and ${field.length} columns may be axes: need three, x y z; ${MORE_WITH}`);
        const others = [...values[0].keys()].filter((place) => !field.includes(place));
        const place = others.find((each) => isClock(values, each)) ?? others.find((each) => each === 0 && rises(each));
        const time = place === undefined ? null : this.timed(place, `${place + 1}`, "", values);
        return { field, names: field.map((cell) => `${cell + 1}`), unit: this.rules.units.COUNTS, time, devices: [] };
    }

    /**
     * Whether a column without a name may be an axis: numbers that change, and do not only ever rise.
     * @param {number[][]} values
     * @param {number} place
     */
    mayBeAxis(values, place) {
        const column = values.map((row) => row[place]);
        const isNumeric = column.filter(Number.isFinite).length >= column.length / 2;
        return isNumeric && new Set(column).size > 1 && !onlyRises(this.rules.likeness, column);
    }

    /**
     * Whether the first of three columns only rise, as no axis does, while the others go to and fro; a spiral over a
     * sphere is left to the library.
     * @param {number[][]} columns
     */
    hasClock(columns) {
        const rising = columns.map((column) => onlyRises(this.rules.likeness, column));
        const finite = columns[0].flatMap((_, i) => (columns.every((column) => Number.isFinite(column[i])) ? [i] : []));
        const falling = columns.map((column) => {
            const falls = finite.slice(1).filter((row, i) => column[row] < column[finite[i]]).length;
            return falls > this.rules.likeness.FALLING * finite.length;
        });
        return rising[0] && !rising[2] && rising.every((rises, i) => rises || falling[i]);
    }

    /**
     * The time of a table; null where it has none that can be used.
     * @param {readonly string[]} names
     * @param {readonly import("./names.js").Meaning[]} meanings
     * @param {number[][]} values
     * @param {number[]} field
     * @param {readonly Clock[]} clocks
     * @returns {Columns["time"]}
     */
    timeOf(names, meanings, values, field, clocks) {
        const isWarm = (/** @type {number} */ place) =>
            this.names.isLetterOfTime(names[place]) && this.isTemperature(values.map((row) => row[place]));
        const isTime = (/** @type {number} */ place) =>
            meanings[place].kind === this.rules.names.TIME && !meanings[place].axis && !isWarm(place);
        const places = [...meanings.keys()].filter((place) => isTime(place) && !field.includes(place));
        const parted = places.filter((place) => this.isParted(names, place, values));
        for (const place of places.toSorted((one, other) => meanings[one].rank - meanings[other].rank)) {
            const clock = clocks.find(({ cell }) => cell === place) ?? null;
            const named = clock?.cells.filter((cell) => names[cell].trim()) ?? [];
            const name = (named.length ? named : [place]).map((cell) => names[cell].trim() || `${cell + 1}`).join(" and ");
            const time = { ...this.timed(place, name, meanings[place].unit, values), clock };
            if (parted.includes(place)) return { ...time, fraction: place + 1 };
            const column = values.map((row) => row[place]);
            const isNumeric = column.filter(Number.isFinite).length >= column.length / 2;
            const { unit } = meanings[place];
            const isNone = !isNumeric || this.falls(names[place], unit, column) || this.isCut(column);
            const isOther = isNone || (!unit && this.isTooFast(column, values, field));
            if (!parted.includes(place - 1) && !isOther) return time;
        }
        return null;
    }

    /**
     * Places of a column of whole seconds since 1970 and of the next, which has the nanoseconds.
     * @param {number[][]} values
     */
    secondsAndNanoseconds(values) {
        const [least] = this.rules.columns.EPOCHS[this.rules.columns.EPOCHS.length - 1];
        const place = [...(values[0] ?? []).keys()].slice(1).findIndex((next) => {
            const [whole, part] = [next - 1, next].map((cell) => values.map((row) => row[cell]));
            const isWhole = [...whole, ...part].every(Number.isInteger) && Math.min(...whole) >= least && Math.max(...whole) < 4 * least;
            const isPart = Math.min(...part) >= 0 && Math.max(...part) >= 1e6 && Math.max(...part) < 1e9;
            return isWhole && isPart && ascends(whole.map((value, i) => value - whole[0] + 1e-9 * part[i]));
        });
        return place < 0 ? [] : [place, place + 1];
    }

    /**
     * Whether a column is of whole seconds, and the next of the nanoseconds that belong to them.
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
     * Whether a time was written with too few digits: many readings share each.
     * @param {number[]} column
     */
    isCut(column) {
        const { COARSE } = this.rules.columns;
        const values = column.filter(Number.isFinite);
        const changes = values.flatMap((value, i) => (i > 0 && value !== values[i - 1] ? [i] : []));
        const lengths = [0, ...changes].map((change, i) => (changes[i] ?? values.length) - change);
        const inside = lengths.length > 2 ? lengths.slice(1, -1) : lengths;
        return values.length >= 2 * COARSE && median(inside) >= COARSE;
    }

    /**
     * Whether no sensor turns as fast as readings do at times whose unit their size suggests.
     * @param {number[]} column
     * @param {number[][]} values
     * @param {number[]} field
     */
    isTooFast(column, values, field) {
        const { FEWEST_TIMES, APART, GROWS, FASTEST_RAD_S } = this.rules.columns;
        const rows = values.flatMap((row, i) => ([column[i], ...field.map((cell) => row[cell])].every(Number.isFinite) ? [i] : []));
        if (rows.length < FEWEST_TIMES) return false;
        const times = rows.map((i) => column[i]);
        const read = rows.map((i) => field.map((cell) => values[i][cell]));
        const step = median(stepsOf(times)) * this.secondsInOne(times);
        const turned = (/** @type {number} */ lag) =>
            median(read.slice(lag).map((row, i) => Math.hypot(...row.map((value, axis) => value - read[i][axis]))));
        const ranges = field.map((_, axis) => read.map((row) => row[axis])).map((each) => Math.max(...each) - Math.min(...each));
        return step > 0 && turned(APART) > GROWS * turned(1) && turned(1) > (FASTEST_RAD_S * step * Math.max(...ranges)) / 2;
    }

    /**
     * Whether a column whose name states no unit of time falls, or goes to and fro, as no time does; or is a `T` that
     * stands still.
     * @param {string} name
     * @param {string} unit
     * @param {number[]} column
     */
    falls(name, unit, column) {
        const values = column.filter(Number.isFinite);
        const steps = stepsOf(values);
        const falling = steps.filter((step) => step < 0).length;
        const isNone = !unit && falling > 1 && 2 * falling > steps.filter((step) => step > 0).length;
        const isLetter = this.names.isLetterOfTime(name);
        return values.length >= this.rules.columns.FEWEST_TIMES && (isNone || (isLetter && !this.rises(values)));
    }

    /**
     * Whether numbers rise as a coarse clock does, with the same number of readings to each of its steps.
     * @param {number[]} values Finite.
     */
    rises(values) {
        const { LONG, RARE, REGULAR } = this.rules.columns;
        const steps = stepsOf(values);
        const changes = steps.flatMap((step, i) => (step ? [i] : []));
        if (!changes.length) return values[0] === 0 || values[0] > LONG;
        const runs = changes.slice(1).map((change, i) => change - changes[i]);
        if (!runs.length || changes.filter((i) => steps[i] < 0).length > RARE * changes.length) return false;
        const usual = median(runs);
        const isUsual = (/** @type {number} */ run) => Math.abs(run - usual) <= Math.max(1, REGULAR * usual);
        return runs.filter(isUsual).length >= (1 - RARE) * runs.length;
    }

    /**
     * Whether a column named `T` is a temperature in °C, and does not rise as a clock does.
     * @param {number[]} column
     */
    isTemperature(column) {
        const { TEMPERATURES_C, FEWEST_TIMES } = this.rules.columns;
        const [low, high] = TEMPERATURES_C;
        const values = column.filter(Number.isFinite);
        const isWarm = values.every((value) => low <= value && value <= high);
        return values.length >= FEWEST_TIMES && isWarm && !this.rises(values);
    }

    /**
     * @param {number} cell
     * @param {string} name
     * @param {string} unit
     * @param {number[][]} values
     */
    timed(cell, name, unit, values) {
        const { FACTORS, TIME } = this.rules.names;
        const times = values.map((row) => row[cell]).filter(Number.isFinite);
        const factor = unit ? FACTORS[TIME][unit] : this.secondsInOne(times);
        const first = times[0] ?? 0;
        return { cell, name, factor, start: Math.abs(first) * factor > this.rules.columns.LONG ? first : 0, fraction: null, clock: null };
    }

    /**
     * Seconds in one of a unit that is not stated, by the size of times, then by their steps.
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
     * The unit that messages of ROS and the app Sensor Logger have without saying so.
     * @param {readonly string[]} names
     * @param {string} first
     */
    unitByConvention(names, first) {
        const folded = names.map((name) => name.trim().toLowerCase());
        const hasCovariance = names.some((name) => name.startsWith("magnetic_field_covariance"));
        const isPrinted = first.toLowerCase() === "magnetic_field x" && hasCovariance;
        const isOfRos = this.rules.columns.OF_ROS.some((/** @type {string} */ end) => first.toLowerCase().endsWith(end));
        if (isPrinted || isOfRos) return "T";
        return ["seconds_elapsed", "x", "y", "z"].every((name) => folded.includes(name)) ? "uT" : "";
    }

    /**
     * Refuse names that do not tell which columns are the magnetometer, and readings that were corrected already.
     * @param {readonly string[]} names
     * @param {string[]} own
     */
    refuseUnclear(names, own) {
        const folded = names.map((name) => name.trim().toLowerCase());
        const bare = this.names.vectors(names, this.rules.names.FIELD).filter(({ cells }) => this.names.isBare(names[cells[0]]));
        if (this.names.isBare(own[0]) && (bare.length > 1 || folded.includes("w"))) {
            throw new Unreadable(`names do not tell which columns are the magnetometer: ${shown(names)}; ${MORE_WITH}`);
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
        const afterSet = trimmed.filter((name) => this.rules.names.SET.test(name));
        const reset = (/** @type {string} */ word) => word.replace(/set/i, "reset");
        const afterReset = afterSet.map((name) => replaced(this.rules.names.SET, reset, name).toLowerCase());
        if (afterReset.some((name) => folded.includes(name))) {
            throw new Unreadable("it has readings after set and after reset pulses: `flinders calibrate` takes both");
        }
    }

    /**
     * Refuse readings of several sensors, and numbers that are not clear.
     * @param {readonly string[]} names
     * @param {string[][]} rows
     * @param {Columns} columns
     * @param {string} decimal
     */
    refuseOthers(names, rows, columns, decimal) {
        if (!names.length || this.names.isBare(names[columns.field[0]])) this.refuseMixed(rows);
        this.refuseThousands(rows, columns, decimal);
    }

    /**
     * Devices that a column tells apart, by its name or the first rows, and then by all rows.
     * @param {readonly string[]} names
     * @param {string[][]} alike The first rows.
     * @param {number[]} told Places of times.
     * @param {() => string[][]} every
     * @param {import("./devices.js").SensorColumn | null} sensor
     */
    devicesOf(names, alike, told, every, sensor) {
        const width = alike[0].length;
        const ahead = width <= this.layout.NAMELESS ? width - 3 : 0;
        const isTelling = (/** @type {number} */ place) => this.devices.areIds(alike.map((row) => row[place]), place < ahead);
        const areUnits = (/** @type {number} */ place) => alike.every((row) => this.names.isUnit(row[place].trim()));
        const isNamed = (/** @type {number} */ place) => this.devices.named(names[place] ?? "", names) && !areUnits(place);
        const free = [...alike[0].keys()].filter((place) => !told.includes(place) && place !== sensor?.place);
        const places = free.filter(names.length ? isNamed : isTelling);
        const found = places.length ? this.devices.in(names, places, every().filter((cells) => this.prints.fits(cells, width))) : [];
        return sensor ? this.devices.ofSensor(sensor, found) : found;
    }

    /**
     * Rows of the first of several devices; all where there is one, or none is of the first.
     * @param {import("./devices.js").Device[]} devices
     * @param {string[][]} rows
     */
    ofFirst(devices, rows) {
        const own = rows.filter((row) => !devices.length || !this.devices.isOfOther(devices[0], row));
        return own.length ? own : rows;
    }

    /**
     * Refuse a table without a header in which a column says which of several sensors each line is of.
     * @param {import("./devices.js").Device[]} devices
     * @param {number} width
     */
    refuseNameless(devices, width) {
        if (!devices.length || width > this.layout.NAMELESS) return;
        const words = devices.map((device) => device.words.join(" ")).join(", ");
        throw new Unreadable(`column ${devices[0].cells[0] + 1} says which sensor each line is of (${words}): keep the lines of one of them`);
    }

    /**
     * Refuse a table in which a column of words says which sensor each line is of, and none is a magnetometer.
     * @param {string[][]} rows
     */
    refuseMixed(rows) {
        for (let place = 0; place < Math.min(...rows.map((row) => row.length)); place++) {
            const known = this.devices.sensorsOf(rows.map((row) => row[place]));
            const other = [...known.keys()].find((word) => known.get(word)?.kind !== this.rules.names.FIELD);
            if (other) {
                const which = `column ${place + 1} says which sensor each line is of, such as '${other}'`;
                throw new Unreadable(`${which}: keep the lines of the magnetometer`);
            }
        }
    }

    /**
     * Refuse text of Octave with two matrices or more of three columns, one below the other.
     * @param {readonly string[]} texts
     */
    refuseMatrices(texts) {
        const columns = texts.map((text) => Number(this.layout.MATRIX.exec(text)?.groups?.columns ?? 0));
        if (columns.filter((count) => count >= 3).length < 2) return;
        throw new Unreadable("it has several matrices, one below the other: save the magnetometer's alone");
    }

    /**
     * Refuse a table in which a number says which sensor each line is of: lengths of x, y and z differ with it by far.
     * @param {number[][]} values
     * @param {Columns} columns
     */
    refuseCoded(values, { field, devices }) {
        const { MAX_CODES, IN_TURN, LEAST_OF_CODE, APART, FAR_APART } = this.layout;
        const { GRAVITY, NEARLY, STEADY } = this.rules.likeness;
        if (devices.length) return;
        const lengths = values.map((row) => Math.hypot(...field.map((cell) => row[cell])));
        for (const place of (values[0] ?? []).keys()) {
            const codes = [...new Set(values.map((row) => row[place]))].filter(Number.isFinite);
            if (field.includes(place) || codes.length > MAX_CODES || !codes.every(Number.isInteger)) continue;
            const steps = stepsOf(values.map((row) => row[place]).filter(Number.isFinite));
            if (!steps.some((step) => step < 0) || steps.filter(Boolean).length <= IN_TURN * steps.length) continue;
            const own = codes.map((code) => lengths.filter((length, i) => values[i][place] === code && Number.isFinite(length)));
            const often = own.filter((each) => each.length >= LEAST_OF_CODE);
            const isGravity = (/** @type {number[]} */ each) => {
                const usual = median(each);
                const near = ["m/s²", "g"].some((unit) => Math.abs(usual / GRAVITY[unit] - 1) < NEARLY);
                return near && median(each.map((length) => Math.abs(length - usual))) < STEADY * usual;
            };
            const usual = often.map(median);
            const isFar = Math.min(...usual) * (often.some(isGravity) ? APART : FAR_APART) < Math.max(...usual);
            if (usual.length && isFar) throw new Unreadable(`column ${place + 1} says by a number which sensor each line is of: keep the lines of the magnetometer`);
        }
    }

    /**
     * Refuse a table with one value a row, whose axis a word in the row names: `sensor.field_x,28.90,2026-11-22`.
     * @param {readonly string[]} lines
     * @param {boolean} isPrint Labelled lines are read where the axes come in turn.
     */
    refuseOneValue(lines, isPrint) {
        const texts = lines.filter((text) => text.trim() && !this.prints.isComment(text));
        for (const delimiter of this.layout.ONE_VALUE_SIGNS) {
            const rows = texts.flatMap((text) => (text.includes(delimiter) ? [this.prints.split(text, delimiter)] : []));
            if (2 * rows.length <= texts.length) continue;
            const widths = counted(rows.map((row) => row.length));
            const width = /** @type {number} */ (largest([...widths.keys()], (each) => [widths.get(each) ?? 0]));
            const alike = rows.filter((row) => row.length === width && width > 1);
            for (let place = 0; place < width; place++) {
                const words = alike.map((row) => this.devices.bare(row[place]));
                const told = this.axesOfWords(words);
                const own = words.filter((word) => told.includes(word));
                const isInTurn = 2 * own.filter((word, i) => i > 0 && word !== own[i - 1]).length > own.length;
                if (!told.length || (isPrint && isInTurn)) continue;
                throw new Unreadable(`it has one value a row, of which column ${place + 1} says what it is: pivot it, so that x, y and z of a moment are in one row`);
            }
        }
    }

    /**
     * Repeated words that name the three axes of a magnetometer; none where there are too many.
     * @param {readonly string[]} words
     */
    axesOfWords(words) {
        const { MAX_DEVICES, MIN_READINGS } = this.rules.devices;
        const counts = counted([...words]);
        if (counts.size > MAX_DEVICES) return [];
        const often = [...counts.keys()].filter((word) => (counts.get(word) ?? 0) >= MIN_READINGS && this.prints.number(word) === null);
        const found = this.names.magnetometer(often);
        return found ? found.cells.map((cell) => often[cell]) : [];
    }

    /**
     * Refuse readings in which commas or points part thousands.
     * @param {string[][]} rows
     * @param {Columns} columns
     * @param {string} decimal
     */
    refuseThousands(rows, { field }, decimal) {
        const cells = rows.flatMap((row) => field.map((place) => row[place].trim()));
        const grouped = cells.filter((cell) => cell.includes(decimal));
        const plain = cells.flatMap((cell) => (cell.includes(decimal) ? [] : [Math.abs(this.prints.number(cell) ?? 0)]));
        const most = Math.max(0, ...plain.filter(Number.isFinite));
        if (grouped.length >= 3 && most >= 100 && most < 1000 && grouped.every((cell) => whole(this.layout._GROUPED, cell))) {
            const what = `numbers such as '${grouped[0]}' have '${decimal}' between thousands, it seems`;
            throw new Unreadable(`${what}: save it without a separator of thousands`);
        }
    }
}

/**
 * Whether a column without a name ascends, and does not count rows.
 * @param {number[][]} values
 * @param {number} place
 */
function isClock(values, place) {
    const column = values.map((row) => row[place]).filter(Number.isFinite);
    return ascends(column) && stepsOf(column).some((step) => step !== 1);
}

/**
 * @param {readonly string[]} names
 * @returns {string}
 */
function shown(names) {
    const more = names.length > 24 ? `, and ${names.length - 24} others` : "";
    return names.slice(0, 24).join(", ") + more;
}
