"""Whether a column of a log follows the attitude: its values are a function of the direction of the field.

An offset that is a function of the direction of the field, P c(u), is soft iron, or a term of an ellipsoid that no
calibration has: no recording tells the two apart. `following` measures it without a model of that function: a value is
predicted from readings of nearly the same direction in other parts of the recording,

    R² = 1 − Σ (c − ĉ(u))² / Σ (c − c̄)²,        ĉ(u) the mean of the nearest readings that were kept

over readings of a stretch that was left out. A column that only happened to change slowly predicts nothing there.

>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(3000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> tilted, switched = directions[:, 2] ** 2, np.repeat(rng.uniform(size=30), 100)
>>> following(tilted, directions) > 0.95, following(switched, directions) < 0.1
(True, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.diagnostics.hold_out import folds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

PIECES: Final = 4
"""Intervals of each fold."""

MAX_READINGS: Final = 2_000
"""Readings that are compared with each other."""

NEIGHBOURS: Final = 8
"""Readings of nearly the same direction whose mean predicts a value."""

MIN_COSINE: Final = float(np.cos(np.deg2rad(20.0)))
"""Of the angle between a reading and the farthest of those neighbours: others say nothing of it."""

MIN_PREDICTED: Final = 0.2
"""Share of the readings that have such neighbours; with fewer, nothing is said."""


def following(values: Floats, directions: Floats) -> float:
    """Share of the variance of (N,) values that (N, 3) directions of the field predict in stretches left out, to 1.

    Below 0 where they predict less than the mean does; NaN where too few directions come again.
    """
    stride = -(-len(values) // MAX_READINGS)
    values, directions = values[::stride], directions[::stride]
    total = left = 0.0
    predicted = 0
    for kept, out in folds(len(values), PIECES):
        near, is_near = _neighbours(directions[out], directions[kept])
        own = values[out][is_near]
        left += float(np.sum((own - values[kept][near[is_near]].mean(axis=1)) ** 2))
        total += float(np.sum((own - values[kept].mean()) ** 2))
        predicted += len(own)
    if predicted < MIN_PREDICTED * len(values) or not total > 0.0:
        return np.nan
    return 1.0 - left / total


def _neighbours(of: Floats, among: Floats) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """(M, k) places of the nearest of (K, 3) directions to each of (M, 3), and (M,) whether all of them are near."""
    cosines = of @ among.T
    count = min(NEIGHBOURS, len(among))
    near = np.argpartition(-cosines, count - 1, axis=1)[:, :count]
    return near, np.take_along_axis(cosines, near, axis=1).min(axis=1) >= MIN_COSINE
