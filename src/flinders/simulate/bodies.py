r"""Bodies that carry a magnetometer: their largest tilt, rate of turning and sway, and their motion in words.

>>> drone = BODIES["drone"]
>>> print(*drone.steps(drone.sequences()[1]), sep="\n")
turn it once around, level
lower its nose by 45°, keep it so and turn it once around
lower its right side by 45°, keep it so and turn it once around
lower its tail by 45°, keep it so and turn it once around
lower its left side by 45°, keep it so and turn it once around
>>> round(drone.seconds(drone.sequences()[1]))
45
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Final

from flinders.core.language import ENGLISH
from flinders.simulate.turn_sequence import SIDES, PoseTurn, path_deg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.core.language import Language
    from flinders.simulate.turn_sequence import Side

QUARTER_DEG: Final = 90.0
"""Degrees of tilt at which a side points straight down."""

UPSIDE_DOWN_DEG: Final = 180.0
"""Degrees of tilt at which a body is upside down."""

DIAGONAL_DEG: Final = 45.0
"""Degrees of tilt half way between level and a side that points straight down."""

TIMES: Final = {1: "once", 2: "twice"}
"""Words for the number of circles."""

MANY_TIMES: Final = "{count} times"
"""Words for another number of circles."""

CIRCLES: Final = {
    "turn": "turn it {times} around",
    "steer": "steer {times} around",
    "yourself": "turn yourself {times} around",
}
"""Words for turns about the vertical."""

STEP_FORMS: Final = {
    "level": "{around}, level",
    "over": "hold it upside down, keep it so and {around}",
    "down": "point its {side} straight down, keep it so and {around}",
    "lower": "lower its {side} by {tilt}°, keep it so and {around}",
}
"""Words for circles in one attitude."""


@dataclass(frozen=True, slots=True)
class Step:
    """Instruction for circles in one attitude."""

    form: str  #: attitude, one of `STEP_FORMS`
    circle: str  #: turn about the vertical, one of `CIRCLES`
    times: int  #: number of circles
    side: str  #: side that is lowered, in words; empty for none
    tilt_deg: float

    def words(self, language: Language = ENGLISH) -> str:
        """The instruction as a clause.

        >>> Step("lower", "turn", 3, "nose", 45.0).words()
        'lower its nose by 45°, keep it so and turn it 3 times around'
        """
        key = self.times if self.times in TIMES else "many"
        times = language.phrase(f"plan.times.{key}", TIMES.get(self.times, MANY_TIMES), count=str(self.times))
        around = language.phrase(f"plan.circle.{self.circle}", CIRCLES[self.circle], times=times)
        side = language.phrase(f"plan.side.{side_key(self.side)}", self.side)
        return language.phrase(
            f"plan.step.{self.form}", STEP_FORMS[self.form], around=around, side=side, tilt=f"{self.tilt_deg:g}"
        )


def side_key(side: str) -> str:
    """Words for a side as a key of other languages.

    >>> side_key("12 o'clock side")
    '12-oclock-side'
    """
    return side.replace("'", "").replace(" ", "-")


@dataclass(frozen=True, slots=True)
class Body:
    """A body that carries a magnetometer, with axes forward, right and down."""

    name: str
    description: str  #: the body in a few words
    tilt_deg: float  #: largest tilt that the body reaches; 180 if it can be turned upside down
    turning_deg_s: float  #: usual rate of turning, degrees a second
    sway_deg: float  #: root mean square lean away from a constant attitude, about each of two level axes, degrees
    sides: Mapping[Side, str]  #: words for the sides that are lowered
    circle: str = "turn"  #: words for circles about the vertical, one of `CIRCLES`

    def sequences(self, tilt_deg: float | None = None) -> tuple[tuple[PoseTurn, ...], ...]:
        """Sequences of turns that the body can follow, the shortest first.

        Parameters
        ----------
        tilt_deg : float, optional
            Largest tilt, in place of the body's own.
        """
        reach_deg = self.tilt_deg if tilt_deg is None else tilt_deg
        level = (PoseTurn(),)
        if reach_deg <= 0.0:
            return (level,)
        steep_deg = min(reach_deg, QUARTER_DEG)
        around = (*level, *(PoseTurn(side, steep_deg) for side in SIDES))
        if reach_deg <= QUARTER_DEG:
            between = tuple(PoseTurn(side, steep_deg / 2.0) for side in SIDES)
            return level, around, (*level, *between, *around[1:])
        over = (*around[:3], PoseTurn("right", reach_deg), *around[3:])
        diagonal = tuple(PoseTurn(side, DIAGONAL_DEG) for side in SIDES)
        return level, around, over, (*level, *diagonal, *over[1:])

    def seconds(self, sequence: Sequence[PoseTurn]) -> float:
        """Seconds that a sequence takes at the usual rate of turning."""
        return path_deg(sequence) / self.turning_deg_s

    def steps(self, sequence: Sequence[PoseTurn]) -> list[str]:
        """Instructions to follow a sequence, one sentence for each attitude."""
        return [step.words() for step in self.coded_steps(sequence)]

    def coded_steps(self, sequence: Sequence[PoseTurn]) -> list[Step]:
        """The same instructions as codes and numbers."""
        return [self._step(turn, len(list(same))) for turn, same in groupby(sequence)]

    def _step(self, turn: PoseTurn, circles: int) -> Step:
        """Instruction for a count of circles in one attitude."""
        if turn.tilt_deg <= 0.0:
            form = "level"
        elif turn.tilt_deg >= UPSIDE_DOWN_DEG:
            form = "over"
        else:
            form = "down" if turn.tilt_deg == QUARTER_DEG else "lower"
        side = self.sides[turn.side] if form in ("down", "lower") else ""
        return Step(form, self.circle, circles, side, turn.tilt_deg)


_SIDES: Final[Mapping[Side, str]] = {"nose": "front", "right": "right side", "tail": "rear", "left": "left side"}

BODIES: Final[Mapping[str, Body]] = {
    body.name: body
    for body in (
        Body("hand", "a sensor or a board in the hand", 180.0, 60.0, 8.0, _SIDES),
        Body(
            "drone", "a multicopter held in both hands, its motors off", 45.0, 45.0, 4.0,
            {**_SIDES, "nose": "nose", "tail": "tail"},
        ),
        Body(
            "boat", "a boat that steers circles in calm water", 0.0, 3.0, 1.0,
            {"nose": "bow", "right": "starboard side", "tail": "stern", "left": "port side"},
            "steer",
        ),
        Body("robot", "a wheeled robot that turns on a level floor", 0.0, 30.0, 0.05, _SIDES),
        Body(
            "wrist", "a watch on the wrist of a person who turns on the spot", 90.0, 60.0, 8.0,
            {"nose": "12 o'clock side", "right": "3 o'clock side", "tail": "6 o'clock side", "left": "9 o'clock side"},
            "yourself",
        ),
    )
}  # fmt: skip
"""Bodies by name."""
