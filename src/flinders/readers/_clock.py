"""Conversion of dates and times of day to seconds, in cells of a table or in stamps before a line.

The order of day and month is inferred from all cells of a column. A time without a date counts from midnight, and keeps
rising past the next midnight.

>>> clock = Clock.of([["22.11.2026 23:59:59,5"], ["23.11.2026 00:00:00,0"]], (0,))
>>> clock.order, [clock.seconds([text]) for text in ("22.11.2026 23:59:59,5", "Nov 23, 2026 12:00:01 AM", "later")]
('dmy', [1795391999.5, 1795392001.0, nan])
>>> Midnights(Clock((0,), is_dated=False)).unwrap(np.array([86399.5, 0.0, 0.5])).tolist()
[86399.5, 86400.0, 86400.5]
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats

DATE: Final = (
    r"(?:[^\W\d_]{2,9}\.?,?\s+)?"
    r"(?:(?P<first>\d{4}|\d{1,2})(?:[-/.](?P<middle>\d{1,2})[-/.]|[-/. ]\s?(?P<named>[^\W\d_]{3,9})\.?[-/., ]\s?)"
    r"(?P<last>\d{4}|\d{1,2})"
    r"|(?P<month>[^\W\d_]{3,9})\.?\s+(?P<day>\d{1,2})(?:st|nd|rd|th)?,?(?:\s+(?P<year>\d{4})(?![:\d]))?)"
)
"""A date, optionally after the day of the week."""
HALF_OF_DAY: Final = r"(?:\s?(?P<half>[AaPp])\.?[Mm]\b\.?)?"
TIME_OF_DAY: Final = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d))?(?P<fraction>[.,]\d+|:\d{3,}|\s(?:\d{3}|\d{6}))?"
    + HALF_OF_DAY
)
"""A time of day; without hours, as in the ``mm:ss.0`` of spreadsheets, it has a fraction."""
ZONE: Final = r"(?:\s?(?P<zone>Z|UTC|GMT|(?:UTC|GMT)?[-+]\d\d:?(?:\d\d)?)|\s[A-Z]{2,5})?(?:\[[^\]]*\])?"
"""A time zone. A name such as ``CET`` is ignored: its times are read as UTC."""
DATE_AND_TIME: Final = re.compile(
    rf"\s*[\[(<'\"]?(?:{DATE}(?:T|[ ,;_]\s*|$|(?=[\])>'\"])))?(?:(?P<days>\d+)\s+days?,?\s+)?"
    rf"(?:{TIME_OF_DAY}{ZONE})?(?:\s+(?P<late>\d{{4}}))?[\])>'\"]?\s*"
)
"""A cell with a date, a time of day or both. ``ctime`` puts the year last; a pandas timedelta starts with days."""
PACKED_TIME: Final = re.compile(r"\s*(\d{4})(\d\d)(\d\d)[T_ ](\d\d)(\d\d)(\d\d)")  # ``20261122T044207.813Z``
UNPADDED_TIME: Final = re.compile(
    r"\s*(\d{1,2}):(\d{1,2}):(\d{1,2}):(\d{1,3})\s*"
)  # ``4:42:7:13``, the last in milliseconds
FRACTION: Final = re.compile(r"\d{3}|\d{6}")  # of a second
# share of repeated whole seconds above which the next cell may hold the fraction of a second
MIN_REPEATED_SHARE: Final = 0.2
_SECONDS: Final = re.compile(r"(.*?\d:\d\d):(\d\d)(?:[.,](\d+))?((?:\s?[A-Za-z.+-].*)?)")
"""A time with seconds, and the text before and after them."""
MONTHS: Final = {
    "jan": 1, "ene": 1, "gen": 1, "feb": 2, "fév": 2, "mar": 3, "mär": 3, "mrz": 3, "apr": 4, "avr": 4, "abr": 4,
    "may": 5, "mai": 5, "jun": 6, "juin": 6, "giu": 6, "jul": 7, "juil": 7, "lug": 7, "aug": 8, "aoû": 8, "ago": 8,
    "sep": 9, "set": 9, "oct": 10, "okt": 10, "ott": 10, "nov": 11, "dec": 12, "dez": 12, "déc": 12, "dic": 12,
}  # fmt: skip
"""Number of a month, by the first letters of its name."""
ORDERS: Final = ("dmy", "mdy", "ymd")  # orders of day, month and year; the first is the default for an ambiguous column
FIRST_YEAR_OF_1900S: Final = 70  # first two-digit year that belongs to the 1900s
DAY_S: Final = 86400.0
HOUR_S: Final = 3600.0
MIN_TIME_SHARE: Final = 0.5  # smallest share of times among the cells of a time column
EPOCH: Final = date(1970, 1, 1).toordinal()


@dataclass(frozen=True, slots=True)
class Clock:
    """Conversion to seconds of one column of times, or of a column of dates with one of times of day."""

    cells: tuple[int, ...]  # places of dates and times of day; the seconds are stored at the last place
    order: str = "ymd"  # of day, month and year in numeric dates
    is_dated: bool = True
    period: float = DAY_S  # seconds after which a time without a date starts again
    is_settled: bool = True  # whether the dates allow only this order

    @classmethod
    def of(cls, rows: Iterable[Sequence[str]], cells: tuple[int, ...]) -> Self:
        """Infer the order of day and month from the dates in some rows."""
        found = [match for row in rows if (match := _match(_join_cells(row, cells)))]
        is_dated = any(match["first"] or match["year"] or match["late"] for match in found)
        is_short = any(match["second"] is None and match["fraction"] for match in found)
        order, is_settled = order_of(found)
        return cls(cells, order, is_dated, HOUR_S if is_short else DAY_S, is_settled)

    @property
    def cell(self) -> int:
        """Place of the clock's seconds in a row of numbers."""
        return self.cells[-1]

    def seconds(self, row: Sequence[str]) -> float:
        """Seconds of a row of cells, since 1970 or since midnight; NaN without a time."""
        return self.seconds_of(*(row[cell] for cell in self.cells if cell < len(row)))

    def seconds_of(self, *texts: str) -> float:
        """Seconds of the cells that hold the time; NaN without a time."""
        text = _pad_milliseconds(" ".join(map(str.strip, texts)))
        parts = _SECONDS.fullmatch(text)
        if parts is None:
            return _seconds(text, self.order)
        before, second, fraction, behind = parts.groups()
        minute = _minute(before, behind, self.order)
        return math.nan if minute is None else float(f"{minute + int(second)}.{fraction or 0}")


