"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

COMMANDS = {
    "firmware": ("Sensors on a wire", "cli.firmware", "Write the calibrator for a microcontroller."),
    "component": ("Calibrate and use", "cli.component", "Write a calibration as a component of firmware."),
}
