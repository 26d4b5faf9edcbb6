"""Readings that do not belong: which, when, and how far off.

What passes by fades in and out, and its field crosses zero along the surface's normal: readings between outliers and
shortly before and after them are no better. Single outliers, of a bus that drops bits, say nothing of their neighbours;
so a run is where more of eleven readings are far than chance would put there.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> from flinders.core.samples import Samples
>>> field = np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 80.0, 0], [0, 0, 50.0]])
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> outliers_of([Samples(field, time=np.arange(4.0))], sphere, 5.0)
[Outlier(first=2, last=3, readings=2, start_s=1.0, end_s=2.0, max_distance=40.0, independent=2)]
"""

from __future__ import annotations

import dataclasses
from collections import deque
from dataclasses import dataclass
from itertools import islice
from math import comb
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.likelihood import magnitude

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.estimators.data import Readings
    from flinders.estimators.rests import Rests
    from flinders.geometry.ellipsoid import Ellipsoid

WINDOW: Final = 11
"""Readings in a row that are looked at together: a fifth of a second at 50 Hz, and what passes by hand takes longer."""

MARGIN: Final = 25
"""Readings before and after a run that go with it: half a second at 50 Hz, in which a magnet's field fades away."""

LEAST: Final = 3
"""Far readings of a window that make a run at the least, however rare they are."""

BY_CHANCE: Final = 1e-3
"""Runs that outliers thrown in at random may make in a whole recording, on average."""

LOOKS: Final = 3
"""At the readings, before what is in runs and what is not is distinguished."""

NO_RUN: Final = WINDOW + 1
"""More than a window holds: no run is looked for."""

_REACH: Final = MARGIN + WINDOW // 2
"""Readings before and after one that have a say in whether it is left out."""

TOGETHER: Final = 5
"""Rows from one reading that is left out to the next, up to which they are told as one run: a tenth of a second."""

LISTED: Final = 1000
"""Runs of a recording that are kept; more are counted with the last."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """A run of readings that do not belong to the rest."""

    first: int  # usable reading, counted from 1 over all recordings
    last: int  # the last of the run
    readings: int  # outliers among them
    start_s: float  # s: time of the first; NaN without time
    end_s: float  # s: time of the last
    max_distance: float  # largest distance from the ellipsoid, in the unit of the readings
    independent: int = 0  # outliers that a fit would have gone by, each rest as one or none

    def as_dict(self) -> dict[str, int | float | None]:
        """JSON-ready fields; a time that is not known is None."""
        fields = dataclasses.asdict(self)
        return {name: None if value != value else value for name, value in fields.items()}  # noqa: PLR0124

    def __str__(self) -> str:
        rows = f"{self.readings:,} readings" if self.readings > 1 else "a reading"
        rows += " at rest" if self.readings > 1 == self.independent else ""
        if not self.start_s <= self.end_s:  # no time, or a clock that stepped back
            if self.first == self.last:
                return f"reading {self.first}"
            return f"readings {self.first}–{self.last}: {rows}"
        return (
            f"{self.start_s:.1f} s: {rows}" if self.readings == 1 else f"{self.start_s:.1f}–{self.end_s:.1f} s: {rows}"
        )


def outliers_among(readings: Readings, ellipsoid: Ellipsoid, limit: float, dense: int) -> tuple[Outlier, ...]:
    """List what `Readings.near` leaves out, with its rows in the whole of several recordings."""
    runs: list[Outlier] = []
    first_row = 1
    for part in readings.each:
        if part.recording is not None:
            blocks = part.recording.blocks()
            runs += outliers_of(blocks, ellipsoid, limit, dense, first_row=first_row, rests=readings.rests)
        first_row += len(part) if readings.rests else len(part.summary)
    return tuple(runs)


def outliers_of(
    blocks: Iterable[Samples],
    ellipsoid: Ellipsoid,
    limit: float,
    dense: int = NO_RUN,
    *,
    first_row: int = 1,
    rests: Rests | None = None,
) -> list[Outlier]:
    """List the runs of readings that are left out, in order.

    Parameters
    ----------
    blocks : iterable of Samples
        A recording.
    ellipsoid, limit, dense
        See `left_out`; by default only what is farther than the limit is left out.
    first_row : int
        Number of the first reading.
    rests : Rests, optional
        Where each rest is one reading or none: the rests of the recording that rows and times are of.
    """
    runs: list[Outlier] = []
    for block, distances, out in left_out(blocks, ellipsoid, limit, dense):
        for rows in _runs(np.flatnonzero(out)):
            farthest = float(distances[rows].max())
            if rests is None:
                _append(runs, _outlier(rows, first_row, block.time, farthest))
            else:
                _append(runs, _outlier_of_rests(rows + first_row - 1, rests, farthest))
        first_row += len(block)
    return runs


def _runs(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Cut ascending rows where too many good ones lie between."""
    return np.split(rows, np.flatnonzero(np.diff(rows) > TOGETHER) + 1) if len(rows) else []


