/** Sounds for a new area, the arrow nearer, a completed step, a good calibration and a fault. Off until switched on. */

import { correctReading, dot, unit } from "../../../static/views/vectors.js";
import { recall, remember } from "./dom.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("./standalone/lead.js").Lead} Lead */
/** @typedef {{phase: string, step: number, seen: number}} Heard  State that sounds depend on. */
/** @typedef {keyof typeof NOTES} Sound */

/** Key of the setting in the browser's storage. */
const KEY = "flinders-sounds";
/** Number of new tiles (of 642) that make a new area, and the shortest time between two such sounds, s. */
const [AREA, AREA_S] = [12, 0.4];
/** Frequencies of each sound, one after the other, Hz. */
const NOTES = { area: [880], near: [1319], step: [660, 880], good: [523, 659, 784], wrong: [220, 165] };
/** Seconds from one beep to the next where the arrow is reached, and where it leads to the other side. */
const [FASTEST_S, SLOWEST_S] = [0.12, 1.2];
const [NOTE_S, LOUDNESS] = [0.12, 0.15];

/**
 * The facts that sounds depend on.
 * @param {State} state
 * @param {View | null} view
 * @param {Lead | null} lead
 * @returns {Heard}
 */
export function heardOf({ phase }, view, lead) {
    const seen = view?.tiles_seen.reduce((sum, count) => sum + Number(count > 0), 0) ?? 0;
    return { phase, step: lead?.kind === "turn" ? lead.step : 0, seen };
}

/**
 * The sound of a change; of several, the most important.
 * @param {Heard} before
 * @param {Heard} after
 * @returns {Sound | null}
 */
export function soundOf(before, after) {
    if (after.phase !== before.phase && after.phase === "wrong") return "wrong";
    if (after.phase !== before.phase && after.phase === "good") return "good";
    if (before.step > 0 && after.step !== before.step) return "step";
    return after.seen - before.seen >= AREA ? "area" : null;
}

/**
 * Seconds from one beep to the next, shorter as the field comes nearer to where the arrow leads; null without an arrow.
 * @param {Lead | null} lead
 * @param {View | null} view
 * @param {readonly number[] | null} raw  the newest reading
 * @returns {number | null}
 */
export function beepPeriod(lead, view, raw) {
    if (lead?.kind !== "arrow" || !lead.target || !view?.shown || !raw) return null;
    const cosine = dot(lead.target, unit(correctReading(raw, view.shown)));
    const share = Math.acos(Math.min(Math.max(cosine, -1), 1)) / Math.PI;
    return FASTEST_S + (SLOWEST_S - FASTEST_S) * share;
}

export class Sounds {
    /** @param {HTMLInputElement} box  the switch */
    constructor(box) {
        /** @type {AudioContext | null} */
        this.context = null;
        /** @type {Heard | null} */
        this.heard = null;
        this.at = -Infinity;
        this.beepAt = -Infinity;
        this.isOn = recall(KEY) === "on";
        box.checked = this.isOn;
        box.addEventListener("change", () => this.switch(box.checked));
    }

    /** @param {boolean} isOn */
    switch(isOn) {
        this.isOn = isOn;
        remember(KEY, isOn ? "on" : "off");
        if (isOn) this.play("area");
    }

    /**
     * Play the sound of a change.
     * @param {State} state
     * @param {View | null} view
     * @param {Lead | null} lead
     * @param {number} at  seconds
     * @param {readonly number[] | null} [raw]  the newest reading
     */
    follow(state, view, lead, at, raw = null) {
        const period = beepPeriod(lead, view, raw);
        if (period !== null && this.isOn && at - this.beepAt >= period) {
            this.beepAt = at;
            this.play("near");
        }
        const after = heardOf(state, view, lead);
        const sound = this.heard && soundOf(this.heard, after);
        if (sound === null && this.heard) {
            this.heard = { ...after, seen: Math.min(this.heard.seen, after.seen) }; // areas add up
            return;
        }
        this.heard = after;
        if (!sound || !this.isOn || (sound === "area" && (period !== null || at - this.at < AREA_S))) return;
        this.at = at;
        this.play(sound);
    }

    /** @param {Sound} sound */
    play(sound) {
        if (!("AudioContext" in window)) return;
        this.context ??= new AudioContext();
        const { context } = this;
        NOTES[sound].forEach((frequency, i) => {
            const [begin, end] = [context.currentTime + i * NOTE_S, context.currentTime + (i + 1) * NOTE_S];
            const [tone, gain] = [context.createOscillator(), context.createGain()];
            tone.frequency.value = frequency;
            gain.gain.setValueAtTime(LOUDNESS, begin);
            gain.gain.exponentialRampToValueAtTime(0.001, end);
            tone.connect(gain).connect(context.destination);
            tone.start(begin);
            tone.stop(end);
        });
    }
}
