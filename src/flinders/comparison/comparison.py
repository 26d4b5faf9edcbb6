"""Comparison of two calibrations of one sensor, in degrees of heading and against their claims.

The engine gives the answer (`flinders_holds` of ``compare.c``), as on the live page.

>>> from dataclasses import replace
>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> monday, tuesday = (simulate.tumble(seed=seed, sensor=simulate.Sensor(noise=0.5)) for seed in (1, 2))
>>> first, second = (calibrate.fit(day.samples) for day in (monday, tuesday))
>>> compare(first, second).answer
'holds'
>>> moved = replace(second, calibration=replace(second.calibration, offset=second.calibration.offset + [5, 0, 0]))
>>> compare(first, moved).answer
'fails'
>>> compare(first, second, target_deg=0.1).answer
'cannot-tell'
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import numpy as np

from flinders.comparison.pairs import EllipsoidPairs, Pairs
from flinders.comparison.results import json_attributes, with_bound
from flinders.comparison.rotation_difference import RotationDifference
from flinders.core.calibration import Calibration
from flinders.core.keywords import check_keywords
from flinders.core.notebook import html_table
from flinders.core.units import unit_label
from flinders.errors import AxesError, UnitError, UsageError, figures
from flinders.fitting.fit_file import fit_for
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.geometry.plane import PLANE_PARAMETERS, equator_matrix
from flinders.geometry.rotation import rotation_vectors
from flinders.geometry.sphere import fibonacci
from flinders.heading.error_propagation import HeadingError, level_bound_deg
from flinders.native.engine import engine
from flinders.native.layouts import defined_value
from flinders.summary.pooling import p_value_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.fitting.result import Fit
    from flinders.native.faults import Answer

Wider = Literal["a", "b"]

MAX_P_VALUE: Final = defined_value("CHANCE")
"""Largest p-value of a significant difference."""

DIRECTIONS: Final = fibonacci(400).T
"""(3, 400) unit vectors, over which the direction difference is computed."""


ONE_SIDED_SIGMAS: Final = defined_value("ONE_SIDED")
"""Standard deviations that a normal error exceeds on one side with a probability of 5 %."""

MAX_ROUNDING_DEG: Final = 1e-6
"""Largest angle between rotations that are equal except for rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Differences of two calibrations, b minus a, and their standard deviations by both claims."""

    #: difference in heading of a level vehicle without its mean: rms over 72 headings, and the worst
    heading_difference_deg: HeadingError
    heading_mean_deg: float  #: mean heading difference, which has the effect of a rotated mounting
    #: 1 σ of the heading difference by the claims of both; None if neither states a covariance
    claimed_deg: HeadingError | None
    #: 95 % bound of the heading difference over all headings, by both claims; None if neither states a covariance
    claimed_bound_deg: float | None
    own_bounds_deg: tuple[float, float] | None  #: 95 % bounds by the claim of a alone, and by the claim of b alone
    #: angle between the corrected fields, rms over 400 directions spread evenly over the sphere
    direction_difference_deg: float
    offset_difference: Floats  #: (3,), in `unit`
    offset_sigma: Floats | None  #: (3,), in `unit`: 1 σ of the offset difference, by both claims
    #: in `unit`: common radius to which both ellipsoids are scaled; `offset_share` is relative to it
    field_strength: float
    scale_difference: float  #: radius of b over that of a, minus one; for one field strength if `is_scale_known`
    #: whether both have a known field strength. If not, the scale depends on two unknown fields, and only
    #: `scale_difference` includes it.
    is_scale_known: bool
    chi_square: float | None  #: χ² of the difference in offset and shape, against the sum of the covariances
    #: degrees of freedom of `chi_square`: 9, or 8 without the scale, less the parameters that both methods fix
    freedom: int
    target_deg: float  #: the worst heading difference that is good enough
    unit: str  #: unit of offsets: ``uT`` or ``counts``
    #: difference of the rotations into the body, if both have one; the other numbers do not include it
    rotation: RotationDifference | None = None
    omitted_rotation_deg: float | None = None  #: angle of the rotation into the body, if only one of both has one

    def _repr_html_(self) -> str:
        """HTML table for a notebook."""
        found, claimed, p_value = self.heading_difference_deg, self.claimed_deg, self.p_value
        offset = f"{figures(math.hypot(*self.offset_difference))} {unit_label(self.unit)}"
        rows = [
            ("heading, rms", _degrees(found.rms), "" if claimed is None else _degrees(claimed.rms)),
            ("heading, worst", _degrees(found.worst), "" if claimed is None else _degrees(claimed.worst)),
            ("offset", offset, ""),
        ]
        chance = "no covariance is stated" if p_value is None else f"by chance as much with p = {p_value:.2g}"
        words = [f"target {self.target_deg:g}°; {chance}"]
        return html_table(f"Comparison: {self.answer}", ("", "difference", "1 σ claimed"), rows, words)

    @property
    def offset_share(self) -> float:
        """Length of the offset difference, as a fraction of the field."""
        return math.hypot(*self.offset_difference) / self.field_strength

    @property
    def ratio(self) -> float | None:
        """Ratio of the rms heading difference to its claimed 1 σ, about 1 if claims are right; None without a claim."""
        claimed = 0.0 if self.claimed_deg is None else self.claimed_deg.rms
        return self.heading_difference_deg.rms / claimed if claimed > 0.0 else None

    @property
    def p_value(self) -> float | None:
        """Probability of a difference as large by chance; None if neither states a covariance."""
        return None if self.chi_square is None else p_value_of(self.chi_square, self.freedom)

    @property
    def answer(self) -> Answer:
        """Whether the calibrations agree: ``holds``, ``fails`` or ``cannot-tell``, with a confidence of 95 %.

        - ``holds``: the heading difference plus its bound is within the target.
        - ``fails``: the heading difference exceeds the target by more than 1.645 σ and is significant (p < 0.01), or
          the same holds for the rotations into the body.
        - ``cannot-tell``: the claims are too wide for either.

        Without covariances the differences count as exact.
        """
        if self.is_turned_beyond_target:
            return "fails"
        return engine().answer(
            self.worst_deg,
            sigma_deg=0.0 if self.claimed_deg is None else self.claimed_deg.worst,
            bound_deg=self.claimed_bound_deg or 0.0,
            p_value=math.nan if self.p_value is None else self.p_value,
            target_deg=self.target_deg,
        )

    @property
    def is_turned_beyond_target(self) -> bool:
        """Whether the difference of the rotations alone changes body headings significantly by more than the target."""
        dip_deg = self.heading_difference_deg.dip_deg
        return self.rotation is not None and self.rotation.answer_to(self.target_deg, dip_deg) == "fails"

    @property
    def is_turned(self) -> bool:
        """Whether both have a rotation into the body, and these differ significantly.

        Without covariances any difference counts. The ellipsoids do not matter: a sensor that was rotated in its
        mounting is still the same sensor.
        """
        if self.rotation is None:
            return False
        if self.rotation.p_value is None:
            return self.p_value is None and self.rotation.angle_deg > MAX_ROUNDING_DEG
        return self.rotation.p_value < MAX_P_VALUE

    @property
    def worst_deg(self) -> float:
        """The worst heading difference; without covariances it includes the difference of the rotations."""
        worst = self.heading_difference_deg.worst
        if self.rotation is None or self.p_value is not None:
            return worst
        return worst + self.rotation.heading_deg(self.heading_difference_deg.dip_deg)

    @property
    def largest_deg(self) -> float:
        """Upper limit of the heading difference with a probability of 95 %: the difference plus its bound."""
        return self.worst_deg + (self.claimed_bound_deg or 0.0)

    @property
    def telling_bound_deg(self) -> float | None:
        """Widest 95 % bound that would decide `answer` for this difference; None if `answer` is decided."""
        if self.answer != "cannot-tell" or self.claimed_deg is None or self.claimed_bound_deg is None:
            return None
        if self.worst_deg <= self.target_deg:
            return self.target_deg - self.worst_deg
        narrower = (self.worst_deg - self.target_deg) / (ONE_SIDED_SIGMAS * self.claimed_deg.worst)
        return min(narrower * self.claimed_bound_deg, self.worst_deg)

    @property
    def wider_claim(self) -> Wider | None:
        """The calibration with the wider claim, ``a`` or ``b``, if the claims prevent a decision; else None."""
        if self.answer != "cannot-tell" or self.own_bounds_deg is None:
            return None
        return "a" if self.own_bounds_deg[0] > self.own_bounds_deg[1] else "b"

    @property
    def is_identical(self) -> bool:
        """Whether both are the same calibration except for rounding, also in their rotation into the body."""
        return self.is_same_ellipsoid and not self.is_turned and self.omitted_rotation_deg is None

    @property
    def is_same_ellipsoid(self) -> bool:
        """Whether both correct alike except for rounding, without their rotations into the body."""
        scale = abs(self.scale_difference) if self.is_scale_known else 0.0
        apart = max(math.radians(self.direction_difference_deg), self.offset_share, scale)
        return apart < 1e-9

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, as printed by ``--json``; keys of a rotation only if there is one."""
        heading = self.heading_difference_deg
        return {
            "answer": self.answer,
            "heading_difference_deg": heading.as_dict(
                mean=self.heading_mean_deg, dip_deg=heading.dip_deg, target_deg=self.target_deg
            ),
            "claimed_deg": with_bound(self.claimed_deg, self.claimed_bound_deg),
            **json_attributes(self, "largest_deg", "telling_bound_deg", "wider_claim"),
            **json_attributes(self, "ratio", "chi_square", "freedom", "p_value", "direction_difference_deg"),
            **json_attributes(self, "offset_difference", "offset_sigma", "offset_share", "unit", "scale_difference"),
            **json_attributes(self, "is_scale_known", "is_identical"),
            **({} if self.rotation is None else json_attributes(self, "rotation")),
            **({} if self.omitted_rotation_deg is None else {"omitted_rotation_deg": self.omitted_rotation_deg}),
        }

    def __repr__(self) -> str:
        heading = self.heading_difference_deg
        chance = "no uncertainty stated" if self.p_value is None else f"p = {self.p_value:.2g}"
        return (
            f"Comparison({self.answer}, heading {heading.rms:.2g}° rms, {heading.worst:.2g}° worst, {chance}, "
            f"offset {math.hypot(*self.offset_difference):.3g} {unit_label(self.unit)})"
        )


