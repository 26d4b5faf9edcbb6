"""The program as a user meets it: what the options do, what comes out where, how it ends, and what it leaves behind."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click
import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.trials import daily
from tests.waiting import wait_until

import flinders
from flinders import simulate
from flinders.cli import _output, main
from flinders.cli._commands import ROWS
from flinders.cli._program import EXIT_CODES
from flinders.cli._signals import STOP_SIGNALS, handle_signals, interrupt
from flinders.core import calibration_file
from flinders.core.calibration import Calibration
from flinders.fitting.fit_json import json_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.arrays import Floats

TUMBLE = simulate.tumble(seed=5, n=600, motion="uniform")
FIELD = TUMBLE.samples.field
COMMANDS = tuple(main.commands)
INTERRUPTIBLE = """
import signal
from flinders.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a test run in the background ignores it
main(prog_name="flinders")
"""
PROGRAM = [sys.executable, "-c", "from flinders.cli import main; main(prog_name='flinders')"]


def text(field: Floats, *, header: str = "", digits: int = 4, between: str = ",") -> str:
    lines = [between.join(f"{value:.{digits}f}" for value in row) for row in field]
    return "".join(f"{line}\n" for line in ([header] if header else []) + lines)


def leaves(name: str) -> list[str]:
    """The commands that a group holds, each with its group's name; or the command itself."""
    command = main.commands[name]
    return [f"{name} {word}" for word in command.commands] if isinstance(command, click.Group) else [name]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with ``tumble.csv`` in it."""
    monkeypatch.chdir(tmp_path)
    Path("tumble.csv").write_text(text(FIELD, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    return tmp_path


@pytest.fixture
def calibration(home: Path) -> Calibration:
    """What stands in ``calibration.json``."""
    found = Calibration([[1.1, 0.05, 0.0], [0.05, 0.9, -0.02], [0.0, -0.02, 1.02]], TUMBLE.sensor.offset, 50.0)  # type: ignore[arg-type]
    found = Calibration(found.matrix, found.offset, 50.0, raw=flinders.Unit.of("uT"))
    found.save(home / "calibration.json")
    return found


# how it starts


def test_help_comes_without_the_heavy_libraries() -> None:
    code = """
import sys, flinders.cli as cli
for words in ("--help", "calibrate --help", "--version"):
    cli.main(words.split(), "flinders", standalone_mode=False)
print("loaded", *sorted(m for m in sys.modules if "." not in m))
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(done.stdout.rpartition("loaded ")[2].split())
    assert "flinders" in loaded
    assert not loaded & {"numpy", "scipy", "rich", "msgspec"}


def test_what_else_was_recorded_goes_by_names_that_are_told(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "--with", "gyro")
    assert ended.code == 5
    assert all(name in ended.err for name in ("gyro", "mx_uT", "my_uT", "mz_uT"))
    shown = " ".join(flinders_("calibrate", "--help").out.split())
    assert all(name in shown for name in ("auto", "rate", "dip", "tilt", "attitude", "current", "temperature"))


def test_a_recording_may_have_a_name_that_is_no_utf_8(home: Path) -> None:
    odd = os.fsdecode(b"tumble\xff.csv")
    Path("tumble.csv").rename(odd)
    assert flinders_("calibrate", odd, "-o", "odd.json").code in {0, 1}
    assert json.loads(Path("odd.json").read_text(encoding="utf-8"))["provenance"]["files"][0]["name"] == "tumble�.csv"


@pytest.mark.parametrize("command", [word for name in COMMANDS for word in leaves(name)])
def test_every_command_has_json_and_help_with_an_example(command: str) -> None:
    shown = flinders_(*command.split(), "--help").out
    assert "--json" in shown
    assert re.search(rf"Example:\n  +flinders {command}", shown)


def test_the_list_of_commands_cuts_no_sentence() -> None:
    shown = flinders_("--help").out
    listed = shown[shown.index("Calibrate and use:") : shown.index("Example:")]
    assert "..." not in listed
    assert all(re.search(rf"^  {command} +\w.*\.$", listed, re.MULTILINE) for command in COMMANDS)


def test_help_holds_the_table_of_exit_codes() -> None:
    shown = flinders_("--help").out
    assert all(f"{code:>3}  {meaning}" in shown for code, meaning in EXIT_CODES.items())


def test_the_name_alone_gives_help_on_stderr_and_2() -> None:
    ended = flinders_()
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith("Usage: ")


@pytest.mark.parametrize(
    "typed",
    [
        "cal tumble.csv",
        "callibrate tumble.csv",
        "calibrate tumble.csv --out c.json",
        "export --to arduino c.json",
        "record --port /dev/ttyACM0 -o tumble.csv",
        "record /dev/ttyACM0 -o tumble.csv",
        "live tumble.csv",
        "calibrate",
        "fleet logs",
        "fleet V101 V102 -o calibrations.parquet",
        "calibrate tumble.csv --to arduino",
    ],
)
def test_what_is_mistyped_is_answered_with_what_was_meant(typed: str) -> None:
    ended = flinders_(*typed.split())
    assert ended.code == 2
    assert_sentences(ended.err)


