"""What this package adds to tables of the library, by names of its modules; nothing is imported before it is used."""

WIRE = "Sensors on a wire"

PUBLIC = {"Session": "guided"}
COMMANDS = {
    "live": (WIRE, "cli.live", "Calibrate on a page, while the sensor is turned."),
    "record": (WIRE, "cli.record", "Record a running sensor."),
    "page": (WIRE, "cli.page", "Write a page that calibrates without a program."),
}
