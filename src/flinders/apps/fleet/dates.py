"""Dates of recordings, by their clocks or in their names, and the order of the recordings of a unit.

A recording has a date if its clock counts from 1970. A clock that counts from power-on does not order recordings:
they are ordered by ISO 8601 dates in their names if all recordings of the unit have one, or by name if none has one.

>>> date_of("V101/2026-01-10T12-30-05.csv") - date_of("20260110.ulg")
45005.0
>>> date_of("flight 12"), date_of("03-04-2026.csv")
(nan, nan)
>>> names = ["run 10", "run 9", "run 11"]
>>> arrange(names, np.array([3.0, 900.0, 400.0]))                          # seconds since power-on are no order
Arrangement(places=[1, 0, 2], date_s=[nan, nan, nan], is_known=True)
>>> arrange(["after", "2026-01-10", "before"], np.full(3, np.nan)).is_known
False
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._times import EPOCHS, MIN_EPOCH_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

MAX_DATE_S: Final = 4.0 * EPOCHS[-1][0]
"""Largest time, in seconds since 1970, that is a date."""
ISO_DATE: Final = re.compile(
    r"(?<!\d)(?P<day>(?:19[89]|20\d)\d(?P<dash>[-_/]?)\d\d(?P=dash)\d\d)(?!\d)"
    r"(?:(?:(?P<iso>T)|[\s_/-]{1,2})(?P<time>\d\d(?P<colon>[-:_])\d\d(?:(?P=colon)\d\d)?|\d{6}|(?<=T)\d{4})"
    r"(?(iso)(?P<zone>Z|[+-]\d\d:?\d\d)?)(?![-:_+]?\d))?"
)
"""Pattern of a date in ISO 8601 with separators as in file names; further digits may number recordings."""
OTHER_DATE: Final = re.compile(r"(?<!\d)\d{1,2}([-_./])\d{1,2}\1(?:19[89]|20\d)\d(?!\d)")
"""Pattern of a date whose day and month cannot be distinguished, so that it gives no order."""


def is_date(seconds: Floats) -> NDArray[np.bool_]:
    """(n,) whether times count from 1970 and not from power-on; False for NaN."""
    counts: NDArray[np.bool_] = (seconds > MIN_EPOCH_S) & (seconds < MAX_DATE_S)
    return counts


def date_of(name: str) -> float:
    """Seconds since 1970 of the date in a recording's name, at midnight without a time of day; or NaN."""
    date = _date_in(name)
    return date.day_s if math.isnan(date.time_s) else date.time_s


@dataclass(frozen=True, slots=True)
class _NameDate:
    """Date in a name: midnight of the day and the time, both in s since 1970 or NaN."""

    day_s: float = math.nan
    time_s: float = math.nan
    has_time: bool = False  # digits like a time of day follow the date; they may be no time, as 00-62


@lru_cache(maxsize=65_536)
def _date_in(name: str) -> _NameDate:
    """Find date and time of day in a name."""
    for match in ISO_DATE.finditer(name):
        day, time = (re.sub(r"\D", "", match[part] or "") for part in ("day", "time"))
        day_s = _seconds(day)
        if math.isfinite(day_s):
            return _NameDate(day_s, _seconds(f"{day}T{time}{match['zone'] or ''}"), bool(time))
    return _NameDate()


def _seconds(text: str) -> float:
    """Seconds since 1970 of a time in ISO 8601, in UTC unless it names a zone; NaN if there is no such time."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return math.nan
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Order of the recordings of one unit."""

    places: list[int]  # indices of the recordings in order; by name if the order is not known
    date_s: list[float]  # s, of each, in that order; NaN if it is not known
    is_known: bool  # whether the order is known

    @property
    def is_dated(self) -> bool:
        """Whether all dates are known."""
        return self.is_known and not any(map(math.isnan, self.date_s))


def arrange(names: Sequence[str], start_s: Floats, tables: Sequence[int] | None = None) -> Arrangement:
    """Order the n recordings of one unit by their names, (n,) start times, and numbers of their tables.

    By their clocks if all have dates, else by the dates in their names if all have one, else by name if none has a
    date. Recordings of one date are ordered by name, and equal names by their tables. Otherwise the order is not known.
    """
    keys = list(zip(map(_natural_key, names), tables or [0] * len(names), strict=True))
    has_clock = is_date(start_s)
    dates, is_known = (start_s.tolist(), True) if has_clock.all() else _dates_in(names)
    is_known = is_known and not (has_clock.any() and math.isnan(math.fsum(dates)))
    order = [(0.0 if math.isnan(date) else date, key) for date, key in zip(dates, keys, strict=True)]
    places = sorted(range(len(names)), key=order.__getitem__)
    clocks = start_s[places][has_clock[places]]
    if not (is_known and len(set(order)) == len(order) and (np.diff(clocks) >= 0.0).all()):
        is_known, places = False, sorted(range(len(names)), key=keys.__getitem__)
    return Arrangement(places, [dates[place] for place in places], is_known)


def _dates_in(names: Sequence[str]) -> tuple[list[float], bool]:
    """Dates in names, and whether they give an order: either all names have a date, or none has."""
    each = [_date_in(name) for name in names]
    # digits after a date are times of day if all names allow it; else they number recordings
    are_times = all(math.isfinite(date.time_s) for date in each if date.has_time)
    dates = [date.time_s if are_times and date.has_time else date.day_s for date in each]
    if all(map(math.isnan, dates)):
        return dates, not any(map(OTHER_DATE.search, names))
    days_with_time = {date.day_s for date in each if are_times and date.has_time}
    days_alone = {date.day_s for date in each if not (are_times and date.has_time)}
    return dates, not any(map(math.isnan, dates)) and not days_with_time & days_alone


def _natural_key(name: str) -> tuple[str | int, ...]:
    """Key of natural sorting: ``run 9`` before ``run 10``."""
    return tuple(int(part) if place % 2 else part.casefold() for place, part in enumerate(re.split(r"(\d+)", name)))
