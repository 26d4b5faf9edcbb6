/** Meaning of column names: sensor, axis and unit. The tables are those of `readers/_names.py`. */

import { ahead, every, largest, replaceAll, stripStart, whole } from "./patterns.js";

/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {import("./patterns.js").Rules} Rules */

/**
 * Meaning of a name; `kind` is empty if unrecognised.
 * @typedef {{kind: string, axis: string, unit: string, rank: number}} Meaning
 */

/**
 * Three columns of one sensor: their places, and their rank as a source of raw readings.
 * @typedef {{cells: number[], rank: number, words: string[], name: string, isReadings: boolean}} Vector
 */

/** Largest number of cached names, as garbage on a wire has ever new names. */
const MAX_CACHED_NAMES = 4096;
const NOTHING = { kind: "", axis: "", unit: "", rank: 0 };
const LETTERS = /^\p{L}+$/u;
const DIGITS = /^\d+$/;

export class Names {
    /** @param {Rules} rules */
    constructor(rules) {
        /** @type {Constants} */
        this.rules = rules.names;
        this.spellings = rules.units.SPELLINGS;
        this.partedUnit = rules.units.SEPARATE_PREFIX;
        this.units = new Set(this.rules._UNITS);
        /** @type {Map<string, Meaning>} */
        this.known = new Map();
        /** @type {[string, RegExp][]} */
        this.chips = Object.entries(this.rules._CHIPS).map(([kind, chips]) => [kind, new RegExp(`^(?:${chips})$`)]);
    }

    /**
     * Meaning of the name of a column.
     * @param {string} name
     * @returns {Meaning}
     */
    meaning(name) {
        let meaning = this.known.get(name);
        if (!meaning) {
            if (this.known.size >= MAX_CACHED_NAMES) this.known.clear();
            this.known.set(name, (meaning = this.parseName(name)));
        }
        return meaning;
    }

    /**
     * @param {string} name
     * @returns {Meaning}
     */
    parseName(name) {
        const { _WRITTEN_HERE, _MOTOR_COLUMNS, _OTHERS, _DERIVED_WORD, CALIBRATED_RANK, FIELD, STRENGTH } = this.rules;
        const folded = name.trim().toLowerCase();
        if (Object.hasOwn(_WRITTEN_HERE, folded)) {
            const [kind, axis] = _WRITTEN_HERE[folded];
            return { ...NOTHING, kind, axis };
        }
        for (const kind of Object.keys(_MOTOR_COLUMNS)) {
            const match = whole(_MOTOR_COLUMNS[kind], folded);
            if (match) return { ...NOTHING, kind, axis: match[1] || match[2] };
        }
        const { words, units } = this.splitName(name);
        const lower = words.map((word) => word.toLowerCase());
        if ((!words.length && !units.length) || whole(this.rules._NUMBERED, name.trim())) return NOTHING;
        if (this.isStrength(lower, units)) return { ...NOTHING, kind: STRENGTH, unit: this.unit(STRENGTH, units) };
        const { sensor, axis } = this.withoutAxis(lower);
        if (sensor.some((word) => ahead(_OTHERS, word))) return NOTHING;
        const isJoined = sensor.length === lower.length;
        let [kind, rank] = axis ? this.vector(sensor, units, isJoined) : this.scalar(sensor, units);
        const isDerived = [...sensor, ...units].some((word) => ahead(_DERIVED_WORD, word.toLowerCase()));
        if (kind === FIELD && axis && isDerived) rank += CALIBRATED_RANK;
        return { kind, axis, unit: this.unit(kind, units), rank };
    }

    /**
     * Clearness of a magnetometer's name.
     * @param {number} rank
     */
    clearness(rank) {
        return Math.floor((rank % this.rules.CALIBRATED_RANK) / 2);
    }

    /**
     * Whether a name is only an axis.
     * @param {string} name
     */
    isBare(name) {
        const { kind, unit, rank } = this.meaning(name);
        return kind === this.rules.FIELD && !unit && this.clearness(rank) >= this.rules.BARE_CLEARNESS;
    }

    /**
     * Whether a text is only a unit.
     * @param {string} text
     */
    isUnit(text) {
        return this.units.has(this.withUnitTogether(text).toLowerCase());
    }

