/**
 * The page of a station: serial number, motion to make, and a result that is readable from two metres.
 *
 * The program holds the state and decides; this page requests it four times a second. The session of the live page
 * decides whether a unit has been turned enough, and draws the turns.
 */

import { byId, element, icon, remember, setIcon, setList, setText } from "../dom.js";
import { RelayLink } from "../relay.js";
import { Fitter } from "../standalone/fitter.js";
import { ANY_ANGLE_DEG } from "../standalone/wording.js";
import { errors, Store } from "../store.js";
import { Guide, LeadView } from "../views/lead.js";
import { degrees, duration, frequency } from "../views/words.js";

/** @typedef {import("./station.d.ts").StationState} StationState */
/** @typedef {import("./station.d.ts").PageFacts} PageFacts */
/** @typedef {import("./station.d.ts").Asked} Asked */
/** @typedef {import("../relay.js").ServedData} ServedData */

const ASK_MS = 250;
const WORDS = { pass: "PASS", fail: "FAIL", aborted: "STOPPED" };
const ICONS = { pass: "good", fail: "wrong", aborted: "stopped" };
const LINKS = { connected: "connected", waiting: "waiting for readings", gone: "unplugged", ended: "ended" };
const LOST = "Flinders does not answer. The recording is safe on its machine.";

const store = new Store();
const guide = new Guide();
const leadView = new LeadView(guide, () => {});
const serial = byId("serial", HTMLInputElement);
const operator = byId("operator", HTMLInputElement);
/** @type {PageFacts} */
let facts;
/** @type {StationState | null} */
let state = null;
let heardAt = 0;
let isFinishing = false;
/** Number that rises with each request and each answer; a state requested before its rise is outdated, and dropped. */
let turn = 0;
let isRefreshing = false;
let frameAsked = false;

start();

async function start() {
    try {
        const [data, told] = await Promise.all(["page.json", "station-facts.json"].map(load));
        facts = told;
        guide.chosen = facts.motion.body;
        setText(byId("station-name", HTMLElement), facts.name ? `Station ${facts.name}` : "Station");
        const fitter = new Fitter("static/worker.js", new URL("flinders.wasm", document.baseURI).href, data.engine);
        const socket = new URL("socket", document.baseURI).href.replace(/^http/, "ws");
        const link = new RelayLink(socket, listener, fitter, /** @type {ServedData} */ (data));
        Object.defineProperty(window, "flinders", { value: Object.freeze({ store, connection: link, station: () => state }) });
    } catch (error) {
        lose(`This page could not be loaded: ${error instanceof Error ? error.message : error}.`);
        return;
    }
    document.addEventListener("keydown", onKey);
    serial.addEventListener("keydown", onSerialKey);
    operator.addEventListener("keydown", onNameKey);
    serial.addEventListener("blur", () => window.setTimeout(attend));
    byId("theme", HTMLElement).addEventListener("click", turnTheme);
    window.setInterval(refresh, ASK_MS);
    refresh();
}

/** @param {string} address */
async function load(address) {
    const answer = await fetch(address, { cache: "no-store" });
    if (!answer.ok) throw new Error(`${address} gave ${answer.status}`);
    return answer.json();
}

/** @type {import("../standalone/running.js").Listener} */
const listener = {
    onMessage(message) {
        if (message.type === "notice") return;
        store.take(message);
        askFrame();
    },
    onReadings(series, stride) {
        if (store.follow(series, stride) !== Infinity) askFrame();
    },
    onLink() {},
};

// What the operator does ------------------------------------------------------------------------------------------------

/**
 * Send a request to the program, and show its answer.
 * @param {Partial<Asked> & {do: Asked["do"]}} asked
 */
async function ask(asked) {
    setText(byId("refusal", HTMLElement), "");
    turn += 1;
    try {
        const answer = await fetch("station", { method: "POST", body: JSON.stringify(asked) });
        const said = await answer.json();
        turn += 1;
        if (answer.ok) take(said);
        else setText(byId("refusal", HTMLElement), said.words);
    } catch {
        lose(LOST);
    }
}

