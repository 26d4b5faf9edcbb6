"""The table of a fleet: finished parts merged in order, and what it counts, in the memory of a row group."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TextIO, TypeAlias, cast

import numpy as np

from flinders.apps.fleet.results import KEY, TEXTS, VERDICTS, integers, named_rows, needs_arrow, schema, strings
from flinders.core.files import replacing

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from flinders.arrays import Floats

    RowKey: TypeAlias = tuple[str, str, float]  # cells of `KEY`

GROUP: Final = 65_536
"""Rows in a row group of the table."""
LEVEL: Final = 3
"""Level of compression; settings of the writer are fixed, so that the same rows are the same bytes."""


def merge(parts: Sequence[Path], out: str | os.PathLike[str]) -> None:
    """Merge Arrow files of rows, each sorted by `KEY`, into a Parquet file; of equal rows the first come first.

    A file is opened when its first row comes next, and a row group is taken from a few files, so that memory is that of
    a row group. Raises OutputError.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders.apps.fleet.results import UnitResult, UnitResults
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name, units in (("a", ["A1", "A3"]), ("b", ["A2", "A4"])):
    ...     _ = (folder / name).write_bytes(UnitResults.of([UnitResult(unit=unit) for unit in units]).to_bytes())
    >>> merge([folder / "a", folder / "b"], folder / "all.parquet")
    >>> UnitResults.read(folder / "all.parquet").unit.tolist()
    ['A1', 'A2', 'A3', 'A4']
    """
    needs_arrow()
    with replacing(out, force=True) as file:
        _write(_groups(parts), cast("TextIO", file).buffer)


def _write(groups: Iterator[Any], file: Any) -> None:  # noqa: ANN401 - pyarrow ships no types
    """Write row groups."""
    from pyarrow import parquet

    options: dict[str, Any] = {
        "compression": "zstd",
        "compression_level": LEVEL,
        "version": "2.6",
        "use_dictionary": [*TEXTS, "findings.list.element"],
        "write_page_checksum": True,
    }
    with parquet.ParquetWriter(file, schema(), **options) as writer:
        for group in groups:
            writer.write_table(group, row_group_size=GROUP)


def _groups(parts: Sequence[Path]) -> Iterator[Any]:
    """Tables of the rows of one row group each, in order."""
    rows = _rows(parts)
    while group := list(islice(rows, GROUP)):
        yield _gathered(parts, np.array(group))


def _rows(parts: Sequence[Path]) -> Iterator[tuple[int, int]]:
    """Yield the number of a file and that of a row in it, in order of the rows."""
    for _, place, row in heapq.merge(*(_keyed(place, path) for place, path in enumerate(parts))):
        yield place, row


def _keyed(place: int, path: Path) -> Iterator[tuple[RowKey, int, int]]:
    """Rows of a file with their keys; all but the first are read when its turn comes."""
    yield from ((key, place, 0) for key in _keys(_mapped(path).slice(0, 1)))
    yield from ((key, place, row) for row, key in enumerate(_keys(_mapped(path).slice(1)), 1))


def _mapped(path: Path) -> Any:  # noqa: ANN401
    """Rows of a file, mapped into memory and not read."""
    arrow = needs_arrow()
    return arrow.ipc.open_file(arrow.memory_map(str(path))).read_all()


def _keys(table: Any) -> list[RowKey]:  # noqa: ANN401
    """Cells of `KEY` of each row; a missing time comes last."""
    unit, recording, start = (table.column(name).to_pylist() for name in KEY)
    return list(zip(unit, recording, (math.inf if time is None else time for time in start), strict=True))


def _gathered(parts: Sequence[Path], rows: NDArray[np.int64]) -> Any:  # noqa: ANN401
    """Table of (G, 2) rows, each the number of a file and of a row in it."""
    arrow = needs_arrow()
    order = np.argsort(rows[:, 0], kind="stable")
    places, first = np.unique(rows[order, 0], return_index=True)
    taken = zip(places.tolist(), np.split(rows[order, 1], first[1:]), strict=True)
    pieces = (_mapped(parts[place]).take(integers(arrow, numbers)) for place, numbers in taken)
    whole = arrow.concat_tables(pieces).combine_chunks()
    is_ordered = bool((np.diff(order) == 1).all())
    return whole if is_ordered else whole.take(integers(arrow, np.argsort(order)))


# --------------------------------------------------------------------------------------------------------------- counts

REJECTED: Final = 100
"""Recordings without a calibration that a summary names; the table has all of them."""

COUNTED: Final = {
    "verdict": "verdicts", "code": "codes", "findings": "findings", "unit_of_field": "units_of_field"
}  # fmt: skip
"""Columns of few texts that occur often, and what their counts are called."""


def table_counts(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Units, rows and readings of a table sorted by unit, and counts of verdicts; memory is that of a batch.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from flinders.apps.fleet.results import UnitResult, UnitResults
    >>> folder = Path(tempfile.mkdtemp())
    >>> good = UnitResult(unit="A1", verdict="good", worst_deg=0.4)
    >>> rows = [good, UnitResult(unit="A2", code="unreadable"), UnitResult(unit="A2")]
    >>> _ = (folder / "part").write_bytes(UnitResults.of(rows).to_bytes())
    >>> merge([folder / "part"], folder / "all.parquet")
    >>> counts = table_counts(folder / "all.parquet")
    >>> counts["rows"], counts["units"], counts["verdicts"], counts["worst_deg"]["largest"], counts["failed_readings"]
    (3, 2, {'good': 1, 'failed': 2}, 0.4, 0)
    """
    needs_arrow()
    from pyarrow import parquet

    counters = {name: Counter[str]() for name in COUNTED}
    totals, last = Counter[str](), None
    rejected: list[dict[str, str]] = []
    errors: list[Floats] = [np.empty(0)]
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        for batch in file.iter_batches(columns=["unit", "recording", "readings", "worst_deg", *COUNTED]):
            for name, counter in counters.items():
                counter.update(_value_counts(batch.column(name)))
            errors.append(_heading_errors(batch))
            readings = batch.column("readings")
            failed = readings.filter(_is_among(batch, VERDICTS[3:]))
            if len(rejected) < REJECTED:
                some = batch.filter(_is_among(batch, VERDICTS[2:]))
                some = some.select(["unit", "recording", "code", "findings"])
                rejected += map(_named, some.slice(0, REJECTED - len(rejected)).to_pylist())
            units = named_rows(batch).column("unit")
            totals.update(readings=total(readings), failed_readings=total(failed), rows=len(readings))
            if len(units):
                totals["units"] += len(units.unique()) - (units[0].as_py() == last)
                last = units[-1].as_py()
    verdicts = counters.pop("verdict")
    return {
        **{name: totals[name] for name in ("units", "rows", "readings", "failed_readings")},
        "verdicts": {name: verdicts[name] for name in VERDICTS if verdicts[name]},
        **{COUNTED[name]: _by_frequency(counter) for name, counter in counters.items()},
        "worst_deg": _spread(errors),
        "rejected": rejected,
    }


