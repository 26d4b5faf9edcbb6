/**
 * From an uncertain ellipsoid to degrees of heading: `flinders.heading.error_propagation` and `confidence`, where the
 * formulas and their sources are written. `tests/agreement/test_page_engine.py` holds them to those.
 */

import { apply, diagonal, dot, eigen, full, inverse3, multiply, transposed, variance } from "./linear.js";

/** @typedef {import("./linear.js").Numbers} Numbers */

/**
 * An ellipsoid with what is asked of it.
 * @typedef {object} Surface
 * @property {number[]} centre
 * @property {number[]} shape Its six numbers.
 * @property {number[]} matrix The shape in full.
 * @property {number[]} inverse Of the shape, in full.
 * @property {number} radius Geometric mean of the semi-axes.
 * @property {number[]} axes Semi-axes, ascending.
 */

/** @typedef {{rms: number, worst: number}} ErrorDeg */

const HEADINGS = 72;
const AZIMUTHS = 24;
const TILT_STEP_DEG = 5;
const TILT_DIGITS_DEG = 0.01;
const EVERYWHERE = 400;
const MARGIN = 1.1;
const DEG = 180 / Math.PI;
/** Entries of a shape: which two rows of S each stands for. */
const ENTRIES = [[0, 0], [1, 1], [2, 2], [0, 1], [0, 2], [1, 2]];

/**
 * @param {number[]} centre
 * @param {number[]} shape
 * @returns {Surface}
 */
export function surfaceOf(centre, shape) {
    const matrix = full(shape);
    const axes = eigen(matrix, 3).values;
    return { centre, shape, matrix, inverse: inverse3(matrix), radius: Math.cbrt(axes[0] * axes[1] * axes[2]), axes };
}

/**
 * Coefficients of v·δb + vᵀ δS u in the nine parameters.
 * @param {number[]} v
 * @param {number[]} u
 * @returns {number[]}
 */
function gathered([v0, v1, v2], [u0, u1, u2]) {
    return [v0, v1, v2, v0 * u0, v1 * u1, v2 * u2, v0 * u1 + v1 * u0, v0 * u2 + v2 * u0, v1 * u2 + v2 * u1];
}

/**
 * Fields that a level vehicle meets at each heading, and vectors along which an error is one of heading.
 * @param {number} dipDeg
 * @returns {{heading: number, field: number[], across: number[]}[]}
 */
export function levelTurn(dipDeg) {
    const [level, height] = [Math.cos(dipDeg / DEG), Math.sin(dipDeg / DEG)];
    return Array.from({ length: HEADINGS }, (_, k) => {
        const heading = (2 * Math.PI * k) / HEADINGS;
        const [sine, cosine] = [Math.sin(heading), Math.cos(heading)];
        return { heading, field: [level * cosine, -level * sine, height], across: [sine / level, cosine / level, 0] };
    });
}

/**
 * @param {number[][]} rows
 * @returns {number[]}
 */
function meanOf(rows) {
    return rows[0].map((_, i) => rows.reduce((sum, row) => sum + row[i], 0) / rows.length);
}

/**
 * How the heading of a level vehicle changes with each parameter, at 72 headings; the mean is a matter of mounting.
 * @param {Surface} surface
 * @param {number} dipDeg
 * @returns {{rows: number[][], mean: number[]}}
 */
function levelRows(surface, dipDeg) {
    const rows = levelTurn(dipDeg).map(({ field, across }) => gathered(apply(surface.inverse, across), field));
    const mean = meanOf(rows);
    return { rows: rows.map((row) => row.map((part, i) => part - mean[i])), mean };
}

/**
 * @param {number[]} variances
 * @returns {ErrorDeg}
 */
function inDegrees(variances) {
    const mean = variances.reduce((sum, part) => sum + part, 0) / variances.length;
    return { rms: DEG * Math.sqrt(mean), worst: DEG * Math.sqrt(Math.max(...variances)) };
}

/**
 * Heading error of a level vehicle, 1 σ.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @returns {ErrorDeg}
 */
export function levelError(surface, covariance, dipDeg) {
    return inDegrees(levelRows(surface, dipDeg).rows.map((row) => variance(row, covariance)));
}

/**
 * A covariance with what belongs to the direction, σ of the corrected field, as an uncertain offset.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} sigma rad
 * @returns {Float64Array}
 */
export function withStructure({ matrix }, covariance, sigma) {
    const claimed = Float64Array.from(covariance);
    for (const [i, j] of [...ENTRIES, [1, 0], [2, 0], [2, 1]]) {
        claimed[9 * i + j] += sigma * sigma * dot(matrix.slice(3 * i, 3 * i + 3), matrix.slice(3 * j, 3 * j + 3));
    }
    return claimed;
}

