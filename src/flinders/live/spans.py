"""Stretches of time that were taken out, with undo: values, ascending and apart from each other.

>>> taken_out = History().excluding((3.0, 5.0)).excluding((4.0, 8.0)).restoring((6.0, 7.0))
>>> taken_out.spans
((3.0, 6.0), (7.0, 8.0))
>>> taken_out.undone().spans, taken_out.undone().redone() == taken_out
(((3.0, 8.0),), True)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable

Span = tuple[float, float]

REMEMBERED: Final = 200
"""Steps that can be undone."""
MOST: Final = 1000
"""Spans, at most: nobody takes out more by hand."""


def merged(spans: Iterable[Span]) -> tuple[Span, ...]:
    """Put spans in order and those that touch together."""
    found: list[Span] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return tuple(found)


def without(spans: Iterable[Span], hole: Span) -> tuple[Span, ...]:
    """Spans with a hole cut into them."""
    pieces = [piece for start, end in spans for piece in ((start, min(end, hole[0])), (max(start, hole[1]), end))]
    return tuple((start, end) for start, end in pieces if start < end)


@dataclass(frozen=True, slots=True)
class History:
    """What is taken out now, was before, and was before it was undone.

    Attributes
    ----------
    spans : tuple of (start, end), s
    past, future : tuple of such
        The last is the nearest.
    """

    spans: tuple[Span, ...] = ()
    past: tuple[tuple[Span, ...], ...] = ()
    future: tuple[tuple[Span, ...], ...] = ()

    def excluding(self, span: Span) -> History:
        """Take a span out."""
        return self._then(merged([*self.spans, span]))

    def restoring(self, span: Span) -> History:
        """Put a span back in."""
        return self._then(without(self.spans, span))

    def undone(self) -> History:
        """As before the last step; the same where there is none."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (*self.future, self.spans))

    def redone(self) -> History:
        """As before the last step was undone."""
        if not self.future:
            return self
        return History(self.future[-1], (*self.past, self.spans), self.future[:-1])

    def _then(self, spans: tuple[Span, ...]) -> History:
        if spans == self.spans or len(spans) > MOST:
            return self
        return History(spans, (*self.past, self.spans)[-REMEMBERED:])
