"""Many units at once, from what is in memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from flinders.core.samples import Samples
from flinders.errors import FlindersError, UsageError
from flinders.fleet.lots import Job
from flinders.fleet.plan import Partition, Piece
from flinders.fleet.store import Member
from flinders.fleet.table import Row, Rows, needs_arrow
from flinders.fleet.tables import BATCH, Asked, KeyedTable, Keys, Tabular
from flinders.fleet.work import fitted, of_table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


def fit_many(
    table: Any,  # noqa: ANN401 - of Arrow, pandas, polars or anything else that hands over Arrow's columns
    *,
    columns: str | None = None,
    unit: str | None = None,
    scale: float | None = None,
    axes: str = "x,y,z",
    unit_column: str | None = None,
    recording_column: str | None = None,
    batch_column: str | None = None,
    target_deg: float = 1.0,
    dip_deg: float = 60.0,
    polish: bool = True,
) -> Rows:
    """Calibrate many units, each as `flinders.fit` would by itself; what cannot be fitted is a row that says why.

    Parameters
    ----------
    table : mapping, or table
        Units by name, each Samples, a recording or an (N, 3) array in `unit`; or a table of all their readings with a
        column that says which unit a row is of: of pyarrow, or anything with ``__arrow_c_stream__`` (pandas, polars).
    columns, unit, scale, axes
        As `flinders.read`.
    unit_column, recording_column, batch_column : str, optional
        Of a table: the columns that say whose reading a row is, and of which batch of hardware; by default such as
        ``unit`` or ``serial``, ``recording`` or ``session``, and ``batch`` or ``lot``.
    target_deg, dip_deg : float
        As `flinders.fit`.
    polish : bool
        Go through the readings again; without, sums are all that is used.

    Returns
    -------
    Rows
        Sorted by unit, recording and start.

    Raises
    ------
    UsageError
        For a table without a column of units, and columns or units of field that there are not.
    UnreadableInput
        For a column of units that is nested, or there twice.
    NoMagnetometer
        Where it is not clear which columns are the magnetometer.
    MissingExtra
        For a table, where pyarrow is not installed.

    Examples
    --------
    >>> from flinders import simulate
    >>> rows = fit_many({f"A{seed}": simulate.tumble(seed=seed).samples for seed in (1, 2)})
    >>> rows, rows.offset.shape
    (Rows(2 good), (2, 3))
    """
    asked = Asked(
        columns=columns,
        unit=unit,
        scale=scale,
        axes=axes,
        unit_column=unit_column,
        recording_column=recording_column,
        batch_column=batch_column,
        target_deg=target_deg,
        dip_deg=dip_deg,
        polish=polish,
    )
    if isinstance(table, Mapping):
        jobs = [_of_one(str(name), source, asked) for name, source in table.items()]
        refused = Rows.of([row for row in jobs if isinstance(row, Row)])
        return Rows.joined([refused, fitted([job for job in jobs if isinstance(job, Job)], asked)]).sorted()
    held = _in_memory(table)
    Keys.of(held.name, held.schema.names, asked)  # where each column that was asked for is to be there
    whole = Partition((Piece(Member("table", "", 0), (0,), held.groups[0]),))
    return of_table(KeyedTable.of(held, asked), whole, asked).sorted()


def _of_one(name: str, source: Any, asked: Asked) -> Job | Row:  # noqa: ANN401
    """One unit of a mapping."""
    try:
        if not hasattr(source, "blocks"):
            source = Samples.of(source, unit=asked.unit or "counts", scale=asked.scale, axes=asked.axes)
    except FlindersError as error:
        return Row.of_error(error, name)
    return Job(name, "", source, 0)


def _in_memory(table: Any) -> Tabular:  # noqa: ANN401
    """A table that is there as if it were a file of one group.

    Raises
    ------
    UsageError
        For what is no table.
    """
    arrow = needs_arrow()
    if not isinstance(table, arrow.Table):
        if not hasattr(table, "__arrow_c_stream__"):
            raise UsageError(
                f"{type(table).__name__} is no table: give units by name as a dict, or a table of pyarrow, pandas or "
                "polars with a column of units"
            )
        table = arrow.table(table)

    def batches(_: Sequence[int], columns: list[str], rows: int = BATCH) -> Iterator[Any]:
        yield from table.select(columns).to_batches(max_chunksize=rows)

    return Tabular("the table", "Arrow", table.schema, (table.num_rows,), batches, lambda _: [None])
