"""What each target is given, to the letter; and the page of the docs that has a section for each."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import ROOT, assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.exporters import EXPORTERS

if TYPE_CHECKING:
    from pathlib import Path

    from tests.golden.sessions import Golden

    from flinders.exporters import Exporter

ROWS = [row for row in EXPORTERS.values() if row.docs == "targets.md"]


@pytest.fixture(autouse=True)
def calibrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With soft iron all over, along the axes alone, and with next to none of it; in milligauss and in counts."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    along, hardly = np.diag([0.97, 1.05, 0.98]), np.diag([1.003, 1.0, 0.997])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(hardly, offset, 49.4, raw=Unit.of("mG")).save("round.json")
    Calibration(along, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("counts.json")
    Calibration(hardly, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("round-counts.json")


def line(row: Exporter) -> str:
    """The command that shows a target."""
    name = "round" if row.sheet.keeps == "offset" else "calibration"
    if row.sheet.unit == "counts":
        name = "round-counts" if row.sheet.keeps == "offset" else "counts"
    command = f"flinders export --to {row.name} {name}.json"
    return f"{command} -o calibration{row.suffix}" if row.suffix == ".bin" else command


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_each_target(row: Exporter, golden: Golden) -> None:
    golden(f"cli/target-{row.name}.txt", session(line(row)))


def test_soft_iron_that_has_no_room(golden: Golden) -> None:
    golden("cli/target-refused.txt", session("flinders export --to betaflight counts.json -o mag.txt", code=4))


def test_the_list_of_targets(golden: Golden) -> None:
    golden("cli/targets.txt", session("flinders targets"))


def test_there_and_back(golden: Golden) -> None:
    lines = (
        "flinders export --to ardupilot --compass 2 calibration.json -o compass.param",
        "flinders import compass.param -o back.json",
    )
    golden("cli/import.txt", session(*lines))


@pytest.mark.parametrize("command", ["targets", "import"])
def test_help(command: str, golden: Golden) -> None:
    golden(f"cli/flinders-{command}-help.txt", session(f"flinders {command} --help"))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_the_docs_have_a_section_for_each_with_what_its_table_says(row: Exporter) -> None:
    """Formula, unit, axes, what it holds, how it is kept, and the source, word for word."""
    text = (ROOT / "docs" / "targets.md").read_text(encoding="utf-8")
    found = re.search(rf"^## [^\n]*`{re.escape(row.name)}`[^\n]*\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"docs/targets.md has no section for `{row.name}`"
    missing = [fact for fact in facts(row) if fact not in found[1]]
    assert not missing, f"docs/targets.md, `{row.name}`, lacks {missing}"


def facts(row: Exporter) -> list[str]:
    """The rows of the table of a section."""
    sheet = row.sheet
    unit = {"own": "that of the calibration, µT or counts", "recorded": "that of the recording"}.get(
        sheet.unit, sheet.unit
    )
    return [
        f"| formula | `{sheet.formula}` |",
        f"| unit | {unit} |",
        f"| axes | {sheet.where} |",
        f"| holds | {sheet.holds} |",
        f"| lengths | {sheet.lengths or 'those of the calibration'} |",
        f"| storage | {sheet.storage} |",
        f"| source | {sheet.source} |",
        f"| `flinders import` | {'reads it back' if row.reader else 'no'} |",
        *(f"| **not verified** | {clause} |" for clause in sheet.unverified),
        f"<!-- tests/golden/files/cli/target-{row.name}.txt -->",
    ]


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("targets.md", request, least=len(ROWS))
