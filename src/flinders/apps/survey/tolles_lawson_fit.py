"""Tolles–Lawson: the field of an aircraft in its scalar magnetometer, linear in sixteen coefficients.

The terms are those of Leach [2]_ for the model of Tolles and Lawson [1]_. With the direction cosines u of the field in
the axes of the aircraft, from a vector magnetometer, and the strength B from the scalar magnetometer, the field of the
aircraft adds

    Σ pᵢ uᵢ + B/50 µT (Σ aᵢⱼ uᵢ uⱼ + Σ eᵢⱼ uᵢ u̇ⱼ)

p is the permanent field, a the induced and e the eddy-current part. Σ uᵢ² is 1 and Σ uᵢ u̇ᵢ is 0, so that azz and ezz
cannot be observed and are zero here: 3 + 5 + 8 terms. Terms of second order in the aircraft's field are those of [3]_;
eddy currents follow the field of the earth, not the total field.

u is the reading of the vector magnetometer divided by B, not by its own length. An error of its axes or gains is then a
linear map of u, which the terms absorb, and the division adds no variation with attitude.

Model and readings are compared between 0.1 and 0.9 Hz, the band of manoeuvres, which hardly contains the field of the
ground below. Each run without gaps is detrended and transformed by a discrete cosine transform. The cosines of the band
are the equations [4]_: noise of any colour is independent between them, so that the covariance needs no model of the
noise. A ridge constrains terms that the manoeuvres hardly excite. It is relative to the spread of each term, and chosen
by cross-validation over half minutes.

>>> from flinders.apps.survey.simulate_aircraft import calibration_flight
>>> flight = calibration_flight(seed=1)
>>> fit = fit_coefficients(flight.samples)
>>> bool(fit.improvement > 10.0), fit.unobserved
(True, ())
>>> left = flight.interference - fit.interference(flight.samples)
>>> bool(left.std() < 0.05 * flight.interference.std())
True

References
----------
.. [1] W. E. Tolles and J. D. Lawson (1950), Magnetic compensation of MAD equipped aircraft.
.. [2] B. W. Leach (1979), Automatic aeromagnetic compensation: the sixteen terms, and the ridge.
.. [3] A. R. Gnadt, A. B. Wollaber, A. P. Nielsen (2022), Derivation and extensions of the Tolles–Lawson model,
   arXiv:2212.09899; ``tolles_lawson.jl`` of MagNav.jl has its band and its scale of 50 µT.
.. [4] R. F. Engle (1974), Band spectrum regression.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from flinders.apps.survey.tolles_lawson_terms import NAMES, Signal, rotation_map
from flinders.arrays import Value, read_only_copy
from flinders.errors import FitError, figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

MIN_DURATION_S: Final = 90.0
"""Smallest duration of all runs together in s, that of a quick flight on two headings."""

FOLD_S: Final = 30.0
"""Length of the parts for cross-validation, in s."""
FOLDS: Final = 5
"""Number of folds of cross-validation."""

RIDGES: Final = np.logspace(-8.0, 0.0, 17)
"""Ridges that are tried, as shares of the sum of squares of each term."""

NO_RIDGE: Final = 1e-12
"""Ridge that only suppresses rounding errors."""

MIN_IMPROVEMENT: Final = 1.2
"""Smallest improvement ratio of a useful compensation."""

MAX_UNCERTAINTY: Final = 0.25
"""Largest uncertainty of an observed term, as a share of the standard deviation before compensation."""

ROUNDS: Final = 2
"""Iterations for terms of second order. They are a hundredth of the first order if the aircraft has 1 % of the earth's
field."""

HEADINGS: Final = 8
"""Number of headings to which the manoeuvres are rotated, for the uncertainty on any heading."""

Quality = Literal["good", "limited", "refused"]


@dataclass(frozen=True, slots=True, eq=False)
class TollesLawson(Value):
    """Coefficients of an aircraft, and residuals of the compensation as standard deviations from 0.1 to 0.9 Hz."""

    coefficients: Floats  #: (16,) coefficients of the terms
    covariance: Floats  #: (16, 16) covariance of the coefficients
    ridge: float  #: ridge, as a share of the sum of squares of each term
    before: float  #: nT: standard deviation of the recorded strength
    after: float  #: nT: residual from noise and ground alone, with exact coefficients
    cross_validated: float  #: nT: residual of each fifth of the half minutes, with coefficients from the other fifths
    as_flown: float  #: nT, 1 σ: uncertainty of the compensation in manoeuvres as flown
    on_any_heading: float  #: nT, 1 σ: uncertainty of the compensation in these manoeuvres on all headings
    unobserved: tuple[str, ...] = ()  #: names of the terms that the manoeuvres do not determine
    readings: int = 0  #: number of readings
    seconds: float = 0.0  #: duration of the recording

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "coefficients", read_only_copy(self.coefficients))
        object.__setattr__(self, "covariance", read_only_copy(self.covariance))

    @property
    def sigma(self) -> Floats:
        """(16,) 1 σ of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def improvement(self) -> float:
        """Improvement ratio: standard deviation without compensation over that of compensated held-out half minutes."""
        return self.before / self.cross_validated

    @property
    def verdict(self) -> Quality:
        """``refused`` if terms are unobserved, ``limited`` if there are `limits`, else ``good``."""
        return "refused" if self.unobserved else "limited" if self.limits else "good"

    @property
    def limits(self) -> tuple[str, ...]:
        """Sentences about the limits of the coefficients."""
        said = []
        if self.unobserved:
            said.append(
                f"the manoeuvres do not determine {', '.join(self.unobserved)}: fly rolls, pitches and yaws on four "
                "headings"
            )
        elif self.on_any_heading > self.cross_validated:
            said.append(
                f"on other headings the compensation is off by {figures(self.on_any_heading)} nT, more than the "
                "residual on the headings of this flight: use these headings only, or fly four headings"
            )
        if self.improvement < MIN_IMPROVEMENT:
            said.append(
                f"the compensation improves the readings by a factor of {self.improvement:.2f} only: the aircraft is "
                "hardly magnetic, or the readings vary for another reason, such as a current or the ground below"
            )
        return tuple(said)

    def interference(self, samples: Samples) -> Floats:
        """(N,) field of the aircraft in each reading in nT, up to a constant; NaN for incomplete readings.

        Raises `InputError`, `UnitError` or `FitError` as `fit_coefficients`.
        """
        signal = Signal.of(samples)
        interference = np.full(len(samples), np.nan)
        interference[signal.rows] = signal.interference(self.coefficients)
        return interference

    def compensate(self, samples: Samples) -> CompensationResidual:
        """Residual of the compensation of another recording; raises as `interference` and `fit_coefficients`."""
        equations = Equations.of(Signal.of(samples).runs())
        removed = np.concatenate([run.filter_band(run.interference(self.coefficients)) for run in equations.runs])
        left = equations.values - removed
        return CompensationResidual(
            before=equations.before,
            after=float(np.sqrt(np.sum(left**2) / equations.readings)),
            claimed=_claimed_sigma(equations.gram, self.covariance),
            noise=self.after,
        )


