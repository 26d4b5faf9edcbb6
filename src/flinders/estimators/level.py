"""Level: the ellipse of a level turn, where nothing was turned over."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.core.samples import Wrapped
from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators.base import Method, check_prior
from flinders.estimators.likelihood import ENOUGH, Likelihood
from flinders.estimators.robust import SEED
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import prior
from flinders.likelihood.equations import ROUNDING
from flinders.summary.summary import FLAT_NOISE, is_flat

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

DRAWS: Final = 256
SCORED: Final = 600
THINNEST: Final = 1e-12
POINTS: Final = 7
RIDGE: Final = np.diag([1e-3] * 2 + [1e-9] * 3)
LONGEST_AXIS: Final = 5.0
TRIMS, TRIMMED = 3, 0.03
"""Share of the readings that is left out, the farthest from their plane, and how often, to see how flat the rest is."""

STRAIGHT: Final = 1e-6
"""Variance across over that along, of an arc of two degrees: less is a line."""

UPRIGHT: Final = np.cos(np.deg2rad(30.0))
"""The axis of a level turn is the sensor's z, to this angle; about another one x and y do not make a heading."""


@dataclass(frozen=True, slots=True)
class Level:
    """Ellipse through the x and y of a level turn: two offsets, two scales and their skew.

    With the field u = (cos I cos ψ, −cos I sin ψ, sin I) a level vehicle reads in x and y

        c + S₂ (cos ψ, −sin ψ),     c = b + sin I (S₁₃, S₂₃),     S₂ = cos I (S₁₁, S₁₂; S₁₂, S₂₂)

    an ellipse, whatever the iron. It is found as `Likelihood` finds an ellipsoid, from the readings laid
    flat, and puts the heading right as long as the vehicle stays level. Nothing else is known: along z the soft
    iron is held at none with the prior's spread, and the offset where the dip puts it, give or take the field.

    Use it for vehicles that cannot be turned over. `auto` takes it where all readings lie in one
    plane across z.

    Parameters
    ----------
    prior : float
        See `Likelihood`; in the plane it matters only where less than a full turn was recorded.
    dip_deg : float
        Inclination of the field at the site.

    Examples
    --------
    >>> from flinders.estimators.data import Readings
    >>> heading = np.arange(200) * (2 * np.pi / 200)
    >>> level = np.stack([25 * np.cos(heading) + 20, -30 * np.sin(heading) + 90, np.full(200, 60.0)], axis=1)
    >>> ellipsoid = Level().estimate(Readings.of(level)).ellipsoid
    >>> ellipsoid.centre[:2].round(3), ellipsoid.shape.diagonal()[:2].round(3)
    (array([20., 90.]), array([50., 60.]))
    """

    prior: float = prior.SPREAD
    dip_deg: float = 60.0

    name: ClassVar[str] = "level"
    unknowns: ClassVar[int] = 6
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing, or none: no level turn says what lies across it.

        Raises `UsageError` for either.
        """
        check_prior(self.prior)
        if self.prior is None:
            raise UsageError("level needs a prior for what lies across the plane: leave prior=None out")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipse to x and y.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if half
        of the readings are in one place; `NeedsSamples` if only sums were given.
        """
        readings.require(self.unknowns, self.name, axes="xy")
        height = float(readings.summary.moments.mean[2])
        flat = readings.through(lambda recording: _Flat(recording, height))
        rng = np.random.default_rng(SEED)
        start = ellipse_start(flat.spread_out(flat.thinned(ENOUGH, self.name), rng), rng)
        estimate = Likelihood(prior=self.prior).polish(flat, start, robust=True)
        return self._lifted(estimate)

    def _lifted(self, flat: Estimate) -> Estimate:
        """Take an ellipse, found as the equator of an ellipsoid, to where the dip puts it."""
        dip = np.deg2rad(self.dip_deg)
        shape = flat.ellipsoid.shape / np.cos(dip)
        ellipsoid = Ellipsoid(flat.ellipsoid.centre - np.sin(dip) * shape[:, 2], shape)
        lift = lift_of(float(dip))
        return replace(
            flat,
            ellipsoid=ellipsoid,
            covariance=lifted_covariance(flat.covariance, lift, ellipsoid.radius),
            textbook=None if flat.textbook is None else lifted_covariance(flat.textbook, lift, ellipsoid.radius),
            method=self.name,
            plane="xy",
        )


def is_level(covariance: Floats, noise: float, *, within: float = FLAT_NOISE) -> bool:
    """Whether readings of a (3, 3) covariance lie in one plane, but for noise, and that plane across z."""
    variances, axes = np.linalg.eigh(covariance)
    return bool(is_flat(variances.clip(min=0.0), noise, within=within) and abs(float(axes[2, 0])) > UPRIGHT)


def turned_level(field: Floats) -> bool:
    """Whether (N, 3) readings, in the order in which they came, leave a plane across z by their noise alone.

    The noise is that from one reading to the next: a body that sways stands out of it.

    >>> headings, rng = np.arange(0.0, 6.28, 0.01), np.random.default_rng(1)
    >>> level = np.stack([25 * np.cos(headings), 25 * np.sin(headings), 0 * headings], axis=1)
    >>> swayed = level + np.outer(np.sin(5 * headings), [0.0, 0.0, 2.0])
    >>> [turned_level(each + 0.5 * rng.standard_normal(each.shape)) for each in (level, swayed)]
    [True, False]
    """
    for _ in range(TRIMS):
        axis = np.linalg.eigh(np.cov(field.T))[1][:, 0]
        across = np.abs(field @ axis - np.median(field @ axis))
        field = field[across <= np.quantile(across, 1.0 - TRIMMED)]
    if len(field) < Level.unknowns:
        return False
    covariance = np.cov(field.T)
    steps = np.diff(field @ np.linalg.eigh(covariance)[1][:, 0])
    return is_level(covariance, math.sqrt(0.5 * float(np.mean(steps**2))))


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
        raise NotAnEllipsoid(method=Level.name)
    points = (some[:, :2] - origin[:2]) / scale
    chosen = points[np.argsort(rng.random((DRAWS, len(points))), axis=1)[:, :POINTS]]
    centres, inverses = _closed(_conics(chosen))
    if not len(centres):  # a short arc, or a line
        across, along = np.linalg.eigvalsh(np.cov(points.T))
        if across <= STRAIGHT * along:
            raise NotAnEllipsoid(method=Level.name)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Flat(Wrapped):
    """A recording with all readings at one height."""

    recording: Recording
    height: float

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        for block in self.recording.blocks():
            field = block.field.copy()
            field[:, 2] = self.height
            yield replace(block, field=field)


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


METHOD: Final = Method(
    Level,
    use="ellipse of a level turn, x and y only: vehicles that cannot be turned over",
    source="the likelihood in a plane; Rousseeuw (1984) for its start",
)
