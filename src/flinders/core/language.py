"""Translation of sentences; the English sentences are in the code that makes them.

A language is one file of `flinders/languages`: formats by key, with the same placeholders as the English ones. A key
that a language lacks stays English. The live page is translated, and in the terminal the pages of a calibration, of a
check and of a plan; JSON, files, codes and all else are English in every language.

>>> german = language_of("de")
>>> german.phrase("verdict.good", "Good"), german.numeral("1,234.5")
('Gut', '1.234,5')
>>> german.phrase("no.such.key", "from {name}", name="A17"), ENGLISH.phrase("verdict.good", "Good")
('from A17', 'Good')
>>> phrase("verdict.good", "Good")                      # in the language of the terminal, which is English unless set
'Good'
"""

from __future__ import annotations

import json
import unicodedata
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import TYPE_CHECKING, Any, Final

from flinders.errors import UsageError, count_text, figures

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ENGLISH_CODE: Final = "en"

LANGUAGES: Final = (ENGLISH_CODE, "de", "el")
"""Codes of the languages; `languages/en.json` lists all English phrases for translators, and no program reads it."""

SIGNS: Final = {"decimal": ".", "group": ",", "percent": "%"}
"""Signs in English numbers, by the names in keys of other languages."""


@dataclass(frozen=True, slots=True)
class Language:
    """A language, with its translations by key."""

    code: str  #: code of ISO 639-1, such as ``de``
    words: Mapping[str, str] = field(default_factory=dict, repr=False)  #: translations by key; empty for English

    def translation(self, key: str) -> str:
        """Translation of a key, with placeholders; empty in English, and for a key without a translation."""
        return self.words.get(key, "")

    def phrase(self, key: str, english: str, **values: object) -> str:
        """Translate a sentence and fill in its values; `english` is used if the key has no translation."""
        return self.fill(self.translation(key) or english, values)

    def count(self, number: float, thing: str) -> str:
        """Write a count with its noun, such as ``3,000 readings``; in English if the noun has no translation."""
        form = self.translation(f"things.{thing}.{'one' if number == 1 else 'other'}")
        return self.fill(form, {"count": self.numeral(f"{number:,.0f}")}) if form else count_text(number, thing)

    def fill(self, template: str, values: Mapping[str, Any]) -> str:
        """Fill values into a template; numbers have two digits unless the template states a format."""
        return _NumeralFormatter(self).vformat(template, (), values)

    def capitals(self, text: str) -> str:
        """Write a title in capitals; Greek capitals have no accents."""
        if self.code == "el":
            text = unicodedata.normalize("NFD", text).replace("\N{COMBINING ACUTE ACCENT}", "")
        return unicodedata.normalize("NFC", text).upper()

    def numeral(self, text: str) -> str:
        """Write an English number, ``1,234.5`` or ``95%``, with the signs of the language."""
        signs = {sign: self.translation(f"number.{name}") or sign for name, sign in SIGNS.items()}
        return "".join(signs.get(letter, letter) for letter in text)


class _NumeralFormatter(Formatter):
    """Formatter that writes numbers with the separators of a language."""

    def __init__(self, language: Language) -> None:
        self.language = language

    def format_field(self, value: Any, format_spec: str) -> str:  # noqa: ANN401 - as `string.Formatter` has it
        """Format one value; text stays as it is."""
        if isinstance(value, str):
            return value
        return self.language.numeral(format(value, format_spec) if format_spec else figures(float(value)))


ENGLISH: Final = Language(ENGLISH_CODE)

TERMINAL_LANGUAGE: Final[ContextVar[Language]] = ContextVar("language of the terminal", default=ENGLISH)
"""Language of the terminal, which the command line sets; pages and the command line's own words are in it."""


def phrase(key: str, english: str, **values: object) -> str:
    """A sentence in the language of the terminal, with its values filled in."""
    return TERMINAL_LANGUAGE.get().phrase(key, english, **values)


def numeral(text: str) -> str:
    """An English number with the signs of the language of the terminal."""
    return TERMINAL_LANGUAGE.get().numeral(text)


@contextmanager
def in_english() -> Iterator[None]:
    """Make something that stays English in every language, such as a file; also a decorator, as ``@in_english()``."""
    token = TERMINAL_LANGUAGE.set(ENGLISH)
    try:
        yield
    finally:
        TERMINAL_LANGUAGE.reset(token)


@cache
def language_of(code: str) -> Language:
    """A language by its code.

    Raises
    ------
    UsageError
        For a language that is not in `LANGUAGES`.
    """
    if code not in LANGUAGES:
        raise UsageError(f"there is no language {code!r}: use one of {', '.join(LANGUAGES)}")
    return ENGLISH if code == ENGLISH_CODE else Language(code, json.loads(text_of(code)))


def text_of(code: str) -> str:
    """Text of the file of a language."""
    return files("flinders").joinpath("languages", f"{code}.json").read_text(encoding="utf-8")
