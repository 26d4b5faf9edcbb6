/**
 * How finely the 3-D view is drawn, by how long its pictures take while it moves.
 *
 * A slow machine shows fewer pixels, and while the view moves fewer readings. Pictures that are fast then do not tell
 * whether those in full detail would be: full detail is tried again, each time after twice as many pictures.
 */

/** Mean milliseconds of a picture: beyond the first, detail is low; below the second, it may be full again. */
const [SLOW_MS, FAST_MS] = [45, 25];

/** What a picture counts for in the mean; a longer one than this was interrupted. */
const [WEIGHT, LONGEST_MS] = [0.15, 150];

/** Pictures before full detail is tried again, at first. */
const PATIENCE = 90;

export class Detail {
    isLow = false;
    mean_ms = FAST_MS;
    fast = 0;
    patience = PATIENCE;

    /**
     * Take how long a picture took that followed on another.
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
