"""The lines of a recording once more, with other numbers in the place of the magnetometer's."""

from __future__ import annotations

import re
from itertools import chain
from operator import ne
from typing import TYPE_CHECKING, Final

from flinders.core.samples import BLOCK
from flinders.errors import UsageError
from flinders.readers._cells import SPACES, quoted, unglued

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.readers._grid import NumberRows
    from flinders.readers._layout import TextLayout
    from flinders.readers._lines import Lines

WRITTEN: Final = "%.9g"  # Nine significant digits: as many as a float32 has
SUFFIX: Final = "_cal"


class Rewriter:
    """Puts numbers into lines, or with `add` after them, and leaves the rest of them alone."""

    def __init__(self, layout: TextLayout, *, add: bool) -> None:
        if layout.columns.reset is not None and not add:
            raise UsageError(
                f"readings are in pairs ({layout.columns.field.names[0]}, {layout.columns.reset.names[0]}), and a "
                "corrected one has no place among them: add columns for it",
                hint={"add": True},
            )
        self._layout, self._add = layout, add
        self._delimiter = layout.grid.delimiter
        mark = re.escape(self._delimiter)
        spaces = rf"[^\S{mark}]*"  # a tab may be the delimiter
        self._cell = re.compile(rf'({spaces}"(?:[^"]|"")*"{spaces}(?={mark}|$)|[^{mark}]*)(?:{mark}|$)')

    def opening(self) -> Iterator[str]:
        """Yield a header, where the recording has names and no line that says them."""
        header = self._layout.header
        if header and not self._layout.header_line:
            yield self._named(",".join(map(quoted, header))) + self._layout.newline

    def lines(self, lines: Lines, rows: NumberRows, field: Floats) -> Iterator[str]:
        """Yield these lines with their ends; `field` is (len(rows.lines), 3), in the unit of the recording."""
        if self._add or len(rows.lines) < lines.count or self._delimiter == SPACES or '"' in lines.text:
            return self._one_by_one(lines, rows, field)
        texts = lines.texts
        blocks = (slice(start, start + BLOCK) for start in range(0, lines.count, BLOCK))
        return chain.from_iterable(self._replaced(texts[block], field[block]) for block in blocks)

    def _replaced(self, texts: Sequence[str], field: Floats) -> Iterable[str]:
        """Put numbers into lines that are all readings, column by column where all have the same bare cells."""
        delimiter, end = self._delimiter, self._layout.newline
        between = f"{delimiter}\n{delimiter}"
        cells = between.join(texts).split(delimiter)
        step = -(-len(cells) // len(texts))  # a line, and its end
        if cells[step - 1 :: step] != ["\n"] * (len(texts) - 1):
            return self._each_changed(texts, field)
        for place, values in zip(self._layout.columns.field.cells, field.T.tolist(), strict=True):
            if any(map(ne, cells[place::step], map(str.strip, cells[place::step]))):
                return self._each_changed(texts, field)
            cells[place::step] = self._written(values)
        return [f"{line}{end}" for line in delimiter.join(cells).split(between)]

    def _each_changed(self, texts: Sequence[str], field: Floats) -> Iterator[str]:
        changed = map(self._changed, texts, map(self._written, field.tolist()))
        return (text + self._layout.newline for text in changed)

    def _one_by_one(self, lines: Lines, rows: NumberRows, field: Floats) -> Iterator[str]:
        """Yield lines among which some may be no readings, or are given cells."""
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
            texts[place] = self._changed(recorded[place], self._written(reading))
        for text in texts:
            if text is not None:
                yield text + layout.newline

    def _written(self, values: Sequence[float]) -> Sequence[str]:
        """Write numbers, all at once: one by one they take twice as long."""
        text = ";".join([WRITTEN] * len(values)) % tuple(values)
        return (text.replace(".", ",") if self._layout.grid.decimal == "," else text).split(";")

    def _changed(self, text: str, reading: Sequence[str]) -> str:
        """Put three numbers into a line, or after it."""
        cells = self._cut(text)
        places = self._layout.columns.field.cells
        if self._add:
            quote = '"' if '"' in cells[places[0]] or (self._layout.grid.decimal == self._delimiter) else ""
            return self._appended(text, [f"{quote}{value}{quote}" for value in reading])
        for place, value in zip(places, reading, strict=True):
            old = cells[place]
            bare = old.strip().strip('"')
            cells[place] = value if bare == old else old.replace(bare, value, 1) if bare else old + value
        return self._joined(cells)

    def _rename(self, texts: list[str | None], first: int) -> None:
        """Name added columns, wherever the header stands."""
        layout = self._layout
        for place, text in enumerate(texts):
            if layout.header_line and text == layout.header_text and first + place >= layout.header_line:
                texts[place] = self._named(text)

    def _named(self, header: str) -> str:
        """Add names to a header."""
        if not self._add:
            return header
        if self._layout.heading:
            known = self._layout.header
            over = next((at for at, name in enumerate(reversed(known)) if name), 0) * (self._delimiter != SPACES)
            own = [known[place] + SUFFIX for place in self._layout.columns.field.cells]
            return self._appended(header + self._delimiter * over, own)
        cells = self._cut(header)
        shift = len(cells) - len(self._layout.header) if self._delimiter == SPACES else 0  # the sign of a comment
        names = [cells[place + max(shift, 0)].strip().lstrip("#%/ ") for place in self._layout.columns.field.cells]
        return self._appended(
            header, [f'{name[:-1]}{SUFFIX}"' if name[-1:] == '"' else name + SUFFIX for name in names]
        )

    def _appended(self, text: str, cells: list[str]) -> str:
        """Write three cells after a line, in the style of its delimiters."""
        text = text.rstrip(" ")
        if self._delimiter == SPACES:
            between = "\t" if "\t" in text else " "
            return between.join([text.rstrip(), *cells])
        between = self._delimiter + " " * (f"{self._delimiter} " in text)
        closed = text.endswith(self._delimiter) and 0 < self._layout.grid.width < len(self._cut(text))
        return text + ("" if closed else between) + between.join(cells)

    def _cut(self, text: str) -> list[str]:
        """Cut a line into cells that `_joined` puts together again: spaces and quotes stay on."""
        if self._delimiter == SPACES:
            return re.findall(r"\s*\S+", unglued(text))
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

    def _joined(self, cells: list[str]) -> str:
        return "".join(cells) if self._delimiter == SPACES else self._delimiter.join(cells)
