r"""Readers: files and streams in, blocks of `Samples` out.

`open_recording` looks at what a path holds and picks the reader; `read` takes everything in at once.

>>> import tempfile
>>> from pathlib import Path
>>> tumble = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> _ = tumble.write_text("t_s,mag_x_mG,mag_y_mG,mag_z_mG\n0.0,217,4,-586\n0.1,217,2,-587\n")
>>> recording = open_recording(tumble, axes="x,-y,-z")
>>> print(recording.describe())
tumble.csv: columns mag_x_mG, mag_y_mG, mag_z_mG in mG, time in t_s; comma-separated; axes x,-y,-z
>>> read(tumble).field[0]
array([ 21.7,   0.4, -58.6])

A reader is a module of this package with its row in ``READERS`` at the end, by which `registry` finds it. It needs a
sample in tests/samples.py; its line in docs/formats.md is made from the row. Other packages add rows through the entry
points ``flinders.readers``, and are asked first.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache, reduce
from importlib import import_module
from itertools import chain
from numbers import Real
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, TypeAlias, cast

import numpy as np

from flinders.core.axes import Axes
from flinders.core.frames import is_frame
from flinders.core.joining import Joined, in_memory
from flinders.core.keywords import OF_A_FIT, spell_checked
from flinders.core.plugins import modules_of, plugin_rows
from flinders.core.samples import Recording, Samples, added, frame_of
from flinders.core.time_span import TimeSpan
from flinders.errors import FlindersError, NoMagnetometer, UnitError, UnreadableInput, UsageError
from flinders.foreign_errors import reading
from flinders.readers._auxiliary import with_auxiliary
from flinders.readers._choice import FIRST, Choice
from flinders.readers._foreign_files import foreign_kind
from flinders.readers._frame import open_frame
from flinders.readers._log import Instrument, Log, Position, Stored, beginning_of
from flinders.readers._reader import Reader
from flinders.readers._source import File, Progress, Source, find, on_disk
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers.text import TextRecording, open_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.readers._asked_columns import AnyColumns
    from flinders.readers._columns import Columns

__all__ = [
    "Choice",
    "Instrument",
    "Log",
    "Position",
    "Reader",
    "Stored",
    "Table",
    "TableRecording",
    "TextRecording",
    "holds_log",
    "open_log",
    "open_recording",
    "open_table",
    "read",
    "registry",
]

AnyPath: TypeAlias = "str | os.PathLike[str]"
AnySource: TypeAlias = "AnyPath | IO[bytes] | IO[str] | Any"
"""What is one recording; frames need no types here, as their packages need not be there."""
FileRecording: TypeAlias = TextRecording | TableRecording | Instrument
"""What there is to choose from: each knows its file and its unit, and can say what it recognised."""

LAST: Final = "text"
"""The module that takes what no other does: whatever is not binary."""


@cache
def registry() -> tuple[Reader, ...]:
    """All readers, in the order in which they are asked whether they take a file; the first call imports their modules.

    Raises `PluginError` for an installed package whose readers cannot be loaded.
    """
    modules = modules_of(sys.modules[__name__], "READERS")
    last = modules.pop(LAST)
    rows = (getattr(import_module(module), "READERS", ()) for module in (*modules.values(), last))
    return (*plugin_rows("flinders.readers", Reader), *chain.from_iterable(rows))


@spell_checked(OF_A_FIT)
def open_recording(
    path: AnySource | Sequence[AnySource],
    *,
    columns: AnyColumns | None = None,
    pattern: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    sensor: str | int | Choice | None = None,
    topic: str | None = None,
    as_logged: bool = False,
    start: float | None = None,
    end: float | None = None,
    flat: str | None = None,
    auxiliary: Sequence[str] = (),
    once: bool = False,
    progress: Progress | None = None,
) -> Recording:
    """Recognise what a file holds, ready to yield its readings.

    Parameters
    ----------
    path : str, path, file object, data frame, or sequence of them
        A file, ``"-"`` for standard input, an open file, a table in memory, or several recordings of one sensor. Any
        data frame is a table, and so are a mapping of columns and a structured array (`flinders.core.frames`).
    columns : str or sequence of str or int, optional
        Three names, or numbers from 1, of the magnetometer's columns: ``["mx", "my", "mz"]``, ``"mx,my,mz"``,
        ``"4,5,6"``.
    pattern : str, optional
        How a line of text with a reading is written, with names in the place of its numbers, where it is not
        recognised: ``"N {x} / {y} / {z}"``.
    unit : str, optional
        What they are in, where the file does not say: ``uT``, ``mG``, ``G``, ``nT``, ``mT``, ``T`` or ``counts``.
    scale : float, optional
        Microtesla in one count.
    axes : str
        Where each new axis comes from, such as ``"x,-y,-z"``.
    sensor : str, int or Choice, optional
        Which magnetometer of a log, or of a table of several, by its number from 1 or its name; by default the first,
        which says what others there are.
    topic : str, optional
        The member of an archive, or the topic of a bag, which is the name of a magnetometer.
    as_logged : bool
        Of a log, the readings as they were logged; by default the calibration that was in force is removed.
    start, end : float, optional
        Only what lies between these times, in seconds from the beginning of the recording, or of the log.
    flat : str, optional
        Columns may be two, those of a level turn in this plane: ``xy``, ``yz`` or ``zx``; the third axis reads 0.
    auxiliary : sequence of str
        Other columns to read, by the names they have there: ``["wheel_speed_rpm"]``, of a flight log ``BAT.Curr``, of
        a bag ``/battery.current``; into `Samples.auxiliary`.
    once : bool
        It will be gone through once. Standard input or a pipe is then not copied to a temporary file, may be
        endless, and gives its readings as they arrive; a second pass raises `UsageError`.
    progress : callable, optional
        Called once a block with the bytes read so far and, where it is known, those there are.

    Raises
    ------
    InputError
        `UnreadableInput` for what is not there or not a recording, `NoMagnetometer` where it is not clear
        which columns are the magnetometer; for an auxiliary column that is not there.
    UsageError
        For columns or a magnetometer that there are not; its `UnitError` and `AxesError` for a unit or mapping that
        cannot be used.
    """
    is_one = not isinstance(path, Iterable) or (not isinstance(path, (list, tuple)) and is_source(path))
    paths = [path] if is_one else list(cast("Sequence[AnySource]", path))
    if not paths:
        raise UsageError("no recording was given: name at least one file, or '-' for standard input")
    options = _Options(
        columns=columns,
        pattern=pattern,
        unit=unit,
        scale=scale,
        axes=Axes.of(axes),
        choice=sensor if isinstance(sensor, Choice) else Choice.of(sensor),
        topic=topic,
        as_logged=as_logged,
        span=TimeSpan.of(start, end),
        flat=flat,
        progress=progress,
    )
    return with_auxiliary(_of_one_sensor([_opened(each, options, once=once) for each in paths]), auxiliary)


def _of_one_sensor(recordings: Sequence[FileRecording]) -> Recording:
    """Join several recordings, which need one unit."""
    first, *others = recordings
    for other in others:
        if other.unit != first.unit:
            raise UnitError(
                f"{first.source} is in {first.unit.name} and {other.source} in {other.unit.name}: "
                "recordings of one sensor need one unit; say which",
                hint={"unit": None},
            )
    return Joined((first, *others)) if others else first


@spell_checked(OF_A_FIT)
def open_log(
    path: AnyPath,
    *,
    columns: AnyColumns | None = None,
    pattern: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    topic: str | None = None,
    as_logged: bool = False,
    start: float | None = None,
    end: float | None = None,
    progress: Progress | None = None,
) -> Log:
    r"""Recognise all that a file holds: each of its magnetometers, place and time, the calibration that was in force.

    Parameters and errors are those of `open_recording`. A table knows no place.

    >>> import tempfile
    >>> from pathlib import Path
    >>> tumble = Path(tempfile.mkdtemp()) / "tumble.csv"
    >>> _ = tumble.write_text("t_s,mag_x_mG,mag_y_mG,mag_z_mG\n0.0,217,4,-586\n0.1,217,2,-587\n")
    >>> log = open_log(tumble)
    >>> log.format, [instrument.name for instrument in log.instruments]
    ('text', ['columns mag_x_mG, mag_y_mG, mag_z_mG'])
    """
    options = _Options(
        columns=columns,
        pattern=pattern,
        unit=unit,
        scale=scale,
        axes=Axes.of(axes),
        topic=topic,
        as_logged=as_logged,
        span=TimeSpan.of(start, end),
        progress=progress,
    )
    file = _source_of(path)
    with _reading(file) as reader:
        if reader.log is not None:
            return _log_of(file, reader, options)
        table = _table_of(file, reader, options)
        several = [_as_instrument(each) for each in table.each(unit, scale)]
    return Log(
        source=table.source,
        format=reader.title,
        instruments=tuple(several or [_as_instrument(table)]),
        begun=_begun(table.columns),
        notes=() if several else (table.contents(),),
        is_table=True,
    )


def holds_log(
    path: AnyPath, *, columns: AnyColumns | None = None, pattern: str | None = None, topic: str | None = None
) -> bool:
    """Tell whether there is a magnetometer to choose: in a log, or a table of several; never for a pipe.

    Raises `UnreadableInput` for what is not there, or of no kind that is read.

    Parameters
    ----------
    columns, pattern, topic : str, optional
        As `open_recording`; columns say which magnetometer it is already.
    """
    if os.fspath(path) == "-" or not (_is_folder(path) or os.path.isfile(path)):  # noqa: PTH113 - as _is_folder
        return False  # what cannot be looked at twice is left alone
    file = _source_of(path)
    if _reader_of(file.name, file.head()).log is not None:
        return True
    options = _Options(columns=columns, pattern=pattern, topic=topic)
    with contextlib.suppress(FlindersError), _reading(file) as reader:  # said by whoever opens it next
        return bool(_table_of(file, reader, options).columns.magnetometers)
    return False


@spell_checked(OF_A_FIT)
def read(
    path: AnySource | Sequence[AnySource],
    *,
    columns: AnyColumns | None = None,
    pattern: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    sensor: str | int | None = None,
    topic: str | None = None,
    as_logged: bool = False,
    start: float | None = None,
    end: float | None = None,
    auxiliary: Sequence[str] = (),
    progress: Progress | None = None,
) -> Samples:
    """Read a whole recording into memory; parameters and errors as `open_recording`.

    Of several recordings, columns that some do not have are left out.
    """
    recording = open_recording(
        path,
        columns=columns,
        pattern=pattern,
        unit=unit,
        scale=scale,
        axes=axes,
        sensor=sensor,
        topic=topic,
        as_logged=as_logged,
        start=start,
        end=end,
        auxiliary=auxiliary,
        progress=progress,
    )
    samples = in_memory(recording)
    parts = recording.recordings if isinstance(recording, Joined) else (recording,)
    return replace(samples, skipped=reduce(added, (getattr(part, "skipped", ()) for part in parts), ()))


OF_TABLES: Final = ("columns", "unit", "scale", "axes", "flat", "choice", "progress")
"""Options that every reader of tables takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Options:
    """What the caller wants of a file, as `open_recording` names it."""

    columns: AnyColumns | None = None
    unit: str | None = None
    scale: float | None = None
    axes: Axes = field(default_factory=Axes)
    topic: str | None = None
    span: TimeSpan = field(default_factory=TimeSpan)
    progress: Progress | None = None
    pattern: str | None = None
    choice: Choice = FIRST
    as_logged: bool = False
    flat: str | None = None

    def __post_init__(self) -> None:
        """Refuse what is of no type that an option takes, before a file is blamed for it."""
        if not isinstance(self.columns, str | list | tuple | None):
            raise UsageError(f"columns are {self.columns!r}: need a text such as 'mx,my,mz', or a list of three names")
        for option in ("unit", "topic", "pattern", "flat"):
            if not isinstance(given := getattr(self, option), str | None):
                raise UsageError(f"{option} is {given!r}, which is no text: give it within quotes")
        if not isinstance(self.scale, Real | None):
            raise UsageError(f"scale is {self.scale!r}, which is no number: give microtesla in one count")
        if not isinstance(self.as_logged, bool | np.bool_):
            raise UsageError(f"as_logged is {self.as_logged!r}: need True or False")
        if not (self.progress is None or callable(self.progress)):
            raise UsageError(f"progress is {self.progress!r}: need a function of two numbers of bytes")


