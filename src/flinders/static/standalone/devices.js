/** Several devices in one table, told apart by a column such as `id`, `node` or `address`. As `readers/_devices.py`. */

import { counted, stripped, whole } from "./patterns.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {import("./printed.js").Prints} Prints */

/**
 * One of several devices: the words that its rows have in some columns.
 * @typedef {{cells: number[], words: string[], name: string}} Device
 */

/**
 * A column that says which sensor a row is of, and its word of the magnetometer.
 * @typedef {{place: number, word: string}} SensorColumn
 */

/** Words that are counted together. */
const BETWEEN = "\0";

export class Devices {
    /**
     * @param {Constants} rules
     * @param {Prints} prints
     */
    constructor(rules, prints) {
        this.rules = rules;
        this.prints = prints;
        this.names = prints.names;
    }

    /**
     * Whether a column may say by its name which device a row is of.
     * @param {string} name
     * @param {readonly string[]} header
     */
    named(name, header) {
        if (name.trim() === this.rules.INSTANCE && header.includes(this.rules.CLOCK_OF_INSTANCES)) return true;
        const words = this.names.parted(name).words.map((word) => word.toLowerCase());
        const { kind, axis } = this.names.meaning(name);
        const isOther = words.some((word) => whole(this.rules._OTHER, word));
        return !isOther && words.some((word) => whole(this.rules._DEVICE, word)) && !kind && !axis;
    }

    /**
     * A word as it is compared.
     * @param {string} cell
     */
    bare(cell) {
        const word = stripped(cell, this.rules._AROUND);
        return whole(/(\d+)\.0*/u, word)?.[1] ?? word;
    }

    /**
     * The column of words that name a magnetometer in some rows and another sensor in others.
     * @param {readonly string[][]} rows
     * @param {number[]} places
     * @returns {SensorColumn | null}
     */
    sensorColumn(rows, places) {
        for (const place of places) {
            const known = this.sensorsOf(rows.flatMap((row) => (place < row.length ? [row[place]] : [])));
            const words = [...known.keys()].filter((word) => known.get(word)?.kind === this.names.rules.FIELD);
            const isMixed = new Set(words.map((word) => known.get(word)?.rank)).size > 1 || words.length < known.size;
            if (!words.length || !isMixed) continue;
            const best = this.names.magnetometer(words.flatMap((word) => [`${word} x`, `${word} y`, `${word} z`]));
            return best ? { place, word: words[Math.floor(best.cells[0] / 3)] } : null;
        }
        return null;
    }

    /**
     * What the words of a column say, those that name a sensor; none of too many.
     * @param {readonly string[]} words
     * @returns {Map<string, import("./names.js").Meaning>}
     */
    sensorsOf(words) {
        const { FIELD, ACCELERATION, RATE } = this.names.rules;
        const different = [...new Set(words.map((word) => this.bare(word)))].sort();
        if (different.length > this.rules.MAX_SENSORS) return new Map();
        const told = different.filter((word) => word.length >= this.rules.LEAST_LETTERS && this.prints.number(word) === null);
        const isOther = (/** @type {string} */ word) => this.prints.rules.QUANTITY.test(word);
        const known = told.map((word) => /** @type {const} */ ([word, isOther(word) ? { kind: ACCELERATION, axis: "", unit: "", rank: 0 } : this.names.meaning(`${word} x`)]));
        return new Map(known.filter(([word, { kind }]) => [FIELD, ACCELERATION, RATE].includes(kind) && (isOther(word) || !this.names.isBare(`${word} x`))));
    }

    /**
     * Whether a row is of the magnetometer that a column tells from other sensors.
     * @param {SensorColumn} sensor
     * @param {readonly string[]} row
     */
    isOf({ place, word }, row) {
        return place < row.length && this.bare(row[place]) === word;
    }

    /**
     * The magnetometer that a column tells from other sensors, of each of the devices that another column tells apart.
     * @param {SensorColumn} sensor
     * @param {readonly Device[]} others
     * @returns {Device[]}
     */
    ofSensor({ place, word }, others) {
        const each = others.length ? others : [{ cells: [], words: [], name: "" }];
        return each.map(({ cells, words, name }) => ({ cells: [place, ...cells], words: [word, ...words], name: `${word} ${name}`.trim() }));
    }

