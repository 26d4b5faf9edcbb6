"""`flinders import`, `flinders targets` and `calibrate --export` as a user meets them."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import registry
from flinders.targets._target import GROUPS

if TYPE_CHECKING:
    from click.testing import Result

MATRIX = np.array([[1.1, 0.05, 0], [0.05, 0.9, 0], [0, 0, 1.02]])
OFFSET = np.array([12.0, -30, 7])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration, what some targets make of it, and a recording."""
    folder = tmp_path_factory.mktemp("made")
    Calibration(MATRIX, OFFSET, 49.0, True, raw=Unit.of("mG")).save(folder / "calibration.json")
    for name, path in (("motioncal", "packet.bin"), ("vectornav", "sensor.txt")):
        assert run("export", "--for", name, str(folder / "calibration.json"), "-o", str(folder / path)).exit_code == 0
    field = simulate.tumble(seed=2).samples.field
    write_field(folder / "tumble.csv", field)
    return folder


@pytest.fixture(autouse=True)
def home(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a copy of these."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(shutil.copytree(made, tmp_path, dirs_exist_ok=True))
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(main, words)


# import


@pytest.mark.parametrize("path", ["sensor.txt", "packet.bin"])
def test_a_file_of_a_target_becomes_a_calibration_file(path: str) -> None:
    ended = run("import", path, "--field-strength", "49", "-o", "back.json")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    back = Calibration.load("back.json")
    npt.assert_allclose(back.offset, OFFSET, atol=1e-4)
    npt.assert_allclose(back.matrix / back.matrix[0, 0], MATRIX / MATRIX[0, 0], atol=1e-6)


def test_without_a_name_it_goes_to_standard_output() -> None:
    ended = run("import", "sensor.txt")
    assert ended.exit_code == 0
    assert json.loads(ended.stdout)["calibration"]["field_strength_known"] is False
    assert "is a nominal value" in ended.stderr


def test_json_tells_what_was_found() -> None:
    ended = run("import", "packet.bin", "-o", "back.json", "--json")
    told = json.loads(ended.stdout)
    assert told["target"] == "motioncal"
    npt.assert_allclose(told["calibration"]["offset"], OFFSET, atol=1e-5)


def test_a_field_strength_that_is_given_goes_before_that_of_a_packet() -> None:
    ended = run("import", "packet.bin", "--field-strength", "20")
    found = json.loads(ended.stdout)["calibration"]
    assert (found["field_strength"], found["field_strength_known"]) == (20.0, True)
    assert "convention" not in ended.stderr


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("", 2),
        ("-", 2),
        ("missing.param", 5),
        (".", 5),
        ("calibration.json", 2),
        ("tumble.csv", 5),
        ("sensor.txt --for motioncal", 5),
        ("sensor.txt --for matlab", 2),
        ("sensor.txt --for nothing", 2),
        ("sensor.txt --compass 4", 2),
        ("packet.bin --compass 1", 2),
        ("sensor.txt --field-strength 0", 2),
        ("sensor.txt --json", 2),
        ("sensor.txt -o calibration.json", 6),
        ("sensor.txt -o sensor.txt --force", 2),
        ("sensor.txt -o nowhere/back.json", 6),
    ],
)
def test_wrong_use_is_one_line_on_stderr(words: str, code: int) -> None:
    ended = run("import", *words.split())
    assert ended.exit_code == code
    assert_sentences(ended.stderr)
    assert len(ended.stderr.splitlines()) == 1


def test_a_name_of_a_file_that_is_no_text_is_no_fault_of_ours() -> None:
    path = os.fsdecode(b"sensor\xff.txt")
    Path(path).write_bytes(Path("sensor.txt").read_bytes())
    ended = run("import", path, "-o", "back.json")
    assert ended.exit_code == 0, ended.output
    npt.assert_allclose(Calibration.load("back.json").offset, OFFSET, atol=1e-4)


def test_what_is_too_large_to_be_a_file_of_parameters_is_not_read() -> None:
    with Path("large.param").open("wb") as file:
        file.truncate(2**23)
    ended = run("import", "large.param")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)


# targets


