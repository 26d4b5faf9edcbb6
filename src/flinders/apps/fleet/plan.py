r"""Plan of a run: recordings split into partitions, each of which is calibrated by itself and written as one file.

A partition is some log files, some files of rows, or a range of row groups of one. It depends on the input alone, so
that a run which is resumed, or uses more workers, has the same partitions. A unit with rows in several of them gets
a partition of its own, which takes its rows alone.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.apps.fleet.options import Options
>>> folder = Path(tempfile.mkdtemp())
>>> for name in ("A17/monday.csv", "A17/friday.csv", "B02/monday.csv", "B02/notes.md"):
...     (folder / name).parent.mkdir(exist_ok=True)
...     _ = (folder / name).write_text("x,y,z\n")
>>> plan = plan_of(str(folder), Options())
>>> len(plan.partitions), [key_of(part.file.name) for part in plan.partitions[0].slices][:2], plan.other_files
(3, [('A17', 'friday.csv')], {'.md': 1})
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import accumulate, chain, islice, pairwise
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from flinders.apps.fleet.dataset import extents_of, opened, units_of
from flinders.apps.fleet.growth import ReadFiles
from flinders.apps.fleet.keys import KeyColumns, in_path
from flinders.apps.fleet.kinds import TABLES_OF_FLEETS, is_csv_of_units, is_readable, own_kind
from flinders.apps.fleet.names import BATCH_COLUMNS, TABLES
from flinders.apps.fleet.results import SIGN, VERSION
from flinders.apps.fleet.storage import MAGIC, StoredFile, listed
from flinders.errors import FlindersError, UnreadableInput, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from flinders.apps.fleet.dataset import TableFile
    from flinders.apps.fleet.options import Options

Item = TypeVar("Item")
Answer = TypeVar("Answer")

LARGEST: Final = 1_000_000
"""Rows that a partition holds in memory: 64 MB with times and intermediate results."""
SMALLEST: Final = 400_000
"""Rows below which small files share a partition, which costs a few milliseconds."""
MOST_SLICES: Final = 64
"""Files in a partition."""
LEAST_PARTITIONS: Final = 64
"""Partitions of a small job, whose workers would otherwise wait for each other."""
SHORT: Final = 100_000
"""Rows that take a worker a tenth of a second: smaller partitions are not made,"""
SHORT_BYTES: Final = 1 << 18
"""nor of log files of fewer bytes, which take as long,"""
FEW_PARTITIONS: Final = 16
"""unless there would be fewer than this."""
LOG_BYTES: Final = 1 << 24
"""Bytes of log files in a partition."""
LOOKS: Final = 32
"""Files that are opened at a time: most of it is waiting for a store."""
BATCHES: Final = tuple([column] for column in BATCH_COLUMNS)
"""Names of folders with the hardware batch."""
AHEAD: Final = 8 * LOOKS
"""Files that are submitted at a time: memory is bounded for any number of files."""


@dataclass(frozen=True, slots=True)
class FileSlice:
    """A log file, or some row groups of a file of rows."""

    file: StoredFile
    groups: tuple[int, ...] = ()  # None for a log
    rows: int = 0  # of the groups
    # why its row groups are not known: the file could not be opened as a table
    error: FlindersError | None = field(default=None, compare=False)
    is_table: bool = False  # whether such a file is a table of several units, which are not known

    @property
    def weight(self) -> int:
        """Bytes to read, for the progress bar."""
        return self.rows * 32 if self.groups else self.file.size


@contextlib.contextmanager
def open_as_planned(part: FileSlice, options: Options) -> Iterator[TableFile]:
    """Open the file of a slice; one that could not be opened while planning raises that error."""
    if part.error is not None:
        raise part.error
    with opened(part.file, options) as file:
        yield file


@dataclass(frozen=True, slots=True)
class Partition:
    """Unit of work: what a worker calibrates at a time."""

    slices: tuple[FileSlice, ...]
    only: tuple[str, ...] | None = None  # units that are taken; None for all but `without`
    without: tuple[str, ...] = ()  # units that another partition takes
    _named: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_named", frozenset(self.without if self.only is None else self.only))

    @property
    def rows(self) -> int:
        """Rows of all slices."""
        return sum(part.rows for part in self.slices)

    @property
    def weight(self) -> int:
        """Bytes to read, for the progress bar."""
        return sum(part.weight for part in self.slices) + 1

    def takes(self, unit: str) -> bool:
        """Whether readings of a unit are taken."""
        return (unit in self._named) != (self.only is None)

    def split(self) -> list[Partition]:
        """A partition for each slice, to find the one that kills its worker; none if they belong together."""
        if self.only is not None or len(self.slices) == 1:
            return []
        return [replace(self, slices=(part,)) for part in self.slices]


@dataclass(frozen=True, slots=True)
class Plan:
    """All partitions of a run."""

    partitions: tuple[Partition, ...]
    files: int  # files that are read
    # files of other kinds by their suffix, entries that are no files, and files that Flinders wrote
    other_files: dict[str, int]
    fingerprint: str  # hash of files, options and release: partitions with another one belong to another run
    asked: str  # options and release
    read: ReadFiles  # files of this run, and of the table that it extends
    names: tuple[str, ...] = ()  # of the files that are looked at
    faults: Mapping[str, FlindersError] = field(default_factory=dict)  # of files that were read before, by name
    later: int = 0  # new files that wait for the next run, since this one goes on with what another began


@dataclass(frozen=True, slots=True)
class _TableSlice:
    """A slice of a file of rows with its first and last unit."""

    part: FileSlice
    least: str
    greatest: str
    keys: KeyColumns


def plan_of(where: str, options: Options, *, earlier: ReadFiles | None = None, begun: Collection[str] = ()) -> Plan:
    """List the input, and split what is to be read into partitions.

    Raises UnreadableInput if nothing can be read, and UsageError if no file has the columns that the options name, or
    nothing of what a table was made from is there.

    Parameters
    ----------
    earlier : ReadFiles, optional
        Of the table that is extended: only files that are new to it are read.
    begun : collection of str
        Files of a run that was stopped: where all are there, only these are read.
    """
    files = listed(where)
    new, faults = (files, {}) if earlier is None else earlier.news(files)
    if earlier is not None:
        _refuse_other_input(where, earlier, files)
    names = set(begun)
    resumed = [file for file in new if file.name in names]
    chosen = resumed if resumed and len(resumed) == len(begun) else new
    taken = [file for file in chosen if not file.kind and (MAGIC.search(where) or is_readable(file.name))]
    others = set(chosen) - set(taken)
    other_files = Counter(file.kind or PurePosixPath(file.name).suffix or "none" for file in others)
    if not taken and earlier is None:
        raise UnreadableInput(
            f"{where}: none of {len(files)} files is a recording: they end in {', '.join(other_files)}"
        )
    tables, logs, own = _sorted_out(taken, options)
    other_files.update(own.values())
    other_files.update(() if earlier is None else earlier.other_files(files))
    taken = [file for file in taken if file not in own]
    if not taken and earlier is None:
        wrote = f"{counted(len(own), 'file')} that Flinders wrote"
        raise UnreadableInput(f"{where}: no recordings, but {wrote}: give the folder of recordings")
    if taken:
        _refuse_options(where, tables, logs, options)
    by_recording = defaultdict(list)
    for table in tables:
        by_recording[table.keys.recording.value].append(table)
    alike = [_tables(tables, options) for _, tables in sorted(by_recording.items())]
    read = ReadFiles.of(taken, options, {file: kind for file, kind in own.items() if kind != TABLES_OF_FLEETS})
    return Plan(
        (*chain.from_iterable(alike), *_logs(logs)),
        len(taken),
        dict(sorted(other_files.items())),
        _fingerprint(taken, options, earlier),
        _asked(options),
        read if earlier is None else earlier + read,
        tuple(file.name for file in chosen),
        faults,
        sum(is_readable(file.name) for file in new) - sum(is_readable(file.name) for file in chosen),
    )


def _refuse_other_input(where: str, earlier: ReadFiles, files: Sequence[StoredFile]) -> None:
    """Refuse to extend a table from where nothing is left of what it was made from."""
    if not any(file.name in earlier.files for file in files) and (known := earlier.recordings):
        raise UsageError(
            f"{where}: none of the {counted(len(known), 'file')} that the table was made from is there, such as "
            f"{min(known)}: give the same input, with its new files, or name another table"
        )


def _refuse_options(where: str, tables: Sequence[_TableSlice], logs: Sequence[FileSlice], options: Options) -> None:
    """Refuse options about columns where no file has any."""
    if options.unit_column is not None and not tables and not any(part.error for part in logs):
        raise UsageError(
            f"{where}: no table of Parquet or Arrow and no CSV has a column {options.unit_column}: name another, or "
            "give each unit a file or folder of its own",
            hint={"unit_column": None},
        )
    _refuse_batch(where, tables, logs, options)


def _sorted_out(
    files: Sequence[StoredFile], options: Options
) -> tuple[list[_TableSlice], list[FileSlice], dict[StoredFile, str]]:
    """Slices of tables; logs, and files that cannot be opened, which get a row; kinds of files that Flinders wrote."""
    tables: list[_TableSlice] = []
    logs: list[FileSlice] = []
    own: dict[StoredFile, str] = {}
    unopened: list[FileSlice] = []
    for file, surveyed in zip(files, _in_threads(lambda file: _survey(file, options), files), strict=True):
        if isinstance(surveyed, str):
            own[file] = surveyed
        elif isinstance(surveyed, list):
            tables += surveyed
            logs += [] if surveyed else [FileSlice(file)]
        else:
            unopened.append(surveyed)
    wrong_columns = next((part.error for part in unopened if isinstance(part.error, UsageError)), None)
    if wrong_columns is not None and not tables:
        raise wrong_columns
    logs += [replace(part, is_table=part.is_table or bool(tables)) for part in unopened]
    return tables, sorted(logs, key=lambda part: part.file), own


def _refuse_batch(where: str, tables: Sequence[_TableSlice], logs: Sequence[FileSlice], options: Options) -> None:
    """Refuse an option for the hardware batch that matches no column and no folder."""
    slices = [*(table.part for table in tables), *logs]
    if options.batch_column is None or any(table.keys.batch.column for table in tables):
        return
    if not any(part.error or options.batch_column in in_path(part.file.name) for part in slices):
        raise UsageError(
            f"{where}: no file has a column {options.batch_column} or lies in a folder named after it: name another, "
            "or leave that out",
            hint={"batch_column": None},
        )


def _in_threads(function: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
    """Results in the order of the items, a bounded number of them computed ahead.

    >>> list(_in_threads(abs, [-1, 2, -3]))
    [1, 2, 3]
    """
    waiting = iter(items)
    with ThreadPoolExecutor(LOOKS) as pool:
        while batch := list(islice(waiting, AHEAD)):
            yield from pool.map(function, batch)


def key_of(name: str) -> tuple[str, str]:
    """Unit and recording of a log file, by where it lies: the first folder is the unit, else the file itself.

    A folder that names the batch of hardware is passed over. No unit, in a folder of null, is the empty text.

    >>> key_of("A17/2026/monday.bin"), key_of("unit=A17/monday.csv"), key_of("A17.csv.gz")
    (('A17', '2026/monday.bin'), ('A17', 'monday.csv'), ('A17', 'A17.csv.gz'))
    >>> key_of("batch=7/unit=A%2017/monday.bin")
    ('A 17', 'monday.bin')
    """
    parts = [part for part in PurePosixPath(name).parts if part.split("=")[:-1] not in BATCHES]
    if len(parts) == 1:
        return parts[0].removesuffix(".gz").rpartition(".")[0] or parts[0], parts[0]
    first, recording = parts[0], "/".join(parts[1:])
    return next(iter(in_path(f"{first}/{recording}").values()), first) if "=" in first else first, recording


def _survey(file: StoredFile, options: Options) -> list[_TableSlice] | FileSlice | str:
    """Slices of a file of rows, none for a log; the kind of what Flinders wrote; a slice with a broken one's error."""
    if not file.name.lower().endswith(TABLES) and not is_csv_of_units(file, options):
        return own_kind(file) or []
    is_table = False
    try:
        with opened(file, options) as table:
            is_table = True
            if SIGN in (table.schema.metadata or {}):
                return TABLES_OF_FLEETS
            keys = KeyColumns.of_schema(file.name, table.schema, options)
            if keys is None:
                return []
            if not sum(table.groups):
                raise UnreadableInput(f"{file.name} has no rows: record again, or check what was saved")
            return list(_slices(file, table, keys))
    except FlindersError as error:
        keys = None if isinstance(error, UsageError) else KeyColumns.of_path(file.name, options)
        if keys is None:
            return FileSlice(file, error=error, is_table=is_table)
        return [_TableSlice(FileSlice(file, (0,), error=error), keys.unit.value, keys.unit.value, keys)]


