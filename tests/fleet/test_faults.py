"""Units of a simulated fleet are what their labels say, and what is wrong with them is found, or cannot be."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.faults import FAULT_NOTES, judged, off_deg, summary, table, tallied
from benchmarks.faults import Piece as Part
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.apps.fleet.simulate import FAULTS, FIELD_UT, MAX_HARD_IRON_UT, MAX_SOFT_IRON, NOISE_UT, fleet, unit
from flinders.diagnostics.axis_swap import axis_swap_of
from flinders.errors import UsageError
from flinders.fitting.result import Refused
from flinders.simulate import tumble

if TYPE_CHECKING:
    from pathlib import Path

TOLD: Final = [fault for fault, kind in FAULTS.items() if kind.is_detectable]
UNTOLD: Final = [fault for fault, kind in FAULTS.items() if not kind.is_detectable]


def test_a_unit_follows_from_seed_and_number_alone() -> None:
    among = list(fleet(5, seed=4, bad=0.5, first=10))
    for made in among:
        again = unit(made.number, seed=4, bad=0.5)
        assert (made.fault, made.severity, made.amount) == (again.fault, again.severity, again.amount)
        npt.assert_array_equal(made.samples.field, again.samples.field)


def test_another_seed_or_number_is_another_unit() -> None:
    assert not np.array_equal(unit(1, seed=1).samples.field, unit(2, seed=1).samples.field)
    assert not np.array_equal(unit(1, seed=1).samples.field, unit(1, seed=2).samples.field)


def test_units_are_drawn_as_they_are_said_to_be() -> None:
    """Of 800, the share of bad ones within 4 σ; all faults and severities are there, all sensors in their range."""
    made = list(fleet(800, seed=1, bad=0.4, readings=12))
    labels = Counter((each.fault, each.severity) for each in made if each.fault)
    assert sum(labels.values()) == pytest.approx(320, abs=4 * np.sqrt(320 * 0.6))
    assert set(labels) == {(fault, severity) for fault in FAULTS for severity in (1, 2)}
    gains = np.linalg.eigvalsh(np.stack([each.sensor.matrix for each in made]))
    assert gains.min() >= 1 - MAX_SOFT_IRON
    assert gains.max() <= 1 + MAX_SOFT_IRON
    assert np.linalg.norm([each.sensor.offset for each in made], axis=1).max() <= MAX_HARD_IRON_UT
    assert all(NOISE_UT[0] <= each.sensor.noise <= NOISE_UT[1] for each in made)
    assert all(FIELD_UT[0] <= each.field_strength <= FIELD_UT[1] for each in made)


def test_a_good_unit_reads_what_its_sensor_reads() -> None:
    """Undone by the truth, readings lie one field strength from zero, but for noise and the converter's steps."""
    for number in range(5):
        made = unit(number, fault="")
        matrix, offset = made.sensor.correction
        lengths = np.linalg.norm((made.samples.field - offset) @ matrix.T, axis=1)
        assert lengths.mean() == pytest.approx(made.field_strength, abs=0.2)
        assert lengths.std() < 1.3 * made.sensor.noise + 0.05


@pytest.mark.parametrize("fault", FAULTS)
def test_the_larger_severity_is_more_of_the_same_unit(fault: str) -> None:
    """What is wrong changes readings, and the sensor it is wrong with stays the same."""
    good, smaller, larger = unit(8, fault=""), unit(8, fault=fault, severity=1), unit(8, fault=fault)
    npt.assert_array_equal(good.sensor.offset, larger.sensor.offset)
    assert not np.array_equal(good.samples.field, larger.samples.field)
    assert (smaller.amount, larger.amount) == (FAULTS[fault].smaller, FAULTS[fault].larger)


def test_what_is_not_known_is_refused() -> None:
    with assert_raises(UsageError):
        unit(0, fault="rust")
    with pytest.raises(UsageError, match="severity 3"):
        unit(0, fault="spikes", severity=3)
    with assert_raises(UsageError):
        unit(-1)


