"""Options that several commands share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from collections.abc import Callable

Function = TypeVar("Function", bound="Callable[..., Any]")

as_json = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")
force = click.option("--force", is_flag=True, help="Overwrite the output file if it exists.")
columns = click.option(
    "--columns", metavar="X,Y,Z", help="The magnetometer's columns: three names, or numbers counted from 1."
)


def recording(function: Function) -> Function:
    """How a recording is to be read."""
    for option in (
        click.option(
            "--axes", default="x,y,z", show_default=True, metavar="AXES",
            help="Where each axis used comes from: x,-y,-z turns the sensor over.",
        ),
        click.option("--scale", type=float, metavar="UT", help="Microtesla in one count."),
        click.option("--unit", metavar="UNIT", help="Unit of the readings: uT, mG, G, nT, mT, T or counts."),
        columns,
    ):  # fmt: skip
        function = option(function)
    return function


def judgement(function: Function) -> Function:
    """What the result is held against."""
    for option in (
        click.option(
            "--dip", "dip_deg", type=float, default=60.0, show_default=True, metavar="DEG",
            help="Inclination of the field at the site.",
        ),
        click.option(
            "--target", "target_deg", type=float, default=1.0, show_default=True, metavar="DEG",
            help="Worst heading error that is good enough.",
        ),
    ):  # fmt: skip
        function = option(function)
    return function
