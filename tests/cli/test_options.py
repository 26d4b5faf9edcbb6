"""Options of the commands: help with headings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences

from flinders.cli import main
from flinders.cli._program import HEADINGS, Command

if TYPE_CHECKING:
    from collections.abc import Iterator


def leaves(group: click.Group, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """Every command that has no commands of its own, with what is typed for it."""
    for name, command in group.commands.items():
        typed = f"{path} {name}".strip()
        if isinstance(command, click.Group):
            yield from leaves(command, typed)
        else:
            yield typed, command


def test_the_help_of_a_command_has_a_handful_of_options_before_the_headings() -> None:
    for name, command in leaves(main):
        if not isinstance(command, Command) or not command.common:
            continue
        shown = CliRunner().invoke(main, [*name.split(), "--help"]).stdout
        first = shown.partition("Options:\n")[2].partition("\n\n")[0]
        options = [line for line in first.splitlines() if line.startswith("  -")]
        assert 3 <= len(options) <= 9, f"{name} begins with {len(options)} options"
        places = [shown.find(f"\n{heading}:\n") for heading in HEADINGS]
        assert sorted(places := [place for place in places if place > 0]) == places, name


def test_every_common_option_is_one_of_the_command() -> None:
    for name, command in leaves(main):
        if isinstance(command, Command):
            grouped = [each for names in command.headings.values() for each in names]
            unknown = {*command.common, *grouped} - {param.name for param in command.params}
            assert not unknown, f"{name} has no option {unknown}"


@pytest.mark.parametrize(
    "typed",
    [
        "calibrate log.bin --out x.json",
        "calibrate log.bin --units uT",
        "export --to ardupilot x.json",
        "calibrate log.bin --report",
    ],
)
def test_a_mistyped_option_is_answered_with_one_option_and_the_help_of_its_command(typed: str) -> None:
    ended = CliRunner().invoke(main, typed.split())
    assert ended.exit_code == 2, ended.stderr
    assert_sentences(ended.stderr)


def test_the_name_of_a_chip_is_given_to_a_command_that_reads_counts() -> None:
    ended = CliRunner().invoke(main, ["record", "-o", "tumble.csv", "--chip", "HMC5883L"])
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


@pytest.mark.parametrize(
    ("words", "language"), [("demo", "xx"), ("--language xx demo", ""), ("demo --language de", ""), ("live --lang", "")]
)
def test_a_language_that_cannot_be_used(words: str, language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLINDERS_LANGUAGE", language)
    ended = CliRunner().invoke(main, words.split())
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)
