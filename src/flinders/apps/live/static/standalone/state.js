/** State of a session in words and numbers, for the page. */

import { capital, clock, sourceTitle } from "../views/words.js";
import { strideFor } from "./buffer.js";
import { figures, fixedText, general } from "./numbers.js";
import { labelOf } from "./session.js";
import { ANY_ANGLE_DEG } from "./wording.js";
import { numeral, phrase } from "../language.js";
import { conditionOf, reasonWords, refusalWords, sentenceOf } from "../verdict_words.js";

/** @typedef {import("./session.js").Session} Session */
/** @typedef {import("../messages.d.ts").Reason} Reason */
/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../../../../static/view.d.ts").View} View */

const RATE_STEPS = 2;

/**
 * @param {Session} session
 * @returns {State}
 */
export function sessionState(session) {
    const { shown, live } = session;
    const { buffer, evaluated, exclusions, excluded } = shown;
    const [phase, words, told, reasons] = session.keptInstead ? ofKept(session, session.keptInstead) : phaseOf(session);
    const [dipDeg, dipAssumed] = session.judgedDip;
    return {
        type: "state",
        source: session.source,
        unit: labelOf(shown.unit),
        readings: buffer.total,
        used: evaluated.used,
        rejected: evaluated.rejected,
        excluded_readings: buffer.countWithin(excluded),
        rate_hz: rateHz(session),
        seconds: shown.isTimed ? buffer.seconds : null,
        phase,
        words,
        told,
        reasons,
        target_deg: session.targetDeg,
        dip_deg: shownDip(session.dipDeg, dipDeg),
        dip_assumed: dipAssumed,
        goal: session.goal,
        excluded,
        can_undo: exclusions.past.length > 0,
        can_redo: exclusions.future.length > 0,
        stride: shownStride(session),
        paused: live.pausedAt !== null,
        finished: shown.finishedS === null ? null : { seconds: shown.finishedS, since: shown.since },
        recording: session.recording || null,
        previous: session.previous && evaluated.previous,
        refreshing: session.isRenewed,
        opened: session.openedName || null,
        kept: shown.finishedS !== null || shown.kept === null ? null : { seconds: shown.kept.seconds, is_changed: session.isChanged },
        can_send: session.hasBoard && session.opened === null && session.held.record !== null,
    };
}

/**
 * Dip to show; that of a place is rounded to 0.1°.
 * @param {number | null} typed
 * @param {number} dipDeg
 * @returns {number}
 */
function shownDip(typed, dipDeg) {
    const isExact = typed !== null && Number(fixedText(typed, 2)) === typed;
    return isExact ? typed : Number(fixedText(dipDeg, 1));
}

/**
 * Readings a second by their own times, over the last two seconds.
 * @param {Session} session
 * @returns {number | null}
 */
function rateHz({ arrivals, at, rules }) {
    if (arrivals.length < 2) return null;
    const [first, before, last] = [arrivals[0], arrivals[arrivals.length - 2], arrivals[arrivals.length - 1]];
    const isSilent = at - last[0] >= Math.max(rules.rate_s, RATE_STEPS * (last[0] - before[0]));
    if (isSilent || last[1] <= first[1]) return null;
    return arrivals.slice(1).reduce((sum, [, , count]) => sum + count, 0) / (last[1] - first[1]);
}

/**
 * Phase of the session, a sentence about it, the code of the reason in that sentence, and all reasons against it.
 * @param {Session} session
 * @returns {[State["phase"], string, string | null, Reason[]]}
 */
function phaseOf(session) {
    const reasons = [...(session.opened ? [] : ofLink(session)), ...currentReasons(session), ...recordingReasons(session)];
    const wrong = reasons.find(({ severity }) => severity === "warning");
    if (wrong) return ["wrong", sentence(wrong.advice), wrong.code, reasons];
    if (session.shown.buffer.total === 0 && session.source.link !== "ended") {
        return ["waiting", phrase("state.waiting", "Waiting for readings from {name}.", { name: sourceTitle(session.source.name) }), null, reasons];
    }
    const { view } = session.shown.evaluated;
    if (view === null) return ["collecting", ...beforeAFit(session), reasons];
    return [...ofView(session, view), null, reasons];
}

