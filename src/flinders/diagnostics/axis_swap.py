"""Test whether an axis changed its sign, or two axes were exchanged, within a recording.

The cause is a restarted driver, a cable with a bad wire or firmware that changes its assumed mounting. The field at the
sensor stays continuous, so that readings before and after the moment are continuous only if T is applied to those
after:

    r₊ = T r₋      T one of x → −x, y → −y, z → −z, x ↔ y, y ↔ z, z ↔ x

for r₋ and r₊ extrapolated by half a step from before and from after. Such a moment is a candidate. The candidates are
confirmed if the readings with all of them undone lie clearly closer to an ellipsoid than as recorded, as close as
readings of a usable recording. A gap in the recording, or a field that is not uniform, is not confirmed. A swap of the
whole recording has no such moment, and the mirror image of an ellipsoid is an ellipsoid, so that a magnetometer alone
cannot show it. Neither can it show a changed sign if the offset along the axis is zero: then only headings change.

>>> import numpy as np
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

from flinders.findings import limit_of
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats

SWAPS: Final = ("x", "y", "z", "xy", "yz", "zx")
"""Possible swaps, by their axes, in the order of the engine."""

MAX_NOISE: Final = limit_of("noise")
"""Largest noise of readings with the swap undone, as a share of the field: the limit of a good recording."""


@dataclass(frozen=True, slots=True)
class AxisSwap:
    """Axes that changed their sign, or were exchanged, within a recording."""

    axes: str  # ``x``, ``y`` or ``z`` for a sign; ``xy``, ``yz`` or ``zx`` for two that were exchanged
    rows: tuple[int, ...]  # indices of readings at which the swap begins or ends, from 0
    gain: float  # factor by which the distance from an ellipsoid shrinks if the swap is undone


def axis_swap_of(readings: Floats, noise: float = math.inf) -> AxisSwap | None:
    """Find the moments at which axes were swapped; None if there are none, or none can be shown.

    `readings` are (N, 3), in the order of recording, in any unit; `noise` is the noise (1 σ) of the inliers of a fit,
    which all readings must reach after the swap is undone.
    """
    change, rows = engine().axis_swap(readings, noise, MAX_NOISE)
    if change["swap"] < 0:
        return None
    return AxisSwap(axes=SWAPS[change["swap"]], rows=tuple(rows.tolist()), gain=float(change["gain"]))