def _named(row: dict[str, Any]) -> dict[str, str]:
    """A row without a calibration, with the finding that refuses a fit."""
    cause = row["findings"][0] if row["code"] == "refused" and row["findings"] else ""
    return {"unit": row["unit"], "recording": row["recording"], "code": row["code"], "finding": cause}


def common_findings(findings: Mapping[str, int], verdicts: Mapping[str, int]) -> list[str]:
    """Findings that all calibrations of a fleet have, by the rows with each finding and verdict; none of one alone.

    >>> common_findings({"scale-unknown": 6, "outliers": 2}, {"good": 5, "limited": 1, "refused": 2})
    ['scale-unknown']
    """
    calibrations = sum(verdicts.get(verdict, 0) for verdict in VERDICTS[:2])
    return [code for code, count in findings.items() if count >= calibrations > 1]


def _spread(errors: Sequence[Floats]) -> dict[str, float]:
    """Median, 95th percentile and maximum of heading errors; empty without any."""
    known = np.concatenate(errors)
    if not len(known):
        return {}
    return dict(zip(("median", "p95", "largest"), np.percentile(known, [50, 95, 100]).tolist(), strict=True))


def _value_counts(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """Count each text of a column, or of the lists in one."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _heading_errors(batch: Any) -> Floats:  # noqa: ANN401
    """Known heading errors of a batch, of rows that have a calibration."""
    column = batch.column("worst_deg").filter(_is_among(batch, VERDICTS[:2]))
    worst = np.asarray(np.from_dlpack(column.drop_null()), dtype=float)
    known: Floats = worst[np.isfinite(worst)]
    return known


def _is_among(batch: Any, verdicts: Sequence[str]) -> Any:  # noqa: ANN401
    """(R,) of Arrow: whether rows of a batch have one of these verdicts."""
    from pyarrow import compute

    return compute.is_in(batch.column("verdict"), value_set=strings(needs_arrow(), verdicts))


def total(column: Any) -> int:  # noqa: ANN401
    """Sum of a column of whole numbers."""
    from pyarrow import compute

    return int(compute.sum(column).as_py() or 0)


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    """Counts with the most frequent first, the empty text left out."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}
