"""An accelerometer from still poses: known errors are found within what is claimed, and the tilt that is left too."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.still_poses import EDGES, SIDES, FlawedAccelerometer

from flinders.errors import FitError, MissingPose, TooFewSamples
from flinders.estimators.accelerometer_poses import AccelerometerEstimate, from_poses, from_readings
from flinders.estimators.still_poses import StillPoses
from flinders.geometry.sphere import fibonacci
from flinders.heading.tilt_error import tilt_gradients

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats

ALL: Final = np.concatenate([SIDES, EDGES])


def estimated(sensor: FlawedAccelerometer, seed: int, attitudes: Floats) -> AccelerometerEstimate:
    return from_poses(StillPoses.of(sensor.put_down(seed, attitudes)))


def tilts_deg(found: AccelerometerEstimate, off: Floats) -> Floats:
    """(N,) how far errors that are left turn the vertical, in attitudes all over."""
    turned: Floats = np.rad2deg(np.linalg.norm(tilt_gradients(found.errors, fibonacci(200)) @ off, axis=1))
    return turned


@pytest.mark.parametrize(("attitudes", "sees"), [(SIDES, False), (ALL, True)], ids=["six sides", "and six edges"])
def test_errors_are_found_within_their_covariance_and_the_tilt_within_its_claim(
    attitudes: Floats, sees: bool, trials: Choose
) -> None:
    """Mean of δᵀC⁻¹δ over 9 (NEES), coverage of the bound of 95 %, and rms tilt over the claim."""
    several = trials(4000, 100)
    nees, covered, squares = [], [], []
    for seed in several.seeds:
        sensor = FlawedAccelerometer.drawn(seed)
        found = estimated(sensor, seed, attitudes)
        off = found.errors - sensor.in_scale(found.scale)
        nees.append(off @ np.linalg.solve(found.covariance, off) / 9.0)
        tilts = tilts_deg(found, off)
        covered.append(tilts.max() <= found.tilt_error.bound_95)
        squares.append(np.mean(tilts**2) / found.tilt_error.rms**2)
        assert found.has_misalignment == sees
    low, high = several.ratios(0.96, 1.04)
    assert low < np.mean(nees) < high
    assert np.mean(covered) > 0.95 - 0.016 * several.widening
    low, high = several.ratios(0.97, 1.03)
    assert low < np.sqrt(np.mean(squares)) < high


def test_six_poses_of_square_axes_are_as_good_as_their_noise_allows() -> None:
    """Offsets to σ/√(2n), gains to the same over gravity: two poses of n readings tell each."""
    expected = 0.05 / np.sqrt(2.0 * 60.0)
    offsets = []
    for seed in range(100):
        sensor = FlawedAccelerometer.drawn(seed, misalignment=0.0)
        triad = estimated(sensor, seed, SIDES).triad()
        assert triad.offset_sigma is not None
        assert triad.offset_sigma == pytest.approx(np.full(3, expected), rel=0.25)
        offsets.append((triad.offset - 9.80665 * sensor.errors[:3]) / expected)
    assert 0.85 < np.sqrt(np.mean(np.square(offsets))) < 1.2


@pytest.mark.parametrize("missing", range(6))
def test_a_missing_side_is_named(missing: int) -> None:
    sensor = FlawedAccelerometer.drawn(3)
    with pytest.raises(MissingPose) as caught:
        estimated(sensor, 3, np.delete(SIDES, missing, axis=0))
    assert caught.value.evidence["side"] == ("+x", "+y", "+z", "-x", "-y", "-z")[missing]
    assert caught.value.evidence["open"] == 2
    assert f"{str(caught.value.evidence['side']).replace('-', '−')} points up" in caught.value.message


@pytest.mark.parametrize("count", range(1, 5))
def test_a_side_that_was_recorded_is_not_asked_for_again(count: int) -> None:
    """However the sides that are there were held: their small tilts tell little of an axis that was never upright."""
    names = np.array(["+x", "+y", "+z", "-x", "-y", "-z"])
    for seed, sides in enumerate(combinations(range(6), count)):
        with pytest.raises(MissingPose) as caught:
            estimated(FlawedAccelerometer.drawn(seed), seed, SIDES[list(sides)])
        assert caught.value.evidence["side"] not in names[list(sides)]


def test_poses_at_any_attitude_tell_all_without_a_side_among_them() -> None:
    attitudes = fibonacci(14)
    sensor = FlawedAccelerometer.drawn(5)
    found = estimated(sensor, 5, attitudes)
    off = found.errors - sensor.in_scale(found.scale)
    assert np.all(np.abs(off) < 4.0 * np.sqrt(np.diag(found.covariance)))
    assert found.has_misalignment
    assert found.tilt_error.bound_95 < 0.5


def test_poses_that_no_offsets_explain_widen_the_claim() -> None:
    """Of a device that is pushed while it stands: lengths differ by 1 %."""
    read = FlawedAccelerometer.drawn(2, noise=0.02).put_down(2, np.concatenate([ALL, fibonacci(20)]))
    poses = StillPoses.of(read)
    pushed = StillPoses(
        poses.bounds, poses.mean * np.random.default_rng(2).normal(1.0, 0.01, (len(poses), 1)), poses.noise
    )
    plain, widened = from_poses(poses), from_poses(pushed)
    assert plain.excess == 1.0
    assert widened.excess > 5.0
    assert widened.tilt_error.rms > 5.0 * plain.tilt_error.rms


def test_what_is_no_accelerometer_at_rest_is_refused() -> None:
    rng = np.random.default_rng(1)
    heights = np.repeat(np.abs(rng.normal(size=(12, 3))) + np.array([9.0, 1.0, 30.0]), 40, axis=0)
    with pytest.raises(FitError):
        from_poses(StillPoses.of(heights + 0.01 * rng.normal(size=heights.shape)))
    with pytest.raises(TooFewSamples):
        from_readings(9.8 * SIDES)
    with pytest.raises(MissingPose):
        from_poses(StillPoses.of(np.zeros((0, 3))))


def test_still_spans_are_those_that_were_made_and_gaps_belong_to_none() -> None:
    read = FlawedAccelerometer.drawn(1).put_down(1, SIDES, 60)
    read[200] = np.nan
    poses = StillPoses.of(read)
    begins = 85 * np.arange(6)  # 60 readings at rest and 25 on the way
    assert len(poses) >= 6
    inside = [np.any((begins <= begin + 10) & (end <= begins + 70)) for begin, end in poses.bounds]
    assert all(inside)
    assert not any(begin <= 200 < end for begin, end in poses.bounds)


def test_a_real_accelerometer_agrees_with_magneto(recordings: Callable[[str], Path]) -> None:
    """Turned slowly, never at rest: Magneto 1.4 states B = (79.60, −18.56, 383.31) and no uncertainty."""
    read = np.loadtxt(recordings("jremington_icm20948/icm_20948_cal_acc.csv"), delimiter=",")
    found = from_readings(read)
    triad = found.triad()
    assert triad.offset_sigma is not None
    assert np.all(np.abs(triad.offset - [79.60, -18.56, 383.31]) < 2.0 * triad.offset_sigma)
    assert 3.0 * 9.80665 / np.trace(triad.matrix) == pytest.approx(16604.0, rel=0.005)
    assert triad.unit == "counts"
    assert 0.3 < found.tilt_error.rms < 0.8