# what is no text


@pytest.mark.parametrize("words", [(), ("--add",), ("--filter", "median:3")])
def test_a_table_is_corrected_into_text(home: Path, calibration: Calibration, words: tuple[str, ...]) -> None:
    np.save("tumble.npy", FIELD)
    lines = flinders_("apply", "calibration.json", "tumble.npy", *words).out.splitlines()
    rows = np.array([line.split(",") for line in lines[1:]], float)
    assert lines[0].startswith("mag_x_uT,mag_y_uT,mag_z_uT")
    assert len(rows) == len(FIELD)
    if "--filter" not in words:
        npt.assert_allclose(rows[:, -3:], calibration.apply(FIELD), atol=1e-4)
    if "--add" in words:
        assert lines[0].endswith(",mag_x_uT_cal,mag_y_uT_cal,mag_z_uT_cal")
        npt.assert_allclose(rows[:, :3], FIELD, atol=1e-4)


def test_a_part_of_a_recording_is_corrected_as_a_table(home: Path, calibration: Calibration) -> None:
    timed = np.column_stack([np.arange(len(FIELD)) / 10.0, FIELD])
    Path("timed.csv").write_text(text(timed, header="time_s,mx_uT,my_uT,mz_uT"), encoding="utf-8")
    rows = flinders_("apply", "calibration.json", "timed.csv", "--from", "1", "--to", "2").out.splitlines()
    assert rows[0] == "time_s,mag_x_uT,mag_y_uT,mag_z_uT"
    assert [float(row.split(",")[0]) for row in (rows[1], rows[-1])] == [1.0, 2.0]
    npt.assert_allclose([float(cell) for cell in rows[1].split(",")[1:]], calibration.apply(FIELD[10]), atol=2e-4)


# results


def test_json_has_the_promised_keys(home: Path) -> None:
    found = flinders_("calibrate", "tumble.csv", "--json").json
    promised = ["verdict", "method", "calibration", "heading_error_deg", "noise", "coverage", "findings"]
    assert [key for key in found if key in promised] == promised
    assert set(found) - set(promised) == {
        "uncorrected_heading_error_deg", "textbook_heading_error_deg", "alignment_error_deg", "direction_error_deg",
        "bias_deg", "prior_influence", "unobserved", "samples", "independent_samples", "outliers", "distortion",
        "drift", "nonlinearity", "axis_lag", "conditions", "repeats", "good_until",
        "covariance", "tilted_heading_error_deg", "attitude_limit_deg", "autocorrelation",
    }  # fmt: skip
    assert {"offset", "matrix", "field_strength", "unit"} <= set(found["calibration"])
    assert {"rms", "worst"} <= set(found["heading_error_deg"])
    keys = {"code", "severity", "number", "limit", "values", "follows_from", "advice"}
    assert all(set(finding) == keys for finding in found["findings"])
    assert found["verdict"] == "good"


def test_json_has_the_fields_of_the_python_objects(home: Path) -> None:
    found = flinders_("calibrate", "tumble.csv", "--json").json
    assert found == json.loads(json.dumps(json_of(flinders.fit(flinders.read("tumble.csv")))))


def test_results_go_to_stdout_and_talk_to_stderr(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "-o", "out.json")
    assert_sentences(ended.err)
    assert "GOOD" in ended.out
    assert "\x1b" not in ended.out + ended.err


def test_the_file_holds_what_the_fit_found_and_where_it_came_from(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "-o", "out.json", "--sensor", "hull 7")
    fit = flinders.fit(flinders.read("tumble.csv"), sensor="hull 7")
    written = calibration_file.read("out.json")
    assert ended.code == 0
    assert Calibration.load("out.json").isclose(fit.calibration)
    assert (written.raw.sensor, written.raw.unit) == ("hull 7", "uT")
    assert written.provenance is not None
    file = written.provenance.files[0]
    assert (file.name, file.bytes, file.rows) == ("tumble.csv", Path("tumble.csv").stat().st_size, len(FIELD))
    assert written.fit is not None
    assert written.fit.verdict == "good"


def test_the_calibration_can_go_to_standard_output(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "-o", "-")
    assert Calibration.from_document(calibration_file.loads(ended.out)).isclose(
        flinders.fit(flinders.read("tumble.csv")).calibration
    )
    assert "GOOD" in ended.err
    assert not Path("-").exists()


def test_demo_comes_close_to_the_truth() -> None:
    found = flinders_("demo", "--json", "--seed", "3").json
    assert found["verdict"] == "good"
    assert found["true_direction_error_deg"] < 3 * found["heading_error_deg"]["worst"]


def test_demo_writes_a_recording_for_the_other_commands(home: Path) -> None:
    assert flinders_("demo", "--csv", "demo.csv", "--json").code == 0
    assert flinders_("calibrate", "demo.csv", "-o", "demo.json").code == 0
    assert flinders_("apply", "demo.json", "demo.csv", "-o", "flat.csv").code == 0
    strength = np.linalg.norm(flinders.read("flat.csv").field, axis=1)
    assert np.std(strength) < 0.02 * np.mean(strength)