@dataclass(frozen=True, slots=True)
class CompensationResidual:
    """Residual of the compensation of a recording: standard deviations from 0.1 to 0.9 Hz, in nT."""

    before: float  #: without compensation
    after: float  #: with compensation
    claimed: float  #: 1 σ of the compensation in these readings
    noise: float  #: residual from noise and ground on the calibration flight

    @property
    def expected(self) -> float:
        """Expected residual: claimed uncertainty, noise and ground."""
        return float(np.hypot(self.claimed, self.noise))

    def as_dict(self) -> dict[str, float]:
        """JSON-ready."""
        return {
            "before": self.before,
            "after": self.after,
            "improvement": self.before / self.after,  # ratio of the standard deviations before and after
            "claimed": self.claimed,
            "expected": self.expected,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Terms and strength within the band, as equations for the coefficients."""

    runs: Sequence[Signal]
    cosines: tuple[Floats, ...]  #: (M, 17) for each run: the terms, and the strength in nT

    @classmethod
    def of(cls, runs: Sequence[Signal], coefficients: Floats | None = None) -> Self:
        """Equations of some runs; if coefficients are given, terms of second order are subtracted."""
        return cls(runs, tuple(run.band_cosines(coefficients) for run in runs))

    @property
    def readings(self) -> int:
        """Number of readings of all runs."""
        return sum(map(len, self.runs))

    @property
    def terms(self) -> Floats:
        """(M, 16) cosines of the terms, of all runs."""
        return np.concatenate(self.cosines)[:, :-1]

    @property
    def values(self) -> Floats:
        """(M,) cosines of the strength, of all runs, nT."""
        return np.concatenate(self.cosines)[:, -1]

    @property
    def gram(self) -> Floats:
        """(16, 16) mean products of terms per reading."""
        gram: Floats = self.terms.T @ self.terms / self.readings
        return gram

    @property
    def before(self) -> float:
        """Standard deviation of the strength, nT."""
        return float(np.sqrt(np.sum(self.values**2) / self.readings))

    def fit(self, ridge: float) -> Floats:
        """(16,) coefficients of least squares with a ridge."""
        coefficients: Floats = _inverse(self.terms.T @ self.terms, ridge) @ self.terms.T @ self.values
        return coefficients

    def products(self) -> Floats:
        """(`FOLDS`, 17, 17) sums over time of products of terms and strength, for each fold of half minutes."""
        passed = np.concatenate([run.to_time(cosines) for run, cosines in zip(self.runs, self.cosines, strict=True)])
        fold = np.concatenate([(run.time - run.time[0]) // FOLD_S % FOLDS for run in self.runs])
        return np.stack([passed[fold == each].T @ passed[fold == each] for each in range(FOLDS)])


def _held_out_squares(products: Floats, ridge: float) -> float:
    """Sum of squares in nT² over all folds, each compensated with coefficients from the other folds."""
    others = np.sum(products, axis=0) - products
    left = 0.0
    for own, other in zip(products, others, strict=True):
        rest = np.append(-_inverse(other[:-1, :-1], ridge) @ other[:-1, -1], 1.0)
        left += float(rest @ own @ rest)
    return left


def _inverse(normal: Floats, ridge: float) -> Floats:
    """(16, 16) inverse of a normal matrix with a ridge, a share of the sum of squares of each term."""
    scale = np.maximum(np.sqrt(np.diag(normal)), 1e-150)
    units = np.outer(scale, scale)
    inverse: Floats = np.linalg.pinv(normal / units + ridge * np.eye(len(scale)), hermitian=True) / units
    return inverse


def fit_coefficients(samples: Samples) -> TollesLawson:
    """Fit the sixteen coefficients to a calibration flight.

    Minimises Σ (y − Σ cⱼ xⱼ)² + λ Σ (cⱼ sⱼ)² over the cosines y of the strength and xⱼ of the terms, where sⱼ² is the
    sum of squares of the term; λ minimises the residuals of held-out half minutes. The covariance allows residuals of
    different size at each frequency [5]_, and includes the shrinkage by the ridge.

    Use it for rolls, pitches and yaws of some degrees on four headings, high above the ground, if the aircraft adds 2 %
    of the field or less; with a more magnetic aircraft, calibrate the vector magnetometer first. The effect of the
    aircraft's field across that of the earth is of second order, and is subtracted.

    Raises `InputError` or `UnitError` without time, for counts, or for magnetometers in different units; `FitError` for
    less than 90 s of usable readings, fewer than four a second, or a magnetometer that does not work.

    Parameters
    ----------
    samples : Samples
        Field in the axes of the aircraft, forward, right, down, with times. `Samples.strength` is the reading of the
        scalar magnetometer; without it the length of the field is compensated, which should be constant.

    References
    ----------
    .. [5] H. White (1980), doi:10.2307/1912934; HC3 of MacKinnon and White (1985).
    """
    flown = Signal.of(samples).runs()
    seconds = sum(run.seconds for run in flown)
    if seconds < MIN_DURATION_S:
        raise FitError(
            f"{seconds:.0f} s without gaps: need {MIN_DURATION_S:.0f} s and more, such as rolls, pitches and yaws on "
            "four headings",
            seconds=seconds,
        )
    recorded = Equations.of(flown)
    around = _all_headings(recorded.gram)
    unobserved = _unobserved_terms(around, recorded)
    equations = recorded if unobserved else _first_order(recorded)
    products = equations.products()
    cross_validated = [_held_out_squares(products, ridge) for ridge in RIDGES]
    best = int(np.argmin(cross_validated))
    coefficients, covariance, noise = _solve(equations, RIDGES[best])
    return TollesLawson(
        coefficients,
        covariance,
        ridge=float(RIDGES[best]),
        before=recorded.before,
        after=noise * math.sqrt(len(equations.values) / equations.readings),
        cross_validated=math.sqrt(cross_validated[best] / equations.readings),
        as_flown=_claimed_sigma(equations.gram, covariance),
        on_any_heading=_claimed_sigma(around, covariance),
        unobserved=unobserved,
        readings=equations.readings,
        seconds=seconds,
    )


def _all_headings(gram: Floats) -> Floats:
    """(16, 16) mean products of the terms for the same manoeuvres on `HEADINGS` headings."""
    maps = [rotation_map(2.0 * np.pi * place / HEADINGS) for place in range(HEADINGS)]
    around: Floats = np.mean([each.T @ gram @ each for each in maps], axis=0)
    return around


def _first_order(recorded: Equations) -> Equations:
    """Equations from which terms of second order are subtracted, with coefficients that are found by iteration."""
    equations = recorded
    for _ in range(ROUNDS):
        equations = Equations.of(recorded.runs, equations.fit(RIDGES[0]))
    return equations


def _solve(equations: Equations, ridge: float) -> tuple[Floats, Floats, float]:
    """(16,) coefficients, their (16, 16) covariance, and the standard deviation of an equation in nT."""
    terms, values, coefficients = equations.terms, equations.values, equations.fit(ridge)
    inverse = _inverse(terms.T @ terms, ridge)
    residuals = values - terms @ coefficients
    leverage = np.einsum("mi,ij,mj->m", terms, inverse, terms)
    noise = float(np.sqrt(np.sum(residuals**2) / (len(values) - np.sum(leverage))))
    weighted = terms * (residuals / (1.0 - leverage))[:, np.newaxis]
    squares = np.sum(terms**2, axis=0)
    size = max(noise**2 / ridge, float(np.mean(squares * coefficients**2)))
    shrunk = ridge**2 * size * np.diag(squares)
    return coefficients, inverse @ (weighted.T @ weighted + shrunk) @ inverse, noise


def _claimed_sigma(gram: Floats, covariance: Floats) -> float:
    """Standard deviation of compensated readings in nT, from mean products of terms and the covariance."""
    return float(np.sqrt(np.sum(gram * covariance)))


def _unobserved_terms(gram: Floats, equations: Equations) -> tuple[str, ...]:
    """Names of terms whose uncertainty by least squares, on any heading, is large compared with the interference."""
    _, _, noise = _solve(equations, RIDGES[0])
    covariance = noise**2 * _inverse(equations.terms.T @ equations.terms, NO_RIDGE)
    most = MAX_UNCERTAINTY * equations.before
    if _claimed_sigma(gram, covariance) <= most:
        return ()
    each = np.sqrt(np.diag(gram) * np.diag(covariance))
    return tuple(name for name, size in zip(NAMES, each.tolist(), strict=True) if size > most)
