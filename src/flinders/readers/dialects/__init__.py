"""Dialects: formats of lines that are not a table, and their conversion to rows of a table.

A dialect is recognised by the first lines of a text, and then converts line by line, from a file or from a sensor. To
add one, add a file here with a `Dialect` and a function ``recognise``, and a row to ``DIALECTS`` in `_recognition`.
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
        """Cells of a reading from the next line: empty for a part of a reading, None for a line of another kind."""
        raise NotImplementedError
