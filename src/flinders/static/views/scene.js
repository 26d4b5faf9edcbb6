/**
 * The 3-D view: the heading error in each direction, and the readings before and after correction.
 *
 * "sphere" colours the tiles of the unit sphere by the predicted heading error; tiles without readings are hatched.
 * A marker shows the newest direction, an arrow leads to the tile to be covered next. "clouds" shows raw and corrected
 * readings together, "raw" and "corrected" one of them: all from one buffer on the graphics card, the corrected ones with
 * the matrix W (x − b) / F, which changes smoothly from the old fit to the new one.
 *
 * The view draws only after a change, and a frame allocates almost no memory. Tiles, grids and readings are the ground; in
 * software WebGL the ground is saved, and only new readings are drawn onto it.
 *
 * @typedef {import("./colours.js").Theme} Theme
 * @typedef {import("./geometry.js").Tiles} Tiles
 * @typedef {"sphere" | "clouds" | "raw" | "corrected"} Mode
 * @typedef {{part: import("../vendor/three.js").Object3D, from: Matrix4, to: Matrix4}} Way
 *
 * @typedef {Pick<View, "unit" | "offset" | "shown" | "tiles_deg" | "level_deg" | "tiles_seen" | "guidance">} Shown
 *
 * @typedef {object} Options
 * @property {Tiles} tiles
 * @property {Theme} theme
 * @property {boolean} [interactive]  by mouse, touch and keys
 * @property {number} [target_deg]  target of the error, which determines the colours
 * @property {"zoom" | "focus"} [wheel]  "focus" leaves the wheel to the page until the view has the focus
 */

import {
    BufferAttribute,
    BufferGeometry,
    DynamicDrawUsage,
    Matrix4,
    Scene as Stage,
    Vector3,
    WebGLRenderer,
} from "../vendor/three.js";
import { clamp, Eye } from "./camera.js";
import { nearestOf } from "./nearest.js";
import { errorColour, palette } from "./colours.js";
import { Detail } from "./detail.js";
import {
    SHAFT,
    OUTSIDE,
    arrow,
    axes,
    circle,
    drawMatrix,
    extend,
    graticule,
    emptyExtent,
    strokes,
    tileAt,
    towards,
} from "./geometry.js";
import { SavedFrame } from "./saved_frame.js";
import { Labels } from "./labels.js";
import { mark } from "./marks.js";
import { Ball, cloud, drawFirst, lines, marker, rewrite } from "./parts.js";

/** @typedef {import("../view.d.ts").View} View */
/** @typedef {Omit<import("../view.d.ts").Points, "acceleration">} Points */

/** Duration of the change of colours and matrices from one fit to the next, ms. */
const TRANSITION = 350;

/** Changes of a tint (of 255) and of position (of the radius) that are too small to animate. */
const [UNSEEN_TINT, UNSEEN_WAY] = [6, 0.004];

/** Number of directions in the tail of the marker, and their duration, s. */
const [TAIL, TAIL_SECONDS] = [64, 2.5];

/** Time between frames of the pulse with hardware and software graphics, ms. */
const [PULSE, PULSE_SLOW] = [40, 150];
const PULSE_PERIOD = 1600;

/** Most screen pixels per page pixel; most pixels in software and in low detail. */
const [FINEST, MOST_SLOW, MOST_LOW] = [2, 700_000, 320_000];

/** Readings drawn in low detail during motion. */
const LOW_DETAIL_READINGS = 4000;

/** Most readings drawn in full size. */
const FULL_SIZE_READINGS = 3000;

/** Lengths of the axes and of the distance of their names, and the margin of names in pixels. */
const [AXIS, NAME, MARGIN] = [1.16, 1.225, 3];

/** Largest distance of the pointer from a marked reading, pixels. */
const REACH = 14;

/** Radius of the ring around the advised direction. */
const RING = Math.sin((8.5 * Math.PI) / 180);

/** Longest visible arrow, radians. */
const IN_SIGHT = 1.7;

/** Cosine of the largest step in the tail; a larger step is an outlier or a gap, and breaks the tail. */
const JUMP = Math.cos((20 * Math.PI) / 180);

export class Scene {
    /** @type {Points | null} */
    points = null;
    /** @type {Shown | null} */
    view = null;
    /** @type {Vector3 | null} newest reading, raw */
    now = null;
    /** @type {number | null} marked reading */
    hovered = null;
    /** @type {Mode} */
    mode = "sphere";
    /** @type {readonly (readonly [number, number])[]} */
    excluded = [];
    /** @type {readonly (readonly [number, number])[]} */
    rejected = [];
    extent = emptyExtent();

