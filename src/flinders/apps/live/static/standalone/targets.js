/**
 * Writes calibrations for other programs, and reads and writes calibration files.
 *
 * Templates are in `page.json` under `targets`: output of the library's writers for placeholder numbers, split at these,
 * see `standalone/targets.py`.
 */

import { cross, determinant, dot, inverseOf } from "../../../../static/views/vectors.js";
import { parseJson } from "./dialects.js";
import { exponential, figures, general, shortest, withPoint } from "./numbers.js";
import { Unreadable } from "./tables.js";

/** @typedef {import("../messages.d.ts").TargetInfo} TargetInfo */

/**
 * A calibration for export: corrected = matrix (reading − offset).
 * @typedef {object} Calibration
 * @property {number[][]} matrix Rows.
 * @property {number[]} offset In `unit`.
 * @property {number} fieldStrength In `unit`.
 * @property {boolean} fieldStrengthKnown
 * @property {"uT" | "counts"} unit
 * @property {{unit: string, scale: number}} [raw] The recorded unit, and its size in `unit`.
 * @property {string[]} [about] Sentences on origin and uncertainty, for the head of a file.
 */

/**
 * A calibration from a file, with further facts.
 * @typedef {Calibration & {fit: Record<string, any> | null, files: object[], rotation: string, disturbances: string[],
 *     isLinearized: boolean, axes: string}} Known
 */

/**
 * @typedef {object} Exported
 * @property {string} text For a packet, its bytes in hexadecimal.
 * @property {string} filename
 * @property {string[]} warnings
 * @property {string} checked Sentence on the largest error of the target's own formula.
 * @property {string | null} binary_base64
 */

/** @typedef {{of: string, at: number, over: number | string, sign: number, format: string, unit?: string}} Slot */
/** @typedef {(string | number)[]} Pieces Texts, and numbers of slots. */
/** @typedef {[number, number, number]} Triple */

/** A calibration that a target cannot hold; the message states the reason and a remedy. */
export class NotExportable extends Error {}

const WIDTH = 78;

/**
 * All targets.
 * @param {{targets: any}} data `page.json`.
 * @returns {TargetInfo[]}
 */
export function targetsOf({ targets }) {
    return targets.rows.map((/** @type {TargetInfo & {use: string}} */ { name, use, suffix, group }) => ({ name, title: use, suffix, group }));
}

/**
 * Export a calibration for a target.
 * @param {{targets: any}} data `page.json`.
 * @param {string} name Of the target.
 * @param {Calibration} calibration
 * @returns {Exported}
 * @throws {NotExportable}
 */
export function exported({ targets }, name, calibration) {
    const row = targets.rows.find((/** @type {{name: string}} */ each) => each.name === name);
    if (!row) throw new NotExportable(`there is no target ${name}`);
    const known = calibration.fieldStrengthKnown ? "known" : "relative";
    const variant = row.variants[`${calibration.unit} ${known}`];
    if (variant.refusal) throw new NotExportable(variant.refusal);
    const quantities = new Quantities(calibration);
    refuseBeyond(targets, row, quantities);
    const error = errorOf(targets, row, variant, calibration, quantities);
    const text = (/** @type {string | number} */ piece) =>
        typeof piece === "string"
            ? piece.replaceAll(targets.recorded, quantities.raw.unit)
            : slotText(targets, targets.slots[piece], quantities, error);
    const fill = (/** @type {Pieces} */ pieces) => pieces.map(text).join("");
    const [first, ...remarks] = variant.remarks.map(fill);
    const comments = row.comment ? commentLines(targets, row.comment, [first, ...(calibration.about ?? []), ...remarks]) : [];
    const bytes = variant.packet ? packet(targets, variant.packet, quantities) : null;
    const body = bytes ? `${hexadecimal(bytes)}\n` : variant.guarded ? withChecksum(fill(variant.body)) : fill(variant.body);
    return {
        text: [...comments, body].join("\n"),
        filename: `${row.name}${row.suffix}`,
        warnings: variant.warnings,
        checked: remarks[remarks.length - 1],
        binary_base64: bytes && btoa(String.fromCharCode(...bytes)),
    };
}

/** Quantities of a calibration that templates use. */
class Quantities {
    /** @param {Calibration} calibration */
    constructor({ matrix, offset, fieldStrength, unit, raw }) {
        this.raw = raw ?? { unit, scale: 1 };
        const entries = matrix.flat();
        const scale = (matrix[0][0] + matrix[1][1] + matrix[2][2]) / 3;
        const size = Math.cbrt(Math.abs(determinant(matrix)));
        /** @type {Record<string, number[]>} */
        this.values = {
            matrix: entries,
            iron: entries.map((entry) => entry / scale),
            unimodular: entries.map((entry) => entry / size),
            scale: [scale],
            radius: [fieldStrength / size],
            strength: [fieldStrength],
            offset,
        };
    }

