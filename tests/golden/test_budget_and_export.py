"""What `flinders budget` and `flinders export` print, to the letter."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flinders.calibration import Calibration
from flinders.cli import main
from flinders.units import Unit

if TYPE_CHECKING:
    from collections.abc import Callable

    Golden = Callable[[str, str], None]

ROOT = Path(__file__).resolve().parent.parent.parent
SESSION = re.compile(r"<!-- (tests/golden/files/cli/\S+) -->\n```console\n(.*?)```\n", re.DOTALL)


@pytest.fixture(autouse=True)
def calibrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A calibration that fits the registers, and one of a field strength in another unit, which does not."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(2 * matrix, offset, 98.8, True, raw=Unit.of("mG")).save("doubled.json")


def session(*lines: tuple[str, int]) -> str:
    """What a terminal shows for some command lines, each with the code it ends with."""
    shown = ""
    for line, code in lines:
        ended = CliRunner().invoke(main, line.split()[1:], prog_name="flinders")
        shown += f"$ {line}\n{ended.output}"
        assert ended.exit_code == code, shown
    return shown


def test_budget(golden: Golden) -> None:
    lines = (
        "flinders budget heading --field 150mG --error 1deg",
        "flinders budget wire --current 0.2A --distance 1cm",
        "flinders budget wire --current 0.2A --field 150mG --error 1deg",
        "flinders budget pair --current 10A --separation 5mm --field 20uT --error 1deg",
        "flinders budget magnet --remanence 1.3T --volume 0.236cm3 --distance 30cm --field 20uT",
    )
    golden("cli/budget.txt", session(*((line, 0) for line in lines)))


def test_export(golden: Golden) -> None:
    golden("cli/export.txt", session(("flinders export --to adis16480 calibration.json", 0)))


def test_export_of_what_does_not_fit(golden: Golden) -> None:
    golden("cli/export-refused.txt", session(("flinders export --to adis16480 doubled.json -o registers.txt", 4)))


def test_the_list_of_targets(golden: Golden) -> None:
    golden("cli/export-list.txt", session(("flinders export --list", 0)))


@pytest.mark.parametrize(
    "command", ["export", "budget", "budget heading", "budget wire", "budget pair", "budget magnet"]
)
def test_help(command: str, golden: Golden) -> None:
    golden(f"cli/flinders-{command.replace(' ', '-')}-help.txt", session((f"flinders {command} --help", 0)))


@pytest.mark.parametrize("name", ["budget.md", "registers.md"])
def test_the_sessions_in_the_docs_are_real(name: str, request: pytest.FixtureRequest) -> None:
    page = ROOT / "docs" / name
    text = page.read_text(encoding="utf-8")

    def real(found: re.Match[str]) -> str:
        return f"<!-- {found[1]} -->\n```console\n{(ROOT / found[1]).read_text(encoding='utf-8')}```\n"

    renewed = SESSION.sub(real, text)
    assert SESSION.search(text)
    if request.config.getoption("--regenerate", default=False):
        page.write_text(renewed, encoding="utf-8")
    else:
        assert text == renewed, f"docs/{name} shows another session than its golden files: `pytest --regenerate`"
