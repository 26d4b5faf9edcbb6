r"""JSON, as one record per line with other lines between, or as a document: a list of records or a table.

A record is an object or a list of numbers. `arrange_records` finds the records of a table.

>>> dialect = recognise(["ready", '{"t": 0.1, "mag": {"x": 21.70, "y": 0.4, "z": -58.6}}'])
>>> dialect.names, dialect.row('{"mag": {"x": 1, "y": 2, "z": 3}, "t": 0.20}')
(('t', 'mag.x', 'mag.y', 'mag.z'), ['0.20', '1', '2', '3'])
>>> lines = '{"t": 1, "mag": [2, 3, 4]}\n{"t": 2, "mag": [5, 6, 7]}'
>>> is_document("[[1, 2, 3],"), is_document(lines), is_document("[1, 2, 3] uT")
(True, False, False)
"""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

from flinders.errors import UnreadableInput
from flinders.readers._cells import parse_number, quote_cell
from flinders.readers._instruments import names_magnetometer
from flinders.readers._source import unpacked_chunks
from flinders.readers._tokenizer import list_columns, shorten
from flinders.readers.dialects import Dialect
from flinders.readers.dialects.json_arrangements import arrange_records, split_records

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.readers._source import Source

_load = partial(json.loads, parse_float=str, parse_int=str)  # keeps numbers as they are written
MIN_NUMBERS: Final = 3  # smallest count of numbers in a record with a reading
MAX_DOCUMENT_BYTES: Final = 256 << 20  # largest document in bytes; JSON lines may be of any length
# Start of JSON with readings; ``[INFO] …`` starts a line of a log instead.
JSON_START: Final = re.compile(r"\[\s*(?:[\[{\]]|-?[\d.]+(?:[eE][-+]?\d+)?\s*,|$)|\{\s*(?:\"|\}|$)")
_NEXT: Final = re.compile(r"[\n\r](?=[\[{])")  # position before a document that follows another one
EXAMINED_LINES: Final = 100  # lines that are examined for the number of readings per record
MARK: Final = "flinders"  # key that all files written by Flinders have


@dataclass(slots=True)
class JsonLines(Dialect):
    """Records with the same keys; records that are lists have no keys."""

    def row(self, line: str) -> list[str] | None:
        """Values of a line's record, in the order of the columns, with numbers as they are written."""
        record = _record(line)
        if isinstance(record, dict) and self.names:
            leaves = flatten(record)
            values = [leaves.get(name) for name in self.names] if leaves.keys() & set(self.names) else []
        else:
            values = record if isinstance(record, list) and not self.names else []
        return ["" if value is None else quote_cell(str(value)) for value in values] or None


def recognise(lines: list[str]) -> JsonLines | None:
    """Find records with three numbers; if their keys differ, those of a magnetometer, then the most frequent."""
    records = [record for record in map(_record, lines) if record is not None and _numbers(record) >= MIN_NUMBERS]
    keys = Counter(tuple(flatten(record)) if isinstance(record, dict) else () for record in records)
    if not keys:
        return None
    return JsonLines("JSON", max(keys, key=lambda names: (names_magnetometer(names), keys[names])))


def flatten(record: dict[str, object]) -> dict[str, object]:
    """Flatten objects and lists, with dots in the names: ``mag.x``, ``mag.y.0``."""
    leaves: dict[str, object] = {}
    for key, value in record.items():
        inside = {str(place): each for place, each in enumerate(value)} if isinstance(value, list) else value
        if isinstance(inside, dict):
            leaves |= {f"{key}.{inner}": leaf for inner, leaf in flatten(inside).items()}
        else:
            leaves[key] = value
    return leaves


def is_document(text: str) -> bool:
    """Whether a text starts a JSON document, and not JSON lines, or lines such as ``[1, 2, 3] uT``."""
    first, _, more = text.lstrip().partition("\n")
    if not JSON_START.match(first):
        return False
    record = _record(first)
    if isinstance(record, dict):
        is_alone = not more.strip()
        has_list = any(isinstance(value, list) for value in record.values())
        return MARK in record or (is_alone and (has_list or arrange_records(record) is not None))
    is_closed = sum(map(first.count, "[{")) == sum(map(first.count, "]}"))
    return record in (None, []) and not (is_closed and _load_json(first) is None)


