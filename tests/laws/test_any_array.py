"""Whatever finite numbers `fit` is given, it gives a Fit or says why not with an error of its own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from tests.trials import examples

import flinders
from flinders import simulate
from flinders.core.samples import Joined, Samples
from flinders.errors import ArrayError, FitError
from flinders.estimators import METHODS

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

HUGE = [0.0, 1.0, -1.0, 5e-324, -2.2e-308, 1e-160, 1e-100, 1e77, -1e77, 1e150, -1e155, 1e300, -1.7e308, 1.79e308]
methods = st.sampled_from(sorted(METHODS))
sizes = st.integers(0, 30)
any_float = st.floats(allow_nan=False, allow_infinity=False)
powers = st.integers(-320, 290).map(lambda power: 10.0**power)
gentle = st.integers(-12, 12).map(lambda power: 10.0**power)
seeds = st.integers(0, 10_000)


@st.composite
def flat(draw: st.DrawFn) -> Floats:
    """Readings on a line, in a plane, on a ring, on two rings, or all alike, anywhere and turned anyhow."""
    n, rng = draw(sizes), np.random.default_rng(draw(seeds))
    kind = draw(st.sampled_from(["line", "plane", "ring", "rings", "constant", "turned"]))
    angle = rng.uniform(0, 2 * np.pi, n)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    field = {
        "line": rng.normal(size=(n, 1)) * [1.0, 2.0, -1.0],
        "plane": rng.normal(size=(n, 2)) @ rng.normal(size=(2, 3)),
        "ring": ring,
        "rings": ring + [0, 0, 1] * rng.choice([-0.5, 0.5], (n, 1)),
        "constant": np.ones((n, 3)),
        "turned": ring @ simulate.turns([[0.4, 0.5, 0.6]])[0],
    }[kind]
    return np.asarray(draw(gentle) * field + draw(gentle) * rng.normal(size=3), np.float64)


@st.composite
def repeated(draw: st.DrawFn) -> Floats:
    """A few readings, again and again."""
    rng, different = np.random.default_rng(draw(seeds)), draw(st.integers(1, 12))
    return draw(powers) * rng.normal(size=(different, 3))[rng.integers(0, different, draw(sizes))]


@st.composite
def spheres(draw: st.DrawFn) -> Floats:
    """Readings on a sphere of any size, up to a thousand million radii off, some nearly flat."""
    n, rng = draw(sizes), np.random.default_rng(draw(seeds))
    directions = simulate.uniform(rng, n) if n else np.empty((0, 3))
    directions[:, 2] *= draw(st.sampled_from([1.0, 0.1, 1e-6, 1e-12]))
    return np.asarray(draw(powers) * (directions + draw(gentle) * rng.normal(size=3)), np.float64).clip(-1e308, 1e308)


arrays_of_any_kind = st.one_of(
    sizes.flatmap(lambda n: arrays(np.float64, (n, 3), elements=any_float)),
    sizes.flatmap(lambda n: arrays(np.float64, (n, 3), elements=st.sampled_from(HUGE))),
    st.integers(8, 20).flatmap(lambda n: arrays(np.float64, (n, 3), elements=st.integers(-2, 2).map(float))),
    flat(),
    repeated(),
    spheres(),
)


CLOUD = simulate.tumble(seed=1, motion="uniform", n=60).samples.field
ANGLES = np.linspace(0.0, 6.0, 40)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.full(40, 0.5)], axis=1)


def attempt(field: Floats, method: str) -> Fit | None:
    """Fit; the errors of this package are an answer, and all others are not."""
    try:
        return flinders.fit(field, method=method)
    except (FitError, ArrayError):
        return None


@given(arrays_of_any_kind, methods)
@example(np.zeros((0, 3)), "auto")
@example(np.full((12, 3), 1e300), "auto")
@example(np.random.default_rng(0).normal(size=(50, 3)) * 1e300, "auto")
@example(np.random.default_rng(0).normal(size=(50, 3)) * 1e-300, "auto")
@example(np.random.default_rng(0).normal(size=(50, 3)) * [1e-150, 1.0, 1e150], "consistent")
@example(CLOUD[:57] + 1e10, "auto")  # so far off that rounding leaves their variances at 0
@example(np.vstack([CIRCLE, np.zeros((12, 3))]), "auto")  # what is not at a rail is all alike
@examples(600)
def test_any_finite_array_gives_a_fit_or_a_refusal(field: Floats, method: str) -> None:
    fit = attempt(field, method)
    if fit is not None:
        assert fit.verdict in ("good", "limited")
        for numbers in (fit.calibration.matrix, fit.calibration.offset, fit.covariance, fit.noise):
            assert np.isfinite(numbers).all()
        assert np.isfinite([fit.heading_error_deg.rms, fit.heading_error_deg.worst, fit.coverage.hole_deg]).all()
        assert fit.calibration.field_strength > 0
        assert repr(fit)
        assert fit.as_dict()["verdict"] == fit.verdict


@pytest.mark.parametrize("method", ["auto", "level", "ellipse", "two-axis"])
@given(arrays_of_any_kind)
@example(np.full((12, 3), 7.0))
@example(np.ones((12, 3)) * [1.0, 1.0, 1e300])
@examples(150)
def test_any_finite_array_gives_a_level_turn_or_a_refusal(method: str, field: Floats) -> None:
    """Laid flat, anything at all."""
    for height in (0.0, 1.0):
        laid = field * [1.0, 1.0, 0.0] + [0.0, 0.0, height]
        fit = attempt(laid, method)
        assert fit is None or fit.verdict == "limited"
        assert fit is None or np.isfinite(fit.covariance).all()


@given(arrays_of_any_kind, arrays_of_any_kind, methods)
@example(np.zeros((0, 3)), np.zeros((0, 3)), "auto")
@example(CLOUD, CLOUD, "auto")
@example(CLOUD, CLOUD[:1] * np.ones((30, 1)), "auto")
@example(CLOUD, 1e200 * CLOUD, "auto")
@example(CLOUD * [1.0, 1.0, 1e-9], CLOUD * [1.0, 1.0, 1e-9] + 3.0, "level")
@examples(300)
def test_any_two_finite_arrays_give_a_fit_or_a_refusal(one: Floats, other: Floats, method: str) -> None:
    """As recordings of one sensor, held against each other."""
    try:
        fit = flinders.fit(Joined((Samples.of(one), Samples.of(other))), method=method)
    except (FitError, ArrayError):
        return
    assert fit.verdict in ("good", "limited")
    assert np.isfinite(fit.covariance).all()
    assert fit.repeats is None or np.isfinite([part.off_deg for part in fit.repeats.parts]).all()
    assert json.dumps(fit.as_dict(), allow_nan=False)


@given(flat(), methods)
@examples(200)
def test_readings_in_one_plane_are_never_called_good(field: Floats, method: str) -> None:
    fit = attempt(field, method)
    assert fit is None or fit.verdict == "limited" or not is_flat(field)


def is_flat(field: Floats) -> bool:
    """Thinner than a millionth of its width."""
    widths = np.linalg.svd(field - field.mean(axis=0), compute_uv=False)
    return bool(widths[2] < 1e-6 * widths[0])


@given(arrays(np.float64, array_shapes(min_dims=0, max_dims=3, max_side=4), elements=st.floats(-9, 9)))
def test_any_shape_gives_a_fit_or_an_error_of_ours(field: Floats) -> None:
    attempt(field, "sphere")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@given(st.integers(0, 59), st.integers(0, 2))
@examples(20)
def test_rows_that_are_not_finite_are_left_out_and_counted(bad: float, row: int, axis: int) -> None:
    field = simulate.tumble(seed=1, motion="uniform", n=60).samples.field.copy()
    without = flinders.fit(np.delete(field, row, axis=0))
    field[row, axis] = bad
    fit = flinders.fit(field)
    assert np.array_equal(fit.calibration.offset, without.calibration.offset)
    assert [finding.number for finding in fit.findings if finding.code == "skipped-rows"] == [1.0]


@pytest.mark.parametrize("value", ["text", [["a", "b", "c"]], [[1, 2], [3]], [[1j, 2, 3]], None, {}, 5.0])
def test_what_is_not_numbers_is_refused_at_the_gate(value: object) -> None:
    with pytest.raises(ArrayError):
        flinders.fit(value)  # type: ignore[arg-type]
