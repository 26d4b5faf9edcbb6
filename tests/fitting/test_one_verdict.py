"""A recording has one verdict: the same word on terminal, page and report, in JSON, file and notebook."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from flinders import simulate
from flinders.cli import main
from flinders.fitting.fit_file import load
from flinders.report.notebook import html_of
from flinders.simulate.recording import write_csv

EXITS = {"good": 0, "limited": 3, "refused": 4}
CASES = {
    "good": simulate.tumble(seed=1),
    "limited": simulate.tumble(seed=1, motion="tilted"),
    "refused": simulate.tumble(seed=3, disturbances=[simulate.Step([6.0, 0.0, -4.0], at=0.5)]),
}


@pytest.mark.parametrize("verdict", CASES)
def test_all_renderings_have_the_word(verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_csv(CASES[verdict].samples, "tumble.csv")
    words = ["calibrate", "tumble.csv", "--report", "report.html", "-o", "c.json"]
    shown = CliRunner().invoke(main, words)
    told = json.loads(CliRunner().invoke(main, ["calibrate", "tumble.csv", "--json"]).stdout)
    assert (shown.exit_code, told["verdict"]) == (EXITS[verdict], verdict)
    assert f"{verdict.upper()}  " in shown.output
    assert f">{verdict.capitalize()}</h1>" in Path("report.html").read_text(encoding="utf-8")
    if verdict == "refused":
        assert not Path("c.json").exists()
    else:
        loaded = load("c.json")
        assert loaded.verdict == verdict
        assert f" {verdict}: " in html_of(loaded)
