r"""HDF5 files, also those of MATLAB (``.mat`` version 7.3): datasets are columns, groups are parts of their names.

An HDF5 file can refer to other files, and can store a terabyte of zeros in a kilobyte. Only data in the file itself are
read that are reached without soft links and have a plausible size; others are left out, and named with the reason.

>>> import tempfile
>>> from pathlib import Path
>>> import h5py
>>> import numpy as np
>>> from flinders.readers._source import find
>>> path = Path(tempfile.mkdtemp()) / "tumble.h5"
>>> with h5py.File(path, "w") as writing:
...     writing["imu0/t"] = np.arange(3) / 10
...     writing["imu0/mag"] = np.eye(3)
...     writing["imu0/mag"].attrs["units"] = "mG"
...     writing["gps/lat"] = np.zeros(2)
>>> recording = open_hdf5(find(path))
>>> print(recording)
tumble.h5: columns mag.x (mG), mag.y (mG), mag.z (mG) in mG, time in t; HDF5
>>> next(recording.blocks()).field[2]
array([0. , 0. , 0.1])
"""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.core.files import is_bomb, size_error
from flinders.core.samples import BLOCK_ROWS
from flinders.errors import NoMagnetometer, UnreadableInput
from flinders.foreign_errors import import_optional, parser_errors
from flinders.readers._instruments import names_magnetometer
from flinders.readers._reader import Reader
from flinders.readers._table import MAX_COLUMNS, Table, TableRecording, named_part, open_table
from flinders.readers._tokenizer import MAX_NAMES, shorten
from flinders.readers.matlab import unread_objects

if TYPE_CHECKING:
    import mmap
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.readers._columns import Columns
    from flinders.readers._source import File

HDF5: Final = b"\x89HDF\r\n\x1a\n"
MATLAB_7_3: Final = b"MATLAB 7.3 MAT-file"
"""First bytes of a MATLAB file, in a block of 512 bytes ahead of HDF5; other programs use blocks of 512·2ⁿ bytes."""
USER_BLOCKS: Final = b"|".join(b".{%d}" % size for size in (0, *(512 << power for power in range(7))))
STARTS: Final = re.compile(rb"(?s)\A(?:%b|(?:%b)%b)" % (re.escape(MATLAB_7_3), USER_BLOCKS, re.escape(HDF5)))

MAX_OBJECTS: Final = 10_000
"""Largest number of links in a file that is read."""
MAX_DEPTH: Final = 8
"""Largest depth of nested groups that are read."""
MAX_CHUNK_BYTES: Final = 32 << 20
"""Largest unpacked size of a chunk in bytes; a chunk is in memory as a whole even if only a part is read."""
MAX_REASONS: Final = 4
"""Largest number of left-out datasets that are named, each with the reason."""
SHUFFLE, FLETCHER, DEFLATE = 2, 3, 1
FILTERS: Final = frozenset((SHUFFLE, FLETCHER, DEFLATE))
"""Filters that are decoded. For others, HDF5 would load a plug-in by a number in the file, which is not trusted."""
MAX_DEFLATE_RATIO: Final = 1032
"""Largest compression ratio of deflate."""
MAX_UNCHECKED_BYTES: Final = 256 << 20
"""Largest size in bytes to which a chunk may unpack according to the file, without a check by unpacking it."""
MATLAB_CLASSES: Final = frozenset((
    "double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical",
))  # fmt: skip
"""Numeric classes of MATLAB variables; those of character codes are not among them."""
UNITS: Final = (b"units", b"unit", b"Units", b"Unit")
"""Names of attributes that state a unit."""
MAX_UNIT_LETTERS: Final = 64
MAX_TEXT_BYTES: Final = 1 << 20
"""Largest size in bytes of a text of variable length."""
HEAP: Final = b"GCOL\x01"
"""First bytes of a global heap, which contains texts of variable length."""