    /**
     * Value of a slot, rounded to single precision if the target does so.
     * @param {Slot} slot
     */
    value({ of, at, over, sign, format }) {
        const own = this.values[of][at];
        const isRaw = typeof over === "string";
        const value = sign * (isRaw ? (of === "matrix" ? own * this.raw.scale : own / this.raw.scale) : own / over);
        return format === "general" || format === "digits" ? Math.fround(value) + 0 : value;
    }
}

/**
 * Text of a slot in the format of the target.
 * @param {any} targets
 * @param {Slot} slot
 * @param {Quantities} quantities
 * @param {{worst: number, deg: number}} error
 * @returns {string}
 */
function slotText(targets, slot, quantities, error) {
    if (slot.format === "error") return errorWords(targets, error, slot.unit ?? "");
    const value = quantities.value(slot);
    switch (slot.format) {
        case "digits": return withPoint(general(value, 9));
        case "general": return general(value, 9);
        case "nine": return shortest(Number(general(value, 9)));
        case "exponent": return exponential(value, 18);
        case "seventeen": return general(value, 17);
        case "figures": return figures(value, 4);
        default: return shortest(value);
    }
}

// Errors of targets

/**
 * Largest error of a target's own formula with the numbers as stored: length, and angle in degrees.
 * @param {any} targets
 * @param {any} row
 * @param {any} variant
 * @param {Calibration} calibration
 * @param {Quantities} quantities
 * @returns {{worst: number, deg: number}}
 */
function errorOf(targets, row, variant, { matrix, offset, fieldStrength }, quantities) {
    const { heldMatrix, heldOffset } = heldCorrection(targets, variant, quantities);
    const inverse = inverseOf(matrix);
    const expected = directions(targets.directions);
    const corrected = expected.map((direction) => {
        const raw = times(inverse, direction).map((value, i) => fieldStrength * value + offset[i]);
        return times(heldMatrix, raw.map((value, i) => value - heldOffset[i])).map((value) => value / fieldStrength);
    });
    const along = sum(corrected.map((each, i) => dot(each, expected[i])));
    const size = row.relative ? along / sum(corrected.map((each) => dot(each, each))) : 1;
    let [worst, deg] = [0, 0];
    corrected.forEach((each, i) => {
        const scaled = each.map((value) => size * value);
        worst = Math.max(worst, fieldStrength * Math.hypot(...scaled.map((value, axis) => value - expected[i][axis])));
        const across = Math.hypot(...cross(scaled, expected[i]));
        deg = Math.max(deg, (Math.atan2(across, dot(scaled, expected[i])) * 180) / Math.PI);
    });
    if (!(worst / fieldStrength <= Math.sin((targets.coarsest_deg * Math.PI) / 180))) {
        const off = `readings would be off by more than ${targets.coarsest_deg}°`;
        throw new NotExportable(`rounded to the target's numbers, ${off}: check the unit of the recording`);
    }
    return { worst, deg };
}

/**
 * Matrix and offset as stored by a target, in the unit of the calibration.
 * @param {any} targets
 * @param {any} variant
 * @param {Quantities} quantities
 */
function heldCorrection(targets, variant, quantities) {
    const pieces = [...variant.body, ...(variant.packet?.values ?? [])];
    /** @type {Slot[]} */
    const slots = pieces.filter((piece) => typeof piece === "number").map((piece) => targets.slots[piece]);
    const { scale } = quantities.raw;
    /** @type {(of: string) => Slot | undefined} */
    const slotOf = (of) => slots.find((slot) => slot.of === of);
    const own = slotOf("matrix") ?? slotOf("iron") ?? slotOf("unimodular");
    const [offset, gain] = [slotOf("offset"), slotOf("scale")];
    if (!own || !offset) throw new Error("a template has no matrix or no offset");
    const factor = (gain ? quantities.value({ ...gain }) : 1) / (typeof own.over === "string" ? scale : 1);
    const over = typeof offset.over === "string" ? scale : offset.over;
    const entry = (/** @type {number} */ at) => factor * quantities.value({ ...own, at, sign: 1 });
    return {
        heldMatrix: [0, 3, 6].map((start) => [entry(start), entry(start + 1), entry(start + 2)]),
        heldOffset: [0, 1, 2].map((at) => over * quantities.value({ ...offset, at, sign: 1 })),
    };
}

