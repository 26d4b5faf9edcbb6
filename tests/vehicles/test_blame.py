"""Who is blamed for an error in a log: the file, the call, or this program."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.samples import LOGS, written
from tests.sentences import assert_raises
from tests.vehicles.test_px4 import still, ulog

import flinders
from flinders.cli import main
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    from pathlib import Path


TABLE = np.column_stack([0.1 * np.arange(80), np.random.default_rng(1).uniform(-400, 400, (80, 6))])
OWN_STEPS = {"dataflash": "_position", "ros": "_position", "tlog": "_damage", "ulog": "_start_time"}
"""A function of each log reader that works on what was parsed."""


@pytest.mark.parametrize("name", sorted(LOGS))
def test_a_sensor_is_chosen_by_a_number_as_by_its_digits(name: str, tmp_path: Path) -> None:
    path = written(name, tmp_path, TABLE)
    first, same = flinders.read(path, sensor=1), flinders.read(path, sensor="1")
    assert np.array_equal(first.field, same.field)
    index: Any = np.int64(1)
    assert np.array_equal(flinders.read(path, sensor=index).field, same.field)
    with assert_raises(UsageError):
        flinders.read(path, sensor=3)


@pytest.mark.parametrize("name", sorted(LOGS))
def test_an_error_of_this_program_is_not_told_as_a_broken_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, module = written(name, tmp_path, TABLE), import_module(f"flinders.apps.vehicles.readers.{name}")
    monkeypatch.setattr(module, OWN_STEPS[name], None)
    with assert_raises(TypeError):
        flinders.read(path)
    monkeypatch.delattr(module, OWN_STEPS[name])
    with pytest.raises(NameError, match=OWN_STEPS[name]):
        flinders.read(path)


@pytest.mark.parametrize("fault", [AttributeError, TypeError, RuntimeError, KeyError])
def test_an_error_of_a_parser_is_told_as_a_broken_file(
    fault: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyulog

    def broken(*_: object, **__: object) -> None:
        raise fault("theirs")

    monkeypatch.setattr(pyulog.ULog, "__init__", broken)
    with assert_raises(UnreadableInput) as caught:
        flinders.read(written("ulog", tmp_path, TABLE))
    assert "theirs" in str(caught.value)


ON_BOARD = {"CAL_MAG0_ID": 77, "CAL_MAG0_ROT": 2, "CAL_MAG0_XOFF": 0.25}


@pytest.mark.parametrize(
    ("of_version", "options", "became"),
    [
        ({"CAL_MAG0_PRIO": 75}, [], "logged raw, before it"),
        ({"CAL_MAG0_XODIAG": 0.01}, [], "logged raw, before it"),
        ({"CAL_MAG0_PRIO": 75}, ["--as-logged"], "logged raw, before it"),
        ({"CAL_MAG0_EN": 1}, [], "removed here"),
        ({"CAL_MAG0_EN": 1}, ["--as-logged"], "left on"),
    ],
)
def test_info_says_what_became_of_a_calibration_on_board(
    of_version: dict[str, float], options: list[str], became: str, tmp_path: Path
) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog(still(), ON_BOARD | of_version))
    said = " ".join(CliRunner().invoke(main, ["info", str(path), *options]).stdout.split())
    assert f"; {became}" in said
