"""Tolles–Lawson: the field of an aircraft in its scalar magnetometer, linear in sixteen coefficients.

With the direction cosines u of the field in the axes of the aircraft, which a vector magnetometer gives, and the
strength B that the scalar magnetometer reads, the field of the aircraft adds

    Σ pᵢ uᵢ + B/50 µT (Σ aᵢⱼ uᵢ uⱼ + Σ eᵢⱼ uᵢ u̇ⱼ)

p is the permanent field, a the induced and e the eddy-current part. Σ uᵢ² is 1 and Σ uᵢ u̇ᵢ is 0, so that azz and ezz
cannot be seen beside the others and are zero here: 3 + 5 + 8 terms.

Both sides are compared between 0.1 and 0.9 Hz, where manoeuvres are and the ground below is not. Stretches of half a
minute, each without its straight line, are taken apart into cosines, and those of the band are the equations
(band-spectrum regression): noise of any colour is independent there, so that the covariance needs no model of it.
A ridge in units of the spread of each term, chosen by cross-validation over the stretches, holds what the manoeuvres
hardly show.

>>> from flinders.simulate import calibration_flight
>>> flight = calibration_flight(seed=1)
>>> fit = fitted(flight.samples)
>>> bool(fit.improvement > 10.0), fit.unseen
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
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from flinders.arrays import Value, frozen, runs
from flinders.errors import ArrayError, FitError, InputError, UnitError, figures
from flinders.geometry.rotation import rotations

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

INDUCED: Final = ("xx", "xy", "xz", "yy", "yz")
EDDY: Final = ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy")
NAMES: Final = (
    *(f"permanent {axis}" for axis in "xyz"),
    *(f"induced {pair}" for pair in INDUCED),
    *(f"eddy {pair}" for pair in EDDY),
)
"""Of the coefficients: permanent in nT, induced in nT and eddy in nT s where the field has 50 µT."""

NORMAL_FIELD: Final = 50.0
"""µT, the strength that induced and eddy coefficients hold for."""

BAND_HZ: Final = (0.1, 0.9)

STRETCH_S: Final = 30.0

SHORTEST_S: Final = 15.0
"""Of a stretch that counts."""

LONGEST_GAP_S: Final = 1.0

SLOWEST_HZ: Final = 4.0
"""Readings a second, twice the band and a margin."""

FEWEST_STRETCHES: Final = 4

FOLDS: Final = 5

DROPOUT: Final = 0.1
"""Of the strength: a reading that is farther from the median is one of a scalar magnetometer without a signal."""

RIDGES: Final = np.logspace(-8.0, 0.0, 17)

NO_RIDGE: Final = 1e-12

OPEN: Final = 0.25
"""Of the standard deviation before compensation: coefficients that are less certain leave terms unseen."""

ROUNDS: Final = 2
"""Of the second order, which is a hundredth of the first where the aircraft has one percent of the field."""

HEADINGS: Final = 8
"""To which the manoeuvres are turned about z, to see what the coefficients claim on any heading."""

Quality = Literal["good", "limited", "refused"]


@dataclass(frozen=True, slots=True, eq=False)
class TollesLawson(Value):
    """Coefficients of an aircraft, with what a compensation by them leaves; standard deviations from 0.1 to 0.9 Hz."""

    coefficients: Floats  #: (16,) as `NAMES`
    covariance: Floats  #: (16, 16)
    ridge: float  #: share of the sum of squares of each term
    before: float  #: nT: of the strength as recorded
    after: float  #: nT: of the strength compensated, as noise and ground would leave with coefficients that are known
    held_out: float  #: nT: of a fifth of the stretches, compensated by coefficients of all others
    as_flown: float  #: nT, 1 σ: of the compensation by these coefficients, in manoeuvres as flown
    on_any_heading: float  #: nT, 1 σ: the same in these manoeuvres about z, on headings all around
    unseen: tuple[str, ...] = ()  #: of `NAMES`: what the manoeuvres do not show
    readings: int = 0
    seconds: float = 0.0

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
        """Improvement ratio: standard deviation before over that of held-out stretches after."""
        return self.before / self.held_out

    @property
    def verdict(self) -> Quality:
        """``refused`` where terms are unseen, ``limited`` by `limits`, else ``good``."""
        return "refused" if self.unseen else "limited" if self.limits else "good"

    @property
    def limits(self) -> tuple[str, ...]:
        """What the coefficients are not good for, in words."""
        said = []
        if self.unseen:
            said.append(
                f"the manoeuvres do not show {', '.join(self.unseen)}: fly rolls, pitches and yaws on four headings"
            )
        elif self.on_any_heading > self.held_out:
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

        Raises
        ------
        InputError, ArrayError
            Without time, in counts, or for less than two readings.
        """
        signal = Signal.of(samples)
        interference = np.full(len(samples), np.nan)
        interference[signal.rows] = signal.interference(self.coefficients)
        return interference

    def compensated(self, samples: Samples) -> Compensated:
        """Look at what the coefficients leave of another recording; raises as `interference`, and `fitted`."""
        stretches = _stretches(Signal.of(samples))
        equations = Equations.of(stretches)
        removed = np.concatenate([each.filtered(each.interference(self.coefficients)) for each in stretches])
        return Compensated(
            before=equations.spread(equations.values),
            after=equations.spread(equations.values - removed),
            claimed=_claimed(equations.gram, self.covariance),
            noise=self.after,
        )


