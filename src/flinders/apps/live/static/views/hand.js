/**
 * Drawing of the body in the hand: its present and its wanted attitude, an arrow of the turn, and a ring of its progress.
 *
 * SVG in parallel projection, seen by the user from behind and somewhat above. The view moves sideways or up until neither
 * the body nor the turn is edge-on.
 */

import { NAMES, SHAPES } from "./bodies.js";
import { svg } from "./plot.js";
import { Attitude, between, LEVEL, product, rotated, rotation } from "../../../../static/views/turn.js";
import { cross, dot, minus } from "../../../../static/views/vectors.js";
import { phrase } from "../language.js";

/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {import("../../../../static/views/turn.js").Rotation} Rotation */
/** @typedef {import("./bodies.js").Face} Face */
/** @typedef {import("../standalone/choreography.js").Body} Body */
/** @typedef {readonly [number, number]} Place */

/**
 * What is drawn: a body, its turn, and the progress.
 * @typedef {object} Picture
 * @property {Body} body
 * @property {Rotation} hold  from axes of the body to those of the user, at the start of the turn
 * @property {Vector} axis  of the turn, in the user's axes
 * @property {number} angle  of the whole turn, rad
 * @property {number} now  progress of the turn, rad
 * @property {readonly number[]} parts  progress of each part of the ring, 0 to 1; empty without a ring
 */

/** Direction of the light: to the right, up, and towards the viewer. */
const LIGHT = /** @type {const} */ ([0.35, 0.75, 0.55]);
const RING = 67;
/** The preview runs ahead by this angle of a long turn, rad, in this time, ms, and then waits. */
const [AHEAD, PERIOD, WAITS] = [1.2, 2200, 500];
/** Milliseconds from one picture to the next. */
const STEP = 40;
/** Number of pieces of the arrow, and its distance from the axis. */
const [PIECES, REACH] = [22, 58];
/** A plate counts as edge-on if this share of its face, or less, is visible. */
const EDGE_ON = 0.12;
/** Candidate views, radians sideways and above; the default first. */
const ASIDE = [0.4, -0.4, 0.15, 0.75, -0.75];
const ABOVE = [0.55, 0.35, 0.8];

export class Hand {
    attitude = new Attitude();
    /** @type {Picture | null} */
    picture = null;
    view = viewFrom(ASIDE[0], ABOVE[0]);
    key = "";
    timer = 0;
    begun = 0;

    /** @param {HTMLElement} host  is filled */
    constructor(host) {
        this.host = host;
        this.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
        this.ring = svg("g", { class: "ring" });
        this.ghost = svg("g", { class: "ghost" });
        this.solid = svg("g", { class: "solid" });
        this.way = svg("path", { class: "way" });
        this.head = svg("path", { class: "head" });
        this.drawing = svg("svg", { viewBox: "-71 -71 142 142", role: "img" }, [this.ring, this.ghost, this.solid, this.way, this.head]);
        host.append(this.drawing);
    }

    /**
     * Set the drawing.
     * @param {Picture} picture
     * @param {string} words  for screen readers
     * @param {string} key  of the turn: a new key restarts the animation
     */
    show(picture, words, key) {
        this.picture = picture;
        this.drawing.setAttribute("aria-label", words);
        if (key !== this.key) {
            this.key = key;
            this.begun = performance.now();
            this.view = viewOf(picture);
        }
        if (!this.timer) this.#draw();
    }

    hide() {
        clearTimeout(this.timer);
        this.timer = 0;
        this.picture = null;
    }

