/** Status of each shown reading in the fit. */

/** @typedef {import("../view.d.ts").Points} Points */

export const USED = 0;
export const REJECTED = 1;
export const EXCLUDED = 2;

/**
 * Mark shown points that the fit has rejected, and those that the user has excluded.
 *
 * @param {Uint8Array} marks  written: USED, REJECTED or EXCLUDED for each point
 * @param {Pick<Points, "count" | "time" | "stride">} points
 * @param {readonly (readonly [number, number])[]} rejected  runs of reading numbers in order, both ends included
 * @param {readonly (readonly [number, number])[]} excluded  spans of time, seconds
 * @param {number} [first]  the first point to mark
 */
export function mark(marks, points, rejected, excluded, first = 0) {
    let run = 0;
    for (let j = first; j < points.count; j += 1) {
        const reading = j * points.stride;
        while (run < rejected.length && rejected[run][1] < reading) run += 1;
        marks[j] = run < rejected.length && rejected[run][0] <= reading ? REJECTED : USED;
    }
    for (const [start, end] of excluded) {
        for (let j = first; j < points.count; j += 1) {
            if (points.time[j] >= start && points.time[j] <= end) marks[j] = EXCLUDED;
        }
    }
}
