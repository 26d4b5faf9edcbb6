/**
 * The fixed sequence of turns for a body, and the progress of the present turn. Uses no clock and no page.
 *
 * The progress of a turn is the bend of the path of the readings: a full turn about any axis gives a closed path with a
 * bend of 360°, for any offset and soft iron, so the calibration need not be known. Bends add up as vectors along their
 * axes: rocking there and back adds up to zero. If the field is nearly along the axis, its path is too small; then the
 * acceleration's path counts, if recorded, or else the time.
 */

import { product, rotated, rotation } from "../../../../static/views/turn.js";
import { correctReading, cross, dot, minus, unit } from "../../../../static/views/vectors.js";
import { farOf, seenOf } from "./gaps.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {import("../../../../static/views/turn.js").Rotation} Rotation */
/** @typedef {"board" | "phone" | "drone" | "car" | "boat" | "instrument"} Body */

/**
 * One slow turn, in the user's axes: right, away, up. Axes of a body: to its right, to its front or top, out of its face
 * or roof.
 * @typedef {object} Turning
 * @property {Rotation} hold  attitude of the body: from axes of the body to the user's
 * @property {boolean} isHeld  whether to take this attitude first; else the turn starts from the present one
 * @property {Vector} axis
 * @property {string} words
 * @property {number} share  angle, as a share of a whole turn
 *
 * A path of readings: its beads (readings at some distance from each other), and the bend of the path, rad.
 * @typedef {{beads: readonly Vector[], bend: Vector}} Path
 */

/**
 * @typedef {object} Choreography
 * @property {Body} body
 * @property {number} step  counted from 0; the number of steps after the last
 * @property {Path} field
 * @property {Path} gravity
 * @property {Vector[]} axes  of the completed turns, in axes of the sensor
 * @property {number} moving_s  duration of motion in the present step
 * @property {number} moved_at  time of the newest bead
 * @property {number | null} strength  of the field in the unit of the readings, if known
 * @property {{low: Vector, high: Vector} | null} reach  of the readings
 * @property {{before: Vector[], squares: number, count: number}} jitter  for the estimate of the noise
 */

/**
 * New readings. Three numbers each of field and acceleration.
 * @typedef {{time: ArrayLike<number>, field: ArrayLike<number>, acceleration: ArrayLike<number> | null}} Readings
 */

export const BODIES = /** @type {const} */ (["board", "phone", "drone", "car", "boat", "instrument"]);

/** Angle at which a whole turn counts as done, radians, as a hand does not stop exactly at 360°. */
const WHOLE_TURN = 5.6;
/** Axes of turns nearer to each other than this, radians, count as one. */
const MAX_AXIS_DIFFERENCE = 0.6;
/** Longest duration of a step, s, after which the step counts as done: of a body in the hand, and of a large body. */
const [LONGEST_S, LARGE_S] = [12, 25];
/** Smallest diameter of the loop of a turn, in field strengths. While the strength is unknown, bends count by the
 * second number. */
const [LOOP, UNSURE] = [0.85, 0.87];
/** Distance of the readings kept of a path (beads): the first share of the field strength, or the second number of
 * standard deviations of the noise, at most the third share of the field strength. */
const [APART, CLEAR, WIDEST] = [0.08, 8, 0.3];
/** Smallest bend, radians, that counts as a reversal of the turn and not as a bend. */
const MIN_REVERSAL = 2;
/** Distance of the accelerations kept of a path, m/s². */
const GRAVITY_APART = 1.2;
/** Shortest time between beads, s, that counts as a rest. */
const REST_S = 1;
/** Smallest angle from a direction to the covered ones for which readings are needed, and spacing of the checked
 * directions, radians. */
const [FAR, STEP] = [1, 0.25];
/** Largest heading error with which the directions of readings count as known, degrees. */
const MAX_KNOWN_ERROR_DEG = 20;
/** Smallest bend with which a turn is judged, radians, as earlier bends may belong to the turn before. */
const HALF = 2.8;
/** Number of turns that are always needed. */
const MIN_TURNS = 2;
/** Smallest bend that determines the axis of a turn, radians. */
const MIN_AXIS_BEND = 1.2;
/** Smallest number of readings for an estimate of the noise. */
const NOISE_READINGS = 12;

