/** The present instruction on the page: sentence, drawing of the body with the turn's progress, and choice of the body. */

import { byId, element, remember, recall, setIcon, setText } from "../dom.js";
import { goesOn } from "../store.js";
import { advance, begin, BODIES, skipNeedless, SEQUENCES } from "../standalone/choreography.js";
import { lead } from "../standalone/lead.js";
import { Hand, nameOf, portrait, turnTowards } from "./hand.js";
import { DRAWN, LEVEL, product } from "../../../../static/views/turn.js";
import { phrase } from "../language.js";

/** @typedef {import("../messages.d.ts").SessionState} State */
/** @typedef {import("../../../../static/view.d.ts").View} View */
/** @typedef {import("../store.js").Store} Store */
/** @typedef {import("../standalone/choreography.js").Body} Body */
/** @typedef {import("../standalone/lead.js").Lead} Lead */
/** @typedef {import("./hand.js").Picture} Picture */

/** Key of the chosen body in the browser's storage. */
const KEY = "flinders-body";
/** Default body by the kind of source. @type {Readonly<Record<string, Body>>} */
const DEFAULT_BODIES = { phone: "phone", mavlink: "drone" };
/** Largest number of characters in the large type. */
const MAX_LARGE_LETTERS = 112;
/** Duration of one side of the general turn, s. */
const AROUND_S = 4;
const ICONS = { wait: "next", turn: "next", arrow: "next", around: "next", done: "good", wrong: "wrong", ended: "next", finished: "good" };

/** Updates the progress of the turns and the present instruction from the readings. */
export class Guide {
    /** @type {Body | null} chosen by the user */
    chosen = BODIES.find((body) => body === recall(KEY)) ?? null;
    choreography = begin(this.chosen ?? "board");
    /** @type {Lead | null} */
    lead = null;
    generation = -1;
    taken = 0;

    /**
     * Update from the data of the page.
     * @param {Store} store
     * @param {number} at  seconds
     * @returns {Lead | null}
     */
    follow({ state, view, points, now, generation, hello }, at) {
        if (!state || !hello) return null;
        const body = this.chosen ?? DEFAULT_BODIES[state.source.kind] ?? "board";
        if (generation !== this.generation || points.count < this.taken || body !== this.choreography.body) {
            this.choreography = begin(body);
            [this.generation, this.taken] = [generation, 0];
        }
        if (goesOn(state) && !state.paused) this.#read(points, view);
        this.taken = points.count;
        const { centres } = hello.tiles;
        this.choreography = skipNeedless(this.choreography, view, centres);
        this.lead = lead(this.lead, { at, state, view, choreography: this.choreography, raw: now?.raw ?? null, centres });
        return this.lead;
    }

    /** @param {import("../../../../static/view.d.ts").Points} points @param {View | null} view */
    #read({ count, time, field, acceleration }, view) {
        const from = this.taken;
        const readings = {
            time: time.subarray(from, count),
            field: field.subarray(3 * from, 3 * count),
            acceleration: acceleration && acceleration.subarray(3 * from, 3 * count),
        };
        this.choreography = advance(this.choreography, readings, view);
    }

    /** @param {Body} body */
    choose(body) {
        this.chosen = body;
        remember(KEY, body);
    }
}

