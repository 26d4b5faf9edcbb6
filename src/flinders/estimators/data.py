"""Input of an estimator: the sums of a recording, and the recording itself if available.

>>> readings = Readings.of(np.random.default_rng(1).normal(size=(50, 3)))
>>> len(readings.summary), readings.thin(20).shape
(50, (17, 3))

A recording that is short enough stays in memory after the first pass:

>>> read_once = Joined((Samples(np.ones((5, 3))), Samples(np.ones((5, 3)))))
>>> [type(Readings._of_one(read_once, room).recording).__name__ for room in (10, 9)]
['Samples', 'Joined']

Inliers are readings near a surface:

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> inliers = Inliers(Samples(np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 0, 51.0]])), sphere, 5.0)
>>> [block.field for block in inliers.blocks()]
[array([[50.,  0.,  0.],
       [ 0.,  0., 51.]])]

Saturated readings give only a limit of the field, and are not used:

>>> from flinders.summary.quality import Rail
>>> samples = Samples(np.array([[50.0, 0, 0], [40.0, 9, 0], [50.0, 3, 2]]))
>>> [block.field.tolist() for block in UnsaturatedRecording(samples, (Rail(0, "highest", 50.0, 0.66),)).blocks()]
[[[40.0, 9.0, 0.0]]]
"""

from __future__ import annotations

import math
import os
from collections import deque
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain
from typing import TYPE_CHECKING, Any, Final, Self, TypeGuard, cast

import numpy as np

from flinders.core.axes import Axes
from flinders.core.joining import Joined, concatenate, single_recordings
from flinders.core.samples import Recording, RecordingWrapper, Samples
from flinders.core.units import COUNTS, Unit
from flinders.errors import NeedsSamples, OutOfScale, StuckAxis, TooFewSamples, Unmoved, UsageError
from flinders.estimators.rests import Rests
from flinders.geometry.plane import axis_order
from flinders.likelihood import magnitude
from flinders.summary.quality import DataQuality
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Skipped
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.geometry.plane import Plane
    from flinders.readers._asked_columns import AnyColumns
    from flinders.summary.quality import Rail
    from flinders.summary.summary import Statistics

MAX_HELD_READINGS: Final = 500_000
"""Largest number of readings that are kept in memory: 16 MB with times, 76 MB with all columns.

A longer recording is read again in each pass, and fits use every second, third … reading.
"""


def _release_blocks(blocks: deque[Samples]) -> Iterator[Samples]:
    """Yield blocks, and release each from memory."""
    while blocks:
        yield blocks.popleft()