@pytest.mark.parametrize("fault", TOLD)
def test_the_larger_severity_is_found(fault: str) -> None:
    """Each of a few units; `benchmarks/faults.py` has the rates."""
    made = [unit(number, seed=5, fault=fault) for number in range(1 if fault == "level-turn" else 2)]
    for number, said in enumerate(judged(made)):
        assert said["found"] == 1, f"unit {number}: {sorted(said)}"


@pytest.mark.parametrize("fault", UNTOLD)
def test_what_is_so_throughout_cannot_be_told_from_the_readings(fault: str) -> None:
    """The ellipsoid is the mirror image: noise and verdict stay, to rounding, and no calibration could be preferred."""
    for number in range(2):
        good, mirrored = (flinders.fit(unit(number, seed=5, fault=name).samples) for name in ("", fault))
        assert mirrored.verdict == good.verdict == "good"
        assert mirrored.evidence.noise == pytest.approx(good.evidence.noise, rel=1e-6)
        npt.assert_allclose(mirrored.calibration.ellipsoid.semi_axes, good.calibration.ellipsoid.semi_axes, rtol=1e-6)


def test_good_units_are_not_called_bad() -> None:
    """Of sixty at most one: more are as rare as one in twenty-five where 0.5 % are."""
    said = judged(list(fleet(60, seed=6, bad=0.0)))
    assert len([sorted(each) for each in said if each["found"]]) <= 1


def test_good_units_are_as_good_as_they_claim() -> None:
    """Errors of level headings by the truth, within three times the worst that is claimed at 1 σ."""
    for made in fleet(20, seed=6, bad=0.0):
        fitted = flinders.fit(made.samples)
        off = off_deg(made, fitted.calibration.offset, fitted.calibration.matrix)
        assert off < 3.0 * fitted.heading_error_deg.worst


@pytest.mark.parametrize("fault", ["flipped-sign", "swapped-axes"])
def test_a_slip_is_named_with_its_axes_and_its_moment(fault: str) -> None:
    """Seven of ten units at least: where an axis reads next to nothing just then, there is no break to be seen."""
    named = 0
    for number in range(10):
        made, good = (unit(number, seed=5, fault=name) for name in (fault, ""))
        slip = axis_swap_of(made.samples.field)
        struck = {"xyz"[axis] for axis in np.flatnonzero((made.samples.field != good.samples.field).any(axis=0))}
        named += slip is not None and set(slip.axes) == struck and slip.rows == (250,)
    assert named >= 7


def test_a_slip_that_comes_and_goes_is_told_with_all_its_moments() -> None:
    field = tumble(seed=3, n=1500).samples.field.copy()
    field[400:700, 2] *= -1.0
    slip = axis_swap_of(field)
    assert slip is not None
    assert (slip.axes, slip.rows) == ("z", (400, 700))


def test_the_verdict_names_a_slip_and_says_from_when_on() -> None:
    field = tumble(seed=3, n=1500).samples.field.copy()
    field[900:] = field[900:][:, [1, 0, 2]]
    try:
        fitted = flinders.fit(field)
    except Refused as error:
        fitted = error.fit
    finding = next(finding for finding in fitted.findings if finding.code == "axis-swap")
    assert finding.severity == "limits"
    assert finding.number > finding.limit
    assert_sentences(finding.advice)


def test_a_piece_that_is_done_is_not_done_again(tmp_path: Path) -> None:
    part = Part(0, 6, "stuck-axis", 2)
    first = tallied(part, tmp_path)
    (path,) = tmp_path.iterdir()
    assert path.name == part.name
    path.write_text(path.read_text().replace('"units": 6', '"units": 7'))
    assert tallied(part, tmp_path)["stuck-axis", 2]["units"] == first["stuck-axis", 2]["units"] + 1


def test_the_table_counts_what_was_said() -> None:
    total = {
        ("", 0): Counter(units=200, good=199, limited=1, found=1),
        ("spikes", 2): Counter(units=4, limited=3, found=3),
    }
    total["spikes", 2].update({"good": 1, "off": 1, "outliers!": 3})
    assert "| spikes | larger (0.2) | 4 | 25.0% | 75.0% | 0.0% | 0.0% | **75.00%** | 1 | `outliers` 75.0% |" in table(
        total
    )
    assert_sentences(summary(total))
    assert "outliers" in FAULT_NOTES