/** Draws an instruction: the body beside the sphere, and the sentence above both. */
export class LeadView {
    /**
     * @param {Guide} guide
     * @param {() => void} redraw  called after the user has chosen a body
     */
    constructor(guide, redraw) {
        this.guide = guide;
        this.host = byId("hand", HTMLElement);
        this.hand = new Hand(this.host);
        this.caption = element("p", "", "caption");
        this.open = element("button", "", "quiet in-hand");
        this.open.setAttribute("aria-expanded", "false");
        this.open.addEventListener("click", () => this.#toggle(this.choices.hidden));
        this.choices = element("div", [element("p", phrase("hand.question", "What is in your hand?")), ...BODIES.map((body) => this.#choice(body, redraw))], "bodies");
        this.choices.setAttribute("role", "radiogroup");
        this.choices.setAttribute("aria-label", phrase("hand.label", "What is in your hand"));
        this.choices.hidden = guide.chosen !== null;
        this.host.append(this.caption, this.open, this.choices);
        this.since = -1; // time of the drawn arrow
    }

    /** @param {Body} body @param {() => void} redraw */
    #choice(body, redraw) {
        const button = element("button", [portrait(body), element("span", nameOf(body))]);
        button.setAttribute("role", "radio");
        button.dataset.body = body;
        button.addEventListener("click", () => {
            this.guide.choose(body);
            this.#toggle(false);
            redraw();
        });
        return button;
    }

    /** @param {boolean} isOpen */
    #toggle(isOpen) {
        this.choices.hidden = !isOpen;
        this.open.setAttribute("aria-expanded", String(isOpen));
    }

    /** The attitude follows each reading. @param {import("../../../../static/view.d.ts").Now} now @param {View} view */
    turn(now, view) {
        if (view.shown) this.hand.attitude.follow(now, view.shown);
    }

    /**
     * @param {State} state
     * @param {View | null} view
     * @param {Lead} now
     */
    draw(state, view, now) {
        const isTurning = ["turn", "arrow", "around"].includes(now.kind) && state.readings > 0;
        const stage = byId("stage", HTMLElement);
        stage.toggleAttribute("data-lead", isTurning);
        document.documentElement.toggleAttribute("data-lead", isTurning);
        this.host.hidden = !isTurning;
        this.#say(now);
        if (!isTurning) {
            this.hand.hide();
            return;
        }
        if (this.guide.chosen === null && now.step > 1) this.#toggle(false);
        setText(this.caption, captionOf(now));
        setText(this.open, nameOf(now.body));
        for (const button of this.choices.querySelectorAll("button")) {
            button.setAttribute("aria-checked", String(button.dataset.body === now.body));
        }
        this.hand.show(this.#picture(now, view), now.words, `${now.kind} ${now.body} ${now.since}`);
    }

    /** @param {Lead} now */
    #say({ kind, words }) {
        const advice = byId("advice", HTMLElement);
        advice.hidden = words === "";
        advice.dataset.lead = kind;
        setIcon(advice, ICONS[kind]);
        advice.classList.toggle("long", words.length > MAX_LARGE_LETTERS);
        setText(byId("advice-words", HTMLElement), words);
    }

    /** @param {Lead} now @param {View | null} view @returns {Picture} */
    #picture({ kind, body, step, of, progress, target, since }, view) {
        if (kind === "turn") {
            const { hold, axis, share } = SEQUENCES[body][step - 1];
            const parts = Array.from({ length: of }, (_, i) => (i + 1 < step ? 1 : i + 1 === step ? progress : 0));
            return { body, hold, axis, angle: 2 * Math.PI * share, now: 2 * Math.PI * share * progress, parts };
        }
        const { attitude } = this.hand;
        if (kind === "arrow" && target && attitude.field && view?.shown) {
            const drawn = DRAWN[view.guidance?.frame ?? "sensor"]; // the same for both frames
            if (this.since !== since && !attitude.isUpright) attitude.rotation = drawn;
            this.since = since;
            const hold = product(attitude.rotation, drawn);
            return { body, hold, ...turnTowards(attitude.rotation, target, attitude.field), now: 0, parts: [] };
        }
        const side = Math.floor(performance.now() / 1000 / AROUND_S) % 3;
        const axis = [0, 1, 2].map((i) => Number(i === side));
        return { body, hold: LEVEL, axis, angle: 2 * Math.PI, now: 0, parts: [] };
    }
}

/** @param {Lead} now */
function captionOf({ kind, step, of }) {
    if (kind === "turn") return phrase("hand.step", "Step {step} of {of}", { step, of });
    return kind === "arrow" ? phrase("hand.arrow", "Towards missing directions") : "";
}
