/** The finish panel: verdict, numbers, export, what to keep, and the calibration from before. */

import { errors } from "./store.js";
import { byId, element, icon, Refusal, remember, remembered, save, setIcon, setList, setText } from "./dom.js";
import { table } from "./views/table.js";
import { counted, degrees, ICONS, measured, PHASES, sentence, significant, VERDICTS } from "./views/words.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("./messages.d.ts").View} View */
/** @typedef {import("./messages.d.ts").TargetInfo} TargetInfo */

/**
 * What an export looks like.
 * @typedef {object} Preview
 * @property {string} text
 * @property {string} filename
 * @property {string[]} warnings
 * @property {string | null} [binary_base64]
 * @property {string | null} [refusal] Why this calibration cannot be exported for this target.
 */

const LAST_TARGET = "flinders-export";
/** What can be had of any calibration, in any unit. */
const FIRST_TARGET = "c";
/** What may be wrong while the readings that are here are sound. */
const NOT_OF_READINGS = ["gone", "nothing-arrives", "not-recorded"];
/** A preview follows the fit no faster than this. */
const PREVIEW_MS = 1000;

export class Finish {
    /**
     * @param {(severity: "info" | "warning" | "error", words: string) => void} notify
     * @param {import("./connection.js").Link["ask"]} ask
     */
    constructor(notify, ask) {
        this.notify = notify;
        this.ask = ask;
        this.dialog = byId("finish-panel", HTMLDialogElement);
        this.targets = byId("export-target", HTMLSelectElement);
        this.answer = byId("answer", HTMLElement);
        /** @type {Preview | null} */
        this.preview = null;
        this.asked = 0;
        this.timer = 0;
        /** The fit and the target that the preview was asked for. */
        this.previewed = "";
        this.waiting = false;
        /** @type {View | null} */
        this.view = null;
        /** @type {State | null} */
        this.state = null;
        this.targets.addEventListener("change", () => {
            remember(LAST_TARGET, this.targets.value);
            this.showPreview(null, "…");
            this.refresh();
        });
        this.onClick("copy", () => this.copy());
        this.onClick("export-file", () => this.download());
        this.onClick("save-calibration", () => this.fetchFile("calibration.json", "calibration.json"));
        this.onClick("save-report", () => this.fetchFile("report.html", "report.html"));
        this.onClick("save-session", () => this.fetchFile("session.csv", "session.csv"));
        this.onClick("send", () => this.send());
    }

    /**
     * @param {string} id
     * @param {() => Promise<void>} act
     */
    onClick(id, act) {
        const button = byId(id, HTMLButtonElement);
        button.addEventListener("click", async () => {
            button.disabled = true;
            setText(this.answer, "");
            try {
                await act();
            } catch (error) {
                if (!(error instanceof Refusal)) throw error;
                setText(this.answer, sentence(error.message));
            } finally {
                button.disabled = false;
                this.allow();
            }
        });
    }

    get isOpen() {
        return this.dialog.open;
    }

    open() {
        if (!this.dialog.open) this.dialog.showModal();
        setText(this.answer, "");
        this.refresh();
    }

    /**
     * The targets that there are.
     * @param {readonly TargetInfo[]} targets
     */
    setTargets(targets) {
        const known = (/** @type {string | null} */ chosen) => targets.some(({ name }) => name === chosen);
        const chosen = [this.targets.value, remembered(LAST_TARGET), FIRST_TARGET].find(known);
        this.targets.replaceChildren(
            ...targets.map(({ name, title, suffix }) => {
                const option = element("option", `${title} (${suffix})`);
                option.setAttribute("value", name);
                return option;
            }),
        );
        if (chosen) this.targets.value = chosen;
    }

    /**
     * Show a fit, or that there is none.
     * @param {View | null} view
     * @param {State | null} state
     */
    show(view, state) {
        this.view = view;
        this.state = state;
        this.verdict(view, state);
        this.numbers(view);
        const region = byId("parameters", HTMLElement);
        const key = JSON.stringify([view?.verdict, view?.offset, view?.matrix, view?.offset_sigma, view?.matrix_sigma]);
        if (region.dataset.key !== key) {
            region.dataset.key = key;
            if (view?.offset) table(region, view);
            else region.replaceChildren(element("p", view ? "A refused fit gives no numbers to copy." : "None yet."));
        }
        setList(byId("findings", HTMLElement), view?.findings ?? [], (finding) => {
            const row = noted(ICONS[finding.severity] ?? "info", finding.advice);
            row.dataset.severity = finding.severity;
            return row;
        });
        setText(byId("kept", HTMLElement), state?.recording ? `All that arrives is recorded to ${state.recording}.` : "");
        const previous = state?.previous ?? null;
        setText(
            byId("previous-words", HTMLElement),
            previous
                ? `${previous.name}: ${sentence(previous.words)}`
                : "A calibration file of this sensor: how many degrees have headings changed since?",
        );
        byId("previous-clear", HTMLElement).hidden = !previous;
        byId("refresh-choice", HTMLElement).hidden = !previous;
        byId("refresh", HTMLInputElement).checked = state?.refreshing ?? false;
        this.allow();
        if (this.isOpen && this.key !== this.previewed) this.refreshSoon();
    }

