/**
 * The way that the field should go from where it points now, and a sphere to draw readings on that no fit has a surface
 * for yet: `flinders.heading.path_planning` and `flinders.live.evaluation.guided`.
 */

import { threes } from "./coverage.js";
import { readingVariance, sharpMeans } from "./guidance.js";
import { directionError, directionRows, fibonacci, jacobian, levelRows, surfaceOf } from "./heading.js";
import { apply, diagonal, dot, eigen, inverted, leastSquares, variance } from "./linear.js";
import { principal } from "./plane.js";

/** @typedef {import("../messages.d.ts").View} View */
/** @typedef {import("./data.d.ts").EngineData} EngineData */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./guidance.js").Goal} Goal */
/** @typedef {import("./heading.js").Surface} Surface */
/** @typedef {import("./reasons.js").Readings} Readings */

/**
 * What is known before the next reading, and what a reading is worth.
 * @typedef {{surface: Surface, covariance: ArrayLike<number>, variance: number, isRough: boolean}} Belief
 */
/** @typedef {{information: Float64Array, nodes: number[]}} Path */
/** @typedef {{waypoints: number[][], worstDeg: number, afterDeg: number}} Route */

const DEG = 180 / Math.PI;
const BETWEEN = 4;
const ATTITUDES = 50;
const NEIGHBOUR_DEG = 40;
const FLOOR = 1e-12;

/**
 * Put the path from the newest reading into the view of a fit; not where it gains nothing.
 * @param {View} view
 * @param {Fit} fit
 * @param {Readings} readings
 * @param {boolean} isFlat
 * @param {Goal} goal
 * @returns {View}
 */
export function guided(view, fit, readings, isFlat, goal) {
    const belief = believe(fit, readings.field, isFlat);
    if (!belief) return view;
    const { surface, isRough } = belief;
    const newest = readings.field.slice(-3);
    const here = apply(surface.inverse, Array.from(newest, (part, axis) => part - surface.centre[axis]));
    const length = Math.hypot(...here);
    if (!length) return view;
    const start = here.map((part) => part / length);
    const route = planned(belief, start, fit, readingsPerDeg(readings.time, fit.data), goal);
    if (route.worstDeg <= fit.targetDeg && !isRough) return view;
    const guidance = {
        direction: /** @type {[number, number, number]} */ (route.waypoints[0]),
        words: `follow the arrow: turn it ${turns([start, ...route.waypoints], fit.data)}`,
        worst_deg: route.worstDeg,
        after_deg: route.afterDeg,
        goal,
        frame: /** @type {const} */ ("sensor"),
    };
    return { ...view, guidance, shown: isRough ? round(surface) : view.shown };
}

/**
 * A sphere to draw readings on.
 * @param {Surface} surface
 * @returns {View["shown"]}
 */
function round({ centre, radius }) {
    const [x, y, z] = centre;
    return { offset: [x, y, z], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], strength: radius };
}

/**
 * What is known after a fit: what it claims, or else a sphere; null of too few readings, or a short arc.
 * @param {Fit} fit
 * @param {Float64Array} field
 * @param {boolean} isFlat
 * @returns {Belief | null}
 */
function believe(fit, field, isFlat) {
    const { surface, covariance, claimed, data } = fit;
    if (isFlat || directionError(surface, claimed).worst > data.numbers.KNOWN_DEG) return rough(field, data);
    const jacobians = data.cells.map((cell) => jacobian(surface, cell));
    return { surface, covariance, variance: readingVariance(jacobians, fit), isRough: false };
}

/**
 * A sphere through readings that no fit can do anything with yet, in the plane or space in which they are spread.
 * @param {Float64Array} field
 * @param {EngineData} data
 * @returns {Belief | null}
 */
