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
>>> way = plan(Belief.of_fit(fit), [0.5, 0.0, 0.87], target_deg=0.5, goal="attitude")
>>> way
Route(4 waypoints, worst 1.78°, at its end 0.44°)
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

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, Self

import numpy as np

from flinders.arrays import table, triple
from flinders.errors import ArrayError
from flinders.geometry.ellipsoid import Ellipsoid, sphere_through
from flinders.geometry.sphere import bisected, fibonacci, icosahedron
from flinders.heading.guidance import goal_gradients, reading_variance, sharp_mean
from flinders.likelihood import magnitude
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.heading.guidance import Frame, Goal
    from flinders.summary.coverage import Coverage

STEPS: Final = 6
"""Waypoints that are planned ahead, some 210°; farther ones change nothing (`python -m benchmarks.guidance`)."""
BEAM: Final = 24
"""Paths that are kept after each step."""
READINGS_PER_DEG: Final = 50.0 / 90.0
"""What a sensor of 50 Hz gives that is turned by 90° a second."""
NEAREST_DEG, FARTHEST_DEG = 15.0, 60.0
"""How far off the first waypoint may be."""

DEPARTURE: Final = 0.3
"""Standard deviation of what soft iron does to a sphere, as a fraction of its radius, before anything is known."""
ARC_DEG: Final = 60.0
"""An arc shorter than this does not tell where its centre is."""
FLAT: Final = 0.12
"""An axis along which readings spread by less than this share of the widest spread tells nothing of the centre."""
ROUGHEST: Final = 0.01
"""Of the radius: no arc is trusted to be rounder than this."""
THINNED: Final = 400
"""Readings that `rough` looks at."""

_EVERYWHERE: Final = fibonacci(50)


class FittedSurface(Protocol):
    """What is taken of a fit."""

    @property
    def ellipsoid(self) -> Ellipsoid: ...  # noqa: D102

    @property
    def covariance(self) -> Floats: ...  # noqa: D102

    @property
    def noise(self) -> float: ...  # noqa: D102

    @property
    def coverage(self) -> Coverage: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is known before the next reading, and what a reading is worth."""

    ellipsoid: Ellipsoid
    covariance: Floats  # (9, 9) of (b, S), in unit²
    variance: float  # of the distance of a further reading from the surface, in unit²
    is_rough: bool = False  # it comes from `rough` and no fit

    @classmethod
    def of_fit(cls, fit: FittedSurface) -> Self:
        """What a fit claims. A refused one may claim nothing that makes sense: see `rough`."""
        jacobian = magnitude.information(CELLS, fit.ellipsoid)
        variance = reading_variance(jacobian, fit.covariance, fit.noise, fit.coverage.counts)
        return cls(fit.ellipsoid, fit.covariance, variance)

    def direction(self, reading: ArrayLike) -> Floats:
        """(3,) where the corrected field of a raw reading points; `ArrayError` where that is not three numbers."""
        departure = np.linalg.solve(self.ellipsoid.shape, triple(reading, "reading") - self.ellipsoid.centre)
        direction: Floats = departure / max(float(np.linalg.norm(departure)), np.finfo(float).tiny)
        return direction


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
    """Find the way that brings the worst error below the target soonest, or as low as it gets in `STEPS` steps.

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
    wanted = goal_gradients(belief.ellipsoid, goal, _EVERYWHERE, dip_deg=dip_deg, down=down)
    weight = readings_per_deg / belief.variance
    now = _information(belief.covariance)
    target = math.radians(target_deg) ** 2
    paths = _begun(now, start, belief.ellipsoid, weight)
    graph = _graph()
    stretches = _information_along(graph.between, graph.lengths_deg, belief.ellipsoid, weight)  # (42, 6, 9, 9)
    for step in range(STEPS):
        variances = _variances(wanted, paths.information)
        worst = variances.max(axis=1)
        if step == STEPS - 1 or (worst <= target).any():
            break
        paths = _extended(paths.best(sharp_mean(variances), BEAM), stretches)
    best = int(np.argmin(worst if (worst <= target).any() else sharp_mean(variances)))
    before = float(_variances(wanted, now[np.newaxis]).max())
    return Route(start, _graph().nodes[paths.nodes[best]], _in_degrees(before), _in_degrees(float(worst[best])))