def is_source(source: object) -> bool:
    """Whether `open_recording` takes it as one recording: a path, an open file, or a table in memory."""
    return isinstance(source, (str, os.PathLike)) or hasattr(source, "read") or is_frame(source)


def _opened(source: AnySource, options: _Options, *, once: bool) -> FileRecording:
    """Open a table in memory, or what a path or an open file holds."""
    if isinstance(source, (str, os.PathLike)) or hasattr(source, "read"):
        return _open(_source_of(cast("AnyPath", source), once=once), options)
    if not is_frame(source):
        what = f"{type(source).__name__} is no recording"
        raise UsageError(f"{what}: give a path, an open file or a table; flinders.Samples.of takes an array")
    for option in ("pattern", "topic", "as_logged"):
        if getattr(options, option):
            raise UsageError(
                "a table in memory has named columns and nothing else: leave this out", hint={option: None}
            )
    recording = open_frame(source, **{name: getattr(options, name) for name in OF_TABLES})
    recording.span = options.span
    recording.is_unit_given = options.unit is not None or options.scale is not None
    return recording


def _open(file: Source, options: _Options) -> FileRecording:
    """Open a file with the first reader that accepts its first bytes; of a log, choose the magnetometer."""
    with _reading(file) as reader:
        if reader.log is not None:
            return _chosen(_log_of(file, reader, options), options)
        return _table_of(file, reader, options)


