"""`flinders.contents` of files whose recordings are simulated: what was put into them is found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.worlds import body, table_text

import flinders
from flinders import simulate
from flinders.core.geomag import site_field
from flinders.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def test_rate_gap_range_and_coverage_are_those_of_the_recording(tmp_path: Path) -> None:
    tumble = simulate.tumble(seed=1)
    assert tumble.samples.time is not None
    late = tumble.samples.time + np.where(np.arange(3000) < 1500, 0.0, 4.0)
    simulate.write_csv(replace(tumble.samples, time=late), tmp_path / "tumble.csv")
    held = flinders.contents(tmp_path / "tumble.csv", site=site_field(47.62, -122.35, year=2025.0))
    (sensor,) = held.sensors
    assert (sensor.readings, sensor.unit, sensor.unmoved, sensor.rails) == (3000, "uT", "", ())
    assert sensor.rate_hz == pytest.approx(50.0, rel=1e-3)
    assert sensor.longest_gap_s == pytest.approx(4.02, abs=1e-3)
    assert sensor.lowest == pytest.approx(tumble.samples.field.min(axis=0), abs=1e-3)
    assert sensor.coverage is not None
    assert sensor.coverage > 0.95
    assert sensor.strength == pytest.approx(tumble.field_strength, rel=0.05)
    assert held.site is not None
    assert held.commands == ()


def test_each_magnetometer_is_gone_through_and_counts_tell_their_unit(tmp_path: Path) -> None:
    recordings, _, _ = body()
    header = ",".join(f"mag{number}_{axis}" for number in (1, 2) for axis in "xyz")
    still = np.tile([200.0, 0.0, 400.0], (len(recordings["a"]), 1)) + np.arange(len(recordings["a"]))[:, None] % 2
    table = np.column_stack([10.0 * recordings["a"].field, still])
    (tmp_path / "board.csv").write_text(table_text(header, table), encoding="utf-8")
    turned, unmoved = flinders.contents(tmp_path / "board.csv").sensors
    assert turned.unit_of_field == "counts"
    assert "unit='mG'" in turned.notes[0]
    assert turned.unmoved == ""
    assert unmoved.unmoved
    assert unmoved.coverage is None
    with pytest.raises(InputError):
        flinders.contents(tmp_path / "missing.csv")
