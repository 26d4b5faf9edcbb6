"""Summary of a recording in a few kilobytes: sums, cells and counts that add in any order.

Live pages, log files, several logs of one device and fleets on a cluster all use this summary.

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

_BLOCK_READINGS: Final = 65536
"""Number of readings in a block: small enough to save memory, large enough to make the addition of blocks cheap."""

FLAT_RATIO, MAX_FLAT_RATIO = 0.01, 0.2
"""Ratios of thickness to width of a cloud: below the first it is always flat, above the second never."""

MAX_FLAT_NOISE_RATIO: Final = 1.5
"""Ratio of a cloud's thickness to its noise below which the cloud counts as flat."""


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """Statistics of a recording, which can be added, saved and sent in place of its readings."""

    moments: Moments  #: sums of monomials, for quadric fits
    cloud: Cloud  #: number of readings by cell
    health: DataQuality  #: repeated readings, rails, jumps in time

    @classmethod
    def empty(cls) -> Self:
        """Summary of no readings: the identity of ``+``."""
        return cls(Moments.empty(), Cloud.empty(), DataQuality())

    @classmethod
    def of(cls, readings: Samples | ArrayLike, *, side: float | None = None) -> Summary:
        """Summarise readings in memory.

        Raises `ArrayError` for a wrong shape.

        Parameters
        ----------
        readings : Samples or (N, 3) array-like
        side : float, optional
            Side of the cloud's cells; by default computed from the readings.
        """
        samples = readings if isinstance(readings, Samples) else Samples.of(readings)
        return cls(_sum_moments(samples), _sum_cloud(samples, side), _sum_quality(samples))

    @classmethod
    def of_recording(cls, recording: Recording) -> Summary:
        """Summarise a recording block by block, in one pass and in bounded memory."""
        return cls.of_blocks(recording.blocks())

    @classmethod
    def of_blocks(cls, blocks: Iterable[Samples]) -> Summary:
        """Summarise blocks of one recording."""
        whole: Summary = cls.empty()
        side = None
        for block in blocks:
            if side is None and len(block):
                side = natural_side(block.field)
            whole = whole + cls.of(block, side=side)
        return whole

    @classmethod
    def lazy(cls, samples: Samples) -> Summary:
        """Make a summary of samples in memory, each part of which is computed at its first use."""
        return _LazySummary(samples)

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """Rows that were skipped by the reader."""
        return self.health.skipped

    @property
    def statistics(self) -> Statistics:
        """Statistics for a verdict on a fit that uses every reading."""
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
        """Append the next block of the same recording."""
        return Summary(self.moments + other.moments, self.cloud + other.cloud, self.health + other.health)

    def merge(self, other: Summary) -> Summary:
        """Merge with the summary of a separate recording."""
        return Summary(self.moments + other.moments, self.cloud + other.cloud, self.health.merge(other.health))

    def forget(self, factor: float) -> Summary:
        """Multiply the weight of all readings by a factor below 1, after each block, for exponential forgetting."""
        return Summary(self.moments * factor, self.cloud * factor, self.health)

    def __len__(self) -> int:
        return self.health.rows

    def __repr__(self) -> str:
        return f"Summary({len(self)} readings, {len(self.cloud)} cells)"


class _LazySummary(Summary):
    """Summary of samples in memory, each part of which is computed at its first use."""

    def __init__(self, samples: Samples) -> None:
        vars(self)["_samples"] = samples

    @cached_property
    def moments(self) -> Moments:
        """See `Summary`."""
        return _sum_moments(vars(self)["_samples"])

    @cached_property
    def cloud(self) -> Cloud:
        """See `Summary`."""
        return _sum_cloud(vars(self)["_samples"])

    @cached_property
    def health(self) -> DataQuality:
        """See `Summary`."""
        return _sum_quality(vars(self)["_samples"])

    @property
    def skipped(self) -> tuple[Skipped, ...]:
        """See `Summary`."""
        skipped: tuple[Skipped, ...] = vars(self)["_samples"].skipped
        return skipped

    def __len__(self) -> int:
        return len(vars(self)["_samples"])

    def __reduce__(self) -> tuple[type[Summary], tuple[Moments, Cloud, DataQuality]]:
        """Pickle and copy without the readings."""
        return Summary, (self.moments, self.cloud, self.health)


def _sum_moments(samples: Samples) -> Moments:
    """Sums of monomials of samples, computed in blocks."""
    return reduce(add, (Moments.of(each.field) for each in _blocks(samples)))


