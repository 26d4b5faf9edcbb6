/** The first sentence of a verdict: `flinders.findings.headline`, whose words are data. */

import { remedyOf, whyOf } from "./findings.js";
import { figures, general } from "./numbers.js";
import { ANY_ANGLE_DEG, fillTemplate, UPSIDE_DOWN } from "./wording.js";

/** @typedef {import("./fit.js").Fit} Fit */
/** @typedef {import("./findings.js").Finding} Finding */
/** @typedef {import("../../../../static/view.d.ts").View["verdict"]} Verdict */

/**
 * The first sentence of the verdict on a fit.
 * @param {Fit} fit
 * @param {Finding[]} shown First causes.
 * @param {Verdict} verdict
 * @returns {string}
 */
export function headline(fit, shown, verdict) {
    const { data, targetDeg } = fit;
    const { leads, reaches, numbers, said } = data;
    const cause = verdict === "good" ? undefined : shown[0];
    const kind = kindOf(fit, cause, verdict);
    const why = cause ? whyOf(cause, data) : "";
    const takes = leads[kind].includes("{reach}") || leads[kind].includes("{beyond}");
    const [, reach, beyond] = (takes && reaches.find(([end]) => end === null || fit.attitudeLimitDeg < end)) || [0, "", ""];
    /** @type {Record<string, string | number>} */
    const values = {
        reach: fillTemplate(reach, () => fit.attitudeLimitDeg),
        beyond,
        error: leads[kind].includes("{error}") ? errorWords(fit) : "",
        target: `${general(targetDeg)}°`,
        why: why.charAt(0).toLowerCase() + why.slice(1),
    };
    const lead = `${fillTemplate(leads[kind], (name) => values[name]).replace(/\.$/, "")}.`;
    const isSmall = kind === "good" && fit.headingError.worst < numbers.SMALL_ERROR_DEG;
    return [lead, cause ? remedyOf(cause, data) : "", isSmall ? said["left-out"] : ""].filter(Boolean).join(" ");
}

/**
 * Kind of the first sentence of a verdict.
 * @param {Fit} fit
 * @param {Finding | undefined} cause
 * @param {Verdict} verdict
 * @returns {string}
 */
function kindOf(fit, cause, verdict) {
    if (!cause) return "good";
    const affects = fit.data.rows.find(({ code }) => code === cause.code)?.affects ?? "claim";
    const { worst } = fit.headingError;
    if (verdict === "refused" && affects !== "error") return "refused";
    if (verdict === "refused") return worst < ANY_ANGLE_DEG ? "refused-error" : "refused-unknown";
    if (!(worst < ANY_ANGLE_DEG)) return "unknown";
    const isAbove = worst > fit.targetDeg;
    if (affects === "error" || isAbove) return isAbove && affects !== "claim" ? "error" : "claim";
    return affects === "attitudes" && fit.attitudeLimitDeg >= UPSIDE_DOWN ? "directions" : affects;
}

/**
 * The worst heading error, 1 σ, and its bound, with enough digits to differ from the target.
 * @param {Fit} fit
 * @returns {string}
 */
function errorWords({ headingError: { worst }, headingBoundDeg, targetDeg }) {
    if (!(worst < ANY_ANGLE_DEG)) return "any angle";
    const digits = [2, 3, 4].find((count) => figures(worst, count) !== figures(targetDeg, count)) ?? 2;
    const bound = headingBoundDeg < ANY_ANGLE_DEG ? `95 % within ${figures(headingBoundDeg)}°` : "1 σ";
    return `${figures(worst, digits)}° (${bound})`;
}
