"""When the recordings of a unit were made, and in what order, as far as anything tells.

A recording knows its date where its times count from 1970. Times that count from where a sensor was switched on say
nothing of which recording came first, and nothing is made of them: then the date that stands in the recording's name
is taken, and where there is none the order of the names, which knows no days between recordings.

>>> date_of("V101/2026-01-10T12-30-05.csv") - date_of("20260110.ulg")
45005.0
>>> date_of("flight 12"), is_unclear("03-04-2026.csv")
(nan, True)
>>> names = ["run 10", "run 9", "run 11"]
>>> arranged(names, np.array([3.0, 900.0, 400.0]))                          # seconds since a boot tell no order
Arrangement(places=[1, 0, 2], date_s=[nan, nan, nan], is_known=True)
>>> arranged(["after", "2026-01-10", "before"], np.full(3, np.nan)).is_known
False
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np  # noqa: TC002 - examples use it

from flinders.readers._columns import EPOCHS, LONG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

LATEST: Final = 4.0 * EPOCHS[-1][0]
"""Seconds since 1970 after which a time is no date."""
DAY: Final = 86400.0
YEAR_FIRST: Final = re.compile(
    r"(?<!\d)(?P<year>(?:19[89]|20\d)\d)(?P<dash>[-_./]?)(?P<month>0[1-9]|1[0-2])(?P=dash)"
    r"(?P<day>0[1-9]|[12]\d|3[01])"
    r"(?:(?:[T\s_./-]{1,2}|(?<=\d{8})(?=\d{4}))"
    r"(?P<hour>[01]\d|2[0-3])(?P<colon>[-:_.h]?)(?P<minute>[0-5]\d)"
    r"(?:(?P=colon)(?P<second>[0-5]\d)(?:[.,]?(?P<fraction>\d{1,9}))?)?"
    r"\s?(?:Z|(?P<zone>[+-])(?P<zone_hour>[01]\d):?(?P<zone_minute>[0-5]\d))?)?(?!\d)"
)
"""ISO 8601, with what file names have in place of its signs."""
DAY_FIRST: Final = re.compile(r"(?<!\d)(\d{1,2})([-_./])(\d{1,2})\2((?:19[89]|20\d)\d)(?!\d)")
"""A year at the end: with dots the day goes before the month, otherwise numbers have to tell."""


def is_date(seconds: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(n,) whether times count from 1970, and not from where a sensor was switched on; NaN does not."""
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]] = (seconds > LONG) & (seconds < LATEST)
    return counts


@lru_cache(maxsize=65_536)
def date_of(name: str) -> float:
    """Seconds since 1970 of the date in a recording's name, at its midnight where no time of day follows; or NaN."""
    for found in YEAR_FIRST.finditer(name):
        seconds = _seconds(found)
        if math.isfinite(seconds):
            return seconds
    named = DAY_FIRST.search(name)
    if named is None or is_unclear(name):
        return math.nan
    day, month, year = int(named[1]), int(named[3]), int(named[4])
    if named[2] != "." and month > 12:
        day, month = month, day
    return _midnight(year, month, day)


@lru_cache(maxsize=65_536)
def is_unclear(name: str) -> bool:
    """Tell whether a name has a date of which day and month cannot be told apart."""
    found = DAY_FIRST.search(name)
    if found is None or found[2] == "." or YEAR_FIRST.search(name):
        return False
    return int(found[1]) <= 12 and int(found[3]) <= 12 and int(found[1]) != int(found[3])


def _seconds(found: re.Match[str]) -> float:
    midnight = _midnight(*(int(found[part]) for part in ("year", "month", "day")))
    hour, minute, second = (int(found[part] or 0) for part in ("hour", "minute", "second"))
    east = int(found["zone_hour"] or 0) * 3600.0 + int(found["zone_minute"] or 0) * 60.0
    if found["zone"] == "-":
        east = -east
    return midnight + 3600.0 * hour + 60.0 * minute + second + float(f"0.{found['fraction'] or 0}") - east


def _midnight(year: int, month: int, day: int) -> float:
    """Seconds since 1970, NaN for a day that there is not."""
    try:
        return datetime(year, month, day, tzinfo=UTC).timestamp()
    except ValueError:
        return math.nan


# ------------------------------------------------------------------------------------------------------------- order


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Recordings of one unit, put in order.

    Attributes
    ----------
    places : list of int
        Which comes first, and so on; by name where the order is not known.
    date_s : list of float, s
        Of each, in that order; NaN where no date is known.
    is_known : bool
        Whether something tells the order.
    """

    places: list[int]
    date_s: list[float]
    is_known: bool

    @property
    def is_dated(self) -> bool:
        """Whether the days between all of them are known."""
        return self.is_known and not any(map(math.isnan, self.date_s))


def arranged(names: Sequence[str], start_s: Floats, tables: Sequence[int] | None = None) -> Arrangement:
    """Put the recordings of one unit in order.

    Dates go first: of the clock, else in the name. Without any the names tell, and of equal names the tables that they
    stand in. Where some have a date and others not, names tell it if they differ in numbers alone and rise with the
    dates that are known; otherwise nothing does.

    Parameters
    ----------
    names : n str
    start_s : (n,) float
        Of their clocks, whatever these count from.
    tables : n int, optional
        Which table each is of.
    """
    clock = is_date(start_s)
    dates = [float(start) if told else date_of(name) for name, start, told in zip(names, start_s, clock, strict=True)]
    turns = list(zip(map(_natural, names), tables or [0] * len(names), strict=True))
    undated = [math.isnan(date) for date in dates]
    if not any(undated):
        places = sorted(range(len(names)), key=lambda place: (dates[place], turns[place]))
        is_known = all(_told_apart(dates, turns, clock, pair) for pair in pairwise(places))
    else:
        places = sorted(range(len(names)), key=turns.__getitem__)
        is_known = len(set(turns)) == len(turns) and not any(map(is_unclear, names))
        if is_known and not all(undated):
            known = [dates[place] for place in places if not undated[place]]
            is_known = len({re.sub(r"\d+", "0", name) for name in names}) == 1 and known == sorted(known)
    return Arrangement(places, [dates[place] for place in places], is_known)


def _natural(name: str) -> tuple[str | int, ...]:
    """By which names sort as people count: ``run 9`` before ``run 10``."""
    return tuple(int(part) if place % 2 else part.casefold() for place, part in enumerate(re.split(r"(\d+)", name)))


def _told_apart(
    dates: Sequence[float],
    turns: Sequence[tuple[tuple[str | int, ...], int]],
    clock: np.ndarray[tuple[int], np.dtype[np.bool_]],
    pair: tuple[int, int],
) -> bool:
    """Whether the first of a pair of dated recordings surely is the earlier; a name's day may be any hour of it."""
    first, second = pair
    if dates[first] < dates[second] - DAY or turns[first] < turns[second]:
        return True
    return dates[first] < dates[second] and bool(clock[first] == clock[second])