@dataclass(frozen=True, slots=True)
class LengthSums:
    """Statistics of the lengths of corrected readings, as fractions of the calibration's field, in sums that add.

    >>> LengthSums.of(np.array([0.9, 1.1])) + LengthSums.of(np.array([1.0, 1.0]))
    Strength(mean=1.000, spread=7.1%, readings=4)
    """

    readings: int = 0
    total: float = 0.0  #: sum of the lengths minus one
    squares: float = 0.0  #: sum of the squares of the lengths minus one

    @classmethod
    def of(cls, lengths: Floats) -> Self:
        """Sum up (N,) lengths, as fractions of the field."""
        excess = lengths - 1.0
        return cls(len(lengths), float(excess.sum()), float(excess @ excess))

    @classmethod
    def of_corrected(cls, calibration: Calibration, field: Floats) -> Self:
        """Correct (N, 3) raw readings, in the calibration's unit and axes, and sum up their lengths."""
        with np.errstate(over="ignore"):
            return cls.of(np.linalg.norm(calibration.apply(field), axis=1) / calibration.field_strength)

    @property
    def mean(self) -> float:
        """Mean length: 1 if the field is as strong as that of the calibration."""
        return 1.0 + self.total / self.readings if self.readings else 0.0

    @property
    def spread(self) -> float:
        """Standard deviation of the lengths."""
        count = max(self.readings, 1)
        if not math.isfinite(self.squares):
            return math.inf
        return math.sqrt(max(self.squares / count - (self.total / count) ** 2, 0.0))

    def as_dict(self) -> dict[str, float]:
        """Values for JSON, by name."""
        return {
            "strength": self.mean,  # mean length of corrected readings over the field strength
            "spread": self.spread,
        }

    def __add__(self, other: LengthSums) -> LengthSums:
        return LengthSums(self.readings + other.readings, self.total + other.total, self.squares + other.squares)

    def __repr__(self) -> str:
        return f"Strength(mean={self.mean:.3f}, spread={self.spread:.1%}, readings={self.readings:,})"


