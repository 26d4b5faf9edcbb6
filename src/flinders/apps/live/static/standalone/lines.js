/**
 * Reads lines of boards and text logs.
 *
 * The first lines determine the format, as in `flinders.links.transcript` and `flinders.readers.text`, whose tables are in
 * `page.json` under `lines`.
 */

import { midnights } from "./clocks.js";
import { jsonLines, labelledDialect, markedDialect, parseJson, stampedDialect } from "./dialects.js";
import { Names } from "./names.js";
import { revived, whole } from "./patterns.js";
import { Prints } from "./printed.js";
import { Silence } from "./silence.js";
import { MORE_WITH, Several, Tables, Unclear, Unreadable } from "./tables.js";

/** @typedef {import("./dialects.js").Dialect} Dialect */
/** @typedef {import("./patterns.js").Rules} Rules */
/** @typedef {import("./tables.js").Choice} Choice */
/** @typedef {import("./tables.js").Columns} Columns */
/** @typedef {[number, number, number]} Triple */

/**
 * A reading: seconds or null, the field in the unit of the reader, and the acceleration, in any unit.
 * @typedef {{time: number | null, field: Triple, acceleration: Triple | null}} Reading
 */

/**
 * A log: (3N) field in `unit`, (3N) accelerations or null, (N) times in s or null, and the recognised format in words.
 * @typedef {{field: Float64Array, acceleration: Float64Array | null, time: Float64Array | null, unit: "uT" | "counts", raw: Form["raw"],
 *     words: string[]}} Log
 */

/** Largest log in bytes; larger ones need the command line. */
const MAX_LOG_BYTES = 64 << 20;
/** Lines used to recognise a log. */
const OPENING = 8192;
/** Marks a missing acceleration. */
const NONE = [NaN, NaN, NaN];
/** Lines of a wire used to recognise its format. */
const MIN_WIRE_LINES = 20;

/**
 * Conversion of lines to readings.
 * @typedef {object} Form
 * @property {string} words
 * @property {"uT" | "counts"} unit
 * @property {{unit: string, scale: number}} raw The recorded unit, and its size in `unit`.
 * @property {boolean} isTimed
 * @property {Silence} silence Counts readings without an answer of the sensor.
 * @property {(line: string) => Reading | null | undefined} reading Null for another line, undefined for one without a reading.
 */

/** @type {WeakMap<object, Language>} */
const languages = new WeakMap();

/**
 * The language of lines, cached by the data of a page.
 * @param {{lines: object}} data
 * @returns {Language}
 */
function languageOf(data) {
    let language = languages.get(data);
    if (!language) languages.set(data, (language = new Language(revived(data.lines))));
    return language;
}

class Language {
    /** @param {Rules} rules */
    constructor(rules) {
        this.rules = rules;
        this.prints = new Prints(rules, new Names(rules));
        this.tables = new Tables(rules, this.prints);
    }

    /**
     * Format of lines.
     * @param {string[]} lines The first.
     * @param {Choice | null} choice Choice of columns, if names are ambiguous.
     * @param {string[]} [every] All lines, to detect several devices.
     * @returns {Form}
     * @throws {Unreadable} As `Unclear` if a choice of columns would help.
     */
    form(lines, choice, every = lines) {
        const found = this.recogniseDialect(lines);
        const isPrint = found !== null && found.words === this.rules.labelled.WORDS;
        const dialect = isPrint && !this.namesMagnetometer(found) && this.tables.isTable(lines) ? null : found;
        try {
            return dialect ? this.ofDialect(dialect, lines, choice) : this.ofTable(lines, choice, every);
        } catch (error) {
            const isOpen = error instanceof Unreadable && !(error instanceof Several);
            const guess = isOpen && !dialect ? this.guessDialect(lines) : null;
            if (!guess || (!this.namesMagnetometer(guess) && this.tables.isTable(lines))) throw error;
            return this.ofDialect(guess, lines, choice);
        }
    }

