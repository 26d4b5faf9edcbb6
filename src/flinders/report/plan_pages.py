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

from flinders.core.language import TERMINAL_LANGUAGE, phrase
from flinders.findings.words import UPSIDE_DOWN
from flinders.fitting.verdict import headline_of
from flinders.report.phrases import count, degrees, duration, plain_number
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
"""Smallest tilt limit in degrees that is printed; with a smaller limit, headings are good for a level body only."""

HIGH_RATIO: Final = 1.5
"""Ratio of the high claim to the expected claim from which the high claim is mentioned."""


def of_plan(plan: Plan, commands: Sequence[str]) -> RenderableType:
    """Lay out a plan; `commands` record and calibrate as planned."""
    expected = plan.expected
    language, quality = TERMINAL_LANGUAGE.get(), expected.fit.verdict
    said = language.phrase(f"verdict.{quality}", quality)
    title = language.capitals(language.phrase("plan.expected", "expected {verdict}", verdict=said))
    words = headline_of(expected.fit, language=language).words
    steps = [step.words(language) for step in plan.body.coded_steps(plan.sequence)]
    found = verdict(title, quality, words, *basis_words(plan))
    return page(facts(plan_facts(plan)), _steps(steps), _results(plan), found, _commands(commands))


def plan_facts(plan: Plan) -> list[tuple[str, str]]:
    """Names and values of the facts on which a plan is based."""
    recording = plan.recording
    sensors = "".join(f", {_aid(aid)}" for aid in recording.aiding)
    body = f"{plan.body.name}: {phrase(f'plan.for.{plan.body.name}', plan.body.description)}"
    sensor = phrase(
        "plan.sensor", "{noise} µT of noise, {rate} readings a second{sensors}",
        noise=plain_number(recording.noise, ".3g"), rate=plain_number(recording.rate_hz), sensors=sensors,
    )  # fmt: skip
    return [
        (phrase("plan.body", "body"), body),
        (phrase("plan.fact.sensor", "sensor"), sensor),
        (phrase("plan.fact.field", "field"), field_words(plan)),
        (phrase("plan.fact.time", "time"), recording_words(plan)),
    ]


def _aid(aid: str) -> str:
    """Words for an aiding sensor."""
    return phrase(f"plan.aid.{aid}", AIDS[aid])


def field_words(plan: Plan) -> str:
    """Words for the strength and dip of a plan's field."""
    site = plan.recording.site
    strength = FIELD_STRENGTH if site is None or site.strength is None else site.strength
    shown, dip = plain_number(strength, ".3g"), plain_number(dip_of(site), ".3g")
    if site is not None and site.inclination_deg is not None:
        return phrase("plan.field", "{strength} µT, dip {dip}°", strength=shown, dip=dip)
    return phrase("plan.field-assumed", "{strength} µT, dip {dip}° (assumed)", strength=shown, dip=dip)


def recording_words(plan: Plan) -> str:
    """Words for duration, number of readings, and time of one turn."""
    usual_s = CIRCLE_DEG / plan.body.turning_deg_s
    each = duration(usual_s * plan.seconds / plan.body.seconds(plan.sequence))
    return phrase(
        "plan.recording", "{time}, {readings}, {each} for each turn",
        time=duration(plan.seconds), readings=count(plan.readings, "reading"), each=each,
    )  # fmt: skip


def basis_words(plan: Plan) -> list[str]:
    """Sentences below the verdict: information bound, scatter of the claims, effect of a tilt."""
    expected = plan.expected
    claim, information = expected.fit.claim, expected.information_error_deg
    words = []
    if not math.isnan(information):
        words.append(
            phrase(
                "plan.information", "information bound of noise and prior: {error} (rms)", error=degrees(information)
            )
        )
    if expected.high_error_deg > HIGH_RATIO * claim.heading_error_deg.worst:
        words.append(
            phrase(
                "plan.high-claim", "one recording in eight claims {error} or more, as its noise seems to last",
                error=degrees(expected.high_error_deg),
            )
        )  # fmt: skip
    if claim.attitude_limit_deg < SMALL_TILT_DEG:
        words.append(
            phrase("plan.per-tilt", "each degree of tilt adds {error}", error=degrees(claim.per_degree_of_tilt))
        )
    return words


def result_cells(expected: ExpectedFit | None) -> list[str]:
    """Cells of a result: expected heading error, rms and worst, its 95 % value, and the tilt within the target."""
    if expected is None:
        return [phrase("plan.no-fit", "no fit"), "", "", ""]
    claim = expected.fit.claim
    error = claim.heading_error_deg
    return [degrees(error.rms), degrees(error.worst), degrees(claim.heading_bound_deg), reach_words(expected)]


def reach_words(expected: ExpectedFit) -> str:
    """Words for the tilt up to which headings are within the target."""
    claim = expected.fit.claim
    if not claim.heading_error_deg.worst <= claim.target_deg:
        return phrase("numbers.none", "none")
    limit_deg = claim.attitude_limit_deg
    if limit_deg >= UPSIDE_DOWN:
        return phrase("numbers.any", "any")
    return f"{limit_deg:.0f}°" if limit_deg >= SMALL_TILT_DEG else phrase("plan.level-only", "level only")


def alternative_words(each: Alternative) -> str:
    """Name of an alternative in the table."""
    if each.name == "time":
        return phrase("plan.twice", "twice the time")
    if each.name == "tilt":
        return phrase("plan.tilted", "tilted by {tilt}°", tilt=plain_number(each.tilt_deg))
    return f"+ {_aid(each.name)}"


def result_rows(plan: Plan) -> list[list[str]]:
    """Rows of the table of results: the plan, then its alternatives."""
    rows = [[phrase("plan.as-planned", "as planned"), duration(plan.seconds), *result_cells(plan.expected)]]
    return rows + [
        [alternative_words(each), duration(each.seconds), *result_cells(each.expected)] for each in plan.alternatives
    ]


def result_headings(target_deg: float) -> list[str]:
    """Headings of the table of results."""
    return [
        "",
        phrase("plan.fact.time", "time"),
        phrase("errors.rms", "heading error, rms"),
        phrase("errors.worst", "worst"),
        phrase("plan.bound", "95 %"),
        phrase("plan.within", "within {target}° to", target=plain_number(target_deg)),
    ]


def _steps(steps: Sequence[str]) -> RenderableType:
    """Lay out the numbered steps of the motion."""
    grid = Table.grid(Column(style="bold", no_wrap=True, justify="right"), Column(), padding=(0, 2))
    for number, words in enumerate(steps, 1):
        grid.add_row(str(number), Text(words))
    return grid


def _commands(commands: Sequence[str]) -> RenderableType:
    """Lay out commands in the order in which they are typed."""
    return Group(
        Text(phrase("plan.commands", "record and calibrate"), "bold"),
        *(Text(f"   {command}", no_wrap=True, overflow="ignore") for command in commands),
    )


def _results(plan: Plan) -> RenderableType:
    """Lay out the expected error as planned, and with more time, tilt or sensors."""
    first, *others = result_headings(plan.recording.target_deg)
    return Group(table([Column(first, overflow="fold"), *whole_columns(others)], result_rows(plan)))
