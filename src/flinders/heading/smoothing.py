"""Filters for noisy readings: moving average, running median, and a Kalman filter for a constant field.

A fit needs none of them: a likelihood averages over all readings already, and a filter that looks at several readings
of a turning sensor gives one that lies inside the ellipsoid. They are for what takes single readings at their word: a
display of headings, a corrected stream, and methods that go by extremes.

>>> spiky = Samples.of([[20.0, 0, 40], [20, 1, 40], [20, 2, 400], [20, 3, 40], [20, 4, 40]])
>>> [block.field[:, 2] for block in filtered(spiky, Filter("median", 3)).blocks()]
[array([40., 40., 40., 40., 40.])]

What a uniform turn loses by it, here at 10° from one reading to the next, as a share of the radius that is left:

>>> [round(Filter(name, 5).keeps(10.0), 3) for name in NAMES]
[0.97, 0.985, 0.92]
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

import numpy as np

from flinders.core.joining import Joined
from flinders.core.samples import Samples, Wrapped
from flinders.errors import UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

Name: TypeAlias = Literal["moving-average", "median", "kalman"]
NAMES: Final[tuple[Name, ...]] = get_args(Name)

_Vector: TypeAlias = tuple[float, float, float]

WIDTH: Final = 5
"""Readings, where nothing is said: a tenth of a second at 50 Hz."""

WIDEST: Final = 999
"""Readings: more than that is no filter of a compass."""

PAUSE: Final = 20.0
"""Mean steps of the clock without a reading, from which on a filter starts afresh."""

STEPS: Final = 10
"""Steps of the clock whose mean tells a pause from a step."""

GATE: Final = 21.108
"""χ² of three numbers that chance exceeds once in ten thousand times."""

PATIENCE: Final = 3
"""Readings beyond the gate, more than there are within it meanwhile, after which it is the field that has changed."""

LOOKED_AT, MEMORY = 11, 50
"""Innovations that tell their scale for the first time, all of them let through; and those over which it is kept."""

MEDIAN_CHI2: Final = 2.366
"""Median of χ² of three numbers."""

AT_ONCE: Final = 500_000
"""Numbers of windows that are looked at together: 4 MB an axis."""


@dataclass(frozen=True, slots=True)
class Filter:
    """A filter and how wide it is.

    ``"moving-average"``
        The mean of `width` readings.
    ``"median"``
        Of `width` readings the one in the middle, axis by axis: single spikes are gone, and so are up to
        (width − 1)/2 in a row.
    ``"kalman"``
        State: the field, a random walk from one reading to the next; measurement: the field and white noise. The walk
        has the standard deviation λ σ for a noise of σ, λ² = K²/(1 − K) with K = 2/(width + 1), so that in the steady
        state it is as quiet as the mean of `width` readings. σ is estimated from the innovations, and a reading
        whose innovation chance exceeds once in ten thousand times is dropped. Three of those in a row, or three more
        than others in between, mean that the field has really changed: the filter goes on from there. The first
        eleven innovations are all let through, as nothing is known of σ.

    Parameters
    ----------
    width : int, readings
        Odd where it is a window, so that there is a reading in its middle.

    Raises
    ------
    UsageError
        For a name or width that there is not.

    References
    ----------
    .. [1] Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001),
       5.2.3 (filter) and 5.4.2 (χ² of innovations), for a random walk; K as of an exponentially weighted mean with the
       variance of `width` readings, K/(2 − K) = 1/width.

    Examples
    --------
    >>> Filter.of("median:7"), Filter.of("kalman")
    (Filter(name='median', width=7), Filter(name='kalman', width=5))
    """

    name: Name
    width: int = WIDTH

    def __post_init__(self) -> None:
        """Refuse what is no filter."""
        if self.name not in NAMES:
            raise UsageError(f"filter {self.name!r} is not known: use {', '.join(NAMES)}, such as median:{WIDTH}")
        odd = self.name == "kalman" or self.width % 2 == 1
        if not 3 <= self.width <= WIDEST or not odd:
            need = "a whole number" if self.name == "kalman" else "an odd number"
            raise UsageError(f"{self.name} over {counted(self.width, 'reading')}: need {need} from 3 to {WIDEST}")

    @classmethod
    def of(cls, text: str) -> Filter:
        """Read ``NAME`` or ``NAME:WIDTH``; `UsageError` for anything else."""
        name, colon, width = text.strip().partition(":")
        number = width.strip()
        if colon and not (number.isascii() and number.isdecimal() and len(number) < 10):
            raise UsageError(f"filter {text!r}: need a number of readings behind the colon, such as median:{WIDTH}")
        return cls(name.strip().casefold(), int(number) if colon else WIDTH)  # type: ignore[arg-type]  # checked there

    def keeps(self, angle_deg: float) -> float:
        """Share of the radius that is left of a circle, gone round uniformly at 0 to 180° from reading to reading.

        A mean of w readings leaves |sin(wθ/2) / (w sin(θ/2))|. A Kalman filter in its steady state is an exponential
        mean, and leaves K / √(K² + 4(1 − K) sin²(θ/2)). A median leaves all but the ends of each axis, which it
        cuts off at cos((w − 1)θ/4) of the radius where steps are fine, and a little lower where they are not: no
        circle is left, and this is half of its width along the axes, up to (w − 1)θ/2 = 90°.

        >>> round(Filter("moving-average", 9).keeps(20.0), 3), round(Filter("median", 9).keeps(20.0), 3)
        (0.64, 0.766)
        """
        angle = math.radians(angle_deg)
        if self.name == "moving-average":
            across = self.width * math.sin(angle / 2.0)
            return min(abs(math.sin(self.width * angle / 2.0) / across), 1.0) if across else 1.0
        if self.name == "median":
            return max(math.cos((self.width - 1) * angle / 4.0), 0.0)
        return self.gain / math.sqrt(self.gain**2 + 4.0 * (1.0 - self.gain) * math.sin(angle / 2.0) ** 2)

    @property
    def gain(self) -> float:
        """K of a Kalman filter in its steady state: the share of each innovation that it follows."""
        return 2.0 / (self.width + 1.0)

    @property
    def lag(self) -> float:
        """Readings by which it is late where it cannot wait for those to come: half of its width."""
        return (self.width - 1) / 2.0

    def start(self, *, centred: bool) -> SmoothingStream:
        """Begin with a recording.

        A centred window lies around its reading, and readings come out when those behind it have come in; otherwise it
        ends with its reading, which comes out at once. A Kalman filter never waits.
        """
        return SmoothingStream(self, centred=centred)

    def __str__(self) -> str:
        return f"{self.name} of {self.width} readings"


def filtered(recording: Recording, by: Filter) -> Recording:
    """A recording with its readings filtered, each file of several on its own.

    Windows are centred, so nothing is late; times and what else stands beside a reading stay with it. Readings that a
    Kalman filter drops are left out with all their columns.
    """
    if isinstance(recording, Joined):
        return Joined(tuple(filtered(part, by) for part in recording.recordings))
    return Filtered(recording, by)


@dataclass(frozen=True, slots=True, eq=False)
class Filtered(Wrapped):
    """One recording with its readings filtered, see `filtered`."""

    recording: Recording
    by: Filter

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording; the blocks have the rows of its own, but for those that are dropped."""
        stream = self.by.start(centred=True)
        waiting: deque[Samples] = deque()
        ready = Passed.nothing()
        for block in self.recording.blocks():
            waiting.append(block)
            ready = ready + stream.push(block.field, block.time)
            while waiting and len(ready) >= len(waiting[0]):
                first = waiting.popleft()
                yield ready[: len(first)].of(first)
                ready = ready[len(first) :]
        ready = ready + stream.finish()
        for block in waiting:
            yield ready[: len(block)].of(block)
            ready = ready[len(block) :]


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """Readings that have come through; in the place of one that was dropped stands what was expected of it."""

    field: Floats  # (N, 3)
    accepted: NDArray[np.bool_]  # (N,) not dropped

    @classmethod
    def nothing(cls) -> Passed:
        """None at all: the identity of ``+``."""
        return cls(np.empty((0, 3)), np.empty(0, dtype=bool))

    def of(self, samples: Samples) -> Samples:
        """What it leaves of some samples."""
        through = replace(samples, field=self.field)
        return through if self.accepted.all() else through[self.accepted]

    def __len__(self) -> int:
        return len(self.field)

    def __getitem__(self, rows: slice) -> Passed:
        return Passed(self.field[rows], self.accepted[rows])

    def __add__(self, other: Passed) -> Passed:
        if not len(other):
            return self
        return Passed(np.concatenate([self.field, other.field]), np.concatenate([self.accepted, other.accepted]))


