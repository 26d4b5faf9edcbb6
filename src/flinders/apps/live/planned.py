"""Plans of recordings for the page: instructions and the heading error to expect, by body and noise of the sensor.

The program plans when it is asked. The page that needs no program has a table of plans, `plans.json`, for each body at
some levels of noise; ``python -m flinders.apps.live.planned`` writes it anew, and a test plans some of them again.

>>> [row.noise for row in planned_table() if row.body == "robot"] == list(NOISES_UT)
True
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from flinders.core.durations import duration_text
from flinders.fitting.verdict import headline_of
from flinders.simulate.bodies import BODIES
from flinders.workflows.planning import plan

NOISES_UT: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Levels of noise of the table, µT."""

TABLE: Final = "plans.json"
"""Name of the table's file, in the folder of this module."""


class PlannedRecording(Struct, frozen=True):
    """A plan as the page shows it."""

    body: str
    noise: float  # µT: 1 σ of each axis and reading
    verdict: str  # expected verdict
    sentence: str  # duration, and the first sentence of the expected verdict
    steps: tuple[str, ...]  # instructions, one for each attitude


def planned_recording(body: str, noise: float | str) -> PlannedRecording:
    """Plan a recording of a body with a noise in µT, or with its unit; raises as `flinders.plan`."""
    planned = plan(body, noise=noise, alternatives=False)
    fit = planned.expected.fit
    words = (
        f"{duration_text(planned.seconds)} at {planned.recording.rate_hz:g} readings a second. {headline_of(fit).words}"
    )
    return PlannedRecording(planned.body.name, planned.recording.noise, fit.verdict, words, tuple(planned.steps))


@cache
def planned_table() -> tuple[PlannedRecording, ...]:
    """The table of plans: each body at each of `NOISES_UT`."""
    text = files("flinders.apps.live").joinpath(TABLE).read_bytes()
    return msgspec.json.decode(text, type=tuple[PlannedRecording, ...])


def bodies_data() -> list[list[str]]:
    """Name and description of each body, such as a drone, for the page."""
    return [[body.name, body.description] for body in BODIES.values()]


def write_table() -> None:
    """Plan all recordings of the table, and write it."""
    rows = [planned_recording(body, noise) for body in BODIES for noise in NOISES_UT]
    lines = ",\n".join(msgspec.json.encode(row).decode() for row in rows)
    Path(__file__).with_name(TABLE).write_text(f"[\n{lines}\n]\n", encoding="utf-8")


if __name__ == "__main__":
    write_table()
