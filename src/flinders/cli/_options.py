"""Options of commands: a dataclass of each, completion of their values, and those that several commands share.

Each command has a dataclass whose fields are its arguments, options and groups of options.

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

import math
import sys
from dataclasses import Field as DataclassField
from dataclasses import dataclass, field, fields
from functools import wraps
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias, TypeVar, dataclass_transform

import click
from click.shell_completion import CompletionItem

from flinders.cli._output import Output, Outputs, say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from types import ModuleType

    from flinders.heading.smoothing import Filter

Options = TypeVar("Options", bound="Group")
Field: TypeAlias = Any
"""A field of a group: what declares an option, and the value of that for a type checker."""

RECORDING, SITE, AIDING, METHOD, OUTPUT = HEADINGS = (
    "Recording", "Site", "Aiding sensors and disturbances", "Method", "Output",
)  # fmt: skip
"""Headings of a command's help, in their order, below the options that are used most."""

Completion: TypeAlias = list[CompletionItem]
"""What a shell completes a word to."""

FEW: Final = 8
"""So many options of a command need no headings."""

RENAMED: Final[Mapping[str, Mapping[str, str]]] = {
    "apply": {"--hold": "--fix"},
    "calibrate": {"--together": "--joint"},
    "check": {"--hold": "--fix"},
    "drift": {"--most": "--limit"},
    "heading": {"--hold": "--fix"},
    "swing": {"--rest": "--stationary"},
    "three-axis": {"--held": "--stationary", "--limit": "--saturation"},
}
"""Options by command that had another spelling in the last release, which still works for this one."""


