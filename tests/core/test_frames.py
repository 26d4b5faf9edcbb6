"""In which axes readings are that a calibration is for."""

from __future__ import annotations

import numpy as np

from flinders.core.calibration import Calibration


def test_a_chain_of_calibrations_is_for_the_readings_of_its_first() -> None:
    first = Calibration(np.diag([1.1, 0.9, 1.0]), np.array([1.0, 2, 3]), 49.0, frame="vehicle")
    second = Calibration(np.diag([1.01, 1.0, 0.99]), np.array([0.1, 0, 0]), 49.0)
    assert (second @ first).frame == "vehicle"
