/**
 * The live page: stores the messages of its session, and draws them.
 *
 * Messages only mark parts as changed; the next frame of the screen draws them, so that a slow machine draws less often
 * and never falls behind. Charts of all readings are drawn at most ten times a second, numbers four times, the dials and
 * the sphere with each frame.
 */

import { byId, element, icon, Refusal, remember, recall, setIcon, setList, setText } from "./dom.js";
import { Finish } from "./finish.js";
import { listen, rows, setSingleKeys, singleKeys } from "./keys.js";
import { listenForLanguage, numeral, phrase, translateFixed } from "./language.js";
import { legendOf, legendRow } from "./legend.js";
import { listenForPlace, showRemedies } from "./remedies.js";
import { Sounds } from "./sounds.js";
import { staysLevel } from "./standalone/choreography.js";
import { Fitter } from "./standalone/fitter.js";
import { errors, goesOn, Store } from "./store.js";
import { useVerdictTables } from "./verdict_words.js";
import { ems, gauge } from "./views/gauge.js";
import { Guide, LeadView } from "./views/lead.js";
import { brief, capital, countText, degrees, duration, faultTitle, frequency, ICONS, isGoodWhileLevel, phaseTitle, remarkWords, sentence, sinceWords, sourceTitle, things, whileLevelTitle } from "./views/words.js";
import { Voice } from "./voice.js";
import { drawChanged, lay, markHovered } from "./widgets.js";

/** @typedef {import("./messages.d.ts").Command} Command */
/** @typedef {import("./standalone/running.js").Link} Link */
/** @typedef {import("./standalone/running.js").Listener} Listener */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/views/scene.js").Scene} Scene */

/** Shortest time between two drawings of charts, ms, and the inverse of the largest share of time for drawing. */
const CHART_MS = 100;
const CHART_SHARE = 6;
/** Key of the chosen theme in the browser's storage; see theme.js. */
const THEME = "flinders-theme";
const SAID_MS = 4000;
const NOTICE_MS = 9000;

translateFixed(document);
listenForLanguage(byId("language", HTMLSelectElement));
const store = new Store();
const finish = new Finish(notify, () => link, () => {
    const panel = document.querySelector(".panel.heading:not(.enlarged)");
    if (panel instanceof HTMLElement) enlarge(panel);
});
const panels = lay(byId("strip", HTMLElement), { store, send, notify, hover });
const guide = new Guide();
const leadView = new LeadView(guide, drawAll);
const sounds = new Sounds(byId("sounds", HTMLInputElement));
const voice = new Voice(byId("voice", HTMLInputElement), byId("voice-words", HTMLElement));
/** @type {Scene | null} */
let scene = null;
let sceneAsked = false;
/** First point that is not in the scene yet. */
let sceneFrom = Infinity;
const dirty = { state: true, view: true, points: true, now: true, hovered: false };
let chartsNext = 0;
let frameAsked = false;
let wasOpen = false;

// Link --------------------------------------------------------------------------------------------------------------

/** @type {Link} */
let link;

/**
 * Load the page's data from Python, and run the page on the messages of a link.
 * @template {{engine: import("./standalone/data.d.ts").EngineData}} Data
 * @param {(listener: Listener, data: Data, fitter: Fitter) => Link | Promise<Link>} connect
 */
export async function start(connect) {
    try {
        const answer = await fetch("page.json");
        if (!answer.ok) throw new Error(`page.json gave ${answer.status}`);
        const data = /** @type {Data} */ (await answer.json());
        useVerdictTables(data.engine);
        link = await connect(listener, data, new Fitter("static/worker.js", new URL("flinders.wasm", document.baseURI).href, data.engine));
        /** State of the page, for tests and for inspection. */
        Object.defineProperty(window, "flinders", { value: Object.freeze({ store, connection: link }) });
    } catch (error) {
        byId("lost", HTMLElement).hidden = false;
        setText(byId("lost-words", HTMLElement), phrase("page.not-loaded", "This page could not be loaded: {error}.", { error: error instanceof Error ? error.message : String(error) }));
        byId("retry", HTMLElement).addEventListener("click", () => window.location.reload());
    }
}

