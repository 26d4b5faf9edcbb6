/**
 * Bodies in the hand as flat faces: x to the right, y to the front or top, z out of the face or roof.
 *
 * A face is visible from the side with counter-clockwise corners; marks on a face are visible with it.
 */

/** @typedef {import("../../../../static/views/vectors.js").Vector} Vector */
/** @typedef {import("../standalone/choreography.js").Body} Body */

/**
 * @typedef {object} Face
 * @property {readonly Vector[]} corners
 * @property {string} kind  its class: the material
 * @property {readonly Face[]} marks  drawn on it
 */

/** @typedef {readonly (readonly [number, number])[]} Outline */

/** @param {readonly Vector[]} corners @param {string} kind @param {readonly Face[]} marks @returns {Face} */
const face = (corners, kind, marks = []) => ({ corners, kind, marks });

/**
 * A body with the same outline below and above, or a smaller one.
 * @param {Outline} outline  counter-clockwise, seen from above
 * @param {readonly [number, number]} heights  below and above
 * @param {{kind?: string, top?: string, above?: Outline, marks?: readonly Face[], under?: readonly Face[]}} [more]
 * @returns {Face[]}
 */
function prism(outline, [low, high], { kind = "hull", top = kind, above = outline, marks = [], under = [] } = {}) {
    const below = outline.map(([x, y]) => /** @type {Vector} */ ([x, y, low]));
    const lid = above.map(([x, y]) => /** @type {Vector} */ ([x, y, high]));
    const sides = below.map((corner, i) => {
        const next = (i + 1) % below.length;
        return face([corner, below[next], lid[next], lid[i]], kind);
    });
    return [...sides, face(below.toReversed(), kind, under), face(lid, top, marks)];
}

/** @param {number} x @param {number} y @param {number} cut  of its corners @returns {[number, number][]} */
function rectangle(x, y, cut = 0) {
    if (cut === 0) return [[-x, -y], [x, -y], [x, y], [-x, y]];
    return [[-x + cut, -y], [x - cut, -y], [x, -y + cut], [x, y - cut], [x - cut, y], [-x + cut, y], [-x, y - cut], [-x, -y + cut]];
}

/** @param {Outline} outline @param {number} x @param {number} y @returns {[number, number][]} */
function moveOutline(outline, x, y) {
    return outline.map(([a, b]) => [a + x, b + y]);
}

/** @param {number} radius @returns {[number, number][]} */
function round(radius) {
    return Array.from({ length: 14 }, (_, i) => [radius * Math.cos((i * Math.PI) / 7), radius * Math.sin((i * Math.PI) / 7)]);
}

/** A flat mark on a face at a height. @param {Outline} outline @param {number} z @param {string} kind */
function mark(outline, z, kind) {
    const corners = outline.map(([x, y]) => /** @type {Vector} */ ([x, y, z]));
    return face(z < 0 ? corners.toReversed() : corners, kind);
}

/** A wheel on a side. @param {number} x @param {number} y @param {number} z @returns {Face} */
function wheel(x, y, z) {
    const rim = round(8).map(([a, b]) => /** @type {Vector} */ ([x, y + a, z + b]));
    return face(x < 0 ? rim.toReversed() : rim, "dark");
}

/** @returns {Face[]} */
function board() {
    const [x, y, z] = [46, 33, 3];
    const pins = [-3, -2, -1, 0, 1, 2, 3].map((pin) => moveOutline(round(2.6), 12 * pin, -y + 6));
    /** @type {Outline} */
    const along = [[-39, -14], [-37, -14], [-37, 6], [-34, 6], [-38, 13], [-42, 6], [-39, 6]];
    /** @type {Outline} */
    const across = [[-38, -16], [-20, -16], [-20, -19], [-13, -15], [-20, -11], [-20, -14], [-38, -14]];
    const marks = [...pins.map((pin) => mark(pin, z, "pin")), mark(along, z, "ink"), mark(across, z, "ink")];
    const plate = prism(rectangle(x, y, 4), [-z, z], { kind: "hull", marks, under: pins.map((pin) => mark(pin, -z, "pin")) });
    const chip = prism(rectangle(12, 12), [z, z + 5], { kind: "dark" });
    const port = prism(moveOutline(rectangle(9, 6), 0, y - 4), [z, z + 7], { kind: "metal" });
    return [...plate, ...port, ...chip];
}

