"""What a station keeps is what `flinders fleet` and `flinders drift` read."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
from tests.live.test_station import Line, lines_of
from tests.program import flinders_

from flinders import simulate
from flinders.apps.fleet.results import NAMES, UnitResults
from flinders.apps.live.station.table import COLUMNS

if TYPE_CHECKING:
    from pathlib import Path

OWN = {"matrix", "offset", "covariance", "batch", "cause", "number", "limit"}


def test_recordings_of_a_station_are_a_fleet_with_its_numbers(tmp_path: Path) -> None:
    with Line(tmp_path / "line") as line:
        for serial, seed in (("A17", 3), ("B02", 8)):
            line.do("next")
            line.test(serial, lines_of(simulate.tumble(seed=seed, noise=0.3).samples))
        rows = line.rows
    table = tmp_path / "fleet.parquet"
    ended = flinders_(
        "fleet", str(tmp_path / "line" / "recordings"), "-o", str(table), "--unit", "uT", "--workers", "0"
    )
    assert ended.code == 0, ended.err
    fleet = UnitResults.read(table)
    assert fleet.unit.tolist() == [row["unit"] for row in rows]
    offsets = np.array([[float(row[f"offset_{axis}"]) for axis in "xyz"] for row in rows])
    npt.assert_allclose(fleet.offset, offsets, rtol=1e-6)
    npt.assert_allclose(fleet.worst_deg, [float(row["worst_deg"]) for row in rows], rtol=1e-6)
    assert flinders_("drift", str(table)).code == 0


def test_columns_that_a_fleet_has_too_have_its_names(tmp_path: Path) -> None:
    assert set(NAMES) - set(COLUMNS) == OWN
    with Line(tmp_path) as line:
        line.test("A17", lines_of())
        text = (tmp_path / "table.csv").read_text(encoding="utf-8")
    assert next(csv.reader(text.splitlines())) == list(COLUMNS)