    /**
     * Whether names contain a word for a magnetometer, not only a letter or an axis.
     * @param {Dialect} dialect
     */
    namesMagnetometer({ names }) {
        return names.some((name) => {
            const { kind, axis, rank } = this.prints.names.meaning(name);
            return kind === this.rules.names.FIELD && axis && this.prints.names.clearness(rank) === 0;
        });
    }

    /**
     * Dialect with distinctive signs in the lines; null for a table.
     * @param {string[]} lines
     * @returns {Dialect | null}
     */
    recogniseDialect(lines) {
        const { layout, marked: programs, json } = this.rules;
        const tried = lines.slice(0, layout.TRIED_LINES);
        const below = lines.slice(layout.MAX_HEADING_LINES, layout.TRIED_LINES);
        if (below.length && below.every((line) => whole(layout._PLAIN, line))) return null;
        const has = (/** @type {RegExp} */ sign) => tried.some((line) => sign.test(line));
        const behind = (/** @type {string[]} */ rest) => this.recogniseDialect(rest);
        return (
            (lines.some((line) => programs.SIGN.test(line)) && markedDialect(this.prints, programs, lines)) ||
            (has(layout._OPENS_JSON) && jsonLines(this.prints, json, tried)) ||
            (has(layout._CLOCK) && stampedDialect(this.rules, tried, behind, (rest) => this.tableRows(rest), true)) ||
            (has(layout._LETTER) && labelledDialect(this.prints, this.rules.labelled, tried, true)) ||
            null
        );
    }

    /**
     * Dialect of lines that are not a table and have no distinctive signs.
     * @param {string[]} lines
     */
    guessDialect(lines) {
        const behind = (/** @type {string[]} */ rest) => this.recogniseDialect(rest) ?? labelledDialect(this.prints, this.rules.labelled, rest, false);
        return stampedDialect(this.rules, lines, behind, (rest) => this.tableRows(rest), false) ?? labelledDialect(this.prints, this.rules.labelled, lines, false);
    }

    /**
     * Dialect of table rows, as after time stamps.
     * @param {string[]} lines
     * @returns {Dialect | null}
     */
    tableRows(lines) {
        let layout;
        try {
            layout = this.tables.layoutOf(lines);
        } catch (error) {
            if (error instanceof Unreadable) return null;
            throw error;
        }
        const { delimiter, decimal, width, header, headerText } = layout;
        const nameless = width === 3 ? ["x", "y", "z"] : Array.from({ length: width }, (_, i) => `${i + 1}`);
        /** @type {Dialect} */
        const rows = {
            words: `${this.rules.layout.DELIMITER_WORDS[delimiter]}-separated numbers`,
            names: header.length ? header : nameless,
            row: (line) => {
                if (headerText && line === headerText) return [];
                const cells = this.cells(line, layout)?.slice(0, width || undefined) ?? null;
                return cells && cells.map((cell) => cell.trim().replace(decimal, "."));
            },
            fresh: () => rows,
        };
        return rows;
    }

    /**
     * @param {Dialect} dialect
     * @param {string[]} lines
     * @param {Choice | null} choice
     * @returns {Form}
     */
    ofDialect(dialect, lines, choice) {
        const all = rowsOf(dialect, lines);
        if (!all.length) throw new Unreadable(`they are ${dialect.words} without a line of a magnetometer`);
        const only = this.tables.sensorOf(all);
        const rows = only ? all.filter((row) => this.tables.isOf(only, row)) : all;
        const columns = this.tables.columns(dialect.names, rows, ".", choice, { only });
        this.tables.refuseSeveral(dialect.names, () => rows, only);
        const own = dialect.fresh();
        return this.formOf(dialect.words, columns, ".", (line) => {
            const row = own.row(line);
            return row?.length ? row : row && undefined;
        });
    }

    /**
     * @param {string[]} lines
     * @param {Choice | null} choice
     * @param {string[]} every
     * @returns {Form}
     */
    ofTable(lines, choice, every) {
        const layout = this.tables.layoutOf(lines, choice, every);
        const separated = `${this.rules.layout.DELIMITER_WORDS[layout.delimiter]}-separated`;
        return this.formOf(`lines of numbers, ${separated}`, layout.columns, layout.decimal, (line) => {
            if (!line.trim() || this.prints.isComment(line) || line === layout.headerText) return undefined;
            return this.cells(line, layout);
        });
    }

