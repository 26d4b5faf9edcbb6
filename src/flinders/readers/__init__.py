r"""Readers: files and streams in, blocks of `Samples` out.

`open_recording` recognises the content of a path and selects the reader; `read` reads a whole recording into memory.

>>> import tempfile
>>> from pathlib import Path
>>> tumble = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> _ = tumble.write_text("t_s,mag_x_mG,mag_y_mG,mag_z_mG\n0.0,217,4,-586\n0.1,217,2,-587\n")
>>> recording = open_recording(tumble, axes="x,-y,-z")
>>> print(recording.describe())
tumble.csv: columns mag_x_mG, mag_y_mG, mag_z_mG in mG, time in t_s; comma-separated; axes x,-y,-z
>>> read(tumble).field[0]
array([ 21.7,   0.4, -58.6])

A reader is a module of this package with a row in the ``READERS`` at its end; `registry` collects these rows. A reader
needs a sample in tests/samples.py; its line in docs/formats.md is made from the row. Other packages add rows through
the entry points ``flinders.readers``; their readers are tried first.
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
from flinders.core.joining import Joined, read_into_memory
from flinders.core.keywords import FIT_KEYWORDS, check_keywords
from flinders.core.plugins import modules_of, plugin_rows
from flinders.core.samples import Recording, Samples, frame_of, merge_skipped
from flinders.core.time_span import TimeSpan
from flinders.errors import FlindersError, NoMagnetometer, UnitError, UnreadableInput, UsageError
from flinders.foreign_errors import parser_errors
from flinders.readers._auxiliary import with_auxiliary
from flinders.readers._choice import FIRST_SENSOR, Choice
from flinders.readers._foreign_files import foreign_kind
from flinders.readers._frame import open_frame
from flinders.readers._log import Instrument, Log, Position, Stored, start_time_of
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
"""One recording: a path, an open file or a table in memory. Data frames have no type: their packages are optional."""
FileRecording: TypeAlias = TextRecording | TableRecording | Instrument
"""A recording of one magnetometer, with a file, a unit and a description of the recognised columns."""

LAST_MODULE: Final = "text"
"""The module that is tried last, since it accepts every file that is not binary."""


@cache
def registry() -> tuple[Reader, ...]:
    """All readers, in the order in which they are tried. The first call imports their modules.

    Raises `PluginError` for an installed package whose readers cannot be loaded.
    """
    modules = modules_of(sys.modules[__name__], "READERS")
    last = modules.pop(LAST_MODULE)
    rows = (getattr(import_module(module), "READERS", ()) for module in (*modules.values(), last))
    return (*plugin_rows("flinders.readers", Reader), *chain.from_iterable(rows))


@check_keywords(FIT_KEYWORDS)
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
    """Recognise the format of a file and return a recording that yields its readings.

    Parameters
    ----------
    path : str, path, file object, data frame, or sequence of them
        A file, ``"-"`` for standard input, an open file, a table in memory, or several recordings of one sensor. Any
        data frame is a table, and so are a mapping of columns and a structured array (`flinders.core.frames`).
    columns : str or sequence of str or int, optional
        Three names, or numbers from 1, of the magnetometer's columns: ``["mx", "my", "mz"]``, ``"mx,my,mz"``,
        ``"4,5,6"``.
    pattern : str, optional
        Pattern of a line of text with a reading, with names in place of its numbers, for a format that is not
        recognised: ``"N {x} / {y} / {z}"``.
    unit : str, optional
        Unit of the columns if the file states none: ``uT``, ``mG``, ``G``, ``nT``, ``mT``, ``T`` or ``counts``.
    scale : float, optional
        Microtesla per count.
    axes : str
        Source of each new axis, such as ``"x,-y,-z"``.
    sensor : str, int or Choice, optional
        Magnetometer of a log, or of a table with several, by its number from 1 or its name. The default is the first,
        and the description then lists the others.
    topic : str, optional
        Name of a magnetometer: the member of an archive, or the topic of a bag.
    as_logged : bool
        Read the values of a log as they were logged. By default the calibration that the vehicle applied is removed.
    start, end : float, optional
        Read only the readings between these times, in seconds from the beginning of the recording or log.
    flat : str, optional
        Accept two columns, those of a level turn in this plane: ``xy``, ``yz`` or ``zx``; the third axis reads 0.
    auxiliary : sequence of str
        Names of further columns to read: ``["wheel_speed_rpm"]``, in a flight log ``BAT.Curr``, in a bag
        ``/battery.current``. They become `Samples.auxiliary`.
    once : bool
        The recording is read in a single pass. Standard input or a pipe is then not copied to a temporary file, may
        be endless, and yields its readings as they arrive; a second pass raises `UsageError`.
    progress : callable, optional
        Called once per block with the bytes read so far and the total, or None if the total is unknown.

    Raises
    ------
    InputError
        `UnreadableInput` for a file that does not exist or is no recording; `NoMagnetometer` if the columns of the
        magnetometer are not clear. Also for an auxiliary column that does not exist.
    UsageError
        For columns or a magnetometer that do not exist; `UnitError` and `AxesError` for an invalid unit or mapping.
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
    return with_auxiliary(_join_recordings([_open_source(each, options, once=once) for each in paths]), auxiliary)


