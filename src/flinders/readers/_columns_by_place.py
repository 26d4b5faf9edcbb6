"""Choice of a table's columns without a header: three numbers are x, y and z, and a column that only rises is the time.

>>> chosen = by_place(np.array([[0.0, 20, -3, 41], [0.1, 21, -4, 40], [0.2, 20, -5, 42]]))
>>> chosen.field.names, chosen.time.names
(('2', '3', '4'), ('1',))
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.readers._columns import Column, Columns, column_of
from flinders.readers._likeness import has_clock, is_ascending, is_numeric, only_rises
from flinders.readers._names import FIELD, TIME
from flinders.readers._times import (
    is_clock,
    reason_of_missing_digits,
    reason_of_unknown_unit,
    seconds_and_nanoseconds,
    with_time_factor,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.readers._clock import Clock
    from flinders.readers._devices import Device


def by_place(
    values: Floats, wanted: Sequence[int] = (), clocks: Sequence[Clock] = (), sensor: Device | None = None
) -> Columns | None:
    """Choose columns without a header: three numbers next to a time are x, y and z.

    Of four columns, an ascending first one is the time. A column that only rises is not an axis; next to the `wanted`
    columns it is the time. If a word in each row names the `sensor`, constant columns are not axes either.
    """
    told = {cell for clock in clocks for cell in clock.cells}
    parted = seconds_and_nanoseconds(values)
    told.update(parted)
    free = tuple(place for place in range(values.shape[1]) if place not in told)
    free = tuple(place for place in axes_of(values) if place in free) if sensor else free
    timed = len(free) == 4 and not told and is_ascending(values[:, free[0]])
    field = tuple(wanted) or (free if len(free) == 3 else free[1:] if timed else ())
    if not field or (not wanted and has_clock(values[:, field])):
        return None
    own = column_of(FIELD, field, ())
    time, reason = _time_by_place(values, field, clocks, parted)
    name = " and ".join(time.names) if time else ""
    if reason:
        return Columns(own, left_out=(f"{name} ({reason})",), unread_time=name)
    return Columns(own, auxiliary=(time,) if time else ())


def _time_by_place(
    values: Floats, field: Sequence[int], clocks: Sequence[Clock], parted: Sequence[int]
) -> tuple[Column | None, str]:
    """Time column of a table without a header, and the reason if it cannot be used."""
    if clocks:
        column = replace(column_of(TIME, clocks[0].cells, ()), cells=(clocks[0].cell,), clock=clocks[0])
        times = values[:, clocks[0].cell]
        return with_time_factor(column, "s", times), reason_of_missing_digits(times, "s")
    if parted:
        return with_time_factor(column_of(TIME, parted, ()), "s", values[:, parted[0]]), ""
    place = _clock(values, field)
    if place is None:
        return None, ""
    times = values[:, place]
    return with_time_factor(column_of(TIME, [place], ()), "", times), reason_of_unknown_unit(
        times, "", values[:, field]
    )


def axes_of(values: Floats) -> list[int]:
    """Places of unnamed columns that may be an axis: they are numeric, they change, and they do not only rise."""
    changing = [place for place, column in enumerate(values.T) if is_numeric(column) and len(np.unique(column)) > 1]
    return [place for place in changing if not only_rises(values[:, place])]


def _clock(values: Floats, field: Sequence[int]) -> int | None:
    """Place of the time without a header: an ascending column that is not a counter, else an ascending first column."""
    free = [place for place in range(values.shape[1]) if place not in field]
    clocks = [place for place in free if is_clock(values[:, place])]
    return next(iter([*clocks, *(place for place in free if place == 0 and is_ascending(values[:, place]))]), None)
