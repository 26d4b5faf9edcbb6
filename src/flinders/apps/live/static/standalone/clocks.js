/** Times of day in table columns and in time stamps of lines. The patterns are those of `readers/_clock.py`. */

import { whole } from "./patterns.js";

/** @typedef {import("./patterns.js").Constants} Constants */

const DAY_S = 86400;

/**
 * A column of times of day, with or without a date: `2026-11-22T04:42:07.25Z`.
 * @typedef {{cell: number, seconds: (row: readonly string[]) => number}} Clock
 */

/**
 * Text columns that hold times.
 * @param {Constants} rules
 * @param {readonly (readonly string[])[]} rows
 * @param {readonly number[]} places
 * @returns {Clock[]}
 */
export function clocksOf(rules, rows, places) {
    const secondsAt = (/** @type {number} */ place) => (/** @type {readonly string[]} */ row) => {
        const groups = whole(rules.DATE_AND_TIME, row[place] ?? "")?.groups;
        return groups?.second ? secondsOfDay(groups) : NaN;
    };
    return places.flatMap((cell) => {
        const seconds = secondsAt(cell);
        const filled = rows.filter((row) => row[cell]?.trim());
        const known = filled.filter((row) => Number.isFinite(seconds(row)));
        return known.length && known.length >= rules.MIN_TIME_SHARE * filled.length ? [{ cell, seconds }] : [];
    });
}

/**
 * Seconds since midnight, from the groups of a pattern.
 * @param {Record<string, string | undefined>} parts
 */
export function secondsOfDay({ hour, minute, second, fraction, half }) {
    const hours = half ? (Number(hour) % 12) + ("pP".includes(half) ? 12 : 0) : Number(hour);
    return Number(`${3600 * hours + 60 * Number(minute) + Number(second)}.${(fraction ?? "").slice(1) || 0}`);
}

/** Return a function that continues times of day past midnight. */
export function midnights() {
    let last = NaN;
    return (/** @type {number} */ seconds) => {
        if (Number.isNaN(seconds)) return seconds;
        const days = Number.isNaN(last) ? 0 : Math.max(Math.ceil((last - seconds) / DAY_S - 0.5), 0);
        return (last = seconds + DAY_S * days);
    };
}
