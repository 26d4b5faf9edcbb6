"""Calls of the engine for directions: coverage of the sphere, guidance where to turn next, and paths of turns.

>>> Directions().cell_indices(np.eye(3)).tolist()
[16, 24, 0]
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flinders.native.layouts import ADVICE, BELIEF, COVERAGE, ROUTE, empty_row
from flinders.native.library import Library, contiguous, symmetric_entries

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Directions(Library):
    """Calls for the coverage of the sphere, for guidance, and for paths of turns."""

    def make_belief(self, centre: Floats, shape: Floats, covariance: Floats, noise: float, counts: Floats) -> Records:
        """Make a row of `BELIEF` from the claim of a fit, and (100,) counts of its readings by cell of the sphere."""
        belief = empty_row(BELIEF)
        self._library.flinders_believe(
            contiguous(centre), symmetric_entries(shape), contiguous(covariance), noise, contiguous(counts), belief
        )
        return belief

    def sphere_belief(self, field: Floats) -> Records | None:
        """Make a row of `BELIEF` from a sphere through (N, 3) readings; None if they do not determine its centre."""
        belief = empty_row(BELIEF)
        return None if self._library.flinders_rough(contiguous(field), len(field), belief) else belief

    def guidance(self, belief: Records, goal: Records, batch: float = 0.0) -> Records:
        """Make a row of `ADVICE`: the direction in which a batch of readings adds the most information.

        `batch` is the number of readings in the batch; 0 stands for a hundredth of the readings so far.
        """
        advice = empty_row(ADVICE)
        self._library.flinders_guidance(belief, goal, batch, advice)
        return advice

    def path(self, belief: Records, goal: Records, at: Floats, readings_per_deg: float) -> Records:
        """Make a row of `ROUTE`: the advised path of the field's direction, which begins at the (3,) direction `at`."""
        route = empty_row(ROUTE)
        self._library.flinders_path(belief, goal, contiguous(at), readings_per_deg, route)
        return route

    def pose_towards(self, frame: int, goal: Records, direction: Floats) -> int:
        """Number of the simplest attitude, of a frame, in which a turn moves the field near a (3,) direction."""
        return int(self._library.flinders_pose_towards(frame, goal, contiguous(direction)))

    def pose(self, frame: int, pose: int) -> tuple[Floats, int]:
        """(3,) down direction in an attitude of a frame, and the number of angles to estimate by eye."""
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
        """Make a row of `COVERAGE`: directions from the centre of an ellipsoid, counted in cells of the sphere.

        Parameters
        ----------
        means, readings : (K, 3), (K,) float
            Mean and number of the readings in each cell of raw space.
        centre, shape : (3,), (3, 3) array-like
            Centre and shape of the ellipsoid.
        side : float
            Side of the cells of raw space.
        within : float
            Largest distance of a cell from the ellipsoid, to which `side` is added; farther cells are left out.
        """
        coverage, scratch = empty_row(COVERAGE), np.empty(6 * len(means))
        self._library.flinders_coverage_of_cells(
            np.ascontiguousarray(means, np.float64),
            np.ascontiguousarray(readings, np.float64),
            len(means),
            side,
            np.ascontiguousarray(centre, np.float64),
            symmetric_entries(shape),
            within if math.isfinite(within) else 0.0,
            scratch,
            coverage,
        )
        return coverage

    def cell_indices(self, directions: Floats) -> NDArray[np.uint32]:
        """(K,) index of the cell of the sphere, 0 to 99, of each of (K, 3) unit vectors."""
        cells = np.empty(len(directions), np.uint32)
        self._library.flinders_cells_of(np.ascontiguousarray(directions, np.float64), len(directions), cells)
        return cells

    def signed_dip(self, readings: Floats, dip_deg: float) -> tuple[float, bool]:
        """Dip with its sign in the sensor's axes, by (100,) counts by cell, and whether both signs are possible."""
        is_open = np.zeros(1, np.int32)
        facing = self._library.flinders_facing(np.ascontiguousarray(readings, np.float64), dip_deg, is_open)
        return float(facing), bool(is_open[0])
