"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

COMMANDS = {"send": ("Vehicles, boats and surveys", "cli.send", "Send a calibration to a board or vehicle.")}
FEEDS = {"mavlink": "telemetry"}
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
