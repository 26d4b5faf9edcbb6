"""Who is blamed for an error: the file, the call, or this program."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.samples import written
from tests.sentences import assert_raises

import flinders
from flinders.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

TABLE = np.column_stack([0.1 * np.arange(80), np.random.default_rng(1).uniform(-400, 400, (80, 6))])


def test_a_sensor_of_a_table_is_chosen_by_a_number(tmp_path: Path) -> None:
    path = tmp_path / "two.csv"
    rows = "\n".join(",".join(f"{value:.3f}" for value in row[1:]) for row in TABLE)
    path.write_text(f"mag1_x,mag1_y,mag1_z,mag2_x,mag2_y,mag2_z\n{rows}\n")
    assert np.allclose(flinders.read(path, sensor=2, unit="mG").field, 0.1 * TABLE[:, 4:], atol=1e-3)


WRONG: list[dict[str, Any]] = [
    {"sensor": 1.5}, {"sensor": True}, {"sensor": [1]}, {"topic": 1}, {"axes": 5}, {"axes": ("x", "y", "z")},
    {"start": "1"}, {"end": [3]}, {"as_logged": "no"}, {"unit": 5}, {"scale": "a"}, {"columns": 123},
    {"pattern": 3}, {"progress": 1},
]  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG, ids=str)
@pytest.mark.parametrize("name", ["text", "hdf5"])
def test_a_wrong_argument_is_an_error_of_the_call(name: str, wrong: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        flinders.read(written(name, tmp_path, TABLE), **wrong)


@pytest.mark.parametrize("wrong", [5, None, [5], 1.5])
def test_what_is_no_recording_is_an_error_of_the_call(wrong: Any) -> None:  # noqa: ANN401
    with assert_raises(UsageError):
        flinders.read(wrong)
