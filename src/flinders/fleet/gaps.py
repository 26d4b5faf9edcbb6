r"""What of a table cannot be read, and whose readings are in it: those units fail, and the others go on.

A table is broken in a few places: a page, and with it a row group. Whose rows lie there is told by the columns of keys,
which are read by themselves. Where these are what is broken, the footer still counts the rows, and may name two units.

>>> import tempfile
>>> from pathlib import Path
>>> import pyarrow
>>> from pyarrow import parquet
>>> from flinders.fleet.plan import plan_of
>>> path = Path(tempfile.mkdtemp()) / "fleet.parquet"
>>> parquet.write_table(pyarrow.table({"unit": ["A17", "A17", "B02"], "x": [1.0, 2.0, 3.0]}), path)
>>> (partition,) = plan_of(str(path), Asked()).partitions
>>> gaps = Gaps(partition, Asked())
>>> gaps.look(partition.pieces[0])
()
>>> [(row.unit, row.readings, row.code) for row in gaps.rows({("A17", ""): 0, ("B02", ""): 0})]
[('A17', 2, 'no-magnetometer'), ('B02', 1, 'no-magnetometer')]
"""

from __future__ import annotations

import contextlib
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from flinders.errors import UnreadableInput, counted
from flinders.fleet.table import LONGEST, Row
from flinders.fleet.tables import HALF, Asked, KeyedTable, Keys, Names, batch_in, counts_of, extents_of, opened

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from flinders.fleet.plan import Partition, Piece
    from flinders.fleet.tables import Pair, Tabular

NAMED: Final = 4
"""Groups that a message names; it counts the others."""
NOT_PLANNED: Final = "could not be read when the run began, so that it is not known what is in it: run it again"
"""Said of a file that can be opened now."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Groups of a file that cannot be read.

    Attributes
    ----------
    piece : Piece
        What they are of.
    group : str
        What the groups of its file are called.
    groups, of : tuple of int, int
        Which of how many groups, counted from 0.
    rows : int
    error : Exception
        Why.
    counts : Counter
        How many of the rows are of which recording of which unit; empty where that cannot be read either.
    ends : tuple of str
        Where it cannot be: units that have some of the rows, as the footer or the path says.
    is_told : bool
        No others have.
    """

    piece: Piece
    group: str
    groups: tuple[int, ...]
    of: int
    rows: int
    error: Exception
    counts: Counter[Pair] = field(default_factory=Counter)
    ends: tuple[str, ...] = ()
    is_told: bool = False

    @property
    def name(self) -> str:
        """Of the file."""
        return self.piece.member.name

    @property
    def place(self) -> str:
        """Which groups, for people: counted from 1; nothing where it is all of them."""
        if len(self.groups) == self.of:
            return ""
        named = [str(group + 1) for group in self.groups[:NAMED]]
        more = [f"{len(self.groups) - NAMED} more"] * (len(self.groups) > NAMED)
        *first, last = named + more
        plural = ("es" if self.group.endswith("ch") else "s") * (len(self.groups) > 1)
        return f"{self.group}{plural} {', '.join(first)}{' and ' if first else ''}{last} of {self.of}"

    @property
    def where(self) -> str:
        """Which groups of which file."""
        return f"{self.place} of {self.name}" if self.place else self.name

    @property
    def row(self) -> Row:
        """A row for those whose units are not known; no unit is called like that."""
        rows = f" ({counted(self.rows, 'row')})" if self.rows else ""
        said = (
            f"it cannot be told whose readings are in {self.where}{rows}, and a unit that has some of them and others "
            f"elsewhere was fitted without them: {self.error}"
        )
        return _row(self.error, (f"({self.name})", self.place), self.rows, said)


@contextlib.contextmanager
def opened_as_planned(piece: Piece, asked: Asked) -> Iterator[Tabular]:
    """Open the file of a piece, unless that did not go when the run was planned: only some of it would be read.

    Raises
    ------
    UnreadableInput
    """
    with opened(piece.member, asked) as file:
        if piece.is_refused:
            raise UnreadableInput(f"{piece.member.name} {NOT_PLANNED}")
        yield file


