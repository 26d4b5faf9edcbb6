"""Logs that promise more than they hold cost no more time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.samples import written
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.apps.vehicles.readers import dataflash_format as _fmt
from flinders.apps.vehicles.readers import ulog
from flinders.errors import NoMagnetometer, UnreadableInput
from flinders.readers import _source

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats


FIELD = simulate.tumble(seed=5, n=300, motion="uniform").samples.field


@pytest.fixture
def table() -> Floats:
    return np.column_stack([np.arange(300) / 50, 10 * FIELD, np.tile([0.0, 0.0, 9.8], (300, 1))])


def test_letters_beyond_the_labels_of_a_message_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def holder(letter: str) -> list[float]:
        made.append(letter)
        return []

    monkeypatch.setattr(_fmt, "_holder", holder)
    description = f"FMT, 134, 18, MAG, Qhhh{'h' * 5000}, TimeUS,MagX,MagY,MagZ"
    lines = [description, *(f"MAG, {row}, 0, 4, -586" for row in range(20))]
    read = _fmt.read_text(enumerate(lines), {"MAG"})
    assert made == list("Qhhh"), "once, and for the labels alone"
    assert list(read.tables["MAG"].fields) == ["TimeUS", "MagX", "MagY", "MagZ"]


def test_zeros_that_a_logger_has_reserved_cost_no_more_than_looking_at_them(
    tmp_path: Path, table: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    """20 MB of them, in a hole of the file: the log is read as it is without, and they are said."""
    from tests.flight_log import dataflash

    parsed: list[int] = []

    def up_to(path: Path, size: int) -> _source.UpTo:
        parsed.append(size)
        return _source.UpTo(path, size)

    monkeypatch.setattr(ulog, "UpTo", up_to)
    logs = [written("ulog", tmp_path, table), tmp_path / "flight.bin"]
    logs[1].write_bytes(b"".join(dataflash()))
    for path in logs:
        whole = flinders.read(path)
        with path.open("ab") as file:
            file.truncate(path.stat().st_size + 20_000_000)
        log = flinders.open_log(path)
        assert np.array_equal(flinders.read(path).field, whole.field)
        assert any("20,000,0" in note for note in log.damage)
        assert_sentences(log.damage)
    assert len(set(parsed)) == 1


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (b"ULog\x01\x12\x35\x01" + bytes(50), NoMagnetometer),
        (b"#ROSBAG V2.0\n" + bytes(50), UnreadableInput),
    ],
    ids=["a ULog", "a bag"],
)
def test_a_log_of_nothing_is_refused_in_one_line(content: bytes, error: type[Exception], tmp_path: Path) -> None:
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    with pytest.raises(error) as caught:
        flinders.read(path)
    assert_sentences(str(caught.value))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
