"""Sensors and boards on a wire: where bytes come from, feeds of readings, and a calibration sent to a board."""