/**
 * @param {any} targets
 * @param {{worst: number, deg: number}} error
 * @param {string} unit
 */
function errorWords({ negligible }, { worst, deg }, unit) {
    if (Math.max(worst, deg) < negligible) return `less than ${negligible} ${unit} and ${negligible}°`;
    return `at most ${figures(Math.max(worst, negligible))} ${unit} and ${figures(Math.max(deg, negligible))}°`;
}

/**
 * Refuse values out of an autopilot's range.
 * @param {any} targets
 * @param {any} row
 * @param {Quantities} quantities
 */
function refuseBeyond(targets, row, quantities) {
    for (const { name, slots, low, high } of row.limits) {
        const values = slots.map((/** @type {number} */ slot) => quantities.value(targets.slots[slot]));
        const value = values.length > 1 ? Math.hypot(...values) : values[0];
        if (value >= low && value <= high) continue;
        const size = `${figures(value, 4)}${values.length > 1 ? " long" : ""}`;
        const range = `${figures(low, 4)} to ${figures(high, 4)}`;
        throw new NotExportable(
            `${name} would be ${size}, and ${row.title} takes ${range}: ` +
                "take away or demagnetise what is near the compass, mount it elsewhere, or check the unit of the recording",
        );
    }
}

// Files

/**
 * Remarks as comment lines in ASCII.
 * @param {any} targets
 * @param {{each: string, opening: string, closing: string, ends: [string, string][]}} comment
 * @param {string[]} remarks
 */
function commentLines({ ascii }, { each, opening, closing, ends }, remarks) {
    const lines = remarks.flatMap((remark) => {
        let text = [...remark.replaceAll(" °", "°")].map((letter) => plain(ascii[letter] ?? letter)).join("");
        for (const [unsafe, harmless] of ends) while (text.includes(unsafe)) text = text.replaceAll(unsafe, harmless);
        return wrapText(text, each);
    });
    return [opening, ...lines, closing].filter(Boolean);
}

/**
 * Text in printable ASCII, other characters by their code.
 * @param {string} text
 */
function plain(text) {
    return text.replace(/[^\x20-\x7e]/gu, (letter) => {
        const code = letter.codePointAt(0) ?? 0;
        if ("\t\n\r".includes(letter)) return { "\t": "\\t", "\n": "\\n", "\r": "\\r" }[letter] ?? "";
        const [mark, digits] = code < 0x100 ? ["x", 2] : code < 0x10000 ? ["u", 4] : ["U", 8];
        return `\\${mark}${code.toString(16).padStart(Number(digits), "0")}`;
    });
}

/**
 * @param {string} text
 * @param {string} each Prefix of each line.
 */
function wrapText(text, each) {
    const lines = [each];
    let isEmpty = true;
    for (const [, spaces, word] of text.matchAll(/( *)([^ ]+)/g)) {
        const longer = lines[lines.length - 1] + (isEmpty && lines.length > 1 ? "" : spaces) + word;
        if (isEmpty || longer.length <= WIDTH) lines[lines.length - 1] = longer;
        else lines.push(`${each}  ${word}`);
        isEmpty = false;
    }
    return lines;
}

/**
 * A C header with the checksum of its lines in its include guard.
 * @param {string} text
 */
function withChecksum(text) {
    const lines = text.split("\n");
    const own = new TextEncoder().encode(lines.slice(3, -5).join("\n"));
    const checksum = crc(own, 0xedb88320, 0xffffffff) ^ 0xffffffff;
    const written = `0x${(checksum >>> 0).toString(16).padStart(8, "0")}u`;
    return text.replaceAll(/0x[0-9a-f]{8}u/g, written);
}

/**
 * The bytes of MotionCal's packet.
 * @param {any} targets
 * @param {{signature: string, values: (number | null)[], polynomial: number}} form
 * @param {Quantities} quantities
 */
function packet(targets, { signature, values, polynomial }, quantities) {
    const bytes = new Uint8Array(4 + 4 * values.length);
    const view = new DataView(bytes.buffer);
    view.setUint16(0, parseInt(signature, 16));
    values.forEach((slot, i) => view.setFloat32(2 + 4 * i, slot === null ? 0 : quantities.value(targets.slots[slot]), true));
    view.setUint16(bytes.length - 2, crc(bytes.subarray(0, -2), polynomial, 0xffff), true);
    return bytes;
}

/**
 * @param {Uint8Array} bytes
 * @param {number} polynomial Reflected.
 * @param {number} start
 */
function crc(bytes, polynomial, start) {
    let value = start >>> 0;
    for (const byte of bytes) {
        value = (value ^ byte) >>> 0;
        for (let bit = 0; bit < 8; bit++) value = ((value >>> 1) ^ (value & 1 ? polynomial : 0)) >>> 0;
    }
    return value;
}

