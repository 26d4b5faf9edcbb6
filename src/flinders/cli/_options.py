"""Options that several commands share, and checks of what they name."""

from __future__ import annotations

import math
import os
import stat
import sys
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, TypeVar

import click

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Function = TypeVar("Function", bound="Callable[..., Any]")


def within(low: float, high: float, what: str) -> Callable[[object], float]:
    """Make the type of an option that takes a finite number from `low`, unless that is 0, to `high`.

    >>> within(0, 180, "an angle")("7.5")
    7.5
    """

    def number(value: object) -> float:
        try:
            found = float(str(value))
        except ValueError:
            found = math.nan
        if not low <= found <= high or found == low == 0:
            raise click.BadParameter(f"{str(value)!r}: need {what}")
        return found

    return number


positive = within(0, sys.float_info.max, "a number above 0")

as_json = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
force = click.option("--force", is_flag=True, help="Overwrite the output file if it exists.")
columns = click.option(
    "--columns", metavar="X,Y,Z", help="The magnetometer's columns: three names, or numbers counted from 1."
)
pattern = click.option(
    "--pattern", metavar="LINE", help="How a line is printed, where it is not recognised: 'N {x} / {y} / {z}'."
)


def numbers(function: Function) -> Function:
    """Which numbers of a line are the magnetometer's."""
    return columns(pattern(function))


sensor = click.option(
    "--sensor",
    metavar="N|NAME",
    help="Which magnetometer of several, by number or name [default: the first].",
)

OF_A_LOG: Final = ("topic", "start", "end", "as_logged")
"""What `log` adds."""
READING: Final = ("columns", "pattern", "unit", "scale", "axes", *OF_A_LOG)
"""What `recording` adds: arguments of `flinders.open_recording`."""


def log(function: Function) -> Function:
    """Which part of a recording is read, and of a log with several instruments."""
    for option in (
        click.option(
            "--as-logged", is_flag=True,
            help="Take the readings of a log as they are: leave on what the vehicle had corrected.",
        ),
        click.option(
            "--to", "end", type=float, metavar="S", help="Leave out what comes later, in seconds from the beginning."
        ),
        click.option(
            "--from", "start", type=float, metavar="S", help="Leave out what comes before, in seconds."
        ),
        click.option("--topic", metavar="NAME", help="Topic of a bag, or member of a ZIP archive."),
    ):  # fmt: skip
        function = option(function)
    return function


def recording(function: Function) -> Function:
    """How a recording is to be read."""
    function = log(function)
    for option in (
        click.option(
            "--axes", default="x,y,z", show_default=True, metavar="AXES",
            help="Where each axis used comes from: x,-y,-z turns the sensor over.",
        ),
        click.option("--scale", type=positive, metavar="UT", help="Microtesla in one count."),
        click.option("--unit", metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts."),
        numbers,
    ):  # fmt: skip
        function = option(function)
    return function


def judgement(function: Function) -> Function:
    """What the result is held against."""
    for option in (
        click.option(
            "--dip", "dip_deg", type=within(-89, 89, "degrees from -89 to 89"), default=60.0, show_default=True,
            metavar="DEG", help="Inclination of the field at the site.",
        ),
        click.option(
            "--target", "target_deg", type=within(0, 180, "degrees above 0, up to 180"), default=1.0,
            show_default=True, metavar="DEG", help="Worst heading error that is good enough.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


def shown(function: Function) -> Function:
    """What a calibration that is shown is held against, where that is not what its file says."""
    for option in (
        click.option(
            "--dip", "dip_deg", type=within(-89, 89, "degrees from -89 to 89"), metavar="DEG",
            help="Inclination of the field at the site [default: the calibration's].",
        ),
        click.option(
            "--target", "target_deg", type=within(0, 180, "degrees above 0, up to 180"), metavar="DEG",
            help="Worst heading error that is good enough [default: the calibration's].",
        ),
    ):  # fmt: skip
        function = option(function)
    return function


def refuse_to_overwrite(output: str | None, inputs: Iterable[str]) -> None:
    """Keep what is read from being written over, also with ``--force`` and through ``>``.

    Raises
    ------
    UsageError
        Where the output is one of the inputs.
    """
    target = _identity(sys.stdout if output is None or output == "-" else output)
    for path in inputs:
        if path != "-" and target is not None and target == _identity(path):
            raise UsageError(f"{path} is read, and would be written over: name another file for the output")


def refuse_twice(paths: Iterable[str]) -> None:
    """Take a recording once: counted twice it would seem better than it is.

    Raises
    ------
    UsageError
        Where a file is named twice.
    """
    seen = set()
    for path in paths:
        file = path if path == "-" else _identity(path)
        if file is not None and file in seen:
            raise UsageError(f"{'standard input' if path == '-' else path} is given twice: name each recording once")
        seen.add(file)


def _identity(file: str | IO[str]) -> tuple[int, int] | None:
    """Which regular file a path or stream leads to, by whatever name; None where it leads to none."""
    try:
        status = Path(file).stat() if isinstance(file, str) else os.fstat(file.fileno())
    except (OSError, ValueError):
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISREG(status.st_mode) else None
