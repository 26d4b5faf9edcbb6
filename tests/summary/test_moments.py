"""A million readings beside hard iron of ten field strengths, held against exact integer arithmetic.

Readings are integer counts, so that every sum of powers is an integer. Seen from an origin of whole counts, the sums
of powers are exact too, with no cancellation at all: that is what floating-point sums about zero, shifted afterwards,
are compared with.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.trials import daily
from tests.worlds import SOFT_IRON

from flinders.estimators import Readings
from flinders.estimators.consistent import Consistent
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.native.engine import engine
from flinders.simulate import uniform_directions
from flinders.summary.moments import EXPONENTS, Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from numpy.typing import NDArray


FIELD: Final = 500.0
N: Final = 1_000_000
DIRECTION: Final = np.array([0.48, -0.6, 0.64])


@cache
def counts(strengths: float) -> NDArray[np.int64]:
    """(N, 3) readings in whole counts, the hard iron so many field strengths away."""
    rng = np.random.default_rng(7)
    raw = (
        FIELD * uniform_directions(rng, N) @ SOFT_IRON.T
        + strengths * FIELD * DIRECTION
        + 5.0 * rng.standard_normal((N, 3))
    )
    readings: NDArray[np.int64] = np.rint(raw).astype(np.int64)
    return readings


def exact_moments(readings: NDArray[np.int64], origin: NDArray[np.int64], scale: int) -> Moments:
    """Moments about an origin of whole counts: integer sums, each divided and rounded once."""
    sums = [0] * 35
    for start in range(0, len(readings), 100_000):
        z = readings[start : start + 100_000] - origin
        # |z| < 1000, so that a sum of a hundred thousand fourth powers stays below 2^63.
        assert int(np.abs(z).max()) ** 4 * len(z) < 2**63
        squares = z * z
        powers = np.stack([np.ones_like(z), z, squares, squares * z, squares * squares])
        for row, (i, j, k) in enumerate(EXPONENTS.tolist()):
            sums[row] += int(np.sum(powers[i, :, 0] * powers[j, :, 1] * powers[k, :, 2]))
    return Moments(np.array([total / scale ** sum(e) for total, e in zip(sums, EXPONENTS.tolist(), strict=True)]), 1.0)


@pytest.mark.parametrize(("strengths", "bound"), daily([(0.0, 1e-15), (1.0, 3e-15), (3.0, 1e-13), (10.0, 1e-10)], 2))
def test_shifted_sums_are_the_exact_ones(strengths: float, bound: float) -> None:
    """Measured: off by 1e-16, 5e-16, 1e-14 and 2e-11 of the count at 0, 1, 3 and 10 field strengths."""
    readings = counts(strengths)
    moments = Moments.of(readings)
    origin, scale = np.rint(moments.mean).astype(np.int64), round(moments.spread)
    exact = exact_moments(readings, origin, scale).about(np.zeros(3), 1.0)
    error = np.abs(moments.about(origin, float(scale)) - exact).max() / N
    assert error < bound


@pytest.mark.parametrize("strengths", daily([0.0, 10.0]))
def test_the_consistent_fit_is_that_of_exact_sums_to_a_ten_thousandth_of_its_uncertainty(strengths: float) -> None:
    """Measured: off by 2e-15 and 3e-11 of the field at 0 and 10 field strengths, where σ is 2e-5 of it."""
    readings = counts(strengths)
    moments = Moments.of(readings)
    origin, scale = np.rint(moments.mean).astype(np.int64), round(moments.spread)
    record = engine().solve(exact_moments(readings, origin, scale).sums, origin=origin, unit=scale)
    exact = Ellipsoid(record["centre"], symmetric_matrix(record["shape"]))
    found = Consistent().estimate(Readings(Summary.of(readings)))
    sigma = np.sqrt(np.diag(found.covariance))
    off = np.abs(np.concatenate([found.ellipsoid.centre - exact.centre, (found.ellipsoid.shape - exact.shape).ravel()]))
    assert off.max() < 1e-4 * sigma[:3].min()
    assert found.noise == pytest.approx(float(record["noise"]), rel=1e-6)
    npt.assert_allclose(exact.centre, strengths * FIELD * DIRECTION, atol=5 * sigma[:3].max())


@pytest.mark.nightly
def test_a_million_readings_added_in_blocks_of_a_thousand_lose_nothing_more() -> None:
    readings = counts(10.0)
    streamed = Moments.empty()
    for block in np.array_split(readings, 1000):
        streamed = streamed + Moments.of(block)
    origin, scale = np.rint(streamed.mean).astype(np.int64), round(streamed.spread)
    exact = exact_moments(readings, origin, scale).about(np.zeros(3), 1.0)
    error = np.abs(streamed.about(origin, float(scale)) - exact).max() / N
    assert error < 1e-10
    assert streamed.count == N


def test_exact_integers_stay_exact_while_they_fit() -> None:
    """Counts below 2⁹ and a hundred readings: every sum is below 2⁵³, so floating point makes no error at all."""
    readings = np.random.default_rng(3).integers(-200, 200, (100, 3))
    found = Moments.of(readings)
    for row, exponents in enumerate(EXPONENTS.tolist()):
        total = sum(
            int(np.prod([int(v) ** e for v, e in zip(r, exponents, strict=True)], dtype=object)) for r in readings
        )
        assert found.sums[row] * found.unit ** sum(exponents) == total
