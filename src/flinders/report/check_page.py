"""The check of a calibration on another recording, as a page for the terminal."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from flinders.core.language import TERMINAL_LANGUAGE, phrase
from flinders.errors import python_arguments
from flinders.report.comparison_pages import TITLES, page_of_comparison, page_of_partial_check
from flinders.report.phrases import date, degrees, duration, plain_number
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
    is_onboard = checked.known.provenance.name == ONBOARD_NAME
    name = phrase("check.onboard", ONBOARD_NAME) if is_onboard else phrase("check.known", "the calibration")
    return page_of_comparison(checked.comparison, spell, fresh=fresh, strengths=strengths, own=own, name=name)


def page_of_aged(aged: AgedCalibration) -> RenderableType:
    """Lay out the present heading error of an older calibration."""
    until, since = aged.until, aged.since
    walk = (
        phrase("aged.walk-of-unit", "by the walk of this unit")
        if until.by == "history"
        else phrase("aged.usual-walk", "by the usual walk of an offset")
    )
    low, high = map(degrees, aged.claim_range_deg)
    claims = phrase(
        "aged.claims", "{then} then, {now} now ({range})", then=degrees(until.claim_deg), now=degrees(aged.claim_deg),
        range=phrase("range", "{low} to {high}", low=low, high=high),
    )  # fmt: skip
    later = phrase("aged.later", "{date}, {time} later", date=date(aged.at), time=duration(aged.seconds))
    known = [
        (phrase("aged.made", "made"), date(since)),
        (phrase("aged.asked", "asked for"), later),
        (phrase("aged.claim", "claim"), claims),
        (phrase("aged.doubled", "doubled"), f"{date(until.doubled_date(since))}, {walk}"),
    ]
    if until.target_s is not None:
        reached = since + timedelta(seconds=round(until.target_s))
        known.insert(3, (phrase("aged.target", "target"), f"{date(reached)}, {walk}"))
    more = until.sentence(TERMINAL_LANGUAGE.get())
    title, words = _aged_words(aged)
    return page(facts(known), verdict(title, "good" if aged.answer == "holds" else "limited", words, more))


def _aged_words(aged: AgedCalibration) -> tuple[str, str]:
    """Title and words of the verdict on an aged calibration."""
    target = plain_number(aged.until.target_deg)
    holds, cannot_tell = (phrase(f"answer.check.{answer}", TITLES[answer][1]) for answer in ("holds", "cannot-tell"))
    if aged.answer == "holds":
        if aged.until.target_s is None:
            return holds, phrase("aged.not-doubled", "The claim has not doubled.")
        return holds, phrase("aged.below-target", "The claim has not reached the target of {target}°.", target=target)
    if aged.until.target_s is None:
        words = phrase("aged.has-doubled", "The claim has doubled: check it on a recording, or calibrate again.")
        return cannot_tell, words
    return cannot_tell, phrase(
        "aged.at-target",
        "The claim has reached the target of {target}°: check it on a recording, or calibrate again.",
        target=target,
    )