/** Share of a whole turn for a body in the hand: two of these and the arrow to the remaining gap need fewer degrees. */
const HALF_TURN = 0.5;
const QUARTER = Math.PI / 2;
/** @type {[Vector, Vector, Vector]} */
const [ACROSS, AWAY, UP] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const LEVEL = rotation({ axis: UP, angle: 0 });
const FACING = rotation({ axis: ACROSS, angle: QUARTER });
const EDGE = product(rotation({ axis: UP, angle: -QUARTER }), FACING);
const ON_ITS_SIDE = rotation({ axis: AWAY, angle: QUARTER });
const NOSE_DOWN = rotation({ axis: ACROSS, angle: -QUARTER });

/** @param {Rotation} hold @param {Vector} axis @param {string} words @param {number} [share] @returns {Turning} */
const holdTurn = (hold, axis, words, share = 1) => ({ hold, axis, words, share, isHeld: true });

/** @param {Rotation} hold @param {Vector} axis @param {string} words @param {number} [share] @returns {Turning} */
const asItIs = (hold, axis, words, share = 1) => ({ hold, axis, words, share, isHeld: false });

/** @type {Turning[]} */
const IN_THE_HAND = [
    asItIs(FACING, AWAY, "Turn it half around, like a wheel.", HALF_TURN),
    asItIs(FACING, ACROSS, "Now tip it away from you, half over.", HALF_TURN),
    holdTurn(EDGE, AWAY, "Now its edge towards you, and half around, like a wheel.", HALF_TURN),
];

/** Turns of each body. @type {Readonly<Record<Body, readonly Turning[]>>} */
export const SEQUENCES = {
    board: IN_THE_HAND,
    phone: IN_THE_HAND,
    drone: [
        holdTurn(LEVEL, UP, "Hold it level, one at each end, and walk it once around."),
        holdTurn(ON_ITS_SIDE, UP, "Now on its side, and once around."),
        holdTurn(NOSE_DOWN, UP, "Now nose down, and once around."),
    ],
    car: [
        holdTurn(LEVEL, UP, "Drive one slow circle on level ground, away from other cars."),
        holdTurn(LEVEL, UP, "Now one more slow circle, the other way around."),
    ],
    boat: [
        holdTurn(LEVEL, UP, "Steer one slow circle on calm water, of two minutes or more."),
        holdTurn(LEVEL, UP, "Now one more slow circle, the other way around."),
    ],
    instrument: [
        asItIs(LEVEL, AWAY, "Roll it half around, like a barrel.", HALF_TURN),
        asItIs(LEVEL, ACROSS, "Now tip it, front down first, half over.", HALF_TURN),
        holdTurn(FACING, AWAY, "Now its face towards you, and half around, like a wheel.", HALF_TURN),
    ],
};

/** @param {Body} body @returns {boolean} Whether the body stays level, so that only a level turn is needed. */
export function staysLevel(body) {
    return body === "car" || body === "boat";
}

/** @type {Path} */
const NO_PATH = { beads: [], bend: [0, 0, 0] };

/**
 * The sequence for a body, before the first turn.
 * @param {Body} body
 * @returns {Choreography}
 */
export function begin(body) {
    const jitter = { before: [], squares: 0, count: 0 };
    return { body, step: 0, field: NO_PATH, gravity: NO_PATH, axes: [], moving_s: 0, moved_at: -Infinity, strength: null, reach: null, jitter };
}

/**
 * Update the choreography with new readings.
 * @param {Choreography} before
 * @param {Readings} readings
 * @param {View | null} view  of the newest fit
 * @returns {Choreography}
 */
export function advance(before, { time, field, acceleration }, view) {
    const strength = isKnown(view) ? view.shown.strength : null;
    let now = before;
    for (let j = 0; j < time.length && !isOver(now); j += 1) {
        const gravity = acceleration && at(acceleration, j);
        now = advanceStep(read(now, time[j], at(field, j), gravity, strength));
    }
    return now;
}

/**
 * Skip steps whose readings are no longer needed.
 * @param {Choreography} before
 * @param {View | null} view
 * @param {readonly number[]} centres  of the tiles
 * @returns {Choreography}
 */
export function skipNeedless(before, view, centres) {
    let now = before;
    while (!isOver(now) && !isNeeded(now, view, centres)) now = next(now, [...now.axes, axisOf(now)]);
    return now;
}

/** @param {Choreography} choreography @returns {boolean} Whether all turns are done. */
export function isOver({ body, step }) {
    return step >= SEQUENCES[body].length;
}

/**
 * Progress of the present turn, 0 to 1.
 * @param {Choreography} choreography
 * @returns {number}
 */
