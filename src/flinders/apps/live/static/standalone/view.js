/** View of a fit for the page, as in `flinders.report.view`. */

import { guide, isIdle, nextMovement } from "./advice.js";
import { correctedVectors, threes, tileCounts, tilesOf } from "./coverage.js";
import { adviceOf, firstCauses, plainValues, remedyOf, stepWords, verdictOf, whyOf } from "./findings.js";
import { headline } from "./headline.js";
import { tiles } from "./tiles.js";
import { ANY_ANGLE_DEG } from "./wording.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./advice.js").Goal} Goal */
/** @typedef {import("./advice.js").Frame} Frame */
/** @typedef {import("./findings.js").Finding} Finding */
/** @typedef {[number, number, number]} Triple */

const BINS = 40;
const WIDEST = 4;
const RAD = Math.PI / 180;
export const EVERYWHERE = "turn it slowly through all directions, away from iron and from currents";

/**
 * @param {Fit} fit
 * @param {Finding[]} findings
 * @param {{field: Float64Array, numbers: ArrayLike<number> | null, goal: Goal, frame: Frame}} given
 * @returns {View}
 */
export function viewOf(fit, findings, { field, numbers, goal, frame }) {
    const verdict = verdictOf(fit);
    const shown = firstCauses(fit);
    const isFlat = findings.some(({ code }) => code === "one-plane");
    const used = isFlat ? new Float64Array(0) : field.filter((_, i) => !fit.left.isOut[Math.floor(i / 3)]);
    const vectors = correctedVectors(used, fit.surface);
    const { centres } = tiles();
    const errors = fit.engine.attitudeErrorsDeg(fit.surface.shape, fit.claimed, fit.headingError.dipDeg, centres);
    const shownErrors = errors.map((error) => (!isFlat && error < ANY_ANGLE_DEG ? roundDegrees(error) : null));
    const turn = fit.turn;
    return {
        verdict,
        sentence: sentenceOf(fit, shown, verdict),
        condition: fit.data.resting[fit.judgement.conditions],
        method: fit.method,
        unit: fit.unit,
        field_strength_known: fit.isStrengthKnown,
        samples: fit.samples,
        findings: shown.map((finding) => viewOfFinding(finding, fit.data)),
        tiles_deg: shownErrors,
        tiles_seen: tileCounts(vectors, centres),
        rejected: rejectedRuns(fit, numbers),
        ...(verdict === "refused" ? UNTOLD : correctionView(fit, turn)),
        ...(isFlat ? UNDRAWN : { ...surfaceView(fit, vectors), ...claimView(fit, turn, errors, goal, frame) }),
    };
}

/**
 * The first sentence of the verdict.
 * @param {Fit} fit
 * @param {Finding[]} shown  first causes
 * @param {View["verdict"]} verdict
 * @returns {string}
 */
function sentenceOf({ data, targetDeg, headingError, headingBoundDeg, attitudeLimitDeg }, shown, verdict) {
    const { leads, reaches, numbers, said, rows } = data;
    const [first] = verdict === "good" ? [] : shown;
    const why = first ? whyOf(first, data) : "";
    const affects = rows.find(({ code }) => code === first?.code)?.affects ?? "claim";
    const cause = first ? { affects, why: why.charAt(0).toLowerCase() + why.slice(1), remedy: remedyOf(first, data) } : null;
    const claim = { worstDeg: headingError.worst, boundDeg: headingBoundDeg, targetDeg, limitDeg: attitudeLimitDeg };
    return headline(claim, cause, verdict, { leads, reaches, leftOut: said["left-out"], smallErrorDeg: numbers.SMALL_ERROR_DEG });
}

/**
 * A finding with its sentence.
 * @param {Finding} finding
 * @param {import("./data.d.ts").EngineData} data
 * @returns {View["findings"][number]}
 */
function viewOfFinding(finding, data) {
    const { code, severity, number, limit } = finding;
    return { code, severity, number: finiteOrNull(number), limit: finiteOrNull(limit), advice: adviceOf(finding, data), values: plainValues(finding) };
}