/**
 * Phase while a kept fit replaces a worse, newer fit; the reasons of the newer fit are shown as information.
 * @param {Session} session
 * @param {import("./session.js").Kept} kept
 * @returns {[State["phase"], string, string | null, Reason[]]}
 */
function ofKept(session, { view, seconds }) {
    const [, newest, , reasons] = phaseOf(session);
    const time = clock(seconds);
    const good = phrase("state.good", "Good: {done}.", { done: expectedError(session, view) });
    const verdict = view.verdict === "good" ? good : sentenceOf(view);
    const held = phrase("state.kept", "{verdict} That is of what came up to {time}, which is kept.", { verdict, time });
    const told = /** @type {Reason[]} */ (reasons.map((reason) => ({ ...reason, severity: "info" })));
    const changed = { code: "changed-since", advice: phrase("state.changed", "something changed since {time}: {newest}", { time, newest }), severity: /** @type {const} */ ("info"), spans: [] };
    return [view.verdict === "good" ? "good" : "limited", held, null, session.isChanged ? [changed, ...told] : told];
}

/**
 * Expected error of a fit in words, with the bound for all headings if headings are the goal.
 * @param {Session} session
 * @param {View} view
 */
function expectedError(session, view) {
    const values = { error: numeral(figures(session.worstDeg(view) ?? NaN)), bound: bound(session, view) };
    return session.goal === "heading"
        ? phrase("state.heading-error", "the worst heading error to expect is {error}° ({bound})", values)
        : phrase("state.attitude-error", "the worst error at any attitude to expect is {error}° ({bound})", values);
}

/**
 * Reasons of the newest fit; findings that further turning may end are not warnings yet.
 * @param {Session} session
 * @returns {Reason[]}
 */
function currentReasons(session) {
    /** @type {(reason: Reason) => Reason} */
    const worded = (reason) => ({ code: reason.code, advice: reasonWords(reason), severity: reason.severity, spans: reason.spans });
    /** @type {(reason: Reason) => Reason} */
    const soFar = ({ code, advice }) => ({ code, advice: phrase("state.so-far", "so far {advice}", { advice }), severity: "info", spans: [] });
    const all = session.shown.evaluated.reasons.map(worded);
    const reasons = all.map((reason) => (session.isSettled(reason.code) ? reason : soFar(reason)));
    return reasons.sort((a, b) => Number(a.severity !== "warning") - Number(b.severity !== "warning"));
}

/**
 * Phase and sentence of the newest fit.
 * @param {Session} session
 * @param {View} view
 * @returns {[State["phase"], string]}
 */
function ofView(session, view) {
    const { alarms } = session.shown.evaluated;
    const target = numeral(general(session.targetDeg));
    const worst = session.worstDeg(view);
    if (worst === null) return ["collecting", sentenceOf(view)];
    if (worst > session.targetDeg) {
        const known = worst < ANY_ANGLE_DEG
            ? phrase("state.known", "the worst error to expect is {error}° (1 σ)", { error: numeral(figures(worst)) })
            : phrase("state.unknown", "no heading is known yet");
        return ["collecting", isEnded(session)
            ? phrase("state.misses", "Misses the target: {known}, the target {target}°.", { known, target })
            : phrase("state.keep-turning", "Keep turning: {known}, the target {target}°.", { known, target })];
    }
    const done = phrase("state.done", "{expected}, the target {target}°", { expected: expectedError(session, view), target });
    if (!alarms.every((code) => session.isSettled(code))) {
        return ["collecting", phrase("state.fault", "Keep turning: {done}, but a fault was found that more readings may disprove.", { done })];
    }
    if (view.verdict === "refused") return ["wrong", sentenceOf(view)];
    if (!isSure(session)) return ["collecting", phrase("state.almost", "Almost: {done}; keep turning a little.", { done })];
    if (view.verdict === "limited") return ["limited", sentenceOf(view)];
    const good = phrase("state.good", "Good: {done}.", { done });
    return ["good", view.condition ? `${good} ${sentence(conditionOf(view))}` : good];
}

/**
 * Whether no further readings count: for a log, an ended playback or a finished calibration.
 * @param {Session} session
 */
