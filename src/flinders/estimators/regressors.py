"""What was logged beside the readings: the columns of the disturbances, with a lag where one is asked for.

>>> from flinders.core.samples import Samples
>>> time = np.arange(40) / 10.0
>>> one = Samples.of(np.ones((40, 3)), time=time, current=10.0 * time)
>>> logged = Logged.of([one], ("current",))
>>> logged.values["current"][:3], logged.lagged("current", 0.1)[:3]
(array([0., 1., 2.]), array([0., 0., 1.]))
>>> logged.split()
(('current',), ())

A `Track` is a column at any lag, smoothed so that its noise is the same at each. A value between two readings of a
meter, a share f of the way from one to the next, has (1 − f)² + f² of its variance: half of it in the middle.
Readings that follow the meter's column would lie nearer to such values whatever the lag is, and a lag of half a
reading would be found where there is none. So columns are smoothed by a Gaussian kernel of two readings before they
are shifted, which leaves 0.13 of the variance at any share of a reading:

    c(t) = Σ G(i(t) − j) c_j,        i(t) the place of t among the times of readings

That is for finding a lag. Offsets per unit are told by the columns themselves, which keep their fast changes.

>>> noise = np.random.default_rng(1).normal(size=20_000)
>>> time = np.arange(20_000) / 50.0
>>> plain = [np.interp(time - share / 50.0, time, noise) for share in (0.0, 0.25, 0.5)]
>>> [round(float(np.var(values)), 1) for values in plain]
[1.0, 0.6, 0.5]
>>> course = Track.of(time, noise)
>>> [round(float(np.var(course.at(time - share / 50.0))), 3) for share in (0.0, 0.25, 0.5)]
[0.132, 0.132, 0.132]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.disturbance import MOTORS, Disturbance, is_column, known, lagged, place_of
from flinders.errors import InputError, TooFewSamples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples

WIDTH: Final = 2.0
"""Standard deviation of the kernel, in readings."""

REACH: Final = 4.0
"""Standard deviations at which it ends."""

PLACES: Final = 8
"""To each reading: between these the course is straight, which takes less than a thousandth off the variance."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A smoothed column."""

    time: Floats  #: (M,), s
    values: Floats  #: (M,)

    @classmethod
    def of(cls, time: Floats, values: Floats) -> Self:
        """Smooth (N,) values at (N,) ascending times; gaps among them are bridged, and the ends hold beyond."""
        readings = np.arange(len(values), dtype=float)
        places = np.arange((len(values) - 1) * PLACES + 1) / PLACES
        reach = int(REACH * WIDTH * PLACES)
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (WIDTH * PLACES)) ** 2)
        between = np.pad(np.interp(places, readings, lagged(values, time, 0.0)), reach, mode="edge")
        smooth = np.convolve(between, kernel / kernel.sum(), mode="valid")
        return cls(np.interp(places, readings, time), smooth)

    def at(self, time: Floats) -> Floats:
        """(N,) values at (N,) times."""
        interpolated: Floats = np.interp(time, self.time, self.values)
        return interpolated


FAR_REFERENCE: Final = 0.25
"""Of the range of a column: how far 0 may lie outside to be its reference, as of `disturbance-reference`."""

MOST: Final = 20_000
"""Readings of a longer recording that are looked at, spread evenly over it."""

FEWEST: Final = 30
"""Readings below which nothing is said of a disturbance."""


