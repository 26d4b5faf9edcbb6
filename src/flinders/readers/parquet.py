r"""Parquet tables and Arrow files (IPC, Feather version 2), column by column and a row group at a time.

Columns are recognised by the same names as in text. A column ``mag`` of fixed lists of three is three columns. A text
column with the name of a time is read if its cells are ISO 8601 dates, ``2026-11-21T12:30:05.25Z``.

pyarrow terminates the program if sizes or statistics in a footer contradict its schema. `group_extents` therefore
parses by itself the minimum and maximum of a column in each row group. They are unknown if the footer is broken or has
a form that writers do not use.

>>> import tempfile
>>> import pyarrow
>>> from pyarrow import parquet
>>> path = tempfile.mkdtemp() + "/fleet.parquet"
>>> parquet.write_table(pyarrow.table({"unit": ["A17", "B02", "C05"]}), path, row_group_size=2)
>>> group_extents(parquet.ParquetFile(path).metadata, "unit")
[(b'A17', b'B02'), (b'C05', b'C05')]

Sources: Apache Parquet, ``parquet.thrift``, for the numbers of the fields; Apache Thrift, *Thrift Compact Protocol*.
"""

from __future__ import annotations

import io
import re
import struct
from datetime import date
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import numpy as np

from flinders.core.files import refuse_bomb
from flinders.core.samples import BLOCK_ROWS
from flinders.errors import UnreadableInput
from flinders.foreign_errors import import_optional, parser_errors
from flinders.readers._devices import may_distinguish_rows
from flinders.readers._names import TIME, meaning
from flinders.readers._reader import Reader
from flinders.readers._table import MAX_COLUMNS, Labels, Table, TableRecording, open_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.readers._source import File

PARQUET: Final = b"PAR1"
ARROW: Final = b"ARROW1\x00\x00"
TEXTS: Final = ("string", "large_string", "string_view")
FLOATS: Final = ("float", "double")
ISO: Final = (
    r"^\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])[T ]([01]\d|2[0-3]):[0-5]\d(:[0-5]\d(\.\d{1,9})?)?"
    r"(Z|[+-]([01]\d|2[0-3])(:?[0-5]\d)?)?$"
)
"""Pattern of texts that are read as dates."""
BYTES_OF_READING: Final = 24
MAX_UNPACKED_BYTES: Final = 128 << 20
"""Largest unpacked size in bytes of a row group's column, or of a record batch: either may have to be in memory."""


def open_parquet(file: File, **options: Any) -> TableRecording:
    """Open a Parquet table; options are those of `open_table`.

    `MissingExtra` is raised without pyarrow, `UnreadableInput` for a file that is broken, cut short or implausibly
    compressed, and `NoMagnetometer` for unclear columns.
    """
    parquet = import_optional("pyarrow.parquet", "parquet", "a Parquet table")

    def open_table_file() -> Any:  # noqa: ANN401 - pyarrow ships no types
        return parquet.ParquetFile(file.path, memory_map=True, page_checksum_verification=True)

    def batches(names: list[str]) -> Iterator[Any]:
        is_long = metadata.num_rows > BLOCK_ROWS  # threads slow a short table down by a quarter
        yield from open_table_file().iter_batches(BLOCK_ROWS, columns=names, use_threads=is_long)

    whole = open_table_file()
    metadata, schema = whole.metadata, whole.schema_arrow
    refuse_packed_groups(metadata, file.name, file.size)
    return open_table(file, table_of("Parquet", schema, metadata.num_rows, batches, file.name), **options)


def open_arrow(file: File, **options: Any) -> TableRecording:
    """Open an Arrow file, which may be Feather version 2; parameters and errors are those of `open_parquet`."""
    ipc, arrow = (import_optional(f"pyarrow{part}", "parquet", "an Arrow file") for part in (".ipc", ""))
    source = arrow.memory_map(str(file.path))
    length = sum(rows_of_batches(source, file.name, file.size))

    def batches(names: list[str]) -> Iterator[Any]:
        source.seek(len(ARROW))
        for batch in ipc.open_stream(source):
            chosen = batch.select(names)
            chosen.validate(full=True)
            yield from (chosen.slice(start, BLOCK_ROWS) for start in range(0, chosen.num_rows, BLOCK_ROWS))

    schema = ipc.open_file(source).schema  # raises an error for a file without an end
    return open_table(file, table_of("Arrow", schema, length, batches, file.name), **options)


