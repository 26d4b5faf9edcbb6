/** Sources of readings on a page without a server: a board on a port, the sensor of a phone, a simulation. */

import { Refusal } from "../dom.js";
import { accelerationOf, LineReader } from "./lines.js";
import { MICROTESLA } from "./session.js";
import { phrase } from "../language.js";

/** @typedef {import("../messages.d.ts").Notice} Notice */
/** @typedef {import("../messages.d.ts").SourceState} SourceState */

/**
 * Callbacks of a source.
 * @typedef {object} Feed
 * @property {(rows: import("./buffer.js").Rows, unit: import("./session.js").Unit) => void} take
 * @property {(link: SourceState["link"], words: string) => void} link
 * @property {(words: string, severity?: Notice["severity"]) => void} tell
 * @property {import("./link.js").Choose} choose
 */

/**
 * A source of readings.
 * @typedef {object} Source
 * @property {string} name
 * @property {SourceState["kind"]} kind
 * @property {(feed: Feed) => Promise<void>} start  throws a `Refusal` if unavailable
 * @property {() => Promise<void>} stop
 */

/**
 * A port of Web Serial, which TypeScript's types lack.
 * @typedef {object} Port
 * @property {(options: {baudRate: number, bufferSize?: number}) => Promise<void>} open
 * @property {() => Promise<void>} close
 * @property {ReadableStream<Uint8Array> | null} readable
 * @property {WritableStream<Uint8Array> | null} [writable]
 * @property {() => object} [getInfo]  vendor and product
 */

/** @typedef {EventTarget & {requestPort: () => Promise<Port>}} Serial */

/** Period of checks of a silent port, for queued lines and advice. */
const WATCH_MS = 1000;
/** Checks without a reading after which advice is given. */
const SILENT_LOOKS = 3;
const PORT_BYTES = 1 << 16;

/** @returns {Serial | null} */
export function serial() {
    return /** @type {{serial?: Serial}} */ (navigator).serial ?? null;
}

/** A board on a port chosen by the user. Continues when the board is plugged in again. */
export class Board {
    /**
     * @param {Serial} ports
     * @param {Port} port
     * @param {number} baudRate
     * @param {{lines: object}} data
     */
    constructor(ports, port, baudRate, data) {
        this.name = "the board";
        this.kind = /** @type {const} */ ("serial");
        this.ports = ports;
        this.port = port;
        this.baudRate = baudRate;
        this.data = data;
        this.lines = new LineReader(data);
        this.said = "";
        this.isSilenceSaid = false;
        this.isAsked = false;
        this.silent = 0;
        this.isStopped = false;
        /** @type {ReadableStreamDefaultReader<Uint8Array> | null} */
        this.reader = null;
        /** @type {import("./sending.js").Echoes | null} receiver of the board's echo */
        this.echoes = null;
        this.plugged = (/** @type {Event} */ event) => this.again(/** @type {any} */ (event.target));
    }

    /** @param {Feed} feed */
    async start(feed) {
        this.feed = feed;
        this.begun = performance.now();
        try {
            await this.port.open({ baudRate: this.baudRate, bufferSize: PORT_BYTES });
        } catch (error) {
            throw new Refusal(phrase("source.port", "The port cannot be opened: close other programs that use it, such as a serial monitor. ({error})", { error: words(error) }));
        }
        this.ports.addEventListener("connect", this.plugged);
        this.timer = window.setInterval(() => this.watch(), WATCH_MS);
        this.read();
    }

    async stop() {
        this.isStopped = true;
        this.ports.removeEventListener("connect", this.plugged);
        window.clearInterval(this.timer);
        await this.reader?.cancel().catch(() => {});
        await this.port.close().catch(() => {});
    }

