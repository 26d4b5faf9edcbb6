"""Laws of axes that slip: for any motion, any sensor, any unit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples
from tests.worlds import SWAPS

from flinders.diagnostics.axis_swap import axis_swap_of
from flinders.native.engine import engine
from flinders.simulate import MOTIONS, tumble

seeds = st.integers(0, 2**32 - 1)
slips = st.sampled_from(sorted(SWAPS))


@given(seeds, st.sampled_from(sorted(MOTIONS)))
@examples(15)
def test_what_did_not_slip_is_not_told_to_have(seed: int, motion: str) -> None:
    assert axis_swap_of(tumble(seed, motion=motion, n=600).samples.field) is None


@given(seeds, st.integers(150, 450), st.integers(20, 120))
@examples(15)
def test_a_gap_is_no_slip(seed: int, at: int, long: int) -> None:
    """Readings that were lost leave a break that mends nothing, or hardly ever, and then no ellipsoid gets better."""
    field = tumble(seed, n=600).samples.field
    assert axis_swap_of(np.concatenate([field[:at], field[at + long :]])) is None


@given(seeds, st.integers(150, 450), st.integers(-10, 10))
@examples(6)
def test_the_unit_does_not_matter(seed: int, at: int, power: int) -> None:
    field = tumble(seed, n=600).samples.field.copy()
    field[at:, 0] *= -1.0
    one, other = axis_swap_of(field), axis_swap_of(2.0**power * field)
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        assert (one.axes, one.rows) == (other.axes, other.rows)
        assert one.gain == pytest.approx(other.gain, rel=1e-6)


@given(seeds, slips, st.integers(150, 450))
@examples(15)
def test_backwards_it_is_the_same_slip(seed: int, axes: str, at: int) -> None:
    field = tumble(seed, n=600).samples.field.copy()
    field[at:] = field[at:] @ SWAPS[axes]
    forwards, backwards = (engine().fit(each, robust=0) for each in (field, field[::-1]))
    assert forwards["swaps"].tolist() == backwards["swaps"].tolist()
    for moments, first, last in zip(*forwards[["swaps", "first_swap"]].tolist(), backwards["first_swap"], strict=True):
        assert moments != 1 or first == len(field) - last
