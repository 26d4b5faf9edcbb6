"""The check of a calibration on another recording, as a page for the terminal."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from flinders.core.durations import duration_text
from flinders.errors import python_arguments
from flinders.report.comparison_pages import page_of_comparison, page_of_partial_check
from flinders.report.formatting import date_of, degrees
from flinders.report.terminal import facts, page, verdict
from flinders.workflows.onboard import ONBOARD_NAME

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.errors import Spelling
    from flinders.workflows.aging import AgedCalibration
    from flinders.workflows.checking import Check


def page_of_check(checked: Check, spell: Spelling = python_arguments) -> RenderableType:
    """Lay out a check: the comparison, or the partial evidence of a recording without a usable fit."""
    if checked.comparison is None or checked.fresh_strength is None:
        return page_of_partial_check(checked.known, checked.fresh, checked.strength, spell)
    strengths = checked.strength, checked.fresh_strength
    own, fresh = checked.made_from, checked.fresh
    name = ONBOARD_NAME if checked.known.provenance.name == ONBOARD_NAME else "the calibration"
    return page_of_comparison(checked.comparison, spell, fresh=fresh, strengths=strengths, own=own, name=name)


def page_of_aged(aged: AgedCalibration) -> RenderableType:
    """Lay out the present heading error of an older calibration."""
    until, ends = aged.until, " to ".join(map(degrees, aged.claim_range_deg))
    walk = "by the walk of this unit" if until.by == "history" else "by the usual walk of an offset"
    known = [
        ("made", date_of(aged.since)),
        ("asked for", f"{date_of(aged.at)}, {duration_text(aged.seconds)} later"),
        ("claim", f"{degrees(until.claim_deg)} then, {degrees(aged.claim_deg)} now ({ends})"),
        ("doubled", f"{date_of(until.doubled_date(aged.since))}, {walk}"),
    ]
    is_beyond = until.target_s is None
    limit = "doubled" if is_beyond else f"reached the target of {until.target_deg:g}°"
    if until.target_s is not None:
        known.insert(3, ("target", f"{date_of(aged.since + timedelta(seconds=round(until.target_s)))}, {walk}"))
    if aged.answer == "holds":
        said = verdict("HOLDS", "good", f"The claim has not {limit}.", str(until))
    else:
        words = f"The claim has {limit}: check it on a recording, or calibrate again."
        said = verdict("CANNOT TELL", "limited", words, str(until))
    return page(facts(known), said)
