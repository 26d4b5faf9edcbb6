"""Filters for noisy readings: moving average, running median, and a Kalman filter for a constant field.

A fit needs no filter: the likelihood averages over all readings already, and the mean of several readings of a turning
sensor lies inside the ellipsoid. Filters are for uses of single readings: a display of headings, a corrected stream,
and methods that use extremes.

>>> spiky = Samples.of([[20.0, 0, 40], [20, 1, 40], [20, 2, 400], [20, 3, 40], [20, 4, 40]])
>>> [block.field[:, 2] for block in filter_recording(spiky, Filter("median", 3)).blocks()]
[array([40., 40., 40., 40., 40.])]

Share of the radius that remains in a uniform turn, here with 10° between readings:

>>> [round(Filter(name, 5).remaining_share(10.0), 3) for name in NAMES]
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
from flinders.core.samples import RecordingWrapper, Samples
from flinders.errors import UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

Name: TypeAlias = Literal["moving-average", "median", "kalman"]
NAMES: Final[tuple[Name, ...]] = get_args(Name)

_Vector: TypeAlias = tuple[float, float, float]

DEFAULT_WIDTH: Final = 5
"""Width in readings by default, 0.1 s at 50 Hz."""

MAX_WIDTH: Final = 999
"""Largest width in readings; larger ones are not useful for a compass."""

MIN_PAUSE_STEPS: Final = 20.0
"""Smallest pause after which a filter restarts, in mean intervals between readings."""

STEPS_IN_MEAN: Final = 10
"""Count of intervals between readings in the mean interval."""

MAX_CHI2: Final = 21.108
"""χ² with three degrees of freedom that is exceeded by chance with a probability of 0.01 %."""

MAX_REJECTED: Final = 3
"""Count of rejected minus accepted readings, since the first rejected one, at which the field counts as changed."""

INITIAL_INNOVATIONS, SCALE_INNOVATIONS = 11, 50
"""Count of innovations for the scale of the noise: of the first ones, which are all accepted, and later."""

MEDIAN_CHI2: Final = 2.366
"""Median of χ² with three degrees of freedom."""

CHUNK_NUMBERS: Final = 500_000
"""Count of numbers in windows that are processed together: 4 MB per axis."""


@dataclass(frozen=True, slots=True)
class Filter:
    """A filter with its width.

    ``"moving-average"``
        The mean of `width` readings.
    ``"median"``
        The median of `width` readings, axis by axis. It removes single spikes, and up to (width − 1)/2 in a row.
    ``"kalman"``
        The state is the field, which changes from one reading to the next by a random walk; a reading is the field plus
        white noise of σ. The walk has the standard deviation λ σ, λ² = K²/(1 − K) with K = 2/(width + 1), so that in
        the steady state the noise is that of the mean of `width` readings. σ is estimated from the innovations. A
        reading is dropped if an innovation as large has a probability below 0.01 %. If three readings in a row are
        dropped, or three more than are accepted meanwhile, the field has changed, and the filter continues from the new
        field. The first eleven innovations are all accepted, because σ is not yet known.

    Parameters
    ----------
    width : int, readings
        Width; odd for a window, so that there is a reading in its middle.

    Raises
    ------
    UsageError
        For an unknown name or an invalid width.

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
    width: int = DEFAULT_WIDTH

    def __post_init__(self) -> None:
        """Refuse an unknown name and an invalid width."""
        if self.name not in NAMES:
            raise UsageError(
                f"filter {self.name!r} is not known: use {', '.join(NAMES)}, such as median:{DEFAULT_WIDTH}"
            )
        odd = self.name == "kalman" or self.width % 2 == 1
        if not 3 <= self.width <= MAX_WIDTH or not odd:
            need = "a whole number" if self.name == "kalman" else "an odd number"
            raise UsageError(f"{self.name} over {count_text(self.width, 'reading')}: need {need} from 3 to {MAX_WIDTH}")

    @classmethod
    def of(cls, text: str) -> Filter:
        """Read ``NAME`` or ``NAME:WIDTH``; `UsageError` for anything else."""
        name, colon, width = text.strip().partition(":")
        number = width.strip()
        if colon and not (number.isascii() and number.isdecimal() and len(number) < 10):
            raise UsageError(
                f"filter {text!r}: need a number of readings after the colon, such as median:{DEFAULT_WIDTH}"
            )
        return cls(name.strip().casefold(), int(number) if colon else DEFAULT_WIDTH)  # type: ignore[arg-type]  # checked there

    def remaining_share(self, angle_deg: float) -> float:
        """Share of the radius of a circle that the filter leaves, for a uniform turn of 0 to 180° per reading.

        For w readings and an angle θ between them, a mean leaves |sin(wθ/2) / (w sin(θ/2))|. A Kalman filter in its
        steady state is an exponential mean, and leaves K / √(K² + 4(1 − K) sin²(θ/2)). A median limits each axis to
        cos((w − 1)θ/4) of the radius for a small θ, and to a little less for a large θ. The result of a median is not
        a circle; its share is half of its width along the axes, up to (w − 1)θ/2 = 90°.

        >>> average, median = Filter("moving-average", 9), Filter("median", 9)
        >>> round(average.remaining_share(20.0), 3), round(median.remaining_share(20.0), 3)
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
        """Gain K of a Kalman filter in its steady state, applied to each innovation."""
        return 2.0 / (self.width + 1.0)

    @property
    def lag(self) -> float:
        """Delay in readings of a filter that is not centred: half of its width."""
        return (self.width - 1) / 2.0

    def start(self, *, centred: bool) -> SmoothingStream:
        """Start the filter for one recording.

        With `centred`, a window is symmetric about its reading, so that the filtered reading is returned only after the
        following readings have arrived. Otherwise a window ends with its reading, and the filtered reading is returned
        immediately. A Kalman filter always returns immediately.
        """
        return SmoothingStream(self, centred=centred)

    def __str__(self) -> str:
        return f"{self.name} of {self.width} readings"


def filter_recording(recording: Recording, by: Filter) -> Recording:
    """A recording with filtered readings; each of several files is filtered separately.

    Windows are centred, so that there is no delay. The other columns of each reading are unchanged. Readings that a
    Kalman filter drops are left out with all their columns.
    """
    if isinstance(recording, Joined):
        return Joined(tuple(filter_recording(part, by) for part in recording.recordings))
    return FilteredRecording(recording, by)


@dataclass(frozen=True, slots=True, eq=False)
class FilteredRecording(RecordingWrapper):
    """One recording with filtered readings, see `filter_recording`."""

    recording: Recording
    by: Filter

    def blocks(self) -> Iterator[Samples]:
        """Yield filtered blocks of the recording, without dropped readings."""
        stream = self.by.start(centred=True)
        waiting: deque[Samples] = deque()
        ready = FilteredReadings.nothing()
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
class FilteredReadings:
    """Filtered readings; the value of a dropped reading is its prediction."""

    field: Floats  # (N, 3): filtered readings
    accepted: NDArray[np.bool_]  # (N,): whether each reading was not dropped

    @classmethod
    def nothing(cls) -> FilteredReadings:
        """No readings, the zero of addition."""
        return cls(np.empty((0, 3)), np.empty(0, dtype=bool))

    def of(self, samples: Samples) -> Samples:
        """Samples with the filtered readings, without dropped ones."""
        through = replace(samples, field=self.field)
        return through if self.accepted.all() else through[self.accepted]

    def __len__(self) -> int:
        return len(self.field)

    def __getitem__(self, rows: slice) -> FilteredReadings:
        return FilteredReadings(self.field[rows], self.accepted[rows])

    def __add__(self, other: FilteredReadings) -> FilteredReadings:
        if not len(other):
            return self
        return FilteredReadings(
            np.concatenate([self.field, other.field]), np.concatenate([self.accepted, other.accepted])
        )


class SmoothingStream:
    """A running filter of one recording, which takes readings in blocks of any size.

    The filter restarts if the clock steps back, and after a pause of 20 mean intervals between readings, because
    readings before a pause are unrelated to those after it. The mean is over ten intervals. Without times no pause is
    detected.
    """

    def __init__(self, by: Filter, *, centred: bool) -> None:
        self._run: _Kalman | _Window = _Kalman(by.gain) if by.name == "kalman" else _Window(by, centred=centred)
        self._clock = _Clock()
        self._pauses = 0
        self.dropped = 0  #: count of readings that a Kalman filter has dropped so far

    @property
    def restarts(self) -> int:
        """Count of restarts after pauses and, by a Kalman filter, after changes of the field."""
        return self._pauses + self._run.restarts

    def push(self, field: Floats, time: Floats | None = None) -> FilteredReadings:
        """Add (N, 3) readings with their (N,) times, and return the readings that are now filtered completely."""
        through = FilteredReadings.nothing()
        pauses = [] if time is None else self._clock.pauses(time)
        for number, (begin, end) in enumerate(pairwise([0, *pauses, len(field)])):
            if number:
                through = through + self.finish()
                self._pauses += 1
            through = through + self._run.push(field[begin:end])
        self.dropped += int(np.count_nonzero(~through.accepted))
        return through

    def finish(self) -> FilteredReadings:
        """Return the readings whose centred windows were not yet complete, and reset the filter."""
        return self._run.finish()


class _Clock:
    """Detector of pauses in a stream of times."""

    def __init__(self) -> None:
        self._last = math.nan
        self._steps, self._seconds = 0, 0.0

    def pauses(self, time: Floats) -> list[int]:
        """Rows before which there is a pause, or the clock steps back."""
        rows = []
        for row, now in enumerate(time.tolist()):
            step = now - self._last
            if step != step:  # noqa: PLR0124 - the first time, or none
                self._last = self._last if now != now else now  # noqa: PLR0124
                continue
            usual = self._seconds / self._steps if self._steps >= STEPS_IN_MEAN else math.inf
            if step < 0.0 or step > MIN_PAUSE_STEPS * usual > 0.0:
                rows.append(row)
            else:
                self._steps, self._seconds = self._steps + 1, self._seconds + step
            self._last = now
        return rows


class _Window:
    """A moving window over readings, which is narrower at both ends of a recording; a centred one stays symmetric."""

    def __init__(self, by: Filter, *, centred: bool) -> None:
        self.restarts = 0
        self._by, self._centred = by, centred
        self._reach = by.width // 2 if centred else by.width - 1
        self._waiting, self._done = np.empty((0, 3)), 0

    def push(self, field: Floats) -> FilteredReadings:
        self._waiting = np.concatenate([self._waiting, field])
        return self._filter_until(len(self._waiting) - (self._reach if self._centred else 0))

    def finish(self) -> FilteredReadings:
        rest = self._filter_until(len(self._waiting))
        self._waiting, self._done = np.empty((0, 3)), 0
        return rest

    def _filter_until(self, end: int) -> FilteredReadings:
        """Filtered readings up to a row; readings that no later window contains are removed from memory."""
        rows = np.arange(self._done, max(end, self._done))
        back = np.minimum(rows, self._reach)
        if self._centred:
            back = np.minimum(back, len(self._waiting) - 1 - rows)
        out = np.empty((len(rows), 3))
        full = np.flatnonzero(back == self._reach)
        for place in np.flatnonzero(back < self._reach).tolist():
            out[place] = self._middle(int(rows[place]), int(back[place]), 1)[0]
        at_once = max(1, CHUNK_NUMBERS // self._by.width)
        for some in np.split(full, range(at_once, len(full), at_once)):
            if len(some):  # consecutive, as windows are narrower only at the ends
                out[some] = self._middle(int(rows[some[0]]), self._reach, len(some))
        let_go = max(int(rows[-1]) + 1 - self._reach, 0) if len(rows) else 0
        self._done += len(rows) - let_go
        self._waiting = self._waiting[let_go:]
        return FilteredReadings(out, np.ones(len(out), dtype=bool))

    def _middle(self, row: int, back: int, count: int) -> Floats:
        """(count, 3) mean or median of the windows of `count` rows from `row`, which begin `back` rows earlier."""
        ahead = back if self._centred else 0
        around = self._waiting[row - back : row + count + ahead]
        windows = np.lib.stride_tricks.sliding_window_view(around, back + ahead + 1, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):  # numbers as large are refused elsewhere
            if self._by.name == "median":
                return np.asarray(np.median(windows, axis=2))
            own = around[back : back + count]
            mean: Floats = own + sum(windows[:, :, place] - own for place in range(back + ahead + 1)) / (
                back + ahead + 1
            )  # relative to its own reading, so that a constant stays exactly constant
            return mean


class _Kalman:
    """Kalman filter of a random walk with white noise; variances are relative to that of the noise."""

    def __init__(self, gain: float) -> None:
        self.restarts = 0
        self._step_variance = gain**2 / (1.0 - gain)  # λ², from the steady state of the Riccati equation
        self._state: _Vector | None = None
        self._variance = 1.0
        self._beyond: list[_Vector] = []
        self._scale = _Scale()

    def push(self, field: Floats) -> FilteredReadings:
        out: list[_Vector] = []
        accepted: list[bool] = []
        for x, y, z in field.tolist():
            state, follows = self._next((x, y, z))
            out.append(state)
            accepted.append(follows)
        return FilteredReadings(np.array(out).reshape(-1, 3), np.array(accepted, dtype=bool))

    def finish(self) -> FilteredReadings:
        self._state, self._beyond = None, []
        return FilteredReadings.nothing()

    def _next(self, reading: _Vector) -> tuple[_Vector, bool]:
        """Filter one reading: predict, and accept or reject it by its innovation.

        Returns the state, and whether the reading was accepted.
        """
        if self._state is None:
            return self._at(reading), True
        self._variance += self._step_variance
        innovation = tuple(seen - known for seen, known in zip(reading, self._state, strict=True))
        square = _square(innovation) / (self._variance + 1.0)
        if self._scale.is_beyond(square):
            self._beyond.append(reading)
            is_new = len(self._beyond) == MAX_REJECTED
            return (self._reacquire() if is_new else self._state), is_new
        self._beyond = self._beyond[1:]  # one accepted reading cancels one rejected reading
        self._scale.add(square)
        gain = self._variance / (self._variance + 1.0)
        self._variance *= 1.0 - gain
        x, y, z = (known + gain * part for known, part in zip(self._state, innovation, strict=True))
        self._state = (x, y, z)
        return self._state, True

    def _reacquire(self) -> _Vector:
        """Restart at the last rejected readings; if these differ, widen the scale to accept their differences."""
        self.restarts += 1
        steps = [_square(tuple(b - a for a, b in zip(*pair, strict=True))) / 2.0 for pair in pairwise(self._beyond)]
        self._scale.widen(sum(steps) / len(steps))
        return self._at(self._beyond[-1])

    def _at(self, reading: _Vector) -> _Vector:
        """Restart at a reading."""
        self._state, self._variance, self._beyond = reading, 1.0, []
        return reading


class _Scale:
    """Estimator of the noise from the squares of innovations, each divided by its variance for a noise of 1."""

    def __init__(self) -> None:
        self._first: list[float] = []
        self._square = 0.0
        self._count = 0

    def is_beyond(self, square: float) -> bool:
        """Whether a square as large has a probability below 0.01 %; False while the noise is not yet known."""
        return self._count > 0 and square > MAX_CHI2 * self._square > 0.0

    def add(self, square: float) -> None:
        """Update the scale by an accepted innovation."""
        if self._count:
            self._count = min(self._count + 1, SCALE_INNOVATIONS)
            self._square += (square / 3.0 - self._square) / self._count
            return
        self._first.append(square)
        if len(self._first) == INITIAL_INNOVATIONS:
            self._count, self._square = INITIAL_INNOVATIONS, sorted(self._first)[INITIAL_INNOVATIONS // 2] / MEDIAN_CHI2

    def widen(self, square: float) -> None:
        """Increase the scale so that it accepts a square as large as `square`."""
        self._square = max(self._square, square / 3.0)


def _square(vector: tuple[float, ...]) -> float:
    """Squared length of a vector."""
    return sum(part * part for part in vector)
