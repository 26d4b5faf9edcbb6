"""Plain words and remedies of findings in other languages; the rows of the catalogue are the English ones.

>>> from flinders.core.language import language_of
>>> from flinders.findings.finding import Finding
>>> gap = Finding("coverage", "limits", {"hole_deg": 74.0, "next_movement": ("record-longer",)})
>>> plain_words(gap, language_of("de"))
'Einige Richtungen liegen 74° von der nächsten Messung entfernt. Wie gut Kurse dort sind, ist nicht bekannt.'
"""

from __future__ import annotations

import re
from string import Formatter
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import figures
from flinders.findings.poses import POSE_WORDS
from flinders.findings.row import CONDITIONS, VERIFICATIONS
from flinders.findings.words import ANY_ANGLE_DEG, STEPS, WHY_LARGE, as_sentence

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flinders.core.language import Language
    from flinders.findings.finding import Finding
    from flinders.findings.row import Condition

POSES: Final = {
    "side": "with its {one} side down",
    "edge": "with the edge between its {one} and {two} sides down",
    "lowered": "with its {one} side down and its {two} side lowered by 30°",
    "corner": "with the corner of its {one}, {two} and {three} sides down",
}
"""English words for attitudes of a sensor, as `flinders.findings.poses` makes them; `verdict_words.js` has the same."""

_PATTERNS: Final = {
    name: re.compile(re.sub(r"\\\{(\w+)\\\}", r"(?P<\1>\\S+?)", re.escape(english))) for name, english in POSES.items()
}


def plain_words(finding: Finding, language: Language) -> str:
    """Meaning of a finding for the user of the compass; English if the language lacks it."""
    return _filled(finding, "plain", language) or finding.plain_words


def is_known(finding: Finding, language: Language) -> bool:
    """Whether the language has the meaning of a finding."""
    return bool(_filled(finding, "plain", language))


def sentence(finding: Finding, language: Language) -> str:
    """The first sentence of `plain_words`."""
    return plain_words(finding, language).partition(". ")[0]


def remedy(finding: Finding, language: Language) -> str:
    """Remedy for the user, as a sentence; empty without one."""
    words = _filled(finding, "remedy", language)
    return as_sentence(words) if words else finding.remedy


def advice(finding: Finding, language: Language) -> str:
    """Meaning and remedy of a finding; empty if the language lacks them."""
    words = _filled(finding, "plain", language)
    return " ".join(filter(None, (as_sentence(words), remedy(finding, language)))) if words else ""


def angle(degrees: float, language: Language) -> str:
    """An error in degrees; more than 90° counts as any angle."""
    if degrees < ANY_ANGLE_DEG:
        return f"{language.numeral(figures(degrees))}°"
    return language.phrase("error.any-angle", "any angle")


def assumptions(conditions: Sequence[Condition], language: Language) -> str:
    """Assumptions of a verdict with a way to verify the first; empty without any, or without a translation."""
    if not conditions or not language.translation("condition.holds"):
        return ""
    parts = [language.phrase(f"condition.{code}", CONDITIONS[code]) for code in conditions]
    listed = f" {language.translation('list.and')} ".join(filter(None, (", ".join(parts[:-1]), parts[-1])))
    holds = language.phrase("condition.holds", "holds if {conditions}", conditions=listed)
    return f"{holds}: {language.phrase(f'verification.{conditions[0]}', VERIFICATIONS[conditions[0]])}"


def _filled(finding: Finding, part: str, language: Language) -> str:
    """Translated sentence of a finding, filled with its values; empty if there is none or a value is missing."""
    template = language.translation(f"findings.{finding.code}.{part}")
    if not template:
        return ""
    named = {name for _, name, _, _ in Formatter().parse(template) if name}
    try:
        return language.fill(template, {name: _value(name, finding, language) for name in named})
    except LookupError:
        return ""


def _value(name: str, finding: Finding, language: Language) -> Any:  # noqa: ANN401 - a number or a word
    """Value of a placeholder in a sentence: a number or a word.

    Raises
    ------
    LookupError
        If the finding lacks it.
    """
    if name in WORDS:
        return WORDS[name](finding.values, language)
    stated: dict[str, Callable[[], Any]] = {
        "number": lambda: finding.number,
        "limit": lambda: finding.limit,
        "angle": lambda: angle(finding.number, language),
        "seconds": lambda: language.numeral(figures(finding.number)),
    }
    return stated[name]() if name in stated else finding.values[name]


def _step(step: Sequence[Any], language: Language) -> str:
    """Words for a step: a key of `STEPS`, followed by the number of a pose for ``hold``."""
    name, *poses = step
    pose = "".join(_pose(POSE_WORDS["sensor"][round(pose)], language) for pose in poses)
    return language.phrase(f"step.{name}", STEPS[name].replace("{}", "{pose}"), pose=pose)


def _pose(english: str, language: Language) -> str:
    """Words for an attitude of the sensor."""
    for name, pattern in _PATTERNS.items():
        if found := pattern.fullmatch(english):
            return language.phrase(f"pose.{name}", POSES[name], **found.groupdict())
    return english


def _why_large(values: Mapping[str, Any], language: Language) -> str:
    """Reason for a large heading error."""
    name = values.get("repeated_step", values["next_step"])[0]
    return language.phrase(f"why-large.{name}", WHY_LARGE[name])


def _length(values: Mapping[str, Any], language: Language) -> str:
    """Field strength of corrected readings, in words."""
    return f"{language.numeral(figures(values['corrected_length'], 4))} {values['unit']}"


WORDS: Final[Mapping[str, Callable[[Mapping[str, Any], Language], str]]] = {
    "movement": lambda values, language: _step(values["next_movement"], language),
    "remedy": lambda values, language: _step(values["next_step"], language),
    "why_large": _why_large,
    "length": _length,
}
"""Words of plain sentences made from values, as in `flinders.findings.words`."""
