"""Laws of `Cloud`: nothing is lost, order does not matter, and it stays small."""

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
from flinders.summary.cloud import MAX_CELLS, Cloud, natural_side

if TYPE_CHECKING:
    from flinders.arrays import Floats

coordinates = st.floats(-500, 500).map(lambda x: round(x, 3) + 0.0)
fields = st.integers(0, 30).flatmap(lambda n: arrays(np.float64, (n, 3), elements=coordinates))
sides = st.integers(-3, 6).map(lambda power: 2.0**power)


@st.composite
def clouds(draw: st.DrawFn) -> Cloud:
    """Any cloud, with or without time."""
    field, side = draw(fields), draw(sides)
    start = draw(st.none() | st.integers(0, 100))
    return Cloud.of(field, time=None if start is None else start + np.arange(len(field)) * 0.5, side=side)


def same(a: Cloud, b: Cloud) -> None:
    """Alike, but for rounding of the sums."""
    assert a.side == b.side
    assert np.array_equal(a.keys, b.keys)
    npt.assert_allclose(a.counts, b.counts, rtol=1e-12)
    npt.assert_allclose(a.sums, b.sums, rtol=1e-12, atol=1e-9)
    assert np.array_equal(a.first, b.first, equal_nan=True)
    assert np.array_equal(a.last, b.last, equal_nan=True)


@given(fields, sides)
def test_every_reading_is_in_the_cell_it_lies_in(field: Floats, side: float) -> None:
    cloud = Cloud.of(field, side=side)
    cells = np.unique(np.floor(field / side), axis=0)
    assert len(cloud) == len(cells)
    assert cloud.counts.sum() == len(field)
    npt.assert_allclose(cloud.sums.sum(axis=0), field.sum(axis=0), atol=1e-9)
    middles = np.floor(cloud.means / side + 1e-12)
    npt.assert_allclose(sorted(map(tuple, middles)), sorted(map(tuple, cells)), atol=1.0)
    assert (np.diff(cloud.keys) > 0).all()


@given(clouds(), clouds())
def test_addition_commutes_and_takes_the_coarser_side(a: Cloud, b: Cloud) -> None:
    same(a + b, b + a)
    if len(a) and len(b):
        assert (a + b).side == max(a.side, b.side)


@given(clouds(), clouds(), clouds())
def test_addition_associates(a: Cloud, b: Cloud, c: Cloud) -> None:
    same((a + b) + c, a + (b + c))


@given(clouds())
def test_no_readings_are_the_identity(a: Cloud) -> None:
    for other in (Cloud.empty(), Cloud.of(np.empty((0, 3)))):
        if len(a):
            same(a + other, a)
            same(other + a, a)
        else:
            assert not len(a + other)


@given(clouds(), clouds())
def test_counts_and_sums_are_conserved(a: Cloud, b: Cloud) -> None:
    both = a + b
    assert both.counts.sum() == a.counts.sum() + b.counts.sum()
    npt.assert_allclose(both.sums.sum(axis=0), a.sums.sum(axis=0) + b.sums.sum(axis=0), atol=1e-8)


@given(fields, sides, st.data())
def test_split_anywhere_and_merged_it_is_the_whole(field: Floats, side: float, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(field)))
    time = np.arange(len(field)) * 0.02
    whole = Cloud.of(field, time=time, side=side)
    merged = Cloud.of(field[:cut], time=time[:cut], side=side) + Cloud.of(field[cut:], time=time[cut:], side=side)
    if len(field):
        same(merged, whole)


@given(fields, sides, st.integers(1, 4))
def test_coarsening_is_sorting_into_larger_cells(field: Floats, side: float, doublings: int) -> None:
    if len(field):
        coarse = side * 2.0**doublings
        same(Cloud.of(field, side=side)._coarsen(coarse), Cloud.of(field, side=coarse))


@given(fields.filter(len), sides)
def test_each_cell_knows_when_it_was_first_and_last_seen(field: Floats, side: float) -> None:
    time = 10.0 + np.arange(len(field))
    cloud = Cloud.of(field, time=time, side=side)
    assert cloud.first.min() == time[0]
    assert cloud.last.max() == time[-1]
    assert (cloud.first <= cloud.last).all()
    alone = cloud.counts == 1
    assert (cloud.first[alone] == cloud.last[alone]).all()


@given(fields.filter(len), sides)
def test_time_that_only_one_side_has_is_kept(field: Floats, side: float) -> None:
    timed, untimed = Cloud.of(field, time=np.arange(len(field)) * 1.0, side=side), Cloud.of(field, side=side)
    both = timed + untimed
    assert np.array_equal(both.first, timed.first)
    assert np.array_equal(both.last, timed.last)


@given(clouds(), st.floats(0.01, 1))
def test_forgetting_lowers_counts_and_leaves_means(a: Cloud, factor: float) -> None:
    faded = a * factor
    npt.assert_allclose(faded.counts, a.counts * factor)
    npt.assert_allclose(faded.means, a.means, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("spread", [1.0, 100.0, 1e4])
def test_it_never_holds_more_cells_than_it_may(spread: float) -> None:
    rng = np.random.default_rng(2)
    whole = Cloud.empty()
    for _ in range(6):
        whole = whole + Cloud.of(rng.normal(size=(3000, 3)) * spread, side=0.25)
        assert len(whole) <= MAX_CELLS
    assert whole.counts.sum() == 18_000
    assert np.log2(whole.side) == np.round(np.log2(whole.side))


def test_however_it_was_split_a_cloud_that_is_bounded_has_the_same_cells() -> None:
    field = np.random.default_rng(3).normal(size=(20_000, 3)) * 50
    whole = Cloud.of(field, side=1.0)
    merged = Cloud.empty()
    for part in np.array_split(field, 7):
        merged = Cloud.of(part, side=1.0) + merged
    same(merged, whole)


def test_cells_far_out_of_reach_are_counted_at_the_edge() -> None:
    cloud = Cloud.of([[0.0, 0.0, 0.0], [1e9, 0.0, -1e12]], side=1.0)
    assert cloud.counts.sum() == 2
    npt.assert_allclose(cloud.sums.sum(axis=0), [1e9, 0, -1e12])


@given(fields.filter(len), st.integers(-20, 20))
def test_the_natural_side_scales_with_the_readings(field: Floats, power: int) -> None:
    side = natural_side(field)
    assert np.log2(side) == np.round(np.log2(side))
    if np.ptp(field, axis=0).max() > 1:
        assert natural_side(field * 2.0**power) == side * 2.0**power


def test_a_sphere_has_some_two_thousand_cells_of_its_natural_side() -> None:
    directions = np.random.default_rng(4).normal(size=(100_000, 3))
    field = 50 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + [20, 120, 90]
    assert 1000 < len(Cloud.of(field)) <= MAX_CELLS


def test_time_needs_one_value_a_reading() -> None:
    with assert_raises(ArrayError):
        Cloud.of(np.zeros((3, 3)), time=[1.0])
