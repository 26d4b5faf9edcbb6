"""Rests of a vehicle on one heading, found in a stream of headings, and the compass error over half a turn.

A compass swing is recorded by holding the vehicle on one heading after another. The stretches between turns are found
here, each with its mean heading.

>>> rng = np.random.default_rng(1)
>>> turn = np.linspace(0.0, 180.0, 300)
>>> heading = np.concatenate([np.full(400, 10.0), 10.0 + turn, np.full(400, 190.0)]) + rng.normal(0.0, 0.5, 1100)
>>> [(rest.start, rest.stop, round(rest.heading_deg)) for rest in rests(heading)]
[(6, 402, 10), (696, 1092, 190)]
>>> [half] = half_turns(rests(heading))
>>> abs(half.error_deg) < 0.2
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import to_floats
from flinders.errors import ArrayError
from flinders.geometry.angles import mean_deg, wrap_180, wrap_360

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

MAX_DEVIATION_DEG: Final = 3.0
"""Largest angle between the mean of one part of a rest and the mean of the whole rest."""
MIN_REST_READINGS: Final = 50
"""Smallest count of readings of a rest."""
MOMENTS_PER_REST: Final = 8
"""Count of parts of the shortest rest; readings of a part are averaged, so that noise is not mistaken for motion."""
MAX_HALF_TURN_ERROR_DEG: Final = 30.0
"""Largest difference of a measured turn from 180° that counts as half a turn."""


@dataclass(frozen=True, slots=True)
class Rest:
    """A stretch of one heading."""

    start: int  # index of the first reading
    stop: int  # index after the last reading
    heading_deg: float  # mean heading, in [0, 360)
    spread_deg: float  # scatter of single headings, 1 σ
    sigma_deg: float  # 1 σ of the mean by the means of its eighths, with slow noise, but without the effect of iron

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, with the names of the attributes as keys."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True, slots=True)
class HalfTurn:
    """Two rests that are half a turn apart.

    For a deviation δ(ζ) the error over half a turn is δ(ζ) − δ(ζ + 180°) = 2 (B sin ζ + C cos ζ). It shows hard iron,
    but no error that is the same after half a turn, such as that of soft iron.
    """

    first: Rest
    second: Rest
    error_deg: float  # change of the heading minus 180°, in (−180, 180]
    sigma_deg: float  # 1 σ of `error_deg` from the noise of the readings

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            "first_deg": self.first.heading_deg,  # heading before the turn
            "second_deg": self.second.heading_deg,  # heading after the turn
            "error_deg": self.error_deg,
            "sigma_deg": self.sigma_deg,
        }


def rests(heading_deg: ArrayLike, *, least_readings: int = MIN_REST_READINGS) -> tuple[Rest, ...]:
    """Find rests of at least `least_readings` in (N,) headings in the order of time, NaN if missing.

    Consecutive rests on the same heading, interrupted by a disturbance, count as one. At both ends of a rest, an eighth
    of the shortest rest is left out, because turns end and begin there.

    Raises `ArrayError` for anything but a list of numbers.
    """
    headings = to_floats(heading_deg, "heading_deg")
    if headings.ndim != 1:
        raise ArrayError(f"heading_deg has shape {headings.shape}: need (N,), one heading per reading")
    size = max(least_readings // MOMENTS_PER_REST, 1)
    moments = np.exp(1j * np.deg2rad(headings[: len(headings) // size * size])).reshape(-1, size)
    with np.errstate(invalid="ignore"):
        mean = np.where(np.isfinite(moments).any(axis=1), np.nansum(moments, axis=1), np.nan)
    joined: list[tuple[int, int]] = []
    for run in _steady_runs(mean):
        is_next = joined and run[0] - joined[-1][1] <= MOMENTS_PER_REST
        if is_next and abs(_apart(mean, joined[-1], run)) <= MAX_DEVIATION_DEG:
            joined[-1] = (joined[-1][0], run[1])
        else:
            joined.append(run)
    return tuple(_rest(headings, (start + 1) * size, (stop - 1) * size) for start, stop in joined)


def half_turns(rests: Sequence[Rest], known_deg: Sequence[float] = ()) -> tuple[HalfTurn, ...]:
    """Pair each rest with the next one that is about half a turn away.

    The change of heading is compared with 180°, or with the difference of `known_deg`, (N,) true headings.

    >>> north, south = Rest(0, 100, 1.0, 0.5, 0.1), Rest(200, 300, 178.0, 0.5, 0.1)
    >>> [round(half.error_deg, 9) for half in half_turns([north, south])]
    [-3.0]
    >>> [round(half.error_deg, 9) for half in half_turns([north, south], [0.0, 178.0])]
    [-1.0]
    """
    halves = []
    for place, first in enumerate(rests):
        for other, second in enumerate(rests[place + 1 :], place + 1):
            turn = known_deg[other] - known_deg[place] if len(known_deg) else 180.0
            off = float(wrap_180(second.heading_deg - first.heading_deg - turn))
            if abs(off) <= MAX_HALF_TURN_ERROR_DEG and abs(float(wrap_180(turn - 180.0))) <= MAX_DEVIATION_DEG:
                halves.append(HalfTurn(first, second, off, float(np.hypot(first.sigma_deg, second.sigma_deg))))
                break
    return tuple(halves)


def hard_iron(halves: Sequence[HalfTurn]) -> tuple[float, float] | None:
    """Coefficients B and C of the deviation in degrees, by least squares from half turns; None if all are parallel.

    >>> north_south = HalfTurn(Rest(0, 9, 0.0, 0.5, 0.1), Rest(9, 18, 184.0, 0.5, 0.1), 4.0, 0.1)
    >>> east_west = HalfTurn(Rest(20, 29, 90.0, 0.5, 0.1), Rest(30, 39, 272.0, 0.5, 0.1), 2.0, 0.1)
    >>> [round(part, 2) for part in hard_iron([north_south, east_west])]
    [1.03, 1.97]
    """
    angles = np.deg2rad([[half.first.heading_deg, half.second.heading_deg] for half in halves]).reshape(-1, 2)
    rows = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    rows = rows[:, 0] - rows[:, 1]
    if len(rows) < 2 or np.linalg.svd(rows, compute_uv=False)[-1] < 1.0:  # less than 30° between two lines
        return None
    b, c = np.linalg.lstsq(rows, np.array([half.error_deg for half in halves]))[0].tolist()
    return b, c


def _steady_runs(mean: Floats) -> list[tuple[int, int]]:
    """Stretches of moments that stay near their own mean for long enough: first index, and index after the last."""
    runs, start, total = [], 0, 0.0 + 0.0j
    for place, moment in enumerate(mean.tolist()):
        belongs = start < place and abs(_angle(moment, total)) <= MAX_DEVIATION_DEG  # false for NaN
        if not belongs:
            runs.append((start, place))
            start, total = place, 0.0 + 0.0j
        total += moment
    return [(first, stop) for first, stop in [*runs, (start, len(mean))] if stop - first >= MOMENTS_PER_REST]


def _apart(mean: Floats, one: tuple[int, int], other: tuple[int, int]) -> float:
    """Angle between the means of two runs of moments, in degrees."""
    return _angle(complex(np.nansum(mean[slice(*other)])), complex(np.nansum(mean[slice(*one)])))


def _angle(one: complex, other: complex) -> float:
    """Angle from `other` to `one` in degrees."""
    return float(np.rad2deg(np.angle(one * other.conjugate())))


def _rest(headings: Floats, start: int, stop: int) -> Rest:
    """Rest with the mean, scatter and uncertainty of a stretch of headings."""
    inside = headings[start:stop]
    inside = inside[np.isfinite(inside)]
    middle = mean_deg(inside)
    off = wrap_180(inside - middle)
    parts = [float(part.mean()) for part in np.array_split(off, MOMENTS_PER_REST) if len(part)]
    sigma = float(np.std(parts, ddof=1) / len(parts) ** 0.5) if len(parts) > 1 else float("nan")
    return Rest(start, stop, float(wrap_360(middle)), float(off.std()), sigma)
