/** Splits a printed line into numbers, and names them by labels and units. The tables are those of `readers/_tokenizer.py`. */

import { ahead, replaceAll, stripLetters, stripEnd, stripStart, whole } from "./patterns.js";

/** @typedef {import("./names.js").Names} Names */
/** @typedef {import("./patterns.js").Rules} Rules */

/**
 * A line, split into its numbers and the text before, between and after them.
 * @typedef {{numbers: string[], gaps: string[]}} Cut
 */

/** Largest number of kinds of lines with cached names. */
const MAX_CACHED_KINDS = 1024;
const NUMBER = /^[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?$/i;
const INFINITE = /^([-+]?)inf(?:inity)?$/i;

export class Prints {
    /**
     * @param {Rules} rules
     * @param {Names} names
     */
    constructor(rules, names) {
        this.rules = rules.tokenizer;
        this.names = names;
        /** @type {Map<string, string[]>} */
        this.known = new Map();
    }

    /**
     * A cell as a number: NaN if empty or `nan`, null for text.
     * @param {string} cell
     * @param {string} [decimal]
     * @returns {number | null}
     */
    number(cell, decimal = ".") {
        let text = cell.trim();
        if (this.rules.MISSING.includes(text.toLowerCase())) return NaN;
        if (decimal === ",") {
            if (text.endsWith(",")) return null;
            text = text.replaceAll(",", ".");
        }
        text = text.replaceAll(this.rules.MINUS, "-");
        if (NUMBER.test(text)) return Number(text);
        const infinite = INFINITE.exec(text);
        return infinite ? Number(`${infinite[1]}Infinity`) : null;
    }

    /** @param {string} text */
    isComment(text) {
        return this.rules.COMMENTS.some((/** @type {string} */ sign) => text.trimStart().startsWith(sign));
    }

    /**
     * Cells of a line, quotes removed.
     * @param {string} text
     * @param {string} delimiter One character; a space is any run of spaces and tabs.
     * @returns {string[]}
     */
    split(text, delimiter) {
        if (delimiter === this.rules.SPACES) return this.splitColumns(text.replaceAll('"', "")).split(/\s+/).filter(Boolean);
        return text.includes('"') ? quotedCells(text, delimiter) : text.split(delimiter);
    }

    /**
     * Whether a line has the width of the others; a delimiter at its end is allowed.
     * @param {string[]} cells
     * @param {number} width
     */
    fits(cells, width) {
        return cells.length === width || (cells.length > width && !cells.slice(width).some((cell) => cell.trim()));
    }

    /**
     * @param {string} line
     * @returns {Cut}
     */
    cut(line) {
        const { _COLOURS, _CHECK_SUM, _TELEPLOT, _SENSOR_NUMBER, _REMARK_AFTER_LABEL, _DIGITS, MOMENT, _LOOSE_SIGN, _CUT } = this.rules;
        if (line.startsWith("$")) line = replaceAll(_CHECK_SUM, "", line);
        line = replaceAll(_TELEPLOT, "$1", replaceAll(_COLOURS, "", line));
        line = replaceAll(_SENSOR_NUMBER, "$1$2", replaceAll(MOMENT, " ", this.splitColumns(line)));
        line = replaceAll(_REMARK_AFTER_LABEL, (remark) => replaceAll(_DIGITS, "#", remark), line);
        const pieces = (line.includes("- ") ? replaceAll(_LOOSE_SIGN, " -", line) : line).split(_CUT);
        return {
            numbers: pieces.filter((_, i) => i % 2).map((number) => this.decimal(number)),
            gaps: pieces.filter((_, i) => i % 2 === 0).map((gap) => gap.trim()),
        };
    }

    /**
     * A number in decimal; a hexadecimal one of full width is signed, and an overflow is `nan`.
     * @param {string} number
     */
    decimal(number) {
        if (/^[-+]*(?:inf|ovf)$/i.test(number)) return "nan";
        const match = /^([-+]?)0x([0-9a-f]+)$/i.exec(number);
        if (!match) return number.replaceAll(this.rules.MINUS, "-");
        const value = parseInt(match[2], 16);
        const bits = this.rules._BITS[match[2].length] ?? 0;
        const signed = bits && value >= 2 ** (bits - 1) ? value - 2 ** bits : value;
        return `${match[1] === "-" ? "-" : ""}${signed}`;
    }

    /**
     * Separate decimals in columns of fixed width that touch because of a minus sign.
     * @param {string} text
     */
    splitColumns(text) {
        if (!text.includes("-")) return text;
        return replaceAll(this.rules.JOINED_DECIMALS, (match) => match[0] + match.slice(1).replaceAll("-", " -"), text);
    }

    /**
     * Names of the numbers of a line by label, axis and unit; empty without a label.
     * @param {string[]} gaps
     * @returns {string[]}
     */
    namesOf(gaps) {
        const key = gaps.join("\n");
        let names = this.known.get(key);
        if (!names) {
            if (this.known.size >= MAX_CACHED_KINDS) this.known.clear();
            this.known.set(key, (names = this.namesFromGaps(gaps)));
        }
        return names;
    }

    /**
     * @param {string[]} gaps
     * @returns {string[]}
     */
    namesFromGaps(gaps) {
        const behind = gaps.slice(1).map((gap) => this.unitAndLabel(gap));
        const first = whole(this.rules._TICKS, gaps[0]) ? "time (ms)" : this.label(gaps[0]);
        const labels = [first, ...behind.slice(0, -1).map(({ label }) => label)];
        const units = behind.map(({ unit }) => unit);
        /** @type {string[]} */
        const names = [];
        let sensor = "";
        for (const [first, count] of runs(labels)) {
            const { label, unit } = this.withoutUnit(labels[first]);
            if (label !== labels[first]) sensor = "";
            const own = this.axes(label, count, sensor);
            sensor = own.sensor;
            const stated = unit || units.slice(first, first + count).reverse().find(Boolean) || "";
            for (let place = first; place < first + count; place++) units[place] ||= stated;
            names.push(...own.names);
        }
        const all = shareUnit(names, units);
        return names.map((name, place) => (all[place] ? `${name} (${all[place]})` : name));
    }

    /**
     * All words before and between the numbers, which identify the lines of one sensor.
     * @param {string[]} gaps
     */
    labelOf(gaps) {
        const text = replaceAll(this.rules._LEVEL, "", gaps.slice(0, -1).join(" "));
        return text.replace(/[^\p{L}\p{N}]/gu, "").toLowerCase();
    }

    /**
     * Whether the text between numbers has signs of a label, and not only commas.
     * @param {string[]} gaps
     */
    isLabelled(gaps) {
        const hasSign = (/** @type {string} */ gap) => gap.split(/[,;]/).some((part) => this.rules._LABEL.test(part));
        return gaps.slice(0, -1).some((gap) => gap && ("xyzXYZ".includes(gap.slice(-1)) || hasSign(gap)));
    }

    /**
     * Split the text between two numbers into the unit of the first and the label of the second.
     * @param {string} gap
     */
    unitAndLabel(gap) {
        const text = stripStart(gap, this.rules._CLOSING_SIGNS);
        const unit = ahead(this.rules._UNIT_AHEAD, text);
        return unit ? { unit: unit[1], label: this.label(text.slice(unit[0].length)) } : { unit: "", label: this.label(text) };
    }

    /**
     * The words of a label, with brackets around a unit at its end.
     * @param {string} gap
     */
    label(gap) {
        const { _REMARK, _SENSOR_AND_UNIT, _UNIT_INSIDE, _LABEL_SEPARATORS, _SIGNS_BEFORE_NUMBER, _BRACKET, _EDGE, _LEVEL } = this.rules;
        const bare = stripEnd(replaceAll(_LEVEL, "", gap), _SIGNS_BEFORE_NUMBER);
        const whole = replaceAll(_SENSOR_AND_UNIT, " $1 ($2)", replaceAll(_REMARK, "", bare));
        const inside = _UNIT_INSIDE.exec(whole);
        const text = inside ? whole : replaceAll(_BRACKET, (_, remark) => this.remark(remark), whole);
        const words = stripLetters(replaceAll(_LABEL_SEPARATORS, " ", stripLetters(replaceAll(_UNIT_INSIDE, " ", text), _EDGE)), _EDGE);
        return inside ? `${words} (${inside[1]})`.trimStart() : words;
    }

    /**
     * Words of a remark in brackets that distinguish readings, such as `raw` and `left`.
     * @param {string} remark
     */
    remark(remark) {
        const words = remark.match(/[\p{L}\p{N}_]+/gu) ?? [];
        return words.filter((word) => this.names.tellsReadingsApart(word.toLowerCase())).map((word) => ` ${word}`).join("");
    }

    /** @param {string} label */
    withoutUnit(label) {
        const before = whole(this.rules._UNIT_AND_AXIS, label);
        if (before) return { label: before[2], unit: before[1] };
        const inside = this.rules._UNIT_INSIDE.exec(label);
        return inside ? { label: label.slice(0, inside.index).trimEnd(), unit: inside[1] } : { label, unit: "" };
    }

    /**
     * Names of the numbers after one label, and the sensor for following labels that are only an axis.
     * @param {string} label
     * @param {number} count
     * @param {string} sensor
     * @returns {{names: string[], sensor: string}}
     */
    axes(label, count, sensor) {
        const { _XYZ, _EDGE, QUANTITY, _AXIS, _AXIS_AHEAD, _MEANINGLESS } = this.rules;
        const bare = stripLetters(replaceAll(_XYZ, "", label), _EDGE);
        if (count === 3 && (label || sensor)) {
            const named = QUANTITY.test(bare) ? bare : bare ? this.knownWords(bare, " x") : "";
            return { names: ["x", "y", "z"].map((axis) => `${named} ${axis}`.trimStart()), sensor: named };
        }
        if (count > 1) {
            const numbered = Array.from({ length: count }, (_, i) => (label ? `${label} ${i + 1} of ${count}` : ""));
            return { names: numbered, sensor: "" };
        }
        const before = whole(_AXIS_AHEAD, label);
        if (before && (before[2] || !before[3])) {
            const words = replaceAll(_MEANINGLESS, " ", `${before[2] ?? ""} ${before[3]}`).split(/\s+/).filter(Boolean);
            label = [...words, before[1]].join(" ");
            if (before[2]?.toLowerCase() === "norm") return { names: [label], sensor };
        }
        const axis = _AXIS.exec(label);
        if (!axis) return { names: [label ? this.knownWords(label) : ""], sensor: "" };
        const own = stripLetters(label.slice(0, axis.index), _EDGE);
        const words = QUANTITY.test(own) ? own : this.knownWords(own, ` ${axis[1]}`, "") || sensor;
        return { names: [`${words} ${axis[1]}`.trimStart()], sensor: words };
    }

    /**
     * The longest known ending of a label; else its last word.
     * @param {string} label
     * @param {string} [ending]
     * @param {string} [otherwise]
     */
    knownWords(label, ending = "", otherwise) {
        const words = label.split(/\s+/).filter(Boolean);
        const few = Math.min(this.rules._MAX_WORDS, words.length - 1);
        const counts = [words.length, ...Array.from({ length: Math.max(few, 0) }, (_, i) => few - i)];
        for (const count of counts) {
            const some = words.slice(words.length - count).join(" ");
            if (some && this.names.meaning(some + ending).kind) return some;
        }
        return otherwise ?? words[words.length - 1] ?? "";
    }
}

/**
 * Position of each label, and the number of unlabelled numbers after it.
 * @param {string[]} labels
 * @returns {[number, number][]}
 */
function runs(labels) {
    const starts = labels.flatMap((label, place) => (label || place === 0 ? [place] : []));
    return starts.map((start, i) => [start, (starts[i + 1] ?? labels.length) - start]);
}

/**
 * Units, with the unit of three consecutive axes copied to all three.
 * @param {string[]} names
 * @param {string[]} units
 */
function shareUnit(names, units) {
    const known = [...units];
    const axes = names.map((name) => name.slice(-1).toLowerCase());
    for (let place = 0; place + 2 < names.length; place++) {
        const stated = new Set(known.slice(place, place + 3).filter(Boolean));
        if (axes.slice(place, place + 3).join("") === "xyz" && stated.size === 1) known.fill([...stated][0], place, place + 3);
    }
    return known;
}

/**
 * Cells of a line with quotes; spaces before a cell are dropped.
 * @param {string} text
 * @param {string} delimiter
 */
function quotedCells(text, delimiter) {
    const cells = [];
    let place = 0;
    while (place <= text.length) {
        const start = /^ */.exec(text.slice(place))?.[0].length ?? 0;
        place += start;
        const quoted = text[place] === '"' ? /^"((?:[^"]|"")*)"?/.exec(text.slice(place)) : null;
        let cell = "";
        if (quoted) {
            cell = quoted[1].replaceAll('""', '"');
            place += quoted[0].length;
        }
        const end = text.indexOf(delimiter, place);
        cells.push(cell + text.slice(place, end < 0 ? text.length : end));
        place = end < 0 ? text.length + 1 : end + 1;
    }
    return cells;
}
