"""What is known is used and said: the site in a log, the unit of counts, the next command, the word that was meant."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.flight_log import dataflash

from flinders.cli import main
from flinders.errors import UsageError
from flinders.simulate import tumble
from flinders.simulate.recording import write_csv

if TYPE_CHECKING:
    from click.testing import Result


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(line: str, code: int = 0) -> Result:
    ended = CliRunner().invoke(main, line.split(), prog_name="flinders")
    assert ended.exit_code == code, ended.output
    return ended


def calibration(line: str, code: int = 0) -> dict[str, Any]:
    fit: dict[str, Any] = json.loads(run(f"calibrate {line} --json", code).stdout)
    return fit


@pytest.fixture
def flight() -> str:
    Path("flight.bin").write_bytes(b"".join(dataflash()))
    return "flight.bin"


@pytest.fixture
def tumbled() -> str:
    write_csv(tumble(seed=1).samples, "tumble.csv")
    return "tumble.csv"


def test_a_log_tells_its_site_which_counts_as_if_it_were_typed(flight: str) -> None:
    told, typed = calibration(flight), calibration(f"{flight} --at 43.77,11.26,50 --date 2026-01-08")
    assert told["calibration"]["field_strength_known"] is True
    for name in ("offset", "matrix", "field_strength"):  # to the hours between midnight and the beginning
        np.testing.assert_allclose(told["calibration"][name], typed["calibration"][name], rtol=1e-5)
    assert told["heading_error_deg"]["dip_deg"] == pytest.approx(60.2, abs=0.05)
    said = run(f"calibrate {flight}").stderr
    assert "flight.bin: the log says where and when: WMM-2025 at 43.77, 11.26" in said
    assert "dip 60.2°, 47.44 µT; used, unless --at says otherwise" in said


def test_the_site_in_a_log_can_be_left_out_and_its_dip_be_replaced(flight: str) -> None:
    out = calibration(f"{flight} --at none")
    assert out["calibration"]["field_strength_known"] is False
    assert abs(out["heading_error_deg"]["dip_deg"]) == 60.0
    steeper = calibration(f"{flight} --dip 70")
    assert abs(steeper["heading_error_deg"]["dip_deg"]) == 70.0
    assert steeper["calibration"]["field_strength_known"] is True


def test_a_dip_that_nobody_gave_is_marked_as_assumed(tumbled: str, flight: str) -> None:
    assert "dip 60° (assumed)" in " ".join(run(f"calibrate {tumbled}").stdout.split())
    for line, code in ((f"{tumbled} --dip 60", 0), (flight, 0), (f"{tumbled} --at 47,8 --date 2026-01-08", 0)):
        assert "(assumed)" not in run(f"calibrate {line}", code).stdout


def test_counts_of_the_strength_of_the_earths_field_are_proposed_a_unit() -> None:
    np.savetxt("counts.txt", 10.0 * tumble(seed=1).samples.field, fmt="%.2f")
    said = run("calibrate counts.txt").stderr
    assert "! as mG the strength would be the earth's: add --unit mG if that is their unit" in said
    assert "would be the earth's" not in run("calibrate counts.txt --unit mG").stderr


def test_what_nearly_every_fit_says_is_printed_on_request_and_kept_in_the_file(tumbled: str) -> None:
    brief = " ".join(run(f"calibrate {tumbled} -o c.json").stdout.split())
    verbose = " ".join(run(f"calibrate {tumbled} --verbose").stdout.split())
    for note in ("field strength unknown", "the mounting angle cannot be seen"):
        assert note not in brief
        assert note in verbose
    codes = [finding["code"] for finding in json.loads(Path("c.json").read_text())["fit"]["findings"]]
    assert {"scale-unknown", "rotation-unknown"} <= set(codes)
    assert brief.startswith("The calibration is good. Without it headings are off by any angle")
    assert "holds if no iron is near" in brief  # no good verdict is without a condition


def test_a_calibration_is_shown_and_the_next_command_is_named(tumbled: str) -> None:
    assert "next: flinders export --to arduino c.json" in run(f"calibrate {tumbled} -o c.json").stderr
    assert "next: " not in run(f"calibrate {tumbled} -o d.json --export arduino").stderr
    shown = run("show c.json").stdout
    for words in ("tumble.csv, 3,000 readings", "offset", "matrix", "GOOD  headings good to 0.066°", "dip 60°"):
        assert words in shown
    assert "mounting angle" not in shown
    assert "mounting angle" in run("show c.json --verbose").stdout
    assert run("show c.json --json").stdout == Path("c.json").read_text()
    assert "tumble.csv is a recording, calibrate it first" in run("show tumble.csv", 2).stderr


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("export --to ardupilt c.json", "ardupilot"),
        ("calibrate tumble.csv --method minmx", "minmax"),
        ("calibrate tumble.csv --columns mag_x_uT,mag_y_uT,mag_z", "mag_z_uT"),
    ],
)
def test_a_word_that_is_nearly_right_is_recognised(line: str, meant: str, tumbled: str) -> None:
    run(f"calibrate {tumbled} -o c.json")
    assert f"(did you mean {meant!r}?)" in run(line, 2).stderr


def test_a_recipe_of_the_extremes_prints_its_table() -> None:
    run("simulate three-axis -o even.csv --soft-iron 0 --noise 0.1")
    shown = run("calibrate even.csv --method minmax").stdout.splitlines()
    assert any(line.split() == ["min", "max", "offset", "half-range", "scale"] for line in shown)


def test_numbers_of_a_refused_recipe_are_marked_and_nothing_is_written(tumbled: str) -> None:
    plain = run(f"calibrate {tumbled} --method minmax -o c.json", 4)
    assert "half-range" not in plain.output
    insisted = run(f"calibrate {tumbled} --method minmax --even-if-refused -o c.json", 4)
    assert insisted.stdout.strip().startswith("REFUSED, not fit for use: what minmax calculates all the same")
    x = next(line.split() for line in insisted.stdout.splitlines() if line.startswith("x "))
    field = tumble(seed=1).samples.field[:, 0].round(4)
    assert [float(cell) for cell in x[1:3]] == [field.min(), field.max()]
    as_json = json.loads(run(f"calibrate {tumbled} --method minmax --even-if-refused --json", 4).stdout)
    assert as_json["calibration"] is None
    assert as_json["refused_calibration"]["matrix"][0][1] == 0.0
    assert not Path("c.json").exists()
    assert "--even-if-refused goes with --method" in run(f"calibrate {tumbled} --even-if-refused", 2).stderr


def test_a_swing_is_drawn_and_has_the_numbers_of_the_recipe() -> None:
    shown = run("simulate two-axis -o swing.csv --polar rose.svg").stdout
    assert Path("rose.svg").read_text(encoding="utf-8").count('class="point ') == 2 * 36
    recipe = run("two-axis swing.csv", 3).stdout
    for name in ("mean Hx", "mean Hy", "S11", "S12", "S21", "S22"):
        ours, theirs = (next(line for line in page.splitlines() if line.startswith(name)) for page in (shown, recipe))
        assert float(ours.split()[1 if name[0] == "S" else 2]) == pytest.approx(
            float(theirs.split()[1 if name[0] == "S" else 2]), abs=1e-5
        )


def test_a_report_is_printed_to_a_file_of_its_own_name_before_another_option(tumbled: str) -> None:
    from flinders.cli.report import Report

    seen: list[object] = []

    def check(options: Report) -> None:
        seen.append((options.pdf, options.force))
        raise UsageError("enough")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Report, "check", check)
        for words in ("--pdf --force", "--pdf x.pdf", ""):
            run(f"report c.json {tumbled} {words}", 2)
    assert seen == [("report.pdf", True), ("x.pdf", False), (None, False)]


def rested(offset: tuple[float, float], headings: tuple[int, ...] = (0, 180, 90, 270)) -> str:
    """Write readings of a level sensor that rests for six seconds on each heading, with its hard iron."""
    rng = np.random.default_rng(1)
    angle = np.radians(np.repeat(headings, 300)) + rng.normal(0.0, 0.002, 300 * len(headings))
    field = np.stack(
        [25 * np.cos(angle) + offset[0], -25 * np.sin(angle) + offset[1], np.full(len(angle), 43.0)], axis=1
    )
    header = "t_s,mx_uT,my_uT,mz_uT"
    rows = np.column_stack([np.arange(len(angle)) / 50, field + rng.normal(0.0, 0.1, field.shape)])
    np.savetxt("rested.csv", rows, "%.4f", ",", header=header, comments="")
    return "rested.csv"


def test_the_half_turn_test_takes_a_recording_as_it_is() -> None:
    good = json.loads(run(f"swing {rested((0.0, 0.0))} --level --json").stdout)
    assert good["half_turns_pass"] is True
    assert len(good["half_turns"]) == 2
    bad = json.loads(run(f"swing {rested((2.0, 1.0))} --level --json", 4).stdout)
    b, c = (np.degrees(shift / 25.0) for shift in (2.0, 1.0))  # small angles
    assert bad["hard_iron_deg"]["B"] == pytest.approx(b, abs=0.2)
    assert bad["hard_iron_deg"]["C"] == pytest.approx(c, abs=0.2)
    assert "do not suit the calibration" not in run(f"swing {rested((2.0, 1.0))} --level", 4).stderr


def test_the_half_turn_test_takes_the_headings_of_a_table() -> None:
    magnetic = np.arange(0.0, 360.0, 45.0)
    compass = magnetic - 2.0 * np.sin(np.radians(magnetic)) - 3.0 * np.cos(np.radians(magnetic))
    rows = np.column_stack([compass, magnetic])
    np.savetxt("swing.csv", rows, "%.3f", ",", header="compass,magnetic", comments="")
    swing = json.loads(run("swing swing.csv --json", 0).stdout)
    assert len(swing["half_turns"]) == 4
    north = swing["half_turns"][0]
    assert north["error_deg"] == pytest.approx(6.0, abs=0.01)
    assert swing["half_turns_pass"] is False
