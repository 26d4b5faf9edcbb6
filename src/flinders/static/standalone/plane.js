/** Places about their mean, and their principal axes. */

import { eigen } from "./linear.js";

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
