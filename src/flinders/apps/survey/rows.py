"""Rows that this package adds to the tables of the library, with names of its modules, imported at first use."""

TRADES = "Vehicles, boats and surveys"

PUBLIC = {"fit_survey": "calibration", "read_shots": "shots", "tolles_lawson": "aeromagnetic"}
COMMANDS = {
    "survey": (TRADES, "cli.survey", "Calibrate a cave or geological surveyor's instrument."),
    "tolles-lawson": (TRADES, "cli.tolles_lawson", "Compensate an aircraft's scalar magnetometer."),
}
SIMULATIONS = {
    "aircraft": ("Commands", "cli.simulate", "An aircraft with a scalar magnetometer, on a calibration flight.")
}
TARGETS = {"survey": "targets"}
