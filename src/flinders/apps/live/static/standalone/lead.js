/**
 * The present instruction of the page: a turn of the sequence, then an arrow to the remaining gap, then Finish.
 *
 * Words and drawing change together. An instruction stays for at least three seconds, a direction until the field points
 * there or for five seconds, and there are at most twelve changes a minute. Only a fault, a pause and the end of a recording
 * are shown at once. Uses no clock and no page.
 */

import { goesOn } from "../store.js";
import { between, DRAWN, rotated } from "../../../../static/views/turn.js";
import { correctReading, dot, unit } from "../../../../static/views/vectors.js";
import { brief, faultTitle, sentence } from "../views/words.js";
import { isOver, progress, SEQUENCES, staysLevel } from "./choreography.js";
import { gapOf } from "./gaps.js";
import { languageCode, phrase, translation } from "../language.js";

/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {import("./choreography.js").Body} Body */
/** @typedef {import("./choreography.js").Choreography} Choreography */

/**
 * The present instruction.
 * @typedef {object} Lead
 * @property {"wait" | "turn" | "arrow" | "around" | "done" | "wrong" | "ended" | "finished"} kind  `around`: all directions help equally
 * @property {string} words
 * @property {Body} body
 * @property {number} step  counted from 1
 * @property {number} of
 * @property {number} progress  of the step, 0 to 1
 * @property {Vector | null} target  wanted direction of the field, in axes of the corrected sensor
 * @property {number} since  time of its first showing
 * @property {readonly number[]} changes  times of changes in the last minute
 */

/**
 * Inputs of a lead.
 * @typedef {object} Known
 * @property {number} at  seconds
 * @property {State} state
 * @property {View | null} view
 * @property {Choreography} choreography
 * @property {Vector | null} raw  the newest reading
 * @property {readonly number[]} centres  of the tiles of the sphere
 */

/** Shortest duration of an instruction, and longest duration of a target that is not reached, s. */
const [STANDS_S, TARGET_S] = [3, 5];
/** Largest number of changes of words in a period, and the period, s. */
const [MOST, WITHIN_S] = [12, 60];
/** Kinds of instructions that are shown at once. */
const AT_ONCE = ["wrong", "ended", "finished", "wait"];
/** Angle within which a target counts as reached, radians. */
const TARGET_ANGLE = 0.3;
/** Smallest radius of a gap to be closed, radians; the finding `coverage` begins at 60°. */
const GAP = 0.96;

/**
 * @param {Lead | null} before
 * @param {Known} known
 * @returns {Lead}
 */
export function lead(before, known) {
    const wanted = wantedLead(known);
    if (!before) return { ...wanted, since: known.at, changes: [] };
    if (wanted.words === before.words && wanted.kind === before.kind && wanted.kind !== "arrow") {
        return { ...before, ...wanted };
    }
    if (stands(before, wanted, known)) return { ...before, progress: standing(before, known) };
    const changes = before.changes.filter((when) => when > known.at - WITHIN_S);
    return { ...wanted, since: known.at, changes: [...changes, known.at] };
}

/** @typedef {Omit<Lead, "since" | "changes">} Asked */

/**
 * Instruction without regard to the previous one.
 * @param {Known} known
 * @returns {Asked}
 */
function wantedLead(known) {
    const { state, view, choreography, raw } = known;
    const { body } = choreography;
    /** @type {(kind: Lead["kind"], words: string, target?: Vector | null) => Asked} */
    const plain = (kind, words, target = null) => ({ kind, words, body, step: 0, of: 0, progress: 0, target });
    if (state.phase === "wrong") return plain("wrong", sentence(brief(state.words)[0]));
    if (state.finished) return plain(...finishedWords(state, view));
    if (!goesOn(state) && state.readings > 0) return plain("ended", endedWords(state, view));
    if (state.phase === "waiting") return plain("wait", "");
    if (state.paused) return plain("wait", phrase("lead.paused", "Paused: press Go on, and turn it again."));
    if (state.phase === "good") return plain("done", phrase("lead.done", "Done: press Finish, or keep turning to make it better."));
    if (staysLevel(body) && state.phase === "limited") return plain("done", phrase("lead.done-level", "Done, for level headings: press Finish."));
    if (!isOver(choreography)) return turn(choreography);
    if (staysLevel(body)) return plain("around", phrase("lead.circle", "One more slow circle, level as before."));
    const direction = targetOf(known);
    if (!direction && state.phase === "limited") return plain("done", phrase("lead.enough", "Good enough: press Finish, or keep turning to lift the limits."));
    if (!direction || !view?.shown || !raw) return plain("around", around());
    const { axis } = between(direction, unit(correctReading(raw, view.shown)));
    return plain("arrow", turnAbout(rotated(DRAWN[view.guidance?.frame ?? "sensor"], axis), body), direction);
}

/**
 * Wanted direction of the field: the middle of the largest gap, else that of the most useful readings.
 * @param {Known} known
 * @returns {Vector | null}
 */
