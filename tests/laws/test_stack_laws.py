"""A stack knows nothing of its neighbours: in whatever company and order, a unit gets the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples

from flinders.core.samples import Samples
from flinders.errors import ArrayError, UnitError, UsageError
from flinders.stacked import Lined, Stack, consistent, fit_stack
from flinders.stacked.algebra import READINGS_AT_A_TIME, counted_in, put, segments
from flinders.stacked.sums import BatchMoments, powers_of_two_above
from flinders.summary.moments import Moments, power_of_two_above


def units(seed: int, many: int) -> list[Samples]:
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(many):
        directions = rng.normal(size=(int(rng.integers(60, 140)), 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        field = directions * rng.uniform(40, 60, 3) + rng.uniform(-40, 40, 3) + rng.normal(size=directions.shape)
        found.append(Samples.of(field, unit="uT"))
    return found


@given(seed=st.integers(0, 99), order=st.permutations(range(8)), cut=st.integers(1, 7))
@examples(4)
def test_neither_order_nor_company_matters(seed: int, order: list[int], cut: int) -> None:
    alike = [one for one in units(seed, 12) if fit_stack([one], target_deg=9.0).through[0]][:8]
    order = [place for place in order if place < len(alike)]
    whole = fit_stack(alike, target_deg=9.0)
    parts = [fit_stack([alike[p] for p in some], target_deg=9.0) for some in (order[:cut], order[cut:]) if some]
    for name in ("offset", "matrix", "covariance", "worst_deg"):
        together = np.concatenate([getattr(part, name) for part in parts])
        assert np.allclose(together, getattr(whole, name)[order], rtol=1e-9, atol=1e-9)
    assert [codes for part in parts for codes in part.findings] == [whole.findings[place] for place in order]


@given(places=st.lists(st.integers(0, 6), min_size=1, max_size=40), seed=st.integers(0, 99))
@examples(30)
def test_counting_is_the_same_in_any_library(places: list[int], seed: int) -> None:
    strict = pytest.importorskip("array_api_strict")
    weights = np.random.default_rng(seed).normal(size=len(places))
    for own in (None, weights):
        expected = np.bincount(places, weights=own, minlength=9)
        found = counted_in(strict.asarray(places), 9, None if own is None else strict.asarray(own))
        assert np.allclose(np.asarray(found), expected, atol=1e-12)


@given(units=st.integers(1, 300), readings=st.integers(1, 2 * READINGS_AT_A_TIME))
def test_stretches_cover_each_unit_once(units: int, readings: int) -> None:
    cuts = list(segments(units, readings))
    assert [place for cut in cuts for place in range(units)[cut]] == list(range(units))
    assert all((cut.stop - cut.start) * readings <= 1.5 * READINGS_AT_A_TIME + readings for cut in cuts)


@given(st.sets(st.integers(0, 9), min_size=1))
def test_put_replaces_what_is_named_and_nothing_else(named: set[int]) -> None:
    at = np.array(sorted(named))
    found = put(np.zeros((10, 2)), at, np.ones((len(at), 2)))
    assert np.flatnonzero(found.all(axis=1)).tolist() == at.tolist()
    assert found.sum() == 2 * len(at)


@given(exponent=st.integers(-999, 1022), ulps=st.integers(-2, 2))
@examples(300)
def test_units_are_the_power_of_two_above_next_to_one_too(exponent: int, ulps: int) -> None:
    value = 2.0**exponent
    for _ in range(abs(ulps)):
        value = float(np.nextafter(value, np.inf if ulps > 0 else 0.0))
    assert powers_of_two_above(np.array([value, 0.0])).tolist() == [power_of_two_above(value), power_of_two_above(0.0)]


@given(ulps=st.integers(-1, 1), seed=st.integers(0, 99))
@examples(10)
def test_sums_are_to_the_last_bit_in_the_unit_of_a_summary(ulps: int, seed: int) -> None:
    field = np.random.default_rng(seed).uniform(-60.0, 60.0, size=(40, 3))
    field[7, 1] = 64.0 + ulps * np.spacing(64.0)
    assert BatchMoments.of(field.T[np.newaxis]).unit.tolist() == [Moments.of(field).unit]


def test_a_table_cut_is_the_same_as_units_stacked() -> None:
    some = units(4, 5)
    cut = Stack.cut(np.concatenate([one.field for one in some]), [len(one) for one in some], unit=some[0].unit)
    stack = Stack.of(some)
    assert np.array_equal(cut.readings, stack.readings)
    assert cut.inside is not None
    assert stack.inside is not None
    assert np.array_equal(cut.inside, stack.inside)
    assert all(np.array_equal(cut[place].field, one.field) for place, one in enumerate(some))
    whole, found = fit_stack(some), fit_stack(cut)
    assert np.allclose(whole.offset, found.offset, rtol=1e-9, equal_nan=True)
    assert whole.readings.tolist() == found.readings.tolist() == [len(one) for one in some]


def test_what_cannot_be_stacked_is_said() -> None:
    one = units(1, 1)[0]
    with pytest.raises(ArrayError, match="0 units, 0 without readings"):
        Stack.of([])
    with pytest.raises(UnitError, match="counts and uT"):
        Stack.of([one, Samples.of(one.field)])
    with pytest.raises(ArrayError, match="counts add up to 7"):
        Stack.cut(np.zeros((6, 3)), [3, 4])
    with pytest.raises(UsageError, match="need a positive angle"):
        fit_stack([one], target_deg=0.0)


def lined(alone: list[Samples]) -> Lined:
    whole = Samples.of(
        np.concatenate([one.field for one in alone]),
        unit="uT",
        time=np.concatenate([np.arange(len(one)) * 0.02 for one in alone]),
    )
    return Lined(whole, np.cumsum([len(one) for one in alone]), [f"A{place}" for place in range(len(alone))])


@pytest.mark.parametrize("polish", [True, False])
def test_recordings_that_lie_in_one_table_are_fitted_as_single_ones_are(*, polish: bool) -> None:
    alone = [*units(5, 30), *(one[:70] for one in units(6, 9)), units(7, 1)[0][:5]]
    together = lined(alone)
    found, expected = (fit_stack(each, target_deg=9.0, polish=polish) for each in (together, list(together)))
    assert found.through.tolist() == expected.through.tolist()
    assert found.through.sum() > 20
    for name in ("verdict", "code", "findings", "used", "readings"):
        assert getattr(found, name).tolist() == getattr(expected, name).tolist()
    for name in ("offset", "matrix", "covariance", "worst_deg", "noise"):
        assert np.allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-9, equal_nan=True)


def test_recordings_of_one_table_are_views_in_order() -> None:
    together = lined(units(5, 4))
    assert [one.source for one in together] == ["A0", "A1", "A2", "A3"]
    assert sum(map(len, together)) == len(together.whole)
    assert np.array_equal(np.concatenate([one.field for one in together]), together.whole.field)


@given(seed=st.integers(0, 99))
@examples(10)
def test_inverse_iteration_finds_the_smallest_of_all_eigenvalues(seed: int) -> None:
    sums = BatchMoments.of(np.stack([one.field[:60].T for one in units(seed, 12)]))
    scatter = sums.about(sums.mean, sums.spread)
    corrections = consistent._corrections(scatter)
    quadric, variance, settled = consistent._by_inverse_iteration(scatter, *corrections)
    expected, known, sure = consistent._by_eigenvalues(scatter, *corrections)
    assert settled.sum() > 8
    assert sure[settled].all()
    assert np.allclose(variance[settled], known[settled], rtol=1e-8)
    assert np.allclose(np.abs(np.sum(quadric * expected, axis=1))[settled], 1.0, rtol=1e-12)
