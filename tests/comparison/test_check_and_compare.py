"""`flinders check` and `flinders compare` as a user meets them: verdicts, exit codes, JSON, bad input."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec import structs
from rich.console import Console
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.worlds import TUMBLED_SENSOR, judged

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core import calibration_file
from flinders.core.calibration import Calibration
from flinders.fitting.result import with_calibration
from flinders.report.comparison_pages import page_of_comparison
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from flinders.simulate import Sensor

HEADER = "mx_uT,my_uT,mz_uT"
KEYS = [
    "answer", "heading_difference_deg", "claimed_deg", "largest_deg", "telling_bound_deg", "wider_claim", "ratio",
    "chi_square", "freedom", "p_value",
    "direction_difference_deg", "offset_difference", "offset_sigma", "offset_share", "unit", "scale_difference",
    "is_scale_known", "is_identical",
]  # fmt: skip


def record(
    name: str | Path,
    seed: int,
    *,
    offset: float = 0.0,
    motion: str = "uniform",
    header: str = HEADER,
    factor: float = 1.0,
    n: int | None = None,
) -> None:
    """Write a recording of the sensor, its offset moved by so many µT."""
    sensor: Sensor = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + np.array([offset, 0, 0]))
    field = factor * simulate.tumble(seed=seed, motion=motion, n=n, sensor=sensor).samples.field
    rows = [",".join(f"{value:.4f}" for value in row) for row in field]
    Path(name).write_text("\n".join([header, *rows, ""] if header else [*rows, ""]), encoding="utf-8")


def edit(source: str, target: str, **parts: dict[str, object] | None) -> None:
    """Copy a calibration file with some of its parts changed."""
    content = json.loads(Path(source).read_text(encoding="utf-8"))
    for part, entries in parts.items():
        content[part] = None if entries is None else {**content[part], **entries}
    Path(target).write_text(json.dumps(content), encoding="utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of a sensor and their calibrations."""
    folder = tmp_path_factory.mktemp("made")
    for seed, name in ((3, "monday"), (4, "tuesday")):
        record(folder / f"{name}.csv", seed)
        flinders.fit(flinders.read(folder / f"{name}.csv")).save(folder / f"{name}.json")
    return folder


