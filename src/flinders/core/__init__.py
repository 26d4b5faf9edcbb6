"""Basic types that every other package uses: samples, calibrations, units, axes, the earth's field, files."""
