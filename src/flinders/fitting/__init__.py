"""Fit of readings: `calibrate.fit` makes a `Fit`, which is a calibration with its uncertainty and verdict."""
