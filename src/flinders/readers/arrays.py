r"""Arrays on the disk, NumPy's ``.npy`` and ``.npz``, and ZIP archives of phone loggers.

Named arrays are columns: ``t``, ``mag`` with three columns, ``acc``. Arrays of another length than most are left out.
Nothing that would have to be executed is read: an array of Python objects is refused.

>>> import tempfile
>>> from pathlib import Path
>>> import numpy as np
>>> from flinders.readers._source import find
>>> path = Path(tempfile.mkdtemp()) / "tumble.npz"
>>> np.savez(path, t=np.arange(3) / 10, mag_uT=np.eye(3), note=np.array("bench"))
>>> recording = open_npz(find(path))
>>> print(recording)
tumble.npz: columns mag_uT.x, mag_uT.y, mag_uT.z in uT, time in t; NumPy
>>> next(recording.blocks()).field[2]
array([0., 0., 1.])

Of an archive of phyphox, Sensor Logger or AndroSensor the member with the magnetometer is read; of several the
uncalibrated one: what the phone calls calibrated has had hard iron removed by its own rules, which change while it
records.

>>> import zipfile
>>> path = path.with_name("walk.zip")
>>> with zipfile.ZipFile(path, "w") as archive:
...     archive.writestr("Magnetometer.csv", "time,seconds_elapsed,z,y,x\n1,0.1,3,2,1\n")
...     archive.writestr("MagnetometerUncalibrated.csv", "time,seconds_elapsed,z,y,x\n1,0.1,30,20,10\n")
>>> print(open_zip(find(path)))
walk.zip/MagnetometerUncalibrated.csv: columns x, y, z in uT, time in seconds_elapsed; comma-separated
"""

from __future__ import annotations

import math
import warnings
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.files import metered
from flinders.errors import NoMagnetometer, UnreadableInput, UsageError
from flinders.foreign_errors import reading
from flinders.readers._reader import Reader
from flinders.readers._source import MOST_MEMBER, spooled
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers._tokenizer import shown
from flinders.readers.text import open_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.readers._source import File
    from flinders.readers.text import TextRecording

TEXT: Final = (".csv", ".txt", ".tsv", ".dat", ".log", ".json", ".jsonl")
RANKED: Final = (
    ("mag", "uncal"), ("mag", "raw"), ("magnet",), ("mag",), ("compass",), ("raw data",), ("data",),
)  # fmt: skip
"""Words in the name of a member, the best first."""
ASIDE: Final = ("meta", "metadata", "annotation", "__macosx", "device", "readme")
"""Words in the path of what is no recording."""
SHEETS: Final = {"[Content_Types].xml": "an Office document", "mimetype": "an OpenDocument file"}
ZIP: Final = b"PK\x03\x04"
MOST_MEMBERS: Final = 10_000
CHUNK: Final = 1 << 18


def members(file: File) -> list[zipfile.ZipInfo]:
    """List the files in an archive; a broken one, or one of more than `MOST_MEMBERS`, raises `UnreadableInput`."""
    with reading(file.name, "a ZIP archive"), zipfile.ZipFile(file.path) as archive:
        listed = [member for member in archive.infolist() if not member.is_dir()]
    if len(listed) > MOST_MEMBERS:
        raise UnreadableInput(f"{file.name} has {len(listed):,} members: unpack it and give the recording inside")
    return listed


def member_chunks(file: File, member: zipfile.ZipInfo, *, ratio: bool = True) -> Iterator[bytes]:
    """Unpack a member, a piece at a time; `ratio` as `metered` has it.

    One that is locked, broken, or unpacks to too much raises `UnreadableInput`.
    """
    if member.flag_bits & 1:
        raise UnreadableInput(f"{member.filename} in {file.name} is locked with a password: unpack it first")
    name = f"{member.filename} in {file.name}"
    with reading(file.name, "a ZIP archive"), zipfile.ZipFile(file.path) as archive, archive.open(member) as stream:
        chunks = iter(partial(stream.read, CHUNK), b"")
        yield from metered(name, chunks, lambda: member.compress_size, most=MOST_MEMBER, ratio=ratio)


def open_zip(file: File, *, topic: str | None = None, **options: Any) -> TextRecording:
    """Open the member of an archive that holds the magnetometer.

    `topic`: the member's name, or a part of it that no other has; by default the one that a phone logger would have
    written the raw magnetometer to; `**options`: as `flinders.readers.text.open_text`. Raises `NoMagnetometer` or
    `UsageError` where it is not clear which member it is, or there is none of that name; `UnreadableInput` for a
    spreadsheet, an archive that is broken or locked, and one that unpacks to too much.
    """
    there = members(file)
    for name, kind in SHEETS.items():
        if any(member.filename == name for member in there):
            raise UnreadableInput(f"{file.name} is {kind}: export the sheet as CSV")
    member = _asked(file.name, there, topic) if topic is not None else _likely(file.name, there)
    unpacked = spooled(f"{file.name}/{shown(member.filename)}", member_chunks(file, member))
    return open_text(unpacked, **options)


