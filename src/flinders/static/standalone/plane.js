/**
 * Whether readings may be those of a level turn, but for outliers: `flinders.estimators.auto.hides_plane`. The program
 * then calibrates the turn; this page does not, and leaves out what such readings cannot tell of their axes.
 */

import { dot, eigen } from "./linear.js";
import { threes } from "./coverage.js";

/** @typedef {import("./data.d.ts").EngineData} EngineData */

/**
 * @param {Float64Array} near Readings that are no outliers.
 * @param {EngineData} data
 * @returns {boolean}
 */
export function hidesPlane(near, { numbers }) {
    let places = threes(near);
    if (places.length < numbers.FEWEST_LEFT) return false;
    for (let trim = 0; trim < numbers.TRIMS; trim++) {
        const { local, vectors } = principal(places);
        const across = local.map((place) => Math.abs(dot(place, vectors[0])));
        const last = Math.floor((1 - numbers.TRIMMED) * (places.length - 1));
        const limit = [...across].sort((one, other) => one - other)[last];
        places = places.filter((_, i) => across[i] <= limit);
    }
    const { values, vectors } = principal(places);
    const isFlat = Math.sqrt(Math.max(values[0], 0)) < numbers.FLATTEST * Math.sqrt(values[2]);
    return isFlat && Math.abs(vectors[0][2]) > numbers.UPRIGHT;
}

/**
 * Places about their mean, their variances along principal axes, ascending, and these.
 * @param {number[][]} places
 */
export function principal(places) {
    const mean = [0, 1, 2].map((axis) => places.reduce((sum, place) => sum + place[axis], 0) / places.length);
    const local = places.map((place) => place.map((part, axis) => part - mean[axis]));
    const products = [0, 1, 2].flatMap((i) =>
        [0, 1, 2].map((j) => local.reduce((sum, place) => sum + place[i] * place[j], 0) / places.length),
    );
    return { mean, local, ...eigen(products, 3) };
}
