"""Readings that do not belong: which, when, and how far off.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> from flinders.core.samples import Samples
>>> field = np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 80.0, 0], [0, 0, 50.0]])
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> outliers_of([Samples(field, time=np.arange(4.0))], sphere, 5.0)
[Outlier(first=2, last=3, rows=2, start=1.0, end=2.0, farthest=40.0)]
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.data import NO_RUN, left_out

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.data import Readings
    from flinders.geometry.ellipsoid import Ellipsoid

TOGETHER: Final = 5
"""Rows from one reading that is left out to the next, up to which they are told as one run: a tenth of a second."""

LISTED: Final = 1000
"""Runs of a recording that are kept; more are counted with the last."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """A run of readings that do not belong to the rest."""

    first: int  # usable reading, counted from 1 over all recordings
    last: int
    rows: int  # strays among them
    start: float  # s: time of the first; NaN without time
    end: float  # s: time of the last
    farthest: float  # largest distance from the ellipsoid, in the unit of the readings

    def as_dict(self) -> dict[str, int | float | None]:
        """JSON-ready fields; a time that is not known is None."""
        fields = dataclasses.asdict(self)
        return {name: None if value != value else value for name, value in fields.items()}  # noqa: PLR0124

    def __str__(self) -> str:
        rows = f"{self.rows:,} readings" if self.rows > 1 else "a reading"
        if np.isnan(self.start):
            if self.first == self.last:
                return f"reading {self.first}"
            return f"readings {self.first}–{self.last}: {rows}"
        return f"{self.start:.1f} s: {rows}" if self.rows == 1 else f"{self.start:.1f}–{self.end:.1f} s: {rows}"


def outliers_among(readings: Readings, ellipsoid: Ellipsoid, limit: float, dense: int) -> tuple[Outlier, ...]:
    """List what `Readings.near` leaves out, with its rows in the whole of several recordings."""
    runs: list[Outlier] = []
    first_row = 1
    for part in readings.each:
        if part.recording is not None:
            runs += outliers_of(part.recording.blocks(), ellipsoid, limit, dense, first_row=first_row)
        first_row += len(part.summary)
    return tuple(runs)


def outliers_of(
    blocks: Iterable[Samples], ellipsoid: Ellipsoid, limit: float, dense: int = NO_RUN, *, first_row: int = 1
) -> list[Outlier]:
    """List the runs of readings that are left out, in order.

    Parameters
    ----------
    blocks : iterable of Samples
        A recording.
    ellipsoid, limit, dense
        See `flinders.estimators.data`; by default only what is farther than the limit is left out.
    first_row : int
        Number of the first reading.
    """
    runs: list[Outlier] = []
    for block, distances, out in left_out(blocks, ellipsoid, limit, dense):
        for rows in _runs(np.flatnonzero(out)):
            _append(runs, _outlier(rows, first_row, block.time, distances))
        first_row += len(block)
    return runs


def _runs(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Cut ascending rows where too many good ones lie between."""
    return np.split(rows, np.flatnonzero(np.diff(rows) > TOGETHER) + 1) if len(rows) else []


def _outlier(rows: NDArray[np.intp], first_row: int, time: Floats | None, distances: Floats) -> Outlier:
    first, last = int(rows[0]), int(rows[-1])
    start, end = (np.nan, np.nan) if time is None else (float(time[first]), float(time[last]))
    return Outlier(first_row + first, first_row + last, len(rows), start, end, float(distances[rows].max()))


def _append(runs: list[Outlier], new: Outlier) -> None:
    """Add a run, or lengthen the one before where it goes on from block to block or the list is full."""
    if runs and (new.first - runs[-1].last <= TOGETHER or len(runs) >= LISTED):
        old = runs.pop()
        new = Outlier(old.first, new.last, old.rows + new.rows, old.start, new.end, max(old.farthest, new.farthest))
    runs.append(new)
