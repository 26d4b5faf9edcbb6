"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

MANY = "Many units"

PUBLIC = {"fit_many": "worker"}
COMMANDS = {
    "fleet": (MANY, "cli.fleet", "Calibrate many units at once: one table out."),
    "drift": (MANY, "cli.drift", "Say which units of a fleet have changed, and when."),
}
