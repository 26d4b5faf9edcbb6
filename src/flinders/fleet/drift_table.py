"""Table of the drift of all units: a row for each, in the order of their names, written as they are compared."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from typing import TYPE_CHECKING, Any, TextIO, cast

from flinders.core.files import replacing
from flinders.fleet.results import needs_arrow
from flinders.report.fleet_view import UnitDrift

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence


@contextlib.contextmanager
def writing(
    path: str | os.PathLike[str] | None, *, force: bool = False
) -> Iterator[Callable[[Sequence[UnitDrift]], None] | None]:
    """Write a Parquet file that appears under its name when the block ends well.

    Yields a function that takes some units at a time; None if there is no path.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    if path is None:
        yield None
        return
    arrow = needs_arrow()
    from pyarrow import parquet

    with (
        replacing(path, force=force) as file,
        parquet.ParquetWriter(cast("TextIO", file).buffer, schema(), write_page_checksum=True) as writer,
    ):
        yield lambda units: writer.write_table(_table(arrow, units))


def schema() -> Any:  # noqa: ANN401 - pyarrow ships no types
    """Fields of `UnitDrift` as columns."""
    arrow = needs_arrow()
    kinds = {"str": arrow.string(), "int": arrow.int64(), "float": arrow.float64()}
    return arrow.schema([(field.name, kinds[str(field.type)]) for field in dataclasses.fields(UnitDrift)])


def _table(arrow: Any, units: Sequence[UnitDrift]) -> Any:  # noqa: ANN401
    """Table of some units, null for NaN."""
    columns = {
        field.name: [_known(getattr(unit, field.name)) for unit in units] for field in dataclasses.fields(UnitDrift)
    }
    return arrow.table(columns, schema=schema())


def _known(value: str | float) -> str | float | None:
    """A value, None for NaN."""
    return None if isinstance(value, float) and math.isnan(value) else value
