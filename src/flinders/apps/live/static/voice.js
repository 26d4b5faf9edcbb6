/** Spoken words for a user who does not look at the screen: the next step, a completed turn, a good result, a fault. */

import { recall, remember, setText } from "./dom.js";
import { languageCode, phrase } from "./language.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./standalone/lead.js").Lead} Lead */
/** @typedef {{phase: string, step: number, words: string}} Heard  What spoken words depend on. */

/** Key of the setting in the browser's storage. */
const KEY = "flinders-voice";

/**
 * The facts that spoken words depend on.
 * @param {State} state
 * @param {Lead | null} lead
 * @returns {Heard}
 */
export function heardOf({ phase }, lead) {
    return { phase, step: lead?.kind === "turn" ? lead.step : 0, words: lead?.words ?? "" };
}

/**
 * The sentences to speak after a change; empty for none.
 * @param {Heard | null} before
 * @param {Heard} after
 * @returns {string}
 */
export function spokenWords(before, after) {
    const isNewPhase = after.phase !== before?.phase;
    if (after.phase === "wrong") return isNewPhase || after.words !== before?.words ? phrase("voice.wrong", "Wrong: {words}", { words: after.words }) : "";
    if (isNewPhase && after.phase === "good") return [phrase("voice.good", "Good."), after.words].filter(Boolean).join(" ");
    if (after.words === before?.words) return "";
    const isDone = before !== null && before.step > 0 && after.step !== before.step;
    return [isDone ? phrase("voice.turn-done", "Turn done.") : "", after.words].filter(Boolean).join(" ");
}

export class Voice {
    /**
     * @param {HTMLInputElement} box  that switches spoken words on
     * @param {HTMLElement} note  that says why there are none
     */
    constructor(box, note) {
        this.box = box;
        this.note = note;
        /** @type {SpeechSynthesis | null} */
        this.speech = "speechSynthesis" in window ? window.speechSynthesis : null;
        /** @type {Heard | null} */
        this.heard = null;
        this.isOn = recall(KEY) === "on";
        box.addEventListener("change", () => this.switch(box.checked));
        this.speech?.addEventListener?.("voiceschanged", () => this.showVoice());
        this.showVoice();
    }

    /** @returns {SpeechSynthesisVoice | null} A voice of the page's language. */
    get voice() {
        const voices = this.speech?.getVoices() ?? [];
        return voices.find(({ lang }) => lang.split(/[-_]/)[0] === languageCode()) ?? null;
    }

    /** Show whether there is a voice; browsers load voices after the page. */
    showVoice() {
        const hasVoice = this.voice !== null;
        this.box.disabled = !hasVoice;
        this.box.checked = this.isOn && hasVoice;
        setText(this.note, hasVoice ? "" : phrase("voice.none", "This browser has no voice for this language."));
    }

    /** @param {boolean} isOn */
    switch(isOn) {
        this.isOn = isOn;
        remember(KEY, isOn ? "on" : "off");
        if (!isOn) this.speech?.cancel();
        else if (this.heard) this.speak(spokenWords(null, this.heard));
    }

    /**
     * Speak what has changed.
     * @param {State} state
     * @param {Lead | null} lead
     */
    follow(state, lead) {
        const after = heardOf(state, lead);
        const words = spokenWords(this.heard, after);
        const isStale = this.heard?.words !== after.words;
        this.heard = after;
        if (!this.isOn) return;
        if (words) this.speak(words);
        else if (isStale) this.speech?.cancel();
    }

    /**
     * Speak a sentence now; one that is being spoken is out of date, and ends.
     * @param {string} words
     */
    speak(words) {
        const { speech, voice } = this;
        if (!speech || !voice || !words) return;
        speech.cancel();
        const utterance = new SpeechSynthesisUtterance(words);
        Object.assign(utterance, { voice, lang: voice.lang });
        speech.speak(utterance);
    }
}
