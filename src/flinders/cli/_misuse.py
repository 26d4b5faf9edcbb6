"""What click says of a mistyped command line, with what was probably meant.

>>> import click
>>> from flinders.cli import main
>>> export = click.Context(main.commands["export"], info_name="flinders export")
>>> misused(click.NoSuchOption("--to", ctx=export))
"No such option '--to': did you mean '--for'? See flinders export --help"
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import click

from flinders.links.serial_ports import SERIAL_PORT

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

ALSO_CALLED: Final = {"--port": "--serial", "--device": "--serial", "--to": "--for", "--format": "--for"}
"""Options by what other programs call them."""

PLAINER: Final = {
    "is not a valid integer range": "is not a whole number",
    "is not a valid integer": "is not a whole number",
    "is not a valid float": "is not a number",
}
"""What click says, in words for people who do not program."""

EXAMPLE: Final = re.compile(r"^ *(flinders .*\S)", re.MULTILINE)
"""The first command line of an epilog."""


def misused(error: click.ClickException) -> str:
    """Say in a line what click found, what was probably meant, and where help is."""
    context = getattr(error, "ctx", None)
    problem = " ".join(error.format_message().split()).rstrip(".")
    for said, plainer in PLAINER.items():
        problem = problem.replace(said, plainer)
    if isinstance(error, click.NoSuchOption):
        problem = _no_such_option(error)
    elif isinstance(error, click.MissingParameter) and (example := _example(context)):
        problem = f"{problem}, as in {example}"
    see = " See" if problem.endswith("?") else "; see"
    return f"{problem}{see} {context.command_path if context else 'flinders'} --help"


def unexpected(words: Sequence[str], context: click.Context) -> click.UsageError:
    """Say of arguments that a command does not take how the first is given, if an option takes such a thing."""
    word = words[0]
    is_port = SERIAL_PORT.match(word) is not None
    takes_none = not any(isinstance(param, click.Argument) for param in context.command.params)
    option = "--serial" if is_port else "--replay"
    if option in _options(context.command) and (is_port or takes_none):
        return click.UsageError(
            f"unexpected argument {word}: name the source, as in {context.command_path} {option} {word}", context
        )
    return click.UsageError(f"{word} is one argument too many", context)


def _no_such_option(error: click.NoSuchOption) -> str:
    """The option that was probably meant: what begins so, is called so elsewhere, or is spelled almost so."""
    name, options = error.option_name, _options(error.ctx.command) if error.ctx else ()
    begun = [option for option in options if option.startswith(name)]
    called = [option for option in (ALSO_CALLED.get(name),) if option in options]
    likely = [*begun, *called, *(error.possibilities or ())]
    problem = f"No such option '{name}'"
    return f"{problem}: did you mean '{likely[0]}'?" if likely else problem


def _options(command: click.Command) -> Collection[str]:
    """The options of a command, as they are typed."""
    return [name for param in command.params if isinstance(param, click.Option) for name in param.opts]


def _example(context: click.Context | None) -> str:
    """The first example of a command's help; nothing where it has none."""
    found = EXAMPLE.search(context.command.epilog or "") if context else None
    return found[1].partition("  #")[0] if found else ""
