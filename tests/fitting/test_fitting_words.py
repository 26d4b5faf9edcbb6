"""Words that belong to the case: of checks that cannot tell, calibrations that do not help, clocks set back, steps."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console
from tests.fitting.test_shrinkage import CORRECTED, UNCORRECTED, judged, rocked
from tests.sentences import assert_sentences
from tests.worlds import TUMBLED_SENSOR, write_field

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.comparison.agreement import Disagreement
from flinders.estimators.outliers import Outlier
from flinders.fitting.result import Judgement
from flinders.report.fit_pages import NO_BETTER_WORDS, page_of_fit

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit


@pytest.fixture
def calibrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a calibration, ``known.json``."""
    monkeypatch.chdir(tmp_path)
    flinders.fit(simulate.tumble(seed=3, n=500, sensor=TUMBLED_SENSOR).samples).save("known.json")


def turned(about: int) -> Floats:
    """A turn about one axis, and nothing else."""
    angle, rng = np.linspace(0.0, 12.0, 300), np.random.default_rng(about)
    ring = np.zeros((300, 3))
    ring[:, (about + 1) % 3], ring[:, (about + 2) % 3] = 45.0 * np.cos(angle), 45.0 * np.sin(angle)
    return TUMBLED_SENSOR.read(ring, rng)


UNTOLD: dict[str, Callable[[], Floats]] = {
    "a turn about x": lambda: turned(0),
    "a turn about y": lambda: turned(1),
    "a patch": lambda: simulate.tumble(seed=5, n=4000, sensor=TUMBLED_SENSOR).samples.field[:60],
    "noise": lambda: np.random.default_rng(1).normal(scale=40.0, size=(300, 3)),
}


@pytest.mark.usefixtures("calibrated")
@pytest.mark.parametrize("name", UNTOLD)
def test_a_check_of_a_recording_that_cannot_be_fitted_is_about_the_calibration(name: str) -> None:
    write_field("other.csv", UNTOLD[name]())
    ended = CliRunner().invoke(main, ["check", "known.json", "other.csv"])
    shown = " ".join(ended.output.split())
    assert ended.exit_code == 3
    assert_sentences(shown)
    assert "✗" in shown
    assert "REFUSED" not in shown
    assert "no calibration" not in shown


@pytest.mark.usefixtures("calibrated")
@pytest.mark.parametrize("command", ["check known.json other.csv", "compare known.json other.json"])
def test_what_cannot_tell_is_not_said_to_hold_or_to_agree(command: str) -> None:
    samples = simulate.tumble(seed=5, sensor=TUMBLED_SENSOR).samples
    write_field("other.csv", samples.field)
    flinders.fit(samples).save("other.json")
    assert CliRunner().invoke(main, command.split()).output.count("CANNOT TELL") == 0
    ended = CliRunner().invoke(main, [*command.split(), "--target", "0.1"])
    assert ended.exit_code == 3
    assert "CANNOT TELL" in ended.output
    assert not {"HOLDS", "AGREE"} & set(ended.output.split())


def shown(fit: Fit) -> str:
    """The page of a fit for the terminal."""
    console = Console(file=io.StringIO(), width=200)
    with console.capture() as captured:
        console.print(page_of_fit(fit))
    return captured.get()


@pytest.mark.parametrize("seed", [1, 3, 6])  # others are taken for level turns
def test_a_calibration_that_makes_headings_no_better_is_not_said_to_be_usable(seed: int) -> None:
    fit = judged(rocked(seed, CORRECTED))
    advice = next(finding.advice for finding in fit.findings if finding.code == "corrected-before")
    assert_sentences(advice)
    needed = replace(judged(rocked(seed, UNCORRECTED)), judgement=Judgement())
    assert [NO_BETTER_WORDS in shown(one) for one in (fit, needed)] == [True, False]


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [
        (74.2, 90.1, "74.2–90.1 s: 31 readings"),
        (74.2, -1650.1, "readings 120–160: 31 readings"),
        (1e9, 3.0, "readings 120–160: 31 readings"),
        (np.nan, np.nan, "readings 120–160: 31 readings"),
    ],
)
def test_no_interval_ends_before_it_begins(start: float, end: float, words: str) -> None:
    assert str(Outlier(120, 160, 31, start, end, 5.0)) == words
    if start > end:
        assert str(Disagreement(0, False, 119, 159, start, end, 3.0, 4.0, 0.1)) == "readings 120–160"


@pytest.mark.parametrize("change", [simulate.Step(3.0), simulate.Step(5.0, at=0.3), simulate.ThermalDrift(3.0)])
def test_a_field_that_changed_is_not_told_to_warm_up(change: simulate.Step | simulate.ThermalDrift) -> None:
    fit = judged(simulate.tumble(seed=2, n=1000, disturbances=[change]).samples)
    said = next(finding for finding in fit.findings if finding.code == "field-changed")
    assert "warm up" not in said.advice
    assert_sentences(said.advice)
