"""Columns of the disturbances in recordings, optionally with a lag.

>>> from flinders.core.samples import Samples
>>> time = np.arange(40) / 10.0
>>> one = Samples.of(np.ones((40, 3)), time=time, current=10.0 * time)
>>> logged = LoggedDisturbances.of([one], ("current",))
>>> logged.values["current"][:3], logged.lagged_values("current", 0.1)[:3]
(array([0., 1., 2.]), array([0., 0., 1.]))
>>> logged.split()
(('current',), ())

A `Track` gives a column at any lag, smoothed so that its noise does not depend on the lag. A linear interpolation at a
fraction f between two readings of a meter has (1 − f)² + f² of their noise variance, half of it in the middle. Without
smoothing, a fit would therefore prefer a lag of half a reading even if there is no lag. Values are smoothed by a
Gaussian kernel with σ of two readings before they are shifted, which leaves 0.13 of the noise variance at any fraction:

    c(t) = Σ G(i(t) − j) c_j,        i(t) the index of t among the times of readings

Tracks are used only to estimate lags. Offsets per unit are estimated from the columns with their fast changes.

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

from flinders.core.disturbance import MOTORS, Disturbance, is_column, kind_of, lagged_values, sort_key
from flinders.errors import InputError, TooFewSamples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples

KERNEL_SIGMA: Final = 2.0
"""Standard deviation of the kernel, in readings."""

KERNEL_SIGMAS: Final = 4.0
"""Half width of the kernel in standard deviations."""

POINTS_PER_READING: Final = 8
"""Count of stored points per reading of a track; interpolation between them changes the variance by less than 1e-3."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A smoothed column of a recording, as a function of time."""

    time: Floats  #: (M,), s: times of the stored points
    values: Floats  #: (M,): smoothed values at these times

    @classmethod
    def of(cls, time: Floats, values: Floats) -> Self:
        """Smooth (N,) values at (N,) ascending times; gaps are interpolated, and end values continued."""
        readings = np.arange(len(values), dtype=float)
        places = np.arange((len(values) - 1) * POINTS_PER_READING + 1) / POINTS_PER_READING
        reach = int(KERNEL_SIGMAS * KERNEL_SIGMA * POINTS_PER_READING)
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (KERNEL_SIGMA * POINTS_PER_READING)) ** 2)
        between = np.pad(np.interp(places, readings, lagged_values(values, time, 0.0)), reach, mode="edge")
        smooth = np.convolve(between, kernel / kernel.sum(), mode="valid")
        return cls(np.interp(places, readings, time), smooth)

    def at(self, time: Floats) -> Floats:
        """(N,) values at (N,) times."""
        interpolated: Floats = np.interp(time, self.time, self.values)
        return interpolated


MAX_REFERENCE_DISTANCE: Final = 0.25
"""Largest distance of 0 from the range of a column's values, as a share of the range, at which 0 is the reference."""

MAX_READINGS: Final = 20_000
"""Largest number of readings in a fit with disturbances, spread evenly over the recording."""

MIN_READINGS: Final = 30
"""Smallest number of readings in a fit with disturbances."""


