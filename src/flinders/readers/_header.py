"""Header of a table: names of its columns, units below them, and headers that fit no line of readings.

>>> find_header(["site: hall", "t_s,mag_x_uT,mag_y_uT,mag_z_uT"], ",", 4, 4)
(1, ['t_s', 'mag_x_uT', 'mag_y_uT', 'mag_z_uT'])
>>> units_below(["[s],[uT],[uT],[uT]"], ",", 4)
['s', 'uT', 'uT', 'uT']
"""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.units import PARTED, SPELLINGS
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._asked_columns import parts_of
from flinders.readers._cells import COMMENTS, SPACES, fits, number, split
from flinders.readers._delimiters import SIGNS, is_comment
from flinders.readers._heading import shifted
from flinders.readers._instruments import names_magnetometer, vectors
from flinders.readers._likeness import XYZ, advice, groups
from flinders.readers._names import ACCELERATION, FIELD, RATE, Meaning, is_unit, meaning
from flinders.readers._refusals import MOST_ABOVE, ranges
from flinders.readers._tokenizer import shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._clock import Clock
    from flinders.readers._devices import SensorColumn

MOST_NAMES_OVER: Final = 2  # Names that a header may have more than lines have fields
_UNITS: Final = re.compile(r"(?:(?:mag|field)[ _-]?)?units?", re.IGNORECASE)  # name of a column
_SAYS_UNIT: Final = re.compile(
    r"\W*(?:(?:mag[^\W_]*|(?:magnetic[ _])?field|the)[\W_]+)*units?(?:[ _]of[ _](?:the[ _])?(?:mag\w*|field))?"
    r"(?:\s+(?:is|are)\b|[\"']?\s*[:=,;\t])\s*[\"'\[(]?((?:(?:micro|milli|nano)[ _-])?[^\W\d_]+)\W*",
    re.IGNORECASE,
)
"""A line that says in which unit the field is."""
_OTHER_UNITS: Final = ("g", "mg", "t", "raw")  # gravity, and what says nothing


def lines_above(texts: Sequence[str], delimiter: str, sensors: SensorColumn | None) -> list[str]:
    """Lines above the readings; of several headers those of the sensor that is read, where each begins with its own."""
    if sensors is None:
        return list(texts)
    own = [text if sensors.is_of_first(_names_in(text, delimiter)) else "" for text in texts]
    return own if any(own) else list(texts)


def find_header(above: list[str], delimiter: str, filled: int, width: int) -> tuple[int, list[str]]:
    """Find the header above the readings: the nearest line that names a magnetometer, or else columns at all.

    Lines have `width` cells, of which the first `filled` hold something.
    """
    fallback: tuple[int, list[str]] = (-1, [])
    for place in range(len(above) - 1, -1, -1):
        names = _names_in(above[place], delimiter)
        if not (fits(names, width) or filled <= len(names) < width):
            continue
        names = names[:width]
        if all(is_unit(name) for name in names if name):
            continue
        if grouped := _with_sensors(names, _names_in(above[place - 1], delimiter) if place else []):
            lower = fallback[1][: len(grouped)]  # of a column whose name stands in a line of its own
            return place, [name or below for name, below in zip_longest(grouped, lower, fillvalue="")]
        if names_magnetometer(names):
            return place, names
        if not fallback[1] and not is_comment(above[place]) and _could_name(names, delimiter):
            fallback = place, names
    return fallback


class _Misfit(NamedTuple):
    """A header with another number of names than lines have fields."""

    place: int
    written: int  # names
    names: list[str]  # one for each field, some of them empty; none where values do not tell whose they are
    text: str

    def words(self, width: int) -> str:
        """How many there are of each."""
        return f"a header of {self.written} names over {width} fields" if self.written != width else ""


