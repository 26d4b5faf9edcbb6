"""How to turn a sensor, planned several turns ahead, so that the target is reached with little turning.

`flinders.heading.guidance` says which readings are worth most. Whoever turns a sensor takes readings all along the way,
so what matters is the way: the field's direction, seen from the body, walks over the sphere, each stretch of it adds
information that is known before it is walked, and the best of many walks is the advice. Walks lead over 42 waypoints,
some 35° apart; a beam search keeps those that promise the smallest worst error, and the first that reaches the target
wins. After a quarter of a second's walk everything is looked at anew.

The first seconds need more care, since directions need a centre and no fit has one yet. A few readings on an arc say
where its centre is in their own plane, and nothing of what lies across: `rough` puts a sphere there and says so in its
covariance, which sends the walk out of the plane.

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

A circle that is not even closed tells which way is out of its plane:

>>> angle = np.linspace(0.0, 2.0, 40)[:, np.newaxis]
>>> arc = 50.0 * (np.cos(angle) * [1.0, 0.0, 0.0] + np.sin(angle) * [0.0, 1.0, 0.0]) + [10.0, 0.0, 0.0]
>>> belief = rough(arc)
>>> belief.ellipsoid.centre.round(6), bool(abs(plan(belief, [-0.42, 0.91, 0.0]).waypoints[0][2]) > 0.3)
(array([10.,  0.,  0.]), True)

Sources: sequential designs as in `flinders.heading.guidance`; beam search: P. S. Ow, T. E. Morton, "Filtered beam
search in scheduling", Int. J. Production Research 26 (1988) 35–62. What it saves: `python -m benchmarks.guidance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Final, Protocol, Self

import numpy as np

from flinders.arrays import table, triple
from flinders.errors import ArrayError
from flinders.geometry.ellipsoid import Ellipsoid, symmetric, upper
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
"""What a sensor of 50 Hz gives that is turned by 90° a second."""


class UncertainEllipsoid(Protocol):
    """What is taken of the claim of a fit."""

    @property
    def ellipsoid(self) -> Ellipsoid: ...  # noqa: D102

    @property
    def covariance(self) -> Floats: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is known before the next reading, and what a reading is worth."""

    ellipsoid: Ellipsoid
    covariance: Floats  # (9, 9) of (b, S), in unit²
    variance: float  # of the distance of a further reading from the surface, in unit²
    is_rough: bool = False  # it comes from `rough` and no fit

    @classmethod
    def of(cls, claim: UncertainEllipsoid, noise: float, coverage: Coverage) -> Self:
        """What a fit claims. A refused one may claim nothing that makes sense: see `rough`."""
        variance = reading_variance(claim.ellipsoid, claim.covariance, noise, coverage.counts)
        return cls(claim.ellipsoid, claim.covariance, variance)

    def direction(self, reading: ArrayLike) -> Floats:
        """(3,) where the corrected field of a raw reading points; `ArrayError` where that is not three numbers."""
        departure = np.linalg.solve(self.ellipsoid.shape, triple(reading, "reading") - self.ellipsoid.centre)
        direction: Floats = departure / max(float(np.linalg.norm(departure)), np.finfo(float).tiny)
        return direction

    def row(self) -> Records:
        """The belief as the engine takes it."""
        row = np.zeros((), dtype=BELIEF)
        row["centre"], row["shape"] = self.ellipsoid.centre, upper(self.ellipsoid.shape)
        row["covariance"], row["variance"] = np.ravel(self.covariance), self.variance
        return row


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Where the field should walk, as seen from the body; unit vectors in corrected sensor axes."""

    start: Floats  # (3,) where it points now
    waypoints: Floats  # (K, 3) on great circles one after the other
    worst_deg: float  # the error that matters now
    after_deg: float  # and at the end of the walk, as far as can be told before it is walked

    def words(self, frame: Frame = "vehicle") -> str:
        """Say how to turn the body, in at most two turns, as `flinders.heading.guidance.Guidance.words` does.

        The field stays where it is, so to let its direction walk from u to v in the body's axes, the body turns
        about v × u.
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
    """Find the way that brings the worst error below the target soonest, or as low as it gets in six steps.

    Raises `ArrayError` for a direction of another shape or without length; `UsageError`: within a degree of the
    magnetic poles, for the goal ``heading``.

    Parameters
    ----------
    at : (3,) array-like
        Where the field points now, in corrected sensor axes.
    target_deg : float
        The worst error that is good enough, 1 σ.
    goal : str
        ``heading``: of a level vehicle; ``attitude``: the field's direction, whichever way the sensor is turned.
    dip_deg : float
        Inclination of the field at the site, positive in the north.
    down : (3,) float, optional
        Which way is down when the vehicle is level, in corrected sensor axes; by default +z.
    readings_per_deg : float
        Readings that are taken for each degree of turning.
    """
    start = _unit(at)
    if goal == "heading":
        require_headings(dip_deg)
    wanted = goal_row(goal, dip_deg=dip_deg, down=down, target_deg=target_deg)
    route = engine().path(belief.row(), wanted, start, readings_per_deg)
    waypoints = route["waypoints"][: 3 * int(route["count"])].reshape(-1, 3).copy()
    return Route(start, waypoints, float(route["worst_deg"]), float(route["after_deg"]))


def rough(readings: ArrayLike) -> Belief | None:
    """Put a sphere through (N, 3) raw readings that no fit can do anything with yet; None of too few, or a short arc.

    A linear least-squares sphere (|x|² = 2 c·x + k) in the plane, or space, in which the readings are spread; along
    an axis without spread its centre is their mean. Where nothing was seen, the covariance is that of what hard and
    soft iron commonly do: a radius each way, and 0.3 of it in shape.

    Raises `ArrayError` for another shape, or what is not finite.
    """
    belief = engine().rough(table(readings))
    if belief is None:
        return None
    ellipsoid = Ellipsoid(belief["centre"].copy(), symmetric(belief["shape"]))
    return Belief(ellipsoid, belief["covariance"].reshape(9, 9).copy(), float(belief["variance"]), is_rough=True)


def _turn(axis: Floats, frame: Frame) -> str:
    """Words for a turn about an axis of the body: the one of its own axes that it is mostly about.

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
"""Turns about each axis, right-handed and left-handed."""


def _unit(values: ArrayLike) -> Floats:
    """(3,) of length one."""
    vector = triple(values, "direction")
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise ArrayError("direction has no length: need three numbers, not all zero")
    unit: Floats = vector / length
    return unit
