"""`auto` keeps what helps and leaves out what does not: aids and disturbances of recordings whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences
from tests.trials import nightly

import flinders
from flinders import simulate
from flinders.estimators.aiding import fit_aided
from flinders.fitting.aid_selection import fit_with_aids
from flinders.fitting.disturbance_selection import select_disturbances
from flinders.geometry.quaternions import from_matrix
from flinders.geometry.rotation import rotations
from flinders.heading.error_propagation import level_turn

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.samples import Samples
    from flinders.estimators.aiding import AidedFit
    from flinders.simulate import Simulated

IMU: Final = simulate.Imu(gyro_bias=np.array([0.02, -0.01, 0.015]))
SCALES: Final = np.array([1.02, 0.98, 1.015])
MOUNTING: Final = rotations(np.array([[0.06, -0.05, 0.08]]))[0]
"""Six degrees between the magnetometer's axes and those of gyro and accelerometer."""


def swayed(seed: int) -> Simulated:
    """30 s at 50 Hz, all headings, leaning by up to 35°."""
    return simulate.tumble(seed=seed, motion="swayed", n=1500, imu=IMU)


def heading_error_deg(found: AidedFit, true: Simulated) -> float:
    """Rms over a level turn, its mean removed, in the magnetometer's own axes."""
    _, fields = level_turn(60.0)
    readings = true.sensor.offset + true.field_strength * fields.T @ np.asarray(true.sensor.matrix).T
    corrected = np.linalg.solve(found.parameters.shape, (readings - found.parameters.offset).T)
    error = np.exp(1j * (np.arctan2(-corrected[1], corrected[0]) - np.arctan2(-fields[1], fields[0])))
    return float(np.rad2deg(np.sqrt(np.mean(np.angle(error / error.mean()) ** 2))))


def with_gyro_scales(samples: Samples) -> Samples:
    assert samples.rate is not None
    return replace(samples, rate=samples.rate * SCALES)


def with_another_mounting(samples: Samples) -> Samples:
    assert samples.rate is not None
    assert samples.acceleration is not None
    return replace(samples, rate=samples.rate @ MOUNTING.T, acceleration=samples.acceleration @ MOUNTING.T)


def fifty_milliseconds_late(samples: Samples) -> Samples:
    assert samples.time is not None
    late = [np.interp(samples.time - 0.05, samples.time, column) for column in samples.field.T]
    return replace(samples, field=np.stack(late, axis=1))


def shaken(samples: Samples) -> Samples:
    assert samples.acceleration is not None
    vibration = np.random.default_rng(5).normal(scale=3.0, size=samples.field.shape)
    return replace(samples, acceleration=samples.acceleration + vibration)


def all_at_once(samples: Samples) -> Samples:
    return shaken(fifty_milliseconds_late(with_another_mounting(with_gyro_scales(samples))))


@pytest.mark.parametrize(
    ("spoilt", "kept"),
    [
        (with_gyro_scales, ("rate", "dip")),
        nightly(with_another_mounting, ("rate", "dip")),
        nightly(fifty_milliseconds_late, ("rate",)),
        nightly(shaken, ("rate",)),
        nightly(all_at_once, ("rate",)),
    ],
)
def test_an_aid_that_helps_is_kept(spoilt: Callable[[Samples], Samples], kept: tuple[str, ...]) -> None:
    """A vertical that is late while the body turns, or shaken by a third of gravity, claims nothing beside the gyro."""
    true = swayed(2)
    samples = spoilt(true.samples)
    found, aiding = fit_with_aids(samples, "auto", acceleration_bias=0.0)
    assert found.aiding == kept
    assert heading_error_deg(found, true) < 0.5 * heading_error_deg(fit_aided(samples, ()), true)
    assert all(aid.after_deg < aid.before_deg for aid in aiding.sensors if aid.is_used)


def test_an_accelerometer_of_unknown_bias_adds_nothing_to_a_gyro() -> None:
    _, aiding = fit_with_aids(swayed(2).samples, "auto")
    assert [aid.name for aid in aiding.sensors if aid.is_used] == ["rate"]
    assert_sentences(aiding.sensors[1].reason)


def test_the_scales_of_the_gyro_are_found() -> None:
    true = swayed(2)
    found = fit_aided(with_gyro_scales(true.samples), ("rate", "dip"))
    covariance = found.of("gyro_scale")
    assert covariance is not None
    away = (1.0 + found.parameters.gyro_scale[:3]) * SCALES - 1.0
    assert np.all(np.abs(away) < 4.0 * np.sqrt(np.diag(covariance)[:3]))
    assert np.all(np.sqrt(np.diag(covariance)[:3]) < 0.01)
    assert "gyro_scale" not in fit_aided(true.samples, ("rate",), gyro_scale=0.0).layout