    /** First reading not yet sent to the graphics card. */
    unsent = Infinity;
    /** Number of readings in the arrays on the graphics card; `points` may have newer arrays. */
    count = 0;
    /** Whether to redraw the ground, and the number of readings in the saved one. */
    stale = true;
    laid = 0;
    /** Camera of the saved ground: the numbers of two matrices. */
    seen = new Float64Array(32);
    /** Times of the start of the transition and of the last frame, ms. */
    started = -Infinity;
    last = 0;
    /** Level of detail, and whether the last frame requested the next at once. */
    detail = new Detail();
    isMoving = false;
    /** Handles of the next frame and the next pulse. */
    waiting = 0;
    pulsing = 0;

    /** Readings on the graphics card, drawn twice. */
    readings = new BufferGeometry();
    field = new BufferAttribute(new Float32Array(0), 3);
    marked = new BufferAttribute(new Uint8Array(0), 1);

    /** Ring buffer of the newest raw readings: x, y, z, seconds. */
    tail = { recent: new Float32Array(4 * TAIL), next: 0, length: 0 };

    /** 1 to project readings onto the sphere, 0 to draw them at their places. */
    onto = { from: 0, to: 0, now: 0 };
    draw = new Matrix4();
    inverse = new Matrix4();
    place = new Vector3();
    other = new Vector3();
    previous = new Vector3();

    /**
     * @param {HTMLElement} host  parent of the view, which follows its size
     * @param {Options} options
     * @throws {Error} If the browser has no WebGL.
     */
    constructor(host, { tiles, theme, interactive = true, target_deg = 1, wheel = "zoom" }) {
        const canvas = document.createElement("canvas");
        const context = canvas.getContext("webgl2", { alpha: true, antialias: false });
        if (context === null) throw new Error("this browser cannot draw in 3-D: WebGL is missing or switched off");
        if (getComputedStyle(host).position === "static") host.style.position = "relative";
        this.host = host;
        this.canvas = canvas;
        this.tiles = tiles;
        this.theme = theme;
        this.target_deg = target_deg;
        this.software = isSoftware(context);
        this.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
        this.saved = this.software ? new SavedFrame(context) : null;
        this.renderer = new WebGLRenderer({ canvas, context });
        this.renderer.setClearColor(0, 0);
        this.renderer.autoClear = false;
        placeCanvas(host, canvas, interactive);
        this.notice = noticeIn(host);
        canvas.addEventListener("webglcontextlost", () => (this.notice.textContent = LOST));
        canvas.addEventListener("webglcontextrestored", () => {
            this.notice.textContent = "";
            this.saved?.drop();
            this.#anew();
        });
        this.eye = new Eye(canvas, { interactive, wheel, still: this.calm, changed: () => this.redraw() });
        this.labels = new Labels(host, { x: "x", y: "y", z: "z", offset: "offset", next: "go here", hovered: "◯" });

        this.ball = new Ball(tiles);
        this.tints = new Uint8Array(4 * tiles.corners.length);
        this.path = strokes(SHAFT + 1);
        this.trail = strokes(TAIL);
        this.pushed = strokes(2);
        this.places = new BufferAttribute(new Float32Array(6), 3).setUsage(DynamicDrawUsage);
        const grid = { width: 1.1, behind: 0.3 };
        this.grid = lines(graticule(), { ...grid, opacity: 0.75 }, 0);
        this.gridRaw = lines(graticule(), { ...grid, opacity: 0.45 }, 0);
        this.raw = cloud(this.readings);
        this.corrected = cloud(this.readings);
        this.axes = lines(axes(AXIS), { width: 1.6 }, 2);
        this.ring = lines(circle(RING), { width: 2.2, border: 1.6, behind: 0.3 }, 3);
        this.ripple = lines(circle(RING), { width: 2, behind: 0.2 }, 3);
        this.push = lines(this.pushed, { width: 2.4, border: 1.4, behind: 1 }, 3);
        this.arrow = lines(this.path, { width: 3.4, border: 1.8, behind: 0.28 }, 4);
        this.trace = lines(this.trail, { width: 3, border: 1.5, behind: 0.15 }, 5);
        this.marker = marker(this.places);

        this.still = [this.ball.part, this.grid, this.gridRaw];
        this.lines = [this.grid, this.gridRaw, this.axes, this.ring, this.ripple, this.push, this.arrow, this.trace];
        this.seenFromEye = [...this.lines, this.marker];
        this.parts = [this.ball.part, this.raw, this.corrected, ...this.seenFromEye];
        this.ground = new Stage();
        this.ground.add(this.ball.part, this.grid, this.gridRaw, this.raw, this.corrected);
        this.front = new Stage();
        this.front.add(this.axes, this.ring, this.ripple, this.push, this.arrow, this.trace, this.marker);

        const way = (/** @type {Way["part"]} */ part) => ({ part, from: new Matrix4(), to: new Matrix4() });
        this.rawWay = way(this.raw);
        this.correctedWay = way(this.corrected);
        this.gridWay = way(this.gridRaw);
        this.ways = [this.rawWay, this.correctedWay, this.gridWay];
        for (const { part } of this.ways) part.matrixAutoUpdate = false;

        this.setTheme(theme);
        this.#arrange(false);
        this.watcher = new ResizeObserver(() => this.#resize());
        this.watcher.observe(host);
        this.#resize();
    }

    // -------------------------------------------------------------------------------------------------- what is shown

    /** Show new readings in place of the earlier ones. @param {Points} points */
    setPoints(points) {
        this.extent = emptyExtent();
        this.tail.length = 0;
        this.#hold(points);
        this.appendPoints(points, 0);
    }

    /**
     * Show further readings; the arrays may have been replaced by larger ones.
     *
     * @param {Points} points
     * @param {number} from  the first new point
     */
    appendPoints(points, from) {
        let first = from;
        if (points.field !== this.field.array) {
            this.#hold(points);
            first = 0;
        }
        this.points = points;
        this.count = points.count;
        mark(this.marks, points, this.rejected, this.excluded, first);
        extend(this.extent, points.field, first, points.count);
        this.unsent = Math.min(this.unsent, first);
        if (!this.view?.shown) this.#arrange(false);
        this.redraw();
    }

    /** Show a fit; null without one. @param {Shown | null} view */
    setView(view) {
        this.view = view;
        this.#paint(true);
        this.#arrange(true);
    }

    /** The newest reading, raw. @param {{raw: ArrayLike<number>} | null} now */
    setNow(now) {
        const known = now !== null && [0, 1, 2].every((axis) => Number.isFinite(now.raw[axis]));
        if (known) {
            this.now = (this.now ?? new Vector3()).set(now.raw[0], now.raw[1], now.raw[2]);
            this.#remember(this.now);
        } else {
            this.now = null;
            this.tail.length = 0;
        }
        this.#markNow();
        this.redraw();
    }

    /** Mark a reading, or none. @param {number | null} reading */
    setHovered(reading) {
        this.hovered = reading;
        this.redraw();
    }

    /**
     * The reading drawn nearest to a place.
     * @param {number} x  pixels from the left
     * @param {number} y  pixels from the top
     * @returns {number | null}
     */
    readingAt(x, y) {
        const { camera } = this.eye;
        const { clientWidth: width, clientHeight: height } = this.host;
        return nearestOf(
            this.count,
            (reading) => {
                const place = this.#placeOf(reading);
                if (this.ball.part.visible && place.dot(camera.position) < 1) return Infinity; // behind the sphere
                place.project(camera);
                return Math.hypot(width * (0.5 + 0.5 * place.x) - x, height * (0.5 - 0.5 * place.y) - y);
            },
            REACH,
        );
    }

    /** Place of a reading in the drawing. @param {number} reading */
    #placeOf(reading) {
        const place = this.other.fromArray(this.field.array, 3 * reading).applyMatrix4(this.draw);
        return this.ball.part.visible ? place.normalize() : place;
    }