def _slices(file: StoredFile, table: TableFile, keys: KeyColumns) -> Iterator[_TableSlice]:
    """Slices of a file of rows, each with its first and last unit."""
    extents = extents_of(table, keys)
    for groups in _ranges(table.groups):
        part = FileSlice(file, groups, sum(table.groups[group] for group in groups))
        ends = [end for group in groups if (end := extents[group]) is not None]
        if len(ends) < len(groups):
            units = units_of(table, keys, groups)
            ends = [(min(units, default=""), max(units, default=""))]
        yield _TableSlice(part, min(ends)[0], max(greatest for _, greatest in ends), keys)


def _runs_that_fit(items: Iterable[Item], fits: Callable[[list[Item], Item], bool]) -> Iterator[list[Item]]:
    """Split items into runs: a new one begins with an item that does not fit the run before it.

    >>> list(_runs_that_fit([1, 2, 3, 9, 1], lambda run, item: sum(run) + item <= 5))
    [[1, 2], [3], [9], [1]]
    """
    run: list[Item] = []
    for item in items:
        if run and not fits(run, item):
            yield run
            run = []
        run.append(item)
    if run:
        yield run


def _ranges(rows: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Split row groups into ranges of up to `LARGEST` rows.

    >>> list(_ranges([600_000, 300_000, 300_000, 2_000_000, 5]))
    [(0, 1), (2,), (3,), (4,)]
    """
    above = np.cumsum([0, *rows])
    runs = _runs_that_fit(range(len(rows)), lambda run, group: above[group + 1] - above[run[0]] <= LARGEST)
    yield from map(tuple, runs)


def _tables(tables: Sequence[_TableSlice], options: Options) -> Iterator[Partition]:
    """Partitions of files of rows: first units that lie in one slice, then units that lie in several."""
    across = _across(tables, options)
    shared = defaultdict(list)
    for unit, places in across.items():
        for place in places:
            shared[place].append(unit)
    alone = {
        table.part: shared[place] for place, table in enumerate(tables) if table.keys.unit.column or not shared[place]
    }
    for slices in _packed(list(alone)):
        without = {unit for part in slices for unit in alone[part]}
        yield Partition(tuple(slices), without=tuple(sorted(without)))
    together = defaultdict(list)
    for unit, places in sorted(across.items()):
        together[places].append(unit)
    yield from _joined(together, tables)


def _enough(total: int, short: int) -> int:
    """Rows or bytes from which on a partition takes no more files."""
    return max(total // LEAST_PARTITIONS, min(short, total // FEW_PARTITIONS))


def _packed(slices: Sequence[FileSlice]) -> Iterator[list[FileSlice]]:
    """Pack small slices of tables together, in order.

    >>> files = [FileSlice(StoredFile(str(part), "", 0), (0,), 20_000) for part in range(200)]
    >>> [len([*_packed(files[:count])]) for count in (3, 32, 100, 200)]
    [3, 16, 20, 40]
    """
    rows = [part.rows for part in slices]
    return _filled(slices, rows, min(SMALLEST, _enough(sum(rows), SHORT)), LARGEST)


def _filled(slices: Sequence[FileSlice], sizes: Sequence[int], enough: int, largest: int) -> Iterator[list[FileSlice]]:
    """Runs of up to `MOST_SLICES` slices that end where they are large enough, or would be too large."""
    above = [0, *accumulate(sizes)]

    def fits(run: list[int], place: int) -> bool:
        size = above[place] - above[run[0]]
        return len(run) < MOST_SLICES and size < enough and size + sizes[place] <= largest

    return ([slices[place] for place in run] for run in _runs_that_fit(range(len(slices)), fits))


def _joined(together: dict[tuple[int, ...], list[str]], tables: Sequence[_TableSlice]) -> Iterator[Partition]:
    """Partitions of units that lie in several slices: each as many units as are likely to fit into memory."""
    units: list[str] = []
    places: set[int] = set()

    def rows(numbers: Iterable[int]) -> int:
        return sum(tables[number].part.rows for number in numbers)

    def partition() -> Partition:
        return Partition(tuple(tables[place].part for place in sorted(places)), only=tuple(sorted(units)))

    for own, every in together.items():
        shares = -(-rows(own) // LARGEST) if len(every) > 1 else 1
        for share in range(shares):
            if units and rows(places | set(own)) > SMALLEST:
                yield partition()
                units, places = [], set()
            units += every[share::shares]
            places |= set(own)
    if units:
        yield partition()


def _across(tables: Sequence[_TableSlice], options: Options) -> dict[str, tuple[int, ...]]:
    """Units with rows in several slices, and in which."""
    across: dict[str, tuple[int, ...]] = {}
    for cluster in _overlapping(tables):
        overlapping = [tables[place] for place in cluster]
        is_sorted = all(one.greatest <= two.least for one, two in pairwise(overlapping))
        if is_sorted:  # only the last unit of one can be the first of the next
            units = [{table.least, table.greatest} for table in overlapping]
        else:
            units = list(_in_threads(lambda table: _units(table, options), overlapping))
        places = defaultdict(list)
        for place, own in sorted(zip(cluster, units, strict=True), key=lambda each: each[0]):
            for unit in own:
                places[unit].append(place)
        across |= {unit: tuple(each) for unit, each in places.items() if len(each) > 1}
    return across


def _overlapping(tables: Sequence[_TableSlice]) -> Iterator[list[int]]:
    """Slices whose ranges of units overlap, from the least unit on."""
    cluster: list[int] = []
    greatest = ""
    for place in sorted(range(len(tables)), key=lambda place: (tables[place].least, tables[place].greatest)):
        if cluster and tables[place].least > greatest:
            yield cluster
            cluster = []
        greatest = max(greatest, tables[place].greatest) if cluster else tables[place].greatest
        cluster.append(place)
    yield from [cluster] if cluster else []


def _units(table: _TableSlice, options: Options) -> set[str]:
    """Units of a slice."""
    with opened(table.part.file, options) as file:
        return units_of(file, table.keys, table.part.groups)


def _logs(slices: Sequence[FileSlice]) -> Iterator[Partition]:
    """Partitions of log files, in order.

    >>> files = [FileSlice(StoredFile(str(part), "", 12_000)) for part in range(2000)]
    >>> [len([*_logs(files[:count])]) for count in (3, 32, 600, 2000)]
    [3, 16, 28, 63]
    """
    sizes = [part.weight for part in slices]
    runs = _filled(slices, sizes, _enough(sum(sizes), SHORT_BYTES), LOG_BYTES)
    return (Partition(tuple(run)) for run in runs)


def _asked(options: Options) -> str:
    """Options and release, as text."""
    return json.dumps({**dataclasses.asdict(options), "versions": (version("flinders"), VERSION)}, sort_keys=True)


def _fingerprint(files: Sequence[StoredFile], options: Options, earlier: ReadFiles | None) -> str:
    """Hash of everything that a result depends on."""
    known = None if earlier is None else earlier.digest
    inputs = [[dataclasses.astuple(file) for file in files], _asked(options), known]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()