def open_hdf5(file: File, **options: Any) -> TableRecording:
    """Open the datasets of an HDF5 file; those with the magnetometer's length make up the table.

    Options are those of `open_table`. `MissingExtra` is raised without h5py. `UnreadableInput` is raised for a file
    that is broken, cut short, or has more than `MAX_OBJECTS` objects, and `NoMagnetometer` for unclear columns.
    """
    with file.path.open("rb") as stream:
        is_matlab = stream.read(len(MATLAB_7_3)) == MATLAB_7_3
    kind = "a MATLAB 7.3 file" if is_matlab else "an HDF5 file"
    h5py = import_optional("h5py", "hdf5", kind)
    with ExitStack() as closing:
        with parser_errors(file.name, kind):
            opened = closing.enter_context(h5py.File(file.path, "r", driver="sec2", locking=False))
            catalogue = _Catalogue(h5py, opened, file, is_matlab)
            catalogue.collect(opened.id, ())
        try:
            table, left_out = _table_of(catalogue, kind)
            recording = open_table(file, table, **options)
        except NoMagnetometer:
            if catalogue.objects:
                raise unread_objects(file.name, catalogue.objects) from None
            raise
        recording.columns = _add_left_out(recording.columns, left_out)
        closing.pop_all()  # keeps the file open as long as the recording exists
    return recording


class _Array(NamedTuple):
    """Numbers of a dataset or of one of its fields: (N,), (N, K) or (K, N) as stored."""

    path: bytes
    name: str
    fields: tuple[str, ...]
    length: int
    width: int
    axis: int  # axis of the dataset along which readings are stored


