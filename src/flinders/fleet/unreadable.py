r"""Unreadable row groups of tables, and the recordings with readings in them: those fail, and the others go on.

Usually a single page of a table is broken, and with it a row group. The recordings in it are read from the columns of
keys alone. If those are what is broken, the footer still has the number of rows, and perhaps the first and last unit.

>>> import tempfile
>>> from pathlib import Path
>>> import pyarrow
>>> from pyarrow import parquet
>>> from flinders.fleet.options import Options
>>> from flinders.fleet.plan import plan_of
>>> path = Path(tempfile.mkdtemp()) / "fleet.parquet"
>>> parquet.write_table(pyarrow.table({"unit": ["A17", "A17", "B02"], "x": [1.0, 2.0, 3.0]}), path)
>>> (partition,) = plan_of(str(path), Options()).partitions
>>> unreadable = Unreadable(partition, Options())
>>> unreadable.readable_groups(partition.slices[0])
()
>>> [(row.unit, row.readings, row.code) for row in unreadable.rows({("A17", ""): 0, ("B02", ""): 0})]
[('A17', 2, 'no-magnetometer'), ('B02', 1, 'no-magnetometer')]
"""

from __future__ import annotations

import contextlib
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from flinders.errors import UnreadableInput, counted
from flinders.fleet.dataset import HALF, Interner, KeyColumns, KeyedTable, batch_in, counts_of, extents_of, opened
from flinders.fleet.results import UnitResult, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from flinders.fleet.dataset import Pair, TableFile
    from flinders.fleet.options import Options
    from flinders.fleet.plan import FileSlice, Partition

LISTED: Final = 4
"""Groups that a message lists; it counts the others."""
NOT_PLANNED: Final = "could not be read when the run began, so that it is not known what is in it: run it again"
"""Said of a file that can be opened now."""


@dataclass(frozen=True, slots=True)
class UnreadableGroups:
    """Groups of a file that cannot be read.

    Attributes
    ----------
    part : FileSlice
        Slice that they belong to.
    group : str
        Name of a group in its file.
    groups, of : tuple of int, int
        Which of how many groups, counted from 0.
    rows : int
    error : Exception
    counts : Counter
        Rows of each recording; empty if the keys cannot be read either.
    ends : tuple of str
        If they cannot: units with some of the rows, according to footer or path.
    is_complete : bool
        Whether no other units have any.
    """

    part: FileSlice
    group: str
    groups: tuple[int, ...]
    of: int
    rows: int
    error: Exception
    counts: Counter[Pair] = field(default_factory=Counter)
    ends: tuple[str, ...] = ()
    is_complete: bool = False

    @property
    def place(self) -> str:
        """Groups, for people: counted from 1; empty if it is all of them."""
        if len(self.groups) == self.of:
            return ""
        named = [str(group + 1) for group in self.groups[:LISTED]]
        more = [f"{len(self.groups) - LISTED} more"] * (len(self.groups) > LISTED)
        *first, last = named + more
        plural = ("es" if self.group.endswith("ch") else "s") * (len(self.groups) > 1)
        return f"{self.group}{plural} {', '.join(first)}{' and ' if first else ''}{last} of {self.of}"

    @property
    def where(self) -> str:
        """Groups and file, for people."""
        name = self.part.file.name
        return f"{self.place} of {name}" if self.place else name

    @property
    def row(self) -> UnitResult:
        """A row for those whose units are not known; no unit has such a name."""
        rows = f" ({counted(self.rows, 'row')})" if self.rows else ""
        message = (
            f"it cannot be told whose readings are in {self.where}{rows}, and a unit that has some of them and others "
            f"elsewhere was fitted without them: {self.error}"
        )
        return _row(self.error, (f"({self.part.file.name})", self.place), self.rows, message)


@contextlib.contextmanager
def open_as_planned(part: FileSlice, options: Options) -> Iterator[TableFile]:
    """Open the file of a slice; refuse one that could not be opened for the plan, whose groups are not known.

    Raises
    ------
    UnreadableInput
    """
    with opened(part.file, options) as file:
        if part.is_unopened:
            raise UnreadableInput(f"{part.file.name} {NOT_PLANNED}")
        yield file


