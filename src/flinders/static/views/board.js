/**
 * A drawn board that turns as the real one should be turned: what the arrow on the sphere means for a hand.
 *
 * The arrow leads the field's direction from u to v in the axes of the sensor. The field stays where it is, so the
 * sensor turns about v × u, by the angle between them. The drawing turns about the same line of the board, whatever
 * attitude it is drawn in: who turns the real one about that line comes to v.
 *
 * It is SVG, of parallel projection: what is printed on the board is drawn once and put under a matrix for each picture.
 */

import { svg } from "./plot.js";
import { Attitude, between, LEVEL, product, rotated, rotation } from "./turn.js";
import { cross, dot } from "./vectors.js";

/** @typedef {import("./vectors.js").Vector} Vector */
/** @typedef {import("./turn.js").Rotation} Rotation */
/** @typedef {import("./turn.js").Turn} Turn */
/** @typedef {"sensor" | "vehicle"} Frame */
/** @typedef {readonly [number, number]} Place */

/** Half of the board's width, length and thickness, in units of the drawing. */
const HALF = /** @type {const} */ ([46, 32, 3.5]);

/** Where the viewer is: to the side and above, radians; rows are right, up, and towards the viewer. */
const VIEW = viewFrom(0.42, 0.62);

/** To the right, along and out of the face of the board, in axes of the body: of a bare sensor, of a vehicle. */
const SIDES = /** @type {const} */ ({ sensor: LEVEL, vehicle: [[0, 1, 0], [1, 0, 0], [0, 0, -1]] });

/** Milliseconds of a turn, of which it waits so many before it begins, and from one picture to the next. */
const [PERIOD, WAITS, STEP] = [2600, 400, 45];

/** A smaller turn is not drawn, radians. */
const LEAST = 0.12;

/** Pieces of the arrow. */
const PIECES = 16;

/** Once around one side after the other, where no direction is better than the others. */
const AROUND = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => ({ axis, angle: 2 * Math.PI }));

export class Board {
    attitude = new Attitude();
    /** @type {Vector | null} where the field is to point; null: anywhere else */
    target = null;
    /** @type {Frame} */
    frame = "sensor";
    timer = 0;
    begun = 0;

    /** @param {HTMLElement} host  is filled, and hidden where nothing is to be done */
    constructor(host) {
        this.host = host;
        this.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
        this.drawing = svg("svg", { viewBox: "-66 -62 132 124", role: "img" });
        this.goal = svg("path", { class: "goal" });
        this.side = svg("path", { class: "side" });
        this.face = printed("face");
        this.back = printed("back");
        this.path = svg("path", { class: "way" });
        this.head = svg("path", { class: "head" });
        this.drawing.append(this.goal, this.side, this.back, this.face, this.path, this.head);
        host.replaceChildren(this.drawing);
    }

    /**
     * Show how to turn, from now on.
     * @param {{direction: Vector | null, frame: Frame}} lead  direction: null for all
     * @param {string} words  for who does not see it
     */
    show({ direction, frame }, words) {
        [this.target, this.frame] = [direction, frame];
        this.drawing.setAttribute("aria-label", words);
        this.face.dataset.frame = frame;
        if (!this.host.hidden) return;
        this.host.hidden = false;
        this.begun = performance.now();
        this.#draw();
    }

    hide() {
        this.host.hidden = true;
        clearTimeout(this.timer);
    }

    #draw = () => {
        const passed = performance.now() - this.begun;
        const turn = this.#turn(Math.floor(passed / PERIOD));
        const share = this.calm ? 0 : clampedShare((passed % PERIOD) - WAITS, PERIOD - 2 * WAITS);
        this.#put(this.#turned(turn, share));
        const ghost = turn.angle > LEAST && turn.angle < 6 ? outline(this.#turned(turn, 1)) : "";
        this.goal.setAttribute("d", ghost);
        this.#arrow(turn);
        this.timer = setTimeout(() => requestAnimationFrame(this.#draw), this.calm ? 5 * STEP : STEP);
    };

    /** @param {number} round @returns {Turn} */
    #turn(round) {
        const { field } = this.attitude;
        if (this.target === null || field === null) return AROUND[round % AROUND.length];
        return between(this.target, field);
    }

    /** From the axes of the drawn board to those of the picture, at a share of a turn. @param {Turn} turn @param {number} share */
    #turned({ axis, angle }, share) {
        const body = product(this.attitude.rotation, rotation({ axis, angle: share * angle }));
        return product(VIEW, product(body, transposed(SIDES[this.frame])));
    }

