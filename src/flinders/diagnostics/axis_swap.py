"""Whether an axis changed its sign, or two were exchanged, while the recording was made.

A driver that is restarted, a cable with a bad wire or a firmware that changes the mounting it assumes does
this. The field at the sensor goes on as smoothly as before, so readings on both sides of the moment fit together after,
and only after, T is applied to those behind it:

    r₊ = T r₋      T one of x → −x, y → −y, z → −z, x ↔ y, y ↔ z, z ↔ x

for r₋ and r₊ continued by half a step from before and from behind. Such a moment is a candidate. It is one where the
readings with all candidates undone lie clearly closer to an ellipsoid than they do as recorded, as close as those of a
usable recording: a gap in the recording passes neither, nor does a field that is not the same everywhere. What is so
throughout has no moment, and a mirror image of an ellipsoid is an ellipsoid: no magnetometer alone can tell it. Nor can
it where the offset along the axis is nothing: then nothing is changed but the heading.

>>> rng = np.random.default_rng(1)
>>> turn = np.linspace(0.0, 40.0, 1000)
>>> around = np.stack([np.sin(turn) * np.cos(0.1 * turn), np.cos(turn), np.sin(turn) * np.sin(0.1 * turn)], axis=1)
>>> field = 50.0 * around + [10, 20, 30] + rng.normal(scale=0.3, size=around.shape)
>>> axis_swap_of(field) is None
True
>>> field[600:, 1] *= -1.0
>>> swap = axis_swap_of(field)
>>> swap.axes, swap.rows, swap.gain > 10.0
('y', (600,), True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import BLOCK
from flinders.errors import FitError
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood
from flinders.findings import limit_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate

SWAPS: Final = {
    "x": np.diag([-1.0, 1.0, 1.0]),
    "y": np.diag([1.0, -1.0, 1.0]),
    "z": np.diag([1.0, 1.0, -1.0]),
    "xy": np.eye(3)[[1, 0, 2]],
    "yz": np.eye(3)[[0, 2, 1]],
    "zx": np.eye(3)[[2, 1, 0]],
}
"""What can happen to axes, each its own inverse, by the axes that it happens to."""

FEWEST: Final = 50
"""Fewer readings than this do not tell how smooth they are."""

REACH: Final = 11
"""Readings that are looked at around a break, less one."""

BROKEN: Final = 3.0
"""Times the largest break among three readings on either side that a break has to be."""

LIKE: Final = 2.0
"""Times the same that readings may be apart once it is undone: less than a break is, more than the smooth path has."""

GAIN: Final = 1.1
"""Times closer to an ellipsoid that readings have to be once it is undone: the noise of 500 readings, known to
√(1/1000) = 3 %, changes by more than three times as much."""

MOST_NOISE: Final = limit_of("noise")
"""Largest noise of readings with the swap undone, as a share of the field: that of a recording that nothing limits."""

LEAST_EVIDENCE: Final = 10.0
"""Least gain in log-likelihood, n ln gain: of n independent readings, of which a field along a path leaves few."""

MOST: Final = 1000.0
"""What is told at most, also where the readings as recorded lie on no ellipsoid at all."""

LOOKED_AT: Final = 20_000
"""Readings that noises are compared by, at most: they tell one to √(1/40000) = 0.5 %, of the 10 % that `GAIN` asks."""


@dataclass(frozen=True, slots=True)
class AxisSwap:
    """Axes that changed their sign, or were exchanged, while the recording was made."""

    axes: str  # ``x``, ``y`` or ``z`` for a sign; ``xy``, ``yz`` or ``zx`` for two that were exchanged
    rows: tuple[int, ...]  # readings, counted from 0, from each of which on it is so, or is so no longer
    gain: float  # how many times closer to an ellipsoid all readings lie once it is undone


def axis_swap_of(readings: Floats, noise: float = np.inf) -> AxisSwap | None:
    """Look for the moments at which axes slipped.

    `readings`: (N, 3), in the order of recording, in any unit; `noise`: of the readings that a fit keeps, 1 σ: all of
    them have to lie as close once the swap is undone. Returns None where nothing slipped, or nothing that can be told.
    """
    if len(readings) < FEWEST:
        return None
    moments = moments_of(readings)
    if not moments:
        return None
    axes = max(moments, key=lambda name: len(moments[name]))
    rows = np.arange(0, len(readings), -(-len(readings) // LOOKED_AT))
    some = readings[rows]
    is_behind = np.searchsorted(moments[axes], rows, side="right") % 2 == 1
    undone = np.where(is_behind[:, np.newaxis], some @ SWAPS[axes], some)
    put_right, as_recorded = _fitted(undone), _fitted(some)
    if put_right is None or not put_right.noise <= min(GAIN * noise, MOST_NOISE * put_right.ellipsoid.radius):
        return None
    before = np.inf if as_recorded is None else as_recorded.noise
    gain = min(before / max(put_right.noise, np.finfo(float).tiny), MOST)
    independent = len(some) if put_right.correlation is None else put_right.correlation.effective(len(some))
    if gain <= GAIN or independent * math.log(gain) < LEAST_EVIDENCE:
        return None
    return AxisSwap(axes=axes, rows=tuple(int(row) for row in moments[axes]), gain=gain)


def moments_of(readings: Floats) -> dict[str, NDArray[np.int64]]:
    """First rows behind a break that one of `SWAPS` mends, by its name; those that mend none are left out."""
    starts = range(0, len(readings) - REACH, BLOCK)
    breaks = [_breaks(readings[begin : begin + BLOCK + REACH], begin) for begin in starts]
    at, usual = np.concatenate([rows for rows, _ in breaks]), np.concatenate([neighbours for _, neighbours in breaks])
    onward = 1.5 * readings[at + 2] - 0.5 * readings[at + 3]
    back = 1.5 * readings[at + 1] - 0.5 * readings[at]
    mended = {name: at[np.abs(onward @ swap - back).max(axis=1) <= LIKE * usual] for name, swap in SWAPS.items()}
    return {name: breaks + 2 for name, breaks in mended.items() if len(breaks)}


def _breaks(readings: Floats, begin: int) -> tuple[NDArray[np.int64], Floats]:
    """Rows, counted from `begin`, behind whose next one the path breaks, and how far it usually is from straight there.

    What two readings lead to is then far from what the next two come from, and the two next to the middle of nine go
    across the break.
    """
    axes = np.ascontiguousarray(readings.T)
    before = 1.5 * axes[:, 1:-2] - 0.5 * axes[:, :-3]
    after = 1.5 * axes[:, 2:-1] - 0.5 * axes[:, 3:]
    breaks = np.abs(after - before).max(axis=0)
    three = np.maximum(np.maximum(breaks[:-2], breaks[1:-1]), breaks[2:])
    neighbours = np.maximum(three[:-6], three[6:])
    at = np.flatnonzero(breaks[4:-4] > BROKEN * neighbours)
    return at + 4 + begin, neighbours[at]


def _fitted(readings: Floats) -> Estimate | None:
    """The ellipsoid of readings; None where there is none."""
    try:
        return Likelihood().estimate(Readings.of(readings))
    except FitError:
        return None