@pytest.fixture(autouse=True)
def home(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copy for each test."""
    monkeypatch.chdir(shutil.copytree(made, tmp_path, dirs_exist_ok=True))


# compare


def test_two_calibrations_of_a_sensor_agree() -> None:
    ended = flinders_("compare", "monday.json", "tuesday.json")
    assert (ended.code, ended.err) == (0, "")
    assert "AGREE  headings within" in ended.out


@pytest.mark.parametrize(("offset", "code", "answer"), [(0.3, 3, "cannot-tell"), (5.0, 4, "fails")])
def test_a_sensor_that_changed(offset: float, code: int, answer: str) -> None:
    record("later.csv", 5, offset=offset)
    flinders_("calibrate", "later.csv", "-o", "later.json")
    for words in (("compare", "monday.json", "later.json"), ("check", "monday.json", "later.csv")):
        ended = flinders_(*words, "--json")
        assert (ended.code, ended.json["answer"]) == (code, answer)
        assert flinders_(*words).code == code


def test_compare_prints_the_fields_of_the_python_object() -> None:
    found = flinders_("compare", "monday.json", "tuesday.json", "--json", "--dip", "-40", "--target", "2").json
    wanted = flinders.compare(
        flinders.load("monday.json"), flinders.load("tuesday.json"), dip_deg=-40.0, target_deg=2.0
    )
    assert list(found) == KEYS
    assert found == json.loads(json.dumps(wanted.as_dict()))


def test_calibrations_too_vague_to_tell_end_with_3() -> None:
    ended = flinders_("compare", "monday.json", "tuesday.json", "--target", "0.1", "--json")
    assert (ended.code, ended.json["answer"]) == (3, "cannot-tell")
    assert ended.json["largest_deg"] > 0.1
    shown = " ".join(flinders_("compare", "monday.json", "tuesday.json", "--target", "0.1").out.split())
    assert f"{ended.json['heading_difference_deg']['worst']:.2f}° apart" in shown
    assert f"that of {ended.json['wider_claim'].upper()}" in shown
    assert_sentences(shown)


def test_a_file_without_a_covariance_is_exact() -> None:
    edit("tuesday.json", "bare.json", fit=None)
    ended = flinders_("compare", "monday.json", "bare.json", "--json")
    assert_sentences(ended.err)
    assert ended.json["chi_square"] > flinders_("compare", "monday.json", "tuesday.json", "--json").json["chi_square"]
    edit("monday.json", "other.json", fit=None)
    ended = flinders_("compare", "other.json", "bare.json")
    assert ended.code == 0
    assert_sentences(" ".join(ended.out.split()))
    found = flinders_("compare", "other.json", "bare.json", "--json").json
    assert (found["p_value"], found["claimed_deg"], found["offset_sigma"]) == (None, None, None)
    assert "the same calibration twice" in flinders_("compare", "bare.json", "bare.json").out
    assert "the same calibration twice" in flinders_("compare", "monday.json", "monday.json").out


def test_names_of_two_sensors_are_noticed() -> None:
    edit("tuesday.json", "second.json", raw={"sensor": "hull 8"})
    assert flinders_("compare", "monday.json", "second.json").err == ""
    edit("monday.json", "first.json", raw={"sensor": "hull 7"})
    assert_sentences(flinders_("compare", "first.json", "second.json").err)


# check


def test_a_calibration_holds_on_another_recording() -> None:
    ended = flinders_("check", "monday.json", "tuesday.csv")
    assert ended.code == 0
    assert_sentences(ended.err)
    assert "HOLDS  headings within" in ended.out


def test_a_calibration_checked_on_its_own_recording_proves_nothing() -> None:
    flinders_("calibrate", "monday.csv", "-o", "made.json")
    Path("copy.csv").write_bytes(Path("monday.csv").read_bytes())
    ended = flinders_("check", "made.json", "copy.csv")
    shown = " ".join(ended.out.split())
    assert ended.code == 3
    assert "HOLDS" not in shown
    assert_sentences(shown)
    both = flinders_("check", "made.json", "tuesday.csv", "copy.csv", "--json")
    assert (both.code, both.json["own_recordings"]) == (3, ["copy.csv"])
    assert flinders_("check", "made.json", "tuesday.csv").code == 0


def test_calibrations_that_leave_any_angle_say_so() -> None:
    """One of another sensor, whose claim is as wide as it is wrong."""
    first = flinders.load("monday.json")
    moved = replace(first.calibration, offset=first.calibration.offset + np.array([200.0, 0.0, 0.0]))
    claim = replace(first.claim, covariance=1e8 * first.claim.covariance)
    with_calibration(replace(first, claim=claim), moved).save("wide.json")
    ended = flinders_("compare", "monday.json", "wide.json")
    assert ended.code == 3
    assert_sentences(" ".join(ended.out.split()))
    replace(first, calibration=moved).save("far.json")
    assert_sentences(" ".join(flinders_("compare", "monday.json", "far.json").out.split()))


def test_angles_and_shares_that_round_to_nothing_have_no_sign() -> None:
    found = flinders.compare(flinders.load("monday.json"), flinders.load("tuesday.json"))
    tiny = replace(found, heading_mean_deg=-0.001, scale_difference=-0.00001)
    with StringIO() as out:
        Console(file=out, width=100, color_system=None).print(page_of_comparison(tiny))
        shown = out.getvalue()
    assert "-0.00" not in shown
    assert "0.00°" in shown
    assert "0.00%" in shown


def test_an_answer_that_cannot_be_told_says_what_to_do() -> None:
    record("later.csv", 5, offset=0.3)
    assert_sentences(" ".join(flinders_("check", "monday.json", "later.csv").out.split()))
    vague = flinders_("compare", "monday.json", "tuesday.json", "--target", "0.1").out
    assert_sentences(" ".join(vague.split()))
    record("short.csv", 9, n=150)
    assert "record for longer" in " ".join(flinders_("check", "monday.json", "short.csv").out.split())


def test_check_says_what_was_skipped_where_too_little_is_left() -> None:
    Path("few.csv").write_text(f"{HEADER}\n1,2,3\n2,3,4\nnan,1,2\n", encoding="utf-8")
    assert_sentences(flinders_("check", "monday.json", "few.csv").err)


def test_check_compares_with_a_fresh_fit() -> None:
    found = flinders_("check", "monday.json", "tuesday.csv", "--json").json
    assert list(found) == [*KEYS, "residual", "own_recordings", "limiting_finding", "fresh"]
    assert found["own_recordings"] == []
    compared = flinders_("compare", "monday.json", "tuesday.json", "--json").json
    for key in ("heading_difference_deg", "claimed_deg", "chi_square", "offset_difference", "p_value"):
        assert found[key] == pytest.approx(compared[key])
    assert found["fresh"]["verdict"] == "good"
    assert found["residual"]["calibration"]["spread"] >= found["residual"]["fresh"]["spread"] > 0.005
    assert found["residual"]["fresh"]["strength"] == pytest.approx(1.0, abs=0.001)


def test_a_moved_offset_widens_the_spread_under_the_calibration() -> None:
    record("moved.csv", 5, offset=5.0)
    residual = flinders_("check", "monday.json", "moved.csv", "--json").json["residual"]
    assert residual["calibration"]["spread"] > 3 * residual["fresh"]["spread"]
    assert_sentences(flinders_("check", "monday.json", "moved.csv").out)


def test_a_recording_too_poor_to_tell_ends_with_3_and_says_what_to_do() -> None:
    record("deck.csv", 6, motion="tilted")
    ended = flinders_("check", "monday.json", "deck.csv")
    assert ended.code == 3
    assert flinders_("check", "monday.json", "deck.csv", "--json").json["limiting_finding"] == "coverage"
    assert_sentences(" ".join(ended.out.split()))


def test_a_level_turn_tells_with_its_limits() -> None:
    record("turn.csv", 6, motion="level")
    ended = flinders_("check", "monday.json", "turn.csv")
    assert ended.code == 0
    assert "HOLDS headings within" in " ".join(ended.out.split())
    assert_sentences(" ".join(ended.out.split()))


def test_a_recording_that_cannot_be_fitted_ends_with_3_and_says_what_it_does_show() -> None:
    record("still.csv", 7)
    lines = Path("still.csv").read_text(encoding="utf-8").splitlines()
    held = simulate.tumble(seed=7, motion="uniform", sensor=TUMBLED_SENSOR).directions[:, 2] > 0.95
    Path("still.csv").write_text("\n".join([lines[0], *np.array(lines[1:])[held], ""]), encoding="utf-8")
    ended = flinders_("check", "monday.json", "still.csv")
    assert (ended.code, ended.out) == (3, "")
    shown = " ".join(ended.err.split())
    assert_sentences(shown)
    assert_sentences(" ".join(ended.err.split()))
    found = flinders_("check", "monday.json", "still.csv", "--json").json
    assert (found["answer"], found["verdict"]) == ("cannot-tell", "refused")
    assert (found["error"]["code"], found["error"]["exit_code"]) == ("refused", 3)
    Path("short.csv").write_text(f"{HEADER}\n1,2,3\n2,3,4\n", encoding="utf-8")
    ended = flinders_("check", "monday.json", "short.csv")
    assert ended.code == 3
    assert_sentences(ended.err)
    found = flinders_("check", "monday.json", "short.csv", "--json").json
    assert (found["answer"], found["error"]["code"]) == ("cannot-tell", "too-few-samples")
    assert found["error"]["exit_code"] == 3


def test_unit_and_axes_come_from_the_calibration() -> None:
    record("raw.csv", 3, header="", factor=10.0)
    flinders_("calibrate", "raw.csv", "--unit", "mG", "--axes", "y,-x,z", "-o", "raw.json")
    record("again.csv", 4, header="", factor=10.0)
    ended = flinders_("check", "raw.json", "again.csv", "--json")
    assert (ended.code, ended.json["unit"]) == (0, "uT")
    assert "axes y,-x,z" in ended.err


def test_several_recordings_and_standard_input() -> None:
    record("wednesday.csv", 8)
    found = flinders_("check", "monday.json", "tuesday.csv", "wednesday.csv", "--json")
    assert (found.code, found.json["fresh"]["samples"]) == (0, 2000)
    piped = flinders_("check", "monday.json", "-", "--json", stdin=Path("tuesday.csv").read_bytes())
    assert piped.json == flinders_("check", "monday.json", "tuesday.csv", "--json").json


def test_columns_are_chosen() -> None:
    rows = [f"0,0,1,{line}" for line in Path("tuesday.csv").read_text(encoding="utf-8").splitlines()[1:]]
    Path("wide.csv").write_text("\n".join(["a,b,c,u,v,w", *rows, ""]), encoding="utf-8")
    assert flinders_("check", "monday.json", "wide.csv", "--columns", "u,v,w").code == 0


def test_the_dip_has_the_sign_that_the_recording_shows() -> None:
    sensor = simulate.Sensor(noise=0.5)
    field = simulate.tumble(seed=9, motion="hemisphere", sensor=sensor).samples.field
    rows = [",".join(f"{value:.4f}" for value in row) for row in field]
    Path("half.csv").write_text("\n".join([HEADER, *rows, ""]), encoding="utf-8")
    Calibration.identity(field_strength=50.0, raw=flinders.Unit.of("uT")).save("flat.json")
    found = flinders_("check", "flat.json", "half.csv", "--json").json
    assert found["heading_difference_deg"]["dip_deg"] == found["fresh"]["heading_error_deg"]["dip_deg"]


# bad input


def test_a_refresh_refuses_the_recording_of_the_earlier_calibration() -> None:
    assert flinders_("calibrate", "monday.csv", "-o", "made.json").code == 0
    ended = flinders_("refresh", "--previous", "made.json", "monday.csv")
    assert ended.code == 2
    assert_sentences(ended.err)
    assert flinders_("refresh", "--previous", "made.json", "tuesday.csv").code in {0, 3}


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("check tuesday.csv monday.json", 2),
        ("check monday.json tuesday.json", 2),
        ("check - tuesday.csv", 2),
        ("check monday.json tuesday.csv tuesday.csv", 2),
        ("check monday.json", 2),
        ("check monday.json counts.csv", 2),
        ("check counts.json tuesday.csv", 2),
        ("check monday.json nix.csv", 5),
        ("check nix.json tuesday.csv", 5),
        ("check monday.json tuesday.csv --columns q,r,s", 2),
        ("check monday.json tuesday.csv --dip 90", 2),
        ("check broken.json tuesday.csv", 5),
        ("compare monday.json", 2),
        ("compare monday.json tuesday.csv", 2),
        ("compare tuesday.csv monday.json", 2),
        ("compare tuesday.csv monday.csv", 2),
        ("check tuesday.csv monday.csv", 2),
        ("refresh --previous tuesday.csv monday.json", 2),
        ("refresh --previous tuesday.csv monday.csv", 2),
        ("compare monday.json nix.json", 5),
        ("compare monday.json -", 5),
        ("compare monday.json counts.json", 2),
        ("compare monday.json axes.json", 2),
        ("compare monday.json broken.json", 5),
        ("compare monday.json tuesday.json --target 0", 2),
    ],
)
def test_bad_input_is_a_line_that_says_what_to_do(line: str, code: int) -> None:
    record("counts.csv", 3, header="mx_counts,my_counts,mz_counts")
    edit("monday.json", "counts.json", calibration={"unit": "counts"}, raw={"unit": "counts"})
    edit("monday.json", "axes.json", raw={"axes": "x,-y,-z"})
    covariance = [[float(row <= column) for column in range(9)] for row in range(9)]
    edit("monday.json", "broken.json", fit={"covariance": covariance})
    ended = flinders_(*line.split())
    assert ended.code == code, ended.err
    assert_sentences(ended.err)
    assert ended.out == ""
    assert flinders_(*line.split(), "--json").json["error"]["exit_code"] == code


def test_numbers_beyond_reason_are_no_fault() -> None:
    edit("monday.json", "huge.json", calibration={"offset": [1e200, 0.0, 0.0]})
    assert calibration_file.read("huge.json").calibration.offset[0] == 1e200
    assert flinders_("compare", "monday.json", "huge.json").code == 4
    assert flinders_("check", "huge.json", "monday.csv").code == 4
    assert flinders_("check", "huge.json", "monday.csv", "--json").json["residual"]["calibration"]["spread"] is None


def test_a_drift_that_no_fit_survives_is_followed_by_the_calibration(tmp_path: Path) -> None:
    """5 µT along x over the recording: the fit is refused, and the path is that of the calibration alone."""
    tumble = simulate.tumble(seed=5, motion="uniform", n=3000, sensor=TUMBLED_SENSOR)
    time = np.linspace(0.0, 120.0, 3000)
    moved = tumble.samples.field + np.outer(5.0 * time / 120.0, [1.0, 0.0, 0.0])
    for name, field in (("still.csv", tumble.samples.field), ("moved.csv", moved)):
        table = np.column_stack([time, field])
        np.savetxt(tmp_path / name, table, delimiter=",", header=f"time_s,{HEADER}", comments="", fmt="%.6f")
    known, moving = str(tmp_path / "still.json"), str(tmp_path / "moved.csv")
    runner = CliRunner()
    runner.invoke(main, ["calibrate", str(tmp_path / "still.csv"), "-o", known])
    ended = runner.invoke(main, ["check", known, moving, "--drift"])
    assert ended.exit_code == 3
    assert_sentences(" ".join(ended.output.split()), about="drift under")
    told = json.loads(runner.invoke(main, ["check", known, moving, "--drift", "--json"]).stdout)
    assert told["verdict"] == told["fresh"]["verdict"] == "refused"
    assert told["drift"]["is_proven"]
    assert told["drift"]["offset_change"] == pytest.approx(5.0, abs=0.7)
    assert np.array(told["drift"]["path"])[-1] - np.array(told["drift"]["path"])[0] == pytest.approx([5, 0, 0], abs=0.7)


def test_an_aided_calibration_is_checked_without_its_rotation(tmp_path: Path) -> None:
    """The same sensor, nothing changed, whose axes an aid has found 12° from those of the body."""
    calibration = calibrated_with_a_turn(tmp_path)
    write_tumble(tmp_path / "later.csv", seed=9)
    told = json.loads(CliRunner().invoke(main, ["check", calibration, str(tmp_path / "later.csv"), "--json"]).stdout)
    assert told["answer"] == "holds"
    assert told["heading_difference_deg"]["worst"] < 4.0 * told["claimed_deg"]["worst"]
    assert told["omitted_rotation_deg"] == pytest.approx(12.0)


@pytest.mark.parametrize(("target", "code"), [("1", 0), ("0.01", 3)])
def test_a_rotation_in_one_calibration_alone_is_named_as_the_difference(tmp_path: Path, target: str, code: int) -> None:
    turned = calibrated_with_a_turn(tmp_path)
    found = calibration_file.read(turned)
    matrix = euler(-12.0, 0.0, 0.0) @ np.array(found.calibration.matrix)
    correction = structs.replace(found.calibration, matrix=tuple(map(tuple, matrix.tolist())), rotation="symmetric")
    alone = str(tmp_path / "alone.json")
    calibration_file.write(structs.replace(found, calibration=correction), alone)
    for other, is_identical in ((turned, False), (alone, True)):
        ended = flinders_("compare", alone, other, "--target", target)
        assert ended.code == code
        assert_sentences(" ".join(ended.out.partition("together")[2].split()), numbers=False)
        told = flinders_("compare", alone, other, "--target", target, "--json").json
        assert told["is_identical"] == is_identical
        assert told.get("omitted_rotation_deg") == (None if is_identical else pytest.approx(12.0))


def write_tumble(path: Path, *, seed: int) -> None:
    tumble = simulate.tumble(seed=seed, motion="uniform", n=2000, sensor=TUMBLED_SENSOR)
    np.savetxt(path, tumble.samples.field, delimiter=",", header=HEADER, comments="", fmt="%.6f")


def calibrated_with_a_turn(home: Path) -> str:
    """A calibration file whose matrix is turned by 12° about x, as if an aid had told so."""
    write_tumble(home / "first.csv", seed=8)
    path = str(home / "turned.json")
    CliRunner().invoke(main, ["calibrate", str(home / "first.csv"), "-o", path])
    found = calibration_file.read(path)
    turn = euler(12.0, 0.0, 0.0) @ np.array(found.calibration.matrix)
    correction = structs.replace(found.calibration, matrix=tuple(map(tuple, turn.tolist())), rotation="estimated")
    calibration_file.write(structs.replace(found, calibration=correction), path, force=True)
    return path


def test_the_dip_of_the_calibration_is_that_of_its_comparisons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its size, and its side: of a sensor that is mounted upside down the field points along −z."""
    monkeypatch.chdir(tmp_path)
    upside_down = simulate.tumble(seed=3, motion="flight", dip_deg=-70.0, sensor=simulate.Sensor(noise=0.5)).samples
    fit = judged(upside_down, site=flinders.Site(inclination_deg=70.0))
    assert fit.claim.known_dip_deg == -70.0
    other = judged(simulate.tumble(seed=4, sensor=simulate.Sensor(noise=0.5)).samples)
    assert flinders.compare(fit, other).heading_difference_deg.dip_deg == -70.0
    assert flinders.compare(other, fit).heading_difference_deg.dip_deg == 60.0
    fit.save("known.json")
    np.savetxt("fresh.csv", upside_down.field, delimiter=",", header="mag_x_uT,mag_y_uT,mag_z_uT", comments="")
    printed = flinders_("check", "known.json", "fresh.csv", "--json").json
    assert printed["heading_difference_deg"]["dip_deg"] == printed["fresh"]["heading_error_deg"]["dip_deg"] == -70.0
