"""Between one plane and three axes: readings laid flat, and what is found of them put back.

In a plane an estimate is that of an ellipsoid whose equator holds the readings, as for `Level`: first and second axis
of the plane are then x and y, and all readings are at one height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import Wrapped
from flinders.errors import FitError, NotAnEllipsoid, Unmoved
from flinders.estimators.data import FARTHEST, SMALLEST
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.robust import SEED
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import PlaneEllipse, order_of
from flinders.likelihood.equations import ROUNDING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.plane import Plane

DRAWS: Final = 256
SCORED: Final = 600
THINNEST: Final = 1e-12
POINTS: Final = 7
RIDGE: Final = np.diag([1e-3] * 2 + [1e-9] * 3)
LONGEST_AXIS: Final = 5.0
STRAIGHT: Final = 1e-6
"""Variance across over that along, of an arc of two degrees: less is a line."""

_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class NotAnEllipse(NotAnEllipsoid):
    """No ellipse goes through the readings of a plane: they are on a line, or half of them in one place."""

    def __init__(self, method: str) -> None:
        self.eigenvalues = (0.0, 0.0, 0.0)
        FitError.__init__(
            self,
            "no ellipse goes through these readings: in this plane they lie on a line, or half of them in one place. "
            "Turn the sensor all the way round about the third axis, and check the plane and the columns",
            method=method,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Flat(Wrapped):
    """A recording whose first and second column are a plane's axes, and whose third one is the same for all."""

    recording: Recording
    plane: Plane
    height: float = 0.0

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        first, second, _ = order_of(self.plane)
        for block in self.recording.blocks():
            field = np.full_like(block.field, self.height)
            field[:, 0], field[:, 1] = block.field[:, first], block.field[:, second]
            yield replace(block, field=field)


def require_turn(readings: Readings, unknowns: int, method: str, plane: Plane) -> None:
    """Refuse what no method can work with in a plane.

    Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; the last one also where next
    to nothing varies in the plane.
    """
    readings.require(unknowns, method, axes=plane)
    seen = list(order_of(plane)[:2])
    moments = readings.summary.moments
    spread = float(np.sqrt(np.diag(moments.covariance)[seen].sum().clip(min=0.0)))
    size = float(np.linalg.norm(moments.mean[seen]))
    if not (spread > SMALLEST and FARTHEST * spread > size):
        apart = float(np.linalg.norm(readings.summary.health.extent[seen]))
        raise Unmoved(math.degrees(math.atan2(apart, size)), f"all the way round in the plane {plane}")


def laid_flat(readings: Readings, plane: Plane, height: float = 0.0) -> Readings:
    """The readings of a plane, all at one height, with the sums of all."""
    return readings.through(lambda recording: Flat(recording, plane, height))


def fitted_flat(flat: Readings, spread: float) -> Estimate:
    """Fit an ellipse to readings laid flat, as `Likelihood` fits an ellipsoid; robustly where residuals ask for it.

    Raises `NotAnEllipse` if half of the readings are in one place, or all on a line; `NeedsSamples` if only sums were
    given.
    """
    rng = np.random.default_rng(SEED)
    points = flat.thinned(ENOUGH, "ellipse")
    try:  # a handful of readings, most of them in one place, can lead the steps out of all numbers
        start = ellipse_start(flat.spread_out(points, rng), rng)
        if not start.semi_axes[0] > max(SMALLEST, THINNEST * float(np.ptp(points, axis=0).max())):
            raise NotAnEllipse("ellipse")
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            return Likelihood(prior=spread).polish(flat, start, robust=True)
    except (FloatingPointError, ZeroDivisionError, NotAnEllipsoid):
        raise NotAnEllipse("ellipse") from None


def ellipse_start(readings: Floats, rng: Generator) -> Ellipsoid:
    """Least median of squares: of many ellipses through seven readings each, the one that is nearest to half of all.

    As of `Robust`, in the plane: conics with tr Q = 2 and a slight pull towards the circle. A circle around the
    readings where no seven of them lie on an ellipse.

    `readings`: (N, 3), at one height. Raises `NotAnEllipsoid` if half of the readings are in one place, or all on a
    line.
    """
    some = readings if len(readings) <= SCORED else readings[rng.choice(len(readings), SCORED, replace=False)]
    origin = np.median(some, axis=0)
    apart = np.linalg.norm(some - origin, axis=1)
    scale = float(np.median(apart))
    if not scale > THINNEST * float(apart.max()):
        raise NotAnEllipsoid(method="level")
    points = (some[:, :2] - origin[:2]) / scale
    chosen = points[np.argsort(rng.random((DRAWS, len(points))), axis=1)[:, :POINTS]]
    centres, inverses = _closed(_conics(chosen))
    if not len(centres):  # a short arc, or a line
        across, along = np.linalg.eigvalsh(np.cov(points.T))
        if across <= STRAIGHT * along:
            raise NotAnEllipsoid(method="level")
        return Ellipsoid(origin, scale * np.eye(3))
    y = np.matmul(inverses, (points - centres[:, np.newaxis]).transpose(0, 2, 1))
    lengths = np.maximum(np.linalg.norm(y, axis=1), THINNEST)
    steepness = np.linalg.norm(np.matmul(inverses, y), axis=1)
    distances = np.abs(lengths - 1.0) * lengths / np.maximum(steepness, THINNEST)
    best = int(np.argmin(np.median(distances, axis=1)))
    shape = np.zeros((3, 3))
    shape[:2, :2] = np.linalg.inv(inverses[best])
    shape[2, 2] = np.trace(shape) / 2.0
    return Ellipsoid(origin + scale * np.append(centres[best], 0.0), scale * shape)