    /** Read until the port is disconnected; a line error, such as from a wrong baud rate, ends only the present stream. */
    async read() {
        const decoder = new TextDecoder();
        while (this.port.readable && !this.isStopped) {
            this.reader = this.port.readable.getReader();
            try {
                for (;;) {
                    const { value, done } = await this.reader.read();
                    if (done) break;
                    this.take(decoder.decode(value, { stream: true }));
                }
            } catch {
                continue;
            } finally {
                this.reader.releaseLock();
            }
            break;
        }
        if (this.isStopped) return;
        await this.port.close().catch(() => {});
        this.feed?.link("gone", phrase("source.unplugged", "the board is gone: plug it in again, and the page goes on"));
    }

    /**
     * @param {Uint8Array} bytes
     * @throws {Refusal} If sending fails.
     */
    async write(bytes) {
        const writer = this.port.writable?.getWriter();
        if (!writer) throw new Refusal(phrase("source.board-gone", "The board is gone: plug it in, and send again."));
        try {
            await writer.write(bytes);
        } catch (error) {
            throw new Refusal(phrase("source.not-taken", "The board did not take it: plug it in, and send again. ({error})", { error: words(error) }));
        } finally {
            writer.releaseLock();
        }
    }

    /** @param {string} text */
    take(text) {
        this.echoes?.take(text);
        const at = (performance.now() - (this.begun ?? 0)) / 1000;
        const { rows } = this.lines.take(text, at);
        if (this.lines.silence && !this.isSilenceSaid) this.feed?.tell(this.lines.silence, "warning");
        this.isSilenceSaid ||= this.lines.silence !== "";
        if (this.lines.unclear && !this.isAsked) this.ask(this.lines);
        if (rows.length === 0) return;
        this.silent = 0;
        const time = rows.map(({ time }) => time ?? at);
        this.feed?.take({ time, field: rows.flatMap(({ field }) => field), acceleration: accelerationOf(rows) }, unitOf(this.lines));
        if (this.lines.words === this.said) return;
        this.said = this.lines.words;
        this.feed?.tell(phrase("source.understood", "understood as {form}", { form: this.said }));
    }

    /**
     * Let the user choose the magnetometer's columns.
     * @param {LineReader} lines
     */
    async ask(lines) {
        this.isAsked = true;
        lines.choice = lines.unclear && ((await this.feed?.choose(lines.unclear)) ?? null);
    }

    /** Read queued lines, and give advice if no reading arrives. */
    watch() {
        if (!this.port.readable) return;
        this.silent += 1;
        this.take("");
        if (this.silent === SILENT_LOOKS && this.lines.advice) this.feed?.link("waiting", this.lines.advice);
    }

    /**
     * Continue with a port that was plugged in again.
     * @param {Port} port
     */
    async again(port) {
        const isSame = JSON.stringify(port.getInfo?.()) === JSON.stringify(this.port.getInfo?.());
        if (this.isStopped || this.port.readable || !isSame) return;
        this.port = port;
        const { choice } = this.lines;
        this.lines = new LineReader(this.data);
        this.lines.choice = choice;
        this.silent = 0;
        try {
            await port.open({ baudRate: this.baudRate, bufferSize: PORT_BYTES });
        } catch {
            return; // not ready yet, or used by another program: the user can choose it again
        }
        this.feed?.link("connected", phrase("source.back", "the board is back"));
        this.read();
    }
}

/** @returns {string} */
function noSensor() {
    return phrase(
        "source.no-sensor",
        "This browser gives pages no magnetometer. Chrome on Android does, over https, once “Experimental Web Platform " +
            "features” is switched on in chrome://flags.",
    );
}

/** The magnetometer of a phone, if the browser gives access. */
export class Phone {
    /** @throws {Refusal} If the browser gives no access. */
    constructor() {
        if (!("Magnetometer" in window)) throw new Refusal(noSensor());
        this.name = "the sensor of this phone";
        this.kind = /** @type {const} */ ("phone");
        this.sensor = /** @type {any} */ (null);
    }

