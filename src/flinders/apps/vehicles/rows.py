"""Rows that this package adds to the library's tables, as names of modules, imported on first use."""

GROUP = "Vehicles, boats and surveys"

COMMANDS = {
    "ros-package": (GROUP, "cli.ros_package", "Write a ROS 2 package with a node that calibrates."),
    "send": (GROUP, "cli.send", "Send a calibration to a board or vehicle."),
}
FEEDS = {"mavlink": "telemetry", "ros2": "ros2.feed"}
PUBLISHERS = {"ros2": "ros2.publisher"}
READERS = {
    "dataflash": "readers.dataflash",
    "ros": "readers.ros",
    "tlog": "readers.tlog",
    "ulog": "readers.ulog",
}
TARGETS = {
    "ardupilot": "targets.ardupilot",
    "betaflight": "targets.betaflight",
    "betaflight_model": "targets.betaflight_model",
    "inav": "targets.inav",
    "paparazzi": "targets.paparazzi",
    "px4": "targets.px4",
    "ros": "targets.ros",
    "ros_mounting": "targets.ros_mounting",
}
