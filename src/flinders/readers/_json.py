"""JSON recordings, turned into a table of comma-separated lines, one a record.

A list of triples, a list of objects, or one of either a line; the keys of the first object become
the header, those of objects and lists inside it joined with a dot.

>>> is_json('{"t": 1, "mag": [2, 3, 4]}'), is_json("[[1, 2, 3],"), is_json("[1, 2, 3] uT")
(True, True, False)
"""

from __future__ import annotations

import csv
import io
import json
import re
from itertools import chain
from typing import TYPE_CHECKING, Final

from flinders.errors import UnreadableInput
from flinders.readers._lines import EndsEarly, Lines, shown
from flinders.readers._source import Source, derived
from flinders.readers.dialects.json_lines import flat
from flinders.samples import BLOCK

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

LARGEST: Final = 256 << 20
"""Bytes of a whole-file JSON document that are still read; JSON lines may be of any length."""
OPENING: Final = re.compile(r"\[\s*(?:[\[{\]]|-?[\d.]+(?:[eE][-+]?\d+)?\s*,|$)|\{\s*(?:\"|\}|$)")
"""How JSON with readings in it begins; ``[INFO] …`` is a line of a log."""
MARK: Final = "flinders"
"""The key by which files that Flinders itself writes are known."""


def is_json(text: str) -> bool:
    """Tell whether a text begins like JSON with readings in it; ``[1, 2, 3] uT`` is a line of a board."""
    first = text.lstrip().partition("\n")[0].rstrip()
    is_closed = sum(map(first.count, "[{")) == sum(map(first.count, "]}"))
    return OPENING.match(first) is not None and not (is_closed and isinstance(_parsed(first), str))


def table_of(source: Source, encoding: str) -> tuple[Source, tuple[str, ...]]:
    """Turn the records of a JSON file into a table, which is kept as the file is: on the disk, or not at all.

    Returns
    -------
    Source, tuple of str
        The table, and the names of its columns; none where records are lists.

    Raises
    ------
    UnreadableInput
        For broken JSON, a document above `LARGEST`, and one that is not a list of records.
    """
    opening, _ = source.opening(encoding)
    groups = map(_records, source.lines(encoding)) if _a_record_a_line(opening) else _whole(source, encoding)
    first = next(groups, [])
    names = next((tuple(flat(record)) for record in first if isinstance(record, dict)), ())
    return derived(source, _encoded(chain([first], groups), names)), names


def _a_record_a_line(opening: list[str]) -> bool:
    """Tell JSON lines from a document: the first line is an object or list of plain values by itself."""
    text = next((text for text in opening if text.strip()), "")
    record = _parsed(text)
    if isinstance(record, dict):
        alone = len(opening) == 1
        return MARK not in record and not (alone and any(isinstance(value, list) for value in record.values()))
    return isinstance(record, list) and bool(record) and not any(isinstance(value, (list, dict)) for value in record)


def _records(lines: Lines) -> list[object]:
    return [_parsed(text) if text.strip() else None for text in lines.texts]


def _parsed(text: str) -> object:
    """Parse one line; what is not JSON stays text, to be counted as unreadable."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return shown(text)


def _whole(source: Source, encoding: str) -> Iterator[list[object]]:
    """Yield the records of one JSON document, a block at a time."""
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
        document = json.loads(content.decode(encoding, "replace"))
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
    for start in range(0, len(document), BLOCK):
        yield document[start : start + BLOCK]


def _encoded(groups: Iterable[list[object]], names: tuple[str, ...]) -> Iterator[bytes]:
    """Write records as lines."""
    for group in groups:
        page = io.StringIO()
        writer = csv.writer(page, lineterminator="\n")
        for record in group:
            if record is None:
                page.write("\n")
            else:
                writer.writerow(_cells(record, names))
        yield page.getvalue().encode()


def _cells(record: object, names: tuple[str, ...]) -> list[object]:
    """Bring one record into the order of the columns; something else than a record becomes one cell of text."""
    if isinstance(record, dict) and names:
        values = flat(record)
        return [values.get(name) for name in names]
    if isinstance(record, list) and not names:
        return ["?" if isinstance(value, (list, dict, bool)) else value for value in record]
    return [shown(str(record))]
