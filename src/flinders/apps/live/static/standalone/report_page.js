/** Report of a calibration in the style of `flinders report`: one file of HTML, without scripts. */

import { element } from "../dom.js";
import { judged, tiltText } from "../finish.js";
import { path, roundUp, svg } from "../views/plot.js";
import { table } from "../views/table.js";
import { degrees, measuredText, sentence, significant, things } from "../views/words.js";

/** @typedef {import("../../../../static/view.d.ts").View} View */

/**
 * Inputs of a report.
 * @typedef {object} Reported
 * @property {import("./running.js").Finished} finished
 * @property {import("../messages.d.ts").SessionState} state
 * @property {ArrayLike<number>} field Used readings.
 * @property {string} version Of Flinders.
 */

const NEEDLE = '<svg viewBox="0 0 32 32" aria-hidden="true"><circle class="case" cx="16" cy="16" r="14"/><path class="north" d="M16 5.5 20 16h-8z"/><path class="south" d="M16 26.5 12 16h8z"/></svg>';
const CSP = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'";
/** Largest number of readings in a drawing. */
const MAX_DRAWN_READINGS = 1500;
const SIDE = 240;
const [WIDE, HIGH, EDGE] = [760, 220, 44];
const PLANES = [[0, 1], [0, 2], [1, 2]];
const NAMES = ["x", "y", "z"];
const SEVERITIES = { refuses: ["refused", "Refused"], limits: ["limited", "Limit"], note: ["info", "Note"] };
const PATHS = /** @type {Record<string, string>} */ ({
    good: "M12 2.5a9.5 9.5 0 1 0 0 19 9.5 9.5 0 0 0 0-19M7.5 12.5l3 3 6-6.5",
    limited: "M12 3 22 20.5H2zM12 10v4.5M12 17.5v.1",
    refused: "M8 2.5h8L21.5 8v8L16 21.5H8L2.5 16V8zM8.5 8.5l7 7M15.5 8.5l-7 7",
    info: "M12 11v6M12 7.2v.1M12 2.5a9.5 9.5 0 1 0 0 19 9.5 9.5 0 0 0 0-19",
});

/**
 * @param {Reported} reported
 * @param {string} style Style sheet of the report.
 * @returns {string} The page.
 */
export function reportPage({ finished, state, field, version }, style) {
    const view = /** @type {View} */ (finished.view);
    const { kind, title, words } = judged(finished, state);
    const date = new Date().toISOString().slice(0, 16).replace("T", " ");
    const from = origin(view, state, [finished.name, `${date} UTC, with Flinders ${version}`]);
    const main = element("main", [verdictOf(view, kind, title, words), ...sections(view, field), from]);
    const brand = element("p", "", "brand");
    brand.innerHTML = `${NEEDLE}Flinders`;
    const top = element("header", [brand, element("p", `${finished.name} · ${date.slice(0, 10)}`, "about")], "top");
    const heading = element("title", `Compass calibration from ${finished.name}: ${title}`);
    const head = `<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="${CSP}"><meta name="viewport" content="width=device-width, initial-scale=1">`;
    return `<!doctype html>\n<html lang="en-GB"><head>${head}${heading.outerHTML}<style>${style}</style></head>\n<body>${top.outerHTML}${main.outerHTML}</body></html>\n`;
}

/**
 * @param {View} view
 * @param {string} kind
 * @param {string} title
 * @param {string} words
 */
function verdictOf(view, kind, title, words) {
    const texts = element("div", [element("p", "Compass calibration", "what"), element("h1", title), element("p", words, "sentence")]);
    const said = element("div", [icon(kind), texts], "said");
    const made = element("section", view.offset ? [said, numbersOf(view)] : [said], "verdict");
    made.dataset.verdict = kind;
    return made;
}

