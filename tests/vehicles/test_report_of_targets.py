"""Parameters of autopilots in a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.program import flinders_
from tests.worlds import write_field

from flinders import simulate

if TYPE_CHECKING:
    from pathlib import Path


def test_a_report_has_parameters_for_autopilots(tmp_path: Path) -> None:
    write_field(tmp_path / "tumble.csv", simulate.tumble(seed=2, n=400, motion="uniform").samples.field)
    report = tmp_path / "fit.html"
    assert flinders_("calibrate", str(tmp_path / "tumble.csv"), "--report", str(report)).code == 0
    text = report.read_text(encoding="utf-8")
    assert all(target in text for target in ("ardupilot.param", "px4.params"))
    assert text.count("<details") == text.count("</details>") >= 20
