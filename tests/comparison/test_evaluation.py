"""The true error of a calibration: what is put in comes out, in degrees and µT."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises
from tests.trials import daily

from flinders import simulate
from flinders.comparison.evaluation import evaluate
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import UnitError, UsageError
from flinders.fitting import calibrate
from flinders.fitting.result import Fit, bare_fit, with_calibration
from flinders.geometry.rotation import rotations
from flinders.simulate import Sensor, tumble
from flinders.simulate.truth import Truth

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

MICROTESLA = Unit.of("uT")
RECORDING = tumble(seed=3, motion="uniform", n=400)
TRUTH = Truth.of(RECORDING)


def calibration(matrix: Floats, offset: Floats, **options: object) -> Fit:
    return bare_fit(Calibration(matrix, offset, 50.0, raw=MICROTESLA, **options))  # type: ignore[arg-type]


def test_the_truth_itself_has_no_error_and_claims_nothing() -> None:
    matrix, offset = RECORDING.sensor.correction
    told = evaluate(calibration(matrix, offset, field_strength_known=True), TRUTH)
    npt.assert_allclose(
        [told.heading_error_deg.worst, *told.direction_error_deg, told.matrix_error, told.rotation_deg], 0.0, atol=1e-7
    )
    npt.assert_allclose(told.offset_error, 0.0)
    assert told.scale_error == pytest.approx(0.0, abs=1e-12)
    assert (told.verdict, told.p_value, told.heading_ratio, told.offset_ratio) == ("unclaimed", None, None, None)


def test_an_offset_error_is_found_and_costs_what_geometry_says() -> None:
    """δ across a horizontal field of 25 µT is δ/25 at its worst, rms over √2."""
    perfect = Truth.of(tumble(n=10, sensor=Sensor()))
    told = evaluate(calibration(np.eye(3), np.array([0.5, 0.0, 0.0])), perfect)
    npt.assert_allclose(told.offset_error, [0.5, 0.0, 0.0])
    assert told.heading_error_deg.worst == pytest.approx(np.degrees(0.5 / 25), rel=1e-3)
    assert told.heading_error_deg.rms == pytest.approx(np.degrees(0.5 / 25) / np.sqrt(2), rel=1e-3)
    assert told.direction_error_deg[0] == pytest.approx(np.degrees(np.sqrt(2 / 3) * 0.5 / 50), rel=1e-3)


def test_a_rotation_is_told_apart_from_soft_iron() -> None:
    turn = simulate.turns([[0.0, 0.0, np.radians(3.0)]])[0]
    told = evaluate(calibration(turn, np.zeros(3), rotation="composed"), Truth.of(tumble(n=10, sensor=Sensor())))
    assert told.rotation_deg == pytest.approx(3.0)
    assert told.heading_mean_deg == pytest.approx(0.0, abs=1e-7)
    assert told.matrix_error == pytest.approx(0.0, abs=1e-12)
    assert told.heading_error_deg.worst == pytest.approx(0.0, abs=1e-7)
    assert told.unrotated_direction_error_deg[1] == pytest.approx(0.0, abs=1e-6)
    assert told.direction_error_deg[1] == pytest.approx(3.0, rel=1e-3)


@cache
def aided() -> tuple[Fit, Truth]:
    """A fit with an accelerometer, which sees the rotation into the body, and the truth."""
    recording = tumble(seed=1, n=2000)
    return calibrate.fit(recording.samples, aiding=("dip",)), Truth.of(recording)


def with_rotation_error(fit: Fit, off_deg: float, claimed_deg: float) -> Fit:
    """The same turned by so much about the body's x axis, and with that claim about each."""
    assert fit.evidence.aiding is not None
    turn = rotations(np.array([[np.radians(off_deg), 0.0, 0.0]]))[0]
    turned = replace(fit.calibration, matrix=turn @ fit.calibration.matrix)
    covariance = np.radians(claimed_deg) ** 2 * np.eye(3)
    aiding = replace(fit.evidence.aiding, rotation_covariance=covariance)
    return replace(with_calibration(fit, turned), evidence=replace(fit.evidence, aiding=aiding))


def test_a_rotation_error_that_is_claimed_is_no_error_beyond_the_claim() -> None:
    """2° about x turn headings by 3.5°: far more than the ellipsoid claims, and as much as the rotation does."""
    plain, truth = aided()
    as_fitted, turned = (evaluate(one, truth) for one in (plain, with_rotation_error(plain, 2.0, 2.0)))
    assert turned.verdict == as_fitted.verdict == "as claimed"
    assert turned.heading_ratio == pytest.approx(as_fitted.heading_ratio)
    assert turned.direction_ratio == pytest.approx(as_fitted.direction_ratio)
    assert turned.rotation_deg == pytest.approx(2.0, abs=0.1)
    assert turned.body_heading_error_deg is not None
    assert turned.claimed_body_heading_deg is not None
    assert turned.body_heading_error_deg.worst == pytest.approx(2.0 * np.tan(np.radians(60.0)), rel=0.1)
    assert 0.3 < turned.body_heading_error_deg.rms / turned.claimed_body_heading_deg.rms < 1.0
    assert not turned.is_on_target


def test_a_rotation_that_claims_too_much_is_found_out() -> None:
    plain, truth = aided()
    turned = evaluate(with_rotation_error(plain, 2.0, 0.1), truth)
    assert turned.verdict == "worse than claimed"
    assert turned.heading_ratio == pytest.approx(evaluate(plain, truth).heading_ratio)
    assert turned.body_heading_ratio is not None
    assert turned.body_heading_ratio > 10


