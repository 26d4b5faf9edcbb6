"""Dialects: lines that are no table, and how each of them becomes a row of one.

A dialect is recognised by the first lines and then takes one line at a time, whether that comes from a file or from a
wire. A new one is a file here with a `Dialect` and a function ``recognise``, and its row of ``DIALECTS`` in `_layout`.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(slots=True)
class Dialect:
    """How lines become rows of a table that is separated by commas."""

    words: str  # what the lines are, for people
    names: tuple[str, ...]  # of the columns; empty where the lines do not state them
    _: KW_ONLY
    frame: str = "sensor"  # what the axes are, as `Samples` calls it

    def row(self, line: str) -> Sequence[str] | None:
        """Take one line, in order: the cells of a reading, nothing for a part of one, None where it is another line."""
        raise NotImplementedError
