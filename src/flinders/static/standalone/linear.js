/**
 * Small matrices, row by row in plain arrays. A symmetric one of three rows is six numbers where it is called a shape:
 * 11, 22, 33, 12, 13, 23.
 */

/** @typedef {ArrayLike<number>} Numbers */

const SWEEPS = 60;

/**
 * All nine entries of a shape.
 * @param {Numbers} shape
 * @returns {number[]}
 */
export function full(shape) {
    const [a, b, c, d, e, f] = Array.from(shape);
    return [a, d, e, d, b, f, e, f, c];
}

/**
 * Determinant of three rows.
 * @param {Numbers} m
 * @returns {number}
 */
function determinant(m) {
    return (
        m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6])
    );
}

/**
 * Inverse of three symmetric rows.
 * @param {Numbers} m
 * @returns {number[]}
 */
export function inverse3(m) {
    const det = determinant(m);
    const cofactor = (/** @type {number[]} */ [i, j, k, l]) => (m[i] * m[l] - m[j] * m[k]) / det;
    const [a, d, e] = [cofactor([4, 5, 7, 8]), -cofactor([3, 5, 6, 8]), cofactor([3, 4, 6, 7])];
    const [b, f, c] = [cofactor([0, 2, 6, 8]), -cofactor([0, 1, 6, 7]), cofactor([0, 1, 3, 4])];
    return [a, d, e, d, b, f, e, f, c];
}

/**
 * Product of three rows with a vector.
 * @param {Numbers} m
 * @param {Numbers} v
 * @returns {number[]}
 */
export function apply(m, v) {
    const [x, y, z] = [v[0], v[1], v[2]];
    return [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
}

/**
 * Product of an n × m with an m × k matrix.
 * @param {Numbers} a
 * @param {Numbers} b
 * @param {number} n
 * @param {number} m
 * @param {number} k
 * @returns {Float64Array}
 */
export function multiply(a, b, n, m, k) {
    const out = new Float64Array(n * k);
    for (let i = 0; i < n; i++) {
        for (let j = 0; j < m; j++) {
            const factor = a[i * m + j];
            if (factor === 0) continue;
            for (let l = 0; l < k; l++) out[i * k + l] += factor * b[j * k + l];
        }
    }
    return out;
}

/**
 * @param {Numbers} matrix n × m
 * @param {number} n
 * @param {number} m
 * @returns {Float64Array}
 */
export function transposed(matrix, n, m) {
    return Float64Array.from({ length: n * m }, (_, i) => matrix[(i % n) * m + Math.floor(i / n)]);
}

/**
 * @param {number} n
 * @param {(i: number) => number} entry
 * @returns {Float64Array}
 */
export function diagonal(n, entry) {
    const out = new Float64Array(n * n);
    for (let i = 0; i < n; i++) out[i * (n + 1)] = entry(i);
    return out;
}

/**
 * Variance rᵀ C r of one row, not below zero.
 * @param {Numbers} row
 * @param {Numbers} covariance n × n, of the row's length n.
 * @returns {number}
 */
export function variance(row, covariance) {
    const n = row.length;
    let sum = 0;
    for (let i = 0; i < n; i++) {
        if (row[i] === 0) continue;
        let part = 0;
        for (let j = 0; j < n; j++) part += covariance[i * n + j] * row[j];
        sum += row[i] * part;
    }
    return Math.max(sum, 0);
}

/**
 * Scalar product.
 * @param {Numbers} a
 * @param {Numbers} b
 * @returns {number}
 */
export function dot(a, b) {
    let sum = 0;
    for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
    return sum;
}

/**
 * Eigenvalues of a symmetric matrix, ascending, and its eigenvectors in rows, by Jacobi's rotations.
 * @param {Numbers} matrix
 * @param {number} n
 * @returns {{values: number[], vectors: number[][]}}
 */
export function eigen(matrix, n) {
    const a = Float64Array.from(matrix);
    const v = diagonal(n, () => 1);
    for (let sweep = 0; sweep < SWEEPS && rotated(a, v, n); sweep++);
    const order = Array.from({ length: n }, (_, i) => i).sort((i, j) => a[i * (n + 1)] - a[j * (n + 1)]);
    return {
        values: order.map((i) => a[i * (n + 1)]),
        vectors: order.map((i) => Array.from({ length: n }, (_, row) => v[row * n + i])),
    };
}

/**
 * Turn each pair of axes once; false where nothing is left beside the diagonal.
 * @param {Float64Array} a
 * @param {Float64Array} v
 * @param {number} n
 * @returns {boolean}
 */
function rotated(a, v, n) {
    let isLeft = false;
    for (let p = 0; p < n; p++) {
        for (let q = p + 1; q < n; q++) {
            const off = a[p * n + q];
            if (Math.abs(off) <= 1e-17 * Math.sqrt(Math.abs(a[p * (n + 1)] * a[q * (n + 1)])) || off === 0) continue;
            isLeft = true;
            const theta = (a[q * (n + 1)] - a[p * (n + 1)]) / (2 * off);
            const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.hypot(theta, 1));
            const cosine = 1 / Math.hypot(t, 1);
            turnRows(a, n, p, q, cosine, t * cosine);
            turnColumns(a, n, p, q, cosine, t * cosine);
            turnColumns(v, n, p, q, cosine, t * cosine);
        }
    }
    return isLeft;
}

