"""Heading errors of level and tilted vehicles, against closed forms and against the full non-linear compass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest

from flinders import simulate
from flinders.geometry.angles import wrap_180
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import (
    attitude_limit_deg,
    deviation_covariance,
    direction_error_deg,
    direction_errors_deg,
    level_error,
    level_turn,
    raw_error,
    tilted_error,
    upright,
)
from flinders.heading.harmonics import design

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.heading.error_propagation import HeadingError

SPHERE: Final = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
SKEW: Final = Ellipsoid(
    np.array([10.0, -30.0, 20.0]), np.array([[48.0, 3.0, -2.0], [3.0, 55.0, 4.0], [-2.0, 4.0, 45.0]])
)
ROOT: Final = 0.05 * np.random.default_rng(5).normal(size=(9, 9))
COVARIANCE: Final = ROOT @ ROOT.T
VERTICAL: Final = np.diag([0.0, 0.0, 0.5**2, 0, 0, 0, 0, 0, 0])
"""Half a microtesla along z, and nothing else."""

DOWNS: Final = [np.array(down) for down in ([0.1, 0.2, 1.0], [1.0, 0.0, 0.0], [0.3, -0.5, -0.2], [0.0, 0.0, -1.0])]


def turned(ellipsoid: Ellipsoid, covariance: Floats, rotation: Floats) -> tuple[Ellipsoid, Floats]:
    """The same sensor in axes that are turned."""
    change = np.stack(
        [
            np.concatenate([rotation @ e[:3], upper_entries(rotation @ symmetric_matrix(e[3:]) @ rotation.T)])
            for e in np.eye(9)
        ],
        axis=1,
    )
    moved = Ellipsoid(rotation @ ellipsoid.centre, rotation @ ellipsoid.shape @ rotation.T)
    return moved, change @ covariance @ change.T


def assert_alike(found: HeadingError, wanted: HeadingError) -> None:
    npt.assert_allclose([found.rms, found.worst], [wanted.rms, wanted.worst], rtol=1e-6)


def compass(readings: Floats, tilt: Floats) -> Floats:
    """Heading in rad of corrected readings (K, 3), turned back to level by (3, 3)."""
    level = readings @ tilt.T
    heading: Floats = np.arctan2(-level[:, 1], level[:, 0])
    return heading


def scattered(tilt_deg: float, dip_deg: float, trials: int) -> Floats:
    """(trials,) mean square heading error in deg² of calibrations drawn from the covariance, vehicle tilted."""
    rng = np.random.default_rng(8)
    heading, fields = level_turn(dip_deg)
    azimuths = np.arange(24) * (2 * np.pi / 24)
    axes = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(24)], axis=1)
    tilts = simulate.turns(np.deg2rad(tilt_deg) * axes)
    squares = []
    for change in rng.multivariate_normal(np.zeros(9), COVARIANCE, trials):
        centre, inverse = SKEW.centre + change[:3], np.linalg.inv(SKEW.shape + symmetric_matrix(change[3:]))

        def errors(tilt: Floats, centre: Floats = centre, inverse: Floats = inverse) -> Floats:
            readings = SKEW.centre + fields.T @ tilt @ SKEW.shape
            wrong: Floats = compass((readings - centre) @ inverse, tilt) - heading
            wrapped: Floats = np.angle(np.exp(1j * wrong))
            return wrapped

        mounting = errors(np.eye(3)).mean()
        squares.append(np.mean([np.rad2deg(errors(tilt) - mounting) ** 2 for tilt in tilts]))
    return np.array(squares)


@pytest.mark.parametrize(("tilt_deg", "dip_deg"), [(0.0, 60.0), (30.0, 60.0), (75.0, 20.0), (140.0, -65.0)])
def test_a_tilted_vehicle_errs_as_the_covariance_says(tilt_deg: float, dip_deg: float, trials: Choose) -> None:
    squares = scattered(tilt_deg, dip_deg, trials(300, 60).count)
    claimed = tilted_error(SKEW, COVARIANCE, dip_deg=dip_deg, tilt_deg=tilt_deg)
    assert claimed.rms < 3.0, "small enough for the linear claim"
    assert abs(squares.mean() - claimed.rms**2) < 3.5 * squares.std() / np.sqrt(len(squares))


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, 45.0, 90.0, 150.0, 180.0])
def test_a_vertical_offset_comes_in_with_the_sine_of_the_tilt(tilt_deg: float) -> None:
    found = tilted_error(SPHERE, VERTICAL, dip_deg=60.0, tilt_deg=tilt_deg)
    wanted = np.rad2deg(0.5 / 25.0) * np.sin(np.deg2rad(tilt_deg))
    assert found.worst == pytest.approx(wanted, abs=1e-9)
    assert found.rms == pytest.approx(wanted / np.sqrt(2.0), abs=1e-9)


@pytest.mark.parametrize("limit_deg", [0.1, 0.5, 1.0, 1.14])
def test_the_attitude_limit_of_a_vertical_offset_is_an_arc_sine(limit_deg: float) -> None:
    wanted = np.rad2deg(np.arcsin(limit_deg / np.rad2deg(0.5 / 25.0)))
    assert attitude_limit_deg(SPHERE, VERTICAL, limit_deg=limit_deg) == pytest.approx(wanted, abs=0.01)


def test_the_attitude_limit_reaches_from_none_to_all() -> None:
    worst = level_error(SKEW, COVARIANCE).worst
    assert attitude_limit_deg(SKEW, COVARIANCE, limit_deg=0.99 * worst) == 0.0
    assert attitude_limit_deg(SKEW, COVARIANCE, limit_deg=10.0 * worst) == 180.0
    limits = [attitude_limit_deg(SKEW, COVARIANCE, limit_deg=factor * worst) for factor in (1.05, 1.2, 1.4, 1.6)]
    assert limits == sorted(limits)
    for factor, limit in zip((1.05, 1.2, 1.4, 1.6), limits, strict=True):
        for tilt_deg in np.linspace(0.0, limit, 7):
            assert tilted_error(SKEW, COVARIANCE, tilt_deg=tilt_deg).worst <= 1.005 * factor * worst


def test_coefficients_of_deviation_scatter_as_the_covariance_says() -> None:
    """300 calibrations drawn from it, each swung on 24 headings without noise."""
    turn, field = level_turn(65.0)
    readings = (SKEW.shape @ field + SKEW.centre[:, np.newaxis])[:, ::3]
    covariance = 1e-2 * COVARIANCE
    found = []
    for step in np.random.default_rng(4).multivariate_normal(np.zeros(9), covariance, 300):
        off = readings - (SKEW.centre + step[:3])[:, np.newaxis]
        corrected = np.linalg.solve(SKEW.shape + symmetric_matrix(step[3:]), off)
        seen = np.rad2deg(compass(corrected.T, np.eye(3)))
        deviation = wrap_180(np.rad2deg(turn[::3]) - seen)
        found.append(np.linalg.lstsq(design(seen), deviation, rcond=None)[0][1:])
    wanted = deviation_covariance(SKEW, covariance, dip_deg=65.0)
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    npt.assert_allclose(np.cov(np.transpose(found)) / scale, wanted / scale, atol=0.2)


@pytest.mark.parametrize("down", [None, *DOWNS])
def test_a_level_turn_errs_by_its_four_coefficients_and_nothing_else(down: Floats | None) -> None:
    covariance = deviation_covariance(SKEW, COVARIANCE, dip_deg=-40.0, down=down)
    rms = level_error(SKEW, COVARIANCE, dip_deg=-40.0, down=down).rms
    assert np.sqrt(np.trace(covariance) / 2.0) == pytest.approx(rms, rel=1e-9)


def test_deviation_is_that_of_the_body_where_the_sensor_is_turned_in_it() -> None:
    """A quarter turn to the right: what is fore and aft of the sensor is athwart of the body."""
    sphere, along_x = Ellipsoid(np.zeros(3), 50.0 * np.eye(3)), np.diag([0.25, 0, 0, 0, 0, 0, 0, 0, 0])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    plain, turned = (deviation_covariance(sphere, along_x, rotation=each) for each in (None, quarter))
    npt.assert_allclose(np.diagonal(turned)[[1, 0, 2, 3]], np.diagonal(plain), atol=1e-12)
    assert plain[0, 0] > 1.0


def test_without_tilt_the_tilted_error_is_the_level_one() -> None:
    for down in (None, *DOWNS):
        level = level_error(SKEW, COVARIANCE, dip_deg=-40.0, down=down)
        tilted = tilted_error(SKEW, COVARIANCE, dip_deg=-40.0, down=down)
        assert_alike(tilted, level)


def test_down_is_plus_z_unless_stated() -> None:
    down = np.array([0.0, 0.0, 1.0])
    npt.assert_array_equal(level_turn(60.0, down)[1], level_turn(60.0)[1])
    assert level_error(SKEW, COVARIANCE, down=down) == level_error(SKEW, COVARIANCE)
    assert raw_error(SKEW, down=down) == raw_error(SKEW)


@pytest.mark.parametrize("down", DOWNS, ids=str)
def test_a_vehicle_does_not_care_how_its_sensor_is_mounted_if_it_knows_where_down_is(down: Floats) -> None:
    rotation = upright(down)
    npt.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    npt.assert_allclose(rotation[:, 2], down / np.linalg.norm(down))
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    moved, carried = turned(SKEW, COVARIANCE, rotation)
    for tilt_deg in (0.0, 50.0):
        here = tilted_error(SKEW, COVARIANCE, tilt_deg=tilt_deg)
        there = tilted_error(moved, carried, tilt_deg=tilt_deg, down=down)
        assert_alike(there, here)
    assert raw_error(moved, down=down).worst == pytest.approx(raw_error(SKEW).worst)
    assert raw_error(SPHERE, down=down).worst == pytest.approx(0.0, abs=1e-9)


def test_a_sensor_upside_down_is_one_under_a_field_from_below() -> None:
    over = level_error(SKEW, COVARIANCE, dip_deg=60.0, down=np.array([0.0, 0.0, -1.0]))
    south = level_error(SKEW, COVARIANCE, dip_deg=-60.0)
    assert_alike(over, south)


def test_direction_errors_are_those_of_calibrations_drawn_from_the_covariance() -> None:
    directions = simulate.fibonacci(40)
    claimed = direction_errors_deg(SKEW, COVARIANCE, directions)
    squares = []
    for change in np.random.default_rng(3).multivariate_normal(np.zeros(9), COVARIANCE, 2000):
        readings = SKEW.centre + directions @ SKEW.shape - change[:3]
        seen = readings - SKEW.centre
        corrected = seen @ np.linalg.inv(SKEW.shape + symmetric_matrix(change[3:]))
        across = np.linalg.norm(np.cross(corrected, directions), axis=1)
        squares.append(np.rad2deg(np.arctan2(across, np.sum(corrected * directions, axis=1))) ** 2)
    npt.assert_allclose(np.mean(squares, axis=0), claimed**2, rtol=0.2)
    assert np.mean(squares) == pytest.approx(float(np.mean(claimed**2)), rel=0.06)


def test_an_offset_alike_in_all_axes_turns_all_directions_alike() -> None:
    alike = np.diag([1.0, 1.0, 1.0, 0, 0, 0, 0, 0, 0])
    wanted = np.rad2deg(np.sqrt(2.0) / 50.0)
    npt.assert_allclose(direction_errors_deg(SPHERE, alike, simulate.fibonacci(50)), wanted)
    npt.assert_allclose(direction_error_deg(SPHERE, alike), wanted)