def _sum_cloud(samples: Samples, side: float | None = None) -> Cloud:
    """Cells of samples, computed in blocks; the default of `side` is that of all samples."""
    side = natural_side(samples.field) if side is None and len(samples) else side
    return reduce(add, (Cloud.of(each.field, time=each.time, side=side) for each in _blocks(samples)))


def _sum_quality(samples: Samples) -> DataQuality:
    """Repeated readings, rails and jumps in time of samples, computed in blocks."""
    return reduce(add, map(DataQuality.of, _blocks(samples)))


def _blocks(samples: Samples) -> Iterable[Samples]:
    """Blocks of `_BLOCK_READINGS` samples; a shorter recording as one block."""
    return samples.blocks(_BLOCK_READINGS) if len(samples) > _BLOCK_READINGS else [samples]


def is_flat(principal_variances: Floats, noise: float, *, within: float = MAX_FLAT_NOISE_RATIO) -> bool:
    """Whether readings lie in one plane, as in a level turn, by their (3,) ascending principal variances."""
    thickness, width = np.sqrt(principal_variances[[0, 2]]).tolist()
    return bool(thickness < flat_below(width, noise, within=within))


def flat_below(width: float, noise: float, *, within: float = MAX_FLAT_NOISE_RATIO) -> float:
    """Thickness (1 σ) below which readings are flat; `width` is the standard deviation along their longest axis.

    Readings are never flat if their width is zero or only rounding.

    >>> flat_below(30.0, 0.5), flat_below(30.0, 0.0), flat_below(30.0, np.inf), flat_below(0.0, 0.5)
    (0.75, 0.3, 6.0, 0.0)
    """
    return min(max(within * noise, FLAT_RATIO * width), MAX_FLAT_RATIO * width)


class RestSpan(NamedTuple):
    """Interval in which the direction of the field is constant."""

    first: int  #: first reading, counted from 1
    last: int  #: last reading
    start: float  #: s: time of the first reading; NaN without times
    end: float  #: s: time of the last reading; NaN without times

    def __str__(self) -> str:
        """Times of the interval; without times, the numbers of its readings."""
        return f"{self.start:.1f}–{self.end:.1f} s" if self.start <= self.end else f"readings {self.first}–{self.last}"


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Statistics of a recording for a verdict, from its summary or from a record of the engine."""

    rows: int  #: usable readings
    repeats: int  #: readings equal to the previous one in all three axes
    distinct: int  #: different readings
    rests: int  #: number of intervals in which the direction is constant (rests)
    at_rest: int  #: usable readings in rests
    fitted: int  #: readings in the fit: a rest counts as one reading, or as none if the recording has long turns
    fitted_repeats: int  #: readings in the fit that equal the previous one
    fitted_distinct: int  #: different readings in the fit
    path_correlation: float  #: correlation of consecutive readings
    extent: float  #: largest range of an axis, in the unit of the readings
    principal_variances: Floats  #: (3,): variances along the principal axes, ascending
    rails: tuple[Rail, ...]  #: ends of axes at which the sensor was saturated
    step: float  #: resolution of the coarsest axis with coarse resolution; 0 if there is none
    clock: TimeStamps  #: statistics of the time stamps
    skipped: tuple[Skipped, ...]  #: rows that were skipped by the reader
    rest_spans: tuple[RestSpan, ...] = ()  #: the rests, if known
    are_rests_left_out: bool = False  #: whether the fit leaves rests out; otherwise each rest is one reading of the fit
    doubt: str = (
        ""  #: kind of sensor that the readings resemble, unless the user named the columns; empty for a magnetometer
    )

    @classmethod
    def of_record(cls, record: Records, time: Floats | None = None, skipped: tuple[Skipped, ...] = ()) -> Self:
        """Make the statistics from a record of the engine, of readings without rails.

        Parameters
        ----------
        record : Records
            Record of the fit.
        time : (N,) float, s, optional
            Times of the readings in the fit.
        skipped : tuple of Skipped
            Rows that were skipped by the reader.

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
            clock=_time_stamps(record, time),
            skipped=skipped,
        )


def _time_stamps(record: Records, time: Floats | None) -> TimeStamps:
    """Statistics of (N,) times in s from a record; readings without a time are ignored."""
    if time is None or np.isnan(record["start"]):
        return TimeStamps()
    start, end = float(record["start"]), float(record["end"])
    steps = int(np.count_nonzero(~np.isnan(time))) - 1
    return TimeStamps(start, end, end - start, steps, float(record["longest_step"]), int(record["backward_steps"]))