/**
 * Heading error of a vehicle that is rolled or pitched by an angle, whichever way, and knows how far.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @param {number} tiltDeg
 * @returns {ErrorDeg}
 */
export function tiltedError(surface, covariance, dipDeg, tiltDeg) {
    const { mean } = levelRows(surface, dipDeg);
    const turn = levelTurn(dipDeg);
    const variances = tiltsBack(tiltDeg / DEG).flatMap((back) => {
        const bend = multiply(surface.inverse, back, 3, 3, 3);
        return turn.map(({ field, across }) => {
            const row = gathered(apply(bend, across), apply(back, field));
            for (let i = 0; i < row.length; i++) row[i] -= mean[i];
            return variance(row, covariance);
        });
    });
    return inDegrees(variances);
}

/**
 * Inverse turns by an angle about horizontal axes, by Rodrigues' formula.
 * @param {number} angle rad
 * @returns {number[][]}
 */
function tiltsBack(angle) {
    const [sine, rest] = [Math.sin(angle), 1 - Math.cos(angle)];
    return Array.from({ length: AZIMUTHS }, (_, k) => {
        const [x, y] = [Math.cos((2 * Math.PI * k) / AZIMUTHS), Math.sin((2 * Math.PI * k) / AZIMUTHS)];
        return [
            1 - rest * y * y, rest * x * y, -sine * y,
            rest * x * y, 1 - rest * x * x, sine * x,
            sine * y, -sine * x, 1 - rest,
        ]; // prettier-ignore
    });
}

/**
 * Tilt up to which the worst heading error is within a limit: 0 where even level it is not, 180 for all.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @param {number} limitDeg
 * @returns {number}
 */
export function attitudeLimitDeg(surface, covariance, dipDeg, limitDeg) {
    const isWithin = (/** @type {number} */ tilt) => tiltedError(surface, covariance, dipDeg, tilt).worst <= limitDeg;
    if (worstAnywhereDeg(surface, covariance, dipDeg) <= limitDeg) return 180;
    let beyond = 0;
    while (beyond <= 180 && isWithin(beyond)) beyond += TILT_STEP_DEG;
    if (beyond > 180) return 180;
    if (beyond === 0) return 0;
    let inside = beyond - TILT_STEP_DEG;
    while (beyond - inside > TILT_DIGITS_DEG) {
        const middle = (inside + beyond) / 2;
        if (isWithin(middle)) inside = middle;
        else beyond = middle;
    }
    return inside;
}

/**
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @returns {number}
 */
function worstAnywhereDeg(surface, covariance, dipDeg) {
    const { mean } = levelRows(surface, dipDeg);
    const mounting = DEG * Math.sqrt(variance(mean, covariance));
    return (MARGIN / Math.cos(dipDeg / DEG)) * directionError(surface, covariance).worst + mounting;
}

/**
 * Directions spread evenly over the sphere.
 * @param {number} count
 * @returns {number[][]}
 */
function fibonacci(count) {
    return Array.from({ length: count }, (_, k) => {
        const z = 1 - (2 * (k + 0.5)) / count;
        const longitude = Math.PI * (1 + Math.sqrt(5)) * (k + 0.5);
        const across = Math.sqrt(1 - z * z);
        return [across * Math.cos(longitude), across * Math.sin(longitude), z];
    });
}

/**
 * How the direction of the corrected field changes with each parameter: three rows, those of (1 − uuᵀ) S⁻¹.
 * @param {Surface} surface
 * @param {number[]} u
 * @returns {number[][]}
 */
function directionRows(surface, u) {
    return [0, 1, 2].map((axis) => {
        const across = [0, 1, 2].map((i) => Number(i === axis) - u[axis] * u[i]);
        return gathered(apply(surface.inverse, across), u);
    });
}

/**
 * Error of the direction of the corrected field over the whole sphere, 1 σ.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @returns {ErrorDeg}
 */
export function directionError(surface, covariance) {
    const sums = fibonacci(EVERYWHERE).map((u) =>
        directionRows(surface, u).reduce((sum, row) => sum + variance(row, covariance), 0),
    );
    return inDegrees(sums);
}

/**
 * Heading error at the worst attitude that brings the corrected field into each of the directions, degrees.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @param {number[][]} directions
 * @returns {number[]}
 */
export function tileErrorsDeg(surface, covariance, dipDeg, directions) {
    return directions.map((u) => {
        const rows = directionRows(surface, u);
        return (DEG * Math.sqrt(largestAcross(rows, covariance))) / Math.cos(dipDeg / DEG);
    });
}

