r"""Lines beside readings: those that a program prints with them, and those that should have been readings.

A shape is a line without its values, ``Heading: 0``. Lines of a shape that comes back again and again with readings
between accompany them. What is left of a cut reading does not, whatever it looks like, nor does an error in its place.

>>> shapes = LineShapes()
>>> for row in range(4):
...     shapes.add(f"X: {row} Y: -2.5 Z: 26.1", is_reading=True)
...     for text in (f"Heading: {row}", "-----", "X: 1 Y: -2", "Z: 26.1", "read failed"):
...         shapes.add(text)
>>> list(map(shapes.accompanies, ("Heading: 7", "-----", "X: 1 Y: -2", "Z: 26.1", "read failed", "Halt")))
[True, True, False, False, False, False]
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

MIN_RETURNS: Final = 3  # times that a shape comes back with readings between before it accompanies them
MIN_SHARE: Final = 0.005  # the same, as a share of the readings
EACH_TIME: Final = 0.9  # share from which on it comes with each reading
MAX_IN_A_ROW: Final = 10.0  # lines of one shape for each return; more are a burst
MAX_LENGTH: Final = 512  # characters of a line that is looked at
MAX_SHAPES: Final = 1000  # shapes that are remembered; garbage has new ones without end
LEARNED: Final = 400  # readings whose shapes are learned
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
_VALUE: Final = re.compile(r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_TITLE: Final = re.compile(r"[^\W\d_]{2}[^:=,;\d]*")
"""The first words of a line, up to its first value or the sign before that."""
_APART: Final = re.compile(r"(?<![^\W_])0(?![^\W_])")  # a value that is no part of a word
_RULER: Final = re.compile(r"([^\w\s,;])\1")
_CLOSING: Final = re.compile(r"[\])}]+[,;]?")  # ends a block of lines, unless readings have it
_FAILURE: Final = re.compile(
    r"\b(?:err(?:or)?s?|fail(?:ed|s|ure)?|time[ -]?out|timed out|nack|lost|overrun|overflow|invalid|bad"
    r"|no (?:data|response)|not ready|exception)\b",
    re.IGNORECASE,
)
"""What a line says that stands in place of a reading."""


@dataclass(slots=True)
class _Shape:
    """Lines of one shape."""

    example: str  # shape of the first
    lines: int = 0
    returns: int = 0  # of them, those with a reading between it and the one before
    readings: int = -1  # before the latest


class LineShapes:
    """Shapes of the lines of a recording so far."""

    def __init__(self) -> None:
        self._readings: dict[str, str] = {}  # shapes of readings, and the letters of each
        self._titles: set[str] = set()  # their first words
        self._shapes: dict[str, _Shape] = {}  # of other lines
        self._count = 0  # readings so far

    def add(self, text: str, *, is_reading: bool = False) -> None:
        """Take the next line; those that are blank need not come."""
        if is_reading:
            self._count += 1
            if self._count <= LEARNED:
                shape = _shape_of(text)
                self._readings[shape] = _letters_of(shape)
                self._titles.add(_title_of(shape))
            return
        shape = _shape_of(text)
        known = self._shapes.get(self._key(shape))
        if known is None:
            if len(self._shapes) >= MAX_SHAPES:
                return
            known = self._shapes[self._key(shape)] = _Shape(shape)
        known.lines += 1
        known.returns += known.readings < self._count
        known.readings = self._count

    def accompanies(self, text: str) -> bool:
        """Tell whether a line is of a shape that comes with the readings."""
        known = self._shapes.get(self._key(_shape_of(text)))
        if known is None or not self._comes_back(known):
            return False
        shape = known.example
        is_sound = shape.isprintable() and "\ufffd" not in shape
        return is_sound and not _fails(shape) and not self._is_rest(known)

    def count_accompanying(self) -> int:
        """Count the lines so far that accompany readings."""
        return sum(known.lines for known in self._shapes.values() if self.accompanies(known.example))

    def _key(self, shape: str) -> str:
        """What lines of one shape share: their first words, unless readings begin with these; else all."""
        title = _title_of(shape)
        return title if title and title not in self._titles else shape

    def _comes_back(self, known: _Shape) -> bool:
        """Tell whether lines of a shape come again and again with readings between, and in no burst."""
        is_often = known.returns >= max(MIN_RETURNS, MIN_SHARE * self._count)
        return is_often and known.lines <= MAX_IN_A_ROW * known.returns

    def _is_rest(self, known: _Shape) -> bool:
        """Tell whether a line may be what is left of a reading; not one of as many numbers that comes with each."""
        shape, letters = known.example, _letters_of(known.example)
        is_of_each = known.returns >= EACH_TIME * self._count
        if not letters:
            is_end = _CLOSING.fullmatch(shape) and not any(shape in reading for reading in self._readings)
            return not (_RULER.search(shape) or is_end or (is_of_each and shape == "0"))
        for reading, of_reading in self._readings.items():
            is_another = is_of_each and letters != of_reading and shape.count("0") >= reading.count("0")
            if _has_cells_of(shape, reading) or (not is_another and _is_piece(letters, of_reading)):
                return True
        return False


def _shape_of(text: str) -> str:
    """A line with zeros for its values."""
    return " ".join(_VALUE.sub("0", _COLOURS.sub("", text[:MAX_LENGTH])).split())


def _title_of(shape: str) -> str:
    match = _TITLE.search(shape)
    return match[0].strip() if match else ""


def _letters_of(shape: str) -> str:
    return "".join(filter(str.isalpha, shape))


def _fails(shape: str) -> bool:
    """Tell whether a line without a value says that a reading failed."""
    return _FAILURE.search(shape) is not None and _APART.search(shape) is None


def _is_piece(letters: str, reading: str) -> bool:
    """Tell whether letters are a piece of others, or their beginning and their end without what is between."""
    ends = range(1, len(letters))
    is_gapped = any(reading.startswith(letters[:end]) and reading.endswith(letters[end:]) for end in ends)
    return letters in reading or is_gapped


def _has_cells_of(shape: str, row: str) -> bool:
    """Tell whether a line has as many cells as the row of a table, with words for numbers."""
    delimiters = row.replace("0", "").replace(" ", "")
    if not delimiters or any(map(str.isalpha, row)):
        return False
    return "".join(sign for sign in shape if sign in delimiters) == delimiters
