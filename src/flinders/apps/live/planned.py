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
from flinders.findings import Finding, first_causes
from flinders.fitting.verdict import headline_of
from flinders.report.view import FindingView, finding_view
from flinders.simulate.bodies import BODIES, Step, side_key
from flinders.workflows.planning import plan

NOISES_UT: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Levels of noise of the table, µT."""

DIGITS: Final = 4
"""Significant digits of numbers for sentences."""

TABLE: Final = "plans.json"
"""Name of the table's file, in the folder of this module."""


class ClaimView(Struct, frozen=True):
    """Heading error to expect while level, degrees."""

    worst: float
    bound_95: float
    target_deg: float


class StepView(Struct, frozen=True):
    """An instruction: `flinders.simulate.bodies.Step`."""

    form: str
    circle: str
    times: int
    side: str  # key of its words; empty for none
    tilt_deg: float


class PlannedRecording(Struct, frozen=True):
    """A plan as the page shows it."""

    body: str
    noise: float  # µT: 1 σ of each axis and reading
    verdict: str  # expected verdict
    sentence: str  # duration, and the first sentence of the expected verdict
    steps: tuple[str, ...]  # instructions, one for each attitude
    seconds: float
    rate_hz: float  # readings a second
    heading_error_deg: ClaimView  # to expect
    attitude_limit_deg: float  # tilt up to which headings are within the target
    findings: tuple[FindingView, ...]  # first cause of the verdict
    turns: tuple[StepView, ...]  # `steps` as codes and numbers, for pages in other languages


def planned_recording(body: str, noise: float | str) -> PlannedRecording:
    """Plan a recording of a body with a noise in µT, or with its unit; raises as `flinders.plan`."""
    planned = plan(body, noise=noise, alternatives=False)
    fit = planned.expected.fit
    words = (
        f"{duration_text(planned.seconds)} at {planned.recording.rate_hz:g} readings a second. {headline_of(fit).words}"
    )
    claim = fit.claim
    return PlannedRecording(
        body=planned.body.name,
        noise=planned.recording.noise,
        verdict=fit.verdict,
        sentence=words,
        steps=tuple(planned.steps),
        seconds=_short(planned.seconds),
        rate_hz=planned.recording.rate_hz,
        heading_error_deg=ClaimView(
            worst=_short(claim.heading_error_deg.worst),
            bound_95=_short(claim.heading_bound_deg),
            target_deg=claim.target_deg,
        ),
        attitude_limit_deg=_short(claim.attitude_limit_deg),
        findings=tuple(_short_finding(each) for each in first_causes(fit.findings)[:1] if fit.verdict != "good"),
        turns=tuple(map(_step_view, planned.body.coded_steps(planned.sequence))),
    )


def _short(number: float) -> float:
    """A number to as many digits as a sentence may need."""
    return float(f"{number:.{DIGITS}g}")


def _short_finding(finding: Finding) -> FindingView:
    """A finding for the page, with short numbers and without its English sentence."""
    whole = finding_view(finding)
    number, limit = (None if value is None else _short(value) for value in (whole.number, whole.limit))
    return msgspec.structs.replace(whole, number=number, limit=limit, advice="")


def _step_view(step: Step) -> StepView:
    """An instruction for the page."""
    return StepView(step.form, step.circle, step.times, side_key(step.side), step.tilt_deg)


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
