/** A small planner: gives the turns and the expected heading error for a body and the noise of its sensor. */

import { adopt, byId, element, Refusal } from "./dom.js";
import { sentence } from "./views/words.js";
import { numeral, phrase, translateFixed } from "./language.js";

/**
 * A plan as `flinders.apps.live.planned` gives it.
 * @typedef {object} PlannedRecording
 * @property {string} body
 * @property {number} noise  µT, 1 σ of each axis and reading
 * @property {string} verdict  expected verdict
 * @property {string} sentence
 * @property {string[]} steps  instructions
 */

/** @typedef {(body: string, noise: number) => Promise<PlannedRecording>} Ask */

const CSS = `
.plan { pointer-events: auto; text-align: left; color: var(--ink); }
.plan summary { cursor: pointer; font-weight: 600; }
.plan .row { display: flex; flex-wrap: wrap; align-items: center; gap: 0.5rem 0.75rem; margin-top: 0.5rem; }
.plan input { width: 5rem; }
.plan label:has(select) { display: flex; flex-wrap: wrap; align-items: center; gap: 0.25rem; min-width: 0; max-width: 100%; }
.plan select { min-width: 0; max-width: 100%; }
.plan ol { margin: 0.5rem 0 0; padding-left: 1.5rem; list-style: decimal; }
.empty > .plan[open] { position: absolute; inset: 0; overflow: auto; }
.empty:has(> .plan[open]) > :not(.plan) { visibility: hidden; }
.plan p { max-width: 40rem; margin-top: 0.5rem; text-wrap: pretty; }
.plan:not([data-verdict]) :is(ol, .result) { display: none; }`;

const FORM = `<summary data-phrase="plan.title">Plan a recording</summary>
<p class="row"><label><span data-phrase="plan.body">body</span> <select id="plan-body"></select></label>
<label><span data-phrase="plan.noise">noise</span> <input id="plan-noise" type="number" inputmode="decimal" min="0.001" step="any" value="0.5"> µT</label>
<button type="button" id="plan-ask" data-phrase="plan.ask">Plan</button></p>
<ol id="plan-steps"></ol><p class="result" id="plan-result" role="status"></p>`;

/**
 * Put the planner into a part of the page.
 * @param {HTMLElement} parent
 * @param {readonly [name: string, description: string][]} bodies
 * @param {Ask} ask
 */
export function layPlan(parent, bodies, ask) {
    adopt(CSS);
    const plan = element("details", "", "plan");
    plan.id = "plan";
    plan.insertAdjacentHTML("beforeend", FORM);
    translateFixed(plan);
    parent.append(plan);
    const body = byId("plan-body", HTMLSelectElement);
    body.append(...bodies.map(([name, description]) => new Option(`${name}: ${phrase(`plan.for.${name}`, description)}`, name)));
    byId("plan-ask", HTMLElement).addEventListener("click", async () => {
        plan.setAttribute("aria-busy", "true");
        try {
            show(plan, await ask(body.value, Number(byId("plan-noise", HTMLInputElement).value)));
        } catch (error) {
            if (!(error instanceof Refusal)) throw error;
            show(plan, { body: "", noise: 0, verdict: "refused", sentence: sentence(error.message), steps: [] });
        } finally {
            plan.removeAttribute("aria-busy");
        }
    });
}

/**
 * @param {HTMLElement} plan
 * @param {PlannedRecording} planned
 */
function show(plan, planned) {
    plan.dataset.verdict = planned.verdict;
    const noise = planned.body ? phrase("plan.with", "With {noise} µT of noise: ", { noise: numeral(String(planned.noise)) }) : "";
    const english = element("span", planned.sentence);
    if (planned.body) english.lang = "en"; // instructions and verdict of a plan have no translation
    byId("plan-result", HTMLElement).replaceChildren(noise, english);
    const steps = byId("plan-steps", HTMLElement);
    steps.lang = "en";
    steps.replaceChildren(...planned.steps.map((words) => element("li", words)));
}

/**
 * Answer from a table of plans: the one with the next larger noise.
 * @param {readonly PlannedRecording[]} table
 * @returns {Ask}
 */
export function askTable(table) {
    return async (body, noise) => {
        if (!(noise > 0)) throw new Refusal(phrase("plan.no-number", "the noise of a reading is a number above 0, in µT"));
        const rows = table.filter((row) => row.body === body && row.noise >= noise * (1 - 1e-9));
        if (!rows.length) throw new Refusal(phrase("plan.none", "for so much noise this page has no plan: flinders plan makes one"));
        return rows.reduce((least, row) => (row.noise < least.noise ? row : least));
    };
}