class Gaps:
    """What cannot be read of the pieces of a partition.

    Parameters
    ----------
    partition : Partition
    asked : Asked

    Attributes
    ----------
    found : list of Gap
    """

    def __init__(self, partition: Partition, asked: Asked) -> None:
        self.found: list[Gap] = []
        self._names = Names()
        self._partition, self._asked = partition, asked
        self._sound: dict[Piece, tuple[int, ...]] = {}

    def look(self, piece: Piece) -> tuple[int, ...]:
        """Groups of a piece that can be read, one by one; of the others it is found out whose they are."""
        if piece not in self._sound:
            self._note(piece, lambda file: self._bad(piece, file))
        return self._sound[piece]

    def give_up(self, piece: Piece, error: Exception) -> None:
        """Take nothing of a piece, though each group of it could be read."""
        bad = dict.fromkeys(self._sound.get(piece, piece.groups), error)
        self._note(piece, lambda _: bad)
        self._sound[piece] = ()

    def _note(self, piece: Piece, bad_of: Callable[[Tabular], Mapping[int, Exception]]) -> None:
        """Take note of the groups of a piece that cannot be read."""
        try:
            with opened_as_planned(piece, self._asked) as file:
                keys = Keys.of_schema(file.name, file.schema, self._asked) or Keys()
                bad = bad_of(file)
                self.found += list(self._gaps(piece, file, keys, bad))
        except Exception as error:  # noqa: BLE001 - `work` takes whatever a file does, and asks here what that costs
            bad = dict.fromkeys(piece.groups, error)
            self.found = [gap for gap in self.found if gap.piece != piece]  # all of it, what was broken before too
            self.found.append(self._closed(piece, error))
        self._sound[piece] = tuple(group for group in piece.groups if group not in bad)

    def counts_in(self, piece: Piece) -> Counter[Pair]:
        """How many rows of what cannot be read of a piece are whose."""
        return sum((gap.counts for gap in self.found if gap.piece == piece), Counter())

    def _closed(self, piece: Piece, error: Exception) -> Gap:
        """What is known of a piece whose file cannot be opened any more: its rows, and the unit that its path says."""
        keys = Keys.of_path(piece.member.name, self._asked)
        gap = Gap(piece, "", piece.groups, len(piece.groups), piece.rows, error, ends=self._partition.only or ())
        if keys is None:
            return gap
        number = self._names.number(keys.unit_value) << HALF | self._names.number(keys.recording_value)
        self._names.note(number, batch_in(piece.member.name, self._asked))
        if keys.recording_value:
            return replace(gap, counts=Counter({(keys.unit_value, keys.recording_value): piece.rows}), ends=())
        return replace(gap, ends=(keys.unit_value,), is_told=True)

    def _bad(self, piece: Piece, file: Tabular) -> dict[int, Exception]:
        """Which groups cannot be read, and why."""
        bad: dict[int, Exception] = {}
        try:
            table = KeyedTable.of(file, self._asked)
        except Exception as error:  # noqa: BLE001 - as in `_note`: all groups, with whose they are
            return dict.fromkeys(piece.groups, error)
        for group in piece.groups:
            try:
                for _ in table.batches((group,), self._names):
                    pass
            except Exception as error:  # noqa: BLE001 - as in `_note`: this group, and the others are read
                bad[group] = error
        return bad

    def _gaps(self, piece: Piece, file: Tabular, keys: Keys, bad: Mapping[int, Exception]) -> Iterator[Gap]:
        """Put bad groups together: those whose units are known, and those where they are not."""
        known: Counter[Pair] = Counter()
        told: list[int] = []
        untold: list[int] = []
        ends: set[str] = set()
        for group in bad:
            try:
                known += counts_of(file, keys, (group,), self._names)
                told.append(group)
            except Exception:  # noqa: BLE001 - as in `_note`: its keys are broken too, whatever that raises
                units = set(extents_of(file, keys)[group] or ())
                if len(units) == 1 and not keys.recording:
                    unit = units.pop()
                    known[unit, keys.recording_value] += file.groups[group]
                    number = self._names.number(unit) << HALF | self._names.number(keys.recording_value)
                    self._names.note(number, keys.batch_value)
                    told.append(group)
                else:
                    untold.append(group)
                    ends |= units - {""}
        for groups, counts, named in ((told, known, ()), (untold, Counter(), tuple(sorted(ends)))):
            if groups:
                rows = sum(file.groups[group] for group in groups)
                every = len(file.groups)
                yield Gap(piece, file.group, tuple(groups), every, rows, bad[groups[0]], counts, named)

    def lost(self, held: Iterable[Pair]) -> set[Pair]:
        """Recordings that have readings in what cannot be read; of units that the footer names those that are held."""
        found = {pair for gap in self.found for pair in gap.counts if pair[0]}
        ends = {unit for gap in self.found for unit in gap.ends}
        there = {pair for pair in held if pair[0] in ends}
        return found | there | {(unit, "") for unit in ends - {unit for unit, _ in there}}

    def rows(self, sound: Mapping[Pair, int]) -> list[Row]:
        """Rows of recordings that are `lost`, with how many readings of each can be read."""
        gaps_of: dict[Pair, list[Gap]] = defaultdict(list)
        for gap in self.found:
            for pair in sound:
                if pair in gap.counts or pair[0] in gap.ends:
                    gaps_of[pair].append(gap)
        return [_of_pair(pair, gaps, sound[pair]) for pair, gaps in gaps_of.items()]

    def untold(self) -> list[Row]:
        """Rows of those whose units cannot be told."""
        return [gap.row for gap in self.found if not gap.counts and not gap.is_told]

    def batches(self, known: Mapping[Pair, str]) -> dict[Pair, str]:
        """Batches of hardware that are known, and those of recordings some of which cannot be read."""
        own = self._names.batches
        return {pair: min(each[pair] for each in (known, own) if pair in each) for pair in {*known, *own}}

    @property
    def nameless(self) -> int:
        """How many rows name no unit."""
        return sum(rows for gap in self.found for (unit, _), rows in gap.counts.items() if not unit)


def _of_pair(pair: Pair, gaps: list[Gap], sound: int) -> Row:
    """The row of a recording that is not whole."""
    lost = sum(gap.counts[pair] for gap in gaps)
    every, where = counted(sound + lost, "reading"), " and ".join(gap.where for gap in gaps[:NAMED])
    share = f"{lost:,} of its {every}" if lost < sound + lost else f"its {every}"
    if any(gap.ends or not gap.rows for gap in gaps):
        besides = f", besides {counted(sound, 'reading')} that can be read," if sound else ""
        share = f"some of its readings{besides}"
    return _row(gaps[0].error, pair, sound + lost, f"{share} lie in {where}: {gaps[0].error}")


def _row(error: Exception, pair: Pair, readings: int, said: str) -> Row:
    """A row with the code of an error, and more words."""
    row = Row.of_error(error, pair[0], recording=pair[1], readings=readings)
    return replace(row, message=" ".join(said.split())[:LONGEST])