function rough(field, { numbers }) {
    const stride = Math.ceil(field.length / 3 / numbers.PATH_THINNED);
    const points = threes(field).filter((_, i) => i % stride === 0);
    if (points.length < 4) return null;
    const { mean, local, values, vectors } = principal(points);
    const spreads = values.map((value) => Math.sqrt(Math.max(value, 0)));
    const plane = [2, 1, 0].filter((i) => spreads[i] > numbers.PATH_FLAT * spreads[2]).map((i) => vectors[i]);
    if (plane.length < 2) return null;
    const flat = local.map((point) => plane.map((axis) => dot(point, axis)));
    const solution = leastSquares(
        flat.map((point) => [...point.map((part) => 2 * part), 1]),
        flat.map((point) => dot(point, point)),
    );
    const across = solution.slice(0, -1);
    const radius = Math.sqrt(Math.max(solution[plane.length] + dot(across, across), 0));
    const centre = mean.map((part, axis) => part + plane.reduce((sum, each, i) => sum + across[i] * each[axis], 0));
    const apart = points.map((point) => point.map((part, axis) => part - centre[axis]));
    const lengths = apart.map((point) => Math.hypot(...point));
    if (!radius || !lengths.every(Boolean)) return null;
    const directions = apart.map((point, i) => point.map((part) => part / lengths[i]));
    if (isShortArc(directions, Math.cos(numbers.ARC_DEG / DEG))) return null;
    const scatter = lengths.reduce((sum, length) => sum + (length - radius) ** 2, 0) / lengths.length;
    return sphere(centre, radius, directions, Math.max(scatter, (numbers.ROUGHEST * radius) ** 2), numbers.DEPARTURE);
}

/**
 * @param {number[][]} directions
 * @param {number} least Cosine.
 * @returns {boolean}
 */
function isShortArc(directions, least) {
    return directions.every((one, i) => directions.every((other, j) => j < i || dot(one, other) > least));
}

/**
 * A sphere, with what hard and soft iron commonly do where nothing was seen.
 * @param {number[]} centre
 * @param {number} radius
 * @param {number[][]} directions
 * @param {number} scatter Variance of a reading's distance.
 * @param {number} departure
 * @returns {Belief}
 */
function sphere(centre, radius, directions, scatter, departure) {
    const surface = surfaceOf(centre, [radius, radius, radius, 0, 0, 0]);
    const information = diagonal(9, (i) => 1 / (i < 3 ? radius : departure * radius) ** 2);
    addRows(information, directions.map((direction) => jacobian(surface, direction)), 1 / scatter);
    return { surface, covariance: inverted(information, 9).inverse, variance: scatter, isRough: true };
}

/**
 * Add weight · JᵀJ.
 * @param {Float64Array} information
 * @param {number[][]} rows
 * @param {number} weight
 */
function addRows(information, rows, weight) {
    for (const row of rows) {
        for (let k = 0; k < 81; k++) information[k] += weight * row[Math.floor(k / 9)] * row[k % 9];
    }
}

/**
 * Readings for each degree that a hand turns the sensor by.
 * @param {Float64Array} time
 * @param {EngineData} data
 * @returns {number}
 */
function readingsPerDeg(time, { numbers }) {
    const seconds = time[time.length - 1] - time[0];
    return seconds > 0 ? (time.length - 1) / seconds / numbers.SPEED_DEG : numbers.READINGS_PER_DEG;
}

/**
 * Find the way that brings the worst error below the target soonest, or as low as it gets, by a beam search.
 * @param {Belief} belief
 * @param {number[]} start
 * @param {Fit} fit
 * @param {number} perDeg
 * @param {Goal} goal
 * @returns {Route}
 */
function planned({ surface, covariance, variance: own }, start, { headingError, targetDeg, data }, perDeg, goal) {
    const { numbers, nodes } = data;
    const wanted =
        goal === "heading"
            ? levelRows(surface, headingError.dipDeg).rows.map((row) => [row])
            : fibonacci(ATTITUDES).map((direction) => directionRows(surface, direction));
    const along = informationAlong(surface, perDeg / own);
    const now = informationOf(covariance);
    const target = (targetDeg / DEG) ** 2;
    let paths = begun(now, start, data, along);
    let variances = paths.map((path) => variancesOf(wanted, path.information));
    for (let step = 1; step < numbers.PATH_STEPS && !variances.some((each) => Math.max(...each) <= target); step++) {
        paths = extended(lowest(paths, sharpMeans(variances)).slice(0, numbers.BEAM), nodes, along);
        variances = paths.map((path) => variancesOf(wanted, path.information));
    }
    const worst = variances.map((each) => Math.max(...each));
    const scores = worst.some((each) => each <= target) ? worst : sharpMeans(variances);
    const best = paths.indexOf(lowest(paths, scores)[0]);
    return {
        waypoints: paths[best].nodes.map((node) => nodes[node]),
        worstDeg: DEG * Math.sqrt(Math.max(...variancesOf(wanted, now))),
        afterDeg: DEG * Math.sqrt(worst[best]),
    };
}

