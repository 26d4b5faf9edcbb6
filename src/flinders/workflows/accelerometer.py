"""Calibrate an accelerometer by itself, from still poses of the device, and the offset of a gyro beside it.

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
from flinders.core.joining import in_memory
from flinders.core.keywords import spell_checked
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

MIN_STILL: Final = 0.1
"""Share of the readings that still poses hold; with less, the device was turned slowly and not put down."""
GRAVITIES: Final = 9.7, 9.9
"""m/s²: between them lies gravity anywhere on the ground."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AccelerometerFit:
    """A calibrated accelerometer, with the error of its vertical."""

    inertial: Inertial  #: the correction of the accelerometer, and of a gyro where one was recorded
    tilt_error: TiltError  #: of the vertical at rest, within the accelerometer's own axes
    poses: int  #: still poses, or readings that each count as one
    is_still: bool  #: the device was put down; otherwise each reading counts as a pose, and residuals tell the noise
    sees_misalignment: bool  #: the poses tell how square the axes are; else the claim has 0.01 rad, 1 σ, for it
    excess: float  #: by what factor residuals are larger than the noise within poses explains, 1 σ
    source: str  #: where the readings came from

    def __repr__(self) -> str:
        what = "poses" if self.is_still else "readings"
        error = self.tilt_error
        return (
            f"AccelerometerFit({self.poses:,} {what}, tilt {figures(error.rms)}° (95 % within "
            f"{figures(error.bound_95)}°))"
        )

    def document(self, provenance: ProvenanceRecord | None = None) -> InertialDocument:
        """Content of the file."""
        return replace(self.inertial, provenance=provenance).to_document()

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the file, whole or not at all; raises `OutputExists` for a file that is there, unless `force`."""
        write_text(inertial_record.dumps(self.document()), path, force=force)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        error = self.tilt_error
        return {
            "accelerometer": _as_dict(self.inertial.accelerometer),  # the correction, and 1 σ of each number
            "gyro": _as_dict(self.inertial.gyro),  # its offset, where one was recorded
            # degrees: vertical at rest, 1 σ over all attitudes and at the worst, and what 95 % stay within
            "tilt_error_deg": {"rms": error.rms, "worst": error.worst, "bound_95": error.bound_95},
            # degrees, 1 σ: of the heading, at a dip of 45°, 60° and 70°
            "heading_error_deg": {f"{dip:g}": error.heading_error_deg(dip) for dip in (45.0, 60.0, 70.0)},
            "poses": self.poses,  # still poses, or readings that each count as one
            "still": self.is_still,  # whether the device was put down
            "misalignment_seen": self.sees_misalignment,  # whether the poses tell how square the axes are
            "excess": self.excess,  # by what factor residuals are larger than the noise explains, 1 σ
            "gravity": self.inertial.gravity,  # m/s²: length of corrected accelerations at rest
        }


@spell_checked()
def calibrate_accelerometer(
    source: AnySource | Samples, *, columns: str | None = None, gravity: float | None = None
) -> AccelerometerFit:
    """Find offsets, gains and misalignment of an accelerometer from still poses, by the length of gravity.

    Put the device down on each of its six sides for two seconds: that tells offsets and gains. Poses on edges and
    corners, twelve or more in all, tell the misalignment too. Still spans are found in the readings. Where there is
    none, a device that was turned slowly, each reading counts as a pose.

    Parameters
    ----------
    source : path, file object, data frame or Samples
        A recording; any that `flinders.open_recording` takes, with or without a magnetometer.
    columns : str, optional
        Names or numbers of the accelerometer's columns; found by their names where not given.
    gravity : float, m/s²
        That of the place; the standard 9.80665 where not given. An error of it, up to 0.5 %, goes into all gains alike
        and into no tilt.

    Raises
    ------
    MissingPose
        Where the poses do not tell all offsets and gains; it says which side to turn up next.
    NoAccelerometer
        Where no columns of one are recognised.
    FitError
        For readings that no offsets and gains make as long as gravity.
    """
    length = STANDARD_GRAVITY if gravity is None else float(gravity)
    if not GRAVITIES[0] <= length <= GRAVITIES[1]:
        raise UsageError(f"gravity is {length:g}: it lies between 9.76 and 9.84 m/s² anywhere on the ground")
    samples = source if isinstance(source, Samples) else _read(source, columns)
    if samples.acceleration is None:
        raise NoAccelerometer(f"{samples.source} has no accelerometer: say which columns it is", hint={"columns": None})
    poses = StillPoses.of(samples.acceleration)
    if int(poses.counts.sum()) < MIN_STILL * len(samples):
        return _fit(from_readings(samples.acceleration, gravity=length), None, samples)
    return _fit(from_poses(poses, gravity=length), poses, samples)


def open_acceleration(source: AnySource, columns: str | None = None) -> tuple[Recording, bool]:
    """Open a recording, and tell whether its accelerometer stands in the place of the magnetometer, as `field`.

    Raises as `flinders.open_recording`, and `NoAccelerometer` where no columns of one are recognised.
    """
    if columns is None:
        columns = _columns_without_magnetometer(source)
    return open_recording(source, columns=columns), columns is not None


def accelerations_of(recording: Recording, *, is_field: bool) -> Samples:
    """Read what `open_acceleration` opened, with the accelerometer as `acceleration`."""
    samples = in_memory(recording)
    if is_field or (samples.nameless and samples.acceleration is None):
        return replace(samples, acceleration=samples.field)
    return samples


def _read(source: AnySource, columns: str | None) -> Samples:
    """Read a recording that was not opened yet."""
    recording, is_field = open_acceleration(source, columns)
    return accelerations_of(recording, is_field=is_field)


def _columns_without_magnetometer(source: AnySource) -> str | None:
    """Numbers of the accelerometer's columns in a table without a magnetometer; None where that is recognised."""
    try:
        open_recording(source)
    except NoMagnetometer as error:
        header = error.evidence.get("columns")
        names = list(header) if isinstance(header, list) else []
        found = triples(names, [meaning(name) for name in names], ACCELERATION)
        if not found:
            raise NoAccelerometer(
                f"neither magnetometer nor accelerometer among the columns {', '.join(names) or 'of the recording'}: "
                "say which three are the accelerometer's",
                hint={"columns": "ax,ay,az"},
            ) from None
        return ",".join(str(cell + 1) for cell in found[0].cells)
    return None