def test_the_list_has_every_target_with_what_it_holds() -> None:
    ended = run("targets")
    assert ended.exit_code == 0
    _, _, *lines = ended.stdout.splitlines()
    rows = [line.split() for line in lines if line.startswith("  ") and line[2] != " "][: len(registry())]
    assert [name for name, *_ in rows] == list(registry())
    assert [line for line in lines if line in GROUPS] == list(dict.fromkeys(row.group for row in registry().values()))
    assert [name for name, star, *_ in rows if star == "*"] == [
        row.name for row in registry().values() if row.unverified
    ]
    below = " ".join(" ".join(lines[len(registry()) :]).split())
    assert all(clause in below for row in registry().values() for clause in row.unverified)
    assert all(len(line) <= 80 for line in ended.stdout.splitlines())
    told = json.loads(run("targets", "--json").stdout)
    assert set(told) == set(registry())
    assert told["vectornav"]["import"] is True
    assert {row["group"] for row in told.values()} <= set(GROUPS)


@pytest.mark.parametrize(
    ("word", "names"),
    [
        ("px4", ["px4", "px4-shell"]),
        ("ROS mount", ["urdf", "static-transform"]),
        ("python", ["micropython", "fusion-python"]),
        ("autopilot", ["ardupilot", "px4", "px4-shell", "betaflight", "betaflight-model", "inav", "paparazzi"]),
    ],
)
def test_a_word_selects_targets_by_name_form_and_group(word: str, names: list[str]) -> None:
    assert list(json.loads(run("targets", word, "--json").stdout)) == names
    shown = run("targets", word).stdout
    assert all(f"  {name} " in shown for name in names)


@pytest.mark.parametrize("word", ["ardpilot", "pixhalk"])
def test_a_word_of_no_target_is_refused(word: str) -> None:
    ended = run("targets", word)
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


# export


def test_a_packet_goes_to_standard_output_as_bytes() -> None:
    ended = run("export", "--for", "motioncal", "calibration.json")
    assert ended.stdout_bytes == Path("packet.bin").read_bytes()
    assert "determinant 1" in ended.stderr


@pytest.mark.parametrize(
    "words",
    [
        "--for c --compass 1 calibration.json",
        "--for c --compass 9 calibration.json",
    ],
)
def test_a_compass_that_there_is_not(words: str) -> None:
    ended = run("export", *words.split())
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


def test_a_name_for_code_of_two_sensors() -> None:
    assert "mast_correct(" in run("export", "--for", "c", "--name", "mast", "calibration.json").stdout
    ended = run("export", "--for", "yaml", "--name", "mast", "calibration.json")
    assert (ended.exit_code, len(ended.stderr.splitlines())) == (2, 1)
    takes = ", ".join(row.name for row in registry().values() if row.named)
    assert takes in ended.stderr
    assert_sentences(ended.stderr)
    assert run("export", "--for", "c", "--name", "", "calibration.json").exit_code == 2


# calibrate --export


def test_a_calibration_is_written_for_a_target_at_once() -> None:
    ended = run("calibrate", "tumble.csv", "-o", "new.json", "--export", "esphome")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    assert "# from tumble.csv\n" in Path("esphome.yaml").read_text(encoding="ascii")
    again = run("calibrate", "tumble.csv", "--export", "esphome")
    assert again.exit_code == 6
    assert_sentences(again.stderr)


def test_what_a_target_refuses_does_not_cost_the_calibration() -> None:
    """It is written and shown as without the target; then what went wrong, and where the calibration is."""
    ended = run("calibrate", "tumble.csv", "-o", "new.json", "--export", "c-q15:out.h")
    assert ended.exit_code == 4
    *_, written, kept, refusal = ended.stderr.splitlines()
    assert written == "written to new.json"
    assert_sentences(kept)
    assert refusal.startswith("refused: ")
    assert not Path("out.h").exists()


def test_to_standard_output_the_page_goes_beside_it() -> None:
    ended = run("calibrate", "tumble.csv", "--export", "json:-")
    assert set(json.loads(ended.stdout)) >= {"matrix", "offset"}
    assert "GOOD" in ended.stderr
    assert_sentences(ended.stderr, about="calibration file")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("tumble.csv --export px5", 2),
        ("tumble.csv --export json:- --json", 2),
        ("tumble.csv --export json:- -o -", 2),
        ("tumble.csv --export json:new.json -o new.json", 2),
        ("tumble.csv --export c --export c", 2),
        ("tumble.csv --export json:- --export c:-", 2),
        ("tumble.csv --export c --export px5", 2),
        ("tumble.csv --export json:tumble.csv --force", 2),
        ("--minmax=-1,2,-1,2,-1,2 --export c", 2),
    ],
)
def test_wrong_use_of_export_is_told(words: str, code: int) -> None:
    ended = run("calibrate", *words.split())
    assert ended.exit_code == code
    assert_sentences(ended.stderr)
