"""What `flinders send` would do, shown without a board, and the help of `send` and `record`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from tests.golden.sessions import assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit

if TYPE_CHECKING:
    import pytest
    from tests.golden.sessions import Golden


def test_send_dry_run(golden: Golden) -> None:
    matrix = np.array([[1.25, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.8]])
    Calibration(matrix, np.array([12.5, -30.25, 7.0]), 50.0, raw=Unit.of("uT")).save("calibration.json")
    golden("cli/send.txt", session("flinders send --serial /dev/ttyACM0 --dry-run calibration.json"))


def test_the_page_shows_this_session(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("vehicles/send.md", request)
