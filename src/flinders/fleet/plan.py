r"""What there is to do: recordings cut into partitions, each of which is worked on alone and written as one file.

A partition is some log files, some files of rows, or a range of the row groups of one; it depends on what is there and
on nothing else, so that a job which is resumed, or run with more workers, does the same partitions. A unit that has
rows in several of them gets a partition that reads just those and takes just its rows.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> for name in ("A17/monday.csv", "A17/friday.csv", "B02/monday.csv", "B02/notes.md"):
...     (folder / name).parent.mkdir(exist_ok=True)
...     _ = (folder / name).write_text("x,y,z\n")
>>> plan = plan_of(str(folder), Asked())
>>> len(plan.partitions), [key_of(piece.member.name) for piece in plan.partitions[0].pieces][:2], plan.left_out
(3, [('A17', 'friday.csv')], {'.md': 1})
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections import Counter, defaultdict, deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from itertools import chain, islice, pairwise
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Final, TypeVar

from flinders.errors import FlindersError, UnreadableInput, UsageError, counted
from flinders.fleet.store import MAGIC, Member, listed
from flinders.fleet.table import SIGN, VERSION
from flinders.fleet.tables import (
    BATCH_COLUMNS,
    TABLES,
    Asked,
    Keys,
    extents_of,
    in_path,
    opened,
    refuse_empty,
    units_of,
)
from flinders.readers import READERS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

Asker = TypeVar("Asker")
Answer = TypeVar("Answer")

READABLE: Final = (*{suffix for reader in READERS for suffix in reader.suffixes}, *TABLES)
"""Endings of files that are taken from a folder; a pattern takes what it names."""
LARGEST: Final = 1_000_000
"""Rows that a partition holds in memory, 64 MB with times and what becomes of them."""
SMALLEST: Final = 400_000
"""Rows below which small files are put together into one partition: each costs a few milliseconds of its own."""
MOST_PIECES: Final = 64
"""Files in a partition."""
LEAST_PARTITIONS: Final = 64
"""Fewer of them, and workers would wait for each other: a small job has small partitions."""
SHORT: Final = 100_000
"""Rows that take a worker a tenth of a second: a job of few partitions is not cut into smaller ones,"""
FEW_PARTITIONS: Final = 16
"""unless there are fewer than that."""
LOG_BYTES: Final = 1 << 24
"""Bytes of log files in a partition."""
LOOKS: Final = 32
"""Files that are looked at at a time: most of it is waiting for a store."""
BATCHES: Final = tuple([column] for column in BATCH_COLUMNS)
"""What folders are called that say the batch of hardware."""
TABLES_OF_FLEETS: Final = "tables of fleets"
"""What tables that a run wrote are counted as: an output may lie among the recordings."""
AHEAD: Final = 8 * LOOKS
"""Files whose turn comes next: what is held of those that were looked at is bounded, for any number of files."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A log file, or some row groups of a file of rows.

    Attributes
    ----------
    member : Member
    groups : tuple of int
        None of them for a log.
    rows : int
        Of the groups.
    is_table : bool
        A table that could not be taken for one, among others that could: what its units are is not known.
    is_refused : bool
        A file that could not be opened as a table, and of whose row groups nothing is known.
    """

    member: Member
    groups: tuple[int, ...] = ()
    rows: int = 0
    is_table: bool = False
    is_refused: bool = False

    @property
    def weight(self) -> int:
        """What it is to read, in bytes, for the progress bar."""
        return self.rows * 32 if self.groups else self.member.size


@dataclass(frozen=True, slots=True)
class Partition:
    """What is worked on at a time.

    Attributes
    ----------
    pieces : tuple of Piece
    only : tuple of str, optional
        Units that are taken; None for all but `without`.
    without : tuple of str
        Units that another partition takes.
    """

    pieces: tuple[Piece, ...]
    only: tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    _named: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_named", frozenset(self.without if self.only is None else self.only))

    @property
    def rows(self) -> int:
        """Rows of all its pieces."""
        return sum(piece.rows for piece in self.pieces)

    @property
    def weight(self) -> int:
        """What it is to read, for the progress bar."""
        return sum(piece.weight for piece in self.pieces) + 1

    def takes(self, unit: str) -> bool:
        """Whether the readings of a unit are taken."""
        return (unit in self._named) != (self.only is None)

    def split(self) -> list[Partition]:
        """A partition for each piece, to find the one that kills its worker; none where they belong together."""
        if self.only is not None or len(self.pieces) == 1:
            return []
        return [replace(self, pieces=(piece,)) for piece in self.pieces]


@dataclass(frozen=True, slots=True)
class Plan:
    """All that is to be done.

    Attributes
    ----------
    partitions : tuple of Partition
    files : int
        Those that are read.
    left_out : dict
        How many files of other kinds there are, by their endings; and what is no file, and tables of fleets.
    fingerprint : str
        Of files, options and release: parts of a run with another one do not belong to this.
    """

    partitions: tuple[Partition, ...]
    files: int
    left_out: dict[str, int]
    fingerprint: str


@dataclass(frozen=True, slots=True)
class _Surveyed:
    """A piece of a file of rows with the units between which its own lie."""

    piece: Piece
    least: str
    greatest: str
    keys: Keys


def plan_of(where: str, asked: Asked) -> Plan:
    """Look at what is there, and cut it into partitions.

    Raises
    ------
    UnreadableInput
        Where there is nothing that can be read.
    UsageError
        Where no file has the columns that were asked for.
    """
    members = listed(where)
    taken = [member for member in members if not member.kind and (MAGIC.search(where) or _is_readable(member.name))]
    left_out = Counter(_ending(member) for member in set(members) - set(taken))
    if not taken:
        raise UnreadableInput(
            f"{where}: none of {len(members)} files is a recording: they end in {', '.join(left_out)}"
        )
    tables, logs, own = _sorted_out(taken, asked)
    if own:
        left_out[TABLES_OF_FLEETS] = len(own)
        taken = [member for member in taken if member not in own]
    if not taken:
        raise UnreadableInput(f"{where}: no recordings, but {counted(len(own), 'table')} that `flinders fleet` wrote")
    _refuse_batch(where, tables, logs, asked)
    by_recording = defaultdict(list)
    for table in tables:
        by_recording[table.keys.recording_value].append(table)
    alike = [_tables(tables, asked) for _, tables in sorted(by_recording.items())]
    partitions = (*chain.from_iterable(alike), *_logs(logs))
    return Plan(partitions, len(taken), dict(sorted(left_out.items())), _fingerprint(taken, asked))


def _sorted_out(members: Sequence[Member], asked: Asked) -> tuple[list[_Surveyed], list[Piece], set[Member]]:
    """Files of rows; logs, among these also what cannot be opened, which its row will say; and tables of fleets.

    Raises
    ------
    UsageError
        Where no file has the columns that were asked for.
    """
    tables: list[_Surveyed] = []
    logs: list[Piece] = []
    own: set[Member] = set()
    refused: dict[Member, FlindersError] = {}
    for member, found in zip(members, _at_once(lambda member: _looked_at(member, asked), members), strict=True):
        if found is None:
            own.add(member)
        elif isinstance(found, FlindersError):
            named = [] if isinstance(found, UsageError) else _named(member, asked)
            tables += named
            refused |= {} if named else {member: found}
        elif found:
            tables += found
        else:
            logs.append(Piece(member))
    columns = next((error for error in refused.values() if isinstance(error, UsageError)), None)
    if columns is not None and not tables:
        raise columns
    is_table = bool(tables)
    logs += [Piece(member, is_table=is_table, is_refused=True) for member in refused]  # why, the worker will say
    return tables, sorted(logs, key=lambda piece: piece.member), own


def _refuse_batch(where: str, tables: Sequence[_Surveyed], logs: Sequence[Piece], asked: Asked) -> None:
    """Refuse a batch of hardware that was asked for, and that nothing says.

    Raises
    ------
    UsageError
    """
    pieces = [*(table.piece for table in tables), *logs]
    if asked.batch_column is None or any(table.keys.batch for table in tables):
        return
    if not any(piece.is_refused or asked.batch_column in in_path(piece.member.name) for piece in pieces):
        raise UsageError(
            f"{where}: no file has a column {asked.batch_column} or lies in a folder "
            f"{asked.batch_column}=...: name another with --batch-column, or leave that out"
        )


def _named(member: Member, asked: Asked) -> list[_Surveyed]:
    """A table that cannot be opened as one piece of the unit that its path says; nothing where that says none."""
    keys = Keys.of_path(member.name, asked)
    return (
        []
        if keys is None
        else [_Surveyed(Piece(member, (0,), is_refused=True), keys.unit_value, keys.unit_value, keys)]
    )


def _ending(member: Member) -> str:
    """What kind of file is left out."""
    return member.kind or PurePosixPath(member.name).suffix or "none"


def _at_once(look: Callable[[Asker], Answer], asked: Iterable[Asker]) -> Iterator[Answer]:
    """Answers in the order of what is asked, some of them being waited for at the same time.

    >>> list(_at_once(abs, [-1, 2, -3]))
    [1, 2, 3]
    """
    waiting = iter(asked)
    pool = ThreadPoolExecutor(LOOKS)
    try:
        held = deque(pool.submit(look, each) for each in islice(waiting, AHEAD))
        while held:
            yield held.popleft().result()
            held.extend(pool.submit(look, each) for each in islice(waiting, 1))
    finally:
        pool.shutdown(cancel_futures=True)


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


def _is_readable(name: str) -> bool:
    """Whether it is taken: by its ending, or a folder that cannot be listed, which a row shall say."""
    return name.lower().endswith((*READABLE, "/"))


def _looked_at(member: Member, asked: Asked) -> list[_Surveyed] | FlindersError | None:
    """The pieces of a file of rows, none for a log; the error where it cannot be opened, or a column is not there."""
    try:
        return _surveyed(member, asked)
    except FlindersError as error:
        return error


def _surveyed(member: Member, asked: Asked) -> list[_Surveyed] | None:
    """The pieces of a file of rows; none for a log, and None for a table of a fleet.

    Raises
    ------
    FlindersError
        Where it cannot be opened, or a column is not there.
    """
    if not member.name.lower().endswith(TABLES):
        return []
    found = []
    with opened(member, asked) as file:
        if SIGN in (file.schema.metadata or {}):
            return None
        keys = Keys.of_schema(member.name, file.schema, asked)
        if keys is None:
            return []
        refuse_empty(file)
        extents = extents_of(file, keys)
        for groups in _ranges(file.groups):
            piece = Piece(member, groups, sum(file.groups[group] for group in groups))
            ends = [extents[group] for group in groups]
            known = [end for end in ends if end is not None]
            if len(known) < len(ends):
                units = units_of(file, keys, groups)
                known = [(min(units, default=""), max(units, default=""))]
            found.append(_Surveyed(piece, min(known)[0], max(greatest for _, greatest in known), keys))
    return found


def _ranges(rows: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Cut row groups into ranges of up to `LARGEST` rows.

    >>> list(_ranges([600_000, 300_000, 300_000, 2_000_000, 5]))
    [(0, 1), (2,), (3,), (4,)]
    """
    held: list[int] = []
    for group, count in enumerate(rows):
        if held and sum(rows[each] for each in held) + count > LARGEST:
            yield tuple(held)
            held = []
        held.append(group)
    if held:
        yield tuple(held)


