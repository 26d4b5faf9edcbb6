/** Whether a sensor was hardly turned: `flinders.diagnostics.unmoved`, where the reasons and their measures are. */

import { threes } from "./coverage.js";
import { dot, leastSquares } from "./linear.js";
import { principal } from "./plane.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./engine.js").Fitted} Fitted */

const DEG = 180 / Math.PI;

/**
 * Whether a record alone shows a sensor that was turned out of one plane, and was at no rail.
 * @param {Fitted} record
 * @param {boolean} isMicrotesla
 * @param {EngineData} data
 * @returns {boolean}
 */
export function wasTurned({ mean, principal_variances: variances, rails }, isMicrotesla, { numbers }) {
    const level = levelOf(Math.hypot(...mean), isMicrotesla, numbers);
    const isWide = variances[2] > (numbers.NARROW_BALL * level) ** 2;
    return isWide && variances[0] > numbers.FLATTEST ** 2 * variances[2] && rails === 0;
}

/**
 * @param {number} size
 * @param {boolean} isMicrotesla
 * @param {Record<string, number>} numbers
 * @returns {number}
 */
function levelOf(size, isMicrotesla, { EARTH_WEAKEST, EARTH_STRONGEST }) {
    return isMicrotesla ? Math.min(Math.max(size, EARTH_WEAKEST), EARTH_STRONGEST) : size;
}

/**
 * Angle within which all readings of a sensor lie that was hardly turned; null of one that was.
 * @param {Float64Array} field
 * @param {boolean} isMicrotesla
 * @param {EngineData} data
 * @returns {number | null}
 */
export function unmovedDeg(field, isMicrotesla, { numbers }) {
    if (field.length < 3 * numbers.UNMOVED_FEWEST) return null;
    const cloud = spread(placesOf(threes(field)));
    const size = Math.hypot(...cloud.mean);
    if (!(cloud.reach > numbers.UNMOVED_ROUNDING * size && size > 0)) return null;
    const level = levelOf(size, isMicrotesla, numbers);
    const isPoint = isMicrotesla && size >= numbers.EARTH_WEAKEST && cloud.reach < numbers.POINT * level;
    if (isPoint) return DEG * Math.atan2(cloud.reach, level);
    if (!isNarrow(cloud, level, numbers)) return null;
    const isCoarse = isCoarseCloud(cloud, field.length / 3, numbers);
    const radius = isCoarse ? 0 : radiusSeen(cloud, numbers);
    const seen = radius > numbers.MOST_IRON * size ? Math.min(level, radius) : level;
    if (!isNarrow(cloud, seen, numbers) || !(isCoarse || isFilled(cloud, numbers))) return null;
    return DEG * Math.atan2(cloud.reach, seen);
}

/**
 * Readings by place: each cell counts once, by its mean.
 * @param {number[][]} readings
 * @returns {number[][]}
 */
function placesOf(readings) {
    const side = naturalSide(readings);
    /** @type {Map<string, number[]>} */
    const cells = new Map();
    for (const [x, y, z] of readings) {
        const key = [x, y, z].map((part) => Math.floor(part / side)).join();
        const sums = cells.get(key) ?? [0, 0, 0, 0];
        cells.set(key, [sums[0] + x, sums[1] + y, sums[2] + z, sums[3] + 1]);
    }
    return [...cells.values()].map(([x, y, z, count]) => [x / count, y / count, z / count]);
}

/**
 * The power of two nearest to a twelfth of the median distance from the middle.
 * @param {number[][]} readings
 * @returns {number}
 */
function naturalSide(readings) {
    const stride = Math.max(1, Math.floor(readings.length / 512));
    const some = readings.filter((_, i) => i % stride === 0);
    const { apart } = spread(some);
    const lengths = apart.map((local) => Math.hypot(...local)).sort((a, b) => a - b);
    const median = (lengths[(lengths.length - 1) >> 1] + lengths[lengths.length >> 1]) / 2;
    const largest = greatest(some.flat().map(Math.abs));
    return 2 ** Math.round(Math.log2(Math.max(median, 2 ** -40 * largest) / 12));
}

/**
 * A cloud of places: those about its mean, how far the farthest is, and standard deviations along its axes.
 * @typedef {{mean: number[], apart: number[][], reach: number, deviations: number[], axes: number[][]}} Cloud
 */

