/**
 * Dialects: formats of lines other than tables, each converted to rows of a table. The rows are those of
 * `readers/dialects/`.
 *
 * A dialect is recognised by the first lines, and then converts one line at a time.
 */

import { midnights, secondsOfDay } from "./clocks.js";
import { ahead, countKeys, largest, whole } from "./patterns.js";
import { Unreadable } from "./tables.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {import("./patterns.js").Rules} Rules */
/** @typedef {import("./printed.js").Prints} Prints */

/**
 * Conversion of lines to rows.
 * @typedef {object} Dialect
 * @property {string} words Name of the format, for the user.
 * @property {string[]} names Of the columns; empty if the lines do not state them.
 * @property {(line: string) => string[] | null} row Cells of a reading, empty for a part of one, null for another line.
 * @property {() => Dialect} fresh Return a copy in its initial state.
 */

/** @typedef {(lines: string[]) => Dialect | null} Recognise */

/**
 * A line with labels, split into its parts.
 * @typedef {object} Printed
 * @property {string} kind Names of its numbers, one a line; lines of one kind have the same.
 * @property {string} label The words before and between its numbers.
 * @property {string} text
 * @property {string[]} names
 * @property {string[]} numbers
 * @property {string[]} gaps
 * @property {boolean} isLabelled
 * @property {boolean} isPlain
 * @property {boolean} isSetting
 */

// Lines whose beginning states their content

class Marked {
    /**
     * @param {Prints} prints
     * @param {Constants} form A row of `marked.py`.
     */
    constructor(prints, form) {
        this.prints = prints;
        this.form = form;
        /** @type {string} */
        this.words = form.words;
        /** @type {string[]} */
        this.names = form.names;
    }

    fresh() {
        return this;
    }

    /** @param {string} line */
    row(line) {
        const { mark, counts } = this.form;
        const match = whole(this.form.line, line.trim())?.groups;
        if (!match) return null;
        if (match.mark.toLowerCase() !== mark.toLowerCase()) return [];
        const cells = match.values.trim().split(/\s*,\s*|\s+/);
        const numbers = cells.map((cell) => this.prints.number(cell));
        if (cells.length !== this.names.length || numbers.includes(null)) return null;
        if (!counts.length) return cells;
        return numbers.map((number, place) => `${Number(((number ?? NaN) / counts[place]).toPrecision(9))}`);
    }
}

/**
 * Dialect of MotionCal's and Adafruit's lines: `Raw:` in counts, `Uni:` in units.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} lines
 * @returns {Dialect | null}
 */
export function markedDialect(prints, rules, lines) {
    for (const form of [rules._RAW, rules._UNI]) {
        const counts = new Marked(prints, { ...form, counts: [] });
        const rows = lines.map((line) => counts.row(line)).filter((row) => row?.length);
        if (!rows.length) continue;
        const isInUnits = form === rules._RAW && areUnits(rules, /** @type {string[][]} */ (rows));
        return new Marked(prints, isInUnits ? { ...rules._UNI, words: form.words, mark: "raw" } : form);
    }
    return null;
}

/**
 * Whether `Raw:` lines hold decimals and a gravity of 10 or 1, and not of 8192.
 * @param {Constants} rules
 * @param {string[][]} rows
 */
function areUnits(rules, rows) {
    const gravity = rows.map((cells) => Math.hypot(...cells.slice(0, 3).map((cell) => (cell ? Number(cell) : NaN))));
    const hasPoint = rows.some((cells) => cells.slice(0, 3).some((cell) => cell.includes(".")));
    return hasPoint && Math.min(...gravity) > 0 && Math.max(...gravity) < rules.MAX_ACCELERATION;
}

// JSON, a record in each line

class JsonLines {
    /**
     * @param {Prints} prints
     * @param {string[]} names
     */
    constructor(prints, names) {
        this.prints = prints;
        this.words = "JSON";
        this.names = names;
    }

    fresh() {
        return this;
    }

    /** @param {string} line */
    row(line) {
        const record = recordOf(line);
        if (record === null || Array.isArray(record) !== !this.names.length) return null;
        if (Array.isArray(record)) return record.length ? record.map(cellText) : null;
        const leaves = flat(record);
        return this.names.some((name) => leaves.has(name)) ? this.names.map((name) => cellText(leaves.get(name))) : null;
    }
}

