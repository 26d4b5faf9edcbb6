"""Whatever a file is called and whatever is in it: a report stays one page that holds no foreign markup."""

from __future__ import annotations

import json
import re
from functools import cache
from html.parser import HTMLParser
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.report.test_report import Page, fitted
from tests.trials import daily, examples

from flinders.core.calibration_file import ProvenanceRecord, SourceFile
from flinders.findings import Finding
from flinders.report.charts import dot_path, ticks
from flinders.report.colours import STEPS, Theme, class_of, colour_of, seen_ends, seen_level
from flinders.report.html import Listing, page
from flinders.report.terminal import braille, letters

EVIL = (
    "<script>alert(1)</script>",
    "</title><script>alert(1)</script>",
    "</style><img src=x onerror=alert(1)>",
    "</script><b>",
    '"><svg onload=alert(1)>',
    "' onmouseover='alert(1)",
    "{{ 7 * 7 }}{% raw %}",
    "<!--",
    "]]>",
    "a\u2028b\u0000c",
)
DAILY = daily(EVIL, 4)


class Tags(HTMLParser):
    """Names of all elements, and of all their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [tag, *(f"{tag}@{name}" for name, _ in attrs)]


@cache
def tags(text: str) -> list[str]:
    parser = Tags()
    parser.feed(text)
    return parser.found


@cache
def reported(name: str) -> str:
    """A report with a name everywhere that a name can stand."""
    from dataclasses import replace
    from datetime import UTC, datetime

    fit, samples = fitted()
    calibration = replace(fit.calibration, sensor=name)
    finding = Finding("like-gravity", "limits", {"is_doubtful": 1.0, "doubt": name})
    provenance = ProvenanceRecord(
        flinders="1.2.3",
        date=datetime(2026, 5, 1, 12, 30, tzinfo=UTC),
        files=(SourceFile(name=name, sha256="0" * 64, bytes=1, rows=1),),
    )
    return page(
        replace(fit, calibration=calibration, judgement=replace(fit.judgement, findings=(finding,))),
        replace(samples, source=name),
        provenance=provenance,
        asked={name: name},
        listings=[Listing(name, name, name, (name,))],
        notes=[name],
    )


@cache
def plain_tags() -> list[str]:
    return tags(reported("plain name"))


@pytest.mark.parametrize("name", DAILY)
def test_names_from_files_add_no_element_and_no_attribute(name: str) -> None:
    assert tags(reported(name)) == plain_tags()


@examples(4)
@given(st.text(min_size=1, max_size=40))
def test_no_name_whatever_adds_an_element(name: str) -> None:
    assert tags(reported(name)) == plain_tags()


@pytest.mark.parametrize("name", DAILY)
def test_what_the_script_reads_is_json_whatever_the_names(name: str) -> None:
    held = re.search(r'id="drawn">(.*?)</script>', reported(name), re.DOTALL)
    assert held
    assert set(json.loads(held[1])) >= {"tiles", "field", "shown", "tiles_deg"}


def test_a_refusal_in_foreign_words_is_escaped() -> None:
    from flinders.errors import FitError

    found = Page.of(page(FitError("<script>alert(1)</script>")))
    assert found.text.count("<script") == 1
    assert "<script>alert(1)</script>." in found.words


@given(st.floats(1e-6, 1e6), st.floats(1e-3, 180.0), st.sampled_from(get_args(Theme)))
def test_a_larger_error_is_never_lighter(error: float, target: float, theme: Theme) -> None:
    def lightness(colour: str) -> float:
        red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
        return float(0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2)

    near, far = (colour_of(class_of(factor * error, target), theme) for factor in (1.0, 1.5))
    assert lightness(far) <= 1.02 * lightness(near)
    assert class_of(error, target) in {f"e{step}" for step in range(STEPS)}


@given(st.floats(0.0, 1e6), st.integers(0, 10**7))
def test_classes_of_readings_ascend(share: float, count: int) -> None:
    ends = seen_ends(share)
    assert list(ends) == sorted(set(ends))
    assert seen_level(count, ends) <= seen_level(count + 1, ends) <= 4
    assert (seen_level(count, ends) == 0) == (count == 0)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(2, 12))
def test_ticks_lie_inside_and_are_few(low: float, width: float, most: int) -> None:
    found = ticks(low, low + width, most)
    assert all(low - 1e-6 * width <= value <= low + 1.000001 * width for value in found)
    assert len(found) <= most + 1


@given(st.lists(st.tuples(st.floats(0.0, 300.0), st.floats(0.0, 300.0)), min_size=1, max_size=50))
def test_dots_end_where_the_points_are(points: list[tuple[float, float]]) -> None:
    steps = np.array(re.findall(r"m(-?\d+)[ ]?(-?\d+)h0", dot_path(points)), int)
    places = set(map(tuple, np.cumsum(steps, axis=0).tolist()))
    assert places == {(round(2 * x), round(2 * y)) for x, y in points}


@given(st.integers(1, 6), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_each_dot_of_a_picture_is_one_of_a_letter(rows: int, columns: int, seed: int) -> None:
    made = np.random.default_rng(seed).random((4 * rows, 2 * columns)) < 0.3
    lines = braille(made)
    assert sum((ord(letter) - 0x2800).bit_count() for line in lines for letter in line) == made.sum()
    assert [len(line) for line in lines] == [len(line) for line in letters(made)] == [columns] * rows
