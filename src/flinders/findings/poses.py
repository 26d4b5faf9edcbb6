"""Words for the attitudes in advice, which follow "hold it"; the engine has the directions of these attitudes.

>>> POSE_WORDS["vehicle"][2], POSE_WORDS["sensor"][0]
('level', 'with its +x side down')
"""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator

Frame = Literal["vehicle", "sensor"]

_ROLLS: Final = {
    0: "", 45: "rolled 45° to its right", 90: "on its right side", 135: "rolled 135° to its right",
    180: "upside down", -135: "rolled 135° to its left", -90: "on its left side", -45: "rolled 45° to its left",
}  # fmt: skip
_PITCHES: Final = {
    0: "", -30: "with its nose 30° down", -60: "with its nose 60° down",
    30: "with its nose 30° up", 60: "with its nose 60° up",
}  # fmt: skip
_SIDES: Final = ("+x", "+y", "+z", "−x", "−y", "−z")


def _vehicle_words() -> Iterator[str]:
    """Yield words for attitudes of a vehicle: nose down, nose up, then five pitches with eight rolls each."""
    yield "with its nose straight down"
    yield "with its nose straight up"
    for pitch_deg, roll_deg in product(_PITCHES, _ROLLS):
        yield f"{_ROLLS[roll_deg]} {_PITCHES[pitch_deg]}".strip() or "level"


def _sensor_words() -> Iterator[str]:
    """Yield words for attitudes of a sensor: sides, edges and corners up, and sides with one neighbour lowered."""
    for side in _SIDES:
        yield f"with its {side} side down"
    for one, two in combinations(_SIDES, 2):
        if one[1] != two[1]:
            yield f"with the edge between its {one} and {two} sides down"
            for low, lowered in ((one, two), (two, one)):
                yield f"with its {low} side down and its {lowered} side lowered by 30°"
    for signs in product("+−", repeat=3):
        one, two, three = (sign + axis for sign, axis in zip(signs, "xyz", strict=True))
        yield f"with the corner of its {one}, {two} and {three} sides down"


POSE_WORDS: Final[dict[Frame, tuple[str, ...]]] = {"vehicle": tuple(_vehicle_words()), "sensor": tuple(_sensor_words())}
"""Words for the engine's attitudes, by frame; they follow "hold it"."""