def rough(readings: ArrayLike) -> Belief | None:
    """Put a sphere through (N, 3) raw readings that no fit can do anything with yet; None of too few, or a short arc.

    A linear least-squares sphere (|x|² = 2 c·x + k) in the plane, or space, in which the readings are spread; along
    an axis without spread its centre is their mean. Where nothing was seen, the covariance is that of what hard and
    soft iron commonly do: a radius each way, and `DEPARTURE` of it in shape.

    Raises `ArrayError` for another shape, or what is not finite.
    """
    points = table(readings)
    points = points[:: -(-len(points) // THINNED)] if len(points) else points
    if len(points) < 4:
        return None
    mean = points.mean(axis=0)
    _, spreads, axes = np.linalg.svd(points - mean, full_matrices=False)
    plane = axes[spreads > FLAT * spreads[0]]
    if len(plane) < 2:
        return None
    flat = (points - mean) @ plane.T
    centre, radius = sphere_through(flat)
    centre = mean + centre @ plane
    lengths = np.linalg.norm(points - centre, axis=1)
    if radius == 0.0 or not lengths.all():
        return None
    directions = (points - centre) / lengths[:, np.newaxis]
    if float((directions @ directions.T).min()) > math.cos(math.radians(ARC_DEG)):
        return None
    ellipsoid = Ellipsoid(centre, radius * np.eye(3))
    variance = max(float(np.mean((lengths - radius) ** 2)), (ROUGHEST * radius) ** 2)
    jacobian = magnitude.information(directions, ellipsoid)
    prior = 1.0 / np.repeat([radius, DEPARTURE * radius], [3, 6]) ** 2
    return Belief(ellipsoid, np.linalg.inv(np.diag(prior) + jacobian.T @ jacobian / variance), variance, is_rough=True)


class _Graph(NamedTuple):
    """The waypoints: (42, 3) nodes, (42, 6) neighbours (−1 for none), and (42, 6, 4, 3) directions between them."""

    nodes: Floats
    neighbours: NDArray[np.intp]
    between: Floats
    lengths_deg: Floats


class _Paths(NamedTuple):
    """Paths side by side: (B, 9, 9) information at their ends, and (B, K) the nodes that they passed."""

    information: Floats
    nodes: NDArray[np.intp]

    def best(self, scores: Floats, count: int) -> _Paths:
        """Keep those with the smallest scores."""
        order = np.argsort(scores, kind="stable")[:count]
        return _Paths(self.information[order], self.nodes[order])


@lru_cache(maxsize=1)
def _graph() -> _Graph:
    """The corners of an icosahedron and the middles of its edges."""
    nodes, _ = bisected(*icosahedron())
    neighbours = np.full((len(nodes), 6), -1)
    between, lengths = np.empty((len(nodes), 6, 4, 3)), np.empty((len(nodes), 6))
    for node, near in enumerate(nodes @ nodes.T > math.cos(math.radians(40.0))):
        others = np.flatnonzero(near)[np.flatnonzero(near) != node]
        neighbours[node, : len(others)] = others
        for slot, other in enumerate(neighbours[node]):
            between[node, slot], lengths[node, slot] = _arc(nodes[node], nodes[other], 4)
    return _Graph(nodes, neighbours, between, lengths)


def _arc(a: Floats, b: Floats, count: int) -> tuple[Floats, float]:
    """(count, 3) directions evenly on the great circle from `a` to `b`, and its length in degrees."""
    angle = math.acos(min(max(float(a @ b), -1.0), 1.0))
    share = ((np.arange(count) + 0.5) / count)[:, np.newaxis]
    points = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / math.sin(angle)
    return points, math.degrees(angle)


def _begun(now: Floats, start: Floats, ellipsoid: Ellipsoid, weight: float) -> _Paths:
    """Paths from where the field points to each waypoint in reach."""
    angles = np.degrees(np.arccos(np.clip(_graph().nodes @ start, -1.0, 1.0)))
    reached = np.flatnonzero((angles > NEAREST_DEG) & (angles < FARTHEST_DEG))
    arcs = np.array([_arc(start, _graph().nodes[node], 4)[0] for node in reached])
    return _Paths(now + _information_along(arcs, angles[reached], ellipsoid, weight), reached[:, np.newaxis])


def _information_along(arcs: Floats, lengths_deg: Floats, ellipsoid: Ellipsoid, weight: float) -> Floats:
    """(..., 9, 9) information of readings along (..., K, 3) directions, (...) degrees in all."""
    jacobian = magnitude.information(arcs.reshape(-1, 3), ellipsoid).reshape(*arcs.shape[:-1], 9)
    each = weight * lengths_deg / arcs.shape[-2]
    information: Floats = np.swapaxes(jacobian, -1, -2) @ jacobian * each[..., np.newaxis, np.newaxis]
    return information


def _extended(paths: _Paths, stretches: Floats) -> _Paths:
    """Go on from the end of each path to each neighbour, but not straight back."""
    here = paths.nodes[:, -1]
    there = _graph().neighbours[here]
    before = paths.nodes[:, -2] if paths.nodes.shape[1] > 1 else np.full(len(here), -1)
    row, slot = np.nonzero((there >= 0) & (there != before[:, np.newaxis]))
    nodes = np.concatenate([paths.nodes[row], there[row, slot][:, np.newaxis]], axis=1)
    return _Paths(paths.information[row] + stretches[here[row], slot], nodes)


def _information(covariance: Floats) -> Floats:
    """(9, 9) inverse of a covariance; what a method holds counts as known very well."""
    values, vectors = np.linalg.eigh(covariance)
    floored = values.clip(min=1e-12 * values[-1])
    information: Floats = (vectors / floored) @ vectors.T
    return information


def _variances(wanted: Floats, information: Floats) -> Floats:
    """(B, M) variances of M things with (M, R, 9) gradients, summed over their R components, for each of B paths."""
    root = np.linalg.inv(np.linalg.cholesky(information))
    spread = root @ wanted.reshape(-1, 9).T
    variances: Floats = np.sum((spread**2).reshape(len(root), 9, *wanted.shape[:2]), axis=(1, 3))
    return variances


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


def _in_degrees(variance: float) -> float:
    return math.degrees(math.sqrt(variance))
