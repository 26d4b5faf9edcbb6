/**
 * The earth's field at sea level by the World Magnetic Model, as `flinders.core.geomag`.
 *
 * Source: NOAA/NCEI, *The US/UK World Magnetic Model for 2025–2030*, eq. 4 to 19. Its coefficients are data, taken from
 * pygeomag when the page is made.
 */

/**
 * A model: g, h and their change in a year for each degree and order, nT, in the order of the model's file.
 * @typedef {{name: string, epoch: number, years: number, coefficients: number[][]}} Model
 *
 * @typedef {{strength: number, inclinationDeg: number, declinationDeg: number}} SiteField  The strength in µT.
 */

const DEG = Math.PI / 180;
const EQUATOR_KM = 6378.137; // WGS 84
const FLATTENING = 1 / 298.257223563;
const RADIUS_KM = 6371.2; // reference radius of the coefficients
const DEGREES = 12;

/**
 * Inclination, declination and strength of the field.
 * @param {Model} model
 * @param {number} latitudeDeg  geodetic
 * @param {number} longitudeDeg
 * @param {number} year  with its fraction
 * @returns {SiteField}
 */
export function siteField({ epoch, coefficients }, latitudeDeg, longitudeDeg, year) {
    const { radius, latitude } = geocentric(latitudeDeg * DEG);
    const [north, east, down] = gradient(coefficients, year - epoch, radius, Math.PI / 2 - latitude, longitudeDeg * DEG);
    const turn = latitude - latitudeDeg * DEG;
    const x = north * Math.cos(turn) - down * Math.sin(turn);
    const z = north * Math.sin(turn) + down * Math.cos(turn);
    const level = Math.hypot(x, east);
    return {
        strength: Math.hypot(level, z) / 1000,
        inclinationDeg: Math.atan2(z, level) / DEG,
        declinationDeg: Math.atan2(east, x) / DEG,
    };
}

/**
 * Distance from the middle of the earth, km, and latitude as seen from there.
 * @param {number} latitude  geodetic, rad
 */
function geocentric(latitude) {
    const squeezed = (1 - FLATTENING) ** 2;
    const across = EQUATOR_KM / Math.sqrt(1 - (1 - squeezed) * Math.sin(latitude) ** 2);
    const [flat, height] = [across * Math.cos(latitude), across * squeezed * Math.sin(latitude)];
    return { radius: Math.hypot(flat, height), latitude: Math.atan2(height, flat) };
}

/**
 * North, east and down of the field on a sphere, nT: the sum of its harmonics.
 *
 * Of the associated Legendre functions, normalised after Schmidt, `value` is P, `slope` is ∂P/∂θ and `share` is P / sin θ,
 * which is finite at the poles, too.
 * @param {number[][]} coefficients
 * @param {number} years  since the epoch
 * @param {number} radius
 * @param {number} colatitude
 * @param {number} longitude
 * @returns {[number, number, number]}
 */
function gradient(coefficients, years, radius, colatitude, longitude) {
    const [sin, cos] = [Math.sin(colatitude), Math.cos(colatitude)];
    let [north, east, down] = [0, 0, 0];
    let first = { value: 1, slope: 0, share: 0 }; // of degree m and order m
    for (let m = 0; m <= DEGREES; m++) {
        if (m > 0) first = nextOrder(first, m, sin, cos);
        let [before, now] = [{ value: 0, slope: 0, share: 0 }, first];
        for (let n = m; n <= DEGREES; n++) {
            if (n > m) [before, now] = [now, nextDegree(before, now, n, m, sin, cos)];
            if (n === 0) continue;
            const [g, h, gYear, hYear] = coefficients[(n * (n + 1)) / 2 - 1 + m];
            const [a, b] = [g + years * gYear, h + years * hYear];
            const [c, s] = [Math.cos(m * longitude), Math.sin(m * longitude)];
            const size = (RADIUS_KM / radius) ** (n + 2);
            north += size * (a * c + b * s) * now.slope;
            east += size * m * (a * s - b * c) * now.share;
            down -= size * (n + 1) * (a * c + b * s) * now.value;
        }
    }
    return [north, east, down];
}

/** @typedef {{value: number, slope: number, share: number}} Legendre */

/**
 * Function of degree and order m from that of m - 1.
 * @param {Legendre} from
 * @param {number} m
 * @param {number} sin
 * @param {number} cos
 * @returns {Legendre}
 */
function nextOrder({ value, slope, share }, m, sin, cos) {
    const norm = m > 1 ? Math.sqrt(1 - 1 / (2 * m)) : 1;
    return { value: norm * sin * value, slope: norm * (sin * slope + cos * value), share: m > 1 ? norm * sin * share : 1 };
}

/**
 * Function of degree n from those of n - 2 and n - 1.
 * @param {Legendre} before
 * @param {Legendre} now
 * @param {number} n
 * @param {number} m
 * @param {number} sin
 * @param {number} cos
 * @returns {Legendre}
 */
function nextDegree(before, now, n, m, sin, cos) {
    const [more, less, norm] = [2 * n - 1, Math.sqrt((n - 1) ** 2 - m * m), Math.sqrt(n * n - m * m)];
    return {
        value: (more * cos * now.value - less * before.value) / norm,
        slope: (more * (cos * now.slope - sin * now.value) - less * before.slope) / norm,
        share: (more * cos * now.share - less * before.share) / norm,
    };
}
