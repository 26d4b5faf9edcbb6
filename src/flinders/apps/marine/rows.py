"""Rows that this package adds to the tables of the library, with names of its modules, imported at first use."""

TRADES = "Vehicles, boats and surveys"

PUBLIC = {"swing": "compass_swing"}
COMMANDS = {"swing": (TRADES, "cli.swing", "Deviation of a compass at known headings, and its card.")}
COURSES = {"compass_log": "compass_log"}
KNOWN_TEXTS = {"known_texts": "known_texts"}
REMARKS = {"course log": "such as of a boat: NMEA 0183, NMEA 2000 (candump) or Signal K"}
