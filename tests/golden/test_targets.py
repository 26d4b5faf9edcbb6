"""What each target is given, to the letter; and the page of the docs that has a section for each.

A new target adds its own golden file. What lists all targets has none: the page of the docs stands in for it, and
``pytest --regenerate`` makes it anew from the rows. It keeps the words between the heading of a section and its table.
"""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import ROOT, assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import registry
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from pathlib import Path

    from tests.golden.sessions import Golden

    from flinders.targets import Target

ROWS = [row for row in registry().values() if row.docs == "targets.md"]


@pytest.fixture(autouse=True)
def calibrations(page_of_80_columns: None) -> None:
    """With soft iron all over, along the axes alone, and with next to none of it; in milligauss and in counts."""
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    along, hardly = np.diag([0.97, 1.05, 0.98]), np.diag([1.003, 1.0, 0.997])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(hardly, offset, 49.4, raw=Unit.of("mG")).save("round.json")
    Calibration(along, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("counts.json")
    Calibration(hardly, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("round-counts.json")


def line(row: Target) -> str:
    """The command that shows a target."""
    name = "round" if row.keeps == "offset" else "calibration"
    if row.unit == "counts":
        name = "round-counts" if row.keeps == "offset" else "counts"
    command = f"flinders export --to {row.name} {name}.json"
    return f"{command} -o calibration{row.suffix}" if row.suffix == ".bin" else command


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_each_target(row: Target, golden: Golden) -> None:
    golden(f"cli/target-{row.name}.txt", session(line(row)))


def test_soft_iron_that_has_no_room(golden: Golden) -> None:
    golden("cli/target-refused.txt", session("flinders export --to betaflight counts.json -o mag.txt", code=4))


def test_a_rotation_becomes_the_mounting(golden: Golden) -> None:
    turned = euler(3.0, -8.0, 40.0) @ np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    found = Calibration(turned, np.array([-69.8, 68.9, -5.6]), 49.4, rotation="estimated", raw=Unit.of("G"))
    found.save("turned.json")
    golden("cli/mounting.txt", session("flinders export --to px4-shell --mounting YAW_270 turned.json"))


def test_there_and_back(golden: Golden) -> None:
    lines = (
        "flinders export --to ardupilot --compass 2 calibration.json -o compass.param",
        "flinders import compass.param -o back.json",
    )
    golden("cli/import.txt", session(*lines))


# the page of the docs

PAGE = ROOT / "docs" / "targets.md"
LIVE = re.compile(r"(?<=<!-- made from the rows -->\n```console\n)\$ (flinders [^\n]+)\n.*?(?=```\n)", re.DOTALL)
REFUSING = re.compile(r"(?<=<!-- refusing -->).*?(?=<!-- end -->)")
SECTION = re.compile(r"^## [^\n]*`([^`\n]+)`\n\n(.*?)^\| \| \|\n.*?(?=^## )", re.MULTILINE | re.DOTALL)


def facts(row: Target) -> list[str]:
    """The rows of the table of a section."""
    unit = {"own": "that of the calibration, µT or counts", "recorded": "that of the recording"}.get(row.unit, row.unit)
    return [
        f"| formula | `{row.formula}` |",
        f"| unit | {unit} |",
        f"| axes | {row.where} |",
        f"| holds | {row.holds} |",
        f"| lengths | {row.lengths or 'those of the calibration'} |",
        f"| storage | {row.storage} |",
        f"| source | {row.source} |",
        f"| `flinders import` | {'reads it back' if row.reader else 'no'} |",
        *(f"| **not verified** | {clause} |" for clause in row.unverified),
    ]


def section(row: Target, words: str) -> str:
    """What the page has of a target, with the `words` that somebody wrote about it."""
    table = "\n".join(["| | |", "|---|---|", *facts(row)])
    path = f"tests/golden/files/cli/target-{row.name}.txt"
    shown = f"<!-- {path} -->\n```console\n{(ROOT / path).read_text(encoding='utf-8')}```"
    return f"## {row.use}: `{row.name}`\n\n{words}{table}\n\n{shown}\n\n"


def made_from_the_rows(text: str) -> str:
    """The page with its lists, tables and sessions made anew."""
    found = list(SECTION.finditer(text))
    words = {one[1]: one[2] for one in found}
    sections = "".join(section(row, words.get(row.name, "")) for row in ROWS)
    text = text[: found[0].start()] + sections + text[found[-1].end() :]
    refusing = ", ".join(f"`{row.name}`" for row in registry().values() if row.refuses_mounted)
    return LIVE.sub(lambda one: session(one[1]), REFUSING.sub(refusing, text))


def test_the_page_has_what_the_rows_say(request: pytest.FixtureRequest) -> None:
    """Lists, a section for each target with its table word for word, and sessions; nothing of a target that is gone."""
    text = PAGE.read_text(encoding="utf-8")
    made = made_from_the_rows(text)
    assert len(LIVE.findall(text)) == 2
    assert REFUSING.search(text)
    if request.config.getoption("--regenerate", default=False):
        PAGE.write_text(made, encoding="utf-8")
    else:
        assert text == made, "docs/targets.md is not what the rows say: `uv run pytest --regenerate`, review the diff"


DOCS = ROOT / "docs"
MODULES = re.compile(r"(?<=<!-- modules of targets -->\n).*?(?=<!-- end of the modules -->)", re.DOTALL)


def _joined(sections: list[str], _: re.Match[str]) -> str:
    return "".join(["\n", *sections])


def test_the_reference_has_a_section_for_each_module_of_targets(request: pytest.FixtureRequest) -> None:
    """Those of a package are on the page of the package."""
    pages: dict[Path, list[str]] = {}
    for name in dict.fromkeys(row.write.__module__ for row in registry().values()):
        _, place, package, *_ = name.split(".")
        page = DOCS / package / "api.md" if place == "apps" else DOCS / "api" / "targets.md"
        pages.setdefault(page, []).append(f"## `{name}`\n\n```{{eval-rst}}\n.. automodule:: {name}\n```\n\n")
    for page, sections in pages.items():
        text = page.read_text(encoding="utf-8")
        made = MODULES.sub(partial(_joined, sections), text)
        assert MODULES.search(text)
        if request.config.getoption("--regenerate", default=False):
            page.write_text(made, encoding="utf-8")
        else:
            assert text == made, f"{page} lacks a module: `uv run pytest --regenerate`, review the diff"


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("targets.md", request, least=len(ROWS))
