"""Calibration of an accelerometer alone, from still poses of the device; with the offset of a gyro, if recorded.

>>> from flinders.core.samples import Samples
>>> rng = np.random.default_rng(1)
>>> sides = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 100, axis=0)
>>> felt = 9.8 * sides + [0.2, 0.0, -0.1] + rng.normal(scale=0.02, size=sides.shape)
>>> fit = calibrate_accelerometer(Samples.of(rng.normal(size=(600, 3)), acceleration=felt))
>>> fit
AccelerometerFit(6 poses, tilt 0.63° (95 % within 1.6°))
>>> fit.inertial.accelerometer.offset.round(2) + 0.0
array([ 0.2,  0. , -0.1])
"""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core import inertial_record
from flinders.core.files import write_text
from flinders.core.inertial import STANDARD_GRAVITY, Inertial, TiltError, Triad
from flinders.core.joining import read_into_memory
from flinders.core.keywords import check_keywords
from flinders.core.samples import Samples
from flinders.errors import DocumentError, NoAccelerometer, NoMagnetometer, UsageError, figures
from flinders.estimators.accelerometer_poses import from_poses, from_readings
from flinders.estimators.still_poses import StillPoses
from flinders.readers import open_recording
from flinders.readers._instruments import vectors as triples
from flinders.readers._names import ACCELERATION, meaning

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.core.inertial_record import InertialDocument
    from flinders.core.samples import Recording
    from flinders.estimators.accelerometer_poses import AccelerometerEstimate
    from flinders.readers import AnySource

MIN_STILL_SHARE: Final = 0.1
"""Smallest share of readings in still poses. With less, the device was turned slowly and never put down."""
GRAVITY_RANGE: Final = 9.7, 9.9
"""Range of gravity on the ground, with a margin, in m/s²."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AccelerometerFit:
    """A calibrated accelerometer, with the error of the vertical that it measures."""

    inertial: Inertial  #: the correction of the accelerometer, and of a gyro if one was recorded
    tilt_error: TiltError  #: error of the vertical that it measures at rest, in the accelerometer's own axes
    poses: int  #: number of still poses, or of readings if each counts as a pose
    #: whether the device was put down; otherwise each reading counts as a pose, and residuals give the noise
    is_still: bool
    #: whether the poses determine the angles between the axes; otherwise the claim includes 0.01 rad, 1 σ, for them
    sees_misalignment: bool
    excess: float  #: rms residual divided by the noise within poses
    source: str  #: name of the recording

    def __repr__(self) -> str:
        what = "poses" if self.is_still else "readings"
        error = self.tilt_error
        return (
            f"AccelerometerFit({self.poses:,} {what}, tilt {figures(error.rms)}° (95 % within "
            f"{figures(error.bound_95)}°))"
        )

    def document(self, provenance: ProvenanceRecord | None = None) -> InertialDocument:
        """Content of the calibration file."""
        return replace(self.inertial, provenance=provenance).to_document()

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the calibration file, completely or not at all; `OutputExists` if the file exists, unless `force`."""
        write_text(inertial_record.dumps(self.document()), path, force=force)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        error = self.tilt_error
        return {
            "accelerometer": _as_dict(self.inertial.accelerometer),  # the correction, with 1 σ of each number
            "gyro": _as_dict(self.inertial.gyro),  # its offset, if one was recorded
            # degrees: error of the vertical at rest, 1 σ over all attitudes and at the worst, and the 95 % bound
            "tilt_error_deg": {"rms": error.rms, "worst": error.worst, "bound_95": error.bound_95},
            # degrees, 1 σ: of the heading, at a dip of 45°, 60° and 70°
            "heading_error_deg": {f"{dip:g}": error.heading_error_deg(dip) for dip in (45.0, 60.0, 70.0)},
            "poses": self.poses,  # still poses, or readings if each counts as a pose
            "still": self.is_still,  # whether the device was put down
            "misalignment_seen": self.sees_misalignment,  # whether the poses determine the orthogonality of the axes
            "excess": self.excess,  # ratio of residuals to the noise, 1 σ
            "gravity": self.inertial.gravity,  # m/s²: length of corrected accelerations at rest
        }