export function progress(choreography) {
    if (isOver(choreography)) return 1;
    return Math.min(bendAngle(choreography) / wholeOf(choreography), 1);
}

/**
 * Angle of the present turn, rad, about a new axis unless the step repeats an axis. Small loops, as from rocking, do not
 * count; while their size is unknown, bends count less.
 * @param {Choreography} now
 * @returns {number}
 */
function bendAngle(now) {
    const { field, gravity, strength } = now;
    return Math.max(length(newOf(field.bend, now)) * shareOf(field.beads, strength), length(newOf(gravity.bend, now)));
}

/**
 * Part of a bend about none of the earlier axes; the whole bend if the step repeats a turn.
 * @param {Vector} bend
 * @param {Choreography} now
 * @returns {Vector}
 */
function newOf(bend, { body, axes }) {
    if (staysLevel(body)) return bend;
    return axes.reduce((left, axis) => minus(left, axis.map((part) => dot(axis, left) * part)), bend);
}

/** Axis of the present turn. @param {Choreography} now @returns {Vector} */
function axisOf(now) {
    const [field, gravity] = [newOf(now.field.bend, now), newOf(now.gravity.bend, now)];
    return unit(length(gravity) > length(field) ? gravity : field);
}

/** Angle of a step, rad. @param {Choreography} now */
function wholeOf({ body, step }) {
    return WHOLE_TURN * SEQUENCES[body][step].share;
}

/** @param {readonly Vector[]} beads @param {number | null} strength @returns {number} Weight of the bends of a path. */
function shareOf(beads, strength) {
    if (strength === null) return UNSURE;
    return Math.min(acrossOf(beads) / (LOOP * strength), 1) ** 2;
}

/** Diameter of a path around a circle. @param {readonly Vector[]} beads */
function acrossOf(beads) {
    const sides = [0, 1, 2].map((i) => Math.max(...beads.map((bead) => bead[i])) - Math.min(...beads.map((bead) => bead[i])));
    return beads.length ? length(sides) / Math.SQRT2 : 0;
}

/**
 * @param {Choreography} now
 * @returns {Choreography}  at the next step, if the turn is whole
 */
function advanceStep(now) {
    if (bendAngle(now) >= wholeOf(now)) return next(now, [...now.axes, axisOf(now)]);
    const most = now.body === "drone" ? LARGE_S : LONGEST_S;
    return !staysLevel(now.body) && now.moving_s > most ? next(now, now.axes) : now;
}

/** @param {Choreography} now @param {Vector[]} axes @returns {Choreography} */
function next(now, axes) {
    return { ...now, step: now.step + 1, axes, field: NO_PATH, gravity: NO_PATH, moving_s: 0 };
}

/**
 * @param {Choreography} before
 * @param {number} time
 * @param {Vector} field
 * @param {Vector | null} gravity
 * @param {number | null} strength
 * @returns {Choreography}
 */
function read(before, time, field, gravity, strength) {
    if (!field.every(Number.isFinite)) return before;
    const reach = extendReach(before.reach, field);
    const jitter = addJitter(before.jitter, field);
    const clear = Math.min(CLEAR * noiseOf(jitter), strength === null ? Infinity : WIDEST * strength);
    const apart = Math.max(APART * (strength ?? halfOf(reach)), clear);
    const path = along(before.field, field, apart);
    const lies = gravity?.every(Number.isFinite) ? along(before.gravity, gravity, GRAVITY_APART) : before.gravity;
    const isMoving = path !== before.field || lies !== before.gravity;
    const moved = isMoving ? Math.min(Math.max(time - before.moved_at, 0), REST_S) : 0;
    const moved_at = isMoving ? time : before.moved_at;
    return { ...before, strength, reach, jitter, field: path, gravity: lies, moving_s: before.moving_s + moved, moved_at };
}

/**
 * A path with one more reading; unchanged if that is too near to the last bead.
 * @param {Path} path
 * @param {Vector} here
 * @param {number} apart
 * @returns {Path}
 */
function along(path, here, apart) {
    const { beads, bend } = path;
    const last = beads.at(-1);
    if (last && !(length(minus(here, last)) > apart)) return path;
    const added = [...beads, here];
    return { beads: added, bend: sum(bend, bendOf(added.slice(-3))) };
}

/**
 * Bend of a path at the second of three beads: the angle, as a vector along the axis.
 * @param {readonly Vector[]} beads
 * @returns {Vector}
 */
