"""`flinders.fit_many`: files and frames in, a table of Arrow out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.fitting.test_python_door import FRAMES, pyarrow

import flinders
from flinders.simulate.recording import write_csv

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.core.samples import Samples


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=1).samples


def test_a_fit_of_many_takes_files_and_frames(samples: Samples, tmp_path: Path) -> None:
    write_csv(samples, tmp_path / "A1.csv")
    rows = flinders.fit_many({"A1": tmp_path / "A1.csv", "A2": FRAMES["pandas"](samples), "A3": "missing.csv"})
    assert rows.verdict.tolist() == ["good", "good", "failed"]
    assert rows.code.tolist() == ["", "", "unreadable"]


def test_rows_of_a_fleet_are_a_table_of_arrow(samples: Samples) -> None:
    rows = flinders.fit_many({"A1": samples})
    assert pyarrow.table(rows).equals(rows.to_arrow())
    assert rows.to_pandas().unit.tolist() == ["A1"]
