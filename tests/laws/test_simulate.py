"""Laws of simulated sensors, motions and recordings, for any seed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.trials import examples

from flinders import simulate
from flinders.simulate import (
    MOTIONS,
    MotorCurrent,
    PassingMagnet,
    Perturbation,
    Sensor,
    Simulated,
    Step,
    ThermalDrift,
    angle_error_deg,
    tumble,
)
from flinders.simulate.truth import Truth, dumps, loads

if TYPE_CHECKING:
    from flinders.arrays import Floats

seeds = st.integers(0, 2**32 - 1)
motions = st.sampled_from(sorted(MOTIONS))
counts = st.integers(1, 60)
fields = arrays(np.float64, (7, 3), elements=st.floats(-200, 200, allow_subnormal=False))


@st.composite
def sensors(draw: st.DrawFn) -> Sensor:
    """Any noiseless sensor whose matrix is well away from singular: a turn, gains of 0.4 to 2.5, a turn."""
    rng = np.random.default_rng(draw(seeds))
    first, second = simulate.turns(rng.normal(0.0, 2.0, (2, 3)))
    gains = [draw(st.floats(0.4, 2.5)) for _ in range(3)]
    return Sensor(first @ np.diag(gains) @ second, rng.uniform(-500, 500, 3))


@st.composite
def recordings(draw: st.DrawFn) -> Simulated:
    return tumble(draw(seeds), motion=draw(motions), n=draw(counts), outliers=draw(st.floats(0, 1)))


@st.composite
def disturbances(draw: st.DrawFn) -> list[Perturbation]:
    """Some of all kinds, in any order, of any strength."""
    strengths, shares = st.floats(0.0, 100.0), st.floats(0.0, 1.0)
    kinds = st.one_of(
        st.builds(MotorCurrent, strengths),
        st.builds(ThermalDrift, strengths, kelvin=st.floats(-30, 30)),
        st.builds(Step, strengths, at=shares),
        st.builds(PassingMagnet, strengths, at=shares, seconds=st.floats(0.01, 10.0)),
    )
    return draw(st.lists(kinds, max_size=4))


def assert_rotations(matrices: Floats) -> None:
    npt.assert_allclose(matrices @ np.swapaxes(matrices, -1, -2), np.broadcast_to(np.eye(3), matrices.shape), atol=1e-9)
    assert np.all(np.linalg.det(matrices) > 0)


def assert_same(one: Simulated, other: Simulated) -> None:
    npt.assert_array_equal(one.samples.field, other.samples.field)
    npt.assert_array_equal(one.directions, other.directions)
    npt.assert_array_equal(one.outliers, other.outliers)
    for name in ("time", "acceleration", "rate"):
        first, second = getattr(one.samples, name), getattr(other.samples, name)
        assert (first is None) == (second is None)
        if first is not None:
            npt.assert_array_equal(first, second)


@given(sensors(), fields)
def test_the_correction_brings_back_the_strength_of_any_field(sensor: Sensor, field: Floats) -> None:
    matrix, offset = sensor.correction
    corrected = (sensor.read(field, np.random.default_rng(0)) - offset) @ matrix.T
    npt.assert_allclose(np.linalg.norm(corrected, axis=1), np.linalg.norm(field, axis=1), atol=1e-9)


@given(sensors())
def test_the_correction_is_symmetric_and_positive(sensor: Sensor) -> None:
    matrix, _ = sensor.correction
    npt.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix)[0] > 0


@given(sensors())
def test_what_the_correction_leaves_is_a_rotation(sensor: Sensor) -> None:
    assert_rotations(sensor.rotation)
    npt.assert_allclose(sensor.rotation, sensor.correction[0] @ sensor.matrix)


@given(seeds, st.floats(0, 1.79))
def test_a_random_sensor_is_symmetric_so_its_correction_is_the_inverse(seed: int, strength: float) -> None:
    sensor = Sensor.random(np.random.default_rng(seed), strength=strength)
    npt.assert_allclose(sensor.correction[0] @ sensor.matrix, np.eye(3), atol=1e-7)
    assert np.abs(sensor.offset).max() <= 100 * strength


@given(fields, st.floats(0.01, 5.0), seeds)
def test_quantised_readings_are_multiples_of_the_resolution(field: Floats, resolution: float, seed: int) -> None:
    sensor = Sensor(noise=1.0, resolution=resolution)
    steps = sensor.read(field, np.random.default_rng(seed)) / resolution
    npt.assert_allclose(steps, np.round(steps), atol=1e-9)
    smooth = Sensor(noise=1.0).read(field, np.random.default_rng(seed))
    assert np.abs(steps * resolution - smooth).max() <= resolution / 2 + 1e-9


@given(fields, st.floats(1.0, 300.0), seeds)
def test_saturated_readings_stay_within_the_limit(field: Floats, limit: float, seed: int) -> None:
    read = Sensor(noise=1.0, saturation=limit).read(field, np.random.default_rng(seed))
    free = Sensor(noise=1.0).read(field, np.random.default_rng(seed))
    npt.assert_array_equal(read, np.clip(free, -limit, limit))


@given(recordings())
def test_directions_have_length_one(recording: Simulated) -> None:
    npt.assert_allclose(np.linalg.norm(recording.directions, axis=1), 1.0, atol=1e-12)


@given(recordings())
def test_attitudes_are_rotations_that_turn_the_field_into_the_directions(recording: Simulated) -> None:
    if recording.attitudes is None:
        assert recording.samples.acceleration is None
        return
    assert_rotations(recording.attitudes)
    world = np.einsum("nij,nj->ni", recording.attitudes, recording.directions)
    npt.assert_allclose(world, np.broadcast_to(simulate.north_and_down(60.0), world.shape), atol=1e-9)


@given(seeds, motions, counts)
def test_the_same_seed_gives_the_same_recording(seed: int, motion: str, n: int) -> None:
    assert_same(tumble(seed, motion=motion, n=n, outliers=0.3), tumble(seed, motion=motion, n=n, outliers=0.3))


@given(seeds, motions, counts)
def test_noise_and_outliers_change_neither_sensor_nor_path(seed: int, motion: str, n: int) -> None:
    plain, disturbed = tumble(seed, motion=motion, n=n, noise=0.0), tumble(seed, motion=motion, n=n, outliers=0.5)
    npt.assert_array_equal(plain.directions, disturbed.directions)
    npt.assert_array_equal(plain.sensor.matrix, disturbed.sensor.matrix)
    npt.assert_array_equal(plain.sensor.offset, disturbed.sensor.offset)


@given(seeds, motions, counts, st.floats(0, 1))
def test_as_many_readings_are_astray_as_asked_and_no_others(seed: int, motion: str, n: int, share: float) -> None:
    clean, dirty = tumble(seed, motion=motion, n=n), tumble(seed, motion=motion, n=n, outliers=share)
    moved = np.any(clean.samples.field != dirty.samples.field, axis=1)
    npt.assert_array_equal(moved, dirty.outliers)
    assert dirty.outliers.sum() == round(share * n)


@given(seeds, st.floats(1, 179))
def test_a_clump_stays_within_its_angle(seed: int, half_angle_deg: float) -> None:
    rng = np.random.default_rng(seed)
    pole = simulate.uniform_directions(np.random.default_rng(seed), 1)[0]
    directions = simulate.clump(rng, 20, half_angle_deg=half_angle_deg)
    npt.assert_array_less(np.cos(np.radians(half_angle_deg)) - 1e-9, directions @ pole)


@given(arrays(np.float64, (5, 3), elements=st.floats(-10, 10)))
def test_turns_are_rotations_that_keep_their_axis(axes: Floats) -> None:
    rotations = simulate.turns(axes)
    assert_rotations(rotations)
    npt.assert_allclose(np.einsum("nij,nj->ni", rotations, axes), axes, atol=1e-9)


@given(st.integers(1, 400))
def test_fibonacci_directions_balance(n: int) -> None:
    directions = simulate.fibonacci(n)
    npt.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.linalg.norm(directions.sum(axis=0)) < 2.0


@examples(30)
@given(sensors(), st.floats(0.1, 10.0), seeds)
def test_the_angle_error_ignores_scale_and_rotation_of_the_matrix(sensor: Sensor, scale: float, seed: int) -> None:
    recording = tumble(seed, motion="uniform", n=5, sensor=sensor)
    matrix, offset = sensor.correction
    turn = simulate.turns(np.random.default_rng(seed).normal(size=(1, 3)))[0]
    expected = angle_error_deg(matrix, offset + 1.0, recording)
    assert angle_error_deg(scale * turn @ matrix, offset + 1.0, recording) == pytest.approx(expected, rel=1e-6)


@examples(30)
@given(sensors(), seeds)
def test_without_its_rotation_a_perfect_correction_has_no_error(sensor: Sensor, seed: int) -> None:
    recording = tumble(seed, motion="uniform", n=5, sensor=sensor)
    assert angle_error_deg(*sensor.correction, recording, rotation="best") == pytest.approx(0.0, abs=1e-9)
    left = angle_error_deg(*sensor.correction, recording)
    corrected = simulate.fibonacci(400) @ sensor.rotation.T
    angles = np.degrees(np.arccos(np.clip(np.sum(corrected * simulate.fibonacci(400), axis=1), -1, 1)))
    assert left == pytest.approx(np.sqrt(np.mean(angles**2)), abs=1e-5)


@given(seeds, motions, counts, disturbances(), st.floats(0, 1))
def test_disturbances_add_to_the_readings_and_touch_nothing_else(
    seed: int, motion: str, n: int, several: list[Perturbation], stationary: float
) -> None:
    plain = tumble(seed, motion=motion, n=n, stationary=stationary)
    disturbed = tumble(seed, motion=motion, n=n, stationary=stationary, disturbances=several)
    assert_same(disturbed, tumble(seed, motion=motion, n=n, stationary=stationary, disturbances=several))
    npt.assert_array_equal(disturbed.directions, plain.directions)
    shift = np.zeros((n, 3)) if disturbed.shift is None else disturbed.shift
    npt.assert_allclose(disturbed.samples.field, plain.samples.field + shift, atol=1e-9)
    assert len(disturbed.samples) == n
    for column, kind in ((disturbed.samples.current, MotorCurrent), (disturbed.samples.temperature, ThermalDrift)):
        assert (column is not None) == any(isinstance(one, kind) for one in several)


@given(sensors(), seeds, st.floats(0.1, 1000.0), st.floats(-90, 90))
def test_a_truth_is_read_as_it_was_written(sensor: Sensor, seed: int, strength: float, dip_deg: float) -> None:
    written = Truth.of(tumble(seed, n=3, sensor=sensor, field_strength=strength, dip_deg=dip_deg))
    assert loads(dumps(written)) == written


@given(arrays(np.float64, (5, 3), elements=st.floats(-1.8, 1.8)))
def test_rotation_vectors_are_the_inverse_of_turns(vectors: Floats) -> None:
    npt.assert_allclose(simulate.rotation_vectors(simulate.turns(vectors)), vectors, atol=1e-7)
