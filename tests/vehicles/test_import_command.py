"""``flinders import`` and ``calibrate --export`` with the parameters of autopilots and ROS."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences
from tests.targets.test_import_command import MATRIX, OFFSET, run
from tests.worlds import write_field

from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import read_back


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration, what some targets make of it, and a recording."""
    folder = tmp_path_factory.mktemp("made")
    Calibration(MATRIX, OFFSET, 49.0, True, raw=Unit.of("mG")).save(folder / "calibration.json")
    for name, path in (("ardupilot", "compass.param"), ("px4-shell", "px4.txt"), ("motioncal", "packet.bin")):
        assert run("export", "--for", name, str(folder / "calibration.json"), "-o", str(folder / path)).exit_code == 0
    write_field(folder / "tumble.csv", simulate.tumble(seed=2).samples.field)
    return folder


@pytest.fixture(autouse=True)
def home(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a copy of these."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(shutil.copytree(made, tmp_path, dirs_exist_ok=True))
    return tmp_path


@pytest.mark.parametrize("path", ["compass.param", "px4.txt"])
def test_a_file_of_a_target_becomes_a_calibration_file(path: str) -> None:
    ended = run("import", path, "--field-strength", "49", "-o", "back.json")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    back = Calibration.load("back.json")
    npt.assert_allclose(back.offset, OFFSET, atol=1e-4)
    npt.assert_allclose(back.matrix / back.matrix[0, 0], MATRIX / MATRIX[0, 0], atol=1e-6)


def test_without_a_name_it_goes_to_standard_output() -> None:
    ended = run("import", "compass.param")
    assert ended.exit_code == 0
    assert json.loads(ended.stdout)["calibration"]["field_strength_known"] is False
    assert_sentences(ended.stderr)
    assert_sentences(ended.stderr)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("tumble.csv --for ardupilot", 5),
        ("packet.bin --for ardupilot", 5),
        ("compass.param --for betaflight", 5),
        ("compass.param --for inav", 5),
        ("compass.param --for paparazzi", 5),
        ("compass.param --compass 3", 5),
    ],
)
def test_wrong_use_is_one_line_on_stderr(words: str, code: int) -> None:
    ended = run("import", *words.split())
    assert ended.exit_code == code
    assert_sentences(ended.stderr)
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "words",
    [
        "--for ardupilot --compass 0 calibration.json",
        "--for px4 --compass 9 calibration.json",
    ],
)
def test_a_compass_that_there_is_not(words: str) -> None:
    ended = run("export", *words.split())
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


def test_the_unit_that_a_target_needs_is_told() -> None:
    ended = run("calibrate", "tumble.csv", "--export", "betaflight")
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


def test_a_calibration_is_written_for_a_target_at_once() -> None:
    ended = run("calibrate", "tumble.csv", "-o", "new.json", "--export", "ardupilot")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    assert "# from tumble.csv\n" in Path("ardupilot.param").read_text(encoding="ascii")
    _, back = read_back(Path("ardupilot.param").read_bytes(), "file")
    npt.assert_allclose(back.offset, Calibration.load("new.json").offset, atol=1e-4)
    again = run("calibrate", "tumble.csv", "--export", "ardupilot")
    assert again.exit_code == 6
    assert_sentences(again.stderr)


def test_numbers_that_are_no_calibration_are_refused() -> None:
    flat = Path("compass.param").read_text(encoding="utf-8")
    lines = [f"{line.split(',')[0]},0" if "DIA_Z" in line else line for line in flat.splitlines()]
    Path("flat.param").write_text("\n".join(lines), encoding="utf-8")
    ended = run("import", "flat.param")
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)


def test_lossy_is_asked_for() -> None:
    refused = run("export", "--for", "ros-madgwick", "calibration.json", "-o", "mag.yaml")
    assert refused.exit_code == 4
    assert_sentences(refused.stderr)
    assert not Path("mag.yaml").exists()
    ended = run("export", "--for", "ros-madgwick", "--lossy", "calibration.json", "-o", "mag.yaml")
    assert ended.exit_code == 0
    assert_sentences(ended.stderr)
    assert "mag_bias_x: 1.200000000e-05" in Path("mag.yaml").read_text(encoding="ascii")


@pytest.mark.parametrize(
    ("target", "code"),
    [("ros-madgwick", 4), ("inav", 2)],
)
def test_what_a_target_refuses_does_not_cost_the_calibration(target: str, code: int) -> None:
    """It is written, reported and shown as without the target; then what went wrong, and where the calibration is."""
    ended = run(
        "calibrate", "tumble.csv", "-o", "new.json", "--report-text", "page.txt", "--export", f"{target}:out.txt"
    )
    assert ended.exit_code == code
    assert "GOOD" in ended.stdout
    *_, written, kept, refusal = ended.stderr.splitlines()
    assert written == "written to new.json"
    assert_sentences(kept)
    assert_sentences(refusal)
    assert not Path("out.txt").exists()
    assert Path("page.txt").exists()
    npt.assert_allclose(Calibration.load("new.json").offset, simulate.tumble(seed=2).sensor.offset, atol=1)


def test_a_target_that_refuses_without_a_calibration_file_says_how_to_keep_it() -> None:
    ended = run("calibrate", "tumble.csv", "--export", "ros-madgwick:out.yaml")
    assert ended.exit_code == 4
    assert_sentences(ended.stderr)
    told = run("calibrate", "tumble.csv", "--export", "ros-madgwick:out.yaml", "--json")
    assert told.exit_code == 4
    assert json.loads(told.stdout)["error"]["code"] == "not-exportable"
    piped = run("calibrate", "tumble.csv", "-o", "-", "--export", "ros-madgwick:out.yaml")
    assert json.loads(piped.stdout)["calibration"]
    assert_sentences(piped.stderr, about="standard output")


def test_a_calibration_is_written_for_several_targets_and_each_refusal_is_said() -> None:
    words = ["--export", "c", "--export", "inav", "--export", "ros-madgwick", "--export", "ardupilot:own.param"]
    ended = run("calibrate", "tumble.csv", "-o", "new.json", *words)
    assert ended.exit_code == 4  # of 2, for a unit, and 4, for what madgwick has no room for
    assert Path("new.json").exists()
    assert "flinders_correct(" in Path("c.h").read_text(encoding="ascii")
    assert Path("own.param").read_text(encoding="ascii").startswith("#")
    assert not Path("inav.txt").exists()
    for target in ("inav", "ros-madgwick"):
        assert f"written for {target};" in ended.stderr
    assert_sentences(ended.stderr)


def test_a_name_of_a_file_that_is_no_text_is_kept_readable() -> None:
    path = os.fsdecode(b"compass\xff.param")
    Path(path).write_bytes(Path("compass.param").read_bytes())
    assert run("import", path, "-o", "back.json").exit_code == 0
    (file,) = json.loads(Path("back.json").read_text(encoding="utf-8"))["provenance"]["files"]
    assert file["name"].startswith("compass")