class Unreadable:
    """Unreadable groups of the slices of a partition.

    Parameters
    ----------
    partition : Partition
    options : Options

    Attributes
    ----------
    all : list of UnreadableGroups
    """

    def __init__(self, partition: Partition, options: Options) -> None:
        self.all: list[UnreadableGroups] = []
        self._names = Interner()
        self._partition, self._options = partition, options
        self._readable: dict[FileSlice, tuple[int, ...]] = {}

    def readable_groups(self, part: FileSlice) -> tuple[int, ...]:
        """Groups of a slice that can be read, each by itself; the others are recorded with their recordings."""
        if part not in self._readable:
            self._record(part, lambda file: self._errors(part, file))
        return self._readable[part]

    def give_up(self, part: FileSlice, error: Exception) -> None:
        """Record all of a slice, though each of its groups could be read."""
        errors = dict.fromkeys(self._readable.get(part, part.groups), error)
        self._record(part, lambda _: errors)
        self._readable[part] = ()

    def _record(self, part: FileSlice, errors_of: Callable[[TableFile], Mapping[int, Exception]]) -> None:
        """Record the groups of a slice with errors."""
        try:
            with open_as_planned(part, self._options) as file:
                keys = KeyColumns.of_schema(file.name, file.schema, self._options) or KeyColumns()
                errors = errors_of(file)
                self.all += list(self._with_recordings(part, file, keys, errors))
        except Exception as error:  # noqa: BLE001 - a broken file may raise anything, and costs its recordings alone
            errors = dict.fromkeys(part.groups, error)
            self.all = [each for each in self.all if each.part != part]  # all of it, with what was recorded before
            self.all.append(self._unopened(part, error))
        self._readable[part] = tuple(group for group in part.groups if group not in errors)

    def counts_in(self, part: FileSlice) -> Counter[Pair]:
        """Unreadable rows of each recording in a slice."""
        return sum((each.counts for each in self.all if each.part == part), Counter())

    def _unopened(self, part: FileSlice, error: Exception) -> UnreadableGroups:
        """A slice whose file cannot be opened any more: its rows, and the unit in its path."""
        keys = KeyColumns.of_path(part.file.name, self._options)
        groups = UnreadableGroups(
            part, "", part.groups, len(part.groups), part.rows, error, ends=self._partition.only or ()
        )
        if keys is None:
            return groups
        number = self._names.number(keys.unit_value) << HALF | self._names.number(keys.recording_value)
        self._names.note(number, batch_in(part.file.name, self._options))
        if keys.recording_value:
            return replace(groups, counts=Counter({(keys.unit_value, keys.recording_value): part.rows}), ends=())
        return replace(groups, ends=(keys.unit_value,), is_complete=True)

    def _errors(self, part: FileSlice, file: TableFile) -> dict[int, Exception]:
        """Errors of the groups of a slice that cannot be read."""
        errors: dict[int, Exception] = {}
        try:
            table = KeyedTable.of(file, self._options)
        except Exception as error:  # noqa: BLE001 - as in `_record`: all groups, with their recordings
            return dict.fromkeys(part.groups, error)
        for group in part.groups:
            try:
                for _ in table.batches((group,), self._names):
                    pass
            except Exception as error:  # noqa: BLE001 - as in `_record`: this group, and the others are read
                errors[group] = error
        return errors

    def _with_recordings(
        self, part: FileSlice, file: TableFile, keys: KeyColumns, errors: Mapping[int, Exception]
    ) -> Iterator[UnreadableGroups]:
        """Groups with errors whose recordings can be read, and those of which the footer has two units at most."""
        counts: Counter[Pair] = Counter()
        known: list[int] = []
        unknown: list[int] = []
        ends: set[str] = set()
        for group in errors:
            try:
                counts += counts_of(file, keys, (group,), self._names)
                known.append(group)
            except Exception:  # noqa: BLE001 - as in `_record`: its keys are broken too
                units = set(extents_of(file, keys)[group] or ())
                if len(units) == 1 and not keys.recording:
                    unit = units.pop()
                    counts[unit, keys.recording_value] += file.groups[group]
                    number = self._names.number(unit) << HALF | self._names.number(keys.recording_value)
                    self._names.note(number, keys.batch_value)
                    known.append(group)
                else:
                    unknown.append(group)
                    ends |= units - {""}
        for groups, own, named in ((known, counts, ()), (unknown, Counter(), tuple(sorted(ends)))):
            if groups:
                rows = sum(file.groups[group] for group in groups)
                every = len(file.groups)
                yield UnreadableGroups(part, file.group, tuple(groups), every, rows, errors[groups[0]], own, named)

    def recordings(self, read: Iterable[Pair]) -> set[Pair]:
        """Recordings with unreadable rows; of units that the footer names those that were `read`."""
        recordings = {pair for each in self.all for pair in each.counts if pair[0]}
        ends = {unit for each in self.all for unit in each.ends}
        there = {pair for pair in read if pair[0] in ends}
        return recordings | there | {(unit, "") for unit in ends - {unit for unit, _ in there}}

    def rows(self, readable: Mapping[Pair, int]) -> list[UnitResult]:
        """Rows of `recordings`, given how many readings of each can be read."""
        groups_of: dict[Pair, list[UnreadableGroups]] = defaultdict(list)
        for each in self.all:
            for pair in readable:
                if pair in each.counts or pair[0] in each.ends:
                    groups_of[pair].append(each)
        return [_of_recording(pair, groups, readable[pair]) for pair, groups in groups_of.items()]

    def unknown(self) -> list[UnitResult]:
        """Rows for groups whose units are not known."""
        return [each.row for each in self.all if not each.counts and not each.is_complete]

    def batches(self, known: Mapping[Pair, str]) -> dict[Pair, str]:
        """Hardware batches that are known, and those of unreadable recordings."""
        own = self._names.batches
        return {pair: min(each[pair] for each in (known, own) if pair in each) for pair in {*known, *own}}

    @property
    def nameless(self) -> int:
        """Rows that name no unit."""
        return sum(rows for each in self.all for (unit, _), rows in each.counts.items() if not unit)


def _of_recording(pair: Pair, groups: list[UnreadableGroups], readable: int) -> UnitResult:
    """Row of a recording with unreadable rows."""
    lost = sum(each.counts[pair] for each in groups)
    every, where = counted(readable + lost, "reading"), " and ".join(each.where for each in groups[:LISTED])
    share = f"{lost:,} of its {every}" if lost < readable + lost else f"its {every}"
    if any(each.ends or not each.rows for each in groups):
        others = f", besides {counted(readable, 'reading')} that can be read," if readable else ""
        share = f"some of its readings{others}"
    return _row(groups[0].error, pair, readable + lost, f"{share} lie in {where}: {groups[0].error}")


def _row(error: Exception, pair: Pair, readings: int, message: str) -> UnitResult:
    """Row with the code of an error and a longer message."""
    row = UnitResult.of_error(error, pair[0], recording=pair[1], readings=readings)
    return replace(row, message=one_line(message))
