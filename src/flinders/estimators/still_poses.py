"""Still poses of an accelerometer: spans in which a device is still, each with its mean and the noise of the mean.

A window of readings is still if its scatter is hardly larger than differences of consecutive readings explain.
Consecutive still windows with equal means are one pose. The motion between poses does not matter, and the recording may
be paused there.

>>> rng = np.random.default_rng(1)
>>> sides = np.concatenate([np.eye(3), -np.eye(3)])
>>> acceleration = 9.8 * np.repeat(sides, 100, axis=0) + rng.normal(scale=0.05, size=(600, 3))
>>> poses = StillPoses.of(acceleration)
>>> len(poses), poses.counts.tolist(), poses.mean[0].round(1)
(6, [100, 100, 100, 100, 100, 100], array([ 9.8, -0. ,  0. ]))
>>> bool(np.all(np.abs(poses.noise - 0.05 / 10.0) < 0.001))
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.estimators.covariance import Residuals, correlation_length
from flinders.geometry.rotation import lengths

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats

WINDOW_READINGS: Final = 10
"""Length of a window in readings, and smallest number of readings of a pose."""
MAX_STEP_RATIO: Final = 4.0
"""Largest ratio of a still window's variance to the variance from differences of consecutive readings."""
MIN_SCATTER: Final = 0.003
"""Scatter relative to gravity below which a window is still regardless of `MAX_STEP_RATIO`."""
MAX_SCATTER: Final = 0.03
"""Scatter relative to gravity above which a window is in motion regardless of `MAX_STEP_RATIO`."""
MAX_SCATTER_RATIO: Final = 2.0
"""Largest ratio of a still window's scatter to the lower quartile of all still windows."""
MAX_MEAN_DISTANCE: Final = 0.01
"""Largest distance of a window's mean from its pose, relative to gravity, before noise is added."""
MEAN_DISTANCE_SIGMAS: Final = 5.0
"""Standard deviations of a window's mean that are added to `MAX_MEAN_DISTANCE` for noise."""


@dataclass(frozen=True, slots=True, eq=False)
class StillPoses:
    """Means of still spans."""

    bounds: NDArray[np.intp]  #: (P, 2): first row of each span, and the row after its last
    mean: Floats  #: (P, 3): mean of each span, in the unit of the readings
    noise: Floats  #: (P,): standard deviation of a component of the mean, in the unit of the readings

    def __len__(self) -> int:
        return len(self.bounds)

    @property
    def counts(self) -> NDArray[np.intp]:
        """(P,) number of readings of each pose."""
        return np.diff(self.bounds, axis=1)[:, 0]

    @property
    def scale(self) -> float:
        """Median length of the means: gravity in the unit of the readings."""
        return float(np.median(lengths(self.mean)))

    @classmethod
    def of(cls, acceleration: Floats) -> Self:
        """Find the poses in (N, 3) readings of the specific force in any unit; NaN rows are in no pose."""
        bounds = np.array(list(_find_spans(acceleration)), dtype=np.intp).reshape(-1, 2)
        if not len(bounds):
            return cls(bounds, np.empty((0, 3)), np.empty(0))
        spans = [acceleration[begin:end] for begin, end in bounds]
        mean = np.array([span.mean(axis=0) for span in spans])
        freedom = np.diff(bounds, axis=1)[:, 0]
        left = np.concatenate([span - middle for span, middle in zip(spans, mean, strict=True)])
        variance = float(np.sum(left**2)) / (3.0 * float(np.sum(freedom - 1)))
        noise = np.sqrt(variance * _correlation_length(left, freedom) / freedom)
        return cls(bounds, mean, noise)

    def drift_of(self, values: Floats) -> tuple[Floats, Floats] | None:
        """(3,) mean of another (N, 3) column over all poses, and its 1 σ; None for fewer than three poses.

        The 1 σ comes from the differences between poses. For example, the mean rate is the offset of a gyro.
        """
        means = np.array([np.nanmean(values[begin:end], axis=0) for begin, end in self.bounds])
        means = means[np.isfinite(means).all(axis=1)]
        if len(means) < 3:
            return None
        return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))


def _correlation_length(left: Floats, counts: NDArray[np.intp]) -> float:
    """Correlation length of the readings of poses, in readings."""
    ends = np.cumsum(counts)
    segments = [np.arange(end - count, end) for end, count in zip(ends, counts, strict=True)]
    alone = [Residuals(component, np.zeros((len(component), 1)), segments) for component in left.T]
    return max(1.0, *(correlation_length(each.autocovariance()) for each in alone))


def _find_spans(acceleration: Floats) -> Iterator[tuple[int, int]]:
    """Yield the first row, and the row after the last, of each pose."""
    windows = len(acceleration) // WINDOW_READINGS
    if not windows:
        return
    cut = acceleration[: windows * WINDOW_READINGS].reshape(windows, WINDOW_READINGS, 3)
    known = np.isfinite(cut).all(axis=(1, 2))
    gravity = float(np.median(lengths(cut[known].reshape(-1, 3)))) if known.any() else 1.0
    mean, variance, of_steps = _window_statistics(cut)
    scatter = np.sqrt(variance)
    still = known & (scatter <= MAX_SCATTER * gravity)
    still &= (variance <= MAX_STEP_RATIO * of_steps) | (scatter <= MIN_SCATTER * gravity)
    if still.any():  # in a quiet recording a single reading in motion increases the scatter
        still &= scatter <= max(MAX_SCATTER_RATIO * float(np.quantile(scatter[still], 0.25)), MIN_SCATTER * gravity)
    begin, first = -1, np.zeros(3)
    for place in range(windows):
        reach = MAX_MEAN_DISTANCE * gravity + MEAN_DISTANCE_SIGMAS * scatter[place] / np.sqrt(WINDOW_READINGS)
        is_more = begin >= 0 and still[place] and float(np.linalg.norm(mean[place] - first)) <= reach
        if begin >= 0 and not is_more:
            yield begin * WINDOW_READINGS, place * WINDOW_READINGS
            begin = -1
        if still[place] and not is_more:
            begin, first = place, mean[place]
    if begin >= 0:
        yield begin * WINDOW_READINGS, windows * WINDOW_READINGS


def _window_statistics(cut: Floats) -> tuple[Floats, Floats, Floats]:
    """Statistics of W windows of (W, n, 3) readings: (W, 3) means and two (W,) variances of a component.

    The second variance is half the mean squared difference of consecutive readings.
    """
    mean = cut.mean(axis=1)
    variance = np.sum((cut - mean[:, np.newaxis]) ** 2, axis=(1, 2)) / (3.0 * (WINDOW_READINGS - 1))
    of_steps = np.sum(np.diff(cut, axis=1) ** 2, axis=(1, 2)) / (6.0 * (WINDOW_READINGS - 1))
    return mean, variance, of_steps
