"""Times of a table: the unit of a time column, by its name or values, and reasons why a column is not used as a time.

>>> seconds_and_nanoseconds(np.array([[1.7e9, 9e8, 4], [1.7e9 + 1, 1e8, 5]]))
(0, 1)
>>> field = np.tile([[20.0, 0, 40], [0, 20, 40], [-20, 0, 40], [0, -20, 40]], (3, 1))
>>> reason_of_unknown_unit(np.arange(12.0), "", field)
''
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._likeness import is_ascending
from flinders.readers._names import FACTORS, TIME, is_letter_of_time

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.readers._columns import Column

# Smallest time since 1970 in ns, µs, ms and s, with the factor to s. Four times each value is the year 2096.
EPOCHS: Final = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))
# Readings per time from which times have too few digits; a sensor's buffer gives fewer readings at once
MIN_READINGS_PER_TIME: Final = 10
# Resolution in s from which a constant time lacks digits; with a finer one its clock has stopped
MIN_COARSE_S: Final = 1.0
TEMPERATURES_C: Final = (-60.0, 150.0)  # range of a sensor's temperature
MIN_TIMES: Final = 10  # rows from which on a column is checked for rising
MAX_RESET_SHARE: Final = 0.1  # largest share of backward steps, as when a clock is set back or restarts
REPEAT_TOLERANCE: Final = 0.25  # tolerance of the number of readings per time, relative to its median
FALLING_REASON: Final = "it does not rise like a time"
MAX_RATE_RAD_S: Final = 70.0  # 4000 °/s, the range of gyros; a sensor turned by hand is slower
TURN_LAG_ROWS: Final = 4  # lag in rows at which a rotation has accumulated and noise has not
# smallest ratio of differences at this lag to those between neighbours that shows a rotation
MIN_TURN_RATIO: Final = 2.0
MIN_EPOCH_S: Final = 1e8  # s; larger times count from 1970, not from the start of the recording


def seconds_and_nanoseconds(values: Floats) -> tuple[int, ...]:
    """Places of a column of whole seconds since 1970 and of the next column with nanoseconds; empty if there is none.

    >>> seconds_and_nanoseconds(np.array([[1.7e9, 9e8, 4], [1.7e9 + 1, 1e8, 5]]))
    (0, 1)
    """
    for place, (whole, part) in enumerate(pairwise(values.T)):
        is_whole = (
            np.isfinite([whole, part]).all() and (whole == np.floor(whole)).all() and (part == np.floor(part)).all()
        )
        if is_whole and EPOCHS[-1][0] <= whole.min() and whole.max() < 4 * EPOCHS[-1][0]:
            is_part = part.min() >= 0 and 1e6 <= part.max() < 1e9
            if is_part and is_ascending((whole - whole[0]) + 1e-9 * part):
                return place, place + 1
    return ()


def is_clock(column: Floats) -> bool:
    """Whether an unnamed column ascends and is not a row counter."""
    return is_ascending(column) and set(np.diff(column[np.isfinite(column)])) != {1.0}


def with_time_factor(column: Column, unit: str, values: Floats) -> Column:
    """Time column with its factor to seconds, and with its start if the clock counts from 1970."""
    values = values[np.isfinite(values)]
    first = float(values[0]) if len(values) else 0.0
    factor = _factor_to_seconds(values, unit)
    return replace(column, factor=factor, start=first if abs(first) * factor > MIN_EPOCH_S else 0.0)


@np.errstate(over="ignore")
def reason_of_missing_digits(values: Floats, unit: str) -> str:
    """Reason if a time lacks digits: many readings share one time, and times rise by one unit of the last digit."""
    values = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(values)) + 1
    runs = np.diff([0, *changes, len(values)])
    inside = runs[1:-1] if len(runs) > 2 else runs  # the first and the last may be incomplete
    if len(values) < 2 * MIN_READINGS_PER_TIME or np.median(inside) < MIN_READINGS_PER_TIME:
        return ""
    distinct, factor = values[[0, *changes]], _factor_to_seconds(values, unit)
    steps = _resolutions(distinct)
    if len(distinct) > 1:
        jump = float(np.min(np.abs(np.diff(distinct))))
        steps = [jump] if any(step / 2 < jump < 2 * step for step in steps) else []
    else:
        steps = [step for step in steps if step * factor >= MIN_COARSE_S]
    many = f"{np.median(inside):.0f}" if len(runs) > 2 else f"{np.max(runs)} or more"
    reason = "its digits were cut to steps of {:.3g} s, {} readings to each: write more of them, as float64"
    return reason.format(max(steps) * factor, many) if steps else ""


@np.errstate(over="ignore", invalid="ignore")
def reason_of_unknown_unit(values: Floats, unit: str, field: Floats) -> str:
    """Reason if the unit of a time is unknown: with the most likely unit, the sensor would turn too fast."""
    known = np.isfinite(values) & np.isfinite(field).all(axis=1)
    times, read = values[known], field[known]
    if unit or len(times) < MIN_TIMES:
        return ""
    step = float(np.median(np.diff(times))) * _factor_to_seconds(times, unit)
    near, far = (float(np.median(np.linalg.norm(read[lag:] - read[:-lag], axis=1))) for lag in (1, TURN_LAG_ROWS))
    radius = float(np.ptp(read, axis=0).max()) / 2
    if step <= 0 or far <= MIN_TURN_RATIO * near or near <= MAX_RATE_RAD_S * step * radius:
        return ""
    fast = f"at steps of {step:.3g} s the sensor would turn at {near / radius / step:,.0f} rad/s"
    return f"its unit is unknown, and {fast}: put the unit into the name, such as t_ms"


def reason_of_falling(name: str, unit: str, values: Floats) -> str:
    """Reason if a column falls or alternates, which no time does; a ``T`` must not be constant either.

    A name with a unit of time is always accepted, as the rows of a fleet may be in any order.
    """
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    falling = np.count_nonzero(steps < 0)
    is_none = not unit and falling > 1 and 2 * falling > np.count_nonzero(steps > 0)
    if len(values) >= MIN_TIMES and (is_none or (is_letter_of_time(name) and not _rises(values))):
        return FALLING_REASON
    return ""


def _rises(values: Floats) -> bool:
    """Whether finite numbers rise like those of a clock, with a regular number of readings per time."""
    steps = np.diff(values)
    changes = np.flatnonzero(steps)
    if len(changes) == 0:
        return bool(values[0] == 0.0 or values[0] > MIN_EPOCH_S)  # a clock at rest, or one that lacks digits
    runs = np.diff(changes)  # readings per value, without the first and the last
    if len(runs) == 0 or np.mean(steps[changes] < 0) > MAX_RESET_SHARE:
        return False
    usual = float(np.median(runs))
    return bool(np.mean(np.abs(runs - usual) <= max(1.0, REPEAT_TOLERANCE * usual)) >= 1 - MAX_RESET_SHARE)


def is_temperature(values: Floats) -> bool:
    """Whether a column ``T`` is a temperature in °C: within the range of one, and not rising like a clock."""
    values = values[np.isfinite(values)]
    is_warm = (TEMPERATURES_C[0] <= values) & (values <= TEMPERATURES_C[1])
    return len(values) >= MIN_TIMES and bool(is_warm.all()) and not _rises(values)


def _factor_to_seconds(values: Floats, unit: str) -> float:
    """Factor to seconds: that of the stated unit; else a guess from the size, and from steps of 10 µs to 10 s."""
    if unit:
        return FACTORS[TIME][unit]
    first = float(values[0]) if len(values) else 0.0
    with np.errstate(over="ignore"):  # of numbers that are not times
        step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    for least, factor in EPOCHS:
        if least <= first < 4 * least and (step == 0 or 1e-5 <= step * factor <= 10):
            return factor
    return 1.0 if step < 2 else 1e-3 if step < 1e3 else 1e-6 if step < 5e5 else 1e-9


def _resolutions(values: Floats) -> list[float]:
    """Possible values of the last digit of these numbers: by the decimals that were written, and by float32."""
    digits = [Decimal(repr(value)).normalize().as_tuple().exponent for value in values.tolist() if value]
    if not digits:
        return []
    written = 10.0 ** min(map(int, digits))
    single = np.abs(values.astype(np.float32))
    is_single = bool(np.all(single == np.abs(values)))
    return [written, float(np.spacing(single.max()))] if is_single else [written]
