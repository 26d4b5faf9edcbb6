"""Still poses of an accelerometer: the spans in which a device stands still, each with its mean and the noise of that.

A window of readings is still where its readings scatter hardly more than steps from one to the next explain. Still
windows that follow each other and agree are one pose. How a person moved the device in between does not matter, and a
recording may have been paused there.

>>> rng = np.random.default_rng(1)
>>> sides = np.concatenate([np.eye(3), -np.eye(3)])
>>> felt = 9.8 * np.repeat(sides, 100, axis=0) + rng.normal(scale=0.05, size=(600, 3))
>>> poses = StillPoses.of(felt)
>>> len(poses), poses.counts.tolist(), poses.mean[0].round(1)
(6, [100, 100, 100, 100, 100, 100], array([ 9.8, -0. ,  0. ]))
>>> bool(np.all(np.abs(poses.noise - 0.05 / 10.0) < 0.001))
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.estimators.covariance import Residuals, time_of
from flinders.geometry.rotation import lengths

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats

WINDOW: Final = 10
"""Readings that are looked at together, and least readings of a pose."""
STEP_RATIO: Final = 4.0
"""Variance of a still window, at most, over that which steps from one reading to the next explain."""
QUIET: Final = 0.003
"""Of gravity: scatter of a window that is still whatever its steps are."""
LOUD: Final = 0.03
"""Of gravity: scatter of a window that is moved whatever its steps are."""
UNUSUAL: Final = 2.0
"""Scatter of a still window, at most, over that which a quarter of them stay below."""
SAME_POSE: Final = 0.01
"""Of gravity: distance of the mean of a window from that of its pose, at most; more with more noise."""
SIGMAS: Final = 5.0
"""Standard deviations of the mean of a window, which are no distance."""


@dataclass(frozen=True, slots=True, eq=False)
class StillPoses:
    """Means of still spans."""

    bounds: NDArray[np.intp]  #: (P, 2): first row of each span, and the row behind its last
    mean: Floats  #: (P, 3): in the unit of the readings
    noise: Floats  #: (P,): standard deviation of a component of that mean, in that unit

    def __len__(self) -> int:
        return len(self.bounds)

    @property
    def counts(self) -> NDArray[np.intp]:
        """(P,) readings of each."""
        return np.diff(self.bounds, axis=1)[:, 0]

    @property
    def scale(self) -> float:
        """Median length of the means: what gravity is, in the unit of the readings."""
        return float(np.median(lengths(self.mean)))

    @classmethod
    def of(cls, acceleration: Floats) -> Self:
        """Find the poses of (N, 3) readings, specific force in any unit; rows with NaN belong to none."""
        bounds = np.array(list(_spans(acceleration)), dtype=np.intp).reshape(-1, 2)
        if not len(bounds):
            return cls(bounds, np.empty((0, 3)), np.empty(0))
        spans = [acceleration[begin:end] for begin, end in bounds]
        mean = np.array([span.mean(axis=0) for span in spans])
        freedom = np.diff(bounds, axis=1)[:, 0]
        left = np.concatenate([span - middle for span, middle in zip(spans, mean, strict=True)])
        variance = float(np.sum(left**2)) / (3.0 * float(np.sum(freedom - 1)))
        noise = np.sqrt(variance * _correlated(left, freedom) / freedom)
        return cls(bounds, mean, noise)

    def drift_of(self, values: Floats) -> tuple[Floats, Floats] | None:
        """(3,) mean of another column, (N, 3), over all poses, and 1 σ by how poses differ; None of fewer than three.

        What a gyro reads at rest, say, which is its offset.
        """
        means = np.array([np.nanmean(values[begin:end], axis=0) for begin, end in self.bounds])
        means = means[np.isfinite(means).all(axis=1)]
        if len(means) < 3:
            return None
        return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))


def _correlated(left: Floats, counts: NDArray[np.intp]) -> float:
    """Readings of a pose that say as much as one independent reading."""
    ends = np.cumsum(counts)
    segments = [np.arange(end - count, end) for end, count in zip(ends, counts, strict=True)]
    alone = [Residuals(component, np.zeros((len(component), 1)), segments) for component in left.T]
    return max(1.0, *(time_of(each.autocovariance()) for each in alone))


def _spans(acceleration: Floats) -> Iterator[tuple[int, int]]:
    """First row, and row behind the last, of each pose."""
    windows = len(acceleration) // WINDOW
    if not windows:
        return
    cut = acceleration[: windows * WINDOW].reshape(windows, WINDOW, 3)
    known = np.isfinite(cut).all(axis=(1, 2))
    gravity = float(np.median(lengths(cut[known].reshape(-1, 3)))) if known.any() else 1.0
    mean, variance, of_steps = _windows(cut)
    scatter = np.sqrt(variance)
    still = known & (scatter <= LOUD * gravity)
    still &= (variance <= STEP_RATIO * of_steps) | (scatter <= QUIET * gravity)
    if still.any():  # one reading on the way to the next pose stands out of a quiet recording
        still &= scatter <= max(UNUSUAL * float(np.quantile(scatter[still], 0.25)), QUIET * gravity)
    begin, first = -1, np.zeros(3)
    for place in range(windows):
        reach = SAME_POSE * gravity + SIGMAS * scatter[place] / np.sqrt(WINDOW)
        is_more = begin >= 0 and still[place] and float(np.linalg.norm(mean[place] - first)) <= reach
        if begin >= 0 and not is_more:
            yield begin * WINDOW, place * WINDOW
            begin = -1
        if still[place] and not is_more:
            begin, first = place, mean[place]
    if begin >= 0:
        yield begin * WINDOW, windows * WINDOW


def _windows(cut: Floats) -> tuple[Floats, Floats, Floats]:
    """(W, 3) means, and of a component (W,) variances and half the mean squares of steps, of (W, n, 3) readings."""
    mean = cut.mean(axis=1)
    variance = np.sum((cut - mean[:, np.newaxis]) ** 2, axis=(1, 2)) / (3.0 * (WINDOW - 1))
    of_steps = np.sum(np.diff(cut, axis=1) ** 2, axis=(1, 2)) / (6.0 * (WINDOW - 1))
    return mean, variance, of_steps