@dataclass(slots=True, eq=False)
class _Catalogue:
    """Arrays of an open file."""

    h5py: Any
    opened: Any  # open as long as the recording exists
    file: File
    is_matlab: bool  # axes of arrays are stored in reverse order
    arrays: list[_Array] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # datasets that are not read, each with the reason
    objects: list[tuple[str, str]] = field(default_factory=list)  # names and classes of MATLAB objects
    _addresses: set[int] = field(default_factory=set)
    _checked: set[bytes] = field(default_factory=set)
    _links: int = 0
    _has_sound_heaps: bool = False

    def collect(self, group: Any, path: tuple[bytes, ...]) -> None:  # noqa: ANN401
        """List the arrays of a group and of its subgroups, each object once; raises an error for too many objects."""
        self._links += group.get_num_objs()
        if self._links > MAX_OBJECTS:
            raise UnreadableInput(
                f"{self.file.name} contains more than {MAX_OBJECTS:,} objects: copy the group of the magnetometer to a "
                "file of its own, with h5copy"
            )
        for name in sorted(group):
            link = group.links.get_info(name)
            inside = (*path, name)
            if link.type == self.h5py.h5l.TYPE_EXTERNAL:
                self._leave_out(inside, "in another file")
            elif link.type == self.h5py.h5l.TYPE_HARD and link.u not in self._addresses:
                self._addresses.add(link.u)
                self._collect_object(group, name, inside)

    def _collect_object(self, group: Any, name: bytes, path: tuple[bytes, ...]) -> None:  # noqa: ANN401
        """List the object behind a hard link; groups that MATLAB uses internally are skipped."""
        if self.is_matlab and name.startswith(b"#"):
            return
        member = self.h5py.h5o.open(group, name)
        if isinstance(member, self.h5py.h5g.GroupID):
            if len(path) < MAX_DEPTH and not self.h5py.h5a.exists(member, b"MATLAB_sparse"):
                self.collect(member, path)
        elif isinstance(member, self.h5py.h5d.DatasetID):
            self._collect_dataset(member, path)

    def _collect_dataset(self, dataset: Any, path: tuple[bytes, ...]) -> None:  # noqa: ANN401
        """List the numbers of a dataset, unless they are in another file or unpack to an implausible size."""
        storage = dataset.get_create_plist()
        if storage.get_layout() == self.h5py.h5d.VIRTUAL or storage.get_external_count():
            self._leave_out(path, "in another file")
            return
        kind = dataset.get_type().get_class()
        h5t = self.h5py.h5t
        if self.is_matlab and self.h5py.h5a.exists(dataset, b"MATLAB_object_decode"):
            self.objects.append((shorten(_name_of(path)), shorten(self._text(dataset, b"MATLAB_class"))))
            return
        if kind not in {h5t.INTEGER, h5t.FLOAT, h5t.ENUM, h5t.COMPOUND} or not self._is_numbers_of_matlab(dataset):
            return
        try:
            dtype = dataset.dtype
        except (TypeError, ValueError):  # NumPy has no type for the number
            return
        arrays = list(self._arrays_of(dataset, dtype, path))
        if arrays and (reason := self._reason_against(dataset, storage, dtype)):
            self._leave_out(path, reason)
        else:
            self.arrays += arrays

    def _is_numbers_of_matlab(self, dataset: Any) -> bool:  # noqa: ANN401
        """Whether a dataset is a non-empty array of numbers for MATLAB too, and not text or cells."""
        if not self.is_matlab:
            return True
        return self._text(dataset, b"MATLAB_class") in MATLAB_CLASSES and not self.h5py.h5a.exists(
            dataset, b"MATLAB_empty"
        )

    def _reason_against(self, dataset: Any, storage: Any, dtype: np.dtype[Any]) -> str:  # noqa: ANN401
        """Reason why a dataset cannot be read in bounded memory; empty if it can."""
        numbers = [storage.get_filter(place)[0] for place in range(storage.get_nfilters())]
        if foreign := [number for number in numbers if number not in FILTERS]:
            return f"compressed with filter {foreign[0]}: write it with gzip"
        if len(set(numbers)) < len(numbers):
            return "compressed twice"
        is_chunked = storage.get_layout() == self.h5py.h5d.CHUNKED
        if is_chunked and math.prod(storage.get_chunk()) * dtype.itemsize > MAX_CHUNK_BYTES:
            return f"in chunks of more than {MAX_CHUNK_BYTES >> 20} MB: write smaller ones"
        stored = min(dataset.get_storage_size(), self.file.size)
        if is_bomb(math.prod(dataset.shape) * dtype.itemsize, stored):
            return f"stated as {math.prod(dataset.shape) * dtype.itemsize >> 20:,} MB in {stored:,} bytes"
        return ""

    def _arrays_of(self, dataset: Any, dtype: np.dtype[Any], path: tuple[bytes, ...]) -> Iterator[_Array]:  # noqa: ANN401
        """Yield the arrays of numbers in a dataset; none if it cannot be a list of readings."""
        shape = dataset.shape or ()
        if len(shape) not in {1, 2} or math.prod(shape) <= 1:
            return
        own, where = _name_of(path), b"/" + b"/".join(path)
        if not dtype.names:
            unit = self._unit(dataset)
            length, width, axis = _layout_of(shape, is_reversed=self.is_matlab)
            if dtype.kind in "iufb" and width <= MAX_COLUMNS:
                yield _Array(where, f"{own} ({unit})" if unit else own, (), length, width, axis)
        elif 1 in shape or len(shape) == 1:
            for fields, width in _numbers_in(dtype):
                yield _Array(where, ".".join((own, *fields)), fields, max(shape), width, int(np.argmax(shape)))

    def _unit(self, dataset: Any) -> str:  # noqa: ANN401
        """Unit in an attribute; empty without one, or if its text cannot be part of a column's name."""
        texts = (self._text(dataset, name).partition(" since ")[0].strip() for name in UNITS)
        return next((text for text in texts if re.fullmatch(r"[^()\[\]\s,]{1,24}", text) and text.isprintable()), "")

    def _text(self, dataset: Any, attribute: bytes) -> str:  # noqa: ANN401
        """Short text in an attribute; empty without one."""
        h5a = self.h5py.h5a
        if not h5a.exists(dataset, attribute):
            return ""
        opened = h5a.open(dataset, attribute)
        kind = opened.get_type()
        if kind.get_class() != self.h5py.h5t.STRING or opened.get_space().get_simple_extent_npoints() != 1:
            return ""
        if kind.is_variable_str():
            self._check_heaps()
        elif kind.get_size() > MAX_UNIT_LETTERS:
            return ""
        value = np.asarray(self.h5py.Dataset(dataset).attrs[attribute.decode()]).ravel()[0]
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
        return text.strip("\x00 ") if len(text) <= MAX_UNIT_LETTERS else ""

    def _check_heaps(self) -> None:
        """Check once whether texts of variable length can be read safely.

        On a broken heap HDF5 2.0 does not terminate. It also allocates the stated length of a text before it checks
        that length.
        """
        if self._has_sound_heaps:
            return
        with self.file.mapped_bytes() as content:
            is_sound = self.opened.id.get_create_plist().get_sizes() == (8, 8)
            is_sound &= all(_is_sound_heap(content, place) for place in _positions_of(HEAP, content))
            is_sound &= all(
                _length_of_text(content, place, len(name) + 1) <= MAX_TEXT_BYTES
                for name in (*UNITS, b"MATLAB_class")
                for place in _positions_of(name + b"\x00", content)
            )
            if not is_sound:
                raise UnreadableInput(f"{self.file.name} has a broken heap of texts: copy it again")
        self._has_sound_heaps = True

    def _leave_out(self, path: tuple[bytes, ...], reason: str) -> None:
        self.left_out.append(f"{shorten(_name_of(path))} ({reason})")

    def dataset(self, path: bytes) -> Any:  # noqa: ANN401
        """Open a dataset. When it is opened first, raise an error if a chunk unpacks to more than its stated size."""
        dataset = self.h5py.h5d.open(self.opened.id, path)
        if path not in self._checked and dataset.get_create_plist().get_layout() == self.h5py.h5d.CHUNKED:
            self._check_chunks(dataset, path)
        self._checked.add(path)
        return self.h5py.Dataset(dataset)

    def _check_chunks(self, dataset: Any, path: bytes) -> None:  # noqa: ANN401
        """Unpack each suspicious chunk, at most to its stated size."""
        storage = dataset.get_create_plist()
        unpacked = int(math.prod(storage.get_chunk()) * dataset.dtype.itemsize)
        numbers = [storage.get_filter(place)[0] for place in range(storage.get_nfilters())]
        large: list[Any] = []

        def note(chunk: Any) -> None:  # noqa: ANN401 - called for each chunk; any other result would end the iteration
            if chunk.size > 2 * unpacked + BLOCK_ROWS or (
                DEFLATE in numbers and chunk.size * MAX_DEFLATE_RATIO > MAX_UNCHECKED_BYTES
            ):
                large.append(chunk)

        dataset.chunk_iter(note)
        for chunk in large:
            is_deflated = DEFLATE in numbers and not chunk.filter_mask >> numbers.index(DEFLATE) & 1
            _, packed = dataset.read_direct_chunk(chunk.chunk_offset) if is_deflated else (0, b"")
            made = len(zlib.decompressobj().decompress(packed, unpacked + BLOCK_ROWS)) if is_deflated else chunk.size
            if made >= unpacked + BLOCK_ROWS:
                raise size_error(f"{shorten(path.decode('utf-8', 'replace'))} in {self.file.name}", made, chunk.size)


