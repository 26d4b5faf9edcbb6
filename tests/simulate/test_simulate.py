"""Simulated recordings have the truth, the statistics and the physics that they claim."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises
from tests.worlds import SOFT_IRON

from flinders import simulate
from flinders.errors import ArrayError, UsageError
from flinders.simulate import Sensor, angle_error_deg, tumble


def test_fibonacci_directions_reproduce_the_golden_sphere_fit() -> None:
    """The data of the published comparison, made of `fibonacci(500)`, give its sphere: centre and radius to 1e-6."""
    distortion = SOFT_IRON
    noise = np.random.default_rng(20240601).standard_normal((500, 3))
    raw = 50 * simulate.fibonacci(500) @ distortion.T + [20, 120, 90] + 0.5 * noise
    x, y, z, constant = np.linalg.lstsq(np.column_stack([2 * raw, np.ones(500)]), np.sum(raw**2, axis=1))[0]
    npt.assert_allclose([x, y, z], [19.980117, 119.964560, 90.030444], atol=1e-6)
    assert np.sqrt(constant + x * x + y * y + z * z) == pytest.approx(53.95222, abs=1e-5)


def test_fibonacci_directions_are_the_formula() -> None:
    """z = 1 − 2i/n, longitude π(1 + √5) i, at i = ½, 1½, …"""
    steps = np.arange(500) + 0.5
    z, longitude = 1 - 2 * steps / 500, np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - z * z)
    expected = np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], axis=1)
    npt.assert_array_equal(simulate.fibonacci(500), expected)


def test_random_numbers_of_sensors_and_motions_stay_as_they_are() -> None:
    """Published tables were measured on them: a seed must mean the same recording in every release."""

    def rng() -> np.random.Generator:
        return np.random.default_rng([20240607, 0, 0])

    draws = {
        "sensor": Sensor.random(rng()).offset,
        "uniform": simulate.uniform_directions(rng(), 500)[-1],
        "clumped": simulate.clumped_directions(rng(), 1250)[-1],
        "tilted": simulate.tilted(rng(), 2000)[-1, 0],
        "level": simulate.level_turn(rng(), 1000)[-1, 0],
        "hand": simulate.hand_tumble(rng()).attitudes[-1, 0],
    }
    expected = {
        "sensor": [5.4233614862, -39.904240991, -10.835811871],
        "uniform": [0.2575682726, -0.8419645507, -0.4740825669],
        "clumped": [0.1903400381, 0.752318185, -0.6307043827],
        "tilted": [-0.6995485924, 0.6055676144, 0.3793674092],
        "level": [-0.8883799853, -0.4591089213, 0.0],
        "hand": [0.4059041622, 0.3850612291, 0.8288363294],
    }
    for name, values in expected.items():
        npt.assert_allclose(draws[name], values, atol=1e-9, err_msg=name)


def test_a_recording_without_noise_is_the_sensor_applied_to_the_field() -> None:
    recording = tumble(seed=5, noise=0.0)
    sensor = recording.sensor
    npt.assert_allclose(
        recording.samples.field, 50 * recording.directions @ sensor.matrix.T + sensor.offset, atol=1e-10
    )


def test_noise_has_the_strength_that_the_sensor_claims_rounding_included() -> None:
    for sensor in (Sensor(noise=0.5), Sensor(noise=0.5, resolution=1.5)):
        recording = tumble(seed=6, motion="uniform", n=50_000, sensor=sensor)
        off = recording.samples.field - 50 * recording.directions
        npt.assert_allclose(off.std(axis=0), sensor.sigma, rtol=0.02)


def test_a_hand_tumble_covers_the_sphere_and_has_the_speed_that_was_asked_for() -> None:
    recording = tumble(seed=7)
    assert recording.samples.time is not None
    assert recording.samples.rate is not None
    npt.assert_allclose(recording.samples.time, np.arange(3000) / 50)
    assert np.sqrt(np.mean(recording.samples.rate**2)) == pytest.approx(1.5, rel=0.01)
    nearest = (simulate.fibonacci(100) @ recording.directions.T).max(axis=1)
    assert np.mean(nearest > np.cos(np.radians(20))) > 0.9


def test_the_rate_is_that_at_which_the_attitude_turns() -> None:
    turning = simulate.hand_tumble(np.random.default_rng(8), seconds=4, rate_hz=100)
    steps = np.swapaxes(turning.attitudes[:-1], 1, 2) @ turning.attitudes[1:]
    npt.assert_allclose(steps, simulate.turns(turning.rate[:-1] / 100), atol=1e-9)


def test_the_field_turns_against_the_rate() -> None:
    """dh/dt = −ω × h in body axes: what a gyro term relies on."""
    turning = simulate.hand_tumble(np.random.default_rng(9), seconds=4, rate_hz=1000)
    seen = simulate.in_body_axes(turning.attitudes, simulate.north_and_down(60.0))
    npt.assert_allclose(np.diff(seen, axis=0) * 1000, -np.cross(turning.rate, seen)[:-1], atol=0.05)


def test_a_level_body_feels_gravity_on_its_z_axis_and_sees_the_dip() -> None:
    recording = tumble(seed=10, motion="level", sensor=Sensor(), dip_deg=70)
    assert recording.samples.acceleration is not None
    npt.assert_allclose(recording.samples.acceleration.mean(axis=0), [0, 0, -9.81], atol=0.01)
    npt.assert_allclose(recording.samples.field[:, 2], 50 * np.sin(np.radians(70)))


def test_the_angle_between_gravity_and_field_is_constant_whatever_the_attitude() -> None:
    for motion in ("hand", "tilted", "level"):
        recording = tumble(seed=11, motion=motion, dip_deg=55)
        assert recording.samples.acceleration is not None
        down = -recording.samples.acceleration / 9.81
        sines = np.sum(down * recording.directions, axis=1)
        npt.assert_allclose(sines, np.sin(np.radians(55)), atol=0.04)


def test_a_heading_turns_clockwise_seen_from_above() -> None:
    """ψ = atan2(−m_y, m_x): a body that has turned by 30° to the right of north says 30°."""
    attitude = simulate.turns([[0.0, 0.0, np.radians(30)]])
    ((x, y, _),) = simulate.in_body_axes(attitude, simulate.north_and_down(60.0))
    assert np.degrees(np.arctan2(-y, x)) == pytest.approx(30)


def test_a_tilted_body_has_all_headings_and_never_tilts_further_than_asked() -> None:
    attitudes = simulate.tilted(np.random.default_rng(12), 5000, tilt_deg=20)
    assert np.degrees(np.arccos(attitudes[:, 2, 2])).max() == pytest.approx(20, abs=0.1)
    headings = np.degrees(np.arctan2(attitudes[:, 1, 0], attitudes[:, 0, 0])) % 360
    assert np.histogram(headings, bins=12, range=(0, 360))[0].min() > 300


def test_stray_fields_are_half_to_three_field_strengths() -> None:
    recording = tumble(seed=13, motion="uniform", sensor=Sensor(), field_strength=40, outliers=0.4)
    off = np.linalg.norm(recording.samples.field - 40 * recording.directions, axis=1)
    assert off[recording.outliers].min() >= 0.5 * 40
    assert off[recording.outliers].max() <= 3.0 * 40
    npt.assert_allclose(off[~recording.outliers], 0.0, atol=1e-9)


def test_the_angle_error_of_a_small_offset_is_what_geometry_says() -> None:
    """An offset error δ turns a direction by |δ across it|/F: √(2/3) δ/F on average over the sphere."""
    recording = tumble(seed=14, sensor=Sensor())
    expected = np.degrees(np.sqrt(2 / 3) * 0.1 / 50)
    assert angle_error_deg(np.eye(3), [0.0, 0.1, 0.0], recording) == pytest.approx(expected, rel=1e-3)


def test_arrays_of_a_sensor_cannot_be_changed_behind_its_back() -> None:
    given = np.eye(3)
    sensor = Sensor(given)
    given[0, 0] = 7.0
    assert sensor.matrix[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        sensor.offset[0] = 1.0


@pytest.mark.parametrize(
    "options",
    [
        {"motion": "dance"},
        {"n": 0},
        {"n": 10**8},
        {"outliers": 1.5},
        {"noise": -1.0},
        {"field_strength": 0.0},
    ],
)
def test_impossible_recordings_are_refused_with_the_number_that_is_wrong(options: dict[str, Any]) -> None:
    with assert_raises(UsageError):
        tumble(**options)


@pytest.mark.parametrize(
    "options",
    [
        {"resolution": 0.0},
        {"saturation": float("nan")},
        {"matrix": np.diag([1.0, 1.0, -1.0])},
        {"matrix": np.eye(2)},
        {"offset": np.zeros(2)},
        {"offset": np.zeros((1, 3))},
    ],
)
def test_impossible_sensors_are_refused_with_what_is_wrong(options: dict[str, Any]) -> None:
    with assert_raises((ArrayError, UsageError)):
        Sensor(**options)


def test_iron_too_strong_to_be_sure_of_is_refused() -> None:
    with assert_raises(UsageError):
        Sensor.random(np.random.default_rng(0), strength=2.0)
