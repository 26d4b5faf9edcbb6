"""Header of a table: the names of columns, the units below them, and headers that do not fit the columns.

>>> find_header(["site: hall", "t_s,mag_x_uT,mag_y_uT,mag_z_uT"], ",", 4, 4)
(1, ['t_s', 'mag_x_uT', 'mag_y_uT', 'mag_z_uT'])
>>> units_below(["[s],[uT],[uT],[uT]"], ",", 4)
['s', 'uT', 'uT', 'uT']
"""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.units import SEPARATE_PREFIX, SPELLINGS
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._asked_columns import parts_of
from flinders.readers._cells import COMMENTS, SPACES, has_width, parse_number, split
from flinders.readers._delimiters import SIGNS, is_comment
from flinders.readers._heading import place_names
from flinders.readers._instruments import names_magnetometer, vectors
from flinders.readers._likeness import XYZ, advice, groups
from flinders.readers._names import ACCELERATION, FIELD, RATE, Meaning, is_unit, meaning
from flinders.readers._refusals import MAX_LINES_ABOVE, ranges
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._clock import Clock
    from flinders.readers._devices import SensorColumn

MAX_EXTRA_NAMES: Final = 2  # largest excess of header names over fields in a line
_UNITS: Final = re.compile(r"(?:(?:mag|field)[ _-]?)?units?", re.IGNORECASE)  # name of a column that contains the unit
_SAYS_UNIT: Final = re.compile(
    r"\W*(?:(?:mag[^\W_]*|(?:magnetic[ _])?field|the)[\W_]+)*units?(?:[ _]of[ _](?:the[ _])?(?:mag\w*|field))?"
    r"(?:\s+(?:is|are)\b|[\"']?\s*[:=,;\t])\s*[\"'\[(]?((?:(?:micro|milli|nano)[ _-])?[^\W\d_]+)\W*",
    re.IGNORECASE,
)
"""A line that states the unit of the field."""
_OTHER_UNITS: Final = ("g", "mg", "t", "raw")  # units of gravity, and words that name no unit


def lines_above(texts: Sequence[str], delimiter: str, sensors: SensorColumn | None) -> list[str]:
    """Lines above the readings. If each header starts with a sensor's name, only those of the selected sensor."""
    if sensors is None:
        return list(texts)
    own = [text if sensors.is_of_first(_names_in(text, delimiter)) else "" for text in texts]
    return own if any(own) else list(texts)


def find_header(above: list[str], delimiter: str, filled: int, width: int) -> tuple[int, list[str]]:
    """Find the header above the readings: the nearest line that names a magnetometer, else the nearest with names.

    The lines have `width` cells, of which the first `filled` are not empty.
    """
    fallback: tuple[int, list[str]] = (-1, [])
    for place in range(len(above) - 1, -1, -1):
        names = _names_in(above[place], delimiter)
        if not (has_width(names, width) or filled <= len(names) < width):
            continue
        names = names[:width]
        if all(is_unit(name) for name in names if name):
            continue
        if grouped := _with_sensors(names, _names_in(above[place - 1], delimiter) if place else []):
            lower = fallback[1][: len(grouped)]  # for a column whose name is in another line
            return place, [name or below for name, below in zip_longest(grouped, lower, fillvalue="")]
        if names_magnetometer(names):
            return place, names
        if not fallback[1] and not is_comment(above[place]) and _could_name(names, delimiter):
            fallback = place, names
    return fallback


class _Misfit(NamedTuple):
    """A header whose number of names is not the number of columns."""

    place: int
    written: int  # number of names
    names: list[str]  # a name for each column, some of them empty; no names at all if their places are ambiguous
    text: str

    def words(self, width: int) -> str:
        """Words for the two numbers, of names and of columns."""
        return f"a header of {self.written} names over {width} fields" if self.written != width else ""


def find_misfit(
    name: str, above: list[str], delimiter: str, values: Floats, clocks: Sequence[Clock], asked: AnyColumns | None
) -> _Misfit | None:
    """Find a header that does not fit the columns, the nearest with the requested names.

    It has another number of names or another delimiter. Raises `NoMagnetometer` if it names a magnetometer whose
    columns the values do not identify.
    """
    width, other = values.shape[1], None
    parts = [part.casefold() for part in parts_of(asked)] if asked else []
    wanted = [part for part in parts if not part.isdecimal()]
    for place, sign in ((place, sign) for place in range(len(above) - 1, -1, -1) for sign in dict(SIGNS)):
        names = _named_in(above[place], sign)
        least = 3 if sign == delimiter != SPACES else width / 2 if sign == delimiter else width
        is_close = least <= len(names) <= width + MAX_EXTRA_NAMES * (sign == delimiter)
        is_meant = set(wanted) <= set(map(str.casefold, names)) if wanted else names_magnetometer(names)
        if is_close and is_meant:
            header = names if len(names) == width else place_names(names, values, clocks, wanted)
            if header or asked is None or wanted:
                return _require_places(name, _Misfit(place, len(names), header, above[place]), values, wanted)
        could_be = is_close and sign == delimiter and not is_comment(above[place])
        if other is None and could_be and _could_name(names, sign):
            other = _Misfit(place, len(names), [], above[place])
    return other