    /**
     * Groups of three columns of a kind with all axes, in the order of their first columns.
     * @param {readonly string[]} names
     * @param {string} kind
     * @param {readonly Meaning[]} [meanings]
     * @returns {Vector[]}
     */
    vectors(names, kind, meanings = names.map((name) => this.meaning(name))) {
        /** @type {Map<string, Record<string, number>>} */
        const sensors = new Map();
        /** @type {Map<string, number>} */
        const times = new Map();
        meanings.forEach(({ kind: own, axis }, place) => {
            if (own !== kind || !axis) return;
            const name = names[place].trim().toLowerCase();
            const time = (times.get(name) ?? 0) + 1;
            times.set(name, time);
            const at = placeOfAxis(name, axis);
            const stem = `${name.slice(0, at)}*${name.slice(at + 1)} ${time}`;
            sensors.set(stem, { ...sensors.get(stem), [axis]: place });
        });
        for (const [axis, place] of [...sensors.values()].flatMap((axes) => (lettersOf(axes) ? [] : Object.entries(axes)))) {
            const stem = this.wordsOfSensor(names[place]).join("");
            sensors.set(stem, { [axis]: place, ...sensors.get(stem) });
        }
        const made = [];
        for (const axes of sensors.values()) {
            const letters = lettersOf(axes);
            if (letters) made.push(this.vectorOf(names, meanings, [...letters].map((axis) => axes[axis]), letters[0]));
        }
        return made.sort((one, other) => Math.min(...one.cells) - Math.min(...other.cells));
    }

    /**
     * @param {readonly string[]} names
     * @param {readonly Meaning[]} meanings
     * @param {number[]} cells
     * @param {string} axis Of the first.
     * @returns {Vector}
     */
    vectorOf(names, meanings, cells, axis) {
        const first = names[cells[0]];
        const isReadings = !this.isNoReadings(first);
        return { cells, rank: meanings[cells[0]].rank, words: this.label(first), name: this.sensorName(first, axis), isReadings };
    }

    /**
     * The magnetometer to read: the rawest, of equals the one with the clearest name.
     * @param {readonly string[]} names
     * @param {readonly Meaning[]} [meanings]
     * @returns {Vector | undefined}
     */
    magnetometer(names, meanings) {
        return this.best(names, this.vectors(names, this.rules.FIELD, meanings));
    }

    /**
     * The sensor to read, of several of a kind.
     * @param {readonly string[]} names
     * @param {readonly Vector[]} vectors
     * @returns {Vector | undefined}
     */
    best(names, vectors) {
        const { BARE_CLEARNESS, CALIBRATED_RANK } = this.rules;
        const all = vectors.filter(({ isReadings }) => isReadings);
        const manner = (/** @type {Vector} */ { cells }) => this.manner(names[cells[0]]);
        const hasSensor = all.some((vector) => vector.rank < CALIBRATED_RANK && manner(vector) === 0);
        const readings = all.filter((vector) => !hasSensor || vector.words.length || manner(vector) < 2);
        const plain = readings.filter(({ rank }) => this.clearness(rank) < BARE_CLEARNESS);
        return largest(plain.length ? plain : readings, (vector) => this.quality(vector, manner(vector)).map((value) => -value));
    }

    /**
     * 0 for the name of a sensor, 2 for that of a field, which may be a model's, 1 for others.
     * @param {string} name
     */
    manner(name) {
        const { _SENSOR_WORD, _RAW } = this.rules;
        const words = this.wordsOfSensor(name);
        if (words.some((word) => ahead(_SENSOR_WORD, word) || ahead(_RAW, word) || this.isChip(word))) return 0;
        return words.includes("field") ? 2 : 1;
    }

    /**
     * @param {Vector} vector
     * @param {number} manner
     * @returns {number[]} Smallest of the best.
     */
    quality({ rank, name, words, cells }, manner) {
        const foreign = words.filter((word) => !DIGITS.test(word) && !this.tellsApart(word)).length;
        return [rank, manner, Number(["b", "h"].includes(name.toLowerCase())), foreign, words.length, Math.min(...cells)];
    }