class SmoothingStream:
    """A filter at work on one recording: readings go in as they come, block by block, wherever blocks end.

    It starts afresh where the clock steps back, and after a pause of twenty mean steps: what lies before a pause says
    nothing of what comes after it. The first ten steps tell what a step is; without times no pause is seen.
    """

    def __init__(self, by: Filter, *, centred: bool) -> None:
        self._run: _Kalman | _Window = _Kalman(by.gain) if by.name == "kalman" else _Window(by, centred=centred)
        self._clock = _Clock()
        self._pauses = 0
        self.dropped = 0  #: readings that a Kalman filter has dropped so far

    @property
    def restarts(self) -> int:
        """Pauses after which it has started afresh, and, of a Kalman filter, fields that have really changed."""
        return self._pauses + self._run.restarts

    def push(self, field: Floats, time: Floats | None = None) -> Passed:
        """Take (N, 3) readings with their (N,) times, and give back what is ready: as many, unless windows wait."""
        through = Passed.nothing()
        pauses = [] if time is None else self._clock.pauses(time)
        for number, (begin, end) in enumerate(pairwise([0, *pauses, len(field)])):
            if number:
                through = through + self.finish()
                self._pauses += 1
            through = through + self._run.push(field[begin:end])
        self.dropped += int(np.count_nonzero(~through.accepted))
        return through

    def finish(self) -> Passed:
        """Give back what still waits for readings to come, and forget what was before."""
        return self._run.finish()


