"""Comparison of several compasses of one body: which one deviates, when, and by how much.

All compasses measure one field, and their corrected readings are in common axes. Readings are averaged over about 1 s,
and the difference of the means of each pair is compared with the usual difference of this pair. A sensor deviates if it
is far from more than half of the others while those agree. So with three or more sensors the majority decides. An
exception is a majority whose readings have changed in length while those of the other sensor have not. With two sensors
it is unknown which one is wrong, unless only one of both has changed in length.

A difference d, as a share of the field, changes a level heading by up to asin(d / cos I) at the dip I.

>>> rng = np.random.default_rng(1)
>>> q = rng.normal(size=(600, 3)).cumsum(axis=0)
>>> q /= np.linalg.norm(q, axis=1, keepdims=True)
>>> seen = np.stack([q + rng.normal(scale=0.01, size=q.shape) for _ in range(3)])
>>> seen[1, 200:300] += [0.1, 0.0, 0.0]                     # a phone lies beside the second from 10 to 15 s
>>> time = np.arange(600) / 20.0
>>> [(run.sensor, round(run.start_s), round(run.end_s), round(run.heading_deg)) for run in disagreements(seen, time)]
[(1, 10, 15, 12)]
>>> [(run.sensor, run.is_by_length) for run in disagreements(seen[:2], time, limit_deg=3.0)]  # by the length
[(1, True)]
>>> seen[1, 200:300] -= [0.1, 0.0, 0.0]
>>> seen[1, 200:300] += 0.15 * np.cross(q[200:300], [0.0, 0.0, 1.0])                         # across: no longer
>>> [run.sensor for run in disagreements(seen[:2], time, limit_deg=3.0)]
[None]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.arrays import true_runs
from flinders.geometry.angles import deflection_deg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats

BLOCK_S: Final = 1.0
"""Duration in s over which readings are averaged before the comparison."""

MIN_READINGS: Final = 5
"""Smallest count of readings in an average."""

MIN_UNUSUAL_RATIO: Final = 4.0
"""Smallest ratio of an unusual difference of a pair, or of an unusual change of length, to the usual one."""


MEDIAN_LENGTH: Final = 1.538
"""Median length of a vector of three independent normal components with a standard deviation of 1."""

MEDIAN_CHANGE: Final = 0.6745
"""Median absolute value of one normal component with a standard deviation of 1."""


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A stretch of time in which a sensor disagrees with the others."""

    sensor: int | None  #: index of the deviating sensor; None if unknown
    is_by_length: bool  #: whether the length of its readings shows that it deviates, instead of the other sensors
    first: int  #: index of the first reading
    last: int  #: index of the last reading
    start_s: float  #: time of the first reading
    end_s: float  #: time of the last reading
    angle_deg: float  #: largest angle between the sensor's direction and that of the others, averaged over 1 s
    heading_deg: float  #: largest possible level heading error from the disagreement
    #: largest error of the length of the sensor's readings, as a share of the field; positive if too long
    length_error: float

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {name: getattr(self, name) for name in self.__slots__}

    def of_sensor(self, places: Mapping[int, int]) -> Self:
        """Copy of the span with its sensor renumbered by `places`."""
        return replace(self, sensor=None if self.sensor is None else places[self.sensor])

    def __str__(self) -> str:
        if self.start_s <= self.end_s:
            return f"{self.start_s:.1f}–{self.end_s:.1f} s"
        return f"readings {self.first + 1}–{self.last + 1}"  # the clock has stepped back


def heading_deg(difference: float, dip_deg: float) -> float:
    """Largest level heading error in degrees from a `difference` of fields, as a share of the field.

    180° if the difference exceeds the horizontal field.

    >>> round(heading_deg(0.1, 60.0), 1), heading_deg(0.6, 60.0)
    (11.5, 180.0)
    """
    return deflection_deg(difference / np.cos(np.deg2rad(dip_deg)))


