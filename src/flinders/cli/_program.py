"""The program: commands made of dataclasses of options, one table of exit codes, no traceback for bad input.

Each command is imported when it is called, and has a dataclass whose fields are its arguments, options and groups of
options.

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

from flinders.cli._commands import OTHERWISE, Commands
from flinders.cli._completion import BY_METAVAR, complete_files
from flinders.cli._misuse import misused, unexpected
from flinders.cli._output import Output, Outputs, error_words, print_fit, print_json, say
from flinders.cli._process import let_imports_be, prepare_streams, silence_stdout
from flinders.cli._signals import ENDING, handled, interrupt
from flinders.cli._spelling import in_options, searched
from flinders.core.files import reason
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
"""How a command ends by its verdict."""

ANSWER_EXITS: Final[dict[Answer, int]] = {"holds": GOOD, "cannot-tell": LIMITED, "fails": REFUSED}
"""How a command ends that says whether a calibration holds."""

BEGINNINGS: Final = {REFUSED: "refused", LIMITED: "cannot tell"}
"""How the line of an error begins, by how the command ends; else with the word error."""

FIT_KEYS: Final = ("verdict", "method", "calibration", "heading_error_deg", "noise", "coverage", "findings")
"""What every result of ``calibrate --json`` has."""


def show_versions(context: click.Context, _option: click.Parameter, is_asked: bool) -> None:
    """Print the versions and end the program."""
    if is_asked and not context.resilient_parsing:
        from flinders.cli._version import versions

        click.echo(versions())
        context.exit()


class Commanded(click.Group):
    """A group of `Commands`; its help imports none of them."""

    def format_commands(self, _context: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands below their headings."""
        assert isinstance(self.commands, Commands)
        for heading, entries in self.commands.headings():
            with formatter.section(heading):
                formatter.write_dl(entries)


class Program(Commanded):
    """The group of all commands, which ends with a code of the table, whatever happens."""

    def main(  # type: ignore[override]  # click's overloads only tell what `standalone_mode` does
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: object,
    ) -> int:
        """Run a command line and exit; without `standalone_mode`, return the code."""
        words = list(sys.argv[1:] if args is None else args)
        as_json = "--json" in words[: words.index("--") if "--" in words else None]
        try:
            if args is None:
                let_imports_be()
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of such small matrices, threads would wait
            prepare_streams()
            with handled(interrupt, *ENDING):
                code = super().main(words, prog_name, complete_var, standalone_mode=False, **extra)
        except click.ClickException as error:
            code = _misused(error, as_json=as_json)
        except (click.Abort, KeyboardInterrupt):
            say("interrupted")
            code = INTERRUPTED
        except FlindersError as error:
            code = print_error(error, as_json=as_json, commands=searched(self._named_in(words), self))
        except SystemExit as end:  # 1 is how click ends when whoever read our output has gone
            code = UNWRITABLE if end.code == 1 else end.code
        except OSError as error:
            code = print_error(OutputError(f"output cannot be written: {reason(error)}"), as_json=False)
            silence_stdout()
        except Exception as error:  # noqa: BLE001 - the one place that turns a fault of ours into a report
            code = _report_fault(error)
        code = code if isinstance(code, int) else GOOD
        return sys.exit(code) if standalone_mode else code

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Look up a command, also one of two words; for a name that is none, say what replaces it."""
        if (name := " ".join(args[:2])) in self.commands:
            args = [name, *args[2:]]
        if args[0] in OTHERWISE and args[0] not in self.commands and not ctx.resilient_parsing:
            raise click.UsageError(f"No such command '{args[0]}': {OTHERWISE[args[0]]}", ctx)
        begun = [command for command in self.commands if command.startswith(args[0])]
        if begun and args[0] not in self.commands and not ctx.resilient_parsing:
            raise click.UsageError(f"No such command '{args[0]}': did you mean '{begun[0]}'?", ctx)
        return super().resolve_command(ctx, args)

    def _named_in(self, words: Sequence[str]) -> click.Command:
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
    """Print an error in a line, a refused fit as a page, and either in full as JSON where that was asked for.

    `more`: what else the JSON is to hold. `commands`: those whose options may mend it, as `in_options` takes them.
    `exit_code`: how the program ends where it is not that of the error. Returns how it ends.
    """
    exit_code = error.exit_code if exit_code is None else exit_code
    words = error_words(error, commands)
    fit = getattr(error, "fit", None)
    if fit is not None and not as_json:
        print_fit(fit, partial(in_options, commands=commands), err=True)
    else:
        say(f"{BEGINNINGS.get(exit_code, 'error')}: {words}")
    if as_json:
        with contextlib.suppress(OSError):
            print_json({**_as_dict(error, words, exit_code), **(more or {})})
    return exit_code


def _as_dict(error: FlindersError, words: str, exit_code: int) -> dict[str, Any]:
    """The error as a result: a refusal has the keys of a fit, with null where there is none."""
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


def _misused(error: click.ClickException, *, as_json: bool) -> int:
    """Say what click found, and where help is; or give help, where only the name of the program was typed."""
    message = error.format_message()
    if message.startswith("Usage:"):
        say(message)
        return USAGE
    return print_error(UsageError(misused(error)), as_json=as_json)


def _report_fault(error: Exception) -> int:
    """Say that the fault is ours, keep the details in a file, and ask for a report."""
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
"""A field of a group: what declares an option, and the value of that for a type checker."""

RECORDING, SITE, AIDING, METHOD, OUTPUT = HEADINGS = (
    "Recording", "Site", "Aiding sensors and disturbances", "Method", "Output",
)  # fmt: skip
"""Headings of a command's help, in their order, below the options that are used most."""