@dataclass(frozen=True, slots=True)
class DisturbanceEstimate:
    """Statistics of one disturbance."""

    #: ``current``, ``throttle`` or ``temperature``; ``current1`` or ``throttle1`` of one motor; name of a column
    name: str
    disturbance: Disturbance | None = None  #: the disturbance; None if it hardly changed, and was not estimated
    #: heading error that the correction removes, at the far end of the recorded range and the worst attitude
    removed_deg: float = 0.0
    #: heading error (1 σ) that remains from the uncertainty of the correction, at the far end of the recorded range and
    #: the worst heading; for a disturbance of one motor, with the usual values of the other motors
    remaining_deg: float = 0.0
    #: fraction of the information on the disturbance that the attitude could explain, 0 to 1
    attitude_collinearity: float = 0.0
    chi_square: float = 0.0  #: reduction of the sum of squared residuals by the disturbance, over the noise variance
    lag_sigma_s: float = np.nan  #: s: 1 σ of the lag; NaN if no lag was estimated
    is_lag_at_limit: bool = False  #: whether the best lag is the largest lag of the search
    monotonicity: float = 0.0  #: fraction of the column's variance that a monotone function of time explains, 0 to 1
    attenuation: float = 0.0  #: fraction by which the offset per unit is too small because of a noisy meter
    #: nonlinear part of the effect, relative to the linear effect; 0 if not significant
    curvature: float = 0.0
    collinearity: float = 0.0  #: fraction of the column's variance that the other disturbances explain, 0 to 1
    #: fraction of the residual variance of a fit without the disturbance that the disturbance explains, 0 to 1
    explained_share: float = np.nan
    explained_share_sigma: float = np.nan  #: 1 σ of `explained_share`
    explained: float = np.nan  #: rms effect of the disturbance on the readings, in their unit
    explained_sigma: float = np.nan  #: 1 σ of `explained`
    #: ratio of the scatter of left-out readings with the disturbance to that without it; NaN if not computed
    scatter_ratio: float = np.nan

    @property
    def is_unused(self) -> bool:
        """Whether the column was left out after a test, because it explains no part of the residuals."""
        return self.disturbance is None and bool(np.isfinite(self.scatter_ratio))

    def as_dict(self) -> dict[str, Any]:
        """Attributes by their names, JSON-ready."""
        fields = {name: getattr(self, name) for name in self.__slots__ if name != "disturbance"}
        finite = {key: value if isinstance(value, str) or np.isfinite(value) else None for key, value in fields.items()}
        return {**finite, "found": self.disturbance is not None}  # whether the offset is corrected for it


