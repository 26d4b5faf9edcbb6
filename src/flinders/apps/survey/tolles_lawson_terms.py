"""Readings of a scalar and a vector magnetometer as terms of the Tolles–Lawson model, in the band of manoeuvres.

>>> from flinders.apps.survey.simulate_aircraft import calibration_flight
>>> [run] = Signal.of(calibration_flight(seed=1).samples).runs()
>>> run.terms().shape[1], run.in_band().shape[1]
(16, 17)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.arrays import runs
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
"""Of the coefficients: permanent in nT, induced in nT and eddy in nT s where the field has 50 µT."""

NORMAL_FIELD: Final = 50.0
"""µT, the strength that induced and eddy coefficients hold for."""

BAND_HZ: Final = (0.1, 0.9)

SHORTEST_S: Final = 15.0
"""Of a run without gaps that counts."""

LONGEST_GAP_S: Final = 1.0

SLOWEST_HZ: Final = 4.0
"""Readings a second, twice the band and a margin."""

DROPOUT: Final = 0.1
"""Of the strength: a reading that is farther from the median is one of a scalar magnetometer without a signal."""

SPIKE, LEAST_SPIKE = 30.0, 1e-2
"""Times the mean, and µT, by which a spike is off the median of three readings."""

FEWEST_READINGS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Usable readings of both magnetometers."""

    rows: NDArray[np.intp]  #: (N,) where they stand in the recording
    time: Floats  #: (N,) s, ascending
    directions: Floats  #: (N, 3) field of the vector magnetometer over `strength`, in the axes of the aircraft
    strength: Floats  #: (N,) µT, of the scalar magnetometer, else the length of the vector

    @classmethod
    def of(cls, samples: Samples) -> Self:
        """Take those with a time after the one before, and a strength that is no dropout and no spike.

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
        if len(rows) < FEWEST_READINGS:
            raise FitError(
                f"{len(rows)} of {len(samples)} readings have a later time and a usual strength of the scalar "
                f"magnetometer: need {FEWEST_READINGS} and more; check which columns are read",
                found=len(rows),
            )
        directions = samples.field[rows] / strength[rows, np.newaxis]
        signal = cls(rows, samples.time[rows], directions, strength[rows])
        signal.refuse_foreign(samples.field[rows])
        return signal

    def refuse_foreign(self, field: Floats) -> None:
        """Refuse magnetometers of which one does not work, or is in another unit, by the (N, 3) field."""
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
        """Parts without gaps that are long enough, and have readings enough, for the band.

        Raises `FitError` where there is none.
        """
        rate = 1.0 / float(np.median(np.diff(self.time)))
        if rate < SLOWEST_HZ:
            raise FitError(
                f"{figures(rate)} readings a second: need {SLOWEST_HZ:g} or more, 10 are usual", rate_hz=rate
            )
        steady = runs(np.append(np.diff(self.time) <= LONGEST_GAP_S, False))
        whole = [self[run.start : run.stop + 1] for run in steady]
        long = [run for run in whole if run.seconds >= SHORTEST_S]
        if not long:
            raise FitError(
                f"no {SHORTEST_S:g} s without a gap of {LONGEST_GAP_S:g} s: record manoeuvres and lines in one piece",
                found=max((run.seconds for run in whole), default=0.0),
                needed=SHORTEST_S,
            )
        return long

    @property
    def seconds(self) -> float:
        """From the first reading to the last."""
        return float(self.time[-1] - self.time[0])

    def terms(self) -> Floats:
        """(N, 16) what each coefficient is multiplied by."""
        return self._terms(self.directions)

    def _terms(self, u: Floats) -> Floats:
        """The same of (N, 3) direction cosines."""
        change = np.gradient(u, self.time, axis=0)
        (first, second), (across, along) = _places(INDUCED), _places(EDDY)
        products = np.hstack([u[:, first] * u[:, second], u[:, across] * change[:, along]])
        return np.hstack([u, products * self.strength[:, np.newaxis] / NORMAL_FIELD])

    def in_band(self, coefficients: Floats | None = None) -> Floats:
        """(M, 17) cosines within the band: of the terms, and of the strength in nT, without the second order."""
        second = 0.0 if coefficients is None else self.second_order(coefficients)
        return self.filtered(np.column_stack([self.terms(), 1000.0 * self.strength - second]))

    def interference(self, coefficients: Floats) -> Floats:
        """(N,) nT that coefficients make of the aircraft: how much shorter the field is without its own."""
        linear: Floats = self.terms() @ coefficients
        return linear + self.second_order(coefficients)

    def second_order(self, coefficients: Floats) -> Floats:
        """(N,) nT of it that is not linear.

        The field of the aircraft across the earth's lengthens that by its square over 2 B, and eddy currents follow
        the field of the earth alone, which changes otherwise than the sum of both.
        """
        unit = self.directions / np.linalg.norm(self.directions, axis=1, keepdims=True)
        total = 1000.0 * self.strength[:, np.newaxis]
        first = total * unit - self._aircraft(coefficients, unit, np.gradient(unit, self.time, axis=0))
        change = np.gradient(first, self.time, axis=0) / total
        earth = total * unit - self._aircraft(coefficients, unit, change)
        shorter: Floats = total[:, 0] - np.linalg.norm(earth, axis=1)
        return shorter - self._terms(unit) @ coefficients

    def _aircraft(self, coefficients: Floats, unit: Floats, change: Floats) -> Floats:
        """(N, 3) nT of the aircraft in a field along (N, 3) unit vectors, with (N, 3) change of these in a second."""
        permanent, induced, eddy = as_matrices(coefficients)
        field: Floats = permanent + self.strength[:, np.newaxis] / NORMAL_FIELD * (unit @ induced.T + change @ eddy.T)
        return field

    def filtered(self, columns: Floats) -> Floats:
        """(M, ...) cosines within the band of (N, ...) columns, each without its straight line."""
        n = len(self)
        even = np.linspace(self.time[0], self.time[-1], n)
        columns = np.apply_along_axis(lambda column: np.interp(even, self.time, column), 0, columns)
        line = np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)])
        return cosine_transform(columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0])[self._is_in_band]

    def passed(self, cosines: Floats) -> Floats:
        """(N, ...) what (M, ...) cosines of the band are in time."""
        whole = np.zeros((len(self), *cosines.shape[1:]))
        whole[self._is_in_band] = cosines
        return inverse_cosine_transform(whole)

    @property
    def _is_in_band(self) -> NDArray[np.bool_]:
        """(N,) which cosines are."""
        n = len(self)
        hertz = np.arange(n) * (n - 1) / (2.0 * n * self.seconds)
        is_in: NDArray[np.bool_] = (hertz >= BAND_HZ[0]) & (hertz <= BAND_HZ[1])
        return is_in


def scalar_of(samples: Samples) -> Floats:
    """(N,) µT: what the scalar magnetometer reads, else the length of the vector."""
    return np.linalg.norm(samples.field, axis=1) if samples.strength is None else samples.strength


def _is_usual(strength: Floats) -> NDArray[np.bool_]:
    """(N,) whether strengths are neither dropouts nor spikes."""
    if not len(strength):
        return np.zeros(0, bool)
    padded = np.pad(strength, 1, mode="edge")
    off = np.abs(strength - np.median([padded[:-2], strength, padded[2:]], axis=0))
    is_spike = off > max(SPIKE * float(np.mean(off)), LEAST_SPIKE)
    is_usual: NDArray[np.bool_] = ~is_spike & (np.abs(strength / np.median(strength) - 1.0) <= DROPOUT)
    return is_usual


def as_matrices(coefficients: Floats) -> tuple[Floats, Floats, Floats]:
    """Permanent field (3,), induced matrix (3, 3), symmetric, and eddy matrix (3, 3), both with zz = 0."""
    induced, eddy = np.zeros((3, 3)), np.zeros((3, 3))
    induced[_places(INDUCED)], eddy[_places(EDDY)] = coefficients[3:8], coefficients[8:]
    return coefficients[:3], (induced + induced.T) / 2.0, eddy


def as_coefficients(permanent: Floats, induced: Floats, eddy: Floats) -> Floats:
    """(16,) coefficients of a field; of a matrix the same in all directions, which cannot be seen, nothing is left.

    >>> as_coefficients(*as_matrices(np.arange(16.0)))
    array([ 0.,  1.,  2.,  3.,  4.,  5.,  6.,  7.,  8.,  9., 10., 11., 12.,
           13., 14., 15.])
    """
    induced, eddy = (matrix - matrix[2, 2] * np.eye(3) for matrix in (induced, eddy))
    both = induced + induced.T - np.diag(np.diag(induced))
    return np.concatenate([permanent, both[_places(INDUCED)], eddy[_places(EDDY)]])


def turned(angle: float) -> Floats:
    """(16, 16) what gives coefficients for an aircraft of those of one that is turned about z by some rad.

    >>> bool(np.allclose(turned(0.3) @ turned(-0.3), np.eye(16)))
    True
    """
    matrix = rotations([[0.0, 0.0, angle]])[0]
    units = (as_matrices(unit) for unit in np.eye(len(NAMES)))
    seen = [(matrix.T @ p, matrix.T @ induced @ matrix, matrix.T @ eddy @ matrix) for p, induced, eddy in units]
    return np.column_stack([as_coefficients(*each) for each in seen])


def _places(pairs: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Rows and columns of entries."""
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
    """(N, ...) columns of which `cosine_transform` gives (N, ...) cosines, the first of them zero.

    >>> columns = np.array([1.0, 2.0, 4.0, -7.0])
    >>> inverse_cosine_transform(cosine_transform(columns)).round(6)
    array([ 1.,  2.,  4., -7.])
    """
    n = len(cosines)
    shifted = (cosines.T * np.exp(0.5j * np.pi * np.arange(n) / n)).T * np.sqrt(2.0 * n)
    columns: Floats = np.fft.irfft(shifted, 2 * n, axis=0)[:n]
    return columns