class _Clock:
    """Tells pauses from steps while times come in."""

    def __init__(self) -> None:
        self._last = math.nan
        self._steps, self._seconds = 0, 0.0

    def pauses(self, time: Floats) -> list[int]:
        """Rows before which there is a pause, or a step back."""
        rows = []
        for row, now in enumerate(time.tolist()):
            step = now - self._last
            if step != step:  # noqa: PLR0124 - the first time, or none
                self._last = self._last if now != now else now  # noqa: PLR0124
                continue
            usual = self._seconds / self._steps if self._steps >= STEPS else math.inf
            if step < 0.0 or step > PAUSE * usual > 0.0:
                rows.append(row)
            else:
                self._steps, self._seconds = self._steps + 1, self._seconds + step
            self._last = now
        return rows


class _Window:
    """A window that goes over readings; at an end it is narrower, and centred ones stay so."""

    def __init__(self, by: Filter, *, centred: bool) -> None:
        self.restarts = 0
        self._by, self._centred = by, centred
        self._reach = by.width // 2 if centred else by.width - 1
        self._waiting, self._done = np.empty((0, 3)), 0

    def push(self, field: Floats) -> Passed:
        self._waiting = np.concatenate([self._waiting, field])
        return self._through(len(self._waiting) - (self._reach if self._centred else 0))

    def finish(self) -> Passed:
        rest = self._through(len(self._waiting))
        self._waiting, self._done = np.empty((0, 3)), 0
        return rest

    def _through(self, end: int) -> Passed:
        """Those up to a row whose windows are as full as they will be; what no window needs any more is let go."""
        rows = np.arange(self._done, max(end, self._done))
        back = np.minimum(rows, self._reach)
        if self._centred:
            back = np.minimum(back, len(self._waiting) - 1 - rows)
        out = np.empty((len(rows), 3))
        full = np.flatnonzero(back == self._reach)
        for place in np.flatnonzero(back < self._reach).tolist():
            out[place] = self._middle(int(rows[place]), int(back[place]), 1)[0]
        at_once = max(1, AT_ONCE // self._by.width)
        for some in np.split(full, range(at_once, len(full), at_once)):
            if len(some):  # consecutive, as windows are narrower at the ends alone
                out[some] = self._middle(int(rows[some[0]]), self._reach, len(some))
        let_go = max(int(rows[-1]) + 1 - self._reach, 0) if len(rows) else 0
        self._done += len(rows) - let_go
        self._waiting = self._waiting[let_go:]
        return Passed(out, np.ones(len(out), dtype=bool))

    def _middle(self, row: int, back: int, count: int) -> Floats:
        """(count, 3) mean or median of the windows of so many rows, from one on."""
        ahead = back if self._centred else 0
        around = self._waiting[row - back : row + count + ahead]
        windows = np.lib.stride_tricks.sliding_window_view(around, back + ahead + 1, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):  # numbers that large are refused, but not here
            if self._by.name == "median":
                return np.asarray(np.median(windows, axis=2))
            own = around[back : back + count]
            mean: Floats = own + sum(windows[:, :, place] - own for place in range(back + ahead + 1)) / (
                back + ahead + 1
            )  # about its own reading, so that what is constant stays so to the last bit
            return mean


class _Kalman:
    """A random walk seen through white noise; variances are in units of that of the noise."""

    def __init__(self, gain: float) -> None:
        self.restarts = 0
        self._step_variance = gain**2 / (1.0 - gain)  # λ², from the steady state of the Riccati equation
        self._state: _Vector | None = None
        self._variance = 1.0
        self._beyond: list[_Vector] = []
        self._scale = _Scale()

    def push(self, field: Floats) -> Passed:
        out: list[_Vector] = []
        accepted: list[bool] = []
        for x, y, z in field.tolist():
            state, follows = self._next((x, y, z))
            out.append(state)
            accepted.append(follows)
        return Passed(np.array(out).reshape(-1, 3), np.array(accepted, dtype=bool))

    def finish(self) -> Passed:
        self._state, self._beyond = None, []
        return Passed.nothing()

    def _next(self, reading: _Vector) -> tuple[_Vector, bool]:
        """Predict, look at the innovation, and follow it or not."""
        if self._state is None:
            return self._at(reading), True
        self._variance += self._step_variance
        innovation = tuple(seen - known for seen, known in zip(reading, self._state, strict=True))
        square = _square(innovation) / (self._variance + 1.0)
        if self._scale.is_beyond(square):
            self._beyond.append(reading)
            is_new = len(self._beyond) == PATIENCE
            return (self._reacquired() if is_new else self._state), is_new
        self._beyond = self._beyond[1:]  # one that is within makes up for one beyond, not for all of them
        self._scale.add(square)
        gain = self._variance / (self._variance + 1.0)
        self._variance *= 1.0 - gain
        x, y, z = (known + gain * part for known, part in zip(self._state, innovation, strict=True))
        self._state = (x, y, z)
        return self._state, True

    def _reacquired(self) -> _Vector:
        """Go on where the last readings are; if they differ among themselves, what they do is let through from now."""
        self.restarts += 1
        steps = [_square(tuple(b - a for a, b in zip(*pair, strict=True))) / 2.0 for pair in pairwise(self._beyond)]
        self._scale.widen(sum(steps) / len(steps))
        return self._at(self._beyond[-1])

    def _at(self, reading: _Vector) -> _Vector:
        """Start afresh at a reading."""
        self._state, self._variance, self._beyond = reading, 1.0, []
        return reading


class _Scale:
    """The noise of the readings, as |innovation|² over its variance in units of the noise."""

    def __init__(self) -> None:
        self._first: list[float] = []
        self._square = 0.0
        self._count = 0

    def is_beyond(self, square: float) -> bool:
        """Whether chance makes it less than once in ten thousand times; of what never varied nobody can say."""
        return self._count > 0 and square > GATE * self._square > 0.0

    def add(self, square: float) -> None:
        """Learn from one that was let through."""
        if self._count:
            self._count = min(self._count + 1, MEMORY)
            self._square += (square / 3.0 - self._square) / self._count
            return
        self._first.append(square)
        if len(self._first) == LOOKED_AT:
            self._count, self._square = LOOKED_AT, sorted(self._first)[LOOKED_AT // 2] / MEDIAN_CHI2

    def widen(self, square: float) -> None:
        """Let through what is as large as this."""
        self._square = max(self._square, square / 3.0)


def _square(vector: tuple[float, ...]) -> float:
    """Squared length."""
    return sum(part * part for part in vector)
