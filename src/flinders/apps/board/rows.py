"""Rows that this package adds to the library's tables, as names of modules, imported on first use."""

COMMANDS = {
    "firmware": ("Sensors on a wire", "cli.firmware", "Write the calibrator for a microcontroller."),
    "component": ("Calibrate and use", "cli.component", "Write a calibration as a component of firmware."),
}