def _degrees(angle_deg: float) -> str:
    """Write an angle for a table; an angle that is only a rounding error is 0°."""
    return f"{figures(angle_deg)}°" if angle_deg > 1e-6 else "0°"


@check_keywords()
def compare(
    a: AnyCalibration, b: AnyCalibration, *, dip_deg: float | None = None, target_deg: float = 1.0
) -> Comparison:
    """Compare two calibrations of one sensor, and decide whether their difference is significant.

    Each calibration corrects readings of a turning vehicle that were simulated with the other, and the result is
    compared with the true heading. To exchange a and b therefore only changes signs. The covariances are added, as
    those of independent recordings. Two fits of one recording share its noise, and agree better than this claims.

    Scale: readings of one sensor are longer in a stronger field, which is no property of the sensor. Unless the field
    strength of both calibrations is known, both ellipsoids are therefore scaled to one radius. Their common scale is
    removed from the covariances, and χ² has one degree of freedom less.

    Level turns: a calibration from a level turn is known in x and y alone. Both calibrations are then compared for that
    turn, at its dip, and the direction is that of a level vehicle's horizontal field.

    Rotation: the numbers are in the magnetometer's own axes, and do not include its rotation into the body. If aiding
    sensors found this rotation for both, `Comparison.rotation` has the difference.

    Parameters
    ----------
    a, b : Fit, Calibration, or path of a calibration file
        In the same unit and axes. A calibration without a stated uncertainty counts as exact, such as a `Calibration`.
    dip_deg : float, optional
        Inclination of the field, positive if it points along +z of the sensor's mapped axes; by default that at which
        `a` was judged, else `b`, else 60°.
    target_deg : float
        Worst heading difference that is good enough, in degrees.

    Returns
    -------
    Comparison
        Differences b minus a, their uncertainty, and the `Comparison.answer`.

    Raises
    ------
    DocumentError
        For a calibration file that cannot be opened or understood, as `flinders.load`.
    UnitError
        If one is in µT and the other in counts.
    AxesError
        If their axes are mapped in different ways.
    UsageError
        For a target that is not positive, a dip within a degree of the poles, or something that is no calibration.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> days = [simulate.tumble(seed=seed, sensor=simulate.Sensor(noise=0.5)) for seed in (1, 2)]
    >>> one, other = (calibrate.fit(day.samples) for day in days)
    >>> compare(one, other).answer, compare(one.calibration, other.calibration).claimed_deg
    ('holds', None)
    """
    a, b = fit_for(a), fit_for(b)
    if dip_deg is None:
        dip_deg = common_dip_deg(a, b)
    if "xy" in (a.claim.plane, b.claim.plane):
        refuse_unlike(a, b)
        comparison = compare_level(_level(a, dip_deg), _level(b, dip_deg), dip_deg=dip_deg, target_deg=target_deg)
    else:
        comparison = _compare(a, b, dip_deg=dip_deg, target_deg=target_deg, is_flat=False)
    return replace(comparison, rotation=RotationDifference.of(a, b), omitted_rotation_deg=_omitted_rotation_deg(a, b))


