"""What `flinders plan` prints, to the letter, and the files that it writes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import pytest
from tests.golden.sessions import assert_sessions_are_real, session
from tests.program import flinders_
from tests.sentences import assert_sentences

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


def test_a_drone_at_a_known_place(golden: Golden) -> None:
    line = "flinders plan --body drone --noise 0.5uT --at 47.6,-122.3 --date 2026-11-21 --target 1"
    golden("cli/plan.txt", session(line, code=3))


@pytest.mark.nightly
def test_a_robot_that_stays_level(golden: Golden) -> None:
    golden("cli/plan-level.txt", session("flinders plan --body robot --noise 0.5uT", code=3))


def test_the_page_of_plans_shows_these_sessions(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("plan.md", request, least=2)


@pytest.mark.nightly
def test_a_drawing_and_a_page() -> None:
    ended = flinders_(
        "plan", "--noise", "0.5uT", "--seconds", "40", "-o", "plan.svg", "--report", "plan.html", "--json"
    )
    assert ended.code == 0
    assert_sentences(ended.json["steps"][0])
    drawing = ElementTree.fromstring(Path("plan.svg").read_text(encoding="utf-8"))
    kinds = [part.get("class", "") for part in drawing.iter()]
    assert sum("dots path" in kind for kind in kinds) == 2
    text = Path("plan.html").read_text(encoding="utf-8")
    assert "straight down" in text
    assert "://" not in text.split("<script")[0].replace("http://www.w3.org/2000/svg", "")


def test_other_kinds_of_files_are_refused() -> None:
    for name, option in (("plan.png", "-o"), ("plan.pdf", "--report")):
        ended = flinders_("plan", "--noise", "0.5uT", option, name)
        assert ended.code == 2
        assert name in ended.err
