r"""Arrays on disk in NumPy's ``.npy`` and ``.npz``, and ZIP archives of phone loggers.

Named arrays are columns: ``t``, ``mag`` with three columns, ``acc``. Arrays with an uncommon length are left out.
Nothing in a file is executed: an array of Python objects is refused.

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

In an archive of phyphox, Sensor Logger or AndroSensor the member with the magnetometer is read; if there are two, the
uncalibrated one. Phones remove hard iron from the calibrated one by undocumented rules that change during a recording.

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

from flinders.core.files import limit_size
from flinders.errors import NoMagnetometer, UnreadableInput, UsageError
from flinders.foreign_errors import parser_errors
from flinders.readers._reader import Reader
from flinders.readers._source import MAX_MEMBER_BYTES, spool
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers._tokenizer import shorten
from flinders.readers.text import open_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.readers._source import File
    from flinders.readers.text import TextRecording

TEXT_SUFFIXES: Final = (".csv", ".txt", ".tsv", ".dat", ".log", ".json", ".jsonl")
MEMBER_WORDS: Final = (
    ("mag", "uncal"), ("mag", "raw"), ("magnet",), ("mag",), ("compass",), ("raw data",), ("data",),
)  # fmt: skip
"""Words in the names of members with a magnetometer, the best first."""
OTHER_WORDS: Final = ("meta", "metadata", "annotation", "__macosx", "device", "readme")
"""Words in the paths of members that are not recordings."""
SHEETS: Final = {"[Content_Types].xml": "an Office document", "mimetype": "an OpenDocument file"}
ZIP: Final = b"PK\x03\x04"
MAX_MEMBERS: Final = 10_000
CHUNK_BYTES: Final = 1 << 18


def members(file: File) -> list[zipfile.ZipInfo]:
    """List the files of an archive; `UnreadableInput` if it is broken or has more than `MAX_MEMBERS`."""
    with parser_errors(file.name, "a ZIP archive"), zipfile.ZipFile(file.path) as archive:
        listed = [member for member in archive.infolist() if not member.is_dir()]
    if len(listed) > MAX_MEMBERS:
        raise UnreadableInput(f"{file.name} has {len(listed):,} members: unpack it and give the recording inside")
    return listed


def member_chunks(file: File, member: zipfile.ZipInfo, *, ratio: bool = True) -> Iterator[bytes]:
    """Unpack a member piece by piece; `ratio` is that of `limit_size`.

    Raises `UnreadableInput` for a member that is encrypted, broken, or unpacks to too much.
    """
    if member.flag_bits & 1:
        raise UnreadableInput(f"{member.filename} in {file.name} is protected by a password: unpack it first")
    name = f"{member.filename} in {file.name}"
    with (
        parser_errors(file.name, "a ZIP archive"),
        zipfile.ZipFile(file.path) as archive,
        archive.open(member) as stream,
    ):
        chunks = iter(partial(stream.read, CHUNK_BYTES), b"")
        yield from limit_size(name, chunks, lambda: member.compress_size, most=MAX_MEMBER_BYTES, ratio=ratio)


def open_zip(file: File, *, topic: str | None = None, **options: Any) -> TextRecording:
    """Open the member of an archive that contains the magnetometer.

    `topic` is the member's name, or a part of it that is unique; the default is the member to which phone loggers write
    the raw magnetometer. `**options` are those of `flinders.readers.text.open_text`. `NoMagnetometer` is raised if the
    member is not clear, `UsageError` if none has that name. `UnreadableInput` is raised for a spreadsheet and for an
    archive that is broken, encrypted or unpacks to too much.
    """
    there = members(file)
    for name, kind in SHEETS.items():
        if any(member.filename == name for member in there):
            raise UnreadableInput(f"{file.name} is {kind}: export the sheet as CSV")
    member = _find_member(file.name, there, topic) if topic is not None else _likely_member(file.name, there)
    unpacked = spool(f"{file.name}/{shorten(member.filename)}", member_chunks(file, member))
    return open_text(unpacked, **options)


def _find_member(name: str, there: list[zipfile.ZipInfo], topic: str) -> zipfile.ZipInfo:
    exact = [member for member in there if member.filename.casefold() == topic.strip().casefold()]
    named = exact or [member for member in there if topic.strip().casefold() in member.filename.casefold()]
    if len(named) != 1:
        how = "several members" if named else "no member"
        raise UsageError(f"{name} has {how} called {topic!r}: it contains {_list_members(named or there)}")
    return named[0]


def _likely_member(name: str, there: list[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    """Member with a magnetometer's name, or else the only one that may be a recording."""
    texts = [
        member
        for member in there
        if _file_name(member).endswith(TEXT_SUFFIXES) and not _is_no_recording(member.filename)
    ]
    for words in MEMBER_WORDS:
        named = [member for member in texts if all(word in _file_name(member) for word in words)]
        if named:
            return named[0]
    if len(texts) == 1:
        return texts[0]
    if not texts:
        raise NoMagnetometer(
            f"{name} contains no text recording: it has {_list_members(there)}; unpack it, and give a recording from it"
        )
    raise NoMagnetometer(
        f"{name} contains {len(texts)} recordings, none named like a magnetometer: {_list_members(texts)}; say which",
        hint={"topic": None},
    )