def clocks_of(rows: Sequence[Sequence[str]], places: Iterable[int]) -> Iterator[Clock]:
    """Yield the text columns that are times: with dates, or times of day that are paired with a column of dates."""
    days: list[int] = []
    times: list[int] = []
    for place in places:
        filled = [row[place] for row in rows if place < len(row) and row[place].strip()]
        found = list(filter(None, map(_match, filled)))
        if not found or len(found) < MIN_TIME_SHARE * len(filled) or _are_parts(filled):
            continue
        if found[0]["hour"] is None:
            days.append(place)
        elif found[0]["first"] or found[0]["month"]:
            yield Clock.of(rows, _with_fraction(rows, (place,)))
        else:
            times.append(place)
    for place in times:
        day = min(days, key=lambda day: abs(day - place), default=None)
        yield Clock.of(rows, _with_fraction(rows, (place,) if day is None else (day, place)))


def _with_fraction(rows: Sequence[Sequence[str]], cells: tuple[int, ...]) -> tuple[int, ...]:
    """Cells of a time, with the next cell if a decimal comma has moved the fraction there: ``04:42:07,813``."""
    after = cells[-1] + 1
    if not all(after < len(row) and FRACTION.fullmatch(row[after].strip()) for row in rows):
        return cells
    alone, joined = Clock.of(rows, cells), Clock.of(rows, (*cells, after))
    whole, times = (np.array([clock.seconds(row) for row in rows]) for clock in (alone, joined))
    repeats = np.diff(whole) == 0
    is_finer = (
        np.mean(repeats) > MIN_REPEATED_SHARE
        and (whole == np.floor(whole)).all()
        and (np.diff(times)[repeats] > 0).all()
    )
    return (*cells, after) if is_finer else cells


def seconds_of(match: re.Match[str], order: str = "ymd") -> float | None:
    """Seconds of a match of `DATE` and a time of day; None for a date that does not exist."""
    parts = match.groupdict()
    hour, minute, second = int(parts["hour"] or 0), int(parts["minute"] or 0), parts["second"]
    fraction = (parts["fraction"] or "")[1:]
    if second is None and fraction:
        hour, minute, second = 0, hour, parts["minute"]
    if parts["half"]:
        hour = hour % 12 + 12 * (parts["half"] in "pP")
    whole = int(DAY_S) * int(parts.get("days") or 0) + 3600 * hour + 60 * minute + int(second or 0)
    day = _day_of(parts, order)
    if day is None:
        return None
    if day:
        whole += day * int(DAY_S) - _zone(parts["zone"])
    return float(f"{whole}.{fraction or 0}")


