r"""JSON whose records are not one reading each: lists by key, names and rows, several readings per record.

>>> arrange_records({"t": [0, 1, 2, 3, 4], "mag": {"x": [5, 5, 5, 5, 5]}, "note": "a"})[1]
{'t': 1, 'mag.x': 5}
>>> arrange_records({"columns": ["mx", "my", "mz"], "data": [[1, 2, 3], [4, 5, 6]]})[1]
{'mx': 4, 'my': 5, 'mz': 6}
>>> arrange_records({"mag": [1, 2, 3]}) is None
True
>>> records = [{"t": "0", "m": [{"x": "1", "y": "2", "z": "3"}, {"x": "2", "y": "2", "z": "3"}]},
...            {"t": "8", "m": [{"x": "3", "y": "2", "z": "3"}, {"x": "4", "y": "2", "z": "3"}]}]
>>> [(each["t"], each["m"]["x"]) for each in split_records(records)]
[('0', '1'), ('4.0', '2'), ('8', '3'), ('12.0', '4')]
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.readers._cells import parse_number
from flinders.readers._instruments import names_magnetometer, vectors
from flinders.readers._names import FIELD, TIME, meaning

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats

Json: TypeAlias = dict[str, Any]

MIN_ROWS: Final = 5  # smallest length of a list of readings; a shorter one may be a vector or a quaternion
# smallest length of a key that is a time: digits of a time since 1970, or characters of a date
MIN_TIME_LETTERS: Final = 10
MAX_PARTS: Final = 20  # largest number of members of a list that is searched for a table
COMPARED_RECORDS: Final = 100  # number of records that are compared, to tell successive readings from several sensors
# smallest ratio of differences within a record to those between records that shows several sensors
MIN_SENSOR_RATIO: Final = 1.5


def arrange_records(document: Json) -> list[Any] | None:
    """Records of a table in one object: names and rows, lists by key, or a list of records; None for other objects."""
    for body in _objects(document):
        if rows := _named_rows(body):
            return rows
    lists = _lists(_as_list(document) or document)
    lengths = sorted({len(each) for each in lists.values() if len(each) >= MIN_ROWS}, reverse=True)
    tables = [{name: each for name, each in lists.items() if len(each) == length} for length in lengths]
    table = max(tables, key=lambda table: (names_magnetometer(_names_of(table)), len(table)), default=None)
    if table is None:
        return None
    if len(table) == 1:
        (only,) = table.values()
        return only if isinstance(only[0], (dict, list)) else None
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


def split_records(records: list[Any]) -> list[Any]:
    """Split records with several readings into one record for each; other records are unchanged.

    Records with one reading of each of several sensors are not split. The time of a record is that of its first
    reading; the times of the others are spread evenly up to the next record.
    """
    inside = [_batch(record) if isinstance(record, dict) else {} for record in records[:COMPARED_RECORDS]]
    if not any(inside) or _are_sensors([batch for batch in inside if batch]):
        return records
    times = [_times(record) if isinstance(record, dict) else {} for record in records]
    after = [*times[1:], {}]
    made: list[Any] = []
    steps: dict[str, float] = {}
    for record, own, following in zip(records, times, after, strict=True):
        steps = {name: following[name] - time for name, time in own.items() if name in following} or steps
        made += _split_record(record, own, steps) if isinstance(record, dict) else [record]
    return made


def _objects(value: Any) -> Iterator[Json]:  # noqa: ANN401 - JSON
    """Yield the objects inside a document, outer ones first; long lists are not searched."""
    if isinstance(value, dict):
        yield value
        value = list(value.values())
    if isinstance(value, list) and len(value) < MAX_PARTS:
        for each in value:
            yield from _objects(each)


def _named_rows(body: Json) -> list[Json]:
    """Rows of an object as records, with the names from a separate list such as ``columns`` or ``sensors``."""
    for heads in filter(_is_list, body.values()):
        names = [_name(head) for head in heads]
        for rows in filter(_is_list, body.values()):
            if len(rows) > 1 and all(names) and all(_is_list(row) and len(row) == len(names) for row in rows):
                step = parse_number(str(body["interval_ms"]), ".") if "interval_ms" in body else None
                times = [{"t_ms": str(step * place)} if step else {} for place in range(len(rows))]
                return [{**time, **dict(zip(names, row, strict=True))} for time, row in zip(times, rows, strict=True)]
    return []


def _name(head: Any) -> str:  # noqa: ANN401 - JSON
    """Name of a column: a word that is not a number, or the name in an object, with its unit."""
    if isinstance(head, dict) and isinstance(head.get("name"), str):
        unit = head.get("units") or head.get("unit")
        return f"{head['name']} ({unit})" if isinstance(unit, str) else str(head["name"])
    return head if isinstance(head, str) and parse_number(head, ".") is None else ""


def _is_list(value: object) -> bool:
    return isinstance(value, list) and bool(value)


def _as_list(value: Json) -> list[Any] | None:
    """Values of an object whose keys are row numbers, dates or times, as pandas writes it; None for another object."""
    is_by_row = len(value) >= MIN_ROWS and all(key[:1].isdecimal() for key in value)
    return list(value.values()) if is_by_row else None


def _lists(value: Any, name: str = "") -> dict[str, list[Any]]:  # noqa: ANN401 - JSON
    """Lists of an object, by path of keys; the keys of an object by time become a list ``timestamp``."""
    if isinstance(value, list):
        return {name: value} if value else {}
    found: dict[str, list[Any]] = {}
    for key, inner in value.items() if isinstance(value, dict) else ():
        path = f"{name}.{key}" if name else str(key)
        rows = _as_list(inner) if isinstance(inner, dict) else None
        if rows and len(next(iter(inner))) >= MIN_TIME_LETTERS:
            found.setdefault("timestamp", list(inner))
        found |= _lists(inner if rows is None else rows, path)
    return found


def _names_of(table: dict[str, list[Any]]) -> list[str]:
    """Names of the columns of a table; a vector has one for each component."""
    return [name for key, rows in table.items() for name in _parts(key, rows[0])]


def _parts(key: str, value: Any) -> list[str]:  # noqa: ANN401 - JSON
    """Names of the numbers in a value."""
    inside = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else None
    return [key] if inside is None else [f"{key}.{part}" for part in inside]


def _batch(record: Json) -> dict[str, list[Any]]:
    """Lists of equal length in a record that are columns of a magnetometer; empty if there are none."""
    lists = _lists(record)
    for length in sorted({len(each) for each in lists.values() if len(each) > 1}, reverse=True):
        batch = {name: each for name, each in lists.items() if len(each) == length}
        if names_magnetometer(_names_of(batch)):
            return batch
    return {}


def _are_sensors(batches: Sequence[dict[str, list[Any]]]) -> bool:
    """Whether a record has several sensors: each reading is closer to its successor in the next record."""
    same = [batch for batch in batches if len(_first(batch)) == len(_first(batches[0]))]
    read = [each for each in map(_readings, same) if each is not None]
    if len(read) < 2:
        return False
    inside = np.concatenate([np.linalg.norm(np.diff(each, axis=0), axis=1) for each in read])
    across = np.concatenate([np.linalg.norm(after - before, axis=1) for before, after in pairwise(read)])
    return bool(np.median(inside) > MIN_SENSOR_RATIO * np.median(across))


def _first(batch: dict[str, list[Any]]) -> list[Any]:
    return next(iter(batch.values()))


def _readings(batch: dict[str, list[Any]]) -> Floats | None:
    """(N, 3) readings of the magnetometer in a record's lists; None if some are not numbers."""
    names = _names_of(batch)
    columns = [list(_values(row)) for row in zip(*batch.values(), strict=True)]
    cells = vectors(names, list(map(meaning, names)), FIELD)[0].cells
    try:
        return np.array([[float(row[cell]) for cell in cells] for row in columns])
    except (ValueError, TypeError, IndexError):
        return None