    /** @param {Feed} feed */
    async start(feed) {
        try {
            this.sensor = new /** @type {any} */ (window).Magnetometer({ frequency: 50 });
        } catch (error) {
            throw new Refusal(refusedSensor(error));
        }
        const begun = performance.now();
        this.sensor.addEventListener("reading", () => {
            const { x, y, z, timestamp } = this.sensor;
            feed.take({ time: [((timestamp ?? performance.now()) - begun) / 1000], field: [x, y, z] }, MICROTESLA);
        });
        this.sensor.addEventListener("error", (/** @type {any} */ event) => feed.link("gone", refusedSensor(event.error)));
        this.sensor.start();
    }

    async stop() {
        this.sensor?.stop();
    }
}

/** @param {unknown} error */
function refusedSensor(error) {
    const name = error instanceof Error ? error.name : "";
    if (name === "NotAllowedError") return phrase("source.not-allowed", "the browser was not allowed to use the motion sensors: allow them in its settings for this site");
    if (name === "SecurityError") return phrase("source.https", "the browser gives its sensors to pages over https only, and not to frames of other pages");
    return phrase("source.no-magnetometer", "this device has no magnetometer that a page can read ({error})", { error: words(error) });
}

/**
 * The simulated sensor, from Python.
 * @typedef {object} Simulation
 * @property {number} rate_hz
 * @property {number} noise_ut
 * @property {number[][]} steps_centi_ut  second differences of x, y and z without noise, in 0.01 µT
 * @property {[number, string][]} said
 */

/** A simulated sensor in a hand: its path is played forwards and backwards, each time with new noise. */
export class Simulated {
    /**
     * @param {Simulation} simulation
     * @param {number} speed  relative to the clock
     */
    constructor(simulation, speed = 1) {
        this.name = "simulation";
        this.kind = /** @type {const} */ ("simulated");
        this.simulation = simulation;
        this.axes = simulation.steps_centi_ut.map((steps) => runningSums(runningSums(steps)));
        this.speed = speed;
        this.count = 0;
        this.timer = 0;
    }

    /** @param {Feed} feed */
    async start(feed) {
        const { rate_hz, said } = this.simulation;
        const begun = performance.now();
        const left = [...said];
        this.timer = window.setInterval(() => {
            const seconds = ((performance.now() - begun) / 1000) * this.speed;
            const due = Math.floor(seconds * rate_hz) - this.count;
            const time = Array.from({ length: due }, (_, j) => (this.count + j) / rate_hz);
            feed.take({ time, field: time.flatMap((_, j) => this.reading(this.count + j)) }, MICROTESLA);
            this.count += due;
            while (left.length > 0 && seconds >= left[0][0]) feed.tell(left.shift()?.[1] ?? "");
        }, 1000 / rate_hz);
    }

    async stop() {
        window.clearInterval(this.timer);
    }

    /** @param {number} number @returns {number[]} */
    reading(number) {
        const { axes, simulation: { noise_ut } } = this;
        const { length } = axes[0];
        const turn = Math.floor(number / length);
        const place = turn % 2 ? length - 1 - (number % length) : number % length;
        return axes.map((centi_ut) => centi_ut[place] / 100 + noise_ut * normal());
    }
}

/** @param {number[]} steps @returns {number[]} Cumulative sums. */
function runningSums(steps) {
    let sum = 0;
    return steps.map((step) => (sum += step));
}

/** A normal random number by the method of Box and Muller. */
function normal() {
    return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

/**
 * Unit of readings from lines.
 * @param {{unit: string, raw: {unit: string, scale: number}}} read
 * @returns {import("./session.js").Unit}
 */
export function unitOf({ unit, raw }) {
    return { inside: unit, recorded: raw.unit, scale: raw.scale };
}

/** @param {unknown} error */
function words(error) {
    return error instanceof Error ? error.message.replace(/^.*?: /, "").replace(/\.$/, "") : String(error);
}
