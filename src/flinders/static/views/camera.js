/**
 * Camera of the 3-D view: rotates, moves and zooms by mouse, touch and keys, with smooth motion.
 *
 * z points up on the screen. Until the user moves the view, the camera keeps the scene in frame. It turns towards the
 * advised direction; after a move by the user, only some seconds later.
 */

import { OrbitControls, PerspectiveCamera, Vector3 } from "../vendor/three.js";

/** Vertical angle of view, degrees; narrow, to avoid distortion of the sphere. */
const VIEW_DEG = 26;

const HOME = { azimuth: (32 * Math.PI) / 180, elevation: (20 * Math.PI) / 180 };
const STEEPEST = (84 * Math.PI) / 180;
const STEP = (12 * Math.PI) / 180;

/** Angles from the middle of the picture, radians: within the first well visible; below the second no turn. */
const [INSIGHT, LEEWAY] = [0.95, 0.25];

/** Time after a move by the user in which the camera does not turn by itself, ms. */
const LEFT_MS = 4000;

/** Time constants of moves by the user and of following, s. */
const [QUICK, SLOW] = [0.11, 0.45];

export class Eye {
    /**
     * @param {HTMLCanvasElement} canvas
     * @param {{interactive: boolean, wheel: "zoom" | "focus", still: boolean, changed: () => void}} options
     *     still: no easing, since the user asked for reduced motion
     */
    constructor(canvas, { interactive, wheel, still, changed }) {
        this.camera = new PerspectiveCamera(VIEW_DEG, 1, 0.05, 500);
        this.camera.up.set(0, 0, 1);
        this.still = still;
        this.canvas = canvas;
        this.changed = changed;
        this.centre = new Vector3();
        this.radius = 1.4;
        this.azimuth = HOME.azimuth;
        this.elevation = HOME.elevation;
        this.distance = 5;
        this.target = new Vector3();
        this.constant = QUICK;
        this.easing = false;
        this.untouched = true;
        this.touchedAt = -Infinity;
        this.offset = new Vector3();

        this.controls = new OrbitControls(this.camera, canvas);
        this.controls.enabled = interactive;
        this.controls.enableDamping = !still;
        this.controls.dampingFactor = 0.14;
        this.controls.rotateSpeed = 0.75;
        this.controls.addEventListener("start", () => {
            this.untouched = false;
            this.easing = false;
            this.touchedAt = Infinity;
        });
        this.controls.addEventListener("end", () => (this.touchedAt = performance.now()));
        this.controls.addEventListener("change", changed);
        if (wheel === "focus") canvas.addEventListener("wheel", this.#leave, { capture: true });
        if (interactive) canvas.addEventListener("keydown", this.#key);
        this.#stand();
    }

    /** @param {number} width @param {number} height */
    resize(width, height) {
        this.camera.aspect = width / height;
        this.camera.updateProjectionMatrix();
        if (this.untouched) this.frame(this.centre, this.radius);
    }

    /**
     * Keep a ball in the picture, unless the user has moved the view.
     *
     * @param {Vector3} centre
     * @param {number} radius
     * @param {number} [nearest]  least distance of the camera
     */
    frame(centre, radius, nearest = 0.3) {
        this.centre.copy(centre);
        this.radius = radius;
        this.controls.minDistance = nearest;
        this.controls.maxDistance = 8 * this.#away();
        this.camera.far = 20 * this.#away() + 10;
        this.camera.updateProjectionMatrix();
        if (!this.untouched) return;
        this.target.copy(centre);
        this.distance = this.#away();
        this.#ease(QUICK);
    }

    /** Reset the camera to its initial view. */
    reset() {
        this.untouched = true;
        [this.azimuth, this.elevation] = [HOME.azimuth, HOME.elevation];
        this.frame(this.centre, this.radius, this.controls.minDistance);
    }

    /**
     * Turn until a direction and its surroundings are well visible, unless the user has just moved the view.
     *
     * @param {Vector3} direction  unit vector, from the centre of what is drawn
     * @param {number} around  radians
     */
    follow(direction, around) {
        if (performance.now() - this.touchedAt < LEFT_MS) return;
        this.offset.copy(this.camera.position).sub(this.controls.target).normalize();
        if (this.offset.dot(direction) > Math.cos(Math.max(INSIGHT - around, LEEWAY))) return;
        this.#takeOver();
        this.azimuth = nearestTurn(Math.atan2(direction.y, direction.x), this.#azimuth());
        this.elevation = clamp(Math.asin(clamp(direction.z, -1, 1)), -1.1, 1.1);
        this.#ease(SLOW);
    }

    /** Length on the screen, in pixels, of a length at the centre. @param {number} length */
    pixels(length) {
        const distance = this.camera.position.distanceTo(this.controls.target);
        return ((this.canvas.clientHeight / 2) * length) / (Math.tan((VIEW_DEG * Math.PI) / 360) * distance);
    }

    /**
     * Advance the motion by a step of time.
     *
     * @param {number} seconds  since the last step
     * @returns {boolean}  whether the motion continues
     */
    step(seconds) {
        if (!this.easing) return this.controls.update();
        const share = this.still ? 1 : 1 - Math.exp(-Math.min(seconds, 0.1) / this.constant);
        this.controls.target.lerp(this.target, share);
        this.offset.copy(this.camera.position).sub(this.controls.target);
        const [azimuth, elevation, distance] = [this.#azimuth(), this.#elevation(), this.offset.length()];
        const left = Math.max(
            Math.abs(nearestTurn(this.azimuth, azimuth) - azimuth),
            Math.abs(this.elevation - elevation),
            Math.abs(this.distance / distance - 1),
            this.controls.target.distanceTo(this.target) / this.distance,
        );
        this.easing = left > 0.002 && !this.still;
        const part = this.easing ? share : 1;
        this.#put(
            azimuth + part * (nearestTurn(this.azimuth, azimuth) - azimuth),
            elevation + part * (this.elevation - elevation),
            distance * (this.distance / distance) ** part,
        );
        return this.easing;
    }

    dispose() {
        this.canvas.removeEventListener("wheel", this.#leave, { capture: true });
        this.canvas.removeEventListener("keydown", this.#key);
        this.controls.dispose();
    }

    /** Distance at which the ball fits the shorter side of the picture. */
    #away() {
        const half = (VIEW_DEG * Math.PI) / 360;
        return this.radius / Math.sin(Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect)));
    }

    /** @param {number} constant */
    #ease(constant) {
        this.constant = constant;
        this.easing = true;
        this.changed();
    }

    /** Continue from the present view to the target of a key. */
    #goOn() {
        this.#takeOver();
        this.untouched = false;
        this.touchedAt = performance.now();
        this.#ease(QUICK);
    }