/**
 * @param {Path[]} paths
 * @param {number[]} scores
 * @returns {Path[]}
 */
function lowest(paths, scores) {
    const order = paths.map((_, i) => i).sort((one, other) => scores[one] - scores[other]);
    return order.map((i) => paths[i]);
}

/**
 * Inverse of a covariance; what a method holds counts as known very well.
 * @param {ArrayLike<number>} covariance
 * @returns {Float64Array}
 */
function informationOf(covariance) {
    const { values, vectors } = eigen(covariance, 9);
    const information = new Float64Array(81);
    vectors.forEach((vector, i) => addRows(information, [vector], 1 / Math.max(values[i], FLOOR * values[8])));
    return information;
}

/**
 * Variances of what is wanted, summed over the components of each.
 * @param {number[][][]} wanted
 * @param {Float64Array} information
 * @returns {number[]}
 */
function variancesOf(wanted, information) {
    const { inverse } = inverted(information, 9);
    return wanted.map((rows) => rows.reduce((sum, row) => sum + variance(row, inverse), 0));
}

/**
 * Information of the readings along a great circle.
 * @param {Surface} surface
 * @param {number} weight Of a degree.
 * @returns {(from: number[], to: number[]) => Float64Array}
 */
function informationAlong(surface, weight) {
    return (from, to) => {
        const angle = Math.acos(Math.min(Math.max(dot(from, to), -1), 1));
        const information = new Float64Array(81);
        const rows = Array.from({ length: BETWEEN }, (_, i) => {
            const share = (i + 0.5) / BETWEEN;
            const [near, far] = [Math.sin((1 - share) * angle), Math.sin(share * angle)];
            return jacobian(surface, from.map((part, axis) => (near * part + far * to[axis]) / Math.sin(angle)));
        });
        addRows(information, rows, (weight * DEG * angle) / BETWEEN);
        return information;
    };
}

/**
 * Paths from where the field points to each waypoint in reach.
 * @param {Float64Array} now
 * @param {number[]} start
 * @param {EngineData} data
 * @param {(from: number[], to: number[]) => Float64Array} along
 * @returns {Path[]}
 */
function begun(now, start, { nodes, numbers }, along) {
    const angles = nodes.map((node) => DEG * Math.acos(Math.min(Math.max(dot(node, start), -1), 1)));
    const reached = nodes.map((_, i) => i).filter((i) => angles[i] > numbers.NEAREST_DEG && angles[i] < numbers.FARTHEST_DEG);
    return reached.map((node) => ({ information: sum(now, along(start, nodes[node])), nodes: [node] }));
}

/**
 * Go on from the end of each path to each neighbour, but not straight back.
 * @param {Path[]} paths
 * @param {number[][]} nodes
 * @param {(from: number[], to: number[]) => Float64Array} along
 * @returns {Path[]}
 */
function extended(paths, nodes, along) {
    const least = Math.cos(NEIGHBOUR_DEG / DEG);
    return paths.flatMap(({ information, nodes: passed }) => {
        const [before, here] = [passed.at(-2), passed[passed.length - 1]];
        const near = nodes.map((_, i) => i).filter((i) => i !== here && i !== before && dot(nodes[i], nodes[here]) > least);
        return near.map((node) => ({
            information: sum(information, along(nodes[here], nodes[node])),
            nodes: [...passed, node],
        }));
    });
}

/**
 * @param {Float64Array} one
 * @param {Float64Array} other
 * @returns {Float64Array}
 */
function sum(one, other) {
    return one.map((part, i) => part + other[i]);
}

/**
 * How to turn the sensor so that the field's direction goes along a path, in at most two turns.
 * @param {number[][]} path
 * @param {EngineData} data
 * @returns {string}
 */
function turns(path, data) {
    const each = path.slice(1).map((there, i) => turn(there, path[i], data));
    return each.filter((words, i) => words !== each[i - 1]).slice(0, 2).join(", then ");
}

/**
 * The turn about the axis that it is mostly about: the field stays, so that the body turns the other way.
 * @param {number[]} there
 * @param {number[]} here
 * @param {EngineData} data
 * @returns {string}
 */
function turn([a, b, c], [x, y, z], { turns: words }) {
    const axis = [b * z - c * y, c * x - a * z, a * y - b * x];
    const main = axis.reduce((most, part, i) => (Math.abs(part) > Math.abs(axis[most]) ? i : most), 0);
    return words[main][axis[main] < 0 ? 1 : 0];
}