def _conics(points: Floats) -> Floats:
    """(H, 5) a, b, l₁, l₂, d of H conics (1 + a) x² + (1 − a) y² + 2 b x y + l·x + d through (H, K, 2) points."""
    x, y = np.moveaxis(points, 2, 0)
    rows = np.stack([x * x - y * y, 2.0 * x * y, x, y, np.ones_like(x)], axis=2)
    transposed = rows.transpose(0, 2, 1)
    normal = transposed @ rows + RIDGE
    normal += ROUNDING * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(5)
    solution: Floats = np.linalg.solve(normal, -(transposed @ (x * x + y * y)[..., np.newaxis]))
    return solution[..., 0]


def _closed(conics: Floats) -> tuple[Floats, Floats]:
    """Centres (H, 2) and inverse shapes (H, 2, 2) of those conics that are ellipses of a sensible shape."""
    a, b = conics[:, 0], conics[:, 1]
    forms = np.stack([1.0 + a, b, b, 1.0 - a], axis=1).reshape(-1, 2, 2)
    eigenvalues, vectors = np.linalg.eigh(forms)
    sound = eigenvalues[:, 0] > LONGEST_AXIS**-2 * eigenvalues[:, 1]
    eigenvalues, vectors, conics, forms = eigenvalues[sound], vectors[sound], conics[sound], forms[sound]
    centres = -0.5 * np.linalg.solve(forms, conics[:, 2:4, np.newaxis])[..., 0]
    levels = np.einsum("hi,hij,hj->h", centres, forms, centres) - conics[:, 4]
    real = levels > THINNEST
    roots = np.sqrt(eigenvalues[real] / levels[real, np.newaxis])
    return centres[real], np.einsum("hij,hj,hkj->hik", vectors[real], roots, vectors[real])


def equator(ellipse: PlaneEllipse) -> Ellipsoid:
    """The ellipsoid whose equator is an ellipse, as wide across it as on average in it."""
    shape = np.zeros((3, 3))
    shape[:2, :2], shape[2, 2] = ellipse.shape, ellipse.radius
    return Ellipsoid(np.append(ellipse.centre, 0.0), shape)


def lifted(
    flat: Estimate, readings: Readings, plane: Plane, *, name: str, dip_deg: float, field_strength: float | None
) -> Estimate:
    """Take an ellipse to the ellipsoid of three axes whose third one has unit gain and no offset.

    A vehicle that turns about the third axis, which points down, meets F (cos I cos ψ, −cos I sin ψ, sin I), and so
    its ellipse has the shape cos I · S₂. Nothing is known across the plane but a prior: the offset in the plane
    is the ellipse's centre less sin I times what the third axis lends to it, which is taken as nothing.

    Parameters
    ----------
    flat : Estimate
        Of readings laid flat.
    readings : Readings
        All three axes. The offset of the third is zero, give or take its mean reading and the field.
    name : str
        Of the method.
    dip_deg : float
        Inclination of the field, towards the third axis.
    field_strength : float, optional
        Where it is known the third axis gets it for its semi-axis, else the mean of those in the plane: the matrix has
        a 1 there either way.
    """
    dip = np.deg2rad(dip_deg)
    level = equator(PlaneEllipse(flat.ellipsoid.centre[:2], flat.ellipsoid.shape[:2, :2]))
    shape = level.shape / np.cos(dip)
    if field_strength is not None:
        shape[2, 2] = field_strength
    lift = lift_of(float(dip))
    order = order_of(plane)
    unclaimed = np.hypot(float(readings.summary.moments.mean[order[2]]), shape[2, 2])
    there = [order.index(axis) for axis in range(3)]
    rows = _parameters(there)
    return replace(
        flat,
        ellipsoid=Ellipsoid(level.centre[there], shape[np.ix_(there, there)]),
        covariance=lifted_covariance(flat.covariance, lift, unclaimed)[np.ix_(rows, rows)],
        textbook=None
        if flat.textbook is None
        else lifted_covariance(flat.textbook, lift, unclaimed)[np.ix_(rows, rows)],
        bias=None if flat.bias is None else (lift @ flat.bias)[rows],
        method=f"{name} {plane}",
        estimator=name,
        plane=plane,
    )


def lift_of(dip: float) -> Floats:
    """(9, 9) from offset and shape of an equator to those of the ellipsoid that has the ellipse at a dip, in rad."""
    lift = np.eye(9)
    lift[3:, 3:] /= np.cos(dip)
    lift[[0, 1, 2], [7, 8, 5]] = -np.tan(dip)
    return lift


def lifted_covariance(covariance: Floats, lift: Floats, unclaimed: float) -> Floats:
    """(9, 9) covariance of the lifted ellipsoid; the offset across is known to `unclaimed`, whatever it was before."""
    known = covariance.copy()
    known[2, :] = known[:, 2] = 0.0
    carried: Floats = lift @ known @ lift.T
    carried[2, 2] += unclaimed**2
    return carried


def _parameters(there: list[int]) -> list[int]:
    """Places among the nine parameters of a plane's frame, for those of the sensor's in their order."""
    entries = [_ENTRIES.index((min(pair), max(pair))) for pair in ((there[i], there[j]) for i, j in _ENTRIES)]
    return [*there, *(3 + entry for entry in entries)]