    #draw = () => {
        if (!this.picture) return;
        const { body, angle, now, parts } = this.picture;
        const share = this.calm ? 1 : easeShare(((performance.now() - this.begun) % (PERIOD + WAITS)) / PERIOD);
        const to = Math.min(angle, now + Math.min(AHEAD, angle));
        if (isEdgeOn(this.view, this.#attitude(now))) this.view = viewOf(this.picture);
        this.#put(this.ghost, body, this.#viewedRotation(now + share * (to - now)));
        this.#put(this.solid, body, this.#viewedRotation(now));
        this.#arrow(Math.max(to - now, 0));
        this.ring.replaceChildren(...rings(parts));
        this.timer = window.setTimeout(() => requestAnimationFrame(this.#draw), this.calm ? 5 * STEP : STEP);
    };

    /** Rotation from axes of the body to those of the picture, at an angle of the turn. @param {number} angle */
    #viewedRotation(angle) {
        return product(this.view, this.#attitude(angle));
    }

    /** Rotation from axes of the body to the user's, at an angle of the turn. @param {number} angle */
    #attitude(angle) {
        const { hold, axis } = /** @type {Picture} */ (this.picture);
        return product(rotation({ axis, angle }), hold);
    }

    /** @param {SVGElement} group @param {Body} body @param {Rotation} seen */
    #put(group, body, seen) {
        group.replaceChildren(...visibleFaces(SHAPES[body], seen));
    }

    /** Draw the arrow around the axis, its nearer part in front of the body. @param {number} angle */
    #arrow(angle) {
        const { axis } = /** @type {Picture} */ (this.picture);
        const start = perpendicular(axis, this.view[2]);
        const places = Array.from({ length: PIECES + 1 }, (_, k) => {
            const turn = rotation({ axis, angle: -0.6 + (k / PIECES) * Math.max(Math.min(angle, 2.4), 0.9) });
            return rotated(this.view, rotated(turn, start).map((part) => REACH * part));
        });
        const flat = places.map(([x, y]) => /** @type {Place} */ ([x, -y]));
        this.way.setAttribute("d", line(flat.slice(0, -1)));
        this.head.setAttribute("d", arrowhead(flat));
    }
}

/**
 * A small picture of a body, at rest.
 * @param {Body} body
 * @returns {SVGElement}
 */
export function portrait(body) {
    const solid = svg("g", { class: "solid" }, visibleFaces(SHAPES[body], product(viewFrom(0.55, 0.75), LEVEL)));
    return svg("svg", { class: "portrait", viewBox: "-60 -46 120 92", "aria-hidden": "true" }, [solid]);
}

/**
 * The turn of a body that moves the field, as seen from the body, to a wanted direction.
 * @param {Rotation} hold  present attitude
 * @param {Vector} target
 * @param {Vector} field
 * @returns {{axis: Vector, angle: number}}  axis in the user's axes, and angle, rad
 */
export function turnTowards(hold, target, field) {
    const { axis, angle } = between(target, field);
    return { axis: rotated(hold, axis), angle };
}

/** @param {Body} body */
export function nameOf(body) {
    return phrase(`body.${body}`, NAMES[body]);
}

/**
 * Visible faces, the far ones first.
 * @param {readonly Face[]} faces
 * @param {Rotation} seen
 * @returns {SVGElement[]}
 */
function visibleFaces(faces, seen) {
    const shown = faces.map((face) => ({ face, corners: face.corners.map((corner) => rotated(seen, corner)) }));
    const depth = (/** @type {readonly Vector[]} */ corners) => corners.reduce((sum, corner) => sum + corner[2], 0) / corners.length;
    const front = shown.filter(({ corners }) => normalOf(corners)[2] > 0);
    front.sort((one, other) => depth(one.corners) - depth(other.corners));
    return front.flatMap(({ face, corners }) => [
        polygon(corners, face.kind),
        ...face.marks.map((mark) => polygon(mark.corners.map((corner) => rotated(seen, corner)), mark.kind)),
    ]);
}

/** @param {readonly Vector[]} corners @param {string} kind @returns {SVGElement} */
function polygon(corners, kind) {
    const normal = normalOf(corners);
    const light = 0.25 + 0.75 * Math.max(dot(normal, LIGHT) / (Math.hypot(...normal) || 1), 0);
    const made = svg("path", { class: kind, d: `${line(corners.map(([x, y]) => [x, -y]))}Z` });
    made.style.setProperty("--lit", `${Math.round(100 * light)}%`);
    return made;
}

