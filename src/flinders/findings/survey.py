"""Calibrations of survey instruments."""

from __future__ import annotations

from typing import Final

from flinders.findings.row import CatalogueRow, Grade, Limit, Rule

ROWS: Final = (
    CatalogueRow(
        code="pointing-error",
        subject="survey",
        grades="limits; refuses above five times the target",
        number="error to expect of [azimuth or inclination](survey.md) in the worst pose, degrees, 1 σ",
        limit="the target (`target_deg`, `--target`)",
        action="shoot the directions that the page names, with four rolls each",
        rule=Rule("pointing_deg", (Grade("limits", 1.0, "target_deg"), Grade("refuses", 5.0, "target_deg"))),
        said=(
            "azimuth may be off by {azimuth_deg:angle} and inclination by {inclination_deg:angle} (1 σ, worst pose; "
            "the target is {target_deg:g}°): {remedy}"
        ),
        plain="At worst the instrument may be off by {angle}, and {limit:g}° is the target.",
        remedy="Take more shots, in other directions, with four rolls each.",
    ),
    CatalogueRow(
        code="shots-contradict",
        subject="survey",
        grades="note; limits for more than a tenth of the shots",
        number="share of [shots](survey.md) that contradict the others and were left out",
        limit="0",
        action="repeat those shots",
        rule=Rule("contradicting", (Grade("note", 0.0), Grade("limits", 0.1)), limit=Limit(0.0)),
        said=(
            "left out, as they contradict the others: {shots}. The instrument was moved or aimed elsewhere, or iron "
            "was near: repeat them"
        ),
        plain="Some shots contradict the others and were left out.",
        remedy="Repeat those shots, away from iron.",
    ),
)
