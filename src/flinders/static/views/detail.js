/**
 * Level of detail of the 3-D view, from the duration of its frames during motion.
 *
 * A slow machine shows fewer pixels, and fewer readings during motion. Fast frames in low detail do not show that full
 * detail would be fast: full detail is tried again, each time after twice as many frames.
 */

/** Mean duration of a frame, ms: above the first, detail is low; below the second, it may be full again. */
const [SLOW_MS, FAST_MS] = [45, 25];

/** Weight of a frame in the mean, and the longest frame, ms; longer ones were interrupted. */
const [WEIGHT, LONGEST_MS] = [0.15, 150];

/** Frames before the first new try of full detail. */
const PATIENCE = 90;

export class Detail {
    isLow = false;
    mean_ms = FAST_MS;
    fast = 0;
    patience = PATIENCE;

    /**
     * Add the duration of a frame.
     * @param {number} ms
     * @returns {boolean} Whether the detail has changed.
     */
    took(ms) {
        this.mean_ms += WEIGHT * (Math.min(ms, LONGEST_MS) - this.mean_ms);
        this.fast = this.mean_ms < FAST_MS ? this.fast + 1 : 0;
        const isDue = this.isLow ? this.fast > this.patience : this.mean_ms > SLOW_MS;
        if (!isDue) return false;
        if (this.isLow) this.patience *= 2;
        this.isLow = !this.isLow;
        this.fast = 0;
        return true;
    }
}
