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
"""What can happen to axes, by the axes that it happens to, in the order of the engine."""

MAX_NOISE: Final = limit_of("noise")
"""Largest noise of readings with the swap undone, as a share of the field: that of a recording that nothing limits."""


@dataclass(frozen=True, slots=True)
class AxisSwap:
    """Axes that changed their sign, or were exchanged, while the recording was made."""

    axes: str  # ``x``, ``y`` or ``z`` for a sign; ``xy``, ``yz`` or ``zx`` for two that were exchanged
    rows: tuple[int, ...]  # readings, counted from 0, from each of which on it is so, or is so no longer
    gain: float  # how many times closer to an ellipsoid all readings lie once it is undone


def axis_swap_of(readings: Floats, noise: float = math.inf) -> AxisSwap | None:
    """Look for the moments at which axes slipped.

    `readings`: (N, 3), in the order of recording, in any unit; `noise`: of the readings that a fit keeps, 1 σ: all of
    them have to lie as close once the swap is undone. Returns None where nothing slipped, or nothing that can be told.
    """
    change, rows = engine().axis_swap(readings, noise, MAX_NOISE)
    if change["swap"] < 0:
        return None
    return AxisSwap(axes=SWAPS[change["swap"]], rows=tuple(rows.tolist()), gain=float(change["gain"]))
