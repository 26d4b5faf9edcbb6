/**
 * Connection to the server: one WebSocket that reconnects by itself.
 *
 * The waits between attempts double up to eight seconds. Commands of the user are not queued without a connection, but
 * refused with a message, because other pages may have changed the session meanwhile.
 */

import { Refusal } from "./dom.js";
import { phrase } from "./language.js";

/** @typedef {import("./wire.d.ts").FromServer} FromServer */
/** @typedef {import("./wire.d.ts").Edits} Edits */
/** @typedef {import("./wire.d.ts").Previous} Previous */

const MIN_WAIT_MS = 500;
const MAX_WAIT_MS = 8000;
/** Longest silence of a connection, as the server sends a message every two seconds. */
const SILENCE_MS = 6000;

/**
 * Callbacks of the connection.
 * @typedef {object} Listener
 * @property {(message: FromServer) => void} onMessage
 * @property {(frame: ArrayBuffer) => void} onFrame
 * @property {(link: "open" | "lost" | "trying", seconds: number) => void} onLink
 *   Called each second while the connection is lost: `seconds` until the next attempt.
 */

export class Connection {
    /**
     * @param {string} address
     * @param {Listener} listener
     */
    constructor(address, listener) {
        this.address = address;
        this.listener = listener;
        this.wait = MIN_WAIT_MS;
        /** @type {WebSocket | null} */
        this.socket = null;
        this.timer = 0;
        this.heard = 0;
        window.setInterval(() => this.watch(), 1000);
        window.addEventListener("online", () => this.retry());
        this.open();
    }

    /** Whether messages reach the server. */
    get isOpen() {
        return this.socket?.readyState === WebSocket.OPEN;
    }

    /**
     * Send a message to the server.
     * @param {Edits | Previous} message
     * @returns {boolean} Whether it was sent.
     */
    send(message) {
        if (!this.isOpen || !this.socket) return false;
        this.socket.send(JSON.stringify(message));
        return true;
    }

    /**
     * Send a request to the server over HTTP.
     * @param {string} address
     * @param {RequestInit} [options]
     * @returns {Promise<Response>}
     * @throws {Refusal} With a message to show, for any failure.
     */
    async ask(address, options = {}) {
        let answer;
        try {
            answer = await fetch(address, { cache: "no-store", ...options });
        } catch {
            throw new Refusal(phrase("line.silent", "The server does not answer. Is flinders live still running?"));
        }
        if (answer.ok) return answer;
        const text = (await answer.text()).trim();
        throw new Refusal(refusalWords(text) || phrase("line.refused", "The server refuses, with status {status}.", { status: answer.status }));
    }

    /** Reconnect at once. */
    retry() {
        if (this.isOpen || this.socket?.readyState === WebSocket.CONNECTING) return;
        window.clearTimeout(this.timer);
        this.open();
    }

    open() {
        this.listener.onLink("trying", 0);
        const socket = new WebSocket(this.address);
        socket.binaryType = "arraybuffer";
        this.socket = socket;
        this.heard = performance.now();
        socket.addEventListener("message", (event) => {
            if (this.socket !== socket) return;
            this.heard = performance.now();
            if (typeof event.data !== "string") {
                this.listener.onFrame(event.data);
                return;
            }
            const message = /** @type {FromServer} */ (JSON.parse(event.data));
            if (message.type === "welcome") {
                this.wait = MIN_WAIT_MS;
                this.listener.onLink("open", 0);
            }
            this.listener.onMessage(message);
        });
        socket.addEventListener("close", () => this.lost(socket));
    }

    /**
     * @param {WebSocket} socket
     */
    lost(socket) {
        if (this.socket !== socket) return;
        this.socket = null;
        const again = performance.now() + this.wait;
        this.wait = Math.min(2 * this.wait, MAX_WAIT_MS);
        const count = () => {
            const left = again - performance.now();
            if (left <= 0) {
                this.open();
                return;
            }
            this.listener.onLink("lost", Math.ceil(left / 1000));
            this.timer = window.setTimeout(count, Math.min(left, 1000));
        };
        count();
    }

    /** Detect a connection that was lost without notice, as by a cable or a sleeping laptop. */
    watch() {
        const socket = this.socket;
        if (document.hidden) this.heard = performance.now();
        if (!socket) return;
        if (performance.now() - this.heard > SILENCE_MS) {
            socket.close();
            this.lost(socket);
        }
    }
}

/**
 * @param {string} text
 * @returns {string}
 */
function refusalWords(text) {
    try {
        const { words } = JSON.parse(text);
        return typeof words === "string" ? words : "";
    } catch {
        return text.startsWith("<") ? "" : text.slice(0, 1000);
    }
}
