"""Rows that this package adds to the library's tables, as names of modules, imported on first use."""

WIRE = "Sensors on a wire"

PUBLIC = {"Session": "guided", "gauge_study": "station.gauge"}
COMMANDS = {
    "live": (WIRE, "cli.live", "Calibrate on a page, while the sensor is turned."),
    "station": (WIRE, "cli.station", "Test units of a production line, one after the other."),
    "record": (WIRE, "cli.record", "Record a running sensor."),
    "page": (WIRE, "cli.page", "Write a page that calibrates without a program."),
    "gauge-study": ("Many units", "cli.gauge_study", "State repeatability and reproducibility of a station."),
    "certificate": ("Calibrate and use", "cli.certificate", "Write a Digital Calibration Certificate (DCC)."),
}
