"""Lines of another dialect inside a wrapper: after a time stamp, or with hexadecimal words without ``0x``.

The text after a stamp is a dialect or a table; a stamp without a date counts from midnight. Words of 4, 6 or 8
hexadecimal digits are signed numbers. They are recognised by letters in some of the lines. An ascending first word
without letters is the time.

>>> from flinders.readers._recognition import recognise
>>> dialect = recognise(["14:03:00.100 -> X: 1 Y: 2 Z: 3", "14:03:00.200 -> X: 1 Y: 2 Z: 4"])
>>> dialect.words, dialect.names, dialect.row("14:03:00.300 -> X: 5 Y: 6 Z: 7")
('time stamps before labelled lines', ('time (s)', 'X', 'Y', 'Z'), ['50580.300', '5', '6', '7'])
>>> recognise(["2026-11-22 14:03:00 -> 1,2,3"]).row("2026-11-22 14:03:01 -> 4,5,6")
['1795356181.000', '4', '5', '6']
>>> dialect = recognise(["Mag: 0165 fe58 01a5", "Mag: 0160 0058 01a4"])
>>> dialect.words, dialect.row("Mag: 0010 fffe 0020")
('hexadecimal words in labelled lines', ['16', '-2', '32'])
>>> recognise(["9998 0165 fe58 01a5", "10018 0160 0058 01a4"]).row("10038 0010 fffe 0020")
['10038', '16', '-2', '32']
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, TypeAlias

from flinders.readers._clock import DATE, DAY_S, HALF_OF_DAY, order_of, seconds_of
from flinders.readers.dialects import Dialect

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Recognise: TypeAlias = "Callable[[list[str]], Dialect | None]"
STAMP: Final = re.compile(
    rf"\s*[\[(<]?(?:(?:{DATE}|\d\d[-/]\d\d|[DEFIVW]\d{{4}})(?:T|[ ,]\s*))?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)"
    rf"(?P<fraction>\.\d+|,\d+(?![.,\d]))?(?:,\d{{3}}(?=\]))?{HALF_OF_DAY}(?P<zone>Z|[+-]\d\d:?\d\d)?"
    r"[\])>]?\s*(?P<mark>->|[|>:;,\t]|-(?![\d.]))?\s*"
)
"""Time that a serial monitor, a logger or an operating system prints before a line."""
MIN_STAMP_SHARE: Final = 0.6  # smallest share of lines with a stamp
# smallest share of lines with a stamp, if the lines are neither a table nor in a dialect
MIN_STAMP_SHARE_OF_OTHERS: Final = 0.1
LETTERED_WORD: Final = re.compile(r"(?<![\w.+-])(?=\d*[a-fA-F])[0-9a-fA-F]{4,8}(?![\w.])")
SIGNED_WORD_DIGITS: Final = (4, 6, 8)  # number of digits in words of 16, 24 and 32 bits
WORDS: Final = {
    **{digits: re.compile(rf"(?<![\w.+-])[0-9a-fA-F]{{{digits}}}(?![\w.])") for digits in SIGNED_WORD_DIGITS},
    0: re.compile(r"(?<![\w.+-])[0-9a-fA-F]{1,8}(?![\w.])"),
}
_WORD_SEPARATORS: Final = re.compile(r"[\s,;]+")
MIN_WORDS: Final = 3  # smallest count of hexadecimal words in a line with a reading
# smallest share of lines that contain a letter, among lines with the same number of words
MIN_LETTER_SHARE: Final = 0.3


@dataclass(slots=True)
class Stamped(Dialect):
    """Lines of a dialect, or rows of a table, after a time stamp."""

    inner: Dialect
    order: str  # of day, month and year in numeric dates
    _midnights: float = field(default=0.0, init=False)
    _last: float = field(default=-1.0, init=False)

    def row(self, line: str) -> Sequence[str] | None:
        """Cells of a line with the time in front; the time continues past midnight."""
        stamp = STAMP.match(line)
        seconds = seconds_of(stamp, self.order) if stamp else None
        if stamp is None or seconds is None:
            return None
        cells = self.inner.row(line[stamp.end() :])
        if not cells:
            return cells
        if seconds + self._midnights < self._last - DAY_S / 2:
            self._midnights += DAY_S
        self._last = seconds + self._midnights
        return [f"{self._last:.6f}".removesuffix("000"), *cells]


@dataclass(slots=True)
class Hexadecimal(Dialect):
    """Lines whose last words are hexadecimal numbers of equal length."""

    inner: Dialect
    digits: int  # digits of each word; 0 if they vary
    count: int
    is_table: bool  # whether `inner` takes decimal numbers, rather than words with ``0x``

    def row(self, line: str) -> Sequence[str] | None:
        """Convert the hexadecimal words of a line for `inner`."""
        return self.inner.row(_convert_words(line, self.digits, self.count, in_decimals=self.is_table))


def find_stamps(
    lines: list[str], behind: Recognise, table: Recognise, *, marked: bool = True, share: float = MIN_STAMP_SHARE
) -> Stamped | None:
    """Find time stamps before at least `share` of the lines; None with fewer.

    If `marked`, a `table` after the stamps needs a separator such as ``->``.
    """
    filled = [line for line in lines if line.strip()]
    stamps = [stamp for line in filled if (stamp := STAMP.match(line))]
    if not stamps or len(stamps) < share * len(filled):
        return None
    marks = {stamp["mark"] for stamp in stamps}
    if marked and marks & {",", ";", "\t"}:
        return None
    rest = [stamp.string[stamp.end() :] for stamp in stamps]
    inner = behind(rest) or (table(rest) if all(marks) or not marked else None)
    if inner is None:
        return None
    return Stamped(f"time stamps before {inner.words}", ("time (s)", *inner.names), inner, order_of(stamps)[0])


def find_hexadecimal(lines: list[str], behind: Recognise, table: Recognise) -> Hexadecimal | None:
    """Find lines with three hexadecimal words of one length, or rows of such words of any length."""
    bare = [
        words for line in lines if len(words := _WORD_SEPARATORS.split(line.strip())) >= MIN_WORDS and _are_words(words)
    ]
    for digits, word in WORDS.items():
        rows = [words for line in lines if len(words := word.findall(line)) >= MIN_WORDS] if digits else bare
        lettered = [words for words in rows if not all(map(str.isdigit, words))]
        if not lettered or len(lettered) < MIN_LETTER_SHARE * len(rows) or len(rows) < MIN_STAMP_SHARE * len(bare):
            continue
        count = _hexadecimal_words(rows)
        inner = table([_convert_words(line, digits, count, in_decimals=True) for line in lines])
        if inner is not None:
            return Hexadecimal(f"hexadecimal words in {inner.words}", inner.names, inner, digits, count, is_table=True)
        inner = behind([_convert_words(line, digits, count) for line in lines]) if digits else None
        spoken = f"hexadecimal words in {inner.words}" if inner else ""
        return Hexadecimal(spoken, inner.names, inner, digits, count, is_table=False) if inner else None
    return None


def _are_words(words: list[str]) -> bool:
    """Whether all cells are hexadecimal words."""
    return all(map(WORDS[0].fullmatch, words))


def _hexadecimal_words(rows: list[list[str]]) -> int:
    """Number of hexadecimal words in each line; a decimal time before them may have as many digits as they."""
    count = min(map(len, rows))
    while count > MIN_WORDS and all(row[-count].isdigit() for row in rows):
        times = [int(row[-count]) for row in rows if len(row) == len(rows[0])]
        if sorted(times) != times or times[0] == times[-1]:
            break
        count -= 1
    return count


def _convert_words(line: str, digits: int, count: int, *, in_decimals: bool = False) -> str:
    """Prefix the last words of a given number of digits with ``0x``, or convert them to decimal numbers."""
    words = list(WORDS[digits].finditer(line))
    for word in reversed(words[-count:] if len(words) >= count else []):
        value = _signed_value(word[0]) if in_decimals else f"0x{word[0]}"
        line = f"{line[: word.start()]}{value}{line[word.end() :]}"
    return line


def _signed_value(word: str) -> int:
    """Two's complement of a word of 16, 24 or 32 bits; a shorter word, which lacks leading zeros, is positive.

    >>> _signed_value("FEBF"), _signed_value("13B"), _signed_value("FFFFFEBF")
    (-321, 315, -321)
    """
    value, bits = int(word, 16), 4 * len(word)
    return value - (1 << bits) if len(word) in SIGNED_WORD_DIGITS and value >> (bits - 1) else value
