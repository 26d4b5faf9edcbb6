"""Readings of a scalar and a vector magnetometer as terms of the Tolles–Lawson model, in the band of manoeuvres.

>>> from flinders.apps.survey.simulate_aircraft import calibration_flight
>>> [run] = Signal.of(calibration_flight(seed=1).samples).runs()
>>> run.terms().shape[1], run.band_cosines().shape[1]
(16, 17)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import true_runs
from flinders.errors import FitError, InputError, StuckAxis, UnitError, figures
from flinders.geometry.rotation import rotations

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

AXES: Final = "xyz"
INDUCED: Final = ("xx", "xy", "xz", "yy", "yz")
EDDY: Final = ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy")
NAMES: Final = (
    *(f"permanent {axis}" for axis in AXES),
    *(f"induced {pair}" for pair in INDUCED),
    *(f"eddy {pair}" for pair in EDDY),
)
"""Names of the coefficients: permanent in nT; induced in nT and eddy in nT s, both for a field of 50 µT."""

NORMAL_FIELD: Final = 50.0
"""Field strength in µT for which induced and eddy coefficients are stated."""

BAND_HZ: Final = (0.1, 0.9)
"""Band of frequencies of the manoeuvres, in Hz."""

MIN_RUN_S: Final = 15.0
"""Smallest duration in s of a run without gaps that is used."""

MAX_GAP_S: Final = 1.0
"""Largest interval in s between readings of a run."""

MIN_RATE_HZ: Final = 4.0
"""Smallest rate of readings: twice the upper end of the band and a margin."""

MAX_DEVIATION: Final = 0.1
"""Largest relative deviation of a strength from the median; beyond it the scalar magnetometer had no signal."""

MIN_SPIKE_RATIO, MIN_SPIKE_UT = 30.0, 1e-2
"""Smallest deviation of a spike from the median of three readings: in units of the mean deviation, and in µT."""

MIN_READINGS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Usable readings of both magnetometers."""

    rows: NDArray[np.intp]  #: (N,) rows of the recording
    time: Floats  #: (N,) s, ascending
    directions: Floats  #: (N, 3) field of the vector magnetometer over `strength`, in the axes of the aircraft
    strength: Floats  #: (N,) µT: reading of the scalar magnetometer, else the length of the vector

    @classmethod
    def of(cls, samples: Samples) -> Self:
        """Usable readings: with ascending times, and a strength that is neither a dropout nor a spike.

        Raises `InputError`, `UnitError` or `FitError` as `fitted`.
        """
        if samples.time is None:
            raise InputError(f"{samples.source} has no times: eddy currents and the band of manoeuvres need them")
        if samples.unit.inside != "uT":
            raise UnitError(
                f"{samples.source} is in counts: give the unit or the scale of the readings",
                hint={"unit": None, "scale": None},
            )
        length, strength = np.linalg.norm(samples.field, axis=1), scalar_of(samples)
        is_later = np.diff(np.fmax.accumulate(samples.time), prepend=-np.inf) > 0.0
        rows = np.flatnonzero(is_later & (length > 0.0) & (strength > 0.0))
        rows = rows[_is_usual(strength[rows])]
        if len(rows) < MIN_READINGS:
            raise FitError(
                f"{len(rows)} of {len(samples)} readings have an ascending time and a plausible strength of the "
                f"scalar magnetometer: need {MIN_READINGS} and more; check which columns are read",
                found=len(rows),
            )
        directions = samples.field[rows] / strength[rows, np.newaxis]
        signal = cls(rows, samples.time[rows], directions, strength[rows])
        signal.refuse_foreign(samples.field[rows])
        return signal

    def refuse_foreign(self, field: Floats) -> None:
        """Refuse a magnetometer that does not work, or is in another unit, from the (N, 3) field of the vector."""
        if stuck := [axis for axis in range(3) if np.ptp(field[:, axis]) == 0.0]:
            raise StuckAxis(
                tuple("xyz"[axis] for axis in stuck), tuple(float(field[0, axis]) for axis in stuck), "in manoeuvres"
            )
        if np.ptp(self.strength) == 0.0:
            strength = float(self.strength[0])
            raise FitError(f"the scalar magnetometer always reads {strength:g} µT: check its column", strength=strength)
        vector, scalar = float(np.median(np.linalg.norm(field, axis=1))), float(np.median(self.strength))
        if not 0.5 < vector / scalar < 2.0:
            raise UnitError(
                f"the scalar magnetometer reads {scalar:.5g} µT and the vector {vector:.5g} µT: check their columns, "
                "and give the unit of each in its name, such as scalar_nT"
            )

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, part: slice) -> Signal:
        return Signal(self.rows[part], self.time[part], self.directions[part], self.strength[part])

    def runs(self) -> list[Signal]:
        """Parts without gaps that are long enough for the band, with a sufficient rate.

        Raises `FitError` if there is none.
        """
        rate = 1.0 / float(np.median(np.diff(self.time)))
        if rate < MIN_RATE_HZ:
            raise FitError(
                f"{figures(rate)} readings a second: need {MIN_RATE_HZ:g} or more, 10 are usual", rate_hz=rate
            )
        steady = true_runs(np.append(np.diff(self.time) <= MAX_GAP_S, False))
        whole = [self[run.start : run.stop + 1] for run in steady]
        long = [run for run in whole if run.seconds >= MIN_RUN_S]
        if not long:
            raise FitError(
                f"no {MIN_RUN_S:g} s without a gap of {MAX_GAP_S:g} s: record manoeuvres and lines in one piece",
                found=max((run.seconds for run in whole), default=0.0),
                needed=MIN_RUN_S,
            )
        return long

    @property
    def seconds(self) -> float:
        """Duration from the first reading to the last."""
        return float(self.time[-1] - self.time[0])

    def terms(self) -> Floats:
        """(N, 16) terms of the model, one for each coefficient."""
        return self._terms(self.directions)

    def _terms(self, u: Floats) -> Floats:
        """(N, 16) terms of the model for (N, 3) direction cosines."""
        change = np.gradient(u, self.time, axis=0)
        (first, second), (across, along) = _places(INDUCED), _places(EDDY)
        products = np.hstack([u[:, first] * u[:, second], u[:, across] * change[:, along]])
        return np.hstack([u, products * self.strength[:, np.newaxis] / NORMAL_FIELD])

    def band_cosines(self, coefficients: Floats | None = None) -> Floats:
        """(M, 17) cosines within the band, of the terms and of the strength in nT.

        If coefficients are given, terms of second order in the aircraft's field are subtracted from the strength.
        """
        second = 0.0 if coefficients is None else self.second_order(coefficients)
        return self.filter_band(np.column_stack([self.terms(), 1000.0 * self.strength - second]))

    def interference(self, coefficients: Floats) -> Floats:
        """(N,) nT by which the aircraft lengthens the field, from the coefficients."""
        linear: Floats = self.terms() @ coefficients
        return linear + self.second_order(coefficients)

    def second_order(self, coefficients: Floats) -> Floats:
        """(N,) part of the interference of second order in the aircraft's field, in nT.

        A component a of the aircraft's field across the earth's field B lengthens the total field by a²/(2 B). Eddy
        currents follow the change of the earth's field, which differs from that of the total field.
        """
        unit = self.directions / np.linalg.norm(self.directions, axis=1, keepdims=True)
        total = 1000.0 * self.strength[:, np.newaxis]
        first = total * unit - self._aircraft(coefficients, unit, np.gradient(unit, self.time, axis=0))
        change = np.gradient(first, self.time, axis=0) / total
        earth = total * unit - self._aircraft(coefficients, unit, change)
        shorter: Floats = total[:, 0] - np.linalg.norm(earth, axis=1)
        return shorter - self._terms(unit) @ coefficients

    def _aircraft(self, coefficients: Floats, unit: Floats, change: Floats) -> Floats:
        """(N, 3) field of the aircraft in nT, for a field along (N, 3) unit vectors with (N, 3) change per second."""
        permanent, induced, eddy = as_matrices(coefficients)
        field: Floats = permanent + self.strength[:, np.newaxis] / NORMAL_FIELD * (unit @ induced.T + change @ eddy.T)
        return field

    def filter_band(self, columns: Floats) -> Floats:
        """(M, ...) cosines within the band, of (N, ...) columns from which a straight line is removed."""
        n = len(self)
        even = np.linspace(self.time[0], self.time[-1], n)
        columns = np.apply_along_axis(lambda column: np.interp(even, self.time, column), 0, columns)
        line = np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)])
        return cosine_transform(columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0])[self._is_in_band]

    def to_time(self, cosines: Floats) -> Floats:
        """(N, ...) time series of (M, ...) cosines of the band."""
        whole = np.zeros((len(self), *cosines.shape[1:]))
        whole[self._is_in_band] = cosines
        return inverse_cosine_transform(whole)

    @property
    def _is_in_band(self) -> NDArray[np.bool_]:
        """(N,) whether cosines are in the band."""
        n = len(self)
        hertz = np.arange(n) * (n - 1) / (2.0 * n * self.seconds)
        is_in: NDArray[np.bool_] = (hertz >= BAND_HZ[0]) & (hertz <= BAND_HZ[1])
        return is_in