@contextlib.contextmanager
def _reading(file: Source) -> Iterator[Reader]:
    """Find the reader of a file, and let no error leave it but those of Flinders."""
    reader = _reader_of(file.name, file.head())
    with reading(file.name, reader.title):
        yield reader


def _is_folder(path: AnyPath) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 - False for a name that is too long, where pathlib raises


def _source_of(path: AnyPath, *, once: bool = False) -> Source:
    """Find what a path names; a folder of ROS goes by the description in it, and weighs what all in it does."""
    if not hasattr(path, "read") and _is_folder(path) and (description := _description_of(Path(path))):
        folder = description.parent
        size = sum(member.stat().st_size for member in folder.iterdir() if member.is_file())
        return File(folder.name, description, size)
    return find(path, once=once, check=_reader_of)


def _description_of(folder: Path) -> Path | None:
    """The file that describes a folder which is one recording; None of any other folder."""
    names = (reader.folder_file for reader in registry() if reader.folder_file)
    files = (folder / name for name in names)
    return next((file for file in files if os.path.isfile(file)), None)  # noqa: PTH113 - as _is_folder


def _reader_of(name: str, head: bytes) -> Reader:
    """Find the reader of what starts with these bytes."""
    for reader in registry():
        if reader.accepts(head):
            return reader
    kind = foreign_kind(head)
    what = f"{kind.name}: {kind.advice}" if kind else "of no known kind: give a text recording"
    raise UnreadableInput(f"{name} is {what}")


