"""The words of a report and the drawing on a terminal, to the letter."""

from __future__ import annotations

import re
from html import unescape
from typing import TYPE_CHECKING

import pytest
from tests.golden.sessions import assert_sessions_are_real, session
from tests.worlds import write_field

from flinders import simulate
from flinders.fitting import calibrate
from flinders.report.figure_data import FigureData
from flinders.report.html import page
from flinders.report.terminal import plot

if TYPE_CHECKING:
    from tests.golden.sessions import Golden

DATED = re.compile(r"\d+ \w+ \d{4}, [\d:]+ UTC(, with Flinders \S+)?")


def record(name: str, motion: str) -> None:
    field = simulate.tumble(seed=2, motion=motion).samples.field
    write_field(name, field)


def words(text: str) -> str:
    """What a person reads of a report, a line for each paragraph; without figures and listings."""
    bare = re.sub(r"<(script|style|svg|pre)\b.*?</\1>", "", text, flags=re.DOTALL)
    bare = re.sub(r"</(?:p|h\d|dt|strong|li|th|td|summary|figcaption|label|caption)>|<br>", "\n", bare)
    lines = (re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]*>", "", line))).strip() for line in bare.split("\n"))
    said = "\n".join(line for line in lines if line)
    return DATED.sub("1 May 2026, 12:30 UTC", said) + "\n"


@pytest.mark.parametrize("motion", ["uniform", "tilted", "level"])
def test_the_words_of_a_report(motion: str, golden: Golden) -> None:
    samples = simulate.tumble(seed=2, motion=motion).samples
    golden(f"report/{motion}.txt", words(page(calibrate.fit(samples), samples)))


def test_a_drawing_on_a_terminal(golden: Golden) -> None:
    samples = simulate.tumble(seed=2, motion="tilted").samples
    fit = calibrate.fit(samples)
    drawn = FigureData.of(fit, samples)
    shown = (plot(drawn, fit, is_plain=is_plain).plain for is_plain in (False, True))
    golden("report/terminal.txt", "\n".join(line.rstrip() for text in shown for line in text.splitlines()) + "\n")


def test_a_report_of_a_calibration_and_a_recording(golden: Golden) -> None:
    record("tumble.csv", "uniform")
    session("flinders calibrate tumble.csv -o calibration.json")
    golden("cli/report-made.txt", session("flinders report calibration.json tumble.csv -o report.html"))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("report.md", request)
