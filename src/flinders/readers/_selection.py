"""What of a recording is read: which magnetometer, which span of time; and what has to be left out.

>>> from flinders.core.samples import Samples
>>> clock = TimeSpan(1.0, 2.0).clock("tumble.csv")
>>> clock.within(Samples.of([[1, 2, 3]] * 4, time=[100.0, 101.0, 102.0, 103.0]))
array([False,  True,  True, False])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Skipped
from flinders.errors import UnreadableInput, UsageError, figures
from flinders.readers._tokenizer import shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.core.samples import Samples
    from flinders.readers._tokenizer import Lines, NumberRows

UNREADABLE: Final = "unreadable"
NOT_FINITE: Final = "not finite"
SHOWN_LINES: Final = 10
MOST_NAMED: Final = 8  # Magnetometers that a line names; an array may have dozens


@dataclass(frozen=True, slots=True)
class Choice:
    """Which of several magnetometers is meant: the one that was asked for, else the one a calibration was made from.

    >>> Choice("2").among(["mag_left", "mag_right"], "two.csv"), Choice(preferred="mag_right").among(["mag"], "one.csv")
    (1, 0)
    >>> Choice(preferred="mag_bow").among(["mag_left", "mag_right"], "two.csv")
    Traceback (most recent call last):
    flinders.errors.UsageError: two.csv has no magnetometer mag_bow, which the calibration is for: there are 1
        (mag_left), 2 (mag_right); say with --sensor which one it is for
    """

    sensor: str | None = None  # asked for, by its number from 1 or its name
    preferred: str | None = None  # the name of the one that a calibration was made from
    is_name: bool = False  # `sensor` may be given to the only magnetometer of a table, which does not know its name

    @property
    def is_open(self) -> bool:
        """Nobody says which: the first is taken, and the others are named."""
        return self.sensor is None and self.preferred is None

    def among(self, names: Sequence[str], source: str) -> int:
        """Look up its place among these names, from 0; UsageError for one that there is not, with those there are."""
        wanted = self.preferred if self.sensor is None else self.sensor
        if wanted is None or (self.sensor is None and len(names) == 1):
            return 0
        for place, name in enumerate(names):
            numbers = () if self.sensor is None else (str(place + 1),)
            if wanted.strip().casefold() in (*numbers, name.casefold(), name.casefold().removeprefix("/")):
                return place
        verb = "are" if len(names) > 1 else "is"
        there = numbered([f"{number} ({name})" for number, name in enumerate(names, 1)])
        what = f"{source} has no magnetometer {wanted.strip() or repr(wanted)}"
        if self.sensor is None:
            raise UsageError(
                f"{what}, which the calibration is for: there {verb} {there}; say with --sensor which one it is for"
            )
        raise UsageError(f"{what}: there {verb} {there or 'none'}")

    def refuse_alone(self, source: str) -> None:
        """Refuse to choose from a table of one magnetometer."""
        if self.sensor is not None and not self.is_name:
            raise UsageError(
                f"{source} has one magnetometer: leave --sensor out; its columns are chosen with --columns"
            )


FIRST: Final = Choice()  # Nobody says which


def numbered(words: Sequence[str]) -> str:
    """Put numbers and names of magnetometers into a sentence, as many as fit.

    >>> numbered(["2 MAG2", "3 MAG3"])
    '2 MAG2, 3 MAG3'
    """
    more = f" and {len(words) - MOST_NAMED} more" if len(words) > MOST_NAMED else ""
    return ", ".join(words[:MOST_NAMED]) + more


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """From one time to another, in s from the beginning of the recording; both are within."""

    start: float = -np.inf
    end: float = np.inf

    @classmethod
    def of(cls, start: float | None, end: float | None) -> TimeSpan:
        """Take what the user gave; what is not given is not limited."""
        span = cls(-np.inf if start is None else float(start), np.inf if end is None else float(end))
        for name, given in (("from", start), ("to", end)):
            if given is not None and not (np.isfinite(given) and given >= 0):
                raise UsageError(f"--{name} is {given:g}: need seconds from the beginning of the recording, 0 or more")
        if span.end <= span.start:
            raise UsageError(f"--from {span.start:g} --to {span.end:g}: nothing lies between; the end comes second")
        return span

    @property
    def is_all(self) -> bool:
        """Nothing is left out."""
        return self == TimeSpan()

    def clock(self, source: str, beginning: float = np.nan) -> SpanClock:
        """Start a pass over the recording of this name; `beginning` is the time of its first reading, if known."""
        return SpanClock(self, source, beginning)

    def __str__(self) -> str:
        ends = {"from": self.start, "to": self.end}
        return " ".join(f"{word} {time:g} s" for word, time in ends.items() if np.isfinite(time))


class SpanClock:
    """One pass: takes the time of the first reading for the beginning, and knows whether any reading lay within."""

    def __init__(self, span: TimeSpan, source: str, beginning: float) -> None:
        self._span, self._source, self._beginning = span, source, beginning
        self._last, self._taken = np.nan, 0

    def within(self, samples: Samples) -> NDArray[np.bool_]:
        """(N,) whether each reading lies within; those without a time do not."""
        if self._span.is_all:
            return np.ones(len(samples), dtype=np.bool_)
        if samples.time is None:
            raise UsageError(f"{self._source} has no time: leave --from and --to out, or cut it with a text editor")
        known = samples.time[np.isfinite(samples.time)]
        if len(known):
            self._beginning = known[0] if np.isnan(self._beginning) else self._beginning
            self._last = known[-1]
        since = samples.time - self._beginning
        inside = np.asarray((since >= self._span.start) & (since <= self._span.end), dtype=np.bool_)
        self._taken += int(np.count_nonzero(inside))
        return inside

    def selected(self, samples: Samples, within: NDArray[np.bool_]) -> Samples:
        """Those readings; nothing is copied where all are taken."""
        return samples if within.all() else samples[within]

    def judge(self) -> None:
        """Refuse a span in which nothing lies, at the end of the pass."""
        if not self._span.is_all and not self._taken:
            length = "without a clock that runs"
            if np.isfinite(self._last - self._beginning):
                length = f"{figures(self._last - self._beginning, 4)} s long"
            raise UsageError(f"no reading of {self._source} lies {self._span}: it is {length}")


class Tally:
    """Counts what is read and what is not, so that a file of which little can be read is refused."""

    def __init__(self) -> None:
        self.rows = self.usable = 0
        self.unreadable = 0
        self.first = self.last = (0, "")

    def add(self, rows: NumberRows, usable: NDArray[np.bool_]) -> None:
        """Count one stretch."""
        self.rows += len(usable)
        self.usable += int(usable.sum())
        if rows.unreadable:
            self.first = self.first if self.unreadable else rows.unreadable[0]
            self.last = rows.unreadable[-1]
            self.unreadable += len(rows.unreadable)

    def judge(self, name: str, skipped: tuple[Skipped, ...]) -> None:
        """Refuse a file more than half of which is unreadable, or in which nothing can be used."""
        if self.unreadable > self.rows:
            raise UnreadableInput(
                f"{self.unreadable:,} of {self.unreadable + self.rows:,} lines of {name} are not readings: "
                f"the first is line {self.first[0]} ({shown(self.first[1])!r}), the last line {self.last[0]} "
                f"({shown(self.last[1])!r}); check what was recorded, or name the columns with --columns"
            )
        if not self.usable:
            raise UnreadableInput(
                f"no usable reading in {name}: {'; '.join(map(str, skipped))}; need finite x, y and z: "
                "check the sensor and its wiring"
            )


def added(one: tuple[Skipped, ...], other: tuple[Skipped, ...]) -> tuple[Skipped, ...]:
    """Put two accounts of what was left out together, one entry a reason."""
    reasons = {entry.reason: entry for entry in one}
    for entry in other:
        reasons[entry.reason] = reasons[entry.reason] + entry if entry.reason in reasons else entry
    return tuple(reasons.values())


def left_out_of(lines: Lines, rows: NumberRows, usable: NDArray[np.bool_]) -> tuple[Skipped, ...]:
    """Account for the rows of a stretch that cannot be used, and the lines that are none."""
    accounts = []
    if not usable.all():
        gaps = [rows.lines[int(place)] for place in np.flatnonzero(~usable)]
        accounts.append((NOT_FINITE, gaps, lines.texts[gaps[0] - lines.first]))
    if rows.unreadable:
        accounts.append((UNREADABLE, [line for line, _ in rows.unreadable], rows.unreadable[0][1]))
    return tuple(
        Skipped(reason, len(numbers), tuple(numbers[:SHOWN_LINES]), shown(example))
        for reason, numbers, example in accounts
    )