    /**
     * The cells of a row of a table; null for another line.
     * @param {string} line
     * @param {import("./tables.js").Layout} layout
     * @returns {string[] | null}
     */
    cells(line, { delimiter, decimal, width, columns }) {
        const cells = this.prints.split(line, delimiter);
        if (width ? !this.prints.fits(cells, width) : cells.length <= Math.max(...columns.field)) return null;
        if (columns.field.some((cell) => this.prints.number(cells[cell], decimal) === null)) return null;
        return cells;
    }

    /**
     * @param {string} words
     * @param {Columns} columns
     * @param {string} decimal
     * @param {(line: string) => string[] | null | undefined} cells
     * @returns {Form}
     */
    formOf(words, columns, decimal, cells) {
        const { PER_UNIT, COUNTS } = this.rules.units;
        const { field, time, unit, names, acceleration: felt, only } = columns;
        const scale = columns.scale ?? PER_UNIT[unit] ?? 1;
        const timed = time ? `, time in ${time.name}` : "";
        const past = midnights();
        const silence = new Silence(this.rules.silence);
        return {
            words: `${words}: columns ${names.join(", ")} in ${unit}${timed}`,
            unit: unit === COUNTS && !columns.scale ? "counts" : "uT",
            raw: { unit, scale },
            isTimed: time !== null,
            silence,
            reading: (line) => {
                const texts = cells(line);
                if (!texts) return texts;
                if (only && !this.tables.isOf(only, texts)) return undefined;
                const row = texts.map((cell) => this.prints.number(cell, decimal) ?? NaN);
                if (time?.clock) row[time.cell] = past(time.clock.seconds(texts));
                if (silence.has(field.map((cell) => row[cell]))) return undefined;
                const [x, y, z] = field.map((cell) => row[cell] * scale);
                const acceleration = felt && /** @type {Triple} */ (felt.map((cell) => row[cell] ?? NaN));
                return Number.isFinite(x + y + z) ? { time: secondsOf(time, row), field: [x, y, z], acceleration } : undefined;
            },
        };
    }
}

/**
 * Rows of lines by a dialect.
 * @param {Dialect} dialect
 * @param {string[]} lines
 */
function rowsOf(dialect, lines) {
    const trial = dialect.fresh();
    return lines.flatMap((line) => {
        const row = trial.row(line);
        return row?.length ? [row] : [];
    });
}

/**
 * @param {Columns["time"]} time
 * @param {number[]} row
 * @returns {number | null}
 */
function secondsOf(time, row) {
    if (!time) return null;
    const seconds = (row[time.cell] - time.start) * time.factor;
    const all = time.fraction === null ? seconds : seconds + 1e-9 * row[time.fraction];
    return Number.isFinite(all) ? all : null;
}

/**
 * Reads the output of a board, piece by piece.
 *
 * Lines are queued until their format is recognised, from twenty lines or those of the first second.
 */
export class LineReader {
    /** @param {{lines: object}} data `page.json`. */
    constructor(data) {
        this.language = languageOf(data);
        this.rules = this.language.rules.transcript;
        /** @type {Form | null} */
        this.form = null;
        this.isTimed = false;
        this.rest = "";
        this.isCut = true;
        this.isDropping = false;
        /** @type {{line: string, at: number | null}[]} */
        this.waiting = [];
        /** @type {string[]} */
        this.before = [];
        /** @type {number | null} */
        this.last = null;
        this.readings = 0;
        this.unknown = 0;
        this.unlike = 0;
        this.example = "";
        this.heard = false;
        /** Reason why lines are not read, in words. */
        this.refusal = "";
        /** @type {Unclear | null} Open question to the user. */
        this.unclear = null;
        /** @type {Choice | null} */
        this.choice = null;
    }

    /** Unit of the readings; empty while unknown. */
    get unit() {
        return this.form?.unit ?? "";
    }