/** @type {Listener} */
const listener = {
    onMessage(message) {
        if (message.type === "notice") {
            notify(message.severity, remarkWords(message.words));
            return;
        }
        store.take(message);
        if (message.type === "hello") {
            finish.setTargets(message.targets);
            setText(byId("about", HTMLElement), `Flinders ${message.version}`);
            sceneFrom = 0;
            dirty.points = true;
            dirty.now = true;
            startScene();
        }
        dirty.state = true;
        if (message.type !== "state") dirty.view = true;
        askFrame();
    },
    onReadings(series, stride) {
        const from = store.follow(series, stride);
        if (from === Infinity) return;
        sceneFrom = Math.min(sceneFrom, from);
        dirty.points = true;
        dirty.now = true;
        askFrame();
    },
    onLink(state, seconds) {
        if (state === "open") wasOpen = true;
        byId("lost", HTMLElement).hidden = state === "open" || (!wasOpen && state === "trying");
        const words = state === "trying"
            ? phrase("line.trying", "Trying to reach Flinders …")
            : phrase("line.lost", "Flinders does not answer. Next try in {seconds} s. The readings are safe where it runs.", { seconds });
        if (state !== "open") setText(byId("lost-words", HTMLElement), words);
        document.documentElement.dataset.line = state;
    },
};

/**
 * Send a command to the session, or show that there is no connection.
 * @param {Command} message
 */
function send(message) {
    if (!link.send(message)) notify("warning", phrase("line.none", "There is no connection to Flinders, so nothing was changed."));
}

// Drawing -----------------------------------------------------------------------------------------------------------

function askFrame() {
    if (frameAsked) return;
    frameAsked = true;
    requestAnimationFrame(draw);
}

/** @param {number} now */
function draw(now) {
    frameAsked = false;
    const { state, view } = store;
    if (dirty.now && store.now && view) leadView.turn(store.now, view);
    const lead = guide.follow(store, now / 1000);
    if (state && lead) leadView.draw(state, view, lead);
    if (state) sounds.follow(state, view, lead, now / 1000, store.now?.raw ?? null);
    if (state) voice.follow(state, lead);
    if (dirty.state && state) drawState(state, view);
    if (dirty.state) finish.show(state);
    if (dirty.points || dirty.view || dirty.state || guide.lead?.target !== sceneTarget) drawScene(view, state);
    if (dirty.now) scene?.setNow(store.now ? { raw: store.now.raw } : null);
    const picture = { view, state, now: store.now, points: store.points };
    drawChanged(panels, /** @type {const} */ (["view", "state", "now"]).filter((part) => dirty[part]), picture);
    if (dirty.hovered) {
        markHovered(panels, store.hovered);
        scene?.setHovered(store.hovered);
    }
    const charts = dirty.points || dirty.view || dirty.state;
    Object.assign(dirty, { state: false, view: false, now: false, hovered: false });
    if (!charts) return;
    if (now >= chartsNext) {
        const begun = performance.now();
        dirty.points = false;
        drawChanged(panels, ["points"], picture);
        chartsNext = now + Math.max(CHART_MS, CHART_SHARE * (performance.now() - begun));
    } else {
        dirty.points = true;
        window.setTimeout(askFrame, chartsNext - now);
    }
}

/**
 * Mark a reading in all views that show it.
 * @param {number | null} reading
 */
function hover(reading) {
    if (store.hovered === reading) return;
    store.hovered = reading;
    dirty.hovered = true;
    askFrame();
}

/** Draw everything again, for example after a change of theme. */
function drawAll() {
    Object.assign(dirty, { state: true, view: true, points: true, now: true });
    chartsNext = 0;
    drawLegend();
    askFrame();
}

