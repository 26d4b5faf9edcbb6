"""Numbers, dates and findings on terminal pages, in the language of the terminal.

>>> degrees(0.0664), count(3000, "reading"), share(0.266, 1)
('0.066°', '3,000 readings', '26.6%')
>>> from flinders.core.language import TERMINAL_LANGUAGE, language_of
>>> token = TERMINAL_LANGUAGE.set(language_of("de"))
>>> degrees(0.0664), count(3000, "reading"), duration(1e6)
('0,066°', '3.000 Messungen', '12 Tage')
>>> TERMINAL_LANGUAGE.reset(token)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.durations import duration_text
from flinders.core.language import ENGLISH, TERMINAL_LANGUAGE, numeral, phrase
from flinders.findings import advice, translation
from flinders.report import formatting

if TYPE_CHECKING:
    from datetime import datetime

    from flinders.errors import Spelling
    from flinders.findings import Finding


def degrees(angle_deg: float) -> str:
    """Format an error angle as `flinders.report.formatting.degrees`."""
    return numeral(formatting.degrees(angle_deg))


def angle(degrees_off: float) -> str:
    """Format a difference of angles as `flinders.report.formatting.angle`."""
    return numeral(formatting.angle(degrees_off))


def p_value(value: float) -> str:
    """Format a p-value as `flinders.report.formatting.p_value`."""
    return numeral(formatting.p_value(value))


def plain_number(value: float, form: str = "g") -> str:
    """Format a number, by default without trailing zeros."""
    return numeral(format(value, form))


def share(value: float, decimals: int = 0) -> str:
    """Format a fraction as a percentage."""
    return numeral(f"{value:.{decimals}%}")


def count(number: float, thing: str) -> str:
    """A number of things."""
    return TERMINAL_LANGUAGE.get().count(number, thing)


def duration(seconds: float) -> str:
    """A duration in a suitable unit."""
    return duration_text(seconds, TERMINAL_LANGUAGE.get())


def date(when: datetime) -> str:
    """A date and time; by numbers in other languages than English, which have other names of months."""
    return formatting.date_of(when) if TERMINAL_LANGUAGE.get() == ENGLISH else f"{when:%Y-%m-%d, %H:%M %Z}"


def advice_of(finding: Finding, spell: Spelling) -> str:
    """Meaning and remedy of a finding; in English with the numbers of its sentence, and options by `spell`."""
    return translation.advice(finding, TERMINAL_LANGUAGE.get()) or advice(finding, spell)


def join_parts(*parts: str) -> str:
    """Join the parts of a line; empty parts are left out."""
    return phrase("list.separator", "; ").join(filter(None, parts))
