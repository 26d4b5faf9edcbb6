"""What `flinders drift` prints of a fleet, to the letter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.drift import Fleet, simulated
from tests.golden.sessions import session

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


parquet = pytest.importorskip("pyarrow.parquet")


def test_a_fleet_in_which_something_was_moved(golden: Golden) -> None:
    rows, _ = simulated(Fleet(units=200, step_deg=3.0), np.random.default_rng(3))
    parquet.write_table(rows.to_arrow(), Path("calibrations.parquet"))
    golden("cli/drift.txt", session("flinders drift calibrations.parquet", code=3))