function bendOf([one, two, three]) {
    if (!three) return [0, 0, 0];
    const [before, after] = [minus(two, one), minus(three, two)];
    const normal = cross(before, after);
    const angle = Math.atan2(length(normal), dot(before, after));
    return angle < MIN_REVERSAL ? unit(normal).map((part) => angle * part) : [0, 0, 0];
}

/**
 * Whether the present turn is useful: its circle passes near an uncovered direction, or it is the third and the directions
 * of readings are still unknown. Once they are known, the arrow leads straight to the remaining gap.
 * @param {Choreography} choreography
 * @param {View | null} view
 * @param {readonly number[]} centres  of the tiles
 * @returns {boolean}
 */
function isNeeded({ body, step, field, axes }, view, centres) {
    if (!isKnown(view) || staysLevel(body)) return true;
    if (step >= MIN_TURNS && body !== "drone") return false;
    if (length(field.bend) < HALF || axes.some((axis) => areAlike(axis, newestBend(field.beads)))) return true; // the earlier turn continues
    const { shown } = view;
    const beads = field.beads.map((bead) => unit(correctReading(bead, shown)));
    const bend = newestBend(beads);
    if (length(bend) < MIN_AXIS_BEND) return true;
    const seen = seenOf(view, centres);
    for (let angle = STEP; angle < 2 * Math.PI; angle += STEP) {
        const ahead = rotated(rotation({ axis: unit(bend), angle }), beads[beads.length - 1]);
        if (farOf(ahead, seen) > FAR) return true;
    }
    return false;
}

/**
 * Whether a fit determines the directions of readings.
 * @param {View | null} view
 * @returns {view is View & {shown: NonNullable<View["shown"]>}}
 */
function isKnown(view) {
    return view !== null && view.shown !== null && (view.any_attitude_deg?.worst ?? Infinity) < MAX_KNOWN_ERROR_DEG;
}

/**
 * Bend of the newest part of a path, as long as needed to determine its axis.
 * @param {readonly Vector[]} beads
 * @returns {Vector}
 */
function newestBend(beads) {
    let bend = /** @type {Vector} */ ([0, 0, 0]);
    for (let i = beads.length - 3; i >= 0 && length(bend) < MIN_AXIS_BEND; i -= 1) bend = sum(bend, bendOf(beads.slice(i, i + 3)));
    return bend;
}

/** @param {Vector} one @param {Vector} other @returns {Vector} */
function sum(one, other) {
    return one.map((part, i) => part + other[i]);
}

/**
 * Update the noise estimate by second differences, which are nearly zero in a steady turn.
 * @param {Choreography["jitter"]} jitter
 * @param {Vector} field
 * @returns {Choreography["jitter"]}
 */
function addJitter({ before, squares, count }, field) {
    const [one, two] = before;
    if (!two) return { before: [field, ...before], squares, count };
    const off = field.reduce((sum, part, i) => sum + (part - 2 * one[i] + two[i]) ** 2, 0) / 18;
    const isFar = count > NOISE_READINGS && off > 25 * (squares / count); // an outlier, or missing readings
    return { before: [field, one], squares: squares + (isFar ? 0 : off), count: count + (isFar ? 0 : 1) };
}

/** @param {Choreography["jitter"]} jitter @returns {number} Standard deviation of an axis; infinite while unknown. */
function noiseOf({ squares, count }) {
    return count < NOISE_READINGS ? Infinity : Math.sqrt(squares / count);
}

/** @param {Choreography["reach"]} reach @param {Vector} field */
function extendReach(reach, field) {
    if (!reach) return { low: field, high: field };
    const { low, high } = reach;
    if (field.every((part, i) => part >= low[i] && part <= high[i])) return reach;
    return { low: field.map((part, i) => Math.min(part, low[i])), high: field.map((part, i) => Math.max(part, high[i])) };
}

/** @param {NonNullable<Choreography["reach"]>} reach */
function halfOf({ low, high }) {
    return Math.max(...high.map((part, i) => part - low[i])) / 2;
}

/** @param {Vector} one @param {Vector} other @returns {boolean} Whether two axes are nearly parallel or opposite. */
function areAlike(one, other) {
    return Math.abs(dot(one, unit(other))) > Math.cos(MAX_AXIS_DIFFERENCE) && length(other) > 1;
}

/** @param {Vector} v */
function length(v) {
    return Math.hypot(...v);
}

/** @param {ArrayLike<number>} numbers @param {number} j @returns {Vector} */
function at(numbers, j) {
    return [numbers[3 * j], numbers[3 * j + 1], numbers[3 * j + 2]];
}
