/** Dates and times of day, as cells of a table and stamps before a line have them, in seconds. As `readers/_clock.py`. */

import { largest, whole } from "./patterns.js";

/** @typedef {import("./patterns.js").Constants} Constants */
/** @typedef {Record<string, string | undefined>} Parts What the groups of `DATE` and a time of day hold. */

/** How a column, or one with dates and one with times of day, is read as seconds. */
export class Clock {
    /**
     * @param {Constants} rules
     * @param {readonly (readonly string[])[]} rows
     * @param {readonly number[]} cells Of dates and of times of day; the seconds stand in place of the last.
     */
    constructor(rules, rows, cells) {
        const found = rows.map((row) => matched(rules, joined(row, cells))).filter((parts) => parts !== null);
        this.rules = rules;
        this.cells = cells;
        this.cell = cells[cells.length - 1];
        this.isDated = found.some(({ first, year, late }) => first || year || late);
        const isShort = found.some(({ second, fraction }) => second === undefined && fraction);
        this.period = isShort ? rules.HOUR_S : rules.DAY_S;
        const { order, isSettled } = orderOf(rules, found);
        this.order = order;
        this.isSettled = isSettled;
    }

    /**
     * Seconds of a row: since 1970, or since midnight; NaN where it has no time.
     * @param {readonly string[]} row
     */
    seconds(row) {
        const parts = matched(this.rules, joined(row, this.cells));
        return (parts && secondsOf(this.rules, parts, this.order)) ?? NaN;
    }

    /** What makes times of day go on where the day, or the hour, is over. */
    midnights() {
        let last = NaN;
        return (/** @type {number} */ seconds) => {
            if (this.isDated || Number.isNaN(seconds)) return seconds;
            const begun = Number.isNaN(last) ? 0 : Math.max(Math.ceil((last - seconds) / this.period - 0.5), 0);
            return (last = seconds + this.period * begun);
        };
    }
}

/**
 * The columns of text that are times: with a date, or a time of day with a column of dates beside it.
 * @param {Constants} rules
 * @param {readonly (readonly string[])[]} rows
 * @param {readonly number[]} places
 * @returns {Clock[]}
 */
export function clocksOf(rules, rows, places) {
    /** @type {number[]} */
    const days = [];
    /** @type {number[]} */
    const times = [];
    const clocks = [];
    for (const place of places) {
        const filled = rows.flatMap((row) => (row[place]?.trim() ? [row[place]] : []));
        const found = filled.map((text) => matched(rules, text)).filter((parts) => parts !== null);
        if (!found.length || found.length < rules.ENOUGH * filled.length || areParts(rules, filled)) continue;
        if (found[0].hour === undefined) days.push(place);
        else if (found[0].first || found[0].month) clocks.push(new Clock(rules, rows, withFraction(rules, rows, [place])));
        else times.push(place);
    }
    for (const place of times) {
        const day = largest(days, (each) => [-Math.abs(each - place)]);
        clocks.push(new Clock(rules, rows, withFraction(rules, rows, day === undefined ? [place] : [day, place])));
    }
    return clocks;
}

/**
 * Cells of a time, with that of its fraction, which a decimal comma has put into the next: `04:42:07,813`.
 * @param {Constants} rules
 * @param {readonly (readonly string[])[]} rows
 * @param {number[]} cells
 */
function withFraction(rules, rows, cells) {
    const after = cells[cells.length - 1] + 1;
    if (!rows.every((row) => after < row.length && whole(rules.FRACTION, row[after].trim()))) return cells;
    const alone = new Clock(rules, rows, cells);
    const seconds = rows.map((row) => alone.seconds(row));
    const joint = new Clock(rules, rows, [...cells, after]);
    const times = rows.map((row) => joint.seconds(row));
    const repeats = seconds.flatMap((each, i) => (i > 0 && each === seconds[i - 1] ? [i] : []));
    const isOften = repeats.length > rules.REPEATED * (rows.length - 1);
    const isFiner = isOften && seconds.every(Number.isInteger) && repeats.every((i) => times[i] > times[i - 1]);
    return isFiner ? [...cells, after] : cells;
}

/**
 * Seconds of a date and a time of day; null for a day that there is not.
 * @param {Constants} rules
 * @param {Parts} parts
 * @param {string} order
 */
export function secondsOf(rules, parts, order) {
    const digits = (parts.fraction ?? "").slice(1);
    const isShort = parts.second === undefined && digits !== "";
    const [minute, second] = isShort ? [parts.hour, parts.minute] : [parts.minute, parts.second];
    let hour = isShort ? 0 : Number(parts.hour ?? 0);
    if (parts.half) hour = (hour % 12) + ("pP".includes(parts.half) ? 12 : 0);
    const own = rules.DAY_S * Number(parts.days ?? 0) + 3600 * hour + 60 * Number(minute ?? 0) + Number(second ?? 0);
    const day = dayOf(rules, parts, order);
    if (day === null) return null;
    return Number(`${day ? own + day * rules.DAY_S - zoneOf(parts.zone) : own}.${digits || 0}`);
}

