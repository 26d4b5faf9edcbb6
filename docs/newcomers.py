"""Checks that newcomers find their page: ``python -m docs.newcomers HTML`` searches the built documentation.

Each question has to show its page among the first three results. The search is that of the built pages, run by Node.js.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

from tests.javascript import node

QUESTIONS: Final = {
    "install": "start/install",
    "limited": "verdicts",
    "refused": "verdicts",
    "troubleshooting": "wrong",
    "heading wrong": "wrong",
    "compass points wrong way": "wrong",
    "how to turn": "turning",
    "how long to record": "plan",
    "glossary": "glossary",
    "hard iron": "glossary",
    "soft iron": "glossary",
    "dip angle": "glossary",
    "which tool": "tools",
    "MotionCal": "tools",
    "magneto": "tools",
    "ArduPilot": "start/pilot",
    "Arduino board": "start/maker",
    "drone log": "start/pilot",
    "current motor": "disturbances",
    "level only": "level",
    "declination": "headings",
    "serial port": "live/record",
    "notebook": "start/notebook",
    "production line": "start/line",
    "QMC5883L": "chips",
    "unit counts": "chips",
    "export PX4": "targets",
    "example": "tour",
    "difference between hard iron and soft iron": "glossary",
    "residuals": "glossary",
    "figure eight": "turning",
    "how many samples do I need": "plan",
    "how accurate will my heading be": "accuracy",
    "what does limited mean": "verdicts",
    "when should I recalibrate": "aging",
    "interference from motors": "disturbances",
    "temperature drift": "disturbances",
    "metal nearby": "disturbed-readings",
    "car cannot be rotated": "level",
    "gyroscope": "terms",
    "2D calibration": "classic/two-axis",
    "ellipsoid fit": "methods",
    "two compasses": "sensors",
    "swapped axes": "vehicles/mounting",
    "compass in a phone": "service/phone",
    "boat compass": "service/boat",
    "ROS": "vehicles/ros2",
    "calibrate Arduino": "start/maker",
    "permission denied": "live/record",
    "browser": "live/page",
    "csv": "formats",
    "nanotesla": "formats",
    "apply the calibration in Python": "start/notebook",
    "C header": "targets",
    "Windows": "start/install",
    "fake data": "simulate",
    "add a language": "start/contributor",
}
"""What newcomers type, and the page that answers."""
SHOWN: Final = 3
"""Number of first results that people look at."""
PROGRAM: Final = """
const { readFileSync } = require("node:fs");
const vm = require("node:vm");
const [folder, questions] = JSON.parse(readFileSync(0, "utf-8"));
const context = vm.createContext({
    document: { getElementById: () => null },
    DOCUMENTATION_OPTIONS: { BUILDER: "html", FILE_SUFFIX: ".html", LINK_SUFFIX: ".html" },
    SPHINX_HIGHLIGHT_ENABLED: false,
    _ready() {},
    _: (words) => words,
});
context.window = context;
for (const name of ["language_data", "searchtools"]) {
    vm.runInContext(readFileSync(`${folder}/_static/${name}.js`, "utf-8"), context);
}
vm.runInContext(readFileSync(`${folder}/searchindex.js`, "utf-8"), context);
const found = questions.map((question) => {
    context.question = question;
    const found = vm.runInContext("Search._performSearch(...Search._parseQuery(question))", context);
    return found.reverse().map(([name]) => name);
});
process.stdout.write(JSON.stringify(found));
"""


def results(html: Path, questions: list[str]) -> list[list[str]]:
    """Names of the pages that the search shows for each question, best first, each once."""
    given = json.dumps([str(html.resolve()), questions])
    done = subprocess.run([node(), "--eval", PROGRAM], input=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [list(dict.fromkeys(pages)) for pages in json.loads(done.stdout)]


def main() -> None:
    """Search for all questions, and print those that do not find their page."""
    html = Path(sys.argv[1])
    missed = 0
    for (question, page), found in zip(QUESTIONS.items(), results(html, list(QUESTIONS)), strict=True):
        if page not in found[:SHOWN]:
            missed += 1
            place = f"as number {found.index(page) + 1}" if page in found else "not at all"
            sys.stdout.write(f"{question!r} shows {', '.join(found[:SHOWN]) or 'nothing'}, and {page} {place}\n")
    sys.stdout.write(f"{len(QUESTIONS) - missed} of {len(QUESTIONS)} questions find their page\n")
    sys.exit(missed > 0)


if __name__ == "__main__":
    main()
