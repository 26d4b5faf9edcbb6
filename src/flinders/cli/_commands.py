"""Commands by name: each has a module of its own, which is imported when the command is called, and a line for help."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.plugins import app_rows

if TYPE_CHECKING:
    import click

USE, LOOK, TRY, COMMANDS = "Calibrate and use", "Look", "Try out", "Commands"
HEADINGS: Final = (
    USE, LOOK, "Sensors on a wire", "Many units", "Vehicles, boats and surveys", "Classic recipes", TRY, COMMANDS,
)  # fmt: skip
"""Headings of the list of commands, in their order; those without commands are left out."""

ROWS: Final = {
    "plan": (USE, "plan", "Say how to turn a sensor, how long, and what error to expect."),
    "calibrate": (USE, "calibrate", "Fit recordings of a sensor and write its calibration."),
    "apply": (USE, "apply", "Correct a recording with a calibration file."),
    "heading": (USE, "heading", "Turn a recording into magnetic and true headings."),
    "check": (USE, "check", "Say whether a calibration holds on another recording."),
    "refresh": (USE, "refresh", "Renew the hard iron of a calibration in ten seconds."),
    "accelerometer": (USE, "accelerometer", "Calibrate an accelerometer from still poses."),
    "merge": (USE, "merge", "Put several calibrations of a sensor together."),
    "export": (USE, "export", "Write a calibration for what uses it."),
    "import": (USE, "import_", "Read a calibration out of another tool's file."),
    "info": (LOOK, "info", "Say what a recording or a log holds, and what to type next."),
    "show": (LOOK, "show", "Say what a calibration file holds."),
    "explain": (LOOK, "explain", "Say what the code of a finding means, and what to do."),
    "report": (LOOK, "report", "Write a report of a calibration and a recording."),
    "compare": (LOOK, "compare", "Say how far two calibrations are apart, in degrees."),
    "methods": (LOOK, "methods", "List the methods and when to use each."),
    "chips": (LOOK, "chips", "List magnetometer chips, and one with its settings and sources."),
    "targets": (LOOK, "targets", "List what a calibration can be written for."),
    "demo": (TRY, "demo", "Simulate a tumbled sensor and calibrate it."),
    "simulate": (TRY, "simulate", "Simulate a recording whose truth is known."),
    "evaluate": (TRY, "evaluate", "Hold a calibration against the truth of a simulation."),
}
"""Commands of the library: heading, module beside this one, and what the command does."""

OTHERWISE: Final = {
    "help": "each command has --help of its own",
    "monitor": "flinders record keeps what a board prints, flinders live shows it",
    "plot": "figures are in the page of flinders report and of calibrate --report; in Python fit.plot draws them",
}
"""Words that people type as a command, and what does that instead."""


class Row(NamedTuple):
    """A command that is not imported yet."""

    heading: str
    module: str  # full name
    words: str  # what it does, in a line


class Commands(Mapping[str, "click.Command"]):
    """Commands by name, each the ``command`` of its module, imported when it is asked for.

    >>> commands = Commands({"info": (LOOK, "info", "Say what a recording holds.")}, table="NO_SUCH_TABLE")
    >>> commands["info"].name, commands.headings()
    ('info', [('Look', [('info', 'Say what a recording holds.')])])
    """

    def __init__(self, own: Mapping[str, tuple[str, str, str]], *, table: str) -> None:
        """Commands of modules beside this one, and those that packages of `flinders.apps` add in a `table`."""
        self._own, self._table = own, table

    @cached_property
    def _rows(self) -> dict[str, Row]:
        here = __name__.rpartition(".")[0]
        rows = {name: Row(heading, f"{here}.{module}", words) for name, (heading, module, words) in self._own.items()}
        for name, app, (heading, module, words) in app_rows(self._table):
            rows[name] = Row(heading, f"{app}.{module}", words)
        return rows

    def headings(self) -> list[tuple[str, list[tuple[str, str]]]]:
        """Each heading with the names and lines of its commands."""
        return [
            (heading, entries)
            for heading in HEADINGS
            if (entries := [(name, row.words) for name, row in self._rows.items() if row.heading == heading])
        ]

    def __getitem__(self, name: str) -> click.Command:
        command: click.Command = import_module(self._rows[name].module).command
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
