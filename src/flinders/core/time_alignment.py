"""Readings of several sensors at common times, with the delay of each sensor's clock.

The slowest sensor determines the times. Readings of the others are interpolated linearly, and left out in gaps. The
time stamps of sensors in one log may have different delays. The delay δ between two sensors is the shift at which an
affine map M, c of one fits the other best,

    min over δ, M, c   Σ |x(tₖ + δ) − M y(tₖ) − c|²

The map is affine because no calibration is known yet. Both sensors are smoothed alike first: interpolation between two
readings reduces their noise, which would favour a shift by half a step. A delay is used only if it exceeds many times
its standard deviation.

>>> time = np.arange(0.0, 30.0, 0.1)
>>> turning = lambda t: np.stack([np.sin(t), np.cos(1.3 * t), np.sin(0.7 * t)], axis=1)
>>> found = align_readings([time, time], [turning(time), 2.0 * turning(time - 0.25)])
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

MAX_DELAY_S: Final = 2.0
"""Largest delay that is searched, in s, of either sign."""

MAX_GAP_INTERVALS: Final = 3.0
"""Largest gap, in median intervals of the readings, across which readings are interpolated."""

SMOOTHED_READINGS: Final = 5
"""Width in readings of the moving average before shifts are compared."""

MIN_DELAY_SIGMAS: Final = 6.0
"""Smallest delay that is used, in standard deviations."""

MIN_DELAY_STEPS: Final = 0.1
"""Smallest delay that is used, in intervals between the common times."""

MAX_TIMES: Final = 4000
"""Largest number of times at which a delay is estimated."""

MIN_TIMES: Final = 50
"""Smallest number of times from which a delay is estimated."""


@dataclass(frozen=True, slots=True, eq=False)
class AlignedReadings:
    """Readings of m sensors at N common times."""

    time: Floats  #: (N,), s: by the clock of the reference sensor; row numbers without times
    fields: Floats  #: (m, N, 3): NaN if a sensor has no reading
    delays_s: Floats  #: (m,), s: delay of each sensor behind the reference; 0 if not significant
    delay_sigmas_s: Floats  #: (m,), s: 1 σ of `delays_s`


def align_readings(times: Sequence[Floats], fields: Sequence[Floats], *, reference: int = 0) -> AlignedReadings:
    """Interpolate readings to common times at which two sensors or more have a reading.

    Parameters
    ----------
    times : sequence of (N,) float, s
        Times of each sensor, ascending; lengths may differ.
    fields : sequence of (N, 3) float
        Readings of each sensor.
    reference : int
        Index of the sensor whose clock is used.
    """
    delays, sigmas = np.zeros(len(times)), np.zeros(len(times))
    for sensor in range(len(times)):
        if sensor != reference:
            delays[sensor], sigmas[sensor] = _delay(times[reference], fields[reference], times[sensor], fields[sensor])
    slowest = min(range(len(times)), key=lambda sensor: (len(times[sensor]), sensor != reference))
    moments = times[slowest] - delays[slowest]
    taken = np.stack([
        field if sensor == slowest and not delay else interpolate_readings(time - delay, field, moments)
        for sensor, (time, field, delay) in enumerate(zip(times, fields, delays, strict=True))
    ])  # fmt: skip
    shared = np.isfinite(taken[:, :, 0]).sum(axis=0) > 1
    return AlignedReadings(moments[shared], taken[:, shared], delays, sigmas)


def interpolate_readings(time: Floats, field: Floats, moments: Floats) -> Floats:
    """(K, 3) readings interpolated linearly at (K,) times; NaN outside the recording and in gaps.

    >>> time, field = np.array([0.0, 1.0, 2.0, 9.0]), np.arange(12.0).reshape(4, 3)
    >>> interpolate_readings(time, field, np.array([0.5, 2.0, 5.0]))[:, 0]
    array([1.5, 6. , nan])
    """
    if len(time) < 2:
        return np.full((len(moments), 3), np.nan)
    after = np.clip(np.searchsorted(time, moments, side="left"), 1, len(time) - 1)
    step = time[after] - time[after - 1]
    share = np.where(step > 0.0, (moments - time[after - 1]) / np.where(step > 0.0, step, 1.0), 0.0)
    usual = float(np.median(np.diff(time)))
    exact = np.isclose(share, 0.0, atol=1e-9) | np.isclose(share, 1.0, atol=1e-9)
    outside = (share < -1e-9) | (share > 1.0 + 1e-9) | ((step > MAX_GAP_INTERVALS * usual) & ~exact)
    taken: Floats = field[after - 1] + share[:, np.newaxis] * (field[after] - field[after - 1])
    taken[outside] = np.nan
    return taken


def affine_residuals(source: Floats, target: Floats) -> Floats:
    """(K, 3) residuals of the best affine map from (N, 3) `source` to `target`, at the K rows where both are finite."""
    both = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    design = np.column_stack([source[both], np.ones(np.count_nonzero(both))])
    residuals: Floats = target[both] - design @ np.linalg.lstsq(design, target[both], rcond=None)[0]
    return residuals


def _delay(time: Floats, field: Floats, other_time: Floats, other: Floats) -> tuple[float, float]:
    """Delay of another sensor in s, 0 if not significant, and its standard deviation."""
    first, last = max(time[0], other_time[0]), min(time[-1], other_time[-1])
    step = max(float(np.median(np.diff(time))), float(np.median(np.diff(other_time))))
    if not step > 0.0 or last - first < MIN_TIMES * step:
        return 0.0, math.inf
    moments = np.arange(first, last, max(step, (last - first) / MAX_TIMES))
    still = _smooth(interpolate_readings(time, field, moments))
    reach = min(MAX_DELAY_S, 0.25 * (last - first))

    def misfit(delay: float) -> tuple[float, int]:
        moved = _smooth(interpolate_readings(other_time, other, moments + delay))
        left = affine_residuals(still, moved)
        return (math.inf, 1) if len(left) < MIN_TIMES else (float(np.mean(left**2)), len(left))

    shifts = np.arange(-math.ceil(reach / step), math.ceil(reach / step) + 1) * step
    best = float(shifts[int(np.argmin([misfit(float(shift))[0] for shift in shifts]))])
    width = step
    for _ in range(3):  # minimum of a parabola through three points, which are closer in each step
        low, middle, high = (misfit(best + offset)[0] for offset in (-width, 0.0, width))
        bend = low - 2.0 * middle + high
        if not (np.isfinite(bend) and bend > 0.0):
            break
        best += float(np.clip(0.5 * width * (low - high) / bend, -width, width))
        width /= 2.0
    least, count = misfit(best)
    low, high = misfit(best - step)[0], misfit(best + step)[0]
    bend = (low - 2.0 * least + high) / step**2
    free = 3.0 * count / SMOOTHED_READINGS
    if not (np.isfinite(bend) and bend > 0.0):
        return 0.0, math.inf
    sigma = math.sqrt(2.0 * max(least, 1e-300) / (free * bend))
    proven = abs(best) > max(MIN_DELAY_SIGMAS * sigma, MIN_DELAY_STEPS * step) and abs(best) < reach
    return (best if proven else 0.0), sigma


def _smooth(field: Floats) -> Floats:
    """(N, 3) moving average; NaN if any reading in its window is NaN."""
    total = np.cumsum(np.concatenate([np.zeros((1, 3)), np.nan_to_num(field)]), axis=0)
    gaps = np.cumsum(np.concatenate([[0], ~np.isfinite(field[:, 0])]))
    averaged = np.full(field.shape, np.nan)
    half = SMOOTHED_READINGS // 2
    if len(field) >= SMOOTHED_READINGS:
        means = (total[SMOOTHED_READINGS:] - total[:-SMOOTHED_READINGS]) / SMOOTHED_READINGS
        means[gaps[SMOOTHED_READINGS:] > gaps[:-SMOOTHED_READINGS]] = np.nan
        averaged[half : len(field) - half] = means
    return averaged