@pytest.mark.nightly
def test_a_gyro_that_knows_nothing_of_the_motion_is_left_out() -> None:
    true = swayed(2)
    assert true.samples.rate is not None
    mixed = replace(true.samples, rate=true.samples.rate[np.random.default_rng(1).permutation(1500)])
    found, aiding = fit_with_aids(mixed, "auto")
    assert "rate" not in found.aiding
    assert aiding.sensors[0].reason


@pytest.mark.nightly
def test_a_gyro_a_fifth_too_strong_is_left_out() -> None:
    true = swayed(2)
    assert true.samples.rate is not None
    _, aiding = fit_with_aids(replace(true.samples, rate=1.2 * true.samples.rate), "auto")
    assert [aid.name for aid in aiding.sensors if aid.is_used] == ["dip"]


def test_an_accelerometer_that_points_anywhere_is_left_out() -> None:
    true = swayed(2)
    assert true.samples.acceleration is not None
    mixed = replace(true.samples, acceleration=true.samples.acceleration[np.random.default_rng(1).permutation(1500)])
    found, aiding = fit_with_aids(mixed, "auto")
    assert found.aiding == ("rate",)
    assert [aid.name for aid in aiding.sensors if not aid.is_used] == ["dip"]


@pytest.mark.nightly
def test_an_accelerometer_in_coordinated_turns_is_left_out() -> None:
    flight = simulate.tumble(seed=1, motion="flight", n=1500, imu=IMU)
    _, aiding = fit_with_aids(flight.samples, "auto")
    assert [aid.name for aid in aiding.sensors if aid.is_used] == ["rate"]


def test_a_rotation_is_kept_where_the_ellipsoid_needs_no_help() -> None:
    """A tumble by hand tells offset and shape by itself, and nothing of how the accelerometer sits."""
    true = simulate.tumble(seed=3, n=1500, imu=simulate.Imu(acceleration_noise=0.5))
    fit = flinders.fit(replace(with_another_mounting(true.samples), rate=None), aiding="auto")
    assert fit.evidence.aiding is not None
    assert [aid.is_used for aid in fit.evidence.aiding.sensors] == [True]
    assert fit.calibration.rotation == "estimated"
    assert fit.evidence.aiding.rotation is not None
    npt.assert_allclose(fit.evidence.aiding.rotation, MOUNTING, atol=0.02)


def test_a_current_that_moves_the_offset_is_followed_and_says_what_it_takes_away() -> None:
    motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3])
    flown = simulate.tumble(seed=3, n=1500, disturbances=[motors]).samples
    fit = flinders.fit(flown, aiding="auto")
    assert [disturbance.name for disturbance in fit.calibration.disturbances] == ["current"]
    assert fit.evidence.aiding is not None
    assert fit.evidence.aiding.sensors[0].name == "current"
    assert fit.evidence.aiding.sensors[0].heading_change_deg > 10.0


def test_a_current_that_does_nothing_is_left_out() -> None:
    quiet = simulate.tumble(seed=3, n=1500).samples
    current = 10.0 + 8.0 * np.sin(np.arange(1500) * 0.013)
    warm = replace(quiet, current=current, temperature=np.full(1500, 21.0))
    names, told = select_disturbances(warm)
    assert names == ()
    assert [(aid.name, aid.is_used) for aid in told] == [("current", False), ("temperature", False)]
    assert "hardly changes" in told[1].reason


def test_a_short_drive_that_leans_uses_its_attitude_and_a_level_turn_does_not() -> None:
    """Both lie flat; of the drive the residuals of the ellipse are correlated, as the body leans."""
    drive, turn = (_with_attitude(motion, seed=1002) for motion in ("drive", "level"))
    leaning, level = (flinders.fit(each.samples, aiding="attitude", target_deg=10.0) for each in (drive, turn))
    assert (leaning.claim.plane, level.claim.plane) == (None, "xy")
    assert [
        [aid.is_used for aid in fit.evidence.aiding.sensors] for fit in (leaning, level) if fit.evidence.aiding
    ] == [[True], [False]]
    off = np.abs(leaning.calibration.offset - drive.sensor.offset)
    npt.assert_array_less(off, 3.0 * np.sqrt(np.diag(leaning.claim.covariance)[:3]))


def _with_attitude(motion: str, seed: int) -> Simulated:
    """30 s at 50 Hz, and an attitude that is off by 1° about each axis."""
    recording = simulate.tumble(seed=seed, motion=motion, n=1500)
    assert recording.attitudes is not None
    errors = rotations(np.random.default_rng(seed).normal(0.0, np.radians(1.0), (1500, 3)))
    return replace(recording, samples=replace(recording.samples, attitude=from_matrix(recording.attitudes @ errors)))
