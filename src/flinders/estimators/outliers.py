"""Outliers of a recording: runs of readings, their times and distances.

The field of a passing magnet rises and falls slowly, and its component along the surface's normal crosses zero. So
readings between outliers, and shortly before and after them, are also disturbed. Single outliers, such as those of a
bus that drops bits, do not affect their neighbours. Therefore outliers make a run if, of eleven consecutive readings,
more are far from the surface than chance explains.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> from flinders.core.samples import Samples
>>> field = np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 80.0, 0], [0, 0, 50.0]])
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> outlier_runs([Samples(field, time=np.arange(4.0))], sphere, 5.0)
[Outlier(first=2, last=3, readings=2, start_s=1.0, end_s=2.0, max_distance=40.0, independent=2)]
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.samples import Samples
from flinders.findings.words import outlier_run
from flinders.likelihood import magnitude
from flinders.native.engine import engine
from flinders.native.layouts import OUTLIER, enum_value

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.rests import Rests
    from flinders.geometry.ellipsoid import Ellipsoid

WINDOW_READINGS: Final = enum_value("WINDOW")
"""Length in readings of the window in which a run is detected: 0.2 s at 50 Hz, less than a magnet takes to pass."""

MARGIN_READINGS: Final = enum_value("MARGIN")
"""Count of readings before and after a run that are also left out: 0.5 s at 50 Hz, in which a magnet's field fades."""

NO_RUN: Final = enum_value("NO_RUN")
"""Value of `dense` for outliers without runs: no window has so many readings."""

_REACH_READINGS: Final = MARGIN_READINGS + WINDOW_READINGS // 2
"""Half the width, in readings, of the window that decides whether the reading at its centre is left out."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """A run of outliers."""

    first: int  # number of its first usable reading, counted from 1 over all recordings
    last: int  # number of its last reading
    readings: int  # number of outliers in the run
    start_s: float  # s: time of the first reading; NaN without times
    end_s: float  # s: time of the last reading; NaN without times
    max_distance: float  # largest distance from the ellipsoid, in the unit of the readings
    independent: int = 0  # number of outliers if all readings of a rest count as one or none, as in a fit

    @classmethod
    def of_run(cls, run: np.void) -> Self:
        """Make the run from a row of `flinders.native.layouts.OUTLIER`, in which readings are counted from 0."""
        first, last, rows, fitted, *times, farthest = run.tolist()
        start, end = (np.nan if math.isnan(time) else time for time in times)  # one object, so that runs compare
        return cls(first + 1, last + 1, rows, start, end, farthest, fitted)

    def as_dict(self) -> dict[str, int | float | None]:
        """JSON-ready fields; a time that is not known is None."""
        fields = dataclasses.asdict(self)
        return {name: None if value != value else value for name, value in fields.items()}  # noqa: PLR0124

    def __str__(self) -> str:
        return outlier_run(self.first, self.last, self.readings, self.start_s, self.end_s, self.independent)


def list_outliers(readings: Readings, ellipsoid: Ellipsoid, limit: float, dense: int) -> tuple[Outlier, ...]:
    """Runs of readings that `Readings.inliers` leaves out; readings are numbered over all recordings."""
    outliers: list[Outlier] = []
    first_row = 1
    for part in readings.single_recordings:
        if part.recording is not None:
            whole = part.recording
            blocks = [whole] if readings.rests and isinstance(whole, Samples) else whole.blocks()
            outliers += outlier_runs(blocks, ellipsoid, limit, dense, first_row=first_row, rests=readings.rests)
        first_row += len(part) if readings.rests else len(part.summary)
    return tuple(outliers)


def outlier_runs(
    blocks: Iterable[Samples],
    ellipsoid: Ellipsoid,
    limit: float,
    dense: int = NO_RUN,
    *,
    first_row: int = 1,
    rests: Rests | None = None,
) -> list[Outlier]:
    """Runs of outliers in a recording, in order.

    Parameters
    ----------
    blocks : iterable of Samples
        Blocks of the recording.
    ellipsoid, limit, dense
        As in `mark_outliers`; by default only readings beyond `limit` are left out.
    first_row : int
        Number of the first reading.
    rests : Rests, optional
        Rests of the original recording, if each rest is one reading or none in `blocks`. The numbers and times of runs
        are then those of the original recording.
    """
    runs = np.empty(0, OUTLIER)
    for block, distances, out in mark_outliers(blocks, ellipsoid, limit, dense):
        rows = np.arange(first_row - 1, first_row - 1 + len(block))
        if out.any():
            runs = engine().list_outliers(runs, distances, out, *_rows_and_times(rows, block.time, rests))
        first_row += len(block)
    return [Outlier.of_run(run) for run in runs]


def _rows_and_times(
    rows: NDArray[np.int64], time: Floats | None, rests: Rests | None
) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], tuple[Floats, Floats] | None]:
    """First and last row of each reading in the original recording, and the times of these rows."""
    if rests is None:
        return (rows, rows), None if time is None else (time, time)
    first, last = rests.first[rows], rests.last[rows]
    return (first, last), None if rests.time is None else (rests.time[first], rests.time[last])


def extend_to_runs(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) whether each reading is an outlier: far readings, and all readings in or near a run of far readings.

    `far` is (N,), whether each reading is far from the surface.
    """
    return engine().mark_outliers(far, min_run_readings(far, len(far)))


def min_run_readings(far: NDArray[np.bool_], rows: int) -> int:
    """Smallest number of far readings in a window that make a run.

    `far` is (N,), whether each reading is far from the surface; `rows` is the number of readings in the recording. The
    rate of far readings by chance is that outside of runs, so that obvious runs are removed before counting.

    >>> min_run_readings(np.arange(500) % 500 == 9, 500), min_run_readings(np.arange(500) % 3 == 0, 500) == NO_RUN
    (3, True)
    """
    return engine().min_run_readings(far, rows)


def mark_outliers(
    blocks: Iterable[Samples], ellipsoid: Ellipsoid, limit: float, dense: int
) -> Iterator[tuple[Samples, Floats, NDArray[np.bool_]]]:
    """Yield each block of m readings with (m,) distances from a surface, and (m,) whether each reading is left out.

    Readings beyond `limit` are left out, and runs with at least `dense` such readings in a window. Runs may cross the
    ends of blocks, so that the result does not depend on the blocks.
    """
    ahead = iter(blocks)
    pending = deque(islice(ahead, 1))  # not `itertools.tee`, which releases blocks in groups of 57
    begun: Floats = np.zeros(_REACH_READINGS)  # before the first reading nothing is far
    known = np.concatenate([begun, *(np.abs(magnitude.distances(block.field, ellipsoid)) for block in pending)])
    while pending:
        block = pending.popleft()
        needed = _REACH_READINGS + len(block) + _REACH_READINGS
        while len(known) < needed and (following := next(ahead, None)) is not None:
            pending.append(following)
            known = np.concatenate([known, np.abs(magnitude.distances(following.field, ellipsoid))])
        here = slice(_REACH_READINGS, _REACH_READINGS + len(block))
        far = known[:needed] > limit
        yield block, known[here], engine().mark_outliers(far, dense)[here]
        known = known[len(block) :]


def is_near(margin: int, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) whether each row is at most `margin` rows from a row at which the (N,) mask `some` is true.

    >>> is_near(1, np.arange(6) == 4).tolist()
    [False, False, False, True, True, True]
    """
    reach = np.convolve(some, np.ones(2 * margin + 1))[margin : margin + len(some)]
    return np.asarray(reach > 0.5, dtype=bool)
