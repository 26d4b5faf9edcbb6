"""Interpolation of other sensors' measurements at the times of a magnetometer's readings.

>>> climb = TimeSeries.of([0.0, 1.0, 2.0], [[0, 0], [10, 1], [20, 4]])
>>> climb.at(np.array([0.5, 1.5, 9.0]))
array([[ 5. ,  0.5],
       [15. ,  2.5],
       [ nan,  nan]])
>>> roll = AttitudeSeries.of([0.0, 0.1], [[1.0, 0.0, 0.0, 0.0], [0.96, 0.28, 0.0, 0.0]])         # by 32.5°
>>> roll.at(np.array([0.05, 0.2])).round(4)
array([[0.9899, 0.1414, 0.    , 0.    ],
       [   nan,    nan,    nan,    nan]])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np

from flinders.arrays import to_floats
from flinders.core.samples import BLOCK_ROWS, Samples
from flinders.geometry.quaternions import from_matrix, interpolate_attitudes, product, valid_attitudes
from flinders.readers._names import ACCELERATION, ATTITUDE, CURRENT, RATE, TEMPERATURE, THROTTLE, THROTTLES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.units import Unit

MAX_GAP_S: Final = 2.5
"""Longest gap in s between two measurements across which they are interpolated."""
MAX_ATTITUDE_GAP_S: Final = 0.5
"""Longest gap in s between two attitudes across which they are interpolated; autopilots log four or more per second."""
THROTTLE_TOLERANCE: Final = 0.01
"""Largest amount by which a throttle may exceed the range 0 to 1."""
MAX_TURN_RAD: Final = np.pi / 4
"""Largest angle in rad between two attitudes that are interpolated; a larger one is a jump, or ambiguous."""
MIN_HALF_TURN_COSINE: Final = float(np.cos(MAX_TURN_RAD / 2))
"""Smallest inner product of two unit quaternions that are at most `MAX_TURN_RAD` apart: the cosine of half of it."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeSeries:
    """Measurements of a sensor with their times."""

    time: Floats  # (M,), s, ascending
    values: Floats  # (M, k)

    @classmethod
    def of(cls, time: ArrayLike, values: ArrayLike) -> Self | None:
        """Sort finite measurements by time; None without any.

        `time` is (M,) in s, `values` is (M, k).
        """
        when, measured = to_floats(time), to_floats(values)
        usable = np.isfinite(when) & np.isfinite(measured).all(axis=1)
        if not usable.all():
            when, measured = when[usable], measured[usable]
        if np.any(when[1:] < when[:-1]):
            order = np.argsort(when, kind="stable")
            when, measured = when[order], measured[order]
        return cls(when, measured) if len(when) else None

    def at(self, time: Floats) -> Floats:
        """(N, k) values at (N,) times, interpolated linearly; NaN before, after and in long gaps."""
        values = np.column_stack([np.interp(time, self.time, column, np.nan, np.nan) for column in self.values.T])
        after = np.clip(np.searchsorted(self.time, time, side="right"), 1, max(len(self.time) - 1, 1))
        if len(self.time) > 1:
            gap = self.time[after] - self.time[after - 1]
            met = (time == self.time[after]) | (time == self.time[after - 1])
            values[(gap > MAX_GAP_S) & ~met] = np.nan
        return values

    def mean_until_next(self, time: Floats) -> Floats:
        """(N, k) mean from each of (N,) times to the next; the value by `at` where no measurement is in between.

        The mean rate of a gyro gives the rotation of the body up to the next reading. A gyro that is sampled faster
        than the compass needs this mean: with single values, the remaining error in the flight of the archive is
        half as large again.

        >>> shaken = TimeSeries.of(np.arange(9.0) / 4, np.array([[0, 4, 0, 4, 0, 4, 0, 4, 0]]).T)
        >>> shaken.at(np.array([0.0, 1.0, 2.0])).ravel(), shaken.mean_until_next(np.array([0.0, 1.0, 2.0])).ravel()
        (array([0., 0., 0.]), array([2., 2., 0.]))
        """
        values = self.at(time)
        if len(time) < 2 or len(self.time) < 2:
            return values
        ends = time[1:]
        last = self.at(ends)
        inside = np.searchsorted(self.time, ends, side="left") > np.searchsorted(self.time, time[:-1], side="right")
        seconds = ends - time[:-1]
        sound = inside & (seconds > 0.0) & (seconds <= MAX_GAP_S) & np.isfinite(last + values[:-1]).all(axis=1)
        area = self._area(ends, last)[sound] - self._area(time[:-1], values[:-1])[sound]
        values[:-1][sound] = area / seconds[sound, np.newaxis]
        return values

    def _area(self, time: Floats, here: Floats) -> Floats:
        """(N, k) integral from the first measurement to each of (N,) times; `here` are the interpolated values."""
        steps = np.diff(self.time)[:, np.newaxis]
        whole = np.concatenate(
            [np.zeros((1, here.shape[1])), np.cumsum(0.5 * steps * (self.values[1:] + self.values[:-1]), axis=0)]
        )
        before = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 1)
        rest = (time - self.time[before])[:, np.newaxis]
        area: Floats = whole[before] + 0.5 * rest * (self.values[before] + here)
        return area


