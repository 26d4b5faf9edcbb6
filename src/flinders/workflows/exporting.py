"""Export of a calibration to a target, with origin, limits, and the number of the vehicle's compass.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> exported = export(fit, "arduino")
>>> exported.export.target, exported.text.splitlines()[0][:12], exported.limits
('arduino', '/*', ())
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flinders.core.files import write_bytes, write_text
from flinders.core.inertial import Inertial
from flinders.core.keywords import check_keywords
from flinders.core.short_repr import ShortRepr
from flinders.errors import UsageError
from flinders.fitting.export import export_fit, limit_lines, refuse_unfit
from flinders.fitting.fit_file import fit_for
from flinders.fitting.inertial_export import add_inertial, export_inertial, inertial_of
from flinders.fitting.measurement_noise import noise_of
from flinders.targets import find_accepting
from flinders.targets._inertial import Asked
from flinders.workflows.accelerometer import is_inertial, read_inertial

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.fitting.fit_file import AnyCalibration
    from flinders.targets import Export, MeasurementNoise


@dataclass(frozen=True, slots=True, repr=False)
class Exported(ShortRepr):
    """A calibration in the format of a target, with notes."""

    export: Export  #: content of the file, its numbers, their rounding errors, and warnings
    compass: tuple[str, ...]  #: sentences on the vehicle's compass; empty if the user named it or it is unknown
    limits: tuple[str, ...]  #: limits of the calibration, in words

    @property
    def text(self) -> str:
        """Content of the file; for a binary file, a description."""
        return self.export.text

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the file, completely or not at all.

        Raises `OutputExists` if the file exists, unless `force`, and `OutputError` if the file cannot be written.
        """
        if self.export.data is None:
            write_text(self.export.text, path, force=force)
        else:
            write_bytes(self.export.data, path, force=force)


@check_keywords()
def export(
    calibration: AnyCalibration | Inertial,
    target: str,
    *,
    compass: int | None = None,
    mounting: str | None = None,
    name: str | None = None,
    lossy: bool = False,
    sensors: Sequence[str] = (),
    imu: int | None = None,
    noise: bool = False,
) -> Exported:
    """Export a calibration to a target (an autopilot, a device, a program), with the claim of its fit.

    Comments state origin, claim and limits. Code contains limits by which disturbed readings are detected. On a
    vehicle, the parameters are those of the compass that was recorded.

    Parameters
    ----------
    calibration : Fit, Calibration, Inertial or path
        Calibration; a refused one is not exported. A calibration of an accelerometer, or its file, is exported alone.
    target : str
        One of `flinders.targets.registry`, such as ``"arduino"``, ``"esphome"``, ``"c"``.
    compass : int, optional
        Number of the vehicle's compass; by default that in the log.
    mounting : str, optional
        Mounting of the compass at the time of the recording, in the autopilot's words; by default that in the log.
    name : str, optional
        Prefix of names in code.
    lossy : bool
        Export even if parameters that the target cannot represent cause more than 0.5° of heading or tilt error.
    sensors : sequence of str
        ``accelerometer``, ``gyro``: also export the calibration of these, from a fit with aiding sensors.
    imu : int, optional
        Number of the vehicle's IMU; by default the first.
    noise : bool
        Also export the heading error as parameters of the vehicle's estimator (EKF2 of PX4, EKF3 of ArduPilot).

    Raises
    ------
    NotExportable, UnitError
        If the target cannot represent the calibration; for a refused calibration, or one from readings as logged.
    UsageError
        For an unknown target; for a compass, mounting or name that the target does not accept; for a calibration of
        several compasses without `compass`.

    Examples
    --------
    >>> from flinders.core.calibration import Calibration
    >>> from flinders.core.units import Unit
    >>> known = Calibration([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [10, 0, 0], 50.0, raw=Unit.of("uT"))
    >>> export(known, "arduino").text.splitlines()[0][:12]
    '/*'
    """
    chosen, asked = find_accepting(target, compass=compass, code_name=name, noise=noise), Asked(imu, name)
    if isinstance(calibration, str | os.PathLike) and is_inertial(calibration):
        calibration = read_inertial(calibration)
    if isinstance(calibration, Inertial):
        if noise or sensors or compass is not None or mounting is not None:
            raise UsageError("the calibration is that of an accelerometer: leave out the options for a compass")
        return Exported(export_inertial(chosen, calibration, asked, lossy=lossy), (), ())
    fit = fit_for(calibration)
    refuse_unfit(fit)
    found = inertial_of(fit, chosen, sensors)
    made, notes = export_fit(fit, chosen, compass=compass, lossy=lossy, mounting=mounting, name=name, noise=noise)
    made = add_inertial(made, chosen, found, asked, lossy=lossy)
    return Exported(made, tuple(notes), tuple(limit_lines(fit)))


def measurement_noise(calibration: AnyCalibration) -> MeasurementNoise | None:
    """Measurement noise of corrected readings for a filter: white noise, and the error that the calibration leaves.

    None if the calibration states no noise or no uncertainty, such as an imported one.

    Parameters
    ----------
    calibration : Fit, Calibration or path

    Returns
    -------
    MeasurementNoise or None
        In the calibration's unit, and in degrees of a level heading; 1 σ.

    Raises
    ------
    DocumentError
        For a file that cannot be read.

    Examples
    --------
    >>> from flinders import fit, simulate
    >>> noise = measurement_noise(fit(simulate.tumble(seed=1).samples))
    >>> round(noise.heading_reading_deg, 1), round(noise.heading_calibration_deg, 2)
    (1.2, 0.06)
    """
    return noise_of(fit_for(calibration))
