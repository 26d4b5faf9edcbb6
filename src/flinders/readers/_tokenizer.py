r"""Bytes become lines, and lines become numbers: in a table by its delimiter, in a print with their labels and units.

Lines end with LF, CR LF or CR; one longer than `LONGEST` is cut, so that a file without line ends costs no more memory
than any other. A block of lines of a table is read at once where all of them are sound, else line by line. Where
pyarrow is installed, large files take less time: `parser_of` gives the numbers that `rows_of` would give, bit for bit,
or none at all where there is any doubt.

>>> split("1;2,5;nan", ";"), number("2,5", ","), number("two", ".")
(['1', '2,5', 'nan'], 2.5, None)
>>> parse = parser_of(Grid(",", ".", 3, (0, 2), frozenset({0, 2})))
>>> if parse:  # it is installed
...     assert parse(Lines(1, "1,noon,2.5\n-4e-1,dusk,6", 2, 24)).tolist() == [[1.0, 2.5], [-0.4, 6.0]]
...     assert parse(Lines(1, "1,noon,2.5\n,dusk,6", 2, 19)) is None  # an empty cell

In a print the text between two numbers holds the unit of the first and the label of the second. A label that is only an
axis belongs to the sensor named before it, and three numbers behind one label are its x, y and z.

>>> numbers, gaps = cut("Mag X: -20.8 Y: -20.2 Z: 0xff38 uT")
>>> numbers, gaps
(['-20.8', '-20.2', '-200'], ('Mag X:', 'Y:', 'Z:', 'uT'))
>>> names_of(gaps)
('Mag X (uT)', 'Mag Y (uT)', 'Mag Z (uT)')
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from itertools import repeat
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import numpy as np

from flinders.core.samples import BLOCK
from flinders.errors import UnreadableInput
from flinders.readers._names import FACTORS, meaning, tells_readings_apart

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.readers._clock import Clock, Midnights

LONGEST: Final = 1 << 20  # Characters in the longest line that is kept whole
MOST_IN_BLOCK: Final = 1 << 23  # Characters after which a block of lines ends early
CUT: Final = 60  # Characters shown of a line in a message
MOST_NAMED: Final = 24  # Columns named in a message
CUT_OFF: Final = "…"  # What stands at the end of a line that was longer than `LONGEST`
ENDS_EARLY: Final = "gzip ends early"  # What stands in place of the line in which a file was cut short
LINE_FEED: Final = np.uint8(10)
MARKS: Final = {  # byte order marks
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF32_LE: "utf-32", codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip

COMMENTS: Final = ("#", "%", "//")  # What a line that is none of a recording begins with
SPACES: Final = " "  # The delimiter that stands for any run of spaces and tabs
MISSING: Final = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none"})  # What loggers write for no value
MINUS: Final = "\N{MINUS SIGN}"  # What text processors make of a hyphen before a number
PIECE: Final = 128  # Lines that are read one by one where one of them is unsound
Parse: TypeAlias = "Callable[[Lines], Floats | None]"
LEAST_FOR_ARROW: Final = 8 << 20
"""Bytes of a file from which on pyarrow saves more time than its import takes: 17 ms a MB, against 0.05 to 0.1 s."""
BLOCKS_AT_ONCE: Final = 6
"""Blocks of lines that are read at once: a call by itself costs 0.4 ms, a quarter of what the numbers of a block do."""
DOUBTFUL: Final = ('"', "(", "\ufeff", CUT_OFF)
"""What pyarrow's lines may not hold: quotes, what it alone takes for a number (``nan(1)``), a line that was cut."""