    /** @param {Rotation} seen */
    #put(seen) {
        const isFace = seen[2][2] > 0;
        this.side.setAttribute("d", outline(seen));
        for (const [shown, part, normal] of /** @type {const} */ ([[isFace, this.face, 1], [!isFace, this.back, -1]])) {
            part.setAttribute("visibility", shown ? "visible" : "hidden");
            const [x, y] = at(seen, [0, 0, normal * HALF[2]]);
            const matrix = [seen[0][0], -seen[1][0], -seen[0][1], seen[1][1], x, y];
            part.setAttribute("transform", `matrix(${matrix.map((number) => number.toFixed(3)).join(" ")})`);
        }
    }

    /** The way of the corner that goes farthest. @param {Turn} turn */
    #arrow(turn) {
        const angle = Math.min(turn.angle, 2.2);
        const hasArrow = angle > LEAST;
        const sides = SIDES[this.frame];
        const reach = (/** @type {Vector} */ corner) => Math.hypot(...cross(turn.axis, rotated(transposed(sides), corner)));
        const corners = CORNERS.toSorted((one, other) => reach(other) - reach(one));
        const ways = corners.slice(0, 4).map((corner) => this.#way({ ...turn, angle }, corner));
        const way = ways.toSorted((one, other) => length(other) - length(one))[0];
        this.path.setAttribute("d", hasArrow ? line(way.slice(0, -1)) : "");
        this.head.setAttribute("d", hasArrow ? arrowhead(way) : "");
    }

    /** @param {Turn} turn @param {Vector} corner @returns {Place[]} */
    #way(turn, corner) {
        return Array.from({ length: PIECES + 1 }, (_, k) => at(this.#turned(turn, k / PIECES), corner));
    }
}

/** The corners of the board. */
const CORNERS = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) => [x * HALF[0], y * HALF[1], z * HALF[2]])));

/**
 * What is printed on a side, in its own plane, the board's length upwards.
 * @param {"face" | "back"} kind
 * @returns {SVGElement}
 */
function printed(kind) {
    const [x, y] = HALF;
    const made = svg("g", { class: kind });
    made.append(svg("rect", { class: "plate", x: -x, y: -y, width: 2 * x, height: 2 * y, rx: 4 }));
    for (let pin = -3; pin <= 3; pin += 1) made.append(svg("circle", { class: "pin", cx: 12 * pin, cy: y - 6, r: 2.6 }));
    if (kind === "back") return made;
    made.append(
        svg("rect", { class: "chip", x: -11, y: -12, width: 22, height: 22, rx: 2 }),
        svg("path", { class: "axes", d: "M-38 12V-4M-41 0L-38 -5L-35 0M-38 12H-22M-26 9L-21 12L-26 15" }),
        svg("text", { class: "letter", x: -18, y: 16 }, "x"),
        svg("text", { class: "letter", x: -41, y: -9 }, "y"),
        svg("path", { class: "nose", d: "M0 -29L7 -18H-7Z" }),
    );
    return made;
}

/** Where a point of the board is in the picture. @param {Rotation} seen @param {Vector} point @returns {Place} */
function at(seen, point) {
    return [dot(seen[0], point), -dot(seen[1], point)];
}

/** The silhouette of the board: the hull of its corners. @param {Rotation} seen */
function outline(seen) {
    const places = CORNERS.map((corner) => at(seen, corner)).sort(([a, b], [c, d]) => a - c || b - d);
    const half = (/** @type {Place[]} */ row) => {
        /** @type {Place[]} */
        const hull = [];
        for (const place of row) {
            while (hull.length > 1 && isRight(hull[hull.length - 2], hull[hull.length - 1], place)) hull.pop();
            hull.push(place);
        }
        return hull.slice(0, -1);
    };
    return `${line([...half(places), ...half(places.toReversed())])}Z`;
}

/** @param {Place} a @param {Place} b @param {Place} c */
function isRight(a, b, c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0;
}

/** @param {readonly Place[]} places */
function line(places) {
    return `M${places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}`;
}

/** @param {readonly Place[]} way */
function length(way) {
    return way.slice(1).reduce((sum, [x, y], k) => sum + Math.hypot(x - way[k][0], y - way[k][1]), 0);
}

/** @param {readonly Place[]} way */
function arrowhead(way) {
    const [[x, y], [fromX, fromY]] = [way[way.length - 1], way[way.length - 3]];
    const far = Math.hypot(x - fromX, y - fromY) || 1;
    const [along, up] = [(x - fromX) / far, (y - fromY) / far];
    return `${line([[x, y], [x - 9 * along + 5 * up, y - 9 * up - 5 * along], [x - 9 * along - 5 * up, y - 9 * up + 5 * along]])}Z`;
}

/** @param {Rotation} rotation @returns {Rotation} */
function transposed([a, b, c]) {
    return [[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]];
}

/** @param {number} aside @param {number} above @returns {Rotation} */
function viewFrom(aside, above) {
    const round = rotation({ axis: [0, 0, 1], angle: aside });
    const [c, s] = [Math.cos(above), Math.sin(above)];
    return product([[1, 0, 0], [0, s, c], [0, -c, s]], round);
}

/** Eased. @param {number} passed @param {number} whole */
function clampedShare(passed, whole) {
    const share = Math.min(Math.max(passed / whole, 0), 1);
    return share * share * (3 - 2 * share);
}
