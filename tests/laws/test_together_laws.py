"""Laws of several magnetometers: names, orders, axes and units change what they should, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples

from flinders import simulate
from flinders.comparison.agreement import disagreements
from flinders.core.time_alignment import interpolate_readings
from flinders.estimators.multi_sensor import fit_sensors, mirror_or_rotation
from flinders.geometry.rotation import rotations

seeds: Final = st.integers(0, 1000)


def fields_of(seed: int, sensors: int = 3, n: int = 200) -> np.ndarray:
    rng = np.random.default_rng(seed)
    directions = simulate.tumble(seed=seed, motion="uniform", n=n).directions
    turns = rotations(rng.normal(size=(sensors, 3)))
    own = [replace(simulate.Sensor.random(rng), noise=0.5) for _ in range(sensors)]
    return np.stack([each.read(50.0 * directions @ turn, rng) for each, turn in zip(own, turns, strict=True)])


@given(seeds)
@examples(2)
def test_the_reference_is_a_matter_of_axes(seed: int) -> None:
    """Whichever is the reference: ellipsoids, their covariance and the rotation between two are the same."""
    fields = fields_of(seed)
    one, other = fit_sensors(fields), fit_sensors(fields, reference=2)
    for sensor in range(3):
        ours, theirs = one.estimate(sensor), other.estimate(sensor)
        sigma = np.sqrt(np.diag(ours.covariance))
        npt.assert_array_less(np.abs(ours.ellipsoid.parameters - theirs.ellipsoid.parameters), 0.05 * sigma)
        npt.assert_allclose(np.diag(ours.covariance), np.diag(theirs.covariance), rtol=0.02)
    first, second = (each.rotation(1)[0].T @ each.rotation(0)[0] for each in (one, other))
    npt.assert_allclose(first, second, atol=1e-3)


@given(seeds)
@examples(2)
def test_the_order_of_the_sensors_does_not_matter(seed: int) -> None:
    fields = fields_of(seed)
    order = [0, 2, 1]
    one, other = fit_sensors(fields), fit_sensors(fields[order])
    for place, sensor in enumerate(order):
        npt.assert_allclose(other.parameters[place].offset, one.parameters[sensor].offset, atol=1e-2)
        npt.assert_allclose(other.rotation(place)[0], one.rotation(sensor)[0], atol=1e-3)


@given(seeds, st.sampled_from([1e-3, 0.1, 16.0]))
@examples(2)
def test_a_sensor_in_another_unit_is_the_same_sensor(seed: int, unit: float) -> None:
    fields = fields_of(seed, 2)
    scaled = fields * np.array([1.0, unit])[:, np.newaxis, np.newaxis]
    one, other = fit_sensors(fields), fit_sensors(scaled)
    npt.assert_allclose(other.parameters[1].offset, unit * one.parameters[1].offset, rtol=2e-3, atol=2e-2 * unit)
    npt.assert_allclose(np.diag(other.of(1))[:9], unit**2 * np.diag(one.of(1))[:9], rtol=0.05)
    npt.assert_allclose(other.rotation(1)[0], one.rotation(1)[0], atol=1e-3)


@given(seeds)
@examples(2)
def test_turning_a_sensor_turns_its_rotation(seed: int) -> None:
    fields = fields_of(seed, 2)
    turn = rotations(np.random.default_rng(seed).normal(size=(1, 3)))[0]
    one, other = fit_sensors(fields), fit_sensors(np.stack([fields[0], fields[1] @ turn]))
    npt.assert_allclose(other.rotation(1)[0], one.rotation(1)[0] @ turn, atol=2e-3)
    npt.assert_allclose(np.diag(other.rotation(1)[1]), np.diag(one.rotation(1)[1]), rtol=0.1)


@given(seeds, st.booleans())
@examples(20)
def test_directions_tell_their_rotation_or_mirror_image(seed: int, mirrored: bool) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(20, 3))
    turn = rotations(rng.normal(size=(1, 3)))[0] * (-1.0 if mirrored else 1.0)
    npt.assert_allclose(mirror_or_rotation(directions, directions @ turn.T), turn, atol=1e-9)


@given(seeds)
@examples(20)
def test_readings_at_their_own_moments_are_themselves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.01, 0.02, 50))
    field = rng.normal(size=(50, 3))
    npt.assert_allclose(interpolate_readings(time, field, time), field, atol=1e-9)
    assert np.isnan(interpolate_readings(time, field, np.array([time[0] - 1.0, time[-1] + 1.0]))).all()


@given(seeds, st.permutations(range(3)))
@examples(20)
def test_departures_go_with_the_sensor_and_not_with_its_place(seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    q = simulate.tumble(seed=seed, motion="hand", n=500).directions
    seen = np.stack([q + rng.normal(scale=0.005, size=q.shape) for _ in range(3)])
    seen[0, 200:300] += rng.normal(size=3)
    time = np.arange(500) / 50.0
    plain = [replace(run, sensor=None) for run in disagreements(seen, time)]
    moved = disagreements(seen[order], time)
    assert [replace(run, sensor=None) for run in moved] == plain
    assert {run.sensor for run in moved} == {order.index(0)}


def test_sensors_that_agree_to_the_bit_do_not_depart() -> None:
    q = np.random.default_rng(1).normal(size=(100, 3))
    assert disagreements(np.stack([q, q, q]), np.arange(100.0)) == ()
