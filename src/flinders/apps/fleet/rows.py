"""Rows that this package adds to the tables of the library, with names of its modules, imported at first use."""

MANY = "Many units"

PUBLIC = {"fit_many": "worker"}
COMMANDS = {
    "fleet": (MANY, "cli.fleet", "Calibrate many units at once: one table out."),
    "fleet at": (MANY, "cli.fleet_at", "Write the calibration that a unit had at a date."),
    "drift": (MANY, "cli.drift", "List the units of a fleet that have changed, and when."),
}
SIMULATIONS = {"fleet": ("Commands", "cli.simulate", "Units of a line, some good and some not, to try a fleet.")}
CONTENTS = {"fleet": "contents"}