def common_dip_deg(*fits: Fit) -> float:
    """Signed dip in degrees at which the first fit was judged, or the next one if that has no dip; else 60°."""
    stated = [fit.heading_error_deg.dip_deg for fit in fits]
    return next((dip for dip in stated if math.isfinite(dip)), 60.0)


def compare_level(a: Fit, b: Fit, *, dip_deg: float = 60.0, target_deg: float = 1.0) -> Comparison:
    """Compare two calibrations that are both ellipses of level turns, given as equators of ellipsoids.

    Parameters
    ----------
    dip_deg : float
        Inclination of the field at the turn, in degrees; it is reported, and both ellipses already include it.
    target_deg : float
        As for `compare`, like the errors that are raised.
    """
    return _compare(a, b, dip_deg=dip_deg, target_deg=target_deg, is_flat=True)


def _compare(a: Fit, b: Fit, *, dip_deg: float, target_deg: float, is_flat: bool) -> Comparison:
    """Compare two calibrations; `is_flat` states that both are ellipses of a level turn."""
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    turn_dip_deg = 0.0 if is_flat else dip_deg
    pair, is_scale_known = _pair(a, b)
    rms, worst, mean = (float(each[0]) for each in pair.heading_deg(turn_dip_deg))
    claimed = [float(each[0]) for each in pair.sigmas_deg(turn_dip_deg)]
    middle = Ellipsoid(pair.moved[0], pair.middle[0])
    bounds = [
        level_bound_deg(middle, each.covariance[0], dip_deg=turn_dip_deg)
        for each in (pair, _pair(a, _without_covariance(b))[0], _pair(_without_covariance(a), b)[0])
    ]
    chi_square, freedom = pair.chi_square(PLANE_PARAMETERS if is_flat else range(9))
    stated = a.claim.states_uncertainty or b.claim.states_uncertainty
    return Comparison(
        heading_difference_deg=HeadingError(rms, worst, float(dip_deg)),
        heading_mean_deg=mean,
        claimed_deg=HeadingError(claimed[0], claimed[1], float(dip_deg)) if stated else None,
        claimed_bound_deg=bounds[0] if stated else None,
        own_bounds_deg=(bounds[1], bounds[2]) if stated else None,
        direction_difference_deg=math.hypot(rms, mean) if is_flat else float(pair.direction_deg(DIRECTIONS)[0]),
        offset_difference=b.calibration.offset - a.calibration.offset,
        offset_sigma=np.sqrt(np.diag(pair.covariance[0])[:3]) if stated else None,
        field_strength=middle.radius,
        scale_difference=float(pair.scale[0]),
        is_scale_known=is_scale_known,
        chi_square=float(chi_square[0]) if stated else None,
        freedom=int(freedom[0]),
        target_deg=float(target_deg),
        unit=a.calibration.unit,
    )


