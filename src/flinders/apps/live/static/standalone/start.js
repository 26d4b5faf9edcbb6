/** First view of the page without a server: the choice of a source. */

import { adopt, byId } from "../dom.js";
import { translateFixed } from "../language.js";

const PANEL = `
    <section class="start" id="start" aria-labelledby="start-title" hidden>
      <div class="head"><h2 id="start-title" data-phrase="start.title">Calibrate a magnetometer</h2>
        <button type="button" id="start-close" class="square quiet" aria-label="Close" data-phrase-label="close" hidden><svg class="icon" aria-hidden="true"><use href="#i-close"/></svg></button></div>
      <p class="lead" data-phrase="start.words">Turn the sensor through all directions, watch the heading error fall, and take the calibration with you. It is computed in this browser, and nothing is sent anywhere.</p>
      <p class="answer" id="start-answer" role="alert"></p>
      <div class="choices">
        <section class="panel" aria-labelledby="start-board">
          <h3 id="start-board" data-phrase="start.board">A board</h3>
          <p data-phrase="start.board.words">It prints its magnetometer over USB, in about any form.</p>
          <p class="row"><button type="button" id="use-board" class="primary" data-phrase="start.board.button">Connect a board</button>
            <label class="baud"><span class="faint" data-phrase="start.baud">baud</span>
              <select id="baud"><option>9600</option><option>19200</option><option>38400</option><option>57600</option><option selected>115200</option><option>230400</option><option>250000</option><option>460800</option><option>500000</option><option>921600</option><option>1000000</option><option>2000000</option></select></label></p>
        </section>
        <section class="panel" aria-labelledby="start-log">
          <h3 id="start-log" data-phrase="start.log">A log</h3>
          <p data-phrase="start.log.words">A table, or what a board printed: drop the file anywhere on this page, or paste the text.</p>
          <p class="row"><button type="button" id="use-log" data-phrase="compare.choose">Choose a file…</button>
            <textarea id="paste" rows="1" aria-label="Text of a log" data-phrase-label="start.paste.label" placeholder="or paste it here" data-phrase-placeholder="start.paste" spellcheck="false"></textarea></p>
        </section>
        <section class="panel" aria-labelledby="start-phone">
          <h3 id="start-phone" data-phrase="start.phone">This phone</h3>
          <p data-phrase="start.phone.words">Its own magnetometer, where the browser lets pages read it.</p>
          <p class="row"><button type="button" id="use-phone" data-phrase="start.phone.button">Use its sensor</button></p>
        </section>
        <section class="panel" aria-labelledby="start-simulation">
          <h3 id="start-simulation" data-phrase="start.simulation">Nothing at hand</h3>
          <p data-phrase="start.simulation.words">A simulated sensor in a hand shows how it goes.</p>
          <p class="row"><button type="button" id="use-simulation" data-phrase="start.simulation.button">Simulate a sensor</button></p>
        </section>
      </div>
      <section class="panel" id="start-plan" aria-label="Plan"></section>
    </section>`;

const BUTTON = `
    <button type="button" id="connect" title="Source of the readings" data-phrase-title="start.source.title"><svg class="icon" aria-hidden="true"><use href="#i-send"/></svg><span data-phrase="start.source">Source</span></button>`;

const CSS = `
[data-start] :is(.board > :not(.start), .source, #open, #pause, #clear, #finish) { display: none; }
[data-start] .bar { justify-content: space-between; }
[data-start] .board { display: block; min-height: calc(100cqb - 4rem); }
.start { width: 100%; max-width: 56rem; margin-inline: auto; padding: clamp(0.5rem, 8vh, 6rem) 0.25rem 2rem; display: grid; gap: 1rem; }
.start h2 { font-size: 1.75rem; line-height: 1.2; color: var(--ink); letter-spacing: -0.01em; white-space: normal; text-wrap: balance; }
.start .lead { font-size: 1.0625rem; color: var(--faint); text-wrap: pretty; }
.choices { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr)); gap: 0.75rem; }
.choices section { gap: 0.5rem; padding: 1rem 1.25rem 1.25rem; }
.choices h3 { margin: 0; font-size: 1.125rem; color: var(--ink); }
.choices p { color: var(--faint); text-wrap: pretty; }
.choices .row { display: flex; flex-wrap: wrap; align-items: center; gap: 0.5rem 1rem; margin-top: auto; padding-top: 0.5rem; }
.choices button { color: var(--ink); min-height: 2.75rem; padding-inline: 1rem; font-size: 1rem; }
.choices button.primary { color: var(--accent-ink); }
.baud { display: inline-flex; align-items: center; gap: 0.375rem; font-size: 0.875rem; }
.choices textarea { flex: 1; min-width: 8rem; height: 2.75rem; padding: 0.625rem 0.75rem; border: 1px solid var(--strong-line); border-radius: 0.5rem; background: var(--panel); color: var(--ink); font: inherit; font-size: 0.9375rem; line-height: 1.4; resize: none; white-space: nowrap; overflow: hidden; }
.choices textarea::placeholder { color: var(--faint); opacity: 1; }
.start .answer { margin: 0; font-size: 1rem; font-weight: 550; }
.start .answer:empty { display: none; }`;

/** Add the choice to the page, and mark the page as one without a server. */
export function layChoice() {
    document.documentElement.toggleAttribute("data-alone", true);
    adopt(CSS);
    document.querySelector(".board")?.insertAdjacentHTML("afterbegin", PANEL);
    byId("open", HTMLElement).insertAdjacentHTML("beforebegin", BUTTON);
    translateFixed(document);
}
