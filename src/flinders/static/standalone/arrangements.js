/** JSON that holds readings in another way than a record each. As `readers/dialects/json_arrangements.py`. */

import { largest, median } from "./patterns.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {import("./printed.js").Prints} Prints */
/** @typedef {Map<string, any[]>} Lists */

export class Arrangements {
    /**
     * @param {Constants} rules
     * @param {Prints} prints
     * @param {string} time The kind of columns that are times.
     */
    constructor(rules, prints, time) {
        this.rules = rules;
        this.prints = prints;
        this.names = prints.names;
        this.time = time;
    }

    /**
     * Records of a table in one object; null for other objects.
     * @param {Record<string, any>} document
     * @returns {any[] | null}
     */
    arranged(document) {
        for (const body of this.objects(document)) {
            const rows = this.namedRows(body);
            if (rows.length) return rows;
        }
        const lists = this.lists(this.asList(document) ?? document);
        const lengths = [...lists.values()].map(({ length }) => length).filter((length) => length >= this.rules.FEWEST_ROWS);
        const tables = [...new Set(lengths)].sort((one, other) => other - one).map((length) => ofLength(lists, length));
        const table = largest(tables, (each) => [Boolean(this.names.magnetometer(namesOf(each))), each.size]);
        if (!table) return null;
        const [only] = table.values();
        if (table.size === 1) return isInside(only[0]) ? only : null;
        return only.map((_, place) => Object.fromEntries([...table].map(([name, rows]) => [name, rows[place]])));
    }

    /**
     * Readings that come several to a record as a record each.
     * @param {any[]} records
     * @returns {any[]}
     */
    oneByOne(records) {
        const inside = records.slice(0, this.rules.COMPARED).map((record) => this.batch(record)).filter(({ size }) => size);
        if (!inside.length || this.areSensors(inside)) return records;
        const times = records.map((record) => this.times(record));
        /** @type {[string, number][]} */
        let steps = [];
        return records.flatMap((record, i) => {
            const own = times[i];
            const known = [...own].flatMap(([name, time]) => {
                const next = times[i + 1]?.get(name);
                return next === undefined ? [] : [/** @type {[string, number]} */ ([name, next - time])];
            });
            steps = known.length ? known : steps;
            return this.parted(record, own, steps);
        });
    }

    /**
     * Objects inside a document, the outer ones first.
     * @param {any} value
     * @returns {Generator<Record<string, any>>}
     */
    *objects(value) {
        if (isObject(value)) {
            yield value;
            value = Object.values(value);
        }
        if (Array.isArray(value) && value.length < this.rules.MOST_PARTS) for (const each of value) yield* this.objects(each);
    }

    /**
     * Rows of an object that has their names in a list of its own.
     * @param {Record<string, any>} body
     * @returns {Record<string, any>[]}
     */
    namedRows(body) {
        const lists = Object.values(body).filter((value) => Array.isArray(value) && value.length);
        for (const heads of lists) {
            const names = heads.map((/** @type {any} */ head) => this.nameOf(head));
            if (!names.every(Boolean)) continue;
            for (const rows of lists) {
                if (rows.length < 2 || !rows.every((/** @type {any} */ row) => Array.isArray(row) && row.length === names.length)) continue;
                const step = Object.hasOwn(body, "interval_ms") ? this.prints.number(String(body.interval_ms)) : null;
                const time = (/** @type {number} */ place) => (step ? [["t_ms", step * place]] : []);
                const cells = (/** @type {any[]} */ row) => names.map((/** @type {string} */ name, /** @type {number} */ i) => [name, row[i]]);
                return rows.map((/** @type {any[]} */ row, /** @type {number} */ place) => Object.fromEntries([...time(place), ...cells(row)]));
            }
        }
        return [];
    }

    /**
     * Name of a column, with its unit.
     * @param {any} head
     */
    nameOf(head) {
        if (isObject(head) && typeof head.name === "string") {
            const unit = head.units || head.unit;
            return typeof unit === "string" ? `${head.name} (${unit})` : head.name;
        }
        return typeof head === "string" && this.prints.number(head) === null ? head : "";
    }

    /**
     * Values by row number, by date or by time.
     * @param {Record<string, any>} value
     * @returns {any[] | null}
     */
    asList(value) {
        const keys = Object.keys(value);
        return keys.length >= this.rules.FEWEST_ROWS && keys.every((key) => /^\p{Nd}/u.test(key)) ? Object.values(value) : null;
    }

