"""A planned recording as a page for the terminal: instructions, expected error, and the gain of more time or tilt.

>>> from flinders.workflows.planning import plan
>>> robot = plan("robot", noise="0.5 uT", alternatives=False)
>>> print(*result_cells(robot.expected)[:2])
0.090° 0.094°
>>> reach_words(robot.expected), recording_words(robot)
('level only', '12 s, 600 readings, 12 s for each turn')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column, Table
from rich.text import Text

from flinders.core.durations import duration_text
from flinders.core.units import unit_label
from flinders.errors import count_text
from flinders.findings.words import UPSIDE_DOWN
from flinders.fitting.verdict import headline_of
from flinders.report.formatting import degrees
from flinders.report.terminal import facts, page, table, verdict, whole_columns
from flinders.simulate.turn_sequence import CIRCLE_DEG
from flinders.workflows.planned_fit import FIELD_STRENGTH, dip_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from flinders.workflows.planned_fit import ExpectedFit
    from flinders.workflows.planning import Alternative, Plan

AIDS: Final = {"dip": "accelerometer", "rate": "gyro"}
"""Words for aiding sensors, by name."""

SMALL_TILT_DEG: Final = 1.0
"""Tilt in degrees: if headings are within the target only below it, they count as good for a level body only."""

HIGH_RATIO: Final = 1.5
"""Ratio of the high claim to the expected claim from which the high claim is mentioned."""


def of_plan(plan: Plan, commands: Sequence[str]) -> RenderableType:
    """Lay out a plan; `commands` record and calibrate as planned."""
    expected = plan.expected
    title = f"EXPECTED {expected.fit.verdict.upper()}"
    said = verdict(title, expected.fit.verdict, headline_of(expected.fit).words, *basis_words(plan))
    return page(facts(plan_facts(plan)), _steps(plan.steps), _results(plan), said, _commands(commands))


def plan_facts(plan: Plan) -> list[tuple[str, str]]:
    """Names and values of the facts on which a plan is based."""
    recording = plan.recording
    sensors = "".join(f", {AIDS[aid]}" for aid in recording.aiding)
    return [
        ("body", f"{plan.body.name}: {plan.body.description}"),
        (
            "sensor",
            f"{recording.noise:.3g} {unit_label('uT')} of noise, {recording.rate_hz:g} readings a second{sensors}",
        ),
        ("field", field_words(plan)),
        ("time", recording_words(plan)),
    ]


def field_words(plan: Plan) -> str:
    """Words for the strength and dip of a plan's field."""
    site = plan.recording.site
    strength = FIELD_STRENGTH if site is None or site.strength is None else site.strength
    assumed = "" if site is not None and site.inclination_deg is not None else " (assumed)"
    return f"{strength:.3g} {unit_label('uT')}, dip {dip_of(site):.3g}°{assumed}"


def recording_words(plan: Plan) -> str:
    """Words for duration, number of readings, and time of one turn."""
    usual_s = CIRCLE_DEG / plan.body.turning_deg_s
    each = duration_text(usual_s * plan.seconds / plan.body.seconds(plan.sequence))
    return f"{duration_text(plan.seconds)}, {count_text(plan.readings, 'reading')}, {each} for each turn"


def basis_words(plan: Plan) -> list[str]:
    """Sentences below the verdict: information bound, scatter of the claims, effect of a tilt."""
    expected = plan.expected
    claim, information = expected.fit.claim, expected.information_error_deg
    words = []
    if not math.isnan(information):
        words.append(f"information bound of noise and prior: {degrees(information)} (rms)")
    if expected.high_error_deg > HIGH_RATIO * claim.heading_error_deg.worst:
        words.append(
            f"one recording in eight claims {degrees(expected.high_error_deg)} or more, as its noise seems to last"
        )
    if claim.attitude_limit_deg < SMALL_TILT_DEG:
        words.append(f"each degree of tilt adds {degrees(claim.per_degree_of_tilt)}")
    return words


def result_cells(expected: ExpectedFit | None) -> list[str]:
    """Cells of a result: expected heading error, rms and worst, its 95 % value, and the tilt within the target."""
    if expected is None:
        return ["no fit", "", "", ""]
    claim = expected.fit.claim
    error = claim.heading_error_deg
    return [degrees(error.rms), degrees(error.worst), degrees(claim.heading_bound_deg), reach_words(expected)]


def reach_words(expected: ExpectedFit) -> str:
    """Words for the tilt up to which headings are within the target."""
    claim = expected.fit.claim
    if not claim.heading_error_deg.worst <= claim.target_deg:
        return "none"
    limit_deg = claim.attitude_limit_deg
    if limit_deg >= UPSIDE_DOWN:
        return "any"
    return f"{limit_deg:.0f}°" if limit_deg >= SMALL_TILT_DEG else "level only"


def alternative_words(each: Alternative) -> str:
    """Name of an alternative in the table."""
    if each.name == "time":
        return "twice the time"
    return f"tilted by {each.tilt_deg:g}°" if each.name == "tilt" else f"+ {AIDS[each.name]}"


def result_rows(plan: Plan) -> list[list[str]]:
    """Rows of the table of results: the plan, then its alternatives."""
    rows = [["as planned", duration_text(plan.seconds), *result_cells(plan.expected)]]
    return rows + [
        [alternative_words(each), duration_text(each.seconds), *result_cells(each.expected)]
        for each in plan.alternatives
    ]


def result_headings(target_deg: float) -> list[str]:
    """Headings of the table of results."""
    return ["", "time", "heading error, rms", "worst", "95 %", f"within {target_deg:g}° to"]


def _steps(steps: Sequence[str]) -> RenderableType:
    """Lay out the numbered steps of the motion."""
    grid = Table.grid(Column(style="bold", no_wrap=True, justify="right"), Column(), padding=(0, 2))
    for number, words in enumerate(steps, 1):
        grid.add_row(str(number), Text(words))
    return grid


def _commands(commands: Sequence[str]) -> RenderableType:
    """Lay out commands in the order in which they are typed."""
    return Group(
        Text("record and calibrate", "bold"),
        *(Text(f"   {command}", no_wrap=True, overflow="ignore") for command in commands),
    )


def _results(plan: Plan) -> RenderableType:
    """Lay out the expected error as planned, and with more time, tilt or sensors."""
    first, *others = result_headings(plan.recording.target_deg)
    return Group(table([first, *whole_columns(others)], result_rows(plan)))
