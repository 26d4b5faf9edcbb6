"""``flinders export --for adis16480``: the table of registers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.sentences import assert_sentences
from tests.targets.test_export_command import export, made

from flinders import simulate
from flinders.apps.classic.adis16480 import NAMES, Registers
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration

TO = ("--for", "adis16480")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with two calibrations in it: a plain one, and one that saturates."""
    monkeypatch.chdir(tmp_path)
    made([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]], [12, -30, 7]).save("calibration.json")
    made(np.diag([2.5, 2.4, 2.6]), [10, 0, 0], field_strength_known=True).save("large.json")
    return tmp_path


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
    raw = given.unapply(49 * simulate.uniform_directions(np.random.default_rng(0), 1000))
    off = registers.apply(10 * raw) - 10 * given.apply(raw)
    told = json.loads(export(*TO, "calibration.json", "--json").stdout)["checked"]
    assert np.linalg.norm(off, axis=1).max() == pytest.approx(told["worst"], rel=0.05)


def test_the_output_says_what_was_checked_and_what_is_not_verified() -> None:
    text = " ".join(export(*TO, "calibration.json").stdout.replace("#", "").split())
    assert_sentences(text)
    ended = export(*TO, "calibration.json", "-o", "registers.txt")
    assert "checked: " in ended.stderr
    assert_sentences(ended.stderr)


def test_both_devices_have_the_same_registers_under_their_own_names() -> None:
    one, other = (export("--for", name, "calibration.json").stdout for name in ("ADIS16480", "adis16488"))
    assert table(one) == table(other)
    assert one.splitlines()[0].startswith("# ADIS16480:")
    assert other.splitlines()[0].startswith("# ADIS16488:")


def test_json_is_the_same_for_programs() -> None:
    ended = export(*TO, "calibration.json", "--json")
    told = json.loads(ended.stdout)
    rows = table(export(*TO, "calibration.json").stdout)
    assert [(row["name"], str(row["code"]), row["hex"]) for row in told["values"]["registers"]] == [
        (name, row[2], row[3]) for name, row in rows.items()
    ]
    given = Calibration.load("calibration.json")
    np.testing.assert_allclose(told["values"]["decoded"]["matrix"], given.matrix, atol=2e-5)
    np.testing.assert_allclose(told["values"]["decoded"]["offset_mG"], 10 * given.offset, atol=0.1)
    assert told["unverified"]
    assert "checked: " in ended.stderr


def test_saturation_ends_with_4_writes_nothing_and_says_what_would_be_lost() -> None:
    ended = export(*TO, "large.json", "-o", "registers.txt")
    assert (ended.exit_code, ended.stdout) == (4, "")
    assert_sentences(ended.stderr)
    assert not Path("registers.txt").exists()
    told = json.loads(export(*TO, "large.json", "--json").stdout)["error"]
    assert told["code"] == "not-exportable"
    assert told["evidence"]["lost"]["SOFT_IRON_S33"] == pytest.approx(0.6, abs=1e-4)


def test_axes_that_were_mapped_stay_so() -> None:
    made(np.eye(3), [1, 2, 3], axes=Axes.of("x,-y,-z")).save("turned.json")
    assert table(export(*TO, "turned.json").stdout)["HARD_IRON_Y"][4] == "+20.0"


def test_counts_are_no_readings_of_these_registers() -> None:
    made(np.eye(3), [100, 0, 0], unit="counts").save("counts.json")
    ended = export(*TO, "counts.json")
    assert ended.exit_code == 2
    assert "--unit mG" in ended.stderr
