"""Texts that list what all packages add: help, methods, and the pages of the docs made from the rows of targets.

What lists all targets has no golden file: the page of the docs stands in for it, and ``pytest --regenerate`` makes it
anew from the rows. It keeps the words between the heading of a section and its table.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING

import click
import pytest
from tests.golden.sessions import ROOT, Golden, session

from flinders.cli import main
from flinders.core.chips import chips
from flinders.estimators import table
from flinders.readers import registry as readers
from flinders.report.chip_pages import markdown
from flinders.targets import registry
from flinders.targets._target import GROUPS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flinders.targets import Target

DOCS = ROOT / "docs"
ROWS = [row for row in registry().values() if row.docs == "targets.md"]


def commands(group: click.Group, name: str = "flinders") -> Iterator[str]:
    """The program and its commands, as they are typed."""
    yield name
    for each, command in group.commands.items():
        yield from commands(command, f"{name} {each}") if isinstance(command, click.Group) else (f"{name} {each}",)


@pytest.mark.parametrize("command", list(commands(main)))
def test_help(command: str, golden: Golden) -> None:
    golden(f"cli/{command.replace(' ', '-')}-help.txt", session(f"{command} --help"))


def test_methods(golden: Golden) -> None:
    golden("cli/methods.txt", session("flinders methods"))


def test_the_table_of_methods_is_made_from_their_rows(request: pytest.FixtureRequest) -> None:
    page = DOCS / "methods.md"
    text = page.read_text(encoding="utf-8")
    begin = text.index("| method |")
    end = text.index("\n\n", begin) + 1
    if request.config.getoption("--regenerate", default=False):
        page.write_text(text[:begin] + table() + text[end:], encoding="utf-8")
    else:
        assert text[begin:end] == table(), "docs/methods.md: `uv run pytest --regenerate`, then review the diff"


def test_the_page_of_chips_is_made_from_their_table(request: pytest.FixtureRequest) -> None:
    page = DOCS / "chips.md"
    text = page.read_text(encoding="utf-8")
    begin, made = text.index("| chip |"), markdown(chips())
    if request.config.getoption("--regenerate", default=False):
        page.write_text(text[:begin] + made, encoding="utf-8")
    else:
        assert text[begin:] == made, "docs/chips.md: `uv run pytest --regenerate`, then review the diff"


# the pages of targets

PAGE = DOCS / "targets.md"
LIVE = re.compile(r"(?<=<!-- made from the rows -->\n```console\n)\$ (flinders [^\n]+)\n.*?(?=```\n)", re.DOTALL)
REFUSING = re.compile(r"(?<=<!-- refusing -->).*?(?=<!-- end -->)")
OVERVIEW = re.compile(r"(?<=<!-- overview of the rows -->\n).*?(?=<!-- end of the overview -->)", re.DOTALL)
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


def overview() -> str:
    """Table of the groups: what somebody has, and the targets for it, each with a link to its section or page."""
    lines = ["| you have | targets |", "|---|---|"]
    for group, members in groupby(registry().values(), key=lambda row: row.group):
        names = ", ".join(f"[`{row.name}`]({place_of(row)})" for row in members)
        lines.append(f"| {GROUPS[group]} | {names} |")
    return "\n".join(lines) + "\n"


def place_of(row: Target) -> str:
    return f"#{anchor(f'{row.use}: {row.name}')}" if row.docs == PAGE.name else row.docs


def made_from_the_rows(text: str) -> str:
    """The page with its lists, tables and sessions made anew."""
    found = list(SECTION.finditer(text))
    words = {one[1]: one[2] for one in found}
    sections = "".join(section(row, words.get(row.name, "")) for row in ROWS)
    text = text[: found[0].start()] + sections + text[found[-1].end() :]
    refusing = ", ".join(f"`{row.name}`" for row in registry().values() if row.refuses_mounted)
    text = OVERVIEW.sub(lambda _: overview(), REFUSING.sub(refusing, text))
    return LIVE.sub(lambda one: session(one[1]), text)


def test_the_page_has_what_the_rows_say(request: pytest.FixtureRequest) -> None:
    """Lists, a section for each target with its table word for word, and sessions; nothing of a target that is gone."""
    text = PAGE.read_text(encoding="utf-8")
    made = made_from_the_rows(text)
    assert len(LIVE.findall(text)) == 2
    assert REFUSING.search(text)
    assert OVERVIEW.search(text)
    if request.config.getoption("--regenerate", default=False):
        PAGE.write_text(made, encoding="utf-8")
    else:
        assert text == made, "docs/targets.md is not what the rows say: `uv run pytest --regenerate`, review the diff"


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


def test_each_format_is_documented_from_the_table(request: pytest.FixtureRequest) -> None:
    """The table in docs/formats.md is made of the rows; a section under a reader's title shows a command to type."""
    path = ROOT / "docs" / "formats.md"
    text = path.read_text(encoding="utf-8")
    lines = ["| format | endings | what is read | needs |", "|---|---|---|---|"]
    for reader in readers():
        assert reader.docs, f"the row of {reader.name} does not say what is read: docs"
        section = re.search(rf"^## {re.escape(reader.title)}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL | re.I)
        assert section is None or "```sh\nflinders " in section[1], f"'## {reader.title}' shows no command"
        title = f"[{reader.title}](#{anchor(reader.title)})" if section else reader.title
        endings = ", ".join(f"`{suffix}`" for suffix in reader.suffixes)
        needs = f"`pip install '.[{reader.extra}]'`" if reader.extra else ""
        lines.append(f"| {title} | {endings} | {reader.docs} | {needs} |")
    table = "\n".join(lines)
    pattern = re.compile(r"(?<=<!-- table of readers -->\n).*?(?=<!-- end of the table -->)", re.DOTALL)
    if request.config.getoption("--regenerate", default=False):
        path.write_text(pattern.sub(lambda _: f"{table}\n", text), encoding="utf-8")
        return
    assert f"{table}\n" in text, "docs/formats.md has another table than the rows: pytest --regenerate this test"


def anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.casefold()).replace(" ", "-")
