"""What a good verdict rests on and no finding shows, in words, with what would show it.

>>> stated(("uniform-field", "constant-iron"))
'holds if no iron is near and currents are constant: record elsewhere too'
>>> stated(())
''
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.findings.row import Condition

CONDITIONS: Final[dict[Condition, str]] = {
    "same-soft-iron": "soft iron is as it was",
    "uniform-field": "no iron is near",
    "constant-iron": "currents are constant",
}
"""What a good verdict rests on, in words."""

OF_A_TUMBLE: Final[tuple[Condition, ...]] = ("uniform-field", "constant-iron")
"""What a good verdict rests on where a magnetometer alone was recorded."""

CERTAINTY: Final[dict[Condition, str]] = {
    "same-soft-iron": "tumble again",
    "uniform-field": "record elsewhere too",
    "constant-iron": "record the currents",
}
"""What would show it."""


def stated(conditions: Sequence[Condition]) -> str:
    """What a verdict rests on, with what would show the first of it; nothing where it rests on nothing."""
    *first, last = (CONDITIONS[code] for code in conditions) if conditions else ("",)
    words = f"{', '.join(first)} and {last}" if first else last
    return f"holds if {words}: {CERTAINTY[conditions[0]]}" if conditions else ""
