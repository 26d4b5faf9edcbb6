"""Placement of header names over columns, if there are more names than columns or fewer.

An unnamed column, a missing name, or a value of two words shifts the names behind it. Names are placed so that they fit
the values: a time rises; the axes of a magnetometer are numbers of one format that change and do not only rise. If two
places are possible for the magnetometer, no placement is used.

>>> tumble = 45 * np.random.default_rng(1).normal(size=(50, 3))
>>> clock = np.arange(50.0)[:, np.newaxis]
>>> place_names(["mx", "my", "mz"], np.hstack([clock, tumble]))
['', 'mx', 'my', 'mz']
>>> place_names(["t", "mx", "my", "mz"], np.hstack([clock, tumble, 0 * clock]))
['t', 'mx', 'my', 'mz', '']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._instruments import magnetometers
from flinders.readers._likeness import choose_magnetometer, is_ascending, is_no_axis
from flinders.readers._names import ACCELERATION, FIELD, RATE, TIME, is_letter_of_time, meaning

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from flinders.arrays import Floats
    from flinders.readers._clock import Clock

AXIS_PENALTY: Final = 10  # penalty for an axis whose values cannot be one, and for a missing magnetometer
TIME_PENALTY: Final = 3  # penalty for a time that does not rise


def place_names(
    names: Sequence[str], values: Floats, clocks: Sequence[Clock] = (), wanted: Collection[str] = ()
) -> list[str]:
    """One name for each column, empty if it has none; an empty list if the values allow several placements.

    `wanted` are the names of requested columns; they take the part of a magnetometer's names.
    """
    width = values.shape[1]
    told = {cell for clock in clocks for cell in clock.cells}
    places: dict[tuple[int, ...], tuple[int, list[str]]] = {}
    for header in _headers(names, width):
        cells = _field(header, wanted)
        weight = _penalty(header, values, cells, told)
        if cells and weight <= places.get(cells, (AXIS_PENALTY - 1,))[0]:
            places[cells] = weight, header
    least = min((weight for weight, _ in places.values()), default=AXIS_PENALTY)
    best = {cells: header for cells, (weight, header) in places.items() if weight == least}
    chosen = choose_magnetometer(values, list(best)) if len(best) > 1 else next(iter(best), None)
    return best[chosen] if chosen else []


def _headers(names: Sequence[str], width: int) -> list[list[str]]:
    """All placements that skip columns, or names, at one place; the last aligns the names to the left."""
    over = width - len(names)
    if over > 0:
        return [[*names[:at], *[""] * over, *names[at:]] for at in range(len(names) + 1)]
    return [[*names[:at], *names[at - over :]] for at in range(width + 1)]


def _field(header: Sequence[str], wanted: Collection[str]) -> tuple[int, ...]:
    """Places of the requested names; without a request, of the first magnetometer's names."""
    if wanted:
        cells = tuple(place for place, name in enumerate(header) if name and name.casefold() in wanted)
        return cells if len(cells) == len(wanted) else ()
    sensors = magnetometers(header)
    return sensors[0].cells if sensors else ()


def _penalty(header: Sequence[str], values: Floats, field: Sequence[int], told: Collection[int]) -> int:
    """Penalty for values that contradict the names; 0 if none does."""
    doubts = sum(AXIS_PENALTY for place in field if place in told or is_no_axis(values[:, place]))
    doubts += TIME_PENALTY * (max(field, default=0) - min(field, default=0) >= len(field))
    timed = False
    for place, name in enumerate(header):
        kind = meaning(name).kind if name and place not in field else ""
        column = values[:, place]
        if kind in (FIELD, ACCELERATION, RATE) and np.isnan(column).mean() > 0.5:
            doubts += 1
        elif kind == TIME and not is_letter_of_time(name):
            timed = True
            doubts += 0 if place in told else _time_penalty(column)
        elif kind == TIME:
            timed = True
            doubts += 0 if place in told else min(_time_penalty(column), 1)
    return doubts + (not timed)


def _time_penalty(column: Floats) -> int:
    """Penalty for a column that is named a time: a time must rise and must not count rows."""
    if not is_ascending(column):
        return TIME_PENALTY
    return int(set(np.diff(column[np.isfinite(column)])) == {1.0})
