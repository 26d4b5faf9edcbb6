"""The noise of a gyro, drawn many times: the mean gradient it makes is the one that is removed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest

from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.rotation import perpendicular_vectors, rotations
from flinders.likelihood import gyro
from flinders.likelihood import gyro_noise as walked
from flinders.likelihood.observations import ObservationGroup, Weights, residual_rows
from flinders.likelihood.parameters import ParameterLayout, Parameters

if TYPE_CHECKING:
    from flinders.arrays import Floats

DRAWS, EACH_S, STEP = 200, 0.1, 5e-3
"""Pairs of mirrored draws, the time between readings in s, and a gyro's noise in a step in rad."""


ERRORS = np.array([0.02, -0.01, 0.03, 0.02, -0.03, 0.01, 0.01, -0.02, 0.01])
"""Of an accelerometer: bias and gains."""


@pytest.mark.nightly
@pytest.mark.parametrize("is_upright", [False, True])
def test_the_mean_gradient_of_a_gyro_s_noise_is_that_of_its_draws(is_upright: bool) -> None:
    """Two windows of twelve readings, without or with verticals; mirrored pairs take the first order out."""
    rng = np.random.default_rng(0)
    rate, interval = rng.normal(size=(2, 1, 3)) + 0.3 * rng.normal(size=(2, 12, 3)), np.full((2, 12), EACH_S)
    shape = np.array([[55.0, 4.0, 2.0], [4.0, 45.0, 1.0], [2.0, 1.0, 60.0]])
    mounted = rotations(np.array([[0.2, -0.1, 0.3]]))[0]
    at = replace(Parameters.at(np.array([3.0, -2.0, 5.0]), shape), rotation=mounted, sine=0.8)
    layout = ParameterLayout.of(
        rotation=True, gyro_bias=True, gyro_scale=True, gyro_turn=True, sine=is_upright, accelerometer=is_upright
    )
    weights = Weights(1.0, vertical=0.01)
    directions: Floats = rng.normal(size=(2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    still = gyro.integrate_rates(rate, interval, at.gyro_bias, at.gyro)
    seen = np.einsum("wnji,wj->wni", still.rotations, directions)
    group = ObservationGroup.of(at.offset + seen @ at.rotated_shape.T)
    if is_upright:
        at = replace(at, accelerometer=ERRORS)
        down = _felt(_verticals(still.rotations, directions, at.sine), at.accelerometer)
        group = replace(group, down=down, trust=np.ones((2, 12)))

    def gradient(noise: Floats) -> Floats:
        turned = gyro.integrate_rates(rate + noise / EACH_S, interval, at.gyro_bias, at.gyro)
        noisy, towards = replace(group, turned=turned), directions
        for _ in range(3):
            part = noisy.linearize(at, towards, layout, weights)
            towards = part.follow(towards, np.zeros(layout.size))
        return noisy.linearize(at, towards, layout, weights).gradient

    noise = STEP * rng.normal(size=(DRAWS, 2, 12, 3))
    pairs = np.array([0.5 * (gradient(one) + gradient(-one)) for one in noise])
    group = replace(group, turned=still)
    rows = residual_rows(group, at, directions, layout, weights)
    whole = walked.WalkStatistics.of(rows, walked.rotation_derivatives(group, at, directions, weights))
    expected = STEP**2 * walked.mean_gradient(whole, group, at, directions, layout, weights)
    scatter = pairs.std(axis=0) / np.sqrt(DRAWS)
    for block, columns in layout.columns.items():
        found, of_block = pairs.mean(axis=0)[columns], expected[columns]
        npt.assert_array_less(np.abs(found - of_block), 4.0 * scatter[columns] + 0.03 * np.abs(of_block).max(), block)
    assert np.abs(expected[:9] / scatter[:9]).max() > 10.0  # and it is there


def _verticals(turned: Floats, directions: Floats, sine: float) -> Floats:
    """(W, n, 3) verticals at the readings of windows, of one vertical in each to which the field has the sine."""
    aside = perpendicular_vectors(directions)[..., 0]
    down = sine * directions + np.sqrt(1.0 - sine**2) * aside
    verticals: Floats = np.einsum("wnji,wj->wni", turned, down)
    return verticals


def _felt(down: Floats, errors: Floats) -> Floats:
    """(W, n, 3) unit vectors that an accelerometer of some errors makes of verticals."""
    felt: Floats = down @ np.linalg.inv(np.eye(3) + symmetric_matrix(errors[3:])) - errors[:3]
    felt /= np.linalg.norm(felt, axis=2, keepdims=True)
    return felt
