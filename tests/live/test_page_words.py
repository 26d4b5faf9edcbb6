"""Words of the page: its finish panel, the titles of findings, and the list of its widgets."""

from __future__ import annotations

import json
import re
import subprocess
from importlib.resources import files
from typing import Any

import numpy as np
import pytest
from tests.javascript import node
from tests.sentences import assert_sentences

from flinders.errors import figures
from flinders.findings import CATALOGUE

STATIC = files("flinders.apps.live").joinpath("static")
MODULES = ("language.js", "views/words.js", "store.js", "verdict_words.js", "finish.js")
MISSES = "Misses the target"
LEVEL = [{"code": "level-plane", "severity": "limits"}, {"code": "rotation-unknown", "severity": "note"}]
NOISY = {"code": "noise", "severity": "limits"}


def run_of_page(program: str) -> object:
    """What a program says that has the modules of the finish panel at hand."""
    modules = [STATIC.joinpath(*name.split("/")).read_text(encoding="utf-8") for name in MODULES]
    source = re.sub(r"^import .*;$", "", "\n".join(modules), flags=re.MULTILINE)
    done = subprocess.run(
        [node(), "--input-type=module"], input=source + program, capture_output=True, text=True, check=True, timeout=60
    )
    return json.loads(done.stdout)


def test_angles_have_the_same_digits_on_the_page_as_in_sentences() -> None:
    angles = [*np.geomspace(1e-3, 89.0, 300).tolist(), 0.084, 0.0995, 0.996, 9.97]
    found = run_of_page(f"console.log(JSON.stringify({json.dumps(angles)}.map((deg) => degrees(deg))));")
    assert found == [f"{figures(angle)}°" for angle in angles]


@pytest.mark.parametrize(
    ("changes", "goal", "kind", "title"),
    [
        ({}, "heading", "good", "Good"),
        ({"verdict": "limited"}, "heading", "limited", "Limited"),
        ({"verdict": "limited", "findings": LEVEL}, "heading", "limited", "Good while level"),
        ({"verdict": "limited", "findings": [*LEVEL, NOISY]}, "heading", "limited", "Limited"),
        ({"verdict": "limited", "findings": LEVEL}, "attitude", "limited", MISSES),
        ({"verdict": "limited", "heading_error_deg": {"worst": 0.4, "target_deg": 0.2}}, "heading", "limited", MISSES),
        ({"verdict": "good"}, "attitude", "limited", MISSES),
        ({"verdict": "refused"}, "attitude", "refused", "Refused"),
    ],
)
def test_the_finish_panel_says_what_was_made(changes: dict[str, Any], goal: str, kind: str, title: str) -> None:
    errors = {"heading_error_deg": {"worst": 0.4, "target_deg": 1.0}, "any_attitude_deg": {"worst": 3.0, "rms": 2.0}}
    made = {"view": {"verdict": "good", "sentence": "S.", **errors, **changes}, "refusal": ""}
    found = judged(made, {"goal": goal})
    assert (found["kind"], found["title"]) == (kind, title)
    assert ("3.0°" in found["words"]) == (goal == "attitude")


def test_the_finish_panel_says_why_nothing_was_made() -> None:
    found = judged({"view": None, "refusal": "all readings lie in one plane"}, {"goal": "heading"})
    assert found["kind"] == "none"
    assert_sentences(found["words"])


def judged(made: dict[str, Any], state: dict[str, str]) -> dict[str, str]:
    """What the panel says of a calibration that was made."""
    found = run_of_page(f"console.log(JSON.stringify(judged({json.dumps(made)}, {json.dumps(state)})));")
    assert isinstance(found, dict)
    return found


def test_every_widget_of_the_views_is_on_the_page() -> None:
    row = re.compile(r'@type \{import\("../widgets.js"\).Widget\} \*/\nexport const (\w+) = \{\n    name: "(\w+)"')
    views = [path.read_text(encoding="utf-8") for path in STATIC.joinpath("views").iterdir()]
    rows = dict(found for text in views for found in row.findall(text))
    listed = re.search(r"WIDGETS = \[(.*)\]", STATIC.joinpath("widgets.js").read_text(encoding="utf-8"))
    assert listed
    assert sorted(listed[1].split(", ")) == sorted(rows)
    assert len(set(rows.values())) == len(rows)


def test_the_page_has_titles_for_codes_that_there_are() -> None:
    words = STATIC.joinpath("views", "words.js").read_text("utf-8")
    listed = re.search(r"REASONS = Object.freeze\(\{(.*?)\}\)", words, re.DOTALL)
    assert listed
    titled = set(re.findall(r'^ {4}"?([\w-]+)"?:', listed[1], re.MULTILINE))
    sources = [STATIC.joinpath("standalone", name).read_text("utf-8") for name in ("reasons.js", "state.js")]
    own = {code for text in sources for code in re.findall(r'(?:\breason\(|code: )"([\w-]+)"', text)}
    alarms = {code for code, row in CATALOGUE.items() if row.alarm}
    assert alarms <= titled
    assert not titled - set(CATALOGUE) - own - {"stuck-axis"}