    /**
     * Words of a name that distinguish sensors of a kind.
     * @param {string} name
     */
    label(name) {
        const { _MEASURES, _COMMON, _RAW, _DERIVED_WORD, _SENSOR_WORD, _LETTERS, _DEVICES } = this.rules;
        const words = this.wordsOfSensor(name);
        const hasKind = words.some((word) => this.kindOfWord(word) || this.kindOfChip(word));
        const measured = replaceAll(_MEASURES, (match) => match.replaceAll(" ", ""), words.join(" ")).split(" ");
        const plain = [_COMMON, _RAW, _DERIVED_WORD, _SENSOR_WORD];
        const apart = measured.filter((word) => word && (this.isChip(word) || !plain.some((pattern) => ahead(pattern, word))));
        const own = apart.filter((word) => hasKind || !(word in _LETTERS));
        return own.length ? own : words.filter((word) => _DEVICES.includes(word));
    }

    /** @param {string} word */
    isChip(word) {
        return whole(this.rules._CHIP, word)?.[1] === word;
    }

    /** @param {string} word */
    kindOfChip(word) {
        return this.chips.find(([, pattern]) => pattern.test(word))?.[0] ?? "";
    }

    /** @param {string} word */
    tellsApart(word) {
        return this.rules.PLACES.includes(word) || this.rules._DEVICES.includes(word) || this.isChip(word);
    }

    /**
     * Whether a word in lower case distinguishes readings, or states their processing.
     * @param {string} word
     */
    tellsReadingsApart(word) {
        return Boolean(this.tellsApart(word) || ahead(this.rules._RAW, word) || ahead(this.rules._DERIVED_WORD, word));
    }

    /**
     * Whether three columns are not a sensor's readings, such as a reference.
     * @param {string} name
     */
    isNoReadings(name) {
        const words = this.wordsOfSensor(name);
        const isDirection = words.includes("unit") && words.every((word) => ahead(this.rules._DIRECTION_WORDS, word));
        const isOther = words.some((word) => Object.hasOwn(this.rules._DERIVED_KINDS, word));
        return isDirection || isOther || words.join(" ").includes("main field");
    }

    /**
     * Name of a sensor: the column's name without axis, unit, `raw` and the like.
     * @param {string} name
     * @param {string} axis
     */
    sensorName(name, axis) {
        const { _BRACKET, _PIECES, _RAW, _DERIVED_WORD, _UNITS_OF_AXES } = this.rules;
        const bare = replaceAll(_BRACKET, "", name.trim());
        const place = placeOfAxis(bare.toLowerCase(), axis);
        let own = "";
        every(_PIECES, bare.slice(0, place) + bare.slice(place + 1)).forEach(([, between, piece], number) => {
            const folded = piece.toLowerCase();
            const isCommon = (number && _UNITS_OF_AXES.includes(folded)) || ahead(_RAW, folded) || ahead(_DERIVED_WORD, folded);
            if (!isCommon) own += (between && " _.-".includes(between.slice(-1)) ? between.slice(-1) : "_") + piece;
        });
        return stripStart(own, " _.-");
    }

    /**
     * Words of a name, and units that it may state, the most reliable first.
     * @param {string} name
     */
    splitName(name) {
        const { _BRACKETED_UNIT, _SEPARATORS, _CHIP, _PARTS, _JOINED_WORDS, FACTORS, TIME } = this.rules;
        const times = FACTORS[TIME];
        /** @type {string[]} */
        const units = [];
        name = this.withUnitTogether(name);
        const inside = _BRACKETED_UNIT.exec(name);
        if (inside && !DIGITS.test(inside[1].trim())) {
            units.push(inside[1].trim());
            name = name.slice(0, inside.index);
        }
        /** @type {string[]} */
        const words = [];
        for (const piece of name.split(_SEPARATORS)) {
            const folded = piece.toLowerCase();
            if (this.units.has(folded) && (words.length || folded in times)) {
                units.push(piece);
                continue;
            }
            const chip = whole(_CHIP, folded);
            const parts = chip ? [chip[1], chip[2], chip[3] + chip[4]] : every(_PARTS, piece).map((match) => match[0]);
            if (parts.length > 1 && parts[0].toLowerCase() === "time" && parts[parts.length - 1].toLowerCase() in times) {
                units.push(/** @type {string} */ (parts.pop()));
            } else if (parts.length > 2 && parts.slice(-2).join("").toLowerCase() in this.spellings) {
                units.push(parts.splice(-2).join(""));
            }
            for (const part of parts) {
                const glued = whole(_JOINED_WORDS, part.toLowerCase());
                words.push(...(glued ? glued.slice(1) : [part]).filter(Boolean));
            }
        }
        return { words, units };
    }

