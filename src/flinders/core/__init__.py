"""What every other package speaks of: samples, calibrations, units, axes, the earth's field, files."""