def refuse_packed_groups(metadata: Any, name: str, size: int) -> None:  # noqa: ANN401 - pyarrow ships no types
    """Raise an error for a Parquet table if a row group, or the table as a whole, unpacks to too much.

    The sizes of single columns are not read: if they contradict the schema, pyarrow 26 terminates the program.
    """
    groups = [metadata.row_group(number) for number in range(metadata.num_row_groups)]
    for group in groups:
        _refuse_large(name, "row group with columns", group.total_byte_size // max(group.num_columns, 1))
    refuse_bomb(name, max(metadata.num_rows * BYTES_OF_READING, sum(group.total_byte_size for group in groups)), size)


def _refuse_large(name: str, what: str, unpacked: int) -> None:
    if unpacked > MAX_UNPACKED_BYTES:
        raise UnreadableInput(
            f"{name} has a {what} of {unpacked >> 20:,} MB, too large to unpack: write it in smaller ones"
        )


def rows_of_batches(source: Any, name: str, size: int) -> list[int]:  # noqa: ANN401 - pyarrow ships no types
    """Number of rows in each record batch of an Arrow file, from its messages; raises an error for too large batches.

    Source: Arrow's *Format*, ``Message.fbs``: a batch has its length, its nodes, its buffers and their compression; a
    compressed buffer starts with its unpacked length, or −1 if it is not compressed.
    """
    source.seek(len(ARROW))
    rows, total = [], 0
    for message in import_optional("pyarrow.ipc", "parquet", "an Arrow file").MessageReader.open_stream(source):
        if message.type not in ("record batch", "dictionary"):
            continue
        batch = _Flat(message.metadata.to_pybytes()).table(2)
        if message.type == "dictionary":
            batch = batch.table(1)
        unpacked = sum(batch.packed_lengths(message.body))
        total += unpacked
        _refuse_large(name, "record batch", unpacked)
        rows += [batch.number(0)] if message.type == "record batch" else []
    refuse_bomb(name, max(total, sum(rows) * BYTES_OF_READING), size)
    return rows


class _Flat:
    """A table in a flatbuffer. Fields are read by number; a missing field is 0."""

    def __init__(self, content: bytes, at: int | None = None) -> None:
        self._content = content
        self._at = self._read("<I", 0) if at is None else at

    def _read(self, kind: str, at: int) -> int:
        return int(struct.unpack_from(kind, self._content, at)[0])

    def _place(self, field: int) -> int:
        index = self._at - self._read("<i", self._at)
        slot = 4 + 2 * field
        offset = self._read("<H", index + slot) if slot < self._read("<H", index) else 0
        return self._at + offset if offset else 0

    def number(self, field: int) -> int:
        """A 64-bit integer field."""
        place = self._place(field)
        return self._read("<q", place) if place else 0

    def table(self, field: int) -> _Flat:
        """A nested table."""
        place = self._place(field)
        return _Flat(self._content, place + self._read("<I", place))

    def packed_lengths(self, body: Any) -> Iterator[int]:  # noqa: ANN401 - a buffer of pyarrow
        """Yield the unpacked size in bytes of each compressed buffer in a record batch."""
        place = self._place(2)
        start = place + self._read("<I", place)
        for number in range(self._read("<I", start) if self._place(3) else 0):
            offset, length = struct.unpack_from("<qq", self._content, start + 4 + 16 * number)
            if length:
                yield max(struct.unpack_from("<q", body, offset)[0], 0)


def table_of(
    kind: str,
    schema: Any,  # noqa: ANN401
    length: int,
    batches: Callable[[list[str]], Iterator[Any]],
    source: str,
) -> Table:
    """Table of the columns that hold numbers or times."""
    places = places_of(schema)
    width = len(places)
    labels = {
        place: Labels() for place, (column, _, name) in enumerate(places) if _is_of_words(schema.field(column), name)
    }
    places += [(name, None, name) for name in _words_in(schema) if name not in {known for known, _, _ in places}]
    labels |= {place: Labels() for place in range(width, len(places))}

    def rows(cells: Sequence[int]) -> Iterator[Floats]:
        wanted = [places[cell] for cell in cells]
        for batch in batches(sorted({column for column, _, _ in wanted})):
            with parser_errors(source, f"a table of {kind}"):
                columns = [
                    labels[cell].numbers(batch.column(column).to_pylist())
                    if cell in labels
                    else values_of(batch.column(column), part)
                    for cell, (column, part, _) in zip(cells, wanted, strict=True)
                ]
                block = np.stack(columns, axis=1, dtype=np.float64)
            if len(block):
                yield block

    names = tuple(name for _, _, name in places)
    words = dict(zip(names[width:], range(width, len(names)), strict=True))
    return Table(kind, names[:width], width, length, rows, labels, words)


def _words_in(schema: Any) -> list[str]:  # noqa: ANN401
    """Names of the columns of words; names that occur twice are left out."""
    of_words = (field for field in schema if str(field.type) in TEXTS or str(field.type).startswith("dictionary"))
    return [field.name for field in of_words if schema.get_field_index(field.name) >= 0]


def _is_of_words(field: Any, name: str) -> bool:  # noqa: ANN401
    """Whether a field holds words that may distinguish devices or sensors."""
    text = str(field.type)
    return (text in TEXTS or text.startswith("dictionary")) and may_distinguish_rows(name)


def places_of(schema: Any) -> list[tuple[str, int | None, str]]:  # noqa: ANN401
    """Columns of numbers or times: name of the field, place in its fixed list or None, and name of the column."""
    return [
        (field.name, part, name)
        for field in schema
        for part, name in _parts(field)
        if schema.get_field_index(field.name) >= 0  # duplicate names cannot be selected
    ][:MAX_COLUMNS]


def _parts(field: Any) -> list[tuple[int | None, str]]:  # noqa: ANN401
    """Columns of a field: one, or three for a fixed list of three, or none without numbers."""
    kind = field.type
    text = str(kind)
    if text.startswith("fixed_size_list<") and text.endswith("[3]"):
        return [(part, f"{field.name}.{axis}") for part, axis in enumerate("xyz")]
    numeric = text.startswith(("int", "uint", "float", "double", "halffloat", "bool", "timestamp", "decimal"))
    is_date = text in TEXTS and meaning(field.name).kind == TIME
    return [(None, field.name)] if numeric or is_date or _is_of_words(field, field.name) else []


def values_of(column: Any, part: int | None) -> NDArray[np.floating]:  # noqa: ANN401
    """Values of one column in its own precision, NaN for null; a time is in nanoseconds since 1970."""
    if part is not None:
        column = column.flatten().take(_indices_of_part(part, len(column)))
    if str(column.type) in TEXTS:
        column = _dates(column)
    if str(column.type).startswith("timestamp"):
        column = column.cast("timestamp[ns]").cast("int64")
    if column.null_count or str(column.type) not in FLOATS:
        column = column.cast("float64", safe=False).fill_null(np.nan)
    return cast("NDArray[np.floating]", np.from_dlpack(column))  # `to_numpy` would import pandas


def _dates(column: Any) -> Any:  # noqa: ANN401
    """UTC times from ISO 8601 texts; null for other texts. A text without a time zone is taken as UTC.

    >>> import pyarrow
    >>> texts = ["1970-01-01T00:00:01.5Z", "1970-01-01 01:00:02+01:00", "1970-01-01T00:00:03", "noon"]
    >>> _dates(pyarrow.array([*texts, "1970-02-30T00:00:00Z"])).cast("int64").to_pylist()
    [1500000000, 2000000000, 3000000000, None, None]
    """
    arrow, compute = (
        import_optional("pyarrow", "parquet", "a table"),
        import_optional("pyarrow.compute", "parquet", "a table"),
    )
    kind = arrow.timestamp("ns", "UTC")
    texts = compute.utf8_trim_whitespace(column.cast("string"))
    texts = compute.if_else(compute.match_substring_regex(texts, ISO), texts, None)
    zoned = compute.match_substring_regex(texts, r"(Z|[+-]\d{2}(:?\d{2})?)$")
    texts = compute.if_else(zoned, texts, compute.binary_join_element_wise(texts, "Z", ""))
    days = compute.utf8_slice_codeunits(texts, 0, 10)
    known = [day for day in days.unique().to_pylist() if day is not None and _is_day(day)]
    return compute.if_else(compute.is_in(days, arrow.array(known, days.type)), texts, None).cast(kind)


def _is_day(text: str) -> bool:
    """Whether a date exists and can be stored as nanoseconds since 1970.

    >>> _is_day("2028-02-29"), _is_day("1970-02-30"), _is_day("9999-01-01")
    (True, False, False)
    """
    try:
        return date(1678, 1, 1) <= date.fromisoformat(text) < date(2262, 1, 1)
    except ValueError:
        return False


def _indices_of_part(part: int, length: int) -> Any:  # noqa: ANN401
    arrow = import_optional("pyarrow", "parquet", "a table")
    return arrow.array(np.arange(part, 3 * length, 3))


# footers of Parquet ---------------------------------------------------------------------------------------------------

Extent: TypeAlias = tuple[bytes, bytes]
Fields: TypeAlias = dict[int, Any]
"""Values of a struct, by field number."""

STATISTICS: Final = 12
"""Number of a field in ``ColumnMetaData``; the next ones are of fields in ``Statistics``."""
NULL_COUNT, MAX_VALUE, MIN_VALUE, IS_MAX_VALUE_EXACT, IS_MIN_VALUE_EXACT = 3, 5, 6, 7, 8
PATH: Final = 3
"""Number of a field in ``ColumnMetaData``."""
PATH_OF_ONE: Final = b"\x19\x18"
"""Bytes before the name of a column at the top level: the next field is a list of one text."""
MAX_VARINT_BYTES: Final = 10


def group_extents(metadata: Any, column: str) -> list[Extent | None]:  # noqa: ANN401 - pyarrow ships no types
    """Minimum and maximum of a top-level column in each row group, as bytes; None if unknown."""
    unknown = [None] * metadata.num_row_groups
    footer = io.BytesIO()
    metadata.write_metadata_file(footer)
    name = column.encode()
    place = re.compile(re.escape(PATH_OF_ONE + _varint(len(name)) + name))
    content = footer.getvalue()
    try:
        ends = [_extent(_Compact(content, match.end()).fields(PATH)) for match in place.finditer(content)]
    except (LookupError, ValueError, RecursionError):
        return [*unknown]
    return ends if len(ends) == len(unknown) else [*unknown]


def _extent(chunk: Fields) -> Extent | None:
    """Minimum and maximum of a column chunk without nulls."""
    stated = chunk.get(STATISTICS)
    if not isinstance(stated, dict) or stated.get(NULL_COUNT):
        return None
    least, greatest = stated.get(MIN_VALUE), stated.get(MAX_VALUE)
    is_exact = stated.get(IS_MIN_VALUE_EXACT, True) and stated.get(IS_MAX_VALUE_EXACT, True)
    return (least, greatest) if isinstance(least, bytes) and isinstance(greatest, bytes) and is_exact else None


def _varint(value: int) -> bytes:
    r"""A length encoded as a varint.

    >>> _varint(4), _varint(300)
    (b'\x04', b'\xac\x02')
    """
    return bytes([value]) if value < 1 << 7 else bytes([value & 127 | 128]) + _varint(value >> 7)


class _Compact:
    """Reader of values in Thrift's compact protocol; `LookupError` or `ValueError` for invalid bytes."""

    def __init__(self, content: bytes, at: int) -> None:
        self._content, self._at = content, at

    def fields(self, number: int = 0) -> Fields:
        """The remaining fields of a struct, after the field with this number."""
        fields: Fields = {}
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            fields[number] = self._value(head & 15)
        return fields

    def _value(self, kind: int) -> Any:  # noqa: ANN401
        """Value of a field; for a boolean the kind itself is the value."""
        return kind == 1 if kind in (1, 2) else COMPACT_VALUES[kind](self)

    def _byte(self) -> int:
        self._at += 1
        return self._content[self._at - 1]

    def _bytes(self, count: int) -> bytes:
        self._at += count
        return self._content[self._at - count : self._at]

    def _length(self) -> int:
        """A varint: seven bits per byte, the lowest first; the eighth bit is 0 in the last byte."""
        value = 0
        for place in range(MAX_VARINT_BYTES):
            byte = self._byte()
            value |= (byte & 127) << 7 * place
            if byte < 1 << 7:
                return value
        raise ValueError("an endless number")

    def _integer(self) -> int:
        value = self._length()
        return value >> 1 ^ -(value & 1)

    def _text(self) -> bytes:
        return self._bytes(self._length())

    def _list(self) -> list[Any]:
        head = self._byte()
        count = head >> 4
        read = COMPACT_VALUES[head & 15]
        return [read(self) for _ in range(self._length() if count == 15 else count)]

    def _double(self) -> bytes:
        return self._bytes(8)


COMPACT_VALUES: Final[dict[int, Callable[[_Compact], Any]]] = {
    **dict.fromkeys((1, 2, 3), _Compact._byte),
    **dict.fromkeys((4, 5, 6), _Compact._integer),
    7: _Compact._double,
    8: _Compact._text,
    **dict.fromkeys((9, 10), _Compact._list),
    12: _Compact.fields,
}
"""Functions that read a value, by its kind; in a list a boolean is a byte."""

READERS: Final = (
    Reader(
        "parquet",
        "Parquet",
        (".parquet",),
        "columns of numbers and of times",
        starts=(PARQUET,),
        open=open_parquet,
        extra="parquet",
    ),
    Reader(
        "arrow",
        "Arrow, Feather 2",
        (".arrow", ".feather"),
        "columns of numbers and of times",
        starts=(ARROW,),
        open=open_arrow,
        extra="parquet",
    ),
)
