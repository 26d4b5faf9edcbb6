/**
 * Simulated people who turn sensors by the guidance of the page, with its session, engine and guidance.
 *
 * Reads JSON on standard input, and writes a row for each run. turning.py describes the simulation.
 */

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { modules, wasm, data, asked } = JSON.parse(readFileSync(0, "utf-8"));
const load = (name) => import(pathToFileURL(`${modules}/${name}`));
const names = ["standalone/engine.js", "standalone/evaluate.js", "standalone/session.js", "standalone/state.js"];
const [{ loadEngine }, { evaluate }, { Session }, { sessionState }] = await Promise.all(names.map(load));
const [{ advance, begin, skipNeedless, SEQUENCES }, { lead }, { product, rotated, rotation, between }, { correctReading, unit }] =
    await Promise.all(["standalone/choreography.js", "standalone/lead.js", "../../../static/views/turn.js", "../../../static/views/vectors.js"].map(load));
const { tiles } = await load("standalone/tiles.js");
const engine = await loadEngine(readFileSync(wasm), data.engine.layouts);

const RATE_HZ = 50;
const TICK = 5; // readings between looks of the session
const FIT_S = 0.02;
const FIELD = 50;
const UNIT = { inside: "uT", recorded: "uT", scale: 1 };
const DEG = Math.PI / 180;
const transposed = ([a, b, c]) => [0, 1, 2].map((i) => [a[i], b[i], c[i]]);

/** Random numbers of a seed (mulberry32). */
class Chance {
    constructor(seed) {
        this.state = seed >>> 0;
    }
    uniform(low = 0, high = 1) {
        this.state = (this.state + 0x6d2b79f5) >>> 0;
        let t = this.state;
        t = Math.imul(t ^ (t >>> 15), t | 1);
        t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
        return low + ((high - low) * ((t ^ (t >>> 14)) >>> 0)) / 4294967296;
    }
    normal() {
        return Math.sqrt(-2 * Math.log(1 - this.uniform())) * Math.cos(2 * Math.PI * this.uniform());
    }
    direction() {
        return unit([this.normal(), this.normal(), this.normal()]);
    }
}

/** Sensor with soft iron of 25 %, an offset of up to twice the field on each axis, white noise and slow noise. */
class Sensor {
    constructor(chance) {
        this.chance = chance;
        const scale = () => 1 + chance.uniform(-0.25, 0.25);
        const across = () => chance.uniform(-0.1, 0.1);
        const [a, b, c] = [across(), across(), across()];
        this.matrix = [[scale(), a, b], [a, scale(), c], [b, c, scale()]];
        this.offset = [0, 1, 2].map(() => chance.uniform(-2, 2) * FIELD);
        this.noise = chance.uniform(0.001, 0.005) * FIELD;
        this.slow = [0, 0, 0];
    }
    read(field) {
        const keep = Math.exp(-1 / (RATE_HZ * 5));
        this.slow = this.slow.map((part) => keep * part + Math.sqrt(1 - keep * keep) * 0.2 * this.noise * this.chance.normal());
        return rotated(this.matrix, field).map((part, i) => part + this.offset[i] + this.slow[i] + this.noise * this.chance.normal());
    }
}

/** A hand that holds a body, with the attitude of the body and the inaccuracy of its turns. */
class Hand {
    constructor(chance) {
        this.chance = chance;
        this.speed = chance.uniform(30, 90) * DEG;
        this.error = chance.uniform(10, 20) * DEG;
        this.latency = chance.uniform(0.3, 1.5);
        this.attitude = rotation({ axis: chance.direction(), angle: chance.uniform(0, 0.5) });
        this.sway = [0, 0, 0];
        this.turned = 0;
    }
    /** Turn about an axis of the body during one reading period; the axis sways. */
    turn(axis, most = Infinity) {
        const keep = Math.exp(-1 / (RATE_HZ * 1));
        const width = (this.error / 2) * Math.sqrt(1 - keep * keep);
        this.sway = this.sway.map((part) => keep * part + width * this.chance.normal());
        const angle = Math.min(this.speed / RATE_HZ, most);
        this.attitude = product(this.attitude, rotation({ axis: unit(axis.map((part, i) => part + this.sway[i])), angle }));
        this.turned += angle;
    }
    /** Turn towards an attitude by at most one step; returns the angle that was left before. */
    towards(attitude) {
        const { axis, angle } = turnOf(product(transposed(this.attitude), attitude));
        if (angle > this.speed / RATE_HZ) this.turn(axis, angle);
        return angle;
    }
    /** An axis with the error of the hand. */
    near(axis) {
        return rotated(rotation({ axis: this.chance.direction(), angle: this.error * Math.abs(this.chance.normal()) }), axis);
    }
}

