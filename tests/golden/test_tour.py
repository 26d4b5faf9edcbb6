"""What the program says of one real recording, to the letter, as docs/tour.md shows it."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from tests.golden.sessions import Golden, assert_sessions_are_real, session

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pytest


def test_a_flight_log_from_file_to_vehicle(
    golden: Golden, recordings: Callable[[str], Path], request: pytest.FixtureRequest
) -> None:
    shutil.copy(recordings("dronekit_log171_3mags/log171.bin"), "log171.bin")
    golden("cli/tour-info.txt", session("flinders info log171.bin"))
    golden("cli/tour-check.txt", session("flinders check log171.bin", code=4))
    golden("cli/tour-alone.txt", session("flinders calibrate log171.bin --sensor 1 -o alone.json", code=3))
    aided = "flinders calibrate log171.bin --sensor 1 --with current -o compass.json"
    golden("cli/tour-aided.txt", session(aided, code=3))
    golden("cli/tour-compare.txt", session("flinders compare alone.json compass.json", code=3))
    golden("cli/tour-export.txt", session("flinders export --for ardupilot compass.json -o compass.param"))
    golden("cli/tour-back.txt", session("flinders import compass.param -o on-board.json"))
    assert_sessions_are_real("tour.md", request, least=6)