    /** The recorded unit, and its size in `unit`. */
    get raw() {
        return this.form?.raw ?? { unit: this.unit, scale: 1 };
    }

    /** Format of the lines in words; empty while unknown. */
    get words() {
        return this.form?.words ?? "";
    }

    /** Sentence on readings without an answer of the sensor; empty while they are few. */
    get silence() {
        const silence = this.form?.silence;
        return silence && silence.count >= this.rules.MAX_UNANSWERED ? `${silence}; such readings are left out: check its supply and its bus` : "";
    }

    /**
     * Advice if no readings arrive; empty without advice.
     * @returns {string}
     */
    get advice() {
        if (this.unlike >= this.rules.MAX_UNLIKE_LINES) {
            return `the last ${this.unlike} lines are not like the first ones: the latest is '${this.example}'; connect again`;
        }
        if (this.readings) return "";
        if (this.unclear || this.refusal.endsWith(MORE_WITH)) return this.refusal;
        if (!this.heard) {
            return "nothing arrives: see that the sensor is on and prints its readings, and that the baud rate is right";
        }
        if (!this.example) {
            return "what arrives has no line end: check the baud rate, and that the sketch prints each reading on a line (println)";
        }
        const what = `no line of three numbers that can be read ('${this.example}')`;
        return `what arrives has ${what}: check the baud rate, and what the sketch prints`;
    }

    /**
     * Process received text, even if empty, so that queued lines are read in time.
     * @param {string} text
     * @param {number | null} [at] Seconds since the start; used for readings without times.
     * @returns {{rows: Reading[], unit: "uT" | "counts" | ""}}
     */
    take(text, at = null) {
        this.heard ||= text.length > 0;
        const lines = (this.rest + text).split(/[\r\n]+/);
        this.rest = lines.pop() ?? "";
        for (const line of lines) this.queue(line, at);
        if (this.rest.length > this.rules.MAX_LINE_BYTES) {
            this.isDropping = true;
            this.rest = "";
        }
        if (!this.form && this.isEnough(at)) this.settle();
        /** @type {Reading[]} */
        const rows = [];
        if (!this.form) return { rows, unit: "" };
        for (const { line, at: arrived } of this.waiting.splice(0)) {
            const reading = this.read(line, arrived);
            if (reading) rows.push(reading);
        }
        return { rows, unit: this.form.unit };
    }

    /**
     * @param {string} line
     * @param {number | null} at
     */
    queue(line, at) {
        const isWhole = !this.isDropping && line.length <= this.rules.MAX_LINE_BYTES;
        const bare = line.replace(/^[\ufeff\0]+|[\ufeff\0]+$/g, "");
        const isCut = this.isCut && isUnmarked(this.language, bare);
        this.isDropping = false;
        if (!bare.trim()) return;
        this.isCut = false;
        if (isWhole && !isCut) this.waiting.push({ line: bare, at });
        else if (!isWhole) this.note(bare);
    }

    /** @param {number | null} at */
    isEnough(at) {
        const first = this.waiting[0]?.at ?? null;
        const isLate = at !== null && first !== null && at - first >= this.rules.SETTLE_S;
        return this.waiting.length >= this.rules.RECOGNITION_LINES || isLate;
    }

    settle() {
        const lines = this.waiting.map(({ line }) => line);
        const all = [...this.before, ...lines];
        try {
            const trial = this.language.form(all, this.choice);
            const times = all.flatMap((line) => trial.reading(line) ?? []).map(({ time }) => time ?? NaN);
            if (!times.length && !trial.silence.count) throw new Unreadable("no line has a reading");
            this.isTimed = trial.isTimed && ascend(times);
            this.form = this.language.form(all, this.choice); // its trial remembers parts of a reading
        } catch (error) {
            if (!(error instanceof Unreadable)) throw error;
            this.refusal = error.message;
            this.unclear = error instanceof Unclear ? error : null;
            lines.forEach((line) => this.note(line));
            this.before = [...this.before, ...lines].slice(-MIN_WIRE_LINES);
            this.waiting = [];
        }
    }