def _join_recordings(recordings: Sequence[FileRecording]) -> Recording:
    """Join several recordings of one sensor; raise `UnitError` if their units differ."""
    first, *others = recordings
    for other in others:
        if other.unit != first.unit:
            raise UnitError(
                f"{first.source} is in {first.unit.name} and {other.source} in {other.unit.name}: "
                "recordings of one sensor need one unit: name the unit",
                hint={"unit": None},
            )
    return Joined((first, *others)) if others else first


@check_keywords(FIT_KEYWORDS)
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
    r"""Recognise all magnetometers of a file, its position and time, and the calibration that was in force.

    Parameters and errors are those of `open_recording`. A table has no position.

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
        start_time=_start_time(table.columns),
        notes=() if several else (table.contents(),),
        is_table=True,
    )


def holds_log(
    path: AnyPath, *, columns: AnyColumns | None = None, pattern: str | None = None, topic: str | None = None
) -> bool:
    """Whether a file has several magnetometers to choose from: a log, or a table of several. A pipe never counts.

    Raises `UnreadableInput` for a file that does not exist or is of an unknown kind.

    Parameters
    ----------
    columns, pattern, topic : str, optional
        As in `open_recording`; given columns already select the magnetometer.
    """
    if os.fspath(path) == "-" or not (_is_folder(path) or os.path.isfile(path)):  # noqa: PTH113 - as _is_folder
        return False  # a pipe can be read only once, and is left alone
    file = _source_of(path)
    if _reader_of(file.name, file.head()).log is not None:
        return True
    options = _Options(columns=columns, pattern=pattern, topic=topic)
    with contextlib.suppress(FlindersError), _reading(file) as reader:  # whoever opens the file next reports the error
        return bool(_table_of(file, reader, options).columns.magnetometers)
    return False


@check_keywords(FIT_KEYWORDS)
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
    """Read a whole recording into memory. Parameters and errors are those of `open_recording`.

    Columns that not all of several recordings have are left out.
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
    samples = read_into_memory(recording)
    parts = recording.recordings if isinstance(recording, Joined) else (recording,)
    return replace(samples, skipped=reduce(merge_skipped, (getattr(part, "skipped", ()) for part in parts), ()))


