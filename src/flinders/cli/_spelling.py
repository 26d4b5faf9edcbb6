"""Hints of errors and findings, spelled as options of the command line.

A keyword argument of Python corresponds to the option whose parameter has that name or lists it in its `keywords`.

>>> from flinders.cli import main
>>> calibrate = main.commands["calibrate"]
>>> in_options({"unit": "mG", "axes": "-x,y,z", "force": True, "disturbances": None, "rotation": None}, [calibrate])
'--unit mG, --axes=-x,y,z, --force, --with'
>>> in_options({"linearize": False}, [main.commands["export"], calibrate])
'flinders calibrate without --linearize'
"""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from flinders.errors import FlindersError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.errors import Hint

TAKEN: Final = "flinders.cli.taken"
"""Key of the context for options whose values came from another option, by name."""


def in_options(hint: Hint, commands: Sequence[click.Command] | None = None) -> str:
    """Spell a hint as options, each of the first command that has it; keywords without an option are omitted.

    An option that only another command has is given with that command: ``flinders calibrate --unit``. ``--force`` is
    never taken from another command, as it would not overwrite the output of the first one.

    `commands` are by default the `searched_commands` for the command that runs.
    """
    context = click.get_current_context(silent=True)
    if commands is None:
        commands = searched_commands(context.command, context.find_root().command) if context else ()
    spelled: dict[str, list[str]] = {}
    for keyword, value in hint.items():
        asked = commands[:1] if keyword == "force" else commands
        found = next(((each, option) for each in asked if (option := option_of(keyword, each))), None)
        if found is not None:
            command, option = found
            of = "" if command is commands[0] else f"flinders {command.name} "
            spelled.setdefault(of, []).append(_spell_option(option, value))
    return ", ".join(of + ", ".join(options) for of, options in sorted(spelled.items()))


def in_unused_options(hint: Hint, commands: Sequence[click.Command] | None = None) -> str:
    """Spell the hint of a finding as `in_options`, without flags that were given: the fit has their effect."""
    context = click.get_current_context(silent=True)
    unused = {keyword: value for keyword, value in hint.items() if not (context and _is_given(keyword, context))}
    return in_options(unused, commands)


def _is_given(keyword: str, context: click.Context) -> bool:
    """Whether the flag for a keyword argument of Python was given on the command line."""
    option = option_of(keyword, context.command)
    if option is None or not option.is_flag or option.name is None:
        return False
    return context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE


def searched_commands(command: click.Command, program: click.Command) -> tuple[click.Command, ...]:
    """Commands whose options are searched for a hint: `command`, then ``calibrate``."""
    calibrate = program.commands.get("calibrate") if isinstance(program, click.Group) else None
    return (command,) if calibrate is None else (command, calibrate)


def take_from(keyword: str, names: Iterable[str]) -> None:
    """Note that the values of some options came from the option `keyword`, which hints name in their place."""
    click.get_current_context().meta[TAKEN] = dict.fromkeys(names, keyword)


def taken_options() -> Mapping[str, str]:
    """Options whose values came from another option, each with that option, by the names of their parameters."""
    context = click.get_current_context(silent=True)
    return context.meta.get(TAKEN, {}) if context else {}


@contextlib.contextmanager
def hints_of_typed_options() -> Iterator[None]:
    """In the hint of an error, name the option that was typed, if it set the value of another option."""
    try:
        yield
    except FlindersError as error:
        taken = taken_options()
        error.hint = {taken.get(name, name) if value is None else name: value for name, value in error.hint.items()}
        raise


def option_of(keyword: str, command: click.Command) -> click.Option | None:
    """The option of a command for a keyword argument of Python; None without one."""
    options = (param for param in command.params if isinstance(param, click.Option))
    return next((each for each in options if keyword in (each.name, *getattr(each, "keywords", ()))), None)


def _spell_option(option: click.Option, value: object) -> str:
    """An option with its value, repeated for each entry of a list or mapping; ``without --flag`` for False."""
    name = max(option.opts, key=len)
    if option.is_flag and value is False and not option.secondary_opts:
        return f"without {name}"
    if value is None or option.is_flag:
        return name
    if isinstance(value, Mapping):
        written = {key: entry if isinstance(entry, str) else f"{entry:g}" for key, entry in value.items()}
        return " ".join(_with_value(name, f"{key}={entry}") for key, entry in written.items())
    return " ".join(_with_value(name, entry) for entry in (value if isinstance(value, list) else [value]))


def _with_value(name: str, value: object) -> str:
    """An option with one value, even if the value begins with a minus."""
    written = shlex.quote(str(value))
    return f"{name}{'=' if written.startswith('-') else ' '}{written}"
