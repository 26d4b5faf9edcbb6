"""Do two calibrations of one sensor say the same? In degrees of heading, and against what they claim.

>>> from dataclasses import replace
>>> from flinders import fitting, simulate
>>> from flinders.judged import Judged
>>> monday, tuesday = (simulate.tumble(seed=seed, sensor=simulate.Sensor(noise=0.5)) for seed in (1, 2))
>>> first, second = (Judged.from_fit(fitting.fit(day.samples)) for day in (monday, tuesday))
>>> compare(first, second).verdict
'agree'
>>> moved = replace(second, calibration=replace(second.calibration, offset=second.calibration.offset + [5, 0, 0]))
>>> compare(first, moved).verdict
'contradict'
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np

from flinders.errors import UsageError
from flinders.heading import HeadingError, level_error, level_turn
from flinders.judged import refuse_unlike, rescaled, without_scale
from flinders.pooling import chance_of, chi_square_of
from flinders.quadric import Ellipsoid, upper
from flinders.simulate import fibonacci
from flinders.units import label

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.calibration import Calibration
    from flinders.judged import Judged

Agreement = Literal["agree", "differ", "contradict"]

CHANCE: Final = 0.01
"""A difference that chance makes less often than this is more than chance explains."""

DIRECTIONS: Final = fibonacci(400).T
"""(3, 400) unit vectors, over which the direction difference is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """How far two calibrations a and b are apart, and how far chance could have put them. Differences are b less a.

    Attributes
    ----------
    heading_difference_deg : HeadingError
        Of a level vehicle: rms over 72 headings and the worst, the mean taken off.
    heading_mean_deg : float
        That mean: it looks like a mounting that has turned.
    claimed_deg : HeadingError or None
        1 σ of the heading difference, if both covariances are right; None where neither states one.
    direction_difference_deg : float
        Angle between the corrected fields, rms over 400 directions spread evenly over the sphere. A rotation
        common to all directions is left in: both matrices are applied as they are.
    offset_difference : (3,) float, in `unit`
    offset_sigma : (3,) float or None, in `unit`
        1 σ of that, as claimed.
    field_strength : float, in `unit`
        Radius of the sphere that both are brought to; what `offset_share` is a share of.
    scale_difference : float
        Radius of b over that of a, less one; for one field strength where `is_scale_known`.
    is_scale_known : bool
        Both were given a field strength. If not, the scale is the strength of two unknown fields, and left out
        of all that is compared but `scale_difference`.
    chi_square : float or None
        Of the difference in offset and shape, against the sum of the covariances.
    freedom : int
        Its degrees of freedom: the rank of that sum, 9, or 8 without the scale, less what both methods hold.
    target_deg : float
        The worst heading difference that is good enough.
    unit : str
    """

    heading_difference_deg: HeadingError
    heading_mean_deg: float
    claimed_deg: HeadingError | None
    direction_difference_deg: float
    offset_difference: Floats
    offset_sigma: Floats | None
    field_strength: float
    scale_difference: float
    is_scale_known: bool
    chi_square: float | None
    freedom: int
    target_deg: float
    unit: str

    @property
    def offset_share(self) -> float:
        """Length of the offset difference, as a fraction of the field."""
        return math.hypot(*self.offset_difference) / self.field_strength

    @property
    def ratio(self) -> float | None:
        """The heading difference (rms) over its claimed 1 σ: about 1 where the claims are true."""
        claimed = 0.0 if self.claimed_deg is None else self.claimed_deg.rms
        return self.heading_difference_deg.rms / claimed if claimed > 0.0 else None

    @property
    def p_value(self) -> float | None:
        """How often chance alone makes a difference as large; None where neither covariance is stated."""
        return None if self.chi_square is None else chance_of(self.chi_square, self.freedom)

    @property
    def verdict(self) -> Agreement:
        """Say in a word what to make of it.

        ``agree``: no more than chance explains. ``differ``: more, but no heading by more than the target.
        ``contradict``: more, and above it. Without any covariance nothing is left to chance.
        """
        by_chance = self._is_nothing if self.p_value is None else self.p_value >= CHANCE
        if by_chance:
            return "agree"
        return "differ" if self.heading_difference_deg.worst <= self.target_deg else "contradict"

    @property
    def is_telling(self) -> bool:
        """A difference as large as the target would not have passed for chance."""
        return self.claimed_deg is None or self.claimed_deg.worst <= self.target_deg

    @property
    def _is_nothing(self) -> bool:
        """The same but for rounding."""
        scale = abs(self.scale_difference) if self.is_scale_known else 0.0
        return max(math.radians(self.direction_difference_deg), self.offset_share, scale) < 1e-9

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        found, claimed = self.heading_difference_deg, self.claimed_deg
        return {
            "verdict": self.verdict,
            "telling": self.is_telling,
            "heading_difference_deg": {
                "rms": found.rms,
                "worst": found.worst,
                "mean": self.heading_mean_deg,
                "dip_deg": found.dip_deg,
                "target_deg": self.target_deg,
            },
            "claimed_deg": None if claimed is None else {"rms": claimed.rms, "worst": claimed.worst},
            "ratio": self.ratio,
            "chi_square": self.chi_square,
            "freedom": self.freedom,
            "p_value": self.p_value,
            "direction_difference_deg": self.direction_difference_deg,
            "offset_difference": self.offset_difference.tolist(),
            "offset_sigma": None if self.offset_sigma is None else self.offset_sigma.tolist(),
            "offset_share": self.offset_share,
            "unit": self.unit,
            "scale_difference": self.scale_difference,
            "scale_known": self.is_scale_known,
        }

    def __repr__(self) -> str:
        found = self.heading_difference_deg
        chance = "no uncertainty stated" if self.p_value is None else f"p = {self.p_value:.2g}"
        return (
            f"Comparison({self.verdict}, heading {found.rms:.2g}° rms, {found.worst:.2g}° worst, {chance}, "
            f"offset {math.hypot(*self.offset_difference):.3g} {label(self.unit)})"
        )


