r"""MATLAB's ``.mat`` of versions 5 to 7: variables, and fields of structures, as columns.

Arrays of numbers and structures with one element are read; everything else is skipped. Objects, such as a timeseries,
have an undocumented format; they are named if the file contains nothing else. The file is not trusted: a length beyond
the end of its array, or a shape that does not fit its numbers, is an error.

Source: MathWorks, *MAT-File Format*, level 5. After a header of 128 bytes there are elements with type, length and
content, padded to multiples of 8 bytes. An array is an element that consists of elements: flags, shape, name, and
numbers or the fields of a structure.

>>> import tempfile
>>> from pathlib import Path
>>> from scipy.io import savemat
>>> from flinders.readers._source import find
>>> path = Path(tempfile.mkdtemp()) / "tumble.mat"
>>> savemat(path, {"log": {"t": np.arange(3) / 10, "mag_uT": np.eye(3)}, "operator": "bench"}, do_compression=True)
>>> recording = open_mat(find(path))
>>> print(recording)
tumble.mat: columns mag_uT.x, mag_uT.y, mag_uT.z in uT, time in t; MATLAB
>>> next(recording.blocks()).field[2]
array([0., 0., 1.])
"""

from __future__ import annotations

import struct
import zlib
from itertools import islice
from typing import IO, TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.files import limit_size
from flinders.errors import NoMagnetometer
from flinders.readers._reader import Reader
from flinders.readers._source import CHUNK_BYTES, MAX_MEMBER_BYTES, spool
from flinders.readers._table import Table, TableRecording, open_table
from flinders.readers._tokenizer import MAX_NAMES, shorten

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.readers._source import File

MAT: Final = b"MATLAB 5.0 MAT-file"
HEADER: Final = 128
"""Bytes before the first element; the last two state the byte order."""
MATRIX, COMPRESSED = 14, 15
"""Types of elements: an array, and a compressed element."""
NUMBERS: Final = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
"""NumPy types of the elements that hold numbers."""
STRUCTURE: Final = 2
OBJECT, OPAQUE = 3, 17
"""Classes of MATLAB arrays: old objects, and objects of a ``classdef``, such as a timeseries or a timetable."""
NUMERIC: Final = range(6, 16)
"""Classes of numeric arrays, from double to uint64."""
COMPLEX: Final = 0x0800
MAX_DEPTH: Final = 3
"""Largest depth of nested structures that are read."""


def open_mat(file: File, **options: Any) -> TableRecording:
    """Open the variables of a MATLAB file and the fields of its structures; options are those of `open_table`.

    The variables are unpacked to a temporary file, which is mapped into memory. `UnreadableInput` is raised for a file
    that is broken or unpacks to more than `MAX_MEMBER_BYTES` bytes, and `NoMagnetometer` for unclear columns.
    """
    with file.path.open("rb") as stream:
        chunks = limit_size(file.name, inflate(stream), lambda: file.size, most=MAX_MEMBER_BYTES, ratio=False)
        unpacked = spool(file.name, chunks)
        order = _order(stream)
    content = memoryview(np.memmap(unpacked.path, np.uint8, "r"))  # type: ignore[arg-type]
    matrices = [element for kind, element in _elements(content, order) if kind == MATRIX]
    arrays = {
        name: array
        for element in matrices
        for name, array in _arrays(element, order)
        if name and not name.startswith("__")
    }
    try:
        recording = open_table(file, Table.of_arrays(file.name, "MATLAB", _without_common_structure(arrays)), **options)
    except NoMagnetometer:
        if objects := [each for element in matrices if (each := _object(element, order))]:
            raise unread_objects(file.name, objects) from None
        raise
    recording.temporary_files = (unpacked,)
    return recording


def _order(stream: IO[bytes]) -> str:
    """Byte order of numbers, which the end of the header states."""
    stream.seek(HEADER - 2)
    return ">" if stream.read(2) == b"MI" else "<"


