/**
 * How a body turns so that the field's direction goes from one place to another in its axes.
 *
 * An attitude is a rotation from the axes of the body into those of the drawing: to the right, away, up. A magnetometer
 * alone leaves the turn about the field open, so the first attitude is free, and each next one follows by the smallest
 * rotation. With an accelerometer up is up, and magnetic north is away from the viewer.
 */

import { correctReading, cross, dot, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vector} Vector */
/** @typedef {readonly [Vector, Vector, Vector]} Rotation  three rows */
/** @typedef {{axis: Vector, angle: number}} Turn  about a unit vector, radians, right-handed */

/** @type {Rotation} */
export const LEVEL = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

/**
 * From axes of a sensor or vehicle to those of a drawn body: to its right, to its front, out of its face. A vehicle's point
 * forward, to the right and down; a sensor is drawn with its z out of the face.
 * @type {Readonly<Record<"sensor" | "vehicle", Rotation>>}
 */
export const DRAWN = { sensor: LEVEL, vehicle: [[0, 1, 0], [1, 0, 0], [0, 0, -1]] };

/** @param {Rotation} rotation @param {Vector} v @returns {[number, number, number]} */
export function rotated(rotation, v) {
    return [dot(rotation[0], v), dot(rotation[1], v), dot(rotation[2], v)];
}

/** @param {Rotation} a @param {Rotation} b @returns {Rotation} First b, then a. */
export function product(a, b) {
    const column = (/** @type {number} */ k) => rotated(a, [b[0][k], b[1][k], b[2][k]]);
    const [x, y, z] = [column(0), column(1), column(2)];
    return [[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]];
}

/**
 * Rodrigues' formula.
 * @param {Turn} turn
 * @returns {Rotation}
 */
export function rotation({ axis: [x, y, z], angle }) {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const d = 1 - c;
    return [
        [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
        [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
        [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
    ];
}

/**
 * The smallest turn that takes one unit vector to another; of opposite ones, one of the smallest.
 * @param {Vector} from
 * @param {Vector} to
 * @returns {Turn}
 */
export function between(from, to) {
    const normal = cross(from, to);
    const sine = Math.hypot(...normal);
    const aside = sine > 1e-6 ? normal : cross(from, Math.abs(from[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
    return { axis: unit(aside), angle: Math.atan2(sine, dot(from, to)) };
}

/** The attitude of a body, kept up as readings come. */
export class Attitude {
    rotation = LEVEL;
    /** Whether an accelerometer says which way is up. */
    isUpright = false;
    /** @type {Vector | null} where the field points, in axes of the body */
    field = null;

    /**
     * Take a reading.
     * @param {import("../view.d.ts").Now} now
     * @param {import("../view.d.ts").Shown} shown
     */
    follow({ raw, acceleration }, shown) {
        const field = unit(correctReading(raw, shown));
        const upright = acceleration && level(field, unit(acceleration));
        this.isUpright = Boolean(upright);
        if (upright) this.rotation = upright;
        else if (this.field) this.rotation = product(this.rotation, rotation(between(field, this.field)));
        this.field = field;
    }
}

/**
 * @param {Vector} field
 * @param {Vector} up
 * @returns {Rotation | null} Null where the field is vertical.
 */
function level(field, up) {
    const east = cross(field, up);
    if (!(Math.hypot(...east) > 0.05)) return null;
    const right = unit(east);
    return [right, cross(up, right), up];
}
