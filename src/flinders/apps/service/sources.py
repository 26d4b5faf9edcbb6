"""Sources of an online calibration: a wire, a pipe or recordings, with readings on one monotonic time.

>>> from flinders import simulate
>>> source = of_recordings([simulate.tumble(seed=1).samples])
>>> readings = source.next(0.1)
>>> len(readings), readings.unit.name, source.now is None
(3000, 'uT', True)
>>> source.next(0.1).kind
'ended'
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from flinders.apps.service.clocks import MachineClock, RecordedClock
from flinders.core.units import Unit
from flinders.errors import UnitError, UnreadableInput, UsageError
from flinders.links.feeds import FeedEvent
from flinders.links.recipients import Recipient
from flinders.links.recorder import Recorder
from flinders.readers._times import MIN_EPOCH_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.links.feeds import Feed, Received
    from flinders.links.recording_statistics import RecordingStatistics
    from flinders.links.transports import ByteSource, StandardInput

MIN_BATCH: Final = 40
"""Largest number of readings in a small batch. After a larger one, the source is read again at once, before system
buffers are full."""
REST_S: Final = 0.1  # Pause after a small batch, so that later readings form one batch


class Clock(Protocol):
    """Converts times of readings to one monotonic time."""

    @property
    def now(self) -> float | None:
        """Current time without a reading; None if unknown."""

    def of(self, times: Floats) -> Floats:
        """Convert (N,) times of the source to monotonic ones."""

    def remarks(self) -> list[str]:
        """Return sentences on the clock since the last call."""


class Source:
    """A feed with readings on one monotonic time.

    Parameters
    ----------
    feed : Feed
    clock : Clock
    statistics : RecordingStatistics, optional
        Counts of lines of the feed.
    rests : bool
        Pause after a small batch, as a live sensor allows.

    Attributes
    ----------
    feed : Feed
    """

    def __init__(
        self, feed: Feed, clock: Clock, *, statistics: RecordingStatistics | None = None, rests: bool = False
    ) -> None:
        self.name, self.statistics = feed.name, statistics
        self.feed, self._clock, self._rests = feed, clock, rests

    @property
    def now(self) -> float | None:
        """Current time without a reading; None for recordings."""
        return self._clock.now

    @property
    def recipient(self) -> Recipient | None:
        """Recipient of the calibration; None without one."""
        return self.feed if isinstance(self.feed, Recipient) else None

    @property
    def not_understood(self) -> int:
        """Number of lines of unknown format."""
        return 0 if self.statistics is None else self.statistics.unknown - self.statistics.accompanying

    def next(self, timeout: float) -> Received:
        """As `Feed.next`, with times by the clock."""
        received = self.feed.next(timeout)
        if received is None or isinstance(received, FeedEvent):
            return received
        if self._rests and len(received) < MIN_BATCH:
            time.sleep(REST_S)
        return self._with_clock_times(received)

    def remarks(self) -> list[str]:
        """Return sentences on the clock since the last call."""
        return self._clock.remarks()

    def close(self) -> None:
        """Close the source."""
        self.feed.close()

    def _with_clock_times(self, samples: Samples) -> Samples | None:
        if samples.time is None:
            raise UnreadableInput(f"{self.name} has no times: an online calibration needs the times of readings")
        known = np.isfinite(samples.time)
        if not known.any():
            return None
        return replace(samples[known], time=self._clock.of(samples.time[known]))


def of_wire(wire: ByteSource, since: float | None, **reading: Any) -> Source:
    """Return the source of a wire's lines, timed by this machine's clock; `reading` are arguments of `Recorder`."""
    recorder = Recorder(wire, **reading)
    return Source(recorder, MachineClock(since), statistics=recorder.statistics, rests=True)


def of_feed(feed: Feed, since: float | None, *, rests: bool = True) -> Source:
    """Return the source of a live feed, such as a vehicle, timed by this machine's clock."""
    return Source(feed, MachineClock(since), rests=rests)


def of_pipe(pipe: StandardInput, since: float | None, **reading: Any) -> Source:
    """Return the source of standard input; times are those of its lines, else the time of arrival."""
    recorder = Recorder(pipe, **reading)
    return _Piped(recorder, pipe, since)


