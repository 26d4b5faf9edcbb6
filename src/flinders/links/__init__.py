"""Sensors and boards on a wire: sources of bytes, feeds of readings, recordings, and calibrations sent to a board."""