@dataclass(frozen=True, slots=True)
class Compensated:
    """What coefficients leave of a recording: standard deviations from 0.1 to 0.9 Hz, in nT."""

    before: float
    after: float
    claimed: float  #: 1 σ of the compensation in these readings
    noise: float  #: of noise and ground, as on the calibration flight

    @property
    def expected(self) -> float:
        """What was to be left."""
        return float(np.hypot(self.claimed, self.noise))

    def as_dict(self) -> dict[str, float]:
        """JSON-ready."""
        return {
            "before": self.before, "after": self.after, "improvement": self.before / self.after,
            "claimed": self.claimed, "expected": self.expected,
        }  # fmt: skip


LEAST_IMPROVEMENT: Final = 1.2
"""Ratio from which on a compensation is worth its while."""


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Usable readings of both magnetometers."""

    rows: NDArray[np.intp]  #: (N,) where they stand in the recording
    time: Floats  #: (N,) s, ascending
    directions: Floats  #: (N, 3) direction cosines of the field in the axes of the aircraft
    strength: Floats  #: (N,) µT, of the scalar magnetometer, else the length of the vector

    @classmethod
    def of(cls, samples: Samples) -> Self:
        """Take those that have a time after the one before, a direction and a strength near the median."""
        if samples.time is None:
            raise InputError(f"{samples.source} has no times: eddy currents and the band of manoeuvres need them")
        length, strength = np.linalg.norm(samples.field, axis=1), scalar_of(samples)
        if samples.unit.inside != "uT":
            raise UnitError(f"{samples.source} is in counts: give unit= or scale= of the readings")
        is_later = np.diff(np.fmax.accumulate(samples.time), prepend=-np.inf) > 0.0
        is_near = np.abs(strength - np.nanmedian(strength)) <= DROPOUT * np.nanmedian(strength)
        rows = np.flatnonzero(is_later & is_near & (length > 0.0))
        if len(rows) < 2:
            raise ArrayError(f"{samples.source} has {len(rows)} usable readings: need two and more")
        directions = samples.field[rows] / length[rows, np.newaxis]
        return cls(rows, samples.time[rows], directions, strength[rows])

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, part: slice) -> Signal:
        return Signal(self.rows[part], self.time[part], self.directions[part], self.strength[part])

    def turned(self, angle: float) -> Signal:
        """The same with the aircraft turned about its z axis by some rad."""
        matrix = rotations([[0.0, 0.0, angle]])[0]
        return Signal(self.rows, self.time, self.directions @ matrix.T, self.strength)

    def stretches(self) -> list[Signal]:
        """Parts of about half a minute, without gaps."""
        steady = runs(np.append(np.diff(self.time) <= LONGEST_GAP_S, False))
        whole = [slice(run.start, run.stop + 1) for run in steady]
        return [self[part] for each in whole for part in _parts(each, self.time)]

    def terms(self) -> Floats:
        """(N, 16) what each coefficient is multiplied by."""
        u = self.directions
        change = np.gradient(u, self.time, axis=0)
        induced = [u[:, "xyz".index(i)] * u[:, "xyz".index(j)] for i, j in INDUCED]
        eddy = [u[:, "xyz".index(i)] * change[:, "xyz".index(j)] for i, j in EDDY]
        return np.column_stack([u, np.stack([*induced, *eddy], axis=1) * self.strength[:, np.newaxis] / NORMAL_FIELD])

    def in_band(self) -> Floats:
        """(M, 17) cosines within the band: of the terms, and of the strength in nT."""
        return self.filtered(np.column_stack([self.terms(), 1000.0 * self.strength]))

    def interference(self, coefficients: Floats) -> Floats:
        """(N,) nT that coefficients make of the aircraft."""
        first: Floats = self.terms() @ coefficients
        return first + self.second_order(coefficients)

    def second_order(self, coefficients: Floats) -> Floats:
        """(N,) nT by which the strength is higher than the terms make it: half of what is across, squared, over B."""
        permanent, induced, eddy = as_matrices(coefficients)
        u, change = self.directions, np.gradient(self.directions, self.time, axis=0)
        scale = self.strength[:, np.newaxis] / NORMAL_FIELD
        field = permanent + scale * (u @ induced.T + change @ eddy.T)
        along = np.sum(field * u, axis=1)
        total = 1000.0 * self.strength
        earth: Floats = np.linalg.norm(total[:, np.newaxis] * u - field, axis=1)
        return total - earth - along

    def filtered(self, columns: Floats) -> Floats:
        """(M, ...) cosines within the band of (N, ...) columns, each without its straight line."""
        n, seconds = len(self), self.time[-1] - self.time[0]
        even = np.linspace(self.time[0], self.time[-1], n)
        columns = np.apply_along_axis(lambda column: np.interp(even, self.time, column), 0, columns)
        line = np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)])
        cosines = cosine_transform(columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0])
        hertz = np.arange(n) * (n - 1) / (2.0 * n * seconds)
        in_band: Floats = cosines[(hertz >= BAND_HZ[0]) & (hertz <= BAND_HZ[1])]
        return in_band


def scalar_of(samples: Samples) -> Floats:
    """(N,) µT: what the scalar magnetometer reads, else the length of the vector."""
    return np.linalg.norm(samples.field, axis=1) if samples.strength is None else samples.strength


def _parts(run: slice, time: Floats) -> list[slice]:
    """Cut a run without gaps into equal parts; none of one that is too short."""
    seconds = time[run.stop - 1] - time[run.start]
    if seconds < SHORTEST_S:
        return []
    edges = np.linspace(run.start, run.stop, max(round(seconds / STRETCH_S), 1) + 1).astype(int).tolist()
    return [slice(start, stop) for start, stop in pairwise(edges)]


def as_matrices(coefficients: Floats) -> tuple[Floats, Floats, Floats]:
    """Permanent field (3,), induced matrix (3, 3), symmetric, and eddy matrix (3, 3), both with zz = 0."""
    induced, eddy = np.zeros((3, 3)), np.zeros((3, 3))
    for pair, value in zip(INDUCED, coefficients[3:8], strict=True):
        induced["xyz".index(pair[0]), "xyz".index(pair[1])] = value
    for pair, value in zip(EDDY, coefficients[8:], strict=True):
        eddy["xyz".index(pair[0]), "xyz".index(pair[1])] = value
    return coefficients[:3], (induced + induced.T) / 2.0, eddy


def cosine_transform(columns: Floats) -> Floats:
    """(N, ...) discrete cosine transform II of the columns, orthonormal.

    >>> cosine_transform(np.array([[1.0], [1.0], [1.0], [1.0]])).round(6).ravel()
    array([2., 0., 0., 0.])
    """
    n = len(columns)
    spectrum = np.fft.rfft(np.concatenate([columns, columns[::-1]]), axis=0)[:n]
    shifted = (spectrum.T * np.exp(-0.5j * np.pi * np.arange(n) / n)).T
    transform: Floats = shifted.real / np.sqrt(2.0 * n)
    transform[0] /= np.sqrt(2.0)
    return transform


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Terms and strength within the band."""

    terms: Floats  #: (M, 16)
    values: Floats  #: (M,) nT
    stretch: NDArray[np.intp]  #: (M,) which stretch each is of
    readings: int

    @classmethod
    def of(cls, stretches: Sequence[Signal]) -> Self:
        """Those of some stretches."""
        cosines = [stretch.in_band() for stretch in stretches]
        place = np.repeat(np.arange(len(cosines)), [len(each) for each in cosines])
        whole = np.concatenate(cosines)
        return cls(whole[:, :-1], whole[:, -1], place, sum(map(len, stretches)))

    @property
    def gram(self) -> Floats:
        """(16, 16) mean products of the terms in a reading."""
        gram: Floats = self.terms.T @ self.terms / self.readings
        return gram

    def spread(self, values: Floats) -> float:
        """Standard deviation of readings of which (M,) cosines are within the band."""
        return float(np.sqrt(np.sum(values**2) / self.readings))

    def __getitem__(self, rows: NDArray[np.bool_]) -> Equations:
        return Equations(self.terms[rows], self.values[rows], self.stretch[rows], self.readings)

    def fit(self, ridge: float) -> Floats:
        """(16,) coefficients of least squares with a ridge."""
        coefficients: Floats = _inverse(self.terms, ridge) @ self.terms.T @ self.values
        return coefficients

    def held_out(self, ridge: float) -> Floats:
        """(M,) residuals of each fold of stretches, compensated by the coefficients of the others."""
        residuals = np.empty(len(self.values))
        for fold in range(FOLDS):
            is_out = self.stretch % FOLDS == fold
            residuals[is_out] = self.values[is_out] - self.terms[is_out] @ self[~is_out].fit(ridge)
        return residuals


