"""What the field of the site adds to an ellipsoid that the magnetometer has found alone.

A level turn tells two columns of S, and one sum of the third with the offset. It meets
u = (cos I cos ψ, −cos I sin ψ, sin I) and reads

    x = c + cos I (S₁ cos ψ − S₂ sin ψ),     c = b + sin I S₃

for the columns S₁, S₂, S₃ of the shape. A tilt changes the height of the field from sin I to sin I + ε, and what is not
known of S₃ comes in with ε alone: the heading degrades with the tilt, and not before. Three things hold S₃ and b:

    the dip        b₃ = c₃ − sin I S₃₃, where c₃ is the height of the turn's middle among the readings of z
    the strength   S₁₁ + S₂₂ + S₃₃ = 3 F to within the gain, see `flinders.likelihood.site_field`
    the mounting   S₃₁, S₃₂ are the slopes of the turn's plane; that they are S₁₃, S₂₃ as well holds as far as the
                   sensor's z is the axis that it was turned about: to (S₁₁ + S₃₃) ρ for an angle ρ between them

The last one is used where someone says how well the mounting is known. The dip is that of the site to within its own
uncertainty and that of the vehicle's being level, 1° unless an accelerometer shows more: on a slope the
field dips otherwise.

Nothing in the readings of a level turn tells a z that points down from one that points up, for which the offset would
be another by 2 sin I S₃. It is put where it belongs for z down, and unless an accelerometer shows that, or the axes are
stated, the mean square of what it is off, one as likely as the other, widens the claim by 2 sin² I S₃ S₃ᵀ. A level
heading does not notice: S⁻¹ S₃ is the third axis.

When to use it: vehicles that cannot be turned over, at a known place. Of an ellipsoid that was seen from more than
one plane, the strength alone counts.

Source: first-order propagation of the equations above; conditioning a normal distribution as in R. E. Kalman, *A new
approach to linear filtering and prediction problems*, 1960, eq. 21–25.

>>> from flinders import simulate
>>> from flinders.estimators.data import Readings
>>> turned = simulate.tumble(seed=3, motion="level", sensor=simulate.Sensor(offset=[10.0, 20.0, -30.0], noise=0.1))
>>> from flinders.likelihood.site_field import Site
>>> site = Site(strength=50.0, gain_sigma=0.05, inclination_deg=60.0, inclination_sigma_deg=1.0)
>>> readings = Readings.of(turned.samples)
>>> alone = Level(dip_deg=60.0).estimate(readings)
>>> located = sited(alone, readings, site, alignment_sigma_deg=1.0)
>>> located.ellipsoid.centre.round(0), bool(np.sqrt(located.covariance[2, 2]) < 0.2 * np.sqrt(alone.covariance[2, 2]))
(array([ 10.,  20., -30.]), True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.core.samples import frame_of
from flinders.estimators.level import Level
from flinders.estimators.likelihood import ENOUGH
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.geometry.plane import IN_PLANE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.likelihood.site_field import Site

LEVEL_SIGMA_DEG: Final = 1.0
"""Degrees: how level a floor is, or a boat at its mooring, that someone calls level."""

FARTHEST_DEG: Final = 30.0
"""An accelerometer that finds the vertical farther from z has other axes, and the dip then says nothing of z."""

STRAY: Final = 6.0
"""Times the median of their deviations beyond which heights are left out."""

BY_CHANCE: Final = 10.0
"""Of the variance that chance gives a tilt: its square is beyond that in one recording of 20,000."""

HALF_A_TURN: Final = 0.6
"""1 − |mean way|² of headings spread evenly over half of a turn: 1 − (2/π)²."""

CONTRADICTED: Final = 4.0
"""Standard deviations between a strength and an ellipsoid, beyond which the unit or the gain is another."""


def sited(
    estimate: Estimate,
    readings: Readings,
    site: Site | None,
    *,
    dip_deg: float = 60.0,
    alignment_sigma_deg: float | None = None,
) -> Estimate:
    """Hold an estimate by the field of the site.

    Parameters
    ----------
    estimate : Estimate
        Of `Level` for the dip of the site, or of any method that claims all nine parameters.
    readings : Readings
        Those that it came from.
    site : Site, optional
        A strength in the unit of the readings; one that contradicts the ellipsoid is left out.
    dip_deg : float
        Inclination that `estimate` was made with.
    alignment_sigma_deg : float, optional
        How well it is known that the sensor's z axis is vertical in a level vehicle, 1 σ.

    Returns
    -------
    Estimate
        With smaller claims, but for a level turn that an accelerometer shows on a slope, or of which nobody knows which
        way z points; `strength` is that of the site where it was used, and `z_down` says what is known of z.
    """
    if estimate.plane and estimate.method != Level.name:
        return estimate  # a recipe of two axes, which claims nothing of the third
    if not estimate.plane:
        return estimate if site is None else _by_strength(estimate, site)
    shown = _shown(readings, estimate, math.radians(dip_deg))
    if site is not None and shown.down is False:
        return replace(estimate, z_down=site.inclination_deg is None)
    if site is not None:
        placed = _by_dip(estimate, readings, site, alignment_sigma_deg, shown.tilt_deg)
        is_placed, estimate = placed is not estimate, _by_strength(placed, site)
        if is_placed and not (shown.down or site.z_down or _is_mapped(readings)):
            estimate = _on_either_side(estimate, site)
    return _on_a_slope(estimate, math.radians(dip_deg), shown.tilt_deg)


def conditioned(
    parameters: Floats, covariance: Floats, rows: Floats, values: Floats, sigmas: Floats
) -> tuple[Floats, Floats]:
    """What is known of parameters once (K,) linear functions of them are known to be some values ± some sigmas.

    Parameters
    ----------
    parameters : (P,) float
    covariance : (P, P) float
    rows : (K, P) float
    values, sigmas : (K,) float

    >>> parameters, covariance = conditioned(np.zeros(2), np.eye(2), np.array([[1.0, 0.0]]), np.ones(1), np.ones(1))
    >>> parameters, np.diag(covariance)
    (array([0.5, 0. ]), array([0.5, 1. ]))
    """
    spread = rows @ covariance @ rows.T + np.diag(sigmas**2)
    gain = np.linalg.solve(spread, rows @ covariance).T
    rest = np.eye(len(parameters)) - gain @ rows
    after: Floats = rest @ covariance @ rest.T + (gain * sigmas**2) @ gain.T
    return parameters + gain @ (values - rows @ parameters), after


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """The plane that readings of a level turn lie in: z = height + slopes · (xy − centre)."""

    height: float  # in the unit of the readings, at the centre of the ellipse
    slopes: Floats  # (2,)
    covariance: Floats  # (3, 3): of both, the height first

    @classmethod
    def of(cls, field: Floats, centre: Floats, noise: float) -> Self:
        """Least squares through (N, 3) readings, without those whose height is astray.

        The noise of x and y makes a slope smaller; it is subtracted from the scatter.

        >>> turn = np.radians(np.arange(0, 360, 10.0))
        >>> plane = np.stack([np.cos(turn), np.sin(turn), 5.0 + 0.2 * np.cos(turn)], axis=1)
        >>> heights = Heights.of(plane, np.zeros(2), 0.0)
        >>> round(heights.height, 9), heights.slopes.round(9) + 0.0
        (5.0, array([0.2, 0. ]))
        """
        for _ in range(3):
            columns = np.column_stack([np.ones(len(field)), field[:, :2] - centre])
            normal = columns.T @ columns - len(field) * noise**2 * np.diag([0.0, 1.0, 1.0])
            inverse = np.linalg.pinv(normal, hermitian=True)
            solution = inverse @ (columns.T @ field[:, 2])
            left = field[:, 2] - columns @ solution
            limit = STRAY * float(np.median(np.abs(left)))
            variance = float(left @ left) / max(len(field) - 3, 1)
            belongs = np.abs(left) <= limit
            if limit == 0.0 or belongs.all():
                break
            field = field[belongs]
        return cls(float(solution[0]), solution[1:], variance * inverse)


def _by_dip(
    estimate: Estimate, readings: Readings, site: Site, alignment_sigma_deg: float | None, tilt_deg: float
) -> Estimate:
    """Put offset and shape across the plane where the dip and the mounting have them."""
    if site.inclination_deg is None or not readings.summary.health.extent[2]:
        return estimate
    dip = math.radians(site.inclination_deg)
    from_turn = _from_turn(dip)
    parameters = np.linalg.solve(from_turn, estimate.ellipsoid.parameters)  # of the middle c and of S
    heights = Heights.of(_inliers(estimate, readings, parameters[:2], dip), parameters[:2], estimate.noise)
    parameters[2] = heights.height
    wider, field = max(1.0, estimate.variance_inflation(IN_PLANE)), estimate.ellipsoid.radius
    doubt = math.radians(math.hypot(site.inclination_sigma_deg, LEVEL_SIGMA_DEG, tilt_deg))
    claims = []
    for claimed in (estimate.covariance, estimate.textbook):
        if claimed is None:
            continue
        covariance = np.linalg.solve(from_turn, np.linalg.solve(from_turn, claimed).T)
        covariance[2, :] = covariance[:, 2] = 0.0
        covariance[2, 2] = wider * heights.covariance[0, 0]
        posterior = parameters, covariance
        if alignment_sigma_deg is not None:
            askew = math.sqrt(2.0) * math.radians(alignment_sigma_deg) * field
            loose = field * np.sqrt(wider * np.diag(heights.covariance)[1:])
            seen = symmetric(parameters[3:])[:2, :2] @ heights.slopes
            posterior = conditioned(*posterior, np.eye(9)[[7, 8]], seen, np.hypot(askew, loose))
        claims.append(_in_axes(*posterior, dip, doubt))
    return _with(estimate, claims)


def _from_turn(dip: float) -> Floats:
    """(9, 9) matrix from (c, S) to (b, S): b = c − sin I S₃."""
    rows = np.eye(9)
    rows[[0, 1, 2], [7, 8, 5]] = -math.sin(dip)
    return rows


def _in_axes(parameters: Floats, covariance: Floats, dip: float, doubt: float) -> tuple[Floats, Floats]:
    """(b, S) and their covariance, of (c, S) and theirs and a dip in doubt by so many rad.

    What is not known of S₁₃ and S₂₃ alone belongs to the third column and not to the third row, which the slopes show.
    S is symmetric: its part s dsᵀ / S₃₃ in the plane then keeps the heading of a level vehicle as the readings have it.
    """
    rows = _from_turn(dip)
    across, height = parameters[[7, 8]], parameters[5]
    coupled = rows.copy()
    coupled[[3, 4], [7, 8]] = across / height
    coupled[6, [7, 8]] = across[::-1] / (2.0 * height)
    values = rows @ parameters
    third = symmetric(values[3:])[:, 2]
    turned = np.concatenate([-third / math.cos(dip), math.tan(dip) * values[3:]])  # ∂(b, S)/∂I
    return values, coupled @ covariance @ coupled.T + doubt**2 * np.outer(turned, turned)


def _on_either_side(estimate: Estimate, site: Site) -> Estimate:
    """Widen a claim for a z axis that may as well point up."""
    apart = np.zeros(9)
    apart[:3] = math.sqrt(2.0) * (site.sine or 0.0) * estimate.ellipsoid.shape[:, 2]
    either = np.outer(apart, apart)
    textbook = None if estimate.textbook is None else estimate.textbook + either
    return replace(estimate, covariance=estimate.covariance + either, textbook=textbook, z_down=None)


def _is_mapped(readings: Readings) -> bool:
    """Axes that somebody mapped, and those of a vehicle, have z down."""
    recording = readings.recording
    return recording is not None and (not recording.axes.is_identity or frame_of(recording) == "vehicle")


def _on_a_slope(estimate: Estimate, dip: float, tilt_deg: float) -> Estimate:
    """Widen a claim for a turn about an axis that was not vertical.

    The middle then belongs to another height of the field than that of a level vehicle, by ε = cos I · tilt, and the
    offset is off by ε times what is not known of S₁₃ and S₂₃.
    """
    if not tilt_deg > 0.0:
        return estimate
    epsilon = math.cos(dip) * math.radians(tilt_deg)
    covariance = estimate.covariance.copy()
    covariance[[0, 1], [0, 1]] += epsilon**2 * np.diag(covariance)[[7, 8]]
    return replace(estimate, covariance=covariance)


def _by_strength(estimate: Estimate, site: Site) -> Estimate:
    """Hold the mean semi-axis at the strength of the site, unless the readings speak of quite another one."""
    if site.strength is None or not site.strength > 0.0:
        return estimate
    row = np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]]) / 3.0
    value, sigma = np.array([site.strength]), np.array([site.gain_sigma * site.strength])
    parameters = estimate.ellipsoid.parameters
    apart = float(site.strength - (row @ parameters)[0])
    spread = math.hypot(float(sigma[0]), math.sqrt(max((row @ estimate.covariance @ row.T).item(), 0.0)))
    if abs(apart) > CONTRADICTED * spread:
        return estimate
    claims = [claimed for claimed in (estimate.covariance, estimate.textbook) if claimed is not None]
    conditioned_estimate = _with(estimate, [conditioned(parameters, claimed, row, value, sigma) for claimed in claims])
    return estimate if conditioned_estimate is estimate else replace(conditioned_estimate, strength=site.strength)


def _with(estimate: Estimate, posteriors: list[tuple[Floats, Floats]]) -> Estimate:
    """The estimate with other parameters, the covariance claimed and that of the textbook; itself if none is closed."""
    parameters, covariance = posteriors[0]
    shape = symmetric(parameters[3:])
    if not np.linalg.eigvalsh(shape)[0] > 0.0:
        return estimate
    return replace(
        estimate,
        ellipsoid=Ellipsoid(parameters[:3], shape),
        covariance=covariance,
        textbook=posteriors[1][1] if len(posteriors) > 1 else estimate.textbook,
    )


def _inliers(estimate: Estimate, readings: Readings, middle: Floats, dip: float) -> Floats:
    """(N, 3) some of the readings, those that lie on the ellipse."""
    field = readings.thinned(ENOUGH, "level")
    if np.isinf(estimate.rejected_beyond):
        return field
    inverse = np.linalg.inv(math.cos(dip) * estimate.ellipsoid.shape[:2, :2])
    local = (field[:, :2] - middle) @ inverse
    length = np.maximum(np.linalg.norm(local, axis=1), 1e-12)
    steepness = np.linalg.norm(local @ inverse, axis=1) / length
    inliers: Floats = field[np.abs(length - 1.0) <= estimate.rejected_beyond * np.maximum(steepness, 1e-300)]
    return inliers


class _Shown(NamedTuple):
    """What an accelerometer shows of z."""

    down: bool | None = None  # whether it points down, to `FARTHEST_DEG`; None where nothing was recorded
    tilt_deg: float = 0.0  # how far its axis of turning was from vertical


def _shown(readings: Readings, estimate: Estimate, dip: float) -> _Shown:
    """Look at the accelerometer.

    On a slope the vertical leans to one side of the world, and goes round in the body as the field does. What stays
    where it is in the body is a bias of the accelerometer, a trim of the vehicle or the mounting, and no slope: with
    the headings ψ of the ellipse, felt along x and y is a + t exp(−iψ) in complex numbers, and t is what a slope does.
    Where less than half of a turn was made, nobody can tell one from the other, and both count.
    """
    if readings.recording is None:
        return _Shown()
    inverse = np.linalg.inv(math.cos(dip) * estimate.ellipsoid.shape[:2, :2])
    middle = estimate.ellipsoid.centre[:2] + math.sin(dip) * estimate.ellipsoid.shape[:2, 2]
    total, sums = np.zeros(3), _Harmonics()
    for block in readings.recording.blocks():
        if block.acceleration is None:
            return _Shown()
        there = np.isfinite(block.acceleration).all(axis=1)
        felt, turned = block.acceleration[there], (block.field[there, :2] - middle) @ inverse
        total -= felt.sum(axis=0)
        sums += _Harmonics.of(felt[:, 0] + 1j * felt[:, 1], turned[:, 0] + 1j * turned[:, 1])
    gravity = float(np.linalg.norm(total)) / max(sums.count, 1)
    if not gravity > 0.0:
        return _Shown()
    if float(total[2]) < float(np.linalg.norm(total)) * math.cos(math.radians(FARTHEST_DEG)):
        return _Shown(down=False)
    return _Shown(down=True, tilt_deg=math.degrees(math.asin(min(sums.going_round() / gravity, 1.0))))


@dataclass(frozen=True, slots=True)
class _Harmonics:
    """Sums over readings of what is felt in the plane, f, and of the way the field points there, u with |u| = 1."""

    count: int = 0
    felt: complex = 0j  # Σ f
    way: complex = 0j  # Σ u
    both: complex = 0j  # Σ f ū
    squares: float = 0.0  # Σ |f|²

    @classmethod
    def of(cls, felt: NDArray[np.complex128], turned: NDArray[np.complex128]) -> Self:
        """Add up (N,) readings; one in the middle of the ellipse points nowhere."""
        way = turned / np.maximum(np.abs(turned), np.finfo(float).tiny)
        both, squares = complex(np.vdot(way, felt)), float(np.vdot(felt, felt).real)
        return cls(len(felt), complex(felt.sum()), complex(way.sum()), both, squares)

    def __add__(self, other: _Harmonics) -> _Harmonics:
        return _Harmonics(
            self.count + other.count,
            self.felt + other.felt,
            self.way + other.way,
            self.both + other.both,
            self.squares + other.squares,
        )

    def going_round(self) -> float:
        """How much of what is felt goes round with the field; nothing where chance makes as much.

        Least squares of f = a + t u. Of less than half of a turn, a and t are the same, and it is the root of the mean
        square of both.
        """
        felt, way = self.felt / self.count, self.way / self.count
        spread = 1.0 - abs(way) ** 2
        scatter = max(self.squares / self.count - abs(felt) ** 2, 0.0)
        if spread < HALF_A_TURN:
            return math.sqrt(abs(felt) ** 2 + scatter)
        round_ = (self.both / self.count - felt * way.conjugate()) / spread
        left = max(scatter - spread * abs(round_) ** 2, 0.0)
        by_chance = BY_CHANCE * left / (self.count * spread)
        return abs(round_) if abs(round_) ** 2 > by_chance else 0.0
