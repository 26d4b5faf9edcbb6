"""Where a calibration takes its readings from: a wire, a pipe or recordings; all in one unit and on one time.

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

from flinders.apps.service.clocks import FROM_1970_S, MachineClock, RecordedClock
from flinders.core.units import Unit
from flinders.errors import UnitError, UnreadableInput, UsageError
from flinders.links.feeds import FeedEvent
from flinders.links.recipients import Recipient
from flinders.links.recorder import Recorder

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.links.feeds import Feed, Received
    from flinders.links.transcript import RecordingStatistics
    from flinders.links.transports import ByteSource, StandardInput

LITTLE: Final = 40
"""Readings of an answer; a faster sensor is asked again at once, before what the system keeps for it is full."""
REST_S: Final = 0.1  # Seconds to the next question, where little came: what comes meanwhile is then read in one go


class Clock(Protocol):
    """Puts readings onto one time."""

    @property
    def now(self) -> float | None:
        """The time without a reading; None where that is not known."""

    def of(self, times: Floats) -> Floats:
        """(N,) times of the source as that time."""

    def remarks(self) -> list[str]:
        """What has happened to the clock since this was last asked."""


class Source:
    """A feed whose readings are on one time.

    Parameters
    ----------
    feed : Feed
    clock : Clock
    statistics : RecordingStatistics, optional
        What the feed counts of lines.
    rests : bool
        Wait for more where little came, as a live sensor allows.

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
        """The time without a reading; None of recordings, where nothing is known of it."""
        return self._clock.now

    @property
    def recipient(self) -> Recipient | None:
        """What takes a calibration of the readings; None where nothing does."""
        return self.feed if isinstance(self.feed, Recipient) else None

    @property
    def not_understood(self) -> int:
        """Lines that should have been readings."""
        return 0 if self.statistics is None else self.statistics.unknown - self.statistics.accompanying

    def next(self, timeout: float) -> Received:
        """As `Feed.next`; times are those of the clock."""
        received = self.feed.next(timeout)
        if received is None or isinstance(received, FeedEvent):
            return received
        if self._rests and len(received) < LITTLE:
            time.sleep(REST_S)
        return self._timed(received)

    def remarks(self) -> list[str]:
        """What has happened to the clock since this was last asked."""
        return self._clock.remarks()

    def close(self) -> None:
        """Let go of the source."""
        self.feed.close()

    def _timed(self, samples: Samples) -> Samples | None:
        if samples.time is None:
            raise UnreadableInput(
                f"{self.name} has no times: a calibration that goes on needs to know when readings were"
            )
        known = np.isfinite(samples.time)
        if not known.any():
            return None
        return replace(samples[known], time=self._clock.of(samples.time[known]))


def of_wire(wire: ByteSource, since: float | None, **reading: Any) -> Source:
    """Lines of a wire, on the time of this machine; `reading` goes to `Recorder`."""
    recorder = Recorder(wire, **reading)
    return Source(recorder, MachineClock(since), statistics=recorder.statistics, rests=True)


def of_feed(feed: Feed, since: float | None, *, rests: bool = True) -> Source:
    """A feed of a live sensor, such as a vehicle, on the time of this machine."""
    return Source(feed, MachineClock(since), rests=rests)


def of_pipe(pipe: StandardInput, since: float | None, **reading: Any) -> Source:
    """Lines of standard input, on their own time, or that of this machine where they have none."""
    recorder = Recorder(pipe, **reading)
    return _Piped(recorder, pipe, since)


def of_recordings(recordings: Sequence[Recording], starts: Sequence[float] = ()) -> Source:
    """Recordings one after the other, as fast as they are read.

    Parameters
    ----------
    recordings : sequence of Recording
        Where all have a clock that counts from 1970, in the order of time, else as they are given.
    starts : sequence of float
        Seconds from 1970 at which the times of each start to count; 0 where they count from something else.
    """
    dated = list(zip(recordings, starts or [0.0] * len(recordings), strict=True))
    if all(start >= FROM_1970_S for _, start in dated):
        dated.sort(key=lambda each: each[1] + first_time(each[0]))
    return _Replayed(_Recordings(dated), [recording for recording, _ in dated])


def first_time(recording: Recording) -> float:
    """First time of a recording, s; infinite where it has none."""
    times = (block.time[0] for block in recording.blocks() if block.time is not None and len(block))
    return float(next(times, math.inf))


class _Recordings:
    """Recordings as a feed."""

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
    """Recordings, which know what they left out."""

    def __init__(self, feed: Feed, recordings: Sequence[Recording]) -> None:
        super().__init__(feed, RecordedClock())
        self._recordings = recordings

    @property
    def not_understood(self) -> int:
        skipped = (entry for recording in self._recordings for entry in getattr(recording, "skipped", ()))
        return sum(entry.rows for entry in skipped if entry.is_loss)


class _Piped(Source):
    """Lines of standard input, whose clock is chosen with the first reading."""

    def __init__(self, recorder: Recorder, pipe: StandardInput, since: float | None) -> None:
        self._machine = MachineClock(since)
        super().__init__(recorder, self._machine, statistics=recorder.statistics)
        self._recorder, self._pipe, self._since = recorder, pipe, since
        self._is_chosen = False

    def next(self, timeout: float) -> Received:
        if self._pipe.is_done:
            self._recorder.close()  # hands on what waits, and says that it has ended
        return super().next(timeout)

    @property
    def now(self) -> float | None:
        return self._clock.now if self._is_chosen else None

    def _timed(self, samples: Samples) -> Samples | None:
        start = self._recorder.clock_start
        if not self._is_chosen:
            self._is_chosen = True
            self._clock = self._machine if start is None else RecordedClock(self._since)
        if start and samples.time is not None:
            samples = replace(samples, time=samples.time + start)
        return super()._timed(samples)


def _timeless(name: str) -> UnreadableInput:
    return UnreadableInput(f"{name} has no times: a calibration that goes on needs to know when readings were")


def raw_unit(samples: Samples) -> Unit:
    """The unit that readings of a source were written in; that of `Samples.field` where it has a scale of its own.

    >>> from flinders import Samples
    >>> raw_unit(Samples.of([[1, 2, 3]], unit="mG")).name, raw_unit(Samples.of([[1, 2, 3]], scale=0.15)).name
    ('mG', 'uT')
    """
    unit = samples.unit
    return unit if unit == Unit.of(unit.name) else Unit.of(unit.inside)


def raw_readings(samples: Samples, unit: Unit) -> Floats:
    """(N, 3) readings in a unit; `UnitError` where that is of another kind."""
    if samples.unit.inside != unit.inside:
        raise UnitError(
            f"{samples.source} is in {samples.unit.name}, the calibration is for readings in {unit.name}: it belongs "
            "to another kind of recording"
        )
    return samples.field if unit.scale == 1.0 else samples.field / unit.scale


def driving_of(samples: Samples, name: str) -> Floats:
    """(N,) values of a disturbance that the calibration follows; `UsageError` where a source has none."""
    values = samples.driving(name)
    if values is None:
        raise UsageError(
            f"the calibration follows {name}, which {samples.source} does not record: record it, or begin with a "
            "calibration without it"
        )
    return values