def _table_of(file: Source, reader: Reader, options: _Options) -> TextRecording | TableRecording:
    """Open the columns of one magnetometer; of several, that which is meant."""
    if options.as_logged:
        raise UsageError(
            f"{file.name} does not say what was corrected before it was written: leave it as it is",
            hint={"as_logged": None},
        )
    of_table: dict[str, Any] = {name: getattr(options, name) for name in OF_TABLES}
    if options.topic is not None:
        if not reader.takes_topic:
            raise UsageError(f"{file.name} has no topics and no members: name none", hint={"topic": None})
        of_table["topic"] = options.topic
    if reader.open is open_text:
        recording: TextRecording | TableRecording = open_text(file, pattern=options.pattern, **of_table)
    elif options.pattern is not None:
        raise UsageError(f"{file.name} is no text ({reader.title}): leave the pattern out", hint={"pattern": None})
    else:
        disk = on_disk(file)
        assert reader.open is not None
        recording = reader.open(disk, **of_table)
        if isinstance(recording, TableRecording):
            recording.file, recording.temporary_files = file, (*recording.temporary_files, disk)
    recording.span = options.span
    recording.is_unit_given = options.unit is not None or options.scale is not None
    return recording


def _as_instrument(table: TextRecording | TableRecording) -> Instrument:
    """Make a magnetometer of a log out of columns of a table; one of several says which columns those are."""
    return Instrument(
        source=table.source,
        name=table.name or f"columns {', '.join(table.columns.field.names)}",
        unit=table.unit,
        columns=lambda _: table.blocks(),
        axes=table.axes,
        frames=(frame_of(table), frame_of(table)),
        readings=table.readings if isinstance(table, TableRecording) else None,
        notes=(table.contents(is_named=False),) if table.name else (),
        fields=tuple(table.columns.field.names),
        unread_time=table.columns.unread_time,
        file=getattr(table, "original", None) or table.file,
    )


