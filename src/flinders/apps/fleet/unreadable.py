"""Unreadable row groups of tables: the recordings with rows in them, and the rows of results about these recordings.

Usually a single page of a table is broken, and with it a row group. The recordings in that group fail, and the others
are calibrated. The names of its recordings come from the key columns alone; if those columns are broken, the footer
still has the number of rows, and perhaps the first and last unit.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from flinders.apps.fleet.dataset import Interner, KeyedTable, counts_of, extents_of
from flinders.apps.fleet.keys import KeyColumns, batch_in
from flinders.apps.fleet.plan import open_as_planned
from flinders.apps.fleet.results import UnitResult, one_line
from flinders.errors import FlindersError, count_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from flinders.apps.fleet.dataset import Pair, TableFile
    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.plan import FileSlice, Partition

MAX_LISTED: Final = 4
"""Largest number of groups that a message lists; further ones are counted."""


@dataclass(frozen=True, slots=True)
class UnreadableGroups:
    """Groups of a file that cannot be read."""

    part: FileSlice  # slice that the groups belong to
    group: str  # word for a group in such a file
    groups: tuple[int, ...]  # unreadable groups, counted from 0
    group_count: int  # number of all groups
    rows: int  # number of rows in the unreadable groups
    error: Exception
    # number of rows of each recording; empty if the keys cannot be read either
    counts: Counter[Pair] = field(default_factory=Counter)
    ends: tuple[str, ...] = ()  # if keys cannot be read: units with some of the rows, according to footer or path
    is_complete: bool = False  # whether `ends` are all units of the rows

    @property
    def place(self) -> str:
        """Numbers of the groups for a message, counted from 1; empty for all groups."""
        if len(self.groups) == self.group_count:
            return ""
        named = [str(group + 1) for group in self.groups[:MAX_LISTED]]
        more = [f"{len(self.groups) - MAX_LISTED} more"] * (len(self.groups) > MAX_LISTED)
        *first, last = named + more
        plural = ("es" if self.group.endswith("ch") else "s") * (len(self.groups) > 1)
        return f"{self.group}{plural} {', '.join(first)}{' and ' if first else ''}{last} of {self.group_count}"

    @property
    def where(self) -> str:
        """Groups and file for a message."""
        name = self.part.file.name
        return f"{self.place} of {name}" if self.place else name

    @property
    def row(self) -> UnitResult:
        """Row about groups whose units are not known; its unit is the file name in parentheses."""
        rows = f" ({count_text(self.rows, 'row')})" if self.rows else ""
        why = self.error.message if isinstance(self.error, FlindersError) else self.error
        message = (
            f"the units of the readings in {self.where}{rows} are not known, and a unit that also has readings "
            f"elsewhere was fitted without these: {why}"
        )
        return _row(self.error, (f"({self.part.file.name})", self.place), self.rows, message)


class Unreadable:
    """Unreadable groups of the slices of a partition.

    >>> import tempfile
    >>> from pathlib import Path
    >>> import pyarrow
    >>> from pyarrow import parquet
    >>> from flinders.apps.fleet.options import Options
    >>> from flinders.apps.fleet.plan import plan_of
    >>> path = Path(tempfile.mkdtemp()) / "fleet.parquet"
    >>> parquet.write_table(pyarrow.table({"unit": ["A17", "A17", "B02"], "x": [1.0, 2.0, 3.0]}), path)
    >>> (partition,) = plan_of(str(path), Options()).partitions
    >>> unreadable = Unreadable(partition, Options())
    >>> unreadable.readable_groups(partition.slices[0])
    ()
    >>> [(row.unit, row.readings, row.code) for row in unreadable.rows({("A17", ""): 0, ("B02", ""): 0})]
    [('A17', 2, 'no-magnetometer'), ('B02', 1, 'no-magnetometer')]
    """

    def __init__(self, partition: Partition, options: Options) -> None:
        self.all: list[UnreadableGroups] = []
        self._names = Interner()
        self._partition, self._options = partition, options
        self._readable: dict[FileSlice, tuple[int, ...]] = {}

    def readable_groups(self, part: FileSlice) -> tuple[int, ...]:
        """Groups of a slice that can be read, each by itself; the others are noted with their recordings."""
        if part not in self._readable:
            self._record(part, lambda file: self._errors(part, file))
        return self._readable[part]

    def give_up(self, part: FileSlice, error: Exception) -> None:
        """Note all row groups of a slice as unreadable: the slice failed, although each group alone was readable."""
        errors = dict.fromkeys(self._readable.get(part, part.groups), error)
        self._record(part, lambda _: errors)
        self._readable[part] = ()

    def _record(self, part: FileSlice, errors_of: Callable[[TableFile], Mapping[int, Exception]]) -> None:
        """Store the groups of a slice that have errors, with their recordings."""
        try:
            with open_as_planned(part, self._options) as file:
                keys = KeyColumns.of_schema(file.name, file.schema, self._options) or KeyColumns()
                errors = errors_of(file)
                self.all += list(self._find_recordings(part, file, keys, errors))
        except Exception as error:  # noqa: BLE001 - a broken file may raise any error, and fails its recordings only
            errors = dict.fromkeys(part.groups, error)
            self.all = [each for each in self.all if each.part != part]  # replaced by one entry for all groups
            self.all.append(self._unopened_slice(part, error))
        self._readable[part] = tuple(group for group in part.groups if group not in errors)

    def counts_in(self, part: FileSlice) -> Counter[Pair]:
        """Number of unreadable rows of each recording in a slice."""
        return sum((each.counts for each in self.all if each.part == part), Counter())

    def _unopened_slice(self, part: FileSlice, error: Exception) -> UnreadableGroups:
        """All groups of a slice whose file cannot be opened any more, with the unit from its path."""
        keys = KeyColumns.of_path(part.file.name, self._options)
        groups = UnreadableGroups(
            part, "", part.groups, len(part.groups), part.rows, error, ends=self._partition.only or ()
        )
        if keys is None:
            return groups
        self._names.number(keys.pair, batch_in(part.file.name, self._options))
        if keys.recording.value:
            return replace(groups, counts=Counter({keys.pair: part.rows}), ends=())
        return replace(groups, ends=(keys.unit.value,), is_complete=True)

    def _errors(self, part: FileSlice, file: TableFile) -> dict[int, Exception]:
        """Read each group of a slice alone, and return the errors of those that cannot be read."""
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

    def _find_recordings(
        self, part: FileSlice, file: TableFile, keys: KeyColumns, errors: Mapping[int, Exception]
    ) -> Iterator[UnreadableGroups]:
        """Yield groups with errors and known recordings, then groups with units that only the footer names."""
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
                if len(units) == 1 and not keys.recording.column:
                    unit = units.pop()
                    counts[unit, keys.recording.value] += file.groups[group]
                    self._names.number((unit, keys.recording.value), keys.batch.value)
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
        """Recordings with unreadable rows.

        If only the footer names a unit, its recordings are not known; its recordings that were `read` are then taken.
        """
        recordings = {pair for each in self.all for pair in each.counts if pair[0]}
        ends = {unit for each in self.all for unit in each.ends}
        present = {pair for pair in read if pair[0] in ends}
        return recordings | present | {(unit, "") for unit in ends - {unit for unit, _ in present}}

    def rows(self, readable: Mapping[Pair, int]) -> list[UnitResult]:
        """Rows of results about `recordings`, given the number of readable readings of each."""
        groups_of: dict[Pair, list[UnreadableGroups]] = defaultdict(list)
        for each in self.all:
            for pair in readable:
                if pair in each.counts or pair[0] in each.ends:
                    groups_of[pair].append(each)
        return [_of_recording(pair, groups, readable[pair]) for pair, groups in groups_of.items()]

    def unknown_rows(self) -> list[UnitResult]:
        """Rows about groups whose units are not known."""
        return [each.row for each in self.all if not each.counts and not each.is_complete]

    def batches(self, known: Mapping[Pair, str]) -> dict[Pair, str]:
        """Known hardware batches, and those of unreadable recordings."""
        own = self._names.batches
        return {pair: min(each[pair] for each in (known, own) if pair in each) for pair in {*known, *own}}

    @property
    def nameless_count(self) -> int:
        """Number of rows without a unit."""
        return sum(rows for each in self.all for (unit, _), rows in each.counts.items() if not unit)


def _of_recording(pair: Pair, groups: list[UnreadableGroups], readable: int) -> UnitResult:
    """Row of results for a recording with unreadable rows."""
    lost = sum(each.counts[pair] for each in groups)
    every, where = count_text(readable + lost, "reading"), " and ".join(each.where for each in groups[:MAX_LISTED])
    share = f"{lost:,} of its {every}" if lost < readable + lost else f"its {every}"
    if any(each.ends or not each.rows for each in groups):
        others = f", in addition to {count_text(readable, 'reading')} that can be read," if readable else ""
        share = f"some of its readings{others}"
    return _row(groups[0].error, pair, readable + lost, f"{share} lie in {where}: {groups[0].error}")


def _row(error: Exception, pair: Pair, readings: int, message: str) -> UnitResult:
    """Row of results with the code of an error and a longer message."""
    row = UnitResult(unit=pair[0], recording=pair[1], readings=readings).with_error(error)
    return replace(row, message=one_line(message))
