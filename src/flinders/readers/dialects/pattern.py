"""Lines in a format that the user gives: ``"N {x} / {y} / {z}"`` has names for the numbers, and literal text.

>>> pattern = Pattern.of("N {x} / {y} / {z} at {t_ms}")
>>> pattern.names, pattern.row("N -20.8 /  -20.2 / 26.1 at 1200 ms"), pattern.row("N 1 / 2")
(('x', 'y', 'z', 't_ms'), ['-20.8', '-20.2', '26.1', '1200'], None)
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Self

from flinders.errors import UsageError
from flinders.readers._cells import ATTACHED_NUMBER, decimal
from flinders.readers._tokenizer import NUMBER
from flinders.readers.dialects import Dialect

_PLACE: Final = re.compile(r"\{\s*([^{}:]*?)\s*(?::[^{}]*)?\}")
"""A name in braces; a format after a colon is ignored."""


@dataclass(slots=True)
class Pattern(Dialect):
    """A line with a pattern that has names in place of the line's numbers."""

    line: re.Pattern[str]  # pattern that captures the numbers

    @classmethod
    def of(cls, pattern: str) -> Self:
        """Compile the user's pattern; `UsageError` if it has not three different names."""
        pieces = _PLACE.split(pattern)
        names = tuple(pieces[1::2])
        if len(names) < 3 or len(set(names)) < len(names) or not all(names):
            raise UsageError(
                f"pattern {pattern!r}: need a line as printed, with three or more different names in braces "
                "for its numbers, such as 'mag {x} {y} {z}'"
            )
        texts = [r"\s*".join(map(re.escape, piece.split())) for piece in pieces[::2]]
        line = texts[0]
        for before, after in pairwise(zip(pieces[::2], texts, strict=True)):
            is_attached = before[0][-1:].isalnum()  # as in ``X{x}``, where the number may directly follow a letter
            line += rf"\s*({ATTACHED_NUMBER if is_attached else NUMBER})\s*{after[1]}"
        return cls(f"lines like {pattern!r}", names, re.compile(line))

    def row(self, line: str) -> list[str] | None:
        """Numbers of a line; None if it does not match."""
        match = self.line.search(line)
        return None if match is None else [decimal(number) for number in match.groups()]
