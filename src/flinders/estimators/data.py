"""What an estimator looks at: the sums of a recording, and the recording itself where it is there.

>>> readings = Readings.of(np.random.default_rng(1).normal(size=(50, 3)))
>>> len(readings.summary), readings.thinned(20).shape
(50, (17, 3))
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, Final, Self, TypeGuard, cast

import numpy as np

from flinders.core.samples import Samples, singles
from flinders.errors import NeedsSamples, OutOfScale, StuckAxis, TooFewSamples, Unmoved
from flinders.estimators import cache
from flinders.estimators.cache import Cached, concatenated, together
from flinders.estimators.inliers import NO_RUN, Inliers
from flinders.summary.cloud import keys_of
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.random import Generator
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.geometry.ellipsoid import Ellipsoid

SMALLEST, LARGEST = 1e-12, 1e15
"""Between these sizes, in any unit, fourth powers and their inverses are numbers."""

FARTHEST: Final = 1000.0
"""Offset in spreads of the readings; a magnet that strong leaves no range to any sensor."""

STRETCHES, STRETCH = 12, 1024
"""Stretches of consecutive readings, and readings in each, that tell how residuals hang together."""

PER_CELL: Final = 4
"""Readings of one place that count, where what counts is how many places agree."""


def is_recording(source: Recording | ArrayLike) -> TypeGuard[Recording]:
    """Anything with blocks is a recording; all else has to be an array."""
    return hasattr(source, "blocks")


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The sums of a recording, and the recording itself where it can be gone through again.

    Attributes
    ----------
    summary : Summary
    recording : Recording, optional
        None where only the sums came: methods that need each reading then refuse.
    parts : tuple of Readings
        Where it is several recordings of one sensor: each of them. Nothing that follows the order of the readings
        goes across from one to the next.
    """

    summary: Summary
    recording: Recording | None = None
    parts: tuple[Readings, ...] = ()

    @classmethod
    def of(cls, source: Summary | Recording | ArrayLike) -> Self:
        """Summarise whatever is given, in one pass; recordings that are not too long in all are kept in memory."""
        if isinstance(source, Summary):
            return cls(source)
        recording = source if is_recording(source) else Samples.of(cast("ArrayLike", source))
        parts: list[Self] = []
        room = cache.HELD
        for single in singles(recording):
            part = cls._of_one(single, room)
            parts.append(part)
            room -= len(part) if isinstance(part.recording, Samples) else 0
        if len(parts) == 1:
            return parts[0]
        return cls._of_parts(reduce(Summary.beside, [part.summary for part in parts]), parts)

    @classmethod
    def _of_one(cls, recording: Recording, room: int) -> Self:
        """Summarise one recording, and keep it if it has no more readings than there is room for."""
        if isinstance(recording, Samples):
            return cls(Summary.of(recording), recording)
        cached = Cached(recording, room)
        return cls(Summary.through(cached), cached.in_memory())

    @classmethod
    def _of_parts(cls, summary: Summary, parts: Sequence[Readings]) -> Self:
        """Several recordings as one."""
        whole, each = together([part.recording for part in parts if part.recording is not None])
        return cls(summary, whole, tuple(replace(part, recording=own) for part, own in zip(parts, each, strict=True)))

    def __len__(self) -> int:
        return len(self.recording) if isinstance(self.recording, Samples) else len(self.summary)

    def blocks(self, method: str) -> Iterator[Floats]:
        """Go through all readings.

        Raises
        ------
        NeedsSamples
            Where there are only sums.
        """
        if self.recording is None:
            raise NeedsSamples(method)
        if isinstance(self.recording, Samples):
            yield self.recording.field
            return
        for block in self.recording.blocks():
            yield block.field

    def thinned(self, limit: int, method: str = "") -> Floats:
        """Take at most about `limit` readings, spread evenly over the recording."""
        stride = max(1, -(-len(self) // limit))
        seen, taken = 0, []
        is_held = isinstance(self.recording, Samples)
        for block in self.blocks(method):
            some = block[-seen % stride :: stride]
            taken.append(some if is_held else some.copy())  # a view would hold the whole block, of all of them
            seen += len(block)
        return taken[0] if len(taken) == 1 else np.concatenate(taken)

    @property
    def each(self) -> tuple[Readings, ...]:
        """The recordings one by one: the parts, or this."""
        return self.parts or (self,)

    def segments(self, method: str) -> list[Floats]:
        """Some consecutive readings, spread over the recordings; all of them where they are not too many."""
        if len(self) <= STRETCHES * STRETCH:
            return [part.thinned(len(part), method) for part in self.each if len(part)]
        every = -(-len(self) // STRETCHES)
        segments: list[Floats] = []
        seen = 0
        for part in self.each:
            for block in part.blocks(method):
                segments += [block[begin : begin + STRETCH] for begin in range(-seen % every, len(block), every)]
                seen += len(block)
        return segments

    def only(self, field: Floats) -> Self:
        """Some of the readings, in memory, with the sums of all."""
        return replace(self, recording=Samples(field), parts=())

    def near(self, ellipsoid: Ellipsoid, limit: float, dense: int = NO_RUN) -> Self:
        """Those readings that are close to a surface, see `flinders.estimators.inliers`, with the sums of all."""
        if np.isinf(limit):
            return self
        return self.through(lambda recording: Inliers(recording, ellipsoid, limit, dense))

    def through(self, wrapped: Callable[[Recording], Recording]) -> Self:
        """What another recording makes of each, with the sums of all; in memory where the readings are."""
        if self.recording is None:
            return self
        if self.parts:
            return self._of_parts(self.summary, [part.through(wrapped) for part in self.parts])
        other = wrapped(self.recording)
        is_short = isinstance(self.recording, Samples) and len(self) <= cache.HELD
        return replace(self, recording=concatenated(list(other.blocks()), other) if is_short else other)

    def spread_out(self, field: Floats, rng: Generator) -> Floats:
        """Take a few readings from each cell of the cloud: a rest or a clump then counts for no more than its place."""
        cells = keys_of(field, self.summary.cloud.side)
        order = rng.permutation(len(field))
        order = order[np.argsort(cells[order], kind="stable")]
        sorted_cells = cells[order]
        first = np.flatnonzero(np.concatenate([[True], sorted_cells[1:] != sorted_cells[:-1]]))
        rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
        return field[np.sort(order[rank < PER_CELL])]

    @property
    def are_in_scale(self) -> bool:
        """The largest of them is of a size that a magnetometer reads, in any unit; others cannot be calculated with."""
        return SMALLEST < self.summary.moments.unit < LARGEST

    def require(self, unknowns: int, method: str, *, axes: str = "xyz") -> None:
        """Refuse what no method can work with; `axes` are those that have to change.

        Raises
        ------
        TooFewSamples
            Unless there are as many readings as unknowns.
        OutOfScale
            For numbers that no magnetometer reads.
        StuckAxis
            If an axis never changes.
        Unmoved
            If the readings vary by less than a thousandth of their mean: sums about zero tell too little of them. What
            `flinders.fit` refuses besides, see `flinders.diagnostics.unmoved`.
        """
        how = {} if axes == "xyz" else {"how": f"all the way round in the plane {axes}"}
        if len(self) < unknowns:
            raise TooFewSamples(found=len(self), needed=unknowns, method=method, **how)
        if not self.are_in_scale:
            raise OutOfScale(self.summary.moments.unit)
        health = self.summary.health
        stuck = ["xyz".index(axis) for axis in axes if health.extent["xyz".index(axis)] == 0.0]
        if stuck:
            raise StuckAxis(tuple("xyz"[axis] for axis in stuck), tuple(health.lows.values[stuck].tolist()), **how)
        spread, size = self.summary.moments.spread, float(np.linalg.norm(self.summary.moments.mean))
        if size > FARTHEST * spread:
            raise Unmoved(math.degrees(float(np.linalg.norm(health.extent)) / size), **how)