def disagreements(
    seen: Floats, time: Floats, *, limit_deg: float = 1.0, dip_deg: float = 60.0
) -> tuple[Disagreement, ...]:
    """Find the stretches in which sensors disagree.

    Parameters
    ----------
    seen : (m, N, 3) float
        Corrected readings over the field's strength, in common axes; NaN for missing readings.
    time : (N,) float, s
    limit_deg : float
        Heading error in degrees below which a disagreement is ignored.
    dip_deg : float
        Inclination of the field.
    """
    edges = _edges(time)
    limit = float(np.sin(np.deg2rad(min(limit_deg, 90.0))) * np.cos(np.deg2rad(dip_deg)))
    apart = _differences(seen, edges)  # (m, m, K)
    usual = np.nanmedian(np.where(np.isfinite(apart), apart, np.nan), axis=2) if apart.shape[2] else apart[..., 0]
    differ = apart > np.maximum(MIN_UNUSUAL_RATIO * usual, limit)[..., np.newaxis]
    lengths = _lengths(seen, edges)
    has_changed = _has_changed_nearby(differ, lengths, limit)
    blamed = [
        _deviating_sensors(differ[..., block], apart[..., block], lengths, block, limit, has_changed[:, block])
        for block in range(len(edges) - 1)
    ]
    return tuple(_merge_blocks(blamed, time, edges, apart, lengths, dip_deg))


def usual_scatter(seen: Floats, directions: Floats, time: Floats) -> Floats:
    """(m,) usual standard deviation of a component of readings averaged over 1 s, as a share of the field.

    It is estimated by the median, so that a stretch in which a sensor deviates has no effect.

    Parameters
    ----------
    seen : (m, N, 3) float
        As for `disagreements`.
    directions : (N, 3) float
        Common direction of the field at each time.
    time : (N,) float, s
    """
    edges = _edges(time)
    lengths = [np.linalg.norm(_means(each - directions, edges), axis=1) for each in seen]
    return np.array([float(np.nanmedian(each)) / MEDIAN_LENGTH for each in lengths])


def length_scatter(seen: Floats, time: Floats) -> Floats:
    """(m,) usual standard deviation of the length of readings averaged over 1 s, as a share of the field.

    If each sensor is calibrated separately, the result for one sensor does not depend on the others.

    Parameters
    ----------
    seen : (m, N, 3) float
        As for `disagreements`.
    time : (N,) float, s

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> q = rng.normal(size=(20000, 3))
    >>> q /= np.linalg.norm(q, axis=1, keepdims=True)
    >>> noisy = q + rng.normal(scale=0.1, size=q.shape)
    >>> length_scatter(noisy[np.newaxis], np.arange(20000) / 20.0).round(3)        # 0.1 / √20, of 20 a second
    array([0.022])
    """
    lengths = _lengths(seen, _edges(time))
    usual: Floats = np.nanmedian(np.abs(lengths - np.nanmedian(lengths, axis=1, keepdims=True)), axis=1) / MEDIAN_CHANGE
    return usual


