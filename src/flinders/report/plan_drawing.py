"""A planned recording as a drawing and as an HTML file: the path of the field over the sphere of directions.

Colours show the expected heading error in each direction. Dots are the directions that the motion meets; directions
without a reading are hatched.

>>> from flinders.workflows.planning import plan
>>> planned = plan("robot", noise="0.5 uT", alternatives=False)
>>> drawing_of(planned).startswith("<svg"), page_of(planned, []).startswith("<!doctype html>")
(True, True)
"""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from flinders.core.durations import duration_text
from flinders.core.language import in_english
from flinders.fitting.verdict import headline_of
from flinders.report.charts import as_file, row_of_charts, text, thin_out
from flinders.report.formatting import date_of, degrees
from flinders.report.html_file import html_file, script_of, style_of
from flinders.report.maps import MAP_HIGH, MAP_WIDE, error_legend, legend_row, page_tile_rules, path_map, tile_rules
from flinders.report.plan_pages import basis_words, plan_facts, reach_words, result_headings, result_rows
from flinders.report.view import view_alone
from flinders.verdicts import MEANINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.workflows.planning import Plan

MAX_DOTS: Final = 800
"""Largest number of dots of the path."""


@in_english()
def drawing_of(plan: Plan) -> str:
    """The path over the sphere of directions, as an SVG file."""
    title = (
        f"{plan.body.name}: {duration_text(plan.seconds)}, {degrees(plan.expected.fit.claim.heading_error_deg.worst)}"
    )
    head = text(MAP_WIDE / 2.0, 16, f"{title} at the worst heading", kind="name")
    target = plan.recording.target_deg
    legend = legend_row(MAP_WIDE, MAP_HIGH + 40.0, target, "error to expect; dots: path")
    words = "Expected heading error, and the path of the motion"
    figure = (_map(plan), float(MAP_WIDE), float(MAP_HIGH))
    return as_file(row_of_charts(words, [figure], head, legend, top=22.0, foot=26.0), tile_rules())


@in_english()
def page_of(plan: Plan, commands: Sequence[str]) -> str:
    """A plan as one HTML file; `commands` record and calibrate as planned."""
    expected = plan.expected
    claim = expected.fit.claim
    error = claim.heading_error_deg
    given = {
        "plan": plan,
        "outcome": {
            "verdict": expected.fit.verdict,
            "title": f"Expected {MEANINGS[expected.fit.verdict].title.lower()}",
            "sentence": headline_of(expected.fit).words,
        },
        "numbers": [
            ("Heading error", degrees(error.worst), f"at the worst heading, {degrees(error.rms)} rms"),
            ("95 % within", degrees(claim.heading_bound_deg), "at all headings"),
            ("Within target to", reach_words(expected), "of tilt"),
            ("Time", duration_text(plan.seconds), f"{plan.readings:,} readings"),
        ],
        "facts": plan_facts(plan),
        "basis": basis_words(plan),
        "headings": result_headings(plan.recording.target_deg),
        "rows": result_rows(plan),
        "figure": _map(plan),
        "legend": error_legend(plan.recording.target_deg),
        "commands": commands,
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    return html_file("plan.html.j2", given, style=style_of() + page_tile_rules(), script=script_of(), filters={})


def _map(plan: Plan) -> str:
    """The map of expected errors with the path of the motion."""
    directions = thin_out(plan.expected.simulated.directions, MAX_DOTS)
    return path_map(view_alone(plan.expected.fit), plan.recording.target_deg, directions)
