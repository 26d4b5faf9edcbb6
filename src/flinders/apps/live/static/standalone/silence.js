/** Values that a bus returns if a sensor does not answer: `flinders.core.silence`. */

import { countWords } from "./wording.js";

/** Counts readings without an answer of the sensor. */
export class Silence {
    /** @param {import("./patterns.js").Constants} rules */
    constructor(rules) {
        this.rules = rules;
        /** @type {Map<number, number>} Count of each value. */
        this.words = new Map();
    }

    /** Number of such readings. */
    get count() {
        return [...this.words.values()].reduce((sum, count) => sum + count, 0);
    }

    /**
     * Whether a reading has one such value in all three axes; counts it.
     * @param {number[]} reading In the recorded unit.
     */
    has([x, y, z]) {
        const { RANGE_ENDS, WORD_RANGE, REPEATED_BYTE_DIVISOR } = this.rules;
        if (x !== y || y !== z) return false;
        const bits = ((x % WORD_RANGE) + WORD_RANGE) % WORD_RANGE;
        const isTwice = -WORD_RANGE / 2 <= x && x < WORD_RANGE && bits % REPEATED_BYTE_DIVISOR === 0;
        if (!isTwice && !RANGE_ENDS.includes(x)) return false;
        this.words.set(x + 0, (this.words.get(x + 0) ?? 0) + 1);
        return true;
    }

    /** Sentence for the user. */
    toString() {
        const each = [...this.words].sort(([one], [other]) => one - other);
        return each.map(([word, count]) => `${countWords(count, "reading")} ${count === 1 ? "is" : "are"} ${word}, ${word}, ${word}: the sensor did not answer`).join("; ");
    }
}
