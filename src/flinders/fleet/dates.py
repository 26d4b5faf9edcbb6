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
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np  # noqa: TC002 - examples use it

from flinders.readers._columns import EPOCHS, LONG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

    _Turn = tuple[tuple[str | int, ...], int]

LATEST: Final = 4.0 * EPOCHS[-1][0]
"""Seconds since 1970 after which a time is no date."""
DAY: Final = 86400.0
YEAR_FIRST: Final = re.compile(
    r"(?<!\d)(?P<year>(?:19[89]|20\d)\d)(?P<dash>[-_./]?)(?P<month>0[1-9]|1[0-2])(?P=dash)"
    r"(?P<day>0[1-9]|[12]\d|3[01])"
    r"(?P<rest>(?:(?P<iso>T)|[\s_/-]{1,2}|(?P<attached>(?<=\d{8})(?=\d{6})))"
    r"(?:(?P<short>\d\d(?P<colon>[-:_h])\d\d(?!(?P=colon)\d)|(?<=T)\d{4})"
    r"|(?P<long>\d\d(?P<mark>[-:_h])\d\d(?P=mark)\d\d(?!(?P=mark)\d)|\d{6})(?P<fraction>[.,]\d{3,9}|\d{3}|\d{6})?)"
    r"(?P<zone>\s?(?:Z|[+-](?:[01]\d):[0-5]\d|(?(iso)-|(?!))(?:[01]\d)[0-5]\d|\+(?:[01]\d)[0-5]\d))?)?(?!\d)"
)
"""ISO 8601, with what file names have in place of its signs.

A time of day is ``HH-MM`` or ``HH-MM-SS`` with any of ``-:_h``, or six digits; four only after a ``T``. Other digits
after a date may as well count recordings.
"""
DAY_FIRST: Final = re.compile(r"(?<!\d)(\d{1,2})([-_./])(\d{1,2})\2((?:19[89]|20\d)\d)(?!\d)")
"""A year at the end: with dots the day goes before the month, otherwise numbers have to tell."""