def _edges(time: Floats) -> NDArray[np.intp]:
    """Indices at which blocks of about 1 s begin, and the end."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else BLOCK_S
    each = max(MIN_READINGS, round(BLOCK_S / step) if step > 0.0 else MIN_READINGS)
    return np.append(np.arange(0, max(len(time) - each + 1, 1), each), len(time)).astype(np.intp)


def _means(values: Floats, edges: NDArray[np.intp]) -> Floats:
    """(..., K, c) means of the finite values of (..., N, c) over K blocks; NaN for a block with too few values."""
    there = np.isfinite(values)
    total = np.add.reduceat(np.where(there, values, 0.0), edges[:-1], axis=-2)
    count = np.add.reduceat(there.astype(float), edges[:-1], axis=-2)
    means: Floats = np.where(
        count >= min(MIN_READINGS, int(np.diff(edges).min())), total / np.maximum(count, 1.0), np.nan
    )
    return means


def _differences(seen: Floats, edges: NDArray[np.intp]) -> Floats:
    """(m, m, K) distances between the mean readings of each pair, as a share of the field."""
    sensors = len(seen)
    apart = np.zeros((sensors, sensors, len(edges) - 1))
    for one in range(sensors):
        for other in range(one):
            between = np.linalg.norm(_means(seen[one] - seen[other], edges), axis=-1)
            apart[one, other] = apart[other, one] = between
    return apart


def _lengths(seen: Floats, edges: NDArray[np.intp]) -> Floats:
    """(m, K) mean length of the readings of each sensor, minus 1."""
    return _means(np.linalg.norm(seen, axis=2)[..., np.newaxis] - 1.0, edges)[..., 0]


def _has_unusual_length(lengths: Floats, limit: float) -> NDArray[np.bool_]:
    """(m, K) whether the readings of a sensor have an unusual length in a block."""
    usual = np.nanmedian(np.abs(lengths), axis=1, keepdims=True)
    changed: NDArray[np.bool_] = np.abs(lengths) > np.maximum(MIN_UNUSUAL_RATIO * usual, 0.5 * limit)
    return changed


def _has_changed_nearby(differ: NDArray[np.bool_], lengths: Floats, limit: float) -> NDArray[np.bool_]:
    """(m, K) whether readings of a sensor have an unusual length anywhere in the disagreement around a block."""
    changed = _has_unusual_length(lengths, limit)
    has_changed = np.zeros_like(changed)
    for run in true_runs(differ.any(axis=(0, 1))):
        has_changed[:, run] = changed[:, run].any(axis=1, keepdims=True)
    return has_changed


def _deviating_sensors(
    differ: NDArray[np.bool_], apart: Floats, lengths: Floats, block: int, limit: float, has_changed: NDArray[np.bool_]
) -> tuple[tuple[int | None, bool], ...]:
    """Deviating sensors of a block: those far from most others, else one with a changed length, else None.

    Each has a flag, whether its length shows the deviation.
    """
    # If the lengths of the deviating sensors never changed, but those of all others did, the others deviate: iron near
    # two of three sensors affects both alike. Without a majority, two or more sensors that agree and have unchanged
    # lengths count as the majority.
    if not differ.any():
        return ()
    sensors = len(differ)
    there = int(np.count_nonzero(np.isfinite(apart).sum(axis=1) > 1))
    against = differ.sum(axis=1)
    alone = np.flatnonzero(against > (there - 1) / 2.0)
    if there > 2 and 0 < len(alone) < there / 2.0:
        rest = [sensor for sensor in range(sensors) if sensor not in alone and np.isfinite(apart[sensor]).sum() > 1]
        if not has_changed[alone].any() and has_changed[rest].all():
            return tuple((sensor, True) for sensor in rest)
        return tuple((int(sensor), False) for sensor in alone)
    if there > 2 and not len(alone) and sensors > 2:
        alone = np.flatnonzero(against)
    steady = [sensor for sensor in range(sensors) if not has_changed[sensor] and np.isfinite(apart[sensor]).sum() > 1]
    if 2 <= len(steady) < there and not differ[np.ix_(steady, steady)].any():
        return tuple((int(sensor), True) for sensor in np.flatnonzero(has_changed))
    changed = _has_unusual_length(lengths, limit)[:, block]
    longer = [int(sensor) for sensor in alone if changed[sensor]]
    return ((longer[0], True),) if len(longer) == 1 else ((None, False),)


def _merge_blocks(
    blamed: list[tuple[tuple[int | None, bool], ...]],
    time: Floats,
    edges: NDArray[np.intp],
    apart: Floats,
    lengths: Floats,
    dip_deg: float,
) -> Iterator[Disagreement]:
    """Merge consecutive blocks in which the same sensor deviates."""
    who = sorted(
        {each for block in blamed for each in block}, key=lambda each: (each[0] is None, each[0] or 0, each[1])
    )
    for each in who:
        sensor, is_by_length = each
        for run in true_runs([each in those for those in blamed]):
            first, last = int(edges[run.start]), int(edges[run.stop]) - 1
            farthest = float(np.nanmax(_distances(apart[..., run], sensor)))
            length = lengths[:, run] if sensor is None else lengths[sensor, run]
            angle = 2.0 * np.rad2deg(np.arcsin(min(farthest / 2.0, 1.0)))
            yield Disagreement(
                sensor, is_by_length, first, last, float(time[first]), float(time[last]), float(angle),
                heading_deg(farthest, dip_deg), float(length.ravel()[np.nanargmax(np.abs(length))]),
            )  # fmt: skip


def _distances(apart: Floats, sensor: int | None) -> Floats:
    """(K,) median distance of a sensor from the others; for None the largest distance of any pair."""
    if sensor is None:
        return np.asarray(np.nanmax(apart, axis=(0, 1)), float)
    others = np.delete(apart[sensor], sensor, axis=0)
    return np.asarray(np.nanmedian(others, axis=0), float)
