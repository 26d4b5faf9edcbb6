"""Readings of many units in a data frame of pandas or polars, without pyarrow.

>>> import pandas
>>> from flinders.apps.fleet.options import Options
>>> axes = {"x_uT": [1.0, 2.0, 3.0], "y_uT": [4.0, 5.0, 6.0], "z_uT": [7.0, 8.0, 9.0]}
>>> frame = KeyedFrame.of(pandas.DataFrame({"unit": ["A17", "A17", "B02"], **axes}), Options())
>>> [(runs, values)] = frame.batches((0,), names := Interner())
>>> frame.rows, [names.pairs[each] for each in runs.numbers.tolist()], runs.lengths, values[0]
(3, [('A17', ''), ('B02', '')], array([2, 1]), array([1., 2., 3.]))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from flinders.apps.fleet.dataset import USED_COLUMNS, Interner, no_units, runs_of
from flinders.apps.fleet.keys import KeyColumns, text_of
from flinders.core.axes import Axes
from flinders.core.frames import columns_of
from flinders.readers import Choice
from flinders.readers._frame import open_columns, words_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.dataset import Runs
    from flinders.apps.fleet.options import Options
    from flinders.core.samples import Samples
    from flinders.readers import TableRecording
    from flinders.readers._columns import Values

NAME = "the table"
"""Name of a table in memory, for messages."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyedFrame:
    """A data frame with readings of many units, used like `KeyedTable`."""

    keys: KeyColumns
    words: dict[str, Sequence[object]]  # cells of each key column
    recording: TableRecording  # all other columns, unit of field and axes

    @classmethod
    def of(cls, frame: Any, options: Options) -> Self:  # noqa: ANN401
        """Recognise the columns; raises the errors of `KeyedTable.of`."""
        columns = columns_of(frame)
        keys = KeyColumns.of(NAME, [name for name, column in columns.items() if not _is_nested(column)], options)
        if keys is None:
            raise no_units(NAME, list(columns))
        recording = open_columns(
            {name: column for name, column in columns.items() if name not in keys.columns},
            NAME,
            columns=options.columns,
            unit=options.unit,
            scale=options.scale,
            axes=Axes.of(options.axes),
            choice=Choice(options.sensor, is_name=True),
        )
        recording.columns = replace(recording.columns.with_only(*USED_COLUMNS), is_assumed=False)
        return cls(keys, {name: words_of(columns[name]) for name in keys.columns}, recording)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.recording.table.length

    @property
    def start_s(self) -> float:
        """Seconds that are subtracted from the times of this frame."""
        time = self.recording.columns.time
        return 0.0 if time is None else time.start * time.factor

    def batches(self, _: Sequence[int], names: Interner) -> Iterator[tuple[Runs, list[NDArray[np.floating]]]]:
        """Yield a single batch: the recording of each row, as run lengths, and K columns (N,).

        `names` numbers the recordings, and gets the hardware batch of each.
        """
        every = (self.keys.unit, self.keys.recording, self.keys.batch)
        coded = [_encode(self.words[key.column]) if key.column else ([key.value], None) for key in every]
        blocks = list(self.recording.table.rows(self.recording.columns.cells))
        yield runs_of(coded, self.rows, names), list(np.concatenate(blocks).T)

    def samples(self, values: Values, source: str) -> Samples:
        """Make `Samples` from the K columns (N,) of a recording."""
        known = self.recording
        return known.columns.samples(values, unit=known.unit, axes=known.axes, source=source)


def _is_nested(column: Any) -> bool:  # noqa: ANN401
    """Whether a column of polars holds lists or records, which cannot be names."""
    is_nested = getattr(column.dtype, "is_nested", None)
    return bool(is_nested and is_nested())


def _encode(words: Sequence[object]) -> tuple[list[str], NDArray[np.integer]]:
    """Distinct texts of a column, and (N,) the index of each row's text."""
    places: dict[str, int] = {}
    indices = [places.setdefault(_text(word), len(places)) for word in words]
    return list(places), np.array(indices, dtype=np.int64)


def _text(word: object) -> str:
    """Text of a key, as Arrow writes it.

    >>> _text(7.0), _text(float("nan")), _text(True), _text("A17"), _text(None)
    ('7', '', 'true', 'A17', '')
    """
    if isinstance(word, (bool, np.bool_)):
        return str(word).lower()
    if isinstance(word, (float, np.floating)):
        return "" if np.isnan(word) else f"{word:.15g}"
    return text_of(word)