def _fit(found: AccelerometerEstimate, poses: StillPoses | None, samples: Samples) -> AccelerometerFit:
    """What is found, with the gyro's offset where one was recorded."""
    gyro = None if samples.rate is None or poses is None else _gyro(poses, samples.rate)
    inertial = Inertial(found.triad(), gyro, found.tilt_error, found.gravity)
    return AccelerometerFit(
        inertial,
        found.tilt_error,
        found.poses,
        is_still=poses is not None,
        sees_misalignment=found.sees_misalignment,
        excess=found.excess,
        source=samples.source,
    )


def _gyro(poses: StillPoses, rate: Floats) -> Triad | None:
    """The offset of a gyro, which reads it wherever the device is still; its gains stay 1 and unknown."""
    offset = poses.drift_of(rate)
    return None if offset is None else Triad(np.eye(3), offset[0], "rad/s", None, offset[1])


def _as_dict(triad: Triad | None) -> dict[str, Any] | None:
    """JSON-ready."""
    if triad is None:
        return None
    arrays = ("matrix", "matrix_sigma", "offset", "offset_sigma")
    values = {name: getattr(triad, name) for name in arrays}
    return {"unit": triad.unit, **{name: None if value is None else value.tolist() for name, value in values.items()}}


def is_inertial(path: str | os.PathLike[str]) -> bool:
    """Whether a path leads to the file of an accelerometer; standard input is left unread."""
    with contextlib.suppress(DocumentError):
        return os.fspath(path) != "-" and Path(path).is_file() and bool(inertial_record.read(path))
    return False


def read_inertial(path: str | os.PathLike[str]) -> Inertial:
    """Read such a file; raises `DocumentError`."""
    return Inertial.from_document(inertial_record.read(path))
