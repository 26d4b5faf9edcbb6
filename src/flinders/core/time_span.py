"""Part of a recording between two times.

>>> from flinders.core.samples import Samples
>>> clock = TimeSpan(1.0, 2.0).clock("tumble.csv")
>>> clock.is_within(Samples.of([[1, 2, 3]] * 4, time=[100.0, 101.0, 102.0, 103.0]))
array([False,  True,  True, False])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.errors import UsageError, figures

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.core.samples import Samples


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """Span of time from `start` to `end`, both included, in s from the beginning of the recording."""

    start: float = -np.inf
    end: float = np.inf

    @classmethod
    def of(cls, start: float | None, end: float | None) -> TimeSpan:
        """Check the user's times; None is unlimited."""
        ends: tuple[tuple[str, Any], ...] = (("from", start), ("to", end))
        for name, given in ends:
            is_number = isinstance(given, int | float | np.number)
            if given is not None and not (is_number and np.isfinite(given) and given >= 0):
                raise UsageError(f"--{name} is {given!r}: need seconds from the beginning of the recording, 0 or more")
        span = cls(-np.inf if start is None else float(start), np.inf if end is None else float(end))
        if span.end <= span.start:
            raise UsageError(
                f"the time span from {span.start:g} to {span.end:g} s is empty: need an end after its start"
            )
        return span

    @property
    def is_all(self) -> bool:
        """Whether the span is unlimited."""
        return self == TimeSpan()

    def clock(self, source: str, beginning: float = np.nan) -> SpanClock:
        """Start a pass over the recording `source`; `beginning` is the time of its first reading in s, if known."""
        return SpanClock(self, source, beginning)

    def __str__(self) -> str:
        ends = {"from": self.start, "to": self.end}
        return " ".join(f"{word} {time:g} s" for word, time in ends.items() if np.isfinite(time))


class SpanClock:
    """One pass over a recording: selects readings within the span, and counts them."""

    def __init__(self, span: TimeSpan, source: str, beginning: float) -> None:
        self._span, self._source, self._beginning = span, source, beginning
        self._last, self._taken = np.nan, 0

    def is_within(self, samples: Samples) -> NDArray[np.bool_]:
        """(N,) whether each reading is within the span; a reading without a time is not."""
        if self._span.is_all:
            return np.ones(len(samples), dtype=np.bool_)
        if samples.time is None:
            raise UsageError(
                f"{self._source} has no times: leave beginning and end out, or cut the file with a text editor",
                hint={"start": None, "end": None},
            )
        known = samples.time[np.isfinite(samples.time)]
        if len(known):
            self._beginning = known[0] if np.isnan(self._beginning) else self._beginning
            self._last = known[-1]
        since = samples.time - self._beginning
        inside = np.asarray((since >= self._span.start) & (since <= self._span.end), dtype=np.bool_)
        self._taken += int(np.count_nonzero(inside))
        return inside

    def select(self, samples: Samples, within: NDArray[np.bool_]) -> Samples:
        """Readings within the span; the same object if all are."""
        return samples if within.all() else samples[within]

    def refuse_empty(self) -> None:
        """Raise `UsageError` at the end of the pass if no reading was within the span."""
        if not self._span.is_all and not self._taken:
            length = "has no valid times"
            if np.isfinite(self._last - self._beginning):
                length = f"is {figures(self._last - self._beginning, 4)} s long"
            raise UsageError(f"no reading of {self._source} is in the time span {self._span}: the recording {length}")
