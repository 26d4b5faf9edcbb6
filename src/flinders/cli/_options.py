"""Options in groups: a dataclass for each, whose fields are options, and help that has them under headings.

>>> @groups(reading=ReadingOptions)
... def show(reading):
...     print(reading.unit, reading.axes)
>>> click.command(cls=Command)(show).main(["--unit", "mG"], standalone_mode=False)
mG x,y,z
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field, fields
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from flinders.cli._output import say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from flinders.heading.smoothing import Filter

Function = TypeVar("Function", bound="Callable[..., Any]")

RECORDING, SITE, AIDING, METHOD, OUTPUT = (
    "Recording", "Site", "Aiding sensors and disturbances", "Method", "Output",
)  # fmt: skip
HEADINGS: Final = (RECORDING, SITE, AIDING, METHOD, OUTPUT)
"""Headings of a command's help, in their order, below the options that are used most."""


FEW: Final = 8
"""So many options of a command need no headings."""


class Option(click.Option):
    """An option that knows its heading in the help, and how it was spelled in earlier releases."""

    def __init__(self, *args: Any, heading: str = "", was: Sequence[str] = (), **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.heading, self.was = heading, was


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
        return super().parse_args(ctx, list(_respelled(args, self.params)))

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


def _respelled(args: Iterable[str], params: Iterable[click.Parameter]) -> Iterator[str]:
    """Put the new spelling of an option in the place of an earlier one, and say so."""
    renamed = {old: param.opts[0] for param in params for old in getattr(param, "was", ())}
    words = iter(args)
    for word in words:
        name, equals, value = word.partition("=")
        if name in renamed:
            say(f"! {name} is deprecated: use {renamed[name]}")
        yield f"{renamed.get(name, name)}{equals}{value}"
        if word == "--":
            yield from words


command = partial(click.command, cls=Command)
option = partial(click.option, cls=Option)


class OptionGroup:
    """Options that belong together, as one object: a field for each, made by `member`."""

    def as_dict(self) -> dict[str, Any]:
        """Each option by its name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]


def member(*names: str, **attributes: Any) -> Any:  # noqa: ANN401 - a field of any type
    """A field of a group: an option, declared as with `click.option`."""
    return field(metadata={"option": option(*names, **attributes)})


def some(kind: type[OptionGroup], *names: str) -> Callable[[Function], Function]:
    """Add just some options of a group to a command, which gets each by its name."""

    def decorate(function: Function) -> Function:
        for each in reversed(fields(kind)):  # type: ignore[arg-type]
            if each.name in names:
                each.metadata["option"](function)
        return function

    return decorate


def groups(**kinds: type[OptionGroup]) -> Callable[[Function], Function]:
    """Add the options of groups to a command, which gets each group as one object of that name."""

    def decorate(function: Function) -> Function:
        @wraps(function)
        def grouped(*args: Any, **values: Any) -> Any:  # noqa: ANN401 - what the command gives
            given = {
                name: kind(**{each.name: values.pop(each.name) for each in fields(kind)})  # type: ignore[arg-type]
                for name, kind in kinds.items()
            }
            return function(*args, **values, **given)

        for kind in reversed(kinds.values()):
            some(kind, *(each.name for each in fields(kind)))(grouped)  # type: ignore[arg-type]
        return grouped  # type: ignore[return-value]

    return decorate


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


@dataclass(frozen=True)
class ColumnsOptions(OptionGroup):
    """Which numbers of a line are the magnetometer's."""

    columns: str | None = member(
        "--columns", heading=RECORDING, metavar="X,Y,Z",
        help="The magnetometer's columns: three names, or numbers counted from 1.",
    )  # fmt: skip
    pattern: str | None = member(
        "--pattern", heading=RECORDING, metavar="LINE",
        help="How a line is printed, where it is not recognised: 'N {x} / {y} / {z}'.",
    )  # fmt: skip


@dataclass(frozen=True)
class UnitsOptions(OptionGroup):
    """In which unit the readings are."""

    unit: str | None = member(
        "--unit", heading=RECORDING, metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts."
    )
    scale: float | None = member(
        "--scale", heading=RECORDING, type=positive, metavar="UT", help="Microtesla in one count."
    )


@dataclass(frozen=True)
class AxesUsed(OptionGroup):
    """In which axes the readings are used."""

    axes: str = member(
        "--axes", heading=RECORDING, default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis used comes from: x,-y,-z turns the sensor over.",
    )  # fmt: skip


@dataclass(frozen=True)
class PartOptions(OptionGroup):
    """Which part of a recording is read, and of a log with several instruments."""

    topic: str | None = member(
        "--topic", heading=RECORDING, metavar="NAME", help="Topic of a bag, or member of a ZIP archive."
    )
    start: float | None = member(
        "--from", "start", heading=RECORDING, type=float, metavar="S", help="Leave out what comes before, in seconds."
    )
    end: float | None = member(
        "--to", "end", heading=RECORDING, type=float, metavar="S",
        help="Leave out what comes later, in seconds from the beginning.",
    )  # fmt: skip
    as_logged: bool = member(
        "--as-logged", heading=RECORDING, is_flag=True,
        help="Take the readings of a log as they are: leave on what the vehicle had corrected.",
    )  # fmt: skip


@dataclass(frozen=True)
class PartOfColumns(PartOptions, ColumnsOptions):
    """How a recording is read whose unit and axes a calibration knows."""


@dataclass(frozen=True)
class ReadingOptions(PartOptions, AxesUsed, UnitsOptions, ColumnsOptions):
    """How a recording is read: the arguments of `flinders.open_recording`."""


@dataclass(frozen=True)
class Place(OptionGroup):
    """Where and when, for the declination."""

    place: str | None = member(
        "--at", "place", heading=SITE, metavar="LAT,LON[,ALT]",
        help="Site: degrees, north and east positive, and metres; gives true headings (World Magnetic Model).",
    )  # fmt: skip
    date: str | None = member(
        "--date", heading=SITE, metavar="DAY",
        help="Day of the recording, such as 2026-11-21, or today [default: by its clock, if from 1970].",
    )  # fmt: skip


@dataclass(frozen=True)
class Accelerometer(OptionGroup):
    """Whether tilt is taken off, and by which columns."""

    is_level: bool = member(
        "--level", "is_level", heading=AIDING, is_flag=True, help="Use x and y alone: the sensor is never tilted."
    )
    acceleration: str | None = member(
        "--acceleration", heading=AIDING, metavar="X,Y,Z",
        help="The accelerometer's columns: three names, or numbers counted from 1.",
    )  # fmt: skip
    acceleration_axes: str = member(
        "--acceleration-axes", heading=AIDING, default="x,y,z", show_default=True, metavar="AXES",
        help="Where each axis of the acceleration comes from.",
    )  # fmt: skip


def target(
    words: str = "Worst heading error that is good enough.", default: float | None = 1.0
) -> Callable[[Function], Function]:
    """``--target``, with what it means and its default for a command."""
    return option(
        "--target", "target_deg", heading=METHOD, type=angle, default=default, show_default=default is not None,
        metavar="DEG", help=words,
    )  # fmt: skip


def dip(
    words: str = "Inclination of the field at the site.", default: float | None = None
) -> Callable[[Function], Function]:
    """``--dip``, with what it means and its default for a command."""
    return option(
        "--dip", "dip_deg", heading=SITE, type=inclination, default=default, show_default=default is not None,
        metavar="DEG", help=words,
    )  # fmt: skip


def judgement(function: Function) -> Function:
    """What the result is compared with."""
    return target()(dip(default=60.0)(function))


def field_strength(
    words: str = "Strength of the field at the site, in µT (in counts for a recording in counts).", **more: Any
) -> Callable[[Function], Function]:
    """``--field-strength``, with what it means for a command."""
    attributes = {"heading": SITE, "type": positive, "metavar": "F", **more}
    return option("--field-strength", help=words, **attributes)


as_json = option("--json", "as_json", is_flag=True, heading=OUTPUT, help="Print the result as JSON on standard output.")
force = option("--force", is_flag=True, heading=OUTPUT, help="Overwrite the output file if it exists.")
sensor = option(
    "--sensor", heading=RECORDING, metavar="N|NAME",
    help="Which magnetometer of several, by number or name [default: the first].",
)  # fmt: skip
sensor_of_calibration = option(
    "--sensor", heading=RECORDING, metavar="N|NAME",
    help="Which of several magnetometers, by number from 1 or by name [default: the calibration's, else the first].",
)  # fmt: skip
BAUD: Final[dict[str, Any]] = {
    "type": click.IntRange(50, 20_000_000), "default": 115200, "show_default": True, "metavar": "N",
    "help": "Bits per second of a serial port.",
}  # fmt: skip
"""What ``--baud`` is."""
fixed = option(
    "--fix", "fixed", was=("--hold",), heading=AIDING, multiple=True, metavar="NAME=VALUE",
    help="Take the calibration at a fixed current (A), throttle (0 to 1) or temperature (°C).",
)  # fmt: skip


def _filter(value: str) -> Filter:
    """Read the value of ``--filter``."""
    from flinders.heading.smoothing import Filter

    try:
        return Filter.of(value)
    except UsageError as error:
        raise click.BadParameter(str(error)) from None


def _one(_context: click.Context, _option: click.Parameter, given: tuple[Filter, ...]) -> Filter | None:
    """Take the filter, if there is one; two would come one after the other, in an order that nobody has stated."""
    if len(given) > 1:
        raise click.BadParameter(f"{given[0]}, and {given[1]}: give one filter")
    return given[0] if given else None


smoothing = option(
    "--filter", "by", heading=METHOD, type=_filter, multiple=True, callback=_one, metavar="NAME[:WIDTH]",
    help="Filter the readings: moving-average, median or kalman, over WIDTH readings [default: 5].",
)  # fmt: skip
