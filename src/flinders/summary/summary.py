"""A recording in a few kilobytes: sums, cells and counts that add up in any order.

A live page, a log file, ten logs of one device and a fleet on a cluster all hold the same thing.

>>> import numpy as np
>>> cloud = np.random.default_rng(1).normal(size=(100, 3))
>>> Summary.of(cloud[:40]) + Summary.of(cloud[40:])
Summary(100 readings, 100 cells)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from flinders.core.samples import Samples
from flinders.summary.cloud import Cloud, natural_side
from flinders.summary.moments import Moments
from flinders.summary.quality import DataQuality

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.core.samples import Recording

_STRETCH: Final = 65536
"""Readings summarised at a time: few enough to need little memory, enough to make adding up cheap."""


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """What is streamed, saved, merged and sent.

    Attributes
    ----------
    moments : Moments
        Enough for every quadric fit.
    cloud : Cloud
        Where the readings lie.
    health : DataQuality
        Repeats, rails, jumps in time.
    """

    moments: Moments
    cloud: Cloud
    health: DataQuality

    @classmethod
    def empty(cls) -> Self:
        """No readings: the identity of ``+``."""
        return cls(Moments.empty(), Cloud.empty(), DataQuality())

    @classmethod
    def of(cls, readings: Samples | ArrayLike, *, side: float | None = None) -> Self:
        """Summarise readings that are in memory.

        Parameters
        ----------
        readings : Samples or (N, 3) array-like
        side : float, optional
            Edge of the cloud's cells; by default it follows from the readings.

        Raises
        ------
        ArrayError
            For a wrong shape.
        """
        samples = readings if isinstance(readings, Samples) else Samples.of(readings)
        if side is None and len(samples):
            side = natural_side(samples.field)
        if len(samples) <= _STRETCH:
            return cls(
                Moments.of(samples.field),
                Cloud.of(samples.field, time=samples.time, side=side),
                DataQuality.of(samples),
            )
        whole = cls.empty()
        for block in samples.blocks(_STRETCH):
            whole = whole + cls.of(block, side=side)
        return whole

    @classmethod
    def through(cls, recording: Recording) -> Self:
        """Summarise a recording block by block, in one pass and in bounded memory."""
        whole, side = cls.empty(), None
        for block in recording.blocks():
            if side is None and len(block):
                side = natural_side(block.field)
            whole = whole + cls.of(block, side=side)
        return whole

    def __add__(self, other: Summary) -> Self:
        """`other` goes on where this ends."""
        return type(self)(self.moments + other.moments, self.cloud + other.cloud, self.health + other.health)

    def beside(self, other: Summary) -> Self:
        """Both, where `other` is a recording of its own: what lies between the two says nothing."""
        return type(self)(self.moments + other.moments, self.cloud + other.cloud, self.health.merged(other.health))

    def forget(self, factor: float) -> Self:
        """Weigh all readings so far by a factor below one: once a block, this forgets exponentially."""
        return type(self)(self.moments * factor, self.cloud * factor, self.health)

    def __len__(self) -> int:
        return self.health.rows

    def __repr__(self) -> str:
        return f"Summary({len(self)} readings, {len(self.cloud)} cells)"