def is_date(seconds: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(n,) whether times count from 1970, and not from where a sensor was switched on; NaN does not."""
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]] = (seconds > LONG) & (seconds < LATEST)
    return counts


def date_of(name: str) -> float:
    """Seconds since 1970 of the date in a recording's name, at its midnight where no time of day follows; or NaN."""
    return _named(name).mark(is_time=True).date_s


@lru_cache(maxsize=65_536)
def is_unclear(name: str) -> bool:
    """Tell whether a name has a date of which day and month cannot be told apart."""
    found = DAY_FIRST.search(name)
    if found is None or found[2] == "." or YEAR_FIRST.search(name):
        return False
    return int(found[1]) <= 12 and int(found[3]) <= 12 and int(found[1]) != int(found[3])


@dataclass(frozen=True, slots=True)
class _Mark:
    """When a recording was made.

    Attributes
    ----------
    date_s : float, s
        Since 1970, at midnight where the day alone is known; NaN where nothing is.
    kind : str
        Whether that is an ``instant`` of a known zone, a ``time`` of any, or a ``day``.
    name, rest : str
        The name, and what it has beside the time of day.
    """

    date_s: float
    kind: str
    name: str
    rest: str


@dataclass(frozen=True, slots=True)
class _Named:
    """What a name tells.

    Attributes
    ----------
    name, rest : str
        The name, and what it has beside what may be a time of day.
    day_s : float, s
        Midnight of its date since 1970; NaN without one.
    time_s : float, s
        From there; NaN where there are no digits like a time of day, or where they are none, as ``00-62``.
    kind : str
        Of a mark with that time.
    is_attached : bool
        Whether those digits follow the date without anything between: then they are a time, or there is no date.
    """

    name: str
    rest: str
    day_s: float = math.nan
    time_s: float = math.nan
    kind: str = "time"
    is_attached: bool = False

    @property
    def has_time(self) -> bool:
        """Whether digits like a time of day follow the date."""
        return self.rest != self.name

    def mark(self, *, is_time: bool) -> _Mark:
        """When that is, if such digits are a time of day, or else number recordings."""
        if self.has_time and is_time and math.isfinite(self.time_s):
            return _Mark(self.day_s + self.time_s, self.kind, self.name, self.rest)
        return _Mark(math.nan if self.is_attached else self.day_s, "day", self.name, self.name)


@lru_cache(maxsize=65_536)
def _named(name: str) -> _Named:
    for found in YEAR_FIRST.finditer(name):
        day_s = _midnight(*(int(found[part]) for part in ("year", "month", "day")))
        if math.isfinite(day_s):
            rest = name[: found.start("rest")] + name[found.end("rest") :] if found["rest"] else name
            kind = "instant" if found["zone"] else "time"
            return _Named(name, rest, day_s, _time_of_day(found), kind, found["attached"] is not None)
    day_last = DAY_FIRST.search(name)
    if day_last is None or is_unclear(name):
        return _Named(name, name)
    day, month, year = int(day_last[1]), int(day_last[3]), int(day_last[4])
    if day_last[2] != "." and month > 12:
        day, month = month, day
    return _Named(name, name, _midnight(year, month, day))


def _time_of_day(found: re.Match[str]) -> float:
    """Seconds since midnight in Greenwich where a zone is told, else of the place; NaN for what is no time."""
    digits = re.sub(r"\D", "", found["long"] or found["short"] or "")
    hour, minute, second = (int(digits[place : place + 2] or 0) for place in (0, 2, 4))
    if not digits or hour > 23 or minute > 59 or second > 59:
        return math.nan
    fraction, zone = re.sub(r"\D", "", found["fraction"] or ""), re.sub(r"\D", "", found["zone"] or "")
    east = 60.0 * (60 * int(zone[:2] or 0) + int(zone[2:] or 0))
    if "-" in (found["zone"] or ""):
        east = -east
    return 3600.0 * hour + 60.0 * minute + second + float(f"0.{fraction or 0}") - east


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

    Dates go first: of the clock, else in the name. Digits after the date are a time of day if all names that have
    such digits tell one, and otherwise number recordings. Recordings of one day follow in the order of their names,
    and of equal names in that of the tables that they stand in; without any date all do. Where some have a date and
    others not, or some a time and others of that day none, names tell it if they differ in numbers alone and rise with
    what is known; otherwise nothing does.

    Parameters
    ----------
    names : n str
    start_s : (n,) float
        Of their clocks, whatever these count from.
    tables : n int, optional
        Which table each is of.
    """
    marks = _marks(names, start_s)
    turns = list(zip(map(_natural, names), tables or [0] * len(names), strict=True))
    undated = [math.isnan(mark.date_s) for mark in marks]
    if not any(undated):
        groups = [_in_group(group, marks, turns) for group in _groups(marks)]
        places, is_known = [place for group, _ in groups for place in group], all(told for _, told in groups)
    else:
        places = sorted(range(len(names)), key=turns.__getitem__)
        is_known = len(set(turns)) == len(turns) and not any(map(is_unclear, names))
        if is_known and not all(undated):
            known = [marks[place].date_s for place in places if not undated[place]]
            is_known = _differ_in_numbers(names) and known == sorted(known)
    if not is_known:
        places = sorted(range(len(names)), key=turns.__getitem__)
    return Arrangement(places, [marks[place].date_s for place in places], is_known)


def _marks(names: Sequence[str], start_s: Floats) -> list[_Mark]:
    """When each was made, as its clock tells, else its name."""
    told = [_named(name) for name in names]
    is_time = all(math.isfinite(name.time_s) for name in told if name.has_time)
    by_name = [name.mark(is_time=is_time) for name in told]
    clock = zip(start_s.tolist(), is_date(start_s).tolist(), by_name, strict=True)
    return [replace(mark, date_s=start, kind="instant") if counts else mark for start, counts, mark in clock]


def _groups(marks: Sequence[_Mark]) -> list[list[int]]:
    """Places of recordings that dates alone need not tell apart, group by group; each group is surely the earlier.

    A day may be any hour of it, and against an instant the name of any place is uncertain by a day.
    """
    zone = DAY if len({mark.kind == "instant" for mark in marks}) == 2 else 0.0
    spans = []
    for mark in marks:
        slack = 0.0 if mark.kind == "instant" else zone
        length = slack or (math.nextafter(DAY, 0.0) if mark.kind == "day" else 0.0)
        spans.append((mark.date_s - slack, mark.date_s + length))
    groups: list[list[int]] = []
    latest = -math.inf
    for place in sorted(range(len(marks)), key=spans.__getitem__):
        if spans[place][0] > latest:
            groups.append([])
        groups[-1].append(place)
        latest = max(latest, spans[place][1])
    return groups


def _in_group(group: list[int], marks: Sequence[_Mark], turns: Sequence[_Turn]) -> tuple[list[int], bool]:
    """Put recordings in order that have dates close together, and tell whether that is known."""
    kinds = {marks[place].kind for place in group}
    if len(kinds) == 1:
        keys = {place: (marks[place].date_s, turns[place]) for place in group}
        return sorted(group, key=keys.__getitem__), len(set(keys.values())) == len(group)
    has_times = all(marks[place].name != marks[place].rest for place in group)
    names = {place: marks[place].name if has_times else marks[place].rest for place in group}
    ordered = sorted(group, key=lambda place: _natural(names[place]))
    is_told = len(set(map(_natural, names.values()))) == len(group) and _differ_in_numbers(list(names.values()))
    dates = [[marks[place].date_s for place in ordered if marks[place].kind == kind] for kind in kinds]
    return ordered, is_told and all(those == sorted(those) for those in dates)


def _differ_in_numbers(names: Sequence[str]) -> bool:
    """Whether names are alike but for their numbers."""
    return len({re.sub(r"\d+", "0", name) for name in names}) == 1


def _natural(name: str) -> tuple[str | int, ...]:
    """By which names sort as people count: ``run 9`` before ``run 10``."""
    return tuple(int(part) if place % 2 else part.casefold() for place, part in enumerate(re.split(r"(\d+)", name)))