ATTACHED: Final = r"[-+−]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|(?:nan|NaN|NAN|inf|ovf)(?!\w))"
"""A number, whatever stands before it."""
NUMBER: Final = r"(?<![\w.^])(?:(?<!\w[-+−])(?=[-+−])|(?<![-+−])(?![-+−]))(?!(?<=\w\[)\d+\])(?!(?<=<)inf>)" + ATTACHED
"""A number that is no part of a word, of ``m/s^2``, ``X-6`` or an index; Arduino prints ``nan``, ``inf`` and ``ovf``,
and Zephyr ``<inf>`` before what is information."""
GLUED: Final = re.compile(r"(?<!\S)[-+]?\d*[.,]\d+(?:-\d*[.,]\d+)+(?!\S)")  # ``2995.10-5044.85``
_CUT: Final = re.compile(f"({NUMBER})")
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")  # of a terminal, as the log of ESP-IDF has them
_CHECK_SUM: Final = re.compile(r"\*[0-9a-fA-F]{2}\s*$")  # ends a sentence of NMEA 0183, which begins with ``$``
_LOOSE_SIGN: Final = re.compile(r"(?<=[:=,(\[])\s*-\s+(?=[\d.])")  # ``X: - 12``
_NUMBERED: Final = re.compile(
    r"\b(?!(?:reading|sample|measurement|point|step|row|line|packet|frame|loop|count)\b)([^\W\d_]{3,})"
    r"(?: +|\s*(?=[(\[#]))[(\[#]*(\d{1,2})[)\]]?(?=\s*:(?!\d)|\s*=|(?<=[)\]])\s+[xyz]\b)",
    re.IGNORECASE,
)
"""The number of a sensor: ``Mag 1:``, ``Mag (1):``."""
_REMARKED: Final = re.compile(
    r"(?<=[^\W_])\s?[(\[][^()\[\]:=]*[^\W\d_][^()\[\]:=]*[)\]](?=\s*[:=]|\s+[xyz]\s*[:=])", re.IGNORECASE
)
"""A remark in brackets behind a label, in which numbers are no readings: ``Mag (±4 gauss):``."""
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
"""A date, a time of day, or both, with their zone, or a version: none of its numbers is a reading."""
_MAY_BE_MOMENT: Final = re.compile(r"\d(?:[:/-]\d|\.\d+\.\d)|Jan|Feb|Mar|Apr|May|Jun|Jul|Aug|Sep|Oct|Nov|Dec")
_MAY_BE_NUMBERED: Final = re.compile(r"\d[)\]]?\s*[:=]|\d[)\]]\s+[xyzXYZ]\b")
"""What a line with a `MOMENT`, and with the number of a sensor, has and few others: found in a third of the time."""
_OF_OTHERS: Final = re.compile(
    r"\s*(?:km/h|kmh|kph|mph|kn|kts?|knots?|m/s|mps|deg|degrees?|°|º|hz|hpa|mbar|%|volts?|ms|rpm)(?![\w/])",
    re.IGNORECASE,
)
"""What stands behind a number that is no magnetometer's: a speed, an angle."""
_TELEPLOT: Final = re.compile(r"^(\s*>[^:|\s]+:)\d+(?:\.\d+)?:(?=[-+.\d])")  # a time: ``>mag_x:1627551892437:-20.8``
_PLAIN: Final = r"([-+]?\d+(?:\.\d*)?)"
_BITS: Final = {2: 8, 4: 16, 6: 24, 8: 32}  # of a signed hexadecimal number with so many digits

