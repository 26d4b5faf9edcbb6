r"""Printed lines: the numbers in them, and names of columns from the labels and units between the numbers.

The text between two numbers contains the unit of the first and the label of the second. A label that is only an axis
belongs to the sensor named before it, and three numbers after one label are its x, y and z.

>>> numbers, gaps = split_line("Mag X: -20.8 Y: -20.2 Z: 0xff38 uT")
>>> numbers, gaps
(['-20.8', '-20.2', '-200'], ('Mag X:', 'Y:', 'Z:', 'uT'))
>>> names_of(gaps)
('Mag X (uT)', 'Mag Y (uT)', 'Mag Z (uT)')
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from flinders.readers._cells import ATTACHED_NUMBER, decimal, separate_numbers
from flinders.readers._lines import SHOWN_LETTERS
from flinders.readers._names import FACTORS, identifies_readings, meaning

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

MAX_NAMES: Final = 24  # largest number of columns named in a message

NUMBER: Final = (
    r"(?<![\w.^])(?:(?<!\w[-+−])(?=[-+−])|(?<![-+−])(?![-+−]))(?!(?<=\w\[)\d+\])(?!(?<=<)inf>)" + ATTACHED_NUMBER
)
"""A number that is not part of a word, of ``m/s^2``, of ``X-6`` or of an index.

