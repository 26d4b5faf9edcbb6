"""`flinders export` as a user meets it: what it writes and where, what it refuses, and how it ends."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main
from flinders.core import calibration_file
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import registry

if TYPE_CHECKING:
    from click.testing import Result

TO = ("--to", "adis16480")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with calibrations in it: a plain one, one in counts, one that saturates."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    made([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]], [12, -30, 7]).save("calibration.json")
    made(np.eye(3), [100, 0, 0], unit="counts").save("counts.json")
    made(np.diag([2.5, 2.4, 2.6]), [10, 0, 0], field_strength_known=True).save("large.json")
    return tmp_path


def made(matrix: object, offset: object, *, unit: str = "mG", **more: Any) -> Calibration:
    return Calibration(np.array(matrix, float), np.array(offset, float), 49.0, raw=Unit.of(unit), **more)


def export(*words: str) -> Result:
    return CliRunner().invoke(main, ["export", *words])


def table(text: str) -> dict[str, list[str]]:
    """The rows of the table: name to page, address, code, hex, value, unit."""
    return {line.split()[0]: line.split()[1:] for line in text.splitlines() if not line.startswith("#")}


def test_the_output_says_what_was_checked_and_what_is_not_verified() -> None:
    text = " ".join(export(*TO, "calibration.json").stdout.replace("#", "").split())
    assert "checked: its own formula on 400 fields of 490.0 mG, at most 0.0" in text
    assert "not verified: that one step of S is 1/32768" in text
    assert "recorded with these registers at 0" in text
    assert "which is relative: no field strength was given" in text
    ended = export(*TO, "calibration.json", "-o", "registers.txt")
    assert "checked: " in ended.stderr
    assert "! not verified: that one step of S is 1/32768" in ended.stderr


def test_both_devices_have_the_same_registers_under_their_own_names() -> None:
    one, other = (export("--to", name, "calibration.json").stdout for name in ("ADIS16480", "adis16488"))
    assert table(one) == table(other)
    assert one.splitlines()[0].startswith("# ADIS16480:")
    assert other.splitlines()[0].startswith("# ADIS16488:")


def test_a_file_is_written_and_never_written_over_unasked() -> None:
    assert export(*TO, "calibration.json", "-o", "registers.txt").exit_code == 0
    written = Path("registers.txt").read_text(encoding="utf-8")
    assert written == export(*TO, "calibration.json").stdout
    again = export(*TO, "calibration.json", "-o", "registers.txt")
    assert again.exit_code == 6
    assert "registers.txt exists: give another name, or overwrite it (--force)" in again.stderr
    assert export(*TO, "calibration.json", "-o", "registers.txt", "--force").exit_code == 0
    over = export(*TO, "calibration.json", "-o", "calibration.json", "--force")
    assert over.exit_code == 2
    assert "would be written over" in over.stderr


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


def test_mapped_axes_and_a_sensor_are_told() -> None:
    from flinders.core.axes import Axes

    made(np.eye(3), [1, 2, 3], axes=Axes.of("x,-y,-z"), sensor="SN 7").save("turned.json")
    text = export(*TO, "turned.json").stdout
    assert "go on mapping them to x,-y,-z afterwards" in text
    assert "# from turned.json, sensor SN 7" in text
    assert table(text)["HARD_IRON_Y"][4] == "+20.0"


def test_a_limited_calibration_says_what_it_is_not_good_for() -> None:
    record("deck.csv", "tilted")
    assert CliRunner().invoke(main, ["calibrate", "deck.csv", "-o", "deck.json"]).exit_code == 3
    ended = export(*TO, "deck.json", "-o", "deck.txt")
    assert ended.exit_code == 0
    assert "! limited: some directions are" in ended.stderr
    assert "# the calibration is limited: headings good to" in Path("deck.txt").read_text(encoding="utf-8")


def test_a_refused_calibration_is_not_exported() -> None:
    found = calibration_file.Fitted(method="auto", samples=100, verdict="refused")
    calibration_file.write(Calibration.load("calibration.json").to_document(fit=found), "refused.json")
    ended = export(*TO, "refused.json", "-o", "registers.txt")
    assert ended.exit_code == 4
    assert "refused as not fit for use" in ended.stderr
    assert not Path("registers.txt").exists()


def test_saturation_ends_with_4_writes_nothing_and_says_what_would_be_lost() -> None:
    ended = export(*TO, "large.json", "-o", "registers.txt")
    assert (ended.exit_code, ended.stdout) == (4, "")
    assert ended.stderr.startswith(
        "refused: SOFT_IRON_S11 would be +150.00% and holds -100% to +99.997%, 50.0% are lost;"
    )
    assert "without the field strength it fits" in ended.stderr
    assert not Path("registers.txt").exists()
    told = json.loads(export(*TO, "large.json", "--json").stdout)["error"]
    assert told["code"] == "not-exportable"
    assert told["evidence"]["lost"]["SOFT_IRON_S33"] == pytest.approx(0.6, abs=1e-4)


def test_the_targets_are_listed() -> None:
    listed = export("--list")
    assert listed.exit_code == 0
    assert "adis16488 *       ADIS16488 registers" in listed.stdout
    assert listed.stdout == CliRunner().invoke(main, ["targets"]).stdout
    assert set(json.loads(export("--list", "--json").stdout)) == set(registry())


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("", 2, "need a calibration file and a target"),
        ("calibration.json", 2, "need a calibration file and a target"),
        ("--to adis16480", 2, "need a calibration file and a target"),
        ("--to px5 calibration.json", 2, "'px5' is not known (did you mean 'px4'?): use one of ardupilot, px4"),
        ("--to adis16480 counts.json", 2, "--unit mG"),
        ("--to adis16480 -", 2, "must be a file"),
        (
            "--to adis16480 tumble.csv",
            2,
            "tumble.csv is a recording, calibrate it first: flinders calibrate tumble.csv",
        ),
        ("--to adis16480 missing.json", 5, "missing.json: cannot be read: no such file"),
        ("--to adis16480 calibration.json -o nowhere/registers.txt", 6, "no such folder"),
        ("--to adis16480 calibration.json -o .", 6, "it is a directory"),
        ("--to adis16480 calibration.json -o - --json", 2, "both go to standard output"),
        ("--to adis16480 calibration.json calibration.json", 2, "unexpected extra argument"),
    ],
)
def test_wrong_use_is_one_line_on_stderr(words: str, code: int, message: str) -> None:
    record("tumble.csv", "uniform")
    ended = export(*words.split())
    assert ended.exit_code == code
    assert message in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
    assert ended.stdout == "" or "--json" in words


def record(name: str, motion: str) -> None:
    field = simulate.tumble(seed=2, motion=motion).samples.field
    write_field(name, field)


@pytest.mark.parametrize("target", ["ardupilot", "px4", "px4-shell"])
def test_what_comes_on_top_of_the_onboard_calibration_does_not_replace_it(target: str) -> None:
    """Of a log taken as logged: the autopilot would put these numbers in the place of those that were in force."""
    raw = calibration_file.SourceFile(name="flight.bin", sha256="0" * 64, bytes=1, rows=1)
    for as_logged, code in ((False, 0), (True, 4)):
        file = calibration_file.SourceFile(name=raw.name, sha256=raw.sha256, bytes=1, rows=1, as_logged=as_logged)
        made_from = calibration_file.ProvenanceRecord(
            flinders="0.1.0", date=datetime(2026, 1, 1, tzinfo=UTC), files=(file,)
        )
        found = made(np.eye(3), [1, 2, 3]).to_document(provenance=made_from)
        Path("logged.json").write_text(calibration_file.dumps(found), encoding="utf-8")
        ended = export("--to", target, "logged.json")
        assert ended.exit_code == code, ended.output
    assert "come on top of that one" in ended.stderr
    assert export("--to", "c", "logged.json").exit_code == 0
