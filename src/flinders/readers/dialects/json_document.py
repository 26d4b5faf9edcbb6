r"""A JSON document with a list of records, turned into a table: ``[[1, 2, 3], …]``, ``[{"x": 1, "y": 2, "z": 3}, …]``.

>>> lines = '{"t": 1, "mag": [2, 3, 4]}\n{"t": 2, "mag": [5, 6, 7]}'
>>> is_document("[[1, 2, 3],"), is_document(lines), is_document("[1, 2, 3] uT")
(True, False, False)
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final

from flinders.core.samples import BLOCK
from flinders.errors import UnreadableInput
from flinders.readers._lines import EndsEarly, shown
from flinders.readers._source import Source, derived
from flinders.readers.dialects.json_lines import JsonLines, parsed

if TYPE_CHECKING:
    from collections.abc import Iterator

LARGEST: Final = 256 << 20  # Bytes of a document that are still read; JSON lines may be of any length
OPENING: Final = re.compile(r"\[\s*(?:[\[{\]]|-?[\d.]+(?:[eE][-+]?\d+)?\s*,|$)|\{\s*(?:\"|\}|$)")
"""How JSON with readings in it begins; ``[INFO] …`` is a line of a log."""
MARK: Final = "flinders"  # The key by which files that Flinders itself writes are known


def is_document(text: str) -> bool:
    """Tell a JSON document from JSON lines, and from lines such as ``[1, 2, 3] uT``, by how it begins."""
    first, _, more = text.lstrip().partition("\n")
    if not OPENING.match(first):
        return False
    record = parsed(first)
    if isinstance(record, dict):
        return MARK in record or (not more.strip() and any(isinstance(value, list) for value in record.values()))
    is_closed = sum(map(first.count, "[{")) == sum(map(first.count, "]}"))
    return record in (None, []) and not (is_closed and _is_broken(first))


def table_of(source: Source, encoding: str) -> tuple[Source, tuple[str, ...]]:
    """Turn the records of a document into a table without a header, and tell the names of its columns.

    Raises
    ------
    UnreadableInput
        For broken JSON, a document above `LARGEST`, and one that is not a list of records.
    """
    records = _records(source, encoding)
    dialect = JsonLines.of(records)
    return derived(source, _rows(records, dialect)), dialect.names


def _rows(records: list[object], dialect: JsonLines) -> Iterator[bytes]:
    for start in range(0, len(records), BLOCK):
        rows = (dialect.cells(record) or [shown(str(record))] for record in records[start : start + BLOCK])
        yield "".join(f"{','.join(row)}\n" for row in rows).encode()


def _records(source: Source, encoding: str) -> list[object]:
    """Load the records of a document."""
    content = bytearray()
    try:
        for chunk in source.chunks():
            content += chunk
            if len(content) > LARGEST:
                raise UnreadableInput(
                    f"{source.name} is one JSON document of more than {LARGEST >> 20} MB: "
                    "write one record a line (JSON lines) or CSV"
                )
    except EndsEarly as cut:
        raise cut.refusal(source.name) from None
    try:
        document = json.loads(content.decode(encoding, "replace"), parse_float=str, parse_int=str)
    except json.JSONDecodeError as error:
        raise UnreadableInput(
            f"{source.name} begins like JSON and is not ({error.msg}, line {error.lineno}): "
            "need a list of [x, y, z] or of objects"
        ) from None
    except (ValueError, RecursionError) as error:
        raise UnreadableInput(
            f"{source.name} is JSON that cannot be read ({error}): need a list of [x, y, z]"
        ) from None
    if isinstance(document, dict) and MARK in document:
        kind = shown(str(document[MARK]))
        raise UnreadableInput(f"{source.name} is a {kind} file of Flinders and not a recording: give the recording")
    if not isinstance(document, list) or not document:
        kind = "an empty list" if document == [] else f"one {'object' if isinstance(document, dict) else 'value'}"
        raise UnreadableInput(f"{source.name} is JSON with {kind} in it: need a list of [x, y, z] or of objects")
    return document


def _is_broken(text: str) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return True
    return False
