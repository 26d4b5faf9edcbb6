"""What `flinders fleet` prints, to the letter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.golden.sessions import assert_sessions_are_real, session

from flinders import simulate

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


pytest.importorskip("pyarrow")


@pytest.fixture(autouse=True)
def logs(page_of_80_columns: None) -> None:
    """Five vehicles, of which one was hardly turned and one wrote half a file."""
    for place, vehicle in enumerate(("V101", "V102", "V103", "V104")):
        for seed, day in enumerate(("2026-03-01", "2026-06-01")):
            field = simulate.tumble(seed=10 * place + seed, n=400, motion="uniform").samples.field
            rows = [",".join(f"{value:.3f}" for value in row) for row in field]
            short = rows[:6] if (vehicle, day) == ("V103", "2026-06-01") else rows
            Path("logs", vehicle).mkdir(parents=True, exist_ok=True)
            text = "\n".join(["mag_x_uT,mag_y_uT,mag_z_uT", *short, ""])
            Path("logs", vehicle, f"{day}.csv").write_text(text, encoding="utf-8")
    Path("logs", "V104", "2026-06-01.csv").write_bytes(b"")
    Path("logs", "notes.md").write_text("March and June\n", encoding="utf-8")


def test_a_fleet_with_all_that_may_happen(golden: Golden, request: pytest.FixtureRequest) -> None:
    golden("cli/fleet.txt", session("flinders fleet logs -o calibrations.parquet --workers 0", code=3))
    assert_sessions_are_real("fleet/fleet.md", request)
