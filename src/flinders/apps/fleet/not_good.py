"""The recordings of a table that are not good: the main finding, its number, and the remedy.

>>> row = UnitResult(unit="A17", verdict="limited", cause="coverage", message="some directions are …", number=72.0)
>>> NotGood.of(row).remedy
'turn the sensor through the directions without readings too'
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.apps.fleet.results import VERDICTS, UnitResult, needs_arrow, strings
from flinders.findings import action

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator

MAX_LISTED: Final = 100
"""Largest number of recordings that a summary lists; a table has all of them."""


@dataclass(frozen=True, slots=True)
class NotGood:
    """A recording that is not good, and the reason."""

    unit: str  # name of the sensor or vehicle
    recording: str  # name of the recording
    verdict: str  # `limited`, `refused` or `failed`
    cause: str  # code of the first finding, or of the error
    number: float  # number of that finding; docs/findings.md has its meaning and unit
    limit: float  # limit for the number, in the same unit
    message: str  # finding and remedy for this recording
    remedy: str  # remedy for all recordings with this cause

    @classmethod
    def of(cls, row: UnitResult) -> Self:
        """Make the entry of a recording from its row of the table."""
        own = (row.unit, row.recording, row.verdict, row.cause, row.number, row.limit, row.message)
        return cls(*own, action(row.cause))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return asdict(self)


def not_good(path: str | os.PathLike[str]) -> Iterator[list[NotGood]]:
    """Yield the recordings of a table that are not good, in the order of the table, some at a time."""
    from pyarrow import compute, parquet

    bad = strings(needs_arrow(), VERDICTS[1:])
    columns = [each.name for each in fields(NotGood) if each.name != "remedy"]
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        for batch in file.iter_batches(columns=columns):
            rows = batch.filter(compute.is_in(batch.column("verdict"), value_set=bad)).to_pylist()
            yield [NotGood.of(UnitResult(**{name: _cell_value(cell) for name, cell in row.items()})) for row in rows]


def first_of(some: Iterable[list[NotGood]], most: int = MAX_LISTED) -> tuple[NotGood, ...]:
    """The first recordings of each verdict, at most `most`, with the worst verdicts first."""
    kept: dict[str, list[NotGood]] = {verdict: [] for verdict in reversed(VERDICTS[1:])}
    for rows in some:
        for row in rows:
            if len(kept[row.verdict]) < most:
                kept[row.verdict].append(row)
    return tuple(islice((row for rows in kept.values() for row in rows), most))


def _cell_value(cell: Any) -> Any:  # noqa: ANN401 - a text, or a number
    return math.nan if cell is None else cell
