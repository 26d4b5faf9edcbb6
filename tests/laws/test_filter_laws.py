"""Laws of filters: they do not know of blocks, keep rows and columns together, and move with the readings."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.trials import examples

from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.heading.smoothing import MAX_WIDTH, NAMES, Filter, FilteredReadings, Name, filter_recording

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.core.axes import Axes
    from flinders.core.units import Unit

FEW: Final = examples(25)
ALL: Final = pytest.mark.parametrize("name", NAMES)

cuts = st.lists(st.integers(0, 300), max_size=12).map(sorted)
widths = st.integers(1, 15).map(lambda half: 2 * half + 1)


class InBlocks:
    """A recording that comes in pieces, some of them empty."""

    source = "in blocks"

    def __init__(self, samples: Samples, cuts: Sequence[int]) -> None:
        self.samples, self.cuts = samples, cuts

    @property
    def unit(self) -> Unit:
        return self.samples.unit

    @property
    def axes(self) -> Axes:
        return self.samples.axes

    def blocks(self) -> Iterator[Samples]:
        for begin, end in pairwise([0, *self.cuts, len(self.samples)]):
            yield self.samples[begin:end]


def recorded(seed: int, rows: int = 300) -> Samples:
    """A turn with noise, spikes, a pause, a clock that steps back once, and rows that can be told from each other."""
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(0.0, 0.1, rows))
    field = 50.0 * np.stack([np.cos(angle), np.sin(angle), 0.3 * np.cos(2 * angle)], axis=1)
    field += 0.3 * rng.standard_normal((rows, 3))
    field[rng.choice(rows, 9, replace=False)] += 80.0 * rng.standard_normal((9, 3))
    time = 0.02 * np.arange(rows)
    time[120:] += 9.0
    time[200:] -= 5.0
    return Samples.of(field, unit="uT", time=time, temperature=np.arange(rows), acceleration=field[:, ::-1])


def whole(blocks: Iterator[Samples]) -> Samples:
    parts = list(blocks)
    assert all(part.time is not None and part.temperature is not None for part in parts)
    return Samples(
        np.concatenate([part.field for part in parts]),
        time=np.concatenate([part.time for part in parts if part.time is not None]),
        temperature=np.concatenate([part.temperature for part in parts if part.temperature is not None]),
    )


@ALL
@given(cuts=cuts, seed=st.integers(0, 20), width=widths)
@FEW
def test_where_blocks_end_changes_no_bit(name: Name, cuts: list[int], seed: int, width: int) -> None:
    samples, by = recorded(seed), Filter(name, width)
    once, pieces = (whole(filter_recording(InBlocks(samples, at), by).blocks()) for at in ([], cuts))
    npt.assert_array_equal(pieces.field, once.field)
    assert pieces.temperature is not None
    assert once.temperature is not None
    npt.assert_array_equal(pieces.temperature, once.temperature)


@ALL
@given(cuts=cuts, seed=st.integers(0, 20), width=widths)
@FEW
def test_a_stream_gives_as_many_readings_as_it_takes_and_knows_no_blocks(
    name: Name, cuts: list[int], seed: int, width: int
) -> None:
    samples, by = recorded(seed), Filter(name, width)
    assert samples.time is not None
    once = by.start(centred=False).push(samples.field, samples.time)
    stream, through = by.start(centred=False), FilteredReadings.nothing()
    for begin, end in pairwise([0, *cuts, len(samples)]):
        passed = stream.push(samples.field[begin:end], samples.time[begin:end])
        assert len(passed) == end - begin
        through = through + passed
    npt.assert_array_equal(through.field, once.field)
    npt.assert_array_equal(through.accepted, once.accepted)
    assert len(stream.finish()) == 0


@ALL
@given(seed=st.integers(0, 50), width=widths)
@FEW
def test_what_stands_beside_a_reading_stays_with_it(name: Name, seed: int, width: int) -> None:
    """Rows are numbered in the column of temperatures; those that are dropped are gone with all their columns."""
    samples = recorded(seed)
    assert samples.time is not None
    through = list(filter_recording(InBlocks(samples, [100, 100, 250]), Filter(name, width)).blocks())
    rows = np.concatenate([part.temperature for part in through if part.temperature is not None]).astype(int)
    assert np.all(np.diff(rows) > 0)
    assert len(rows) == len(samples) or name == "kalman"
    for part in through:
        assert part.temperature is not None
        assert part.acceleration is not None
        own = part.temperature.astype(int)
        npt.assert_array_equal(part.time, samples.time[own])
        npt.assert_array_equal(part.acceleration, samples.field[own][:, ::-1])


@ALL
@given(value=st.floats(-1e6, 1e6), rows=st.integers(1, 60), width=widths)
@FEW
def test_a_constant_stays_what_it_is_to_the_last_bit(name: Name, value: float, rows: int, width: int) -> None:
    """So that a stuck axis is still seen to be stuck."""
    field = np.full((rows, 3), value)
    out = np.concatenate([block.field for block in filter_recording(Samples(field), Filter(name, width)).blocks()])
    npt.assert_array_equal(out, field)


@ALL
@given(
    seed=st.integers(0, 50), width=widths, size=st.floats(0.01, 1e4), shift=st.floats(-500, 500), axis=st.integers(0, 2)
)
@FEW
def test_moved_scaled_swapped_and_mirrored_readings_come_out_alike(
    name: Name, seed: int, width: int, size: float, shift: float, axis: int
) -> None:
    samples, by = recorded(seed), Filter(name, width)
    assert samples.time is not None
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    one = by.start(centred=False).push(samples.field, samples.time)
    other = by.start(centred=False).push(size * (sign * np.roll(samples.field, axis, axis=1) + shift), samples.time)
    npt.assert_array_equal(other.accepted, one.accepted)
    npt.assert_allclose(other.field / size - shift, sign * np.roll(one.field, axis, axis=1), atol=1e-7)


@pytest.mark.parametrize("name", ["moving-average", "median"])
@given(seed=st.integers(0, 50), width=widths)
@FEW
def test_a_centred_window_does_not_know_which_way_time_goes(name: Name, seed: int, width: int) -> None:
    field = recorded(seed).field
    there, back = (
        np.concatenate([block.field for block in filter_recording(Samples(rows), Filter(name, width)).blocks()])
        for rows in (field, field[::-1])
    )
    npt.assert_allclose(back[::-1], there, atol=1e-11)


@given(seed=st.integers(0, 50), width=widths)
@FEW
def test_a_median_is_one_of_the_readings_around(seed: int, width: int) -> None:
    field = recorded(seed).field
    out = np.concatenate([block.field for block in filter_recording(Samples(field), Filter("median", width)).blocks()])
    for row in range(len(field)):
        around = field[max(row - width // 2, 0) : row + width // 2 + 1]
        assert all(out[row, axis] in around[:, axis] for axis in range(3))


@ALL
@given(seed=st.integers(0, 50), width=widths)
@FEW
def test_a_pause_and_a_new_file_make_a_filter_start_afresh(name: Name, seed: int, width: int) -> None:
    """The two halves of a recording with a pause in between, two files, and each half alone: the same readings."""
    field = recorded(seed).field
    time = 0.02 * np.arange(300)
    by = Filter(name, width)
    halves = Samples.of(field[:150], time=time[:150]), Samples.of(field[150:], time=time[150:])
    alone = [block.field for half in halves for block in filter_recording(half, by).blocks()]
    joined = [block.field for block in filter_recording(Joined(halves), by).blocks()]
    npt.assert_array_equal(np.concatenate(joined), np.concatenate(alone))
    if name == "kalman":  # it keeps what it knows of the noise across a pause
        return
    paused = Samples.of(field, time=np.where(np.arange(300) < 150, time, time + 1.0))
    npt.assert_array_equal(
        np.concatenate([block.field for block in filter_recording(paused, by).blocks()]), np.concatenate(alone)
    )


@ALL
@given(angle=st.floats(0.0, 180.0), width=widths)
def test_no_filter_makes_a_circle_larger(name: Name, angle: float, width: int) -> None:
    kept = Filter(name, width).remaining_share(angle)
    assert 0.0 <= kept <= 1.0 + 1e-12
    assert Filter(name, width).remaining_share(0.0) == 1.0


@given(width=st.integers(-10, 1200), name=st.sampled_from(NAMES))
def test_every_width_is_taken_or_refused_with_what_is_needed(width: int, name: Name) -> None:
    text = f"{name}:{width}"
    good = 3 <= width <= MAX_WIDTH and (width % 2 == 1 or name == "kalman")
    if good:
        assert Filter.of(text) == Filter(name, width)
        return
    with pytest.raises(UsageError, match="need"):
        Filter.of(text)