/**
 * @param {State} state
 * @param {View | null} view
 */
function drawState(state, view) {
    const { rms, worst } = errors(view, state.goal);
    gauge(byId("gauge", HTMLElement), { rms, worst, target: state.target_deg }, theme());
    const figure = degrees(worst).replace("°", "");
    setText(byId("worst", HTMLElement), figure);
    byId("figure", HTMLElement).style.setProperty("--ems", ems(figure).toFixed(2));
    byId("degree", HTMLElement).hidden = worst === null;
    setText(byId("worst-what", HTMLElement), state.goal === "attitude" ? phrase("status.worst-direction", "in the worst direction") : phrase("status.worst-heading", "at the worst heading"));
    setText(byId("rms", HTMLElement), degrees(rms));
    setField("target", state.target_deg);
    setField("dip", state.dip_deg);
    byId("dip-assumed", HTMLElement).hidden = !state.dip_assumed;
    const goal = byId("goal", HTMLSelectElement);
    if (document.activeElement !== goal) goal.value = state.goal;
    drawPhase(state);
    drawSource(state);
    drawAdvice(state);
    drawLegend();
    for (const { controls } of panels) controls?.show(state);
    byId("clear", HTMLElement).hidden = state.opened !== null;
    const pause = byId("pause", HTMLButtonElement);
    pause.hidden = state.opened !== null || state.finished !== null;
    pause.setAttribute("aria-pressed", String(state.paused));
    setIcon(pause, state.paused ? "play" : "pause");
    const label = pause.querySelector("span");
    if (label) setText(label, state.paused ? phrase("go-on", "Go on") : phrase("pause", "Pause"));
    finish.name(state);
    byId("back", HTMLElement).hidden = state.opened === null || state.source.kind === "file";
    document.title = worst === null ? "Flinders" : `${degrees(worst)} · ${phaseTitle(state.phase)} · Flinders`;
}

/** @param {State} state */
function drawPhase(state) {
    const panel = byId("status-title", HTMLElement).closest(".status");
    const title = byId("phase", HTMLElement);
    const isResult = isEnded(state) && state.phase === "collecting" && state.told !== "fitting";
    const isLevel = state.phase === "limited" && isGoodWhileLevel(store.view, state.goal);
    const shownPhase = isLevel && guide.lead && staysLevel(guide.lead.body) ? "good" : state.phase; // headings while level are the best result for a vehicle that stays level
    if (panel instanceof HTMLElement) panel.dataset.phase = shownPhase;
    setIcon(title, ICONS[isResult ? "limited" : shownPhase]);
    const strong = title.querySelector("strong");
    const reached = isLevel ? whileLevelTitle() : phaseTitle(state.phase);
    const result = store.view ? phrase("verdict.misses", "Misses the target") : phrase("verdict.none", "No calibration");
    const shownTitle = state.paused && !state.finished ? phrase("phase.paused", "Paused") : isResult ? result : reached;
    const words = state.words.startsWith(`${shownTitle}: `) ? capital(state.words.slice(shownTitle.length + 2)) : state.words; // "Good: …"
    if (strong) setText(strong, shownTitle);
    const shown = state.phase === "waiting" || isStill(state, store.view) ? "" : words; // the middle of the page shows these words
    setText(byId("phase-words", HTMLElement), state.phase === "wrong" ? gravestFault(state) : shown);
    const others = state.reasons.filter(({ code }) => code !== state.told);
    setList(byId("reasons", HTMLElement), others, (reason) => {
        const row = element("li", sentence(reason.advice));
        row.dataset.severity = reason.severity;
        return row;
    });
    say("phase", `${shownTitle}. ${words}`); // the whole sentence, so that no fault is announced twice
}

/**
 * The most severe fault in a few words, with the details that the large type omits.
 * @param {State} state
 * @returns {string}
 */
