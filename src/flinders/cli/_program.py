"""The program: commands made from dataclasses of options, one table of exit codes, no traceback for bad input.

The module of a command is imported when the command is called. It has a dataclass whose fields are the arguments,
options and groups of options of the command.

>>> class Show(Group):
...     path: str = argument("PATH")
...     axes: str = member("--axes", default="x,y,z")
...     as_json: bool = flag("--json", "Print it as JSON.")
>>> @command_of("show", Show)
... def show(options):
...     print(options.path, options.axes, options.as_json)
>>> show.main(["a.csv", "--json"], standalone_mode=False)
a.csv x,y,z True
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
from dataclasses import Field as DataclassField
from dataclasses import dataclass, field, fields
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, TypeVar, dataclass_transform

import click

from flinders.cli._commands import REPLACEMENTS, Commands
from flinders.cli._completion import BY_METAVAR, complete_files
from flinders.cli._misuse import misuse_message, unexpected_argument
from flinders.cli._output import Output, Outputs, error_words, print_fit, print_json, say
from flinders.cli._process import prepare_streams, silence_stdout, spare_imports_from_gc
from flinders.cli._signals import STOP_SIGNALS, handle_signals, interrupt
from flinders.cli._spelling import (
    hints_of_typed_options,
    in_unused_options,
    searched_commands,
    taken_options,
)
from flinders.core.files import reason_and_remedy
from flinders.core.language import ENGLISH, ENGLISH_CODE, TERMINAL_LANGUAGE, language_of
from flinders.errors import FitError, FlindersError, OutputError, UsageError
from flinders.verdicts import MEANINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import ModuleType

    from flinders.findings import Verdict
    from flinders.native.faults import Answer

GOOD, LIMITED, REFUSED = (meaning.exit_code for meaning in MEANINGS.values())
USAGE, UNREADABLE, UNWRITABLE, INTERNAL, INTERRUPTED = 2, 5, 6, 70, 130

EXIT_CODES: Final = {
    GOOD: f"good: {MEANINGS['good'].words}; check, compare: it holds",
    USAGE: "usage: an option or argument cannot be used",
    LIMITED: f"limited: {MEANINGS['limited'].words}; check, compare: cannot tell",
    REFUSED: f"refused: {MEANINGS['refused'].words}; check, compare: it fails",
    UNREADABLE: "unreadable input",
    UNWRITABLE: "output cannot be written",
    INTERNAL: "internal error: please report it",
    INTERRUPTED: "interrupted",
}

EXITS: Final[dict[Verdict, int]] = {verdict: meaning.exit_code for verdict, meaning in MEANINGS.items()}
"""Exit code for each verdict of a fit."""

ANSWER_EXITS: Final[dict[Answer, int]] = {"holds": GOOD, "cannot-tell": LIMITED, "fails": REFUSED}
"""Exit code for each answer to the question whether an earlier calibration still holds."""

ERROR_PREFIXES: Final = {REFUSED: "refused", LIMITED: "cannot tell"}
"""First words of an error line by exit code; for other codes the first word is "error"."""

FIT_KEYS: Final = ("verdict", "method", "calibration", "heading_error_deg", "noise", "coverage", "findings")
"""Keys of every result of ``calibrate --json``."""


def show_versions(context: click.Context, _option: click.Parameter, is_asked: bool) -> None:
    """Print the versions of the software, and end the program."""
    if is_asked and not context.resilient_parsing:
        from flinders.cli._version import versions

        click.echo(versions())
        context.exit()


def use_language(_context: click.Context, _option: click.Parameter, code: str | None) -> None:
    """Set the language of pages on the terminal."""
    TERMINAL_LANGUAGE.set(language_of(code or ENGLISH_CODE))


class Commanded(click.Group):
    """A group of `Commands` whose help is written without importing them."""

    def format_commands(self, _context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands under their headings."""
        assert isinstance(self.commands, Commands)
        for heading, entries in self.commands.headings():
            with formatter.section(heading):
                formatter.write_dl(entries)


