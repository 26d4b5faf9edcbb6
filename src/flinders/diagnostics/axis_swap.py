"""Test whether an axis changed its sign, or two axes were exchanged, within a recording.

Causes are a restarted driver, a cable with a bad wire, or firmware that changes its assumed mounting. The field at the
sensor stays continuous, but the readings jump from r₋ to r₊ at the moment of the change:

    r₊ = T r₋      T one of x → −x, y → −y, z → −z, x ↔ y, y ↔ z, z ↔ x

where r₋ and r₊ are extrapolated by half a step from before and from after. Each such moment is a candidate. The
candidates are confirmed if undoing all of them moves the readings clearly closer to an ellipsoid, as close as those of
a usable recording. A gap in the recording, or a field that is not uniform, is not confirmed.

If axes are swapped in the whole recording, there is no such moment, and the mirror image of an ellipsoid is an
ellipsoid, so that a magnetometer alone cannot show it. A changed sign does not show either if the offset along the axis
is zero: then only headings change.

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
"""Names of the possible swaps by their axes, in the order of the engine."""

MAX_NOISE: Final = limit_of("noise")
"""Largest noise of readings with the swap undone, as a share of the field: the limit of a good recording."""


@dataclass(frozen=True, slots=True)
class AxisSwap:
    """Axes that changed their sign, or were exchanged, within a recording."""

    axes: str  # ``x``, ``y`` or ``z`` for a changed sign; ``xy``, ``yz`` or ``zx`` for two exchanged axes
    rows: tuple[int, ...]  # indices of the readings at which the swap begins or ends, counted from 0
    gain: float  # factor by which the rms distance from an ellipsoid decreases if the swap is undone


def axis_swap_of(readings: Floats, noise: float = math.inf) -> AxisSwap | None:
    """Find the moments at which axes were swapped; None if no swap is confirmed.

    `readings` are (N, 3), in the order of recording, in any unit. `noise` is 1 σ of the inliers of a fit, which all
    readings must reach after the swap is undone.
    """
    change, rows = engine().axis_swap(readings, noise, MAX_NOISE)
    if change["swap"] < 0:
        return None
    return AxisSwap(axes=SWAPS[change["swap"]], rows=tuple(rows.tolist()), gain=float(change["gain"]))