/**
 * The order of day, month and year in dates of numbers, and whether no other is possible.
 * @param {Constants} rules
 * @param {readonly Parts[]} found
 * @returns {{order: string, isSettled: boolean}}
 */
export function orderOf(rules, found) {
    const dated = found.filter(({ middle }) => middle);
    const dates = new Map(dated.map((parts) => [`${parts.first} ${parts.middle} ${parts.last}`, parts]));
    if (!dates.size || dated.some(({ first }) => first?.length === 4)) return { order: "ymd", isSettled: true };
    const hasHalves = found.some(({ half }) => half);
    const isShort = dated.every(({ last }) => (last ?? "").length < 4);
    const spans = rules.ORDERS.flatMap((/** @type {string} */ order) => {
        const days = [...dates.values()].map((parts) => dayOf(rules, parts, order)).filter(Boolean).map(Number);
        if (days.length < dates.size || (order === "ymd" && !isShort)) return [];
        const falls = days.some((day, i) => i > 0 && day < days[i - 1]);
        return [{ order, key: [falls, Math.max(...days) - Math.min(...days), hasHalves && order !== "mdy"] }];
    });
    const best = largest(spans, ({ key }) => key.map((/** @type {number | boolean} */ each) => -Number(each)));
    return { order: best?.order ?? "dmy", isSettled: spans.length < 2 || dates.size > 1 };
}

/**
 * @param {readonly string[]} row
 * @param {readonly number[]} cells
 */
function joined(row, cells) {
    return cells.flatMap((cell) => (cell < row.length ? [row[cell].trim()] : [])).join(" ");
}

/**
 * A time of day with a colon before its milliseconds, with all of its zeros.
 * @param {Constants} rules
 * @param {string} text
 */
function padded(rules, text) {
    const [, hour, minute, second, part] = whole(rules.UNPADDED, text) ?? [];
    return part ? `${hour}:${minute.padStart(2, "0")}:${second.padStart(2, "0")}.${part.padStart(3, "0")}` : text;
}

/**
 * Whether what stands behind a third colon is no milliseconds: it never has three digits.
 * @param {Constants} rules
 * @param {readonly string[]} texts
 */
function areParts(rules, texts) {
    const parts = texts.flatMap((text) => whole(rules.UNPADDED, text)?.[4] ?? []);
    return parts.length > 0 && Math.max(...parts.map((part) => part.length)) < 3;
}

/**
 * A cell that is a date, a time of day or both, and nothing else.
 * @param {Constants} rules
 * @param {string} text
 * @returns {Parts | null}
 */
function matched(rules, text) {
    const parts = whole(rules.WHEN, padded(rules, text).replace(rules.PACKED, "$1-$2-$3T$4:$5:$6"))?.groups;
    return parts && (parts.hour || parts.first || parts.month) ? parts : null;
}

/**
 * Days from 1970 to a date; 0 where there is none with a year, null where there is no such day.
 * @param {Constants} rules
 * @param {Parts} parts
 * @param {string} order
 */
function dayOf(rules, parts, order) {
    const { first, last, month, day, named } = parts;
    const middle = parts.middle ?? named;
    const year = parts.year ?? parts.late;
    if (month && day) return year ? dayFrom1970(rules, year, month, day) : 0;
    if (!first || !middle || !last) return 0;
    const own = Object.fromEntries([first, middle, last].map((part, i) => [(first.length === 4 ? "ymd" : named ? "dmy" : order)[i], part]));
    return dayFrom1970(rules, own.y, own.m, own.d);
}

/**
 * @param {Constants} rules
 * @param {string} year
 * @param {string} month
 * @param {string} day
 */
function dayFrom1970({ MONTHS, CENTURY, DAY_S }, year, month, day) {
    const name = month.toLowerCase();
    const number = /^\d+$/.test(month) ? Number(month) : (MONTHS[name.slice(0, 4)] ?? MONTHS[name.slice(0, 3)] ?? 0);
    const all = Number(year) + (year.length === 4 ? 0 : Number(year) >= CENTURY ? 1900 : 2000);
    const date = new Date(Date.UTC(all, number - 1, Number(day)));
    const isOne = number >= 1 && date.getUTCFullYear() === all && date.getUTCMonth() === number - 1 && date.getUTCDate() === Number(day);
    return isOne ? date.getTime() / 1000 / DAY_S : null;
}

/**
 * Seconds by which a zone is ahead of UTC.
 * @param {string | undefined} zone
 */
function zoneOf(zone) {
    const digits = (zone ?? "").replace(/\D/g, "");
    const ahead = 3600 * Number(digits.slice(0, 2)) + 60 * Number(digits.slice(2));
    return zone?.includes("-") ? -ahead : ahead;
}
