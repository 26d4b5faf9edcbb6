"""Laws of `Moments`, for any cloud: sums add up, in any order, in any unit, with any weight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.sentences import assert_raises

from flinders.errors import ArrayError
from flinders.summary.moments import (
    EXPONENTS,
    MIXED_TERM_FACTORS,
    QUADRIC_EXPONENTS,
    SMALLEST_UNIT,
    Moments,
    power_of_two_above,
)

if TYPE_CHECKING:
    from flinders.arrays import Floats

coordinates = st.floats(-1000, 1000, allow_subnormal=False).map(lambda x: x if abs(x) > 1e-30 else 0.0)
clouds = st.integers(0, 12).flatmap(lambda n: arrays(np.float64, (n, 3), elements=coordinates))
full_clouds = st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (n, 3), elements=coordinates))
seen_clouds = full_clouds.filter(lambda cloud: float(np.abs(cloud).max()) > 1.0)


def close(found: Moments, wanted: Moments, *, rtol: float = 1e-13) -> None:
    """Alike to rounding, in the larger of both units, where each reading adds at most one to each sum."""
    unit = max(found.unit, wanted.unit)
    atol = rtol * max(float(np.abs(found.sums[0])), float(np.abs(wanted.sums[0])), 1.0) * 8
    npt.assert_allclose(found._convert_unit(unit), wanted._convert_unit(unit), rtol=0, atol=atol)


def test_the_sums_are_those_of_the_monomials() -> None:
    cloud = np.random.default_rng(1).normal(size=(20_000, 3)) * 30 + [5, -20, 60]
    found = Moments.of(cloud)
    wanted = np.array([np.prod((cloud / found.unit) ** exponents, axis=1).sum() for exponents in EXPONENTS])
    npt.assert_allclose(found.sums, wanted, rtol=1e-11, atol=1e-9)
    npt.assert_allclose(found.mean, cloud.mean(axis=0), rtol=1e-12)
    assert found.spread == pytest.approx(np.sqrt(cloud.var(axis=0).sum()), rel=1e-12)
    variances = np.linalg.eigvalsh(np.cov(cloud.T, bias=True))
    npt.assert_allclose(found.principal_variances, variances, rtol=1e-10)


@given(clouds, clouds, clouds)
def test_addition_commutes_associates_and_has_an_identity(a: Floats, b: Floats, c: Floats) -> None:
    one, two, three = map(Moments.of, (a, b, c))
    close(one + two, two + one, rtol=0)
    close((one + two) + three, one + (two + three))
    for same in (one + Moments.empty(), Moments.empty() + one, one + Moments.of(np.empty((0, 3)))):
        assert same.sums.tobytes() == one.sums.tobytes()
        assert same.unit == one.unit


@given(full_clouds, st.data())
def test_split_anywhere_and_merged_it_is_the_same(cloud: Floats, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(cloud)))
    whole = Moments.of(cloud)
    merged = Moments.of(cloud[:cut]) + Moments.of(cloud[cut:])
    assert merged.unit == whole.unit
    close(merged, whole)


@given(clouds, clouds)
def test_what_was_added_can_be_taken_away_again(a: Floats, b: Floats) -> None:
    one, two = Moments.of(a), Moments.of(b)
    unit = max(one.unit, two.unit)
    left = (one + two - two)._convert_unit(unit)
    npt.assert_allclose(left, one._convert_unit(unit), rtol=0, atol=1e-13 * (len(a) + len(b) + 1))


@given(clouds, st.integers(1, 5))
def test_a_weight_is_a_number_of_repeats(cloud: Floats, times: int) -> None:
    repeated = Moments.of(np.repeat(cloud, times, axis=0))
    close(Moments.of(cloud, weight=np.full(len(cloud), float(times))), repeated)
    close(Moments.of(cloud) * times, repeated)


@given(full_clouds, st.data())
def test_weights_add_up_reading_by_reading(cloud: Floats, data: st.DataObject) -> None:
    weights = data.draw(arrays(np.float64, len(cloud), elements=st.floats(0, 4)))
    whole = Moments.of(cloud, weight=weights)
    single = Moments.empty()
    for reading, weight in zip(cloud, weights, strict=True):
        single = single + Moments.of(reading) * float(weight)
    close(whole, single, rtol=4e-13)
    assert whole.count == pytest.approx(weights.sum())


@given(clouds, clouds, st.floats(0, 1))
def test_forgetting_is_linear(a: Floats, b: Floats, factor: float) -> None:
    one, two = Moments.of(a), Moments.of(b)
    close((one + two) * factor, one * factor + two * factor)
    assert (one * factor).count == pytest.approx(len(a) * factor)


@given(full_clouds, st.integers(-40, 40))
def test_readings_in_another_unit_by_a_power_of_two_have_the_same_sums_to_the_bit(cloud: Floats, power: int) -> None:
    factor = 2.0**power
    one, other = Moments.of(cloud), Moments.of(cloud * factor)
    assert other.sums.tobytes() == one.sums.tobytes()
    if cloud.any():
        assert other.unit == one.unit * factor


@given(full_clouds, st.integers(0, 8), st.integers(0, 8))
def test_a_larger_unit_loses_nothing(cloud: Floats, first: int, second: int) -> None:
    moments = Moments.of(cloud + 1.0)
    once = moments._convert_unit(moments.unit * 2.0 ** (first + second))
    twice = Moments(moments._convert_unit(moments.unit * 2.0**first), moments.unit * 2.0**first)
    assert twice._convert_unit(moments.unit * 2.0 ** (first + second)).tobytes() == once.tobytes()
    back = Moments(once, moments.unit * 2.0 ** (first + second))._convert_unit(moments.unit)
    assert back.tobytes() == moments.sums.tobytes()


@given(seen_clouds, arrays(np.float64, 3, elements=st.floats(-1000, 1000)), st.floats(100, 1000))
def test_sums_about_another_origin_are_the_sums_of_moved_readings(cloud: Floats, origin: Floats, scale: float) -> None:
    found = Moments.of(cloud).about(origin, scale)
    z = (cloud - origin) / scale
    x, y, w = z.T
    monomials = np.stack([x * x, y * y, w * w, 2 * x * y, 2 * x * w, 2 * y * w, x, y, w, np.ones(len(z))])
    npt.assert_allclose(found, monomials @ monomials.T, rtol=0, atol=1e-9 * len(cloud))


@given(
    seen_clouds,
    arrays(np.float64, 3, elements=st.floats(-300, 300)),
    arrays(np.float64, 3, elements=st.floats(-2, 2)),
    st.floats(200, 900),
    st.floats(0.5, 2),
)
def test_two_shifts_after_each_other_are_one(
    cloud: Floats, first: Floats, second: Floats, scale: float, again: float
) -> None:
    moments = Moments.of(cloud)
    once = moments.about(first + scale * second, scale * again)
    scatter = moments.about(first, scale) / np.outer(MIXED_TERM_FACTORS, MIXED_TERM_FACTORS)
    products = {
        tuple(one + other): scatter[i, j]
        for i, one in enumerate(QUADRIC_EXPONENTS)
        for j, other in enumerate(QUADRIC_EXPONENTS)
    }
    between = Moments(np.array([products[tuple(exponents)] for exponents in EXPONENTS]), 1.0)
    npt.assert_allclose(between.about(second, again), once, rtol=0, atol=1e-8 * len(cloud))


@given(st.floats(min_value=0, max_value=2.0**1000))
def test_the_unit_is_the_least_power_of_two_that_bounds_a_value(value: float) -> None:
    unit = power_of_two_above(value)
    assert np.log2(unit) == np.round(np.log2(unit))
    assert unit >= value
    assert unit == SMALLEST_UNIT or unit / 2 < value * (1 + 1e-14)


def test_a_column_of_weights_has_one_weight_a_reading() -> None:
    with assert_raises(ArrayError):
        Moments.of(np.zeros((3, 3)), weight=[1.0, 2.0])
