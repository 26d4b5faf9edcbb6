"""Tolles–Lawson: the field of an aircraft in its scalar magnetometer, linear in sixteen coefficients.

The terms of Leach [2]_ for the model of Tolles and Lawson [1]_. With the direction cosines u of the field in the axes
of the aircraft, which a vector magnetometer gives, and the strength B that the scalar magnetometer reads, the
field of the aircraft adds

    Σ pᵢ uᵢ + B/50 µT (Σ aᵢⱼ uᵢ uⱼ + Σ eᵢⱼ uᵢ u̇ⱼ)

p is the permanent field, a the induced and e the eddy-current part. Σ uᵢ² is 1 and Σ uᵢ u̇ᵢ is 0, so that azz and ezz
cannot be seen beside the others and are zero here: 3 + 5 + 8 terms. The second order is that of [3]_, with eddy
currents that follow the field of the earth and not the sum of both.

u is what the vector magnetometer reads over B, not over its own length: an error of its axes or gains is then a linear
map of u, which the terms take up, and its length no longer varies with the attitude beside that.

Both sides are compared between 0.1 and 0.9 Hz, where manoeuvres are and the ground below is not. Runs without gaps,
each without its straight line, are taken apart into cosines, and those of the band are the equations [4]_: noise of any
colour is independent there, so that the covariance needs no model of it. A ridge in units of the spread of each term,
chosen by cross-validation over half minutes, holds what the manoeuvres hardly show.

>>> from flinders.apps.survey.simulate_aircraft import calibration_flight
>>> flight = calibration_flight(seed=1)
>>> fit = fitted(flight.samples)
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

from flinders.apps.survey.tolles_lawson_terms import NAMES, Signal, turned
from flinders.arrays import Value, frozen
from flinders.errors import FitError, figures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

LEAST_S: Final = 90.0
"""Of all runs: a flight of two headings, in a hurry."""

FOLD_S: Final = 30.0
FOLDS: Final = 5

RIDGES: Final = np.logspace(-8.0, 0.0, 17)

NO_RIDGE: Final = 1e-12

LEAST_IMPROVEMENT: Final = 1.2
"""Ratio from which on a compensation is worth its while."""

OPEN: Final = 0.25
"""Of the standard deviation before compensation: coefficients that are less certain leave terms unobserved."""

ROUNDS: Final = 2
"""Of the second order, which is a hundredth of the first where the aircraft has one percent of the field."""

HEADINGS: Final = 8
"""To which the manoeuvres are turned about z, to see what the coefficients claim on any heading."""

Quality = Literal["good", "limited", "refused"]


@dataclass(frozen=True, slots=True, eq=False)
class TollesLawson(Value):
    """Coefficients of an aircraft, with what a compensation by them leaves; standard deviations from 0.1 to 0.9 Hz."""

    coefficients: Floats  #: (16,) of the terms
    covariance: Floats  #: (16, 16)
    ridge: float  #: share of the sum of squares of each term
    before: float  #: nT: of the strength as recorded
    after: float  #: nT: of the strength compensated, as noise and ground would leave with coefficients that are known
    cross_validated: float  #: nT: of each fifth of the half minutes, compensated by coefficients of the others
    as_flown: float  #: nT, 1 σ: of the compensation by these coefficients, in manoeuvres as flown
    on_any_heading: float  #: nT, 1 σ: the same in these manoeuvres about z, on headings all around
    unobserved: tuple[str, ...] = ()  #: names of the terms that the manoeuvres do not show
    readings: int = 0  #: how many
    seconds: float = 0.0  #: duration of the recording

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "coefficients", frozen(self.coefficients))
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def sigma(self) -> Floats:
        """(16,) 1 σ of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def improvement(self) -> float:
        """Improvement ratio: standard deviation before over that of held-out half minutes after."""
        return self.before / self.cross_validated

    @property
    def verdict(self) -> Quality:
        """``refused`` where terms are unobserved, ``limited`` by `limits`, else ``good``."""
        return "refused" if self.unobserved else "limited" if self.limits else "good"

    @property
    def limits(self) -> tuple[str, ...]:
        """What the coefficients are not good for, in words."""
        said = []
        if self.unobserved:
            said.append(
                f"the manoeuvres do not show {', '.join(self.unobserved)}: fly rolls, pitches and yaws on four headings"
            )
        elif self.on_any_heading > self.cross_validated:
            said.append(
                f"on other headings the compensation is off by {figures(self.on_any_heading)} nT, more than what is "
                "left on those that were flown: keep to these, or fly four headings"
            )
        if self.improvement < LEAST_IMPROVEMENT:
            said.append(
                f"the compensation improves the readings by a factor of {self.improvement:.2f} only: the aircraft is "
                "hardly magnetic, or something else moves the readings, such as a current or the ground below"
            )
        return tuple(said)

    def interference(self, samples: Samples) -> Floats:
        """(N,) nT of the aircraft in each reading, but for a constant; NaN where something is missing.

        Raises `InputError`, `UnitError` or `FitError` as `fitted`.
        """
        signal = Signal.of(samples)
        interference = np.full(len(samples), np.nan)
        interference[signal.rows] = signal.interference(self.coefficients)
        return interference

    def compensated(self, samples: Samples) -> CompensationResidual:
        """Look at what the coefficients leave of another recording; raises as `interference`, and `fitted`."""
        equations = Equations.of(Signal.of(samples).runs())
        removed = np.concatenate([run.filtered(run.interference(self.coefficients)) for run in equations.runs])
        left = equations.values - removed
        return CompensationResidual(
            before=equations.before,
            after=float(np.sqrt(np.sum(left**2) / equations.readings)),
            claimed=_claimed(equations.gram, self.covariance),
            noise=self.after,
        )


