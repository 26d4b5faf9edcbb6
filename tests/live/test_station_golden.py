"""Texts of a station: why units fail, and a gauge study on the terminal."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session
from tests.live.test_gauge_study import AIAG

from flinders.apps.live.station.limits import Miss
from flinders.apps.live.station.words import EVENTS, LIMITS, miss_words

if TYPE_CHECKING:
    from pathlib import Path

    from tests.golden.sessions import Golden

RANGES = {
    "heading-error": (1.42, (0.0, 1.0)), "strength": (71.0, (25.0, 65.0)), "noise": (1.234, (0.0, 0.8)),
    "coverage-share": (0.31, (0.5, 1.0)), **{f"offset-{axis}": (-71.2, (-60.0, 60.0)) for axis in "xyz"},
}  # fmt: skip


def test_why_units_fail(golden: Golden) -> None:
    assert RANGES.keys() == LIMITS.keys()
    misses = [*(Miss(code, *RANGES[code]) for code in LIMITS), *map(Miss, EVENTS)]
    lines = [f"{miss.code}: {' | '.join(miss_words(miss, None))}\n" for miss in misses]
    golden("cli/station-reasons.txt", "".join(lines))


@pytest.fixture
def studied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example of AIAG as a station's table, in µT."""
    with (tmp_path / "table.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["unit", "operator", "offset_x", "unit_of_field"])
        for part, operator, repeat in np.ndindex(AIAG.shape):
            writer.writerow([f"P{part + 1}", "ABC"[operator], f"{AIAG[part, operator, repeat]:.2f}", "uT"])
    (tmp_path / "line.toml").write_text("[limits]\noffset = [-60, 60]\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("studied")
def test_a_gauge_study_on_the_terminal(golden: Golden) -> None:
    golden("cli/gauge-study.txt", session("flinders gauge-study table.csv --quantity offset_x", code=3))


def test_the_docs_show_the_sessions(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("live/station.md", request)