def _without_covariance(fit: Fit) -> Fit:
    """The same fit without an uncertainty."""
    return replace(fit, claim=replace(fit.claim, covariance=np.zeros((9, 9)), structure_deg=0.0))


def _omitted_rotation_deg(a: Fit, b: Fit) -> float | None:
    """Angle in degrees of the rotation into the body, if only one of both has a rotation; else None."""
    knowing = [one for one in (a, b) if one.calibration.rotation != "symmetric"]
    if len(knowing) != 1:
        return None
    return float(np.rad2deg(np.linalg.norm(rotation_vectors(knowing[0].calibration.rotation_matrix))))


def _level(fit: Fit, dip_deg: float) -> Fit:
    """A fit reduced to a level turn in x and y: an ellipsoid whose equator is the ellipse of that turn."""
    # the fit of a level turn assumed a dip of its own
    if fit.claim.plane is not None and math.isfinite(fit.heading_error_deg.dip_deg):
        dip_deg = fit.heading_error_deg.dip_deg
    strength = fit.calibration.field_strength * math.cos(math.radians(dip_deg))
    known = strength if fit.calibration.field_strength_known else None
    rows = equator_matrix("xy", dip_deg=dip_deg)
    parameters = fit.calibration.ellipsoid.parameters
    return as_equator(fit, rows, parameters, fit.claim.claimed_covariance, field_strength=known)


def as_equator(
    fit: Fit, rows: Floats, parameters: Floats, covariance: Floats, *, field_strength: float | None = None
) -> Fit:
    """A fit whose nine parameters are `rows` (9, K) times the (K,) `parameters`; its covariance follows likewise."""
    flat, old = rows @ parameters, fit.calibration
    calibration = Calibration.from_ellipsoid(
        flat[:3], symmetric_matrix(flat[3:]), field_strength=field_strength, raw=old.raw, axes=old.axes, frame=old.frame
    )
    claimed: Floats = rows @ covariance @ rows.T
    claim = replace(fit.claim, calibration=calibration, covariance=claimed, structure_deg=0.0)
    residuals = replace(fit.evidence.residuals, distortion=0.0)
    return replace(fit, calibration=calibration, claim=claim, evidence=replace(fit.evidence, residuals=residuals))


def _pair(a: Fit, b: Fit) -> tuple[Pairs, bool]:
    """Both fits as a pair of ellipsoids of one size, and whether the field strengths of both are known."""
    refuse_unlike(a, b)
    known = a.calibration.field_strength_known and b.calibration.field_strength_known
    strengths = np.array([a.calibration.field_strength]), np.array([b.calibration.field_strength])
    return Pairs.of(_one(a), _one(b), strengths if known else None), known


def _one(fit: Fit) -> EllipsoidPairs:
    """A fit as a batch of one; without a covariance it counts as exact."""
    ellipsoid, covariance = fit.calibration.ellipsoid, fit.claim.claimed_covariance
    return EllipsoidPairs(ellipsoid.centre[np.newaxis], ellipsoid.shape[np.newaxis], covariance[np.newaxis])


def refuse_unlike(a: Fit, b: Fit) -> None:
    """Refuse calibrations whose numbers cannot be compared.

    Raises `UnitError` if one is in µT and the other in counts; `AxesError` if their axes are mapped in different ways;
    `UsageError` if one of them linearizes its axes.
    """
    if a.calibration.unit != b.calibration.unit:
        raise UnitError(
            f"{a.provenance.name} is for readings in {unit_label(a.calibration.unit)}, {b.provenance.name} for "
            f"{unit_label(b.calibration.unit)}: calibrate both with one unit, or counts with a scale",
            hint={"unit": None, "scale": None},
        )
    for one in (a, b):
        if one.calibration.linearization is not None:
            raise UsageError(
                f"{one.provenance.name} linearizes its axes, so that offset and matrix are only a part of its "
                "correction: compare it with a recording (flinders check CALIBRATION RECORDING)"
            )
    for what in ("axes", "frame"):
        ours, theirs = getattr(a.calibration, what), getattr(b.calibration, what)
        if ours != theirs:
            how = "mapped alike" if what == "axes" else "from readings in the same axes, sensor's or vehicle's"
            raise AxesError(
                f"{a.provenance.name} has {what} {ours}, {b.provenance.name} has {what} {theirs}: calibrate both {how}",
                hint={"axes": None} if what == "axes" else {},
            )