@dataclass(frozen=True, slots=True)
class CompensationResidual:
    """What coefficients leave of a recording: standard deviations from 0.1 to 0.9 Hz, in nT."""

    before: float  #: without the coefficients
    after: float  #: with them
    claimed: float  #: 1 σ of the compensation in these readings
    noise: float  #: of noise and ground, as on the calibration flight

    @property
    def expected(self) -> float:
        """What was to be left."""
        return float(np.hypot(self.claimed, self.noise))

    def as_dict(self) -> dict[str, float]:
        """JSON-ready."""
        return {
            "before": self.before,
            "after": self.after,
            "improvement": self.before / self.after,  # the first over the second
            "claimed": self.claimed,
            "expected": self.expected,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Terms and strength within the band."""

    runs: Sequence[Signal]
    cosines: tuple[Floats, ...]  #: of each run (M, 17): the terms, and the strength in nT

    @classmethod
    def of(cls, runs: Sequence[Signal], coefficients: Floats | None = None) -> Self:
        """Those of some runs; of the first order alone where coefficients say what the second is."""
        return cls(runs, tuple(run.in_band(coefficients) for run in runs))

    @property
    def readings(self) -> int:
        """How many there are."""
        return sum(map(len, self.runs))

    @property
    def terms(self) -> Floats:
        """(M, 16) of all runs."""
        return np.concatenate(self.cosines)[:, :-1]

    @property
    def values(self) -> Floats:
        """(M,) nT of all runs."""
        return np.concatenate(self.cosines)[:, -1]

    @property
    def gram(self) -> Floats:
        """(16, 16) mean products of the terms in a reading."""
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
        """(`FOLDS`, 17, 17) products of terms and strength in time, of each fifth of the half minutes."""
        passed = np.concatenate([run.passed(cosines) for run, cosines in zip(self.runs, self.cosines, strict=True)])
        fold = np.concatenate([(run.time - run.time[0]) // FOLD_S % FOLDS for run in self.runs])
        return np.stack([passed[fold == each].T @ passed[fold == each] for each in range(FOLDS)])


def _held_out(products: Floats, ridge: float) -> float:
    """Sum of squares of each fold, nT², compensated by the coefficients of the others."""
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


def fitted(samples: Samples) -> TollesLawson:
    """Fit the sixteen coefficients to a calibration flight.

    Minimises Σ (y − Σ cⱼ xⱼ)² + λ Σ (cⱼ sⱼ)² over the cosines y of the strength and xⱼ of the terms, sⱼ² being the sum
    of squares of the term; λ makes the residuals of held-out half minutes smallest. The covariance is that of residuals
    of any size at each frequency [5]_, and of the coefficients that the ridge shrinks.

    Use it for rolls, pitches and yaws of some degrees on four headings, high above the ground, and where the aircraft
    adds two percent of the field or less; the vector magnetometer of a more magnetic one is to be calibrated first.
    What the aircraft adds in second order, by its field across that of the earth, is taken off.

    Raises `InputError` or `UnitError` without time, in counts, or where both magnetometers are in units of their own;
    `FitError` for less than 90 s of usable readings, fewer than four a second, or a magnetometer that does not work.

    Parameters
    ----------
    samples : Samples
        Field in the axes of the aircraft, forward, right, down, with times. `Samples.strength` is what the scalar
        magnetometer reads; without it the length of the field is compensated, which is to be that of a constant field.

    References
    ----------
    .. [5] H. White (1980), doi:10.2307/1912934; HC3 of MacKinnon and White (1985).
    """
    flown = Signal.of(samples).runs()
    seconds = sum(run.seconds for run in flown)
    if seconds < LEAST_S:
        raise FitError(
            f"{seconds:.0f} s without gaps: need {LEAST_S:.0f} s and more, such as rolls, pitches and yaws on four "
            "headings",
            seconds=seconds,
        )
    recorded = Equations.of(flown)
    around = _around(recorded.gram)
    unobserved = _unseen(around, recorded)
    equations = recorded if unobserved else _first_order(recorded)
    products = equations.products()
    cross_validated = [_held_out(products, ridge) for ridge in RIDGES]
    best = int(np.argmin(cross_validated))
    coefficients, covariance, noise = _solved(equations, RIDGES[best])
    return TollesLawson(
        coefficients,
        covariance,
        ridge=float(RIDGES[best]),
        before=recorded.before,
        after=noise * math.sqrt(len(equations.values) / equations.readings),
        cross_validated=math.sqrt(cross_validated[best] / equations.readings),
        as_flown=_claimed(equations.gram, covariance),
        on_any_heading=_claimed(around, covariance),
        unobserved=unobserved,
        readings=equations.readings,
        seconds=seconds,
    )


def _around(gram: Floats) -> Floats:
    """(16, 16) mean products of the terms with the same manoeuvres on headings all around."""
    maps = [turned(2.0 * np.pi * place / HEADINGS) for place in range(HEADINGS)]
    around: Floats = np.mean([each.T @ gram @ each for each in maps], axis=0)
    return around


def _first_order(recorded: Equations) -> Equations:
    """Equations without what the field of the aircraft adds in second order, which the coefficients say."""
    equations = recorded
    for _ in range(ROUNDS):
        equations = Equations.of(recorded.runs, equations.fit(RIDGES[0]))
    return equations


def _solved(equations: Equations, ridge: float) -> tuple[Floats, Floats, float]:
    """Coefficients (16,), their covariance (16, 16), and the standard deviation of an equation."""
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


def _claimed(gram: Floats, covariance: Floats) -> float:
    """Standard deviation, nT, that a covariance of coefficients makes of compensated readings with such products."""
    return float(np.sqrt(np.sum(gram * covariance)))


def _unseen(gram: Floats, equations: Equations) -> tuple[str, ...]:
    """Terms that least squares leave open by much of what there is to compensate, on any heading."""
    _, _, noise = _solved(equations, RIDGES[0])
    covariance = noise**2 * _inverse(equations.terms.T @ equations.terms, NO_RIDGE)
    most = OPEN * equations.before
    if _claimed(gram, covariance) <= most:
        return ()
    each = np.sqrt(np.diag(gram) * np.diag(covariance))
    return tuple(name for name, size in zip(NAMES, each.tolist(), strict=True) if size > most)
