"""Hexadecimal words without ``0x``, as registers are printed: ``Mag: 0165 fe58 01a5``.

Words of 4, 6 or 8 digits are signed numbers of as many bits. Letters in some of the lines tell them from decimal ones.

>>> from flinders.readers.dialects import recognise as of_any
>>> dialect = of_any(["Mag: 0165 fe58 01a5", "Mag: 0160 0058 01a4"])
>>> dialect.words, dialect.row("Mag: 0010 fffe 0020")
('hexadecimal words in labelled lines', ['16', '-2', '32'])
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.readers.dialects import Dialect

WORDS: Final = {digits: re.compile(rf"(?<![\w.+-])[0-9a-fA-F]{{{digits}}}(?![\w.])") for digits in (4, 6, 8)}
LEAST: Final = 3  # Words in a line with a reading
MOST: Final = 0.3  # Share of the lines with as many words that have to hold a letter


@dataclass(frozen=True, slots=True)
class Hexadecimal:
    """Lines whose words of so many digits are hexadecimal numbers."""

    inner: Dialect
    digits: int

    @property
    def words(self) -> str:
        """For people."""
        return f"hexadecimal words in {self.inner.words}"

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the lines."""
        return self.inner.names

    def row(self, line: str) -> Sequence[str] | None:
        """Take a line, its words marked as hexadecimal."""
        return self.inner.row(_marked(line, self.digits))


def recognise(lines: list[str], behind: Callable[[list[str]], Dialect | None]) -> Hexadecimal | None:
    """Find lines of three words of one length that only hexadecimal digits explain."""
    for digits, word in WORDS.items():
        found = [words for line in lines if len(words := word.findall(line)) >= LEAST]
        lettered = [words for words in found if not all(map(str.isdigit, words))]
        if lettered and len(lettered) >= MOST * len(found):
            inner = behind([_marked(line, digits) for line in lines])
            return Hexadecimal(inner, digits) if inner else None
    return None


def _marked(line: str, digits: int) -> str:
    return WORDS[digits].sub(lambda word: f"0x{word[0]}", line)
