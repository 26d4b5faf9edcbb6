"""The deviation of a compass: five coefficients from a swing, and the deviation card.

``δ(ζ) = A + B sin ζ + C cos ζ + D sin 2ζ + E cos 2ζ``: magnetic less compass heading, east positive, over the *compass*
heading ζ. A comes from a misaligned compass or a wrong reference. B and C come from hard iron fore-and-aft and
athwartships, and from soft iron that the vertical field magnetises. D and E come from soft iron.

>>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])      # H.O. 226, figure 501
>>> swing.coefficients_deg.round(4)
array([ 1.    , 11.9397,  7.9598,  5.    ,  1.5   ])
>>> eight_points([10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
array([ 1. , 12. ,  8. ,  5. ,  1.5])
>>> round(float(swing.at(45.0)), 1), round(float(swing.magnetic(45.0)), 1)
(20.1, 65.1)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import check_column, refuse_nonfinite, to_floats
from flinders.errors import ArrayError, FitError, UsageError, count_text
from flinders.geometry.angles import wrap_180, wrap_360
from flinders.heading.harmonics import design
from flinders.summary.pooling import chi_square_of, p_value_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

NAMES: Final = "ABCDE"
MIN_HEADINGS: Final = 5
"""Smallest number of headings for five coefficients."""
MARGIN_SIGMAS: Final = 2.0
"""Margin by which a curve has to be within a limit, in standard deviations."""
ADVISED_HEADINGS: Final = 8
"""Number of headings that a swing should have."""
LARGE_DEVIATION_DEG: Final = 15.0
"""Deviation beyond which the small-angle formula is inaccurate."""
MAX_GAP_DEG: Final = 120.0
"""Largest gap between neighbouring headings in which the curve is determined."""
MAX_ARC_GAP_DEG: Final = 180.0
"""Largest gap between neighbouring headings of a swing; with a wider one, coefficients are not determined."""
MIN_SEPARATION_DEG: Final = 1.0
"""Smallest difference between headings that count as different."""
MAX_SCATTER_DEG: Final = 30.0
"""Largest scatter of a compass about the curve; unrelated headings scatter by 60° and more."""
MAX_POINT_ERROR_DEG: Final = 1.0
"""Largest distance of headings from the cardinal and intercardinal points for the eight-point formulas."""
CARD_STEP_DEG: Final = 15.0
"""Default step between the headings of a card, in degrees."""
CONTRADICTION_PROBABILITY: Final = 1e-3
"""Probability below which a swing contradicts its calibration."""


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """A deviation curve, with the observations of its swing.

    If residuals are larger than expected from the given 1 σ, the covariance is enlarged by the ratio of χ² to the
    degrees of freedom.
    """

    coefficients_deg: Floats  # (5,) A, B, C, D and E
    covariance: Floats | None  # (5, 5) degrees²; None if the uncertainty of headings is not known
    sigma_deg: float | None  # 1 σ of one observation: as given, else its scatter about the curve
    compass_deg: Floats  # (N,) headings by the compass
    observed_deg: Floats  # (N,) observed deviations
    residual_deg: Floats  # (N,) observed less curve
    chi_square: float | None = None  # χ² of the residuals for their given 1 σ

    @property
    def freedom(self) -> int:
        """Degrees of freedom: number of headings less number of coefficients."""
        return len(self.compass_deg) - len(NAMES)

    @property
    def sigmas_deg(self) -> Floats | None:
        """(5,) standard deviations of the coefficients, or None."""
        return None if self.covariance is None else np.sqrt(np.diagonal(self.covariance).clip(min=0.0))

    def at(self, compass_deg: ArrayLike) -> Floats:
        """Deviation at compass headings: (...,) degrees to (...,) degrees."""
        deviation: Floats = design(compass_deg) @ self.coefficients_deg
        return deviation

    def sigma_at(self, compass_deg: ArrayLike) -> Floats | None:
        """1 σ of the curve at compass headings, or None if it is not known."""
        if self.covariance is None:
            return None
        rows = design(compass_deg)
        sigma: Floats = np.sqrt(np.sum(rows @ self.covariance * rows, axis=-1).clip(min=0.0))
        return sigma

    def magnetic(self, compass_deg: ArrayLike) -> Floats:
        """Magnetic headings in [0, 360) for compass headings."""
        return wrap_360(to_floats(compass_deg, "compass_deg") + self.at(compass_deg))

    def compass(self, magnetic_deg: ArrayLike) -> Floats:
        """Compass headings in [0, 360) to steer for magnetic ones: the inverse of `magnetic`, to 1e-6°.

        >>> swing = fit(range(0, 360, 45), [10.5, 20.0, 11.5, -1.2, -5.5, -8.0, -12.5, -6.8])
        >>> round(float(swing.compass(swing.magnetic(100.0))), 6)
        100.0

        Raises `FitError` if deviations are so large that two compass headings give the same magnetic heading.
        """
        wanted = to_floats(magnetic_deg, "magnetic_deg")
        if not self.is_one_to_one:
            raise FitError(
                "the deviation changes faster than the heading, so that one magnetic heading has several compass "
                "headings: compensate the compass first"
            )
        heading = wanted - self.at(wanted)
        for _ in range(200):
            step = wrap_180(wanted - heading - self.at(heading))
            heading = heading + step
            if np.abs(step).max(initial=0.0) < 1e-9:
                break
        return wrap_360(heading)

    @property
    def is_one_to_one(self) -> bool:
        """Whether each magnetic heading has only one compass heading."""
        around = np.arange(0.0, 361.0)
        return bool(np.diff(around + self.at(around)).min() > 0.0)

    @property
    def largest_deg(self) -> float:
        """Largest absolute deviation of the curve at whole degrees."""
        return float(np.abs(self.at(np.arange(360.0))).max())

    @property
    def widest_gap_deg(self) -> float:
        """Largest angle between neighbouring headings of the swing."""
        return _widest_gap_deg(self.compass_deg)

    @property
    def eight_point_coefficients(self) -> Floats | None:
        """The eight-point coefficients if the swing was made on exactly these points, else None."""
        places = np.round(self.compass_deg / 45.0).astype(int) % 8
        near = np.abs(wrap_180(self.compass_deg - 45.0 * places)) <= MAX_POINT_ERROR_DEG
        if len(places) != 8 or not near.all() or len(set(places.tolist())) != 8:
            return None
        return eight_points(self.observed_deg[np.argsort(places)])

    def widen(self, covariance: ArrayLike) -> Deviation:
        """Add the covariance of an error that all headings share: (5, 5) degrees² of A to E.

        Residuals do not contain a common error, such as that of the compass base, which is an error of A. A curve
        without a known uncertainty stays as it is.
        """
        return (
            self
            if self.covariance is None
            else replace(self, covariance=self.covariance + to_floats(covariance, "covariance"))
        )

    def card(self, step_deg: float = CARD_STEP_DEG) -> tuple[Floats, Floats, Floats | None]:
        """Compass headings all round in steps, deviations there, and their 1 σ.

        Raises `UsageError` unless 360 is a multiple of the step.
        """
        if not (
            step_deg > 0.0 and 360.0 / step_deg < 4000.0 and abs(360.0 / step_deg - round(360.0 / step_deg)) < 1e-9
        ):
            raise UsageError(f"a step of {step_deg:g}° does not divide 360°: need a step such as 10, 15 or 45")
        headings = np.arange(round(360.0 / step_deg)) * step_deg
        return headings, self.at(headings), self.sigma_at(headings)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        headings, deviations, sigmas = self.card()
        return {
            "coefficients_deg": dict(zip(NAMES, self.coefficients_deg.tolist(), strict=True)),
            "sigma_deg": None if self.sigmas_deg is None else dict(zip(NAMES, self.sigmas_deg.tolist(), strict=True)),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            # A to E by the classic analysis of eight headings 45° apart; None for other headings
            "eight_points_deg": None
            if self.eight_point_coefficients is None
            else dict(zip(NAMES, self.eight_point_coefficients.tolist(), strict=True)),
            "headings": len(self.compass_deg),  # number of observed headings
            "freedom": self.freedom,
            "observation_sigma_deg": self.sigma_deg,  # 1 σ of one observation: as given, else its scatter
            "chi_square": self.chi_square,
            "largest_deg": self.largest_deg,
            "widest_gap_deg": self.widest_gap_deg,
            # observations by compass heading: `deviation_deg` and its `residual_deg` from the curve
            "swing": {
                "compass_deg": self.compass_deg.tolist(),
                "deviation_deg": self.observed_deg.tolist(),
                "residual_deg": self.residual_deg.tolist(),
            },
            # the curve in steps of compass heading: `deviation_deg`, and its 1 σ
            "card": {
                "compass_deg": headings.tolist(),
                "deviation_deg": deviations.tolist(),
                "sigma_deg": None if sigmas is None else sigmas.tolist(),
            },
        }


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Deviation to expect from a calibration: zero, with the claimed uncertainty as covariance of B to E.

    An error of the calibration is part of the deviation curve, not of the curve's uncertainty.
    """

    covariance: Floats  # (4, 4) degrees², of B, C, D and E; a calibration claims nothing about A, the mounting
    dip_deg: float  # dip of the field for which the covariance holds
    dip_from: str  # source of the dip

    @property
    def sigmas_deg(self) -> Floats:
        """(4,) standard deviations of B, C, D and E."""
        sigmas: Floats = np.sqrt(np.diagonal(self.covariance).clip(min=0.0))
        return sigmas

    def chance(self, deviation: Deviation) -> tuple[float, int, float] | None:
        """χ² of a swing's B to E for this covariance, degrees of freedom, and p value.

        None if the swing has no covariance. A σ of the swing from few residuals is uncertain: the p value allows for
        that by the degrees of freedom of Welch and Satterthwaite.

        >>> swing = fit(range(0, 360, 45), [1.1, 0.8, 0.1, -0.6, -1.0, -0.8, 0.1, 0.6], sigma_deg=0.2)   # C is 1.0°
        >>> expected = [Expected(sigma**2 * np.eye(4), 60.0, "given") for sigma in (0.5, 0.05)]
        >>> [each.chance(swing)[2] > CONTRADICTION_PROBABILITY for each in expected]
        [True, False]
        """
        if deviation.covariance is None:
            return None
        rms, own = deviation.coefficients_deg[1:], deviation.covariance[1:, 1:]
        square, freedom = chi_square_of(rms, own + self.covariance)
        along = np.linalg.pinv(own + self.covariance, hermitian=True) @ rms
        share = float(along @ own @ along) / square if deviation.chi_square is None and square > 0.0 else 0.0
        others = deviation.freedom / share**2 if share > 0.0 else math.inf
        return square, freedom, p_value_of(square, freedom, others)

    def as_dict(self, deviation: Deviation | None) -> dict[str, Any]:
        """JSON-ready fields, with a comparison with a swing if there is one."""
        chance = None if deviation is None else self.chance(deviation)
        return {
            "sigma_deg": dict(zip(NAMES[1:], self.sigmas_deg.tolist(), strict=True)),  # 1 σ of B, C, D and E
            "covariance": self.covariance.tolist(),
            "dip_deg": self.dip_deg,
            "dip_from": self.dip_from,
            # χ² of B to E of the swing for the claimed uncertainty of the calibration
            "chi_square": None if chance is None else chance[0],
            "p_value": None if chance is None else chance[2],  # probability of such a χ², or a larger one, by chance
        }


