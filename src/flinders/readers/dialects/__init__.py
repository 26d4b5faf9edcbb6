"""Dialects: formats of lines that are no table, and their conversion to rows of one.

A dialect is recognised by the first lines, and then converts single lines of a file or a wire. A new one is a file
here with a `Dialect` and a function ``recognise``, and its row of ``DIALECTS`` in `_recognition`.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(slots=True)
class Dialect:
    """Conversion of lines to rows of a comma-separated table."""

    words: str  # description of the lines for users
    names: tuple[str, ...]  # names of the columns; empty if the lines do not state them
    _: KW_ONLY
    frame: str = "sensor"  # axes of the readings, as in `Samples`

    def row(self, line: str) -> Sequence[str] | None:
        """Convert the next line: to the cells of a reading, to nothing for a part of one, to None for another line."""
        raise NotImplementedError
