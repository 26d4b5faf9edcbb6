"""`flinders simulate` and `flinders evaluate` as a user meets them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences

import flinders
from flinders.cli.simulate_three_axis import MOTIONS
from flinders.simulate import MOTIONS as KNOWN
from flinders.simulate import truth, tumble


def names() -> list[str]:
    return sorted(path.name for path in Path().iterdir())


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``tumble.csv``, its truth, and its ``calibration.json``."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert flinders_("simulate", "three-axis", "-o", "tumble.csv", "--readings", "800").code == 0
        assert flinders_("calibrate", "tumble.csv", "-o", "calibration.json").code == 0
    return folder


@pytest.fixture
def calibrated(made: Path, home: Path) -> None:
    """A copy of these for each test."""
    shutil.copytree(made, home, dirs_exist_ok=True)


# simulate


@pytest.mark.parametrize("words", ["simulate", "simulate three-axis", "evaluate"])
def test_help_has_an_example_and_loads_nothing_heavy(words: str) -> None:
    code = (
        "import sys, flinders.cli as cli\n"
        f"cli.main({[*words.split(), '--help']!r}, 'flinders', standalone_mode=False)\n"
        "print('loaded', *sorted(m for m in sys.modules if '.' not in m))"
    )
    shown = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert re.search(rf"Example:\n  +flinders {words.split(maxsplit=1)[0]}", shown)
    assert not set(shown.rpartition("loaded ")[2].split()) & {"numpy", "rich", "msgspec"}


def test_the_help_knows_all_motions() -> None:
    assert sorted(MOTIONS) == sorted(KNOWN)
    shown = flinders_("simulate", "three-axis", "--help").out
    assert all(re.search(rf"^ +{name} +\w", shown, re.MULTILINE) for name in KNOWN)


def test_a_seed_means_the_same_as_in_python() -> None:
    assert flinders_("simulate", "three-axis", "-o", "tumble.csv", "--seed", "5", "--motion", "drive").code == 0
    expected = tumble(5, motion="drive")
    npt.assert_allclose(flinders.read("tumble.csv").field, expected.samples.field, atol=5.1e-5)
    assert truth.read("tumble.truth.json") == truth.Truth.of(expected)


def test_all_options_arrive() -> None:
    words = (
        "--motion flight --readings 60 --rate 10 --tilt 20 --noise 0 --resolution 0.5 --saturation 90 --outliers 0.1 "
        "--stationary 0.2 --motor 0.2 --drift 0.1 --step 3 --magnet 100 --gyro-bias 0.01,0,-0.02 --soft-iron 0 "
        "--hard-iron 0 --field-strength 48 --dip -65 --seed 3"
    )
    found = flinders_("simulate", "three-axis", "-o", "all.csv", "--json", *words.split()).json
    assert found["sensor"]["matrix"] == np.eye(3).tolist()
    assert found["sensor"]["offset"] == [0.0, 0.0, 0.0]
    assert (found["sensor"]["noise"], found["sensor"]["resolution"], found["sensor"]["saturation"]) == (0.0, 0.5, 90.0)
    assert (found["field"]["strength"], found["field"]["dip_deg"]) == (48.0, -65.0)
    assert found["recording"]["disturbances"] == ["motor", "drift", "step", "magnet"]
    assert found["recording"]["gyro_bias"] == [0.01, 0.0, -0.02]
    assert (found["recording"]["readings"], found["recording"]["rate_hz"]) == (60, 10.0)
    assert (found["recording_file"], found["truth_file"]) == ("all.csv", "all.truth.json")
    samples = flinders.read("all.csv")
    assert samples.time is not None
    assert samples.time[1] == pytest.approx(0.1)
    assert samples.current is not None
    assert samples.temperature is not None


def test_the_magnetometer_can_stand_alone() -> None:
    assert flinders_("simulate", "three-axis", "-o", "alone.csv", "--magnetometer-only").code == 0
    assert Path("alone.csv").read_text(encoding="utf-8").partition("\n")[0] == "time_s,mag_x_uT,mag_y_uT,mag_z_uT"


def test_to_standard_output_goes_the_recording_and_nothing_else() -> None:
    ended = flinders_("simulate", "three-axis", "--readings", "500")
    assert ended.out.startswith("time_s,")
    assert len(ended.out.splitlines()) == 501
    assert_sentences(ended.err)
    assert names() == []
    assert flinders_("calibrate", "-", "-o", "c.json", stdin=ended.out).code == 0


def test_the_truth_can_be_kept_elsewhere() -> None:
    assert flinders_("simulate", "three-axis", "--readings", "9", "--truth", "t.json").code == 0
    assert names() == ["t.json"]
    assert flinders_("simulate", "three-axis", "--readings", "9", "-o", "a.csv", "--truth", "u.json").code == 0
    assert names() == ["a.csv", "t.json", "u.json"]


def test_the_sensor_of_another_recording_is_recorded_again() -> None:
    flinders_("simulate", "three-axis", "-o", "one.csv", "--readings", "9", "--noise", "0.2")
    again = ["simulate", "three-axis", "-o", "two.csv", "--readings", "9", "--seed", "2", "--sensor", "one.truth.json"]
    assert flinders_(*again).code == 0
    assert truth.read("two.truth.json").sensor == truth.read("one.truth.json").sensor
    refused = flinders_(*again, "--force", "--soft-iron", "0.1")
    assert refused.code == 2
    assert_sentences(refused.err)


@pytest.mark.parametrize("there", ["a.csv", "a.truth.json"])
def test_nothing_is_overwritten_without_force_and_nothing_is_left_half_done(there: str) -> None:
    Path(there).write_text("mine", encoding="utf-8")
    refused = flinders_("simulate", "three-axis", "-o", "a.csv")
    assert refused.code == 6
    assert f"{there} exists" in refused.err
    assert names() == [there]
    assert Path(there).read_text(encoding="utf-8") == "mine"
    assert flinders_("simulate", "three-axis", "-o", "a.csv", "--force").code == 0
    assert names() == ["a.csv", "a.truth.json"]


@pytest.mark.parametrize(
    "words",
    [
        "three-axis -o a.csv --motion dance",
        "three-axis -o a.csv --soft-iron 0.5",
        "three-axis -o a.csv --noise -1",
        "three-axis -o a.csv --outliers 3",
        "three-axis -o a.csv --gyro-bias 1,2",
        "three-axis -o a.csv --tilt 10",
        "three-axis -o a.csv --truth a.csv",
        "three-axis -o a.csv --truth -",
        "three-axis --json",
        "tumble.csv",
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(words: str) -> None:
    ended = flinders_("simulate", *words.split())
    assert ended.code == 2
    assert_sentences(ended.err)
    assert ended.err.count("\n") == 1
    assert names() == []


def test_a_missing_folder_and_a_missing_sensor_have_codes_of_their_own() -> None:
    assert flinders_("simulate", "three-axis", "-o", "none/a.csv").code == 6
    assert flinders_("simulate", "three-axis", "-o", "a.csv", "--sensor", "none.json").code == 5
    assert names() == []


def test_the_sensor_that_is_read_is_not_written_over() -> None:
    flinders_("simulate", "three-axis", "-o", "a.csv", "--readings", "9")
    before = Path("a.truth.json").read_bytes()
    ended = flinders_("simulate", "three-axis", "-o", "a.csv", "--sensor", "a.truth.json", "--force", "--seed", "3")
    assert ended.code == 2
    assert Path("a.truth.json").read_bytes() == before


# evaluate


@pytest.mark.usefixtures("calibrated")
def test_a_good_calibration_is_as_claimed() -> None:
    told = flinders_("evaluate", "calibration.json", "tumble.truth.json")
    assert told.code == 0
    assert "AS CLAIMED" in told.out
    assert all(len(line) <= 80 for line in told.out.splitlines())
    found = flinders_("evaluate", "calibration.json", "tumble.truth.json", "--json").json
    assert found["verdict"] == "as claimed"
    assert found["is_on_target"] is True
    assert found["scale_error"] is None


@pytest.mark.usefixtures("calibrated")
def test_the_exit_code_tells_the_target_from_the_claim() -> None:
    assert flinders_("evaluate", "calibration.json", "tumble.truth.json", "--target", "0.001").code == 3
    content = json.loads(Path("calibration.json").read_text(encoding="utf-8"))
    content["calibration"]["offset"][0] += 0.3
    Path("off.json").write_text(json.dumps(content), encoding="utf-8")
    told = flinders_("evaluate", "off.json", "tumble.truth.json")
    assert (told.code, "WORSE THAN CLAIMED" in told.out, "within the target" in told.out) == (3, True, True)
    assert flinders_("evaluate", "off.json", "tumble.truth.json", "--target", "0.2").code == 4
    content["fit"] = None
    Path("mute.json").write_text(json.dumps(content), encoding="utf-8")
    told = flinders_("evaluate", "mute.json", "tumble.truth.json", "--json")
    assert (told.code, told.json["verdict"], told.json["heading_ratio"]) == (0, "unclaimed", None)
    assert_sentences(told.err)


@pytest.mark.usefixtures("calibrated")
def test_a_given_field_strength_is_judged_too() -> None:
    words = ["calibrate", "tumble.csv", "-o", "known.json", "--field-strength", "55"]
    assert flinders_(*words).code == 0
    assert flinders_("evaluate", "known.json", "tumble.truth.json", "--json").json["scale_error"] == pytest.approx(
        0.0, abs=0.11
    )


REFUSALS = [
    ("tumble.truth.json calibration.json", 2, "the calibration comes first: flinders evaluate calibration.json"),
    ("calibration.json calibration.json", 5, "calibration.json is the calibration of a magnetometer"),
    ("tumble.csv tumble.truth.json", 2, "tumble.csv is a recording, calibrate it first: flinders calibrate tumble.csv"),
    ("calibration.json tumble.csv", 5, "tumble.csv cannot be read as JSON"),
    ("calibration.json none.json", 5, "none.json cannot be read: no such file"),
    ("calibration.json -", 2, "the truth must be a file"),
    ("- tumble.truth.json", 2, "the calibration must be a file"),
    ("calibration.json tumble.truth.json --dip 90", 2, "need degrees from -89 to 89"),
    ("counts.json tumble.truth.json", 2, "counts.json is for readings in counts, the truth is in µT"),
]


@pytest.mark.usefixtures("calibrated")
@pytest.mark.parametrize(("words", "code", "message"), REFUSALS)
def test_what_is_no_pair_is_refused(words: str, code: int, message: str) -> None:
    content = json.loads(Path("calibration.json").read_text(encoding="utf-8"))
    content["calibration"]["unit"] = content["raw"]["unit"] = "counts"
    Path("counts.json").write_text(json.dumps(content), encoding="utf-8")
    ended = flinders_("evaluate", *words.split())
    assert ended.code == code
    assert message in ended.err
    as_json = flinders_("evaluate", *words.split(), "--json").json
    assert as_json["error"]["exit_code"] == code


def test_the_demo_writes_its_truth_too() -> None:
    assert flinders_("demo", "--csv", "demo.csv", "--json").code == 0
    assert truth.read("demo.truth.json") == truth.Truth.of(tumble(1))
    assert flinders_("demo", "--csv", "demo.csv").code == 6