    /**
     * Name with its final unit as one word: `in micro Tesla` becomes `microTesla`.
     * @param {string} name
     */
    withUnitTogether(name) {
        return replaceAll(this.rules._ELAPSED, "", replaceAll(this.rules._IN, "", replaceAll(this.partedUnit, "$1", name)));
    }

    /** @param {string} name */
    wordsOfSensor(name) {
        const { words, units } = this.splitName(name);
        const foreign = units.filter((unit) => !this.rules._UNITS_OF_AXES.includes(unit.toLowerCase()));
        return this.withoutAxis([...words, ...foreign].map((word) => word.toLowerCase())).sensor;
    }

    /**
     * The axis in the words of a name, and the words without it.
     * @param {string[]} words
     */
    withoutAxis(words) {
        const { _ATTACHED_AXIS, _AXIS_BEFORE } = this.rules;
        const letters = words.filter((word) => ["x", "y", "z"].includes(word));
        if (letters.length === 1) return { sensor: words.filter((word) => word !== letters[0]), axis: letters[0] };
        for (const [place, word] of words.entries()) {
            const attached = whole(_ATTACHED_AXIS, word);
            if (attached) return { sensor: words.with(place, attached[1]), axis: attached[2] };
            const before = whole(_AXIS_BEFORE, word);
            if (before) return { sensor: words.with(place, before[2]), axis: before[1] };
        }
        const last = words[words.length - 1];
        const isCounted = words.length > 1 && ["0", "1", "2", "3"].includes(last);
        if (isCounted && !words.every((word) => DIGITS.test(word))) return { sensor: words.slice(0, -1), axis: last };
        return { sensor: words, axis: "" };
    }

    /**
     * Three-axis sensor named by words, and its rank as a source of raw readings.
     * @param {string[]} words
     * @param {string[]} units
     * @param {boolean} isJoined The axis was part of another word.
     * @returns {[string, number]}
     */
    vector(words, units, isJoined) {
        const { _RAW, _CALIBRATION_WORD, _COMMON, _LETTERS, _LETTERS_OF_A_DEVICE, _SENSOR_WORD, _MEASUREMENT_WORDS, _DERIVED_KINDS } = this.rules;
        const { ACCELERATION, FIELD } = this.rules;
        const raw = words.some((word) => ahead(_RAW, word)) ? 0 : 1;
        const names = words.filter((word) => !DIGITS.test(word));
        const named = names.map((word) => this.kindOfWord(word)).filter(Boolean);
        const kinds = named.length ? named : names.map((word) => this.kindOfChip(word)).filter(Boolean);
        if (kinds.length) return [kinds[0], raw + (kinds[0] === ACCELERATION && words.includes("linear") ? 5 : 0)];
        const isAside = (/** @type {string} */ word) => ahead(_SENSOR_WORD, word) || Object.hasOwn(_DERIVED_KINDS, word);
        const isPlain = (/** @type {string} */ word) => word === "axis" || isAside(word);
        const bare = names.filter((word) => !ahead(_RAW, word) && !ahead(_CALIBRATION_WORD, word) && !isPlain(word));
        const aside = names.filter(isAside);
        const isMeasured = aside.every((word) => _MEASUREMENT_WORDS.split("|").includes(word));
        if (aside.length && !bare.length) return isMeasured ? [FIELD, raw + 2] : ["", 0];
        const own = bare.filter((word) => !this.tellsApart(word) && !ahead(_COMMON, word));
        const isLetter = own.length === 1 && [..._LETTERS_OF_A_DEVICE].includes(own[0]);
        const isOfDevice = isLetter && (isJoined || bare.some((word) => this.isChip(word)));
        if (isOfDevice || (bare.length === 1 && Object.hasOwn(_LETTERS, bare[0]))) return [_LETTERS[own[0]], raw + 2];
        if (["field", "field strength"].includes(bare.join(" "))) return [FIELD, raw + 2];
        return bare.length ? ["", 0] : [this.plain(units), raw + 4];
    }

    /** @param {string} word */
    kindOfWord(word) {
        const { FIELD, ACCELERATION, RATE } = this.rules;
        if (/^(mag|flux)/.test(word) || word === "compass") return FIELD;
        if (word.startsWith("acc")) return ACCELERATION;
        return word.startsWith("gyr") || word.startsWith("angular") ? RATE : "";
    }

