"""Whether an offset that wanders is followed, and one that does not is left alone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from scipy.linalg import block_diag
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.core.compensation import Compensator
from flinders.diagnostics.random_walk import (
    RandomWalk,
    _run_filter,
    _run_smoother,
    _Spans,
    random_walk_of,
    walk_through,
)
from flinders.errors import NeedsSamples, TooFewSamples
from flinders.estimators.disturbance import fit_disturbances
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid


def settled(samples: Samples) -> Ellipsoid:
    """The ellipsoid of a fit, also of one that is refused for having changed."""
    try:
        return flinders.fit(samples).calibration.ellipsoid
    except Refused as refused:
        return refused.fit.calibration.ellipsoid


def test_a_walk_is_found_with_a_path_that_is_as_good_as_claimed() -> None:
    """Seeds 0 to 5, 0.02 µT a reading at 50 Hz: nees of the path 0.99 in 60 trials, q 12 % too small."""
    nees, sizes = [], []
    for seed in range(6):
        simulated = simulate.tumble(seed=seed)
        moved = np.cumsum(np.random.default_rng(seed).normal(scale=0.02, size=(3000, 3)), axis=0)
        moved -= moved.mean(axis=0)
        time = simulated.samples.time
        assert time is not None
        walk = random_walk_of(simulated.samples.field + moved, time, settled(simulated.samples))
        assert walk.is_proven
        true = np.stack([np.interp(walk.time, time, axis) for axis in moved.T], axis=1)
        nees.append(np.mean(((walk.path - true) / walk.sigma) ** 2))
        sizes.append(walk.random_walk_per_root_s)
    assert 0.5 < np.mean(nees) < 1.7
    assert np.median(sizes) == pytest.approx(0.02 * np.sqrt(50.0), rel=0.3)


def test_an_offset_that_stays_is_said_to_stay() -> None:
    """No false alarm in 60 seeds, of which these are six."""
    for seed in range(6):
        samples = simulate.tumble(seed=seed).samples
        walk = walk_through(samples, settled(samples))
        assert not walk.is_proven
        assert "did not move" in walk.words("µT")
        assert walk.valid_for_s(1.0) > 60.0


def test_a_step_shows_when_it_came_and_how_far() -> None:
    simulated = simulate.tumble(seed=3, disturbances=[simulate.Step([3.0, 0.0, -2.0], at=0.5)])
    walk = walk_through(simulated.samples, settled(simulated.samples))
    assert walk.is_proven
    assert walk.offset_change == pytest.approx(np.hypot(3.0, 2.0), abs=0.5)
    far = np.linalg.norm(walk.path - walk.path[0], axis=1)
    halfway = walk.time[np.argmax(far > walk.offset_change / 2.0)]
    assert halfway == pytest.approx(30.0, abs=6.0)
    bars = walk.to_bars(20)
    assert bars[0] == "▁"
    assert bars[-1] == "█"


def test_a_calibration_is_valid_for_longer_at_a_coarser_level() -> None:
    simulated = simulate.tumble(seed=3, disturbances=[simulate.ThermalDrift([0.2, 0.0, -0.1])])
    walk = walk_through(simulated.samples, settled(simulated.samples))
    assert walk.valid_for_s(2.0) == pytest.approx(4.0 * walk.valid_for_s(1.0), rel=0.01)
    assert walk.as_dict()["is_proven"] is True


def test_what_motors_do_is_no_drift_once_modelled_and_a_drift_is_still_seen() -> None:
    motors = simulate.MotorCurrent([0.5, 0.0, -0.3])
    for drift in (0.0, 4.0):
        samples = simulate.tumble(seed=4, n=2000, disturbances=[motors]).samples
        assert samples.time is not None
        moved = samples.field + drift * np.outer((samples.time / samples.time[-1]) ** 2, [1.0, 0.0, 0.0])
        drifting = replace(samples, field=moved)
        found = fit_disturbances([drifting], ("current",))
        walk = walk_through(Compensator(found.calibration)(drifting), found.ellipsoid)
        assert walk.is_proven == (drift > 0.0)
        assert (walk.as_dict(level_deg=2.0)["valid_for_s"] or np.inf) == walk.valid_for_s(2.0)


def test_a_level_turn_tells_of_the_plane_that_it_was_turned_in() -> None:
    """Its offset stays or steps by 3 µT, and what z reads says nothing."""
    for step in (0.0, 3.0):
        samples = simulate.tumble(seed=3, motion="level", n=2000).samples
        fit = flinders.fit(samples)
        assert samples.time is not None
        late = samples.time > samples.time[-1] / 2.0
        readings = samples.field + np.outer(late, [step, 0.0, 0.0]) + [0.0, 0.0, 40.0]
        walk = random_walk_of(
            readings,
            samples.time,
            fit.calibration.ellipsoid,
            plane=fit.claim.plane,
            dip_deg=fit.heading_error_deg.dip_deg,
        )
        assert walk.is_proven == (step > 0.0)
        assert np.ptp(walk.path[:, 0]) == pytest.approx(step, abs=0.5)
        assert np.abs(walk.path[:, 1:]).max() < 0.3


def test_where_nothing_is_proven_the_band_is_as_wide_as_what_was_not_seen() -> None:
    """Walks of 0.001 µT a reading: one of twelve is proven, and of the others the mean square in bands is 0.66."""
    nees = []
    for seed in range(4):
        simulated = simulate.tumble(seed=seed)
        moved = np.cumsum(np.random.default_rng(seed).normal(scale=0.001, size=(3000, 3)), axis=0)
        moved -= moved.mean(axis=0)
        time = simulated.samples.time
        assert time is not None
        walk = random_walk_of(simulated.samples.field + moved, time, settled(simulated.samples))
        assert not walk.is_proven
        assert walk.offset_change == 0.0
        true = np.stack([np.interp(walk.time, time, axis) for axis in moved.T], axis=1)
        nees.append(np.mean(((walk.path - true) / walk.sigma) ** 2))
    assert 0.1 < np.mean(nees) < 1.3


def test_sizes_of_a_walk_are_as_likely_as_the_whole_covariance_of_its_path_makes_them() -> None:
    """Against one Gaussian of all spans at once: cov b = P₀ + q² min(tᵢ, tⱼ), and g = N b + noise of covariance N."""
    rng = np.random.default_rng(2)
    normals, time, radius = rng.normal(size=(8, 5, 3)), np.arange(8.0) * 3.0, 20.0
    spans = _Spans(time, np.einsum("kni,knj->kij", normals, normals), rng.normal(size=(8, 3)) * 3.0)
    sizes = np.array([0.0, 0.1, 1.0, 5.0])
    found = _run_filter(spans, sizes, radius)
    smooth, covariances = _run_smoother(found)
    information = block_diag(*spans.information)
    for place, q in enumerate(sizes):
        prior = np.kron((0.1 * radius) ** 2 + q**2 * np.minimum.outer(time, time), np.eye(3))
        wider = np.eye(24) + prior @ information
        told = np.linalg.solve(wider, prior)
        gradient = spans.gradient.ravel()
        expected = 0.5 * (gradient @ told @ gradient - np.linalg.slogdet(wider)[1])
        assert found.likelihood[place] == pytest.approx(expected, rel=1e-9)
        npt.assert_allclose(smooth[:, place].ravel(), told @ gradient, rtol=1e-7, atol=1e-9)
        sigma = np.einsum("kii->ki", covariances[:, place]).ravel()
        npt.assert_allclose(sigma, np.diag(told), rtol=1e-7)


def test_without_times_or_with_few_readings_nothing_is_said() -> None:
    samples = simulate.tumble(seed=1, n=300).samples
    ellipsoid = settled(samples)
    with pytest.raises(NeedsSamples):
        random_walk_of(samples.field, None, ellipsoid)
    assert samples.time is not None
    with pytest.raises(TooFewSamples):
        random_walk_of(samples.field[:50], samples.time[:50], ellipsoid)


def test_where_a_large_walk_would_not_show_it_is_not_said_that_the_offset_stayed() -> None:
    """What a walk could have been at the most, over 100 s, against 1° of a level field of 25 µT: 0.44 µT."""
    time, path = np.linspace(0.0, 100.0, 11), np.zeros((11, 3))
    within, beyond = (RandomWalk(0.0, q, 0.0, time, path, path, 50.0) for q in (0.03, 0.06))
    assert (within.is_determined(1.0), beyond.is_determined(1.0), beyond.is_determined(2.0)) == (True, False, True)
    assert_sentences(within.words("µT"))
    assert_sentences(beyond.words("µT"))
    assert beyond.as_dict()["is_determined"] is False
    assert RandomWalk(0.1, 0.2, 9.0, time, path, path, 50.0).is_determined(1.0)