def _values(row: Sequence[Any]) -> Iterator[Any]:
    """Yield the numbers of a row, with the components of its vectors in order."""
    for value in row:
        yield from value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]


def _times(record: Json) -> dict[str, float]:
    """Times of a record that are numbers, by path of keys."""
    leaves = {key: parse_number(str(value), ".") for key, value in _plain_values(record) if meaning(key).kind == TIME}
    return {key: value for key, value in leaves.items() if value is not None}


def _plain_values(record: Json, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in a record that are not lists, by path of keys."""
    for key, value in record.items():
        path = f"{name}.{key}" if name else str(key)
        if isinstance(value, dict):
            yield from _plain_values(value, path)
        elif not isinstance(value, list):
            yield path, value


def _split_record(record: Json, times: dict[str, float], steps: dict[str, float]) -> Iterator[Json]:
    """Yield a record for each reading in a record; the record itself if it has only one reading."""
    batch = _batch(record)
    if not batch:
        yield record
        return
    plain, count = dict(_plain_values(record)), len(_first(batch))
    for place in range(count):
        later = {name: times[name] + step * place / count for name, step in steps.items() if place and name in times}
        own = {name: each[place] for name, each in batch.items()}
        yield {**plain, **{name: str(time) for name, time in later.items()}, **own}