/**
 * @param {number[][]} points
 * @returns {Cloud}
 */
function spread(points) {
    const { mean, local, values, vectors } = principal(points);
    const deviations = values.map((value) => Math.sqrt(Math.max(value, 0)));
    return { mean, apart: local, reach: greatest(local.map((place) => Math.hypot(...place))), deviations, axes: vectors };
}

/**
 * The largest of numbers, which are too many for arguments.
 * @param {number[]} numbers
 * @returns {number}
 */
function greatest(numbers) {
    return numbers.reduce((largest, number) => Math.max(largest, number), -Infinity);
}

/**
 * Whether a cloud is small beside the distance of its centre, and no place far off the others.
 * @param {Cloud} cloud
 * @param {number} level
 * @param {Record<string, number>} numbers
 * @returns {boolean}
 */
function isNarrow({ deviations, reach }, level, numbers) {
    const [thickness, , width] = deviations;
    const isBall = thickness > numbers.BALL * width;
    const limit = isBall ? numbers.NARROW_BALL : numbers.NARROW;
    const tails = isBall ? numbers.TAILS_BALL : numbers.TAILS;
    return width < limit * level && reach < Math.max(tails * width, numbers.NEAR * level);
}

/**
 * Whether some places are near the mean, along the axes in which the cloud is not thin.
 * @param {Cloud} cloud
 * @param {Record<string, number>} numbers
 * @returns {boolean}
 */
function isFilled({ apart, deviations, axes }, numbers) {
    const thick = [0, 1, 2].filter((i) => deviations[i] > numbers.THIN * deviations[2]);
    const squares = apart.map((local) => thick.reduce((sum, i) => sum + (dot(local, axes[i]) / deviations[i]) ** 2, 0));
    const close = squares.filter((square) => square < numbers.CLOSE * thick.length);
    return close.length / apart.length > numbers.FILLED;
}

/**
 * Radius of the sphere or circle through places; infinite where they do not show a curve.
 * @param {Cloud} cloud
 * @param {Record<string, number>} numbers
 * @returns {number}
 */
function radiusSeen({ apart, deviations, axes }, numbers) {
    const across = apart.map((local) => [dot(local, axes[1]), dot(local, axes[2])]);
    return Math.min(radiusOf(apart, deviations[0], numbers), radiusOf(across, deviations[1], numbers));
}

/**
 * @param {number[][]} places
 * @param {number} thickness
 * @param {Record<string, number>} numbers
 * @returns {number}
 */
function radiusOf(places, thickness, numbers) {
    const scale = greatest(places.flat().map(Math.abs));
    const rows = places.map((place) => [...place.map((part) => (2 * part) / scale), 1]);
    const targets = places.map((place) => dot(place, place) / scale ** 2);
    const solution = leastSquares(rows, targets);
    const [centre, rest] = [solution.slice(0, -1), solution[solution.length - 1]];
    const radius = scale * Math.sqrt(Math.max(rest + dot(centre, centre), 0));
    const lengths = places.map((place) => Math.hypot(...place.map((part, i) => part - scale * centre[i])));
    const mean = lengths.reduce((sum, length) => sum + length, 0) / lengths.length;
    const noise = Math.sqrt(lengths.reduce((sum, length) => sum + (length - mean) ** 2, 0) / lengths.length);
    return noise < Math.min(numbers.SPHERICAL * radius, numbers.CURVED * thickness) ? radius : Infinity;
}

/**
 * Whether readings take a few values only on each axis, and each place many times.
 * @param {Cloud} cloud
 * @param {number} rows
 * @param {Record<string, number>} numbers
 * @returns {boolean}
 */
function isCoarseCloud({ mean, apart }, rows, { COARSE, OFTEN, UNMOVED_ROUNDING }) {
    if (apart.length > COARSE ** 3 || rows < OFTEN * apart.length) return false;
    return [0, 1, 2].every((axis) => {
        const ordered = apart.map((place) => place[axis] + mean[axis]).sort((one, other) => one - other);
        const least = UNMOVED_ROUNDING * greatest(ordered.map(Math.abs));
        return 1 + ordered.filter((value, i) => i > 0 && value - ordered[i - 1] > least).length <= COARSE;
    });
}
