"""Headings over a log with the onboard calibration and with a new one, and the yaw of the vehicle's attitude.

>>> from dataclasses import replace
>>> from flinders.core.calibration import Calibration
>>> from flinders import simulate
>>> turn = simulate.tumble(seed=1, motion="level")
>>> old = Calibration(np.eye(3), turn.sensor.offset, 50.0, raw=turn.samples.unit)
>>> history = heading_history(turn.samples, old, replace(old, offset=old.offset + [2.0, 0.0, 0.0]))
>>> history.levelled_by, history.yaw_deg, bool(4.0 < np.abs(history.difference_deg).max() < 12.0)
('acceleration', None, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from flinders.core.compensation import Compensator
from flinders.core.geomag import recorded_field
from flinders.core.joining import read_into_memory, single_recordings
from flinders.errors import InputError
from flinders.geometry.angles import wrap_180, wrap_360
from flinders.geometry.quaternions import inverse, rotate_vectors
from flinders.heading.attitude import level_heading_deg, magnetic_heading_deg
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording, Samples

Levelling = Literal["attitude", "acceleration", "nothing"]

FORWARD, DOWN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class HeadingHistory:
    """Headings of each reading in degrees; NaN if missing."""

    seconds: Floats  #: (N,): s since the first reading
    old_deg: Floats  #: (N,): with the onboard calibration, in [0, 360)
    new_deg: Floats  #: (N,): with the new calibration, in [0, 360)
    yaw_deg: Floats | None  #: (N,): yaw of the attitude, in [0, 360); None if none was logged
    levelled_by: Levelling  #: source of the vertical for the tilt compensation
    declination_deg: float | None  #: declination that true headings include; None for magnetic headings
    is_vehicle: bool  #: whether headings are those of the vehicle, and not those of the compass's x axis

    @property
    def difference_deg(self) -> Floats:
        """(N,) headings with the old calibration minus those with the new one, −180 to 180 degrees."""
        return wrap_180(self.old_deg - self.new_deg)


def heading_history(recording: Recording, old: Calibration, new: Calibration) -> HeadingHistory | None:
    """Compute headings over a log with two calibrations.

    Tilt is compensated by the logged attitude, else by the accelerometer; without either, the vehicle is assumed to be
    level. Headings are true if the log states its place. They are those of the vehicle if the mounting of the compass
    is known, else those of the compass's x axis.

    Parameters
    ----------
    recording : Recording
        One log with ascending times. For any other recording the result is None.
    old, new : Calibration
        Their disturbances are compensated if they were logged; otherwise the reference values are assumed.
    """
    parts, samples = list(single_recordings(recording)), read_into_memory(recording)
    time = samples.time
    if len(parts) > 1 or time is None or len(time) < 2 or not (np.diff(time) >= 0.0).all() or time[-1] <= time[0]:
        return None
    log = getattr(parts[0], "recording", parts[0])
    turn, is_vehicle = _vehicle_rotation(log, samples)
    site, (levelled_by, force) = recorded_field(log), _force(samples)
    declination_deg = None if site is None else site.declination_deg
    turned, added = None if force is None else force @ turn.T, declination_deg or 0.0
    by_old, by_new = (
        wrap_360(_magnetic_headings(_correct(samples, each) @ turn.T, turned) + added) for each in (old, new)
    )
    yaw = None if levelled_by != "attitude" else _yaw(samples, turn)
    return HeadingHistory(time - time[0], by_old, by_new, yaw, levelled_by, declination_deg, is_vehicle)


def _vehicle_rotation(log: object, samples: Samples) -> tuple[Floats, bool]:
    """(3, 3) rotation from the axes of the readings to those of the vehicle, and whether the rotation is known."""
    angles = getattr(log, "mounting", None)
    if samples.frame == "vehicle":
        return np.eye(3), samples.axes.is_identity
    if angles is None or not samples.axes.is_identity:
        return np.eye(3), False
    return euler(*angles), True


def _correct(samples: Samples, calibration: Calibration) -> Floats:
    """(N, 3) corrected readings; a disturbance that was not logged has its reference value."""
    try:
        return calibration.affine.apply(Compensator(calibration)(samples).field)
    except InputError:
        return calibration.at().affine.apply(samples.field)


def _force(samples: Samples) -> tuple[Levelling, Floats | None]:
    """Source of the vertical, and (N, 3) specific force in any unit; None instead of the force for a level vehicle."""
    attitude, acceleration = samples.attitude, samples.acceleration
    if attitude is not None and np.isfinite(attitude).all(axis=1).any():
        return "attitude", -rotate_vectors(inverse(attitude), DOWN)
    if acceleration is not None and np.isfinite(acceleration).all(axis=1).any():
        return "acceleration", acceleration
    return "nothing", None


def _magnetic_headings(corrected: Floats, force: Floats | None) -> Floats:
    """(N,) magnetic headings of the x axis."""
    return level_heading_deg(corrected) if force is None else magnetic_heading_deg(corrected, force)


def _yaw(samples: Samples, turn: Floats) -> Floats:
    """(N,) headings of the x axis, as yaw of the attitude."""
    assert samples.attitude is not None
    north, east, _ = rotate_vectors(samples.attitude, FORWARD @ turn).T
    return wrap_360(np.rad2deg(np.arctan2(east, north)))