/** @returns {Face[]} */
function phone() {
    const screen = mark(rectangle(24, 44, 3), 3.5, "glass");
    const notch = mark(moveOutline(rectangle(5, 1.2), 0, 40), 3.5, "ink");
    const camera = mark(moveOutline(rectangle(8, 8, 3), 14, 36), -3.5, "dark");
    return prism(rectangle(27, 52, 6), [-3.5, 3.5], { marks: [screen, notch], under: [camera] });
}

/** @returns {Face[]} */
function drone() {
    const arms = [[1, 1], [-1, 1], [-1, -1], [1, -1]].flatMap(([x, y]) => {
        /** @type {(out: number, aside: number) => [number, number]} */
        const at = (out, aside) => [out * x - aside * y, out * y + aside * x];
        const arm = prism([at(6, 3), at(6, -3), at(34, -3), at(34, 3)], [-2, 2], { kind: "dark" });
        const motor = prism(moveOutline(round(5), 34 * x, 34 * y), [-3, 6], { kind: "metal" });
        const rotor = moveOutline(round(18), 34 * x, 34 * y);
        const kind = y > 0 ? "rotor front" : "rotor";
        return [...arm, ...motor, mark(rotor, 7, kind), face(mark(rotor, 7, kind).corners.toReversed(), kind)];
    });
    const nose = mark([[-6, 14], [6, 14], [0, 24]], 8, "ink");
    return [...arms, ...prism(rectangle(13, 27, 6), [-7, 8], { marks: [nose] })];
}

/** @returns {Face[]} */
function car() {
    const body = prism(rectangle(23, 50, 6), [-12, 3], { marks: [mark([[-5, 38], [5, 38], [0, 46]], 3, "ink")] });
    const cabin = prism(moveOutline(rectangle(20, 25), 0, -8), [3, 18], { kind: "glass", top: "hull", above: moveOutline(rectangle(16, 17), 0, -9) });
    return [...body, ...cabin, ...[-30, 30].flatMap((y) => [wheel(-23.5, y, -12), wheel(23.5, y, -12)])];
}

/** @returns {Face[]} */
function boat() {
    /** @type {Outline} */
    const deck = [[-19, -48], [19, -48], [22, -14], [19, 18], [11, 42], [0, 56], [-11, 42], [-19, 18], [-22, -14]];
    const keel = deck.map(([x, y]) => /** @type {[number, number]} */ ([0.5 * x, 0.88 * y - 2]));
    const hull = prism(keel, [-15, 4], { above: deck, top: "deck", marks: [mark([[-5, 38], [5, 38], [0, 48]], 4, "ink")] });
    const cabin = prism(moveOutline(rectangle(13, 17), 0, -12), [4, 19], { kind: "glass", top: "hull", above: moveOutline(rectangle(11, 13), 0, -14) });
    return [...hull, ...cabin];
}

/** @returns {Face[]} */
function instrument() {
    const screen = mark(moveOutline(rectangle(12, 14, 2), 0, 2), 10, "glass");
    const keys = [-7, 0, 7].map((x) => mark(moveOutline(round(2.6), x, -26), 10, "pin"));
    const body = prism(rectangle(17, 46, 5), [-10, 10], { marks: [screen, ...keys, mark([[-6, 32], [6, 32], [0, 42]], 10, "ink")] });
    const lens = prism(moveOutline(rectangle(9, 4), 0, 50), [-6, 6], { kind: "dark" });
    return [...lens, ...body];
}

/** Faces of each body. @type {Readonly<Record<Body, readonly Face[]>>} */
export const SHAPES = { board: board(), phone: phone(), drone: drone(), car: car(), boat: boat(), instrument: instrument() };

/** Names of the bodies. @type {Readonly<Record<Body, string>>} */
export const NAMES = { board: "Board", phone: "Phone", drone: "Drone", car: "Car, robot", boat: "Boat", instrument: "Instrument" };
