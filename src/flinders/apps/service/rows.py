"""Rows that this package adds to the library's tables, as names of modules, imported on first use."""

WIRE = "Sensors on a wire"

COMMANDS = {"watch": (WIRE, "cli.watch", "Keep a sensor calibrated while its vehicle works.")}
SIMULATIONS = {"boat": ("Commands", "cli.simulate", "The compass of a boat for some days, for an online calibration.")}
