"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

MANY = "Many units"

PUBLIC = {"fit_many": "worker"}
COMMANDS = {
    "fleet": (MANY, "cli.fleet", "Calibrate many units at once: one table out."),
    "fleet at": (MANY, "cli.fleet_at", "Write the calibration that a unit had at a date."),
    "drift": (MANY, "cli.drift", "Say which units of a fleet have changed, and when."),
}
SIMULATIONS = {"fleet": ("Commands", "cli.simulate", "Units of a line, some good and some not, to try a fleet.")}
CONTENTS = {"fleet": "contents"}
