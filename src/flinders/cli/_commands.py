"""Table of the commands. The module of a command is imported only when the command is called."""

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
"""Headings of the list of commands, in order; a heading without commands is omitted."""

ROWS: Final = {
    "plan": (USE, "plan", "Say how to turn a sensor, how long, and what error to expect."),
    "calibrate": (USE, "calibrate", "Fit recordings of a sensor and write its calibration."),
    "apply": (USE, "apply", "Correct a recording with a calibration file."),
    "heading": (USE, "heading", "Turn a recording into magnetic and true headings."),
    "check": (USE, "check", "Test whether a calibration still fits another recording."),
    "refresh": (USE, "refresh", "Renew the hard iron of a calibration in ten seconds."),
    "accelerometer": (USE, "accelerometer", "Calibrate an accelerometer from still poses."),
    "merge": (USE, "merge", "Merge several calibrations of a sensor."),
    "export": (USE, "export", "Write a calibration for another tool."),
    "import": (USE, "import_", "Read a calibration from another tool's file."),
    "info": (LOOK, "info", "Show the contents of a recording or a log, and what to type next."),
    "show": (LOOK, "show", "Show the contents of a calibration file."),
    "explain": (LOOK, "explain", "Explain the code of a finding, and what to do."),
    "report": (LOOK, "report", "Write a report of a calibration and a recording."),
    "compare": (LOOK, "compare", "Compare two calibrations by their headings, in degrees."),
    "methods": (LOOK, "methods", "List the methods and when to use each."),
    "chips": (LOOK, "chips", "List magnetometer chips, and one with its settings and sources."),
    "targets": (LOOK, "targets", "List the tools that a calibration can be written for."),
    "demo": (TRY, "demo", "Simulate a tumbled sensor and calibrate it."),
    "simulate": (TRY, "simulate", "Simulate a recording with a known calibration."),
    "evaluate": (TRY, "evaluate", "Compare a calibration with the truth of a simulation."),
}
"""Commands of the library: heading, module in this package, and line of help."""

REPLACEMENTS: Final = {
    "help": "each command has --help of its own",
    "monitor": "flinders record saves the output of a board, flinders live shows it",
    "plot": "figures are in the reports of flinders report and of calibrate --report; in Python fit.plot draws them",
}
"""Names that people type for a command, and the command to use instead."""


class Row(NamedTuple):
    """Entry of a command whose module is not imported yet."""

    heading: str
    module: str  # full dotted name
    words: str  # line of help


class Commands(Mapping[str, "click.Command"]):
    """Commands by name; the module of a command is imported when the command is first looked up.

    >>> commands = Commands({"info": (LOOK, "info", "Show the contents of a recording.")}, table="NO_SUCH_TABLE")
    >>> commands["info"].name, commands.headings()
    ('info', [('Look', [('info', 'Show the contents of a recording.')])])
    """

    def __init__(self, own: Mapping[str, tuple[str, str, str]], *, table: str) -> None:
        """Combine commands of modules in this package, `own`, with those that apps list in their `table`."""
        self._own, self._table = own, table

    @cached_property
    def _rows(self) -> dict[str, Row]:
        here = __name__.rpartition(".")[0]
        rows = {name: Row(heading, f"{here}.{module}", words) for name, (heading, module, words) in self._own.items()}
        for name, app, (heading, module, words) in app_rows(self._table):
            rows[name] = Row(heading, f"{app}.{module}", words)
        return rows

    def headings(self) -> list[tuple[str, list[tuple[str, str]]]]:
        """Headings, each with the names and help lines of its commands."""
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
