/**
 * What a fit may claim: the covariance of the engine, widened by repeated and by few readings
 * (`flinders.fitting.claim`), and the fit of readings that were corrected before (`flinders.fitting.shrinkage`).
 */

import { surfaceOf } from "./heading.js";
import { diagonal, dot, eigen, inverted, multiply, transposed } from "./linear.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Fitted} Fitted */
/** @typedef {import("./heading.js").Surface} Surface */
/** @typedef {import("./linear.js").Numbers} Numbers */

const PARAMETERS = 9;
const DEPARTURES = 8;

/**
 * Factors by which a covariance is widened: by repeated readings alone, and by all.
 * @param {Fitted} record Of the readings that were fitted.
 * @param {number} rows
 * @param {number} distinct Of all readings.
 * @returns {{repetition: number, factor: number}}
 */
export function widening(record, rows, distinct) {
    const repetition = repetitionOf(record, rows / Math.max(distinct, 1));
    const freedom = rows / repetition - PARAMETERS;
    const known = freedom >= 1 ? (rows - PARAMETERS) / freedom : repetition;
    return { repetition, factor: known * byFew(freedom) };
}

/**
 * Factor by which repeated readings widen a covariance that does not know of them yet.
 * @param {Fitted} record
 * @param {number} share Readings for each different one.
 * @returns {number}
 */
function repetitionOf({ covariance, textbook }, share) {
    const places = Array.from({ length: PARAMETERS }, (_, i) => i * (PARAMETERS + 1)).filter((i) => textbook[i] > 0);
    const ratio = places.reduce((sum, i) => sum + covariance[i] / textbook[i], 0) / places.length;
    return Math.max(1, share / ratio);
}

/**
 * Variance of Student's t, as the noise is known from few residuals.
 * @param {number} freedom
 * @returns {number}
 */
function byFew(freedom) {
    return freedom >= 3 ? freedom / (freedom - 2) : 3 * 4 ** (3 - Math.max(freedom, 0));
}

/**
 * A fit that is shrunk towards leaving readings as they are; null where these were hardly corrected before.
 * @param {Surface} surface
 * @param {Numbers} covariance As claimed.
 * @param {EngineData} data
 * @returns {{surface: Surface, covariance: Float64Array} | null}
 */
export function shrunk(surface, covariance, data) {
    const size = (surface.shape[0] + surface.shape[1] + surface.shape[2]) / 3;
    if (!isNear(surface, covariance, size, data)) return null;
    const { priors, departures } = data.shrinkage;
    const departure = multiply(departures, [...surface.centre, ...surface.shape], DEPARTURES, PARAMETERS, 1);
    const spread = semidefinite(carried(departures, covariance, DEPARTURES, PARAMETERS, 1 / size ** 2));
    const scaled = departure.map((part) => part / size);
    const densities = priors.map((prior) => logDensity(scaled, spread, prior));
    const odds = densities.slice(0, -1).map((density) => Math.exp(density - densities[densities.length - 1]));
    const total = odds.reduce((sum, each) => sum + each, 0);
    if (!(total / odds.length > data.numbers.PROBABLE / (1 - data.numbers.PROBABLE))) return null;
    const each = odds.map((one, i) => ({ weight: one / total, ...posterior(scaled, spread, priors[i]) }));
    return restored(each, covariance, size, data);
}

/**
 * Whether an estimate is so certain, and its offset so small, that a look at the rest is due.
 * @param {Surface} surface
 * @param {Numbers} covariance
 * @param {number} size
 * @param {EngineData} data
 * @returns {boolean}
 */
function isNear({ centre }, covariance, size, { numbers }) {
    const variances = Array.from({ length: PARAMETERS }, (_, i) => covariance[i * (PARAMETERS + 1)]);
    if (!(variances.reduce((sum, each) => sum + each, 0) < (numbers.UNKNOWN * size) ** 2)) return false;
    const least = (numbers.WIDEST_OFFSET * size) ** 2;
    return centre.every((part, i) => Math.abs(part) < numbers.FARTHEST * Math.sqrt(variances[i] + least));
}