def _tables(tables: Sequence[_Surveyed], asked: Asked) -> Iterator[Partition]:
    """Partitions of files of rows: first what lies in one piece, then the units that lie in several."""
    across = _across(tables, asked)
    shared = defaultdict(list)
    for unit, places in across.items():
        for place in places:
            shared[place].append(unit)
    alone = [
        (table.piece, tuple(sorted(shared[place])))
        for place, table in enumerate(tables)
        if table.keys.unit or not shared[place]
    ]
    shares = iter(alone)
    for pieces in _packed([piece for piece, _ in alone]):
        without = {unit for _, units in islice(shares, len(pieces)) for unit in units}
        yield Partition(tuple(pieces), without=tuple(sorted(without)))
    together = defaultdict(list)
    for unit, places in sorted(across.items()):
        together[places].append(unit)
    yield from _gathered(together, tables)


def _packed(pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
    """Put small pieces together, in order.

    >>> files = [Piece(Member("part.parquet", "part.parquet", 0), (0,), rows) for rows in [20_000] * 200]
    >>> [len([*_packed(files[:count])]) for count in (3, 32, 100, 200)]
    [3, 16, 20, 40]
    """
    held: list[Piece] = []
    every = sum(piece.rows for piece in pieces)
    enough = min(SMALLEST, max(every // LEAST_PARTITIONS, min(SHORT, every // FEW_PARTITIONS)))
    for piece in pieces:
        rows = sum(each.rows for each in held)
        if held and (len(held) >= MOST_PIECES or rows >= enough or rows + piece.rows > LARGEST):
            yield held
            held = []
        held.append(piece)
    if held:
        yield held


def _gathered(together: dict[tuple[int, ...], list[str]], tables: Sequence[_Surveyed]) -> Iterator[Partition]:
    """Partitions of units that lie in several pieces: each as many units as are likely to fit into memory."""
    held: list[str] = []
    places: set[int] = set()
    for own, units in together.items():
        rows = sum(tables[place].piece.rows for place in own)
        stacks = -(-rows // LARGEST) if len(units) > 1 else 1
        for stack in range(stacks):
            some = units[stack::stacks]
            if held and sum(tables[place].piece.rows for place in places | set(own)) > SMALLEST:
                yield Partition(tuple(tables[place].piece for place in sorted(places)), only=tuple(sorted(held)))
                held, places = [], set()
            held += some
            places |= set(own)
    if held:
        yield Partition(tuple(tables[place].piece for place in sorted(places)), only=tuple(sorted(held)))


def _across(tables: Sequence[_Surveyed], asked: Asked) -> dict[str, tuple[int, ...]]:
    """Units that have rows in several pieces, and in which."""
    found: dict[str, tuple[int, ...]] = {}
    for cluster in _overlapping(tables):
        row = [tables[place] for place in cluster]
        follow = all(one.greatest <= two.least for one, two in pairwise(row))
        if follow:  # only the last of one can be the first of the next
            held = {place: {tables[place].least, tables[place].greatest} for place in cluster}
        else:
            held = dict(zip(cluster, _at_once(lambda table: _units(table, asked), row), strict=True))
        places = defaultdict(list)
        for place in sorted(cluster):
            for unit in held[place]:
                places[unit].append(place)
        found |= {unit: tuple(each) for unit, each in places.items() if len(each) > 1}
    return found


def _overlapping(tables: Sequence[_Surveyed]) -> Iterator[list[int]]:
    """Pieces whose ranges of units have something in common, from the least unit on."""
    cluster: list[int] = []
    greatest = ""
    for place in sorted(range(len(tables)), key=lambda place: (tables[place].least, tables[place].greatest)):
        if cluster and tables[place].least > greatest:
            yield cluster
            cluster = []
        greatest = max(greatest, tables[place].greatest) if cluster else tables[place].greatest
        cluster.append(place)
    yield from [cluster] if cluster else []


def _units(table: _Surveyed, asked: Asked) -> set[str]:
    with opened(table.piece.member, asked) as file:
        return units_of(file, table.keys, table.piece.groups)


def _logs(pieces: Sequence[Piece]) -> Iterator[Partition]:
    """Partitions of log files, in order."""
    held: list[Piece] = []
    most = min(MOST_PIECES, max(len(pieces) // LEAST_PARTITIONS, 1))
    for piece in pieces:
        if held and (len(held) >= most or sum(each.weight for each in held) + piece.weight > LOG_BYTES):
            yield Partition(tuple(held))
            held = []
        held.append(piece)
    if held:
        yield Partition(tuple(held))


def _fingerprint(members: Sequence[Member], asked: Asked) -> str:
    """A hash of all that a result follows from."""
    told = {
        "members": [dataclasses.astuple(member) for member in members],
        "asked": dataclasses.asdict(asked),
        "versions": (version("flinders"), VERSION),
    }
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