def _inverse(terms: Floats, ridge: float) -> Floats:
    """(16, 16) inverse of the normal matrix with a ridge, a share of the sum of squares of each term."""
    scale = np.sqrt(np.sum(terms**2, axis=0)) + 1e-300
    normal = (terms / scale).T @ (terms / scale) + ridge * np.eye(terms.shape[1])
    return np.linalg.pinv(normal, hermitian=True) / np.outer(scale, scale)


def fitted(samples: Samples) -> TollesLawson:
    """Fit the sixteen coefficients to a calibration flight.

    Minimises Σ (y − Σ cⱼ xⱼ)² + λ Σ (cⱼ sⱼ)² over the cosines y of the strength and xⱼ of the terms, sⱼ² being the sum
    of squares of the term; λ makes the residuals of held-out stretches smallest. The covariance is that of residuals
    of any size at each frequency [5]_, and of the coefficients that the ridge shrinks.

    Use it for rolls, pitches and yaws of some degrees on three and more headings, high above the ground, and fields of
    the aircraft below one or two percent of the earth's: the model is of first order. A larger one wants the vector
    magnetometer calibrated first.

    Parameters
    ----------
    samples : Samples
        Field in the axes of the aircraft, forward, right, down, with times. `Samples.strength` is what the scalar
        magnetometer reads; without it the length of the field is compensated, which is to be that of a constant field.

    Raises
    ------
    InputError, UnitError
        Without time, or in counts.
    FitError
        For less than two minutes of usable readings, or fewer than four a second.

    References
    ----------
    .. [5] H. White (1980), doi:10.2307/1912934; HC3 of MacKinnon and White (1985).
    """
    stretches = _stretches(Signal.of(samples))
    if len(stretches) < FEWEST_STRETCHES:
        raise FitError(
            f"{len(stretches)} half minutes without gaps: need {FEWEST_STRETCHES} and more, "
            "such as rolls, pitches and yaws on four headings",
            stretches=len(stretches),
        )
    recorded = Equations.of(stretches)
    angles = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
    around = np.mean([Equations.of([each.turned(angle) for each in stretches]).gram for angle in angles], axis=0)
    unseen = _unseen(around, recorded)
    equations = recorded if unseen else _first_order(recorded, stretches)
    held_out = [equations.spread(equations.held_out(ridge)) for ridge in RIDGES]
    best = int(np.argmin(held_out))
    coefficients, covariance, noise = _solved(equations, RIDGES[best])
    return TollesLawson(
        coefficients,
        covariance,
        ridge=float(RIDGES[best]),
        before=equations.spread(recorded.values),
        after=noise * math.sqrt(len(equations.values) / equations.readings),
        held_out=held_out[best],
        as_flown=_claimed(equations.gram, covariance),
        on_any_heading=_claimed(around, covariance),
        unseen=unseen,
        readings=equations.readings,
        seconds=float(sum(each.time[-1] - each.time[0] for each in stretches)),
    )