@dataclass(frozen=True, slots=True)
class DisturbanceEstimate:
    """What is known of something that the offset follows."""

    #: ``current``, ``throttle`` or ``temperature``; of one motor ``current1`` or ``throttle1``; that of a column
    name: str
    disturbance: Disturbance | None = None  #: None where it hardly changed, and nothing was found
    #: heading error that following it takes away, at the far end of its recorded range, at the worst attitude
    removed_deg: float = 0.0
    #: heading error (1 σ) that its own uncertainty leaves there, at the worst heading; of motors of which each has a
    #: disturbance of its own, with the others as they usually were then
    remaining_deg: float = 0.0
    attitude_collinearity: float = 0.0  #: share of what tells about it that the attitude could explain as well, 0 to 1
    chi_square: float = 0.0  #: what it takes off the sum of squares, in the noise that is left
    lag_sigma_s: float = np.nan  #: s: of its lag; NaN where none was looked for
    is_lag_at_limit: bool = False  #: the end of the search for a lag is best
    monotonicity: float = 0.0  #: share of its course that a monotone function of time explains, 0 to 1
    attenuation: float = 0.0  #: by which share its offset per unit is too small, as its meter is noisy
    #: how far what it makes is off a straight line, as a share of what it makes; 0 where that may be chance
    curvature: float = 0.0
    collinearity: float = 0.0  #: share of its course that the other disturbances explain, 0 to 1
    explained_share: float = np.nan  #: share of the scatter without it that it explains, 0 to 1
    explained_share_sigma: float = np.nan  #: 1 σ of that
    explained: float = np.nan  #: rms of what it moves the readings by, in their unit
    explained_sigma: float = np.nan  #: 1 σ of that
    #: scatter of readings that were left out of the fit, with it over without; NaN where it was not tried
    scatter_ratio: float = np.nan

    @property
    def is_unused(self) -> bool:
        """It was tried, and left out as it explains nothing."""
        return self.disturbance is None and bool(np.isfinite(self.scatter_ratio))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        fields = {name: getattr(self, name) for name in self.__slots__ if name != "disturbance"}
        finite = {key: value if isinstance(value, str) or np.isfinite(value) else None for key, value in fields.items()}
        return {**finite, "found": self.disturbance is not None}  # whether the offset follows it