    /** @param {Mode} mode */
    setMode(mode) {
        if (mode === this.mode) return;
        this.mode = mode;
        this.#arrange(true);
    }

    /** @param {Theme} theme */
    setTheme(theme) {
        this.theme = theme;
        const colours = palette(theme);
        dye(this.ball.part, { seam: colours.seam, unknown: colours.unknown, ink: colours.mark });
        this.ball.uniforms.depth.value = theme === "dark" ? 0.34 : 0.2;
        for (const dots of [this.raw, this.corrected]) {
            dye(dots, { rejected: colours.rejected, excluded: colours.excluded });
        }
        dye(this.raw, { colour: colours.raw });
        dye(this.marker, { ink: colours.mark, halo: colours.casing, first: colours.corrected, second: colours.raw });
        for (const line of this.lines) dye(line, { colour: colours.mark, halo: colours.casing });
        dye(this.push, { colour: colours.ink, halo: colours.halo });
        dye(this.axes, { colour: colours.dim });
        dye(this.grid, { colour: colours.grid });
        dye(this.gridRaw, { colour: colours.raw });
        this.labels.dye(colours.ink, colours.halo);
        this.#dress();
        this.#paint(false);
    }

    /** Set the target of the error, which determines the colours. @param {number} target_deg */
    setTarget(target_deg) {
        if (target_deg === this.target_deg) return;
        this.target_deg = target_deg;
        this.#paint(true);
    }