@dataclass(frozen=True, slots=True, eq=False)
class LoggedDisturbances:
    """Field and disturbances of several recordings, concatenated and thinned."""

    field: Floats  #: (N, 3): readings
    values: dict[str, Floats]  #: dict of str to (N,) float: values of each disturbance, without lag
    parts: tuple[RecordedColumns, ...]  #: all columns of each recording

    @classmethod
    def of(cls, recordings: Sequence[Recording], names: tuple[str, ...]) -> Self:
        """Read the columns in one pass; ``currents`` and ``throttles`` stand for those of each motor.

        Raises `UsageError` for an unknown name; `InputError` if a recording lacks the column; `TooFewSamples` for fewer
        readings than `MIN_READINGS`.
        """
        names = tuple(
            sorted(expand_names(recordings, names), key=sort_key)
        )  # the order of a calibration's disturbances
        wholes = [RecordedColumns.of(recording, names) for recording in recordings]
        total = sum(len(part.field) for part in wholes)
        if total < MIN_READINGS:
            raise TooFewSamples(found=total, needed=MIN_READINGS, method=f"with {' and '.join(names)}")
        stride = -(-total // MAX_READINGS)
        parts = tuple(replace(part, stride=stride) for part in wholes)
        values = {name: np.concatenate([part.lagged_values(name, 0.0) for part in parts]) for name in names}
        return cls(np.concatenate([part.field[::stride] for part in parts]), values, parts)

    def lagged_values(self, name: str, lag_s: float) -> Floats:
        """(N,) values of a disturbance at `lag_s` before each reading."""
        if lag_s == 0.0:
            return self.values[name]
        return np.concatenate([part.lagged_values(name, lag_s) for part in self.parts])

    def courses(self, name: str) -> list[Track]:
        """Smoothed values of a disturbance as a function of time, for each recording with times."""
        return [Track.of(part.time, part.columns[name]) for part in self.parts if part.time is not None]

    def along(self, courses: Sequence[Track], lag_s: float) -> Floats:
        """(N,) smoothed values at `lag_s` before each reading; `courses` are the result of the method `courses`."""
        times = [part.time[:: part.stride] for part in self.parts if part.time is not None]
        return np.concatenate([course.at(time - lag_s) for course, time in zip(courses, times, strict=True)])

    @property
    def is_timed(self) -> bool:
        """Whether all recordings have ascending times."""
        return all(part.time is not None and bool(np.all(np.diff(part.time) > 0.0)) for part in self.parts)

    @property
    def step_s(self) -> float:
        """Median interval of readings in s."""
        return float(np.median(np.concatenate([np.diff(part.time) for part in self.parts if part.time is not None])))

    def split(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the disturbances that changed in the recording, and of those that did not."""
        moving = tuple(name for name, values in self.values.items() if _has_changed(name, values))
        return moving, tuple(name for name in self.values if name not in moving)

    def reference(self, name: str) -> float:
        """Reference value of a disturbance: 0 for current and throttle, the median of the temperature.

        For another column the reference is 0 if the recorded range is at or near 0, else the median.
        """
        if name == "temperature":
            return round(float(np.median(self.values[name])), 1)
        low, high = self.range(name)
        is_far = is_column(name) and max(low, -high) > MAX_REFERENCE_DISTANCE * (high - low)
        return float(f"{np.nanmedian(self.values[name]):.3g}") if is_far else 0.0

    def range(self, name: str) -> tuple[float, float]:
        """Lowest and highest recorded value of a disturbance."""
        values = self.values[name]
        return float(np.nanmin(values)), float(np.nanmax(values))

    def departures(self, names: tuple[str, ...], lags: dict[str, float]) -> Floats:
        """(N, K) values of K disturbances minus their references, each at its lag before the reading."""
        if not names:
            return np.zeros((len(self.field), 0))
        rows = [self.lagged_values(name, lags.get(name, 0.0)) - self.reference(name) for name in names]
        return np.stack(rows, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedColumns:
    """Field, times and disturbances of one recording."""

    field: Floats  #: (M, 3): readings
    time: Floats | None  #: (M,), s: times of the readings, if recorded
    columns: dict[str, Floats]  #: dict of str to (M,) float: values of each disturbance
    stride: int = 1  #: the fit uses every reading whose row is a multiple of this number

    @classmethod
    def of(cls, recording: Recording, names: tuple[str, ...]) -> Self:
        """Read the columns of a recording; raises `InputError` if one is missing."""
        blocks: list[Samples] = [block for block in recording.blocks() if len(block)]
        columns: dict[str, Floats] = {}
        for name in names:
            pieces = [piece for block in blocks if (piece := block.disturbance_values(name)) is not None]
            if not blocks or len(pieces) < len(blocks) or not np.isfinite(np.concatenate(pieces)).any():
                raise InputError(
                    _missing_column_message(recording.source, name, blocks[0].disturbances if blocks else ())
                )
            columns[name] = np.concatenate(pieces)
        times = [block.time for block in blocks]
        time = None if any(each is None for each in times) else np.concatenate([t for t in times if t is not None])
        return cls(np.concatenate([block.field for block in blocks]), time, columns)

    def lagged_values(self, name: str, lag_s: float) -> Floats:
        """(M / stride,) values of a disturbance at `lag_s` before each reading in the fit."""
        return lagged_values(self.columns[name], self.time, lag_s)[:: self.stride]


def expand_names(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[str, ...]:
    """Names of disturbances without repetitions; ``currents`` and ``throttles`` are replaced by those of all motors.

    Raises `UsageError` for an invalid name; `InputError` for ``currents`` or ``throttles`` without recorded motors.

    Examples
    --------
    >>> from flinders.core.samples import Samples
    >>> expand_names([Samples.of([[1, 2, 3]], currents=[[4.0, 5.0]])], ["temperature", "currents"])
    ('temperature', 'current1', 'current2')
    """
    columns: list[str] = []
    for name in names:
        kind = next((kind for kind, many in MOTORS.items() if many == name), None)
        if kind is None:
            kind_of(name)
            columns.append(name)
            continue
        for recording in recordings:
            there = next(iter(recording.blocks())).disturbances
            each = [one for one in there if one != kind and one.startswith(kind)]
            if not each:
                raise InputError(_missing_column_message(recording.source, name, there))
            columns += each
    return tuple(dict.fromkeys(columns))


def _missing_column_message(source: str, name: str, there: Sequence[str]) -> str:
    """Message about a missing column, with the recorded ones."""
    has = f" (it has {', '.join(there)})" if there else ""
    return f"{source} has no {name}{has}: record it with the readings, or leave {name} out"


def _has_changed(name: str, values: Floats) -> bool:
    """Whether a disturbance changed enough to be estimated."""
    low, high = np.nanquantile(values, [0.02, 0.98])
    return bool(high - low > kind_of(name).least)