def scalar_of(samples: Samples) -> Floats:
    """(N,) µT: readings of the scalar magnetometer, else the length of the vector."""
    return np.linalg.norm(samples.field, axis=1) if samples.strength is None else samples.strength


def _is_usual(strength: Floats) -> NDArray[np.bool_]:
    """(N,) whether strengths are neither dropouts nor spikes."""
    if not len(strength):
        return np.zeros(0, bool)
    padded = np.pad(strength, 1, mode="edge")
    off = np.abs(strength - np.median([padded[:-2], strength, padded[2:]], axis=0))
    is_spike = off > max(MIN_SPIKE_RATIO * float(np.mean(off)), MIN_SPIKE_UT)
    is_usual: NDArray[np.bool_] = ~is_spike & (np.abs(strength / np.median(strength) - 1.0) <= MAX_DEVIATION)
    return is_usual


def as_matrices(coefficients: Floats) -> tuple[Floats, Floats, Floats]:
    """(3,) permanent field, (3, 3) symmetric induced matrix and (3, 3) eddy matrix, both with zz = 0."""
    induced, eddy = np.zeros((3, 3)), np.zeros((3, 3))
    induced[_places(INDUCED)], eddy[_places(EDDY)] = coefficients[3:8], coefficients[8:]
    return coefficients[:3], (induced + induced.T) / 2.0, eddy


