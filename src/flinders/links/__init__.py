"""Sensors and boards on a wire: byte sources, feeds of readings, and sending a calibration to a board."""
