"""The noise of a gyro, drawn many times: the mean gradient it makes is the one that is removed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest

from flinders.geometry.rotation import rotations
from flinders.likelihood import gyro
from flinders.likelihood import gyro_noise as walked
from flinders.likelihood.observations import ObservationGroup, Weights, rows_of
from flinders.likelihood.parameters import ParameterLayout, Parameters

if TYPE_CHECKING:
    from flinders.arrays import Floats

DRAWS, EACH_S, STEP = 200, 0.1, 5e-3
"""Pairs of mirrored draws, the time between readings in s, and a gyro's noise in a step in rad."""


@pytest.mark.nightly
def test_the_mean_gradient_of_a_gyro_s_noise_is_that_of_its_draws() -> None:
    """Two windows of twelve readings, without any other noise; mirrored pairs take the first order out."""
    rng = np.random.default_rng(0)
    rate, interval = rng.normal(size=(2, 1, 3)) + 0.3 * rng.normal(size=(2, 12, 3)), np.full((2, 12), EACH_S)
    shape = np.array([[55.0, 4.0, 2.0], [4.0, 45.0, 1.0], [2.0, 1.0, 60.0]])
    mounted = rotations(np.array([[0.2, -0.1, 0.3]]))[0]
    at = replace(Parameters.at(np.array([3.0, -2.0, 5.0]), shape), rotation=mounted)
    layout, weights = ParameterLayout.of(rotation=True, gyro_bias=True), Weights(1.0)
    directions: Floats = rng.normal(size=(2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    still = gyro.integrated(rate, interval, at.gyro_bias, at.gyro_scale)
    seen = np.einsum("wnji,wj->wni", still.rotations, directions)
    field = at.offset + seen @ at.ellipsoid_like.T

    def gradient(noise: Floats) -> Floats:
        turned = gyro.integrated(rate + noise / EACH_S, interval, at.gyro_bias, at.gyro_scale)
        group, towards = replace(ObservationGroup.of(field), turned=turned), directions
        for _ in range(3):
            part = group.linearised(at, towards, layout, weights)
            towards = part.follow(towards, np.zeros(layout.size))
        return group.linearised(at, towards, layout, weights).gradient

    noise = STEP * rng.normal(size=(DRAWS, 2, 12, 3))
    pairs = np.array([0.5 * (gradient(one) + gradient(-one)) for one in noise])
    group = replace(ObservationGroup.of(field), turned=still)
    rows = rows_of(group, at, directions, layout, weights)
    whole = walked.Walked.of(rows, walked.pushes(group, at, directions, weights))
    expected = STEP**2 * walked.mean_gradient(whole, group, at, directions, layout, weights)
    scatter = pairs.std(axis=0) / np.sqrt(DRAWS)
    npt.assert_array_less(np.abs(pairs.mean(axis=0) - expected), 4.0 * scatter + 0.03 * np.abs(expected).max())
    assert np.abs(expected[:9] / scatter[:9]).max() > 10.0  # and it is there
