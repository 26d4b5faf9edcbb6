/** Nearest of many. */

/**
 * The number with the smallest distance.
 * @param {number} count
 * @param {(number: number) => number} distance
 * @param {number} [most]  farther ones do not count
 * @returns {number | null}
 */
export function nearestOf(count, distance, most = Infinity) {
    let [best, least] = [/** @type {number | null} */ (null), most];
    for (let j = 0; j < count; j++) {
        const far = distance(j);
        if (far < least) [best, least] = [j, far];
    }
    return best;
}