const UNTOLD = {
    field_strength: null, offset: null, offset_sigma: null, matrix: null, matrix_sigma: null,
    uncorrected_heading_error_deg: null,
}; // prettier-ignore
const UNDRAWN = {
    noise: null, residuals: null, shown: null, heading_error_deg: null, attitude_limit_deg: null, any_attitude_deg: null,
    turn: null, level_deg: null, guidance: null,
}; // prettier-ignore

/**
 * A number for JSON: null if not finite.
 * @param {number} number
 * @returns {number | null}
 */
function finiteOrNull(number) {
    return Number.isFinite(number) ? number : null;
}

/** @param {number[]} numbers */
function rootMeanSquare(numbers) {
    return Math.sqrt(numbers.reduce((sum, number) => sum + number * number, 0) / numbers.length);
}

/**
 * @param {number} degrees
 * @returns {number}
 */
function roundDegrees(degrees) {
    return Math.round(degrees * 1e4) / 1e4;
}

/**
 * @param {ArrayLike<number>} numbers
 * @returns {[Triple, Triple, Triple]}
 */
function rowsOf(numbers) {
    return /** @type {[Triple, Triple, Triple]} */ (threes(numbers));
}

/**
 * @param {ArrayLike<number>} numbers
 * @returns {Triple}
 */
function triple(numbers) {
    return [numbers[0], numbers[1], numbers[2]];
}

/**
 * The correction for copying, which a refused fit does not have.
 * @param {Fit} fit
 * @param {Fit["turn"]} turn
 */
function correctionView({ engine, surface, strength, isStrengthKnown, covariance }, { deviationDeg }) {
    const matrix = surface.inverse.map((part) => strength * part);
    return {
        field_strength: strength,
        offset: triple(surface.centre),
        offset_sigma: triple([0, 10, 20].map((i) => Math.sqrt(covariance[i]))),
        matrix: rowsOf(matrix),
        matrix_sigma: rowsOf(engine.matrixSigmas(matrix, surface.shape, covariance, isStrengthKnown)),
        uncorrected_heading_error_deg: { rms: rootMeanSquare(deviationDeg), worst: Math.max(...deviationDeg.map(Math.abs)) },
    };
}

/**
 * Parts of the view that depend on the surface.
 * @param {Fit} fit
 * @param {Float64Array} vectors Of the readings used.
 */
function surfaceView({ surface, strength, noise, plane }, vectors) {
    return {
        noise,
        residuals: histogram(lengthsOff(vectors, plane), strength, noise),
        shown: {
            offset: triple(surface.centre),
            matrix: rowsOf(surface.inverse.map((part) => strength * part)),
            strength,
        },
    };
}

/**
 * Differences of the corrected lengths from the field strength; for a level turn, from their mean in its plane.
 * @param {Float64Array} vectors
 * @param {Fit["plane"]} plane
 * @returns {number[]}
 */
function lengthsOff(vectors, plane) {
    const lengths = threes(vectors).map(([x, y, z]) => (plane ? Math.hypot(x, y) : Math.hypot(x, y, z)));
    const mean = plane ? lengths.reduce((sum, length) => sum + length, 0) / lengths.length : 1;
    return lengths.map((length) => length - mean);
}

/**
 * Histogram of the distances of corrected readings from the sphere.
 * @param {number[]} lengths In units of the radius.
 * @param {number} radius
 * @param {number} noise
 */
function histogram(lengths, radius, noise) {
    const widest = Math.max(WIDEST * noise, Number.MIN_VALUE);
    const counts = new Array(BINS).fill(0);
    for (const length of lengths) {
        const off = radius * length;
        counts[Math.min(Math.max(Math.floor((BINS * (off + widest)) / (2 * widest)), 0), BINS - 1)]++;
    }
    return { edges: Array.from({ length: BINS + 1 }, (_, i) => widest * ((2 * i) / BINS - 1)), counts };
}