class Program(Commanded):
    """The group of all commands; it always ends with an exit code of `EXIT_CODES`."""

    def main(  # type: ignore[override]  # click's overloads only tell what `standalone_mode` does
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: object,
    ) -> int:
        """Run a command line and exit with its code; without `standalone_mode`, return the code instead."""
        words = list(sys.argv[1:] if args is None else args)
        as_json = "--json" in words[: words.index("--") if "--" in words else None]
        try:
            if args is None:
                spare_imports_from_gc()
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are too small for threads
            prepare_streams()
            with handle_signals(interrupt, *STOP_SIGNALS):
                code = super().main(words, prog_name, complete_var, standalone_mode=False, **extra)
        except click.ClickException as error:
            code = _report_misuse(error, as_json=as_json)
        except (click.Abort, KeyboardInterrupt):
            say("interrupted")
            code = INTERRUPTED
        except FlindersError as error:
            code = print_error(error, as_json=as_json, commands=searched_commands(self._called_command(words), self))
        except SystemExit as end:  # click ends with 1 if the reader of stdout is gone
            code = UNWRITABLE if end.code == 1 else end.code
        except OSError as error:
            code = print_error(OutputError(f"output cannot be written: {reason_and_remedy(error)}"), as_json=False)
            silence_stdout()
        except Exception as error:  # noqa: BLE001 - the one place that turns a fault of ours into a report
            code = _report_fault(error)
        code = code if isinstance(code, int) else GOOD
        TERMINAL_LANGUAGE.set(ENGLISH)  # for callers that run several command lines in one process
        return sys.exit(code) if standalone_mode else code

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Look up a command of one or two words; for an unknown name, suggest the replacement or a similar command."""
        if (name := " ".join(args[:2])) in self.commands:
            args = [name, *args[2:]]
        if args[0] in REPLACEMENTS and args[0] not in self.commands and not ctx.resilient_parsing:
            raise click.UsageError(f"No such command '{args[0]}': {REPLACEMENTS[args[0]]}", ctx)
        begun = [command for command in self.commands if command.startswith(args[0])]
        if begun and args[0] not in self.commands and not ctx.resilient_parsing:
            raise click.UsageError(f"No such command '{args[0]}': did you mean '{begun[0]}'?", ctx)
        return super().resolve_command(ctx, args)

    def _called_command(self, words: Sequence[str]) -> click.Command:
        """The command that a command line calls."""
        command: click.Command = self.commands.get(" ".join(words[:2]), self)
        for word in words if command is self else ():
            if isinstance(command, click.Group):
                command = command.commands.get(word, command)
        return command


def print_error(
    error: FlindersError,
    *,
    as_json: bool,
    more: Mapping[str, Any] | None = None,
    commands: Sequence[click.Command] | None = None,
    exit_code: int | None = None,
) -> int:
    """Print an error in one line, or a refused fit as a page; with `as_json`, also print either in full as JSON.

    `more` are further fields of the JSON. `commands` are those whose options may avoid the error, as in `in_options`.
    `exit_code` replaces that of the error. Returns the exit code.
    """
    exit_code = error.exit_code if exit_code is None else exit_code
    words = error_words(error, commands)
    fit = getattr(error, "fit", None)
    if fit is not None and not as_json:
        print_fit(fit, partial(in_unused_options, commands=commands), err=True)
    else:
        say(_spoken(error, exit_code, words))
    if as_json:
        with contextlib.suppress(OSError):
            print_json({**_as_dict(error, words, exit_code), **(more or {})})
    return exit_code


def _spoken(error: FlindersError, exit_code: int, words: str) -> str:
    """An error in one line: a refusal in the terminal's language if it is translated, other errors in English."""
    language = TERMINAL_LANGUAGE.get()
    refusal = language.translation(f"refusal.{error.code}") if isinstance(error, FitError) else ""
    if not refusal:
        return f"{ERROR_PREFIXES.get(exit_code, 'error')}: {words}"
    title = (
        language.phrase("answer.check.cannot-tell", "CANNOT TELL")
        if exit_code == LIMITED
        else language.capitals(language.phrase("verdict.refused", "Refused"))
    )
    return f"{title}: {refusal}"


