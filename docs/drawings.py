"""Makes the drawings of docs/turning.md: ``python -m docs.drawings``.

Each is a turn of a body, as the page draws it. They go to ``docs/images/turn-BODY-STEP.svg``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from benchmarks.stage import Site, chromium

import flinders

IMAGES: Final = Path(__file__).resolve().parent / "images"
PACKAGE: Final = Path(flinders.__file__).parent
SHEET: Final = "apps/live/static/page.css"
STEPS: Final = {"board": 3, "drone": 3, "boat": 1, "car": 1}
"""Number of turns to draw for each body; one for a vehicle, whose circles look alike."""
DRAW: Final = """async (body) => {
    const { Hand } = await import("/src/apps/live/static/views/hand.js");
    const { SEQUENCES } = await import("/src/apps/live/static/standalone/choreography.js");
    const drawings = [];
    for (const { hold, axis, words, share } of SEQUENCES[body]) {
        const host = document.createElement("div");
        host.className = "hand";
        document.body.append(host);
        const hand = new Hand(host);
        hand.show({ body, hold, axis, angle: 2 * Math.PI * share, now: 0, parts: [] }, words, words);
        const drawing = host.querySelector("svg");
        for (const path of drawing.querySelectorAll("path")) {
            const style = getComputedStyle(path);
            const isHidden = style.display === "none" || style.visibility === "hidden";
            if (isHidden) { path.remove(); continue; }
            for (const name of ["fill", "stroke", "stroke-width", "stroke-dasharray"]) {
                path.setAttribute(name, srgb(style.getPropertyValue(name)));
            }
            path.removeAttribute("class");
            path.removeAttribute("style");
        }
        drawing.querySelector(".ghost").setAttribute("opacity", "0.75");
        drawing.setAttribute("xmlns", "http://www.w3.org/2000/svg");
        drawing.setAttribute("width", "210");
        drawing.setAttribute("height", "210");
        drawings.push(drawing.outerHTML);
        hand.hide();
        host.remove();
    }
    return drawings;

    function srgb(value) {
        const [, parts] = /^color\\(srgb ([^)]*)\\)$/.exec(value) ?? [];
        if (!parts) return value;
        const [red, green, blue, alpha = "1"] = parts.split(/[\\s/]+/);
        const whole = [red, green, blue].map((part) => Math.round(255 * Number(part)));
        return alpha === "1" ? `rgb(${whole.join(" ")})` : `rgb(${whole.join(" ")} / ${alpha})`;
    }
}"""


def main() -> None:
    """Draw all turns of all bodies."""
    with Site(PACKAGE, "/src/") as site, chromium() as browser:
        page = browser.new_page(color_scheme="light", reduced_motion="reduce")
        page.goto(f"{site.address}calibration.schema.json")
        page.set_content(f'<link rel="stylesheet" href="/src/{SHEET}">')
        page.wait_for_load_state("networkidle")
        for body, steps in STEPS.items():
            for step, drawing in enumerate(page.evaluate(DRAW, body)[:steps], start=1):
                path = IMAGES / f"turn-{body}-{step}.svg"
                path.write_text(f"{drawing}\n", encoding="utf-8")
                sys.stdout.write(f"{path.name}\n")


if __name__ == "__main__":
    main()
