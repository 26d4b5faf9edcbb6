"""Readings that do not belong: which, when, and how far off.

>>> from flinders.quadric import Ellipsoid
>>> from flinders.samples import Samples
>>> field = np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 80.0, 0], [0, 0, 50.0]])
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> strays_of([Samples(field, time=np.arange(4.0))], sphere, 5.0)
[Stray(first=2, last=3, rows=2, start=1.0, end=2.0, farthest=40.0)]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.result import Stray
from flinders.terms import magnitude

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.quadric import Ellipsoid
    from flinders.samples import Samples

TOGETHER: Final = 5
"""Good readings between two strays that still belong to one run."""

LISTED: Final = 1000
"""Runs that are kept; more are counted with the last."""


def strays_of(blocks: Iterable[Samples], ellipsoid: Ellipsoid, limit: float) -> list[Stray]:
    """List the runs of readings that are farther than `limit` from a surface, in order."""
    runs: list[Stray] = []
    begin = 1
    for block in blocks:
        distances = np.abs(magnitude.distances(block.field, ellipsoid))
        for rows in _runs(np.flatnonzero(distances > limit)):
            _append(runs, _stray(rows, begin, block.time, distances))
        begin += len(block)
    return runs


def _runs(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Cut ascending rows where too many good ones lie between."""
    return np.split(rows, np.flatnonzero(np.diff(rows) > TOGETHER) + 1) if len(rows) else []


def _stray(rows: NDArray[np.intp], begin: int, time: Floats | None, distances: Floats) -> Stray:
    first, last = int(rows[0]), int(rows[-1])
    start, end = (np.nan, np.nan) if time is None else (float(time[first]), float(time[last]))
    return Stray(begin + first, begin + last, len(rows), start, end, float(distances[rows].max()))


def _append(runs: list[Stray], new: Stray) -> None:
    """Add a run, or lengthen the one before where it goes on across a seam or the list is full."""
    if runs and (new.first - runs[-1].last <= TOGETHER or len(runs) >= LISTED):
        old = runs.pop()
        new = Stray(old.first, new.last, old.rows + new.rows, old.start, new.end, max(old.farthest, new.farthest))
    runs.append(new)