/**
 * Dialect of records with three numbers; of records with different keys, the most frequent with a magnetometer's.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} lines
 * @returns {Dialect | null}
 */
export function jsonLines(prints, rules, lines) {
    const keys = [];
    for (const record of lines.map(recordOf)) {
        if (record === null) continue;
        const values = Array.isArray(record) ? record : [...flat(record).values()];
        const isNumber = (/** @type {any} */ value) =>
            typeof value === "number" || (typeof value === "string" && value !== "" && prints.number(value) !== null);
        const numbers = values.filter(isNumber);
        if (numbers.length >= rules.MIN_NUMBERS) keys.push(Array.isArray(record) ? "" : [...flat(record).keys()].join("\n"));
    }
    const counts = countKeys(keys);
    const split = (/** @type {string} */ key) => (key ? key.split("\n") : []);
    const best = largest([...counts.keys()], (key) => [Boolean(prints.names.magnetometer(split(key))), counts.get(key) ?? 0]);
    return best === undefined ? null : new JsonLines(prints, split(best));
}

/**
 * @param {string} line
 * @returns {any[] | Record<string, any> | null} An object, or a list of plain values.
 */
function recordOf(line) {
    if (!/^\s*[[{]/.test(line)) return null;
    const record = parseJson(line);
    const isPlain = Array.isArray(record) && record.every((value) => value === null || typeof value !== "object");
    return isPlain || (record && !Array.isArray(record)) ? record : null;
}

/**
 * @param {string} text
 * @returns {any} null for invalid JSON.
 */
export function parseJson(text) {
    try {
        return JSON.parse(text);
    } catch {
        return null;
    }
}

/**
 * Values inside objects and lists, with dotted names: `mag.x`, `mag.y.0`.
 * @param {object} record
 * @param {string} before
 * @returns {Map<string, any>}
 */
function flat(record, before = "") {
    /** @type {Map<string, any>} */
    const leaves = new Map();
    for (const [key, value] of Object.entries(record)) {
        if (value === null || typeof value !== "object") leaves.set(before + key, value);
        else for (const [name, leaf] of flat(value, `${before}${key}.`)) leaves.set(name, leaf);
    }
    return leaves;
}

/** @param {any} value */
function cellText(value) {
    return value === null || value === undefined ? "" : String(value);
}

// Lines with a time stamp in front

class Stamped {
    /**
     * @param {import("./patterns.js").Rules} rules
     * @param {Dialect} inner
     */
    constructor(rules, inner) {
        this.rules = rules;
        this.inner = inner;
        this.words = `time stamps before ${inner.words}`;
        this.names = ["time (s)", ...inner.names];
        this.past = midnights();
    }

    fresh() {
        return new Stamped(this.rules, this.inner.fresh());
    }

    /** @param {string} line */
    row(line) {
        const stamp = ahead(this.rules.wrapped.STAMP, line);
        if (!stamp) return null;
        const cells = this.inner.row(line.slice(stamp[0].length));
        return cells?.length ? [this.past(secondsOfDay(stamp.groups ?? {})).toFixed(6), ...cells] : cells;
    }
}

/**
 * Stamps before most lines; if `isMarked`, before a table only with a sign such as `->` behind them.
 * @param {import("./patterns.js").Rules} rules
 * @param {string[]} lines
 * @param {Recognise} behind
 * @param {Recognise} table
 * @param {boolean} isMarked
 * @returns {Dialect | null}
 */
export function stampedDialect(rules, lines, behind, table, isMarked) {
    const filled = lines.filter((line) => line.trim());
    const stamps = filled.map((line) => ahead(rules.wrapped.STAMP, line)).filter((stamp) => stamp !== null);
    if (!stamps.length || stamps.length < rules.wrapped.MIN_STAMP_SHARE * filled.length) return null;
    const marks = stamps.map((stamp) => stamp.groups?.mark ?? "");
    if (isMarked && marks.some((mark) => [",", ";", "\t"].includes(mark))) return null;
    const rest = stamps.map((stamp) => stamp.input.slice(stamp[0].length));
    const inner = behind(rest) ?? (marks.every(Boolean) || !isMarked ? table(rest) : null);
    return inner && new Stamped(rules, inner);
}

// Lines with labelled numbers

class Heading {
    /**
     * A label in its own line, for the numbers in the next line, or for the lines below with one axis each.
     * @param {Prints} prints
     * @param {Constants} rules
     */
    constructor(prints, rules) {
        this.prints = prints;
        this.rules = rules;
        this.label = "";
        this.isTaken = false;
    }

    /**
     * A line with its label in front; empty for a line that is a label itself.
     * @param {string} line
     */
    joinHeading(line) {
        if (this.isHeading(line)) {
            this.label = line;
            this.isTaken = false;
            return "";
        }
        const isAxis = Boolean(this.label) && whole(this.rules._AXIS_ALONE, line) !== null;
        const joined = this.label && (isAxis || !this.isTaken) ? `${this.label} ${line}` : line;
        this.label = isAxis ? this.label : "";
        this.isTaken = isAxis;
        return joined;
    }

    /** @param {string} line */
    isHeading(line) {
        return line.length <= this.rules.MAX_LINE_LETTERS && /[:{]$/.test(line.trimEnd()) && !this.prints.cut(line).numbers.length;
    }
}

class Labelled {
    /**
     * @param {Prints} prints
     * @param {Constants} rules
     * @param {object} form
     * @param {string} form.words
     * @param {string[]} form.names
     * @param {Map<string, number>} form.kinds Kinds that are read, and the position of their numbers in the row.
     * @param {string} form.closing The one that ends a reading.
     * @param {number[]} form.needed
     * @param {boolean} [form.hasHeadings]
     * @param {Map<string, string>} [form.labels] Label of each kind that has exactly one.
     * @param {string[]} [form.signs] Text before and between the numbers, if only that is known.
     */
    constructor(prints, rules, form) {
        this.prints = prints;
        this.rules = rules;
        this.form = form;
        this.words = form.words;
        this.names = form.names;
        this.heading = new Heading(prints, rules);
        this.cells = this.names.map(() => "");
    }

    fresh() {
        return new Labelled(this.prints, this.rules, this.form);
    }

    /** @param {string} line */
    row(line) {
        const { kinds, closing, needed, hasHeadings, labels, signs } = this.form;
        if (hasHeadings) line = this.heading.joinHeading(line);
        if (!line) return hasHeadings ? [] : null;
        const { numbers, gaps } = line.length <= this.rules.MAX_LINE_LETTERS ? this.prints.cut(line) : { numbers: [], gaps: [] };
        const kind = gaps.length > 1 ? this.prints.namesOf(gaps).join("\n") : "";
        const start = numbers.length ? kinds.get(kind) : undefined;
        const label = labels?.get(kind);
        if (label !== undefined && label !== this.prints.labelOf(gaps)) return null;
        if (start === undefined || (signs && signs.join("\n") !== gaps.slice(0, -1).join("\n"))) return null;
        this.cells.splice(start, numbers.length, ...numbers);
        if (kind !== closing) return [];
        const cells = this.cells;
        this.cells = this.names.map(() => "");
        return needed.every((place) => cells[place]) ? cells : [];
    }
}

/**
 * Lines whose labels name a magnetometer; unless `isMarked`, also three numbers between any words.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} lines
 * @param {boolean} isMarked
 * @returns {Dialect | null}
 */
export function labelledDialect(prints, rules, lines, isMarked) {
    const { MIN_KIND_SHARE, MIN_FIELD_SHARE, MAX_LINE_LETTERS, PLAIN } = rules;
    const filled = lines.filter((line) => line.trim() && !prints.isComment(line) && line.length <= MAX_LINE_LETTERS);
    const heading = new Heading(prints, rules);
    const headed = filled.map((line) => heading.joinHeading(line)).filter(Boolean).map((line) => printedOf(prints, rules, line));
    const alone = filled.map((line) => printedOf(prints, rules, line));
    const hasHeadings = haveHeadings(prints, heading, alone, headed);
    const all = hasHeadings ? headed : alone;
    const ofThree = countKeys(all.filter(({ numbers }) => numbers.length >= PLAIN.length).map(({ kind }) => kind));
    const enough = MIN_KIND_SHARE * Math.max(0, ...ofThree.values());
    const read = all.filter(({ numbers, isSetting, isPlain }) => numbers.length && !isSetting && !(isPlain && !isMarked));
    const counts = countKeys(read.map(({ kind }) => kind));
    const kinds = [...new Set(read.filter(({ isLabelled }) => isLabelled || !isMarked).map(({ kind }) => kind))];
    const often = (/** @type {number} */ least) => kinds.filter((kind) => (counts.get(kind) ?? 0) >= least);
    const able = often(enough).filter((kind) => mayBeReadings(prints, rules, [kind], read));
    const closing = magnetometerKind(prints, rules, able, counts);
    const total = [...ofThree.values()].reduce((sum, count) => sum + count, 0);
    if (closing !== null && (counts.get(closing) ?? 0) < MIN_FIELD_SHARE * total) return null;
    const most = Math.max(0, ...kinds.filter((kind) => kind.trim()).map((kind) => counts.get(kind) ?? 0));
    const form =
        closing === null
            ? axisByAxis(prints, rules, often(Math.max(MIN_KIND_SHARE * most, enough)), read)
            : lineByLine(prints, rules, closing, counts, read);
    if (!form) return isMarked ? null : byPlace(prints, rules, read, enough, all);
    return new Labelled(prints, rules, { ...form, hasHeadings, labels: labelsOf(rules, form, read) });
}

/**
 * Whether labels stand in lines of their own above the numbers: often enough, and several or known ones.
 * @param {Prints} prints
 * @param {Heading} heading
 * @param {Printed[]} alone
 * @param {Printed[]} headed
 */
function haveHeadings(prints, heading, alone, headed) {
    const headings = alone.filter(({ text }) => heading.isHeading(text)).map(({ text }) => text);
    const counts = countKeys(alone.filter(({ names }) => names.some(Boolean)).map(({ kind }) => kind));
    if (2 * headings.length <= Math.max(0, ...counts.values())) return false;
    const kinds = new Set(alone.map(({ kind }) => kind));
    const isKnown = headed.some(({ kind, names }) => !kinds.has(kind) && names.some((name) => prints.names.meaning(name).kind));
    return isKnown || new Set(headings).size > 1;
}

/**
 * Label of each kind that is read; leaves out kinds with labels of several sensors, except the magnetometer's.
 * @param {Constants} rules
 * @param {{kinds: Map<string, number>, closing: string, needed: number[]}} form
 * @param {Printed[]} read
 */
function labelsOf(rules, { kinds, closing, needed }, read) {
    /** @type {Map<string, string>} */
    const labels = new Map();
    for (const [kind, start] of [...kinds]) {
        const lines = read.filter((line) => line.kind === kind);
        const counts = countKeys(lines.map(({ label }) => label));
        const often = [...counts.keys()].filter((label) => (counts.get(label) ?? 0) >= rules.MIN_AUXILIARY_SHARE * lines.length);
        if (!often.length || often.length > rules.MAX_LABELS) continue;
        labels.set(kind, often[0]);
        if (often.length === 1) continue;
        const end = start + kind.split("\n").length;
        if (kind === closing || needed.some((place) => start <= place && place < end)) {
            const [one, other] = often.map((label) => lines.find((line) => line.label === label)?.text.trim().slice(0, 60));
            throw new Unreadable(`labels tell of several sensors ('${one}' and '${other}'): keep the lines of the magnetometer`);
        }
        kinds.delete(kind);
    }
    return labels;
}

/**
 * Whether numbers may be a magnetometer's, by name, or as none is a clock or counter and not all are constant.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} kinds
 * @param {Printed[]} read
 */
function mayBeReadings({ names }, rules, kinds, read) {
    const own = kinds.flatMap((kind) => kind.split("\n"));
    const field = names.magnetometer(own);
    if (!field || names.clearness(field.rank) === 0) return true;
    const columns = kinds.flatMap((kind) => {
        const rows = read.filter((line) => line.kind === kind).map(({ numbers }) => numbers.map(Number));
        return kind.split("\n").map((_, place) => rows.map((row) => row[place]));
    });
    const axes = field.cells.map((cell) => columns[cell]);
    if (axes.some((axis) => counts(rules, axis))) return false;
    return names.isBare(own[field.cells[0]]) || axes.some(varies) || axes[0].length < rules.MIN_ROWS;
}

/**
 * Whether a column rises in even steps, like a clock or a counter.
 * @param {Constants} rules
 * @param {number[]} values
 */
function counts(rules, values) {
    const known = values.filter(Number.isFinite);
    const steps = known.slice(1).map((value, i) => value - known[i]);
    return steps.length >= rules.MIN_ROWS - 1 && Math.max(...steps) > 0 && Math.max(...steps) <= rules.MAX_STEP_RATIO * Math.min(...steps);
}

/** @param {number[]} values */
function varies(values) {
    return values.some((value) => value !== values[0]);
}

/**
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string} line
 * @returns {Printed}
 */
function printedOf(prints, rules, line) {
    const { numbers, gaps } = prints.cut(line);
    const names = numbers.length ? prints.namesOf(gaps) : [];
    return {
        kind: names.join("\n"),
        label: prints.labelOf(gaps),
        text: line,
        names,
        numbers,
        gaps,
        isLabelled: prints.isLabelled(gaps),
        isPlain: gaps.every((gap) => rules.DELIMITERS.includes(gap)) && !line.toLowerCase().includes("0x"),
        isSetting: rules._SETTING.test(gaps[0]),
    };
}

/**
 * The kind of line that names a magnetometer: the rawest, then one with a unit, then the most frequent.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} kinds
 * @param {Map<string, number>} counts
 * @returns {string | null}
 */
function magnetometerKind({ names }, rules, kinds, counts) {
    const sensors = kinds.filter((kind) => names.magnetometer(kind.split("\n")));
    const most = Math.max(...sensors.map((kind) => counts.get(kind) ?? 0));
    const often = sensors.filter((kind) => (counts.get(kind) ?? 0) >= rules.MIN_KIND_SHARE * most);
    const quality = (/** @type {string} */ kind) => {
        const columns = kind.split("\n");
        const best = names.magnetometer(columns);
        const unit = best ? names.meaning(columns[best.cells[0]]).unit : "";
        return [-(best?.rank ?? Infinity), !["", rules.COUNTS].includes(unit), counts.get(kind) ?? 0];
    };
    return largest(often, quality) ?? null;
}

/**
 * Dialect whose rows have the magnetometer's numbers first, then those of earlier lines with a time or an acceleration.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string} closing
 * @param {Map<string, number>} counts
 * @param {Printed[]} read
 */
function lineByLine(prints, rules, closing, counts, read) {
    const own = closing.split("\n");
    const rows = read.filter(({ kind }) => kind === closing).map(({ numbers }) => numbers);
    const names = namesWithTime(own, rows);
    const kinds = new Map([[closing, 0]]);
    for (const [kind, count] of counts) {
        const columns = kind.split("\n");
        const hasTime = columns.some((name) => prints.names.meaning(name).kind === rules.TIME);
        const isFelt = prints.names.vectors(columns, rules.ACCELERATION).length > 0;
        if (kind === closing || count < rules.MIN_AUXILIARY_SHARE * (counts.get(closing) ?? 0) || !(hasTime || isFelt)) continue;
        kinds.set(kind, names.length);
        names.push(...columns);
    }
    return { words: rules.WORDS, names, kinds, closing, needed: own.map((_, place) => place) };
}

/**
 * Dialect of lines with one axis each; the line of z ends a reading.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} kinds
 * @param {Printed[]} read
 */
function axisByAxis(prints, rules, kinds, read) {
    const names = kinds.flatMap((kind) => kind.split("\n"));
    const field = prints.names.magnetometer(names);
    if (!kinds.length || !field || !mayBeReadings(prints, rules, kinds, read)) return null;
    /** @type {Map<string, number>} */
    const starts = new Map();
    let [start, closing] = [0, ""];
    for (const kind of kinds) {
        starts.set(kind, start);
        const end = start + kind.split("\n").length;
        if (start <= field.cells[2] && field.cells[2] < end) closing = kind;
        start = end;
    }
    return { words: rules.WORDS, names, kinds: starts, closing, needed: field.cells };
}

/**
 * Dialect of lines of three numbers, or of four with the time first, with any text between them.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {Printed[]} read
 * @param {number} enough
 * @param {Printed[]} all
 * @returns {Dialect | null}
 */
function byPlace(prints, rules, read, enough, all) {
    const keyOf = (/** @type {Printed} */ { kind, gaps }) => [kind, ...gaps.slice(0, -1)].join("\n\n");
    const silent = read.filter(({ names }) => saysNothing(prints, rules, names));
    const alike = countKeys(silent.map(keyOf));
    const best = largest([...alike.keys()], (key) => [alike.get(key) ?? 0]);
    const count = best === undefined ? 0 : alike.get(best) ?? 0;
    const beside = countKeys(all.filter(({ numbers }) => numbers.length < rules.PLAIN.length).map(({ gaps }) => gaps.join("\n")));
    const regular = [...beside.values()].filter((lines) => lines >= rules.MIN_KIND_SHARE * count).reduce((sum, lines) => sum + lines, 0);
    const least = Math.max(enough, rules.MIN_KIND_SHARE * (all.length - regular));
    if (!count || count < least || [...alike.values()].filter((other) => other > rules.MIN_KIND_SHARE * count).length > 1) return null;
    const lines = silent.filter((line) => keyOf(line) === best);
    const rows = lines.map(({ numbers }) => numbers);
    const values = rows.map((row) => row.map(Number));
    const axes = [3, 2, 1].map((place) => values.map((row) => row[row.length - place]));
    if (axes.some((axis) => counts(rules, axis))) return null;
    if (rows.length >= rules.MIN_ROWS && axes.filter(varies).length < 2) return null;
    const { names: kind, gaps } = lines[0];
    const isOfThree = kind.length === rules.PLAIN.length;
    const names = namesWithTime(kind, rows);
    if (!isOfThree && prints.names.meaning(names[0]).kind !== rules.TIME) return null;
    const unit = unitAlone(rules, kind);
    return new Labelled(prints, rules, {
        words: isOfThree ? "lines of three numbers" : "lines of time and three numbers",
        names: [...names.slice(0, -3), ...rules.PLAIN.map((/** @type {string} */ axis) => `${axis}${unit}`)],
        kinds: new Map([[lines[0].kind, 0]]),
        closing: lines[0].kind,
        needed: kind.map((_, place) => place),
        signs: gaps.slice(0, -1),
    });
}

/**
 * Whether no label of a line's three or four numbers names another quantity.
 * @param {Prints} prints
 * @param {Constants} rules
 * @param {string[]} kind
 */
function saysNothing(prints, rules, kind) {
    const names = kind.slice(-3);
    if (kind.length !== 3 && kind.length !== 4) return false;
    if (kind.length === 4 && kind[0] && prints.names.meaning(kind[0]).kind !== rules.TIME) return false;
    if (!names.some(Boolean) || unitAlone(rules, kind)) return true;
    const parts = names.map((name) => [name.slice(0, Math.max(name.lastIndexOf(" "), 0)), name.slice(name.lastIndexOf(" ") + 1)]);
    const isOfAxes = parts.map(([, axis]) => axis).join("") === "xyz" && new Set(parts.map(([stem]) => stem)).size === 1;
    return isOfAxes && !prints.names.meaning(names[0]).kind && !rules.QUANTITY.test(names[0]);
}

/**
 * The unit after the last three numbers without labels: `1 2 3 mT`.
 * @param {Constants} rules
 * @param {string[]} kind
 */
function unitAlone(rules, kind) {
    const units = new Set(kind.slice(-rules.PLAIN.length));
    const [unit] = units;
    return units.size === 1 && unit.startsWith(" (") ? unit : "";
}

/**
 * Names of numbers; a first one without a label is the time if it ascends and is not a counter.
 * @param {string[]} kind
 * @param {string[][]} rows
 */
function namesWithTime(kind, rows) {
    if (kind[0]) return [...kind];
    const first = rows.map((row) => Number(row[0]));
    const steps = new Set(first.slice(1).map((value, i) => value - first[i]));
    const isTime = steps.size > 0 && Math.min(...steps) > 0 && !(steps.size === 1 && steps.has(1));
    return isTime ? ["time", ...kind.slice(1)] : [...kind];
}