@dataclass(frozen=True, slots=True)
class Strength:
    """How evenly long corrected readings are, as fractions of the calibration's field; sums that add.

    >>> Strength.of(np.array([0.9, 1.1])) + Strength.of(np.array([1.0, 1.0]))
    Strength(mean=1.000, spread=7.1%, readings=4)

    Attributes
    ----------
    readings : int
    total, squares : float
        Sums of the lengths less one, and of the squares of that.
    """

    readings: int = 0
    total: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, lengths: Floats) -> Self:
        """Add up lengths (N,), as fractions of the field."""
        excess = lengths - 1.0
        return cls(len(lengths), float(excess.sum()), float(excess @ excess))

    @classmethod
    def under(cls, calibration: Calibration, field: Floats) -> Self:
        """Correct (N, 3) raw readings, in the calibration's unit and axes, and add up their lengths."""
        with np.errstate(over="ignore"):
            return cls.of(np.linalg.norm(calibration.apply(field), axis=1) / calibration.field_strength)

    @property
    def mean(self) -> float:
        """Mean length: 1 where the field is as strong as that of the calibration."""
        return 1.0 + self.total / self.readings if self.readings else 0.0

    @property
    def spread(self) -> float:
        """Standard deviation of the lengths."""
        count = max(self.readings, 1)
        if not math.isfinite(self.squares):
            return math.inf
        return math.sqrt(max(self.squares / count - (self.total / count) ** 2, 0.0))

    def as_dict(self) -> dict[str, float]:
        """JSON-ready."""
        return {"strength": self.mean, "spread": self.spread}

    def __add__(self, other: Strength) -> Strength:
        return Strength(self.readings + other.readings, self.total + other.total, self.squares + other.squares)

    def __repr__(self) -> str:
        return f"Strength(mean={self.mean:.3f}, spread={self.spread:.1%}, readings={self.readings:,})"


