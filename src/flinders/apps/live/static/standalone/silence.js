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
        const { ENDS, WORD, BYTE_TWICE } = this.rules;
        if (x !== y || y !== z) return false;
        const bits = ((x % WORD) + WORD) % WORD;
        const isTwice = -WORD / 2 <= x && x < WORD && bits % BYTE_TWICE === 0;
        if (!isTwice && !ENDS.includes(x)) return false;
        this.words.set(x + 0, (this.words.get(x + 0) ?? 0) + 1);
        return true;
    }

    /** Sentence for the user. */
    toString() {
        const each = [...this.words].sort(([one], [other]) => one - other);
        return each.map(([word, count]) => `${countWords(count, "reading")} ${count === 1 ? "is" : "are"} ${word}, ${word}, ${word}: the sensor did not answer`).join("; ");
    }
}
