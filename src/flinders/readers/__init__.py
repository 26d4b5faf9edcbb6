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

A reader is a row of `READERS`: a new format adds a file and a row.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Protocol, TypeAlias

import numpy as np

from flinders.axes import Axes
from flinders.errors import UnitError, UnreadableInput, UsageError
from flinders.readers._kinds import foreign_kind
from flinders.readers._skipping import added
from flinders.readers._source import Source, find
from flinders.readers.text import Progress, TextRecording, open_text, sniff_text
from flinders.samples import Joined, Recording, Samples

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats
    from flinders.units import Unit

__all__ = ["READERS", "Reader", "TextRecording", "open_recording", "read"]

AnyPath: TypeAlias = "str | os.PathLike[str]"


class FileRecording(Recording, Protocol):
    """What every reader gives: a recording that knows its unit and can say what it recognised."""

    @property
    def unit(self) -> Unit:
        """What the magnetometer's readings were written in."""

    def describe(self) -> str:
        """Say in one line what was recognised and is used."""


class Open(Protocol):
    """How a reader opens a file: it recognises at once, and reads when asked."""

    def __call__(
        self,
        file: Source,
        /,
        *,
        columns: str | None,
        unit: str | None,
        scale: float | None,
        axes: Axes,
        progress: Progress | None,
    ) -> FileRecording:
        """As `open_recording`."""


@dataclass(frozen=True, slots=True)
class Reader:
    """One row of the table of formats.

    Attributes
    ----------
    name : str
        For people.
    suffixes : tuple of str
        Endings that such files usually have; the content decides.
    sniff : callable
        Tells from the first bytes, unpacked, whether this reader should try.
    open : callable
        Opens what `sniff` accepted.
    extra : str
        The optional dependency it needs, or nothing.
    """

    name: str
    suffixes: tuple[str, ...]
    sniff: Callable[[bytes], bool]
    open: Open
    extra: str = ""


READERS: Final = (
    Reader("text", (".csv", ".txt", ".tsv", ".dat", ".log", ".json", ".jsonl", ".gz"), sniff_text, open_text),
)
"""Asked in this order."""


def open_recording(
    path: AnyPath | Sequence[AnyPath],
    *,
    columns: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    once: bool = False,
    progress: Progress | None = None,
) -> Recording:
    """Recognise what a file holds, ready to yield its readings.

    Parameters
    ----------
    path : str, path or sequence of them
        A file, ``"-"`` for standard input, or several recordings of one sensor.
    columns : str, optional
        Three names, or numbers from 1, of the magnetometer's columns: ``"mx,my,mz"``, ``"4,5,6"``.
    unit : str, optional
        What they are in, where the file does not say: ``uT``, ``mG``, ``G``, ``nT``, ``mT``, ``T`` or ``counts``.
    scale : float, optional
        Microtesla in one count.
    axes : str
        Where each new axis comes from, such as ``"x,-y,-z"``.
    once : bool
        It will be gone through once. Standard input or a pipe is then not copied to a temporary file, may be
        endless, and gives its readings as they arrive; a second pass raises `UsageError`.
    progress : callable, optional
        Called once a block with the bytes read so far and, where it is known, those there are.

    Raises
    ------
    InputError
        `UnreadableInput` for what is not there or not a recording, `NoMagnetometer` where it is not clear
        which columns are the magnetometer.
    UsageError
        For columns that there are not; its `UnitError` and `AxesError` for a unit or mapping that cannot be used.
    """
    paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
    if not paths:
        raise UsageError("no recording was given: name at least one file, or '-' for standard input")
    turned = Axes.of(axes)
    opened = [
        _open(find(each, once=once), columns=columns, unit=unit, scale=scale, axes=turned, progress=progress)
        for each in paths
    ]
    if len(opened) == 1:
        return opened[0]
    for other in opened[1:]:
        if other.unit != opened[0].unit:
            raise UnitError(
                f"{opened[0].source} is in {opened[0].unit.name} and {other.source} in {other.unit.name}: "
                "recordings of one sensor need one unit; say which with --unit"
            )
    return Joined(tuple(opened))


def read(
    path: AnyPath | Sequence[AnyPath],
    *,
    columns: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    progress: Progress | None = None,
) -> Samples:
    """Read a whole recording into memory; parameters and errors as `open_recording`.

    Of several recordings, columns that some do not have are left out.
    """
    recording = open_recording(path, columns=columns, unit=unit, scale=scale, axes=axes, progress=progress)
    blocks = list(recording.blocks())
    joined = replace(
        blocks[0],
        field=np.concatenate([block.field for block in blocks]),
        time=_joined([block.time for block in blocks]),
        acceleration=_joined([block.acceleration for block in blocks]),
        rate=_joined([block.rate for block in blocks]),
        temperature=_joined([block.temperature for block in blocks]),
        current=_joined([block.current for block in blocks]),
        strength=_joined([block.strength for block in blocks]),
        source=recording.source,
        skipped=(),
    )
    for part in recording.recordings if isinstance(recording, Joined) else (recording,):
        joined = replace(joined, skipped=added(joined.skipped, getattr(part, "skipped", ())))
    return joined


def _open(
    file: Source,
    *,
    columns: str | None,
    unit: str | None,
    scale: float | None,
    axes: Axes,
    progress: Progress | None,
) -> FileRecording:
    """Open a file with the first reader that accepts its first bytes."""
    head = file.head()
    for reader in READERS:
        if reader.sniff(head):
            return reader.open(file, columns=columns, unit=unit, scale=scale, axes=axes, progress=progress)
    kind = foreign_kind(head)
    found = f"{kind.name}: {kind.advice}" if kind else "of no known kind: give a text recording"
    raise UnreadableInput(f"{file.name} is {found}")


def _joined(columns: Sequence[Floats | None]) -> Floats | None:
    present = [column for column in columns if column is not None]
    return np.concatenate(present) if len(present) == len(columns) else None