async function refresh() {
    if (isRefreshing) return;
    isRefreshing = true;
    const begun = turn;
    try {
        const said = await load("station.json");
        if (begun === turn) take(said);
    } catch {
        lose(LOST);
    }
    isRefreshing = false;
}

/** @param {string} words */
function lose(words) {
    byId("lost", HTMLElement).hidden = false;
    setText(byId("lost-words", HTMLElement), words);
}

/** @param {StationState} said */
function take(said) {
    const before = state?.phase;
    state = said;
    heardAt = performance.now();
    byId("lost", HTMLElement).hidden = true;
    if (before !== said.phase) {
        serial.value = "";
        document.body.dataset.phase = said.phase;
    }
    drawStation(said);
    attend();
    askFrame();
}

/** Move the focus to the field for serial numbers whenever one is needed. */
function attend() {
    if (document.activeElement === operator) return;
    if (state && ["testing", "judging"].includes(state.phase)) serial.blur();
    else if (document.activeElement !== serial) serial.focus();
}

/** @param {KeyboardEvent} event */
function onKey(event) {
    if (event.repeat || !state) return;
    if (event.key === "Escape") {
        event.preventDefault();
        serial.value = "";
        ask({ do: state.phase === "result" ? "next" : "abort" });
    } else if (event.key === "F2") {
        event.preventDefault();
        operator.focus();
        operator.select();
    }
}

/** Handle a key in the serial number's field; a scanner ends with Enter or Tab. @param {KeyboardEvent} event */
function onSerialKey(event) {
    const isEnter = event.key === "Enter" || (event.key === "Tab" && serial.value !== "");
    const isSpace = event.key === " " && serial.value === "";
    if (!isEnter && !isSpace && event.key !== "Tab") return;
    event.preventDefault();
    if (event.repeat || !state || event.key === "Tab" && !isEnter) return;
    const number = serial.value.trim();
    serial.value = "";
    if (number) ask({ do: "start", serial: number });
    else if (state.phase === "result") ask({ do: "next" });
    else if (isEnter) ask({ do: "start", again: state.phase === "confirm" });
}

/** @param {KeyboardEvent} event */
function onNameKey(event) {
    if (event.key === "Enter" || event.key === "Tab") {
        event.preventDefault();
        ask({ do: "operator", name: operator.value });
    }
    if (event.key === "Escape" && state) operator.value = state.operator;
    if (["Enter", "Tab", "Escape"].includes(event.key)) {
        event.stopPropagation();
        operator.blur();
        attend();
    }
}

function turnTheme() {
    const root = document.documentElement;
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    remember("flinders-theme", root.dataset.theme);
    attend();
}

// Drawing ---------------------------------------------------------------------------------------------------------------

function askFrame() {
    if (frameAsked) return;
    frameAsked = true;
    requestAnimationFrame((now) => {
        frameAsked = false;
        draw(now / 1000);
    });
}

/** @param {number} at  seconds */
function draw(at) {
    drawSource();
    if (!state || !store.state) return;
    const isTesting = state.phase === "testing" && !store.state.paused;
    const lead = guide.follow(store, at);
    if (!isTesting || !lead) return;
    if (store.now && store.view) leadView.turn(store.now, store.view);
    if (facts.motion.steps.length === 0) leadView.draw(store.state, store.view, lead);
    else drawStep();
    drawProgress();
    const { phase } = store.state;
    if (facts.motion.steps.length === 0 && (phase === "good" || (facts.takes_limited && phase === "limited" && lead.kind === "done"))) finish();
    askFrame();
}

/** End the test of a unit that has been turned enough; repeat the request without an answer. */
async function finish() {
    if (isFinishing) return;
    isFinishing = true;
    await ask({ do: "finish" });
    window.setTimeout(() => (isFinishing = false), ASK_MS);
}

/** Seconds since the start of the test. */
function elapsedSeconds() {
    return state ? state.seconds + (performance.now() - heardAt) / 1000 : 0;
}

