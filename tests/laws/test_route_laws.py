"""A plan knows neither units nor the names of axes, and more readings never make it worse."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.trials import examples

from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.sphere import fibonacci
from flinders.heading import path_planning
from flinders.heading.error_propagation import direction_errors_deg
from flinders.likelihood import magnitude


def belief(seed: int, scale: float = 1.0) -> path_planning.Belief:
    """What a few readings, all on one side, say of an ellipsoid."""
    rng = np.random.default_rng(seed)
    departure = 0.1 * rng.standard_normal((3, 3))
    ellipsoid = Ellipsoid(scale * rng.normal(size=3), 50.0 * scale * (np.eye(3) + 0.5 * (departure + departure.T)))
    seen = np.abs(rng.standard_normal((40, 3)))
    jacobian = magnitude.information(seen / np.linalg.norm(seen, axis=1, keepdims=True), ellipsoid)
    prior = np.diag(1.0 / np.repeat([50.0, 15.0], [3, 6]) ** 2)
    return path_planning.Belief(
        ellipsoid, scale**2 * np.linalg.inv(prior + jacobian.T @ jacobian / 0.25), scale**2 * 0.25
    )


seeds = st.integers(0, 10_000)


@examples(20)
@given(seeds, st.sampled_from([1e-6, 0.01, 1000.0]))
def test_the_unit_does_not_matter(seed: int, scale: float) -> None:
    one, other = (path_planning.plan(belief(seed, each), [0.0, 0.0, 1.0], goal="attitude") for each in (1.0, scale))
    assert_allclose(one.after_deg, other.after_deg, rtol=1e-5)
    assert_allclose(one.waypoints, other.waypoints)


@examples(20)
@given(seeds)
def test_waypoints_are_directions_and_the_way_helps(seed: int) -> None:
    way = path_planning.plan(belief(seed), np.random.default_rng(seed).standard_normal(3), goal="attitude")
    assert_allclose(np.linalg.norm(way.waypoints, axis=1), 1.0)
    assert 1 <= len(way.waypoints) <= 6
    assert way.after_deg <= way.worst_deg * (1.0 + 1e-9)
    assert way.words("vehicle")
    assert way.words("sensor")


@examples(20)
@given(seeds)
def test_the_end_of_a_way_is_what_the_inverse_of_the_information_gives(seed: int) -> None:
    known = belief(seed)
    way = path_planning.plan(known, [0.0, 0.6, 0.8], goal="attitude")
    information = np.linalg.inv(known.covariance)
    for here, there in pairwise([way.start, *way.waypoints]):
        angle = np.arccos(here @ there)
        share = np.array([[0.125], [0.375], [0.625], [0.875]])
        places = (np.sin((1.0 - share) * angle) * here + np.sin(share * angle) * there) / np.sin(angle)
        jacobian = magnitude.information(places, known.ellipsoid)
        readings = path_planning.READINGS_PER_DEG * np.degrees(angle)
        information += jacobian.T @ jacobian * readings / 4.0 / known.variance
    errors = direction_errors_deg(known.ellipsoid, np.linalg.inv(information), fibonacci(50))
    assert_allclose(way.after_deg, errors.max(), rtol=1e-9)


@examples(20)
@given(seeds, st.floats(1.1, 10.0))
def test_better_readings_never_make_it_worse(seed: int, factor: float) -> None:
    known = belief(seed)
    worse = replace(known, variance=known.variance * factor)
    one, other = (
        path_planning.plan(each, [1.0, 0.0, 0.0], goal="attitude", target_deg=1e-6) for each in (known, worse)
    )
    assert one.after_deg <= other.after_deg * 1.02  # two beams may keep different walks


@examples(30)
@given(seeds, st.floats(70.0, 350.0), st.floats(1.0, 500.0))
def test_rough_moves_and_grows_with_the_readings(seed: int, arc_deg: float, scale: float) -> None:
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, np.radians(arc_deg), 50)[:, np.newaxis]
    x, y = np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
    arc = np.cos(angle) * x + np.sin(angle) * y
    offset = rng.uniform(-2.0, 2.0, 3)
    found = path_planning.rough_belief(scale * (arc + offset))
    assert found is not None
    assert_allclose(found.ellipsoid.centre, scale * offset, atol=1e-6 * scale)
    assert_allclose(found.ellipsoid.shape, scale * np.eye(3), atol=1e-6 * scale)
