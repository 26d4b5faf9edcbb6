r"""A printed line becomes numbers, each with its label and its unit, and the labels become names of columns.

The text between two numbers holds the unit of the first and the label of the second. A label that is only an axis
belongs to the sensor named before it, and three numbers behind one label are its x, y and z.

>>> numbers, gaps = cut("Mag X: -20.8 Y: -20.2 Z: 26.1 uT")
>>> numbers
['-20.8', '-20.2', '26.1']
>>> names_of(gaps)
('Mag X (uT)', 'Mag Y (uT)', 'Mag Z (uT)')
"""

from __future__ import annotations

import re
from dataclasses import KW_ONLY, dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from flinders.readers._names import FACTORS, meaning
from flinders.readers._numbers import unglued

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

ATTACHED: Final = r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|(?:nan|NaN|NAN|inf|ovf)(?!\w))"
"""A number, whatever stands before it."""
NUMBER: Final = r"(?<![\w.^])(?:(?<!\w[-+−])(?=[-+−])|(?<![-+−])(?![-+−]))(?!(?<=\w\[)\d+\])(?!(?<=<)inf>)" + ATTACHED
"""A number that is no part of a word, of ``m/s^2``, ``X-6`` or an index; Arduino prints ``nan``, ``inf`` and ``ovf``,
and Zephyr ``<inf>`` before what is information."""
STAMP: Final = re.compile(
    r"\s*[\[(<]?(?:[A-Z][a-z]{2} +\d+ +)?(?:(?P<date>\d{4}-\d\d-\d\d)[T ])?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?P<fraction>[.,]\d+)?(?:,\d+)?(?P<zone>Z|[+-]\d\d:?\d\d)?"
    r"[\])>]?\s*(?P<mark>->|[|>:;,\t]|-(?![\d.]))?\s*"
)
"""The time that a serial monitor, a logger or an operating system puts before a line."""

REMEMBERED: Final = 1024  # lines of different words whose names of columns are remembered
_PLAIN: Final = r"([-+]?\d+(?:\.\d*)?)"
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
"""What turns the colour of a terminal, as the log of ESP-IDF does."""
_CHECK_SUM: Final = re.compile(r"\*[0-9a-fA-F]{2}\s*$")
"""What ends a sentence like those of NMEA 0183, which begin with ``$``."""
_LOOSE_SIGN: Final = re.compile(r"(?<=[:=,(\[])\s*-\s+(?=[\d.])")
"""A minus that stands apart from its number: ``X: - 12``."""
_NUMBERED: Final = re.compile(r"\b([^\W\d_]{3,}) +(\d{1,2})(?=\s*:(?!\d))")
"""The number of a sensor that stands apart from its name: ``Mag 1:``."""
_TELEPLOT: Final = re.compile(r"^(\s*>[^:|\s]+:)\d+(?:\.\d+)?:(?=[-+.\d])")
"""The time that Teleplot takes between a name and its value: ``>mag_x:1627551892437:-20.8``."""
_CUT: Final = re.compile(f"({NUMBER})")
_OTHER_UNITS: Final = (
    "deg",
    "degs",
    "degree",
    "degrees",
    "°",
    "º",
    "hz",
    "hpa",
    "%",
    "rad",
    "mbar",
    "ft",
    "f",
    "°f",
    "mm",
    "cm",
)
"""Units of what stands beside a magnetometer and is not read."""
_UNIT: Final = "|".join(
    re.escape(unit)
    for unit in sorted({*_OTHER_UNITS, *(unit for units in FACTORS.values() for unit in units)}, key=len, reverse=True)
)
_KNOWN_UNIT: Final = rf"((?:{_UNIT}|[^\x00-\x7f]{{1,3}}T))"
_UNIT_AHEAD: Final = re.compile(rf"[\[(]?{_KNOWN_UNIT}[\])]?(?=$|[\s,;|)\]}}/])(?!\s*[:=])", re.IGNORECASE)
"""A unit right behind a number; ``T:`` is a label."""
_UNIT_INSIDE: Final = re.compile(
    rf"(?:[(\[]\s*|\bin\s+){_KNOWN_UNIT}\s*[)\]]?(?=[\s:=]*(?:$|[(\[]|[xyz]\b))", re.IGNORECASE
)
"""A unit in brackets at the end of a label, or behind ``in``."""
_UNIT_AND_AXIS: Final = re.compile(rf"{_KNOWN_UNIT}\s+([xyz])", re.IGNORECASE)  # ``Gauss X``
_SENSOR_AND_UNIT: Final = re.compile(r"\s*\[(\w{3,})/(\w+)\]")  # ``LSM303AGR [mag/mgauss]``
_REMARK: Final = re.compile(r"^\s*\([^()]*\)\s+(?=\w)")
"""What brackets say of the number before, where words follow: ``type=8(magn_x) index=0``."""
_EDGE: Final = " \t,;:=|()[{}<>\"'-#*/>→~&$!"
_AXES: Final = tuple("xyzXYZ")
_LABEL: Final = re.compile(r"^[\W\d_]*[^\W\d_][^:=\[({]*[:=\[({]")  # A letter, and behind it the sign that ends a label
_BETWEEN: Final = re.compile(r"(?:[\s:=|>\"'{,;]|(?<=\s)-(?=\s))+")
_XYZ: Final = re.compile(r"(?:^|[\s(\[])x[\s,/]*y[\s,/]*z$", re.IGNORECASE)
"""``Mag XYZ``, ``x, y, z``: a label of all three."""
_AXIS: Final = re.compile(r"(?:^|[\s_.\-/(])([xyz])(?:[\s_-]*(?:axis|component|value))?$", re.IGNORECASE)
"""An axis at the end of a label."""
_AXIS_AHEAD: Final = re.compile(
    r"([xyz])[\s_-]*(?:axis\b)?[\s_-]*(raw|norm|field|mag(?:net\w*)?|acc\w*|gyro?\w*|value)?\b(.*)", re.IGNORECASE
)
"""An axis at its beginning: ``X axis field``, ``Xraw``."""
QUANTITY: Final = re.compile(
    r"orient|euler|linear|gravity|rotat|posit|\bpos\b|veloc|quat|angle|\bang\b|attitude|tilt|speed|displace|force"
    r"|heading|azimuth|bearing|roll|pitch|yaw|\b(?:ypr|rpy|areal|aworld|(?:min|max)(?:imum)?)\b",
    re.IGNORECASE,
)
"""Other quantities with three axes: their words stay with the axis, where those that mean nothing are dropped."""
_FILLING: Final = re.compile(r"\b(value|reading|data|component|axis)s?\b", re.IGNORECASE)
_WORDS: Final = 3
"""Words of a label that are tried when all of it says nothing: what stands before may be a sentence, or a value."""
_LETTER_BITS: Final = {2: 8, 4: 16, 6: 24, 8: 32}
"""Bits of a hexadecimal number with so many digits; one that has them all is signed."""


