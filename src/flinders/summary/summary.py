"""A recording in a few kilobytes: sums, cells and counts that add up in any order.

A live page, a log file, ten logs of one device and a fleet on a cluster all hold the same thing.

>>> import numpy as np
>>> cloud = np.random.default_rng(1).normal(size=(100, 3))
>>> Summary.of(cloud[:40]) + Summary.of(cloud[40:])
Summary(100 readings, 100 cells)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.core.samples import Samples
from flinders.summary.cloud import Cloud, natural_side
from flinders.summary.moments import Moments
from flinders.summary.quality import DataQuality, TimeStamps

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Skipped
    from flinders.native.layouts import Records
    from flinders.summary.quality import Rail

_STRETCH: Final = 65536
"""Readings summarised at a time: few enough to need little memory, enough to make adding up cheap."""

FLAT, FLATTEST = 0.01, 0.2
"""Thickness over width: readings as thin as the first are flat; as thick as the second they never are."""

FLAT_NOISE: Final = 1.5
"""Thickness over noise, below which it is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """What is streamed, saved, merged and sent."""

    moments: Moments  #: enough for every quadric fit
    cloud: Cloud  #: where the readings lie
    health: DataQuality  #: repeats, rails, jumps in time

    @classmethod
    def empty(cls) -> Self:
        """No readings: the identity of ``+``."""
        return cls(Moments.empty(), Cloud.empty(), DataQuality())

    @classmethod
    def of(cls, readings: Samples | ArrayLike, *, side: float | None = None) -> Summary:
        """Summarise readings that are in memory.

        Raises `ArrayError` for a wrong shape.

        Parameters
        ----------
        readings : Samples or (N, 3) array-like
        side : float, optional
            Edge of the cloud's cells; by default it follows from the readings.
        """
        samples = readings if isinstance(readings, Samples) else Samples.of(readings)
        return cls(_moments_of(samples), _cloud_of(samples, side), _quality_of(samples))

    @classmethod
    def through(cls, recording: Recording) -> Summary:
        """Summarise a recording block by block, in one pass and in bounded memory."""
        return cls.over(recording.blocks())

    @classmethod
    def over(cls, blocks: Iterable[Samples]) -> Summary:
        """Summarise blocks of one recording."""
        whole: Summary = cls.empty()
        side = None
        for block in blocks:
            if side is None and len(block):
                side = natural_side(block.field)
            whole = whole + cls.of(block, side=side)
        return whole

    @classmethod
    def deferred(cls, samples: Samples) -> Summary:
        """The summary of samples in memory, which is made when a part of it is first asked for."""
        return _Deferred(samples)

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """Rows left out while reading."""
        return self.health.skipped

    @property
    def statistics(self) -> Statistics:
        """What a verdict asks of the recording, where each reading counts."""
        health = self.health
        return Statistics(
            rows=health.rows,
            repeats=health.repeats,
            distinct=health.distinct,
            rests=0,
            at_rest=0,
            fitted=health.rows,
            fitted_repeats=health.repeats,
            fitted_distinct=health.distinct,
            path_correlation=health.path.correlation(self.moments.spread),
            extent=float(health.extent.max()),
            principal_variances=self.moments.principal_variances,
            rails=health.rails,
            step=health.step,
            clock=health.clock,
            skipped=self.skipped,
        )

    def __add__(self, other: Summary) -> Summary:
        """`other` goes on where this ends."""
        return Summary(self.moments + other.moments, self.cloud + other.cloud, self.health + other.health)

    def combined(self, other: Summary) -> Summary:
        """Both, where `other` is a recording of its own: what lies between the two says nothing."""
        return Summary(self.moments + other.moments, self.cloud + other.cloud, self.health.merged(other.health))

    def forget(self, factor: float) -> Summary:
        """Weigh all readings so far by a factor below one: once a block, this forgets exponentially."""
        return Summary(self.moments * factor, self.cloud * factor, self.health)

    def __len__(self) -> int:
        return self.health.rows

    def __repr__(self) -> str:
        return f"Summary({len(self)} readings, {len(self.cloud)} cells)"


class _Deferred(Summary):
    """The summary of samples in memory, each part of which is made when it is first asked for."""

    def __init__(self, samples: Samples) -> None:
        vars(self)["_samples"] = samples

    @cached_property
    def moments(self) -> Moments:
        """See `Summary`."""
        return _moments_of(vars(self)["_samples"])

    @cached_property
    def cloud(self) -> Cloud:
        """See `Summary`."""
        return _cloud_of(vars(self)["_samples"])

    @cached_property
    def health(self) -> DataQuality:
        """See `Summary`."""
        return _quality_of(vars(self)["_samples"])

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """See `Summary`."""
        skipped: tuple[Skipped, ...] = vars(self)["_samples"].skipped
        return skipped

    def __len__(self) -> int:
        return len(vars(self)["_samples"])

    def __reduce__(self) -> tuple[type[Summary], tuple[Moments, Cloud, DataQuality]]:
        """Leave the readings behind where it is sent or copied."""
        return Summary, (self.moments, self.cloud, self.health)


