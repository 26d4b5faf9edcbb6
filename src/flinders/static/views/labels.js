/** Labels of the 3-D view: elements of the page at positions of the picture. */

/** @typedef {import("../vendor/three.js").Vector3} Vector3 @typedef {import("../vendor/three.js").Camera} Camera */

/** Opacity of labels behind the sphere. */
const HIDDEN = 0.3;

export class Labels {
    /**
     * @param {HTMLElement} host
     * @param {Record<string, string>} words  of each label, by its name
     */
    constructor(host, words) {
        this.host = host;
        this.size = 14;
        this.made = new Map(Object.entries(words).map(([name, text]) => [name, label(host, text)]));
    }

    /** @param {string} name @param {string} words */
    say(name, words) {
        this.of(name).textContent = words;
    }

    /**
     * @param {string} name
     * @param {Vector3} place  is overwritten
     * @param {Camera} camera
     * @param {{solid?: boolean, below?: number}} [options]
     *     solid: hide the label behind the unit sphere; below: offset down in pixels, plus half a line
     */
    put(name, place, camera, { solid = false, below = 0 } = {}) {
        const label = this.of(name);
        const dim = solid && isHidden(place, camera.position);
        place.project(camera);
        const x = (0.5 + 0.5 * place.x) * this.host.clientWidth;
        const y = (0.5 - 0.5 * place.y) * this.host.clientHeight + (below > 0 ? below + 0.75 * this.size : 0);
        label.style.display = "block";
        label.style.opacity = dim ? String(HIDDEN) : "1";
        label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    }

    /** @param {string} name */
    hide(name) {
        this.of(name).style.display = "none";
    }

    /** @param {string} ink @param {string} halo */
    dye(ink, halo) {
        for (const { style } of this.made.values()) {
            style.color = ink;
            style.textShadow = `0 0 2px ${halo}, 0 0 3px ${halo}, 0 0 4px ${halo}, 0 0 7px ${halo}`;
        }
    }

    /** @param {number} size  pixels */
    resize(size) {
        this.size = size;
        for (const { style } of this.made.values()) style.fontSize = `${size}px`;
    }

    remove() {
        for (const label of this.made.values()) label.remove();
    }

    /** @param {string} name */
    of(name) {
        return /** @type {HTMLElement} */ (this.made.get(name));
    }
}

/** @param {HTMLElement} host @param {string} words */
function label(host, words) {
    const made = document.createElement("div");
    made.className = "scene-label";
    made.textContent = words;
    made.setAttribute("aria-hidden", "true"); // the view's own label describes it
    Object.assign(made.style, { position: "absolute", left: "0", top: "0", display: "none", pointerEvents: "none" });
    Object.assign(made.style, { fontWeight: "600", lineHeight: "1", whiteSpace: "nowrap" });
    host.append(made);
    return made;
}

/** Whether the unit sphere hides a place from the camera. @param {Vector3} place @param {Vector3} eye */
function isHidden(place, eye) {
    const [x, y, z] = [place.x - eye.x, place.y - eye.y, place.z - eye.z];
    const far = Math.hypot(x, y, z);
    const nearest = -(eye.x * x + eye.y * y + eye.z * z) / far;
    const off = eye.lengthSq() - nearest * nearest;
    return off < 1 && nearest - Math.sqrt(1 - off) < far - 0.01;
}