/** @param {readonly Vector[]} corners @returns {Vector} */
function normalOf(corners) {
    const third = Math.floor(corners.length / 3) || 1;
    return cross(minus(corners[third], corners[0]), minus(corners[2 * third], corners[0]));
}

/**
 * The view nearest to the default in which neither body nor turn is edge-on.
 * @param {Picture} picture
 */
function viewOf({ hold, axis, now, angle }) {
    const places = [0, 1 / 3, 2 / 3, 1].map((share) => product(rotation({ axis, angle: now + share * Math.min(angle - now, AHEAD) }), hold));
    let [best, most] = [viewFrom(ASIDE[0], ABOVE[0]), -1];
    for (const above of ABOVE) {
        for (const aside of ASIDE) {
            const view = viewFrom(aside, above);
            const flat = Math.min(...places.map((place) => Math.abs(product(view, place)[2][2])));
            const turn = Math.abs(dot(view[2], axis));
            const score = Math.min(flat, 0.5) + Math.min(turn, 0.5) - 0.05 * (Math.abs(aside - ASIDE[0]) + Math.abs(above - ABOVE[0]));
            if (score > most) [best, most] = [view, score];
        }
    }
    return best;
}

/** @param {Rotation} view @param {Rotation} attitude */
function isEdgeOn(view, attitude) {
    return Math.abs(product(view, attitude)[2][2]) < EDGE_ON;
}

/** A unit vector across an axis, on the side of the viewer. @param {Vector} axis @param {Vector} viewer @returns {Vector} */
function perpendicular(axis, viewer) {
    const across = viewer.map((part, i) => part - dot(axis, viewer) * axis[i]);
    const length = Math.hypot(...across);
    if (length > 0.2) return across.map((part) => part / length);
    const aside = cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
    return aside.map((part) => part / Math.hypot(...aside));
}

/** Parts of a ring, each as full as it is. @param {readonly number[]} parts @returns {SVGElement[]} */
function rings(parts) {
    const each = (2 * Math.PI) / parts.length;
    const gap = parts.length > 1 ? 0.09 : 0;
    return parts.flatMap((share, i) => {
        const from = i * each + gap / 2;
        const whole = each - gap;
        const empty = svg("path", { class: "empty-part", d: arc(from, from + whole) });
        return share > 0.01 ? [empty, svg("path", { class: "full-part", d: arc(from, from + whole * share) })] : [empty];
    });
}

/** An arc of the ring, clockwise from the top. @param {number} from @param {number} to */
function arc(from, to) {
    const at = (/** @type {number} */ angle) => `${(RING * Math.sin(angle)).toFixed(2)} ${(-RING * Math.cos(angle)).toFixed(2)}`;
    const end = Math.min(to, from + 6.28);
    return `M${at(from)}A${RING} ${RING} 0 ${end - from > Math.PI ? 1 : 0} 1 ${at(end)}`;
}

/** @param {readonly Place[]} places */
function line(places) {
    return `M${places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}`;
}

/** @param {readonly Place[]} way */
function arrowhead(way) {
    const [[x, y], [fromX, fromY]] = [way[way.length - 1], way[way.length - 4]];
    const far = Math.hypot(x - fromX, y - fromY) || 1;
    const [along, up] = [(x - fromX) / far, (y - fromY) / far];
    return `${line([[x, y], [x - 12 * along + 7 * up, y - 12 * up - 7 * along], [x - 12 * along - 7 * up, y - 12 * up + 7 * along]])}Z`;
}

/** Rows are right, up, and towards the viewer. @param {number} aside @param {number} above @returns {Rotation} */
function viewFrom(aside, above) {
    const round = rotation({ axis: [0, 0, 1], angle: aside });
    const [c, s] = [Math.cos(above), Math.sin(above)];
    return product([[1, 0, 0], [0, s, c], [0, -c, s]], round);
}

/** @param {number} share */
function easeShare(share) {
    const part = Math.min(Math.max(share, 0), 1);
    return part * part * (3 - 2 * part);
}