def _table_of(catalogue: _Catalogue, kind: str) -> tuple[Table, list[str]]:
    """Table of the columns of one length, and a list of the magnetometers and datasets that are left out."""
    arrays = catalogue.arrays
    if not arrays:
        reasons = f": {', '.join(catalogue.left_out[:MAX_NAMES])}" if catalogue.left_out else ""
        raise NoMagnetometer(
            f"{catalogue.file.name} contains no readable columns of numbers{reasons}; need a dataset of N "
            "readings by 3, or datasets of equal length by name"
        )
    length = _length_of(arrays)
    chosen = _without_common_group(_magnetometer_first([array for array in arrays if array.length == length]))
    columns = [(array, place) for array in chosen for place in range(array.width)][:MAX_COLUMNS]
    names = tuple(named_part(array.name, place, array.width) for array, place in columns)

    def rows(cells: Sequence[int]) -> Iterator[Floats]:
        wanted = [columns[cell] for cell in cells]
        with parser_errors(catalogue.file.name, kind):
            datasets = {array: catalogue.dataset(array.path) for array, _ in wanted}
            step = max(BLOCK_ROWS, *(one.chunks[array.axis] if one.chunks else 0 for array, one in datasets.items()))
            for start in range(0, length, step):
                span = slice(start, min(start + step, length))
                blocks = {array: _block(one, array, span) for array, one in datasets.items()}
                yield np.stack([blocks[array][:, place] for array, place in wanted], axis=1)

    others = [
        f"{shorten(array.name)} ({array.length:,} readings instead of {length:,}: give it alone)"
        for array in arrays
        if array.length != length and names_magnetometer(_names_of(array))
    ]
    title = "MATLAB 7.3" if catalogue.is_matlab else "HDF5"
    return Table(title, names, len(columns), length, rows), [*others, *catalogue.left_out]


