"""Motors in the parameters of an autopilot, which has room for one of current and throttle.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.disturbance import Driver
>>> both = (Driver("current", [0.5, 0, 0], highest=20), Driver("throttle", [3, 0, 0], highest=1))
>>> plain, motor = followed(Calibration(np.eye(3), [10, 0, 0], 50.0, drivers=both))
>>> plain.offset, motor.name
(array([10.,  0.,  0.]), 'current')
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.disturbance import Driver

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

MOTORS: Final = ("current", "throttle")
"""What autopilots follow, the better witness first."""


def followed(calibration: Calibration) -> tuple[Calibration, Driver | None]:
    """The plain calibration of motors at rest, all else at its reference, and the driver that an autopilot follows."""
    ours = {driver.name: driver for driver in calibration.drivers}
    motor = next((ours[name] for name in MOTORS if name in ours), None)
    if motor is None:
        return calibration.at(), None
    return calibration.at(**{motor.name: 0.0}), motor


def read_motor(name: str, per_unit: Floats) -> tuple[Driver, ...]:
    """What an autopilot takes off for its motors, as a driver; none where it is nothing.

    Parameters do not say at which currents they were found; a throttle goes from 0 to 1.

    >>> print(*read_motor("current", np.array([0.5, 0.0, -0.3])))
    current: 0.5, 0, -0.3 per A, from 0 A, range unknown
    """
    if not np.any(per_unit):
        return ()
    return (Driver(name, per_unit, highest=1.0 if name == "throttle" else 0.0),)


def in_recorded_axes(calibration: Calibration, driver: Driver) -> Floats:
    """(3,) offset per unit of a driver in the axes as recorded, in the calibration's unit."""
    back: Floats = calibration.axes.apply(np.eye(3)) @ driver.per_unit
    return back
