"""Path planning: how to turn a sensor, several turns ahead, so that the target is reached with little rotation.

`flinders.heading.guidance` finds the direction of the most informative readings. A sensor also takes readings while it
is turned there, so that the path matters. In body axes the field's direction moves along a path on the sphere. The
information of each part of a path can be computed in advance, and the best of many paths is the advice. Paths lead over
42 waypoints, about 35° apart. A beam search keeps the paths with the smallest predicted worst error, and selects the
first path that reaches the target. The path is planned again after 0.25 s.

In the first seconds there is no fit, and so no centre from which directions are counted. A few readings on an arc
determine the centre in the plane of the arc, but not perpendicular to it. `rough_belief` assumes a sphere whose
covariance is large perpendicular to the plane, so that the path leads out of the plane.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> recording = simulate.tumble(seed=1, motion="tilted")           # never beyond 35° of tilt
>>> fit = calibrate.fit(recording.samples)
>>> belief = Belief.of(fit.claim, fit.evidence.noise, fit.evidence.coverage)
>>> way = plan(belief, [0.5, 0.0, 0.87], target_deg=0.5, goal="attitude")
>>> way
Route(6 waypoints, worst 2.56°, at its end 0.70°)
>>> way.words("vehicle")
'lower its nose, then roll it to its right'

An open arc gives the direction out of its plane:

>>> angle = np.linspace(0.0, 2.0, 40)[:, np.newaxis]
>>> arc = 50.0 * (np.cos(angle) * [1.0, 0.0, 0.0] + np.sin(angle) * [0.0, 1.0, 0.0]) + [10.0, 0.0, 0.0]
>>> belief = rough_belief(arc)
>>> belief.ellipsoid.centre.round(6), bool(abs(plan(belief, [-0.42, 0.91, 0.0]).waypoints[0][2]) > 0.3)
(array([10.,  0.,  0.]), True)

Sources: sequential designs as in `flinders.heading.guidance`; beam search: P. S. Ow, T. E. Morton, "Filtered beam
search in scheduling", Int. J. Production Research 26 (1988) 35–62. `python -m benchmarks.guidance` measures its effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Final, Protocol, Self

import numpy as np

from flinders.arrays import check_table, check_triple
from flinders.errors import ArrayError
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import require_headings
from flinders.heading.guidance import goal_row, reading_variance
from flinders.native.engine import engine
from flinders.native.layouts import BELIEF

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.findings.poses import Frame
    from flinders.heading.guidance import Goal
    from flinders.native.layouts import Records
    from flinders.summary.coverage import Coverage

READINGS_PER_DEG: Final = 50.0 / 90.0
"""Count of readings per degree for a sensor at 50 Hz that is turned by 90° a second."""


class UncertainEllipsoid(Protocol):
    """Attributes of a claim that path planning needs."""

    @property
    def ellipsoid(self) -> Ellipsoid: ...  # noqa: D102

    @property
    def covariance(self) -> Floats: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """State of knowledge before the next reading: an estimate with its covariance, and the variance of a reading."""

    ellipsoid: Ellipsoid
    covariance: Floats  # (9, 9): covariance of (b, S), in unit²
    variance: float  # variance of the distance of a further reading from the surface, in unit²
    is_rough: bool = False  # whether the estimate comes from `rough_belief`, not from a fit

    @classmethod
    def of(cls, claim: UncertainEllipsoid, noise: float, coverage: Coverage) -> Self:
        """Create a belief from the claim of a fit; for a refused fit use `rough_belief` instead."""
        variance = reading_variance(claim.ellipsoid, claim.covariance, noise, coverage.counts)
        return cls(claim.ellipsoid, claim.covariance, variance)

    def direction(self, reading: ArrayLike) -> Floats:
        """(3,) direction of the corrected field of a raw reading; `ArrayError` unless it is three numbers."""
        departure = np.linalg.solve(self.ellipsoid.shape, check_triple(reading, "reading") - self.ellipsoid.centre)
        direction: Floats = departure / max(float(np.linalg.norm(departure)), np.finfo(float).tiny)
        return direction

    def row(self) -> Records:
        """Record of the belief for the engine."""
        row = np.zeros((), dtype=BELIEF)
        row["centre"], row["shape"] = self.ellipsoid.centre, upper_entries(self.ellipsoid.shape)
        row["covariance"], row["variance"] = np.ravel(self.covariance), self.variance
        return row


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Advised path of the field's direction in body axes; directions are unit vectors in corrected sensor axes."""

    start: Floats  # (3,): direction of the field now
    waypoints: Floats  # (K, 3): next directions, connected by great circles
    worst_deg: float  # worst error now, of headings or directions by the goal
    after_deg: float  # predicted worst error at the end of the path

    def words(self, frame: Frame = "vehicle") -> str:
        """Instruction of at most two turns of the body, in the words of `flinders.heading.guidance.Guidance.words`.

        The field is constant in the world: to move its direction from u to v in body axes, the body turns about v × u.
        """
        legs = pairwise([self.start, *self.waypoints])
        turns = [turn for turn, _ in groupby(_turn(np.cross(there, here), frame) for here, there in legs)]
        return ("turn it " if frame == "sensor" else "") + ", then ".join(turns[:2])

    def __repr__(self) -> str:
        count = f"{len(self.waypoints)} waypoint{'s' * (len(self.waypoints) != 1)}"
        return f"Route({count}, worst {self.worst_deg:.2f}°, at its end {self.after_deg:.2f}°)"


