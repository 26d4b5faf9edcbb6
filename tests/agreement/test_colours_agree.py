"""The report and the page draw an error in the same colour: both scales are run and compared."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files

import numpy as np
import pytest

from flinders.report.colours import THEMES, UNKNOWN, error_colour

ERRORS = [*np.geomspace(0.05, 60.0, 200).tolist(), 0.5, 1.0, 2.0, 5.0, 12.0]


def test_the_scale_is_that_of_the_page() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js to run the page's colours with")
    source = files("flinders").joinpath("static", "views", "colours.js").read_text(encoding="utf-8")
    program = f"""{source}
const hex = (rgb) => "#" + rgb.map((part) => Math.round(255 * part).toString(16).padStart(2, "0")).join("");
const found = {{}};
for (const theme of ["light", "dark"]) {{
    found[theme] = {json.dumps(ERRORS)}.map((deg) => hex(errorColour(deg, 1.3, theme)));
    found[theme].push(hex(errorColour(null, 1.3, theme)));
}}
console.log(JSON.stringify(found));
"""
    done = subprocess.run(
        [node, "--input-type=module"], input=program, capture_output=True, text=True, check=True, timeout=60
    )
    found = json.loads(done.stdout)
    for theme in THEMES:
        assert found[theme] == [*(error_colour(error, 1.3, theme) for error in ERRORS), UNKNOWN[theme]]