@dataclass(slots=True)
class Midnights:
    """Unwrapping of times at the end of the day, or of the hour."""

    clock: Clock | None
    last: float = math.nan  # the previous time, in seconds

    def unwrap(self, seconds: Floats) -> Floats:
        """(N,) times in s, continued past midnight; times of a clock with dates are unchanged."""
        known = np.flatnonzero(np.isfinite(seconds))
        if self.clock is None or self.clock.is_dated or not len(known):
            return seconds
        behind = np.concatenate([[self.last], seconds[known][:-1]]) - seconds[known]
        begun = np.where(np.isfinite(behind), np.ceil(behind / self.clock.period - 0.5), 0.0)
        passed = seconds.copy()
        passed[known] += self.clock.period * np.cumsum(np.maximum(begun, 0.0))
        self.last = float(passed[known[-1]])
        return passed


def _join_cells(row: Sequence[str], cells: tuple[int, ...]) -> str:
    return " ".join(row[cell].strip() for cell in cells if cell < len(row))


@lru_cache(64)
def _minute(before: str, behind: str, order: str) -> int | None:
    """Start of a minute in s, from the text around the seconds; cached, since parsing is slow."""
    seconds = _seconds(f"{before}:00{behind}", order)
    return None if math.isnan(seconds) else int(seconds)


def _seconds(text: str, order: str) -> float:
    match = _match(text)
    seconds = seconds_of(match, order) if match else None
    return math.nan if seconds is None else seconds


def _pad_milliseconds(text: str) -> str:
    """A time of day whose milliseconds, after a colon, are padded to three digits."""
    match = UNPADDED_TIME.fullmatch(text) if text.count(":") == 3 else None
    return f"{match[1]}:{match[2]:0>2}:{match[3]:0>2}.{match[4]:0>3}" if match else text


def _are_parts(texts: Sequence[str]) -> bool:
    """Whether the numbers after the third colon are not milliseconds: none of them has three digits."""
    parts = [match[4] for text in texts if (match := UNPADDED_TIME.fullmatch(text))]
    return bool(parts) and max(map(len, parts)) < 3


def _match(text: str) -> re.Match[str] | None:
    """Match of a cell that is a date, a time of day or both, and nothing else; None for other cells."""
    match = DATE_AND_TIME.fullmatch(PACKED_TIME.sub(r"\1-\2-\3T\4:\5:\6", _pad_milliseconds(text)))
    return match if match and (match["hour"] or match["first"] or match["month"]) else None


def _day_of(parts: dict[str, str | None], order: str) -> int | None:
    """Days from 1970 to the date of a match; 0 without a date or year, None for a day that does not exist."""
    first, middle, last = parts["first"], parts["middle"] or parts["named"], parts["last"]
    year, month, day = parts["year"] or parts.get("late"), parts["month"], parts["day"]
    if month and day:
        return _day(year, month, day) if year else 0
    if not (first and middle and last):
        return 0
    if parts["named"]:
        order = "dmy"
    own = dict(zip("ymd" if len(first) == 4 else order, (first, middle, last), strict=True))
    return _day(own["y"], own["m"], own["d"])


@lru_cache(64)
def _day(year: str, month: str, day: str) -> int | None:
    """Days from 1970 to a date; None if the day does not exist."""
    name = month.casefold()
    number = int(month) if month.isdecimal() else MONTHS.get(name[:4]) or MONTHS.get(name[:3])
    whole = int(year) + (0 if len(year) == 4 else 1900 if int(year) >= FIRST_YEAR_OF_1900S else 2000)
    try:
        return date(whole, number or 0, int(day)).toordinal() - EPOCH
    except ValueError:
        return None


@lru_cache(64)
def _zone(zone: str | None) -> int:
    """Seconds by which the local time of a zone is ahead of UTC."""
    digits = re.sub(r"\D", "", zone or "")
    if not digits:
        return 0
    ahead = 3600 * int(digits[:2]) + 60 * int(digits[2:] or 0)
    return -ahead if "-" in str(zone) else ahead


def order_of(found: Sequence[re.Match[str]]) -> tuple[str, bool]:
    """Order of day, month and year in numeric dates, and whether no other order is possible.

    Of several possible orders, the one with ascending dates within the fewest days is chosen. With AM or PM, the month
    comes first.
    """
    dates = {match.group("first", "middle", "last"): match for match in found if match["middle"]}
    if not dates or any(len(first) == 4 for first, _, _ in dates):
        return "ymd", True
    spans: dict[str, tuple[bool, int, bool]] = {}
    has_halves = any(match["half"] for match in found)
    for order in ORDERS:
        days = [_day_of(match.groupdict(), order) for match in dates.values()]
        known = [day for day in days if day]
        if len(known) == len(days) and (order != "ymd" or all(len(last) < 4 for _, _, last in dates)):
            spans[order] = (known != sorted(known), max(known) - min(known), has_halves and order != "mdy")
    return min(spans, key=spans.__getitem__, default="dmy"), len(spans) < 2 or len(dates) > 1