def of_recordings(recordings: Sequence[Recording], starts: Sequence[float] = ()) -> Source:
    """Return the source of recordings one after the other, at full speed.

    Parameters
    ----------
    recordings : sequence of Recording
        In the order of time if all times count from 1970, else in the given order.
    starts : sequence of float
        Start of the times of each, s from 1970; 0 if unknown.
    """
    dated = list(zip(recordings, starts or [0.0] * len(recordings), strict=True))
    if all(start >= MIN_EPOCH_S for _, start in dated):
        dated.sort(key=lambda each: each[1] + first_time(each[0]))
    return _Replayed(_Recordings(dated), [recording for recording, _ in dated])


def first_time(recording: Recording) -> float:
    """First time of a recording, s; infinite without times."""
    times = (block.time[0] for block in recording.blocks() if block.time is not None and len(block))
    return float(next(times, math.inf))


class _Recordings:
    """Feed that plays recordings, one after the other."""

    def __init__(self, dated: Sequence[tuple[Recording, float]]) -> None:
        self.name = ", ".join(recording.source for recording, _ in dated)
        self._dated = dated
        self._blocks = self._all()

    def _all(self) -> Iterator[Samples]:
        for recording, start in self._dated:
            for block in recording.blocks():
                if block.time is None:
                    raise _timeless(recording.source)
                yield replace(block, time=block.time + start)

    def next(self, _timeout: float) -> Received:
        block = next(self._blocks, None)
        return FeedEvent("ended", 0.0, f"{self.name}: read to the end") if block is None else block

    def close(self) -> None:
        self._blocks = iter(())


class _Replayed(Source):
    """Source of recordings, which counts the lines that their readers left out."""

    def __init__(self, feed: Feed, recordings: Sequence[Recording]) -> None:
        super().__init__(feed, RecordedClock())
        self._recordings = recordings

    @property
    def not_understood(self) -> int:
        skipped = (entry for recording in self._recordings for entry in getattr(recording, "skipped", ()))
        return sum(entry.rows for entry in skipped if entry.is_loss)


class _Piped(Source):
    """Source of standard input; the first reading shows whether its lines have times."""

    def __init__(self, recorder: Recorder, pipe: StandardInput, since: float | None) -> None:
        self._machine = MachineClock(since)
        super().__init__(recorder, self._machine, statistics=recorder.statistics)
        self._recorder, self._pipe, self._since = recorder, pipe, since
        self._is_chosen = False

    def next(self, timeout: float) -> Received:
        if self._pipe.is_done:
            self._recorder.close()  # passes on waiting readings and the end
        return super().next(timeout)

    @property
    def now(self) -> float | None:
        return self._clock.now if self._is_chosen else None

    def _with_clock_times(self, samples: Samples) -> Samples | None:
        start = self._recorder.clock_start
        if not self._is_chosen:
            self._is_chosen = True
            self._clock = self._machine if start is None else RecordedClock(self._since)
        if start and samples.time is not None:
            samples = replace(samples, time=samples.time + start)
        return super()._with_clock_times(samples)


def _timeless(name: str) -> UnreadableInput:
    return UnreadableInput(f"{name} has no times: an online calibration needs the times of readings")


def raw_unit(samples: Samples) -> Unit:
    """Unit of the raw readings of a source; for a unit with a scale of its own, the unit of `Samples.field`.

    >>> from flinders import Samples
    >>> raw_unit(Samples.of([[1, 2, 3]], unit="mG")).name, raw_unit(Samples.of([[1, 2, 3]], scale=0.15)).name
    ('mG', 'uT')
    """
    unit = samples.unit
    return unit if unit == Unit.of(unit.name) else Unit.of(unit.inside)


def raw_readings(samples: Samples, unit: Unit) -> Floats:
    """(N, 3) readings in a unit; `UnitError` if they cannot be converted."""
    if samples.unit.inside != unit.inside:
        raise UnitError(
            f"{samples.source} is in {samples.unit.name}, the calibration is for readings in {unit.name}: use a "
            f"calibration for {samples.unit.name}"
        )
    return samples.field if unit.scale == 1.0 else samples.field / unit.scale


def disturbance_values(samples: Samples, name: str) -> Floats:
    """(N,) values of a disturbance in the calibration; `UsageError` if the source lacks them."""
    values = samples.disturbance_values(name)
    if values is None:
        raise UsageError(
            f"the calibration depends on {name}, which {samples.source} does not contain: record {name}, or begin with "
            f"a calibration that does not depend on {name}"
        )
    return values
