"""Every command that README, docs and help texts show is run with files like theirs, and so is what it says comes next.

Sessions of the docs, which show what a command prints, are run by the tests of their golden files. Commands that wait
for a wire, a vehicle or a cluster are parsed alone, with all their options: tests of the live page, of `record`,
`watch` and `send` run those with a simulated board, vehicle or cluster.
"""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
import pytest
from tests import bench_files
from tests.golden.sessions import ROOT
from tests.program import Ended, flinders_
from tests.trials import daily

from flinders.cli import main

if TYPE_CHECKING:
    from collections.abc import Iterator

BLOCK: Final = re.compile(r"^ *```sh\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
SHOWN: Final = re.compile(r"^\s*(?:\$ )?(?:uv run )?(flinders .*)$", re.MULTILINE)
NEXT: Final = re.compile(r"^(?:next: |   )(flinders .*)$", re.MULTILINE)
CELL: Final = re.compile(r"^\|.*?`(flinders [^`]+)` \|", re.MULTILINE)
IN_TABLES: Final = ("README.md", "wrong.md", "tools.md")
"""Pages whose tables say what to type."""
ENDS: Final = frozenset({"|", "&&", "&", ";"})
WAITING: Final = frozenset({"--serial", "--udp", "--tcp", "--mavlink", "--ros2", "--port", "--scheduler"})


def shown() -> dict[str, str]:
    """Each line with a command once, and where it stands first."""
    lines: dict[str, str] = {}
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        text = path.read_text(encoding="utf-8")
        found = [line for block in BLOCK.findall(text) for line in SHOWN.findall(block)]
        for line in [*found, *(CELL.findall(text) if path.name in IN_TABLES else [])]:
            lines.setdefault(" ".join(shlex.split(line, comments=True)), str(path.relative_to(ROOT)))
    for name, command in commands(main, "flinders"):
        for line in SHOWN.findall(command.epilog or ""):
            lines.setdefault(" ".join(shlex.split(line, comments=True)), f"{name} --help")
    return lines


def commands(group: click.Group, name: str) -> Iterator[tuple[str, click.Command]]:
    """A group and its commands, those of groups in it too."""
    yield name, group
    for word, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def parts(line: str) -> list[list[str]]:
    """Words of each command of a line, without the program's name."""
    found: list[list[str]] = [[]]
    for word in shlex.split(line, comments=True):
        if word in ENDS or word.endswith(";"):
            found.append([])
        else:
            found[-1].append(word)
    return [words[1:] for words in found if words[:1] == ["flinders"]]


def is_waiting(words: list[str]) -> bool:
    """Whether a command waits for what no test of this file has."""
    return (
        words[0] in {"live", "station"} or bool(WAITING & set(words)) or any(word.startswith("s3://") for word in words)
    )


def parse(words: list[str]) -> None:
    """Parse a command with its options, and do not run it."""
    command, context = main.commands[words[0]], click.Context(main, info_name="flinders")
    command.make_context(words[0], list(words[1:]), parent=context)


def run(line: str) -> str:
    """Run a line; what its commands say."""
    said: list[str] = []
    ended = Ended(0, "", "")
    for words in parts(line):
        if is_waiting(words):
            parse(words)
            continue
        here = [word.replace("~", "home") if word.startswith("~") else word.lstrip("/") or word for word in words]
        for before, word in pairwise(here):
            if before not in bench_files.WRITTEN:
                bench_files.make(bench_files.UNNAMED.get(word, word), here)
        expanded = [name for word in here for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]
        piped = ended.out
        if "-" in here and not piped and bench_files.make("raw.csv", here):
            piped = Path("raw.csv").read_text(encoding="utf-8")
        ended = flinders_(*expanded, stdin=piped)
        assert ended.code in {0, 3}, f"{line}\nended with {ended.code}: {ended.err}"
        said += [ended.out, ended.err]
    return "\n".join(said)


@pytest.mark.parametrize(("line", "where"), daily(sorted(shown().items()), 8))
def test_every_command_that_is_shown_runs_and_what_it_says_comes_next(
    line: str, where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if "/" in line:
        for folder in ("run/compass", "var/lib/node_exporter", "home/Arduino/libraries", "home/ros2_ws/src"):
            (tmp_path / folder).mkdir(parents=True)
    said = run(line)
    for following in NEXT.findall(said):
        run(following)