/**
 * Largest eigenvalue of G C Gᵀ for three rows of G that have only two directions: its other ones are one, and zero.
 * @param {number[][]} rows
 * @param {Numbers} covariance
 * @returns {number}
 */
function largestAcross([a, b, c], covariance) {
    const [ofA, ofB] = [multiply(a, covariance, 1, 9, 9), multiply(b, covariance, 1, 9, 9)];
    const [aa, bb, cc] = [dot(a, ofA), dot(b, ofB), variance(c, covariance)];
    const [ab, ac, bc] = [dot(b, ofA), dot(c, ofA), dot(c, ofB)];
    const half = (aa + bb + cc) / 2;
    const minors = aa * bb - ab * ab + aa * cc - ac * ac + bb * cc - bc * bc;
    return Math.max(half + Math.sqrt(Math.max(half * half - minors, 0)), 0);
}

/**
 * What the raw heading of a level vehicle is off by, and the deviation at each heading, its mean removed.
 * @param {Surface} surface
 * @param {number} dipDeg
 * @returns {ErrorDeg & {headingDeg: number[], deviationDeg: number[]}}
 */
export function rawTurn(surface, dipDeg) {
    const turn = levelTurn(dipDeg);
    const off = turn.map(({ heading, field }) => {
        const [x, y] = apply(surface.matrix, field).map((part, i) => part + surface.centre[i]);
        return Math.atan2(-y, x) - heading;
    });
    const mean = Math.atan2(
        off.reduce((sum, angle) => sum + Math.sin(angle), 0),
        off.reduce((sum, angle) => sum + Math.cos(angle), 0),
    );
    const deviationDeg = off.map((angle) => DEG * Math.atan2(Math.sin(angle - mean), Math.cos(angle - mean)));
    return {
        rms: Math.sqrt(dot(deviationDeg, deviationDeg) / HEADINGS),
        worst: Math.max(...deviationDeg.map(Math.abs)),
        headingDeg: turn.map(({ heading }) => DEG * heading),
        deviationDeg,
    };
}

/**
 * 1 σ of the corrected compass at each of 72 headings, degrees.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @returns {number[]}
 */
export function turnSigmaDeg(surface, covariance, dipDeg) {
    return levelRows(surface, dipDeg).rows.map((row) => DEG * Math.sqrt(variance(row, covariance)));
}

/**
 * Root (16) of the covariance of the coefficients B, C, D, E by which the heading of a level vehicle errs, degrees: what
 * the engine bounds the error by.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} dipDeg
 * @returns {number[]} Row by row.
 */
export function levelRoot(surface, covariance, dipDeg) {
    const { rows } = levelRows(surface, dipDeg);
    const harmonics = rows.map((_, k) => harmonicsAt((2 * Math.PI * k) / HEADINGS));
    const gradient = [0, 1, 2, 3].flatMap((which) =>
        [0, 1, 2, 3, 4, 5, 6, 7, 8].map(
            (i) => ((2 * DEG) / HEADINGS) * rows.reduce((sum, row, k) => sum + harmonics[k][which] * row[i], 0),
        ),
    );
    const deviation = multiply(multiply(gradient, covariance, 4, 9, 9), transposed(gradient, 4, 9), 4, 9, 4);
    const { values, vectors } = eigen(deviation, 4);
    const columns = vectors.map((vector, k) => vector.map((part) => part * Math.sqrt(Math.max(values[k], 0))));
    return [0, 1, 2, 3].flatMap((row) => columns.map((column) => column[row]));
}

/**
 * @param {number} heading rad
 * @returns {number[]}
 */
function harmonicsAt(heading) {
    return [Math.sin(heading), Math.cos(heading), Math.sin(2 * heading), Math.cos(2 * heading)];
}

/**
 * Standard deviations of the entries of the correction F S⁻¹, where F is the radius.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @returns {number[]} Nine, row by row.
 */
export function matrixSigma({ inverse, radius }, covariance) {
    const matrix = inverse.map((part) => radius * part);
    const ofShape = diagonal(6, () => 0).map((_, i) => covariance[9 * (3 + Math.floor(i / 6)) + 3 + (i % 6)]);
    const changes = ENTRIES.map(([i, j]) => {
        const change = new Float64Array(9);
        change[3 * i + j] = change[3 * j + i] = 1;
        const scale = (inverse[3 * i + j] * (i === j ? 1 : 2)) / 3;
        const bent = multiply(multiply(matrix, change, 3, 3, 3), inverse, 3, 3, 3);
        return matrix.map((part, k) => scale * part - bent[k]);
    });
    return matrix.map((_, k) => Math.sqrt(variance(changes.map((change) => change[k]), ofShape)));
}