def test_methods_lists_all_of_them() -> None:
    found = flinders_("methods", "--json").json
    assert list(found) == list(flinders.estimators.METHODS)
    parameters = {"likelihood": 9, "robust": 9, "level": 5, "minmax": 6}
    assert {name: found[name]["parameters"] for name in parameters} == parameters
    assert found["level"]["least_readings"] == 6
    assert all(name in flinders_("methods").out for name in found)


# what was read


READING = {
    "apply": "apply calibration.json print.txt -o out.csv",
    "calibrate": "calibrate print.txt",
    "check": "check calibration.json print.txt",
    "heading": "heading calibration.json print.txt --level -o out.csv",
    "refresh": "refresh --previous calibration.json print.txt",
    "report": "report calibration.json print.txt -o out.html",
}


def test_the_commands_that_read_a_recording_are_these() -> None:
    """And info, whose result is what it has read."""
    places = {
        name: " ".join(word.metavar or "" for word in command.params if isinstance(word, click.Argument))
        for name, command in main.commands.items()
        if name in ROWS
    }
    assert {name for name, place in places.items() if "RECORDING" in place or "LOG" in place} == {*READING, "info"}


@pytest.mark.parametrize("words", daily(READING.values(), 3), ids=READING)
def test_every_command_says_how_many_readings_there_were_and_quotes_the_first_other_line(
    words: str, calibration: Calibration
) -> None:
    lines = [f"X: {x:.2f} Y: {y:.2f} Z: {z:.2f} uT" for x, y, z in FIELD]
    Path("print.txt").write_text("\n".join(["LIS3MDL test", "LIS3MDL found", *lines, "low battery", ""]))
    told = [line for line in flinders_(*words.split()).err.splitlines() if line.startswith("print.txt: ")]
    (counted,) = [line for line in told if "600 readings" in line]
    assert "(line 1: 'LIS3MDL test')" in counted
    assert_sentences(counted)


# options of calibrate


def offset_of(*words: str) -> Floats:
    ended = flinders_("calibrate", *words, "--json")
    assert ended.code in {0, 3}, ended.err
    return np.array(ended.json["calibration"]["offset"])


def test_columns_are_taken_by_name_or_number(home: Path) -> None:
    other = np.random.default_rng(1).normal(size=FIELD.shape)
    Path("both.csv").write_text(text(np.hstack([other, FIELD]), header="ax,ay,az,u,v,w"), encoding="utf-8")
    npt.assert_allclose(offset_of("both.csv", "--columns", "u,v,w"), TUMBLE.sensor.offset, atol=0.3)
    npt.assert_allclose(offset_of("both.csv", "--columns", "4,5,6"), TUMBLE.sensor.offset, atol=0.3)
    npt.assert_allclose(offset_of("both.csv", "--columns", "6,5,4"), TUMBLE.sensor.offset[::-1], atol=0.3)


@pytest.mark.parametrize(
    ("words", "factor", "unit"),
    [("", 1.0, "counts"), ("--unit mG", 0.1, "uT"), ("--unit G", 100.0, "uT"), ("--scale 0.15", 0.15, "uT"),
     ("--unit counts --scale 2", 2.0, "uT")],
)  # fmt: skip
def test_unit_and_scale(words: str, factor: float, unit: str, home: Path) -> None:
    Path("raw.csv").write_text(text(FIELD), encoding="utf-8")
    found = flinders_("calibrate", "raw.csv", *words.split(), "--json").json["calibration"]
    assert found["unit"] == unit
    npt.assert_allclose(found["offset"], TUMBLE.sensor.offset * factor, atol=0.3 * factor)


def test_axes_turn_the_recording_and_are_kept_in_the_file(home: Path) -> None:
    turned = TUMBLE.sensor.offset[[1, 0, 2]] * [1, -1, 1]
    npt.assert_allclose(offset_of("tumble.csv", "--axes", "y,-x,z", "-o", "out.json"), turned, atol=0.3)
    assert str(Calibration.load("out.json").axes) == "y,-x,z"


def test_a_known_field_strength_sets_the_scale(home: Path) -> None:
    found = flinders_(
        "calibrate", "tumble.csv", "--method", "consistent", "--field-strength", "49.8", "--target", "9", "--json"
    ).json
    assert found["method"] == "consistent"
    assert (found["calibration"]["field_strength"], found["calibration"]["field_strength_known"]) == (49.8, True)
    assert "scale-unknown" not in [finding["code"] for finding in found["findings"]]


