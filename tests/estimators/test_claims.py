"""What each term claims is true: errors over claimed standard deviations have no mean, and a mean square of one.

Thirty trials a term by ``pytest -m claims``;
200 of each, on three motions, in ``python -m benchmarks.terms --tables nees``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import daily

from flinders import simulate
from flinders.estimators.aiding import fit_aided
from flinders.geometry.ellipsoid import upper_entries
from flinders.geometry.quaternions import from_matrix
from flinders.geometry.rotation import rotation_vectors
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

READINGS, ATTITUDE_DEG = 500, 1.5


def drawn(seed: int) -> tuple[simulate.Simulated, Floats, Site]:
    """A vehicle that leans, an attitude (N, 4) as a rough log tells it, and a site known to 1 % and a degree."""
    rng = np.random.default_rng([7, seed])
    sensor = simulate.Sensor.random(rng)
    sensor = replace(sensor, matrix=3.0 * sensor.matrix / np.trace(sensor.matrix))
    imu = simulate.Imu(gyro_bias=rng.normal(0.0, 0.01, 3))
    true = simulate.tumble(rng, motion="swayed", n=READINGS, rate_hz=READINGS / 60.0, sensor=sensor, imu=imu)
    assert true.attitudes is not None
    shaken = simulate.turns(rng.normal(0.0, np.radians(ATTITUDE_DEG), (READINGS, 3)))
    attitude = from_matrix(true.attitudes @ shaken)
    strength, dip = 50.0 * (1.0 + rng.normal(0.0, 0.01)), 60.0 + rng.normal(0.0, 1.0)
    return true, attitude, Site(strength, dip, gain_sigma=0.01, inclination_sigma_deg=1.0)


def scores(seed: int, terms: tuple[str, ...], *, is_known: bool) -> Floats:
    """(9 or 12,) errors of offset, shape and rotation in their claimed standard deviations."""
    true, attitude, site = drawn(seed)
    found = fit_aided(replace(true.samples, attitude=attitude), terms, site=site if is_known else None)
    at = found.parameters
    errors = np.concatenate([at.offset - true.sensor.offset, upper_entries(at.shape - 50.0 * true.sensor.matrix)])
    if "rotation" in found.layout:
        errors = np.concatenate([errors, rotation_vectors(at.rotation[np.newaxis])[0]])
    return errors / np.sqrt(np.diag(found.covariance)[: len(errors)])


@pytest.mark.parametrize(
    ("terms", "is_known"),
    daily([((), True), (("dip",), False), (("tilt",), False), (("attitude",), False), (("rate", "attitude"), True)], 4),
)
def test_errors_are_as_large_as_claimed(terms: tuple[str, ...], is_known: bool, trials: Choose) -> None:
    claim = trials(30, 8)
    found = np.array([scores(seed, terms, is_known=is_known) for seed in claim.seeds])
    low, high = claim.ratios(0.65, 1.4)
    assert np.abs(found.mean(axis=0)).max() < 4.0 / np.sqrt(claim.count)
    assert low < np.mean(found**2) < high