TABLE_OPTIONS: Final = ("columns", "unit", "scale", "axes", "flat", "choice", "progress")
"""Options that every reader of tables accepts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Options:
    """Options of `open_recording` for one file."""

    columns: AnyColumns | None = None
    unit: str | None = None
    scale: float | None = None
    axes: Axes = field(default_factory=Axes)
    topic: str | None = None
    span: TimeSpan = field(default_factory=TimeSpan)
    progress: Progress | None = None
    pattern: str | None = None
    choice: Choice = FIRST_SENSOR
    as_logged: bool = False
    flat: str | None = None

    def __post_init__(self) -> None:
        """Check the types of options before the file is opened, so that an error does not blame the file."""
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
    """Whether an object is one recording for `open_recording`: a path, an open file, or a table in memory."""
    return isinstance(source, (str, os.PathLike)) or hasattr(source, "read") or is_frame(source)


def _open_source(source: AnySource, options: _Options, *, once: bool) -> FileRecording:
    """Open a table in memory, or the file of a path or an open file."""
    if isinstance(source, (str, os.PathLike)) or hasattr(source, "read"):
        return _open(_source_of(cast("AnyPath", source), once=once), options)
    if not is_frame(source):
        what = f"{type(source).__name__} is no recording"
        raise UsageError(f"{what}: give a path, an open file or a table; flinders.Samples.of takes an array")
    for option in ("pattern", "topic", "as_logged"):
        if getattr(options, option):
            raise UsageError(
                "a table in memory has named columns and nothing else: leave this option out", hint={option: None}
            )
    recording = open_frame(source, **{name: getattr(options, name) for name in TABLE_OPTIONS})
    recording.span = options.span
    recording.is_unit_given = options.unit is not None or options.scale is not None
    return recording


def _open(file: Source, options: _Options) -> FileRecording:
    """Open a file with the first reader that accepts its first bytes; in a log, choose the magnetometer."""
    with _reading(file) as reader:
        if reader.log is not None:
            return _choose_instrument(_log_of(file, reader, options), options)
        return _table_of(file, reader, options)


@contextlib.contextmanager
def _reading(file: Source) -> Iterator[Reader]:
    """Find the reader of a file, and convert exceptions of other packages inside the block to errors of Flinders."""
    reader = _reader_of(file.name, file.head())
    with parser_errors(file.name, reader.title):
        yield reader


def _is_folder(path: AnyPath) -> bool:
    return os.path.isdir(path)  # noqa: PTH112 - False for a name that is too long, where pathlib raises


def _source_of(path: AnyPath, *, once: bool = False) -> Source:
    """Find the file of a path; for a folder with a ROS recording, its description file, with the size of all files."""
    if not hasattr(path, "read") and _is_folder(path) and (description := _description_of(Path(path))):
        folder = description.parent
        size = sum(member.stat().st_size for member in folder.iterdir() if member.is_file())
        return File(folder.name, description, size)
    return find(path, once=once, check=_reader_of)


def _description_of(folder: Path) -> Path | None:
    """File that describes a folder, if the folder as a whole is one recording; None for any other folder."""
    names = (reader.folder_file for reader in registry() if reader.folder_file)
    files = (folder / name for name in names)
    return next((file for file in files if os.path.isfile(file)), None)  # noqa: PTH113 - as _is_folder


def _reader_of(name: str, head: bytes) -> Reader:
    """Find the reader that accepts these first bytes; raise `UnreadableInput` if none does."""
    for reader in registry():
        if reader.accepts(head):
            return reader
    kind = foreign_kind(head)
    what = f"{kind.name}: {kind.advice}" if kind else "of no known kind: give a text recording"
    raise UnreadableInput(f"{name} is {what}")


def _table_of(file: Source, reader: Reader, options: _Options) -> TextRecording | TableRecording:
    """Open the columns of one magnetometer in a table; if there are several, of the selected one."""
    if options.as_logged:
        raise UsageError(
            f"{file.name} does not record which corrections were applied: leave this option out",
            hint={"as_logged": None},
        )
    of_table: dict[str, Any] = {name: getattr(options, name) for name in TABLE_OPTIONS}
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
    """Make an instrument of a log from the columns of a table; its notes name the columns if the table has several."""
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
    """Open a log; options that its format already defines are refused."""
    for option in ("columns", "pattern", *(() if reader.takes_unit else ("unit",)), "scale"):
        if getattr(options, option) is not None:
            raise UsageError(
                f"{file.name} is a log ({reader.title}), whose columns and units are known: leave this option out",
                hint={option: None},
            )
    disk = on_disk(file)
    assert reader.log is not None
    log: Log = reader.log(disk, **({"unit": options.unit} if reader.takes_unit else {}))
    if not log.instruments:
        raise NoMagnetometer(
            f"{file.name} ({log.format}) holds no magnetometer: log the magnetometer, and record again"
        )
    beginning = np.nan if options.span.is_all else start_time_of(log)
    of_log: dict[str, Any] = {name: getattr(options, name) for name in ("axes", "as_logged", "span", "progress")}
    of_log |= {"beginning": beginning, "file": file, "temporary_files": (disk,)}
    of_log |= {"position": log.position, "start_time": log.start_time}
    return replace(log, instruments=tuple(replace(instrument, **of_log) for instrument in log.instruments))


def _start_time(columns: Columns) -> datetime | None:
    """Start of a table in UTC if its clock counts from 1970; None otherwise."""
    time = columns.time
    if time is None or not time.start:
        return None
    try:
        return datetime.fromtimestamp(time.start * time.factor, tz=UTC)
    except (OverflowError, ValueError, OSError):
        return None


def _choose_instrument(log: Log, options: _Options) -> Instrument:
    """Select the requested magnetometer, or the first one with a list of the others."""
    if options.choice.sensor is not None and options.topic is not None:
        raise UsageError(
            "sensor and topic both choose a magnetometer of the log: leave one of them out",
            hint={"sensor": None, "topic": None},
        )
    choice = options.choice if options.topic is None else Choice(options.topic)
    names = [instrument.name for instrument in log.instruments]
    chosen = log.instruments[choice.index_in(names, log.source)]
    named = tuple(f"{number} {name}" for number, name in enumerate(names[1:], 2))
    return replace(chosen, others=named if choice.is_open else (), damage=log.damage)
