"""What there is in the table of a fleet, counted batch by batch.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.fleet.merge import merge
>>> from flinders.fleet.table import Row, Rows
>>> folder = Path(tempfile.mkdtemp())
>>> rows = [Row(unit="A1", verdict="good", worst_deg=0.4), Row(unit="A2", code="unreadable"), Row(unit="A2")]
>>> _ = (folder / "part").write_bytes(Rows.of(rows).to_bytes())
>>> merge([folder / "part"], folder / "all.parquet")
>>> counts = Counts.of(folder / "all.parquet")
>>> counts.rows, counts.units, counts.texts["verdict"], counts.worst_deg.tolist()
(3, 2, Counter({'failed': 2, 'good': 1}), [0.4])
>>> counts.failed_readings
0
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.fleet.batches import of_units
from flinders.fleet.table import VERDICTS, needs_arrow

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

COUNTED: Final = ("verdict", "code", "findings", "unit_of_field")
"""Columns of few texts that occur often."""


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """Counts over a table.

    Attributes
    ----------
    rows, readings, units : int
        Of units those that have a name.
    failed_readings : int
        Of the readings those of rows that failed, as far as it is known how many there are.
    texts : dict of Counter
        By the columns `COUNTED`: how many rows there are of each text; with each finding.
    worst_deg : (K,) degrees
        Heading errors of those that are good or limited.
    """

    rows: int
    readings: int
    units: int
    failed_readings: int
    texts: dict[str, Counter[str]]
    worst_deg: Floats

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> Self:
        """Count in a Parquet file, which is sorted by unit; memory is that of a batch, and of `worst_deg`."""
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
                    counter.update(_counted(batch.column(name)))
                worst.append(_worst(batch))
                counts = batch.column("readings").to_numpy()
                readings += int(np.sum(counts))
                failed += int(np.sum(counts[_is_among(batch, VERDICTS[3:])]))
                unit = of_units(batch).column("unit")
                if len(unit):
                    units += len(unit.unique()) - (unit[0].as_py() == last)
                    last = unit[-1].as_py()
            return cls(file.metadata.num_rows, readings, units, failed, texts, np.concatenate(worst))


def _counted(column: Any) -> dict[str, int]:  # noqa: ANN401 - pyarrow ships no types
    """How often each text occurs in a column, or in the lists of one."""
    values = column.flatten() if hasattr(column, "flatten") else column
    return {each["values"]: each["counts"] for each in values.value_counts().to_pylist()}


def _worst(batch: Any) -> Floats:  # noqa: ANN401
    """Heading errors of a batch that are known, of those that have a calibration."""
    worst: Floats = np.asarray(batch.column("worst_deg").to_numpy(zero_copy_only=False), dtype=float)
    known: Floats = worst[_is_among(batch, VERDICTS[:2]) & np.isfinite(worst)]
    return known


def _is_among(batch: Any, verdicts: Sequence[str]) -> NDArray[np.bool_]:  # noqa: ANN401
    """(R,) whether rows of a batch have one of these verdicts."""
    from pyarrow import array, compute

    among: NDArray[np.bool_] = compute.is_in(batch.column("verdict"), value_set=array(verdicts)).to_numpy(False)
    return among
