"""Which readings a robust fit leaves out: those far from the surface, and those around a run of them.

What passes by fades in and out, and its field crosses zero along the surface's normal: readings between
strays and shortly before and after them are no better. Single strays, of a bus that drops bits, say
nothing of their neighbours; so a run is where more of eleven readings are far than chance would put there.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> near = Inliers(Samples(np.array([[50.0, 0, 0], [0, 90.0, 0], [0, 0, 51.0]])), sphere, 5.0)
>>> [block.field for block in near.blocks()]
[array([[50.,  0.,  0.],
       [ 0.,  0., 51.]])]
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice
from math import comb
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Recording, Samples, Wrapped
from flinders.likelihood import magnitude

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
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
"""At the readings, before what is in runs and what is not is told apart."""

NO_RUN: Final = WINDOW + 1
"""More than a window holds: no run is looked for."""

_REACH: Final = MARGIN + WINDOW // 2
"""Readings before and after one that have a say in whether it is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class Inliers(Wrapped):
    """The readings of a recording that are close to a surface, without those around a run of others.

    Attributes
    ----------
    recording : Recording
    ellipsoid : Ellipsoid
    limit : float
        Farthest Sampson distance, in the unit of the readings.
    dense : int
        Far readings of a window that make a run, see `dense_in`.
    """

    recording: Recording
    ellipsoid: Ellipsoid
    limit: float
    dense: int = NO_RUN

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording without what is left out."""
        for block, _, out in left_out(self.recording.blocks(), self.ellipsoid, self.limit, self.dense):
            yield block[~out]


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

    Parameters
    ----------
    share : float
        Of the readings, how many are far.
    rows : int
        How many readings there are, and so how many windows.

    Examples
    --------
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
    if not runs.any():
        return runs
    reach = np.convolve(runs, np.ones(2 * MARGIN + 1))[MARGIN : MARGIN + len(far)]
    return np.asarray(reach > 0.5, dtype=bool)
