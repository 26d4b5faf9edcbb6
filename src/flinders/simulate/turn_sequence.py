"""Motion of a body that is turned once around in one attitude after the other, as a person follows instructions.

The body turns about the vertical at a constant rate, then leans over to the next attitude at the same rate. Meanwhile
hands, wind or waves sway it.

>>> sequence = [PoseTurn(), PoseTurn("nose", 45.0)]
>>> turning = turn_sequence(np.random.default_rng(0), sequence, seconds=20.0, sway_deg=0.0)
>>> turning.attitudes[:, 2, 2].round(2)[[0, 400, 999]].tolist()
[1.0, 1.0, 0.71]
>>> path_deg(sequence)
765.0
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np

from flinders.simulate._checks import count
from flinders.simulate.attitudes import in_body_axes, rates, turns
from flinders.simulate.motions import LEAN_TIME_CONSTANT_S, RATE_HZ, Motion, Path, Trajectory, smooth_noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.simulate.motions import Course

Side = Literal["nose", "right", "tail", "left"]
"""Side of a body that is lowered."""

SIDES: Final[tuple[Side, ...]] = get_args(Side)
"""Sides in the order in which a sequence lowers them."""

LEAN_AXES: Final[dict[Side, tuple[float, float, float]]] = {
    "nose": (0.0, -1.0, 0.0), "right": (1.0, 0.0, 0.0), "tail": (0.0, 1.0, 0.0), "left": (-1.0, 0.0, 0.0),
}  # fmt: skip
"""Body axis (forward, right, down) about which a right-handed rotation lowers each side."""

CIRCLE_DEG: Final = 360.0
"""Degrees of one turn."""


@dataclass(frozen=True, slots=True)
class PoseTurn:
    """One turn about the vertical in a constant attitude."""

    side: Side = "nose"  #: side that is lowered
    tilt_deg: float = 0.0  #: angle by which `side` is lowered; 180 is upside down

    @property
    def lean(self) -> Floats:
        """(3,) rotation vector from level to the attitude, rad, body axes."""
        return math.radians(self.tilt_deg) * np.array(LEAN_AXES[self.side])

    def lean_over_deg(self, other: PoseTurn) -> float:
        """Length of the rotation from this attitude to another, at an unchanged heading."""
        return math.degrees(float(np.linalg.norm(other.lean - self.lean)))


def path_deg(sequence: Sequence[PoseTurn]) -> float:
    """Total rotation of a body in a sequence, in degrees: a circle for each turn, and the changes of attitude."""
    return CIRCLE_DEG * len(sequence) + sum(one.lean_over_deg(other) for one, other in pairwise(sequence))


def turn_sequence(
    rng: Generator,
    sequence: Sequence[PoseTurn],
    *,
    seconds: float = 60.0,
    rate_hz: float = RATE_HZ,
    sway_deg: float = 5.0,
) -> Trajectory:
    """Turn a body once around in each attitude of a sequence.

    Parameters
    ----------
    sequence : sequence of PoseTurn
        At least one turn.
    sway_deg : float
        Rms lean away from the attitude, about each of two axes; it changes within some seconds.
    """
    n = count(round(seconds * rate_hz))
    time = np.arange(n, dtype=np.float64) / rate_hz
    heading, lean = _heading_and_lean(sequence, time / max(seconds, 1.0 / rate_hz))
    sway = smooth_noise(rng, n, math.exp(-1.0 / (rate_hz * LEAN_TIME_CONSTANT_S))) * [1.0, 1.0, 0.0]
    sway *= math.radians(sway_deg) / math.sqrt(float(np.mean(sway[:, :2] ** 2)))
    turned = turns(np.outer(heading + rng.uniform(0.0, 2.0 * np.pi), [0.0, 0.0, 1.0]))
    attitudes = turned @ turns(lean) @ turns(sway)
    return Trajectory(time, attitudes, rates(attitudes, rate_hz))


def sequence_motion(sequence: Sequence[PoseTurn], *, sway_deg: float) -> Motion:
    """Motion of `flinders.simulate.tumble` that follows a sequence."""

    def draw(rng: Generator, course: Course) -> Path:
        seconds = course.n / course.rate_hz
        turning = turn_sequence(rng, sequence, seconds=seconds, rate_hz=course.rate_hz, sway_deg=sway_deg)
        return Path(in_body_axes(turning.attitudes, course.world), turning.attitudes, turning.rate)

    return Motion(draw)


def _heading_and_lean(sequence: Sequence[PoseTurn], progress: Floats) -> tuple[Floats, Floats]:
    """(N,) heading in rad and (N, 3) lean as a rotation vector in rad, at (N,) shares of the whole path."""
    corners, headings, leans = [0.0], [0.0], [sequence[0].lean]
    for place, turn in enumerate(sequence):
        if place:
            corners.append(corners[-1] + sequence[place - 1].lean_over_deg(turn))
            headings.append(headings[-1])
            leans.append(turn.lean)
        corners.append(corners[-1] + CIRCLE_DEG)
        headings.append(headings[-1] + 2.0 * np.pi)
        leans.append(turn.lean)
    path = progress * corners[-1]
    lean = np.stack([np.interp(path, corners, axis) for axis in np.transpose(leans)], axis=1)
    return np.interp(path, corners, headings), lean