def compare(a: Judged, b: Judged, *, dip_deg: float = 60.0, target_deg: float = 1.0) -> Comparison:
    """Say how far two calibrations of one sensor are apart, and whether that is more than chance.

    Each corrects the readings that the other expects of a vehicle that turns, and what comes out is held against
    the turn: so it makes no difference but of sign which comes first. The covariances are added, as those of
    independent recordings: two fits of one recording share its noise and agree better than this claims.

    The scale: readings of one sensor are longer in a stronger field, which says nothing of the sensor. Unless
    both calibrations were given the strength of their field, both ellipsoids are therefore brought to one radius,
    their common scale is taken out of the covariances, and chi-square has a degree of freedom less.

    One that rests on a level turn knows x and y alone: both are then held against each other as that turn reads
    them, at the dip of the level turn, and the direction is that of a level vehicle's horizontal field.

    Parameters
    ----------
    a, b : Judged
        In the same unit and axes. One without a covariance is taken as exact.
    dip_deg : float
        Inclination of the field at the site, positive where it points along +z of the sensor's mapped axes.
    target_deg : float
        Worst heading difference that is good enough, in degrees.

    Raises
    ------
    UnitError
        Where one is in µT and the other in counts.
    AxesError
        Where their axes are mapped in different ways.
    UsageError
        For a target that is not positive, or a dip within a degree of the poles.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    dip = dip_deg
    if "xy" in (a.plane, b.plane) and a.calibration.rotation == b.calibration.rotation == "symmetric":
        refuse_unlike(a, b)
        a, b, dip_deg = a.level(dip_deg), b.level(dip_deg), 0.0
    pair = _Pair.of(a, b)
    heading, mean = pair.heading_difference(dip_deg)
    chi_square, freedom = chi_square_of(pair.difference, pair.covariance)
    stated = a.covariance is not None or b.covariance is not None
    return Comparison(
        heading_difference_deg=replace(heading, dip_deg=float(dip)),
        heading_mean_deg=mean,
        claimed_deg=replace(level_error(pair.middle, pair.covariance, dip_deg=dip_deg), dip_deg=float(dip))
        if stated
        else None,
        direction_difference_deg=pair.direction_difference() if dip == dip_deg else math.hypot(heading.rms, mean),
        offset_difference=b.calibration.offset - a.calibration.offset,
        offset_sigma=np.sqrt(np.diag(pair.covariance)[:3]) if stated else None,
        field_strength=pair.middle.radius,
        scale_difference=pair.scale_difference,
        is_scale_known=pair.is_scale_known,
        chi_square=chi_square if stated else None,
        freedom=freedom,
        target_deg=float(target_deg),
        unit=a.calibration.unit,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    """Two calibrations brought to one field.

    Attributes
    ----------
    offsets, shapes : pairs of (3,) and (3, 3)
        As they correct, with their rotations.
    ellipsoids : pair of Ellipsoid
        What the covariances speak of, without rotations.
    covariance : (9, 9) float
        The sum of both.
    scale_difference : float
    is_scale_known : bool
    """

    offsets: tuple[Floats, Floats]
    shapes: tuple[Floats, Floats]
    ellipsoids: tuple[Ellipsoid, Ellipsoid]
    covariance: Floats
    scale_difference: float
    is_scale_known: bool

    @classmethod
    def of(cls, a: Judged, b: Judged) -> Self:
        """Bring both to the geometric mean of their field strengths where they are known, else of their radii."""
        refuse_unlike(a, b)
        first, second = a.ellipsoid, b.ellipsoid
        known = a.calibration.field_strength_known and b.calibration.field_strength_known
        fields = (a.calibration.field_strength, b.calibration.field_strength)
        sizes = fields if known else (first.radius, second.radius)
        common = math.sqrt(sizes[0]) * math.sqrt(sizes[1])
        p, q = common / sizes[0], common / sizes[1]
        ellipsoids = Ellipsoid(first.centre, p * first.shape), Ellipsoid(second.centre, q * second.shape)
        shape = (ellipsoids[0].shape + ellipsoids[1].shape) / 2.0
        return cls(
            (first.centre, second.centre),
            (p * a.calibration.shape, q * b.calibration.shape),
            ellipsoids,
            _claimed(a, p, shape, known=known) + _claimed(b, q, shape, known=known),
            second.radius / first.radius * (q / p if known else 1.0) - 1.0,
            known,
        )

    @property
    def middle(self) -> Ellipsoid:
        """Halfway between both."""
        first, second = self.ellipsoids
        return Ellipsoid((first.centre + second.centre) / 2.0, (first.shape + second.shape) / 2.0)

    @property
    def difference(self) -> Floats:
        """(9,) offset and shape of the second less those of the first."""
        first, second = self.ellipsoids
        return np.concatenate([second.centre - first.centre, upper(second.shape - first.shape)])

    def corrected(self, directions: Floats) -> tuple[Floats, Floats]:
        """What the second makes of the readings that the first expects for (3, K) directions, and the other way."""
        (p, q), (first, second) = [offset[:, np.newaxis] for offset in self.offsets], self.shapes
        return np.linalg.solve(second, p + first @ directions - q), np.linalg.solve(first, q + second @ directions - p)

    def heading_difference(self, dip_deg: float) -> tuple[HeadingError, float]:
        """Difference over a level turn with its mean taken off, and the mean in degrees."""
        heading, directions = level_turn(dip_deg)
        forth, back = (np.arctan2(-seen[1], seen[0]) - heading for seen in self.corrected(directions))
        differences, means = zip(*map(_about_mean, (forth, -back)), strict=True)
        errors = np.rad2deg(differences)
        rms, worst = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
        return HeadingError(rms, worst, float(dip_deg)), float(np.rad2deg(np.mean(means)))

    def direction_difference(self) -> float:
        """Angle between the corrected fields in degrees, rms over the sphere."""
        angles = [_angles(seen, DIRECTIONS) for seen in self.corrected(DIRECTIONS)]
        return float(np.rad2deg(np.sqrt(np.mean(np.square(angles)))))


def _about_mean(angles: Floats) -> tuple[Floats, float]:
    """Angles less their mean on the circle, from −π to π, and that mean; all in rad."""
    turns = np.exp(1j * angles)
    mean = float(np.angle(turns.mean()))
    return np.angle(turns * np.exp(-1j * mean)), mean


def _angles(vectors: Floats, directions: Floats) -> Floats:
    """(K,) angles between (3, K) vectors of any length and unit vectors, in rad."""
    scaled = vectors / np.abs(vectors).max(axis=0).clip(min=1e-300)
    across = np.linalg.norm(np.cross(scaled, directions, axis=0), axis=0)
    angles: Floats = np.arctan2(across, np.sum(scaled * directions, axis=0))
    return angles


def _claimed(one: Judged, factor: float, shape: Floats, *, known: bool) -> Floats:
    """(9, 9) what a calibration claims, its shape multiplied by `factor`; without the scale unless `known`.

    Both calibrations have it from the same `shape`, so that the scale is out of the sum as well.
    """
    if one.covariance is None:
        return np.zeros((9, 9))
    covariance = rescaled(one.covariance, factor)
    return covariance if known else without_scale(covariance, shape, shape)