    /**
     * Set the readings left out, which are drawn differently.
     *
     * @param {readonly (readonly [number, number])[]} excluded  spans of time, seconds: by the user
     * @param {readonly (readonly [number, number])[]} rejected  runs of reading numbers, both ends included: by the fit
     */
    setMask(excluded, rejected) {
        this.excluded = excluded;
        this.rejected = rejected;
        if (this.points === null) return;
        mark(this.marks, this.points, rejected, excluded);
        this.unsent = 0;
        this.#anew();
    }

    /** Reset the camera to its initial view. */
    resetCamera() {
        this.eye.reset();
        this.#look();
    }

    /** Request a frame with a new ground. */
    #anew() {
        this.stale = true;
        this.redraw();
    }

    /** Request a frame; several calls give one frame. */
    redraw() {
        if (this.waiting === 0) this.waiting = requestAnimationFrame(this.#frame);
    }

    dispose() {
        cancelAnimationFrame(this.waiting);
        clearTimeout(this.pulsing);
        this.waiting = -1; // no further frame
        this.watcher.disconnect();
        this.eye.dispose();
        for (const part of this.parts) {
            part.geometry.dispose();
            part.material.dispose();
        }
        this.renderer.dispose();
        this.saved?.drop();
        this.labels.remove();
        this.notice.remove();
        this.canvas.remove();
    }

    // ------------------------------------------------------------------------------------------------------ a picture

    /** @param {number} time  milliseconds */
    #frame = (time) => {
        this.waiting = 0;
        if (this.host.clientWidth === 0 || this.renderer.getContext().isContextLost()) return;
        const share = this.calm ? 1 : Math.min(Math.max((time - this.started) / TRANSITION, 0), 1);
        this.#move(share * share * (3 - 2 * share));
        const turning = this.eye.step((time - this.last) / 1000);
        if (this.isMoving && this.detail.took(time - this.last)) this.#resize();
        this.last = time;
        this.isMoving = turning || share < 1;
        this.#pulse(time);
        this.#send();
        this.#lookFromEye();
        if (share < 1) this.stale = true;
        this.#drawGround();
        this.renderer.render(this.front, this.eye.camera);
        this.#placeLabels();
        if (this.isMoving) this.redraw();
        else this.#pulseOn();
    };

    /** Draw tiles, grids and readings: from the saved frame with new readings added, or all again. */
    #drawGround() {
        const { renderer, saved, readings, count } = this;
        const { camera } = this.eye;
        renderer.clear(); // even under a saved frame, as a browser's late clearing would erase it
        const stays = !this.#hasMoved() && !this.stale && this.laid <= count && saved?.restore();
        if (!stays || this.laid < count) {
            readings.setDrawRange(stays ? this.laid : 0, stays ? count - this.laid : count);
            this.#drawEvery(this.detail.isLow && this.isMoving ? Math.ceil(count / LOW_DETAIL_READINGS) : 1);
            for (const part of this.still) part.material.visible = !stays;
            renderer.render(this.ground, camera);
            saved?.save();
        }
        [this.stale, this.laid] = [this.detail.isLow && this.isMoving, count]; // draws all of them at rest
    }

    /** @param {number} every  reading is drawn */
    #drawEvery(every) {
        for (const { material } of [this.raw, this.corrected]) material.uniforms.every.value = Math.max(every, 1);
    }

    /** Whether the camera has moved since the last frame. */
    #hasMoved() {
        const { matrixWorld, projectionMatrix } = this.eye.camera;
        let moved = false;
        for (let k = 0; k < 32; k += 1) {
            const number = k < 16 ? matrixWorld.elements[k] : projectionMatrix.elements[k - 16];
            moved ||= Math.abs(this.seen[k] - number) > 1e-5; // the controller's rounding differs at each update
        }
        if (moved) this.seen.set([...matrixWorld.elements, ...projectionMatrix.elements]);
        return moved;
    }

    /** Send only new readings to the graphics card. */
    #send() {
        if (this.unsent >= this.count) return;
        this.field.clearUpdateRanges();
        this.field.addUpdateRange(3 * this.unsent, 3 * (this.count - this.unsent));
        this.field.needsUpdate = true;
        this.marked.clearUpdateRanges();
        this.marked.addUpdateRange(this.unsent, this.count - this.unsent);
        this.marked.needsUpdate = true;
        this.#dress();
        this.unsent = Infinity;
    }

    /** Interpolate colours and matrices between the old fit and the new one. @param {number} share */
    #move(share) {
        this.ball.uniforms.share.value = share;
        for (const { part, from, to } of this.ways) {
            for (let k = 0; k < 16; k += 1) {
                part.matrix.elements[k] = from.elements[k] + share * (to.elements[k] - from.elements[k]);
            }
            part.matrixWorldNeedsUpdate = true;
        }
        this.onto.now = this.onto.from + share * (this.onto.to - this.onto.from);
        this.corrected.material.uniforms.onto.value = this.onto.now;
    }

    /** Set the uniforms of the camera. */
    #lookFromEye() {
        const { camera, centre, radius } = this.eye;
        camera.updateMatrixWorld();
        for (const part of this.seenFromEye) {
            part.updateMatrixWorld();
            this.inverse.copy(part.matrixWorld).invert();
            part.material.uniforms.eye.value.copy(camera.position).applyMatrix4(this.inverse);
        }
        const away = camera.position.distanceTo(centre);
        this.raw.material.uniforms.haze.value.set(away - 0.8 * radius, away + 0.9 * radius);
        this.corrected.material.uniforms.haze.value.set(away - 0.8 * radius, away + 0.9 * radius);
    }

    /** @param {number} time  milliseconds */
    #pulse(time) {
        const phase = this.calm ? 0.35 : (time % PULSE_PERIOD) / PULSE_PERIOD;
        this.ball.uniforms.pulse.value = this.saved ? 0.5 : 0.5 + 0.5 * Math.cos(2 * Math.PI * phase);
        const wide = 0.55 + 0.75 * phase;
        this.ripple.scale.set(wide, wide, 1);
        this.ripple.material.uniforms.opacity.value = 0.9 * (1 - phase);
    }

    #pulseOn() {
        clearTimeout(this.pulsing);
        if (this.calm || !this.ripple.visible) return;
        this.pulsing = setTimeout(() => this.redraw(), this.software || this.detail.isLow ? PULSE_SLOW : PULSE);
    }

    // --------------------------------------------------------------------------------------------- what follows from it

    /** Use the arrays of some readings. @param {Points} points */
    #hold(points) {
        this.points = points;
        this.unsent = 0;
        this.stale = true;
        if (points.field === this.field.array) return;
        this.field = new BufferAttribute(points.field, 3).setUsage(DynamicDrawUsage);
        this.marked = new BufferAttribute(new Uint8Array(points.field.length / 3), 1).setUsage(DynamicDrawUsage);
        this.readings.dispose(); // frees the old arrays on the graphics card
        this.readings.setAttribute("position", this.field);
        this.readings.setAttribute("mark", this.marked);
    }

    get marks() {
        return /** @type {Uint8Array} */ (this.marked.array);
    }

    /** Heading error of each tile: of a level vehicle for a level turn, else of any attitude. */
    get errors() {
        return this.view?.level_deg ?? this.view?.tiles_deg ?? null;
    }

    /** Colour the tiles. @param {boolean} slowly  change from the present colours */
    #paint(slowly) {
        const { tiles_seen: seen = null } = this.view ?? {};
        const errors = this.errors;
        let most = 0;
        for (let tile = 0; tile < this.tiles.corners.length; tile += 1) {
            const error = errors?.[tile] ?? null;
            const [red, green, blue] = errorColour(error, this.target_deg, this.theme);
            const tint = [255 * red, 255 * green, 255 * blue, error === null ? 0 : seen?.[tile] ? 255 : 128];
            for (let k = 0; k < 4; k += 1) {
                most = Math.max(most, Math.abs(tint[k] - this.tints[4 * tile + k]));
                this.tints[4 * tile + k] = tint[k];
            }
        }
        const gently = slowly && most > UNSEEN_TINT;
        this.ball.paint(this.tints, gently);
        if (gently) this.started = performance.now();
        this.#describe();
        this.#anew();
    }

    /** Set the visible parts and their matrices for the mode. @param {boolean} slowly */
    #arrange(slowly) {
        const shown = this.view?.shown ?? null;
        const sphere = this.mode === "sphere";
        const before = this.corrected.visible ? this.corrected.matrix : this.raw.matrix;
        this.correctedWay.from.copy(before);
        this.rawWay.from.copy(this.raw.matrix);
        this.gridWay.from.copy(this.gridRaw.matrix);

        this.ball.part.visible = sphere && shown !== null;
        this.grid.visible = !sphere && shown !== null;
        this.corrected.visible = shown !== null && this.mode !== "raw";
        this.raw.visible = shown === null || this.mode === "raw" || this.mode === "clouds";
        this.gridRaw.visible = this.raw.visible && shown !== null;
        this.push.visible = this.gridRaw.visible;
        drawFirst(this.axes, this.ball.part.visible ? OUTSIDE : Infinity);

        if (shown === null) {
            this.rawWay.to.fromArray(aroundMiddle(this.extent));
            this.correctedWay.to.copy(this.rawWay.to);
        } else {
            this.rawWay.to.makeScale(1 / shown.strength, 1 / shown.strength, 1 / shown.strength);
            this.correctedWay.to.fromArray(drawMatrix(shown));
            this.gridWay.to.copy(this.correctedWay.to).invert().premultiply(this.rawWay.to);
            this.#pushBy();
        }
        this.draw.copy(this.mode === "raw" ? this.rawWay.to : this.correctedWay.to);
        this.onto.from = this.onto.now;
        this.onto.to = sphere && shown !== null ? 1 : 0;
        if (slowly && this.#goesFar()) this.started = performance.now();
        else {
            for (const { from, to } of this.ways) from.copy(to);
            this.onto.from = this.onto.to;
        }
        this.#dress();
        this.#look();
        this.#markNow();
        this.#anew();
    }

    /** Whether the change from the old fit to the new one is visible. */
    #goesFar() {
        if (this.onto.from !== this.onto.to) return true;
        return this.ways.some(({ from, to }) => to.elements.some((number, k) => Math.abs(number - from.elements[k]) > UNSEEN_WAY));
    }

    /** Draw the offset from zero to the middle of the raw cloud. */
    #pushBy() {
        const { start, end, width } = this.pushed;
        const tip = this.place.setFromMatrixPosition(this.gridWay.to);
        const neck = this.other.copy(tip).multiplyScalar(Math.max(1 - 0.13 / Math.max(tip.length(), 1e-6), 0.5));
        start.fill(0);
        neck.toArray(start, 3);
        neck.toArray(end, 0);
        tip.toArray(end, 3);
        width.set([1, 1, 4, 0.05]);
        this.pushed.count = 2;
        rewrite(this.push, this.pushed);
        const { offset = null, unit = "" } = this.view ?? {};
        this.labels.say("offset", offset === null ? "offset" : `offset ${tidy(Math.hypot(...offset))} ${unit}`);
    }

    /** Set colour and size of the readings for the mode. */
    #dress() {
        const sphere = this.mode === "sphere";
        const colours = palette(this.theme);
        dye(this.corrected, { colour: sphere ? colours.reading : colours.corrected });
        const ratio = this.renderer.getPixelRatio();
        const height = this.host.clientHeight * ratio;
        const [raw, corrected] = [this.raw.material.uniforms, this.corrected.material.uniforms];
        raw.opacity.value = this.corrected.visible ? 0.6 : 0.85;
        // smaller dots for many readings
        const size = height * 0.042 * clamp(Math.sqrt(FULL_SIZE_READINGS / (this.points?.count ?? 1)), 0.5, 1);
        raw.size.value = size;
        corrected.opacity.value = sphere ? 0.5 : 0.85;
        corrected.size.value = (sphere ? 0.6 : 1) * size;
        raw.least.value = corrected.least.value = 1.3 * ratio;
    }

    /** Keep the scene in the picture. */
    #look() {
        const known = this.view?.shown != null;
        if (!known || this.mode === "sphere" || this.mode === "corrected") {
            this.eye.frame(this.place.set(0, 0, 0), this.#withNames(), this.mode === "sphere" ? 1.35 : 0.3);
            return;
        }
        const middle = this.place.setFromMatrixPosition(this.gridWay.to);
        const reach = 1.05 * this.gridWay.to.getMaxScaleOnAxis();
        const [gap, own] = [middle.length(), 1.2];
        const radius = Math.max((gap + reach + own) / 2, reach, own);
        if (gap > 0) middle.multiplyScalar(Math.min(Math.max((gap + reach - own) / 2, 0), gap) / gap);
        this.eye.frame(middle, radius);
    }

    /** How far the sphere reaches with the names of its axes, which are as large in a small picture. */
    #withNames() {
        const half = Math.min(this.host.clientWidth, this.host.clientHeight) / 2;
        return NAME / Math.max(1 - (this.labels.size / 2 + MARGIN) / Math.max(half, 1), 0.5);
    }

    /** For the tail. @param {Vector3} raw */
    #remember(raw) {
        const { tail } = this;
        raw.toArray(tail.recent, 4 * tail.next);
        tail.recent[4 * tail.next + 3] = performance.now() / 1000;
        tail.next = (tail.next + 1) % TAIL;
        tail.length = Math.min(tail.length + 1, TAIL);
    }

    /** Marker, tail and arrow, from the newest reading and the advice. */
    #markNow() {
        const known = this.view?.shown != null;
        const sphere = known && this.mode === "sphere";
        const target = sphere ? this.#target() : null;
        this.ring.visible = this.ripple.visible = target !== null;
        this.marker.visible = this.now !== null;
        this.trace.visible = sphere && this.now !== null;
        this.arrow.visible = target !== null && this.now !== null;
        this.ball.uniforms.next.value = target === null ? -1 : tileAt(this.tiles, target);
        if (target !== null) {
            this.place.fromArray(target).normalize();
            for (const part of [this.ring, this.ripple]) part.quaternion.setFromUnitVectors(UP, this.place);
        }
        if (this.now === null) return;
        const place = this.place.copy(this.now).applyMatrix4(this.draw);
        this.marker.material.uniforms.solid.value = sphere ? 1 : 0;
        const both = known && this.mode === "clouds";
        this.marker.material.uniforms.both.value = both ? 1 : 0;
        this.marker.geometry.setDrawRange(0, both ? 2 : 1);
        if (sphere) place.normalize().multiplyScalar(1.012);
        place.toArray(this.places.array);
        this.other.copy(this.now).applyMatrix4(this.rawWay.to).toArray(this.places.array, 3);
        this.places.needsUpdate = true;
        if (sphere) this.#lead(place.normalize(), target);
    }

    /** The middle of the tile to visit next. */
    #target() {
        const direction = this.view?.guidance?.direction ?? null;
        if (direction === null) return null;
        const tile = tileAt(this.tiles, direction);
        return this.tiles.centres.slice(3 * tile, 3 * tile + 3);
    }

    /** Tail and arrow, and the eye along with them. @param {Vector3} place @param {number[] | null} target */
    #lead(place, target) {
        this.#drawTail();
        if (target === null) {
            this.eye.follow(place, 0);
            return;
        }
        const end = towards([place.x, place.y, place.z], target, IN_SIGHT);
        const angle = arrow([place.x, place.y, place.z], end, this.path);
        rewrite(this.arrow, this.path);
        this.other.fromArray(end).multiplyScalar(1.08).add(place);
        if (this.other.length() > 0.2) this.eye.follow(this.other.normalize(), angle / 2);
    }

    #drawTail() {
        const { tail, trail } = this;
        const newest = tail.recent[this.#at(tail.length - 1) + 3];
        trail.count = Math.max(tail.length - 1, 0);
        for (let k = 0; k < tail.length; k += 1) {
            const age = newest - tail.recent[this.#at(k) + 3];
            const fresh = Math.max(1 - age / TAIL_SECONDS, 0);
            const point = this.#smooth(k).applyMatrix4(this.draw).normalize().multiplyScalar(1.01);
            const joins = k === 0 || point.dot(this.previous) > JUMP;
            if (k > 0) point.toArray(trail.end, 3 * (k - 1));
            if (k + 1 < tail.length) point.toArray(trail.start, 3 * k);
            // a point ends one piece and starts the next
            for (const slot of [2 * k - 1, 2 * k]) {
                if (slot < 0 || slot >= 2 * trail.count) continue;
                trail.alpha[slot] = fresh * fresh;
                trail.width[slot] = 0.3 + 0.7 * fresh;
            }
            if (!joins) trail.alpha[2 * k - 2] = trail.alpha[2 * k - 1] = 0;
            this.previous.copy(point);
        }
        rewrite(this.trace, trail);
    }

    /** Where in `tail.recent` the newest readings lie, the oldest of them being 0. @param {number} k */
    #at(k) {
        return 4 * ((this.tail.next - this.tail.length + k + TAIL) % TAIL);
    }

    /** A reading of the tail, the mean of itself and its neighbours in time unless they are far off. @param {number} k */
    #smooth(k) {
        const { recent, length } = this.tail;
        const point = this.other.fromArray(recent, this.#at(k));
        if (k === 0 || k === length - 1) return point;
        const [before, after] = [this.#at(k - 1), this.#at(k + 1)];
        for (let axis = 0; axis < 3; axis += 1) {
            const mean = (recent[before + axis] + recent[after + axis]) / 2;
            point.setComponent(axis, (point.getComponent(axis) + mean) / 2);
        }
        return point;
    }

    #resize() {
        const [width, height] = [this.host.clientWidth, this.host.clientHeight];
        if (width === 0 || height === 0) return;
        const side = Math.min(width, height);
        const pixels = this.detail.isLow ? MOST_LOW : MOST_SLOW;
        const isSlow = this.software || this.detail.isLow;
        const affordable = isSlow ? clamp(Math.sqrt(pixels / (width * height)), 0.5, 1.5) : FINEST;
        this.canvas.dataset.detail = this.detail.isLow ? "low" : "full";
        const ratio = Math.min(devicePixelRatio, affordable);
        this.renderer.setPixelRatio(ratio);
        this.renderer.setSize(width, height, false);
        for (const { material } of this.lines) {
            material.uniforms.viewport.value.set(width * ratio, height * ratio);
            material.uniforms.scale.value = ratio * clamp(side / 560, 0.72, 2.2);
        }
        this.marker.material.uniforms.side.value = ratio * clamp(side / 26, 16, 44);
        this.labels.resize(clamp(side / 40, 12, 26));
        this.#dress();
        this.eye.resize(width, height);
        this.#look();
        this.#anew();
    }

    // ---------------------------------------------------------------------------------------------------------- words

    #placeLabels() {
        const { eye, labels, place } = this;
        const sphere = this.ball.part.visible;
        place.set(NAME, 0, 0);
        labels.put("x", place, eye.camera, { solid: sphere });
        place.set(0, NAME, 0);
        labels.put("y", place, eye.camera, { solid: sphere });
        place.set(0, 0, NAME);
        labels.put("z", place, eye.camera, { solid: sphere });
        const target = this.ring.visible ? this.#target() : null;
        if (target === null) labels.hide("next");
        else labels.put("next", place.fromArray(target).normalize(), eye.camera, { solid: true, below: eye.pixels(RING) });
        if (this.hovered === null || this.hovered >= this.count) labels.hide("hovered");
        else labels.put("hovered", this.#placeOf(this.hovered), eye.camera, { solid: sphere });
        if (!this.push.visible) labels.hide("offset");
        else labels.put("offset", place.setFromMatrixPosition(this.gridWay.to).multiplyScalar(0.7), eye.camera, { below: eye.pixels(0.06) });
    }

    /** What people who do not see the view are told. */
    #describe() {
        const { tiles_seen: seen = null } = this.view ?? {};
        const errors = this.errors;
        const good = errors?.filter((error) => error !== null && error <= this.target_deg).length ?? 0;
        const visited = seen?.filter((count) => count > 0).length ?? 0;
        const known =
            errors === null
                ? "Nothing is known yet."
                : `Of ${errors.length} directions ${good} are within ${this.target_deg}°; ${visited} have readings.`;
        const label = `Sphere of directions. ${known} Arrow keys turn it, plus and minus zoom, R resets.`;
        if (this.canvas.getAttribute("aria-label") !== label) this.canvas.setAttribute("aria-label", label);
    }
}

