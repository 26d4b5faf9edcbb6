"""Do two calibrations of one sensor say the same? In degrees of heading, and against what they claim.

>>> from dataclasses import replace
>>> from flinders import fitting, simulate
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
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np

from flinders.arrays import floats
from flinders.calibration import Calibration
from flinders.document import PARAMETERS, read
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError, UsageError
from flinders.heading import HeadingError, level_error, level_turn
from flinders.quadric import Ellipsoid, upper
from flinders.simulate import fibonacci
from flinders.units import label

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.document import Document
    from flinders.result import Fit

Agreement = Literal["agree", "differ", "contradict"]

CHANCE: Final = 0.01
"""A difference that chance makes less often than this is more than chance explains."""

DIRECTIONS: Final = fibonacci(400).T
"""(3, 400) unit vectors, over which the direction difference is taken."""

DEPENDENT: Final = 1e-10
"""Eigenvalues of the correlation matrix below this share of the largest are parameters that nobody left free."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A calibration and its covariance.

    Attributes
    ----------
    calibration : Calibration
    covariance : (9, 9) float, optional
        Of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the square
        of the calibration's unit. None where it claims nothing: it is then taken as exact.
    name : str
        What messages call it.

    Raises
    ------
    ArrayError
        Unless the covariance is (9, 9), symmetric and without negative eigenvalues.
    """

    calibration: Calibration
    covariance: Floats | None = None
    name: str = "calibration"

    def __post_init__(self) -> None:
        """Check the covariance."""
        if self.covariance is not None:
            object.__setattr__(self, "covariance", _covariance(self.covariance))

    @classmethod
    def from_fit(cls, fit: Fit, *, name: str = "fit") -> Self:
        """Take what a fit found and claims."""
        return cls(fit.calibration, fit.covariance, name)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a calibration file, with the covariance where it holds one.

        Raises
        ------
        DocumentError
            For a file that cannot be opened or understood, or whose covariance is none of offset and shape.
        """
        return cls.from_document(read(path), name=os.fspath(path))

    @classmethod
    def from_document(cls, document: Document, *, name: str = "calibration") -> Self:
        """Take both out of the content of a calibration file.

        Raises
        ------
        DocumentError
            As `load`.
        """
        calibration = Calibration.from_document(document, source=name)
        if document.fit is None or document.fit.covariance is None:
            return cls(calibration, None, name)
        names = document.fit.covariance_of
        missing = [parameter for parameter in PARAMETERS if parameter not in names]
        if missing:
            raise DocumentError(f"{name}: fit.covariance lacks {', '.join(missing)}: need offset and shape, all nine")
        rows = [names.index(parameter) for parameter in PARAMETERS]
        try:
            return cls(calibration, np.array(document.fit.covariance)[np.ix_(rows, rows)], name)
        except ArrayError as error:
            raise DocumentError(f"{name}: fit.{error}") from None

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration makes a sphere, which knows no rotation."""
        shape = self.calibration.shape
        squares, axes = np.linalg.eigh(shape @ shape.T)
        return Ellipsoid(self.calibration.offset, (axes * np.sqrt(squares)) @ axes.T)


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
    pair = _Pair.of(a, b)
    heading, mean = pair.heading_difference(dip_deg)
    chi_square, freedom = _chi_square(pair.difference, pair.covariance)
    stated = a.covariance is not None or b.covariance is not None
    return Comparison(
        heading_difference_deg=heading,
        heading_mean_deg=mean,
        claimed_deg=level_error(pair.middle, pair.covariance, dip_deg=dip_deg) if stated else None,
        direction_difference_deg=pair.direction_difference(),
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


def chance_of(chi_square: float, freedom: int) -> float:
    """How often chance alone makes chi-square as large.

    The cube root of chi-square is all but normal: Wilson and Hilferty, The distribution of chi-square, PNAS 17
    (1931) 684-688. Good to 0.006 from three degrees of freedom on, and to 0.002 where p is below
    0.1.

    >>> round(chance_of(16.919, 9), 3), chance_of(0.0, 9), chance_of(1.0, 0)
    (0.05, 1.0, 1.0)
    """
    if freedom == 0 or chi_square <= 0.0:
        return 1.0
    variance = 2.0 / (9.0 * freedom)
    normal = ((chi_square / freedom) ** (1.0 / 3.0) - (1.0 - variance)) / math.sqrt(variance)
    return math.erfc(normal / math.sqrt(2.0)) / 2.0


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
        _refuse_unlike(a, b)
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
            _scaled(a.covariance, p, shape, known=known) + _scaled(b.covariance, q, shape, known=known),
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


def _covariance(values: Floats) -> Floats:
    """Let through what can be a covariance of nine parameters."""
    array = floats(values, "covariance")
    if array.shape != (9, 9):
        raise ArrayError(f"covariance has shape {array.shape}: need (9, 9), of offset and shape")
    lack = float(np.abs(array - array.T).max())
    largest = float(np.abs(array).max())
    if lack > 1e-6 * largest:
        raise ArrayError(f"covariance is not symmetric: entries across the diagonal differ by up to {lack:.3g}")
    lowest = float(np.linalg.eigvalsh(array)[0])
    if lowest < -1e-6 * largest:
        raise ArrayError(f"covariance has the eigenvalue {lowest:.3g}: no variance is negative")
    return array


def _refuse_unlike(a: Judged, b: Judged) -> None:
    """Refuse calibrations whose numbers cannot be held against each other."""
    if a.calibration.unit != b.calibration.unit:
        raise UnitError(
            f"{a.name} is for readings in {label(a.calibration.unit)}, {b.name} for {label(b.calibration.unit)}: "
            "calibrate both with one unit (counts need --scale)"
        )
    for what in ("axes", "frame"):
        ours, theirs = getattr(a.calibration, what), getattr(b.calibration, what)
        if ours != theirs:
            raise AxesError(
                f"{a.name} has {what} {ours}, {b.name} has {what} {theirs}: calibrate both with the same --axes"
            )


def _scaled(covariance: Floats | None, factor: float, shape: Floats, *, known: bool) -> Floats:
    """(9, 9) covariance of an ellipsoid whose shape was multiplied by `factor`; without the scale unless `known`.

    S/r with r³ = det S changes by (δS − S tr(S⁻¹ δS)/3)/r. Both calibrations have it from the same S = `shape`,
    so that the scale is out of the sum as well.
    """
    if covariance is None:
        return np.zeros((9, 9))
    jacobian = np.eye(9)
    if not known:
        relative = upper(np.linalg.inv(shape)) * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
        jacobian[3:, 3:] -= np.outer(upper(shape), relative) / 3.0
    jacobian[3:] *= factor
    scaled: Floats = jacobian @ covariance @ jacobian.T
    return scaled


def _chi_square(difference: Floats, covariance: Floats) -> tuple[float, int]:
    """Square of a difference in units of its covariance, over what the covariance leaves free; and its rank."""
    sigma = np.sqrt(np.diag(covariance))
    free = sigma > 0.0
    if not free.any():
        return 0.0, 0
    sigma, difference = sigma[free], difference[free]
    values, axes = np.linalg.eigh(covariance[np.ix_(free, free)] / np.outer(sigma, sigma))
    kept = values > DEPENDENT * values[-1]
    along = axes[:, kept].T @ (difference / sigma)
    with np.errstate(over="ignore"):
        return float(np.sum(along**2 / values[kept])), int(kept.sum())
