/** Dialog to choose the magnetometer's columns of a table whose names are ambiguous. */

import { byId, element, setText } from "../dom.js";
import { sentence } from "../views/words.js";
import { phrase, translateFixed } from "../language.js";

/** @typedef {import("./tables.js").Asked} Asked */
/** @typedef {import("./tables.js").Choice} Choice */

const PANEL = `
  <dialog id="columns-panel" class="sheet small" aria-labelledby="columns-title">
    <div class="head"><h2 id="columns-title" data-phrase="columns.title">Which columns are the magnetometer?</h2></div>
    <form id="columns-form" method="dialog">
      <p class="faint" id="columns-words"></p>
      <div class="scrolls" tabindex="0" role="region" aria-label="First rows" data-phrase-label="columns.rows"><table class="parameters" id="columns-rows"></table></div>
      <p class="actions"><label>x <select id="columns-x" required autofocus></select></label> <label>y <select id="columns-y" required></select></label>
        <label>z <select id="columns-z" required></select></label> <label><span data-phrase="columns.in">in</span> <select id="columns-unit"></select></label></p>
      <div class="actions end"><button type="button" class="shut" data-phrase="cancel">Cancel</button><button value="read" class="primary" data-phrase="columns.read">Read these columns</button></div>
    </form>
  </dialog>`;
const AXES = ["x", "y", "z"];
const UNITS = { "": phrase("columns.unit", "as named, or counts"), uT: "µT" };

/**
 * A chip in one of its settings, and the µT of its count.
 * @typedef {[words: string, lsbUt: number]} ChipSetting
 */

export class ColumnDialog {
    /**
     * @param {readonly string[]} units
     * @param {readonly ChipSetting[]} chips
     */
    constructor(units, chips) {
        document.body.insertAdjacentHTML("beforeend", PANEL);
        translateFixed(document.body);
        this.dialog = byId("columns-panel", HTMLDialogElement);
        this.table = byId("columns-rows", HTMLTableElement);
        this.axes = AXES.map((axis) => byId(`columns-${axis}`, HTMLSelectElement));
        this.unit = byId("columns-unit", HTMLSelectElement);
        this.unit.replaceChildren(...["", ...units].map((unit) => option(unit, UNITS[/** @type {keyof typeof UNITS} */ (unit)] ?? unit)));
        const counts = element("optgroup", chips.map(([words], place) => option(`${place}`, words)));
        counts.setAttribute("label", phrase("columns.chip", "counts of a chip"));
        this.unit.append(counts);
        this.chips = chips;
        this.axes[0].addEventListener("change", () => this.follow());
        for (const select of this.axes) select.addEventListener("change", () => this.mark());
    }

    /**
     * Show the first rows, and let the user choose.
     * @param {Asked} asked
     * @param {string} words Reason of the question.
     * @returns {Promise<Choice | null>} Null without a choice.
     */
    ask({ names, rows }, words) {
        setText(byId("columns-words", HTMLElement), `${sentence(words)} ${phrase("columns.words", "These are the first rows.")}`);
        this.table.replaceChildren(rowOf("th", names), ...rows.map((cells) => rowOf("td", cells)));
        const all = names.map((name, place) => option(`${place}`, name === `${place + 1}` ? phrase("columns.column", "column {name}", { name }) : `${place + 1}: ${name}`));
        for (const select of this.axes) select.replaceChildren(option("", phrase("columns.choose", "choose …")), ...all.map((each) => each.cloneNode(true)));
        this.unit.value = "";
        this.mark();
        this.dialog.returnValue = "";
        this.dialog.showModal();
        return new Promise((done) => this.dialog.addEventListener("close", () => done(this.dialog.returnValue ? this.choice : null), { once: true }));
    }

    get choice() {
        const { value } = this.unit;
        const chip = value ? this.chips[Number(value)] : undefined;
        const scale = chip ? { unit: "counts", scale: chip[1] } : { unit: value };
        return { field: this.axes.map((axis) => Number(axis.value)), ...scale };
    }

    /** Select the columns after that of x for y and z. */
    follow() {
        const [x, ...others] = this.axes;
        others.forEach((select, i) => (select.selectedIndex = x.selectedIndex + i + 1 < x.length ? x.selectedIndex + i + 1 : 0));
    }

    /** Highlight the chosen columns, and check that they are three. */
    mark() {
        const chosen = this.axes.map(({ value }) => value);
        for (const row of this.table.rows) {
            [...row.cells].forEach((cell, place) => (cell.dataset.axis = AXES[chosen.indexOf(`${place}`)] ?? ""));
        }
        const isTwice = chosen.some((value, i) => value && chosen.indexOf(value) < i);
        this.axes[2].setCustomValidity(isTwice ? phrase("columns.twice", "x, y and z are three different columns") : "");
    }
}

/** @param {string} kind @param {readonly string[]} cells */
function rowOf(kind, cells) {
    return element("tr", cells.map((cell) => element(kind, cell.trim())));
}

/**
 * @param {string} value
 * @param {string} words
 */
function option(value, words) {
    const made = element("option", words);
    made.setAttribute("value", value);
    return made;
}