/**
 * @param {Float64Array} m
 * @param {number} n
 * @param {number} p
 * @param {number} q
 * @param {number} cosine
 * @param {number} sine
 */
function turnRows(m, n, p, q, cosine, sine) {
    for (let k = 0; k < n; k++) {
        const [x, y] = [m[p * n + k], m[q * n + k]];
        m[p * n + k] = cosine * x - sine * y;
        m[q * n + k] = sine * x + cosine * y;
    }
}

/**
 * @param {Float64Array} m
 * @param {number} n
 * @param {number} p
 * @param {number} q
 * @param {number} cosine
 * @param {number} sine
 */
function turnColumns(m, n, p, q, cosine, sine) {
    for (let k = 0; k < n; k++) {
        const [x, y] = [m[k * n + p], m[k * n + q]];
        m[k * n + p] = cosine * x - sine * y;
        m[k * n + q] = sine * x + cosine * y;
    }
}

/**
 * Inverse of a symmetric positive definite matrix, and half the logarithm of its determinant.
 * @param {Numbers} matrix
 * @param {number} n
 * @returns {{inverse: Float64Array, halfLog: number}}
 */
export function inverted(matrix, n) {
    const a = Float64Array.from(matrix);
    const inverse = diagonal(n, () => 1);
    let halfLog = 0;
    for (let p = 0; p < n; p++) {
        const pivot = a[p * (n + 1)];
        halfLog += Math.log(pivot) / 2;
        for (let k = 0; k < n; k++) {
            a[p * n + k] /= pivot;
            inverse[p * n + k] /= pivot;
        }
        for (let i = 0; i < n; i++) {
            const factor = a[i * n + p];
            if (i === p || factor === 0) continue;
            for (let k = 0; k < n; k++) {
                a[i * n + k] -= factor * a[p * n + k];
                inverse[i * n + k] -= factor * inverse[p * n + k];
            }
        }
    }
    return { inverse, halfLog };
}

/**
 * The shortest of the solutions that leave least.
 * @param {number[][]} rows
 * @param {number[]} targets
 * @returns {number[]}
 */
export function leastSquares(rows, targets) {
    const n = rows[0].length;
    const columns = Array.from({ length: n }, (_, i) => rows.map((row) => row[i]));
    const { values, vectors } = eigen(columns.flatMap((a) => columns.map((b) => dot(a, b))), n);
    const right = columns.map((column) => dot(column, targets));
    const parts = vectors.map((vector, i) => (values[i] > 1e-14 * values[n - 1] ? dot(vector, right) / values[i] : 0));
    return Array.from({ length: n }, (_, i) => vectors.reduce((sum, vector, k) => sum + parts[k] * vector[i], 0));
}
