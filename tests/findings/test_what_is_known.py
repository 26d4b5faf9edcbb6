"""What is known is used and said: the site in a log, the unit of counts, the next command, the word that was meant."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences

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
def tumbled() -> str:
    write_csv(tumble(seed=1).samples, "tumble.csv")
    return "tumble.csv"


def test_a_dip_that_nobody_gave_is_marked_as_assumed(tumbled: str) -> None:
    assert "dip 60° (assumed)" in " ".join(run(f"calibrate {tumbled}").stdout.split())
    for line, code in ((f"{tumbled} --dip 60", 0), (f"{tumbled} --at 47,8 --date 2026-01-08", 0)):
        assert "(assumed)" not in run(f"calibrate {line}", code).stdout


def test_counts_of_the_strength_of_the_earths_field_are_proposed_a_unit() -> None:
    np.savetxt("counts.txt", 10.0 * tumble(seed=1).samples.field, fmt="%.2f")
    said = run("calibrate counts.txt").stderr
    assert_sentences(said)
    known = run("calibrate counts.txt --unit mG")
    assert "the earth's" not in known.stderr


def test_what_nearly_every_fit_says_is_printed_on_request_and_kept_in_the_file(tumbled: str) -> None:
    brief = " ".join(run(f"calibrate {tumbled} -o c.json").stdout.split())
    verbose = " ".join(run(f"calibrate {tumbled} --verbose").stdout.split())
    for note in ("field strength unknown", "mounting angle"):
        assert note not in brief
        assert note in verbose
    codes = [finding["code"] for finding in json.loads(Path("c.json").read_text())["fit"]["findings"]]
    assert {"scale-unknown", "rotation-unknown"} <= set(codes)
    assert_sentences(brief)


def test_a_calibration_is_shown_and_the_next_command_is_named(tumbled: str) -> None:
    assert_sentences(run(f"calibrate {tumbled} -o c.json").stderr)
    assert "next: " not in run(f"calibrate {tumbled} -o d.json --export arduino").stderr
    shown = run("show c.json").stdout
    for words in ("tumble.csv, 3,000 readings", "offset", "matrix", "GOOD  Headings", "0.066°", "dip 60°"):
        assert words in shown
    assert "mounting angle" not in shown
    assert "mounting angle" in run("show c.json --verbose").stdout
    assert run("show c.json --json").stdout == Path("c.json").read_text()
    assert_sentences(run("show tumble.csv", 2).stderr)


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("export --for ardiuno c.json", "arduino"),
        ("calibrate tumble.csv --method minmx", "minmax"),
        ("calibrate tumble.csv --columns mag_x_uT,mag_y_uT,mag_z", "mag_z_uT"),
    ],
)
def test_a_word_that_is_nearly_right_is_recognised(line: str, meant: str, tumbled: str) -> None:
    run(f"calibrate {tumbled} -o c.json")
    assert_sentences(run(line, 2).stderr)


def test_a_recipe_of_the_extremes_prints_its_table() -> None:
    run("simulate three-axis -o even.csv --soft-iron 0 --noise 0.1")
    shown = run("calibrate even.csv --method minmax").stdout.splitlines()
    assert any(line.split() == ["min", "max", "offset", "half-range", "scale"] for line in shown)


def test_numbers_of_a_refused_recipe_are_marked_and_nothing_is_written(tumbled: str) -> None:
    plain = run(f"calibrate {tumbled} --method minmax -o c.json", 4)
    assert "half-range" not in plain.output
    insisted = run(f"calibrate {tumbled} --method minmax --even-if-refused -o c.json", 4)
    assert_sentences(insisted.stdout.strip())
    x = next(line.split() for line in insisted.stdout.splitlines() if line.startswith("x "))
    field = tumble(seed=1).samples.field[:, 0].round(4)
    assert [float(cell) for cell in x[1:3]] == [field.min(), field.max()]
    as_json = json.loads(run(f"calibrate {tumbled} --method minmax --even-if-refused --json", 4).stdout)
    assert as_json["calibration"] is None
    assert as_json["refused_calibration"]["matrix"][0][1] == 0.0
    assert not Path("c.json").exists()
    assert_sentences(run(f"calibrate {tumbled} --even-if-refused", 2).stderr)


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
