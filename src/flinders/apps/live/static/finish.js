/** The finish dialog: verdict, numbers, export, files to save, and comparison with an earlier calibration. */

import { drawCard } from "./card.js";
import { canCollect, errors } from "./store.js";
import { byId, bytesOf, element, icon, Refusal, remember, recall, save, setIcon, setList, setText } from "./dom.js";
import { hexadecimal } from "./standalone/targets.js";
import { table } from "./views/table.js";
import { clock, countText, degrees, ICONS, isGoodWhileLevel, measuredText, phaseTitle, sentence, significant, sinceWords, things, verdictTitle, whileLevelTitle } from "./views/words.js";
import { phrase } from "./language.js";
import { adviceOf, conditionOf, previousWords, reasonWords, sentenceOf } from "./verdict_words.js";

/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("./messages.d.ts").TargetInfo} TargetInfo */

/** @typedef {import("./standalone/running.js").Preview} Preview */

const LAST_TARGET = "flinders-export";
/** Result before the first calibration. @type {import("./standalone/running.js").Finished} */
const NOTHING = { name: "", view: null, refusal: "" };
/** Codes of reasons on the link, which do not concern the readings already received. */
const NOT_OF_READINGS = ["gone", "nothing-arrives", "not-recorded"];
/** Matches a comment line of a preview. */
const COMMENT = /^\s*(\/\*|\*|\/\/|#|--|%|;|$)/;

export class Finish {
    /**
     * @param {(severity: "info" | "warning" | "error", words: string) => void} notify
     * @param {() => import("./standalone/running.js").Link} link
     * @param {() => void} showNeedles Enlarges the chart of headings before and after.
     */
    constructor(notify, link, showNeedles) {
        this.notify = notify;
        this.link = link;
        this.dialog = byId("finish-panel", HTMLDialogElement);
        this.targets = byId("export-target", HTMLSelectElement);
        this.answer = byId("answer", HTMLElement);
        /** @type {Preview | null} */
        this.preview = null;
        this.asked = 0;
        /** @type {import("./standalone/running.js").Finished | null} The latest calibration. */
        this.finished = null;
        /** The earlier calibration, for comparison. */
        this.previous = "";
        /** @type {State | null} */
        this.state = null;
        this.targets.addEventListener("change", () => {
            remember(LAST_TARGET, this.targets.value);
            this.showPreview(null, "");
            this.ask();
        });
        this.onClick("copy", () => this.copy());
        this.onClick("export-file", () => this.download());
        this.onClick("save-calibration", () => this.saveFile("calibration.json"));
        this.onClick("save-report", () => this.saveFile("report.html"));
        this.onClick("save-session", () => this.saveFile("session.csv"));
        this.onClick("save-card", () => this.saveCard());
        this.onClick("send", () => this.send());
        this.onClick("finish-again", () => this.make());
        byId("check", HTMLButtonElement).addEventListener("click", () => {
            this.dialog.close();
            showNeedles();
        });
    }

    /**
     * @param {string} id
     * @param {() => Promise<void>} act
     */
    onClick(id, act) {
        const button = byId(id, HTMLButtonElement);
        button.addEventListener("click", async () => {
            button.disabled = true;
            this.say("");
            try {
                await act();
            } catch (error) {
                if (!(error instanceof Refusal)) throw error;
                this.say(error.message, "refused");
            } finally {
                button.disabled = false;
                this.allow();
            }
        });
    }

    /**
     * Show the outcome of an action.
     * @param {string} words
     * @param {"done" | "refused" | "working"} how
     */
    say(words, how = "done") {
        this.answer.dataset.how = how;
        setText(this.answer, words && sentence(words));
        if (words) this.answer.scrollIntoView({ block: "nearest" });
    }

    get isOpen() {
        return this.dialog.open;
    }

    close() {
        this.dialog.close();
    }

    /** Show the finished calibration, or finish one. */
    async open() {
        if (!this.dialog.open) this.dialog.showModal();
        this.say("");
        if (this.finished?.view?.offset && this.link().isFinished) this.show(this.state);
        else await this.make();
    }

    /** Make the calibration of the readings so far, and show it in the dialog. */
    async make() {
        const turn = ++this.asked;
        const readings = counting(this.state);
        const wasFinished = Boolean(this.state?.finished);
        this.finished = readings === 0 ? NOTHING : null;
        this.draw();
        if (this.finished) return;
        this.verdict("none", phrase("finish.making", "Making the calibration …"), phrase("finish.of", "of {readings}", { readings: things(readings, "reading") }));
        try {
            const finished = await this.link().finish();
            if (turn !== this.asked) return;
            this.finished = finished;
        } catch (error) {
            if (!(error instanceof Refusal)) throw error;
            if (turn !== this.asked) return;
            this.finished = { name: "", view: null, refusal: error.message };
        }
        if (!this.finished.view?.offset && !wasFinished) this.link().send({ type: "collect" }); // without a calibration, continue collecting
        this.draw();
        await this.ask();
    }

    /**
     * Fill the list of targets.
     * @param {readonly TargetInfo[]} targets
     */
    setTargets(targets) {
        const known = (/** @type {string | null} */ chosen) => targets.some(({ name }) => name === chosen);
        const chosen = [this.targets.value, recall(LAST_TARGET), targets[0]?.name ?? ""].find(known);
        const groups = new Set(targets.map(({ group }) => group));
        this.targets.replaceChildren(
            ...Array.from(groups, (group) => {
                const options = targets.filter((target) => target.group === group).map(optionOf);
                const listed = element("optgroup", options);
                listed.setAttribute("label", group);
                return listed;
            }),
        );
        if (chosen) this.targets.value = chosen;
    }

    /**
     * Set the text of the button that opens the dialog.
     * @param {State} state
     */
    name({ finished }) {
        const button = byId("finish", HTMLButtonElement);
        setIcon(button, finished ? "download" : "good");
        button.title = finished ? phrase("export.title", "Export (F)") : phrase("finish.title", "Keep this calibration and export it (F)");
        setText(button.querySelector("span") ?? button, finished ? phrase("export", "Export") : phrase("finish", "Finish"));
        setText(byId("finish-title", HTMLElement), finished ? phrase("finish.at", "Finished at {time}", { time: clock(finished.seconds) }) : phrase("finish", "Finish"));
    }

    /**
     * Show changes of the session; the calibration stays as made.
     * @param {State | null} state
     */
    show(state) {
        this.state = state;
        if (!this.isOpen) return;
        setText(byId("kept", HTMLElement), state?.recording && state.opened === null ? phrase("keep.recorded", "All readings are recorded to {file}.", { file: state.recording }) : "");
        const previous = state?.previous ?? null;
        setText(
            byId("previous-words", HTMLElement),
            previous
                ? `${previous.name}: ${sentence(previousWords(previous))}`
                : phrase("compare.words", "An earlier calibration file of this sensor shows the change of headings since."),
        );
        const name = previous?.name ?? "";
        if (name && name !== this.previous) byId("compare", HTMLDetailsElement).open = true;
        this.previous = name;
        byId("previous-clear", HTMLElement).hidden = !previous;
        byId("refresh-choice", HTMLElement).hidden = !previous;
        byId("refresh", HTMLInputElement).checked = state?.refreshing ?? false;
        if (state) this.showSince(state);
        this.allow();
    }

    /**
     * Show the progress of the session, or that it has changed; the calibration stays until the user presses a button.
     * @param {State} state
     */
    showSince(state) {
        const isMade = Boolean(this.finished?.view?.offset);
        const isCurrent = isMade && this.link().isFinished;
        const [collect, again] = [byId("collect", HTMLButtonElement), byId("finish-again", HTMLButtonElement)];
        collect.hidden = !canCollect(state);
        collect.classList.toggle("primary", lacks(state));
        again.hidden = isCurrent;
        byId("finish-more", HTMLElement).hidden = !this.finished || (collect.hidden && again.hidden);
        setText(byId("finish-more-words", HTMLElement), isCurrent ? sinceWords(state) : otherNow(state, isMade));
    }

    /** Show the latest calibration. */
    draw() {
        const view = this.finished?.view ?? null;
        const { kind, title, words } = judged(this.finished, this.state);
        this.verdict(kind, title, words);
        this.numbers(view);
        const region = byId("parameters", HTMLElement);
        if (view?.offset) table(region, view);
        else region.replaceChildren();
        for (const id of ["take", "preview", "export-warnings"]) byId(id, HTMLElement).hidden = Boolean(this.finished && !view?.offset);
        byId("details", HTMLElement).hidden = !view?.offset;
        setList(byId("findings", HTMLElement), view?.findings ?? [], (finding) => {
            const row = listRow(ICONS[finding.severity] ?? "info", adviceOf(finding));
            row.dataset.severity = finding.severity;
            return row;
        });
        byId("known", HTMLElement).hidden = !view?.findings.length;
        this.showPreview(null, "");
        this.show(this.state);
    }

    /** Disable buttons without effect. */
    allow() {
        const { finished, state } = this;
        const usable = Boolean(finished?.view?.offset);
        const canSend = usable && Boolean(state?.can_send);
        byId("save-calibration", HTMLButtonElement).disabled = !usable;
        byId("save-report", HTMLButtonElement).disabled = !finished?.view; // the report of a refused fit states the reason
        byId("save-card", HTMLButtonElement).disabled = !usable || !finished?.view?.uncorrected_heading_error_deg;
        byId("save-session", HTMLButtonElement).disabled = !(state && state.readings > 0);
        byId("checking", HTMLElement).hidden = !usable || state?.opened !== null || state.source.link !== "connected";
        byId("send", HTMLButtonElement).hidden = !canSend;
        byId("send", HTMLButtonElement).disabled = !canSend;
        const [copy, download] = [byId("copy", HTMLButtonElement), byId("export-file", HTMLButtonElement)];
        copy.disabled = !this.preview?.text;
        download.disabled = !this.preview;
        const isText = !this.preview?.binary_base64;
        const isFirst = !canSend && !(state?.finished && lacks(state));
        copy.classList.toggle("primary", isText && isFirst);
        download.classList.toggle("primary", !isText && isFirst);
    }

    /**
     * @param {string} kind
     * @param {string} title
     * @param {string} words
     */
    verdict(kind, title, words) {
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
                  [phrase("numbers.worst", "heading error, worst (1 σ)"), degrees(error?.worst)],
                  [phrase("numbers.bound", "all headings within (95 %)"), degrees(error?.bound_95)],
                  [phrase("numbers.rms", "heading error, rms (1 σ)"), degrees(error?.rms)],
                  [phrase("numbers.raw", "without calibration, worst"), degrees(raw?.worst)],
                  [phrase("numbers.tilt", "tilt within the target"), tiltText(view.attitude_limit_deg)],
                  [view.field_strength_known ? phrase("numbers.strength", "field strength") : phrase("numbers.relative", "field strength, relative"), withUnit(measuredText(view.field_strength, view.noise).value, view.unit)],
                  [phrase("numbers.noise", "noise (1 σ)"), withUnit(significant(view.noise, 3), view.unit)],
                  [phrase("numbers.used", "readings used"), countText(view.samples)],
                  [phrase("numbers.method", "method"), view.method],
              ]
            : [];
        setList(byId("numbers", HTMLElement), rows, ([name, value]) => element("div", [element("dt", name), element("dd", value)]));
    }

    /** Get the text of the chosen export. */
    async ask() {
        const target = this.targets.value;
        if (!target || !this.finished?.view?.offset) return;
        const turn = ++this.asked;
        try {
            const preview = await this.link().exported(target);
            if (turn !== this.asked) return;
            this.showPreview(preview, preview.text);
        } catch (error) {
            if (turn === this.asked) this.showPreview(null, error instanceof Refusal ? sentence(error.message) : String(error));
        }
    }

    /**
     * @param {Preview | null} preview
     * @param {string} text
     */
    showPreview(preview, text) {
        this.preview = preview;
        const binary = bytesOf(preview?.binary_base64 ?? "");
        const words = binary.length && !text ? `${phrase("export.binary", "{file}: {bytes} bytes, to be downloaded.", { file: preview?.filename ?? "", bytes: binary.length })}\n\n${hexadecimal(binary)}` : text;
        const host = byId("preview", HTMLElement);
        host.classList.toggle("refusal", preview === null && text !== "");
        host.textContent = words;
        host.scrollTop = preview ? heightAbove(host, text) : 0;
        const known = this.finished?.view?.findings.map(({ advice }) => advice) ?? [];
        const warnings = preview?.warnings.filter((warning) => !known.includes(warning)) ?? [];
        setList(byId("export-warnings", HTMLElement), warnings, (warning) => listRow("limited", warning));
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
            this.say(phrase("export.not-copied", "the browser does not let this page copy. The text is selected: press Ctrl+C"), "refused");
            return;
        }
        if (label) {
            setText(label, phrase("export.copied", "Copied"));
            window.setTimeout(() => setText(label, phrase("export.copy", "Copy")), 1500);
        }
        this.say(phrase("export.done", "copied"));
    }

    async download() {
        const preview = this.preview;
        if (!preview) return;
        const { text, filename, binary_base64: binary } = preview;
        const content = binary ? bytesOf(binary) : text;
        save(new Blob([content], { type: "application/octet-stream" }), filename);
    }

    /** @param {import("./standalone/running.js").FileName} name */
    async saveFile(name) {
        save(...(await this.link().file(name)));
    }

    async saveCard() {
        const { view, name } = this.finished ?? NOTHING;
        const [error, raw] = [view?.heading_error_deg, view?.uncorrected_heading_error_deg];
        if (!view || !error || !raw) return;
        const { title } = judged(this.finished, this.state);
        const numbers = { before: degrees(raw.worst), after: degrees(error.worst), bound: degrees(error.bound_95), readings: view.samples };
        const picture = await drawCard({ name: this.state?.opened ?? this.state?.source.name ?? name, verdict: title, seconds: this.state?.seconds ?? null, ...numbers });
        if (!picture) throw new Refusal(phrase("card.none", "the browser makes no picture of it"));
        save(picture, "heading-error.png");
    }

    async send() {
        this.say(phrase("export.sending", "sending …"), "working");
        this.say(await this.link().sendToBoard());
    }
}

