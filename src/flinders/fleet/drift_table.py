"""The drift of all units as a table: a row for each, in the order of their names, written as they are found."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flinders.core.files import reason
from flinders.errors import OutputError
from flinders.fleet.table import needs_arrow
from flinders.report.fleet_view import UnitDrift

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence


@contextlib.contextmanager
def writing(
    path: str | os.PathLike[str] | None, *, force: bool = False
) -> Iterator[Callable[[Sequence[UnitDrift]], None] | None]:
    """Write a Parquet file that appears under its name when the block ends well.

    What it yields takes some units at a time; None where there is no path.

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    if path is None:
        yield None
        return
    arrow = needs_arrow()
    from pyarrow import parquet

    from flinders.core.files import refuse_existing

    refuse_existing(path, force=force)
    target = Path(path)
    temporary = target.with_name(f".flinders-{secrets.token_hex(8)}.tmp")
    try:
        with parquet.ParquetWriter(temporary, schema(), write_page_checksum=True) as writer:
            yield lambda units: writer.write_table(_table(arrow, units))
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {reason(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def schema() -> Any:  # noqa: ANN401 - pyarrow ships no types
    """The fields of `UnitDrift` as columns."""
    arrow = needs_arrow()
    kinds = {"str": arrow.string(), "int": arrow.int64(), "float": arrow.float64()}
    return arrow.schema([(field.name, kinds[str(field.type)]) for field in dataclasses.fields(UnitDrift)])


def _table(arrow: Any, units: Sequence[UnitDrift]) -> Any:  # noqa: ANN401
    """Some units, null for what is not known."""
    columns = {
        field.name: [_known(getattr(unit, field.name)) for unit in units] for field in dataclasses.fields(UnitDrift)
    }
    return arrow.table(columns, schema=schema())


def _known(value: str | float) -> str | float | None:
    return None if isinstance(value, float) and math.isnan(value) else value