def inflate(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield the bytes of all elements, unpacked."""
    order = _order(stream)
    while tag := stream.read(8):
        kind, length = struct.unpack(f"{order}II", tag)
        if kind != COMPRESSED:
            yield tag
        unpacker = zlib.decompressobj()
        while length:
            piece = stream.read(min(CHUNK_BYTES, length))
            if not piece:
                raise ValueError("an element goes on beyond the end of the file")
            length -= len(piece)
            yield from _inflate_piece(unpacker, piece) if kind == COMPRESSED else (piece,)
        if kind == COMPRESSED and not unpacker.eof:
            raise ValueError("a packed element has no end")


def _inflate_piece(unpacker: Any, packed: bytes) -> Iterator[bytes]:  # noqa: ANN401 - zlib does not name its type
    """Unpack a piece, `CHUNK_BYTES` bytes at a time."""
    while packed and not unpacker.eof:
        yield unpacker.decompress(packed, CHUNK_BYTES)
        packed = unpacker.unconsumed_tail


def _elements(content: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element; content of up to four bytes may be in the place of the length."""
    place = 0
    while place < len(content):
        kind, length = struct.unpack_from(f"{order}II", content, place)
        start, end = place + 8, place + 8 + length
        if kind >> 16:
            kind, length, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        if start + length > min(end, len(content)):
            raise ValueError("an element goes on beyond its end")
        yield kind, content[start : start + length]
        place = end if start == place + 4 else start + -(-length // 8) * 8


def _arrays(matrix: memoryview, order: str, name: str = "", depth: int = 0) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the numbers of an array, or of each field of a structure, with a name."""
    parts = _elements(matrix, order)
    (_, flags), shape, (_, own) = islice(parts, 3)
    (bits,) = struct.unpack_from(f"{order}I", flags)
    name, dimensions = name or bytes(own).decode("latin-1"), _numbers(*shape, order)
    if bits & 0xFF == STRUCTURE and depth < MAX_DEPTH and np.all(dimensions == 1):
        (_, width), (_, fields) = islice(parts, 2)
        (step,) = struct.unpack_from(f"{order}I", width)
        labels = [bytes(fields[at : at + step]).partition(b"\0")[0].decode("latin-1")
                  for at in range(0, len(fields), step)]  # fmt: skip
        for label, (_, inner) in zip(labels, parts, strict=True):
            yield from _arrays(inner, order, f"{name}.{label}", depth + 1)
    elif bits & 0xFF in NUMERIC and not bits & COMPLEX:
        yield name, np.squeeze(_numbers(*next(parts), order).reshape(dimensions, order="F"))


def _object(matrix: memoryview, order: str) -> tuple[str, str] | None:
    """Name and class of an object; None for any other array."""
    (_, flags), *parts = islice(_elements(matrix, order), 4)
    kind = struct.unpack_from(f"{order}I", flags)[0] & 0xFF
    if kind not in (OBJECT, OPAQUE) or len(parts) < len(["name,", "system,", "class"]):
        return None
    name, own = (parts[0], parts[2]) if kind == OPAQUE else (parts[1], parts[2])
    called, of_class = (bytes(content).decode("latin-1") for _, content in (name, own))
    return (shorten(called), shorten(of_class)) if called else None


def unread_objects(source: str, objects: Sequence[tuple[str, str]]) -> NoMagnetometer:
    """Error for a file that contains MATLAB objects instead of numbers, with the commands that convert them.

    >>> print(unread_objects("walk.mat", [("mag", "timeseries")]))
    walk.mat holds its readings as objects of MATLAB (mag: timeseries), which only MATLAB reads: save numbers, with
        t = mag.Time; xyz = mag.Data; save('numbers.mat', 't', 'xyz')
    """
    first, of_class = objects[0]
    parts = f"t = {first}.Time; xyz = {first}.Data"
    if of_class in ("timetable", "table"):
        parts = f"t = seconds({first}.Time - {first}.Time(1)); xyz = {first}.Variables"
    listed = ", ".join(f"{name}: {kind}" for name, kind in objects[:MAX_NAMES])
    return NoMagnetometer(
        f"{source} holds its readings as objects of MATLAB ({listed}), which only MATLAB reads: save numbers, with "
        f"{parts}; save('numbers.mat', 't', 'xyz')"
    )


def _numbers(kind: int, content: memoryview, order: str) -> NDArray[Any]:
    """The numbers of an element."""
    return np.frombuffer(content, np.dtype(order + NUMBERS[kind]))


def _without_common_structure(arrays: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    """Arrays without the name of a structure that contains all of them."""
    heads = {name.partition(".")[0] for name in arrays}
    if len(heads) == 1 and all("." in name for name in arrays):
        return {name.partition(".")[2]: array for name, array in arrays.items()}
    return arrays


READERS: Final = (
    Reader("mat", "MATLAB 5 to 7", (".mat",), "variables and fields of structures, as columns", (MAT,), open=open_mat),
)