    /**
     * @param {string} line
     * @param {number | null} at
     * @returns {Reading | null}
     */
    read(line, at) {
        const reading = this.form?.reading(line);
        if (!reading) {
            if (reading === null && !this.language.prints.isComment(line)) this.note(line);
            return null;
        }
        this.unlike = 0;
        this.readings++;
        return this.isTimed ? reading : { ...reading, time: this.arrival(at) };
    }

    /**
     * Time of a reading without one; readings that arrive together differ by a step.
     * @param {number | null} at
     */
    arrival(at) {
        if (at === null) return null;
        this.last = this.last === null ? at : Math.max(at, this.last + this.rules.TIME_STEP_S);
        return Number(this.last.toFixed(4));
    }

    /** @param {string} line */
    note(line) {
        this.unknown++;
        this.unlike += Number(this.form !== null);
        this.example = line.trim().slice(0, this.language.rules.tokenizer.SHOWN_LETTERS);
    }
}

/**
 * Whether times ascend like a clock; `T_C` may be a temperature.
 * @param {number[]} times
 */
function ascend(times) {
    const isOrdered = times.every((time, i) => i === 0 || !(time < times[i - 1]));
    return isOrdered && (times.length < 2 || times[times.length - 1] > times[0]);
}

/**
 * Whether the start of a line may be missing, as in a line of only numbers: `17,4,-586` may have been 217.
 * @param {Language} language
 * @param {string} line
 */
function isUnmarked(language, line) {
    return line.trim().split(/[\s,;]+/).every((cell) => language.prints.number(cell) !== null);
}

/**
 * Accelerations of readings, NaN if missing; null without any.
 * @param {readonly Reading[]} readings
 */
export function accelerationOf(readings) {
    return readings.some(({ acceleration }) => acceleration) ? readings.flatMap(({ acceleration }) => acceleration ?? NONE) : null;
}

/**
 * The readings of a text log.
 * @param {{lines: object}} data `page.json`.
 * @param {string} name Of the file.
 * @param {Uint8Array} bytes
 * @param {Choice | null} [choice] Of the columns.
 * @returns {Log}
 * @throws {Unreadable} Unless it is a text log with a magnetometer, with a remedy. As `Unclear` if a choice would help.
 */
export function readLog(data, name, bytes, choice = null) {
    const language = languageOf(data);
    refuseForeign(language.rules.files, name, bytes);
    const lines = belowHeader(language, linesOf(language, decodeText(bytes)));
    const form = language.form(lines.slice(0, OPENING), choice, lines);
    const readings = [];
    let [unknown, example] = [0, ""];
    for (const [place, line] of lines.entries()) {
        const reading = form.reading(line);
        if (reading) readings.push(reading);
        if (reading !== null || !line.trim()) continue;
        example ||= `line ${place + 1}: '${line.trim().slice(0, language.rules.tokenizer.SHOWN_LETTERS)}'`;
        unknown++;
    }
    if (!readings.length) {
        const silent = form.silence.count ? ` (${form.silence})` : "";
        throw new Unreadable(`no usable reading in ${name}${silent}: need finite x, y and z; check the sensor and its wiring`);
    }
    const hasTimes = readings.every(({ time }) => time !== null);
    const silent = form.silence.count ? [`${form.silence}`] : [];
    const others = unknown ? [`${unknown} other ${unknown === 1 ? "line" : "lines"} (${example})`] : [];
    const acceleration = accelerationOf(readings);
    return {
        field: Float64Array.from(readings.flatMap(({ field }) => field)),
        acceleration: acceleration && Float64Array.from(acceleration),
        time: hasTimes ? Float64Array.from(readings, ({ time }) => time ?? NaN) : null,
        unit: form.unit,
        raw: form.raw,
        words: [`${name}: ${form.words}`, `${readings.length.toLocaleString("en")} readings`, ...silent, ...others],
    };
}

/**
 * @param {Uint8Array} bytes
 * @returns {string}
 */