function isEnded({ opened, source, shown }) {
    return opened !== null || source.link === "ended" || shown.finishedS !== null;
}

/**
 * Words on the bound of all headings, if that is the goal.
 * @param {Session} session
 * @param {View} view
 */
function bound({ goal }, { heading_error_deg: error }) {
    return goal !== "heading" || error === null ? "1 σ" : phrase("error.bound", "95 % within {bound}°", { bound: numeral(figures(error.bound_95)) });
}

/**
 * Whether no further fit is needed to report the target as reached: several fits agree, one is kept, or it is final.
 * @param {Session} session
 */
function isSure({ shown, isRepeated, isOver }) {
    return shown.kept !== null || isRepeated || isOver;
}

/**
 * Sentence while there is no fit, and the code of its reason.
 * @param {Session} session
 * @returns {[string, string | null]}
 */
function beforeAFit(session) {
    const { buffer, evaluated } = session.shown;
    if (buffer.total === 0) return [phrase("state.no-reading", "{name} has ended without a reading.", { name: sourceTitle(session.source.name) }), null];
    if (evaluated.reasons.some(({ code }) => code === "no-rotation")) {
        return [isEnded(session)
            ? phrase("state.not-turned", "The sensor was not turned.")
            : phrase("state.start", "Start turning: turn the sensor slowly through all directions."), null];
    }
    if (!evaluated.refusal) {
        if (isEnded(session)) return [phrase("state.looking", "Looking at the readings."), "fitting"];
        return [phrase("state.looking-first", "Looking at the first readings. Turn the sensor slowly through all directions."), null];
    }
    return [sentence(refusalWords(evaluated.refusalCode, evaluated.refusal)), evaluated.refusalCode || null];
}

/**
 * Reason why readings cannot be recorded.
 * @param {Session} session
 * @returns {Reason[]}
 */
function recordingReasons({ unrecorded: advice }) {
    return advice ? [{ code: "not-recorded", advice, severity: "info", spans: [] }] : [];
}

/**
 * Reasons why no readings arrive; only information if the calibration is finished.
 * @param {Session} session
 * @returns {Reason[]}
 */
function ofLink({ source, live: { buffer, finishedS }, at, arrivedAt, rules }) {
    const { link, words } = source;
    const name = sourceTitle(source.name);
    const since = at - arrivedAt;
    const wrong = finishedS === null ? "warning" : "info";
    /** @type {(code: string, advice: string, severity?: Reason["severity"]) => Reason[]} */
    const reason = (code, advice, severity = wrong) => [{ code, advice, severity, spans: [] }];
    if (link === "gone") return reason("gone", words || phrase("reason.gone", "{name} is gone: check the cable", { name }));
    const patience = Math.max(rules.silent_s, buffer.total ? (rules.silent_steps * buffer.seconds) / buffer.total : 0);
    if (link === "waiting" && buffer.total === 0 && words) return reason("nothing-arrives", words);
    if (["connected", "waiting"].includes(link) && buffer.total > 0 && since > patience) {
        return reason("nothing-arrives", nothingArrives(name, since), arrivedAt ? wrong : "info");
    }
    return link === "ended" ? reason("ended", words || phrase("reason.ended", "{name} has ended", { name }), "info") : [];
}

/**
 * Sentence on the time without a reading, with checks.
 * @param {string} name
 * @param {number} since
 */
function nothingArrives(name, since) {
    return phrase(
        "reason.nothing-arrives",
        "no reading has come for {seconds} s from {name}: check that the sensor is on and prints its readings, and that port, cable " +
            "and baud rate are right",
        { seconds: fixedText(since, 0), name },
    );
}

/**
 * Capitalise a sentence, unless it begins with the name of a file or port.
 * @param {string} words
 */
function sentence(words) {
    const first = words.split(" ", 1)[0].replace(/,+$/, "");
    return `${/^\p{L}+$/u.test(first) ? capital(words) : words}`.replace(/\.+$/, "") + ".";
}

/** @param {Session} session @returns {number} One of this number of readings is shown. */
export function shownStride({ shown: { buffer }, rules }) {
    return Math.max(buffer.stride, strideFor(buffer.total, rules.shown));
}
