/**
 * The fixed sequence of turns for what is in the hand, and how far the present turn has come. No clock, no page.
 *
 * A turn is measured by how far the path of the readings has bent: on a full turn about any axis it closes, and has bent
 * by 360°, wherever its centre is and whatever iron does to it. So nothing need be known of the sensor. Bends add up as
 * vectors along the axis that they are about: rocking there and back adds up to nothing. Where the field lies along the
 * axis, its path is too small to follow; then that of the acceleration counts, where it is recorded, or the time.
 */

import { product, rotated, rotation } from "../../../../static/views/turn.js";
import { correctReading, cross, dot, minus, unit } from "../../../../static/views/vectors.js";
import { farOf, seenOf } from "./gaps.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {import("../../../../static/views/turn.js").Rotation} Rotation */
/** @typedef {"board" | "phone" | "drone" | "car" | "boat" | "instrument"} Body */

/**
 * One slow turn, in axes of who holds it: to the right, away, up. Axes of a body: to its right, to its front or top, out of
 * its face or roof.
 * @typedef {object} Turning
 * @property {Rotation} hold  how to hold it: from axes of the body to those of who holds it
 * @property {boolean} isHeld  whether to hold it so first; else it is turned on as it is
 * @property {Vector} axis
 * @property {string} words
 * @property {number} share  of a whole turn
 *
 * A path of readings in beads: where they lie, and how far the path has bent, rad.
 * @typedef {{beads: readonly Vector[], bend: Vector}} Path
 */

/**
 * @typedef {object} Choreography
 * @property {Body} body
 * @property {number} step  counted from 0; the number of steps where all are done
 * @property {Path} field
 * @property {Path} gravity
 * @property {Vector[]} axes  of the turns that were made, in axes of the sensor
 * @property {number} moving_s  that the present step has been turned for
 * @property {number} moved_at  when the newest bead fell
 * @property {number | null} strength  of the field in the unit of the readings, where it is known
 * @property {{low: Vector, high: Vector} | null} reach  of the readings
 * @property {{before: Vector[], squares: number, count: number}} jitter  by which noise is known
 */

/**
 * Readings that are new. Three numbers each of field and acceleration.
 * @typedef {{time: ArrayLike<number>, field: ArrayLike<number>, acceleration: ArrayLike<number> | null}} Readings
 */

export const BODIES = /** @type {const} */ (["board", "phone", "drone", "car", "boat", "instrument"]);

/** A whole turn that has come so far is done, radians: the hand of nobody stops at 360°. */
const WHOLE_TURN = 5.6;
/** Axes of turns that are nearer to each other than this, radians, are one. */
const ALIKE = 0.6;
/** After so many seconds of turning a step is over, whatever the turn was; with a large thing later. */
const [LONGEST_S, LARGE_S] = [12, 25];
/** A loop that is less wide, in strengths of the field, is none of a turn; while that is not known, bends count by this share. */
const [LOOP, UNSURE] = [0.85, 0.87];
/** Beads lie apart by this share of the strength of the field, or by so many standard deviations of its noise up to a share. */
const [APART, CLEAR, WIDEST] = [0.08, 8, 0.3];
/** A path that goes back on itself more sharply, radians, has not bent. */
const BACK = 2;
/** Gravity in beads, m/s². */
const GRAVITY_APART = 1.2;
/** Beads that are farther apart in time, s, are of a rest between. */
const REST_S = 1;
/** What is nearer to what has been seen, radians, need not be seen; a direction is asked for every so many. */
const [FAR, STEP] = [1, 0.25];
/** With a larger error of a heading nobody knows where the readings lie. */
const KNOWN_DEG = 20;
/** Of any turn as much is needed, radians: at its beginning it is still that before, or not yet what it is to be. */
const HALF = 2.8;
/** So many turns are needed in any case. */
const ENOUGH = 2;
/** A turn that has bent less, radians, leads nowhere yet. */
const BEGUN = 1.2;
/** Readings after which noise is known. */
const LOOKED_AT = 12;

/** Share of a turn in the hand: two of these, and the arrow to the gap that is left, take fewer degrees than whole turns. */
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

/** What to do with each body, turn by turn. @type {Readonly<Record<Body, readonly Turning[]>>} */
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

/** @param {Body} body @returns {boolean} Whether it stays level, and a level turn is all that is asked. */
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
 * Go on by the readings that have come.
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
 * Leave out the steps whose readings are no longer needed.
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

/** @param {Choreography} choreography @returns {boolean} Whether all turns are made. */
export function isOver({ body, step }) {
    return step >= SEQUENCES[body].length;
}

/**
 * How far the present turn has come, 0 to 1.
 * @param {Choreography} choreography
 * @returns {number}
 */
export function progress(choreography) {
    if (isOver(choreography)) return 1;
    return Math.min(bendAngle(choreography) / wholeOf(choreography), 1);
}

/**
 * Angle of the present turn, rad: of one about an axis that no turn before was about, unless that is asked. Small loops, as
 * of a hand that only rocks it, are no turn; while nobody knows how large they are, more of them is asked.
 * @param {Choreography} now
 * @returns {number}
 */
