"""Options of the commands: earlier spellings, and help with headings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner

from flinders.cli import main
from flinders.cli._program import HEADINGS, RENAMED, Command

if TYPE_CHECKING:
    from collections.abc import Iterator

EARLIER = [(command, old) for command, renamed in RENAMED.items() for old in renamed]


def leaves(group: click.Group, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """Every command that has no commands of its own, with what is typed for it."""
    for name, command in group.commands.items():
        typed = f"{path} {name}".strip()
        if isinstance(command, click.Group):
            yield from leaves(command, typed)
        else:
            yield typed, command


def typed(command: str) -> str:
    """What is typed for a command of the table of earlier spellings, which names the last word of it."""
    return next(path for path, _ in leaves(main) if path.split()[-1] == command)


def test_every_option_that_was_spelled_otherwise_in_the_last_release_is_in_the_table() -> None:
    assert RENAMED == {
        "apply": {"--hold": "--fix"},
        "calibrate": {"--together": "--joint"},
        "check": {"--hold": "--fix"},
        "drift": {"--most": "--limit"},
        "heading": {"--hold": "--fix"},
        "swing": {"--rest": "--stationary"},
        "three-axis": {"--held": "--stationary", "--limit": "--saturation"},
    }


@pytest.mark.parametrize(("command", "old"), EARLIER)
def test_an_earlier_spelling_stands_for_an_option_that_there_is(command: str, old: str) -> None:
    spelled = [word for param in dict(leaves(main))[typed(command)].params for word in param.opts]
    assert RENAMED[command][old] in spelled
    assert old not in spelled


@pytest.mark.parametrize(("command", "old"), EARLIER)
def test_an_earlier_spelling_warns_on_standard_error_and_is_not_in_the_help(command: str, old: str) -> None:
    new = RENAMED[command][old]
    ended = CliRunner().invoke(main, [*typed(command).split(), old, "--help"])
    assert f"! {old} is deprecated: use {new}" in ended.stderr.splitlines()
    assert f"{old} " not in CliRunner().invoke(main, [*typed(command).split(), "--help"]).stdout


def test_an_earlier_spelling_takes_its_value_either_way_and_does_the_same() -> None:
    new = CliRunner().invoke(main, ["simulate", "three-axis", "--readings", "9", "--stationary", "0.5"])
    for typed in (["--held", "0.5"], ["--held=0.5"]):
        old = CliRunner().invoke(main, ["simulate", "three-axis", "--readings", "9", *typed])
        assert (old.stdout, old.exit_code) == (new.stdout, 0)
        assert old.stderr == "! --held is deprecated: use --stationary\n" + new.stderr


def test_what_stands_after_two_dashes_is_no_earlier_spelling() -> None:
    ended = CliRunner().invoke(main, ["apply", "--", "--hold", "raw.csv"])
    assert "deprecated" not in ended.stderr


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
