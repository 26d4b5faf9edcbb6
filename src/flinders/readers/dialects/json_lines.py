"""JSON lines: an object, or a list of numbers, in each; other lines may stand between.

>>> dialect = recognise(["ready", '{"t": 0.1, "mag": {"x": 21.70, "y": 0.4, "z": -58.6}}'])
>>> dialect.names, dialect.row('{"mag": {"x": 1, "y": 2, "z": 3}, "t": 0.20}')
(('t', 'mag.x', 'mag.y', 'mag.z'), ['0.20', '1', '2', '3'])
"""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.readers._columns import names_magnetometer

if TYPE_CHECKING:
    from collections.abc import Sequence

LEAST: Final = 3  # Numbers in a record with a reading


@dataclass(frozen=True, slots=True)
class JsonLines:
    """Records with the same keys; lists have none."""

    names: tuple[str, ...]
    words: str = "JSON lines"

    @classmethod
    def of(cls, records: Sequence[object]) -> JsonLines:
        """Name the columns after the keys of the first object."""
        return cls(next((tuple(flat(record)) for record in records if isinstance(record, dict)), ()))

    def row(self, line: str) -> list[str] | None:
        """Bring the record of a line into the order of the columns, numbers as they are written."""
        return self.cells(parsed(line))

    def cells(self, record: object) -> list[str] | None:
        """Bring one record into the order of the columns; None for what is no such record."""
        if isinstance(record, dict) and self.names:
            values = flat(record)
            return [_cell(values.get(name)) for name in self.names] if values.keys() & set(self.names) else None
        return [_cell(value) for value in record] if isinstance(record, list) and not self.names else None


def recognise(lines: list[str]) -> JsonLines | None:
    """Find records with three numbers; of those with different keys, the most frequent that have a magnetometer's."""
    records = [record for record in map(parsed, lines) if record is not None and _numbers(record) >= LEAST]
    keys = Counter(tuple(flat(record)) if isinstance(record, dict) else () for record in records)
    if not keys:
        return None
    return JsonLines(max(keys, key=lambda names: (names_magnetometer(names), keys[names])))


def parsed(line: str) -> dict[str, object] | list[object] | None:
    """Parse an object or a list of plain values; numbers stay as they are written."""
    if not line.lstrip().startswith(("{", "[")):
        return None
    try:
        record = json.loads(line, parse_float=str, parse_int=str)
    except (ValueError, RecursionError):
        return None
    if isinstance(record, list) and any(isinstance(value, (list, dict)) for value in record):
        return None
    return record if isinstance(record, (dict, list)) else None


def flat(record: dict[str, object]) -> dict[str, object]:
    """Bring what lies inside objects and lists to the top, with dots in its name.

    >>> flat({"t": 1, "mag": {"x": 2, "y": [3]}})
    {'t': 1, 'mag.x': 2, 'mag.y.0': 3}
    """
    found: dict[str, object] = {}
    for key, value in record.items():
        if isinstance(value, list):
            inside = flat({str(place): inner for place, inner in enumerate(value)})
        elif isinstance(value, dict):
            inside = flat(value)
        else:
            inside = {}
            found[key] = value
        found.update({f"{key}.{inner}": leaf for inner, leaf in inside.items()})
    return found


def _numbers(record: dict[str, object] | list[object]) -> int:
    values = flat(record).values() if isinstance(record, dict) else record
    return sum(isinstance(value, str) and _is_number(value) for value in values)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _cell(value: object) -> str:
    """Write one value as a cell; text in quotes where it needs them."""
    if value is None:
        return ""
    page = io.StringIO()
    csv.writer(page, lineterminator="").writerow([value])
    return page.getvalue()
