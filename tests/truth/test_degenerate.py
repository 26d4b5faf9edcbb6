"""Recordings that can hardly be calibrated: refused with a reason, or limited; never good with a wrong heading."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

import flinders
from flinders import simulate
from flinders.errors import FitError, NotAnEllipsoid, StuckAxis, TooFewSamples, Unmoved
from flinders.estimators import METHODS
from flinders.result import Refused

if TYPE_CHECKING:
    from flinders.arrays import Floats

ANY: Final = pytest.mark.parametrize("method", sorted(METHODS))
GENERAL: Final = pytest.mark.parametrize("method", sorted(set(METHODS) - {"sphere", "axes"}))
CENTRE: Final = np.array([10.0, -20.0, 30.0])
TURN: Final = simulate.turns([[0.9, 0.4, 0.3]])[0]
LONG: Final = TURN @ np.diag([50.0, 50.0, 70.0]) @ TURN.T
SKEW: Final = 50.0 * np.array([[1.0, 0.2, 0.1], [0.2, 1.1, 0.15], [0.1, 0.15, 0.9]])


def ring(height: float, n: int = 400) -> Floats:
    """(n, 3) directions at one height."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    across = np.sqrt(1 - height * height)
    return np.stack([across * np.cos(angle), across * np.sin(angle), np.full(n, height)], axis=1)


def read(directions: Floats, shape: Floats, noise: float = 0.0) -> Floats:
    """Readings of a sensor, with noise from one seed."""
    white = np.random.default_rng(1).standard_normal(directions.shape)
    return np.asarray(CENTRE + directions @ shape + noise * white, np.float64)


def refused(field: Floats, method: str) -> FitError:
    with pytest.raises(FitError) as caught:
        flinders.fit(field, method=method)
    return caught.value


def answered(field: Floats, method: str) -> flinders.Fit | None:
    """The fit; None where it is refused for what the readings show. Any other error is a fault."""
    try:
        return flinders.fit(field, method=method)
    except (Refused, NotAnEllipsoid):
        return None


def heading_error(fit: flinders.Fit, shape: Floats) -> float:
    """Worst error in degrees of the heading of a level vehicle at dip 60°, the mean taken off."""
    heading, directions = flinders.heading.level_turn(60.0)
    x, y, _ = fit.calibration.matrix @ (
        CENTRE[:, np.newaxis] + shape @ directions - fit.calibration.offset[:, np.newaxis]
    )
    error = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.degrees(np.abs(error - error.mean()).max()))


@ANY
@pytest.mark.parametrize("height", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_one_ring_is_refused(method: str, height: float, noise: float) -> None:
    error = refused(read(ring(height), LONG, noise), method)
    assert isinstance(error, Refused | NotAnEllipsoid)
    if isinstance(error, Refused):
        assert error.fit.findings[0].code == "one-plane"
        assert "also turn the sensor about its other axes" in str(error)


@ANY
def test_one_ring_about_an_axis_of_the_sensor_is_an_axis_that_is_stuck(method: str) -> None:
    error = refused(read(ring(0.5), 50.0 * np.eye(3)), method)
    assert isinstance(error, StuckAxis)
    assert (error.axes, error.evidence["axes"]) == (("z",), ("z",))
    assert error.values == pytest.approx((55.0,))


@ANY
@pytest.mark.parametrize("axes", [(1,), (0, 2), (0, 1, 2)], ids=["one", "two", "all"])
def test_axes_that_never_change_are_named(method: str, axes: tuple[int, ...]) -> None:
    field = read(simulate.fibonacci(200), SKEW, 0.3)
    field[:, axes] = 7.25
    error = refused(field, method)
    assert isinstance(error, StuckAxis | Unmoved)
    if isinstance(error, StuckAxis):
        assert error.axes == tuple("xyz"[axis] for axis in axes)
        assert error.values == (7.25,) * len(axes)


@ANY
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_readings_on_one_line_are_refused(method: str, noise: float) -> None:
    along = np.linspace(-1, 1, 80)[:, np.newaxis] * [1.0, 2.0, 3.0]
    assert isinstance(refused(read(along, 20 * np.eye(3), noise), method), Refused | NotAnEllipsoid)


@ANY
def test_a_sensor_that_was_never_moved_is_refused(method: str) -> None:
    still = read(np.repeat([[0.6, 0.0, 0.8]], 1000, axis=0), SKEW, 0.3)
    assert isinstance(refused(still, method), Refused | NotAnEllipsoid | Unmoved)


@ANY
def test_a_small_cap_is_refused(method: str) -> None:
    directions = simulate.fibonacci(6000)
    cap = directions[directions[:, 2] > np.cos(np.radians(15))]
    error = refused(read(cap, SKEW, 0.3), method)
    assert isinstance(error, Refused | NotAnEllipsoid)


@ANY
@pytest.mark.parametrize("seed", range(5))
def test_a_handful_of_readings_is_too_few_or_limited(method: str, seed: int) -> None:
    field = read(np.random.default_rng(seed).permutation(simulate.fibonacci(60)), 50.0 * np.eye(3), 0.3)
    for n in range(1, 13):
        if n < METHODS[method].unknowns:
            error = refused(field[:n], method)
            assert isinstance(error, TooFewSamples)
            assert (error.found, error.needed) == (n, METHODS[method].unknowns)
            continue
        fit = answered(field[:n], method)
        if fit is not None:
            assert fit.verdict == "limited"
            assert next(finding.number for finding in fit.findings if finding.code == "few-samples") == n


@GENERAL
def test_six_places_seen_again_and_again_are_not_many(method: str) -> None:
    """The faces of a box fix an offset, not nine unknowns."""
    faces = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 50, axis=0)
    fit = answered(read(faces, SKEW, 0.3), method)
    assert fit is None or fit.verdict == "limited" or heading_error(fit, SKEW) < 4 * fit.heading_error_deg.worst


@GENERAL
@pytest.mark.parametrize("shape", [50.0 * np.eye(3), LONG, SKEW], ids=["sphere", "long", "skew"])
def test_two_noisy_rings_are_never_good_with_a_wrong_heading(method: str, shape: Floats) -> None:
    field = read(np.concatenate([ring(0.5), ring(-0.5)]), shape, 0.3)
    fit = answered(field, method)
    assert (
        fit is None or fit.verdict == "limited" or heading_error(fit, shape) < max(1.0, 4 * fit.heading_error_deg.worst)
    )


@GENERAL
@pytest.mark.parametrize(
    "directions",
    [np.concatenate([ring(0.5), ring(-0.5)]), np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 50, axis=0)],
    ids=["two rings", "six faces"],
)
@pytest.mark.parametrize("shape", [LONG, SKEW], ids=["long", "skew"])
def test_readings_without_noise_that_leave_the_ellipsoid_open_are_never_good_with_a_wrong_heading(
    method: str, directions: Floats, shape: Floats
) -> None:
    """Rank 8 and 6 of 9: any number of ellipsoids goes through them, exactly."""
    fit = answered(read(directions, shape), method)
    assert fit is None or fit.verdict == "limited" or heading_error(fit, shape) < 1.0


@GENERAL
def test_three_rings_are_enough(method: str) -> None:
    field = read(np.concatenate([ring(0.6), ring(0.0), ring(-0.6)]), SKEW, 0.3)
    fit = flinders.fit(field, method=method)
    assert heading_error(fit, SKEW) < max(4 * fit.heading_error_deg.worst, 0.5)
    assert fit.heading_error_deg.worst < 1.0