def fit(compass_deg: ArrayLike, deviation_deg: ArrayLike, *, sigma_deg: ArrayLike | None = None) -> Deviation:
    """Find A to E by least squares: minimise ``Σ (δᵢ − δ(ζᵢ))²/σᵢ²``.

    Parameters
    ----------
    compass_deg : (N,) degrees
        Headings by the compass; at least five different ones, better eight, all round.
    deviation_deg : (N,) degrees
        Magnetic less compass heading there; 350 counts as −10.
    sigma_deg : float or (N,) degrees, optional
        1 σ of each heading. By default all are equal, and estimated from the residuals of at least six headings.

    Raises
    ------
    FitError
        For fewer than five different headings, headings within less than half a circle, or unrelated headings.
    ArrayError
        For arrays of the wrong shape, with gaps, or a σ that is not positive.

    Notes
    -----
    With headings all round in equal steps A is the mean, and B, C, D and E are twice the means of δ sin ζ … cos 2ζ.
    """
    headings = wrap_360(_finite_list(compass_deg, "compass_deg"))
    deviations = wrap_180(check_column(_finite_list(deviation_deg, "deviation_deg"), len(headings), "deviation_deg"))
    _refuse_few(headings)
    _refuse_an_arc(headings)
    sigma = _sigmas(1.0 if sigma_deg is None else sigma_deg, len(headings))
    rows = design(headings)
    left, values, right = np.linalg.svd(rows / sigma[:, np.newaxis], full_matrices=False)
    coefficients: Floats = right.T @ ((left.T @ (deviations / sigma)) / values)
    residual = deviations - rows @ coefficients
    square, freedom = float(np.sum((residual / sigma) ** 2)), len(headings) - len(NAMES)
    scale = square / freedom if freedom else None
    if sigma_deg is not None:
        scale = max(1.0, scale or 0.0)
    if scale is None:
        return Deviation(coefficients, None, None, headings, deviations, residual)
    root = right.T / values
    one = float((np.mean(sigma**2) * scale) ** 0.5)
    _refuse_unlike(one)
    return Deviation(
        coefficients,
        scale * (root @ root.T),
        one,
        headings,
        deviations,
        residual,
        None if sigma_deg is None else square,
    )