@dataclass(slots=True)
class Dialect:
    """How lines that are no table become rows of one."""

    words: str  # what the lines are, for people
    names: tuple[str, ...]  # of the columns; empty where the lines do not state them
    _: KW_ONLY
    frame: str = "sensor"  # what the axes are, as `Samples` calls it

    def row(self, line: str) -> Sequence[str] | None:
        """Take one line, in order: the cells of a reading, nothing for a part of one, None where it is another line."""
        raise NotImplementedError


def cut(line: str) -> tuple[list[str], tuple[str, ...]]:
    """Cut a line into its numbers and what stands before, between and behind them, without spaces at the ends."""
    line = _COLOURS.sub("", line) if "\x1b" in line else line
    line = _CHECK_SUM.sub("", line) if line.startswith("$") else line
    line = _TELEPLOT.sub(r"\1", line) if ">" in line else line
    line = _NUMBERED.sub(r"\1\2", unglued(line))
    pieces = _CUT.split(_LOOSE_SIGN.sub(" -", line) if "- " in line else line)
    return [decimal(number) for number in pieces[1::2]], tuple(piece.strip() for piece in pieces[::2])


def like(gaps: Sequence[str]) -> re.Pattern[str]:
    """Compile what finds the numbers of a line with just these gaps, in a third of the time that `cut` takes."""
    inner = [rf"\s*{re.escape(gap)}\s*" if gap else r"\s+" for gap in gaps[1:-1]]
    ends = [rf"\s*{re.escape(gap)}\s*" for gap in (gaps[0], gaps[-1])]
    return re.compile(ends[0] + "".join(f"{_PLAIN}{gap}" for gap in inner) + _PLAIN + ends[1])


def decimal(number: str) -> str:
    """Write a number in decimal: a hexadecimal one with all of its digits is signed, an overflow is ``nan``."""
    if number[-1:] in "fF" and number.lstrip("-+").casefold() in ("inf", "ovf"):
        return "nan"
    if "x" not in number and "X" not in number:
        return number
    sign, digits = ("-", number[3:]) if number.startswith("-") else ("", number.lstrip("+")[2:])
    value, bits = int(digits, 16), _LETTER_BITS.get(len(digits), 0)
    return f"{sign}{value - (1 << bits) if bits and value >> (bits - 1) else value}"


@lru_cache(REMEMBERED)
def names_of(gaps: tuple[str, ...]) -> tuple[str, ...]:
    """Name the columns of a line by label, axis and unit from the gaps of `cut`; empty names where no label stands."""
    behind = [_unit_and_label(gap) for gap in gaps[1:]]
    labels, units = [_label(gaps[0]), *(label for _, label in behind[:-1])], [unit for unit, _ in behind]
    names: list[str] = []
    sensor = ""
    for first, count in _runs(labels):
        label, unit = _without_unit(labels[first])
        sensor = sensor if label == labels[first] else ""
        axes, sensor = _axes(label, count, sensor)
        stated = unit or next((each for each in units[first : first + count][::-1] if each), "")
        for place in range(count):
            units[first + place] = units[first + place] or stated
        names += axes
    return tuple(f"{name} ({unit})" if unit else name for name, unit in zip(names, _shared(names, units), strict=True))


