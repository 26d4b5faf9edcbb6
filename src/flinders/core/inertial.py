"""Calibration of an accelerometer or a gyro: offsets, gains and misalignment, each with its uncertainty.

``corrected = matrix (raw − offset)``: the specific force in m/s², or the angular rate in rad/s. At rest the specific
force points up: the axis that points up reads +g.

>>> in_g = Triad(np.diag([9.8, 9.7, 9.9]), [0.02, 0.0, -0.01], unit="g")
>>> in_g.apply([1.02, 0.0, -0.01])
array([9.8, 0. , 0. ])
>>> in_si = in_g.convert("m/s2")
>>> in_si.offset.round(3), bool(np.allclose(in_si.apply(9.80665 * np.ones(3)), in_g.apply(np.ones(3))))
(array([ 0.196,  0.   , -0.098]), True)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.arrays import check_vectors, to_floats
from flinders.core.inertial_record import InertialDocument, InertialUnit, TiltErrorRecord, TriadRecord
from flinders.core.units import COUNTS
from flinders.errors import UnitError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.calibration_file import ProvenanceRecord

STANDARD_GRAVITY: Final = 9.80665
"""Standard gravity in m/s²; local gravity lies between 9.764 and 9.834."""

SI_PER_UNIT: Final = {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY, "rad/s": 1.0}
"""Size of each unit in m/s², or in rad/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Triad:
    """Correction of a three-axis sensor, ``corrected = matrix (raw − offset)``."""

    matrix: Floats  #: (3, 3), m/s² or rad/s per `unit`: gains on the diagonal, misalignment off the diagonal
    offset: Floats  #: (3,), in `unit`: reading of an accelerometer in free fall, or of a gyro at rest
    unit: InertialUnit  #: of raw readings: ``m/s2``, ``g``, ``mg``, ``rad/s`` or ``counts``
    matrix_sigma: Floats | None = None  #: (3, 3): 1 σ of each entry; None if not known
    offset_sigma: Floats | None = None  #: (3,), in `unit`: 1 σ; None if not known

    def __post_init__(self) -> None:
        """Convert lists to arrays."""
        object.__setattr__(self, "matrix", to_floats(self.matrix, "matrix"))
        object.__setattr__(self, "offset", to_floats(self.offset, "offset"))

    def apply(self, raw: ArrayLike) -> Floats:
        """Correct (..., 3) readings in `unit` to m/s² or rad/s."""
        corrected: Floats = (check_vectors(raw, "raw", finite=False) - self.offset) @ self.matrix.T
        return corrected

    def convert(self, unit: InertialUnit, *, who: str = "this") -> Self:
        """The same correction for readings in another unit.

        Raises `UnitError` between counts and a physical unit; the message says that `who` needs the other unit.
        """
        if unit == self.unit:
            return self
        if COUNTS in (unit, self.unit):
            raise UnitError(
                f"{who} takes readings in {unit}, and these are in {self.unit}: record them in {unit}, "
                "and calibrate again"
            )
        return self.scale_readings(SI_PER_UNIT[self.unit] / SI_PER_UNIT[unit], unit)

    def scale_readings(self, size: float, unit: InertialUnit) -> Self:
        """The same correction for readings that are `size` times as large, in `unit`."""
        scaled = replace(self, matrix=self.matrix / size, offset=self.offset * size, unit=unit)
        matrix, offset = self.matrix_sigma, self.offset_sigma
        return replace(
            scaled,
            matrix_sigma=None if matrix is None else matrix / size,
            offset_sigma=None if offset is None else offset * size,
        )

    def map_axes(self, turn: Floats) -> Self:
        """The same correction in other axes; `turn` is the (3, 3) signed permutation from the old axes to the new."""
        swap = np.abs(turn)
        return replace(
            self,
            matrix=turn @ self.matrix @ turn.T,
            offset=turn @ self.offset,
            matrix_sigma=None if self.matrix_sigma is None else swap @ self.matrix_sigma @ swap.T,
            offset_sigma=None if self.offset_sigma is None else swap @ self.offset_sigma,
        )

    def to_record(self) -> TriadRecord:
        """Convert to the record that a calibration file holds."""
        return TriadRecord(
            matrix=_rows(self.matrix),
            matrix_sigma=None if self.matrix_sigma is None else _rows(self.matrix_sigma),
            offset=_row(self.offset),
            offset_sigma=None if self.offset_sigma is None else _row(self.offset_sigma),
            unit=self.unit,
        )

    @classmethod
    def from_record(cls, record: TriadRecord) -> Self:
        """Make the correction of the record of a file."""
        return cls(
            np.array(record.matrix),
            np.array(record.offset),
            record.unit,
            None if record.matrix_sigma is None else np.array(record.matrix_sigma),
            None if record.offset_sigma is None else np.array(record.offset_sigma),
        )


@dataclass(frozen=True, slots=True)
class TiltError:
    """Angle between the vertical that a calibrated accelerometer shows at rest and the true one, in degrees."""

    rms: float  #: 1 σ: root mean square over all attitudes
    worst: float  #: 1 σ at the worst attitude
    bound_95: float  #: with a probability of 95 % the errors at all attitudes are smaller

    def heading_error_deg(self, dip_deg: float) -> float:
        """Heading error (1 σ) in degrees from the tilt error, tan I · rms / √2.

        Only the tilt about the horizontal field matters, which is rms / √2.

        >>> round(TiltError(0.6, 0.8, 1.5).heading_error_deg(60.0), 2)
        0.73
        """
        return float(np.tan(np.deg2rad(abs(dip_deg))) * self.rms / np.sqrt(2.0))


@dataclass(frozen=True, slots=True, eq=False)
class Inertial:
    """Corrections of the accelerometer and the gyro of one device."""

    accelerometer: Triad | None = None
    gyro: Triad | None = None
    tilt_error: TiltError | None = None  #: of the accelerometer, within its own axes
    gravity: float = STANDARD_GRAVITY  #: m/s²: length of corrected accelerations at rest
    provenance: ProvenanceRecord | None = field(default=None)

    def __bool__(self) -> bool:
        return self.accelerometer is not None or self.gyro is not None

    def to_document(self) -> InertialDocument:
        """Make the content of the file of an accelerometer or a gyro."""
        tilt = self.tilt_error
        return InertialDocument(
            accelerometer=None if self.accelerometer is None else self.accelerometer.to_record(),
            gyro=None if self.gyro is None else self.gyro.to_record(),
            tilt_error_deg=None if tilt is None else TiltErrorRecord(tilt.rms, tilt.worst, tilt.bound_95),
            gravity=self.gravity,
            provenance=self.provenance,
        )

    @classmethod
    def from_document(cls, document: InertialDocument) -> Self:
        """Make the corrections of the content of a file."""
        tilt = document.tilt_error_deg
        return cls(
            None if document.accelerometer is None else Triad.from_record(document.accelerometer),
            None if document.gyro is None else Triad.from_record(document.gyro),
            None if tilt is None else TiltError(tilt.rms, tilt.worst, tilt.bound_95),
            document.gravity,
            document.provenance,
        )


def _row(values: Floats) -> Any:  # noqa: ANN401 - three numbers, as msgspec has them
    return tuple(values.tolist())


def _rows(values: Floats) -> Any:  # noqa: ANN401 - three rows
    return tuple(map(tuple, values.tolist()))
