/**
 * Sends a calibration to a board as MotionCal does, and reads its echo: two lines with ten and nine numbers. The
 * calibration is confirmed if both equal the sent values. `flinders.links.motioncal` explains the tolerance.
 */

import { Refusal } from "../dom.js";

const TRIES = 3;
const ANSWER_MS = 3000;
/** From the second attempt on, the packet is sent in pieces, for boards with a small buffer. */
const [PIECE, PAUSE_MS] = [16, 10];
const [SLACK, SHARE, FEWEST_PLACES] = [1e-4, 3e-5, 2];
const MAX_TEXT = 4096;
const NUMBERS = { Cal1: 10, Cal2: 9 };
/** Indices, among the packet's sixteen numbers, of the numbers in each of the two lines. */
const IN_LINES = { Cal1: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9], Cal2: [10, 13, 14, 13, 11, 15, 14, 15, 12] };

/** @typedef {keyof typeof NUMBERS} Line */

/** Reads the echo of a board. */
export class Echoes {
    /** @param {Uint8Array} packet */
    constructor(packet) {
        const view = new DataView(packet.buffer, packet.byteOffset);
        const sent = Array.from({ length: 16 }, (_, i) => view.getFloat32(2 + 4 * i, true));
        /** @type {Record<Line, number[]>} */
        this.expected = { Cal1: IN_LINES.Cal1.map((at) => sent[at]), Cal2: IN_LINES.Cal2.map((at) => sent[at]) };
        this.rest = "";
        /** @type {Partial<Record<Line, string[]>>} latest line of each kind */
        this.heard = {};
    }

    /** @param {string} text  as it comes from the board */
    take(text) {
        const lines = (this.rest + text).split(/[\r\n]+/);
        this.rest = (lines.pop() ?? "").slice(-MAX_TEXT);
        for (const line of lines) {
            const [, name, cells] = /^\s*(Cal[12]):(.*)$/.exec(line) ?? [];
            const numbers = cells?.split(",").map((cell) => cell.trim()) ?? [];
            const isEcho = name && numbers.length === NUMBERS[/** @type {Line} */ (name)] && numbers.every((cell) => /^[-+]?\d+(\.\d*)?$/.test(cell));
            if (isEcho) this.heard[/** @type {Line} */ (name)] = numbers;
        }
    }

    /** Whether both lines equal the sent values. */
    get isConfirmed() {
        return names().every((name) => this.heard[name] && this.#wrong(name) < 0);
    }

    /** Smallest number of decimals in the board's output. */
    get places() {
        return Math.min(...names().flatMap((name) => this.heard[name]?.map(placesOf) ?? []));
    }

    /** Sentence on the output that came instead of the echo. */
    get complaint() {
        for (const name of names()) {
            const at = this.#wrong(name);
            if (at >= 0) return `the board says ${this.heard[name]?.[at]} in place of ${this.expected[name][at].toPrecision(6)} (number ${at + 1} of its ${name} line)`;
        }
        const missing = names().filter((name) => !this.heard[name]).map((name) => `${name}:`);
        return `the board prints no ${missing.join(" and ")} line, by which a sketch confirms: whether it has taken the values is not known`;
    }

    /** @param {Line} name @returns {number} Index of the first number that differs; -1 without a difference or an echo. */
    #wrong(name) {
        return (this.heard[name] ?? []).findIndex((printed, i) => {
            const wanted = this.expected[name][i];
            const half = 0.5 * 10 ** -Math.max(placesOf(printed), FEWEST_PLACES);
            return !(Math.abs(Number(printed) - wanted) <= SLACK + SHARE * Math.abs(wanted) + half);
        });
    }
}

/**
 * Send a packet until the board confirms it.
 * @param {import("./sources.js").Board} board
 * @param {Uint8Array} packet
 * @returns {Promise<string>} The board's confirmation.
 * @throws {Refusal} Without an echo, or for an echo of other values.
 */
export async function send(board, packet) {
    const echoes = new Echoes(packet);
    board.echoes = echoes;
    try {
        for (let attempt = 1; attempt <= TRIES; attempt++) {
            echoes.heard = {};
            for (const piece of attempt === 1 ? [packet] : pieces(packet)) {
                await board.write(piece);
                if (attempt > 1) await later(PAUSE_MS);
            }
            for (let waited = 0; waited < ANSWER_MS && !echoes.isConfirmed; waited += PAUSE_MS) await later(PAUSE_MS);
            if (!echoes.isConfirmed) continue;
            const again = attempt > 1 ? `, at try ${attempt}` : "";
            return `confirmed by the board's echo, to ${echoes.places} decimals${again}`;
        }
    } finally {
        board.echoes = null;
    }
    throw new Refusal(`sent ${TRIES} times and not confirmed: ${echoes.complaint}`);
}

/** @returns {Line[]} */
function names() {
    return ["Cal1", "Cal2"];
}

/** @param {string} printed */
function placesOf(printed) {
    return printed.split(".")[1]?.length ?? 0;
}

/** @param {Uint8Array} packet */
function pieces(packet) {
    return Array.from({ length: Math.ceil(packet.length / PIECE) }, (_, i) => packet.subarray(PIECE * i, PIECE * (i + 1)));
}

/** @param {number} ms */
function later(ms) {
    return new Promise((done) => setTimeout(done, ms));
}