function gravestFault({ reasons, words }) {
    const reason = reasons.find(({ severity }) => severity === "warning");
    const title = reason && faultTitle(reason.code);
    const [, details] = brief(words);
    return [title, details && sentence(capital(details))].filter(Boolean).join(" ");
}

/** @param {State} state */
function drawSource({ phase, source, readings, rejected, excluded_readings, rate_hz, seconds, recording, opened }) {
    byId("source", HTMLElement).dataset.link = opened === null ? source.link : "ended";
    setText(byId("source-name", HTMLElement), opened ?? sourceTitle(source.name));
    const waiting = phrase("source.waiting", "waiting");
    const links = { connected: "", waiting, gone: phrase("source.gone", "gone"), ended: phrase("source.ended", "ended") };
    const counts = [
        phase === "waiting" ? waiting : opened === null ? links[source.link] : phrase("source.log", "a log"),
        opened === null ? frequency(rate_hz ?? 0) : "",
        readings > 0 && seconds !== null ? duration(seconds) : "",
        readings > 0 ? things(readings, "reading") : "",
        rejected > 0 ? `${things(rejected, "outlier")}` : "",
        excluded_readings > 0 ? phrase("source.left-out", "{count} left out", { count: countText(excluded_readings) }) : "",
    ];
    const words = counts.filter(Boolean).join(" · ");
    setText(byId("source-words", HTMLElement), words);
    byId("source", HTMLElement).title = [sourceTitle(source.name), remarkWords(source.words), words, recording ? phrase("source.recorded", "recorded to {file}", { file: recording }) : ""].filter(Boolean).join("\n");
}

/** @param {State} state */
function drawAdvice(state) {
    drawEmpty(state);
    setText(byId("since", HTMLElement), sinceWords(state));
    showRemedies(byId("remedies", HTMLElement), state, send);
    byId("advice", HTMLElement).dataset.phase = state.phase;
    say("advice", state.phase === "wrong" ? "" : (guide.lead?.words ?? "")); // the phase shows the fault
}

/**
 * Example of code that sends a reading, for each source.
 * @type {Readonly<Record<string, string>>}
 */
const EXAMPLES = Object.freeze({
    serial: 'Serial.println(String(mx) + "," + my + "," + mz);',
    udp: "12.3,-45.6,7.8",
    tcp: "12.3,-45.6,7.8",
});

/**
 * Whether no further readings will arrive: for a log, or a playback that has ended.
 * @param {State} state
 */
function isEnded(state) {
    return !goesOn(state) && state.readings > 0;
}

/**
 * Whether a live sensor has not been turned yet.
 * @param {State} state
 * @param {View | null} view
 * @returns {boolean}
 */
function isStill(state, view) {
    return view === null && goesOn(state) && state.readings > 0 && state.reasons.some(({ code }) => code === "no-rotation");
}

/**
 * Draw the placeholder of the sphere: the source, and an example that sends readings to it.
 * @param {State} state
 */
function drawEmpty({ phase, readings, source }) {
    const isEmpty = readings === 0;
    byId("empty", HTMLElement).hidden = !isEmpty;
    byId("stage", HTMLElement).toggleAttribute("data-empty", isEmpty);
    setText(byId("empty-lead", HTMLElement), phase === "waiting" ? phrase("empty.waiting", "Waiting for readings") : phrase("empty.none", "No readings"));
    setText(byId("empty-from", HTMLElement), phrase("empty.from", "from {name}", { name: sourceTitle(source.name) }));
    byId("empty-board", HTMLElement).hidden = phase !== "waiting" || !EXAMPLES[source.kind];
    setText(byId("empty-example", HTMLElement), EXAMPLES[source.kind] ?? "");
}

let legendDrawn = "";

