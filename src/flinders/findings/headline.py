"""The first sentence of a verdict: for a limited calibration its limit, the reason, and the remedy.

>>> from flinders.findings.finding import Finding
>>> gap = Finding("coverage", "limits", {"hole_deg": 74.0})
>>> headline("limited", gap, Claimed(0.57, 1.4, 1.0), 17.0).words[:75]
'Good up to 17° of tilt: 0.57° (95 % within 1.4°). Above the target beyond: '
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.language import ENGLISH
from flinders.errors import figures
from flinders.findings import translation
from flinders.findings.catalogue import CATALOGUE
from flinders.findings.words import ANY_ANGLE_DEG, UPSIDE_DOWN, as_sentence

if TYPE_CHECKING:
    from flinders.core.language import Language
    from flinders.findings.finding import Finding
    from flinders.verdicts import Verdict

LEADS: Final = {
    "good": "Headings are good to {error} {reach}; the target is {target}",
    "error": "Headings may be off by {error}, above the target of {target}: {why}",
    "attitudes": "Good {reach}: {error}. {beyond}: {why}",
    "directions": "Good in the directions that were recorded: {error}. Not verified in the others: {why}",
    "claim": "Headings may be off by more than {error}: {why}",
    "use": "Headings are good to {error} {reach}, with one reservation: {why}",
    "unknown": "How good headings are is not known: {why}",
    "refused": "Not fit for use: {why}",
    "refused-unknown": "Not fit for use. Headings may be off by any angle: {why}",
    "refused-error": "Not fit for use. Headings may be off by {error}, above the target of {target}: {why}",
}
"""First sentence of a verdict, by the aspect that its first cause affects; `why` is that cause. The remedy follows."""

REACHES: Final = (
    (1.0, "while level", "Not known when tilted"),
    (UPSIDE_DOWN, "up to {limit:.0f}° of tilt", "Above the target beyond"),
    (math.inf, "at any attitude", ""),
)
"""Ranges of tilt for which headings are good: upper end in degrees, words for the range, words for tilts beyond."""

REACH_NAMES: Final = ("level", "tilt", "any")
"""Names of the ranges in `REACHES`, as keys in files of other languages."""

SMALL_ERROR_DEG: Final = 0.2
"""Heading error in degrees below which the headline of a good verdict ends with `CAVEAT`."""

UNSTATED_REASON: Final = "the calibration states no uncertainty"
"""Reason for a calibration without findings, such as an imported one."""

CAVEAT: Final = "That is the error of the calibration alone: mounting, tilt and iron nearby come on top."


class Headline(NamedTuple):
    """The first sentence of a verdict, and the code of its finding."""

    words: str
    code: str  #: empty for a good verdict


class Claimed(NamedTuple):
    """The heading error that a fit claims, for its headline."""

    worst_deg: float  #: worst heading error, 1 σ; NaN if not stated
    bound_deg: float  #: 95 % bound
    target_deg: float


NO_CLAIM: Final = Claimed(math.nan, math.nan, math.nan)


def headline(
    verdict: Verdict, cause: Finding | None, claimed: Claimed, limit_deg: float, language: Language = ENGLISH
) -> Headline:
    """Make the first sentence of a verdict.

    Parameters
    ----------
    cause : Finding or None
        The first cause (`flinders.findings.first_causes`), which a good verdict ignores. None for a calibration without
        findings, such as an imported one.
    limit_deg : float
        Tilt in degrees up to which headings are within the target.
    language : Language
        English by default, as in JSON and in files.
    """
    cause = None if verdict == "good" else cause
    if cause is not None and not translation.is_known(cause, language):
        language = ENGLISH
    kind = _kind(verdict, cause, claimed)
    if kind == "attitudes" and limit_deg >= UPSIDE_DOWN:
        kind = "directions"
    reach, beyond = reach_words(limit_deg, language)
    why, remedy = _why(cause, language), "" if cause is None else translation.remedy(cause, language)
    lead = (language.translation(f"lead.{kind}") or LEADS[kind]).format(
        error=error_words(claimed, language),
        target=f"{language.numeral(f'{claimed.target_deg:g}')}°",
        reach=reach,
        beyond=beyond,
        why=why,
    )
    is_small = kind == "good" and claimed.worst_deg < SMALL_ERROR_DEG
    said = (as_sentence(lead), remedy, language.phrase("verdict.left-out", CAVEAT) if is_small else "")
    return Headline(" ".join(filter(None, said)), "" if cause is None else cause.code)


def _why(cause: Finding | None, language: Language) -> str:
    """The cause as a clause: in English with a small first letter, in other languages as it is written."""
    if cause is None:
        return language.phrase("verdict.unstated", UNSTATED_REASON)
    why = translation.sentence(cause, language)
    return f"{why[:1].lower()}{why[1:]}" if language == ENGLISH else why


def _kind(verdict: Verdict, cause: Finding | None, claimed: Claimed) -> str:
    """Key of `LEADS` for a verdict."""
    if cause is None:
        return "good" if claimed.worst_deg < ANY_ANGLE_DEG else "unknown"
    row = CATALOGUE.get(cause.code)
    affects = "claim" if row is None else row.affects
    if verdict == "refused":
        return _refused_kind(affects, claimed)
    if not claimed.worst_deg < ANY_ANGLE_DEG:
        return "unknown"
    is_above = claimed.worst_deg > claimed.target_deg
    if affects == "error" or is_above:
        return "error" if is_above and affects != "claim" else "claim"
    return affects


def _refused_kind(affects: str, claimed: Claimed) -> str:
    """Key of `LEADS` for a refused fit."""
    if affects != "error":
        return "refused"
    return "refused-error" if claimed.worst_deg < ANY_ANGLE_DEG else "refused-unknown"


def error_words(claimed: Claimed, language: Language = ENGLISH) -> str:
    """The worst heading error, 1 σ, and its bound; with enough digits to differ from the target.

    >>> error_words(Claimed(0.32, 0.71, 1.0)), error_words(Claimed(1.013, 2.5, 1.0))
    ('0.32° (95 % within 0.71°)', '1.01° (95 % within 2.5°)')
    """
    worst_deg, bound_deg, target_deg = claimed
    if not worst_deg < ANY_ANGLE_DEG:
        return translation.angle(worst_deg, language)
    digits = next((n for n in (2, 3, 4) if figures(worst_deg, n) != figures(target_deg, n)), 2)
    is_bounded = bound_deg < ANY_ANGLE_DEG
    words = language.phrase("error.bound", "95 % within {bound}°", bound=language.numeral(figures(bound_deg)))
    return f"{language.numeral(figures(worst_deg, digits))}° ({words if is_bounded else '1 σ'})"


def reach_words(limit_deg: float, language: Language = ENGLISH) -> tuple[str, str]:
    """Words for attitudes within the target, and for the others; if the tilt is NaN, for level attitudes only."""
    place = next((place for place, row in enumerate(REACHES) if limit_deg < row[0]), 0)
    _, reach, beyond = REACHES[place]
    name = REACH_NAMES[place]
    said = language.translation(f"reach.{name}") or reach
    return said.format(limit=limit_deg), language.phrase(f"beyond.{name}", beyond) if beyond else ""