@dataclass(frozen=True, slots=True, eq=False)
class Logged:
    """Columns of the recordings, one after the other."""

    field: Floats  #: (N, 3)
    values: dict[str, Floats]  #: dict of str to (N,) float: of each disturbance, without lag
    parts: tuple[RecordedColumns, ...]  #: the same with all that was logged, recording by recording

    @classmethod
    def of(cls, recordings: Sequence[Recording], names: tuple[str, ...]) -> Self:
        """Go through the recordings once; of ``currents`` and ``throttles`` take each motor's.

        Raises `UsageError` for a name that is not known; `InputError` where a recording lacks the column;
        `TooFewSamples` for fewer readings than anything can be distinguished from.
        """
        names = tuple(sorted(spelled_out(recordings, names), key=place_of))  # the order of a calibration's disturbances
        wholes = [RecordedColumns.of(recording, names) for recording in recordings]
        total = sum(len(part.field) for part in wholes)
        if total < FEWEST:
            raise TooFewSamples(found=total, needed=FEWEST, method=f"with {' and '.join(names)}")
        stride = -(-total // MOST)
        parts = tuple(replace(part, stride=stride) for part in wholes)
        values = {name: np.concatenate([part.lagged(name, 0.0) for part in parts]) for name in names}
        return cls(np.concatenate([part.field[::stride] for part in parts]), values, parts)

    def lagged(self, name: str, lag_s: float) -> Floats:
        """(N,) values of a disturbance so much earlier."""
        if lag_s == 0.0:
            return self.values[name]
        return np.concatenate([part.lagged(name, lag_s) for part in self.parts])

    def courses(self, name: str) -> list[Track]:
        """A disturbance's smoothed course in each recording, which has times."""
        return [Track.of(part.time, part.columns[name]) for part in self.parts if part.time is not None]

    def along(self, courses: Sequence[Track], lag_s: float) -> Floats:
        """(N,) values of such courses so much earlier."""
        times = [part.time[:: part.stride] for part in self.parts if part.time is not None]
        return np.concatenate([course.at(time - lag_s) for course, time in zip(courses, times, strict=True)])

    @property
    def is_timed(self) -> bool:
        """There are ascending times everywhere, and with them a before and an after."""
        return all(part.time is not None and bool(np.all(np.diff(part.time) > 0.0)) for part in self.parts)

    @property
    def step_s(self) -> float:
        """Usual time from one reading to the next."""
        return float(np.median(np.concatenate([np.diff(part.time) for part in self.parts if part.time is not None])))

    def split(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the disturbances that changed, and of those that did not."""
        moving = tuple(name for name, values in self.values.items() if _changes(name, values))
        return moving, tuple(name for name in self.values if name not in moving)

    def reference(self, name: str) -> float:
        """Where the offset holds: no current, no throttle, the middle of the temperatures.

        Of another column at 0 where it was recorded at or near it, else in the middle.
        """
        if name == "temperature":
            return round(float(np.median(self.values[name])), 1)
        low, high = self.range(name)
        is_far = is_column(name) and max(low, -high) > FAR_REFERENCE * (high - low)
        return float(f"{np.nanmedian(self.values[name]):.3g}") if is_far else 0.0

    def range(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a disturbance."""
        values = self.values[name]
        return float(np.nanmin(values)), float(np.nanmax(values))

    def departures(self, names: tuple[str, ...], lags: dict[str, float]) -> Floats:
        """(N, K) values of disturbances less their references, each so much earlier as its lag says."""
        if not names:
            return np.zeros((len(self.field), 0))
        rows = [self.lagged(name, lags.get(name, 0.0)) - self.reference(name) for name in names]
        return np.stack(rows, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedColumns:
    """Columns of one recording."""

    field: Floats  #: (M, 3)
    time: Floats | None  #: (M,), s
    columns: dict[str, Floats]  #: dict of str to (M,) float
    stride: int = 1  #: every which reading is looked at

    @classmethod
    def of(cls, recording: Recording, names: tuple[str, ...]) -> Self:
        """Read a recording through; raises `InputError` where it lacks a column."""
        blocks: list[Samples] = [block for block in recording.blocks() if len(block)]
        columns: dict[str, Floats] = {}
        for name in names:
            pieces = [piece for block in blocks if (piece := block.driving(name)) is not None]
            if not blocks or len(pieces) < len(blocks) or not np.isfinite(np.concatenate(pieces)).any():
                raise InputError(_lacking(recording.source, name, blocks[0].disturbances if blocks else ()))
            columns[name] = np.concatenate(pieces)
        times = [block.time for block in blocks]
        time = None if any(each is None for each in times) else np.concatenate([t for t in times if t is not None])
        return cls(np.concatenate([block.field for block in blocks]), time, columns)

    def lagged(self, name: str, lag_s: float) -> Floats:
        """(M / stride,) what was logged so much earlier."""
        return lagged(self.columns[name], self.time, lag_s)[:: self.stride]


def spelled_out(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[str, ...]:
    """Names of disturbances, each once; for ``currents`` and ``throttles`` those of each motor that was recorded.

    Raises `UsageError` for a name that no column can have; `InputError` for those of motors where none was recorded.

    Examples
    --------
    >>> from flinders.core.samples import Samples
    >>> spelled_out([Samples.of([[1, 2, 3]], currents=[[4.0, 5.0]])], ["temperature", "currents"])
    ('temperature', 'current1', 'current2')
    """
    columns: list[str] = []
    for name in names:
        kind = next((kind for kind, many in MOTORS.items() if many == name), None)
        if kind is None:
            known(name)
            columns.append(name)
            continue
        for recording in recordings:
            there = next(iter(recording.blocks())).disturbances
            each = [one for one in there if one != kind and one.startswith(kind)]
            if not each:
                raise InputError(_lacking(recording.source, name, there))
            columns += each
    return tuple(dict.fromkeys(columns))


def _lacking(source: str, name: str, there: Sequence[str]) -> str:
    """Say that a recording lacks a column, and what it has."""
    has = f" ({', '.join(there)} were)" if there else ""
    return f"{source} has no {name}: record it beside the readings{has}, or leave {name} out"


def _changes(name: str, values: Floats) -> bool:
    """Whether a disturbance changed enough for anything to be told of it."""
    low, high = np.nanquantile(values, [0.02, 0.98])
    return bool(high - low > known(name).least)