/**
 * A covariance carried over by a linear map: factor · M C Mᵀ.
 * @param {Numbers} map n × m
 * @param {Numbers} covariance
 * @param {number} n
 * @param {number} m
 * @param {number} factor
 * @returns {Float64Array}
 */
function carried(map, covariance, n, m, factor) {
    const out = multiply(multiply(map, covariance, n, m, m), transposed(map, n, m), n, m, n);
    return out.map((part) => part * factor);
}

/**
 * A covariance without the negative variances that rounding leaves.
 * @param {Float64Array} spread
 * @returns {Float64Array}
 */
function semidefinite(spread) {
    const { values, vectors } = eigen(spread, DEPARTURES);
    const roots = vectors.flatMap((vector, i) => vector.map((part) => part * Math.sqrt(Math.max(values[i], 0))));
    return multiply(transposed(roots, DEPARTURES, DEPARTURES), roots, DEPARTURES, DEPARTURES, DEPARTURES);
}

/**
 * Sum of a covariance and the variances of a prior.
 * @param {Float64Array} spread
 * @param {number[]} prior
 * @returns {Float64Array}
 */
function withPrior(spread, prior) {
    const own = diagonal(DEPARTURES, (i) => prior[i]);
    return spread.map((part, i) => part + own[i]);
}

/**
 * @param {Float64Array} departure
 * @param {Float64Array} spread
 * @param {number[]} prior
 * @returns {number}
 */
function logDensity(departure, spread, prior) {
    const { inverse, halfLog } = inverted(withPrior(spread, prior), DEPARTURES);
    return -0.5 * dot(departure, multiply(inverse, departure, DEPARTURES, DEPARTURES, 1)) - halfLog;
}

/**
 * Mean and covariance of departures under one prior Q: Q (P + Q)⁻¹ d and Q (P + Q)⁻¹ P.
 * @param {Float64Array} departure
 * @param {Float64Array} spread
 * @param {number[]} prior
 * @returns {{mean: Float64Array, within: Float64Array}}
 */
function posterior(departure, spread, prior) {
    const { inverse } = inverted(withPrior(spread, prior), DEPARTURES);
    const gain = multiply(diagonal(DEPARTURES, (i) => prior[i]), inverse, DEPARTURES, DEPARTURES, DEPARTURES);
    return {
        mean: multiply(gain, departure, DEPARTURES, DEPARTURES, 1),
        within: multiply(gain, spread, DEPARTURES, DEPARTURES, DEPARTURES),
    };
}

/**
 * The average over priors, as an ellipsoid.
 * @param {{weight: number, mean: Float64Array, within: Float64Array}[]} each
 * @param {Numbers} covariance
 * @param {number} size
 * @param {EngineData} data
 * @returns {{surface: Surface, covariance: Float64Array}}
 */
function restored(each, covariance, size, { shrinkage }) {
    const mean = each[0].mean.map((_, i) => each.reduce((sum, { weight, mean: own }) => sum + weight * own[i], 0));
    const spread = each[0].within.map((_, k) => {
        const [i, j] = [Math.floor(k / DEPARTURES), k % DEPARTURES];
        return each.reduce((sum, { weight, mean: own, within }) => {
            const symmetric = (within[k] + within[j * DEPARTURES + i]) / 2;
            return sum + weight * (symmetric + (own[i] - mean[i]) * (own[j] - mean[j]));
        }, 0);
    });
    const off = multiply(shrinkage.parameters, mean, PARAMETERS, DEPARTURES, 1);
    const shrunken = Array.from(off, (part, i) => size * (3 * shrinkage.size[i] + part));
    const share = carried(shrinkage.size, covariance, 1, PARAMETERS, 1 / size ** 2)[0];
    const widths = carried(shrinkage.parameters, spread, PARAMETERS, DEPARTURES, size ** 2);
    return {
        surface: surfaceOf(shrunken.slice(0, 3), shrunken.slice(3)),
        covariance: widths.map((part, k) => part + shrunken[Math.floor(k / 9)] * shrunken[k % 9] * share),
    };
}
