/**
 * The panels of the page in addition to status and sphere, as a list of rows, and their construction.
 *
 * A widget is one file of `views`: its drawing, its words, its styles, and its row at the end. To add one, write that
 * file and name its row in `WIDGETS`.
 */

import { adopt, element, icon } from "./dom.js";
import { chartOf, markReading } from "./views/charts.js";
import { deviation } from "./views/deviation.js";
import { heading } from "./views/heading.js";
import { projections } from "./views/projections.js";
import { residuals } from "./views/residuals.js";
import { strength } from "./views/strength.js";
import { phrase } from "./language.js";

/** @typedef {import("./keys.js").Shortcut} Shortcut */
/** @typedef {import("./messages.d.ts").SessionState} State */
/** @typedef {import("../../../static/view.d.ts").View} View */
/** @typedef {import("../../../static/view.d.ts").Now} Now */
/** @typedef {import("./store.js").Store} Store */
/** @typedef {import("../../../static/view.d.ts").Points} Points */

/**
 * Name of a part of the session that a widget shows.
 * @typedef {"view" | "state" | "now" | "points"} Part
 */

/**
 * Data that widgets draw.
 * @typedef {object} Picture
 * @property {View | null} view
 * @property {State | null} state
 * @property {Now | null} now
 * @property {Points} points
 */

/**
 * Functions of the page for a widget.
 * @typedef {object} Page
 * @property {Store} store
 * @property {(message: import("./messages.d.ts").Command) => void} send
 * @property {(severity: "info" | "warning" | "error", words: string) => void} notify
 * @property {(reading: number | null) => void} hover
 */

/**
 * Controls that a widget adds to the page.
 * @typedef {object} Controls
 * @property {readonly Shortcut[]} shortcuts
 * @property {() => boolean} escape  for the Escape key: returns whether it had an effect
 * @property {(state: State) => void} show  called with each state
 */

/**
 * The row of a widget.
 * @typedef {object} Widget
 * @property {string} name  class of its panel, id of its host
 * @property {string} title
 * @property {"side" | "strip"} place
 * @property {readonly Part[]} on  parts whose change redraws it; with "points", at most ten times a second
 * @property {string} css
 * @property {(panel: WidgetPanel, picture: Picture) => void} draw
 * @property {(panel: WidgetPanel, page: Page) => Controls | void} [begin]
 * @property {readonly (readonly [string, string])[]} [legend]  classes and words
 * @property {boolean} [showsReadings]  a chart that marks the reading under the pointer, in any view
 * @property {string} [enlarges]  label of the button that enlarges it; none without a label
 * @property {string} [host]  class of the host, if it is not a chart
 */

/**
 * A widget on the page.
 * @typedef {object} WidgetPanel
 * @property {Widget} row
 * @property {HTMLElement} head
 * @property {HTMLElement} title
 * @property {HTMLElement} host
 * @property {Controls | null} controls
 */

/**
 * All widgets, in the order of the page.
 * @type {readonly Widget[]}
 */
const WIDGETS = [heading, deviation, residuals, strength, projections];

/**
 * Add all widgets to the page.
 * @param {HTMLElement} strip  the foot of the board; widgets of the side stand before it
 * @param {Page} page
 * @returns {WidgetPanel[]}
 */
export function lay(strip, page) {
    adopt(WIDGETS.map(({ css }) => css).join("\n"));
    return WIDGETS.map((row) => {
        const panel = panelOf(row);
        const section = panel.host.parentElement ?? panel.host;
        if (row.place === "strip") strip.append(section);
        else strip.before(section);
        panel.controls = row.begin?.(panel, page) ?? null;
        if (row.showsReadings) listenForHover(panel, page);
        return panel;
    });
}

/**
 * Draw the widgets that show a changed part.
 * @param {readonly WidgetPanel[]} panels
 * @param {readonly Part[]} changed
 * @param {Picture} picture
 */
export function drawChanged(panels, changed, picture) {
    for (const panel of panels) {
        const { on, draw } = panel.row;
        const isDue = on.includes("points") ? changed.includes("points") : on.some((part) => changed.includes(part));
        if (isDue) draw(panel, picture);
    }
}

/**
 * Mark a reading in all charts that show it; null removes the marks.
 * @param {readonly WidgetPanel[]} panels
 * @param {number | null} reading
 */
export function markHovered(panels, reading) {
    for (const { row, host } of panels) if (row.showsReadings) markReading(chartOf(host), reading);
}

/** @param {WidgetPanel} panel @param {Page} page */
function listenForHover({ host }, page) {
    const chart = chartOf(host);
    host.addEventListener("pointermove", ({ pointerType, clientX, clientY }) => {
        if (pointerType === "touch") return;
        const { left, top } = host.getBoundingClientRect();
        page.hover(chart.nearest(clientX - left, clientY - top));
    });
    host.addEventListener("pointerleave", () => page.hover(null));
}

/**
 * An empty panel.
 * @param {Widget} row
 * @returns {WidgetPanel}
 */
function panelOf(row) {
    const title = element("h2", phrase(`widget.${row.name}`, row.title));
    title.id = `${row.name}-title`;
    const head = element("div", [title], "head");
    if (row.legend) head.append(legendOf(row.legend));
    if (row.enlarges) head.append(enlarger(row.name, row.enlarges));
    const host = element("div", "", row.host ?? "host");
    host.id = row.name;
    const section = element("section", [head, host], `panel ${row.name}`);
    section.setAttribute("aria-labelledby", title.id);
    return { row, head, title, host, controls: null };
}

/**
 * @param {readonly (readonly [string, string])[]} legend
 * @returns {HTMLElement}
 */
function legendOf(legend) {
    const made = element("p", legend.map(([kind, words]) => element("span", phrase(`plot.${words}`, words), kind)), "key");
    made.setAttribute("aria-hidden", "true");
    return made;
}

/**
 * @param {string} name  of the widget
 * @param {string} what
 * @returns {HTMLElement}
 */
function enlarger(name, what) {
    const button = element("button", [icon("enlarge")], "square quiet enlarge");
    button.setAttribute("type", "button");
    button.setAttribute("aria-label", phrase(`enlarge.${name}`, `Enlarge ${what}`));
    return button;
}