def _log_of(file: Source, reader: Reader, options: _Options) -> Log:
    """Open a log, which knows its units and columns."""
    for option in ("columns", "pattern", *(() if reader.takes_unit else ("unit",)), "scale"):
        if getattr(options, option) is not None:
            raise UsageError(
                f"{file.name} is a log ({reader.title}), which knows its own columns and units: leave this out",
                hint={option: None},
            )
    disk = on_disk(file)
    assert reader.log is not None
    log: Log = reader.log(disk, **({"unit": options.unit} if reader.takes_unit else {}))
    if not log.instruments:
        raise NoMagnetometer(f"{file.name} ({log.format}) holds no magnetometer: log it, and record again")
    beginning = np.nan if options.span.is_all else beginning_of(log)
    of_log: dict[str, Any] = {name: getattr(options, name) for name in ("axes", "as_logged", "span", "progress")}
    of_log |= {"beginning": beginning, "file": file, "temporary_files": (disk,)}
    of_log |= {"position": log.position, "begun": log.begun}
    return replace(log, instruments=tuple(replace(instrument, **of_log) for instrument in log.instruments))


def _begun(columns: Columns) -> datetime | None:
    """When a table begins, where its clock counts from 1970."""
    time = columns.time
    if time is None or not time.start:
        return None
    try:
        return datetime.fromtimestamp(time.start * time.factor, tz=UTC)
    except (OverflowError, ValueError, OSError):
        return None


def _chosen(log: Log, options: _Options) -> Instrument:
    """Take the magnetometer that was asked for, or the first, which then names the others."""
    if options.choice.sensor is not None and options.topic is not None:
        raise UsageError(
            "sensor and topic both say which magnetometer of a log it is: leave one of them out",
            hint={"sensor": None, "topic": None},
        )
    choice = options.choice if options.topic is None else Choice(options.topic)
    names = [instrument.name for instrument in log.instruments]
    chosen = log.instruments[choice.among(names, log.source)]
    named = tuple(f"{number} {name}" for number, name in enumerate(names[1:], 2))
    return replace(chosen, others=named if choice.is_open else (), damage=log.damage)
