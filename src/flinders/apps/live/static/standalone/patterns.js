/**
 * Patterns of `page.json`, and functions like those of Python's `re` and `str`.
 *
 * @typedef {Record<string, any>} Constants Constants of a module of the library, by name.
 * @typedef {Record<string, Constants>} Rules Constants of the modules that read text, by `MODULES` of `standalone/lines.py`.
 */

/** @type {WeakMap<RegExp, Map<string, RegExp>>} */
const variants = new WeakMap();

/**
 * Data with patterns converted to regular expressions.
 * @param {any} value
 * @returns {any}
 */
export function revived(value) {
    if (Array.isArray(value)) return value.map(revived);
    if (value === null || typeof value !== "object") return value;
    if (typeof value.pattern === "string" && typeof value.flags === "string") return new RegExp(value.pattern, value.flags);
    const members = Object.entries(value).map(([name, member]) => [name, revived(member)]);
    return Object.assign(Object.create(null), Object.fromEntries(members));
}

/**
 * Match of a whole text: `fullmatch`.
 * @param {RegExp} pattern
 * @param {string} text
 */
export function whole(pattern, text) {
    return variant(pattern, "whole", (source, flags) => new RegExp(`^(?:${source})$`, flags)).exec(text);
}

/**
 * Match at the start of a text: `match`.
 * @param {RegExp} pattern
 * @param {string} text
 */
export function ahead(pattern, text) {
    return variant(pattern, "ahead", (source, flags) => new RegExp(`^(?:${source})`, flags)).exec(text);
}

/**
 * All matches: `finditer`.
 * @param {RegExp} pattern
 * @param {string} text
 */
export function every(pattern, text) {
    return [...text.matchAll(global(pattern))];
}

/**
 * A text with all matches replaced: `sub`.
 * @param {RegExp} pattern
 * @param {string | ((match: string, ...groups: any[]) => string)} by
 * @param {string} text
 */
export function replaceAll(pattern, by, text) {
    return text.replace(global(pattern), /** @type {any} */ (by));
}

/**
 * A text without some letters at its ends: `strip`.
 * @param {string} text
 * @param {string} letters
 */
export function stripLetters(text, letters) {
    return stripEnd(stripStart(text, letters), letters);
}

/**
 * @param {string} text
 * @param {string} letters
 */
export function stripStart(text, letters) {
    let start = 0;
    while (start < text.length && letters.includes(text[start])) start++;
    return text.slice(start);
}

/**
 * @param {string} text
 * @param {string} letters
 */
export function stripEnd(text, letters) {
    let end = text.length;
    while (end > 0 && letters.includes(text[end - 1])) end--;
    return text.slice(0, end);
}

/**
 * Count of each key, in the order of first occurrence.
 * @template Key
 * @param {Iterable<Key>} keys
 * @returns {Map<Key, number>}
 */
export function countKeys(keys) {
    const counts = new Map();
    for (const key of keys) counts.set(key, (counts.get(key) ?? 0) + 1);
    return counts;
}

/**
 * First entry with the largest key; undefined without entries.
 * @template Entry
 * @param {readonly Entry[]} entries
 * @param {(entry: Entry) => (number | boolean)[]} key
 * @returns {Entry | undefined}
 */
export function largest(entries, key) {
    let best = entries[0];
    for (const entry of entries.slice(1)) if (compareKeys(key(entry), key(best)) > 0) best = entry;
    return best;
}

/**
 * @param {(number | boolean)[]} one
 * @param {(number | boolean)[]} other
 * @returns {number} Negative if `one` is first.
 */
function compareKeys(one, other) {
    const place = one.findIndex((value, i) => value !== other[i]);
    return place < 0 ? 0 : Number(one[place]) - Number(other[place]);
}

/**
 * @param {number[]} values
 * @returns {number} NaN without values.
 */
export function median(values) {
    const sorted = values.filter((value) => !Number.isNaN(value)).sort((a, b) => a - b);
    const middle = sorted.length / 2;
    return sorted.length % 2 ? sorted[Math.floor(middle)] : (sorted[middle - 1] + sorted[middle]) / 2;
}

/** @param {RegExp} pattern */
function global(pattern) {
    return variant(pattern, "global", (source, flags) => new RegExp(source, `${flags}g`));
}

/**
 * @param {RegExp} pattern
 * @param {string} kind
 * @param {(source: string, flags: string) => RegExp} make
 * @returns {RegExp}
 */
function variant(pattern, kind, make) {
    const known = variants.get(pattern) ?? new Map();
    variants.set(pattern, known);
    if (!known.has(kind)) known.set(kind, make(pattern.source, pattern.flags));
    return known.get(kind);
}
