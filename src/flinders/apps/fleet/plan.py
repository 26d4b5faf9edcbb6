r"""Plan of a run: recordings split into partitions, each calibrated by itself and written as one file.

A partition has some log files, some table files, or a range of row groups of one table file; each such part is a slice.
Partitions depend on the input alone, so that a resumed run, or a run with more workers, has the same ones. Units with
rows in several slices get partitions of their own, which take only the rows of these units.

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

from flinders.apps.fleet.dataset import extents_of, open_table_file, units_of
from flinders.apps.fleet.growth import ReadFiles
from flinders.apps.fleet.keys import KeyColumns, values_in_path
from flinders.apps.fleet.kinds import TABLES_OF_FLEETS, is_csv_of_units, is_readable, own_kind
from flinders.apps.fleet.names import BATCH_COLUMNS, TABLES
from flinders.apps.fleet.results import SIGN, VERSION
from flinders.apps.fleet.storage import WILDCARD, StoredFile, list_files
from flinders.errors import FlindersError, UnreadableInput, UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from flinders.apps.fleet.dataset import TableFile
    from flinders.apps.fleet.options import Options

Item = TypeVar("Item")
Answer = TypeVar("Answer")

MAX_ROWS: Final = 1_000_000
"""Largest number of rows of a partition: 64 MB of memory with times and intermediate results."""
MIN_ROWS: Final = 400_000
"""Number of rows up to which small files share a partition, as a partition costs a few milliseconds."""
MAX_SLICES: Final = 64
"""Largest number of files in a partition."""
MIN_PARTITIONS: Final = 64
"""Number of partitions to aim for in a small job, so that all workers have work."""
SHORT_ROWS: Final = 100_000
"""Smallest number of rows of a partition of tables if there are `FEW_PARTITIONS`: a worker takes 0.1 s."""
SHORT_BYTES: Final = 1 << 18
"""Smallest number of bytes of a partition of logs if there are `FEW_PARTITIONS`: a worker takes 0.1 s."""
FEW_PARTITIONS: Final = 16
"""Number of partitions that is made even if each then takes less than 0.1 s."""
LOG_BYTES: Final = 1 << 24
"""Largest number of bytes of log files in a partition."""
MAX_OPEN_FILES: Final = 32
"""Number of files that are opened in parallel, since most of the time is spent waiting for a store."""
BATCHES: Final = tuple([column] for column in BATCH_COLUMNS)
"""Names of folders with the hardware batch."""
MAX_SUBMITTED_FILES: Final = 8 * MAX_OPEN_FILES
"""Largest number of files that are submitted at a time, which bounds the memory."""


@dataclass(frozen=True, slots=True)
class FileSlice:
    """A log file, or some row groups of a table file."""

    file: StoredFile
    groups: tuple[int, ...] = ()  # row groups; empty for a log
    rows: int = 0  # number of rows in the groups
    # error of a file that could not be opened as a table, so that its row groups are not known
    error: FlindersError | None = field(default=None, compare=False)
    is_table: bool = False  # whether a file that could not be opened is a table of several units

    @property
    def weight(self) -> int:
        """Bytes to read, for the progress bar."""
        return self.rows * 32 if self.groups else self.file.size


@contextlib.contextmanager
def open_as_planned(part: FileSlice, options: Options) -> Iterator[TableFile]:
    """Open the file of a slice; raises the error of a file that could not be opened while the run was planned."""
    if part.error is not None:
        raise part.error
    with open_table_file(part.file, options) as file:
        yield file


@dataclass(frozen=True, slots=True)
class Partition:
    """Unit of work that a worker calibrates at a time."""

    slices: tuple[FileSlice, ...]
    only: tuple[str, ...] | None = None  # units whose rows are taken; None for all units but `without`
    without: tuple[str, ...] = ()  # units whose rows another partition takes
    _listed_units: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_listed_units", frozenset(self.without if self.only is None else self.only))

    @property
    def rows(self) -> int:
        """Number of rows of all slices."""
        return sum(part.rows for part in self.slices)

    @property
    def weight(self) -> int:
        """Bytes to read, for the progress bar."""
        return sum(part.weight for part in self.slices) + 1

    def takes(self, unit: str) -> bool:
        """Whether the partition has the readings of a unit, and not another partition."""
        return (unit in self._listed_units) != (self.only is None)

    def split(self) -> list[Partition]:
        """A partition for each slice, to find the slice that kills its worker; empty if slices belong together."""
        if self.only is not None or len(self.slices) == 1:
            return []
        return [replace(self, slices=(part,)) for part in self.slices]


@dataclass(frozen=True, slots=True)
class Plan:
    """Plan of a run: its partitions, and the files that it reads."""

    partitions: tuple[Partition, ...]
    files: int  # files that are read
    # number of other files: by suffix, entries that are no files, and files that Flinders wrote
    other_files: dict[str, int]
    fingerprint: str  # hash of files, options and release, which identifies the run of a partition
    asked: str  # options and release
    read: ReadFiles  # files of this run, and of the table that it extends
    names: tuple[str, ...] = ()  # names of the files that are considered
    faults: Mapping[str, FlindersError] = field(default_factory=dict)  # errors of files that were read before, by name
    later: int = 0  # number of new files that wait for the next run, since this run completes a stopped one


@dataclass(frozen=True, slots=True)
class _TableSlice:
    """A slice of a table file, with its first and last unit."""

    part: FileSlice
    least: str
    greatest: str
    keys: KeyColumns


def plan_of(where: str, options: Options, *, earlier: ReadFiles | None = None, begun: Collection[str] = ()) -> Plan:
    """List the input, and split the files to read into partitions.

    Raises UnreadableInput if nothing can be read, and UsageError if no file has the columns that the options name, or
    if all files that the table to extend was made from are missing.

    Parameters
    ----------
    earlier : ReadFiles, optional
        Files of the table to extend; only new files are read.
    begun : collection of str
        Files of a stopped run; if all of them are there, only these are read.
    """
    files = list_files(where)
    new, faults = (files, {}) if earlier is None else earlier.find_changes(files)
    if earlier is not None:
        _refuse_other_input(where, earlier, files)
    names = set(begun)
    resumed = [file for file in new if file.name in names]
    chosen = resumed if resumed and len(resumed) == len(begun) else new
    taken = [file for file in chosen if not file.kind and (WILDCARD.search(where) or is_readable(file.name))]
    others = set(chosen) - set(taken)
    other_files = Counter(file.kind or PurePosixPath(file.name).suffix or "none" for file in others)
    if not taken and earlier is None:
        raise UnreadableInput(
            f"{where}: none of {len(files)} files is a recording (their names end in {', '.join(other_files)}): name "
            "the recordings"
        )
    tables, logs, own = _classify(taken, options)
    other_files.update(own.values())
    other_files.update(() if earlier is None else earlier.other_files(files))
    taken = [file for file in taken if file not in own]
    if not taken and earlier is None:
        wrote = f"{count_text(len(own), 'file')} that Flinders wrote"
        raise UnreadableInput(f"{where}: no recordings, only {wrote}: give the folder of recordings")
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
        _options_text(options),
        read if earlier is None else earlier + read,
        tuple(file.name for file in chosen),
        faults,
        sum(is_readable(file.name) for file in new) - sum(is_readable(file.name) for file in chosen),
    )


def _refuse_other_input(where: str, earlier: ReadFiles, files: Sequence[StoredFile]) -> None:
    """Refuse to extend a table if the input has none of the files that the table was made from."""
    if not any(file.name in earlier.files for file in files) and (known := earlier.recordings):
        raise UsageError(
            f"{where}: the input has none of the {count_text(len(known), 'file')} of the table, such as {min(known)}: "
            "give the input of the table with its new files, or name another table"
        )


def _refuse_options(where: str, tables: Sequence[_TableSlice], logs: Sequence[FileSlice], options: Options) -> None:
    """Refuse options that name columns if no file has these columns."""
    if options.unit_column is not None and not tables and not any(part.error for part in logs):
        raise UsageError(
            f"{where}: no Parquet, Arrow or CSV table has a column {options.unit_column}: name another column, or "
            "give each unit a file or folder of its own",
            hint={"unit_column": None},
        )
    _refuse_batch(where, tables, logs, options)


def _classify(
    files: Sequence[StoredFile], options: Options
) -> tuple[list[_TableSlice], list[FileSlice], dict[StoredFile, str]]:
    """Sort files: slices of tables, slices of logs and of unreadable files, kinds of the files that Flinders wrote."""
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
    if not any(part.error or options.batch_column in values_in_path(part.file.name) for part in slices):
        raise UsageError(
            f"{where}: no file has a column {options.batch_column} or lies in a folder {options.batch_column}=…: name "
            "another column, or leave the option out",
            hint={"batch_column": None},
        )


def _in_threads(function: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
    """Yield results in the order of the items, with a bounded number of them computed in advance.

    >>> list(_in_threads(abs, [-1, 2, -3]))
    [1, 2, 3]
    """
    waiting = iter(items)
    with ThreadPoolExecutor(MAX_OPEN_FILES) as pool:
        while batch := list(islice(waiting, MAX_SUBMITTED_FILES)):
            yield from pool.map(function, batch)


def key_of(name: str) -> tuple[str, str]:
    """Unit and recording of a log file, from its path: the first folder is the unit, else the file itself.

    A folder that names the hardware batch is skipped. A folder that stands for null (Hive) gives an empty unit.

    >>> key_of("A17/2026/monday.bin"), key_of("unit=A17/monday.csv"), key_of("A17.csv.gz")
    (('A17', '2026/monday.bin'), ('A17', 'monday.csv'), ('A17', 'A17.csv.gz'))
    >>> key_of("batch=7/unit=A%2017/monday.bin")
    ('A 17', 'monday.bin')
    """
    parts = [part for part in PurePosixPath(name).parts if part.split("=")[:-1] not in BATCHES]
    if len(parts) == 1:
        return parts[0].removesuffix(".gz").rpartition(".")[0] or parts[0], parts[0]
    first, recording = parts[0], "/".join(parts[1:])
    return next(iter(values_in_path(f"{first}/{recording}").values()), first) if "=" in first else first, recording


def _survey(file: StoredFile, options: Options) -> list[_TableSlice] | FileSlice | str:
    """Examine a file: slices of a table file, no slices for a log, or the kind of a file that Flinders wrote.

    A table file that cannot be opened is a slice with the error.
    """
    if not file.name.lower().endswith(TABLES) and not is_csv_of_units(file, options):
        return own_kind(file) or []
    is_table = False
    try:
        with open_table_file(file, options) as table:
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
    """Yield slices of a table file, each with its first and last unit."""
    extents = extents_of(table, keys)
    for groups in _ranges(table.groups):
        part = FileSlice(file, groups, sum(table.groups[group] for group in groups))
        ends = [end for group in groups if (end := extents[group]) is not None]
        if len(ends) < len(groups):
            units = units_of(table, keys, groups)
            ends = [(min(units, default=""), max(units, default=""))]
        yield _TableSlice(part, min(ends)[0], max(greatest for _, greatest in ends), keys)


def _runs_that_fit(items: Iterable[Item], fits: Callable[[list[Item], Item], bool]) -> Iterator[list[Item]]:
    """Split items into runs; an item that does not fit into a run begins the next one.

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
    """Split row groups into ranges of up to `MAX_ROWS` rows.

    >>> list(_ranges([600_000, 300_000, 300_000, 2_000_000, 5]))
    [(0, 1), (2,), (3,), (4,)]
    """
    above = np.cumsum([0, *rows])
    runs = _runs_that_fit(range(len(rows)), lambda run, group: above[group + 1] - above[run[0]] <= MAX_ROWS)
    yield from map(tuple, runs)