    /** Set the target to the present view. */
    #takeOver() {
        if (this.easing) return;
        this.offset.copy(this.camera.position).sub(this.controls.target);
        [this.azimuth, this.elevation, this.distance] = [this.#azimuth(), this.#elevation(), this.offset.length()];
        this.target.copy(this.controls.target);
    }

    #azimuth() {
        return Math.atan2(this.offset.y, this.offset.x);
    }

    #elevation() {
        return Math.asin(clamp(this.offset.z / this.offset.length(), -1, 1));
    }

    #stand() {
        this.distance = this.#away();
        this.#put(this.azimuth, this.elevation, this.distance);
    }

    /** @param {number} azimuth @param {number} elevation @param {number} distance */
    #put(azimuth, elevation, distance) {
        this.offset.set(
            distance * Math.cos(elevation) * Math.cos(azimuth),
            distance * Math.cos(elevation) * Math.sin(azimuth),
            distance * Math.sin(elevation),
        );
        this.camera.position.copy(this.controls.target).add(this.offset);
        this.camera.lookAt(this.controls.target);
    }

    /** A page that scrolls keeps its wheel until the view has the focus. @param {WheelEvent} event */
    #leave = (event) => {
        if (document.activeElement !== this.canvas && !event.ctrlKey) event.stopImmediatePropagation();
    };

    /** @param {KeyboardEvent} event */
    #key = (event) => {
        if (event.ctrlKey || event.altKey || event.metaKey) return;
        const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
        if (arrow) {
            this.#goOn();
            if (event.shiftKey) this.#shift(arrow[0], arrow[1]);
            else {
                this.azimuth -= STEP * arrow[0];
                this.elevation = clamp(this.elevation + STEP * arrow[1], -STEEPEST, STEEPEST);
            }
        } else if (event.key === "+" || event.key === "=" || event.key === "-" || event.key === "_") {
            this.#goOn();
            const factor = event.key === "+" || event.key === "=" ? 0.85 : 1 / 0.85;
            this.distance = clamp(this.distance * factor, this.controls.minDistance, this.controls.maxDistance);
        } else if (event.key === "r" || event.key === "R") {
            this.reset();
        } else {
            return;
        }
        event.preventDefault();
        event.stopPropagation();
    };

    /** @param {number} right @param {number} up */
    #shift(right, up) {
        const length = 0.06 * this.distance;
        this.offset.setFromMatrixColumn(this.camera.matrix, 0).multiplyScalar(right * length);
        this.target.add(this.offset);
        this.offset.setFromMatrixColumn(this.camera.matrix, 1).multiplyScalar(up * length);
        this.target.add(this.offset);
    }
}

/** The same angle, within half a turn of another. @param {number} angle @param {number} other */
function nearestTurn(angle, other) {
    return other + Math.atan2(Math.sin(angle - other), Math.cos(angle - other));
}

/** @param {number} value @param {number} low @param {number} high */
export function clamp(value, low, high) {
    return Math.min(Math.max(value, low), high);
}
