"""Sentences on a unit that fails: reason and remedy.

>>> from flinders.apps.live.station.limits import Miss
>>> from flinders.errors import TooFewSamples
>>> miss_words(Miss("offset-x", -71.2, (-60.0, 60.0)), None)[0]
'The offset of x is −71.2. The limits are −60 and 60.'
>>> miss_words(Miss("too-few-samples"), TooFewSamples(found=5, needed=10, method="likelihood"))[0]
'The number of usable readings is 5, and at least 10 are needed.'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.units import unit_label
from flinders.errors import FlindersError, figures
from flinders.findings.words import as_sentence
from flinders.fitting.result import Fit
from flinders.report.formatting import minus
from flinders.report.plain import error_words

if TYPE_CHECKING:
    from flinders.apps.live.station.limits import Miss

REPEAT: Final = "Test the unit again."


class LimitWords(NamedTuple):
    """Name, remedy and unit of a limit, for sentences."""

    name: str
    remedy: str
    unit: str = ""  # unit if it is not that of the field


LIMITS: Final = {
    "heading-error": LimitWords("heading error", "Turn it through more directions, away from iron.", "°"),
    "strength": LimitWords("field strength", "Check the sensor's scale, and remove iron near the station."),
    **{
        f"offset-{axis}": LimitWords(f"offset of {axis}", "Check the unit for magnetised parts, and demagnetise them.")
        for axis in "xyz"
    },
    "noise": LimitWords("noise", "Keep phones, tools and cables away, and test it again; else replace the sensor."),
    "coverage-share": LimitWords("share of directions", "Make all turns, each to its end."),
}
"""Name and remedy of each limit of a station's plan, by its code."""

EVENTS: Final = {
    "sensor-gone": ("The sensor was lost during the test.", f"Check its cable. {REPEAT}"),
    "no-readings": ("No readings came from the unit.", f"Check that it is on and connected. {REPEAT}"),
    "interrupted": ("The station stopped in the middle of the unit.", REPEAT),
    "aborted": ("The test was stopped.", REPEAT),
    "fault": ("The test failed by a fault of the program.", f"Please report it. {REPEAT}"),
    "not-recorded": ("The recording could not be written.", f"Make room on the disk. {REPEAT}"),
    "not-exported": ("The calibration cannot be written for its target.", "Ask whoever wrote the station's file."),
    "unstated": ("The calibration has no verdict.", "Calibrate the unit by a recording."),
    "other-unit": (
        "The readings are in another unit than the limits.",
        "Ask whoever wrote the station's file to state the unit of limits and readings.",
    ),
}
"""Reason and remedy of tests that ended without a result, by code."""


def miss_words(miss: Miss, outcome: Fit | FlindersError | None) -> tuple[str, str]:
    """Reason and remedy of a miss; `outcome` is the fit, or the error if there is none."""
    fit = outcome if isinstance(outcome, Fit) else getattr(outcome, "fit", None)
    if miss.code in LIMITS and miss.needed is not None:
        unit = unit_label(fit.calibration.unit) if fit else ""
        return _outside(miss, miss.needed, LIMITS[miss.code], unit), LIMITS[miss.code].remedy
    if miss.code in EVENTS:
        return EVENTS[miss.code]
    finding = next((each for each in fit.findings if each.code == miss.code), None) if fit else None
    if fit and finding:
        words, remedy = finding.plain_words, finding.remedy
    elif isinstance(outcome, FlindersError):
        words, remedy = error_words(outcome)
    else:
        words, remedy = "No calibration could be made.", ""
    return as_sentence(words), as_sentence(remedy) if remedy else REPEAT


def _outside(miss: Miss, needed: tuple[float, float], words: LimitWords, unit: str) -> str:
    """Sentence on a number outside its limits."""
    unit = words.unit or (f" {unit}" if unit else "")
    if miss.found is None:
        return f"The {words.name} is not known."
    if miss.code == "coverage-share":
        return f"{miss.found:.0%} of all directions are covered, and {needed[0]:.0%} are needed."
    low, high = (minus(f"{end:g}") for end in needed)
    limits = f"The limit is {high}{unit}." if needed[0] == 0.0 else f"The limits are {low} and {high}{unit}."
    return f"The {words.name} is {_number(miss.found)}{unit}. {limits}"


def _number(value: float) -> str:
    return minus(figures(value, 3)) if abs(value) >= 10.0 else minus(figures(value))


def numbers_of(fit: Fit) -> list[tuple[str, str]]:
    """Names and texts of the numbers that the page shows."""
    unit = unit_label(fit.calibration.unit)
    offset = ", ".join(_number(value) for value in fit.calibration.offset.tolist())
    return [
        ("Heading error", f"{_number(fit.heading_error_deg.worst)}°"),
        ("Noise", f"{_number(fit.evidence.noise)} {unit}"),
        ("Strength", f"{_number(fit.calibration.field_strength)} {unit}"),
        ("Offset", f"{offset} {unit}"),
    ]
