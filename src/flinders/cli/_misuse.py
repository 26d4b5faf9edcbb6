"""Error message for a mistyped command line, with the probable intention.

>>> import click
>>> from flinders.cli import main
>>> export = click.Context(main.commands["export"], info_name="flinders export")
>>> misuse_message(click.NoSuchOption("--to", ctx=export))
"No such option '--to': did you mean '--for'? See flinders export --help"
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from flinders.links.serial_ports import SERIAL_PORT

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

OTHER_NAMES: Final = {"--port": "--serial", "--device": "--serial", "--to": "--for", "--format": "--for"}
"""Names of options in other programs, with our names for them."""

PLAIN_WORDS: Final = {
    "is not a valid integer range": "is not a whole number",
    "is not a valid integer": "is not a whole number",
    "is not a valid float": "is not a number",
}
"""Phrases of click, with simpler ones."""

EXAMPLE: Final = re.compile(r"^ *(flinders .*\S)", re.MULTILINE)
"""Pattern of the first command line in an epilog."""


def misuse_message(error: click.ClickException) -> str:
    """One line with click's error, the probable intention, and where help is."""
    context = getattr(error, "ctx", None)
    problem = " ".join(error.format_message().split()).rstrip(".")
    for said, plainer in PLAIN_WORDS.items():
        problem = problem.replace(said, plainer)
    if isinstance(error, click.NoSuchOption):
        problem = _no_such_option(error)
    elif isinstance(error, click.BadParameter) and (variable := _variable(error)):
        problem = f"Invalid value of the variable {variable}: {' '.join(error.message.split()).rstrip('.')}"
    elif isinstance(error, click.MissingParameter) and (example := _example(context)):
        problem = f"{problem}, as in {example}"
    see = " See" if problem.endswith("?") else "; see"
    return f"{problem}{see} {context.command_path if context else 'flinders'} --help"


def unexpected_argument(words: Sequence[str], context: click.Context) -> click.UsageError:
    """Error for surplus arguments; it names the option to which the first one belongs, if any."""
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
    """Message for an unknown option, with the known option that it probably means."""
    name, options = error.option_name, _options(error.ctx.command) if error.ctx else ()
    begun = [option for option in options if option.startswith(name)]
    called = [option for option in (OTHER_NAMES.get(name),) if option in options]
    likely = [*begun, *called, *(error.possibilities or ())]
    if name == "--language" and error.ctx and error.ctx.parent:
        return f"'{name}' stands before the command, as in flinders {name} de {error.ctx.info_name}"
    if name == "--chip":
        return f"'{name}' is for commands that read counts, such as flinders info, calibrate and live"
    problem = f"No such option '{name}'"
    return f"{problem}: did you mean '{likely[0]}'?" if likely else problem


def _variable(error: click.BadParameter) -> str:
    """Name of the environment variable that a value comes from; empty for a typed value."""
    if error.ctx is None or error.param is None or error.param.name is None:
        return ""
    is_of_environment = error.ctx.get_parameter_source(error.param.name) is ParameterSource.ENVIRONMENT
    return str(error.param.envvar) if is_of_environment else ""


def _options(command: click.Command) -> Collection[str]:
    """Names of the options of a command."""
    return [name for param in command.params if isinstance(param, click.Option) for name in param.opts]


def _example(context: click.Context | None) -> str:
    """First example in a command's help; empty without one."""
    found = EXAMPLE.search(context.command.epilog or "") if context else None
    return found[1].partition("  #")[0] if found else ""