_OTHER_UNITS: Final = (  # of what stands beside a magnetometer and is not read
    "deg", "degs", "degree", "degrees", "°", "º", "hz", "hpa", "%", "rad", "mbar", "ft", "f", "°f", "mm", "cm",
)  # fmt: skip
_UNIT: Final = "|".join(
    re.sub("^(micro|milli|nano)(?=tesla|gauss)", r"\1[\\s-]?", re.escape(unit))
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
_BRACKET: Final = re.compile(r"(?<=[^\W_])\s*[(\[]([^()\[\]]*)[)\]]")  # behind the words of a label
_LEVEL: Final = re.compile(r"\b(?:trace|debug|info|notice|warn(?:ing)?|err(?:or)?)\b", re.IGNORECASE)  # of a log
_TICKS: Final = re.compile(r"[DEIVW] \(")  # before milliseconds, in the log of ESP-IDF: ``I (400) tag:``
_REMARK: Final = re.compile(r"^\s*\([^()]*\)\s+(?=\w)")  # on the number before: ``type=8(magn_x) index=0``
_EDGE: Final = " \t,;:=|()[{}<>\"'-#*/>→~&$!"  # what stands around the words of a label
_BEHIND: Final = " )]}§"  # what closes brackets around the number before
_BEFORE: Final = " \t,;:=|[{<>\"'-#*/→~"  # what stands between a label and its number
_LABEL: Final = re.compile(r"^[\W\d_]*[^\W\d_][^:=\[({]*[:=\[({]")  # a letter, and behind it the sign that ends a label
_BETWEEN: Final = re.compile(r"(?:[\s:=|>\"'{,;]|(?<=\s)-(?=\s))+")
_XYZ: Final = re.compile(r"(?:^|[\s(\[])x[\s,/]*y[\s,/]*z$", re.IGNORECASE)  # a label of all three: ``Mag XYZ``
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
_WORDS: Final = 3  # last words of a label that are tried when all of it says nothing


# Bytes to lines -------------------------------------------------------------------------------------------------------


class EndsEarly(Exception):
    """Compressed bytes without their end: what came before is sound. Never leaves the readers."""

    def refusal(self, name: str) -> UnreadableInput:
        """Say so, where nothing came before."""
        return UnreadableInput(f"{name} is cut short: its gzip data have no end; copy it again")


@dataclass(frozen=True, slots=True)
class Lines:
    """Consecutive lines of a text."""

    first: int  # the number of the first
    text: str  # all of them, with LF between them
    count: int
    done: int  # bytes of the file read so far

    @property
    def numbers(self) -> range:
        """That of each."""
        return range(self.first, self.first + self.count)

    def blocks(self) -> Iterator[Lines]:
        """Cut them into blocks of `BLOCK`."""
        if self.count <= BLOCK:
            yield self
            return
        texts = self.texts
        for start in range(0, self.count, BLOCK):
            some = texts[start : start + BLOCK]
            yield Lines(self.first + start, "\n".join(some), len(some), self.done)

    @property
    def texts(self) -> list[str]:
        """Each by itself, cut anew each time."""
        return self.text.split("\n") if self.count else []


def lines_of(
    chunks: Iterable[bytes], encoding: str, done: Callable[[], int], least: int = BLOCK, blocks: int = 1
) -> Iterator[Lines]:
    """Yield all lines, `BLOCK` at a time, after the first `blocks` blocks at a time; wait for `least` lines."""
    first, together = 1, 1
    pending, count = "", 0
    for text in _whole(_decoded(chunks, encoding)):
        pending += text
        count += _ends_in(text)
        while count >= least * together or len(pending) - count > MOST_IN_BLOCK:
            taken = min(count, BLOCK * max(min(count // BLOCK, together), 1))
            end = _end_of(pending, taken, count - taken)
            yield Lines(first, pending[: end - 1], taken, done())
            first, pending, count, together = first + taken, pending[end:], count - taken, blocks
    if pending:
        yield Lines(first, pending[:-1], count, done())


def encoding_of(head: bytes) -> str:
    """Tell how text is encoded: by its byte order mark, else UTF-8 where it decodes, else Latin-1."""
    if mark := next((mark for mark in MARKS if head.startswith(mark)), b""):
        return MARKS[mark]
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character cut off at the end is no error
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def shown(text: str) -> str:
    """Cut a line to what fits in a message, without characters that a terminal would act on."""
    cut = text.strip()[: CUT + 1]
    clean = "".join(letter if letter.isprintable() else " " if letter == "\t" else "\ufffd" for letter in cut)
    return clean if len(clean) <= CUT else clean[: CUT - 1] + "…"


def listed(names: Sequence[str]) -> str:
    """The first names of columns, and how many more there are: a table may have thousands.

    >>> listed([str(place) for place in range(26)])[-16:]
    '23, and 2 others'
    """
    more = f", and {len(names) - MOST_NAMED:,} others" if len(names) > MOST_NAMED else ""
    return ", ".join(map(shown, names[:MOST_NAMED])) + more


def _decoded(chunks: Iterable[bytes], encoding: str) -> Iterator[str]:
    """Decode chunk by chunk, with every line end as LF; bytes that mean nothing become U+FFFD."""
    decoder = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)("replace"), translate=True)
    for chunk in chunks:
        yield decoder.decode(chunk)
    yield decoder.decode(b"", final=True)


def _whole(texts: Iterator[str]) -> Iterator[str]:
    """Cut text behind line ends; what exceeds `LONGEST` in a line is dropped, with a mark that no number has."""
    rest = ""
    try:
        for text in texts:
            rest += text
            end = rest.rfind("\n") + 1
            whole, rest = rest[:end], rest[end : end + LONGEST + 1]
            if whole:
                end = whole.index("\n")
                yield whole if end <= LONGEST else _shortened(whole[:end]) + whole[end:]
    except EndsEarly:
        rest = ENDS_EARLY  # the line before the cut may have lost digits
    if rest:
        yield _shortened(rest) + "\n"


def _ends_in(text: str) -> int:
    """Count line ends, in a third of the time that ``text.count`` takes."""
    return int(np.count_nonzero(np.frombuffer(text.encode(), np.uint8) == LINE_FEED))


def _end_of(text: str, before: int, after: int) -> int:
    """Find the place behind so many lines, which is before so many, from the nearer end."""
    if before < after:
        return len(text) - len(text.split("\n", before)[-1])
    return len(text.rsplit("\n", after + 1)[0]) + 1


def _shortened(line: str) -> str:
    return line if len(line) <= LONGEST else line[:CUT] + CUT_OFF


# Lines of a table to numbers ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Grid:
    """How a line is cut into cells, and which of them are read."""

    delimiter: str  # one character; `SPACES` for any run of spaces and tabs
    decimal: str
    width: int  # cells in a line; 0 where that differs from line to line
    cells: tuple[int, ...]  # the ones that are read, counted from 0
    needed: frozenset[int]  # the ones of them without which a line cannot be used; in others, text reads as NaN
    clock: Clock | None = None  # how the one of them with the time is read, where that is no number

    def row(self, text: str) -> list[float] | None:
        """Read one line, or None where it has the wrong number of cells or text in a needed one."""
        cells = split(text, self.delimiter)
        if not fits(cells, self.width) if self.width else len(cells) <= max(self.needed):
            return None
        row = [number(cells[cell], self.decimal) if cell < len(cells) else math.nan for cell in self.cells]
        if any(value is None and cell in self.needed for cell, value in zip(self.cells, row, strict=True)):
            return None
        known = [math.nan if value is None else value for value in row]
        if self.clock:
            known[self.cells.index(self.clock.cell)] = self.clock.seconds(cells)
        return known

    def without_clock(self) -> Grid:
        """The same without the time."""
        cells = tuple(cell for cell in self.cells if not self.clock or cell != self.clock.cell)
        return replace(self, cells=cells, clock=None)


@dataclass(frozen=True, slots=True)
class NumberRows:
    """What was read from some lines."""

    values: Floats  # (N, len(cells)) as written, NaN where a cell is empty
    lines: Sequence[int]  # the line each row came from
    unreadable: list[tuple[int, str]]  # number and text of lines that are not rows

    @property
    def numbers(self) -> Floats:
        """(N,) `lines` as an array."""
        lines = self.lines
        return np.arange(lines.start, lines.stop, dtype=float) if isinstance(lines, range) else np.array(lines, float)

    def past(self, midnights: Midnights, grid: Grid) -> Self:
        """The same rows with times of day that go on past midnight."""
        if grid.clock and not grid.clock.is_dated:
            place = grid.cells.index(grid.clock.cell)
            self.values[:, place] = midnights.past(self.values[:, place])
        return self


def rows_of(texts: list[str], lines: Sequence[int], grid: Grid) -> NumberRows:
    """Read lines that are neither blank nor comments."""
    if not texts:
        return NumberRows(np.empty((0, len(grid.cells))), [], [])
    try:
        return NumberRows(_at_once(texts, grid), lines, [])
    except ValueError:
        if len(texts) <= PIECE:
            return _one_by_one(texts, lines, grid)
    pieces = [
        rows_of(texts[start : start + PIECE], lines[start : start + PIECE], grid)
        for start in range(0, len(texts), PIECE)
    ]
    return NumberRows(
        np.concatenate([piece.values for piece in pieces]),
        [line for piece in pieces for line in piece.lines],
        [line for piece in pieces for line in piece.unreadable],
    )


def split(text: str, delimiter: str) -> list[str]:
    """Cut a line into cells, quotes removed and spaces around them left on."""
    if text.endswith(CUT_OFF):
        return [text]
    if delimiter == SPACES:
        return unglued(text.replace('"', "")).split()
    if '"' not in text:
        return text.split(delimiter)
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return [text]


def quoted(cell: str) -> str:
    """Write a cell of a table that is separated by commas."""
    return '"' + cell.replace('"', '""') + '"' if any(sign in cell for sign in ',"\r\n') else cell


def number(cell: str, decimal: str) -> float | None:
    """Read a cell: NaN where it is empty or says so, None where it is text."""
    text = cell.strip()
    if decimal == ",":
        if text.endswith(","):
            return None
        text = text.replace(",", ".")
    try:
        return None if "_" in text else float(text.replace(MINUS, "-"))
    except ValueError:
        return math.nan if text.casefold() in MISSING else None


def fits(cells: list[str], width: int) -> bool:
    """Tell whether a line has as many cells as the others; a delimiter at its end does no harm."""
    return len(cells) == width or (len(cells) > width and not any(cell.strip() for cell in cells[width:]))


def _at_once(texts: list[str], grid: Grid) -> Floats:
    """Read lines that all have the same number of cells, all of the read ones numbers; else ValueError."""
    if clock := grid.clock:
        values = _at_once(texts, grid.without_clock())
        times = [clock.seconds(split(text, grid.delimiter)) for text in texts]
        return np.insert(values, grid.cells.index(clock.cell), times, axis=1)
    spaces, is_all = grid.delimiter == SPACES, len(grid.cells) == grid.width
    if grid.width and not is_all:  # else loadtxt sees to it
        cells = map(len, map(str.split, texts)) if spaces else map(str.count, texts, repeat(grid.delimiter))
        if set(cells) != {grid.width - (not spaces)}:
            raise ValueError
    if not grid.width and any(text.endswith(CUT_OFF) for text in texts):
        raise ValueError
    if grid.decimal == ",":
        if grid.delimiter == ",":
            raise ValueError  # quotes tell the two kinds of comma apart
        texts = [text.replace(",", ".") for text in texts]
    values = np.loadtxt(
        texts,
        delimiter=None if spaces else grid.delimiter,
        quotechar='"' if '"' in texts[0] else None,
        comments=None,
        usecols=None if is_all else grid.cells,
        ndmin=2,
    )
    if values.shape != (len(texts), len(grid.cells)):
        raise ValueError
    return values


def _one_by_one(texts: list[str], lines: Sequence[int], grid: Grid) -> NumberRows:
    read = [(line, text, grid.row(text)) for line, text in zip(lines, texts, strict=True)]
    values = [row for _, _, row in read if row is not None]
    unreadable = [(line, text) for line, text, row in read if row is None]
    good = [line for line, _, row in read if row is not None]
    return NumberRows(np.array(values, dtype=float).reshape(-1, len(grid.cells)), good, unreadable)


def parser_of(grid: Grid) -> Parse | None:
    """Prepare pyarrow to read lines without comments and header; None where it cannot cut them, or is not there.

    The parser gives (lines.count, len(grid.cells)) numbers, or None where a line is blank, quoted or of another width,
    or a cell that is read holds no plain number.
    """
    if not grid.width or grid.delimiter in (SPACES, grid.decimal):
        return None
    try:
        arrow, table = import_module("pyarrow"), import_module("pyarrow.csv")
    except ImportError:
        return None
    names, clock = [str(cell) for cell in range(grid.width)], grid.clock
    whole_grid, grid = grid, grid.without_clock()
    cut = table.ParseOptions(delimiter=grid.delimiter, quote_char=False)
    converted = table.ConvertOptions(
        include_columns=[names[cell] for cell in (*grid.cells, *(clock.cells if clock else ()))],
        column_types={
            **dict.fromkeys(names, arrow.float64()),
            **{names[cell]: arrow.string() for cell in (clock.cells if clock else ())},
        },
        null_values=[],  # an empty cell is an error, not a gap
        decimal_point=grid.decimal,
    )

    def parse(lines: Lines) -> Floats | None:
        if any(sign in lines.text for sign in DOUBTFUL):
            return None
        content = lines.text.encode()
        whole = table.ReadOptions(column_names=names, block_size=len(content) + 1, use_threads=False)
        try:
            read = table.read_csv(
                arrow.BufferReader(content),
                read_options=whole,
                parse_options=cut,
                convert_options=converted,
                memory_pool=arrow.system_memory_pool(),  # others keep what they gave back
            )
        except arrow.ArrowException:
            return None
        if read.num_rows != lines.count:
            return None  # blank lines
        columns = (column.combine_chunks() for column in read.columns[: len(grid.cells)])
        values = np.array([np.from_dlpack(column) for column in columns]).T  # `to_numpy` would import pandas: 44 MB
        if not clock:
            return values
        times = list(map(clock.seconds_of, *(column.to_pylist() for column in read.columns[len(grid.cells) :])))
        return np.insert(values, whole_grid.cells.index(clock.cell), times, axis=1)

    return parse


# A printed line to numbers --------------------------------------------------------------------------------------------


def cut(line: str) -> tuple[list[str], tuple[str, ...]]:
    """Cut a line into its numbers and what stands before, between and behind them, without spaces at the ends."""
    line = _COLOURS.sub("", line) if "\x1b" in line else line
    line = _CHECK_SUM.sub("", line) if line.startswith("$") else line
    line = _TELEPLOT.sub(r"\1", line) if ">" in line else line
    line = unglued(line)
    line = MOMENT.sub(" ", line) if _MAY_BE_MOMENT.search(line) else line
    line = _NUMBERED.sub(r"\1\2", line) if _MAY_BE_NUMBERED.search(line) else line
    line = _REMARKED.sub(_without_numbers, line) if "(" in line or "[" in line else line
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
        return number.replace(MINUS, "-")
    sign, digits = ("-", number[3:]) if number.startswith("-") else ("", number.lstrip("+")[2:])
    value, bits = int(digits, 16), _BITS.get(len(digits), 0)
    return f"{sign}{value - (1 << bits) if bits and value >> (bits - 1) else value}"


def unglued(text: str) -> str:
    """Part decimals in columns of a fixed width that a minus has filled up."""
    return GLUED.sub(lambda match: match[0][0] + match[0][1:].replace("-", " -"), text) if "-" in text else text


# What stands between numbers to names of columns ---------------------------------------------------------------------


@lru_cache(1024)
def names_of(gaps: tuple[str, ...]) -> tuple[str, ...]:
    """Name the columns of a line by label, axis and unit from the gaps of `cut`; empty names where no label stands."""
    behind = [_unit_and_label(gap) for gap in gaps[1:]]
    ahead = "time (ms)" if _TICKS.fullmatch(gaps[0]) else _label(gaps[0])
    labels, units = [ahead, *(label for _, label in behind[:-1])], [unit for unit, _ in behind]
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
    """Write a line as the ``--pattern`` of lines like it, ``<{x}/{y}/{z}/{n4}>``; empty where no three may be x, y, z.

    Numbers of a date, a check sum, a speed or an angle are none of these.

    >>> pattern_of("12:30:00 <1/2/3/4>"), pattern_of("$VTG,5 kn,1,2,3*3A"), pattern_of("12:30:00 5 km/h 1 2")
    ('<{x}/{y}/{z}/{n4}>', '$VTG,{n1} kn,{x},{y},{z}', '')
    """
    line = _CHECK_SUM.sub("", line) if line.startswith("$") else line
    written = (_as_pattern(stretch.strip()) for stretch in reversed(MOMENT.sub("\n", line).split("\n")))
    return next((pattern for pattern in written if "{z}" in pattern), "")


def _as_pattern(text: str) -> str:
    """Put names for the numbers of a text without dates."""
    pieces = re.split(rf"((?!(?<=[A-Za-z]{{3}} )\d{{1,2}}\s*:(?!\d)){NUMBER})", text)
    axes = iter("xyz")
    for place in range(1, len(pieces), 2):
        own = "" if _OF_OTHERS.match(pieces[place + 1]) or QUANTITY.search(pieces[place - 1]) else next(axes, "")
        pieces[place] = f"{{{own or f'n{place // 2 + 1}'}}}"
    return "".join(pieces)


@lru_cache(1024)
def label_of(gaps: tuple[str, ...]) -> str:
    """All words before and between the numbers of a line, which are the same in all lines of one sensor.

    >>> label_of(("Foo: X=", "Y=", "Z=", "uT")), label_of(("[INFO] Foo X:", "Y:", "Z:", ""))
    ('fooxyz', 'fooxyz')
    """
    return "".join(filter(str.isalnum, _LEVEL.sub("", " ".join(gaps[:-1])))).casefold()


def is_labelled(gaps: Sequence[str]) -> bool:
    """Tell whether signs of a label stand between the numbers, as ``X:``, ``x=`` or ``mag [``, and not commas only."""
    return any(gap[-1] in "xyzXYZ" or any(map(_LABEL.search, re.split("[,;]", gap))) for gap in gaps[:-1] if gap)


def _unit_and_label(gap: str) -> tuple[str, str]:
    """Cut what stands between two numbers into the unit of the first and the label of the second."""
    text = gap.lstrip(_BEHIND)
    unit = _UNIT_AHEAD.match(text)
    return (unit[1], _label(text[unit.end() :])) if unit else ("", _label(text))


def _label(text: str) -> str:
    """The words of a label, without the signs around them; brackets around a unit at its end stay."""
    text = _SENSOR_AND_UNIT.sub(r" \1 (\2)", _REMARK.sub("", _LEVEL.sub("", text).rstrip(_BEFORE)))
    inside = _UNIT_INSIDE.search(text)
    text = text if inside else _BRACKET.sub(_remark, text)
    words = _BETWEEN.sub(" ", _UNIT_INSIDE.sub(" ", text).strip(_EDGE)).strip(_EDGE)
    return f"{words} ({inside[1]})".lstrip() if inside else words


def _without_numbers(remark: re.Match[str]) -> str:
    """A remark with a sign in the place of its numbers."""
    return _DIGITS.sub("#", remark[0])


def _remark(bracket: re.Match[str]) -> str:
    """What a remark behind a label adds to it: words that tell readings apart, as ``raw`` and ``left`` do."""
    return "".join(f" {word}" for word in re.findall(r"\w+", bracket[1]) if tells_readings_apart(word.casefold()))


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
