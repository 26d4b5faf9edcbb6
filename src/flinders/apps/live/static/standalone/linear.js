/** 3 × 3 matrices, stored row by row. */

/**
 * Inverse and determinant.
 * @param {ArrayLike<number>} m
 * @returns {{inverse: number[], determinant: number}}
 */
export function inverseOf(m) {
    const minor = (/** @type {number} */ i, /** @type {number} */ j, /** @type {number} */ k, /** @type {number} */ l) => m[i] * m[l] - m[j] * m[k];
    const adjugate = [
        minor(4, 5, 7, 8), -minor(1, 2, 7, 8), minor(1, 2, 4, 5),
        -minor(3, 5, 6, 8), minor(0, 2, 6, 8), -minor(0, 2, 3, 5),
        minor(3, 4, 6, 7), -minor(0, 1, 6, 7), minor(0, 1, 3, 4),
    ]; // prettier-ignore
    const determinant = m[0] * adjugate[0] + m[1] * adjugate[3] + m[2] * adjugate[6];
    return { inverse: adjugate.map((part) => part / determinant), determinant };
}

/**
 * Product of a matrix and a vector.
 * @param {ArrayLike<number>} m
 * @param {ArrayLike<number>} v
 * @returns {number[]}
 */
export function apply(m, v) {
    const [x, y, z] = [v[0], v[1], v[2]];
    return [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
}

/**
 * Product of two matrices.
 * @param {ArrayLike<number>} a
 * @param {ArrayLike<number>} b
 * @returns {number[]}
 */
export function product(a, b) {
    return Array.from({ length: 9 }, (_, k) => {
        const row = 3 * Math.floor(k / 3);
        return a[row] * b[k % 3] + a[row + 1] * b[3 + (k % 3)] + a[row + 2] * b[6 + (k % 3)];
    });
}

/**
 * @param {ArrayLike<number>} m
 * @returns {number[]}
 */
export function transpose(m) {
    return [0, 3, 6, 1, 4, 7, 2, 5, 8].map((k) => m[k]);
}