/** Draw the legend of the colours. */
function drawLegend() {
    const rows = legendOf(store.state, store.view, mode(), theme());
    const key = JSON.stringify(rows);
    if (legendDrawn === key) return;
    legendDrawn = key;
    byId("legend", HTMLElement).replaceChildren(...rows.map(legendRow));
}

// Scene -------------------------------------------------------------------------------------------------------------

/** Load the sphere, a separate module, after the first frame; the page works without it. */
async function startScene() {
    const tiles = store.hello?.tiles;
    if (sceneAsked || !tiles) return;
    sceneAsked = true;
    const host = byId("scene", HTMLElement);
    await nextPaint();
    try {
        const { Scene: Made } = await import("./views/scene.js");
        scene = new Made(host, { tiles, theme: theme(), interactive: true });
    } catch (error) {
        console.warn("flinders: no 3-D view:", error);
        const without = byId("without", HTMLElement);
        without.hidden = false;
        setText(without, phrase("scene.none", "This browser cannot show the 3-D view. The gauge, the advice, the projections and the exports work."));
        return;
    }
    scene.setMode(mode());
    host.addEventListener("pointermove", ({ pointerType, buttons, clientX, clientY }) => {
        if (pointerType === "touch" || buttons) return;
        const { left, top } = host.getBoundingClientRect();
        hover(scene?.readingAt(clientX - left, clientY - top) ?? null);
    });
    host.addEventListener("pointerleave", () => hover(null));
    sceneFrom = 0;
    drawAll();
}

/** Wait until the drawing is on the screen; for a hidden page, one second. */
function nextPaint() {
    return new Promise((resolve) => {
        requestAnimationFrame(() => requestAnimationFrame(() => window.setTimeout(resolve)));
        window.setTimeout(resolve, 1000);
    });
}

/** @type {View | null} */
let sceneView = null;
/** @type {readonly number[] | null} where the arrow leads */
let sceneTarget = null;
let maskKey = "";

/**
 * Guidance whose arrow on the sphere leads to the direction of the page's advice.
 * @param {View} view
 * @param {readonly number[] | null} target
 * @returns {View["guidance"]}
 */
function guidanceTo({ guidance }, target) {
    if (!target || !guidance) return null;
    return { ...guidance, direction: [target[0], target[1], target[2]] };
}

/**
 * @param {View | null} view
 * @param {State | null} state
 */
function drawScene(view, state) {
    if (!scene) return;
    if (sceneFrom === 0) scene.setPoints(store.points);
    else if (sceneFrom < store.points.count) scene.appendPoints(store.points, sceneFrom);
    sceneFrom = store.points.count;
    if (state) scene.setTarget(state.target_deg);
    const target = guide.lead?.target ?? null;
    if (view !== sceneView || target !== sceneTarget) {
        [sceneView, sceneTarget] = [view, target];
        scene.setView(view && { ...view, guidance: guidanceTo(view, target) });
    }
    const spans = state?.excluded ?? [];
    const key = JSON.stringify([spans, view?.rejected ?? [], store.points.stride]);
    if (key !== maskKey) {
        maskKey = key;
        scene.setMask(spans, view?.rejected ?? []);
    }
}

/** Switch of the drawing mode, and names of its choices for the shortcuts. */
const modes = /** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll('input[name="mode"]'));
const MODE_WORDS = [phrase("keys.sphere", "sphere"), phrase("keys.clouds", "both clouds"), phrase("keys.raw", "raw readings"), phrase("keys.corrected", "corrected readings")];

/** @returns {import("../../../static/views/scene.js").Mode} */
function mode() {
    const chosen = [...modes].find(({ checked }) => checked);
    return /** @type {import("../../../static/views/scene.js").Mode} */ (chosen?.value ?? "sphere");
}

/** @param {number} which */
function chooseMode(which) {
    modes[which].checked = true;
    applyMode();
}

function applyMode() {
    scene?.setMode(mode());
    drawLegend();
}

// Words -------------------------------------------------------------------------------------------------------------

