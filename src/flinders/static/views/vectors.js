/** Vectors of three numbers, and a reading under a calibration. */

/** @typedef {readonly number[]} Vector */

/** @param {Vector} a @param {Vector} b @returns {number} */
export function dot(a, b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {Vector} v @returns {number[]} Of length one; unchanged where it has none. */
export function unit(v) {
    const length = Math.hypot(...v) || 1;
    return v.map((part) => part / length);
}

/** @param {Vector} a @param {Vector} b @returns {[number, number, number]} */
export function minus(a, b) {
    return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/** @param {Vector} a @param {Vector} b @returns {[number, number, number]} */
export function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** @param {readonly Vector[]} matrix  rows */
export function determinant([a, b, c]) {
    return dot(a, cross(b, c));
}

/** @param {readonly Vector[]} matrix  rows @returns {number[][]} */
export function inverseOf(matrix) {
    const [a, b, c] = matrix;
    const size = determinant(matrix);
    const columns = [cross(b, c), cross(c, a), cross(a, b)];
    return [0, 1, 2].map((row) => columns.map((column) => column[row] / size));
}

/**
 * matrix · (raw − offset)
 *
 * @param {Vector} raw
 * @param {{offset: Vector, matrix: readonly Vector[]}} calibration
 * @returns {[number, number, number]}
 */
export function correctReading(raw, { offset, matrix }) {
    const shifted = minus(raw, offset);
    return [dot(matrix[0], shifted), dot(matrix[1], shifted), dot(matrix[2], shifted)];
}
