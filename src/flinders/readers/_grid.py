r"""Numbers in the lines of a table: parsed block by block if all lines are valid, else line by line.

With pyarrow installed, large files take less time: `parser_of` yields the same numbers as `rows_of`, bit for bit, or
None in case of doubt.

>>> grid = Grid(",", ".", 3, (0, 2), frozenset({0, 2}))
>>> rows_of(["1,noon,2.5", "-4e-1,dusk,6"], range(1, 3), grid).values.tolist()
[[1.0, 2.5], [-0.4, 6.0]]
>>> parse = parser_of(grid)
>>> if parse:  # it is installed
...     assert parse(Lines(1, "1,noon,2.5\n-4e-1,dusk,6", 2, 24)).tolist() == [[1.0, 2.5], [-0.4, 6.0]]
...     assert parse(Lines(1, "1,noon,2.5\n,dusk,6", 2, 19)) is None  # an empty cell
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import repeat
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import numpy as np

from flinders.readers._cells import SPACES, has_width, parse_number, split
from flinders.readers._lines import CUT_MARK, Lines

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.readers._clock import Clock, Midnights

PIECE_LINES: Final = 128  # lines per piece; if a line is invalid, only its piece is parsed line by line
Parse: TypeAlias = "Callable[[Lines], Floats | None]"
MIN_BYTES_FOR_ARROW: Final = 8 << 20
"""Smallest file in bytes for which pyarrow is used. It saves 17 ms per MB; its import takes 0.05 to 0.1 s."""
BLOCKS_AT_ONCE: Final = 6
"""Blocks of lines per call of pyarrow. A call costs 0.4 ms, a quarter of the time that parsing a block takes."""
UNSAFE_TEXTS: Final = ('"', "(", "\ufeff", CUT_MARK)
"""Texts that pyarrow must not get: quotes, forms of numbers that only pyarrow accepts (``nan(1)``), a cut line."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Division of a line into cells, and the cells that are read."""

    delimiter: str  # one character; `SPACES` for any run of spaces and tabs
    decimal: str
    width: int  # cells in a line; 0 if the count varies
    cells: tuple[int, ...]  # places of the cells that are read, counted from 0
    needed: frozenset[int]  # places of cells that must be numbers; in other cells text is read as NaN
    clock: Clock | None = None  # clock of the time, if that is not numeric

    def row(self, text: str) -> list[float] | None:
        """Parse one line; None if it has the wrong number of cells, or text in a cell that must be a number."""
        cells = split(text, self.delimiter)
        if not has_width(cells, self.width) if self.width else len(cells) <= max(self.needed):
            return None
        row = [parse_number(cells[cell], self.decimal) if cell < len(cells) else math.nan for cell in self.cells]
        if any(value is None and cell in self.needed for cell, value in zip(self.cells, row, strict=True)):
            return None
        known = [math.nan if value is None else value for value in row]
        if self.clock:
            known[self.cells.index(self.clock.cell)] = self.clock.seconds(cells)
        return known

    def without_clock(self) -> Grid:
        """The same grid without its time column."""
        cells = tuple(cell for cell in self.cells if not self.clock or cell != self.clock.cell)
        return replace(self, cells=cells, clock=None)


@dataclass(frozen=True, slots=True)
class NumberRows:
    """Numbers read from some lines."""

    values: Floats  # (N, len(cells)) as written, NaN for an empty cell
    lines: Sequence[int]  # line number of each row
    unreadable: list[tuple[int, str]]  # number and text of lines that cannot be parsed as rows

    @property
    def numbers(self) -> Floats:
        """(N,) line numbers of the rows, as an array."""
        lines = self.lines
        return np.arange(lines.start, lines.stop, dtype=float) if isinstance(lines, range) else np.array(lines, float)

    def with_unwrapped_times(self, midnights: Midnights, grid: Grid) -> Self:
        """The same rows with times of day unwrapped past midnight."""
        if grid.clock and not grid.clock.is_dated:
            place = grid.cells.index(grid.clock.cell)
            self.values[:, place] = midnights.unwrap(self.values[:, place])
        return self


def rows_of(texts: list[str], lines: Sequence[int], grid: Grid) -> NumberRows:
    """Parse lines that are neither blank nor comments."""
    if not texts:
        return NumberRows(np.empty((0, len(grid.cells))), [], [])
    try:
        return NumberRows(_at_once(texts, grid), lines, [])
    except ValueError:
        if len(texts) <= PIECE_LINES:
            return _one_by_one(texts, lines, grid)
    pieces = [
        rows_of(texts[start : start + PIECE_LINES], lines[start : start + PIECE_LINES], grid)
        for start in range(0, len(texts), PIECE_LINES)
    ]
    return NumberRows(
        np.concatenate([piece.values for piece in pieces]),
        [line for piece in pieces for line in piece.lines],
        [line for piece in pieces for line in piece.unreadable],
    )


def _at_once(texts: list[str], grid: Grid) -> Floats:
    """Parse lines that all have the same number of cells, and numbers in all cells that are read; else `ValueError`."""
    if clock := grid.clock:
        values = _at_once(texts, grid.without_clock())
        times = [clock.seconds(split(text, grid.delimiter)) for text in texts]
        return np.insert(values, grid.cells.index(clock.cell), times, axis=1)
    spaces, is_all = grid.delimiter == SPACES, len(grid.cells) == grid.width
    if grid.width and not is_all:  # otherwise loadtxt checks the width
        cells = map(len, map(str.split, texts)) if spaces else map(str.count, texts, repeat(grid.delimiter))
        if set(cells) != {grid.width - (not spaces)}:
            raise ValueError
    if not grid.width and any(text.endswith(CUT_MARK) for text in texts):
        raise ValueError
    if grid.decimal == ",":
        if grid.delimiter == ",":
            raise ValueError  # quotes distinguish the two kinds of comma
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
    """Parser that uses pyarrow, for lines without comments and header; None if it cannot be used or is not installed.

    The parser returns (lines.count, len(grid.cells)) numbers. It returns None if a line is blank, quoted or of another
    width, or if a cell that is read holds no plain number.
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
        if any(sign in lines.text for sign in UNSAFE_TEXTS):
            return None
        content = lines.text.encode()
        whole = table.ReadOptions(column_names=names, block_size=len(content) + 1, use_threads=False)
        try:
            read = table.read_csv(
                arrow.BufferReader(content),
                read_options=whole,
                parse_options=cut,
                convert_options=converted,
                memory_pool=arrow.system_memory_pool(),  # other pools keep freed memory
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