def _require_places(name: str, found: _Misfit, values: Floats, wanted: Sequence[str]) -> _Misfit:
    """Return a header whose names have places; for another header, raise an error that asks for the columns."""
    if found.names:
        return found
    what = f"{found.words(values.shape[1])} (line {found.place + 1}: {shorten(found.text)!r})"
    if wanted:
        asked = ",".join(wanted)
        raise UsageError(f"columns {asked!r}: {name} has {what}, so their places are ambiguous: give numbers")
    judged = groups(values, range(values.shape[1]))
    told, hint = advice(judged) if judged else (f"say which, by number; they go from {ranges(values)}", XYZ)
    raise NoMagnetometer(
        f"{name} has {what}, and the values do not show which name belongs to which field; {told}", hint=hint
    )


def _named_in(text: str, delimiter: str) -> list[str]:
    """Names in a line, without empty ones at its end; empty if some are numbers or occur twice."""
    names = [name.rstrip(",;") for name in _names_in(text, delimiter)]
    while names and not names[-1]:
        names.pop()
    filled = list(filter(None, names))
    is_text = all(parse_number(name, ".") is None for name in filled) and len(set(filled)) == len(filled)
    return names if is_text else []


def _names_in(text: str, delimiter: str) -> list[str]:
    """Split a line of names, which may be a comment."""
    bare = text.lstrip()
    sign = next((sign for sign in COMMENTS if bare.startswith(sign)), "")
    return [cell.strip() for cell in split(bare.removeprefix(sign).lstrip() if sign else text, delimiter)]


def _with_sensors(names: Sequence[str], titles: Sequence[str]) -> list[str]:
    """Axis names with the sensor names of the line above, each of which is valid up to the next; empty if unclear."""
    below = [meaning(name) for name in names]
    axes = [place for place, each in enumerate(below) if each.axis and (each.is_bare or not each.kind)]
    if len(axes) < 3 or len(titles) > len(names) + 1 or sum(map(bool, titles)) < 2:
        return []
    joined, title = [], ""
    for name, above in zip_longest(names, titles[: len(names)], fillvalue=""):
        title = above or title
        bracket = min((place for sign in "[(" if (place := title.find(sign)) > 0), default=len(title))
        parts = (title[:bracket].strip(), name, title[bracket:])
        joined.append(" ".join(filter(None, parts)) if name else above)
    known = [meaning(name) if place in axes else Meaning("") for place, name in enumerate(joined)]
    plain = [Meaning("") if each.is_bare else each for each in known]
    is_clear = any(vectors(joined, plain, kind) for kind in (FIELD, ACCELERATION, RATE))
    return joined if is_clear and len({joined[place] for place in axes}) == len(axes) else []


def units_below(below: list[str], delimiter: str, width: int) -> list[str]:
    """Row of units between header and readings, one for each column; empty if there is none."""
    for text in below:
        cells = [cell.strip("[]()") for cell in _names_in(text, delimiter)]
        units = [cell if is_unit(cell) else "" for cell in cells]
        if has_width(cells, width) and sum(map(bool, units)) >= max(3, sum(map(bool, cells)) / 2):
            return units
    return []


def stated_unit(header: Sequence[str], rows: Sequence[Sequence[str]], above: Sequence[str]) -> str:
    """Unit of the field, as stated in a column of units or in a line above the readings; empty if none states it."""
    places = [place for place, name in enumerate(header) if _UNITS.fullmatch(name.strip())]
    words = [{row[place].strip() for row in rows if place < len(row)} for place in places]
    said = [word for each in words if len(each) == 1 for word in each]
    lines = filter(None, map(_SAYS_UNIT.fullmatch, above[:MAX_LINES_ABOVE]))
    said += [match[1] for match in lines]
    known = (
        SPELLINGS.get(SEPARATE_PREFIX.sub(r"\1", word).casefold(), "") for word in said if word not in _OTHER_UNITS
    )
    return next(filter(None, known), "")


def _could_name(names: list[str], delimiter: str) -> bool:
    """Whether names may be a header and not a sentence: none is a number; between spaces, one must be recognised."""
    if not any(names) or any(name and parse_number(name, ".") is not None for name in names):
        return False
    return delimiter != SPACES or any(meaning(name).kind for name in names)
