"""Vehicles with an autopilot or ROS: their logs, their parameters, and a calibration sent to them.

For whoever flies, drives or sails with ArduPilot, PX4, Betaflight, INAV, Paparazzi or ROS.

- ``readers``: logs of ArduPilot, PX4 and MAVLink, bags of ROS, each with the calibration that was in force
- ``targets``: parameters of each autopilot, with the mounting of the compass as its number
- `mavlink`, `mavlink_parameters`, `telemetry`: a vehicle on a link, its parameters, its compass as a feed
- ``cli``: the command that sends a calibration
"""
