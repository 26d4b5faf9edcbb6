r"""Arrays on the disk: NumPy's ``.npy`` and ``.npz``.

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
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import UnreadableInput, reading
from flinders.readers._source import Reader, spooled
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers.zipped import ZIP, member_chunks, members

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.readers._source import File

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
)
