"""Hints of errors and findings: arguments by keyword, which Python and the command line spell."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import pytest
from click.testing import CliRunner
from tests.program import flinders_

import flinders
from flinders import cli, errors
from flinders.cli._spelling import in_options, option_of
from flinders.findings import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SOURCES: Final = sorted(Path(flinders.__file__).parent.rglob("*.py"))
PYTHON_ALONE: Final = {"ax", "find", "once", "rotation"}
"""Keywords that no command has an option for."""


def commands() -> Iterator[click.Command]:
    """All commands, of groups their own."""
    for name in cli.main.commands:
        command = cli.main.commands[name]
        yield from command.commands.values() if isinstance(command, click.Group) else [command]


def keywords() -> set[str]:
    """Keywords of all hints in the sources."""
    hints = (
        word.value
        for path in SOURCES
        if "hint=" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        for word in node.keywords
        if word.arg == "hint"
    )
    tables = (each for hint in hints for each in ast.walk(hint) if isinstance(each, ast.Dict))
    return {str(key.value) for table in tables for key in table.keys if isinstance(key, ast.Constant)}


def test_each_keyword_of_a_hint_is_an_option_of_some_command() -> None:
    words = keywords()
    assert {"force", "columns", "disturbances"} <= words
    lacking = {word for word in words if not any(option_of(word, command) for command in commands())}
    assert lacking <= PYTHON_ALONE


def test_a_finding_whose_advice_takes_an_argument_names_it_to_those_who_calibrate() -> None:
    calibrate = cli.main.commands["calibrate"]
    for row in CATALOGUE.values():
        assert all(option_of(word, calibrate) for word in row.hint), row.code


@pytest.mark.parametrize(
    ("hint", "python", "options"),
    [
        ({"unit": "mG", "scale": None}, "unit='mG', scale=", "flinders calibrate --unit mG, --scale"),
        ({"axes": "-x,y,z"}, "axes='-x,y,z'", "flinders calibrate --axes=-x,y,z"),
        ({"columns": "a b,c,d"}, "columns='a b,c,d'", "--columns 'a b,c,d'"),
        ({"at": {"current": 0.0, "temperature": 20.0}}, "at(current=0.0, temperature=20.0)",
         "--fix current=0 --fix temperature=20"),
        ({"linearize": None, "columns": "1,2,3"}, "linearize=, columns='1,2,3'",
         "--columns 1,2,3, flinders calibrate --linearize"),
        ({"rotation": "estimated"}, "rotation='estimated'", ""),
    ],
)  # fmt: skip
def test_a_hint_is_spelled_by_each_interface(hint: dict[str, Any], python: str, options: str) -> None:
    assert errors.python_arguments(hint) == python
    assert in_options(hint, [cli.main.commands["apply"], cli.main.commands["calibrate"]]) == options


def test_a_command_spells_the_hint_of_an_error_and_python_its_own(tmp_path: Path) -> None:
    path = tmp_path / "there.json"
    path.write_text("precious", encoding="utf-8")
    with pytest.raises(errors.OutputExists) as caught:
        flinders.Calibration.identity(field_strength=50.0).save(path)
    assert caught.value.hint == {"force": True}
    assert str(caught.value) == f"{caught.value.message} (force=True)"
    ended = CliRunner().invoke(cli.main, ["demo", "--csv", str(path)], prog_name="flinders")
    assert ended.stderr == f"error: {caught.value.message} (--force)\n"


@pytest.mark.nightly
def test_no_message_spells_a_keyword_or_an_option() -> None:
    """A stand-in for reading them all: no text that an error is made of has ``word=`` or ``--word`` in it."""
    for path in SOURCES:
        if path.parent.name in ("cli", "live"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                texts = [text for argument in node.exc.args for text in ast.walk(argument)]
                said = [text.value for text in texts if isinstance(text, ast.Constant) and isinstance(text.value, str)]
                assert not [text for text in said if re.search(r"\w=(?=[\s'\"),;.]|$)|\s--[a-z]", text)], path


def test_a_finding_does_not_advise_an_option_that_was_used(recordings: Callable[[str], Path]) -> None:
    """Linearized axes would not reduce the heading error of this recording, whose axis x is not linear."""
    words = ("calibrate", str(recordings("sunsided_hmc5883l/full-sphere.csv")), "--unit", "G")
    plain, used = flinders_(*words), flinders_(*words, "--linearize")
    assert plain.code == used.code == 0
    assert "nonlinear-axis" in plain.out
    assert "nonlinear-axis" in used.out
    assert ("(--linearize)" in plain.out, "linearize" in used.out) == (True, False)
    assert "--linearize changes nothing" in used.said
