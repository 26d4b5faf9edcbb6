"""What `flinders info` and `flinders calibrate --sensor all` print of a log, to the letter, as docs/cli/ shows it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.flight_log import dataflash
from tests.golden.sessions import session

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def log(page_of_80_columns: None) -> None:
    """A log with two compasses, in the working directory."""
    Path("flight.bin").write_bytes(b"".join(dataflash()))


def test_info(golden: Golden) -> None:
    golden("cli/info.txt", session("flinders info flight.bin"))


def test_all_sensors(golden: Golden) -> None:
    line = "flinders calibrate flight.bin --sensor all -o compass-{sensor}.json"
    golden("cli/sensor-all.txt", session(line, code=3))
