"""The report and the page draw an error in the same colour: both scales are run and compared."""

from __future__ import annotations

import json
import subprocess
from importlib.resources import files
from typing import get_args

import numpy as np
from tests.javascript import node

from flinders.report.colours import ENDS, STEPS, Theme, class_of, colour_of

EDGES = np.geomspace(*ENDS, STEPS + 1)
MIDDLES = np.sqrt(EDGES[1:] * EDGES[:-1]).tolist()
"""Error ÷ target in the middle of each class."""


def test_the_scale_is_that_of_the_page() -> None:
    source = files("flinders").joinpath("static", "views", "colours.js").read_text(encoding="utf-8")
    program = f"""{source}
const hex = (rgb) => "#" + rgb.map((part) => Math.round(255 * part).toString(16).padStart(2, "0")).join("");
const found = {{}};
for (const theme of ["light", "dark"]) {{
    found[theme] = {json.dumps(MIDDLES)}.map((ratio) => hex(errorColour(1.3 * ratio, 1.3, theme)));
    found[theme].push(hex(errorColour(null, 1.3, theme)));
}}
console.log(JSON.stringify(found));
"""
    done = subprocess.run(
        [node(), "--input-type=module"], input=program, capture_output=True, text=True, check=True, timeout=60
    )
    found = json.loads(done.stdout)
    for theme in get_args(Theme):
        assert found[theme] == [
            colour_of(kind, theme) for kind in [*(class_of(ratio, 1.0) for ratio in MIDDLES), "unknown"]
        ]
