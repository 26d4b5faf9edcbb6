"""`flinders.swing` as a function: tables, boats and recordings of a known deviation, the same out; rules."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.boats import DECLINATION, LATITUDE, LONGITUDE, TRUTH, Boat, nmea0183_of, nmea2000_of, octagon
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.apps import marine
from flinders.apps.marine import STANDARDS, SwingTable, compensate, read_rests, read_swing
from flinders.core.calibration import Calibration
from flinders.core.geomag import site_field
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import FitError, InputError, NoAccelerometer, UsageError
from flinders.heading.harmonics import design

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

AROUND = np.arange(0.0, 360.0, 45.0)
SITE = site_field(LATITUDE, LONGITUDE, year=2026.41)
OFFSET = np.array([20.0, -15.0, 8.0])
IRON = (1.0, -0.5, 0.0)
"""µT ahead and to port; in a level field of 25 µT that is B = 2.29° and C = −1.15°."""


def table_of(columns: dict[str, Any]) -> SwingTable:
    return SwingTable("swing.csv", columns, tuple(range(2, 2 + len(AROUND))))


def resting(headings: list[float], iron: Sequence[float] = (0.0, 0.0, 0.0)) -> Samples:
    """A level sensor that rests for ten seconds on each heading, north of it 25 µT and down 43 µT."""
    rng, stops = np.random.default_rng(2), [*headings, headings[-1]]
    turns = [np.r_[np.full(100, a), np.linspace(a, b, 20)] for a, b in pairwise(stops)]
    around = np.deg2rad(np.concatenate(turns))
    field = np.column_stack([25.0 * np.cos(around), -25.0 * np.sin(around), np.full(len(around), 43.3)])
    raw = field + OFFSET + np.array(iron) + rng.normal(scale=0.1, size=field.shape)
    return Samples.of(raw, unit="uT", time=0.1 * np.arange(len(raw)))


@pytest.fixture
def calibration() -> Calibration:
    return Calibration(np.eye(3), OFFSET, 50.0, True, raw=Unit.of("uT"))


# tables


def test_a_table_gives_the_coefficients_it_was_made_with_as_claimed() -> None:
    noise = np.random.default_rng(4).normal(scale=0.3, size=len(AROUND))
    found = flinders.swing(table_of({"compass": AROUND, "deviation": design(AROUND) @ TRUTH + noise}), sigma_deg=0.3)
    assert found.deviation is not None
    assert found.deviation.sigmas_deg is not None
    assert (np.abs(found.deviation.coefficients_deg - TRUTH) < 3.0 * found.deviation.sigmas_deg).all()
    assert found.verdict == "good"
    assert found.as_dict()["limits"] == []


def test_true_headings_need_a_site_and_others_have_no_use_for_one() -> None:
    deviation = design(AROUND) @ TRUTH
    true = table_of({"compass": AROUND, "true": AROUND + deviation + SITE.declination_deg})
    found = flinders.swing(true, site=SITE).deviation
    assert found is not None
    npt.assert_allclose(found.coefficients_deg, TRUTH, atol=1e-9)
    with assert_raises(UsageError):
        flinders.swing(true)
    with assert_raises(UsageError):
        flinders.swing(table_of({"compass": AROUND, "deviation": deviation}), site=SITE)


def test_a_curve_that_is_not_known_well_says_what_to_do_in_the_words_of_python() -> None:
    few = {"compass": AROUND[[0, 1, 3, 5, 6]], "deviation": np.array([1.0, 2.0, 0.0, 1.0, 0.0])}
    found = flinders.swing(SwingTable("five.csv", few, (2, 3, 4, 5, 6)))
    assert [note.code for note in found.notes if note.severity == "limits"] == ["no-redundancy"]
    assert found.verdict == "limited"
    assert_sentences(found.as_dict()["limits"][0])


def test_a_column_of_sigma_is_used_and_is_the_only_one() -> None:
    table = table_of({"compass": AROUND, "deviation": 0.0 * AROUND, "sigma": np.full(len(AROUND), 0.5)})
    found = flinders.swing(table).deviation
    assert found is not None
    assert found.sigma_deg == pytest.approx(0.5)
    with assert_raises(UsageError):
        flinders.swing(table, sigma_deg=1.0)


# rules


@pytest.mark.parametrize(("limit_deg", "verdict"), [(5.0, "within"), (3.1, "open"), (2.0, "beyond")])
def test_a_limit_is_kept_open_or_exceeded(limit_deg: float, verdict: str) -> None:
    table = table_of({"compass": AROUND, "deviation": 3.0 * np.sin(np.deg2rad(AROUND))})
    found = flinders.swing(table, sigma_deg=0.3, limit_deg=limit_deg)
    assert found.conformity is not None
    assert (found.conformity.verdict, found.verdict) == (verdict, "good" if verdict == "within" else "limited")


def test_a_rule_has_its_limit_and_another_one_replaces_it() -> None:
    table = table_of({"compass": AROUND, "deviation": 3.0 * np.sin(np.deg2rad(AROUND))})
    by_name = flinders.swing(table, sigma_deg=0.3, rule="ac43.13-1b")
    given = flinders.swing(table, sigma_deg=0.3, rule=STANDARDS["ac43.13-1b"], limit_deg=4.0)
    assert by_name.conformity is not None
    assert given.conformity is not None
    assert (by_name.conformity.limit_deg, given.conformity.limit_deg, given.rule) == (10.0, 4.0, by_name.rule)
    assert flinders.swing(table, rule="iso25862").conformity is None
    with assert_raises(UsageError):
        flinders.swing(table, rule="ac4313-1b")


def test_the_error_of_the_base_widens_a_alone() -> None:
    table = table_of({"compass": AROUND, "deviation": 0.0 * AROUND})
    own, wider = (flinders.swing(table, sigma_deg=0.3, base_error_deg=base).deviation for base in (0.0, 1.0))
    assert own is not None
    assert wider is not None
    assert own.covariance is not None
    assert wider.covariance is not None
    npt.assert_allclose(wider.covariance - own.covariance, np.diag([1.0, 0.0, 0.0, 0.0, 0.0]), atol=1e-12)


def test_what_to_turn_comes_from_a_table_or_its_file(tmp_path: Path) -> None:
    path = tmp_path / "correction.csv"
    path.write_text("compass,magnetic\n3,359\n85,91\n170,178\n265,267\n", encoding="utf-8")  # CAP 562, worksheet 1
    found = compensate(path)
    assert (found.a_deg, found.b_deg, found.c_deg) == (3.0, 2.0, -6.0)
    assert compensate(read_swing(path)) == found
    after = flinders.swing(table_of({"compass": AROUND, "deviation": 0.0 * AROUND}), before=path)
    assert after.before == found


# boats


@pytest.mark.parametrize("write", [nmea0183_of, nmea2000_of])
def test_the_log_of_a_boat_gives_its_deviation_as_claimed(
    write: Callable[[Boat], Iterator[str]], tmp_path: Path
) -> None:
    boat = Boat.sail(octagon(40), np.random.default_rng(11), current=0.4 - 0.2j)
    path = tmp_path / "boat.log"
    path.write_text("\n".join(write(boat)), encoding="utf-8")
    found = flinders.swing(path, target_deg=5.0)
    assert found.deviation is not None
    assert found.deviation.sigmas_deg is not None
    assert (np.abs(found.deviation.coefficients_deg - TRUTH) < 4.0 * found.deviation.sigmas_deg + 0.1).all()
    assert found.site is not None
    assert found.site.declination_deg == pytest.approx(DECLINATION, abs=0.01)
    assert found.logged is not None
    assert found.logged.is_steady


def test_a_log_without_a_position_needs_a_site(tmp_path: Path) -> None:
    boat = Boat.sail(octagon(40), np.random.default_rng(11))
    path = tmp_path / "boat.log"
    path.write_text("\n".join(nmea2000_of(boat)).replace("09F80123", "09F80F23"), encoding="utf-8")
    with assert_raises(UsageError):
        flinders.swing(path)
    assert flinders.swing(path, site=SITE).deviation is not None


# recordings


def test_a_file_that_is_no_table_of_headings_is_told_what_a_swing_needs(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("notes of Monday\n1 2 3 were read\n4 5 6 too\n7 8 10\n", encoding="utf-8")
    with assert_raises(NoAccelerometer):
        flinders.swing(path)
    assert_sentences(flinders_("swing", str(path)).said)
    with assert_raises(NoAccelerometer):
        flinders.swing(path, Calibration.identity(field_strength=9.0))


def test_a_calibrated_recording_shows_the_iron_that_came(calibration: Calibration) -> None:
    clean = flinders.swing(resting(AROUND.tolist()), calibration, headings_deg=AROUND.tolist(), level=True)
    assert clean.deviation is not None
    assert np.abs(clean.deviation.coefficients_deg).max() < 0.2
    assert (clean.verdict, clean.half_turns_pass, len(clean.rests), clean.doubts) == ("good", True, 8, ())
    bent = flinders.swing(resting(AROUND.tolist(), IRON), calibration, headings_deg=AROUND.tolist(), level=True)
    assert bent.deviation is not None
    npt.assert_allclose(bent.deviation.coefficients_deg[1:3], [2.29, -1.15], atol=0.2)
    assert bent.verdict == "limited"


def test_half_turns_need_no_known_heading(calibration: Calibration) -> None:
    stops = [10.0, 190.0, 280.0, 100.0]
    good = flinders.swing(resting(stops), calibration, level=True)
    assert (good.deviation, good.verdict, good.notes) == (None, "good", ())
    bad = flinders.swing(resting(stops, IRON), calibration, level=True)
    assert bad.verdict == "refused"
    assert bad.as_dict()["hard_iron_deg"]["B"] == pytest.approx(2.29, abs=0.2)


def test_a_recording_is_taken_as_it_is_without_a_calibration(calibration: Calibration) -> None:
    """Of readings that were corrected before, half turns pass; of raw ones with so much iron none is found."""
    recording = resting([0.0, 180.0, 90.0, 270.0])
    corrected = Samples.of(calibration.apply(recording.field), unit="uT", time=recording.time)
    assert flinders.swing(corrected, level=True).half_turns_pass
    with assert_raises(FitError, rests=4):
        flinders.swing(recording, level=True)


def test_readings_that_do_not_suit_their_calibration_are_doubted(calibration: Calibration) -> None:
    foreign = resting([0.0, 180.0], [12.0, 0.0, 30.0])
    assert [note.code for note in read_rests(foreign, calibration, level=True).doubts] == ["unsuited"]
    assert read_rests(foreign, level=True).doubts == ()


def test_there_is_a_heading_for_each_rest(calibration: Calibration) -> None:
    with assert_raises(FitError, rests=8, headings=3):
        flinders.swing(resting(AROUND.tolist()), calibration, headings_deg=[0.0, 45.0, 90.0], level=True)


def test_true_headings_of_a_recording_are_turned_by_the_declination_of_its_site(calibration: Calibration) -> None:
    true = (AROUND + SITE.declination_deg).tolist()
    found = flinders.swing(resting(AROUND.tolist()), calibration, headings_deg=true, site=SITE, level=True)
    assert found.deviation is not None
    assert np.abs(found.deviation.coefficients_deg).max() < 0.2


# refusals


def test_arguments_that_something_has_no_use_for_are_refused(calibration: Calibration) -> None:
    table = table_of({"compass": AROUND, "deviation": 0.0 * AROUND})
    with assert_raises(UsageError):
        flinders.swing(table, headings_deg=AROUND.tolist())
    with pytest.raises(UsageError, match=r"\(calibration=\)"):
        flinders.swing(table, calibration)
    with assert_raises(UsageError):
        flinders.swing(resting([0.0, 180.0]), calibration, level=True, limit_deg=5.0)


def test_a_file_that_is_no_swing_says_what_a_table_has(tmp_path: Path) -> None:
    path = tmp_path / "words.txt"
    path.write_text("speed,depth\n1,2\n", encoding="utf-8")
    with assert_raises(InputError, "unreadable"):
        flinders.swing(path)
    path.write_text("compass,magnetic\n0,1\n900,1\n", encoding="utf-8")
    with assert_raises(UsageError):
        flinders.swing(path)


def test_both_names_are_one_function() -> None:
    assert flinders.swing is marine.swing
