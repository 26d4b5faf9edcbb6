"""Readings of several sensors at the same moments: one grid of time, and by how much a clock is off.

The slowest sensor sets the moments; the readings of the others are taken there by a straight line between the two on
either side, and left out where those are too far apart. Sensors of one log may have been stamped at different stages:
how late one is against another shows where a common motion fits best,

    min over δ, M, c   Σ |x(tₖ + δ) − M y(tₖ) − c|²

an affine map at each shift, since no calibration is known yet. Both are smoothed alike before, so that a shift by half
a step, which takes noise off a straight line between two readings, is no better for that alone. A delay counts only
where it saves many times its noise.

>>> time = np.arange(0.0, 30.0, 0.1)
>>> turning = lambda t: np.stack([np.sin(t), np.cos(1.3 * t), np.sin(0.7 * t)], axis=1)
>>> found = paired([time, time], [turning(time), 2.0 * turning(time - 0.25)])
>>> found.delays_s.round(2)
array([0.  , 0.25])
>>> bool(np.nanmax(np.abs(found.fields[1] - 2.0 * found.fields[0])) < 0.02)
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

LONGEST_S: Final = 2.0
"""By which a clock is looked for to be off, either way."""

GAP: Final = 3.0
"""Usual intervals between two readings across which there is no straight line."""

SMOOTH: Final = 5
"""Readings that are averaged before shifts are compared."""

PROVEN: Final = 6.0
"""Standard deviations from which on a delay is one."""

LEAST: Final = 0.1
"""Of a step: a smaller delay moves nothing."""

MANY: Final = 4000
"""Moments that a delay is looked for in."""

FEWEST: Final = 50
"""Moments from which a delay can be estimated."""


@dataclass(frozen=True, slots=True, eq=False)
class Paired:
    """Readings at common moments."""

    time: Floats  #: (N,), s: by the clock of the reference; counted readings where there is no time
    fields: Floats  #: (m, N, 3): NaN where a sensor has no reading
    #: (m,), s: by how much each is behind the reference, 0 where that is not proven, and how well that is told
    delays_s: Floats
    delay_sigmas_s: Floats  #: (m,), s


def paired(times: Sequence[Floats], fields: Sequence[Floats], *, reference: int = 0) -> Paired:
    """Take readings to common moments, those at which two sensors or more have a reading.

    Parameters
    ----------
    times : sequence of (N,) float, s
        Of each sensor, ascending; lengths may differ.
    fields : sequence of (N, 3) float
    reference : int
        Whose clock counts.
    """
    delays, sigmas = np.zeros(len(times)), np.zeros(len(times))
    for sensor in range(len(times)):
        if sensor != reference:
            delays[sensor], sigmas[sensor] = _delay(times[reference], fields[reference], times[sensor], fields[sensor])
    slowest = min(range(len(times)), key=lambda sensor: (len(times[sensor]), sensor != reference))
    moments = times[slowest] - delays[slowest]
    taken = np.stack([
        field if sensor == slowest and not delay else between(time - delay, field, moments)
        for sensor, (time, field, delay) in enumerate(zip(times, fields, delays, strict=True))
    ])  # fmt: skip
    shared = np.isfinite(taken[:, :, 0]).sum(axis=0) > 1
    return Paired(moments[shared], taken[:, shared], delays, sigmas)


def between(time: Floats, field: Floats, moments: Floats) -> Floats:
    """(K, 3) readings at other moments, on a straight line from one to the next; NaN outside, and in a gap.

    >>> between(np.array([0.0, 1.0, 2.0, 9.0]), np.arange(12.0).reshape(4, 3), np.array([0.5, 2.0, 5.0]))[:, 0]
    array([1.5, 6. , nan])
    """
    if len(time) < 2:
        return np.full((len(moments), 3), np.nan)
    after = np.clip(np.searchsorted(time, moments, side="left"), 1, len(time) - 1)
    step = time[after] - time[after - 1]
    share = np.where(step > 0.0, (moments - time[after - 1]) / np.where(step > 0.0, step, 1.0), 0.0)
    usual = float(np.median(np.diff(time)))
    exact = np.isclose(share, 0.0, atol=1e-9) | np.isclose(share, 1.0, atol=1e-9)
    outside = (share < -1e-9) | (share > 1.0 + 1e-9) | ((step > GAP * usual) & ~exact)
    taken: Floats = field[after - 1] + share[:, np.newaxis] * (field[after] - field[after - 1])
    taken[outside] = np.nan
    return taken


def affine_residuals(source: Floats, target: Floats) -> Floats:
    """(K, 3) what the best affine map of (N, 3) readings leaves of others, where both are there."""
    both = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    design = np.column_stack([source[both], np.ones(np.count_nonzero(both))])
    residuals: Floats = target[both] - design @ np.linalg.lstsq(design, target[both], rcond=None)[0]
    return residuals


def _delay(time: Floats, field: Floats, other_time: Floats, other: Floats) -> tuple[float, float]:
    """By how much another sensor is behind, and the standard deviation of that; 0 where it is not proven."""
    first, last = max(time[0], other_time[0]), min(time[-1], other_time[-1])
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(other_time))))
    if not step > 0.0 or last - first < FEWEST * step:
        return 0.0, math.inf
    moments = np.arange(first, last, max(step, (last - first) / MANY))
    still = _smooth(between(time, field, moments))
    reach = min(LONGEST_S, 0.25 * (last - first))

    def misfit(delay: float) -> tuple[float, int]:
        moved = _smooth(between(other_time, other, moments + delay))
        left = affine_residuals(still, moved)
        return (math.inf, 1) if len(left) < FEWEST else (float(np.mean(left**2)), len(left))

    shifts = np.arange(-math.ceil(reach / step), math.ceil(reach / step) + 1) * step
    best = float(shifts[int(np.argmin([misfit(float(shift))[0] for shift in shifts]))])
    width = step
    for _ in range(3):  # a parabola through three points, each time a narrower one
        low, middle, high = (misfit(best + offset)[0] for offset in (-width, 0.0, width))
        bend = low - 2.0 * middle + high
        if not (np.isfinite(bend) and bend > 0.0):
            break
        best += float(np.clip(0.5 * width * (low - high) / bend, -width, width))
        width /= 2.0
    least, count = misfit(best)
    low, high = misfit(best - step)[0], misfit(best + step)[0]
    bend = (low - 2.0 * least + high) / step**2
    free = 3.0 * count / SMOOTH
    if not (np.isfinite(bend) and bend > 0.0):
        return 0.0, math.inf
    sigma = math.sqrt(2.0 * max(least, 1e-300) / (free * bend))
    proven = abs(best) > max(PROVEN * sigma, LEAST * step) and abs(best) < reach
    return (best if proven else 0.0), sigma


def _smooth(field: Floats) -> Floats:
    """(N, 3) moving average; NaN where one of its readings is."""
    total = np.cumsum(np.concatenate([np.zeros((1, 3)), np.nan_to_num(field)]), axis=0)
    gaps = np.cumsum(np.concatenate([[0], ~np.isfinite(field[:, 0])]))
    averaged = np.full(field.shape, np.nan)
    half = SMOOTH // 2
    if len(field) >= SMOOTH:
        means = (total[SMOOTH:] - total[:-SMOOTH]) / SMOOTH
        means[gaps[SMOOTH:] > gaps[:-SMOOTH]] = np.nan
        averaged[half : len(field) - half] = means
    return averaged
