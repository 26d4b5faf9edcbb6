"""Summary of a fleet run: what its table holds, how the run went, and both as a page for the terminal.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.merge import merge
>>> from flinders.fleet.results import UnitResult, UnitResults
>>> folder = Path(tempfile.mkdtemp())
>>> good = UnitResult(unit="A1", verdict="good", worst_deg=0.4)
>>> rows = [good, UnitResult(unit="A2", code="unreadable"), UnitResult(unit="A2")]
>>> _ = (folder / "part").write_bytes(UnitResults.of(rows).to_bytes())
>>> merge([folder / "part"], folder / "all.parquet")
>>> counts = Counts.of(folder / "all.parquet")
>>> counts.rows, counts.units, counts.texts["verdict"], counts.worst_deg.tolist(), counts.failed_readings
(3, 2, Counter({'failed': 2, 'good': 1}), [0.4], 0)
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.errors import counted, figures, percent
from flinders.fleet.hardware_batch import named_rows
from flinders.fleet.results import VERDICTS, needs_arrow
from flinders.report.fleet_view import SUMS_ALONE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from rich.console import RenderableType

    from flinders.arrays import Floats
    from flinders.fleet.options import Options
    from flinders.fleet.plan import Plan

COUNTED: Final = ("verdict", "code", "findings", "unit_of_field")
"""Columns of few texts that occur often."""
COLOURS: Final = {"good": "green", "limited": "yellow", "refused": "red", "failed": "red"}
SUFFIXES: Final = {"none": "without an ending"}
"""Words for kinds of files that are not their suffix."""
SHOWN: Final = 8
"""Codes and findings that the page lists; the table has them all."""


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """Counts over a table.

    Attributes
    ----------
    rows, readings, units : int
        Units that have a name.
    failed_readings : int
        Readings of rows that failed, as far as their number is known.
    texts : dict of Counter
        By the columns `COUNTED`: rows of each text; with each finding.
    worst_deg : (K,) degrees
        Heading errors of rows that are good or limited.
    """

    rows: int
    readings: int
    units: int
    failed_readings: int
    texts: dict[str, Counter[str]]
    worst_deg: Floats

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Self:
        """Count in a Parquet file that is sorted by unit; memory is that of a batch, and of `worst_deg`."""
        needs_arrow()
        from pyarrow import parquet

        texts: dict[str, Counter[str]] = {name: Counter() for name in COUNTED}
        readings, failed, units, last = 0, 0, 0, None
        worst: list[Floats] = [np.empty(0)]
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            for batch in file.iter_batches(columns=["unit", "readings", "worst_deg", *COUNTED]):
                if not batch.num_rows:
                    continue
                for name, counter in texts.items():
                    counter.update(_value_counts(batch.column(name)))
                worst.append(_worst(batch))
                counts = batch.column("readings").to_numpy()
                readings += int(np.sum(counts))
                failed += int(np.sum(counts[_is_among(batch, VERDICTS[3:])]))
                unit = named_rows(batch).column("unit")
                if len(unit):
                    units += len(unit.unique()) - (unit[0].as_py() == last)
                    last = unit[-1].as_py()
            return cls(file.metadata.num_rows, readings, units, failed, texts, np.concatenate(worst))


def _value_counts(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """Count each text of a column, or of the lists in one."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _worst(batch: Any) -> Floats:  # noqa: ANN401
    """Known heading errors of a batch, of rows that have a calibration."""
    worst: Floats = np.asarray(batch.column("worst_deg").to_numpy(zero_copy_only=False), dtype=float)
    known: Floats = worst[_is_among(batch, VERDICTS[:2]) & np.isfinite(worst)]
    return known