def plan(
    belief: Belief,
    at: ArrayLike,
    *,
    target_deg: float = 1.0,
    goal: Goal = "heading",
    dip_deg: float = 60.0,
    down: Floats | None = None,
    readings_per_deg: float = READINGS_PER_DEG,
) -> Route:
    """Find the shortest path that brings the worst error below the target, else the best path of six steps.

    Raises `ArrayError` for a direction of another shape or without length; `UsageError`: within a degree of the
    magnetic poles, for the goal ``heading``.

    Parameters
    ----------
    at : (3,) array-like
        Direction of the field now, in corrected sensor axes.
    target_deg : float
        Target of the worst error, 1 σ.
    goal : str
        ``heading`` of a level vehicle, or ``attitude`` for the field's direction at any attitude.
    dip_deg : float
        Inclination of the field at the site, positive in the north.
    down : (3,) float, optional
        Down direction of the level vehicle in corrected sensor axes; by default +z.
    readings_per_deg : float
        Readings per degree of rotation.
    """
    start = _unit(at)
    if goal == "heading":
        require_headings(dip_deg)
    wanted = goal_row(goal, dip_deg=dip_deg, down=down, target_deg=target_deg)
    route = engine().path(belief.row(), wanted, start, readings_per_deg)
    waypoints = route["waypoints"][: 3 * int(route["count"])].reshape(-1, 3).copy()
    return Route(start, waypoints, float(route["worst_deg"]), float(route["after_deg"]))


def rough_belief(readings: ArrayLike) -> Belief | None:
    """Rough sphere through (N, 3) raw readings that are not sufficient for a fit; None for too few or a short arc.

    The sphere is fitted by linear least squares (|x|² = 2 c·x + k) in the plane or space over which the readings
    spread. Along an axis without spread the centre is their mean. In undetermined directions the covariance is that of
    common hard and soft iron: 1 σ of one radius for the offset, and of 0.3 radii for the shape.

    Raises `ArrayError` for another shape, or values that are not finite.
    """
    belief = engine().sphere_belief(check_table(readings))
    if belief is None:
        return None
    ellipsoid = Ellipsoid(belief["centre"].copy(), symmetric_matrix(belief["shape"]))
    return Belief(ellipsoid, belief["covariance"].reshape(9, 9).copy(), float(belief["variance"]), is_rough=True)


def _turn(axis: Floats, frame: Frame) -> str:
    """Words for a turn about the axis of the body that is nearest to (3,) `axis`.

    >>> _turn(np.array([1.0, 0.0, 0.4]), "vehicle"), _turn(np.array([0.0, -1.0, 0.4]), "sensor")
    ('roll it to its right', 'about y (x towards z)')
    """
    main = int(np.argmax(np.abs(axis)))
    return TURNS[frame][main][int(axis[main] < 0.0)]


TURNS: Final[dict[Frame, tuple[tuple[str, str], ...]]] = {
    "vehicle": (
        ("roll it to its right", "roll it to its left"),
        ("raise its nose", "lower its nose"),
        ("turn it to its right", "turn it to its left"),
    ),
    "sensor": (
        ("about x (y towards z)", "about x (z towards y)"),
        ("about y (z towards x)", "about y (x towards z)"),
        ("about z (x towards y)", "about z (y towards x)"),
    ),
}
"""Words for a right-handed and a left-handed turn about each axis, by frame."""


def _unit(values: ArrayLike) -> Floats:
    """(3,) unit vector."""
    vector = check_triple(values, "direction")
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise ArrayError("direction is zero: need three numbers, not all zero")
    unit: Floats = vector / length
    return unit
