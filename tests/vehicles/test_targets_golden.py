"""Calibrations exported to autopilots and read back, to the letter; docs/targets.md shows these files."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def calibrations(page_of_80_columns: None) -> None:
    """With soft iron all over, and along the axes alone; in milligauss and in counts."""
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(np.diag([0.97, 1.05, 0.98]), 10.01 * offset, 494.0, raw=Unit.of("counts")).save("counts.json")


def test_soft_iron_that_has_no_room(golden: Golden) -> None:
    golden("cli/target-refused.txt", session("flinders export --for betaflight counts.json -o mag.txt", code=4))


def test_a_rotation_becomes_the_mounting(golden: Golden) -> None:
    turned = euler(3.0, -8.0, 40.0) @ np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    found = Calibration(turned, np.array([-69.8, 68.9, -5.6]), 49.4, rotation="estimated", raw=Unit.of("G"))
    found.save("turned.json")
    golden("cli/mounting.txt", session("flinders export --for px4-shell --mounting YAW_270 turned.json"))


def test_a_rotation_in_the_settings_of_systems(golden: Golden) -> None:
    turned = euler(3.0, -8.0, 40.0) @ np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    found = Calibration(turned, np.array([-69.8, 68.9, -5.6]), 49.4, rotation="estimated", raw=Unit.of("mG"))
    found.save("turned.json")
    golden("cli/mounting-iio.txt", session("flinders export --for iio-mount-matrix turned.json"))
    golden("cli/mounting-transform.txt", session("flinders export --for static-transform turned.json"))
    golden("cli/mounting-refused.txt", session("flinders export --for zephyr-axis-align turned.json", code=4))


def test_the_sessions_about_mountings_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("vehicles/mounting.md", request, least=4)


def test_there_and_back(golden: Golden) -> None:
    lines = (
        "flinders export --for ardupilot --compass 2 calibration.json -o compass.param",
        "flinders import compass.param -o back.json",
    )
    golden("cli/import.txt", session(*lines))
