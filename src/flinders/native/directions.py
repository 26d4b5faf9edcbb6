"""Calls of the engine about directions: those that readings cover, and where to turn next.

>>> Directions().cells_of(np.eye(3)).tolist()
[16, 24, 0]
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.native.layouts import ADVICE, BELIEF, COVERAGE, ROUTE, blank
from flinders.native.library import Library, entries_of, row_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Directions(Library):
    """Coverage of the sphere, guidance and paths over it."""

    def believe(self, centre: Floats, shape: Floats, covariance: Floats, noise: float, counts: Floats) -> Records:
        """What a fit claims: a row of `BELIEF`; counts (100,) of its readings are by cell of the sphere."""
        belief = blank(BELIEF)
        self._library.flinders_believe(
            row_of(centre), entries_of(shape), row_of(covariance), noise, row_of(counts), belief
        )
        return belief

    def rough(self, field: Floats) -> Records | None:
        """A sphere through (N, 3) readings: a row of `BELIEF`; None where they do not tell its centre."""
        belief = blank(BELIEF)
        return None if self._library.flinders_rough(row_of(field), len(field), belief) else belief

    def guidance(self, belief: Records, goal: Records, batch: float = 0.0) -> Records:
        """Where a batch of readings would tell most: a row of `ADVICE`; a batch of 0 is a hundredth of those so far."""
        advice = blank(ADVICE)
        self._library.flinders_guidance(belief, goal, batch, advice)
        return advice

    def path(self, belief: Records, goal: Records, at: Floats, readings_per_deg: float) -> Records:
        """The path of the field from a direction (3,) on: a row of `ROUTE`."""
        route = blank(ROUTE)
        self._library.flinders_path(belief, goal, row_of(at), readings_per_deg, route)
        return route

    def pose_towards(self, frame: int, goal: Records, direction: Floats) -> int:
        """The simplest attitude of a frame, by its number, that meets the field near a direction (3,)."""
        return int(self._library.flinders_pose_towards(frame, goal, row_of(direction)))

    def pose(self, frame: int, pose: int) -> tuple[Floats, int]:
        """(3,) what points down in an attitude of a frame, and how many angles have to be judged by eye."""
        down = np.empty(3)
        return down, int(self._library.flinders_pose(frame, pose, down))

    def coverage(
        self,
        means: Floats,
        readings: Floats,
        centre: ArrayLike,
        shape: ArrayLike,
        *,
        side: float = 0.0,
        within: float = math.inf,
    ) -> Records:
        """Directions from the centre of an ellipsoid, in cells of the sphere: a row of `COVERAGE`.

        Parameters
        ----------
        means, readings : (K, 3), (K,) float
            Mean of the readings of each cell of space, and how many there are.
        centre, shape : (3,), (3, 3) array-like
        side : float
            Of these cells.
        within : float
            Distance beyond which cells, less their side, hold outliers and are left out.
        """
        coverage, scratch = blank(COVERAGE), np.empty(6 * len(means))
        self._library.flinders_coverage_of_cells(
            np.ascontiguousarray(means, np.float64),
            np.ascontiguousarray(readings, np.float64),
            len(means),
            side,
            np.ascontiguousarray(centre, np.float64),
            entries_of(shape),
            within if math.isfinite(within) else 0.0,
            scratch,
            coverage,
        )
        return coverage

    def cells_of(self, directions: Floats) -> NDArray[np.uint32]:
        """(K,) which of the hundred cells of the sphere (K, 3) unit vectors fall into."""
        cells = np.empty(len(directions), np.uint32)
        self._library.flinders_cells_of(np.ascontiguousarray(directions, np.float64), len(directions), cells)
        return cells

    def facing(self, readings: Floats, dip_deg: float) -> tuple[float, bool]:
        """The dip with the sign that (100,) readings in each cell show, and whether they leave both signs open."""
        is_open = np.zeros(1, np.int32)
        facing = self._library.flinders_facing(np.ascontiguousarray(readings, np.float64), dip_deg, is_open)
        return float(facing), bool(is_open[0])