/** @param {Uint8Array} bytes @returns {string} Hexadecimal text in rows of sixteen bytes. */
export function hexadecimal(bytes) {
    const pairs = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0"));
    return Array.from({ length: Math.ceil(pairs.length / 16) }, (_, i) => pairs.slice(16 * i, 16 * i + 16).join(" ")).join("\n");
}

/**
 * A calibration file of Flinders.
 * @param {{targets: any}} data `page.json`.
 * @param {Calibration} calibration
 * @param {object} [more]
 * @param {object | null} [more.fit] Quality of the fit, with the fields of `Fitted` in `core/calibration_file.py`.
 * @param {object | null} [more.provenance] Release, date and files, with the fields of `ProvenanceRecord`.
 * @returns {string} JSON.
 */
export function calibrationFile({ targets }, calibration, { fit = null, provenance = null } = {}) {
    const { matrix, offset, fieldStrength, fieldStrengthKnown, unit, raw } = calibration;
    const document = {
        flinders: "calibration",
        schema: targets.schema,
        calibration: {
            matrix,
            offset,
            field_strength: fieldStrength,
            field_strength_known: fieldStrengthKnown,
            unit,
            rotation: "symmetric",
        },
        raw: { unit: raw?.unit ?? unit, scale: raw?.scale ?? 1, axes: "x,y,z", sensor: null, frame: "sensor" },
        fit,
        provenance,
    };
    return `${JSON.stringify(document, null, 2)}\n`;
}

/**
 * Read a calibration file of Flinders, with its fit.
 * @param {string} text
 * @param {{targets: any}} data `page.json`.
 * @returns {Known}
 * @throws {Unreadable} With the reason.
 */
export function readCalibration(text, { targets }) {
    const document = parseJson(text.replace(/^\ufeff/, ""));
    if (document === null || typeof document !== "object") {
        throw new Unreadable("it is no JSON: need a calibration file of Flinders");
    }
    if (document.flinders !== "calibration") {
        throw new Unreadable('it is no calibration file of Flinders: it lacks "flinders": "calibration"');
    }
    if (document.schema !== targets.schema) {
        const writer = document.provenance?.flinders;
        const needed = typeof writer === "string" ? `, and Flinders ${writer} or newer` : "";
        const versions = `it is written in schema ${document.schema}, and this page reads ${targets.schema}`;
        throw new Unreadable(`${versions}: open it with the command line${needed}`);
    }
    const { matrix, offset, field_strength, field_strength_known, unit, rotation = "symmetric", disturbances = {}, columns = {}, linearization } =
        document.calibration ?? {};
    const isTriple = (/** @type {any} */ values) => Array.isArray(values) && values.length === 3 && values.every(Number.isFinite);
    const isMatrix = Array.isArray(matrix) && matrix.length === 3 && matrix.every(isTriple) && determinant(matrix) !== 0;
    if (!isMatrix || !isTriple(offset) || !(field_strength > 0) || !["uT", "counts"].includes(unit)) {
        const need = "need a 3 × 3 matrix that can be inverted, an offset, field_strength and unit";
        throw new Unreadable(`its calibration is damaged: ${need}`);
    }
    const { unit: recorded = unit, scale = 1, axes = "x,y,z" } = document.raw ?? {};
    return {
        matrix,
        offset,
        fieldStrength: field_strength,
        fieldStrengthKnown: field_strength_known === true,
        unit,
        raw: { unit: recorded, scale },
        axes,
        fit: document.fit ?? null,
        files: document.provenance?.files ?? [],
        rotation,
        disturbances: [...Object.keys(disturbances).map((key) => key.replace(/_[AC]$/, "")), ...Object.keys(columns)],
        isLinearized: linearization !== undefined,
    };
}

// Vectors

/**
 * Directions spread evenly over the sphere.
 * @param {number} count
 * @returns {number[][]}
 */
function directions(count) {
    return Array.from({ length: count }, (_, i) => {
        const z = 1 - (2 * (i + 0.5)) / count;
        const longitude = Math.PI * (1 + Math.sqrt(5)) * (i + 0.5);
        const radius = Math.sqrt(1 - z * z);
        return [radius * Math.cos(longitude), radius * Math.sin(longitude), z];
    });
}

/**
 * @param {number[][]} matrix
 * @param {number[]} vector
 */
function times(matrix, vector) {
    return matrix.map((row) => dot(row, vector));
}

/** @param {number[]} values */
function sum(values) {
    return values.reduce((total, value) => total + value, 0);
}