def _as_dict(error: FlindersError, words: str, exit_code: int) -> dict[str, Any]:
    """JSON-ready error; a refused fit has all keys of a fit, with null for missing values."""
    about: dict[str, Any] = {
        "code": error.code,  # stable name, see the table of errors
        "message": words,  # what was found, what is needed, what to do
        "exit_code": exit_code,  # of the program
        "evidence": error.evidence,  # numbers and names of the message
    }
    if not isinstance(error, FitError):
        return {"error": about}
    from flinders.fitting.fit_json import json_of

    fit = getattr(error, "fit", None)
    fields = json_of(fit) if fit else {**dict.fromkeys(FIT_KEYS), "verdict": "refused", "findings": []}
    return {**fields, "error": about}


def _report_misuse(error: click.ClickException, *, as_json: bool) -> int:
    """Print click's error and where help is; print the help itself if no command was typed."""
    message = error.format_message()
    if message.startswith("Usage:"):
        say(message)
        return USAGE
    return print_error(UsageError(misuse_message(error)), as_json=as_json)


def _report_fault(error: Exception) -> int:
    """Print that Flinders has a fault, write the details to a file, and ask the user for a report."""
    import platform
    import tempfile
    import traceback
    from importlib.metadata import version

    about = f"flinders {version('flinders')}, Python {platform.python_version()}, {platform.platform()}\n\n"
    details = about + "".join(traceback.format_exception(error))
    say(f"internal error: {type(error).__name__}: {error}")
    where = "the lines above"
    try:
        with tempfile.NamedTemporaryFile(prefix="flinders-", suffix=".txt", delete=False) as file:
            file.write(details.encode())
            where = file.name
    except (OSError, ValueError):
        say(details)
    say(f"This is a fault in Flinders, not in your recording. Please report it with {where}")
    return INTERNAL


# ------------------------------------------------------------------------------------------------- options of a command


Options = TypeVar("Options", bound="Group")
Field: TypeAlias = Any
"""A field of a group: at runtime the declaration of an option, for a type checker the option's value."""

RECORDING, SITE, AIDING, METHOD, OUTPUT = HEADINGS = (
    "Recording", "Site", "Aiding sensors and disturbances", "Method", "Output",
)  # fmt: skip
"""Headings in the help of a command, in order; they follow the most used options."""

MAX_PLAIN_OPTIONS: Final = 8
"""Largest number of options for which a command's help has no headings."""