def _tables(tables: Sequence[_TableSlice], options: Options) -> Iterator[Partition]:
    """Yield partitions of table files: first for units in one slice, then for units in several."""
    across = _shared_units(tables, options)
    shared = defaultdict(list)
    for unit, places in across.items():
        for place in places:
            shared[place].append(unit)
    alone = {
        table.part: shared[place] for place, table in enumerate(tables) if table.keys.unit.column or not shared[place]
    }
    for slices in _pack(list(alone)):
        without = {unit for part in slices for unit in alone[part]}
        yield Partition(tuple(slices), without=tuple(sorted(without)))
    together = defaultdict(list)
    for unit, places in sorted(across.items()):
        together[places].append(unit)
    yield from _shared_partitions(together, tables)


def _full_size(total: int, short: int) -> int:
    """Number of rows or bytes at which a partition is full."""
    return max(total // MIN_PARTITIONS, min(short, total // FEW_PARTITIONS))


def _pack(slices: Sequence[FileSlice]) -> Iterator[list[FileSlice]]:
    """Pack small slices of tables together, in order.

    >>> files = [FileSlice(StoredFile(str(part), "", 0), (0,), 20_000) for part in range(200)]
    >>> [len([*_pack(files[:count])]) for count in (3, 32, 100, 200)]
    [3, 16, 20, 40]
    """
    rows = [part.rows for part in slices]
    return _fill(slices, rows, min(MIN_ROWS, _full_size(sum(rows), SHORT_ROWS)), MAX_ROWS)


def _fill(slices: Sequence[FileSlice], sizes: Sequence[int], enough: int, largest: int) -> Iterator[list[FileSlice]]:
    """Yield runs of up to `MAX_SLICES` slices; a run ends when it is large enough, or would become too large."""
    above = [0, *accumulate(sizes)]

    def fits(run: list[int], place: int) -> bool:
        size = above[place] - above[run[0]]
        return len(run) < MAX_SLICES and size < enough and size + sizes[place] <= largest

    return ([slices[place] for place in run] for run in _runs_that_fit(range(len(slices)), fits))


def _shared_partitions(
    together: dict[tuple[int, ...], list[str]], tables: Sequence[_TableSlice]
) -> Iterator[Partition]:
    """Yield partitions of units that lie in several slices, each with as many units as should fit into memory."""
    units: list[str] = []
    places: set[int] = set()

    def rows(numbers: Iterable[int]) -> int:
        return sum(tables[number].part.rows for number in numbers)

    def partition() -> Partition:
        return Partition(tuple(tables[place].part for place in sorted(places)), only=tuple(sorted(units)))

    for own, every in together.items():
        shares = -(-rows(own) // MAX_ROWS) if len(every) > 1 else 1
        for share in range(shares):
            if units and rows(places | set(own)) > MIN_ROWS:
                yield partition()
                units, places = [], set()
            units += every[share::shares]
            places |= set(own)
    if units:
        yield partition()


def _shared_units(tables: Sequence[_TableSlice], options: Options) -> dict[str, tuple[int, ...]]:
    """Units with rows in several slices, and the indices of these slices."""
    across: dict[str, tuple[int, ...]] = {}
    for cluster in _overlapping_slices(tables):
        overlapping = [tables[place] for place in cluster]
        is_sorted = all(one.greatest <= two.least for one, two in pairwise(overlapping))
        if is_sorted:  # two slices share a unit only if it is the last of one and the first of the next
            units = [{table.least, table.greatest} for table in overlapping]
        else:
            units = list(_in_threads(lambda table: _units(table, options), overlapping))
        places = defaultdict(list)
        for place, own in sorted(zip(cluster, units, strict=True), key=lambda each: each[0]):
            for unit in own:
                places[unit].append(place)
        across |= {unit: tuple(each) for unit, each in places.items() if len(each) > 1}
    return across


def _overlapping_slices(tables: Sequence[_TableSlice]) -> Iterator[list[int]]:
    """Yield groups of slices whose ranges of units overlap, in the order of units."""
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
    """Names of the units with rows in a slice."""
    with open_table_file(table.part.file, options) as file:
        return units_of(file, table.keys, table.part.groups)


def _logs(slices: Sequence[FileSlice]) -> Iterator[Partition]:
    """Pack log files into partitions, in order.

    >>> files = [FileSlice(StoredFile(str(part), "", 12_000)) for part in range(2000)]
    >>> [len([*_logs(files[:count])]) for count in (3, 32, 600, 2000)]
    [3, 16, 28, 63]
    """
    sizes = [part.weight for part in slices]
    runs = _fill(slices, sizes, _full_size(sum(sizes), SHORT_BYTES), LOG_BYTES)
    return (Partition(tuple(run)) for run in runs)


def _options_text(options: Options) -> str:
    """Options and release, as text."""
    return json.dumps({**dataclasses.asdict(options), "versions": (version("flinders"), VERSION)}, sort_keys=True)


def _fingerprint(files: Sequence[StoredFile], options: Options, earlier: ReadFiles | None) -> str:
    """Hash of everything that a result depends on."""
    known = None if earlier is None else earlier.digest
    inputs = [[dataclasses.astuple(file) for file in files], _options_text(options), known]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()