function targetOf({ state, view, centres }) {
    if (!view?.shown) return null;
    if (view.tiles_seen.some((count) => count > 0)) {
        const { direction, far } = gapOf(view, centres);
        if (far > GAP) return direction;
    }
    return state.phase === "limited" ? null : (view.guidance?.direction ?? null);
}

/**
 * @param {Choreography} choreography
 * @returns {Asked}
 */
function turn(choreography) {
    const { body, step } = choreography;
    const steps = SEQUENCES[body];
    const words = phrase(`turn.${body === "phone" ? "board" : body}.${step + 1}`, steps[step].words); // a phone is turned like a board
    return { kind: "turn", words, body, step: step + 1, of: steps.length, progress: progress(choreography), target: null };
}

/**
 * Words on a finished calibration.
 * @param {State} state
 * @param {View | null} view
 * @returns {[Lead["kind"], string]}
 */
function finishedWords({ phase, told, words }, view) {
    if (phase === "good" || phase === "limited") return ["finished", phrase("lead.finished", "Finished: this calibration stays as it is.")];
    if (view === null || told === "fitting") return ["ended", words];
    return ["ended", phrase("lead.finished-misses", "Finished, and it misses the target: press Collect more, and {next}", { next: goOn(view) })];
}

/**
 * Words on a recording that has ended.
 * @param {State} state
 * @param {View | null} view
 */
function endedWords({ phase, told, words, reasons }, view) {
    if (phase === "good" || phase === "limited") return phrase("lead.ended-done", "Done: press Finish.");
    if (told === "fitting") return words;
    const disturbed = reasons.find(({ spans }) => spans.length > 0);
    if (disturbed) return `${faultTitle(disturbed.code)} ${phrase("lead.disturbed", "Leave the interval out, or record again.")}`.trim();
    const next = goOn(view);
    return view === null
        ? phrase("lead.ended-none", "The recording has ended: record again, and {next}", { next })
        : phrase("lead.ended", "The recording has ended: press Finish, or record again and {next}", { next });
}

/**
 * Words on the next turn, for the middle of a sentence.
 * @param {View | null} view
 */
function goOn(view) {
    const guidance = view?.guidance ?? null;
    if (languageCode() !== "en") return (translation(`step.${guidance?.code}`) ?? around()).replace(/^\p{L}/u, (letter) => letter.toLowerCase());
    const isSaid = guidance && !guidance.is_path && (guidance.direction === null || guidance.frame === "vehicle");
    const next = isSaid ? sentence(guidance.words) : around();
    return next.replace(/^\w/, (letter) => letter.toLowerCase());
}

/**
 * Whether the previous instruction still applies.
 * @param {Lead} before
 * @param {Asked} wanted
 * @param {Known} known
 */
function stands(before, wanted, { at, view, raw }) {
    if (AT_ONCE.includes(wanted.kind) || AT_ONCE.includes(before.kind)) return false;
    if (before.changes.filter((when) => when > at - WITHIN_S).length >= MOST) return true;
    if (wanted.kind === "done") return false;
    if (at - before.since < STANDS_S) return true;
    if (before.kind !== "arrow" || wanted.kind !== "arrow") return false;
    return at - before.since < TARGET_S && !isReached(before.target, raw, view);
}

/**
 * @param {Vector | null} target
 * @param {Vector | null} raw
 * @param {View | null} view
 */
function isReached(target, raw, view) {
    if (!target || !raw || !view?.shown) return true;
    return dot(target, unit(correctReading(raw, view.shown))) > Math.cos(TARGET_ANGLE);
}

/**
 * Progress of the present instruction; a completed turn stays complete while its words are shown.
 * @param {Lead} before
 * @param {Known} known
 */
function standing(before, { choreography }) {
    if (before.kind !== "turn") return before.progress;
    const isPresent = before.body === choreography.body && before.step === choreography.step + 1;
    return isPresent ? progress(choreography) : 1;
}

/** @returns {string} The advice where no direction is better than the others. */
function around() {
    return phrase("lead.around", "Turn it slowly through all directions.");
}

/** The end that points away from the user. @type {Readonly<Record<Body, string>>} */
export const FRONTS = { board: "its far edge", phone: "its top", drone: "its nose", car: "its nose", boat: "its bow", instrument: "its front" };

/**
 * Words of a turn about its main axis, right-handed or left-handed, seen from behind.
 * @param {Vector} axis  to its right, to its front, out of its face
 * @param {Body} body
 */
function turnAbout(axis, body) {
    const main = [0, 1, 2].reduce((most, i) => (Math.abs(axis[i]) > Math.abs(axis[most]) ? i : most), 0);
    const isLeft = axis[main] < 0;
    const front = phrase(`front.${body}`, FRONTS[body]);
    if (main === 0) return isLeft ? phrase("arrow.lower", "Now lower {front}.", { front }) : phrase("arrow.raise", "Now raise {front}.", { front });
    if (main === 1) return isLeft ? phrase("arrow.right-side", "Now raise its right side.") : phrase("arrow.left-side", "Now raise its left side.");
    return isLeft ? phrase("arrow.right", "Now turn it to the right.") : phrase("arrow.left", "Now turn it to the left.");
}