/** Axis and angle of a rotation. */
function turnOf(r) {
    const angle = Math.acos(Math.min(Math.max((r[0][0] + r[1][1] + r[2][2] - 1) / 2, -1), 1));
    return { axis: unit([r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]), angle };
}

/** Tumbles the body at random: its rates are white noise after two equal filters, with the mean rate of the hand. */
class Tumbler {
    constructor(chance, hand) {
        Object.assign(this, { chance, hand, once: [0, 0, 0], twice: [0, 0, 0] });
        for (let k = 0; k < 300; k++) this.wander();
    }
    wander() {
        const keep = Math.exp(-1 / (RATE_HZ * 0.6));
        const mix = (to, from) => to.map((part, i) => keep * part + (1 - keep) * from[i]);
        this.once = mix(this.once, [0, 1, 2].map(() => this.chance.normal()));
        this.twice = mix(this.twice, this.once);
    }
    look() {}
    move() {
        this.wander();
        const rms = (1 - Math.exp(-1 / (RATE_HZ * 0.6))) ** 0.5 / 2; // of one part of `twice`
        const rate = this.twice.map((part) => (part / rms) * (this.hand.speed / 1.6));
        const angle = Math.hypot(...rate) / RATE_HZ;
        this.hand.attitude = product(this.hand.attitude, rotation({ axis: unit(rate), angle }));
        this.hand.turned += angle;
    }
}

/** Follows the page, looking always, at glances now and then, or when a turn seems complete. */
class Follower {
    constructor(chance, hand, looks) {
        Object.assign(this, { chance, hand, looks, seen: [], now: null, nextLook: 0 });
        this.axis = null;
        this.world = null;
        this.hold = null;
        this.left = 0;
    }
    /** Look at the page: its words are understood after a latency, its drawing at once. */
    look(at, lead) {
        this.seen.push([at, lead]);
        const isLooking = this.looks === "always" || (this.looks === "glances" ? at >= this.nextLook : this.left <= 0);
        if (!isLooking) return;
        const known = this.seen.filter(([when]) => when <= at - this.hand.latency).at(-1)?.[1];
        this.seen = this.seen.filter(([when]) => when > at - this.hand.latency - 0.2);
        if (!known) return;
        if (this.looks === "glances" && known.kind !== "arrow") this.nextLook = at + this.chance.uniform(2, 5);
        if (known.key !== this.now?.key) {
            this.now = known;
            this.take({ ...known, here: lead.here ?? known.here });
        } else if (this.left <= 0) {
            this.again(at, lead);
        }
    }
    /** Repeat a turn while the page asks for it; aim again at a missed direction after another look. */
    again(at, { here }) {
        if (this.now.kind !== "arrow") {
            this.left = this.now.kind === "turn" ? this.whole : 2 * Math.PI;
            return;
        }
        this.missedAt ??= at;
        if (at < this.missedAt + this.hand.latency || !here) return;
        this.aim(this.now.target, here);
    }
    /** Begin a turn of the field to the target in the drawing, about an axis with the error of the hand. */
    aim(target, here) {
        const { axis, angle } = between(target, here);
        this.missedAt = null;
        this.axis = unit(axis.map((part, i) => part + this.miss[i]));
        this.left = Math.max(angle * this.chance.uniform(0.85, 1.25), 0.4);
    }
    take({ kind, step, body, target, here }) {
        if (kind === "turn") {
            const { hold, isHeld, axis, share } = SEQUENCES[body][step - 1];
            this.whole = 2 * Math.PI * share;
            const isCopied = isHeld || (step === 1 && this.chance.uniform() < 0.5); // of the drawing
            this.hold = isCopied ? product(rotation({ axis: this.chance.direction(), angle: this.hand.error }), hold) : null;
            const sign = this.chance.uniform() < 0.5 ? -1 : 1;
            this.world = this.hand.near(axis.map((part) => sign * part));
            this.axis = null;
            this.left = this.whole * this.chance.uniform(0.8, 1.25);
        } else if (kind === "arrow" && here) {
            [this.hold, this.world] = [null, null];
            this.miss = this.chance.direction().map((part) => part * Math.tan(this.hand.error));
            this.aim(target, here);
        } else if (kind === "around") {
            [this.hold, this.world] = [null, null];
            this.axis = this.chance.direction();
            this.left = Math.PI;
        }
    }
    move() {
        const { hand } = this;
        if (!this.axis && !this.world) return;
        if (this.hold && hand.towards(this.hold) > 0.1) return;
        if (this.world) this.axis = rotated(transposed(hand.attitude), this.world);
        [this.hold, this.world] = [null, null];
        const goesOn = this.looks === "always" && this.now.kind !== "arrow";
        if (!goesOn && this.left <= 0) return;
        hand.turn(this.axis);
        this.left -= hand.speed / RATE_HZ;
    }
}

