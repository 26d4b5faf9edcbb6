"""Tables of a fleet unit by unit: the calibrations of each, in the order of time, a bounded number of rows at once.

Each table is sorted by unit, as `flinders fleet` writes it, so that several of them are read side by side, and a unit
is complete once all have gone past its name. A million rows take no more memory than a hundred thousand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.errors import DocumentError
from flinders.files import reason
from flinders.fleet.changes import Calibrations
from flinders.fleet.table import LISTS, NAMES, needs_arrow

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

COLUMNS: Final = (
    "unit", "recording", "start_s", "verdict", "offset", "matrix", "covariance", "radius", "dip_deg", "unit_of_field",
)  # fmt: skip
ROWS: Final = 16_384
"""Rows that are read at once, of all tables together."""


@dataclass(frozen=True, slots=True, eq=False)
class Histories:
    """Calibrations of some units, those of a unit together and in the order of time.

    Attributes
    ----------
    unit : (U,) object
        Names, sorted; units without any calibration are among them.
    first : (U + 1,) int
        Where the calibrations of each begin.
    recording : (R,) object
    start_s : (R,) float, s
        NaN where it is not known.
    calibrations : Calibrations
        R of them.
    unit_of_field : (R,) object
    dip_deg : (R,) float
    left_out : int
        Rows without a calibration: refused and failed ones, and those in another unit than the unit's first.
    """

    unit: NDArray[np.object_]
    first: NDArray[np.intp]
    recording: NDArray[np.object_]
    start_s: Floats
    calibrations: Calibrations
    unit_of_field: NDArray[np.object_]
    dip_deg: Floats
    left_out: int

    @property
    def line(self) -> NDArray[np.intp]:
        """(R,) which unit each calibration is of."""
        return np.repeat(np.arange(len(self.unit)), np.diff(self.first))

    @classmethod
    def of_table(cls, table: Any) -> Histories:  # noqa: ANN401 - pyarrow ships no types
        """Sort the rows of whole units."""
        from pyarrow import compute

        keys = [("unit", "ascending"), ("start_s", "ascending"), ("recording", "ascending")]
        table = table.take(compute.sort_indices(table, sort_keys=keys)).combine_chunks()
        names, line = np.unique(_texts(table.column("unit")), return_inverse=True)
        usable = table.column("covariance").is_valid().to_numpy() & table.column("offset").is_valid().to_numpy()
        usable &= np.isin(_texts(table.column("verdict")).astype(str), ["good", "limited"])
        field = _texts(table.column("unit_of_field"))
        kept = np.flatnonzero(usable)
        kept = kept[_alike(line[kept], field[kept])]
        inside = table.take(kept)
        offset, matrix, covariance = (_list(inside, name, LISTS[name]) for name in ("offset", "matrix", "covariance"))
        return cls(
            unit=names,
            first=np.searchsorted(line[kept], np.arange(len(names) + 1)),
            recording=_texts(inside.column("recording")),
            start_s=_numbers(inside, "start_s"),
            calibrations=Calibrations.of_columns(offset, matrix, covariance, _numbers(inside, "radius")),
            unit_of_field=field[kept],
            dip_deg=_numbers(inside, "dip_deg"),
            left_out=len(table) - len(kept),
        )


def histories(paths: Sequence[str | os.PathLike[str]], *, rows: int = ROWS) -> Iterator[Histories]:
    """Read tables of a fleet, whole units at a time.

    Parameters
    ----------
    paths : sequence of path
        Parquet files as `flinders fleet` writes them; a unit may be in several.
    rows : int
        That are read at once, of all of them together.

    Raises
    ------
    DocumentError
        For a file that is no table of a fleet, or is not sorted by unit.
    """
    for table in whole_units(paths, COLUMNS, rows=rows):
        yield Histories.of_table(table)


def whole_units(paths: Sequence[str | os.PathLike[str]], columns: Sequence[str], *, rows: int = ROWS) -> Iterator[Any]:
    """Tables of Arrow with all rows of some units, in the order of their names; errors as `histories`."""
    arrow = needs_arrow()
    feeds = [batches(path, columns, rows=max(rows // len(paths), 1)) for path in paths]
    waiting: list[Any] = [next(feed, None) for feed in feeds]
    more = [table is not None for table in waiting]
    while any(table is not None for table in waiting):
        open_ends = [_last(table) for table, goes_on in zip(waiting, more, strict=True) if goes_on]
        limit = min(open_ends) if open_ends else None
        taken = []
        for place, table in enumerate(waiting):
            if table is not None:
                done, waiting[place] = _split(table, limit)
                taken.append(done)
        whole = arrow.concat_tables(taken)
        if len(whole):
            yield whole
        for place, goes_on in enumerate(more):
            if goes_on and (waiting[place] is None or _last(waiting[place]) == limit):
                further = next(feeds[place], None)
                more[place] = further is not None
                if further is not None:
                    left = waiting[place]
                    waiting[place] = further if left is None else arrow.concat_tables([left, further])


def batches(path: str | os.PathLike[str], columns: Sequence[str], *, rows: int = ROWS) -> Iterator[Any]:
    """Tables of Arrow with some columns of a table of a fleet, so many rows at once; errors as `histories`."""
    arrow = needs_arrow()
    from pyarrow import parquet
    from pyarrow.lib import ArrowException

    last = ""
    try:
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            _refuse_other(path, file.schema_arrow.names, columns)
            for batch in file.iter_batches(rows, columns=list(columns)):
                if len(batch):
                    last = _sorted(path, batch.column("unit").to_pylist(), last)
                    yield arrow.Table.from_batches([batch])
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read as a table of a fleet: {reason(error)}") from None
    except ArrowException as error:
        raise DocumentError(f"{path}: cannot be read as a table of a fleet ({error})") from None


def _refuse_other(path: str | os.PathLike[str], found: Sequence[str], columns: Sequence[str]) -> None:
    """Refuse what `flinders fleet` did not write.

    Raises
    ------
    DocumentError
    """
    missing = [name for name in columns if name in NAMES and name not in found]
    if missing:
        raise DocumentError(
            f"{path}: this is no table of a fleet: it has no {', '.join(missing)}; make one with `flinders fleet`"
        )


def _sorted(path: str | os.PathLike[str], units: list[str | None], last: str) -> str:
    """Refuse a table that is not sorted by unit, or names none; the last unit of it.

    Raises
    ------
    DocumentError
    """
    for unit in units:
        if unit is None or unit < last:
            found = "a row has no unit" if unit is None else f"{unit!r} comes after {last!r}"
            raise DocumentError(f"{path}: {found}: sort the table by unit, as `flinders fleet` writes it")
        last = unit
    return last


def _last(table: Any) -> str:  # noqa: ANN401
    return str(table.column("unit")[len(table) - 1].as_py())


def _split(table: Any, limit: str | None) -> tuple[Any, Any]:  # noqa: ANN401
    """Rows of units before a name, and the others; all and None where there is no limit."""
    if limit is None:
        return table, None
    from pyarrow import compute

    count = compute.sum(compute.less(table.column("unit"), limit)).as_py() or 0
    left = table.slice(count)
    return table.slice(0, count), left if len(left) else None


def _texts(column: Any) -> NDArray[np.object_]:  # noqa: ANN401
    """(R,) texts, empty for null."""
    from pyarrow import compute

    texts: NDArray[np.object_] = compute.fill_null(column, "").to_numpy(zero_copy_only=False).astype(object)
    return texts


def _numbers(table: Any, name: str) -> Floats:  # noqa: ANN401
    return np.array(table.column(name).to_numpy(zero_copy_only=False), dtype=float)


def _list(table: Any, name: str, length: int) -> Floats:  # noqa: ANN401
    """(R, length) of a column of lists without null."""
    column = table.column(name).combine_chunks()
    return np.asarray(column.flatten(), dtype=float).reshape(-1, length)


def _alike(line: NDArray[np.intp], field: NDArray[np.object_]) -> NDArray[np.bool_]:
    """(n,) whether rows are in the unit of the field that the first row of their unit is in."""
    if not len(line):
        return np.zeros(0, dtype=bool)
    first = np.searchsorted(line, line)
    alike: NDArray[np.bool_] = field == field[first]
    return alike