def _is_among(batch: Any, verdicts: Sequence[str]) -> NDArray[np.bool_]:  # noqa: ANN401
    """(R,) whether rows of a batch have one of these verdicts."""
    from pyarrow import array, compute

    among: NDArray[np.bool_] = compute.is_in(batch.column("verdict"), value_set=array(verdicts)).to_numpy(False)
    return among


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Summary of a fleet run: rows written, units refused, files left out, duration.

    Attributes
    ----------
    output : str
    files, partitions : int
    units, rows, readings : int
        Units, their recordings, which are the rows of the table, and readings.
    failed_readings : int
        Readings of recordings that failed; an unreadable one has as many as its footer says.
    verdicts, codes, findings, units_of_field : dict
        Rows of each verdict, error code, finding and unit of field.
    worst_deg : dict
        ``median``, ``p95`` and ``largest`` of the worst heading error of rows that are good or limited.
    left_out : dict
        Files of other kinds, by their suffix.
    polish : bool
        Whether the fits used the readings, or their sums alone.
    resumed : int
        Partitions that an earlier run had done.
    workers_lost : int
        Workers that died, or left the cluster.
    retried : int
        Partitions that were run again because their worker died; a cluster reports only those that it gave up.
    seconds : float
    """

    output: str
    files: int
    partitions: int
    units: int
    rows: int
    readings: int
    failed_readings: int
    verdicts: dict[str, int]
    codes: dict[str, int]
    findings: dict[str, int]
    units_of_field: dict[str, int]
    worst_deg: dict[str, float]
    left_out: dict[str, int]
    polish: bool
    resumed: int
    workers_lost: int
    retried: int
    seconds: float

    @property
    def is_whole(self) -> bool:
        """Whether every recording has a calibration."""
        return not self.codes

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields if self.polish else {**fields, "sums_alone": SUMS_ALONE}


def summarize(
    out: str | os.PathLike[str],
    counts: Counts,
    plan: Plan,
    options: Options,
    *,
    resumed: int,
    workers_lost: int,
    retried: int,
    seconds: float,
) -> RunSummary:
    """Summarise a run.

    Parameters
    ----------
    out : str or path
    counts : Counts
        Of the table that was written.
    plan : Plan
    options : Options
    resumed, workers_lost, retried, seconds
        As the attributes of `RunSummary`.
    """
    worst = counts.worst_deg
    places = zip(("median", "p95", "largest"), np.percentile(worst, [50, 95, 100]) if len(worst) else (), strict=False)
    return RunSummary(
        output=os.fspath(out),
        files=plan.files,
        partitions=len(plan.partitions),
        units=counts.units,
        rows=counts.rows,
        readings=counts.readings,
        failed_readings=counts.failed_readings,
        verdicts={name: counts.texts["verdict"][name] for name in VERDICTS if counts.texts["verdict"][name]},
        codes=_by_frequency(counts.texts["code"]),
        findings=_by_frequency(counts.texts["findings"]),
        units_of_field=_by_frequency(counts.texts["unit_of_field"]),
        worst_deg={name: float(value) for name, value in places},
        left_out=plan.left_out,
        polish=options.polish,
        resumed=resumed,
        workers_lost=workers_lost,
        retried=retried,
        seconds=seconds,
    )


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    """Counts with the most frequent first, the empty text left out."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}


# -------------------------------------------------------------------------------------------------------------- page


def page(summary: RunSummary) -> RenderableType:
    """Lay out a run: what was read, verdicts, why rows have no calibration, and findings."""
    from rich.console import Group

    held = (counted(summary.units, "unit"), counted(summary.rows, "recording"), counted(summary.readings, "reading"))
    verdicts = _table("verdict", "recordings", "share")
    for verdict, count in summary.verdicts.items():
        verdicts.add_row(verdict, f"{count:,}", percent(count, summary.rows), style=COLOURS[verdict])
    parts = [f"{counted(summary.files, 'file')}: {', '.join(held)}", "", verdicts]
    for title, counts in (("no calibration because", summary.codes), ("findings", summary.findings)):
        if counts:
            parts += ["", _most_frequent(title, counts)]
    return Group("", *parts, "", *_remarks(summary))


def _table(first: str, *numbers: str) -> Any:  # noqa: ANN401 - rich is imported late
    """Empty table with a column of texts and columns of numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="")
    table.add_column(first)
    for name in numbers:
        table.add_column(name, justify="right")
    return table


def _most_frequent(title: str, counts: dict[str, int]) -> RenderableType:
    """Table of the most frequent codes."""
    table = _table(title, "recordings")
    for code, count in list(counts.items())[:SHOWN]:
        table.add_row(code, f"{count:,}")
    if len(counts) > SHOWN:
        table.add_row(f"and {len(counts) - SHOWN} more", "")
    return table  # type: ignore[no-any-return]


def _remarks(summary: RunSummary) -> list[str]:
    """Further lines of the page."""
    lines = []
    if summary.worst_deg:
        middle, most, largest = (figures(summary.worst_deg[name]) for name in ("median", "p95", "largest"))
        lines.append(f"worst heading error: median {middle}°, 95% below {most}°, largest {largest}° (1 σ)")
    if summary.failed_readings:
        lines.append(f"readings of recordings that failed: {summary.failed_readings:,} of {summary.readings:,}")
    if not summary.polish:
        lines.append(f"from sums alone: {SUMS_ALONE}")
    if len(summary.units_of_field) > 1:
        units = ", ".join(f"{count:,} in {unit}" for unit, count in summary.units_of_field.items())
        lines.append(f"units of field differ: {units}; offsets are in the unit of their row")
    if summary.left_out:
        kinds = ", ".join(f"{count:,} {SUFFIXES.get(kind, kind)}" for kind, count in summary.left_out.items())
        lines.append(f"left out files that are no recordings: {kinds}")
    if summary.resumed:
        lines.append(f"{summary.resumed:,} of {counted(summary.partitions, 'partition')} were done before")
    if summary.workers_lost or summary.retried:
        again = f"{counted(summary.retried, 'partition')} {'was' if summary.retried == 1 else 'were'} done again"
        lines.append(f"{counted(summary.workers_lost, 'worker')} died or left; {again}")
    return lines
