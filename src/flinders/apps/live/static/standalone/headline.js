/** The first sentence of a verdict: `flinders.findings.headline`, whose words are data. */

import { numeral, phrase } from "../language.js";
import { figures, general } from "./numbers.js";
import { ANY_ANGLE_DEG, anyAngle, fillTemplate, UPSIDE_DOWN } from "./wording.js";

/** @typedef {import("../../../../static/view.d.ts").View["verdict"]} Verdict */
/** @typedef {Pick<import("./data.d.ts").EngineData, "leads" | "reaches"> & {leftOut: string, smallErrorDeg: number}} Tables */

/**
 * Claimed heading errors of a fit; NaN for an unknown number.
 * @typedef {{worstDeg: number, boundDeg: number, targetDeg: number, limitDeg: number}} Claim
 *
 * First cause of a verdict that is not good: what it affects, and its words.
 * @typedef {{affects: string, why: string, remedy: string}} Cause
 */

/**
 * The first sentence of the verdict on a fit.
 * @param {Claim} claim
 * @param {Cause | null} cause
 * @param {Verdict} verdict
 * @param {Tables} tables
 * @returns {string}
 */
export function headline(claim, cause, verdict, { leads, reaches, leftOut, smallErrorDeg }) {
    const kind = kindOf(claim, cause, verdict);
    const takes = leads[kind].includes("{reach}") || leads[kind].includes("{beyond}");
    const [, reach, beyond] = (takes && reaches.find(([end]) => end === null || claim.limitDeg < end)) || [0, "", ""];
    /** @type {Record<string, string | number>} */
    const values = {
        reach: fillTemplate(reach, () => claim.limitDeg),
        beyond,
        error: leads[kind].includes("{error}") ? errorWords(claim) : "",
        target: `${numeral(general(claim.targetDeg))}°`,
        why: cause?.why ?? "",
    };
    const lead = `${fillTemplate(leads[kind], (name) => values[name]).replace(/\.$/, "")}.`;
    const isSmall = kind === "good" && claim.worstDeg < smallErrorDeg;
    return [lead, cause?.remedy, isSmall ? leftOut : ""].filter(Boolean).join(" ");
}

/**
 * Kind of the first sentence of a verdict.
 * @param {Claim} claim
 * @param {Cause | null} cause
 * @param {Verdict} verdict
 * @returns {string}
 */
function kindOf({ worstDeg, targetDeg, limitDeg }, cause, verdict) {
    if (!cause) return "good";
    const { affects } = cause;
    if (verdict === "refused" && affects !== "error") return "refused";
    if (verdict === "refused") return worstDeg < ANY_ANGLE_DEG ? "refused-error" : "refused-unknown";
    if (!(worstDeg < ANY_ANGLE_DEG)) return "unknown";
    const isAbove = worstDeg > targetDeg;
    if (affects === "error" || isAbove) return isAbove && affects !== "claim" ? "error" : "claim";
    return affects === "attitudes" && limitDeg >= UPSIDE_DOWN ? "directions" : affects;
}

/**
 * The worst heading error, 1 σ, and its bound, with enough digits to differ from the target.
 * @param {Claim} claim
 * @returns {string}
 */
function errorWords({ worstDeg, boundDeg, targetDeg }) {
    if (!(worstDeg < ANY_ANGLE_DEG)) return anyAngle();
    const digits = [2, 3, 4].find((count) => figures(worstDeg, count) !== figures(targetDeg, count)) ?? 2;
    const bound = boundDeg < ANY_ANGLE_DEG ? phrase("error.bound", "95 % within {bound}°", { bound: numeral(figures(boundDeg)) }) : "1 σ";
    return `${numeral(figures(worstDeg, digits))}° (${bound})`;
}
