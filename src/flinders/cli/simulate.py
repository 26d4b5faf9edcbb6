"""``flinders simulate``: simulate recordings with a known truth."""

from __future__ import annotations

from typing import Final

import click

from flinders.cli import _program as program
from flinders.cli._commands import COMMANDS, Commands

ROWS: Final = {"three-axis": (COMMANDS, "simulate_three_axis", "A three-axis sensor in motion.")}


@click.group(
    "simulate",
    cls=program.Commanded,
    commands=Commands(ROWS, table="SIMULATIONS"),
    epilog="""\b
Example:
  flinders simulate three-axis -o tumble.csv --motion hand --seed 1
  flinders calibrate tumble.csv -o calibration.json
  flinders evaluate calibration.json tumble.truth.json
""",
)
def command() -> None:
    """Simulate a recording of a sensor with hard and soft iron, and write its truth next to it.

    The recording is CSV, as a logger writes it. The truth (sensor, field, motion, seed) goes into a separate file;
    `flinders evaluate` compares a calibration with it. The same seed gives the same bytes.
    """