FEW: Final = 8
"""So many options of a command need no headings."""


class Option(click.Option):
    """An option that knows its heading in the help, and the `keywords` of Python beside its name that it stands for."""

    def __init__(self, *args: Any, heading: str = "", keywords: Sequence[str] = (), **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.heading, self.keywords = heading, keywords


class Command(click.Command):
    """A command whose help begins with the options that are used most, `common`, before the others by heading.

    `headings` has names of parameters by headings of this command alone; other options know theirs.
    """

    def __init__(
        self, *args: Any, common: Sequence[str] = (), headings: Mapping[str, Sequence[str]] | None = None,
        **attributes: Any,
    ) -> None:  # fmt: skip
        super().__init__(*args, **attributes)
        self.common, self.headings = tuple(common), headings or {}

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take the options and arguments, and refuse what remains; an error knows its command, whose help is named."""
        ctx.allow_extra_args = True  # click would refuse them without saying how they are meant
        try:
            rest = super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            raise
        if rest and not ctx.resilient_parsing:
            raise unexpected(rest, ctx)
        return rest

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        sections: dict[str, list[tuple[str, str]]] = {heading: [] for heading in ("", *self.headings, *HEADINGS)}
        for each in sorted(options, key=self._place):
            if record := each.get_help_record(ctx):
                sections[self._heading(each) if len(options) > FEW else ""].append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading or "Options"):
                    formatter.write_dl(records)

    def _heading(self, param: click.Parameter) -> str:
        """Under which heading an option stands."""
        if param.name in self.common:
            return ""
        own = (heading for heading, names in self.headings.items() if param.name in names)
        return next(own, getattr(param, "heading", ""))

    def _place(self, param: click.Parameter) -> int:
        """Where an option stands: the common ones as they are listed, then all others as they were declared."""
        return self.common.index(param.name) if param.name in self.common else len(self.common)


@dataclass_transform(frozen_default=True)
class Group:
    """Options that belong together, as one object: a dataclass with a field for each, made by `member`.

    `heading`: under which heading of the help they stand, unless a member says otherwise.
    """

    def __init_subclass__(cls, heading: str = "") -> None:
        for each in vars(cls).values():
            if isinstance(each, DataclassField) and heading:
                each.metadata["attributes"].setdefault("heading", heading)
        dataclass(frozen=True, eq=False, repr=False)(cls)

    @classmethod
    def parameters(cls) -> Iterator[click.Parameter]:
        """What click is to parse."""
        for each in fields(cls):  # type: ignore[arg-type]
            if "group" in each.metadata:
                yield from each.metadata["group"].parameters()
            else:
                yield each.metadata["kind"]([*each.metadata["names"], each.name], **each.metadata["attributes"])

    @classmethod
    def taken(cls, values: dict[str, Any]) -> Self:
        """Take the values of this group out of those that a command was called with."""
        return cls(
            **{
                each.name: kind.taken(values) if (kind := each.metadata.get("group")) else values[each.name]
                for each in fields(cls)  # type: ignore[arg-type]
            }
        )

    def members(self) -> Iterator[tuple[Mapping[str, Any], Any]]:
        """How each option and argument was declared, and its value; those of groups too."""
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            yield from value.members() if "group" in each.metadata else [(each.metadata, value)]

    @property
    def outputs(self) -> Outputs:
        """The files that options name."""
        return Outputs(tuple(self.named_files()), getattr(self, "force", False), getattr(self, "as_json", False))

    def checked_outputs(self, *inputs: str | None) -> Outputs:
        """The files that options name; refuses one that cannot be written, or is an argument or one of `inputs`."""
        read = list(filter(None, inputs))
        for declared, value in self.members():
            if declared["kind"] is click.Argument:
                read += [value] if isinstance(value, str) else value or ()
        outputs = self.outputs
        outputs.check(read)
        return outputs

    def named_files(self) -> Iterator[Output]:
        """The files that options name, each by `what` it is."""
        for declared, value in self.members():
            if what := declared.get("what"):
                yield Output(what, value, declared["names"][0])

    def as_dict(self, *, if_typed: Sequence[str] = ()) -> dict[str, Any]:
        """Each option by its name; those of `if_typed` only where they were given on the command line."""
        names = [each.name for each in fields(self)]  # type: ignore[arg-type]
        return {name: getattr(self, name) for name in names if name not in if_typed or is_typed(name)}

    def typed(self) -> dict[str, Any]:
        """The options that are not at their defaults, as they are spelled, but for those of what is written.

        >>> from flinders.cli._options import ReadingOptions
        >>> ReadingOptions(None, None, "mG", None, "x,y,z", None, 5.0, None, False).typed()
        {'--unit': 'mG', '--from': 5.0}
        """
        typed: dict[str, Any] = {}
        for declared, value in self.members():
            attributes = declared["attributes"]
            if attributes.get("heading") != OUTPUT and value not in (None, False, (), attributes.get("default")):
                typed |= {name: value for name in declared["names"] if name.startswith("--")}
        return typed

    def typed_words(self) -> dict[str, str]:
        """Options that were typed, and their values in words, for a report.

        >>> from flinders.cli._options import ReadingOptions
        >>> ReadingOptions(None, None, "mG", None, "x,y,z", None, 5.0, None, True).typed_words()
        {'--unit': 'mG', '--from': '5.0', '--as-logged': 'yes'}
        """
        return {
            name: "yes" if value is True else ", ".join(value) if isinstance(value, tuple) else f"{value}"
            for name, value in self.typed().items()
        }


def member(*names: str, what: str = "", **attributes: Any) -> Field:
    """A field that is an option, declared as with `click.option`; the field names its parameter.

    `what`: of an option that names a file to write, what is in that.
    """
    if completion := BY_METAVAR.get(attributes.get("metavar", "")):
        attributes["shell_complete"] = completion
    return field(metadata={"kind": Option, "names": names, "attributes": attributes, "what": what})


def flag(name: str, words: str, **attributes: Any) -> Field:
    """A field that is an option without a value."""
    return member(name, is_flag=True, help=words, **attributes)


def argument(metavar: str, *, required: bool = True, nargs: int = 1) -> Field:
    """A field that is an argument, shown as `metavar`: the name of a file."""
    attributes = {"metavar": metavar, "required": required, "nargs": nargs, "shell_complete": complete_files}
    return field(metadata={"kind": click.Argument, "names": (), "attributes": attributes})


def group(kind: type[Group]) -> Field:
    """A field that is a group of its own."""
    return field(metadata={"group": kind})


def same_as(kind: type[Group], name: str) -> Field:
    """A field that is one option of another group."""
    return field(metadata=kind.__dataclass_fields__[name].metadata)  # type: ignore[attr-defined]


def command_of(
    name: str,
    kind: type[Options],
    parent: click.Group | ModuleType = click,
    *,
    cls: type[Command] = Command,
    **attributes: Any,
) -> Callable[[Callable[[Options], int | None]], click.Command]:
    """Make a command, of `parent` or the program, of a function that takes its options as one object of `kind`."""

    def decorate(function: Callable[[Options], int | None]) -> click.Command:
        @wraps(function)
        def called(**values: Any) -> int | None:
            return function(kind.taken(values))

        made: click.Command = parent.command(name, cls=cls, params=list(kind.parameters()), **attributes)(called)
        return made

    return decorate


def is_typed(name: str) -> bool:
    """Whether an option was given on the command line."""
    context = click.get_current_context(silent=True)
    return context is not None and context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def only_one(_context: click.Context, _option: click.Parameter, values: tuple[Any, ...]) -> Any:  # noqa: ANN401
    """Take the value of an option that may be given once, if it was given; for `callback`, with ``multiple=True``."""
    if len(values) > 1:
        raise click.BadParameter(f"{values[0]}, and {values[1]}: give one")
    return values[0] if values else None


def within(low: float, high: float, what: str, *, zero: bool = False) -> Callable[[object], float]:
    """Make the type of an option that takes a finite number from `low` to `high`, and 0 only where `zero` says so.

    >>> within(0, 180, "an angle")("7.5"), within(0, 1, "a share", zero=True)("0")
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


positive = within(0, sys.float_info.max, "a number above 0")
angle = within(0, 180, "degrees above 0, up to 180")
inclination = within(-89, 89, "degrees from -89 to 89")


def numbers_of(text: str) -> list[float]:
    """Read finite numbers with commas between them; none where there is anything else.

    >>> numbers_of("1.5,-2"), numbers_of("1,nan"), numbers_of("one")
    ([1.5, -2.0], [], [])
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