def join_with_parts(recordings: Sequence[Recording]) -> tuple[Recording, Sequence[Recording]]:
    """Join several recordings; returns the whole and its parts.

    If all are in memory and not too long, the whole is in memory and the parts are views of it. Otherwise the whole
    reads the parts in order.
    """
    joined = Joined(tuple(recordings))
    in_memory = [recording for recording in recordings if isinstance(recording, Samples)]
    if len(in_memory) < len(recordings) or sum(map(len, in_memory)) > MAX_HELD_READINGS:
        return joined, recordings
    whole = concatenate(in_memory, joined)
    ends = np.cumsum([len(part) for part in in_memory])
    return whole, [
        replace(part, field=whole.field[end - len(part) : end]) for part, end in zip(in_memory, ends, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Inliers(RecordingWrapper):
    """A recording without the readings that are far from a surface."""

    recording: Recording
    ellipsoid: Ellipsoid
    limit: float  # largest Sampson distance, in the unit of the readings

    def blocks(self) -> Iterator[Samples]:
        """Yield blocks with the inliers."""
        for block in self.recording.blocks():
            far = np.abs(magnitude.distances(block.field, self.ellipsoid)) > self.limit
            yield block[~far]


@dataclass(frozen=True, slots=True, eq=False)
class UnsaturatedRecording(RecordingWrapper):
    """A recording without saturated readings."""

    recording: Recording
    rails: tuple[Rail, ...]

    def blocks(self) -> Iterator[Samples]:
        """Yield blocks without readings at a rail, the value at which an axis saturates."""
        for block in self.recording.blocks():
            free = np.ones(len(block), dtype=bool)
            for rail in self.rails:
                free &= block.field[:, rail.axis] != rail.value
            yield block[free]


@dataclass(frozen=True, slots=True, eq=False)
class PlanarRecording(RecordingWrapper):
    """A recording projected to a plane: x and y are the axes of the plane, z is constant."""

    recording: Recording
    plane: Plane
    height: float = 0.0  # value of z, in the unit of the readings

    def blocks(self) -> Iterator[Samples]:
        """Yield projected blocks."""
        first, second, _ = axis_order(self.plane)
        for block in self.recording.blocks():
            field = np.full_like(block.field, self.height)
            field[:, 0], field[:, 1] = block.field[:, first], block.field[:, second]
            yield replace(block, field=field)


def project_to_plane(readings: Readings, plane: Plane, height: float = 0.0) -> Readings:
    """Readings projected to a plane, at a constant height; the summary stays that of the unprojected readings."""
    return readings.wrap(lambda recording: PlanarRecording(recording, plane, height))


def remove_saturated(readings: Readings) -> Readings:
    """Readings without saturated ones; the summary stays that of all readings."""
    rails = readings.summary.health.rails
    return readings.wrap(lambda recording: UnsaturatedRecording(recording, rails)) if rails else readings


@dataclass(slots=True, eq=False)
class CountedRecording(RecordingWrapper):
    """A recording that counts its readings in each pass, and stores their earliest and latest time.

    >>> counted = CountedRecording(Samples.of([[1, 2, 3], [3, 2, 1]], time=[5.0, 4.0]))
    >>> [len(block) for block in counted.blocks()], counted.rows, counted.span
    ([2], 2, (4.0, 5.0))
    """

    recording: Recording
    rows: int = 0  #: number of readings in the last pass
    span: tuple[float, float] = (math.nan, math.nan)  #: s: earliest and latest time; NaN if not known

    def __len__(self) -> int:
        return self.rows

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """Rows that were skipped in the last pass."""
        skipped: tuple[Skipped, ...] = getattr(self.recording, "skipped", ())
        return skipped

    def blocks(self) -> Iterator[Samples]:
        """Yield blocks, and update `rows` and `span`."""
        self.rows, self.span = 0, (math.nan, math.nan)
        for block in self.recording.blocks():
            self.rows += len(block)
            first, last = block.span
            self.span = float(np.fmin(self.span[0], first)), float(np.fmax(self.span[1], last))
            yield block


MIN_READING, MAX_READING = 1e-12, 1e15
"""Range of readings, in any unit, within which fourth powers and their inverses are finite."""

MAX_OFFSET_SPREADS: Final = 1000.0
"""Largest ratio of the offset to the spread of the readings; a larger offset saturates any sensor."""


def is_recording(source: Recording | ArrayLike) -> TypeGuard[Recording]:
    """Whether a source is a recording, which has blocks; otherwise it must be an array."""
    return hasattr(source, "blocks")


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Summary of a recording, and the recording itself if it can be read again."""

    summary: Summary
    recording: Recording | None = None  # None for sums alone, which some methods refuse
    # single recordings, if several of one sensor are joined; statistics of consecutive readings do not cross their ends
    parts: tuple[Readings, ...] = ()
    whole: Readings | None = None  # all readings, if each rest is one reading or none here; else None
    rests: Rests | None = None  # the rests in `whole`

    @classmethod
    def of(cls, source: Summary | Recording | ArrayLike) -> Self:
        """Summarise a source in one pass; recordings are kept in memory if they are short enough in total."""
        if isinstance(source, Summary):
            return cls(source)
        recording = source if is_recording(source) else Samples.of(cast("ArrayLike", source))
        parts: list[Self] = []
        room = MAX_HELD_READINGS
        for single in single_recordings(recording):
            part = cls._of_one(single, room)
            parts.append(part)
            room -= len(part) if isinstance(part.recording, Samples) else 0
        if len(parts) == 1:
            return parts[0]
        return cls._of_parts(reduce(Summary.merge, [part.summary for part in parts]), parts)

    @classmethod
    def _of_one(cls, recording: Recording, room: int) -> Self:
        """Summarise one recording, and keep it in memory if it has at most `room` readings."""
        if isinstance(recording, Samples):
            return cls(Summary.lazy(recording), recording)
        blocks, begun, rows = recording.blocks(), deque[Samples](), 0
        for block in blocks:
            begun.append(block)
            rows += len(block)
            if rows > room:
                return cls(Summary.of_blocks(chain(_release_blocks(begun), blocks)), recording)
        whole = concatenate(begun, recording)
        return cls(Summary.lazy(whole), whole)

    @classmethod
    def _of_parts(cls, summary: Summary, parts: Sequence[Readings]) -> Self:
        """Join the readings of several recordings."""
        whole, each = join_with_parts([part.recording for part in parts if part.recording is not None])
        return cls(summary, whole, tuple(replace(part, recording=own) for part, own in zip(parts, each, strict=True)))

    def __len__(self) -> int:
        return len(self.recording) if isinstance(self.recording, Samples) else len(self.summary)

    def blocks(self, method: str) -> Iterator[Floats]:
        """Yield blocks of (m, 3) readings.

        Raises `NeedsSamples` if there are only sums.
        """
        if self.recording is None:
            raise NeedsSamples(method)
        if isinstance(self.recording, Samples):
            yield self.recording.field
            return
        for block in self.recording.blocks():
            yield block.field

    def thin(self, limit: int, method: str = "") -> Floats:
        """(M, 3) readings, at most about `limit`, spread evenly over the recording."""
        stride = max(1, -(-len(self) // limit))
        if isinstance(self.recording, Samples):
            return self.recording.field[::stride]
        thinned, seen = np.empty((-(-len(self) // stride), 3)), 0
        for block in self.blocks(method):
            thinned[-(-seen // stride) : -(-(seen + len(block)) // stride)] = block[-seen % stride :: stride]
            seen += len(block)
        return thinned[: -(-seen // stride)]  # a recording without its outliers has fewer than its sums

    def as_array(self, method: str = "") -> tuple[Floats, NDArray[np.int64] | None]:
        """(N, 3) readings, thinned if too many, and the row after the end of each of several recordings or None."""
        if not isinstance(self.recording, Samples):
            return self.thin(MAX_HELD_READINGS, method), None
        ends = np.cumsum([len(part) for part in self.parts]) if self.parts else None
        return self.recording.field, ends

    def for_fit(self) -> Readings:
        """Readings for a fit, in which each rest is one reading or none; unchanged if not in memory."""
        if self.rests is not None or not isinstance(self.recording, Samples):
            return self
        ends = self.as_array()[1]
        rests = Rests.of(self.recording, ends)
        if not len(rests):
            return self
        once = rests.average(self.recording)
        seen = Summary.of(once)
        parts: tuple[Readings, ...] = ()
        if ends is not None:
            bounds = [0, *np.searchsorted(rests.first, ends).tolist()]
            parts = tuple(
                replace(part, recording=replace(once[begin:end], source=part.recording.source))
                for part, begin, end in zip(self.parts, bounds, bounds[1:], strict=False)
                if part.recording is not None
            )
        summary = Summary(seen.moments, seen.cloud, self.summary.health)
        return replace(self, summary=summary, recording=once, parts=parts, whole=self, rests=rests)

    @property
    def all_readings(self) -> Readings:
        """All readings, including those at rest."""
        return self.whole or self

    @property
    def statistics(self) -> Statistics:
        """Statistics of the recording for a verdict."""
        statistics = self.summary.statistics
        if self.rests is None or not isinstance(self.recording, Samples):
            return statistics
        once = DataQuality.of(self.recording)
        return replace(
            statistics,
            rests=len(self.rests),
            at_rest=self.rests.at_rest,
            rest_spans=self.rests.spans,
            are_rests_left_out=self.rests.are_left_out,
            fitted=once.rows,
            fitted_repeats=once.repeats,
            fitted_distinct=once.distinct,
        )

    @property
    def single_recordings(self) -> tuple[Readings, ...]:
        """The single recordings: the parts, or this one."""
        return self.parts or (self,)

    def inliers(self, ellipsoid: Ellipsoid, limit: float) -> Self:
        """Readings within the distance `limit` of a surface; the summary stays that of all readings."""
        return self if np.isinf(limit) else self.wrap(lambda recording: Inliers(recording, ellipsoid, limit))

    def wrap(self, wrapped: Callable[[Recording], Recording]) -> Self:
        """Wrap each recording by a function; the result is in memory if the readings are. The summary is unchanged."""
        if self.recording is None:
            return self
        if self.parts:
            parts = [part.wrap(wrapped) for part in self.parts]
            return replace(self._of_parts(self.summary, parts), whole=self.whole, rests=self.rests)
        other = wrapped(self.recording)
        is_held = isinstance(self.recording, Samples)
        return replace(self, recording=concatenate(list(other.blocks()), other) if is_held else other)

    @property
    def are_in_scale(self) -> bool:
        """Whether the largest reading is in the range of numbers in which fits can be computed."""
        return MIN_READING < self.summary.moments.unit < MAX_READING

    def require(self, unknowns: int, method: str, *, axes: str = "xyz") -> None:
        """Refuse readings that no method can fit; `axes` are the axes whose readings must change.

        Raises `TooFewSamples` unless there are as many different readings as unknowns. Raises `OutOfScale` for readings
        outside the range of any magnetometer. Raises `StuckAxis` if an axis never changes. Raises `Unmoved` if the
        readings vary by less than a thousandth of their mean, as rounding then dominates sums of powers. `flinders.fit`
        also tests for motion by `flinders.diagnostics.unmoved`.
        """
        plane = "" if axes == "xyz" else f"all the way round in the plane {axes}"
        how = plane or "through all directions"
        if len(self) < unknowns:
            raise TooFewSamples(found=len(self), needed=unknowns, method=method, skipped=self.summary.skipped, how=how)
        if not self.are_in_scale:
            raise OutOfScale(self.summary.moments.unit)
        health = self.summary.health
        stuck = ["xyz".index(axis) for axis in axes if health.extent["xyz".index(axis)] == 0.0]
        if stuck:
            raise StuckAxis(tuple("xyz"[axis] for axis in stuck), tuple(health.lows.values[stuck].tolist()), plane)
        if health.distinct < unknowns:
            raise TooFewSamples(found=health.distinct, among=len(self), needed=unknowns, method=method, how=how)
        spread, size = self.summary.moments.spread, float(np.linalg.norm(self.summary.moments.mean))
        if size > MAX_OFFSET_SPREADS * spread:
            raise Unmoved(math.degrees(float(np.linalg.norm(health.extent)) / size), how)


def recording_of(
    source: Any,  # noqa: ANN401 - arrays, paths, frames of packages that may be missing
    unit: Unit | None = None,
    axes: Axes | None = None,
    sensor: str | int | None = None,
    columns: AnyColumns | None = None,
) -> tuple[Recording | Summary, str | None]:
    """Recording of a source, in the given unit and axes, and the name of its sensor.

    A recording or a Summary is returned unchanged. Raises the errors of `flinders.read`.

    >>> recording, _ = recording_of([[200, 100, -400], [300, 0, -300]], Unit.of("mG"), Axes.of("x,-y,-z"))
    >>> recording.field[0]
    array([ 20., -10.,  40.])
    """
    name = None if sensor is None else str(sensor)
    if isinstance(source, Summary) or hasattr(source, "blocks"):
        if columns is not None:
            raise UsageError("columns are chosen when a recording is read: leave them out", hint={"columns": None})
        return cast("Recording | Summary", source), name
    if not _needs_reader(source):
        if columns is not None:
            raise UsageError("an array has no named columns: give only those of the magnetometer, (N, 3)")
        return Samples.of(source, unit=unit or COUNTS, axes=axes or Axes()), name
    from flinders.readers import Choice, open_recording

    recording = open_recording(
        source,
        columns=columns,
        unit=None if unit is None else unit.name,
        scale=unit.scale if unit is not None and (unit.name == COUNTS != unit.inside) else None,
        axes=str(axes or Axes()),
        sensor=replace(Choice.of(sensor), is_name=True),
    )
    return recording, getattr(recording, "name", "") or name


def _needs_reader(source: object) -> bool:
    """Whether a source is for `flinders.read`; the readers are not imported for an array."""
    if isinstance(source, np.ndarray):
        return source.dtype.names is not None
    if isinstance(source, list | tuple):
        return bool(source) and isinstance(source[0], str | os.PathLike)
    from flinders.readers import is_source

    return is_source(source)