const UP = new Vector3(0, 0, 1);
const LOST = "The graphics driver stopped the 3-D view. It comes back by itself, or after a reload of the page.";

/** Words over the view, where there are any. @param {HTMLElement} host */
function noticeIn(host) {
    const notice = document.createElement("p");
    notice.className = "scene-notice";
    notice.setAttribute("role", "status");
    Object.assign(notice.style, { position: "absolute", inset: "0", margin: "0", padding: "10%", color: "var(--faint)" });
    Object.assign(notice.style, { textAlign: "center", pointerEvents: "none" });
    host.append(notice);
    return notice;
}

/** @param {HTMLElement} host @param {HTMLCanvasElement} canvas @param {boolean} interactive */
function placeCanvas(host, canvas, interactive) {
    Object.assign(canvas.style, { position: "absolute", inset: "0", width: "100%", height: "100%", display: "block" });
    canvas.setAttribute("role", interactive ? "application" : "img");
    if (interactive) {
        canvas.tabIndex = 0;
        canvas.setAttribute("aria-roledescription", "3-D view");
    }
    host.prepend(canvas);
}

/** @param {import("./parts.js").Part | import("./parts.js").Cloud} part @param {Record<string, string>} colours */
function dye(part, colours) {
    // "" : the colour as it is, for materials here mix in sRGB
    for (const [name, colour] of Object.entries(colours)) part.material.uniforms[name].value.setStyle(colour, "");
}

/**
 * Around the middle of what there is, while no surface is known, as the 16 numbers of a matrix by columns.
 *
 * @param {import("./geometry.js").Extent} extent
 * @returns {number[]}
 */
function aroundMiddle({ low, high }) {
    const half = Math.max(...low.map((least, axis) => (high[axis] - least) / 2));
    const scale = half > 0 && Number.isFinite(half) ? 1 / half : 1;
    const middle = low.map((least, axis) => (Number.isFinite(least) ? (least + high[axis]) / 2 : 0));
    return [scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0, ...middle.map((part) => -scale * part), 1];
}

/** With three digits. @param {number} value */
function tidy(value) {
    return value >= 100 ? value.toFixed(0) : value.toPrecision(3);
}

/** Whether WebGL is drawn by the processor. @param {WebGL2RenderingContext} context */
function isSoftware(context) {
    const named = context.getExtension("WEBGL_debug_renderer_info");
    const name = String(context.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : context.RENDERER));
    return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