def _first_order(recorded: Equations, stretches: Sequence[Signal]) -> Equations:
    """Equations without what the field of the aircraft adds in second order, which the coefficients say."""
    equations = recorded
    for _ in range(ROUNDS):
        coefficients = equations.fit(RIDGES[0])
        second = [each.filtered(each.second_order(coefficients)) for each in stretches]
        equations = replace(recorded, values=recorded.values - np.concatenate(second))
    return equations


def _stretches(signal: Signal) -> list[Signal]:
    """Stretches that show the band."""
    rate = 1.0 / float(np.median(np.diff(signal.time)))
    if rate < SLOWEST_HZ:
        raise FitError(f"{figures(rate)} readings a second: need {SLOWEST_HZ:g} or more, 10 are usual", rate_hz=rate)
    stretches = signal.stretches()
    if not stretches:
        raise FitError(
            f"no {SHORTEST_S:g} s without a gap of {LONGEST_GAP_S:g} s: record manoeuvres and lines in one piece"
        )
    return stretches


def _solved(equations: Equations, ridge: float) -> tuple[Floats, Floats, float]:
    """Coefficients (16,), their covariance (16, 16), and the standard deviation of an equation."""
    terms, values, coefficients = equations.terms, equations.values, equations.fit(ridge)
    inverse = _inverse(terms, ridge)
    residuals = values - terms @ coefficients
    leverage = np.einsum("mi,ij,mj->m", terms, inverse, terms)
    noise = float(np.sqrt(np.sum(residuals**2) / (len(values) - np.sum(leverage))))
    weighted = terms * (residuals / (1.0 - leverage))[:, np.newaxis]
    shrunk = noise**2 * ridge * np.diag(np.sum(terms**2, axis=0))
    return coefficients, inverse @ (weighted.T @ weighted + shrunk) @ inverse, noise


def _claimed(gram: Floats, covariance: Floats) -> float:
    """Standard deviation, nT, that a covariance of coefficients makes of compensated readings with such products."""
    return float(np.sqrt(np.sum(gram * covariance)))


def _unseen(gram: Floats, equations: Equations) -> tuple[str, ...]:
    """Terms that least squares leave open by much of what there is to compensate, on any heading."""
    _, _, noise = _solved(equations, RIDGES[0])
    covariance = noise**2 * _inverse(equations.terms, NO_RIDGE)
    most = OPEN * equations.spread(equations.values)
    if _claimed(gram, covariance) <= most:
        return ()
    each = np.sqrt(np.diag(gram) * np.diag(covariance))
    return tuple(name for name, size in zip(NAMES, each.tolist(), strict=True) if size > most)