class Option(click.Option):
    """An option that knows its heading in the help."""

    def __init__(self, *args: Any, heading: str = "", **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.heading = heading


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
        """Read a command line, in which options may have their earlier spelling."""
        return super().parse_args(ctx, list(_respelled(args, RENAMED.get(self.name or "", {}))))

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


def _respelled(args: Iterable[str], renamed: Mapping[str, str]) -> Iterator[str]:
    """Put the new spelling of an option in the place of an earlier one, and say so."""
    words = iter(args)
    for word in words:
        name, equals, value = word.partition("=")
        if name in renamed:
            say(f"! {name} is deprecated: use {renamed[name]}")
        yield f"{renamed.get(name, name)}{equals}{value}"
        if word == "--":
            yield from words


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
        """The same, refused where one cannot be written, or is one of the arguments or `inputs`, which are read."""
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
        """The same in words, for a report.

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


# ------------------------------------------------------------------------------------------- what a shell completes


def complete_files(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Let the shell complete names of files."""
    return [CompletionItem(begun, type="file")]


def complete_targets(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Names of targets.

    >>> [item.value for item in complete_targets(None, None, "px")]
    ['px4', 'px4-shell']
    """
    from flinders.targets import registry

    return _matching(registry(), begun)


def complete_methods(_context: click.Context | None, _option: click.Parameter | None, begun: str) -> Completion:
    """Names of methods."""
    from flinders.estimators import METHODS

    return _matching(("auto", *METHODS), begun)


def _matching(names: Iterable[str], begun: str) -> Completion:
    """Items of the names that begin so."""
    return [CompletionItem(name) for name in names if name.startswith(begun)]


BY_METAVAR: Final = {
    **dict.fromkeys(("FILE", "CALIBRATION", "LOG", "TRUTH", "SESSION"), complete_files),
    "TARGET": complete_targets,
}
"""Completion of options by what their value is called in the help."""


# ------------------------------------------------------------------------------------ options of several commands


def target(words: str = "Worst heading error that is good enough.", default: float | None = 1.0) -> Field:
    """``--target``, with what it means and its default for a command."""
    return member(
        "--target", heading=METHOD, type=angle, default=default, show_default=default is not None, metavar="DEG",
        help=words,
    )  # fmt: skip


def dip(words: str = "Inclination of the field at the site.", default: float | None = None) -> Field:
    """``--dip``, with what it means and its default for a command."""
    return member(
        "--dip", heading=SITE, type=inclination, default=default, show_default=default is not None, metavar="DEG",
        help=words,
    )  # fmt: skip


def field_strength(
    words: str = "Strength of the field at the site, in µT (in counts for a recording in counts).", **more: Any
) -> Field:
    """``--field-strength``, with what it means for a command."""
    return member("--field-strength", help=words, **{"heading": SITE, "type": positive, "metavar": "F", **more})


def as_json(heading: str = OUTPUT) -> Field:
    """``--json``."""
    return flag("--json", "Print the result as JSON on standard output.", heading=heading)


def lossy() -> Field:
    """``--lossy``."""
    return flag("--lossy", "Do it also where what is left out costs more than 0.5° of heading.")


def mounting() -> Field:
    """``--mounting``."""
    return member(
        "--mounting", metavar="MOUNTING",
        help="How the compass was mounted when it was recorded, as the autopilot has it: a number or name, or "
        "ROLL,PITCH,YAW in degrees [default: as its log says].",
    )  # fmt: skip


def force(words: str = "Overwrite the output file if it exists.") -> Field:
    """``--force``."""
    return flag("--force", words, heading=OUTPUT)


def output(what: str, words: str, **more: Any) -> Field:
    """``-o``, with what is written."""
    return member("-o", "--output", what=what, metavar="FILE", help=words, **more)


def sensor(
    words: str = "Which magnetometer of several, by number or name [default: the first].", metavar: str = "N|NAME"
) -> Field:
    """``--sensor``, with what it means for a command."""
    return member("--sensor", heading=RECORDING, metavar=metavar, help=words)


def sensor_of_calibration() -> Field:
    """``--sensor`` where a calibration says which one it is for."""
    return sensor(
        "Which of several magnetometers, by number from 1 or by name [default: the calibration's, else the first]."
    )


def baud() -> Field:
    """``--baud``."""
    return member(
        "--baud", type=click.IntRange(50, 20_000_000), default=115200, show_default=True, metavar="N",
        help="Bits per second of a serial port.",
    )  # fmt: skip


def udp() -> Field:
    """``--udp``."""
    return member("--udp", type=click.IntRange(1, 65535), metavar="PORT", help="Listen for datagrams on this port.")


def tcp() -> Field:
    """``--tcp``."""
    return member("--tcp", metavar="HOST:PORT", help="Connect to a program that sends lines.")


def fixed() -> Field:
    """``--fix``."""
    return member(
        "--fix", heading=AIDING, multiple=True, metavar="NAME=VALUE",
        help="Take the calibration at a fixed current (A), throttle (0 to 1) or temperature (°C).",
    )  # fmt: skip


def smoothing() -> Field:
    """``--filter``."""
    return member(
        "--filter", heading=METHOD, type=_filter, multiple=True, callback=only_one, metavar="NAME[:WIDTH]",
        help="Filter the readings: moving-average, median or kalman, over WIDTH readings [default: 5].",
    )  # fmt: skip


def _filter(value: str) -> Filter:
    """Read the value of ``--filter``."""
    from flinders.heading.smoothing import Filter

    try:
        return Filter.of(value)
    except UsageError as error:
        raise click.BadParameter(str(error)) from None


class Judgement(Group):
    """What the result is compared with."""

    target_deg: float = target()
    dip_deg: float = dip(default=60.0)


class ColumnsOptions(Group, heading=RECORDING):
    """Which numbers of a line are the magnetometer's."""

    columns: str | None = member(
        "--columns", metavar="X,Y,Z", help="The magnetometer's columns: three names, or numbers counted from 1."
    )
    pattern: str | None = member(
        "--pattern", metavar="LINE", help="How a line is printed, where it is not recognised: 'N {x} / {y} / {z}'."
    )


class UnitsOptions(Group, heading=RECORDING):
    """In which unit the readings are."""

    unit: str | None = member("--unit", metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts.")
    scale: float | None = member("--scale", type=positive, metavar="UT", help="Microtesla in one count.")


class AxesOptions(Group, heading=RECORDING):
    """In which axes the readings are used."""

    axes: str = member(
        "--axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis used comes from: x,-y,-z turns the sensor over.",
    )  # fmt: skip


class PartOptions(Group, heading=RECORDING):
    """Which part of a recording is read, and of a log with several instruments."""

    topic: str | None = member("--topic", metavar="NAME", help="Topic of a bag, or member of a ZIP archive.")
    start: float | None = member("--from", type=float, metavar="S", help="Leave out what comes before, in seconds.")
    end: float | None = member(
        "--to", type=float, metavar="S", help="Leave out what comes later, in seconds from the beginning."
    )
    as_logged: bool = flag(
        "--as-logged", "Take the readings of a log as they are: leave on what the vehicle had corrected."
    )


class PartOfColumns(PartOptions, ColumnsOptions):
    """How a recording is read whose unit and axes a calibration knows."""


class ReadingOptions(PartOptions, AxesOptions, UnitsOptions, ColumnsOptions):
    """How a recording is read: the arguments of `flinders.open_recording`."""


class Place(Group, heading=SITE):
    """Where and when, for the declination."""

    place: str | None = member(
        "--at", metavar="LAT,LON[,ALT]",
        help="Site: degrees, north and east positive, and metres; gives true headings (World Magnetic Model).",
    )  # fmt: skip
    date: str | None = member(
        "--date", metavar="DAY",
        help="Day of the recording, such as 2026-11-21, or today [default: by its clock, if from 1970].",
    )  # fmt: skip

    def check(self) -> None:
        """Refuse a day without a place."""
        if self.date is not None and self.place is None:
            raise UsageError("--date is for the field at a place: give --at LAT,LON too")


class Accelerometer(Group, heading=AIDING):
    """Whether tilt is removed, and by which columns."""

    is_level: bool = flag("--level", "Use x and y alone: the sensor is never tilted.")
    acceleration: str | None = member(
        "--acceleration", metavar="X,Y,Z",
        help="The accelerometer's columns: three names, or numbers counted from 1.",
    )  # fmt: skip
    acceleration_axes: str = member(
        "--acceleration-axes", default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis of the acceleration comes from.",
    )  # fmt: skip