    /**
     * Whether the words of a column without a name are those of devices.
     * @param {string[]} words
     * @param {boolean} isAhead
     */
    areIds(words, isAhead) {
        const known = [...new Set(words.map((word) => this.bare(word)))];
        if (known.length < 2 || known.length > this.rules.MAX_DEVICES) return false;
        if (known.every((word) => whole(this.rules._ADDRESS, word))) return true;
        const numbers = known.filter((word) => /^\d+$/.test(word)).map(Number).sort((a, b) => a - b);
        const isRow = numbers.length === known.length && numbers[0] <= 1 && numbers.every((number, i) => number === numbers[0] + i);
        return isAhead && isRow && known.length <= this.rules.MAX_NUMBERED;
    }

    /**
     * Whether the cells of a row say that it is of another device.
     * @param {Device} device
     * @param {readonly string[]} row
     */
    isOfOther({ cells, words }, row) {
        return cells.some((cell, i) => cell < row.length && this.bare(row[cell]) !== words[i]);
    }

    /**
     * Devices by the words of all rows in some columns; none for one.
     * @param {readonly string[]} names
     * @param {number[]} places
     * @param {string[][]} rows
     * @returns {Device[]}
     */
    in(names, places, rows) {
        /** @type {Map<number, string[][]>} */
        const telling = new Map();
        for (const place of places) {
            const found = this.often(rows.map((row) => this.bare(row[place])));
            if (found.length) telling.set(place, found.map((word) => [word]));
        }
        if (!telling.size) return [];
        const size = (/** @type {number} */ place) => telling.get(place)?.length ?? 0;
        const most = [...telling.keys()].reduce((best, place) => (size(place) > size(best) ? place : best));
        let [cells, found] = [[most], telling.get(most) ?? []];
        if (telling.size > 1) {
            const all = [...telling.keys()];
            const counts = counted(rows.map((row) => all.map((place) => this.bare(row[place])).join(BETWEEN)));
            const together = [...counts].filter(([, count]) => count >= this.rules.MIN_READINGS).map(([words]) => words.split(BETWEEN));
            if (together.length > found.length) [cells, found] = [all, together];
        }
        const called = cells.map((cell) => (names.length ? names[cell].trim() : `${cell + 1}`));
        const inOrder = [...found].sort((one, other) => one.reduce((order, word, i) => order || compared(word, other[i]), 0));
        return inOrder.map((words) => ({ cells, words, name: words.map((word, i) => `${called[i]}=${word}`).join(" ") }));
    }

    /**
     * Words of devices; none where there are too many or just one, or where they are no names.
     * @param {string[]} words
     */
    often(words) {
        const { MAX_DEVICES, MAX_LETTERS, MIN_READINGS, MIN_READINGS_IN_A_ROW, MIN_SHARE } = this.rules;
        const counts = counted(words);
        const changes = words.filter((word, i) => i === 0 || word !== words[i - 1]);
        const least = changes.length > counts.size ? MIN_READINGS : MIN_READINGS_IN_A_ROW;
        const often = [...counts.keys()].filter((word) => word && (counts.get(word) ?? 0) >= least);
        const share = often.reduce((sum, word) => sum + (counts.get(word) ?? 0), 0) / words.length;
        const isName = (/** @type {string} */ word) => {
            const value = this.prints.number(word);
            return value === null ? word.length <= MAX_LETTERS : Number.isInteger(value);
        };
        const isFew = often.length >= 2 && counts.size <= MAX_DEVICES && share >= MIN_SHARE;
        return isFew && often.every(isName) ? often : [];
    }
}

/**
 * Words by the alphabet, and numbers in them by their size.
 * @param {string} one
 * @param {string} other
 */
function compared(one, other) {
    const [pieces, others] = [one, other].map((word) => word.toLowerCase().match(/\d+|\D+/g) ?? []);
    for (let i = 0; i < Math.min(pieces.length, others.length); i++) {
        const [a, b] = [pieces[i], others[i]];
        const [isNumber, isOtherNumber] = [a, b].map((piece) => /^\d/.test(piece));
        if (isNumber !== isOtherNumber) return isNumber ? -1 : 1;
        const order = (isNumber && Number(a) - Number(b)) || (a < b ? -1 : Number(a > b));
        if (order) return order;
    }
    return pieces.length - others.length;
}
