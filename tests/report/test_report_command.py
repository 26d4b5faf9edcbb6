"""`flinders report`, `flinders calibrate --report`: what they write, and what they refuse."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner, Result
from tests.sentences import assert_sentences
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main
from flinders.cli._output import plot_fit

if TYPE_CHECKING:
    from collections.abc import Sequence


def run(*words: str) -> Result:
    return CliRunner().invoke(main, list(words), prog_name="flinders")


def write(path: str, motion: str = "uniform", *, n: int = 400, axes: Sequence[int] = (0, 1, 2)) -> None:
    field = simulate.tumble(seed=2, n=n, motion=motion).samples.field[:, list(axes)]
    write_field(path, field)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, its calibration and its report."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as context:
        context.chdir(folder)
        write("tumble.csv")
        assert run("calibrate", "tumble.csv", "-o", "calibration.json", "--report", "fit.html").exit_code == 0
    return folder


@pytest.fixture(autouse=True)
def calibrated(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def test_calibrate_and_report_write_the_same_words() -> None:
    from tests.report.test_report import Page

    assert run("report", "calibration.json", "tumble.csv", "-o", "again.html").exit_code == 0
    made, again = (
        Page.of(Path(name).read_text(encoding="utf-8")).words.split("How to apply it")[0].split("Compass", 2)[2]
        for name in ("fit.html", "again.html")
    )
    assert made == again


def test_a_report_names_the_file_its_hash_and_the_options() -> None:
    import hashlib

    digest = hashlib.sha256(Path("tumble.csv").read_bytes()).hexdigest()
    assert run("calibrate", "tumble.csv", "--target", "0.5", "--report", "r.html").exit_code == 0
    text = Path("r.html").read_text(encoding="utf-8")
    assert digest in text
    assert "<dt>--target</dt><dd>0.5</dd>" in text
    assert "<dt>--dip</dt>" not in text


def test_a_report_has_code_for_targets() -> None:
    text = Path("fit.html").read_text(encoding="utf-8")
    for target in ("correction.py", "c.h", "json.json"):
        assert target in text
    assert text.count("<details") == text.count("</details>") >= 14
    assert text.count(" open>") == 1


def test_the_default_is_report_html_and_nothing_is_written_over() -> None:
    assert run("report", "calibration.json", "tumble.csv").exit_code == 0
    assert Path("report.html").exists()
    again = run("report", "calibration.json", "tumble.csv")
    assert (again.exit_code, "--force" in again.output) == (6, True)
    assert run("report", "calibration.json", "tumble.csv", "--force").exit_code == 0


def test_a_report_of_another_recording_says_so() -> None:
    write("other.csv", n=500)
    done = run("report", "calibration.json", "other.csv")
    assert done.exit_code == 0
    assert_sentences(done.output)
    assert_sentences(Path("report.html").read_text(encoding="utf-8"), about="recording shown")


def test_a_refused_recording_gets_a_report_too() -> None:
    write("table.csv", "level", axes=(2, 0, 1))
    done = run("calibrate", "table.csv", "-o", "none.json", "--report", "refused.html")
    assert done.exit_code == 4
    assert not Path("none.json").exists()
    assert "Refused" in Path("refused.html").read_text(encoding="utf-8")


def test_one_that_gives_no_fit_gets_one_that_says_why() -> None:
    Path("short.csv").write_text("mx,my,mz\n1,2,3\n4,5,6\n", encoding="utf-8")
    assert run("calibrate", "short.csv", "--report", "short.html").exit_code == 4
    assert "2 usable readings" in Path("short.html").read_text(encoding="utf-8")


def test_names_with_markup_are_words(tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("no such names there")
    name = "<script>alert(1)<&script>.csv"
    write(name)
    done = run("calibrate", name, "--sensor", "<img src=x onerror=alert(1)>", "-o", "c.json", "--report", "c.html")
    assert done.exit_code == 0
    text = Path("c.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "<img" not in text
    assert "&lt;img src=x onerror" in text


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("report", "calibration.json"), 2, "RECORDING"),
        (("report", "tumble.csv", "calibration.json"), 2, "comes first"),
        (("report", "calibration.json", "none.csv"), 5, "does not exist"),
        (("report", "none.json", "tumble.csv"), 5, "no such file"),
        (("report", "calibration.json", "tumble.csv", "-o", "r.pdf"), 2, "--pdf r.pdf"),
        (("report", "calibration.json", "tumble.csv", "-o", "tumble.csv", "--force"), 2, "would be overwritten"),
        (("report", "calibration.json", "tumble.csv", "-o", "calibration.json", "--force"), 2, "overwritten"),
        (("report", "calibration.json", "tumble.csv", "-o", "no/such/a.html"), 6, "no such folder"),
        (("report", "calibration.json", "tumble.csv", "--pdf", "-"), 2, "needs a file"),
        (("report", "calibration.json", "tumble.csv", "tumble.csv"), 2, "given twice"),
        (("report", "calibration.json", "calibration.json"), 2, "is a calibration too"),
        (("calibrate", "tumble.csv", "--report", "-"), 2, "megabyte"),
        (("calibrate", "tumble.csv", "--report", "r.pdf"), 2, "flinders report"),
        (("calibrate", "tumble.csv", "--report", "a.txt", "--report-text", "a.txt"), 2, "two different names"),
        (("calibrate", "tumble.csv", "--report", "tumble.csv", "--force"), 2, "would be overwritten"),
        (("calibrate", "--minmax", "1,2,3,4,5,6", "--report", "r.html"), 2, "gives no readings"),
        (("calibrate", "tumble.csv", "--sensor", "all", "--report", "r.html"), 2, "for one magnetometer"),
    ],
)
def test_what_cannot_work_is_one_line(words: Sequence[str], code: int, said: str) -> None:
    done = run(*words)
    assert (done.exit_code, said in done.stderr) == (code, True), done.stderr
    assert "Traceback" not in done.output


def test_json_says_what_was_written() -> None:
    found = json.loads(run("report", "calibration.json", "tumble.csv", "--json").stdout)
    assert found == {"report": "report.html", "pdf": None, "verdict": "good", "notes": []}
    refused = run("report", "calibration.json", "tumble.csv", "-o", "-", "--json")
    assert refused.exit_code == 2
    assert_sentences(refused.output)


def test_a_report_goes_to_standard_output_where_that_is_piped() -> None:
    assert run("report", "calibration.json", "tumble.csv", "-o", "-").stdout.startswith("<!doctype html>")


def test_no_browser_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", os.fspath(Path.cwd()))
    done = run("report", "calibration.json", "tumble.csv", "--pdf", "r.pdf")
    assert done.exit_code == 6
    assert_sentences(done.stderr)
    assert not Path("r.pdf").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a script of a shell")
@pytest.mark.parametrize("script", ["#!/bin/sh\necho no display >&2\nexit 1\n", "#!/bin/sh\nexit 0\n"])
def test_a_browser_that_fails_is_one_line(script: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "chromium"
    program.write_text(script, encoding="utf-8")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    done = run("report", "calibration.json", "tumble.csv", "--pdf", "r.pdf")
    assert done.exit_code == 6
    assert_sentences(done.stderr)
    assert not Path("r.pdf").exists()


def test_an_imported_calibration_is_shown_without_a_claim() -> None:
    assert run("export", "--for", "sensorlab", "calibration.json", "-o", "lab.json").exit_code == 0
    assert run("import", "lab.json", "-o", "imported.json").exit_code == 0
    assert run("report", "imported.json", "tumble.csv").exit_code == 0
    assert "Of unknown quality" in Path("report.html").read_text(encoding="utf-8")


def test_nothing_is_drawn_where_output_is_piped() -> None:
    assert not any("⠀" <= letter <= "⣿" for letter in run("calibrate", "tumble.csv").output)


class Terminal:
    """A stream that is one."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


def drawn_lines(monkeypatch: pytest.MonkeyPatch, encoding: str) -> list[str]:
    """What a terminal of this encoding is given."""
    import flinders

    samples = simulate.tumble(seed=2, n=400).samples
    stream, shown = Terminal(), io.StringIO()
    stream.encoding = encoding
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(click, "echo", lambda text="", err=False: shown.write(f"{text}\n" if not err else ""))
    plot_fit(flinders.fit(samples), samples)
    return shown.getvalue().splitlines()


def test_a_terminal_gets_at_most_fourteen_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    lines = drawn_lines(monkeypatch, "utf-8")
    assert 12 <= len(lines) <= 14
    assert "\x1b" not in "".join(lines)
    assert any("⠀" < letter <= "⣿" for letter in "".join(lines))


def test_a_terminal_without_such_letters_gets_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert "".join(drawn_lines(monkeypatch, "latin-1")).replace("°", "").isascii()


def test_a_dumb_terminal_gets_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    assert drawn_lines(monkeypatch, "utf-8") == []