def _block(dataset: Any, array: _Array, span: slice) -> Floats:  # noqa: ANN401
    """Read some rows of an array as (N, width) float."""
    selected = dataset.fields(array.fields[0]) if array.fields else dataset
    where = tuple(span if axis == array.axis else slice(None) for axis in range(len(dataset.shape)))
    block: NDArray[Any] = np.asarray(selected[where])
    for name in array.fields[1:]:
        block = block[name]
    if array.axis:
        block = np.moveaxis(block, array.axis, 0)
    return block.reshape(len(block), array.width).astype(float)


def _positions_of(start: bytes, content: mmap.mmap) -> Iterator[int]:
    """Yield the positions at which these bytes occur."""
    place = content.find(start)
    while place >= 0:
        yield place
        place = content.find(start, place + 1)


def _is_sound_heap(content: mmap.mmap, place: int) -> bool:
    """Whether the objects of a global heap follow each other without gaps, up to the end of the heap.

    Source: HDF5 File Format Specification 3.0, III.E: signature, version, size; objects of index, count, size, content,
    in multiples of 8 bytes; index 0 is the free space, whose size includes its own header.
    """
    end = place + int.from_bytes(content[place + 8 : place + 16], "little")
    place += 16
    if end > len(content) or end < place:
        return False
    while place + 16 <= end:
        size = int.from_bytes(content[place + 8 : place + 16], "little")
        is_free = content[place : place + 2] == b"\x00\x00"
        step = size if is_free else 16 + 8 * -(-size // 8)
        if step < 16:
            return False
        place += step
    return place <= end


def _length_of_text(content: mmap.mmap, place: int, size: int) -> int:
    """Length that an attribute states for its text, if the attribute's name of `size` bytes is at this place; else 0.

    Source: HDF5 File Format Specification 3.0, IV.A.2.m: version, flags, sizes of name, type and space, in version 3
    the encoding; then these three, in version 1 in multiples of 8 bytes; then the length and position of the text.
    """
    for header in (8, 9):
        start = max(place - header, 0)
        sizes = [int.from_bytes(content[start + at : start + at + 2], "little") for at in (2, 4, 6)]
        version = content[start]
        if sizes[0] == size and version in ({1, 2} if header == 8 else {3}):
            each = [8 * -(-one // 8) if version == 1 else one for one in sizes]
            at = place + sum(each)
            return int.from_bytes(content[at : at + 4], "little")
    return 0


def _layout_of(shape: tuple[int, ...], *, is_reversed: bool) -> tuple[int, int, int]:
    """Number of readings of an array, numbers per reading, and the stored axis of the readings.

    >>> _layout_of((3, 100), is_reversed=False), _layout_of((2, 3), is_reversed=True)
    ((100, 3, 1), (3, 2, 1))
    """
    if len(shape) == 1 or 1 in shape:
        return max(shape), 1, int(np.argmax(shape))
    rows, width = shape[::-1] if is_reversed else shape
    axis = 1 if is_reversed else 0
    if rows <= 4 < width:
        rows, width, axis = width, rows, 1 - axis  # one reading per column
    return rows, width, axis


def _numbers_in(dtype: np.dtype[Any], fields: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], int]]:
    """Yield the numeric fields of records, also nested ones, with the number of numbers in each."""
    for name in dtype.names or ():
        inner = dtype[name]
        base, shape = inner.subdtype or (inner, ())
        if inner.names:
            if not inner.hasobject and len(fields) < MAX_DEPTH:
                yield from _numbers_in(inner, (*fields, name))
        elif base.kind in "iufb" and len(shape) <= 1 and math.prod(shape) <= MAX_COLUMNS:
            yield (*fields, name), math.prod(shape)


def _length_of(arrays: Sequence[_Array]) -> int:
    """Number of rows of the table: the most common length of columns, if possible one with a magnetometer."""
    columns: Counter[int] = Counter()
    for array in arrays:
        columns[array.length] += array.width
    names: dict[int, list[str]] = {}
    for array in arrays:
        names.setdefault(array.length, []).extend(_names_of(array))
    named = [length for length in columns if names_magnetometer(names[length])]
    return max(named or columns, key=lambda length: columns[length])


def _magnetometer_first(arrays: Sequence[_Array]) -> list[_Array]:
    """Arrays with the group of the first magnetometer in front, so that the time of that group is read."""
    groups: dict[str, list[str]] = {}
    for array in arrays:
        groups.setdefault(_group_of(array), []).extend(_names_of(array))
    own = next((group for group, names in groups.items() if names_magnetometer(names)), "")
    return sorted(arrays, key=lambda array: _group_of(array) != own)


def _group_of(array: _Array) -> str:
    return array.name.partition(" (")[0].rpartition(".")[0]


def _names_of(array: _Array) -> list[str]:
    return [named_part(array.name, place, array.width) for place in range(array.width)]


def _without_common_group(arrays: list[_Array]) -> list[_Array]:
    """Arrays without the name of a group that contains all of them."""
    while arrays and all("." in array.name.partition(" (")[0] for array in arrays):
        heads = {array.name.partition(".")[0] for array in arrays}
        if len(heads) > 1:
            break
        arrays = [array._replace(name=array.name.partition(".")[2]) for array in arrays]
    return arrays


def _add_left_out(columns: Columns, reasons: Sequence[str]) -> Columns:
    """Columns with the names of left-out datasets, also for each of several magnetometers."""
    more = [f"{len(reasons) - MAX_REASONS} more"] * (len(reasons) > MAX_REASONS)
    each = tuple(_add_left_out(own, reasons) for own in columns.magnetometers)
    return replace(columns, left_out=(*columns.left_out, *reasons[:MAX_REASONS], *more), magnetometers=each)


def _name_of(path: Sequence[bytes]) -> str:
    return ".".join(part.decode("utf-8", "replace") for part in path)


READERS: Final = (
    Reader(
        "hdf5",
        "HDF5, MATLAB 7.3",
        (".h5", ".hdf5", ".mat"),
        "datasets as columns, groups as parts of their names",
        pattern=STARTS,
        open=open_hdf5,
        extra="hdf5",
    ),
)