/**
 * Parts of the view that also depend on the covariance.
 * @param {Fit} fit
 * @param {Fit["turn"]} turn
 * @param {number[]} errors
 * @param {Goal} goal
 * @param {Frame} frame
 */
function claimView(fit, { headingDeg, deviationDeg, sigmaDeg }, errors, goal, frame) {
    const { headingError } = fit;
    return {
        heading_error_deg: {
            rms: headingError.rms,
            worst: headingError.worst,
            bound_95: fit.headingBoundDeg,
            dip_deg: headingError.dipDeg,
            dip_assumed: fit.dipAssumed,
            target_deg: fit.targetDeg,
        },
        attitude_limit_deg: fit.attitudeLimitDeg,
        any_attitude_deg: {
            rms: rootMeanSquare(errors),
            worst: Math.max(...errors),
        },
        turn: {
            heading_deg: headingDeg.map(roundDegrees),
            before_deg: deviationDeg.map(roundDegrees),
            sigma_deg: sigmaDeg.map(roundDegrees),
        },
        level_deg: fit.plane && goal === "heading" ? levelErrors(fit, { headingDeg, sigmaDeg }) : null,
        guidance: guidance(fit, goal, frame),
    };
}

/**
 * Heading errors of a level vehicle on the tiles of its field; null on the others.
 * @param {Fit} fit
 * @param {{headingDeg: number[], sigmaDeg: number[]}} turn
 * @returns {(number | null)[]}
 */
function levelErrors({ headingError }, { headingDeg, sigmaDeg }) {
    const dip = headingError.dipDeg * RAD;
    const { centres } = tiles();
    /** @type {(number | null)[]} */
    const errors = new Array(centres.length / 3).fill(null);
    const directions = headingDeg.flatMap((heading) => {
        const [north, east] = [Math.cos(heading * RAD), Math.sin(heading * RAD)];
        return [Math.cos(dip) * north, -Math.cos(dip) * east, Math.sin(dip)];
    });
    tilesOf(Float64Array.from(directions), centres).forEach((tile, i) => {
        const error = roundDegrees(sigmaDeg[i]);
        if (error < ANY_ANGLE_DEG) errors[tile] = Math.max(errors[tile] ?? 0, error);
    });
    return errors;
}

/**
 * Advice on the next turn, for a goal.
 * @param {Fit} fit
 * @param {Goal} goal
 * @param {Frame} frame
 * @returns {import("../../../../static/view.d.ts").GuidanceView}
 */
function guidance(fit, goal, frame) {
    const advice = guide(fit, goal, frame);
    const isOpen = fit.plane || isIdle(advice, fit.data);
    const step = nextMovement(fit);
    const around = fit.plane ? stepWords(step, fit.data) : EVERYWHERE;
    return {
        direction: isOpen ? null : triple(advice.direction),
        words: isOpen ? around : advice.words,
        worst_deg: Math.hypot(advice.worstDeg, fit.structureDeg),
        after_deg: Math.hypot(advice.afterDeg, fit.structureDeg),
        goal,
        frame,
        is_path: false,
        code: !isOpen ? "" : fit.plane ? step[0] : "everywhere",
    };
}

/**
 * Numbers of the first and last reading of each run left out.
 * @param {Fit} fit
 * @param {ArrayLike<number> | null} numbers
 * @returns {[number, number][]}
 */
function rejectedRuns({ left: { isRail, outliers } }, numbers) {
    const numbered = (/** @type {number} */ i) => numbers?.[i] ?? i;
    const free = Array.from(isRail.keys()).filter((i) => !isRail[i]);
    /** @type {[number, number][]} */
    const runs = outliers.map(({ first, last }) => [free[first - 1], free[last - 1]]);
    isRail.forEach((is, i) => {
        if (is && !isRail[i - 1]) runs.push([i, i]);
        else if (is) runs[runs.length - 1][1] = i;
    });
    const ordered = runs.sort(([one], [other]) => one - other);
    return ordered.map(([first, last]) => [numbered(first), numbered(last)]);
}