    /** Switch buttons off that have nothing to act on. */
    allow() {
        const usable = Boolean(this.view?.offset);
        byId("save-calibration", HTMLButtonElement).disabled = !usable;
        byId("save-report", HTMLButtonElement).disabled = !this.view; // of a refused fit it says why
        byId("save-session", HTMLButtonElement).disabled = !(this.state && this.state.readings > 0);
        byId("send", HTMLButtonElement).disabled = !usable || !this.state?.can_send;
        byId("copy", HTMLButtonElement).disabled = !this.preview?.text;
        byId("export-file", HTMLButtonElement).disabled = !this.preview;
    }

    /** What the preview hangs on. */
    get key() {
        const { verdict, unit, offset, matrix, field_strength } = this.view ?? {};
        return JSON.stringify([this.targets.value, verdict, unit, offset, matrix, field_strength]);
    }

    /**
     * @param {View | null} view
     * @param {State | null} state
     */
    verdict(view, state) {
        const { kind, title, words } = judged(view, state);
        const box = byId("verdict", HTMLElement);
        box.dataset.verdict = kind;
        setIcon(box, ICONS[kind] ?? "collecting");
        setText(byId("verdict-title", HTMLElement), title);
        setText(byId("verdict-words", HTMLElement), words);
    }

    /** @param {View | null} view */
    numbers(view) {
        const error = view?.heading_error_deg;
        const raw = view?.uncorrected_heading_error_deg;
        /** @type {[string, string][]} */
        const rows = view
            ? [
                  ["heading error, worst (1\u00a0σ)", degrees(error?.worst)],
                  ["all headings within (95\u00a0%)", degrees(error?.bound_95)],
                  ["heading error, rms (1\u00a0σ)", degrees(error?.rms)],
                  ["without calibration, worst", degrees(raw?.worst)],
                  ["tilt within the target", tilt(view.attitude_limit_deg)],
                  [view.field_strength_known ? "field strength" : "field strength, relative", withUnit(measured(view.field_strength, view.noise).value, view.unit)],
                  ["noise (1\u00a0σ)", withUnit(significant(view.noise, 3), view.unit)],
                  ["readings used", counted(view.samples)],
                  ["method", view.method],
              ]
            : [];
        setList(byId("numbers", HTMLElement), rows, ([name, value]) => {
            const pair = element("div");
            pair.append(element("dt", name), element("dd", value));
            return pair;
        });
    }

    refreshSoon() {
        if (this.timer) return;
        this.timer = window.setTimeout(() => {
            this.timer = 0;
            if (!this.isOpen) return;
            if (this.waiting) this.refreshSoon();
            else this.refresh();
        }, PREVIEW_MS);
    }

    /** Get the text of the chosen export for the present fit. */
    async refresh() {
        const target = this.targets.value;
        if (!target) return;
        const turn = ++this.asked;
        this.previewed = this.key;
        if (!this.view?.offset) {
            this.waiting = false;
            this.showPreview(null, this.view ? `A refused fit is not exported. ${this.view.sentence}` : "There is no calibration yet.");
            return;
        }
        this.waiting = true;
        try {
            const answer = await this.ask(`export/${encodeURIComponent(target)}`, { headers: { Accept: "application/json" } });
            const preview = /** @type {Preview} */ (await answer.json());
            if (turn !== this.asked) return;
            if (preview.refusal) this.showPreview(null, sentence(preview.refusal));
            else this.showPreview(preview, preview.text);
        } catch (error) {
            if (turn === this.asked) this.showPreview(null, error instanceof Refusal ? sentence(error.message) : String(error));
        } finally {
            if (turn === this.asked) this.waiting = false;
        }
    }

