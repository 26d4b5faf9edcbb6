r"""Lines of text into numbers: a block at once where all its lines are sound, else line by line.

Where pyarrow is installed, large files of plain lines take less time: `parser_of` gives the numbers that `rows_of`
would give, bit for bit, or none at all where there is any doubt; it never decides what a line is.

>>> split("1;2,5;nan", ";"), number("2,5", ","), number("two", ".")
(['1', '2,5', 'nan'], 2.5, None)
>>> from flinders.readers._lines import Lines
>>> parse = parser_of(Grid(",", ".", 3, (0, 2), frozenset({0, 2})))
>>> if parse:  # it is installed
...     assert parse(Lines(1, "1,noon,2.5\n-4e-1,dusk,6", 2, 24)).tolist() == [[1.0, 2.5], [-0.4, 6.0]]
...     assert parse(Lines(1, "1,noon,2.5\n,dusk,6", 2, 19)) is None  # an empty cell
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import repeat
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from flinders.readers._lines import CUT_OFF

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.readers._lines import Lines

SPACES: Final = " "  # The delimiter that stands for any run of spaces and tabs
MISSING: Final = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none"})
"""What loggers write where there is no value."""
MINUS: Final = "\N{MINUS SIGN}"  # What text processors make of a hyphen before a number
GLUED: Final = re.compile(r"(?<!\S)[-+]?\d*[.,]\d+(?:-\d*[.,]\d+)+(?!\S)")
"""Decimals that only the sign of the next one parts: ``2995.10-5044.85``."""
Parse: TypeAlias = "Callable[[Lines], Floats | None]"
"""Gives the (lines.count, len(grid.cells)) numbers of a stretch of lines, or None where that is left to `rows_of`.

The lines may be good, bad or blank, but no comments and no header."""
LEAST_FOR_ARROW: Final = 8 << 20
"""Bytes of a file from which on pyarrow saves more time than its import takes: 17 ms a MB, against 0.05 to 0.1 s."""
BLOCKS_AT_ONCE: Final = 6
"""Blocks of lines that are read at once: a call by itself costs 0.4 ms, a quarter of what the numbers of a block do."""
DOUBTFUL: Final = ('"', "(", "\ufeff", CUT_OFF)
"""What lines may not hold: quotes, what pyarrow alone takes for a number (``nan(1)``, one after a byte order mark), and
the mark of a line that was cut."""
PIECE: Final = 128  # Lines that go the slow way together when one of them is unsound


@dataclass(frozen=True, slots=True)
class Grid:
    """How a line is cut into cells, and which of them are read."""

    delimiter: str  # one character; `SPACES` for any run of spaces and tabs
    decimal: str
    width: int  # cells in a line; 0 where that differs from line to line
    cells: tuple[int, ...]  # the ones that are read, counted from 0
    needed: frozenset[int]  # the ones of them without which a line cannot be used; in others, text reads as NaN


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
    """Cut a line into cells, quotes taken off and spaces around them left on."""
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


def unglued(text: str) -> str:
    """Part decimals in columns of a fixed width that a minus has filled up."""
    return GLUED.sub(lambda match: match[0][0] + match[0][1:].replace("-", " -"), text) if "-" in text else text


@lru_cache(4096)
def number(cell: str, decimal: str) -> float | None:
    """Read a cell: NaN where it is empty or says so, None where it is text."""
    text = cell.strip()
    if text.casefold() in MISSING:
        return math.nan
    if decimal == ",":
        if text.endswith(","):
            return None
        text = text.replace(",", ".")
    try:
        return None if "_" in text else float(text.replace(MINUS, "-"))
    except ValueError:
        return None


def fits(cells: list[str], width: int) -> bool:
    """Tell whether a line has as many cells as the others; a delimiter at its end does no harm."""
    return len(cells) == width or (len(cells) > width and not any(cell.strip() for cell in cells[width:]))


def _at_once(texts: list[str], grid: Grid) -> Floats:
    """Read lines that all have the same number of cells, all of the read ones numbers; else ValueError."""
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
    read = [(line, text, row_of(split(text, grid.delimiter), grid)) for line, text in zip(lines, texts, strict=True)]
    values = [row for _, _, row in read if row is not None]
    unreadable = [(line, text) for line, text, row in read if row is None]
    good = [line for line, _, row in read if row is not None]
    return NumberRows(np.array(values, dtype=float).reshape(-1, len(grid.cells)), good, unreadable)


def row_of(cells: list[str], grid: Grid) -> list[float] | None:
    """Read the cells of one line, or None where it has the wrong number of them or text in a needed one."""
    if not fits(cells, grid.width) if grid.width else len(cells) <= max(grid.needed):
        return None
    row = []
    for cell in grid.cells:
        value = number(cells[cell], grid.decimal) if cell < len(cells) else math.nan
        if value is None and cell in grid.needed:
            return None
        row.append(math.nan if value is None else value)
    return row


def parser_of(grid: Grid) -> Parse | None:
    """Prepare to read lines that are cut alike.

    Parameters
    ----------
    grid : Grid
        How, and which cells are read.

    Returns
    -------
    Parse or None
        What gives no numbers where a line is blank, quoted or of another width, or a cell that is read holds no plain
        number. None where lines are cut in a way that pyarrow does not know, or it is not installed.
    """
    if not grid.width or grid.delimiter in (SPACES, grid.decimal):
        return None
    try:
        arrow, table = import_module("pyarrow"), import_module("pyarrow.csv")
    except ImportError:
        return None
    names = [str(cell) for cell in range(grid.width)]
    cut = table.ParseOptions(delimiter=grid.delimiter, quote_char=False)
    converted = table.ConvertOptions(
        include_columns=[names[cell] for cell in grid.cells],
        column_types=dict.fromkeys(names, arrow.float64()),
        null_values=[],  # an empty cell is an error, not a gap
        decimal_point=grid.decimal,
    )

    def parse(lines: Lines) -> Floats | None:
        if any(sign in lines.text for sign in DOUBTFUL):
            return None
        content = lines.text.encode()
        whole = table.ReadOptions(column_names=names, block_size=len(content) + 1)
        try:
            read = table.read_csv(
                arrow.BufferReader(content), read_options=whole, parse_options=cut, convert_options=converted
            )
        except arrow.ArrowException:
            return None
        if read.num_rows != lines.count:
            return None  # blank lines
        return np.array([column.to_numpy() for column in read.columns]).T

    return parse