/**
 * Number of readings that count.
 * @param {State | null} state
 * @returns {number}
 */
function counting(state) {
    return state ? state.readings - state.excluded_readings - (state.finished?.since ?? 0) : 0;
}

/**
 * Sentence on the session's changes since the calibration was made.
 * @param {State} state
 * @param {boolean} isMade
 */
function otherNow({ finished, opened }, isMade) {
    if (!isMade) return finished || opened !== null ? "" : phrase("finish.nothing", "Nothing is finished: keep turning, and finish it then.");
    return finished || opened !== null ? phrase("finish.changed", "Something was changed since.") : phrase("finish.collecting", "Readings are being collected again.");
}

/**
 * Whether a calibration misses the target by so much that more readings are the first advice.
 * @param {State} state
 */
function lacks({ phase }) {
    return phase === "collecting" || phase === "wrong";
}

/**
 * Height of the comment lines at the start of a text, to scroll to its first numbers.
 * @param {HTMLElement} host
 * @param {string} text
 * @returns {number}
 */
function heightAbove(host, text) {
    const lines = text.split("\n");
    const first = lines.findIndex((line) => !COMMENT.test(line));
    return first > 0 ? (host.scrollHeight / lines.length) * first : 0;
}

/**
 * A row of a list: an icon and a sentence.
 * @param {string} name
 * @param {string} words
 * @returns {HTMLElement}
 */
