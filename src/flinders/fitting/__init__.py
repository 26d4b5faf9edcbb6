"""The use case: `calibrate.fit` takes readings to a `Fit`, a calibration with its uncertainty and its verdict."""