/** @param {View} view */
function numbersOf({ heading_error_deg: error, uncorrected_heading_error_deg: raw, attitude_limit_deg: tilt, ...view }) {
    const before = raw ? `before: ${degrees(raw.worst)}; ` : "";
    const rows = [
        ["Worst heading off by", error && degrees(error.worst), `${before}the target is ${error?.target_deg}°`],
        ["All headings within", error && degrees(error.bound_95), "with 95 % confidence"],
        ["Within target up to a tilt of", tilt !== null && tiltText(tilt), `level vehicle, dip ${significant(error?.dip_deg, 3)}°${error?.dip_assumed ? ", assumed" : ""}`],
        ["Strength of the field", view.field_strength !== null && `${measuredText(view.field_strength, view.noise).value} ${view.unit}`, view.field_strength_known ? "known" : "relative: none was given"],
    ];
    const pairs = rows.flatMap(([name, value, about]) => (value ? [pair(name || "", [element("strong", value), element("span", about || "")])] : []));
    return element("dl", pairs, "numbers");
}

/**
 * @param {View} view
 * @param {ArrayLike<number>} field
 */
function sections(view, field) {
    const made = [];
    if (view.findings.length) {
        made.push(section("Findings", element("ul", view.findings.map(finding), "findings")));
    }
    made.push(section("Seen along the axes", ...projections(view, field)));
    if (view.offset) {
        if (view.turn) made.push(section("Deviation of a level vehicle", deviation(view.turn), keys()));
        const host = element("div", "", "scrolls");
        table(host, view);
        made.push(section("Offset and matrix", host));
    }
    return made;
}

/** @param {View["findings"][number]} finding */
function finding({ severity, advice, code }) {
    const [mark, name] = SEVERITIES[severity];
    const row = element("li", [icon(mark), element("p", [element("strong", `${name}.`), ` ${sentence(advice)} `, element("code", code)])]);
    row.dataset.severity = severity;
    return row;
}

/**
 * Raw readings with the offset as a line from zero, and corrected readings with their circle.
 * @param {View} view
 * @param {ArrayLike<number>} field
 */
function projections({ shown, unit }, field) {
    const step = Math.max(Math.ceil(field.length / 3 / MAX_DRAWN_READINGS), 1);
    const raw = Array.from({ length: Math.ceil(field.length / 3 / step) }, (_, i) => [0, 1, 2].map((axis) => field[3 * i * step + axis]));
    const rows = [row("before", raw, shown?.offset ?? null, 0)];
    if (shown) {
        const { offset, matrix, strength } = shown;
        const after = raw.map((reading) => matrix.map((line) => line.reduce((sum, part, axis) => sum + part * (reading[axis] - offset[axis]), 0)));
        rows.push(row("after", after, null, strength));
    }
    return [...rows, keys(), element("p", `In ${unit}. A line leads from zero to the offset; corrected readings lie on the circle, or within it.`, "caption")];
}

/**
 * Three squares of one scale.
 * @param {string} kind
 * @param {number[][]} points
 * @param {readonly number[] | null} offset
 * @param {number} radius
 */