def has_batches(text: str) -> bool:
    """Whether JSON lines contain several readings of one magnetometer in a record."""
    records = [record for record in map(_record, text.splitlines()[:EXAMINED_LINES]) if isinstance(record, dict)]
    return split_records(records) is not records


def own_kind(text: str) -> str:
    """Kind of a file written by Flinders, such as ``truth``; empty for any other text.

    >>> own_kind('{"flinders": "truth", "schema": 1}'), own_kind('{"mx": [1, 2]}'), own_kind("mx,my,mz")
    ('truth', '', '')
    """
    document = _load_json(text) if MARK in text and text.lstrip().startswith("{") else None
    return str(document[MARK]) if isinstance(document, dict) and MARK in document else ""


def _record(line: str) -> dict[str, object] | list[object] | None:
    """Record of a line, an object or a list of plain values, with numbers as they are written; None for others."""
    record = _load_json(line) if line.lstrip().startswith(("{", "[")) else None
    is_plain = isinstance(record, list) and not any(isinstance(value, (list, dict)) for value in record)
    return record if is_plain or isinstance(record, dict) else None  # type: ignore[return-value]


def _load_json(text: str) -> object:
    """Value of a JSON text, with numbers as they are written; None for invalid JSON."""
    try:
        return _load(text)
    except (ValueError, RecursionError):
        return None


def _numbers(record: dict[str, object] | list[object]) -> int:
    """Number of numbers in a record."""
    values = flatten(record).values() if isinstance(record, dict) else record
    return sum(isinstance(value, str) and bool(value) and parse_number(value, ".") is not None for value in values)


def records_as_lines(source: Source, encoding: str) -> Iterator[bytes]:
    """Yield the records of a document as JSON lines."""
    content = bytearray()
    for chunk in unpacked_chunks(source):
        content += chunk
        if len(content) > MAX_DOCUMENT_BYTES:
            raise UnreadableInput(
                f"{source.name} is one JSON document of more than {MAX_DOCUMENT_BYTES >> 20} MB: "
                "write one record a line (JSON lines) or CSV"
            )
    text = content.decode(encoding, "replace").removeprefix("\ufeff")
    document, lines = _documents(source.name, text)
    records = (
        document if isinstance(document, list) else arrange_records(document) if isinstance(document, dict) else None
    )
    if isinstance(document, dict) and MARK in document:
        kind = shorten(str(document[MARK]))
        kind = f"an {kind}" if kind[:1] in tuple("aeiou") else f"a {kind}"
        raise UnreadableInput(f"{source.name} is {kind} file of Flinders, not a recording: give the recording")
    if not records:
        kind = "an empty list" if document == [] else f"one {'object' if isinstance(document, dict) else 'value'}"
        keys = f" ({list_columns(list(document))})" if isinstance(document, dict) and document else ""
        raise UnreadableInput(
            f"{source.name} is JSON with {kind}{keys}: need a list of [x, y, z] or of objects, or lists of one "
            "length by key"
        )
    for record in split_records(records):
        yield f"{json.dumps(record)}\n".encode()
    for line in lines:
        yield f"{line}\n".encode()


def _documents(name: str, text: str) -> tuple[object, list[str]]:
    """Value of a document, or list of the values of several documents; invalid parts between them as lines."""
    try:
        return _load(text), []
    except (ValueError, RecursionError) as error:
        parts = [part for part in _NEXT.split(text) if part.strip()]
        loaded = [(part, _load_json(part)) for part in parts]
        found = [record for _, record in loaded if record is not None]
        if len(found) < 2:
            raise UnreadableInput(
                f"{name} starts like JSON but is invalid ({error}): need a list of [x, y, z] or of objects"
            ) from None
        return found, [" ".join(part.split()) for part, record in loaded if record is None]