def find_misfit(
    name: str, above: list[str], delimiter: str, values: Floats, clocks: Sequence[Clock], asked: AnyColumns | None
) -> _Misfit | None:
    """Find a header that fits by no number, or no delimiter: the nearest that has the names that are meant.

    Raises `NoMagnetometer` where it names a magnetometer and values do not tell which columns it is.
    """
    width, other = values.shape[1], None
    parts = [part.casefold() for part in parts_of(asked)] if asked else []
    wanted = [part for part in parts if not part.isdecimal()]
    for place, sign in ((place, sign) for place in range(len(above) - 1, -1, -1) for sign in dict(SIGNS)):
        names = _named_in(above[place], sign)
        least = 3 if sign == delimiter != SPACES else width / 2 if sign == delimiter else width
        is_close = least <= len(names) <= width + MOST_NAMES_OVER * (sign == delimiter)
        is_meant = set(wanted) <= set(map(str.casefold, names)) if wanted else names_magnetometer(names)
        if is_close and is_meant:
            header = names if len(names) == width else shifted(names, values, clocks, wanted)
            if header or asked is None or wanted:
                return _settled(name, _Misfit(place, len(names), header, above[place]), values, wanted)
        could_be = is_close and sign == delimiter and not is_comment(above[place])
        if other is None and could_be and _could_name(names, sign):
            other = _Misfit(place, len(names), [], above[place])
    return other


def _settled(name: str, found: _Misfit, values: Floats, wanted: Sequence[str]) -> _Misfit:
    """Ask where a header names what is wanted and values do not tell which columns that is."""
    if found.names:
        return found
    what = f"{found.words(values.shape[1])} (line {found.place + 1}: {shown(found.text)!r})"
    if wanted:
        asked = ",".join(wanted)
        raise UsageError(f"columns {asked!r}: {name} has {what}, which may be of other columns: give numbers")
    judged = groups(values, range(values.shape[1]))
    told, hint = advice(judged) if judged else (f"say which, by number; they go from {ranges(values)}", XYZ)
    raise NoMagnetometer(f"{name} has {what}, and values do not tell which fields the names are of; {told}", hint=hint)


def _named_in(text: str, delimiter: str) -> list[str]:
    """Names of a line without those that are empty at its end; none where some are numbers, or come again."""
    names = [name.rstrip(",;") for name in _names_in(text, delimiter)]
    while names and not names[-1]:
        names.pop()
    filled = list(filter(None, names))
    is_text = all(number(name, ".") is None for name in filled) and len(set(filled)) == len(filled)
    return names if is_text else []


def _names_in(text: str, delimiter: str) -> list[str]:
    """Cut a line of names, also in a comment."""
    bare = text.lstrip()
    sign = next((sign for sign in COMMENTS if bare.startswith(sign)), "")
    return [cell.strip() for cell in split(bare.removeprefix(sign).lstrip() if sign else text, delimiter)]


def _with_sensors(names: Sequence[str], titles: Sequence[str]) -> list[str]:
    """Put the sensors of a line before the axes below it, each above its columns or the first; else nothing."""
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
    """Find a row of units between the header and the readings, one a column; nothing where there is none."""
    for text in below:
        cells = [cell.strip("[]()") for cell in _names_in(text, delimiter)]
        units = [cell if is_unit(cell) else "" for cell in cells]
        if fits(cells, width) and sum(map(bool, units)) >= max(3, sum(map(bool, cells)) / 2):
            return units
    return []


def stated_unit(header: Sequence[str], rows: Sequence[Sequence[str]], above: Sequence[str]) -> str:
    """Unit that a column of units, or a line above the readings, says the field is in; nothing where none does."""
    places = [place for place, name in enumerate(header) if _UNITS.fullmatch(name.strip())]
    words = [{row[place].strip() for row in rows if place < len(row)} for place in places]
    said = [word for each in words if len(each) == 1 for word in each]
    lines = filter(None, map(_SAYS_UNIT.fullmatch, above[:MOST_ABOVE]))
    said += [match[1] for match in lines]
    known = (SPELLINGS.get(PARTED.sub(r"\1", word).casefold(), "") for word in said if word not in _OTHER_UNITS)
    return next(filter(None, known), "")


def _could_name(names: list[str], delimiter: str) -> bool:
    """Tell a header from a sentence: no numbers and, where spaces part the cells, a name that means something."""
    if not any(names) or any(name and number(name, ".") is not None for name in names):
        return False
    return delimiter != SPACES or any(meaning(name).kind for name in names)