def _asked(name: str, there: list[zipfile.ZipInfo], topic: str) -> zipfile.ZipInfo:
    exact = [member for member in there if member.filename.casefold() == topic.strip().casefold()]
    named = exact or [member for member in there if topic.strip().casefold() in member.filename.casefold()]
    if len(named) != 1:
        how = "several members" if named else "no member"
        raise UsageError(f"{name} has {how} called {topic!r}: there are {_listed(named or there)}")
    return named[0]


def _likely(name: str, there: list[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    """Pick the member that is named like a magnetometer, or the only one that may be a recording."""
    texts = [member for member in there if _bare(member).endswith(TEXT) and not _is_aside(member.filename)]
    for words in RANKED:
        named = [member for member in texts if all(word in _bare(member) for word in words)]
        if named:
            return named[0]
    if len(texts) == 1:
        return texts[0]
    if not texts:
        raise NoMagnetometer(
            f"{name} has no text recording in it: it holds {_listed(there)}; unpack it, and give a recording from it"
        )
    raise NoMagnetometer(
        f"{name} has {len(texts)} recordings, and none is named like a magnetometer: {_listed(texts)}; say which",
        hint={"topic": None},
    )


def _bare(member: zipfile.ZipInfo) -> str:
    return PurePosixPath(member.filename).name.casefold()


def _is_aside(path: str) -> bool:
    parts = [PurePosixPath(part).stem for part in path.casefold().split("/")]
    return any(part in ASIDE or part.startswith(".") for part in parts)


def _listed(members: list[zipfile.ZipInfo]) -> str:
    names = [shown(member.filename) for member in members]
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") or "nothing"


NPY: Final = b"\x93NUMPY"


def _begins_with_array(head: bytes) -> bool:
    """Tell whether the first member of an archive with these first bytes is a NumPy array."""
    return head[30 : 30 + int.from_bytes(head[26:28], "little")].endswith(b".npy")


def open_npy(file: File, **options: Any) -> TableRecording:
    """Open one array: (N, 3), (N, 4) with the time first, or a structured one with named columns.

    Options are those of `open_table`. Python objects, or a broken file, raise `UnreadableInput`; columns that are not
    clear `NoMagnetometer`.
    """
    array, behind = _mapped(file, file.name)
    if array is None:
        raise UnreadableInput(
            f"{file.name} holds Python objects, which are not read from files of others: save an array of numbers"
        )
    recording = open_table(file, Table.of_arrays(file.name, "NumPy", {"": array}), **options)
    if behind:
        words = f"{behind:,} bytes behind the {len(array):,} readings of its header"
        recording.columns = replace(recording.columns, left_out=(*recording.columns.left_out, words))
    return recording


def open_npz(file: File, **options: Any) -> TableRecording:
    """Open an archive of named arrays; parameters and errors as `open_npy`.

    Members are unpacked to a temporary folder, and mapped from there.
    """
    arrays: dict[str, NDArray[Any]] = {}
    unpacked_files = []  # the temporary files go when these do
    for member in members(file):
        if member.filename.endswith(".npy"):
            unpacked = spooled(file.name, member_chunks(file, member, ratio=False))
            unpacked_files.append(unpacked)
            array, _ = _mapped(unpacked, f"{member.filename} in {file.name}")
            if array is not None:
                arrays[member.filename.removesuffix(".npy")] = array
    unnamed = len(arrays) == 1 and next(iter(arrays)) == "arr_0"
    table = Table.of_arrays(file.name, "NumPy", {"": arrays["arr_0"]} if unnamed else arrays)
    recording = open_table(file, table, **options)
    recording.temporary_files = tuple(unpacked_files)
    return recording


def _mapped(file: File, name: str) -> tuple[NDArray[Any] | None, int]:
    """Map an array into memory, once its header is known to tell the truth about its size.

    Returns
    -------
    array or None
        None for one of Python objects, which could be made to run anything.
    int
        Bytes behind it.
    """
    with reading(name, "a NumPy array"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers that Python 2 wrote, which nobody can do anything about
        with file.path.open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = header(stream)
            bytes_there = file.size - stream.tell()
        if dtype.hasobject:
            return None, 0
        bytes_told = math.prod(shape) * dtype.itemsize
        if bytes_told > bytes_there:
            raise UnreadableInput(
                f"{name} is cut short: its header tells of {bytes_told:,} bytes and {bytes_there:,} are there; copy it "
                "again"
            )
        if not bytes_told:
            return np.zeros(shape, dtype), bytes_there
        mapped: NDArray[Any] = np.load(file.path, mmap_mode="r", allow_pickle=False)
        return mapped, bytes_there - bytes_told


READERS: Final = (
    Reader("npy", "NumPy array", (".npy",), "N × 3, N × 4 with the time first, or named fields", (NPY,), open=open_npy),
    Reader(
        "npz",
        "NumPy archive",
        (".npz",),
        "named arrays of one length, as columns",
        starts=(ZIP,),
        sniff=_begins_with_array,
        open=open_npz,
    ),
    Reader(
        "zip",
        "phone logger's archive",
        (".zip",),
        "the file of the uncalibrated magnetometer, of phyphox, Sensor Logger or AndroSensor",
        starts=(ZIP,),
        open=open_zip,
        takes_topic=True,
    ),
)
