r"""Least and greatest value of a Parquet column in each row group, as its footer states them.

pyarrow ends the program on a footer whose sizes or statistics contradict its schema, so they are read here. What is
broken, or in a form that writers do not use, is not known.

>>> import tempfile
>>> import pyarrow
>>> from pyarrow import parquet
>>> path = tempfile.mkdtemp() + "/fleet.parquet"
>>> parquet.write_table(pyarrow.table({"unit": ["A17", "B02", "C05"]}), path, row_group_size=2)
>>> extents(parquet.ParquetFile(path).metadata, "unit")
[(b'A17', b'B02'), (b'C05', b'C05')]

Sources: Apache Parquet, ``parquet.thrift``, for the numbers of the fields; Apache Thrift, *Thrift Compact Protocol*.
"""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any, Final, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable

Extent: TypeAlias = tuple[bytes, bytes]
Fields: TypeAlias = dict[int, Any]
"""Values of a struct by the numbers of their fields."""

STATISTICS: Final = 12
"""Field of ``ColumnMetaData``; the others are of ``Statistics``."""
NULL_COUNT, MAX_VALUE, MIN_VALUE, IS_MAX_VALUE_EXACT, IS_MIN_VALUE_EXACT = 3, 5, 6, 7, 8
PATH: Final = 3
"""Field of ``ColumnMetaData``."""
PATH_OF_ONE: Final = b"\x19\x18"
"""Before the name of a column at the top: the next field is a list, of one text."""
LONGEST_VARINT: Final = 10


def extents(metadata: Any, column: str) -> list[Extent | None]:  # noqa: ANN401 - pyarrow ships no types
    """Least and greatest value of a column at the top in each row group, as bytes; None where they are not known."""
    unknown = [None] * metadata.num_row_groups
    footer = io.BytesIO()
    metadata.write_metadata_file(footer)
    name = column.encode()
    place = re.compile(re.escape(PATH_OF_ONE + _varint(len(name)) + name))
    content = footer.getvalue()
    try:
        ends = [_extent(_Compact(content, found.end()).fields(PATH)) for found in place.finditer(content)]
    except (LookupError, ValueError, RecursionError):
        return [*unknown]
    return ends if len(ends) == len(unknown) else [*unknown]


def _extent(chunk: Fields) -> Extent | None:
    """Least and greatest value of a chunk of a column without nulls."""
    stated = chunk.get(STATISTICS)
    if not isinstance(stated, dict) or stated.get(NULL_COUNT):
        return None
    least, greatest = stated.get(MIN_VALUE), stated.get(MAX_VALUE)
    is_exact = stated.get(IS_MIN_VALUE_EXACT, True) and stated.get(IS_MAX_VALUE_EXACT, True)
    return (least, greatest) if isinstance(least, bytes) and isinstance(greatest, bytes) and is_exact else None


def _varint(value: int) -> bytes:
    r"""A length as it is written.

    >>> _varint(4), _varint(300)
    (b'\x04', b'\xac\x02')
    """
    return bytes([value]) if value < 1 << 7 else bytes([value & 127 | 128]) + _varint(value >> 7)


class _Compact:
    """Values of Thrift's compact protocol, from a place on; LookupError or ValueError where there are none."""

    def __init__(self, content: bytes, at: int) -> None:
        self._content, self._at = content, at

    def fields(self, number: int = 0) -> Fields:
        """Rest of a struct, after the field with a number."""
        fields: Fields = {}
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            fields[number] = self._value(head & 15)
        return fields

    def _value(self, kind: int) -> Any:  # noqa: ANN401
        """A value of a field; that of a truth is its kind."""
        return kind == 1 if kind in (1, 2) else READ[kind](self)

    def _byte(self) -> int:
        self._at += 1
        return self._content[self._at - 1]

    def _bytes(self, count: int) -> bytes:
        self._at += count
        return self._content[self._at - count : self._at]

    def _length(self) -> int:
        """A number of seven bits a byte, the lowest first; of the last byte the eighth is 0."""
        value = 0
        for place in range(LONGEST_VARINT):
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
        read = READ[head & 15]
        return [read(self) for _ in range(self._length() if count == 15 else count)]

    def _double(self) -> bytes:
        return self._bytes(8)


READ: Final[dict[int, Callable[[_Compact], Any]]] = {
    **dict.fromkeys((1, 2, 3), _Compact._byte),
    **dict.fromkeys((4, 5, 6), _Compact._integer),
    7: _Compact._double,
    8: _Compact._text,
    **dict.fromkeys((9, 10), _Compact._list),
    12: _Compact.fields,
}
"""What reads a value of a kind; in a list a truth is a byte."""
