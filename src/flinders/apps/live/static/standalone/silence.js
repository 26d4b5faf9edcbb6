/** Words that a bus gives in the place of a reading whose sensor does not answer: `flinders.core.silence`. */

import { countWords } from "./wording.js";

/** Counts readings at which a sensor did not answer. */
export class Silence {
    /** @param {import("./patterns.js").Constants} rules */
    constructor(rules) {
        this.rules = rules;
        /** @type {Map<number, number>} How often each word was there. */
        this.words = new Map();
    }

    /** How many there were. */
    get count() {
        return [...this.words.values()].reduce((sum, count) => sum + count, 0);
    }

    /**
     * Whether a reading is one such word in all three axes; it is counted.
     * @param {number[]} reading As it was recorded.
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

    /** For people. */
    toString() {
        const each = [...this.words].sort(([one], [other]) => one - other);
        return each.map(([word, count]) => `${countWords(count, "reading")} ${count === 1 ? "is" : "are"} ${word}, ${word}, ${word}: the sensor did not answer`).join("; ");
    }
}