def common_error(sigma_deg: float) -> Floats:
    """(5, 5) covariance of A to E in degrees², for an error of 1 σ that all known headings share: an error of A."""
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[0, 0] = sigma_deg**2
    return covariance


def eight_points(deviation_deg: ArrayLike) -> Floats:
    """A to E in degrees from (8,) deviations on N, NE, E, SE, S, SW, W and NW, as adjusters calculate them by hand.

    A = mean; B = (E − W)/2; C = (N − S)/2; D = ((NE + SW) − (SE + NW))/4; E = ((N + S) − (E + W))/4
    (H.O. 226, Handbook of Magnetic Compass Adjustment). B and C use two of the headings; `fit` uses all.

    Raises `ArrayError` unless there are eight.
    """
    values = check_column(deviation_deg, 8, "deviation_deg")
    refuse_nonfinite(values, "deviation_deg")
    n, ne, e, se, s, sw, w, nw = values
    return np.array(
        [values.mean(), (e - w) / 2.0, (n - s) / 2.0, ((ne + sw) - (se + nw)) / 4.0, ((n + s) - (e + w)) / 4.0]
    )


def eight_points_sigma(sigma_deg: float) -> Floats:
    """(5,) 1 σ of `eight_points` for observations with 1 σ of `sigma_deg` each.

    >>> eight_points_sigma(1.0).round(3)
    array([0.354, 0.707, 0.707, 0.5  , 0.5  ])
    """
    return sigma_deg * np.array([8.0**-0.5, 2.0**-0.5, 2.0**-0.5, 0.5, 0.5])


