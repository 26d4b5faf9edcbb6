"""Excluded intervals of time, with undo and redo: values, ascending and disjoint.

>>> exclusions = Exclusions().excluding((3.0, 5.0)).excluding((4.0, 8.0)).restoring((6.0, 7.0))
>>> exclusions.spans
((3.0, 6.0), (7.0, 8.0))
>>> exclusions.undone().spans, exclusions.undone().redone() == exclusions
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
    united: list[Span] = []
    for start, end in sorted(spans):
        if united and start <= united[-1][1]:
            united[-1] = (united[-1][0], max(end, united[-1][1]))
        else:
            united.append((start, end))
    return tuple(united)


def without(spans: Iterable[Span], hole: Span) -> tuple[Span, ...]:
    """Spans with a hole cut into them."""
    pieces = [piece for start, end in spans for piece in ((start, min(end, hole[0])), (max(start, hole[1]), end))]
    return tuple((start, end) for start, end in pieces if start < end)


@dataclass(frozen=True, slots=True)
class Exclusions:
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

    def excluding(self, span: Span) -> Exclusions:
        """Take a span out."""
        return self._then(merged([*self.spans, span]))

    def restoring(self, span: Span) -> Exclusions:
        """Put a span back in."""
        return self._then(without(self.spans, span))

    def undone(self) -> Exclusions:
        """As before the last step; the same where there is none."""
        if not self.past:
            return self
        return Exclusions(self.past[-1], self.past[:-1], (*self.future, self.spans))

    def redone(self) -> Exclusions:
        """As before the last step was undone."""
        if not self.future:
            return self
        return Exclusions(self.future[-1], (*self.past, self.spans), self.future[:-1])

    def _then(self, spans: tuple[Span, ...]) -> Exclusions:
        if spans == self.spans or len(spans) > MOST:
            return self
        return Exclusions(spans, (*self.past, self.spans)[-REMEMBERED:])