/** @type {Map<string, string>} */
const toSay = new Map();
/** @type {Map<string, string>} */
const saidBefore = new Map();
let sayTimer = 0;

/**
 * Announce news to a screen reader, with a limited rate.
 * @param {string} topic
 * @param {string} words
 */
function say(topic, words) {
    if (saidBefore.get(topic) === words) {
        toSay.delete(topic);
        return;
    }
    toSay.set(topic, words);
    if (sayTimer) return;
    sayTimer = window.setTimeout(() => {
        sayTimer = 0;
        if (toSay.size === 0) return;
        for (const [name, text] of toSay) saidBefore.set(name, text);
        setText(byId("said", HTMLElement), [...toSay.values()].join(" "));
        toSay.clear();
    }, SAID_MS);
}

/**
 * Show a notice. Errors stay until they are closed.
 * @param {"info" | "warning" | "error"} severity
 * @param {string} words
 * @returns {() => void} Removes the notice.
 */
function notify(severity, words) {
    const list = byId("notices", HTMLElement);
    list.querySelector(`[data-words="${CSS.escape(words)}"]`)?.remove();
    const shut = element("button", [icon("close")], "square quiet");
    shut.setAttribute("aria-label", phrase("notice.close", "Close this notice"));
    shut.addEventListener("click", () => row.remove());
    const row = element("li", [icon(ICONS[severity]), element("span", sentence(words)), shut]);
    Object.assign(row.dataset, { severity, words });
    (document.querySelector("dialog[open]") ?? document.body).append(list); // an open dialog makes the rest of the page inert
    list.append(row);
    while (list.children.length > 4) list.firstElementChild?.remove();
    if (severity !== "error") window.setTimeout(() => row.remove(), NOTICE_MS);
    return () => row.remove();
}

// Fields and buttons ------------------------------------------------------------------------------------------------

/**
 * Show a number of the state, unless the user is editing the field.
 * @param {string} id
 * @param {number} value
 */
function setField(id, value) {
    const field = byId(id, HTMLInputElement);
    const text = String(Number(value.toPrecision(6)));
    if (document.activeElement !== field && field.value !== text) field.value = text;
}

/**
 * Send an edited number; an invalid one is replaced by the current value.
 * @param {string} id
 * @param {(value: number) => Command} message
 * @param {() => number | undefined} current
 */
function onNumber(id, message, current) {
    const field = byId(id, HTMLInputElement);
    field.addEventListener("change", () => {
        if (field.value !== "" && field.checkValidity()) {
            send(message(field.valueAsNumber));
            return;
        }
        notify("warning", phrase("field.refused", "{value} cannot be used here: need a number from {min} to {max}.", { value: field.value || phrase("field.nothing", "Nothing"), min: numeral(field.min), max: numeral(field.max) }));
        const value = current();
        if (value !== undefined) field.value = String(value);
    });
    field.addEventListener("keydown", (event) => {
        if (event.key === "Enter") field.blur();
    });
}

/**
 * @param {string} id
 * @param {() => void} act
 */
function onClick(id, act) {
    byId(id, HTMLElement).addEventListener("click", act);
}

onNumber("target", (deg) => ({ type: "target", deg }), () => store.state?.target_deg);
listenForPlace(send);
onNumber("dip", (deg) => ({ type: "dip", deg }), () => store.state?.dip_deg);
byId("goal", HTMLSelectElement).addEventListener("change", () => {
    const goal = byId("goal", HTMLSelectElement).value === "attitude" ? "attitude" : "heading";
    send({ type: "goal", goal });
});
for (const choice of modes) choice.addEventListener("change", applyMode);

