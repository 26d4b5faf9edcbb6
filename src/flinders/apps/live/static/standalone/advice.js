/**
 * Advice on the next turn of the sensor, in words: one direction, or a path while the user turns it. The engine computes
 * both.
 */

import { unit } from "../../../../static/views/vectors.js";
import { surfaceOf } from "./fit.js";
import { apply } from "./linear.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Belief} Belief */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./reasons.js").Readings} Readings */
/** @typedef {"heading" | "attitude"} Goal */
/** @typedef {"sensor" | "vehicle"} Frame */

/** Largest error of a fit, in its worst direction, with which a path is planned, degrees. */
const MAX_PATH_ERROR_DEG = 10;
/** Assumed turn rate of a hand, degrees a second, for the number of readings along a path. */
const TURN_RATE_DEGPS = 90;

/**
 * Present error, and the direction of the most useful next readings.
 * @typedef {object} Advice
 * @property {number} worstDeg Error for the goal: of a level heading, or of any direction.
 * @property {number} afterDeg The error after a batch of readings there.
 * @property {number[]} direction Of the field, in corrected axes.
 * @property {number} pose Number of the attitude to hold.
 * @property {string} words
 */

/**
 * Find the direction whose readings would reduce the worst error most.
 * @param {Fit} fit
 * @param {Goal} goal
 * @param {Frame} [frame]
 * @returns {Advice}
 */
export function guide(fit, goal, frame = "sensor") {
    const { engine, data } = fit;
    const wanted = wantedOf(fit, goal);
    const { worst_deg: worstDeg, after_deg: afterDeg, direction } = engine.guidance(claimOf(fit), wanted);
    const pose = engine.pose(wanted, direction, frame);
    const words = `hold it ${data.poses[frame][pose]} and turn it slowly once around, keeping it so`;
    return { worstDeg, afterDeg, direction, pose, words };
}

/**
 * @param {Fit} fit
 * @returns {Belief}
 */
function claimOf({ engine, surface, covariance, noise, counts }) {
    return engine.believe(surface, covariance, noise, counts);
}

/**
 * @param {Fit} fit
 * @param {Goal} goal
 * @returns {import("./engine.js").Wanted}
 */
function wantedOf({ dipDeg, targetDeg, headingError }, goal) {
    const isSeenFromBelow = headingError.dipDeg * dipDeg < 0;
    return {
        is_attitude: Number(goal === "attitude"),
        dip_deg: dipDeg,
        down: [0, 0, isSeenFromBelow ? -1 : 1],
        target_deg: targetDeg,
    };
}

/**
 * The next turn: for the level heading until that reaches the target, then for all attitudes.
 * @param {Fit} fit
 * @returns {[string] | [string, number]} A name of `steps`, and the number of a pose if the step has one.
 */
export function nextMovement(fit) {
    if (fit.plane) return ["turn-level"];
    const advice = guide(fit, fit.headingError.worst > fit.targetDeg ? "heading" : "attitude");
    return isIdle(advice, fit.data) ? ["record-longer"] : ["hold", advice.pose];
}

/**
 * Whether all directions would help equally.
 * @param {Advice} advice
 * @param {EngineData} data
 * @returns {boolean}
 */
export function isIdle({ worstDeg, afterDeg }, { numbers }) {
    return afterDeg > (1 - numbers.MIN_SAVED_SHARE) * worstDeg;
}

/**
 * Add the path from the newest reading to the view of a fit, if it reduces the error.
 * @param {View} view
 * @param {Fit} fit
 * @param {Readings} readings
 * @param {boolean} isFlat
 * @param {Goal} goal
 * @param {Frame} frame
 * @returns {View}
 */
export function withPath(view, fit, readings, isFlat, goal, frame) {
    if (fit.plane) return view;
    const { surface, claimed, data, engine } = fit;
    const isRough = isFlat || engine.directionWorstDeg(surface, claimed, fit.headingError.dipDeg) > MAX_PATH_ERROR_DEG;
    const belief = isRough ? engine.rough(readings.field) : claimOf(fit);
    if (!belief) return view;
    const { inverse } = surfaceOf(belief.centre, belief.shape);
    const newest = Array.from(readings.field.slice(-3), (part, axis) => part - belief.centre[axis]);
    const start = unit(apply(inverse, newest));
    if (!start.some(Boolean)) return view;
    const route = engine.path(belief, wantedOf(fit, goal), start, readingsPerDeg(readings.time, data));
    if (!route.count || (route.worst_deg <= fit.targetDeg && !isRough)) return view;
    const [x, y, z] = route.waypoints;
    const waypoints = Array.from({ length: route.count }, (_, i) => route.waypoints.slice(3 * i, 3 * i + 3));
    const guidance = {
        direction: /** @type {[number, number, number]} */ ([x, y, z]),
        words: `follow the arrow: ${frame === "sensor" ? "turn it " : ""}${turns([start, ...waypoints], data, frame)}`,
        worst_deg: route.worst_deg,
        after_deg: route.after_deg,
        goal,
        frame,
        is_path: true,
        code: "",
    };
    return { ...view, guidance, shown: isRough ? round(belief) : view.shown };
}

/**
 * A sphere to draw readings on.
 * @param {Belief} belief
 * @returns {View["shown"]}
 */
function round({ centre: [x, y, z], shape: [radius] }) {
    return { offset: [x, y, z], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], strength: radius };
}

/**
 * Readings per degree of a hand's turn.
 * @param {Float64Array} time
 * @param {EngineData} data
 * @returns {number}
 */
function readingsPerDeg(time, { numbers }) {
    const seconds = time[time.length - 1] - time[0];
    return seconds > 0 ? (time.length - 1) / seconds / TURN_RATE_DEGPS : numbers.READINGS_PER_DEG;
}

/**
 * Turns of the sensor that move the field's direction along a path, at most two, in words.
 * @param {number[][]} path
 * @param {EngineData} data
 * @param {Frame} frame
 * @returns {string}
 */
function turns(path, data, frame) {
    const each = path.slice(1).map((there, i) => turn(there, path[i], data.turns[frame]));
    return each.filter((words, i) => words !== each[i - 1]).slice(0, 2).join(", then ");
}

/**
 * Words of a turn about its main axis; the body turns opposite to the field's direction.
 * @param {number[]} there
 * @param {number[]} here
 * @param {[right: string, left: string][]} words
 * @returns {string}
 */
function turn([a, b, c], [x, y, z], words) {
    const axis = [b * z - c * y, c * x - a * z, a * y - b * x];
    const main = axis.reduce((most, part, i) => (Math.abs(part) > Math.abs(axis[most]) ? i : most), 0);
    return words[main][axis[main] < 0 ? 1 : 0];
}
