"""Copies of a recording's lines in which the magnetometer's numbers are corrected."""

from __future__ import annotations

import re
from itertools import chain
from operator import ne
from typing import TYPE_CHECKING, Final

from flinders.core.samples import BLOCK_ROWS
from flinders.errors import UsageError
from flinders.readers._cells import SPACES, quote_cell, separate_numbers

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.readers._grid import NumberRows
    from flinders.readers._layout import TextLayout
    from flinders.readers._lines import Lines

NUMBER_FORMAT: Final = "%.9g"  # nine significant digits, as many as a float32 has
SUFFIX: Final = "_cal"


class Rewriter:
    """Replacement of numbers in lines, which leaves the rest unchanged; with `add` the numbers are appended instead."""

    def __init__(self, layout: TextLayout, *, add: bool) -> None:
        if layout.columns.reset is not None and not add:
            raise UsageError(
                f"each reading has two parts ({layout.columns.field.names[0]}, {layout.columns.reset.names[0]}), "
                "which one corrected reading cannot replace: add columns for corrected readings",
                hint={"add": True},
            )
        self._layout, self._add = layout, add
        self._delimiter = layout.grid.delimiter
        mark = re.escape(self._delimiter)
        spaces = rf"[^\S{mark}]*"  # a tab may be the delimiter
        self._cell = re.compile(rf'({spaces}"(?:[^"]|"")*"{spaces}(?={mark}|$)|[^{mark}]*)(?:{mark}|$)')

    def header_lines(self) -> Iterator[str]:
        """Yield a header line, if the recording has names of columns but no header line."""
        header = self._layout.header
        if header and not self._layout.header_line:
            yield self._name_added_columns(",".join(map(quote_cell, header))) + self._layout.newline

    def lines(self, lines: Lines, rows: NumberRows, field: Floats) -> Iterator[str]:
        """Yield these lines with their ends; `field` is (len(rows.lines), 3), in the unit of the recording."""
        if self._add or len(rows.lines) < lines.count or self._delimiter == SPACES or '"' in lines.text:
            return self._one_by_one(lines, rows, field)
        texts = lines.texts
        blocks = (slice(start, start + BLOCK_ROWS) for start in range(0, lines.count, BLOCK_ROWS))
        return chain.from_iterable(self._replace_numbers(texts[block], field[block]) for block in blocks)

    def _replace_numbers(self, texts: Sequence[str], field: Floats) -> Iterable[str]:
        """Replace numbers in lines that are all readings; by columns if all lines have the same unquoted cells."""
        delimiter, end = self._delimiter, self._layout.newline
        between = f"{delimiter}\n{delimiter}"
        cells = between.join(texts).split(delimiter)
        step = -(-len(cells) // len(texts))  # cells of a line, plus its end
        if cells[step - 1 :: step] != ["\n"] * (len(texts) - 1):
            return self._change_each(texts, field)
        for place, values in zip(self._layout.columns.field.cells, field.T.tolist(), strict=True):
            if any(map(ne, cells[place::step], map(str.strip, cells[place::step]))):
                return self._change_each(texts, field)
            cells[place::step] = self._format_numbers(values)
        return [f"{line}{end}" for line in delimiter.join(cells).split(between)]

    def _change_each(self, texts: Sequence[str], field: Floats) -> Iterator[str]:
        changed = map(self._change_line, texts, map(self._format_numbers, field.tolist()))
        return (text + self._layout.newline for text in changed)

    def _one_by_one(self, lines: Lines, rows: NumberRows, field: Floats) -> Iterator[str]:
        """Yield lines one by one, for lines that are not all readings, or that get appended cells."""
        layout = self._layout
        recorded = lines.texts
        texts: list[str | None] = [text or None for text in recorded] if layout.words else list(recorded)
        if self._add:
            self._rename(texts, lines.first)
        if layout.columns.device is not None:
            texts = [None if text and layout.is_of_other_device(text) else text for text in texts]
        for line, _ in rows.unreadable:
            texts[line - lines.first] = None
        for line, reading in zip(rows.lines, field.tolist(), strict=True):
            place = line - lines.first
            texts[place] = self._change_line(recorded[place], self._format_numbers(reading))
        for text in texts:
            if text is not None:
                yield text + layout.newline

    def _format_numbers(self, values: Sequence[float]) -> Sequence[str]:
        """Format numbers together, which takes half the time of single calls."""
        text = ";".join([NUMBER_FORMAT] * len(values)) % tuple(values)
        return (text.replace(".", ",") if self._layout.grid.decimal == "," else text).split(";")

    def _change_line(self, text: str, reading: Sequence[str]) -> str:
        """Replace the three numbers of a line, or append three numbers to it."""
        cells = self._split_line(text)
        places = self._layout.columns.field.cells
        if self._add:
            quote = '"' if '"' in cells[places[0]] or (self._layout.grid.decimal == self._delimiter) else ""
            return self._append_cells(text, [f"{quote}{value}{quote}" for value in reading])
        for place, value in zip(places, reading, strict=True):
            old = cells[place]
            bare = old.strip().strip('"')
            cells[place] = value if bare == old else old.replace(bare, value, 1) if bare else old + value
        return self._join_cells(cells)

    def _rename(self, texts: list[str | None], first: int) -> None:
        """Append the names of added columns to each line that is a header."""
        layout = self._layout
        for place, text in enumerate(texts):
            if layout.header_line and text == layout.header_text and first + place >= layout.header_line:
                texts[place] = self._name_added_columns(text)

    def _name_added_columns(self, header: str) -> str:
        """Append the names of added columns to a header."""
        if not self._add:
            return header
        if self._layout.heading:
            known = self._layout.header
            over = next((at for at, name in enumerate(reversed(known)) if name), 0) * (self._delimiter != SPACES)
            own = [known[place] + SUFFIX for place in self._layout.columns.field.cells]
            return self._append_cells(header + self._delimiter * over, own)
        cells = self._split_line(header)
        shift = len(cells) - len(self._layout.header) if self._delimiter == SPACES else 0  # the sign of a comment
        names = [cells[place + max(shift, 0)].strip().lstrip("#%/ ") for place in self._layout.columns.field.cells]
        return self._append_cells(
            header, [f'{name[:-1]}{SUFFIX}"' if name[-1:] == '"' else name + SUFFIX for name in names]
        )

    def _append_cells(self, text: str, cells: list[str]) -> str:
        """Append three cells to a line, in the style of its delimiters."""
        text = text.rstrip(" ")
        if self._delimiter == SPACES:
            between = "\t" if "\t" in text else " "
            return between.join([text.rstrip(), *cells])
        between = self._delimiter + " " * (f"{self._delimiter} " in text)
        closed = text.endswith(self._delimiter) and 0 < self._layout.grid.width < len(self._split_line(text))
        return text + ("" if closed else between) + between.join(cells)

    def _split_line(self, text: str) -> list[str]:
        """Split a line into cells with their spaces and quotes, so that `_join_cells` can restore it."""
        if self._delimiter == SPACES:
            return re.findall(r"\s*\S+", separate_numbers(text))
        if '"' not in text:
            return text.split(self._delimiter)
        cells: list[str] = []
        at = 0
        while match := self._cell.match(text, at):
            cells.append(match[1])
            at = match.end()
            if match.end(1) == len(text):
                break
        return cells

    def _join_cells(self, cells: list[str]) -> str:
        return "".join(cells) if self._delimiter == SPACES else self._delimiter.join(cells)