const togglePause = () => {
    if (store.state && store.state.opened === null) send({ type: "pause", paused: !store.state.paused });
};
const collect = () => {
    if (store.state?.finished) send({ type: "collect" });
};
const confirmClear = () => {
    if (store.state && store.state.opened === null) byId("confirm", HTMLDialogElement).showModal();
};
const openHelp = () => byId("help-panel", HTMLDialogElement).showModal();
const chooseLog = () => byId("log-file", HTMLInputElement).click();

onClick("pause", togglePause);
onClick("clear", confirmClear);
onClick("confirmed", () => {
    byId("confirm", HTMLDialogElement).close();
    send({ type: "clear" });
});
onClick("finish", () => finish.open());
onClick("help", openHelp);
onClick("theme", toggleTheme);
onClick("open", chooseLog);
onClick("retry", () => link.retry());
onClick("back", () => send({ type: "back_to_live" }));
onClick("advice-words", () => byId("advice", HTMLElement).classList.toggle("whole")); // a phone shortens it
onClick("reset", () => scene?.resetCamera());
onClick("previous", () => byId("previous-file", HTMLInputElement).click());
onClick("previous-clear", () => send({ type: "previous_clear" }));
onClick("collect", () => {
    finish.close();
    collect();
});
onClick("refresh", () => {
    send({ type: "refresh", refresh: byId("refresh", HTMLInputElement).checked });
    finish.make();
});
document.addEventListener("close", () => document.body.append(byId("notices", HTMLElement)), true); // the event does not bubble
document.addEventListener("click", ({ target }) => {
    if (target instanceof Element && target.matches("dialog, dialog .shut, dialog .shut *")) target.closest("dialog")?.close();
});

// Files -------------------------------------------------------------------------------------------------------------

/**
 * Upload a file, to be opened or to be compared with.
 * @param {"open" | "previous"} what
 * @param {File} file
 */
async function upload(what, file) {
    const limit = store.hello?.limits.upload_bytes ?? Infinity;
    if (file.size > limit) {
        const mib = (/** @type {number} */ bytes) => `${(bytes / 2 ** 20).toFixed(1)} MiB`;
        notify("error", phrase("drop.too-large", "{name} holds {size}; this page takes up to {limit}. Use flinders calibrate for larger logs.", { name: file.name, size: mib(file.size), limit: mib(limit) }));
        return;
    }
    const done = what === "open" ? notify("info", phrase("drop.reading", "Reading {name} …", { name: file.name })) : () => {};
    try {
        await link[what](file.name, file);
    } catch (error) {
        if (!(error instanceof Refusal)) throw error;
        notify("error", error.message);
    } finally {
        done();
    }
}

for (const [id, what] of /** @type {const} */ ([["log-file", "open"], ["previous-file", "previous"]])) {
    const input = byId(id, HTMLInputElement);
    input.addEventListener("change", () => {
        const file = input.files?.[0];
        if (file) upload(what, file);
        input.value = "";
    });
}

let dragged = 0;
const drop = byId("drop", HTMLElement);
const hasFiles = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files") ?? false;
window.addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    dragged += 1;
    setText(drop.firstElementChild ?? drop, finish.isOpen ? phrase("drop.compare", "Drop the earlier calibration to compare with it") : phrase("drop.open", "Drop the log to open it"));
    drop.hidden = false;
});
window.addEventListener("dragleave", (event) => {
    if (!hasFiles(event)) return;
    dragged -= 1;
    drop.hidden = dragged <= 0;
});
window.addEventListener("dragover", (event) => {
    if (hasFiles(event)) event.preventDefault();
});
window.addEventListener("drop", (event) => {
    dragged = 0;
    drop.hidden = true;
    if (!hasFiles(event)) return;
    event.preventDefault();
    const files = event.dataTransfer?.files;
    if (!files || files.length === 0) return;
    if (files.length > 1) notify("info", phrase("drop.several", "One file at a time: opening {name}.", { name: files[0].name }));
    upload(finish.isOpen ? "previous" : "open", files[0]);
});

// Theme, enlarging, keys --------------------------------------------------------------------------------------------

