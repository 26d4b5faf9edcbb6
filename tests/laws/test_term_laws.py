"""Laws of the observation terms: Jacobians are how residuals change, elimination is what the whole system says."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples

from flinders.geometry.rotation import rotations, step_on_sphere
from flinders.likelihood import gyro
from flinders.likelihood.dip import fill_dip
from flinders.likelihood.observations import (
    ObservationGroup,
    Weights,
    eliminate_directions,
    residual_rows,
    unweighted_residuals,
)
from flinders.likelihood.parameters import ParameterLayout, Parameters

if TYPE_CHECKING:
    from collections.abc import Callable

TURNED = partial(
    ParameterLayout.of,
    rotation=True,
    gyro_bias=True,
    gyro_scale=True,
    gyro_turn=True,
    delay=True,
)
LAYOUT = TURNED(accelerometer=True, sine=True)
POINTED = TURNED(direction=True)
WEIGHTS = Weights(0.5, 0.004)
STEP = 1e-6


def group(seed: int, windows: int = 3, n: int = 5) -> ObservationGroup:
    """Readings with everything beside them."""
    rng = np.random.default_rng(seed)
    plain = ObservationGroup.of(rng.normal(scale=40.0, size=(windows, n, 3)))
    down = rng.normal(size=(windows, n, 3))
    return replace(
        plain,
        turned=gyro.integrate_rates(rng.normal(size=(windows, n, 3)), np.full((windows, n), 0.02), np.zeros(3)),
        down=down / np.linalg.norm(down, axis=2, keepdims=True),
        trust=rng.uniform(0.2, 1.0, size=(windows, n)),
    )


def with_attitudes(seed: int) -> ObservationGroup:
    """The same with attitudes in place of verticals."""
    plain = group(seed)
    vectors = np.random.default_rng(seed).normal(size=(plain.weight.size, 3))
    return replace(plain, down=None, attitudes=rotations(vectors).reshape(*plain.weight.shape, 3, 3))


def somewhere(seed: int) -> Parameters:
    rng = np.random.default_rng(seed)
    plain = Parameters.at(rng.normal(scale=5.0, size=3), 50.0 * np.eye(3) + np.diag(rng.normal(size=3)))
    turned = rotations(rng.normal(scale=0.3, size=(1, 3)))[0]
    scale = rng.normal(scale=0.02, size=6)
    lean = 0.03 * rng.standard_normal(3)
    return replace(
        plain, rotation=turned, sine=0.7, gyro_scale=scale, gyro_turn=0.5 * lean,
        accelerometer=np.concatenate([lean, scale]),
    )  # fmt: skip


@given(st.integers(0, 10_000), st.sampled_from([(group, LAYOUT), (with_attitudes, POINTED)]))
@examples(20)
def test_jacobians_are_how_residuals_change(
    seed: int, kind: tuple[Callable[[int], ObservationGroup], ParameterLayout]
) -> None:
    draw, layout = kind
    at = somewhere(seed)
    readings = draw(seed).at(at)
    directions = readings.guess(at)
    rows = residual_rows(readings, at, directions, layout, WEIGHTS)

    def residual(step: np.ndarray, own: np.ndarray | None = None) -> np.ndarray:
        moved = at.take_step(step, layout)
        towards = directions if own is None else step_on_sphere(directions, np.tile(own, (len(directions), 1)))
        taken = readings.at(moved)
        of_field, beside = unweighted_residuals(taken, moved, towards)
        assert beside is not None
        assert taken.trust is not None
        weighed = beside * np.sqrt(taken.trust)[..., None] / WEIGHTS.vertical
        return np.swapaxes(np.concatenate([of_field / WEIGHTS.noise, weighed], axis=2), 1, 2)

    unexpected = layout.columns.get("accelerometer", slice(0, 0))  # is taken where residual and field agree, see below
    for column, unit in enumerate(np.eye(layout.size)):
        if unexpected.start <= column < unexpected.stop:
            continue
        wanted = (residual(-STEP * unit) - residual(STEP * unit)) / (2 * STEP)
        npt.assert_allclose(rows.jacobian[..., column], wanted, atol=2e-5 * max(1.0, np.abs(wanted).max()))
    nothing = np.zeros(layout.size)
    for column, direction in enumerate(np.eye(2)):
        wanted = (residual(nothing, -STEP * direction) - residual(nothing, STEP * direction)) / (2 * STEP)
        npt.assert_allclose(rows.own[..., column], wanted, atol=2e-5 * np.abs(wanted).max())


@given(st.integers(0, 10_000))
@examples(20)
def test_the_jacobian_of_an_accelerometer_is_how_residuals_change(seed: int) -> None:
    """Where vertical and field agree."""
    at, readings = somewhere(seed), group(seed)
    at = replace(at, accelerometer=0.01 * at.accelerometer)
    directions = readings.guess(at)
    q = readings.at(at).rotated_directions(at, directions)[0]
    aside = np.cross(q, [0.3, -0.5, 0.8])
    aside /= np.linalg.norm(aside, axis=2, keepdims=True)
    down = at.sine * q + np.sqrt(1.0 - at.sine**2) * aside
    agreed = replace(readings, down=down).at(at)

    def residual(step: np.ndarray) -> np.ndarray:
        beside = unweighted_residuals(agreed, at.take_step(step, LAYOUT), directions)[1]
        assert beside is not None
        return beside[..., 0]

    jacobian = np.empty((3, 5, LAYOUT.size))
    fill_dip(jacobian, LAYOUT.columns, down, q, sine=at.sine, errors=at.accelerometer, of_gyro=slice(0), moved=None)
    columns = LAYOUT.columns["accelerometer"]
    for column in range(columns.start, columns.stop):
        step = STEP * np.eye(LAYOUT.size)[column]
        wanted = (residual(-step) - residual(step)) / (2 * STEP)
        npt.assert_allclose(
            jacobian[..., column], wanted, atol=2e-3
        )  # errors of 3e-4 and less are left in the residual


@given(st.integers(0, 10_000))
@examples(20)
def test_elimination_leaves_what_the_whole_system_says(seed: int) -> None:
    readings, at = group(seed), somewhere(seed)
    rows = residual_rows(readings, at, readings.guess(at), LAYOUT, WEIGHTS)
    few = eliminate_directions(rows)
    windows, size = len(rows.residual), LAYOUT.size
    wide = np.zeros((windows, rows.residual[0].size, size + 2 * windows))
    wide[..., :size] = rows.jacobian.reshape(windows, -1, size)
    for index in range(windows):
        wide[index, :, size + 2 * index : size + 2 * index + 2] = rows.own[index].reshape(-1, 2)
    full = wide.reshape(-1, wide.shape[-1])
    damped = full.T @ full + 1e-6 * np.eye(full.shape[1])  # 60 rows for 41 unknowns, and not all are seen
    covariance = np.linalg.inv(damped)[:size, :size]
    npt.assert_allclose(np.linalg.inv(few.matrix + 1e-6 * np.eye(size)), covariance, rtol=2e-3, atol=1e-3)


def test_the_order_of_windows_does_not_matter() -> None:
    readings, at = group(1), somewhere(1)
    directions = readings.guess(at)
    whole = readings.linearize(at, directions, LAYOUT, WEIGHTS)
    parts = [readings.chunk(slice(i, i + 1)).linearize(at, directions[i : i + 1], LAYOUT, WEIGHTS) for i in range(3)]
    npt.assert_allclose(sum(part.matrix for part in parts), whole.matrix, atol=1e-6 * np.abs(whole.matrix).max())
    assert sum(part.cost for part in parts) == pytest.approx(whole.cost)
    assert readings.cost(at, directions, WEIGHTS) == pytest.approx(whole.cost)


@given(st.integers(0, 10_000), st.integers(2, 40))
def test_integration_is_the_product_of_its_steps(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    rate, interval, bias = rng.normal(size=(1, n, 3)), rng.uniform(0.01, 0.05, (1, n)), rng.normal(scale=0.1, size=3)
    turned = gyro.integrate_rates(rate, interval, bias)
    attitude = np.eye(3)
    for k in range(n):
        npt.assert_allclose(turned.rotations[0, k], attitude, atol=1e-12)
        attitude = attitude @ rotations(((rate[0, k] - bias) * interval[0, k])[None])[0]


@given(st.integers(0, 10_000))
def test_a_small_change_of_bias_and_scales_is_taken_to_first_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turned = gyro.integrate_rates(rng.normal(size=(2, 20, 3)), np.full((2, 20), 0.02), np.zeros(3))
    bias, scale = rng.normal(scale=1e-3, size=3), rng.normal(scale=1e-3, size=6)
    exact = gyro.integrate_rates(turned.rate, turned.interval, bias, scale)
    npt.assert_allclose(turned.with_gyro(bias, scale).rotations, exact.rotations, atol=2e-5)