class AttitudeSeries(TimeSeries):
    """Attitudes with their times; `values` are unit quaternions."""

    __slots__ = ()

    @classmethod
    def of(cls, time: ArrayLike, values: ArrayLike) -> Self | None:
        """Sort (M, 4) quaternions w, x, y, z by their (M,) times; those whose length is not 1 are left out."""
        return super().of(time, valid_attitudes(to_floats(values)))

    def at(self, time: Floats) -> Floats:
        """(N, 4) attitudes at (N,) times, interpolated at a constant rate on the shortest path.

        NaN before and after, in gaps longer than `MAX_ATTITUDE_GAP_S`, and between attitudes that differ by more than
        `MAX_TURN_RAD`.
        """
        after = np.clip(np.searchsorted(self.time, time, side="right"), 1, max(len(self.time) - 1, 1))
        before, after = after - 1, np.minimum(after, len(self.time) - 1)
        start, end = self.time[before], self.time[after]
        gap = end - start
        share = np.clip((time - start) / np.where(gap > 0, gap, 1.0), 0.0, 1.0)
        values = interpolate_attitudes(self.values[before], self.values[after], share)
        is_smooth = np.abs(np.einsum("ij,ij->i", self.values[before], self.values[after])) >= MIN_HALF_TURN_COSINE
        met = (time == start) | (time == end)
        lost = ~(met | (is_smooth & (gap <= MAX_ATTITUDE_GAP_S)))
        values[~((time >= start) & (time <= end)) | lost] = np.nan
        return values


Series: TypeAlias = TimeSeries | tuple[TimeSeries, ...]
"""Time series of one column of `Samples`, or a tuple of several columns, each with its own times."""


def resample(series: Mapping[str, Series | None], time: Floats, turn: Floats | None = None) -> dict[str, Any]:
    """Columns of `Samples` at the times of readings; the (3, 3) `turn` rotates them into the readings' axes."""
    columns: dict[str, Any] = {}
    for kind, one in series.items():
        if one is None:
            continue
        several = one if isinstance(one, tuple) else (one,)
        values = np.hstack([each.mean_until_next(time) if kind == RATE else each.at(time) for each in several])
        if turn is not None and kind in (ACCELERATION, RATE):
            values = values @ turn.T
        elif turn is not None and kind == ATTITUDE:
            values = product(values, from_matrix(turn.T))
        columns[kind] = _as_column(kind, values)
    return columns


def _as_column(kind: str, values: Floats) -> Floats:
    """(N,) values of kinds with one number in `Samples`, else (N, k); throttles as fractions of 1."""
    valid = throttle_shares(values) if kind in (THROTTLE, THROTTLES) else values
    return valid[:, 0] if kind in (CURRENT, THROTTLE, TEMPERATURE) else valid


def throttle_shares(values: Floats) -> Floats:
    """Throttles of a log as fractions of 1; NaN outside 0 to 1, with a tolerance of 0.01 for rounding.

    >>> throttle_shares(np.array([0.5, 1.005, -0.2]))
    array([0.5, 1. , nan])
    """
    with np.errstate(invalid="ignore"):
        return np.where(
            (values >= -THROTTLE_TOLERANCE) & (values <= 1 + THROTTLE_TOLERANCE), np.clip(values, 0.0, 1.0), np.nan
        )


def number_skipped_rows(samples: Samples, before: int) -> Samples:
    """A block whose skipped rows are numbered from the start of the recording; `before` rows precede the block."""
    skipped = (replace(one, lines=tuple(line + before for line in one.lines)) for one in samples.skipped)
    return replace(samples, skipped=tuple(skipped)) if samples.skipped and before else samples


def blocks(source: str, unit: Unit, count: int, rows: Callable[[slice], dict[str, Any]]) -> Iterator[Samples]:
    """Yield blocks of a magnetometer's readings; `rows` returns the columns of a slice, by name."""
    for start in range(0, count, BLOCK_ROWS):
        samples = Samples.of(unit=unit, source=source, **rows(slice(start, start + BLOCK_ROWS)))
        yield number_skipped_rows(samples, start)
