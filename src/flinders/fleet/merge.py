"""Merge sorted files of rows into one Parquet file, a row group at a time.

Each partition is sorted, and nearly always they follow one another. The first key of each file is read; then files are
opened one by one, and each gives rows while its next key is the least. A row group takes consecutive rows of a few
files, so that memory is that of a row group, for any number of rows.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.results import UnitResult, UnitResults
>>> folder = Path(tempfile.mkdtemp())
>>> for name, units in (("a", ["A1", "A3"]), ("b", ["A2", "A4"])):
...     _ = (folder / name).write_bytes(UnitResults.of([UnitResult(unit=unit) for unit in units]).to_bytes())
>>> merge([folder / "a", folder / "b"], folder / "all.parquet")
>>> UnitResults.read(folder / "all.parquet").unit.tolist()
['A1', 'A2', 'A3', 'A4']
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TextIO, TypeAlias, cast

import numpy as np

from flinders.core.files import replacing
from flinders.fleet.results import GROUP, KEY, TEXTS, needs_arrow, schema

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence
    from pathlib import Path

LEVEL: Final = 3
"""Level of compression; settings of the writer are fixed, so that the same rows are the same bytes."""

Key: TypeAlias = tuple[tuple[bool, Any], ...]
"""Sort key of a row: for each cell of `KEY` whether it is missing, which comes last, and the cell."""


def merge(parts: Sequence[Path], out: str | os.PathLike[str]) -> None:
    """Merge files of rows, in the order of `KEY`, into a Parquet file that appears when it is complete.

    Parameters
    ----------
    parts : sequence of Path
        Arrow files, each sorted by `KEY`. Of equal rows those of the first file come first.
    out : str or path

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    needs_arrow()
    with replacing(out, force=True) as file:
        _write(_groups(parts), cast("TextIO", file).buffer)


def _write(groups: Iterator[Any], file: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
    """Write row groups."""
    from pyarrow import parquet

    options: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": LEVEL,
        "version": "2.6",
        "use_dictionary": [*TEXTS, "findings.list.element"],
        "write_page_checksum": True,
    }
    with parquet.ParquetWriter(file, schema(), **options) as writer:
        for group in groups:
            writer.write_table(group, row_group_size=GROUP)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """An open file: its number, its rows (mapped, not read) and their columns of `KEY`."""

    place: int
    table: Any
    keys: tuple[Any, ...]

    @classmethod
    def of(cls, path: Path, place: int) -> _Part:
        """Map a file."""
        arrow = needs_arrow()
        table = arrow.ipc.open_file(arrow.memory_map(str(path))).read_all()
        return cls(place, table, tuple(table.column(name).combine_chunks() for name in KEY))

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def key(self, row: int) -> Key:
        """Sort key of a row."""
        cells = (column[row].as_py() for column in self.keys)
        return tuple((cell is None, cell) for cell in cells)

    def before(self, row: int, bound: tuple[Key, int] | None) -> int:
        """First row from `row` on that sorts after the key of another file, or the number of rows."""
        if bound is None or (self.key(len(self) - 1), self.place) < bound:
            return len(self)
        low, high = row, row + 1
        while high < len(self) and (self.key(high), self.place) < bound:  # steps grow, for files that alternate
            low, high = high, high + 2 * (high - low)
        high = min(high, len(self) - 1)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if (self.key(middle), self.place) < bound else (low, middle)
        return high


def _runs(parts: Sequence[Path]) -> Iterator[tuple[_Part, int, int]]:
    """Files with first and last of the rows that come next."""
    heads = []
    for place, path in enumerate(parts):
        part = _Part.of(path, place)
        if len(part):
            heads.append((part.key(0), place, 0))
    heapq.heapify(heads)
    opened: dict[int, _Part] = {}
    while heads:
        _, place, row = heapq.heappop(heads)
        part = opened.get(place) or _Part.of(parts[place], place)
        end = part.before(row, heads[0][:2] if heads else None)
        yield part, row, end
        opened.pop(place, None)
        if end < len(part):
            opened[place] = part
            heapq.heappush(heads, (part.key(end), place, end))


def _groups(parts: Sequence[Path]) -> Iterator[Any]:
    """Tables of the rows of one row group each, in order."""
    runs: list[tuple[_Part, int, int]] = []
    room = GROUP
    for part, begin, end in _runs(parts):
        start = begin
        while start < end:
            taken = min(end - start, room)
            runs.append((part, start, start + taken))
            start, room = start + taken, room - taken
            if not room:
                group, runs, room = _table(runs), [], GROUP  # closes files before the group is written
                yield group
    if runs:
        yield _table(runs)


def _table(runs: Sequence[tuple[_Part, int, int]]) -> Any:  # noqa: ANN401
    """Rows of runs, one after the other; the runs of one file are adjacent in it."""
    arrow = needs_arrow()
    first: dict[int, int] = {}
    last: dict[int, tuple[_Part, int]] = {}
    for part, begin, end in runs:
        first.setdefault(part.place, begin)
        last[part.place] = part, end
    pieces = {place: part.table.slice(first[place], end - first[place]) for place, (part, end) in last.items()}
    whole = arrow.concat_tables([schema().empty_table(), *pieces.values()]).combine_chunks()
    if len(pieces) == len(runs):
        return whole
    lengths = [piece.num_rows for piece in pieces.values()]
    above = dict(zip(pieces, np.cumsum([0, *lengths[:-1]]).tolist(), strict=True))
    shift = [above[part.place] - first[part.place] for part, _, _ in runs]
    order = [np.arange(begin, end) + off for (_, begin, end), off in zip(runs, shift, strict=True)]
    return whole.take(arrow.array(np.concatenate(order)))
