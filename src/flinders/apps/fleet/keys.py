"""Columns of a table, or values in its path, that identify unit, recording and hardware batch of its rows."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self
from urllib.parse import unquote

from flinders.apps.fleet.names import BATCH_COLUMNS, RECORDING_COLUMNS, UNIT_COLUMNS
from flinders.apps.fleet.results import needs_arrow
from flinders.errors import UnreadableInput, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.fleet.options import Options

NO_VALUE: Final = "__HIVE_DEFAULT_PARTITION__"
"""Null in a path such as ``unit=__HIVE_DEFAULT_PARTITION__/part-0.parquet``."""


class Key(NamedTuple):
    """Place of a key: its column, or its value in the path; both are empty if the table lacks the key."""

    column: str = ""
    value: str = ""


NO_KEY: Final = Key()


@dataclass(frozen=True, slots=True)
class KeyColumns:
    """Columns of a table, or values in its path, that identify unit, recording and hardware batch of a row."""

    unit: Key = NO_KEY
    recording: Key = NO_KEY
    batch: Key = NO_KEY

    @classmethod
    def of(cls, name: str, columns: Sequence[str], options: Options, *, needs_batch: bool = True) -> Self | None:
        """Find the keys among columns and in a path such as ``unit=A17/part-0.parquet``; None without a unit.

        Raises UsageError if a key that the options name is in neither.

        >>> from flinders.apps.fleet.options import Options
        >>> keys = KeyColumns.of("serial=7/date=2026-11-21/part-0.parquet", ["t", "x", "y", "z", "lot"], Options())
        >>> keys.pair, keys.columns
        (('7', '2026-11-21'), ('lot',))
        """
        values = values_in_path(name)
        unit = _key(values, columns, options.unit_column, UNIT_COLUMNS, name)
        if unit is None:
            return None
        recording = _key(values, columns, options.recording_column, RECORDING_COLUMNS, name)
        batch = _key(values, columns, options.batch_column, BATCH_COLUMNS, name, needed=needs_batch)
        return cls(unit, recording or NO_KEY, batch or NO_KEY)

    @classmethod
    def of_schema(cls, name: str, schema: Any, options: Options) -> Self | None:  # noqa: ANN401
        """Find the keys as `of` does; the hardware batch is optional, and never a nested column.

        Raises UsageError if the unit or the recording that the options name is missing, UnreadableInput if a column of
        keys is nested or duplicate.
        """
        own = (options.recording_column, RECORDING_COLUMNS), (options.batch_column, BATCH_COLUMNS)
        guessed = {column for named, usual in own if named is None for column in usual}
        columns = [field.name for field in schema if field.name.casefold() not in guessed or _is_text(field.type)]
        keys = cls.of(name, columns, options, needs_batch=False)
        for column in keys.columns if keys else ():
            _refuse_column(name, schema, column)
        return keys

    @classmethod
    def of_path(cls, name: str, options: Options) -> Self | None:
        """Keys from the path of a file that cannot be opened; None if it does not name the unit."""
        with contextlib.suppress(UsageError):
            keys = cls.of(name, (), replace(options, recording_column=None, batch_column=None))
            return keys if keys is not None and keys.unit.value else None
        return None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the key columns."""
        return tuple(key.column for key in (self.unit, self.recording, self.batch) if key.column)

    @property
    def pair(self) -> tuple[str, str]:
        """Unit and recording in the path."""
        return self.unit.value, self.recording.value


@functools.lru_cache(maxsize=256)
def _is_text(kind: Any) -> bool:  # noqa: ANN401
    """Whether values of an Arrow type can be converted to texts; those of a struct or a list cannot."""
    arrow = needs_arrow()
    try:
        texts_of(arrow.nulls(0, kind)).dictionary_encode()
    except arrow.ArrowException:
        return False
    return True


def _refuse_column(name: str, schema: Any, column: str) -> None:  # noqa: ANN401
    """Refuse a key column that is nested or duplicate."""
    count = schema.names.count(column)
    if count > 1:
        raise UnreadableInput(f"{name} has {count} columns {column}: give all but one another name, or leave them out")
    kind = schema.field(column).type
    if not _is_text(kind):
        raise UnreadableInput(
            f"{name}: column {column} holds {kind}, which cannot be a name: make it a column of texts or numbers, or "
            "give it another name"
        )


def values_in_path(name: str) -> dict[str, str]:
    """Values in the folders of a path in the notation of Hive; null is the empty text.

    >>> values_in_path("unit=A%2017/date=__HIVE_DEFAULT_PARTITION__/part-0.parquet")
    {'unit': 'A 17', 'date': ''}
    """
    parts = (part.split("=", 1) for part in PurePosixPath(name).parts[:-1] if "=" in part)
    return {key: "" if value == NO_VALUE else text_of(unquote(value)) for key, value in parts}


def batch_in(name: str, options: Options) -> str:
    """Hardware batch in the path of a log; empty if there is none.

    >>> from flinders.apps.fleet.options import Options
    >>> batch_in("batch=2026-04/A17/monday.csv", Options())
    '2026-04'
    """
    values = values_in_path(name)
    wanted = BATCH_COLUMNS if options.batch_column is None else (options.batch_column,)
    return next((values[each] for each in wanted if each in values), "")


def _key(
    values: dict[str, str],
    columns: Sequence[str],
    column: str | None,
    usual: Sequence[str],
    name: str,
    *,
    needed: bool = True,
) -> Key | None:
    """Column of a key, or its value in the path; raises UsageError if a named and needed key is in neither."""
    lowered = {each.casefold(): each for each in reversed(columns)}
    for wanted in usual if column is None else (column,):
        if wanted in values:
            return Key(value=values[wanted])
        if wanted.casefold() in lowered:
            return Key(lowered[wanted.casefold()])
    if column is not None and needed:
        raise UsageError(f"{name} has no column {column}: there are {', '.join(columns[:24])}")
    return None


def texts_of(array: Any) -> Any:  # noqa: ANN401
    """Key column as texts; bytes and dictionaries stay as they are; raises ArrowException."""
    arrow = needs_arrow()
    is_text = "binary" in str(array.type) or arrow.types.is_dictionary(array.type)
    return array if is_text else array.cast(arrow.string())


def text_of(value: object) -> str:
    r"""Cell of a key column as text: bytes are UTF-8 if valid, blanks are empty.

    >>> text_of(b"A17"), text_of(b"\xff\x00"), text_of(7), text_of("  "), text_of(None)
    ('A17', 'ff00', '7', '', '')
    """
    if value is None:
        return ""
    if isinstance(value, bytes):
        try:
            text = value.decode()
        except UnicodeDecodeError:
            text = value.hex()
    else:
        text = str(value)
    return text if text.strip() else ""