/** @returns {"dark" | "light"} */
function theme() {
    return document.documentElement.dataset.theme === "light" ? "light" : "dark";
}

function toggleTheme() {
    const next = theme() === "dark" ? "light" : "dark";
    document.documentElement.dataset.theme = next;
    remember(THEME, next);
    applyTheme();
}

function applyTheme() {
    setIcon(byId("theme", HTMLElement), theme() === "dark" ? "sun" : "moon");
    scene?.setTheme(theme());
    drawAll();
}

/** @param {HTMLElement} panel */
function enlarge(panel) {
    const is = panel.classList.toggle("enlarged");
    const button = panel.querySelector(".enlarge");
    if (button instanceof HTMLElement) {
        setIcon(button, is ? "close" : "enlarge");
        button.setAttribute("aria-expanded", String(is));
    }
    drawAll();
}

for (const button of document.querySelectorAll(".enlarge")) {
    const panel = button.closest(".panel");
    button.setAttribute("aria-expanded", "false");
    if (panel instanceof HTMLElement) button.addEventListener("click", () => enlarge(panel));
}

function escape() {
    const large = document.querySelector(".panel.enlarged");
    if (panels.some(({ controls }) => controls?.escape())) return;
    if (large instanceof HTMLElement) enlarge(large);
}

/** Let keys act on the page only if no dialog is open. */
const onPage = (/** @type {() => void} */ act) => () => {
    if (!document.querySelector("dialog[open]")) act();
};

const shortcuts = [
    { keys: ["?"], words: phrase("keys.help", "this help"), act: onPage(openHelp) },
    { keys: ["f"], words: phrase("keys.finish", "finish: verdict, exports, what to keep"), act: onPage(() => finish.open()) },
    { keys: ["o"], words: phrase("keys.open", "open a log"), act: onPage(chooseLog) },
    { keys: ["m"], words: phrase("keys.collect", "collect more, once it is finished"), act: onPage(collect) },
    { keys: ["p"], words: phrase("keys.pause", "pause, go on"), act: onPage(togglePause) },
    { keys: ["n"], words: phrase("keys.clear", "start again"), act: onPage(confirmClear) },
    { keys: ["t"], words: phrase("keys.target", "type a target"), act: onPage(() => byId("target", HTMLInputElement).select()) },
    ...panels.flatMap(({ controls }) => controls?.shortcuts ?? []).map(({ act, ...key }) => ({ ...key, act: onPage(act) })),
    ...MODE_WORDS.map((words, i) => ({ keys: [String(i + 1)], words, act: onPage(() => chooseMode(i)) })),
    { keys: ["r"], words: phrase("keys.reset", "reset the view"), act: onPage(() => scene?.resetCamera()) },
    { keys: ["l"], words: phrase("keys.theme", "light or dark"), act: onPage(toggleTheme) },
    { keys: ["c"], words: phrase("keys.copy", "copy the export, where the finish panel is open"), act: () => finish.isOpen && byId("copy", HTMLButtonElement).click() },
    { keys: ["escape"], words: phrase("keys.escape", "take the mark away, close what is open"), act: onPage(escape) },
];
listen(shortcuts);
byId("keys", HTMLElement).replaceChildren(...rows(shortcuts));
const single = byId("single-keys", HTMLInputElement);
single.checked = singleKeys();
single.addEventListener("change", () => setSingleKeys(single.checked));
window.matchMedia("(prefers-color-scheme: light)").addEventListener("change", (event) => {
    if (recall(THEME) !== null) return;
    document.documentElement.dataset.theme = event.matches ? "light" : "dark";
    applyTheme();
});
applyTheme();
new ResizeObserver(([{ target }]) => {
    document.documentElement.style.setProperty("--foot", `${Math.ceil(target.getBoundingClientRect().height)}px`);
}).observe(byId("advice", HTMLElement)); // on a phone it covers the foot of the page
