"""Vehicles with an autopilot or ROS: reading logs and parameters, and sending a calibration.

For users of ArduPilot, PX4, Betaflight, INAV, Paparazzi or ROS.

- ``readers``: logs of ArduPilot, PX4 and MAVLink, bags of ROS, each with the calibration in force
- ``targets``: parameters of each autopilot, with the mounting of the compass in the autopilot's numbering
- `mavlink`, `mavlink_parameters`, `telemetry`: a vehicle on a link: parameters, and a feed of its compass
- ``ros2``: topics of ROS 2 over DDS, read and published, and a node for ROS
- `sending`: packet or parameter plan of a calibration; ``cli``: the commands
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.vehicles.mavlink import Vehicle as Vehicle
    from flinders.apps.vehicles.mavlink_parameters import ParameterPlan as ParameterPlan
    from flinders.apps.vehicles.sending import board_packet as board_packet
    from flinders.apps.vehicles.sending import parameter_plan as parameter_plan

PUBLIC = {
    "ParameterPlan": "mavlink_parameters",
    "Vehicle": "mavlink",
    "board_packet": "sending",
    "parameter_plan": "sending",
}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