/** A person who pauses for seconds now and then. */
class Halting {
    constructor(chance, person, each) {
        Object.assign(this, { chance, person, each, rest: 0 });
    }
    look(...seen) {
        this.person.look(...seen);
    }
    move() {
        if (this.each && this.rest <= 0 && this.chance.uniform() < 1 / (RATE_HZ * this.each)) this.rest = this.chance.uniform(1, 3);
        this.rest -= 1 / RATE_HZ;
        if (this.rest <= 0) this.person.move();
    }
}

/** The page: a session, fits that take a fixed time, the choreography and the guidance. */
class Page {
    constructor(body) {
        this.session = new Session(data.session);
        this.session.source = { name: "board", kind: "serial", link: "connected", words: "" };
        this.choreography = begin(body);
        this.lead = null;
        this.words = 0;
    }
    take(at, time, field) {
        const { session } = this;
        session.arrived(at, { time, field }, UNIT);
        const { view } = session.shown.evaluated;
        this.choreography = advance(this.choreography, { time, field, acceleration: null }, view);
        if (session.wantsFit(at)) {
            const task = session.beginFit();
            session.fitDone(at + FIT_S, { ...evaluate(engine, data.engine, task), key: task.key }, FIT_S);
        }
        const state = sessionState(session);
        const raw = field.slice(-3);
        const shown = session.shown.evaluated.view;
        this.choreography = skipNeedless(this.choreography, shown, tiles().centres);
        const before = this.lead;
        this.lead = lead(before, { at, state, view: shown, choreography: this.choreography, raw, centres: tiles().centres });
        if (before && this.lead.since !== before.since) this.words += 1;
        const here = shown?.shown ? unit(correctReading(raw, shown.shown)) : null;
        return { ...this.lead, here, key: `${this.lead.kind} ${this.lead.since}`, phase: state.phase };
    }
}

/** Turn a sensor until its calibration is good. */
function played({ seed, who, body, halts, dip, most_s }) {
    const chance = new Chance(7919 * seed + 17);
    const sensor = new Sensor(chance);
    const hand = new Hand(chance);
    const world = rotated(rotation({ axis: [0, 0, 1], angle: chance.uniform(0, 2 * Math.PI) }), [0, Math.cos(dip * DEG), -Math.sin(dip * DEG)]);
    const person = new Halting(chance, who === "tumbles" ? new Tumbler(chance, hand) : new Follower(chance, hand, who), halts);
    const page = new Page(body);
    let [time, field, good] = [[], [], null];
    for (let k = 0; k < most_s * RATE_HZ; k++) {
        person.move();
        time.push(k / RATE_HZ);
        field.push(...sensor.read(rotated(transposed(hand.attitude), world).map((part) => FIELD * part)));
        if ((k + 1) % TICK) continue;
        const at = k / RATE_HZ;
        const seen = page.take(at, time, field);
        [time, field] = [[], []];
        if (seen.phase === "good") {
            good = at;
            break;
        }
        person.look(at, seen);
    }
    return { seed, who, good, words: page.words, turned_deg: hand.turned / DEG, steps: page.choreography.step, speed: hand.speed / DEG };
}

for (const one of asked) process.stdout.write(`${JSON.stringify(played(one))}\n`);
