/** The choice of the source of readings: the first view of the page, and a button of its bar. */

import { byId, Refusal, setText } from "../dom.js";
import { sentence } from "../views/words.js";
import { Board, Phone, serial, Simulated } from "./sources.js";
import { phrase } from "../language.js";

/** @typedef {import("./link.js").OwnLink} OwnLink */
/** @typedef {import("./link.js").PageData} PageData */

const PASTED = "pasted text";

export class Choice {
    /**
     * @param {OwnLink} link
     * @param {PageData} data
     */
    constructor(link, data) {
        this.link = link;
        this.data = data;
        this.panel = byId("start", HTMLElement);
        this.words = byId("start-answer", HTMLElement);
        link.onChange = () => this.follow();
        this.onClick("use-board", () => this.board());
        this.onClick("use-phone", () => link.use(new Phone()));
        this.onClick("use-simulation", () => link.use(new Simulated(data.simulated, speed())));
        byId("use-log", HTMLElement).addEventListener("click", () => byId("log-file", HTMLInputElement).click());
        byId("connect", HTMLElement).addEventListener("click", () => this.show(this.panel.hidden));
        byId("start-close", HTMLElement).addEventListener("click", () => this.show(false));
        this.listenForText();
    }

    /** Show the choice if there is nothing else to show. */
    follow() {
        this.show(!this.link.isUsed);
    }

    /** @param {boolean} isShown */
    show(isShown) {
        this.panel.hidden = !isShown;
        setText(this.words, "");
        if (document.documentElement.hasAttribute("data-start") !== isShown) byId("page", HTMLElement).scrollTo(0, 0);
        document.documentElement.toggleAttribute("data-start", isShown);
        for (const id of ["start-close", "connect"]) byId(id, HTMLElement).hidden = !this.link.isUsed;
    }

    /**
     * Run an action, and show its refusal.
     * @param {() => Promise<unknown>} act
     */
    async attempt(act) {
        setText(this.words, "");
        try {
            await act();
        } catch (error) {
            if (!(error instanceof Refusal)) throw error;
            this.show(true);
            setText(this.words, sentence(error.message));
        }
    }

    /**
     * @param {string} id
     * @param {() => Promise<unknown>} act
     */
    onClick(id, act) {
        byId(id, HTMLElement).addEventListener("click", () => this.attempt(act));
    }

    /** Let the user choose a port, and read it. */
    async board() {
        const ports = serial();
        if (!ports) throw new Refusal(phrase("start.no-serial", "This browser cannot open ports: use Chrome or Edge on a computer, or drop a file with the board's output here."));
        const port = await ports.requestPort().catch(() => {
            throw new Refusal(phrase("start.no-port", "No port was chosen. If the board is missing in the list, plug it in, or install its driver."));
        });
        await this.link.use(new Board(ports, port, Number(byId("baud", HTMLSelectElement).value), this.data));
    }

    /** Open text that is pasted anywhere except in other fields, or typed into the page's field. */
    listenForText() {
        const area = byId("paste", HTMLTextAreaElement);
        const open = (/** @type {string} */ text) => this.attempt(() => this.link.open(PASTED, new Blob([text])));
        area.addEventListener("change", () => {
            if (area.value) open(area.value);
            area.value = "";
        });
        document.addEventListener("paste", (event) => {
            const text = event.clipboardData?.getData("text");
            const isField = event.target instanceof Element && event.target.matches("input, select");
            if (!text || isField || document.querySelector("dialog[open]")) return;
            event.preventDefault();
            open(text);
        });
    }
}

/** Speed of the simulation, from `?speed=` in the address. */
function speed() {
    return Math.max(Number(new URLSearchParams(window.location.search).get("speed")), 0) || 1;
}