def _finite_list(values: ArrayLike, name: str) -> Floats:
    """(N,) finite numbers; raises `ArrayError` for other values."""
    array = to_floats(values, name)
    if array.ndim != 1:
        raise ArrayError(f"{name} has shape {array.shape}: need (N,), one value a heading")
    refuse_nonfinite(array, name)
    return array


def _sigmas(sigma_deg: ArrayLike, count: int) -> Floats:
    """(N,) positive standard deviations, from one for all or one for each heading; raises `ArrayError`."""
    given = to_floats(sigma_deg, "sigma_deg")
    sigma = np.full(count, float(given)) if given.ndim == 0 else check_column(given, count, "sigma_deg")
    wrong = sigma[~(np.isfinite(sigma) & (sigma > 0.0))]
    if len(wrong):
        raise ArrayError(f"sigma_deg contains {wrong[0]:g}: need positive numbers of degrees")
    return sigma


def _refuse_few(headings: Floats) -> None:
    """Refuse a swing with too few different headings for five coefficients."""
    different: list[float] = []
    for heading in headings.tolist():
        if len(different) < MIN_HEADINGS and all(
            abs(float(wrap_180(heading - other))) >= MIN_SEPARATION_DEG for other in different
        ):
            different.append(heading)
    if len(different) < MIN_HEADINGS:
        raise FitError(
            f"found {count_text(len(different), 'different heading')}; five coefficients need at least {MIN_HEADINGS}: "
            f"steady the vehicle on {ADVISED_HEADINGS} headings all round, each 45° from the last",
            found=len(different),
            needed=MIN_HEADINGS,
        )


