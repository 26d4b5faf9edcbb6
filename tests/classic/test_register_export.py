"""``flinders export --to adis16480``: the table of registers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flinders import simulate
from flinders.apps.classic.adis16480 import NAMES, Registers
from flinders.cli import main
from flinders.core.calibration import Calibration

if TYPE_CHECKING:
    from click.testing import Result


TO = ("--to", "adis16480")


def export(*words: str) -> Result:
    return CliRunner().invoke(main, ["export", *words])


def table(text: str) -> dict[str, list[str]]:
    """The rows of the table: name to page, address, code, hex, value, unit."""
    return {line.split()[0]: line.split()[1:] for line in text.splitlines() if not line.startswith("#")}


def test_the_table_holds_every_register_in_decimal_and_hexadecimal() -> None:
    ended = export(*TO, "calibration.json")
    assert (ended.exit_code, ended.stderr) == (0, "")
    rows = table(ended.stdout)
    assert tuple(rows) == NAMES
    for page, address, code, word, *_ in rows.values():
        assert page == "2"
        assert int(word, 16) == int(code) % 65536
        assert len(address) == 4
    assert rows["HARD_IRON_X"] == ["2", "0x28", "-1170", "0xFB6E", "-117.0", "mG"]  # −(1.1 · 12 − 0.05 · 30) µT
    assert rows["SOFT_IRON_S22"] == ["2", "0x36", "-3277", "0xF333", "-10.001", "%"]


def test_copied_into_a_device_the_table_corrects_readings() -> None:
    rows = table(export(*TO, "calibration.json").stdout)
    registers = Registers.from_words(int(row[3], 16) for row in rows.values())
    given = Calibration.load("calibration.json")
    raw = given.unapply(49 * simulate.uniform(np.random.default_rng(0), 1000))
    off = registers.apply(10 * raw) - 10 * given.apply(raw)
    told = json.loads(export(*TO, "calibration.json", "--json").stdout)["checked"]
    assert np.linalg.norm(off, axis=1).max() == pytest.approx(told["worst"], rel=0.05)
