"""Laws of `DataQuality` and `Summary`: parts in the order of recording add up to the whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flinders.core.samples import Samples, Skipped
from flinders.summary.quality import DataQuality, Lows, TimeStamps
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats

# Few values, so that repeats and shared extremes are common; none that a sensor gives which does not answer.
few = arrays(np.float64, st.tuples(st.integers(0, 14), st.just(3)), elements=st.integers(1, 5).map(float))


@st.composite
def recordings(draw: st.DrawFn) -> Samples:
    """A recording of few values, with times that may jump or go back, or none."""
    field = draw(few)
    steps = draw(arrays(np.float64, len(field), elements=st.sampled_from([0.02, 0.5, 7.0, -1.0, 0.0])))
    return Samples.of(field, time=np.cumsum(steps) if draw(st.booleans()) else None)


def same_lows(a: Lows, b: Lows) -> None:
    assert np.array_equal(a.values, b.values)
    assert np.array_equal(a.counts, b.counts)
    assert np.array_equal(a.next_values, b.next_values)
    assert np.array_equal(a.next_counts, b.next_counts)
    assert np.array_equal(a.least, b.least)
    assert np.array_equal(a.most, b.most)


def same_clock(a: TimeStamps, b: TimeStamps) -> None:
    npt.assert_allclose(
        [a.start, a.end, a.seconds, a.steps, a.longest_step, a.backward_steps],
        [b.start, b.end, b.seconds, b.steps, b.longest_step, b.backward_steps],
        atol=1e-12,
        equal_nan=True,
    )


def same(a: DataQuality, b: DataQuality) -> None:
    assert (a.rows, a.repeats) == (b.rows, b.repeats)
    assert a.path.count == b.path.count
    npt.assert_allclose(a.path.squares, b.path.squares)
    assert np.array_equal(a.first, b.first, equal_nan=True)
    assert np.array_equal(a.last, b.last, equal_nan=True)
    same_lows(a.lows, b.lows)
    same_lows(a.highs, b.highs)
    assert np.array_equal(a.seen.hashes, b.seen.hashes)
    assert np.array_equal(a.seen.counts, b.seen.counts)
    assert a.seen.level == b.seen.level
    same_clock(a.clock, b.clock)
    assert a.skipped == b.skipped


@given(recordings(), st.data())
def test_the_health_of_parts_in_order_is_that_of_the_whole(recording: Samples, data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(recording)), min_size=2, max_size=2)))
    first, second, third = recording[: cuts[0]], recording[cuts[0] : cuts[1]], recording[cuts[1] :]
    a, b, c = map(DataQuality.of, (first, second, third))
    same((a + b) + c, DataQuality.of(recording))
    same(a + (b + c), DataQuality.of(recording))


@given(recordings())
def test_no_readings_leave_health_as_it_is(recording: Samples) -> None:
    health = DataQuality.of(recording)
    same(health + DataQuality(), health)
    same(DataQuality() + health, health)


@given(few.filter(lambda field: len(field) > 0))
def test_a_reading_repeated_across_the_seam_counts(field: Floats) -> None:
    again = Samples.of(field[-1:])
    together = DataQuality.of(Samples.of(field)) + DataQuality.of(again)
    assert together.repeats == DataQuality.of(Samples.of(field)).repeats + 1
    assert together.rows == len(field) + 1


@given(few)
def test_repeats_are_readings_equal_to_the_one_before(field: Floats) -> None:
    wanted = sum(bool((a == b).all()) for a, b in zip(field[1:], field[:-1], strict=True))
    assert DataQuality.of(Samples.of(field)).repeats == wanted


@given(few.filter(lambda field: len(field) > 0))
def test_extent_and_ends_are_those_of_the_readings(field: Floats) -> None:
    health = DataQuality.of(Samples.of(field))
    npt.assert_array_equal(health.extent, np.ptp(field, axis=0))
    npt.assert_array_equal(health.lows.values, field.min(axis=0))
    npt.assert_array_equal(-health.highs.values, field.max(axis=0))
    npt.assert_array_equal(health.highs.counts, (field == field.max(axis=0)).sum(axis=0))
    for axis in range(3):
        there = field[field[:, axis] == field[:, axis].min()]
        npt.assert_array_equal(health.lows.ranges[axis], np.ptp(there, axis=0))


def test_the_seam_between_recordings_can_be_a_jump_or_a_step_back() -> None:
    early, late = TimeStamps.of(np.array([0.0, 1.0, 2.0])), TimeStamps.of(np.array([50.0, 51.0]))
    assert (early + late).longest_step == 48.0
    assert (early + late).seconds == 51.0
    assert (late + early).backward_steps == 1
    assert (TimeStamps() + late) == late == (late + TimeStamps())


def test_the_seam_between_recordings_of_their_own_is_nothing() -> None:
    early, late = TimeStamps.of(np.array([0.0, 1.0, 2.0])), TimeStamps.of(np.array([50.0, 51.0]))
    for both in (early.merge(late), late.merge(early)):
        assert (both.seconds, both.steps, both.longest_step, both.backward_steps) == (3.0, 3, 1.0, 0)
        assert both.mean_step == 1.0
    assert TimeStamps().merge(late) == late == late.merge(TimeStamps())
    assert TimeStamps().mean_step == 0.0


@given(recordings(), recordings(), recordings())
def test_recordings_side_by_side_add_up_in_any_grouping(first: Samples, second: Samples, third: Samples) -> None:
    a, b, c = map(DataQuality.of, (first, second, third))
    same(a.merge(b).merge(c), a.merge(b.merge(c)))
    if not np.isnan(b.clock.end):
        same(a.merge(b + c), a.merge(b) + c)
    same(a.merge(DataQuality()), a)
    same(DataQuality().merge(a), a)


@given(recordings(), recordings())
def test_side_by_side_nothing_is_counted_that_is_in_neither(first: Samples, second: Samples) -> None:
    a, b = Summary.of(first, side=1.0), Summary.of(second, side=1.0)
    both, on = a.merge(b), a + b
    assert both.health.repeats == a.health.repeats + b.health.repeats <= on.health.repeats
    assert both.health.clock.backward_steps == a.health.clock.backward_steps + b.health.clock.backward_steps
    assert both.health.clock.longest_step == max(a.health.clock.longest_step, b.health.clock.longest_step)
    assert both.health.clock.seconds == a.health.clock.seconds + b.health.clock.seconds
    assert both.moments.sums.tobytes() == on.moments.sums.tobytes()
    assert both.cloud.counts.tobytes() == on.cloud.counts.tobytes()
    assert (len(both), both.health.rows) == (len(on), len(first) + len(second))


def test_rows_skipped_for_the_same_reason_are_counted_together() -> None:
    a = DataQuality(skipped=(Skipped("unreadable", 2, (3, 9), "?"),))
    b = DataQuality(skipped=(Skipped("not finite", 1, (4,)), Skipped("unreadable", 1, (30,))))
    assert (a + b).skipped == (Skipped("unreadable", 3, (3, 9, 30), "?"), Skipped("not finite", 1, (4,)))


@given(recordings(), st.data())
def test_a_summary_split_anywhere_and_merged_is_the_whole(recording: Samples, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(recording)))
    whole = Summary.of(recording, side=1.0)
    merged = Summary.of(recording[:cut], side=1.0) + Summary.of(recording[cut:], side=1.0)
    same(merged.health, whole.health)
    assert len(merged) == len(whole) == len(recording)
    assert np.array_equal(merged.cloud.keys, whole.cloud.keys)
    assert np.array_equal(merged.cloud.counts, whole.cloud.counts)
    unit = max(merged.moments.unit, whole.moments.unit)
    npt.assert_allclose(merged.moments._convert_unit(unit), whole.moments._convert_unit(unit), atol=1e-12)


@given(recordings())
def test_the_empty_summary_is_the_identity(recording: Samples) -> None:
    summary = Summary.of(recording)
    for other in (summary + Summary.empty(), Summary.empty() + summary):
        same(other.health, summary.health)
        assert np.array_equal(other.cloud.keys, summary.cloud.keys)
        assert other.moments.sums.tobytes() == summary.moments.sums.tobytes()


class Blocks:
    """A recording that comes in blocks of seven."""

    def __init__(self, samples: Samples) -> None:
        self.source, self.unit, self.axes = samples.source, samples.unit, samples.axes
        self.whole = samples

    def blocks(self) -> Iterator[Samples]:
        """Seven rows at a time."""
        return self.whole.blocks(7)


def test_block_by_block_it_is_the_summary_of_the_whole() -> None:
    field = np.random.default_rng(1).normal(size=(200, 3)) * 50
    samples = Samples.of(field, time=np.arange(200) * 0.02)
    whole, streamed = Summary.of(samples), Summary.of_recording(Blocks(samples))
    same(streamed.health, whole.health)
    assert streamed.cloud.counts.sum() == 200
    npt.assert_allclose(streamed.moments.about(0 * field[0], 50.0), whole.moments.about(0 * field[0], 50.0), atol=1e-10)


def test_a_long_array_is_summarised_in_stretches() -> None:
    field = np.random.default_rng(2).normal(size=(150_000, 3)) * 50
    field[65_536] = field[65_535]
    summary = Summary.of(field)
    assert (len(summary), summary.health.repeats) == (150_000, 1)
    assert summary.cloud.counts.sum() == 150_000
    npt.assert_allclose(summary.moments.mean, field.mean(axis=0), atol=1e-10)


def test_forgetting_fades_sums_and_cells_and_keeps_the_record_of_health() -> None:
    summary = Summary.of(np.random.default_rng(3).normal(size=(100, 3)))
    faded = summary.forget(0.5)
    assert faded.moments.count == 50.0
    assert faded.cloud.counts.sum() == pytest.approx(50.0)
    assert faded.health is summary.health
    assert repr(summary).startswith("Summary(100 readings")
