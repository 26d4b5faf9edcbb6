"""What is printed of the calibration that was on board, to the letter, as docs/vehicles/onboard.md shows it."""

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
    """A log with two compasses, of which the first had offsets on board, in the working directory."""
    Path("flight.bin").write_bytes(b"".join(dataflash()))


def test_check_of_a_log_alone(golden: Golden) -> None:
    golden("cli/onboard-check.txt", session("flinders check flight.bin --sensor 1", code=4))


def test_import_of_a_log(golden: Golden) -> None:
    golden("cli/onboard-import.txt", session("flinders import flight.bin -o on-board.json"))
