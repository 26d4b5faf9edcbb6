"""Sorted files of rows put together to one Parquet file, a row group at a time.

Partitions are sorted each, and nearly always follow one another. Of each file the first key is read, then files are
opened one by one as their turn comes: while its next key is the least of all, a file gives rows. A row group takes
consecutive rows of a few files, so that memory is that of a row group, for any number of rows.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.table import Row, Rows
>>> folder = Path(tempfile.mkdtemp())
>>> for name, units in (("a", ["A1", "A3"]), ("b", ["A2", "A4"])):
...     _ = (folder / name).write_bytes(Rows.of([Row(unit=unit) for unit in units]).to_bytes())
>>> merge([folder / "a", folder / "b"], folder / "all.parquet")
>>> Rows.read(folder / "all.parquet").unit.tolist()
['A1', 'A2', 'A3', 'A4']
"""

from __future__ import annotations

import contextlib
import heapq
import os
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.core.files import reason
from flinders.errors import OutputError
from flinders.fleet.table import GROUP, KEY, TEXTS, needs_arrow, schema

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

LEVEL: Final = 3
"""Of compression: the settings of the writer are fixed, so that the same rows are the same bytes."""

Key: TypeAlias = tuple[tuple[bool, Any], ...]
"""What rows are sorted by: whether a cell of `KEY` is missing, which comes last, and the cell."""


def merge(parts: Sequence[Path], out: str | os.PathLike[str]) -> None:
    """Put files of rows together, in the order of `KEY`, into one of Parquet that appears when it is complete.

    Parameters
    ----------
    parts : sequence of Path
        Arrow files, the rows of each in the order of `KEY`. Of equal rows those of the first file come first.
    out : str or path

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    needs_arrow()
    target = Path(os.path.realpath(out))
    temporary = target.with_name(f".flinders-{secrets.token_hex(8)}.tmp")
    try:
        with temporary.open("wb") as file:
            _write(_groups(parts), file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {reason(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


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
    """An open file.

    Attributes
    ----------
    place : int
        Which it is.
    table : pyarrow.Table
        Its rows, mapped and not read.
    keys : tuple of pyarrow.Array
        Its columns of `KEY`.
    """

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
        """What a row is sorted by."""
        cells = (column[row].as_py() for column in self.keys)
        return tuple((cell is None, cell) for cell in cells)

    def before(self, row: int, bound: tuple[Key, int] | None) -> int:
        """First row from `row` on that does not come before the key of another file, or the number of rows."""
        if bound is None or (self.key(len(self) - 1), self.place) < bound:
            return len(self)
        near, far = row, row + 1
        while far < len(self) and (self.key(far), self.place) < bound:  # steps grow, for files that alternate
            near, far = far, far + 2 * (far - near)
        far = min(far, len(self) - 1)
        while far - near > 1:
            middle = (near + far) // 2
            near, far = (middle, far) if (self.key(middle), self.place) < bound else (near, middle)
        return far


def _runs(parts: Sequence[Path]) -> Iterator[tuple[_Part, int, int]]:
    """Files with the first of the rows that come next and the end of these."""
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
    """Tables of as many rows as a row group has, in order."""
    runs: list[tuple[_Part, int, int]] = []
    room = GROUP
    for part, begin, end in _runs(parts):
        start = begin
        while start < end:
            taken = min(end - start, room)
            runs.append((part, start, start + taken))
            start, room = start + taken, room - taken
            if not room:
                group, runs, room = _table(runs), [], GROUP  # the files are let go before the group is written
                yield group
    if runs:
        yield _table(runs)


def _table(runs: Sequence[tuple[_Part, int, int]]) -> Any:  # noqa: ANN401
    """The rows of runs, one after the other; those of one file follow each other in it, run by run."""
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
