"""Readings at which the sensor did not answer: 0, 0, 0 and other words of a bus are left out under their own name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import UnreadableInput
from flinders.fitting.batch import fit_batch
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

SENSOR: Final = simulate.Sensor(offset=np.array([12.0, -30.0, 25.0]), noise=0.3)
THROUGH_ZERO: Final = simulate.Sensor(offset=np.array([30.0, -30.0, 24.6]), noise=0.3)
"""Its sphere passes through zero."""
GOOD: Final = 400

PLACES: Final = {
    "every other row": range(0, 2 * GOOD, 2),
    "the begin": range(GOOD // 4),
    "the end": range(GOOD, GOOD + 50),
    "one row": range(7, 8),
}
"""Rows at which the sensor does not answer."""


def tumble(sensor: simulate.Sensor = SENSOR) -> Floats:
    field: Floats = simulate.tumble(seed=3, n=GOOD, sensor=sensor, motion="uniform", field_strength=49.0).samples.field
    return field.round(2)


def interrupted(good: Floats, word: float, place: str) -> Floats:
    """Good readings in their order, with a word in all axes in between."""
    field = np.full((len(good) + len(PLACES[place]), 3), float(word))
    field[np.delete(np.arange(len(field)), PLACES[place])] = good
    return field


def csv(path: Path, field: Floats, header: str = "mag_x_uT,mag_y_uT,mag_z_uT") -> Path:
    path.write_text("\n".join([header, *(",".join(f"{value:g}" for value in row) for row in field), ""]))
    return path


def found(fit: flinders.Fit, code: str) -> list[float]:
    return [finding.number for finding in fit.findings if finding.code == code]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("sensor", [SENSOR, THROUGH_ZERO], ids=["zero inside", "zero on the sphere"])
@pytest.mark.parametrize("word", [0.0, -1.0, 32767.0, -32768.0, 0x8181, 0x8181 - 65536, 65535.0, -4096.0, 8388607.0])
def test_a_word_in_all_axes_is_no_reading_wherever_it_stands(word: float, sensor: simulate.Sensor, place: str) -> None:
    good = tumble(sensor)
    field = interrupted(good, word, place)
    fit = flinders.fit(field, unit="uT")
    np.testing.assert_array_equal(fit.calibration.offset, flinders.fit(good, unit="uT").calibration.offset)
    assert found(fit, "no-answer") == [len(field) - len(good)]
    assert not {"outliers", "saturated", "skipped-rows", "stale-repeats"} & {finding.code for finding in fit.findings}


@pytest.mark.parametrize("reading", [(0, 0, 12), (0, -30, 0), (7, 7, 7), (-1, -1, 0), (0.5, 0.5, 0.5)])
def test_a_reading_with_some_zeros_or_equal_axes_stays(reading: tuple[float, float, float]) -> None:
    assert len(Samples.of([reading, (1, 2, 3)])) == 2


@pytest.mark.parametrize(
    "text", ["{:.2f},{:.2f},{:.2f}", '{{"x": {:.2f}, "y": {:.2f}, "z": {:.2f}}}', "X: {} Y: {} Z: {}"]
)
def test_a_file_says_what_it_read_and_where(text: str, tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("\n".join([text.format(*row) for row in interrupted(tumble(), 0.0, "every other row")]))
    samples = flinders.read(path)
    assert len(samples) == GOOD
    (left,) = samples.skipped
    assert left.is_silent
    assert (left.rows, left.lines[:3]) == (GOOD, (1, 3, 5))
    assert_sentences(str(left))


def test_each_word_is_counted_by_itself() -> None:
    samples = Samples.of([[0, 0, 0], [1, 2, 3], [-1, -1, -1], [0, 0, 0]])
    assert [(each.rows, each.example, each.lines) for each in samples.skipped] == [
        (1, "-1, -1, -1", (3,)),
        (2, "0, 0, 0", (1, 4)),
    ]


def test_a_recording_without_an_answer_is_refused_with_the_reason(tmp_path: Path) -> None:
    with assert_raises(UnreadableInput):
        flinders.read(csv(tmp_path / "dead.csv", np.zeros((40, 3))))
    with assert_raises(flinders.FitError, "too-few-samples", found=0, needed=10, method="likelihood"):
        flinders.fit(np.full((40, 3), -1.0))


def test_a_long_recording_is_summarised_without_them() -> None:
    samples = Samples.of(interrupted(tumble(), 0.0, "every other row"), unit="uT")
    summary = Summary.of_blocks(samples.blocks(64))
    assert len(summary) == GOOD
    assert found(flinders.fit(samples), "no-answer") == [GOOD]


def test_a_fleet_fits_each_unit_without_them() -> None:
    good = tumble()
    units = [Samples.of(field, unit="uT") for field in (good, interrupted(good, 0.0, "every other row"))]
    columns = fit_batch(units)
    np.testing.assert_allclose(columns.offset[1], columns.offset[0], atol=1e-9)
    assert columns.verdict.tolist() == ["good", "limited"]


def test_a_corrected_copy_has_gaps_in_their_place(tmp_path: Path) -> None:
    path = csv(tmp_path / "log.csv", interrupted(tumble(), 0.0, "every other row"))
    recording = flinders.open_recording(path)
    rows = list(recording.corrected_lines(lambda field: field))  # type: ignore[attr-defined]
    assert rows[1] == "nan,nan,nan\n"
    assert len(rows) == 1 + 2 * GOOD


def test_the_program_names_them(tmp_path: Path) -> None:
    path = csv(tmp_path / "log.csv", interrupted(tumble(), 0.0, "every other row"))
    assert_sentences(flinders_("info", str(path)).out)
