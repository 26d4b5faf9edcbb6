"""Laws of the robust fit: it moves with the readings, and a list of strays does not know of blocks."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.trials import examples

from flinders.core.samples import Samples
from flinders.estimators import Readings, outlier_runs
from flinders.estimators.outliers import MARGIN_READINGS, NO_RUN, WINDOW_READINGS, mark_outliers, min_run_readings
from flinders.estimators.robust import Robust
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude
from flinders.simulate import tumble

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

FEW: Final = examples(15)
LEAST: Final = 3  # far readings of a window that make a run
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
    """Nor do neighbours of strays suffer where chance alone has put some of them close together."""
    one = Robust().estimate(Readings.of(STRUCK.samples.field))
    other = Robust().estimate(Readings.of(np.random.default_rng(seed).permutation(STRUCK.samples.field)))
    sigma = np.sqrt(np.diag(one.covariance)[:3])
    assert np.all(np.abs(other.ellipsoid.centre - one.ellipsoid.centre) < 0.3 * sigma)
    assert (other.used, one.used) == (368, 368)


@given(every=st.integers(3, 600), rows=st.integers(600, 10**6), more=st.integers(1, 3))
def test_the_more_strays_and_rows_there_are_the_denser_is_a_run(every: int, rows: int, more: int) -> None:
    few, many = np.arange(600) % (more * every) == 0, np.arange(600) % every == 0
    dense = min_run_readings(few, rows)
    assert LEAST <= dense <= NO_RUN
    assert dense <= min_run_readings(many, rows)
    assert dense <= min_run_readings(few, more * rows)


@given(
    far=arrays(np.bool_, st.integers(1, 300), elements=st.sampled_from([False] * 4 + [True])),
    sizes=st.lists(st.integers(0, 90), min_size=1, max_size=8),
    dense=st.integers(LEAST, NO_RUN),
)
@examples(200)
def test_what_is_left_out_does_not_depend_on_blocks(far: NDArray[np.bool_], sizes: list[int], dense: int) -> None:
    """And it is what is listed and what is counted."""
    samples = Samples(np.outer(np.where(far, 80.0, 50.0), [0.6, 0.0, 0.8]) + np.arange(len(far))[:, np.newaxis] * 1e-6)
    edges = np.unique(np.clip([0, *np.cumsum(sizes), len(far)], 0, len(far))).tolist()
    blocks = [samples[:0], *(samples[begin:end] for begin, end in pairwise(edges)), samples[:0]]
    (_, _, whole), *_ = mark_outliers([samples], SPHERE, LIMIT, dense)
    parts = np.concatenate([out for _, _, out in mark_outliers(blocks, SPHERE, LIMIT, dense)])
    npt.assert_array_equal(parts, whole)
    assert np.all(whole[far])
    listed = outlier_runs(blocks, SPHERE, LIMIT, dense)
    assert [str(outlier) for outlier in listed] == [
        str(outlier) for outlier in outlier_runs([samples], SPHERE, LIMIT, dense)
    ]
    assert sum(outlier.readings for outlier in listed) == np.count_nonzero(whole)
    for outlier in listed:
        assert whole[outlier.first - 1]
        assert whole[outlier.last - 1]


@given(far=arrays(np.bool_, st.integers(1, 300), elements=st.sampled_from([False] * 4 + [True])))
def test_neighbours_go_where_a_run_is_and_only_there(far: NDArray[np.bool_]) -> None:
    """Word for word what the module says, reading by reading."""
    dense = 6
    field = np.outer(np.where(far, 80.0, 50.0), [0.6, 0.0, 0.8])
    ((_, _, out),) = mark_outliers([Samples(field)], SPHERE, LIMIT, dense)
    half = WINDOW_READINGS // 2
    run = [row for row in np.flatnonzero(far) if far[max(row - half, 0) : row + half + 1].sum() >= dense]
    near_a_run = [any(abs(row - other) <= MARGIN_READINGS for other in run) for row in range(len(far))]
    npt.assert_array_equal(out, far | np.array(near_a_run))


@given(
    lengths=arrays(np.float64, st.integers(1, 120), elements=st.sampled_from([50.0, 50.2, 49.5, 53.0, 80.0])),
    cuts=st.lists(st.integers(0, 120), max_size=6),
    timed=st.booleans(),
)
@examples(100)
def test_strays_are_the_same_over_any_split_into_blocks(lengths: Floats, cuts: list[int], timed: bool) -> None:
    field = np.outer(lengths, [0.6, 0.0, 0.8])
    samples = Samples(field, time=np.arange(len(field)) * 0.5 if timed else None)
    edges = sorted({0, len(field), *(cut for cut in cuts if cut < len(field))})
    blocks = [samples[begin:end] for begin, end in pairwise(edges)]
    whole, parts = outlier_runs([samples], SPHERE, LIMIT), outlier_runs(blocks, SPHERE, LIMIT)
    assert [str(outlier) for outlier in parts] == [str(outlier) for outlier in whole]
    for one, other in zip(whole, parts, strict=True):
        assert (one.first, one.last, one.readings, one.max_distance) == (
            other.first,
            other.last,
            other.readings,
            other.max_distance,
        )
        npt.assert_array_equal([one.start_s, one.end_s], [other.start_s, other.end_s])


@given(lengths=arrays(np.float64, st.integers(1, 120), elements=st.sampled_from([50.0, 50.2, 53.0, 80.0])))
def test_every_far_reading_is_in_one_run_and_no_run_is_empty(lengths: Floats) -> None:
    field = np.outer(lengths, [0.6, 0.0, 0.8])
    far = np.flatnonzero(np.abs(magnitude.distances(field, SPHERE)) > LIMIT) + 1
    runs = outlier_runs([Samples(field)], SPHERE, LIMIT)
    assert sum(run.readings for run in runs) == len(far)
    inside = [row for run in runs for row in far if run.first <= row <= run.last]
    assert inside == far.tolist()
    assert all(later.first > run.last for run, later in pairwise(runs))


def test_a_run_that_all_other_readings_lie_around_leaves_no_share_to_count() -> None:
    """Eleven of 28, and the margin reaches to the end."""
    assert LEAST <= min_run_readings(np.arange(28) < WINDOW_READINGS, 28) <= NO_RUN