    /**
     * The lists of an object, by the keys that lead to each.
     * @param {any} value
     * @param {string} name
     * @returns {Lists}
     */
    lists(value, name = "") {
        if (Array.isArray(value)) return new Map(value.length ? [[name, value]] : []);
        /** @type {Lists} */
        const found = new Map();
        for (const [key, inner] of isObject(value) ? Object.entries(value) : []) {
            const rows = isObject(inner) ? this.asList(inner) : null;
            if (rows && Object.keys(inner)[0].length >= this.rules.LENGTH_OF_A_MOMENT && !found.has("timestamp")) {
                found.set("timestamp", Object.keys(inner));
            }
            for (const [path, list] of this.lists(rows ?? inner, name ? `${name}.${key}` : key)) found.set(path, list);
        }
        return found;
    }

    /**
     * Lists of as many readings each that make a magnetometer.
     * @param {any} record
     * @returns {Lists}
     */
    batch(record) {
        const lists = isObject(record) ? this.lists(record) : new Map();
        const lengths = [...lists.values()].map(({ length }) => length).filter((length) => length > 1);
        for (const length of [...new Set(lengths)].sort((one, other) => other - one)) {
            const batch = ofLength(lists, length);
            if (this.names.magnetometer(namesOf(batch))) return batch;
        }
        return new Map();
    }

    /**
     * Whether the readings of a record are those of several sensors: each is nearer to its own of the next one.
     * @param {Lists[]} batches
     */
    areSensors(batches) {
        const same = batches.filter((batch) => first(batch).length === first(batches[0]).length);
        const read = same.map((batch) => this.readings(batch)).filter((rows) => rows.every((row) => row.every(Number.isFinite)));
        if (read.length < 2) return false;
        const inside = read.flatMap((rows) => rows.slice(1).map((row, i) => distance(row, rows[i])));
        const across = read.slice(1).flatMap((rows, i) => rows.map((row, j) => distance(row, read[i][j])));
        return median(inside) > this.rules.STEADIER * median(across);
    }

    /**
     * Readings of the magnetometer of a batch.
     * @param {Lists} batch
     * @returns {number[][]}
     */
    readings(batch) {
        const [{ cells }] = this.names.vectors(namesOf(batch), this.names.rules.FIELD);
        return first(batch).map((_, place) => {
            const row = [...batch.values()].flatMap((list) => (isInside(list[place]) ? Object.values(list[place]) : [list[place]]));
            return cells.map((cell) => this.prints.number(String(row[cell])) ?? NaN);
        });
    }

    /**
     * Numbers of a record that are times.
     * @param {any} record
     * @returns {Map<string, number>}
     */
    times(record) {
        const own = plain(record).filter(([key]) => this.names.meaning(key).kind === this.time);
        const numbers = own.map(([key, value]) => /** @type {[string, number | null]} */ ([key, this.prints.number(String(value))]));
        return new Map(numbers.flatMap(([key, value]) => (value === null ? [] : [[key, value]])));
    }

    /**
     * A record for each of the readings of one.
     * @param {any} record
     * @param {Map<string, number>} times
     * @param {[string, number][]} steps
     */
    parted(record, times, steps) {
        const batch = this.batch(record);
        if (!batch.size) return [record];
        const count = first(batch).length;
        return first(batch).map((_, place) => {
            const known = steps.filter(([name]) => place && times.has(name));
            const later = known.map(([name, step]) => [name, (times.get(name) ?? 0) + (step * place) / count]);
            const own = [...batch].map(([name, list]) => [name, list[place]]);
            return Object.fromEntries([...plain(record), ...later, ...own]);
        });
    }
}

/** @param {any} value */
function isInside(value) {
    return value !== null && typeof value === "object";
}

/** @param {any} value */
function isObject(value) {
    return isInside(value) && !Array.isArray(value);
}

/**
 * @param {Lists} lists
 * @param {number} length
 * @returns {Lists}
 */
function ofLength(lists, length) {
    return new Map([...lists].filter(([, each]) => each.length === length));
}

/** @param {Lists} lists */
function first(lists) {
    return [...lists.values()][0];
}

/**
 * Names of the columns that lists make, of vectors with that of each part.
 * @param {Lists} table
 */
function namesOf(table) {
    return [...table].flatMap(([key, [row]]) => (isInside(row) ? Object.keys(row).map((part) => `${key}.${part}`) : [key]));
}

/**
 * What is in the objects of a record and no list, by the keys that lead to it.
 * @param {any} record
 * @param {string} name
 * @returns {[string, any][]}
 */
function plain(record, name = "") {
    return Object.entries(isObject(record) ? record : {}).flatMap(([key, value]) => {
        const path = name ? `${name}.${key}` : key;
        if (isObject(value)) return plain(value, path);
        return Array.isArray(value) ? [] : [/** @type {[string, any]} */ ([path, value])];
    });
}

/**
 * @param {number[]} one
 * @param {number[]} other
 */
function distance(one, other) {
    return Math.hypot(...one.map((value, i) => value - other[i]));
}