/** Draw the present timed step and the next one; a fault takes precedence. */
function drawStep() {
    const { steps } = facts.motion;
    let left = elapsedSeconds();
    const place = steps.findIndex(({ seconds }) => (left -= seconds) < 0);
    const step = steps[place < 0 ? steps.length - 1 : place];
    const next = place < 0 ? undefined : steps[place + 1];
    const isWrong = store.state?.phase === "wrong" && store.state.words;
    byId("hand", HTMLElement).hidden = true;
    byId("advice", HTMLElement).hidden = false;
    setText(byId("advice-words", HTMLElement), isWrong || step.words);
    setText(byId("then", HTMLElement), next ? `Then: ${next.words}` : "");
}

function drawProgress() {
    if (!state) return;
    const share = Math.min(elapsedSeconds() / state.time_s, 1);
    const bar = byId("bar", HTMLElement);
    bar.style.width = `${(100 * share).toFixed(1)}%`;
    bar.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    setText(byId("time-left", HTMLElement), `${duration(Math.max(state.time_s - elapsedSeconds(), 0))} left`);
    const { worst } = errors(store.view, "heading");
    setText(byId("error-now", HTMLElement), worst === null || worst >= ANY_ANGLE_DEG ? "" : `Heading error ${degrees(worst)}, target ${degrees(facts.target_deg)}`);
}

function drawSource() {
    const { state: session } = store;
    if (!session) return;
    byId("source", HTMLElement).dataset.link = session.source.link;
    setText(byId("source-name", HTMLElement), session.source.name);
    setText(byId("source-words", HTMLElement), [LINKS[session.source.link], frequency(session.rate_hz ?? 0)].filter(Boolean).join(" · "));
}

/** @param {StationState} now */
function drawStation(now) {
    setText(byId("passed", HTMLElement), String(now.passed));
    setText(byId("failed", HTMLElement), String(now.failed));
    if (document.activeElement !== operator) operator.value = now.operator;
    setText(byId("question", HTMLElement), now.asked);
    setText(byId("serial-label", HTMLElement), now.phase === "ready" ? "Serial number" : now.phase === "confirm" ? "Test it again?" : "Next serial number");
    serial.placeholder = now.phase === "ready" ? now.board_serial : "";
    setText(byId("hint", HTMLElement), hintOf(now));
    setText(byId("testing-unit", HTMLElement), now.phase === "judging" ? `${now.serial}: judging …` : now.serial);
    const trouble = byId("trouble", HTMLElement);
    trouble.hidden = now.trouble === "";
    setText(trouble, now.trouble && `${now.trouble}. The result is kept, and written before the next unit begins.`);
    drawResult(now);
    setList(byId("newest", HTMLElement), now.newest, ({ serial: unit, result }) => {
        const row = element("li", [icon(ICONS[result]), unit]);
        row.dataset.result = result;
        row.title = WORDS[result];
        return row;
    });
}

/** @param {StationState} now */
function hintOf({ phase, board_serial: said }) {
    if (phase === "confirm") return "Enter: test it again · Escape: back";
    if (phase === "result") return "Scan the next unit, or press Enter";
    if (store.state?.source.link === "gone") return "No unit is connected: connect the next one, and scan its label";
    return said ? `Enter tests ${said}` : "Scan the label, or type it and press Enter";
}

/** @param {StationState} now */
function drawResult({ result }) {
    if (!result) return;
    const [first, ...others] = result.reasons;
    const outcome = byId("outcome", HTMLElement);
    outcome.dataset.result = result.result;
    setIcon(outcome, ICONS[result.result]);
    setText(byId("unit", HTMLElement), result.serial);
    setText(byId("verdict-word", HTMLElement), WORDS[result.result]);
    setText(byId("reason", HTMLElement), first?.words ?? "");
    setText(byId("remedy", HTMLElement), first?.remedy ?? "");
    setText(byId("others", HTMLElement), others.map(({ words }) => words).join(" "));
    setList(byId("measured", HTMLElement), result.numbers, ([name, number]) => element("div", [element("dt", name), element("dd", number)]));
}
