"""Dates of the recordings of a unit, and their order, as far as they are known.

A recording has a date if its times count from 1970. Times that count from power-on do not order recordings, and are not
used: then the date is taken from the recording's name, and without one recordings are ordered by name, without dates.

>>> date_of("V101/2026-01-10T12-30-05.csv") - date_of("20260110.ulg")
45005.0
>>> date_of("flight 12"), is_unclear("03-04-2026.csv")
(nan, True)
>>> names = ["run 10", "run 9", "run 11"]
>>> arranged(names, np.array([3.0, 900.0, 400.0]))                          # seconds since power-on are no order
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

    _NameKey = tuple[tuple[str | int, ...], int]

LATEST: Final = 4.0 * EPOCHS[-1][0]
"""Seconds since 1970 beyond which a time is no date."""
DAY: Final = 86400.0
YEAR_FIRST: Final = re.compile(
    r"(?<!\d)(?P<year>(?:19[89]|20\d)\d)(?P<dash>[-_./]?)(?P<month>0[1-9]|1[0-2])(?P=dash)"
    r"(?P<day>0[1-9]|[12]\d|3[01])"
    r"(?P<rest>(?:(?P<iso>T)|[\s_/-]{1,2}|(?P<attached>(?<=\d{8})(?=\d{6})))"
    r"(?:(?P<short>\d\d(?P<colon>[-:_h])\d\d(?!(?P=colon)\d)|(?<=T)\d{4})"
    r"|(?P<long>\d\d(?P<mark>[-:_h])\d\d(?P=mark)\d\d(?!(?P=mark)\d)|\d{6})(?P<fraction>[.,]\d{3,9}|\d{3}|\d{6})?)"
    r"(?P<zone>\s?(?:Z|[+-](?:[01]\d):[0-5]\d|(?(iso)-|(?!))(?:[01]\d)[0-5]\d|\+(?:[01]\d)[0-5]\d))?)?(?!\d)"
)
"""ISO 8601, with the separators of file names.

A time of day is ``HH-MM`` or ``HH-MM-SS`` with any of ``-:_h``, or six digits; four only after a ``T``. Other digits
after a date may number recordings.
"""
DAY_FIRST: Final = re.compile(r"(?<!\d)(\d{1,2})([-_./])(\d{1,2})\2((?:19[89]|20\d)\d)(?!\d)")
"""Year last: with dots the day comes before the month, otherwise the numbers decide."""


def is_date(seconds: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(n,) whether times count from 1970, and not from power-on; NaN does not."""
    counts: np.ndarray[tuple[int], np.dtype[np.bool_]] = (seconds > LONG) & (seconds < LATEST)
    return counts


def date_of(name: str) -> float:
    """Seconds since 1970 of the date in a recording's name, at midnight without a time of day; or NaN."""
    return _named(name).mark(is_time=True).date_s


@lru_cache(maxsize=65_536)
def is_unclear(name: str) -> bool:
    """Whether a name has a date whose day and month are ambiguous."""
    match = DAY_FIRST.search(name)
    if match is None or match[2] == "." or YEAR_FIRST.search(name):
        return False
    return int(match[1]) <= 12 and int(match[3]) <= 12 and int(match[1]) != int(match[3])


@dataclass(frozen=True, slots=True)
class _Mark:
    """Date of a recording."""

    date_s: float  # s since 1970, at midnight if only the day is known; NaN if nothing is
    kind: str  # an ``instant`` of a known zone, a ``time`` of an unknown one, or a ``day``
    name: str
    rest: str  # the name without the time of day


@dataclass(frozen=True, slots=True)
class _Named:
    """Date and time of day in a name."""

    name: str
    rest: str  # the name without digits that may be a time of day
    day_s: float = math.nan  # s since 1970, midnight of the date; NaN without one
    time_s: float = math.nan  # s from there; NaN without such digits, or if they are no time, as ``00-62``
    kind: str = "time"  # kind of a mark with that time
    is_attached: bool = False  # the digits follow the date directly: they are a time, or there is no date

    @property
    def has_time(self) -> bool:
        """Whether digits like a time of day follow the date."""
        return self.rest != self.name

    def mark(self, *, is_time: bool) -> _Mark:
        """The date, with the time of day if such digits are one and do not number recordings."""
        if self.has_time and is_time and math.isfinite(self.time_s):
            return _Mark(self.day_s + self.time_s, self.kind, self.name, self.rest)
        return _Mark(math.nan if self.is_attached else self.day_s, "day", self.name, self.name)


@lru_cache(maxsize=65_536)
def _named(name: str) -> _Named:
    """Find date and time of day in a name."""
    for match in YEAR_FIRST.finditer(name):
        day_s = _midnight(*(int(match[part]) for part in ("year", "month", "day")))
        if math.isfinite(day_s):
            rest = name[: match.start("rest")] + name[match.end("rest") :] if match["rest"] else name
            kind = "instant" if match["zone"] else "time"
            return _Named(name, rest, day_s, _time_of_day(match), kind, match["attached"] is not None)
    day_last = DAY_FIRST.search(name)
    if day_last is None or is_unclear(name):
        return _Named(name, name)
    day, month, year = int(day_last[1]), int(day_last[3]), int(day_last[4])
    if day_last[2] != "." and month > 12:
        day, month = month, day
    return _Named(name, name, _midnight(year, month, day))