    /**
     * @param {Preview | null} preview
     * @param {string} text
     */
    showPreview(preview, text) {
        this.preview = preview;
        const binary = preview?.binary_base64;
        const words = binary && !text ? `${preview.filename}: ${atob(binary).length} bytes, to be downloaded.\n\n${hex(atob(binary))}` : text;
        const host = byId("preview", HTMLElement);
        host.classList.toggle("refusal", preview === null);
        setText(host, words);
        setList(byId("export-warnings", HTMLElement), preview?.warnings ?? [], (warning) => noted("limited", warning));
        this.allow();
    }

    async copy() {
        const text = this.preview?.text;
        if (!text) return;
        const label = byId("copy", HTMLElement).querySelector("span");
        try {
            await navigator.clipboard.writeText(text);
        } catch {
            window.getSelection()?.selectAllChildren(byId("preview", HTMLElement));
            setText(this.answer, "The browser does not let this page copy. The text is selected: press Ctrl+C.");
            return;
        }
        if (label) {
            setText(label, "Copied");
            window.setTimeout(() => setText(label, "Copy"), 1500);
        }
        setText(this.answer, "Copied.");
    }

    async download() {
        const preview = this.preview;
        if (!preview) return;
        const { text, filename, binary_base64: binary } = preview;
        const content = binary ? Uint8Array.from(atob(binary), (letter) => letter.charCodeAt(0)) : text;
        save(new Blob([content], { type: "application/octet-stream" }), filename);
    }

    /**
     * @param {string} address
     * @param {string} name Where the server gives none.
     */
    async fetchFile(address, name) {
        const answer = await this.ask(address);
        const named = /filename="([^"/\\]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1];
        save(await answer.blob(), named ?? name);
    }

    async send() {
        setText(this.answer, "Sending …");
        const answer = await this.ask("send", { method: "POST" });
        const { words } = await answer.json().catch(() => ({}));
        setText(this.answer, typeof words === "string" ? sentence(words) : "Sent.");
    }
}

/**
 * A row of a list: an icon and a sentence.
 * @param {string} name
 * @param {string} words
 * @returns {HTMLElement}
 */
function noted(name, words) {
    const row = element("li");
    row.append(icon(name), element("span", sentence(words)));
    return row;
}

/**
 * The verdict, never better than what the page says: what is wrong with the readings stands first.
 * @param {View | null} view
 * @param {State | null} state
 * @returns {{kind: string, title: string, words: string}}
 */
function judged(view, state) {
    const wrong = state?.phase === "wrong" ? state.reasons.filter(({ severity }) => severity === "warning") : [];
    const why = wrong.map(({ advice }) => sentence(advice));
    const isWrong = wrong.some(({ code }) => !NOT_OF_READINGS.includes(code));
    if (!view) {
        const none = "Turn the sensor through all directions; the first fit comes after some seconds.";
        if (isWrong) return { kind: "refused", title: PHASES.wrong, words: why.join(" ") };
        return { kind: "none", title: "No calibration yet", words: [...why, none].join(" ") };
    }
    const { worst } = errors(view, state?.goal ?? "heading");
    const anyhow = state?.goal === "attitude" && worst !== null ? [`Whichever way it is held: ${degrees(worst)} (1 σ).`] : [];
    const rests = view.condition ? [sentence(view.condition)] : [];
    const words = [...why, view.sentence, ...rests, ...anyhow].join(" ");
    if (isWrong) return { kind: "refused", title: PHASES.wrong, words };
    const target = state?.target_deg ?? view.heading_error_deg?.target_deg ?? Infinity;
    const misses = view.verdict !== "refused" && worst !== null && worst > target;
    return { kind: misses ? "limited" : view.verdict, title: misses ? "Misses the target" : VERDICTS[view.verdict], words };
}

/**
 * @param {number | null} deg
 * @returns {string}
 */
function tilt(deg) {
    if (deg === null) return "–";
    return deg >= 179.5 ? "any" : deg <= 0 ? "none" : `${Math.floor(deg)}°`;
}

/**
 * @param {string} number
 * @param {string} unit
 * @returns {string} A dash that stands for no number has no unit.
 */
function withUnit(number, unit) {
    return number === "–" ? number : `${number} ${unit}`;
}

/**
 * @param {string} bytes
 * @returns {string} In rows of sixteen.
 */
function hex(bytes) {
    const pairs = Array.from(bytes, (letter) => letter.charCodeAt(0).toString(16).padStart(2, "0"));
    return Array.from({ length: Math.ceil(pairs.length / 16) }, (_, i) => pairs.slice(16 * i, 16 * i + 16).join(" ")).join("\n");
}
