/**
 * Which way to turn the sensor next, so that the worst error falls fastest: `flinders.heading.guidance`, where the
 * design and its sources are written.
 */

import { directionRows, jacobian, levelRows } from "./heading.js";
import { dot, eigen, multiply, variance } from "./linear.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {"heading" | "attitude"} Goal */

const DEG = 180 / Math.PI;
const SHARPNESS = 4;
const FULL_DIGITS = 1e-12;

/**
 * What is known, and where the next readings would tell most.
 * @typedef {object} Guidance
 * @property {number} worstDeg The error that matters: of a level heading, or of any direction.
 * @property {number} afterDeg That after a batch there.
 * @property {number[]} direction Of the field, in corrected axes.
 * @property {string} words
 */

/**
 * Find the direction whose readings would reduce the worst error most.
 * @param {Fit} fit
 * @param {Goal} goal
 * @returns {Guidance}
 */
export function guide(fit, goal) {
    const { surface, covariance, counts, data } = fit;
    const wanted =
        goal === "heading"
            ? levelRows(surface, fit.headingError.dipDeg).rows.map((row) => [row])
            : data.cells.map((cell) => directionRows(surface, cell));
    const jacobians = data.cells.map((cell) => jacobian(surface, cell));
    const readings = Math.max(data.numbers.BATCH_SHARE * counts.reduce((sum, each) => sum + each, 0), 1);
    const own = readingVariance(jacobians, fit) / readings;
    const before = wanted.map((rows) => rows.reduce((sum, row) => sum + variance(row, covariance), 0));
    const after = jacobians.map((row) => {
        const lever = multiply(covariance, row, 9, 9, 1);
        const total = Math.max(own + dot(row, lever), Number.MIN_VALUE);
        return wanted.map((rows, k) => {
            const gained = rows.reduce((sum, gradient) => sum + dot(gradient, lever) ** 2, 0) / total;
            return Math.max(before[k] - gained, 0);
        });
    });
    const best = lowest(sharpMeans(after));
    return {
        worstDeg: DEG * Math.sqrt(Math.max(...before)),
        afterDeg: DEG * Math.sqrt(Math.max(...after[best])),
        direction: data.cells[best],
        words: `hold it ${poseWords(data.cells[best], fit.dipDeg, data)} and turn it slowly once around, keeping it so`,
    };
}

/**
 * Means of the fourth powers of each row, in units of the largest of all.
 * @param {number[][]} variances
 * @returns {number[]}
 */
export function sharpMeans(variances) {
    const largest = Math.max(...variances.map((row) => Math.max(...row)), Number.MIN_VALUE);
    return variances.map((row) => row.reduce((sum, each) => sum + (each / largest) ** SHARPNESS, 0) / row.length);
}

/**
 * @param {number[]} scores
 * @returns {number}
 */
function lowest(scores) {
    return scores.reduce((best, score, i) => (score < scores[best] ? i : best), 0);
}

/**
 * Variance of a reading with which the readings counted give the covariance that is claimed.
 * @param {number[][]} jacobians In the middle of each cell.
 * @param {Fit} fit
 * @returns {number}
 */
export function readingVariance(jacobians, { covariance, noise, counts }) {
    const { values, vectors } = eigen(covariance, 9);
    const free = values.map((_, i) => i).filter((i) => values[i] > FULL_DIGITS * values[8]);
    if (!free.length) return noise ** 2;
    const roots = free.map((i) => jacobians.map((row) => dot(row, vectors[i]) * Math.sqrt(values[i])));
    const gram = roots.flatMap((a) => roots.map((b) => a.reduce((sum, part, k) => sum + counts[k] * part * b[k], 0)));
    const ascending = eigen(gram, free.length).values;
    const middle = [ascending[(free.length - 1) >> 1], ascending[free.length >> 1]];
    return Math.max(noise ** 2, (middle[0] + middle[1]) / 2);
}

/**
 * The simplest attitude whose vertical meets the field as the advised direction does.
 * @param {number[]} wanted
 * @param {number} dipDeg Of the site.
 * @param {EngineData} data
 * @returns {string}
 */
function poseWords(wanted, dipDeg, { poses, numbers }) {
    const costs = poses.map(({ down, effort }) => {
        const angle = DEG * Math.acos(Math.min(Math.max(dot(down, wanted), -1), 1));
        return Number((Math.abs(angle - (90 - dipDeg)) + numbers.EFFORT_DEG * effort).toFixed(6));
    });
    return poses[lowest(costs)].words;
}

/**
 * Which way to turn the sensor next, in words: a level heading while that is not good enough, then all attitudes.
 * @param {Fit} fit
 * @returns {string}
 */
export function movement(fit) {
    const advice = guide(fit, fit.headingError.worst > fit.targetDeg ? "heading" : "attitude");
    if (isIdle(advice, fit.data)) {
        return "record for longer while turning through all directions, away from iron and currents";
    }
    return advice.words.replace("hold it", "hold the sensor");
}

/**
 * Whether no direction would help more than the others.
 * @param {Guidance} advice
 * @param {EngineData} data
 * @returns {boolean}
 */
export function isIdle({ worstDeg, afterDeg }, { numbers }) {
    return afterDeg > (1 - numbers.WORTH_IT) * worstDeg;
}