def _refuse_an_arc(headings: Floats) -> None:
    """Refuse a swing over less than half a circle."""
    gap = _widest_gap_deg(headings)
    if gap > MAX_ARC_GAP_DEG:
        raise FitError(
            f"all headings lie within {360.0 - gap:.0f}°, and five coefficients need headings all round: "
            f"steady the vehicle on {ADVISED_HEADINGS} headings, each 45° from the last",
            found=360.0 - gap,
            needed=MAX_ARC_GAP_DEG,
        )


def _refuse_unlike(scatter_deg: float) -> None:
    """Refuse compass headings that are unrelated to the magnetic ones."""
    if scatter_deg > MAX_SCATTER_DEG:
        raise FitError(
            f"headings scatter by {scatter_deg:.0f}° (1 σ) about any curve of five coefficients: compass headings do "
            "not match the known headings. Check the columns, the order of the lines, and that both headings count "
            "clockwise",
            found=scatter_deg,
            needed=MAX_SCATTER_DEG,
        )


def _widest_gap_deg(headings: Floats) -> float:
    """Largest angle between neighbouring headings of (N,) on a circle, degrees."""
    around = np.sort(headings)
    return float(np.diff(np.append(around, around[0] + 360.0)).max())


@dataclass(frozen=True, slots=True)
class Conformity:
    """Comparison of a swing with a limit, at the decisive reading or point of the curve."""

    limit_deg: float  # largest deviation that the rule allows
    largest_deg: float  # absolute deviation at the decisive heading
    compass_deg: float  # decisive heading by the compass
    sigma_deg: float | None  # 1 σ of the curve there; None if it is not known
    is_reading: bool  # whether a reading of the swing decides, and not the curve

    @property
    def verdict(self) -> str:
        """``beyond`` the limit, ``within`` it with a margin of two standard deviations, or else ``open``."""
        if self.largest_deg > self.limit_deg:
            return "beyond"
        is_sure = self.sigma_deg is not None and self.largest_deg + MARGIN_SIGMAS * self.sigma_deg <= self.limit_deg
        return "within" if is_sure else "open"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {**values, "verdict": self.verdict}


def conformity(deviation: Deviation, limit_deg: float) -> Conformity:
    """Compare the readings of a swing, and the curve at whole degrees, with a limit.

    >>> swing = fit(range(0, 360, 30), [3, 4, 2, 0, -1, -2, -3, -4, -2, 0, 1, 2])
    >>> [conformity(swing, limit).verdict for limit in (10.0, 4.0, 3.0)]
    ['within', 'open', 'beyond']
    """
    around, observed = np.arange(360.0), np.abs(deviation.observed_deg)
    curve, sigma = np.abs(deviation.at(around)), deviation.sigma_at(around)
    worst = int(observed.argmax())
    if observed[worst] > max(limit_deg, float(curve.max())):
        return Conformity(limit_deg, float(observed[worst]), float(deviation.compass_deg[worst]), None, True)
    is_beyond = bool(curve.max() > limit_deg)
    place = int((curve if is_beyond or sigma is None else curve + MARGIN_SIGMAS * sigma).argmax())
    known = None if sigma is None else float(sigma[place])
    return Conformity(limit_deg, float(curve[place]), float(around[place]), known, False)