def test_the_heading_of_the_body_claims_what_the_fit_states() -> None:
    """Offset and shape, with what the mounting adds."""
    fit, truth = aided()
    found = evaluate(fit, truth, dip_deg=fit.claim.known_dip_deg)
    assert found.claimed_body_heading_deg is not None
    assert fit.claim.alignment_error_deg is not None
    stated = np.hypot(fit.heading_error_deg.rms, fit.claim.alignment_error_deg)
    assert found.claimed_body_heading_deg.rms == pytest.approx(stated, rel=0.02)


def test_a_misaligned_sensor_is_as_wrong_as_it_claims_by_the_magnetometer_alone() -> None:
    """Nobody claims the 3° that its axes are turned by."""
    turn = simulate.turns([[np.radians(3.0), 0.0, 0.0]])[0]
    recording = tumble(seed=2, motion="uniform", n=400, sensor=Sensor(RECORDING.sensor.matrix @ turn, noise=0.5))
    found = evaluate(calibrate.fit(recording.samples), Truth.of(recording))
    assert (found.verdict, found.is_on_target) == ("as claimed", True)
    assert found.rotation_deg == pytest.approx(3.0, abs=0.2)
    assert found.body_heading_error_deg is None
    assert found.direction_error_deg.worst > 2.0 > 10 * found.unrotated_direction_error_deg.rms


@pytest.mark.parametrize("aid", ["dip", "rate"])
def test_fits_with_an_aid_are_as_wrong_as_they_claim(aid: str, trials: Choose) -> None:
    """Their rotation, too."""
    found, claim = [], trials(30, 8)
    for seed in claim.seeds:
        recording = tumble(seed, motion="hand", n=1500)
        found.append(evaluate(calibrate.fit(recording.samples, aiding=(aid,)), Truth.of(recording)))
    ratios = np.array([[each.heading_ratio, each.body_heading_ratio] for each in found], dtype=float)
    low, high = claim.ratios(0.75, 1.25)
    assert np.all((np.sqrt(np.mean(ratios**2, axis=0)) > low) & (np.sqrt(np.mean(ratios**2, axis=0)) < high))
    assert sum(each.verdict == "worse than claimed" for each in found) <= 2


def test_soft_iron_and_scale_are_told_apart() -> None:
    bent = Truth.of(tumble(n=10, sensor=Sensor(matrix=1.1 * np.diag([1.02, 1 / 1.02, 1.0]))))
    told = evaluate(calibration(np.eye(3), np.zeros(3), field_strength_known=True), bent)
    assert told.scale_error == pytest.approx(0.1)
    assert told.matrix_error == pytest.approx(np.hypot(0.02, 1 - 1 / 1.02))


@pytest.mark.parametrize("motion", daily(["uniform", "tilted", "level"]))
def test_fits_are_as_wrong_as_they_claim(motion: str, trials: Choose) -> None:
    """Over 30 seeds the ratio of true to claimed error has a root mean square of one, and p is small as rarely as it
    should be."""
    tellings, claim = [], trials(30, 8)
    for seed in claim.seeds:
        recording = tumble(seed, motion=motion, n=300)
        tellings.append(evaluate(calibrate.fit(recording.samples), Truth.of(recording)))
    ratios = np.array([told.heading_ratio for told in tellings], dtype=float)
    low, high = claim.ratios(0.75, 1.25)
    assert low < np.sqrt(np.mean(ratios**2)) < high
    assert sum(told.verdict == "worse than claimed" for told in tellings) <= 2


def test_one_that_claims_too_much_is_found_out() -> None:
    found = calibrate.fit(RECORDING.samples)
    moved = replace(
        found, calibration=replace(found.calibration, offset=found.calibration.offset + np.array([3.0, 0.0, 0.0]))
    )
    told = evaluate(moved, TRUTH)
    assert (told.verdict, told.is_on_target) == ("worse than claimed", False)
    assert told.heading_ratio is not None
    assert told.heading_ratio > 10


def test_mapped_axes_are_held_against_the_mapped_truth() -> None:
    """As if the axes had been recorded so: a sensor turned over is as good as before."""
    plain = evaluate(calibrate.fit(RECORDING.samples), TRUTH, dip_deg=60)
    samples = Samples.of(RECORDING.samples.field, unit="uT", axes="x,-y,-z")
    over = evaluate(calibrate.fit(samples), TRUTH, dip_deg=-60)
    npt.assert_allclose(over.offset_error, np.array([1, -1, -1]) * plain.offset_error, atol=1e-6)
    assert over.unrotated_direction_error_deg[0] == pytest.approx(plain.unrotated_direction_error_deg[0], rel=1e-3)
    assert over.heading_error_deg.rms == pytest.approx(plain.heading_error_deg.rms, rel=1e-3)


def test_axes_of_a_mirrored_log_can_be_put_right() -> None:
    mirrored = Calibration(np.eye(3), np.zeros(3), 50.0, raw=MICROTESLA, axes=Axes.of("x,y,-z"))
    assert evaluate(bare_fit(mirrored), Truth.of(tumble(n=10, sensor=Sensor()))).heading_error_deg.worst < 1e-7


def test_another_unit_and_an_impossible_target_are_refused() -> None:
    counts = bare_fit(Calibration(np.eye(3), np.zeros(3), 50.0), name="calibration.json")
    with assert_raises(UnitError):
        evaluate(counts, TRUTH)
    with assert_raises(UsageError):
        evaluate(calibration(np.eye(3), np.zeros(3)), TRUTH, target_deg=0.0)