def pattern_of(line: str) -> str:
    """Write a line as the ``--pattern`` of lines like it: ``<{x}/{y}/{z}/{n4}>``."""
    pieces = re.split(rf"((?!(?<=[A-Za-z]{{3}} )\d{{1,2}}\s*:(?!\d)){NUMBER})", line.strip())
    names = ("x", "y", "z", *(f"n{place}" for place in range(4, len(pieces))))
    return "".join(f"{{{names[place // 2]}}}" if place % 2 else piece for place, piece in enumerate(pieces))


def is_labelled(gaps: Sequence[str]) -> bool:
    """Tell whether signs of a label stand between the numbers, as ``X:``, ``x=`` or ``mag [``, and not commas only."""
    return any(gap[-1:] in _AXES or any(map(_LABEL.search, re.split("[,;]", gap))) for gap in gaps[:-1] if gap)


def seconds_of(stamp: re.Match[str] | None) -> float | None:
    """The time of a `STAMP` in s: since 1970 where it has a date, else since midnight; None where there is none."""
    if stamp is None:
        return None
    fraction = float((stamp["fraction"] or ".0").replace(",", "."))
    second = 3600 * int(stamp["hour"]) + 60 * int(stamp["minute"]) + int(stamp["second"]) + fraction
    if stamp["date"] is None:
        return second
    try:
        day = datetime.fromisoformat(f"{stamp['date']}T00:00:00{stamp['zone'] or '+00:00'}")
    except ValueError:
        return None
    return (day - datetime.fromtimestamp(0, UTC)).total_seconds() + second


def _unit_and_label(gap: str) -> tuple[str, str]:
    """Cut what stands between two numbers into the unit of the first and the label of the second."""
    text = gap.lstrip(" )]}§")
    unit = _UNIT_AHEAD.match(text)
    return (unit[1], _label(text[unit.end() :])) if unit else ("", _label(text))


def _label(text: str) -> str:
    """The words of a label, without the signs around them; brackets around a unit at its end stay."""
    text = _SENSOR_AND_UNIT.sub(r" \1 (\2)", _REMARK.sub("", text.rstrip(" \t,;:=|[{<>\"'-#*/→~")))
    inside = _UNIT_INSIDE.search(text)
    words = _BETWEEN.sub(" ", _UNIT_INSIDE.sub(" ", text).strip(_EDGE)).strip(_EDGE)
    return f"{words} ({inside[1]})".lstrip() if inside else words


def _without_unit(label: str) -> tuple[str, str]:
    if ahead := _UNIT_AND_AXIS.fullmatch(label):
        return ahead[2], ahead[1]
    inside = _UNIT_INSIDE.search(label)
    return (label[: inside.start()].rstrip(), inside[1]) if inside else (label, "")


def _runs(labels: Sequence[str]) -> Iterator[tuple[int, int]]:
    """Yield where each label stands and how many numbers follow it without one of their own."""
    starts = [place for place, label in enumerate(labels) if label or place == 0]
    for start, end in zip(starts, [*starts[1:], len(labels)], strict=True):
        yield start, end - start


def _axes(label: str, count: int, sensor: str) -> tuple[list[str], str]:
    """Name the numbers behind one label, and tell which sensor a label of an axis alone belongs to from here on."""
    bare = _XYZ.sub("", label).strip(_EDGE)
    if count == 3 and (label or sensor):
        named = bare if QUANTITY.search(bare) else _known(bare, " x") if bare else ""
        return [f"{named} {axis}".lstrip() for axis in "xyz"], named
    if count > 1:
        return [f"{label} {number} of {count}" if label else "" for number in range(1, count + 1)], ""
    if (ahead := _AXIS_AHEAD.fullmatch(label)) and (ahead[2] or not ahead[3]):
        label = " ".join((*_FILLING.sub(" ", f"{ahead[2] or ''} {ahead[3]}").split(), ahead[1]))
        if str(ahead[2]).casefold() == "norm":  # no reading of a sensor, whatever was named before it
            return [label], sensor
    if axis := _AXIS.search(label):
        own = label[: axis.start()].strip(_EDGE)
        words = own if QUANTITY.search(own) else _known(own, f" {axis[1]}", otherwise="") or sensor
        return [f"{words} {axis[1]}".lstrip()], words
    return [_known(label) if label else ""], ""


def _known(label: str, ending: str = "", otherwise: str | None = None) -> str:
    """The last words of a label that mean something to `meaning`, all of them first; else what `otherwise` says."""
    words = label.split()
    for count in (len(words), *range(min(_WORDS, len(words) - 1), 0, -1)):
        some = " ".join(words[len(words) - count :])
        if some and meaning(some + ending).kind:
            return some
    return (words[-1] if words else "") if otherwise is None else otherwise


def _shared(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Give the one unit of three axes in a row to all of them."""
    known = list(units)
    axes = [name[-1:].casefold() for name in names]
    for place in range(len(names) - 2):
        stated = set(known[place : place + 3]) - {""}
        if axes[place : place + 3] == ["x", "y", "z"] and len(stated) == 1:
            known[place : place + 3] = [*stated] * 3
    return known