function decodeText(bytes) {
    if (isWide(bytes)) return new TextDecoder(bytes[0] === 0xff ? "utf-16le" : "utf-16be").decode(bytes);
    try {
        return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
    } catch {
        return new TextDecoder("latin1").decode(bytes);
    }
}

/**
 * Whether bytes begin with the byte order mark of UTF-16.
 * @param {Uint8Array} bytes
 */
function isWide([first, second]) {
    return (first === 0xff && second === 0xfe) || (first === 0xfe && second === 0xff);
}

/**
 * Lines of a text; records in a list of JSON have one each.
 * @param {Language} language
 * @param {string} text
 * @returns {string[]}
 */
function linesOf({ rules }, text) {
    const lines = text.split(/\r\n|\n|\r/);
    const document = /^\s*[[{]/.test(text) ? parseJson(text) : null;
    if (document === null) return lines;
    const kind = document[rules.json.MARK];
    if (kind) throw new Unreadable(`it is a ${kind} file of Flinders and not a recording: give the recording`);
    if (!Array.isArray(document)) throw new Unreadable(`it is JSON of another form than one record for each reading: ${MORE_WITH}`);
    return document.map((record) => JSON.stringify(record));
}

/**
 * Lines after the end of a header.
 * @param {Language} language
 * @param {string[]} lines
 */
function belowHeader({ rules: { layout } }, lines) {
    const isMatrix = (/** @type {string} */ line) => Number(layout.MATRIX.exec(line)?.groups?.columns ?? 0) >= 3;
    if (lines.filter(isMatrix).length > 1) throw new Unreadable(`it has several matrices, one below the other: save the magnetometer's alone; ${MORE_WITH}`);
    return lines.slice(lines.slice(0, layout.TRIED_LINES).findLastIndex((line) => whole(layout._END_OF_HEADER, line)) + 1);
}

/**
 * Refuse a file that is not text, with its type and the program that reads it.
 * @param {import("./patterns.js").Constants} files
 * @param {string} name
 * @param {Uint8Array} bytes
 */
function refuseForeign(files, name, bytes) {
    if (!bytes.length) throw new Unreadable(`${name} is empty: record again, or check what was saved`);
    if (bytes.length > MAX_LOG_BYTES) {
        throw new Unreadable(`${name} is larger than ${MAX_LOG_BYTES >> 20} MB: calibrate it with \`flinders calibrate\``);
    }
    const head = Array.from(bytes.subarray(0, 64), (byte) => byte.toString(16).padStart(2, "0")).join("");
    const kindOf = (/** @type {Record<string, any>} */ starts) => Object.keys(starts).find((start) => head.startsWith(start));
    const suffix = (/\.[^.]+$/.exec(name)?.[0] ?? "").toLowerCase();
    const isText = !isBinary(files, bytes);
    const log = (isText ? undefined : files.suffixes[suffix]) ?? files.starts[kindOf(files.starts) ?? ""];
    if (log) {
        throw new Unreadable(`${name} is a recording of another kind (${log}): calibrate it with \`flinders calibrate ${name}\``);
    }
    const other = files.others[kindOf(files.others) ?? ""];
    if (other && !isText) throw new Unreadable(`${name} is ${other[0]}: ${other[1]}`);
    const start = new TextDecoder().decode(bytes.subarray(0, 64)).trimStart().toLowerCase();
    const page = Object.keys(files.pages).find((each) => start.startsWith(each));
    if (page) throw new Unreadable(`${name} is ${files.pages[page]}: ${page.startsWith("<?") ? "export the readings as CSV, x, y and z in columns" : "download the raw file that it shows"}`);
    if (!isText) throw new Unreadable(`${name} is a binary file: give a text log, or calibrate it with \`flinders calibrate\``);
}

/**
 * Whether bytes contain values that text does not.
 * @param {import("./patterns.js").Constants} files
 * @param {Uint8Array} bytes
 */
function isBinary(files, bytes) {
    const head = bytes.subarray(0, 1 << 16);
    const controls = head.filter((byte) => files.controls.includes(byte)).length;
    return !isWide(bytes) && controls > files.most_controls * head.length;
}
