"""Test whether a column of a log follows the attitude: its values are a function of the direction of the field.

An offset P c(u) that is a function of the direction u of the field cannot be distinguished from soft iron in any
recording. `predicted_share` measures such a dependence without a model of the function: it predicts each value
from readings of nearly the same direction in other parts of the recording,

    R² = 1 − Σ (c − ĉ(u))² / Σ (c − c̄)²,        ĉ(u) the mean of the nearest readings in the other parts

over readings of left-out stretches. A column that merely changes slowly with time cannot be predicted there.

>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(3000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> tilted, switched = directions[:, 2] ** 2, np.repeat(rng.uniform(size=30), 100)
>>> predicted_share(tilted, directions) > 0.95, predicted_share(switched, directions) < 0.1
(True, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.diagnostics.hold_out import folds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

INTERVALS_PER_FOLD: Final = 4
"""Count of intervals of each fold."""

MAX_READINGS: Final = 2_000
"""Largest count of readings that are compared with each other."""

NEIGHBOURS: Final = 8
"""Count of readings of nearly the same direction whose mean predicts a value."""

MIN_COSINE: Final = float(np.cos(np.deg2rad(20.0)))
"""Cosine of the largest angle between a reading and its farthest neighbour; beyond 20° no value is predicted."""

MIN_PREDICTED: Final = 0.2
"""Smallest share of readings whose neighbours are within `MIN_COSINE`; with fewer the result is NaN."""


def predicted_share(values: Floats, directions: Floats) -> float:
    """Share of the variance of (N,) values that (N, 3) field directions predict in left-out stretches, at most 1.

    The share is negative if the mean of all values predicts better. It is NaN if too few directions recur.
    """
    stride = -(-len(values) // MAX_READINGS)
    values, directions = values[::stride], directions[::stride]
    total = left = 0.0
    predicted = 0
    for kept, out in folds(len(values), INTERVALS_PER_FOLD):
        near, is_near = _neighbours(directions[out], directions[kept])
        own = values[out][is_near]
        left += float(np.sum((own - values[kept][near[is_near]].mean(axis=1)) ** 2))
        total += float(np.sum((own - values[kept].mean()) ** 2))
        predicted += len(own)
    if predicted < MIN_PREDICTED * len(values) or not total > 0.0:
        return np.nan
    return 1.0 - left / total


def _neighbours(of: Floats, among: Floats) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """(M, k) indices of the (K, 3) directions `among` that are nearest to each of the (M, 3) directions `of`.

    Also (M,) whether all of these neighbours are near.
    """
    cosines = of @ among.T
    count = min(NEIGHBOURS, len(among))
    near = np.argpartition(-cosines, count - 1, axis=1)[:, :count]
    return near, np.take_along_axis(cosines, near, axis=1).min(axis=1) >= MIN_COSINE