def _moments_of(samples: Samples) -> Moments:
    """Sums of powers of samples, a stretch at a time."""
    return reduce(add, (Moments.of(each.field) for each in _stretches(samples)))


def _cloud_of(samples: Samples, side: float | None = None) -> Cloud:
    """Cells of samples, of an edge that by default follows from them all, a stretch at a time."""
    side = natural_side(samples.field) if side is None and len(samples) else side
    return reduce(add, (Cloud.of(each.field, time=each.time, side=side) for each in _stretches(samples)))


def _quality_of(samples: Samples) -> DataQuality:
    """Repeats, rails and jumps in time of samples, a stretch at a time."""
    return reduce(add, map(DataQuality.of, _stretches(samples)))


def _stretches(samples: Samples) -> Iterable[Samples]:
    """Samples in parts of `_STRETCH` readings; the samples themselves where there are none."""
    return samples.blocks(_STRETCH) if len(samples) > _STRETCH else [samples]


def is_flat(principal_variances: Floats, noise: float, *, within: float = FLAT_NOISE) -> bool:
    """Whether readings of (3,) ascending principal variances lie in one plane, as those of a level turn do."""
    thickness, width = np.sqrt(principal_variances[[0, 2]]).tolist()
    return bool(thickness < flat_below(width, noise, within=within))


def flat_below(width: float, noise: float, *, within: float = FLAT_NOISE) -> float:
    """Thickness below which readings are flat; width is their standard deviation along the longest axis.

    Readings without any width, all alike or so far off that rounding leaves none, are never flat: no plane is seen.

    >>> flat_below(30.0, 0.5), flat_below(30.0, 0.0), flat_below(30.0, np.inf), flat_below(0.0, 0.5)
    (0.75, 0.3, 6.0, 0.0)
    """
    return min(max(within * noise, FLAT * width), FLATTEST * width)


class RestSpan(NamedTuple):
    """An interval in which the direction stands still."""

    first: int  #: first reading, counted from 1
    last: int
    start: float  #: s: its time; NaN without times
    end: float

    def __str__(self) -> str:
        """Its times, or else its readings."""
        return f"{self.start:.1f}–{self.end:.1f} s" if self.start <= self.end else f"readings {self.first}–{self.last}"


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """What a verdict asks of a recording, from its summary or from a record of the engine."""

    rows: int  #: usable readings
    repeats: int  #: readings equal to the one before in all three axes
    distinct: int  #: different readings
    rests: int  #: intervals in which the direction stands still
    at_rest: int  #: usable readings of these
    fitted: int  #: readings that a fit goes by: a rest is one, or none beside a long turn; of them …
    fitted_repeats: int  #: … those equal to the one before, …
    fitted_distinct: int  #: … and different ones
    path_correlation: float  #: of one reading with the next
    extent: float  #: range of the axis that ranges farthest
    principal_variances: Floats  #: (3,): variances along the principal axes, ascending
    rails: tuple[Rail, ...]  #: where the sensor was at its limit
    step: float  #: of the coarsest axis that is read in coarse steps; 0 where none is
    clock: TimeStamps  #: what the time stamps say
    skipped: tuple[Skipped, ...]  #: rows left out while reading
    rest_spans: tuple[RestSpan, ...] = ()  #: where the rests are, as far as it is known
    are_rests_left_out: bool = False  #: a fit leaves them out; else each is one reading of it
    doubt: str = ""  #: what the readings look like, if not like a magnetometer's, where nobody says that they are

    @classmethod
    def of_record(cls, record: Records, time: Floats | None = None, skipped: tuple[Skipped, ...] = ()) -> Self:
        """Take the record of readings that were at no rail.

        Parameters
        ----------
        time : (N,) float, s, optional
            As the engine was given it.
        skipped : tuple of Skipped
            Rows left out while reading.

        Examples
        --------
        >>> from flinders.native.engine import engine
        >>> record = engine().fit(np.random.default_rng(1).normal(size=(100, 3)).repeat(2, axis=0))
        >>> Statistics.of_record(record).distinct
        100
        """
        return cls(
            rows=int(record["rows"]),
            repeats=int(record["repeats"]),
            distinct=int(record["distinct"]),
            rests=int(record["rests"]),
            at_rest=int(record["at_rest"]),
            fitted=int(record["fitted"]),
            fitted_repeats=int(record["fitted_repeats"]),
            fitted_distinct=int(record["fitted_distinct"]),
            path_correlation=float(record["path_correlation"]),
            extent=float((record["highest"] - record["lowest"]).max()),
            principal_variances=record["principal_variances"],
            rails=(),
            step=float(record["step"]),
            clock=_clock(record, time),
            skipped=skipped,
        )


def _clock(record: Records, time: Floats | None) -> TimeStamps:
    """What a record says of (N,) times; readings without one are passed over."""
    if time is None or np.isnan(record["start"]):
        return TimeStamps()
    start, end = float(record["start"]), float(record["end"])
    steps = int(np.count_nonzero(~np.isnan(time))) - 1
    return TimeStamps(start, end, end - start, steps, float(record["longest_step"]), int(record["backward_steps"]))
