/** The form above a chart of time that leaves a marked or typed span out of the fit, or restores it. */

import { setText } from "../dom.js";
import { singleKeys } from "../keys.js";
import { phrase, translateFixed } from "../language.js";

/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../widgets.js").Page} Page */

/** Constant markup, without data of the server. */
const FORM = `
    <form class="cut" id="cut">
      <span class="span" id="span" hidden>
        <label><span class="visually-hidden" data-phrase="span.from">from, seconds</span><input id="from" type="number" step="any" min="0" inputmode="decimal"></label>–<label><span class="visually-hidden" data-phrase="span.to">to, seconds</span><input id="to" type="number" step="any" min="0" inputmode="decimal"></label> s
        <button type="button" id="restore" title="Put this stretch back (B)" data-phrase-title="span.back.title" data-phrase="span.back">Put back</button>
        <button type="button" id="uncut" class="square quiet" aria-label="Take the mark away" data-phrase-label="span.unmark" title="Take the mark away (Esc)" data-phrase-title="span.unmark.title"><svg class="icon" aria-hidden="true"><use href="#i-close"/></svg></button>
      </span>
      <button type="submit" id="exclude" title="Leave a stretch of time out (X)" data-phrase-title="span.leave-out.title" data-phrase="span.leave-out-of">Leave out…</button>
      <button type="button" id="undo" class="square quiet" title="Undo (Z)" data-phrase-title="span.undo.title" aria-label="Undo" data-phrase-label="span.undo" disabled><svg class="icon" aria-hidden="true"><use href="#i-undo"/></svg></button>
      <button type="button" id="redo" class="square quiet" title="Redo (Shift+Z)" data-phrase-title="span.redo.title" aria-label="Redo" data-phrase-label="span.redo" disabled><svg class="icon" aria-hidden="true"><use href="#i-redo"/></svg></button>
    </form>`;

export class Exclusion {
    /**
     * @param {HTMLElement} head  of the panel
     * @param {Page} page
     * @param {(start_s: number | null, end_s: number | null) => void} mark  a span of time in the chart
     */
    constructor(head, page, mark) {
        this.page = page;
        this.mark = mark;
        const enlarge = head.querySelector(".enlarge");
        head.insertAdjacentHTML("beforeend", FORM);
        translateFixed(head);
        const form = /** @type {HTMLFormElement} */ (head.querySelector("form"));
        if (enlarge) form.append(enlarge);
        const field = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (form.querySelector(`#${id}`));
        const button = (/** @type {string} */ id) => /** @type {HTMLButtonElement} */ (form.querySelector(`#${id}`));
        this.from = field("from");
        this.to = field("to");
        this.exclude = button("exclude");
        this.undo = button("undo");
        this.redo = button("redo");
        this.fields = /** @type {HTMLElement} */ (form.querySelector("#span"));
        this.listen(form);
        button("restore").addEventListener("click", () => this.putBack());
        button("uncut").addEventListener("click", () => this.unmark());
        this.undo.addEventListener("click", () => page.send({ type: "undo" }));
        this.redo.addEventListener("click", () => page.send({ type: "redo" }));
        this.shortcuts = [
            { keys: ["x", "delete"], words: phrase("keys.mark", "mark a stretch of time; again: leave it out"), act: () => this.leaveOut() },
            { keys: ["b"], words: phrase("keys.back", "put the marked stretch back"), act: () => this.putBack() },
            { keys: ["z", "ctrl+z"], words: phrase("keys.undo", "undo"), act: () => page.send({ type: "undo" }) },
            { keys: ["shift+z", "ctrl+y", "ctrl+shift+z"], words: phrase("keys.redo", "redo"), act: () => page.send({ type: "redo" }) },
        ];
    }

    /** @param {HTMLFormElement} form */
    listen(form) {
        for (const field of [this.from, this.to]) {
            field.addEventListener("input", () => {
                const [from, to] = [this.from.valueAsNumber, this.to.valueAsNumber];
                if (from < to) this.mark(from, to);
            });
        }
        form.addEventListener("keydown", (event) => {
            const key = event.key.toLowerCase(); // x and b do not occur in numbers
            const act = { x: () => this.leaveOut(), b: () => this.putBack() }[key];
            if (!act || !(event.target instanceof HTMLInputElement) || event.ctrlKey || event.metaKey || !singleKeys()) return;
            event.preventDefault();
            act();
        });
        form.addEventListener("submit", (event) => {
            event.preventDefault();
            this.leaveOut();
        });
    }

    /** @param {State} state */
    show(state) {
        this.undo.disabled = !state.can_undo;
        this.redo.disabled = !state.can_redo;
    }

    /**
     * Remove the mark.
     * @returns {boolean} Whether there was one.
     */
    escape() {
        if (this.fields.hidden) return false;
        this.unmark();
        return true;
    }

    /**
     * Show the span marked in the chart; null and null without a mark.
     * @param {number | null} start_s
     * @param {number | null} end_s
     */
    showMark(start_s, end_s) {
        const none = start_s === null || end_s === null;
        this.fields.hidden = none;
        setText(this.exclude, none ? phrase("span.leave-out-of", "Leave out…") : phrase("span.leave-out", "Leave out"));
        if (none) return;
        this.from.value = start_s.toFixed(2);
        this.to.value = end_s.toFixed(2);
    }

    unmark() {
        this.mark(null, null);
        this.showMark(null, null);
    }

    /** @returns {{start_s: number, end_s: number} | null} */
    stretch() {
        if (this.fields.hidden) return null;
        const [start_s, end_s] = [this.from.valueAsNumber, this.to.valueAsNumber];
        if (Number.isFinite(start_s) && Number.isFinite(end_s) && start_s < end_s) return { start_s, end_s };
        this.page.notify("warning", phrase("span.refused", "The stretch needs a beginning and a later end, in seconds."));
        return null;
    }

    /** Exclude the marked span; without a mark, propose one. */
    leaveOut() {
        if (this.fields.hidden) this.propose();
        else this.sendAs("exclude");
    }

    putBack() {
        this.sendAs("restore");
    }

    /** Mark a tenth of the session in its middle, to be edited. */
    propose() {
        const { count, time } = this.page.store.points;
        const end = count > 0 ? time[count - 1] : 0;
        if (!(end > 0)) {
            this.page.notify("info", phrase("span.empty", "There are no readings yet to leave out."));
            return;
        }
        this.showMark(0.45 * end, 0.55 * end);
        this.mark(0.45 * end, 0.55 * end);
        this.from.select();
    }

    /** @param {"exclude" | "restore"} type */
    sendAs(type) {
        const stretch = this.stretch();
        if (!stretch) return;
        this.page.send({ type, ...stretch });
        this.unmark();
    }
}