def _time_of_day(match: re.Match[str]) -> float:
    """Seconds since midnight, in UTC if there is a zone, else local; NaN if it is no time."""
    digits = re.sub(r"\D", "", match["long"] or match["short"] or "")
    hour, minute, second = (int(digits[place : place + 2] or 0) for place in (0, 2, 4))
    if not digits or hour > 23 or minute > 59 or second > 59:
        return math.nan
    fraction, zone = re.sub(r"\D", "", match["fraction"] or ""), re.sub(r"\D", "", match["zone"] or "")
    east = 60.0 * (60 * int(zone[:2] or 0) + int(zone[2:] or 0))
    if "-" in (match["zone"] or ""):
        east = -east
    return 3600.0 * hour + 60.0 * minute + second + float(f"0.{fraction or 0}") - east


def _midnight(year: int, month: int, day: int) -> float:
    """Seconds since 1970; NaN if there is no such day."""
    try:
        return datetime(year, month, day, tzinfo=UTC).timestamp()
    except ValueError:
        return math.nan


# ------------------------------------------------------------------------------------------------------------- order


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Order of the recordings of one unit.

    Attributes
    ----------
    places : list of int
        Indices of the recordings in order; by name if the order is not known.
    date_s : list of float, s
        Of each, in that order; NaN if it is not known.
    is_known : bool
        Whether the order is known.
    """

    places: list[int]
    date_s: list[float]
    is_known: bool

    @property
    def is_dated(self) -> bool:
        """Whether all dates are known."""
        return self.is_known and not any(map(math.isnan, self.date_s))


def arranged(names: Sequence[str], start_s: Floats, tables: Sequence[int] | None = None) -> Arrangement:
    """Order the recordings of one unit.

    By date: of the clock, else in the name. Digits after the date are a time of day if that is possible in all names
    with such digits, and otherwise number recordings. Recordings of one day, and all without any date, are ordered by
    name, and equal names by their tables. If some have a date and others not, or some of a day a time and others not,
    names decide if they differ in numbers alone and increase with the known dates; otherwise the order is not known.

    Parameters
    ----------
    names : n str
    start_s : (n,) float
        Of their clocks, from any origin.
    tables : n int, optional
        Number of the table of each.
    """
    marks = _marks(names, start_s)
    name_keys = list(zip(map(_natural, names), tables or [0] * len(names), strict=True))
    undated = [math.isnan(mark.date_s) for mark in marks]
    if not any(undated):
        groups = [_in_group(group, marks, name_keys) for group in _groups(marks)]
        places, is_known = [place for group, _ in groups for place in group], all(known for _, known in groups)
    else:
        places = sorted(range(len(names)), key=name_keys.__getitem__)
        is_known = len(set(name_keys)) == len(name_keys) and not any(map(is_unclear, names))
        if is_known and not all(undated):
            known = [marks[place].date_s for place in places if not undated[place]]
            is_known = _differ_in_numbers(names) and known == sorted(known)
    if not is_known:
        places = sorted(range(len(names)), key=name_keys.__getitem__)
    return Arrangement(places, [marks[place].date_s for place in places], is_known)


def _marks(names: Sequence[str], start_s: Floats) -> list[_Mark]:
    """Date of each, from its clock, else from its name."""
    named = [_named(name) for name in names]
    is_time = all(math.isfinite(each.time_s) for each in named if each.has_time)
    by_name = [each.mark(is_time=is_time) for each in named]
    clock = zip(start_s.tolist(), is_date(start_s).tolist(), by_name, strict=True)
    return [replace(mark, date_s=start, kind="instant") if counts else mark for start, counts, mark in clock]


def _groups(marks: Sequence[_Mark]) -> list[list[int]]:
    """Groups of recordings whose dates overlap, in order: a day lasts 24 h, local time may be off by one."""
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


def _in_group(group: list[int], marks: Sequence[_Mark], name_keys: Sequence[_NameKey]) -> tuple[list[int], bool]:
    """Order recordings whose dates overlap; and whether that order is known."""
    kinds = {marks[place].kind for place in group}
    if len(kinds) == 1:
        keys = {place: (marks[place].date_s, name_keys[place]) for place in group}
        return sorted(group, key=keys.__getitem__), len(set(keys.values())) == len(group)
    has_times = all(marks[place].name != marks[place].rest for place in group)
    names = {place: marks[place].name if has_times else marks[place].rest for place in group}
    ordered = sorted(group, key=lambda place: _natural(names[place]))
    is_known = len(set(map(_natural, names.values()))) == len(group) and _differ_in_numbers(list(names.values()))
    dates = [[marks[place].date_s for place in ordered if marks[place].kind == kind] for kind in kinds]
    return ordered, is_known and all(those == sorted(those) for those in dates)


def _differ_in_numbers(names: Sequence[str]) -> bool:
    """Whether names differ in their numbers alone."""
    return len({re.sub(r"\d+", "0", name) for name in names}) == 1


def _natural(name: str) -> tuple[str | int, ...]:
    """Key of natural sorting: ``run 9`` before ``run 10``."""
    return tuple(int(part) if place % 2 else part.casefold() for place, part in enumerate(re.split(r"(\d+)", name)))
