"""What `flinders info` and `flinders calibrate --sensor all` print, to the letter, as docs/cli.md shows it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.flight_log import dataflash
from tests.golden.sessions import session

from flinders import simulate

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def recordings_of_80_columns() -> None:
    """A log with two compasses and a table with one, in the working directory."""
    Path("flight.bin").write_bytes(b"".join(dataflash()))
    field = simulate.tumble(seed=2).samples.field
    np.savez("bench.npz", t=np.arange(len(field)) / 50, mag=field.round(2))


def test_info(golden: Golden) -> None:
    golden("cli/info.txt", session("flinders info flight.bin"))


def test_info_of_a_table(golden: Golden) -> None:
    golden("cli/info-table.txt", session("flinders info bench.npz --at 43.77,11.26 --date 2026-06-01"))


def test_all_sensors(golden: Golden) -> None:
    line = "flinders calibrate flight.bin --sensor all -o compass-{sensor}.json"
    golden("cli/sensor-all.txt", session(line, code=3))
