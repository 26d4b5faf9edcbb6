r"""Arrays on the disk: NumPy's ``.npy`` and ``.npz``, MATLAB's ``.mat`` up to version 7.

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
import os
import warnings
import zlib
from typing import TYPE_CHECKING, Any, BinaryIO, Final, Literal

import numpy as np

from flinders.errors import UnreadableInput, needs, reading
from flinders.readers._source import Reader, spooled
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers.zipped import ZIP, member_chunks, members

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from flinders.readers._source import File

NPY: Final = b"\x93NUMPY"
MAT: Final = b"MATLAB 5.0 MAT-file"
MOST_BYTES: Final = 1 << 30
"""Bytes of a MATLAB file, unpacked, that are held in memory: SciPy cannot read a part of one."""
MOST_NESTED: Final = 1 << 28
"""Bytes of one with structures, which may hold small cells: each becomes an object, of 2.5 times its bytes."""
COLUMNS: Final = frozenset({
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical", "struct",
})  # fmt: skip
"""Classes of the variables that are looked at."""
COMPRESSED: Final = 15
"""Type of an element of a MATLAB file that is packed, as its first number."""
CHUNK: Final = 1 << 18
DEEPEST: Final = 3
"""Structures within structures that are looked into."""


def _begins_with_array(head: bytes) -> bool:
    """Tell whether the first member of an archive with these first bytes is a NumPy array."""
    return head[30 : 30 + int.from_bytes(head[26:28], "little")].endswith(b".npy")


def open_npy(file: File, **options: Any) -> TableRecording:
    """Open one array: (N, 3), (N, 4) with the time first, or a structured one with named columns.

    Options are those of `open_table`. Python objects, or a broken file, raise `UnreadableInput`; columns that are not
    clear `NoMagnetometer`.
    """
    array = _mapped(file, file.name)
    if array is None:
        raise UnreadableInput(
            f"{file.name} holds Python objects, which are not read from files of others: save an array of numbers"
        )
    return open_table(file, Table.of_arrays(file.name, "NumPy", {"": array}), **options)


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
            array = _mapped(unpacked, f"{member.filename} in {file.name}")
            if array is not None:
                arrays[member.filename.removesuffix(".npy")] = array
    unnamed = len(arrays) == 1 and next(iter(arrays)) == "arr_0"
    table = Table.of_arrays(file.name, "NumPy", {"": arrays["arr_0"]} if unnamed else arrays)
    recording = open_table(file, table, **options)
    recording.temporary_files = tuple(unpacked_files)
    return recording


def open_mat(file: File, **options: Any) -> TableRecording:
    """Open the variables of a MATLAB file, and the fields of its structures; options and errors as `open_npy`.

    Without SciPy it raises `MissingExtra`; more than `MOST_BYTES`, or with structures `MOST_NESTED`, `UnreadableInput`.
    """
    io = needs("scipy.io", "scipy", "a MATLAB file")
    with reading(file.name, "a MATLAB file"):
        variables = [variable for variable in io.whosmat(file.path) if variable[2] in COLUMNS]
        is_nested = any(kind == "struct" for _, _, kind in variables)
        most = MOST_NESTED if is_nested else MOST_BYTES
        if _is_beyond(file, most):
            raise UnreadableInput(
                f"{file.name} holds more than {most >> 20} MB{', with structures in it' * is_nested}: save the "
                "magnetometer and its time alone, save('small.mat', 't', 'mag', '-v7')"
            )
        content = io.loadmat(
            file.path,
            squeeze_me=True,
            struct_as_record=True,
            verify_compressed_data_integrity=True,
            variable_names=[name for name, _, _ in variables],
        )
    return open_table(file, Table.of_arrays(file.name, "MATLAB", dict(_variables(content))), **options)


def _is_beyond(file: File, most: int) -> bool:
    """Tell whether the elements of a MATLAB file unpack to more than so many bytes, without keeping them.

    Source: MathWorks, *MAT-File Format*, level 5: after a header of 128 bytes, elements of type, length and content.
    """
    done = 0
    with file.path.open("rb") as stream:
        header = stream.read(128)
        order: Literal["little", "big"] = "little" if header[126:] == b"IM" else "big"
        while done <= most and len(tag := stream.read(8)) == 8:
            kind, length = int.from_bytes(tag[:4], order), int.from_bytes(tag[4:], order)
            if kind == COMPRESSED:
                done += sum(_inflated(stream, length, most - done))
            else:
                done += length
                stream.seek(length, os.SEEK_CUR)
    return done > most


def _inflated(stream: BinaryIO, length: int, most: int) -> Iterator[int]:
    """Unpack so many bytes, and yield how many each piece makes, until they are more than `most`."""
    unpacking, done = zlib.decompressobj(), 0
    while length > 0 and (packed := stream.read(min(CHUNK, length))):
        length -= len(packed)
        while packed:
            made = len(unpacking.decompress(packed, CHUNK))
            yield made
            done += made
            if done > most:
                return
            packed = unpacking.unconsumed_tail


def _variables(content: Mapping[str, Any], depth: int = 0) -> Mapping[str, NDArray[Any]]:
    """Bring the fields of structures to the top, with dots in their names."""
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        array = np.asarray(value)
        if name.startswith("__"):
            continue
        if array.dtype.names and array.ndim == 0 and depth < DEEPEST:
            inside = _variables({part: array[part].item() for part in array.dtype.names}, depth + 1)
            arrays.update({f"{name}.{part}": leaf for part, leaf in inside.items()})
        elif array.dtype.kind in "iufb":
            arrays[name] = array
    heads = {name.partition(".")[0] for name in arrays}
    if len(heads) == 1 and all("." in name for name in arrays):  # one structure, with everything in it
        return {name.partition(".")[2]: array for name, array in arrays.items()}
    return arrays


def _mapped(file: File, name: str) -> NDArray[Any] | None:
    """Map an array into memory, once its header is known to tell the truth about its size.

    Returns
    -------
    array or None
        None for one of Python objects, which could be made to run anything.
    """
    with reading(name, "a NumPy array"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers that Python 2 wrote, which nobody can do anything about
        with file.path.open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = header(stream)
            bytes_there = file.size - stream.tell()
        if dtype.hasobject:
            return None
        bytes_told = math.prod(shape) * dtype.itemsize
        if bytes_told > bytes_there:
            raise UnreadableInput(
                f"{name} is cut short: its header tells of {bytes_told:,} bytes and {bytes_there:,} are there; copy it "
                "again"
            )
        if not bytes_told:
            return np.zeros(shape, dtype)
        mapped: NDArray[Any] = np.load(file.path, mmap_mode="r", allow_pickle=False)
        return mapped


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
        "mat",
        "MATLAB 5 to 7",
        (".mat",),
        "variables and fields of structures, as columns",
        starts=(MAT,),
        open=open_mat,
        extra="scipy",
    ),
)
