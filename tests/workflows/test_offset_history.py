"""Histories of an offset, read from what a calibration that goes on has written."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_raises
from tests.worlds import walked_days

from flinders import OffsetHistory, OnlineCalibration
from flinders.errors import DocumentError
from flinders.workflows.offset_history import adoption_file_name, find_histories, is_history

if TYPE_CHECKING:
    from pathlib import Path

WALK = 0.2


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """A folder with a state, adopted calibrations and lines of JSON of two days, and what the offset was."""
    folder = tmp_path_factory.mktemp("kept")
    (folder / "adopted").mkdir()
    time, field, begins, offsets = walked_days(1, days=2.0, walk=WALK)
    online, lines = OnlineCalibration(), []
    for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), np.inf], strict=True):
        rows = (time >= begin) & (time < end)
        for event in online.add(field[rows], time=time[rows]):
            if event.code == "adopted" and online.fit is not None:
                online.fit.save(folder / "adopted" / adoption_file_name(event.time_s), force=True)
        state = online.state
        known = {"offset": state.offset, "offset_sigma": state.offset_sigma, "radius": state.radius, "unit": "uT"}
        line = {"kind": "state", "event": None, "time_s": state.time_s, **known, "heading_error_deg": 0.5, "more": 1}
        lines.append(json.dumps(line))
    (folder / "lines.jsonl").write_text("\n".join(lines) + '\n{"kind": "sta')
    online.save(folder / "U1.state")
    return folder, begins, offsets


@pytest.mark.parametrize("name", ["U1.state", "adopted", "lines.jsonl"])
def test_an_offset_and_its_walk_are_read(kept: tuple[Path, np.ndarray, np.ndarray], name: str) -> None:
    folder, begins, offsets = kept
    history = OffsetHistory.read(folder / name)
    assert (history.name, history.unit) == (name.partition(".")[0], "uT")
    assert history.radius == pytest.approx(50.0, rel=0.01)
    assert history.dip_deg == 60.0
    truth = offsets[np.searchsorted(begins, history.time_s, side="right") - 1]
    off = np.abs(history.offset - truth) / history.sigma
    assert np.mean(off < 2.0) > 0.8
    estimates = history.estimates
    assert np.diff(estimates.time_s).min() > 0.0
    assert 10 < len(estimates.time_s) <= 25
    assert history.walk is not None
    assert history.walk.low / 1.5 < WALK < 1.5 * history.walk.high


def test_a_folder_of_histories_is_one_of_units(kept: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path) -> None:
    folder, _, _ = kept
    assert sorted(find_histories([folder]).values()) == ["U1", "adopted", "lines"]
    (tmp_path / "U1.state").symlink_to(folder / "U1.state")
    both = find_histories([folder / "U1.state", tmp_path])
    assert list(both.values()) == [str(folder / "U1.state"), str(tmp_path / "U1.state")]
    (tmp_path / "U1.state").unlink()
    with assert_raises(DocumentError):
        find_histories([tmp_path])


@pytest.mark.parametrize(
    "content",
    [
        '{"kind": "state"}\n',
        "time,x,y,z\n1,2,3,4\n",
        "",
        '{"format":"flinders online calibration"}',
    ],
)
def test_what_holds_no_history_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "a").write_text(content)
    with assert_raises(DocumentError):
        OffsetHistory.read(tmp_path / "a")


def test_a_history_is_told_from_other_files(kept: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path) -> None:
    folder, _, _ = kept
    assert all(map(is_history, (folder, folder / "U1.state", folder / "lines.jsonl")))
    (tmp_path / "status.json").write_text('{\n  "kind": "state"\n}\n')
    calibration, *_ = (folder / "adopted").iterdir()
    assert not any(map(is_history, (tmp_path / "status.json", calibration, tmp_path / "nothing")))
    with assert_raises(DocumentError):
        OffsetHistory.read(tmp_path / "nothing")
    with assert_raises(DocumentError):
        OffsetHistory.read(tmp_path)