function row(kind, points, offset, radius) {
    const ends = [0, 1, 2].map((axis) => points.map((point) => point[axis])).map((values) => [Math.min(...values), Math.max(...values)]);
    const half = roundUp(1.12 * Math.max(radius, ...ends.map(([low, high]) => (high - low) / 2)));
    const middle = ends.map(([low, high]) => (radius ? 0 : (Math.round((5 * (low + high)) / half) * half) / 10));
    const figures = PLANES.map(([across, up]) => {
        const place = (/** @type {number} */ value, /** @type {number} */ axis) => ((value - middle[axis] + half) / half / 2) * SIDE;
        const at = (/** @type {readonly number[]} */ point) => `${place(point[across], across).toFixed(1)} ${(SIDE - place(point[up], up)).toFixed(1)}`;
        const [x, y] = at([0, 0, 0]).split(" ");
        const range = (/** @type {number} */ axis) => `${NAMES[axis]}, ${significant(middle[axis] - half, 3)} to ${significant(middle[axis] + half, 3)}`;
        const drawn = svg("svg", { class: "figure", viewBox: `0 0 ${SIDE} ${SIDE}`, role: "img", "aria-label": `${kind}, ${NAMES[across]} and ${NAMES[up]}` });
        drawn.append(svg("path", { class: "zero", d: `M${x} 0V${SIDE}M0 ${y}H${SIDE}` }), svg("path", { class: `dots ${kind}`, d: points.map((point) => `M${at(point)}h0`).join("") }));
        if (offset) drawn.append(svg("path", { class: "iron", d: `M${x} ${y}L${at(offset)}` }));
        if (radius) drawn.append(svg("circle", { class: "outline after", cx: Number(x), cy: Number(y), r: (radius / half / 2) * SIDE }));
        drawn.append(svg("rect", { class: "frame", width: SIDE, height: SIDE }), svg("text", { class: "halo", x: 6, y: 16 }, range(up)));
        drawn.append(svg("text", { class: "halo", x: SIDE - 6, y: SIDE - 6, "text-anchor": "end" }, range(across)));
        return element("figure", [drawn]);
    });
    return element("div", figures, "trio");
}

/** @param {NonNullable<View["turn"]>} turn Deviation of a level vehicle before correction, and 1 σ after it. */
function deviation({ heading_deg: headings, before_deg: before, sigma_deg: sigma }) {
    const most = roundUp(Math.max(...before.map(Math.abs), ...sigma));
    const at = (/** @type {number} */ heading, /** @type {number} */ deg) => /** @type {const} */ ([EDGE + (heading / 360) * (WIDE - EDGE), (HIGH - 20) * (0.5 - deg / most / 2)]);
    const isBroken = (/** @type {number[]} */ values, /** @type {number} */ i) => i > 0 && Math.abs(values[i] - values[i - 1]) > 180;
    const along = (/** @type {number[]} */ values, sign = 1) => headings.map((heading, i) => at(heading, isBroken(values, i) ? NaN : sign * values[i]));
    const drawn = svg("svg", { class: "figure", viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": "Deviation by heading" });
    drawn.append(svg("path", { class: "zero", d: path([at(0, 0), at(360, 0)]) }));
    drawn.append(svg("path", { class: "band", d: path([...along(sigma), ...along(sigma, -1).reverse()], true) }), svg("path", { class: "curve corrected thin", d: path(along(sigma)) }));
    drawn.append(svg("path", { class: "curve raw", d: path(along(before)) }));
    for (const deg of [-most, 0, most]) drawn.append(svg("text", { x: 0, y: at(0, deg)[1] + (deg > 0 ? 12 : deg < 0 ? -2 : 4) }, `${deg}°`));
    for (const [i, name] of ["N", "E", "S", "W"].entries()) drawn.append(svg("text", { x: at(90 * i, 0)[0], y: HIGH - 4 }, name));
    return element("figure", [drawn], "wide");
}

/** @param {View} view @param {Reported["state"]} state @param {string[]} from  The recording, and its time. */
function origin({ method, samples, noise, unit }, state, [name, made]) {
    const rows = [["Recording", name], ["Method", `${method}, ${things(samples, "reading")} used`], ["Noise", `${significant(noise, 3)} ${unit} (1 σ)`], ["Target", `${state.target_deg}°`], ["Made", made]];
    return section("Origin", element("dl", rows.map(([term, value]) => pair(term, value)), "provenance"));
}

/** @param {string} term @param {string | Node[]} value */
function pair(term, value) {
    return element("div", [element("dt", term), element("dd", value)]);
}

/** @param {string} title @param {Element[]} content */
function section(title, ...content) {
    return element("section", [element("h2", title), ...content]);
}

function keys() {
    return element("p", [element("span", "before", "k before"), element("span", "after", "k after")], "key");
}

/** @param {string} name */
function icon(name) {
    return svg("svg", { class: "icon", viewBox: "0 0 24 24", "aria-hidden": "true" }, [svg("path", { d: PATHS[name] ?? PATHS.info })]);
}