def _file_name(member: zipfile.ZipInfo) -> str:
    return PurePosixPath(member.filename).name.casefold()


def _is_no_recording(path: str) -> bool:
    parts = [PurePosixPath(part).stem for part in path.casefold().split("/")]
    return any(part in OTHER_WORDS or part.startswith(".") for part in parts)


def _list_members(members: list[zipfile.ZipInfo]) -> str:
    names = [shorten(member.filename) for member in members]
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") or "nothing"


NPY: Final = b"\x93NUMPY"


def _begins_with_array(head: bytes) -> bool:
    """Whether an archive with these first bytes begins with a NumPy array."""
    return head[30 : 30 + int.from_bytes(head[26:28], "little")].endswith(b".npy")


def open_npy(file: File, **options: Any) -> TableRecording:
    """Open one array: (N, 3), (N, 4) with the time first, or a structured one with named columns.

    Options are those of `open_table`. `UnreadableInput` is raised for Python objects and broken files, `NoMagnetometer`
    for unclear columns.
    """
    array, behind = _map_array(file, file.name)
    if array is None:
        raise UnreadableInput(
            f"{file.name} contains Python objects, which could run code and are not read: save an array of numbers"
        )
    recording = open_table(file, Table.of_arrays(file.name, "NumPy", {"": array}), **options)
    if behind:
        words = f"{behind:,} bytes after the {len(array):,} readings stated in its header"
        recording.columns = replace(recording.columns, left_out=(*recording.columns.left_out, words))
    return recording


def open_npz(file: File, **options: Any) -> TableRecording:
    """Open an archive of named arrays; parameters and errors are those of `open_npy`.

    Members are unpacked to temporary files, which are mapped into memory.
    """
    arrays: dict[str, NDArray[Any]] = {}
    unpacked_files = []  # keeps the temporary files
    for member in members(file):
        if member.filename.endswith(".npy"):
            unpacked = spool(file.name, member_chunks(file, member, ratio=False))
            unpacked_files.append(unpacked)
            array, _ = _map_array(unpacked, f"{member.filename} in {file.name}")
            if array is not None:
                arrays[member.filename.removesuffix(".npy")] = array
    unnamed = len(arrays) == 1 and next(iter(arrays)) == "arr_0"
    table = Table.of_arrays(file.name, "NumPy", {"": arrays["arr_0"]} if unnamed else arrays)
    recording = open_table(file, table, **options)
    recording.temporary_files = tuple(unpacked_files)
    return recording


def _map_array(file: File, name: str) -> tuple[NDArray[Any] | None, int]:
    """Map an array into memory after checking the size in its header.

    Returns
    -------
    array or None
        None for an array of Python objects, which can execute code.
    int
        Number of bytes after the array.
    """
    with parser_errors(name, "a NumPy array"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about headers of Python 2, which a user cannot change
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
                f"{name} is cut short: its header states {bytes_told:,} bytes and {bytes_there:,} exist; copy it again"
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