Arduino prints ``nan``, ``inf`` and ``ovf``. ``<inf>`` is a log level of Zephyr."""
_CUT: Final = re.compile(f"({NUMBER})")
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")  # of a terminal, as in the log of ESP-IDF
_CHECK_SUM: Final = re.compile(r"\*[0-9a-fA-F]{2}\s*$")  # at the end of a sentence that starts with ``$``
_LOOSE_SIGN: Final = re.compile(r"(?<=[:=,(\[])\s*-\s+(?=[\d.])")  # ``X: - 12``
_SENSOR_NUMBER: Final = re.compile(
    r"\b(?!(?:reading|sample|measurement|point|step|row|line|packet|frame|loop|count)\b)([^\W\d_]{3,})"
    r"(?: +|\s*(?=[(\[#]))[(\[#]*(\d{1,2})[)\]]?(?=\s*:(?!\d)|\s*=|(?<=[)\]])\s+[xyz]\b)",
    re.IGNORECASE,
)
"""The number of a sensor: ``Mag 1:``, ``Mag (1):``."""
_REMARK_AFTER_LABEL: Final = re.compile(
    r"(?<=[^\W_])\s?[(\[][^()\[\]:=]*[^\W\d_][^()\[\]:=]*[)\]](?=\s*[:=]|\s+[xyz]\s*[:=])", re.IGNORECASE
)
"""A remark in brackets after a label, whose numbers are not readings: ``Mag (±4 gauss):``."""
_DIGITS: Final = re.compile(r"(?<![\w.^])\d[\d.]*")
_MONTH: Final = r"(?:Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec)[a-z]*\.?"
_YEAR: Final = r"(?:19|20)\d\d"
_DAY: Final = (
    rf"(?:{_YEAR}(?:-\d\d?-\d\d?|/\d\d?/\d\d?|\.\d\d\.\d\d)|\d\d?(?:-\d\d?-|/\d\d?/|\.\d\d?\.){_YEAR}|\d\d?/\d\d?/\d\d"
    rf"|{_MONTH}\s+\d\d?(?:st|nd|rd|th)?(?:,?\s+{_YEAR})?|\d\d?[\s/-]{_MONTH}[\s/-]{_YEAR})"
)
_TIME: Final = (
    r"(?:[01]?\d|2[0-3]):[0-5]\d(?::[0-5]\d(?:[.,]\d+)?)?(?:\s?(?:[AP]M|[ap]m)\b)?"
    r"(?:\s?(?:Z|UTC|GMT)\b|\s?[+-]\d\d:?\d\d)?"
)
MOMENT: Final = re.compile(
    rf"(?<![\w.:+-])(?:{_DAY}(?:[T\s,:]+{_TIME})?|{_TIME}(?:\s+{_DAY})?|\d+(?:\.\d+){{2,}})(?![\w:/]|[.-]\d)"
)
"""A date, a time of day or both, with the time zone; or a version. Numbers in it are not readings."""
_MAY_BE_MOMENT: Final = re.compile(r"\d(?:[:/-]\d|\.\d+\.\d)|Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec")
_MAY_BE_NUMBERED: Final = re.compile(r"\d[)\]]?\s*[:=]|\d[)\]]\s+[xyzXYZ]\b")
"""Quick tests for a `MOMENT`, and for the number of a sensor; they take a third of the time of the full patterns."""
_NON_FIELD_UNIT: Final = re.compile(
    r"\s*(?:km/h|kmh|kph|mph|kn|kts?|knots?|m/s|mps|deg|degrees?|°|º|hz|hpa|mbar|%|volts?|ms|rpm)(?![\w/])",
    re.IGNORECASE,
)
"""Text after a number of a quantity other than a field, such as a speed or an angle."""
_TELEPLOT: Final = re.compile(r"^(\s*>[^:|\s]+:)\d+(?:\.\d+)?:(?=[-+.\d])")  # a time: ``>mag_x:1627551892437:-20.8``
_PLAIN: Final = r"([-+]?\d+(?:\.\d*)?)"

_OTHER_UNITS: Final = (  # of quantities next to a magnetometer that are not read
    "deg", "degs", "degree", "degrees", "°", "º", "hz", "hpa", "%", "rad", "mbar", "ft", "f", "°f", "mm", "cm",
)  # fmt: skip
_UNIT: Final = "|".join(
    re.sub("^(micro|milli|nano)(?=tesla|gauss)", r"\1[\\s-]?", re.escape(unit))
    for unit in sorted(
        {*_OTHER_UNITS, *(unit for units in FACTORS.values() for unit in units)}, key=lambda unit: (-len(unit), unit)
    )
)
_KNOWN_UNIT: Final = rf"((?:{_UNIT}|[^\x00-\x7f]{{1,3}}T))"
_UNIT_AHEAD: Final = re.compile(rf"[\[(]?{_KNOWN_UNIT}[\])]?(?=$|[\s,;|)\]}}/])(?!\s*[:=])", re.IGNORECASE)
"""A unit directly after a number; ``T:`` is a label."""
_UNIT_INSIDE: Final = re.compile(
    rf"(?:[(\[]\s*|\bin\s+){_KNOWN_UNIT}\s*[)\]]?(?=[\s:=]*(?:$|[(\[]|[xyz]\b))", re.IGNORECASE
)
"""A unit in brackets at the end of a label, or after ``in``."""
_UNIT_AND_AXIS: Final = re.compile(rf"{_KNOWN_UNIT}\s+([xyz])", re.IGNORECASE)  # ``Gauss X``
_SENSOR_AND_UNIT: Final = re.compile(r"\s*\[(\w{3,})/(\w+)\]")  # ``LSM303AGR [mag/mgauss]``
_BRACKET: Final = re.compile(r"(?<=[^\W_])\s*[(\[]([^()\[\]]*)[)\]]")  # after the words of a label
_LEVEL: Final = re.compile(r"\b(?:trace|debug|info|notice|warn(?:ing)?|err(?:or)?)\b", re.IGNORECASE)  # log level
_TICKS: Final = re.compile(r"[DEIVW] \(")  # before milliseconds in the log of ESP-IDF: ``I (400) tag:``
_REMARK: Final = re.compile(r"^\s*\([^()]*\)\s+(?=\w)")  # remark on the number before it: ``type=8(magn_x) index=0``
_EDGE: Final = " \t,;:=|()[{}<>\"'-#*/>→~&$!"  # characters around the words of a label
_CLOSING_SIGNS: Final = " )]}§"  # characters that close brackets around the number before them
_SIGNS_BEFORE_NUMBER: Final = " \t,;:=|[{<>\"'-#*/→~"  # characters between a label and its number
_LABEL: Final = re.compile(
    r"^[\W\d_]*[^\W\d_][^:=\[({]*[:=\[({]"
)  # a letter, followed by the character that ends a label
_LABEL_SEPARATORS: Final = re.compile(r"(?:[\s:=|>\"'{,;]|(?<=\s)-(?=\s))+")
_XYZ: Final = re.compile(r"(?:^|[\s(\[])x[\s,/]*y[\s,/]*z$", re.IGNORECASE)  # a label of all three axes: ``Mag XYZ``
_AXIS: Final = re.compile(r"(?:^|[\s_.\-/(])([xyz])(?:[\s_-]*(?:axis|component|value))?$", re.IGNORECASE)
"""An axis at the end of a label."""
_AXIS_AHEAD: Final = re.compile(
    r"([xyz])[\s_-]*(?:axis\b)?[\s_-]*(raw|norm|field|mag(?:net\w*)?|acc\w*|gyro?\w*|value)?\b(.*)", re.IGNORECASE
)
"""An axis at the start of a label: ``X axis field``, ``Xraw``."""
QUANTITY: Final = re.compile(
    r"orient|euler|linear|gravity|rotat|posit|\bpos\b|veloc|quat|angle|\bang\b|attitude|tilt|speed|displace|force"
    r"|heading|azimuth|bearing|roll|pitch|yaw|\b(?:ypr|rpy|areal|aworld|(?:min|max)(?:imum)?)\b",
    re.IGNORECASE,
)
"""Quantities with three axes other than the field. Their words stay with the axis; meaningless words are dropped."""
_MEANINGLESS: Final = re.compile(r"\b(value|reading|data|component|axis)s?\b", re.IGNORECASE)
_MAX_WORDS: Final = 3  # number of last words of a label that are tried if the label as a whole has no meaning


# Bytes to lines -------------------------------------------------------------------------------------------------------


def shorten(text: str) -> str:
    """Shorten a line for a message, without characters that control a terminal."""
    cut = text.strip()[: SHOWN_LETTERS + 1]
    clean = "".join(letter if letter.isprintable() else " " if letter == "\t" else "\ufffd" for letter in cut)
    return clean if len(clean) <= SHOWN_LETTERS else clean[: SHOWN_LETTERS - 1] + "…"


def list_columns(names: Sequence[str]) -> str:
    """The first names of columns and the number of further ones, since a table may have thousands.

    >>> list_columns([str(place) for place in range(26)])[-16:]
    '23, and 2 others'
    """
    more = f", and {len(names) - MAX_NAMES:,} others" if len(names) > MAX_NAMES else ""
    return ", ".join(map(shorten, names[:MAX_NAMES])) + more


# A printed line to numbers --------------------------------------------------------------------------------------------


def split_line(line: str) -> tuple[list[str], tuple[str, ...]]:
    """Split a line into its numbers and the stripped texts before, between and after the numbers."""
    line = _COLOURS.sub("", line) if "\x1b" in line else line
    line = _CHECK_SUM.sub("", line) if line.startswith("$") else line
    line = _TELEPLOT.sub(r"\1", line) if ">" in line else line
    line = separate_numbers(line)
    line = MOMENT.sub(" ", line) if _MAY_BE_MOMENT.search(line) else line
    line = _SENSOR_NUMBER.sub(r"\1\2", line) if _MAY_BE_NUMBERED.search(line) else line
    line = _REMARK_AFTER_LABEL.sub(_without_numbers, line) if "(" in line or "[" in line else line
    pieces = _CUT.split(_LOOSE_SIGN.sub(" -", line) if "- " in line else line)
    return [decimal(number) for number in pieces[1::2]], tuple(piece.strip() for piece in pieces[::2])


def compile_pattern(gaps: Sequence[str]) -> re.Pattern[str]:
    """Pattern of lines with exactly these gaps, which takes a third of the time of `split_line`."""
    inner = [rf"\s*{re.escape(gap)}\s*" if gap else r"\s+" for gap in gaps[1:-1]]
    ends = [rf"\s*{re.escape(gap)}\s*" for gap in (gaps[0], gaps[-1])]
    return re.compile(ends[0] + "".join(f"{_PLAIN}{gap}" for gap in inner) + _PLAIN + ends[1])


# Names of columns from the texts between numbers ----------------------------------------------------------------------


@lru_cache(1024)
def names_of(gaps: tuple[str, ...]) -> tuple[str, ...]:
    """Names of columns, by label, axis and unit in the gaps of `split_line`; empty for a number without a label."""
    behind = [_unit_and_label(gap) for gap in gaps[1:]]
    ahead = "time (ms)" if _TICKS.fullmatch(gaps[0]) else _label(gaps[0])
    labels, units = [ahead, *(label for _, label in behind[:-1])], [unit for unit, _ in behind]
    names: list[str] = []
    sensor = ""
    for first, count in _number_runs(labels):
        label, unit = _without_unit(labels[first])
        sensor = sensor if label == labels[first] else ""
        axes, sensor = _axes(label, count, sensor)
        stated = unit or next((each for each in units[first : first + count][::-1] if each), "")
        for place in range(count):
            units[first + place] = units[first + place] or stated
        names += axes
    return tuple(
        f"{name} ({unit})" if unit else name for name, unit in zip(names, _share_units(names, units), strict=True)
    )


def pattern_of(line: str) -> str:
    """The ``--pattern`` for a line, such as ``<{x}/{y}/{z}/{n4}>``; empty if no three numbers may be x, y, z.

    Numbers of a date, a check sum, a speed or an angle are not used.

    >>> pattern_of("12:30:00 <1/2/3/4>"), pattern_of("$VTG,5 kn,1,2,3*3A"), pattern_of("12:30:00 5 km/h 1 2")
    ('<{x}/{y}/{z}/{n4}>', '$VTG,{n1} kn,{x},{y},{z}', '')
    """
    line = _CHECK_SUM.sub("", line) if line.startswith("$") else line
    written = (_as_pattern(stretch.strip()) for stretch in reversed(MOMENT.sub("\n", line).split("\n")))
    return next((pattern for pattern in written if "{z}" in pattern), "")


def _as_pattern(text: str) -> str:
    """Text without dates, with names in place of its numbers."""
    pieces = re.split(rf"((?!(?<=[A-Za-z]{{3}} )\d{{1,2}}\s*:(?!\d)){NUMBER})", text)
    axes = iter("xyz")
    for place in range(1, len(pieces), 2):
        own = "" if _NON_FIELD_UNIT.match(pieces[place + 1]) or QUANTITY.search(pieces[place - 1]) else next(axes, "")
        pieces[place] = f"{{{own or f'n{place // 2 + 1}'}}}"
    return "".join(pieces)


@lru_cache(1024)
def label_of(gaps: tuple[str, ...]) -> str:
    """All words before and between the numbers of a line; they identify the lines of one sensor.

    >>> label_of(("Foo: X=", "Y=", "Z=", "uT")), label_of(("[INFO] Foo X:", "Y:", "Z:", ""))
    ('fooxyz', 'fooxyz')
    """
    return "".join(filter(str.isalnum, _LEVEL.sub("", " ".join(gaps[:-1])))).casefold()


def is_labelled(gaps: Sequence[str]) -> bool:
    """Whether labels such as ``X:``, ``x=`` or ``mag [`` separate the numbers, and not only commas."""
    return any(gap[-1] in "xyzXYZ" or any(map(_LABEL.search, re.split("[,;]", gap))) for gap in gaps[:-1] if gap)


def _unit_and_label(gap: str) -> tuple[str, str]:
    """Split the text between two numbers into the unit of the first and the label of the second."""
    text = gap.lstrip(_CLOSING_SIGNS)
    unit = _UNIT_AHEAD.match(text)
    return (unit[1], _label(text[unit.end() :])) if unit else ("", _label(text))


def _label(text: str) -> str:
    """Words of a label without the signs around them; brackets around a unit at the end stay."""
    text = _SENSOR_AND_UNIT.sub(r" \1 (\2)", _REMARK.sub("", _LEVEL.sub("", text).rstrip(_SIGNS_BEFORE_NUMBER)))
    inside = _UNIT_INSIDE.search(text)
    text = text if inside else _BRACKET.sub(_remark, text)
    words = _LABEL_SEPARATORS.sub(" ", _UNIT_INSIDE.sub(" ", text).strip(_EDGE)).strip(_EDGE)
    return f"{words} ({inside[1]})".lstrip() if inside else words


def _without_numbers(remark: re.Match[str]) -> str:
    """A remark with ``#`` in place of each number."""
    return _DIGITS.sub("#", remark[0])


def _remark(bracket: re.Match[str]) -> str:
    """Words of a remark after a label, if they distinguish readings, such as ``raw`` and ``left``."""
    return "".join(f" {word}" for word in re.findall(r"\w+", bracket[1]) if identifies_readings(word.casefold()))


def _without_unit(label: str) -> tuple[str, str]:
    if ahead := _UNIT_AND_AXIS.fullmatch(label):
        return ahead[2], ahead[1]
    inside = _UNIT_INSIDE.search(label)
    return (label[: inside.start()].rstrip(), inside[1]) if inside else (label, "")


def _number_runs(labels: Sequence[str]) -> Iterator[tuple[int, int]]:
    """Yield the place of each label and the number of numbers after it, up to the next label."""
    starts = [place for place, label in enumerate(labels) if label or place == 0]
    for start, end in zip(starts, [*starts[1:], len(labels)], strict=True):
        yield start, end - start


def _axes(label: str, count: int, sensor: str) -> tuple[list[str], str]:
    """Names of the numbers after one label, and the sensor of the labels that follow if they are only an axis."""
    bare = _XYZ.sub("", label).strip(_EDGE)
    if count == 3 and (label or sensor):
        named = bare if QUANTITY.search(bare) else _meaningful_words(bare, " x") if bare else ""
        return [f"{named} {axis}".lstrip() for axis in "xyz"], named
    if count > 1:
        return [f"{label} {number} of {count}" if label else "" for number in range(1, count + 1)], ""
    if (ahead := _AXIS_AHEAD.fullmatch(label)) and (ahead[2] or not ahead[3]):
        label = " ".join((*_MEANINGLESS.sub(" ", f"{ahead[2] or ''} {ahead[3]}").split(), ahead[1]))
        if str(ahead[2]).casefold() == "norm":  # no reading of a sensor, whatever its label
            return [label], sensor
    if axis := _AXIS.search(label):
        own = label[: axis.start()].strip(_EDGE)
        words = own if QUANTITY.search(own) else _meaningful_words(own, f" {axis[1]}", otherwise="") or sensor
        return [f"{words} {axis[1]}".lstrip()], words
    return [_meaningful_words(label) if label else ""], ""


def _meaningful_words(label: str, ending: str = "", otherwise: str | None = None) -> str:
    """A label, or its last words, if it names a known quantity; else `otherwise`, or the last word."""
    words = label.split()
    for count in (len(words), *range(min(_MAX_WORDS, len(words) - 1), 0, -1)):
        some = " ".join(words[len(words) - count :])
        if some and meaning(some + ending).kind:
            return some
    return (words[-1] if words else "") if otherwise is None else otherwise


def _share_units(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Units with the only stated unit of three consecutive axes copied to all three."""
    known = list(units)
    axes = [name[-1:].casefold() for name in names]
    for place in range(len(names) - 2):
        stated = set(known[place : place + 3]) - {""}
        if axes[place : place + 3] == ["x", "y", "z"] and len(stated) == 1:
            known[place : place + 3] = [*stated] * 3
    return known