    /**
     * Meaning of a name that is only an axis: a field, unless its unit is of another quantity.
     * @param {string[]} units
     */
    plain(units) {
        const { FACTORS, FIELD, ACCELERATION, RATE } = this.rules;
        for (const unit of units) {
            const folded = unit.toLowerCase();
            if (unit === "g" || unit === "mg") return ACCELERATION;
            const other = [RATE, ACCELERATION].find((kind) => folded in FACTORS[kind] && !(folded in FACTORS[FIELD]));
            if (other) return other;
        }
        return !units.length || this.unit(FIELD, units) ? FIELD : "";
    }

    /**
     * Sensor without axes, or clock, named by words.
     * @param {string[]} words
     * @param {string[]} units
     * @returns {[string, number]}
     */
    scalar(words, units) {
        const { FACTORS, TEMPERATURE, CURRENT, TIME, _NON_TIME_WORD, _TIMES } = this.rules;
        const all = words.join(" ");
        const isWarm = all === "t" && units.some((unit) => unit.toLowerCase() in FACTORS[TEMPERATURE]);
        if (isWarm || (all !== "temps" && words.some((word) => /^(temp|tmp)/.test(word)))) return [TEMPERATURE, 0];
        if (words.some((word) => ["curr", "current", "amps", "amp", "ampere"].includes(word))) return [CURRENT, 0];
        const isOfWeek = words.includes("tow") || (words.includes("time") && words.includes("week"));
        if (words.some((word) => ahead(_NON_TIME_WORD, word)) && !isOfWeek) return ["", 0];
        const isTimed = isOfWeek || words.some((word) => ahead(_TIMES, word));
        const isAlone = !words.length && units.every((unit) => unit.toLowerCase() in FACTORS[TIME]);
        const isTime = isTimed || isAlone || (units.length > 0 && words.includes("elapsed"));
        return isTime ? [TIME, this.unit(TIME, units) ? 0 : 1] : ["", 0];
    }

    /**
     * Whether a name is of a known field strength.
     * @param {string[]} words
     * @param {string[]} units
     */
    isStrength(words, units) {
        const { _REFERENCES, _STRENGTHS, STRENGTH } = this.rules;
        const named = words.filter((word) => !DIGITS.test(word));
        if (!named.some((word) => _REFERENCES.includes(word))) return false;
        if (!named.every((word) => _REFERENCES.includes(word) || _STRENGTHS.includes(word))) return false;
        return named.some((word) => _STRENGTHS.includes(word)) || Boolean(this.unit(STRENGTH, units));
    }

    /**
     * First of some units that fits a kind of column.
     * @param {string} kind
     * @param {string[]} units
     */
    unit(kind, units) {
        const { FIELD, STRENGTH, RATE, FACTORS, _BROKEN_MICRO } = this.rules;
        for (const unit of units) {
            const folded = unit.toLowerCase();
            if ([FIELD, STRENGTH].includes(kind) && folded !== "raw") {
                const known = this.spellings[folded] ?? (whole(_BROKEN_MICRO, folded) ? "uT" : "");
                if (known && !(known === "T" && unit === "t")) return known;
            } else if (kind === RATE && folded.replace(/[^\x00-\x7f]/g, "") === "/s") {
                return "°/s";
            } else if (folded in (FACTORS[kind] ?? {})) {
                return folded;
            }
        }
        return "";
    }
}

/**
 * The letters of three axes of a sensor.
 * @param {Record<string, number>} axes
 */
function lettersOf(axes) {
    return ["xyz", "012", "123"].find((all) => [...all].every((axis) => axis in axes));
}

/**
 * Position of the axis in a name: the last separate letter, else the last.
 * @param {string} folded
 * @param {string} axis
 */
function placeOfAxis(folded, axis) {
    const places = [...folded.matchAll(new RegExp(axis, "g"))].map(({ index }) => index ?? 0);
    const around = (/** @type {number} */ place) => [folded[place - 1] ?? "", folded[place + 1] ?? ""];
    const alone = places.filter((place) => !around(place).some((letter) => LETTERS.test(letter)));
    return Math.max(...(alone.length ? alone : places.length ? places : [0]));
}