@check_keywords()
def calibrate_accelerometer(
    source: AnySource | Samples, *, columns: str | None = None, gravity: float | None = None
) -> AccelerometerFit:
    """Calibrate offsets, gains and misalignment of an accelerometer from still poses, by the length of gravity.

    Put the device down on each of its six sides for 2 s: this determines offsets and gains. Poses on edges and corners,
    twelve or more in all, determine the misalignment too. Still spans are found in the readings. If there are none,
    since the device was turned slowly, each reading counts as a pose.

    Parameters
    ----------
    source : path, file object, data frame or Samples
        A recording in any form that `flinders.open_recording` reads, with or without a magnetometer.
    columns : str, optional
        Names or numbers of the accelerometer's columns; by default they are recognised by their names.
    gravity : float, m/s²
        Gravity at the place; by default the standard 9.80665. A wrong value, by up to 0.5 %, changes all gains by the
        same factor, and no tilt.

    Raises
    ------
    MissingPose
        If the poses do not determine all offsets and gains; the error states which side to turn up next.
    NoAccelerometer
        If no columns of an accelerometer are recognised.
    FitError
        For readings that no offsets and gains can bring to the length of gravity.
    """
    length = STANDARD_GRAVITY if gravity is None else float(gravity)
    if not GRAVITY_RANGE[0] <= length <= GRAVITY_RANGE[1]:
        raise UsageError(f"gravity is {length:g} m/s²: need the gravity of the place, 9.76 to 9.84 m/s² on the ground")
    samples = source if isinstance(source, Samples) else _read(source, columns)
    if samples.acceleration is None:
        raise NoAccelerometer(f"{samples.source} has no accelerometer: name its columns", hint={"columns": None})
    poses = StillPoses.of(samples.acceleration)
    if int(poses.counts.sum()) < MIN_STILL_SHARE * len(samples):
        return _with_gyro(from_readings(samples.acceleration, gravity=length), None, samples)
    return _with_gyro(from_poses(poses, gravity=length), poses, samples)


def open_acceleration(source: AnySource, columns: str | None = None) -> tuple[Recording, bool]:
    """Open a recording, and tell whether its accelerometer is read as `field`, in place of a magnetometer.

    Raises the errors of `flinders.open_recording`, and `NoAccelerometer` if no columns of an accelerometer are
    recognised.
    """
    if columns is None:
        columns = _columns_without_magnetometer(source)
    return open_recording(source, columns=columns), columns is not None


def read_accelerations(recording: Recording, *, is_field: bool) -> Samples:
    """Read a recording of `open_acceleration`; the accelerometer is in `acceleration`."""
    samples = read_into_memory(recording)
    if is_field or (samples.nameless and samples.acceleration is None):
        return replace(samples, acceleration=samples.field)
    return samples


def _read(source: AnySource, columns: str | None) -> Samples:
    """Open and read a recording."""
    recording, is_field = open_acceleration(source, columns)
    return read_accelerations(recording, is_field=is_field)


def _columns_without_magnetometer(source: AnySource) -> str | None:
    """Numbers of the accelerometer's columns in a table without a magnetometer; None for a table with one."""
    try:
        open_recording(source)
    except NoMagnetometer as error:
        header = error.evidence.get("columns")
        names = list(header) if isinstance(header, list) else []
        found = triples(names, [meaning(name) for name in names], ACCELERATION)
        if not found:
            raise NoAccelerometer(
                f"neither magnetometer nor accelerometer among the columns {', '.join(names) or 'of the recording'}: "
                "name the three of the accelerometer",
                hint={"columns": "ax,ay,az"},
            ) from None
        return ",".join(str(cell + 1) for cell in found[0].cells)
    return None


def _with_gyro(found: AccelerometerEstimate, poses: StillPoses | None, samples: Samples) -> AccelerometerFit:
    """Result of an estimate, with the offset of the gyro if one was recorded."""
    gyro = None if samples.rate is None or poses is None else _gyro_offset(poses, samples.rate)
    inertial = Inertial(found.triad(), gyro, found.tilt_error, found.gravity)
    return AccelerometerFit(
        inertial,
        found.tilt_error,
        found.poses,
        is_still=poses is not None,
        sees_misalignment=found.has_misalignment,
        excess=found.excess,
        source=samples.source,
    )


def _gyro_offset(poses: StillPoses, rate: Floats) -> Triad | None:
    """Offset of a gyro: its mean reading while the device is still. The gains stay 1, as they are not determined."""
    offset = poses.drift_of(rate)
    return None if offset is None else Triad(np.eye(3), offset[0], "rad/s", None, offset[1])


def _as_dict(triad: Triad | None) -> dict[str, Any] | None:
    """JSON-ready fields; None without a calibration."""
    if triad is None:
        return None
    arrays = ("matrix", "matrix_sigma", "offset", "offset_sigma")
    values = {name: getattr(triad, name) for name in arrays}
    return {"unit": triad.unit, **{name: None if value is None else value.tolist() for name, value in values.items()}}


def is_inertial(path: str | os.PathLike[str]) -> bool:
    """Whether a path is the calibration file of an accelerometer; standard input is not read."""
    with contextlib.suppress(DocumentError):
        return os.fspath(path) != "-" and Path(path).is_file() and bool(inertial_record.read(path))
    return False


def read_inertial(path: str | os.PathLike[str]) -> Inertial:
    """Read the calibration file of an accelerometer; `DocumentError` if it is not one."""
    return Inertial.from_document(inertial_record.read(path))