function bendAngle(now) {
    const { field, gravity, strength } = now;
    return Math.max(length(newOf(field.bend, now)) * shareOf(field.beads, strength), length(newOf(gravity.bend, now)));
}

/**
 * The part of a bend that is about no axis of a turn before; all of it where the same turn is asked for again.
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

/** Angle that a step asks for, rad. @param {Choreography} now */
function wholeOf({ body, step }) {
    return WHOLE_TURN * SEQUENCES[body][step].share;
}

/** @param {readonly Vector[]} beads @param {number | null} strength @returns {number} How much the bends of a path count. */
function shareOf(beads, strength) {
    if (strength === null) return UNSURE;
    return Math.min(acrossOf(beads) / (LOOP * strength), 1) ** 2;
}

/** How wide a path is that runs around a circle: its diameter. @param {readonly Vector[]} beads */
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
 * A path with one more reading; the same where that is too near to the last bead.
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
 * How far a path bends at the second of three beads: the angle, along the axis.
 * @param {readonly Vector[]} beads
 * @returns {Vector}
 */
function bendOf([one, two, three]) {
    if (!three) return [0, 0, 0];
    const [before, after] = [minus(two, one), minus(three, two)];
    const normal = cross(before, after);
    const angle = Math.atan2(length(normal), dot(before, after));
    return angle < BACK ? unit(normal).map((part) => angle * part) : [0, 0, 0];
}

/**
 * Whether the present turn brings anything: its circle leads near a direction that has not been seen; or it is the third, and
 * not even the two before have told where readings lie. Once they have, the arrow leads straight to the gap that is left.
 * @param {Choreography} choreography
 * @param {View | null} view
 * @param {readonly number[]} centres  of the tiles
 * @returns {boolean}
 */
function isNeeded({ body, step, field, axes }, view, centres) {
    if (!isKnown(view) || staysLevel(body)) return true;
    if (step >= ENOUGH && body !== "drone") return false;
    if (length(field.bend) < HALF || axes.some((axis) => areAlike(axis, newestBend(field.beads)))) return true; // the turn before goes on
    const { shown } = view;
    const beads = field.beads.map((bead) => unit(correctReading(bead, shown)));
    const bend = newestBend(beads);
    if (length(bend) < BEGUN) return true;
    const seen = seenOf(view, centres);
    for (let angle = STEP; angle < 2 * Math.PI; angle += STEP) {
        const ahead = rotated(rotation({ axis: unit(bend), angle }), beads[beads.length - 1]);
        if (farOf(ahead, seen) > FAR) return true;
    }
    return false;
}

/**
 * Whether a fit tells where readings lie.
 * @param {View | null} view
 * @returns {view is View & {shown: NonNullable<View["shown"]>}}
 */
function isKnown(view) {
    return view !== null && view.shown !== null && (view.any_attitude_deg?.worst ?? Infinity) < KNOWN_DEG;
}

/**
 * How the newest part of a path bends, as much of it as tells its axis.
 * @param {readonly Vector[]} beads
 * @returns {Vector}
 */
function newestBend(beads) {
    let bend = /** @type {Vector} */ ([0, 0, 0]);
    for (let i = beads.length - 3; i >= 0 && length(bend) < BEGUN; i -= 1) bend = sum(bend, bendOf(beads.slice(i, i + 3)));
    return bend;
}

/** @param {Vector} one @param {Vector} other @returns {Vector} */
function sum(one, other) {
    return one.map((part, i) => part + other[i]);
}

/**
 * Differences of second order, of which a steady turn has next to none.
 * @param {Choreography["jitter"]} jitter
 * @param {Vector} field
 * @returns {Choreography["jitter"]}
 */
function addJitter({ before, squares, count }, field) {
    const [one, two] = before;
    if (!two) return { before: [field, ...before], squares, count };
    const off = field.reduce((sum, part, i) => sum + (part - 2 * one[i] + two[i]) ** 2, 0) / 18;
    const isFar = count > LOOKED_AT && off > 25 * (squares / count); // an outlier, or readings that are missing
    return { before: [field, one], squares: squares + (isFar ? 0 : off), count: count + (isFar ? 0 : 1) };
}

/** @param {Choreography["jitter"]} jitter @returns {number} Standard deviation of an axis; infinite while it is not known. */
function noiseOf({ squares, count }) {
    return count < LOOKED_AT ? Infinity : Math.sqrt(squares / count);
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

/** @param {Vector} one @param {Vector} other @returns {boolean} Whether two axes are the same, or opposite. */
function areAlike(one, other) {
    return Math.abs(dot(one, unit(other))) > Math.cos(ALIKE) && length(other) > 1;
}

/** @param {Vector} v */
function length(v) {
    return Math.hypot(...v);
}

/** @param {ArrayLike<number>} numbers @param {number} j @returns {Vector} */
function at(numbers, j) {
    return [numbers[3 * j], numbers[3 * j + 1], numbers[3 * j + 2]];
}