def _outlier(rows: NDArray[np.intp], first_row: int, time: Floats | None, farthest: float) -> Outlier:
    first, last = int(rows[0]), int(rows[-1])
    start, end = (np.nan, np.nan) if time is None else (float(time[first]), float(time[last]))
    return Outlier(first_row + first, first_row + last, len(rows), start, end, farthest, len(rows))


def _outlier_of_rests(rows: NDArray[np.intp], rests: Rests, farthest: float) -> Outlier:
    """A run of readings that a fit goes by, with the rows and times of those that were read."""
    first, last = int(rests.first[rows[0]]), int(rests.last[rows[-1]])
    start, end = (np.nan, np.nan) if rests.time is None else (float(rests.time[first]), float(rests.time[last]))
    read = int(np.sum(rests.last[rows] - rests.first[rows] + 1))
    return Outlier(first + 1, last + 1, read, start, end, farthest, len(rows))


def _append(runs: list[Outlier], new: Outlier) -> None:
    """Add a run, or lengthen the one before where it goes on from block to block or the list is full."""
    if runs and (new.first - runs[-1].last <= TOGETHER or len(runs) >= LISTED):
        old = runs.pop()
        farthest, rows, fitted = (
            max(old.max_distance, new.max_distance),
            old.readings + new.readings,
            old.independent + new.independent,
        )
        new = Outlier(old.first, new.last, rows, old.start_s, new.end_s, farthest, fitted)
    runs.append(new)


def with_runs(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) readings that are far, in a run of far ones or within a margin of it, from (N,) which are far."""
    return far | _around_runs(far, dense_in(far, len(far)))


def dense_in(far: NDArray[np.bool_], rows: int) -> int:
    """Fewest far readings of a window that make a run, given (N,) which of some consecutive readings are far.

    Only those outside runs are there by chance, so runs that are beyond doubt are set aside before the rest is counted.
    """
    dense = NO_RUN
    for _ in range(LOOKS):
        rest = far[~_around_runs(far, dense)]
        dense = dense_enough(float(rest.mean()), rows) if len(rest) else NO_RUN
    return dense


def dense_enough(share: float, rows: int) -> int:
    """Fewest far readings of a window that chance hardly ever puts there.

    `share`: of the readings, how many are far; `rows`: how many readings there are, and so how many windows.

    >>> dense_enough(0.001, 500), dense_enough(0.08, 500), dense_enough(0.4, 500) == NO_RUN
    (3, 8, True)
    """
    chances = [comb(WINDOW, far) * share**far * (1.0 - share) ** (WINDOW - far) for far in range(WINDOW + 1)]
    rare = (least for least in range(LEAST, WINDOW + 1) if rows * sum(chances[least:]) < BY_CHANCE)
    return next(rare, NO_RUN)


def left_out(
    blocks: Iterable[Samples], ellipsoid: Ellipsoid, limit: float, dense: int
) -> Iterator[tuple[Samples, Floats, NDArray[np.bool_]]]:
    """Go through a recording: each block, (m,) distances from a surface and (m,) which readings are left out.

    Every reading is judged together with its neighbours, so where one block ends and the next begins has no say.
    """
    ahead = iter(blocks)
    pending = deque(islice(ahead, 1))  # not `itertools.tee`, which lets go of blocks by 57
    begun: Floats = np.zeros(_REACH)  # before the first reading nothing is far
    known = np.concatenate([begun, *(np.abs(magnitude.distances(block.field, ellipsoid)) for block in pending)])
    while pending:
        block = pending.popleft()
        needed = _REACH + len(block) + _REACH
        while len(known) < needed and (following := next(ahead, None)) is not None:
            pending.append(following)
            known = np.concatenate([known, np.abs(magnitude.distances(following.field, ellipsoid))])
        here = slice(_REACH, _REACH + len(block))
        far = known[:needed] > limit
        yield block, known[here], (far | _around_runs(far, dense))[here]
        known = known[len(block) :]


def _around_runs(far: NDArray[np.bool_], dense: int) -> NDArray[np.bool_]:
    """(N,) readings in a run and within a margin of it, from (N,) which are far."""
    runs = far if not far.any() else far & (np.convolve(far, np.ones(WINDOW), mode="same") > dense - 0.5)
    return within(MARGIN, runs) if runs.any() else runs


def within(margin: int, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) readings that are at most so many rows from one of some, from (N,) which those are.

    >>> within(1, np.arange(6) == 4).tolist()
    [False, False, False, True, True, True]
    """
    reach = np.convolve(some, np.ones(2 * margin + 1))[margin : margin + len(some)]
    return np.asarray(reach > 0.5, dtype=bool)