class Option(click.Option):
    """An option with its heading in the help, and with the `keywords` of Python to which it corresponds."""

    def __init__(self, *args: Any, heading: str = "", keywords: Sequence[str] = (), **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.heading, self.keywords = heading, keywords


class Command(click.Command):
    """A command whose help lists its most used options, `common`, before the others, which have headings.

    `headings` maps headings that only this command has to names of parameters; other options state their own heading.
    """

    def __init__(
        self, *args: Any, common: Sequence[str] = (), headings: Mapping[str, Sequence[str]] | None = None,
        **attributes: Any,
    ) -> None:  # fmt: skip
        super().__init__(*args, **attributes)
        self.common, self.headings = tuple(common), headings or {}

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse options and arguments, and refuse surplus ones; errors name the help of this command."""
        ctx.allow_extra_args = True  # click's own refusal gives no advice
        try:
            rest = super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            raise
        if rest and not ctx.resilient_parsing:
            raise unexpected_argument(rest, ctx)
        return rest

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options into the help, under their headings."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        sections: dict[str, list[tuple[str, str]]] = {heading: [] for heading in ("", *self.headings, *HEADINGS)}
        for each in sorted(options, key=self._place):
            if record := each.get_help_record(ctx):
                sections[self._heading(each) if len(options) > MAX_PLAIN_OPTIONS else ""].append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading or "Options"):
                    formatter.write_dl(records)

    def _heading(self, param: click.Parameter) -> str:
        """The heading of an option in the help."""
        if param.name in self.common:
            return ""
        own = (heading for heading, names in self.headings.items() if param.name in names)
        return next(own, getattr(param, "heading", ""))

    def _place(self, param: click.Parameter) -> int:
        """Sort key of an option in the help: the common ones in their order, then all others as declared."""
        return self.common.index(param.name) if param.name in self.common else len(self.common)


@dataclass_transform(frozen_default=True)
class Group:
    """A dataclass of options that belong together; each field is made by `member` and is one option.

    `heading` is their heading in the help; a member can have another one.
    """

    def __init_subclass__(cls, heading: str = "") -> None:
        for each in vars(cls).values():
            if isinstance(each, DataclassField) and heading:
                each.metadata["attributes"].setdefault("heading", heading)
        dataclass(frozen=True, eq=False, repr=False)(cls)

    @classmethod
    def parameters(cls) -> Iterator[click.Parameter]:
        """Yield the parameters for click."""
        for each in fields(cls):  # type: ignore[arg-type]
            if "group" in each.metadata:
                yield from each.metadata["group"].parameters()
            else:
                yield each.metadata["kind"]([*each.metadata["names"], each.name], **each.metadata["attributes"])

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> Self:
        """Take this group's values from all values of a command."""
        return cls(
            **{
                each.name: kind.from_values(values) if (kind := each.metadata.get("group")) else values[each.name]
                for each in fields(cls)  # type: ignore[arg-type]
            }
        )

    def members(self) -> Iterator[tuple[Mapping[str, Any], Any]]:
        """Yield declaration and value of each option and argument, including those of nested groups."""
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            yield from value.members() if "group" in each.metadata else [(each.metadata, value)]

    @property
    def outputs(self) -> Outputs:
        """The output files named by options."""
        return Outputs(tuple(self.named_files()), getattr(self, "force", False), getattr(self, "as_json", False))

    def checked_outputs(self, *inputs: str | None) -> Outputs:
        """The output files, after a check that they can be written and are neither arguments nor `inputs`."""
        read = list(filter(None, inputs))
        for declared, value in self.members():
            if declared["kind"] is click.Argument:
                read += [value] if isinstance(value, str) else value or ()
        outputs = self.outputs
        outputs.check(read)
        return outputs

    def named_files(self) -> Iterator[Output]:
        """Yield the output files that options name, each with its content in words."""
        for declared, value in self.members():
            if what := declared.get("what"):
                yield Output(what, value, declared["names"][0])

    def as_dict(self, *, if_typed: Sequence[str] = ()) -> dict[str, Any]:
        """Value of each option by its name; options of `if_typed` are included only if they were typed."""
        names = [each.name for each in fields(self)]  # type: ignore[arg-type]
        return {name: getattr(self, name) for name in names if name not in if_typed or is_typed(name)}

    def typed_options(self) -> dict[str, Any]:
        """Options that differ from their defaults, by their command-line names.

        Options of outputs are not included, nor those whose values were taken from another option.

        >>> from flinders.cli._options import ReadingOptions
        >>> ReadingOptions(None, None, "mG", None, "x,y,z", None, 5.0, None, False).typed_options()
        {'--unit': 'mG', '--from': 5.0}
        """
        typed: dict[str, Any] = {}
        for declared, value in self.members():
            attributes = declared["attributes"]
            if attributes.get("heading") != OUTPUT and value not in (None, False, (), attributes.get("default")):
                typed |= {name: value for name in declared["names"] if name.startswith("--")}
        return {name: value for name, value in typed.items() if name.removeprefix("--") not in taken_options()}

    def typed_words(self) -> dict[str, str]:
        """Options that differ from their defaults, with their values in words, for a report.

        >>> from flinders.cli._options import ReadingOptions
        >>> ReadingOptions(None, None, "mG", None, "x,y,z", None, 5.0, None, True).typed_words()
        {'--unit': 'mG', '--from': '5.0', '--as-logged': 'yes'}
        """
        return {
            name: "yes" if value is True else ", ".join(value) if isinstance(value, tuple) else f"{value}"
            for name, value in self.typed_options().items()
        }


def member(*names: str, what: str = "", **attributes: Any) -> Field:
    """A field for an option that is declared as with `click.option`; the parameter has the field's name.

    `what` is given for an output only: the content, in words, of the file that the option names.
    """
    if completion := BY_METAVAR.get(attributes.get("metavar", "")):
        attributes["shell_complete"] = completion
    return field(metadata={"kind": Option, "names": names, "attributes": attributes, "what": what})


def flag(name: str, words: str, **attributes: Any) -> Field:
    """A field for an option without a value."""
    return member(name, is_flag=True, help=words, **attributes)


def argument(metavar: str, *, required: bool = True, nargs: int = 1) -> Field:
    """A field for an argument: a file name, shown as `metavar`."""
    attributes = {"metavar": metavar, "required": required, "nargs": nargs, "shell_complete": complete_files}
    return field(metadata={"kind": click.Argument, "names": (), "attributes": attributes})


def group(kind: type[Group]) -> Field:
    """A field for a group of options."""
    return field(metadata={"group": kind})


def same_as(kind: type[Group], name: str) -> Field:
    """A field with a copy of one option of another group."""
    return field(metadata=kind.__dataclass_fields__[name].metadata)  # type: ignore[attr-defined]


def command_of(
    name: str,
    kind: type[Options],
    parent: click.Group | ModuleType = click,
    *,
    cls: type[Command] = Command,
    **attributes: Any,
) -> Callable[[Callable[[Options], int | None]], click.Command]:
    """Make a command from a function that takes an object of `kind`, as a command of `parent` or of the program."""

    def decorate(function: Callable[[Options], int | None]) -> click.Command:
        @wraps(function)
        def called(**values: Any) -> int | None:
            with hints_of_typed_options():
                return function(kind.from_values(values))

        made: click.Command = parent.command(name, cls=cls, params=list(kind.parameters()), **attributes)(called)
        return made

    return decorate


def is_typed(name: str) -> bool:
    """Whether an option was given on the command line."""
    context = click.get_current_context(silent=True)
    return context is not None and context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def single_value(_context: click.Context, _option: click.Parameter, values: tuple[Any, ...]) -> Any:  # noqa: ANN401
    """Callback for an option with ``multiple=True`` that may be given only once: its value, or None."""
    if len(values) > 1:
        raise click.BadParameter(f"{values[0]}, and {values[1]}: give one")
    return values[0] if values else None


def number_within(low: float, high: float, what: str, *, zero: bool = False) -> Callable[[object], float]:
    """Make the type of an option: a finite number from `low` to `high`. A `low` of 0 is excluded unless `zero`.

    >>> number_within(0, 180, "an angle")("7.5"), number_within(0, 1, "a share", zero=True)("0")
    (7.5, 0.0)
    """

    def number(value: object) -> float:
        try:
            typed = float(str(value))
        except ValueError:
            typed = math.nan
        if not low <= typed <= high or (typed == low == 0 and not zero):
            raise click.BadParameter(f"{str(value)!r}: need {what}")
        return typed

    return number


positive = number_within(0, sys.float_info.max, "a number above 0")
angle = number_within(0, 180, "degrees above 0, up to 180")
inclination = number_within(-89, 89, "degrees from -89 to 89")


def numbers_of(text: str) -> list[float]:
    """Read finite numbers separated by commas; empty if the text contains anything else.

    >>> numbers_of("1.5,-2"), numbers_of("1,nan"), numbers_of("one")
    ([1.5, -2.0], [], [])
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
