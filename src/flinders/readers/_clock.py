"""The clock of a table: what its numbers count, from when on, and whether they were written with enough digits.

>>> seconds(np.array([1.7e12, 1.7e12 + 20]), "")  # ms since 1970
(0.001, 1700000000000.0)
>>> seconds(np.array([0.0, 20.0]), ""), seconds(np.array([0.0, 0.02]), "s")
((0.001, 0.0), (1.0, 0.0))
"""

from __future__ import annotations

from decimal import Decimal
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._names import FACTORS, TIME

if TYPE_CHECKING:
    from flinders.arrays import Floats

# From which value on a time counts from 1970, in ns, µs, ms and s; four times it is the year 2096.
EPOCHS: Final = ((1e18, 1e-9), (1e15, 1e-6), (1e12, 1e-3), (1e9, 1.0))
LONG: Final = 1e8  # seconds after which a time is taken to count from 1970 and not from the start of the recording
COARSE: Final = 10  # readings to one time from which on its digits are too few: buffers of sensors give a few at once
COARSE_S: Final = 1.0  # resolution from which on a time that never changes is cut, and its clock not at rest


def seconds(values: Floats, unit: str) -> tuple[float, float]:
    """Find the factor from (N,) times to seconds, and where a clock that counts from 1970 starts."""
    values = values[np.isfinite(values)]
    first = float(values[0]) if len(values) else 0.0
    factor = _factor_to_seconds(values, unit)
    return factor, first if abs(first) * factor > LONG else 0.0


@np.errstate(over="ignore")
def cut_digits(values: Floats, unit: str) -> str:
    """Say that a time was written with too few digits: many readings share each, and the next is one digit later."""
    values = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(values)) + 1
    runs = np.diff([0, *changes, len(values)])
    inside = runs[1:-1] if len(runs) > 2 else runs  # the first and the last may go on
    if len(values) < 2 * COARSE or np.median(inside) < COARSE:
        return ""
    distinct, factor = values[[0, *changes]], _factor_to_seconds(values, unit)
    steps = _resolutions(distinct)
    if len(distinct) > 1:
        jump = float(np.min(np.abs(np.diff(distinct))))
        steps = [jump] if any(step / 2 < jump < 2 * step for step in steps) else []
    else:
        steps = [step for step in steps if step * factor >= COARSE_S]
    many = f"{np.median(inside):.0f}" if len(runs) > 2 else f"{np.max(runs)} or more"
    reason = "its digits were cut to steps of {:.3g} s, {} readings to each: write more of them, as float64"
    return reason.format(max(steps) * factor, many) if steps else ""


def _factor_to_seconds(values: Floats, unit: str) -> float:
    """Factor of a time's stated unit, else a guess from its size, then from its steps of 10 µs to 10 s."""
    if unit:
        return FACTORS[TIME][unit]
    first = float(values[0]) if len(values) else 0.0
    with np.errstate(over="ignore"):  # of numbers that are no times
        step = float(np.median(np.abs(np.diff(values)))) if len(values) > 1 else 0.0
    for least, factor in EPOCHS:
        if least <= first < 4 * least and (step == 0 or 1e-5 <= step * factor <= 10):
            return factor
    return 1.0 if step < 2 else 1e-3 if step < 1e3 else 1e-6 if step < 5e5 else 1e-9


def _resolutions(values: Floats) -> list[float]:
    """Tell which units in the last digit these numbers may have: the last that is written, and that of float32."""
    digits = [Decimal(repr(value)).normalize().as_tuple().exponent for value in values.tolist() if value]
    if not digits:
        return []
    written = 10.0 ** min(map(int, digits))
    single = np.abs(values.astype(np.float32))
    is_single = bool(np.all(single == np.abs(values)))
    return [written, float(np.spacing(single.max()))] if is_single else [written]
