r"""Classification of lines between readings: lines that a program prints along with them, and damaged readings.

The shape of a line is its text without values, ``Heading: 0``. Lines whose shape recurs, with readings in between,
accompany the readings. Rests of a damaged reading never do, and neither do error messages in its place.

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

MIN_RETURNS: Final = 3  # times that a shape must recur, with readings in between, to accompany them
MIN_SHARE: Final = 0.005  # smallest number of recurrences, as a share of the readings
MIN_SHARE_OF_EACH: Final = 0.9  # share of recurrences from which a shape belongs to each reading
MAX_IN_A_ROW: Final = 10.0  # largest number of lines per recurrence; more are a burst
MAX_LENGTH: Final = 512  # characters of a line that are examined
MAX_SHAPES: Final = 1000  # largest number of stored shapes; garbage produces ever new ones
LEARNED_READINGS: Final = 400  # number of readings whose shapes are learned
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
_VALUE: Final = re.compile(r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_TITLE: Final = re.compile(r"[^\W\d_]{2}[^:=,;\d]*")
"""The first words of a line, up to its first value or the delimiter before that."""
_SEPARATE_VALUE: Final = re.compile(r"(?<![^\W_])0(?![^\W_])")  # a value that is not part of a word
_RULER: Final = re.compile(r"([^\w\s,;])\1")
_CLOSING: Final = re.compile(r"[\])}]+[,;]?")  # closing brackets; the end of a block unless readings have them
_FAILURE: Final = re.compile(
    r"\b(?:err(?:or)?s?|fail(?:ed|s|ure)?|time[ -]?out|timed out|nack|lost|overrun|overflow|invalid|bad"
    r"|no (?:data|response)|not ready|exception)\b",
    re.IGNORECASE,
)
"""Words of an error message in place of a reading."""


@dataclass(slots=True)
class _Shape:
    """Statistics of the lines of one shape."""

    example: str  # shape of its first line
    lines: int = 0
    returns: int = 0  # number of its lines with a reading since its previous line
    readings: int = -1  # number of readings before its latest line


class LineShapes:
    """Shapes of the lines of a recording so far."""

    def __init__(self) -> None:
        self._readings: dict[str, str] = {}  # letters of each shape of a reading
        self._titles: set[str] = set()  # first words of readings
        self._shapes: dict[str, _Shape] = {}  # shapes of other lines
        self._count = 0  # number of readings so far

    def add(self, text: str, *, is_reading: bool = False) -> None:
        """Count the next line; blank lines may be skipped."""
        if is_reading:
            self._count += 1
            if self._count <= LEARNED_READINGS:
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
        """Tell whether a line has a shape that accompanies the readings."""
        known = self._shapes.get(self._key(_shape_of(text)))
        if known is None or not self._recurs(known):
            return False
        shape = known.example
        is_sound = shape.isprintable() and "\ufffd" not in shape
        return is_sound and not _is_failure(shape) and not self._is_rest(known)

    def count_accompanying(self) -> int:
        """Number of lines so far that accompany readings."""
        return sum(known.lines for known in self._shapes.values() if self.accompanies(known.example))

    def _key(self, shape: str) -> str:
        """Key of a shape: its first words, unless readings start with them; else the whole shape."""
        title = _title_of(shape)
        return title if title and title not in self._titles else shape

    def _recurs(self, known: _Shape) -> bool:
        """Tell whether lines of a shape recur with readings in between, and not in bursts."""
        is_often = known.returns >= max(MIN_RETURNS, MIN_SHARE * self._count)
        return is_often and known.lines <= MAX_IN_A_ROW * known.returns

    def _is_rest(self, known: _Shape) -> bool:
        """Whether a line may be a fragment of a reading; a line of another sensor beside each reading is none."""
        shape, letters = known.example, _letters_of(known.example)
        is_of_each = known.returns >= MIN_SHARE_OF_EACH * self._count
        if not letters:
            is_end = _CLOSING.fullmatch(shape) and not any(shape in reading for reading in self._readings)
            return not (_RULER.search(shape) or is_end or (is_of_each and shape == "0"))
        for reading, of_reading in self._readings.items():
            is_another = is_of_each and letters != of_reading and shape.count("0") >= reading.count("0")
            if _has_cells_of(shape, reading) or (not is_another and _is_piece(letters, of_reading)):
                return True
        return False


def _shape_of(text: str) -> str:
    """The text of a line with zeros for its values."""
    return " ".join(_VALUE.sub("0", _COLOURS.sub("", text[:MAX_LENGTH])).split())


def _title_of(shape: str) -> str:
    match = _TITLE.search(shape)
    return match[0].strip() if match else ""


def _letters_of(shape: str) -> str:
    return "".join(filter(str.isalpha, shape))


def _is_failure(shape: str) -> bool:
    """Tell whether a line without a value is an error message."""
    return _FAILURE.search(shape) is not None and _SEPARATE_VALUE.search(shape) is None


def _is_piece(letters: str, reading: str) -> bool:
    """Tell whether the letters of a line are those of a cut line: part of a reading's letters, or its two ends."""
    ends = range(1, len(letters))
    is_gapped = any(reading.startswith(letters[:end]) and reading.endswith(letters[end:]) for end in ends)
    return letters in reading or is_gapped


def _has_cells_of(shape: str, row: str) -> bool:
    """Tell whether a line has as many cells as a table row, with words in place of numbers."""
    delimiters = row.replace("0", "").replace(" ", "")
    if not delimiters or any(map(str.isalpha, row)):
        return False
    return "".join(sign for sign in shape if sign in delimiters) == delimiters