def test_prior_none_leaves_the_prior_out(home: Path) -> None:
    hemisphere = simulate.tumble(seed=5, n=60, motion="hemisphere").samples.field
    Path("half.csv").write_text(text(hemisphere, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    for words, prior in ((("--prior", "none"), None), (("--prior", "0.05"), 0.05)):
        found = flinders_("calibrate", "half.csv", *words, "--target", "45", "--json").json
        wanted = flinders.fit(flinders.read("half.csv"), target_deg=45.0, method=flinders.estimators.Auto(prior=prior))
        npt.assert_allclose(found["calibration"]["offset"], wanted.calibration.offset)


def test_dip_changes_the_heading_error(home: Path) -> None:
    flat, steep = (flinders_("calibrate", "tumble.csv", "--dip", dip, "--json").json for dip in ("0", "-80"))
    assert abs(steep["heading_error_deg"]["dip_deg"]) == 80.0
    assert steep["heading_error_deg"]["worst"] > 2 * flat["heading_error_deg"]["worst"]


def test_the_target_decides_between_good_limited_and_refused(home: Path) -> None:
    worst = flinders_("calibrate", "tumble.csv", "--json").json["heading_error_deg"]["worst"]
    for share, code, verdict in ((2.0, 0, "good"), (0.5, 3, "limited"), (0.1, 4, "refused")):
        name = f"{verdict}.json"
        ended = flinders_("calibrate", "tumble.csv", "--target", f"{share * worst}", "-o", name, "--json")
        assert (ended.code, ended.json["verdict"]) == (code, verdict)
        assert Path(name).exists() == (code != 4)


def test_several_recordings_are_fitted_together(home: Path) -> None:
    for part, rows in enumerate((slice(250), slice(250, None))):
        Path(f"{part}.csv").write_text(text(FIELD[rows], header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    together = offset_of("0.csv", "1.csv", "-o", "out.json")
    npt.assert_allclose(together, offset_of("tumble.csv"), rtol=1e-9)
    provenance = calibration_file.read("out.json").provenance
    assert provenance is not None
    assert [(file.name, file.rows) for file in provenance.files] == [("0.csv", 250), ("1.csv", 350)]


def test_standard_input_is_a_recording(home: Path) -> None:
    piped = Path("tumble.csv").read_bytes()
    ended = flinders_("calibrate", "-", "-o", "out.json", "--json", stdin=piped)
    assert ended.json == flinders_("calibrate", "tumble.csv", "--json").json
    provenance = calibration_file.read("out.json").provenance
    assert provenance is not None
    assert (provenance.files[0].name, provenance.files[0].bytes) == ("standard input", len(piped))


def test_force_overwrites(home: Path) -> None:
    Path("out.json").write_text("kept", encoding="utf-8")
    assert flinders_("calibrate", "tumble.csv", "-o", "out.json").code == 6
    assert Path("out.json").read_text(encoding="utf-8") == "kept"
    assert flinders_("calibrate", "tumble.csv", "-o", "out.json", "--force").code == 0
    assert Calibration.load("out.json").unit == "uT"


# verdicts on the terminal


def test_a_limited_fit_says_what_it_is_good_for_and_how_to_move_on(home: Path) -> None:
    tilted = simulate.tumble(seed=5, motion="tilted").samples.field
    Path("deck.csv").write_text(text(tilted, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    ended = flinders_("calibrate", "deck.csv", "-o", "out.json")
    shown = " ".join(ended.out.split())
    assert ended.code == 3
    assert_sentences(shown)
    assert Path("out.json").exists()


def test_a_refused_fit_says_why_and_how_to_move_and_shows_no_number_to_copy(home: Path) -> None:
    hemisphere = simulate.tumble(seed=5, motion="hemisphere").samples.field
    Path("half.csv").write_text(text(hemisphere, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    ended = flinders_("calibrate", "half.csv", "--target", "0.001", "-o", "out.json")
    shown = " ".join(ended.err.split())
    assert (ended.code, ended.out) == (4, "")
    assert_sentences(shown)
    assert shown.casefold().count("record for longer") == 1
    assert "no calibration was written" in shown
    assert "matrix" not in shown
    assert not Path("out.json").exists()


def test_a_refused_fit_says_what_is_odd_about_the_recording_and_nothing_of_the_fit(home: Path) -> None:
    level = simulate.tumble(seed=5, motion="level").samples
    rows = [f"{time:.2f},{text(field[np.newaxis]).strip()}" for time, field in enumerate(level.field)]
    rows[10:12] = ["nan,nan,nan,nan", "what?"]
    rows[20:30] = rows[29:19:-1]
    Path("table.csv").write_text("\n".join(["time_s,mx_uT,my_uT,mz_uT", *rows, ""]), encoding="utf-8")
    shown = " ".join(flinders_("calibrate", "table.csv", "--method", "robust").err.split())
    assert_sentences(shown)
    assert "· time steps back 9 times" in shown
    assert "field strength" not in shown
    assert "of the sphere" not in shown


def test_a_refused_fit_has_its_evidence_in_json_and_no_calibration(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "--target", "0.001", "--json")
    assert_sentences(ended.err.splitlines()[-1])
    assert ended.json["verdict"] == "refused"
    assert ended.json["calibration"] is None
    assert ended.json["noise"] == pytest.approx(0.5, abs=0.05)
    assert ended.json["coverage"]["fraction"] > 0.9
    assert (ended.json["error"]["code"], ended.json["error"]["exit_code"]) == ("refused", 4)
    assert "heading-error" in ended.json["error"]["evidence"]


def test_a_refusal_without_a_fit_has_the_same_keys(home: Path) -> None:
    ended = flinders_("calibrate", "-", "--method", "likelihood", "--json", stdin="1,2,3\n2,3,4\n")
    assert ended.code == 4
    assert ended.json == {
        **dict.fromkeys(["method", "calibration", "heading_error_deg", "noise", "coverage"]),
        "verdict": "refused",
        "findings": [],
        "error": {
            "code": "too-few-samples",
            "message": ended.err.splitlines()[-1].removeprefix("refused: "),
            "exit_code": 4,
            "evidence": {"found": 2, "needed": 10, "method": "likelihood", "skipped": []},
        },
    }


def test_too_few_readings_are_told_with_what_was_skipped(home: Path) -> None:
    words = ("calibrate", "-", "--method", "likelihood")
    ended = flinders_(*words, "--json", stdin="1,2,3\n2,3,4\nwhat?\nnan,1,2\n")
    skipped = ["1 row without finite readings (line 4: 'nan,1,2')", "1 unreadable row (line 3: 'what?')"]
    assert_sentences(ended.err)
    assert ended.json["error"]["evidence"]["skipped"] == skipped
    assert_sentences(flinders_(*words, stdin="1,2,3\n").err)


def test_a_recording_in_counts_is_told_how_to_be_in_microtesla(home: Path) -> None:
    Path("raw.csv").write_text(text(FIELD * 300), encoding="utf-8")
    shown = " ".join(flinders_("calibrate", "raw.csv").out.split())
    assert_sentences(shown)
    assert "e+0" not in shown
    assert "no unit known" not in flinders_("calibrate", "raw.csv", "--scale", "0.0033").out


# the report in plain words


def test_the_report_is_written_beside_the_calibration(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "-o", "out.json", "--report-text", "report.txt")
    report = Path("report.txt").read_text(encoding="utf-8")
    assert ended.code == 0
    assert "GOOD" in ended.out
    assert_sentences(ended.err)
    assert "The calibration is good." in report
    assert "- tumble.csv: 600 readings." in report
    shown = re.findall(r"offset [xyz] +(-?[\d.]+) ± [\d.]+ µT", report)
    npt.assert_allclose(np.array(shown, float), Calibration.load("out.json").offset, atol=1e-3)


def test_the_report_can_take_the_place_of_the_page(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "--sensor", "hull 7", "--report-text", "-")
    assert_sentences(ended.out.splitlines()[0])
    assert "GOOD  worst" not in ended.out + ended.err
    assert not Path("-").exists()


def test_a_refusal_is_reported_too(home: Path) -> None:
    ended = flinders_("calibrate", "tumble.csv", "--target", "0.001", "-o", "out.json", "--report-text", "report.txt")
    report = Path("report.txt").read_text(encoding="utf-8")
    assert ended.code == 4
    assert_sentences(report)
    assert "offset" not in report
    assert not Path("out.json").exists()
    words = ("calibrate", "-", "--method", "likelihood", "--report-text", "-")
    ended = flinders_(*words, stdin="1,2,3\n2,3,4\nwhat?\n")
    assert ended.code == 4
    assert_sentences(ended.out)


@pytest.mark.parametrize(
    ("words", "code"),
    [("--report-text kept.txt", 6), ("--report-text tumble.csv --force", 2),
     ("--report-text - --json", 2),
     ("--report-text - -o -", 2),
     ("--report-text ./out.json -o out.json", 2), ("--report-text nix/a.txt", 6)],
)  # fmt: skip
def test_a_report_that_cannot_be_written_is_refused_before_reading(words: str, code: int, home: Path) -> None:
    Path("kept.txt").write_text("kept", encoding="utf-8")
    ended = flinders_("calibrate", "tumble.csv", *words.split())
    assert (ended.code, ended.err.count("\n")) == (code, 1)
    assert_sentences(ended.err)
    assert Path("kept.txt").read_text(encoding="utf-8") == "kept"
    assert flinders_("calibrate", "tumble.csv", "--report-text", "kept.txt", "--force").code == 0


@pytest.mark.parametrize(
    ("words", "code", "name"),
    [("calibrate nix.csv --json", 5, "unreadable"), ("calibrate tumble.csv -o nix/a.json --json", 6, "output"),
     ("calibrate tumble.csv --target x --json", 2, "usage"), ("calibrate tumble.csv --unit x --json", 2, "unit")],
)  # fmt: skip
def test_other_errors_are_json_too(words: str, code: int, name: str, home: Path) -> None:
    ended = flinders_(*words.split())
    assert ended.code == code
    assert ended.json["error"]["code"] == name
    assert ended.err.count("\n") == 1
    assert flinders_("--", "--json").out == ""


# apply


def test_apply_replaces_the_columns_by_what_the_calibration_gives(calibration: Calibration) -> None:
    ended = flinders_("apply", "calibration.json", "tumble.csv")
    lines = ended.out.splitlines()
    assert ended.code == 3
    assert lines[0] == "mx_uT,my_uT,mz_uT"
    wanted = calibration.apply(flinders.read("tumble.csv").field)
    assert lines[1:] == [",".join(f"{value:.9g}" for value in row) for row in wanted]
    assert "tumble.csv: 600 readings;" in ended.err


def test_apply_adds_columns(calibration: Calibration) -> None:
    recorded = Path("tumble.csv").read_text(encoding="utf-8").splitlines()
    lines = flinders_("apply", "calibration.json", "tumble.csv", "--add").out.splitlines()
    assert lines[0] == "mx_uT,my_uT,mz_uT,mx_uT_cal,my_uT_cal,mz_uT_cal"
    assert [line.split(",")[:3] for line in lines[1:]] == [line.split(",") for line in recorded[1:]]
    added = np.array([line.split(",")[3:] for line in lines[1:]], float)
    npt.assert_allclose(added, calibration.apply(flinders.read("tumble.csv").field), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize(
    ("recording", "decimal"),
    [
        ("# a note\r\nt;mx_uT;my_uT;mz_uT;fix\r\n0,5;{};{};{};ok\r\n1,0;{};{};{};ok\r\n", ","),
        ("t\tmx_uT\tmy_uT\tmz_uT\n0.5\t{}\t{}\t{}\n\n# pause\n1.0\t{}\t{}\t{}\n", "."),
        ("  {}  {}   {}\n {} {} {}\n", "."),
        ('"t","mx_uT","my_uT","mz_uT"\n"0.5","{}","{}","{}"\n"1.0","{}","{}","{}"\n', "."),
        ("\ufeffmx_uT,my_uT,mz_uT\r{},{},{}\r{},{},{}\r", "."),
        ("mz_uT, my_uT, mx_uT\n{2}, {1}, {0}\n{5}, {4}, {3}", "."),
    ],
    ids=[
        "semicolons, decimal comma, CR LF, text beside",
        "tabs, blank, comment",
        "spaces",
        "quotes",
        "BOM, CR",
        "z first",
    ],
)
def test_apply_leaves_the_rest_of_every_line_alone(recording: str, decimal: str, calibration: Calibration) -> None:
    def filled(field: Floats) -> str:
        return recording.format(*(f"{value:.9g}".replace(".", decimal) for value in field.ravel()))

    raw = TUMBLE.samples.field[:2].round(3)
    Path("raw.txt").write_bytes(filled(raw).encode())
    ended = flinders_("apply", "calibration.json", "raw.txt", "-o", "out.txt")
    assert ended.code == 0, ended.err
    corrected = Path("out.txt").read_bytes().decode()
    assert corrected.rstrip("\n") == filled(calibration.apply(raw)).rstrip("\n")


def test_apply_takes_unit_and_axes_from_the_file(home: Path) -> None:
    raw = Path("raw.csv")
    raw.write_text(text(FIELD * 10), encoding="utf-8")
    assert flinders_("calibrate", "raw.csv", "--unit", "mG", "--axes", "y,-x,z", "-o", "out.json").code == 0
    ended = flinders_("apply", "out.json", "raw.csv")
    correction = Calibration.load("out.json")
    wanted = correction.apply(FIELD[:, [1, 0, 2]] * [1, -1, 1]) / 0.1
    npt.assert_allclose(
        [[float(cell) for cell in line.split(",")] for line in ended.out.splitlines()], wanted, atol=1e-2
    )


def test_apply_refuses_a_recording_of_another_unit_or_sensor(calibration: Calibration) -> None:
    Path("nano.csv").write_text(text(FIELD * 300), encoding="utf-8")
    ended = flinders_("apply", "calibration.json", "nano.csv", "-o", "out.csv")
    assert ended.code == 5
    assert_sentences(ended.err)
    Calibration(calibration.matrix, calibration.offset, 50.0).save("counts.json")
    ended = flinders_("apply", "counts.json", "tumble.csv", "-o", "out.csv")
    assert ended.code == 2
    assert_sentences(ended.err)
    assert not Path("out.csv").exists()


def test_apply_doubts_a_strength_that_does_not_suit_the_calibration(home: Path) -> None:
    flinders.fit(flinders.read("tumble.csv")).save("calibration.json")
    calibration = Calibration.load("calibration.json")
    assert "!" not in flinders_("apply", "calibration.json", "tumble.csv").err
    uneven = (FIELD - calibration.offset) * [1.0, 1.4, 1.2] + calibration.offset
    stronger = (FIELD - calibration.offset) * 1.4 + calibration.offset
    for name, field in (("uneven.csv", uneven), ("stronger.csv", stronger)):
        Path(name).write_text(text(field, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
        ended = flinders_("apply", "calibration.json", name, "-o", "out.csv", "--force")
        assert ended.code == 3
        assert_sentences(ended.err)


def test_apply_reads_standard_input_and_reports_in_json(calibration: Calibration) -> None:
    piped = Path("tumble.csv").read_bytes() + b"nan,1,2\nwhat?\n"
    ended = flinders_("apply", "calibration.json", "-", "-o", "out.csv", "--json", stdin=piped)
    assert ended.code == 3
    assert set(ended.json) == {"readings", "strength", "spread", "skipped", "limits"}
    assert_sentences(ended.json["limits"][0])
    assert ended.json["readings"] == 600
    assert 0.8 < ended.json["strength"] < 1.25
    assert len(ended.json["skipped"]) == 2
    lines = Path("out.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "mx_uT,my_uT,mz_uT"
    assert lines[-1] == "nan,nan,nan"
    assert len(lines) == 602


# as a program of its own


def start(*words: str, scratch: Path, **streams: Any) -> subprocess.Popen[bytes]:
    """Start the program with a folder of its own for temporary files, and with Ctrl-C switched on."""
    return subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *words],
        env={**os.environ, "TMPDIR": str(scratch), "PYTHONIOENCODING": "utf-8"},
        **{"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams},
    )


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 300,000 rows."""
    path = tmp_path_factory.mktemp("large") / "large.csv"
    path.write_text("mx_uT,my_uT,mz_uT\n" + text(FIELD) * 500, encoding="utf-8")
    return path


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    folder = tmp_path / "scratch"
    folder.mkdir()
    return folder


def wait_for(happened: Callable[[], object], process: subprocess.Popen[bytes]) -> None:
    """Wait until something happens while a process runs."""
    wait_until(lambda: happened() or process.poll() is not None)
    assert process.poll() is None, process.communicate()[1].decode()


@pytest.mark.parametrize("stop", daily(["SIGINT", "SIGTERM", "SIGHUP"]))
def test_apply_that_is_interrupted_leaves_nothing_behind(
    stop: str, large: Path, calibration: Calibration, scratch: Path, home: Path
) -> None:
    (home / "out").mkdir()
    process = start("apply", "calibration.json", str(large), "-o", "out/out.csv", scratch=scratch)
    wait_for(lambda: any(path.stat().st_size for path in (home / "out").iterdir() if path.exists()), process)
    process.send_signal(getattr(signal, stop))
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.decode().split() == ["interrupted"]
    assert [*(home / "out").iterdir(), *scratch.iterdir()] == []


def test_a_program_that_is_to_outlive_its_terminal_does() -> None:
    """`nohup` has the signal ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with handle_signals(interrupt, *STOP_SIGNALS):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_calibrate_that_is_interrupted_leaves_nothing_behind(large: Path, scratch: Path, home: Path) -> None:
    process = start("calibrate", str(large), "-o", "out.json", scratch=scratch)
    assert process.stderr is not None
    said = process.stderr.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, b""), err
    assert said.startswith(b"large.csv: columns")
    assert err.decode().split() == ["interrupted"]
    assert [*scratch.iterdir(), *home.glob("*.json"), *home.glob(".*")] == []


@pytest.mark.parametrize(
    "words", daily([(("calibrate", "-", "-o", "out.json"),), (("apply", "calibration.json", "-", "-o", "out.csv"),)])
)
def test_ctrl_c_while_reading_standard_input(
    words: tuple[str, ...], calibration: Calibration, scratch: Path, home: Path
) -> None:
    process = start(*words, scratch=scratch)
    assert process.stdin is not None
    process.stdin.write(text(FIELD).encode() * 40)  # more than a pipe holds: it is being read
    process.stdin.flush()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.decode().split() == ["interrupted"]
    assert sorted(path.name for path in home.iterdir()) == ["calibration.json", "scratch", "tumble.csv"]
    assert list(scratch.iterdir()) == []


def test_a_reader_that_has_seen_enough_is_no_error_message(
    large: Path, calibration: Calibration, scratch: Path
) -> None:
    process = start("apply", "calibration.json", str(large), scratch=scratch)
    assert process.stdout is not None
    assert process.stdout.readline() == b"mx_uT,my_uT,mz_uT\n"
    process.stdout.close()
    process.stdout = None
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (6, b"")


def test_apply_follows_a_sensor_that_is_still_running(calibration: Calibration, scratch: Path) -> None:
    process = start("apply", "calibration.json", "-", scratch=scratch)
    assert process.stdin is not None
    assert process.stdout is not None
    for part in (FIELD[:100], FIELD[100:120]):
        process.stdin.write(text(part).encode())
        process.stdin.flush()
        lines = [process.stdout.readline() for _ in part]
        npt.assert_allclose(np.loadtxt(lines, delimiter=","), calibration.apply(part.round(4)), rtol=1e-8)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 3  # these readings do not suit it
    assert "standard input: 120 readings;" in err.decode()
    assert list(scratch.iterdir()) == []


def test_a_closed_stream_of_talk_is_no_fault(home: Path) -> None:
    done = subprocess.run(["sh", "-c", '"$@" 2>&-', "sh", *PROGRAM, "demo"], check=False, capture_output=True)
    assert done.returncode == 0, done.stderr


def test_appending_to_the_recording_itself_is_refused(calibration: Calibration) -> None:
    before = Path("tumble.csv").read_bytes()
    with Path("tumble.csv").open("ab") as file:
        words = ["apply", "calibration.json", "tumble.csv"]
        done = subprocess.run([*PROGRAM, *words], check=False, stdout=file, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert b"would be overwritten" in done.stderr
    assert Path("tumble.csv").read_bytes() == before


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc here")
def test_apply_takes_no_more_memory_for_a_longer_recording(large: Path, calibration: Calibration, home: Path) -> None:
    short = home / "short.csv"
    short.write_text("mx_uT,my_uT,mz_uT\n" + text(FIELD) * 50, encoding="utf-8")
    peaks = []
    for path in (short, large):
        words = ["apply", "calibration.json", str(path), "-o", f"{path.stem}.out"]
        run = f"from flinders.cli import main; main({words!r}, standalone_mode=False)"
        code = f"{run}\nprint(open('/proc/self/status').read())"
        done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
        found = re.search(r"VmHWM:\s+(\d+) kB", done.stdout)
        assert found
        peaks.append(int(found[1]) / 1024)
    assert peaks[1] - peaks[0] < 25, f"{peaks[0]:.0f} MB for 30,000 rows, {peaks[1]:.0f} MB for 300,000"


# on a terminal


def terminal(*words: str, columns: int = 80, environment: Mapping[str, str] = MappingProxyType({})) -> tuple[int, str]:
    """Run the program on a terminal of its own; returns the exit code and all that appears there."""
    pty, termios = pytest.importorskip("pty"), pytest.importorskip("termios")
    ours, its = pty.openpty()
    termios.tcsetwinsize(its, (24, columns))
    kept = {
        name: value for name, value in os.environ.items() if name not in {"COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR"}
    }
    process = subprocess.Popen(
        [*PROGRAM, *words],
        stdin=its,
        stdout=its,
        stderr=its,
        env={**kept, "TERM": "xterm-256color", "PYTHONIOENCODING": "utf-8", **environment},
    )
    os.close(its)
    seen = bytearray()
    while True:
        try:
            chunk = os.read(ours, 65536)
        except OSError:  # how Linux says that nobody is left at the other end
            break
        if not chunk:
            break
        seen += chunk
    os.close(ours)
    return process.wait(timeout=60), seen.decode().replace("\r\n", "\n")


def without_colours(shown: str) -> str:
    return re.sub(r"\x1b\[[0-9;]*m", "", shown)


@pytest.mark.parametrize("columns", daily([80, 120]))
def test_a_terminal_gets_colours_and_lines_that_fit(columns: int, home: Path) -> None:
    hemisphere = simulate.tumble(seed=5, motion="hemisphere").samples.field
    Path("half.csv").write_text(text(hemisphere, header="mx_uT,my_uT,mz_uT"), encoding="utf-8")
    code, shown = terminal("calibrate", "half.csv", columns=columns)
    assert code == 3
    assert "\x1b[1;33mLIMITED" in shown
    lines = without_colours(shown).splitlines()
    assert max(map(len, lines)) <= min(columns, 100)
    assert max(map(len, lines)) > min(columns, 100) - 20


def test_numbers_stay_whole_on_a_narrow_terminal(home: Path) -> None:
    _, narrow = terminal("calibrate", "tumble.csv", columns=30)
    numbers = re.findall(r"-?\d+\.\d+ ± \d+\.\d+|-?\d\.\d{6}", without_colours(narrow))
    assert len(numbers) == 12
    assert "…" not in narrow


def test_the_numbers_stand_below_each_other_on_their_points(home: Path) -> None:
    out = flinders_("calibrate", "tumble.csv").out
    rows = [line for line in out.splitlines() if re.match(r"(offset|matrix|      ) +-?\d", line)]
    assert len(rows) == 4
    points = [
        [found.start() for found in re.finditer(r"\.(?=\d+(?: ±|\b))", re.sub(r"± \d+\.", "± 0 ", row))] for row in rows
    ]
    assert points == [points[0]] * 4
    assert len(points[0]) == 3


@pytest.mark.parametrize(
    ("environment", "words"),
    daily(
        [
            ({"NO_COLOR": "1"}, "calibrate tumble.csv --target 0.001"),
            ({"NO_COLOR": "1"}, "methods"),
            ({"TERM": "dumb"}, "calibrate tumble.csv"),
        ]
    ),
)
def test_no_colours_where_they_are_not_wanted(environment: dict[str, str], words: str, home: Path) -> None:
    _, shown = terminal(*words.split(), environment=environment)
    assert "\x1b" not in shown


def test_json_on_a_terminal_is_json(home: Path) -> None:
    _, shown = terminal("calibrate", "tumble.csv", "--json")
    assert json.loads(shown[shown.index("{") : shown.rindex("}") + 1])["verdict"] == "good"


def test_a_bar_is_shown_for_a_long_file_on_a_terminal_only(
    large: Path, calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, shown = terminal("apply", "calibration.json", str(large), "-o", "out.csv")
    assert "correcting" in shown
    assert "MB" in shown
    _, shown = terminal("apply", "calibration.json", "tumble.csv", "-o", "small.csv")
    assert "correcting" not in shown
    assert "\x1b" not in shown
    monkeypatch.setattr(_output, "MIN_BYTES_FOR_BAR", 1)
    ended = flinders_("apply", "calibration.json", "tumble.csv", "-o", "again.csv")
    assert "correcting" not in ended.err + ended.out


def test_a_letter_that_the_terminal_lacks_is_no_fault(home: Path) -> None:
    done = subprocess.run(
        [*PROGRAM, "calibrate", "tumble.csv"],
        check=False,
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "latin-1"},
    )
    assert done.returncode == 0, done.stderr
    assert "????\nuncorrected" in done.stdout.decode("latin-1")  # the rule below the head of a table