function listRow(name, words) {
    return element("li", [icon(name), element("span", sentence(words))]);
}

/**
 * The verdict of a calibration.
 * @param {import("./standalone/running.js").Finished | null} finished
 * @param {State | null} state
 * @returns {{kind: string, title: string, words: string}}
 */
export function judged(finished, state) {
    const view = finished?.view ?? null;
    if (!view) return { kind: "none", title: phrase("verdict.none-yet", "No calibration yet"), words: sentence(finished?.refusal || turnFirst()) };
    const { worst } = errors(view, state?.goal ?? "heading");
    const anyhow = state?.goal === "attitude" && worst !== null ? [phrase("verdict.anyhow", "Whichever way it is held: {error} (1 σ).", { error: degrees(worst) })] : [];
    const rests = view.condition ? [sentence(conditionOf(view))] : [];
    const wrong = state?.phase === "wrong" ? state.reasons.filter(({ severity, code }) => severity === "warning" && !NOT_OF_READINGS.includes(code)) : [];
    const words = [...wrong.map((reason) => sentence(reasonWords(reason))), sentenceOf(view), ...rests, ...anyhow].join(" ");
    if (wrong.length) return { kind: "refused", title: phaseTitle("wrong"), words };
    const target = view.heading_error_deg?.target_deg ?? Infinity;
    const misses = view.verdict !== "refused" && worst !== null && worst > target;
    const title = isGoodWhileLevel(view, state?.goal ?? "heading") ? whileLevelTitle() : verdictTitle(view.verdict);
    return { kind: misses ? "limited" : view.verdict, title: misses ? phrase("verdict.misses", "Misses the target") : title, words };
}

/** @returns {string} Instruction before the first fit. */
function turnFirst() {
    return phrase("finish.turn-first", "turn the sensor through all directions; the first fit comes after some seconds");
}

/**
 * @param {number | null} deg
 * @returns {string}
 */
export function tiltText(deg) {
    if (deg === null) return "–";
    return deg >= 179.5 ? phrase("numbers.any", "any") : deg <= 0 ? phrase("numbers.none", "none") : `${Math.floor(deg)}°`;
}

/**
 * @param {string} number
 * @param {string} unit
 * @returns {string} The number with its unit; a dash without unit.
 */
function withUnit(number, unit) {
    return number === "–" ? number : `${number} ${unit}`;
}

/** @param {TargetInfo} target */
function optionOf({ name, title, suffix }) {
    const option = element("option", `${title} (${suffix})`);
    option.setAttribute("value", name);
    return option;
}
