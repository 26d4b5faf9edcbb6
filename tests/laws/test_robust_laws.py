"""Laws of the robust fit: it moves with the readings, and a list of strays does not know of blocks."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flinders.estimators import Readings, Robust, strays_of
from flinders.quadric import Ellipsoid
from flinders.samples import Samples
from flinders.simulate import tumble
from flinders.terms import magnitude

if TYPE_CHECKING:
    from flinders.arrays import Floats

FEW: Final = settings(max_examples=15)
SPHERE: Final = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
STRUCK: Final = tumble(seed=6, motion="uniform", n=400, outliers=0.08)
LIMIT: Final = 1.0

shifts = arrays(np.float64, 3, elements=st.floats(-400, 400))


@given(shift=shifts, size=st.floats(0.01, 1000.0))
@FEW
def test_moved_and_scaled_readings_give_a_moved_and_scaled_ellipsoid(shift: Floats, size: float) -> None:
    one = Robust().estimate(Readings.of(STRUCK.samples.field))
    other = Robust().estimate(Readings.of(size * STRUCK.samples.field + size * shift))
    sigma = np.sqrt(np.diag(one.covariance)[:3])
    # Cells of the cloud lie where they lie, so another few readings may be drawn: a fraction of σ.
    assert np.all(np.abs(other.ellipsoid.centre / size - shift - one.ellipsoid.centre) < 0.3 * sigma)
    assert np.isclose(other.noise / size, one.noise, rtol=0.03)
    assert np.isclose(other.rejected_beyond / size, one.rejected_beyond, rtol=0.25)


@given(seed=st.integers(0, 1000))
@FEW
def test_the_order_of_single_strays_does_not_matter(seed: int) -> None:
    one = Robust().estimate(Readings.of(STRUCK.samples.field))
    other = Robust().estimate(Readings.of(np.random.default_rng(seed).permutation(STRUCK.samples.field)))
    sigma = np.sqrt(np.diag(one.covariance)[:3])
    assert np.all(np.abs(other.ellipsoid.centre - one.ellipsoid.centre) < 0.3 * sigma)


@given(
    lengths=arrays(np.float64, st.integers(1, 120), elements=st.sampled_from([50.0, 50.2, 49.5, 53.0, 80.0])),
    cuts=st.lists(st.integers(0, 120), max_size=6),
    timed=st.booleans(),
)
@settings(max_examples=100)
def test_strays_are_the_same_over_any_split_into_blocks(lengths: Floats, cuts: list[int], timed: bool) -> None:
    field = np.outer(lengths, [0.6, 0.0, 0.8])
    samples = Samples(field, time=np.arange(len(field)) * 0.5 if timed else None)
    edges = sorted({0, len(field), *(cut for cut in cuts if cut < len(field))})
    blocks = [samples[begin:end] for begin, end in pairwise(edges)]
    whole, parts = strays_of([samples], SPHERE, LIMIT), strays_of(blocks, SPHERE, LIMIT)
    assert [str(stray) for stray in parts] == [str(stray) for stray in whole]
    for one, other in zip(whole, parts, strict=True):
        assert (one.first, one.last, one.rows, one.farthest) == (other.first, other.last, other.rows, other.farthest)
        npt.assert_array_equal([one.start, one.end], [other.start, other.end])


@given(lengths=arrays(np.float64, st.integers(1, 120), elements=st.sampled_from([50.0, 50.2, 53.0, 80.0])))
def test_every_far_reading_is_in_one_run_and_no_run_is_empty(lengths: Floats) -> None:
    field = np.outer(lengths, [0.6, 0.0, 0.8])
    far = np.flatnonzero(np.abs(magnitude.distances(field, SPHERE)) > LIMIT) + 1
    runs = strays_of([Samples(field)], SPHERE, LIMIT)
    assert sum(run.rows for run in runs) == len(far)
    inside = [row for run in runs for row in far if run.first <= row <= run.last]
    assert inside == far.tolist()
    assert all(later.first > run.last for run, later in pairwise(runs))