def as_coefficients(permanent: Floats, induced: Floats, eddy: Floats) -> Floats:
    """(16,) coefficients of a field; the isotropic part of a matrix cannot be observed, and is removed.

    >>> as_coefficients(*as_matrices(np.arange(16.0)))
    array([ 0.,  1.,  2.,  3.,  4.,  5.,  6.,  7.,  8.,  9., 10., 11., 12.,
           13., 14., 15.])
    """
    induced, eddy = (matrix - matrix[2, 2] * np.eye(3) for matrix in (induced, eddy))
    both = induced + induced.T - np.diag(np.diag(induced))
    return np.concatenate([permanent, both[_places(INDUCED)], eddy[_places(EDDY)]])


def rotation_map(angle: float) -> Floats:
    """(16, 16) matrix from the coefficients of an aircraft turned about z by `angle` (rad) to those before the turn.

    >>> bool(np.allclose(rotation_map(0.3) @ rotation_map(-0.3), np.eye(16)))
    True
    """
    matrix = rotations([[0.0, 0.0, angle]])[0]
    units = (as_matrices(unit) for unit in np.eye(len(NAMES)))
    seen = [(matrix.T @ p, matrix.T @ induced @ matrix, matrix.T @ eddy @ matrix) for p, induced, eddy in units]
    return np.column_stack([as_coefficients(*each) for each in seen])


def _places(pairs: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Rows and columns of matrix entries such as ``xy``."""
    return [AXES.index(pair[0]) for pair in pairs], [AXES.index(pair[1]) for pair in pairs]


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


def inverse_cosine_transform(cosines: Floats) -> Floats:
    """(N, ...) columns from (N, ...) cosines whose first is zero: the inverse of `cosine_transform`.

    >>> columns = np.array([1.0, 2.0, 4.0, -7.0])
    >>> inverse_cosine_transform(cosine_transform(columns)).round(6)
    array([ 1.,  2.,  4., -7.])
    """
    n = len(cosines)
    shifted = (cosines.T * np.exp(0.5j * np.pi * np.arange(n) / n)).T * np.sqrt(2.0 * n)
    columns: Floats = np.fft.irfft(shifted, 2 * n, axis=0)[:n]
    return columns
