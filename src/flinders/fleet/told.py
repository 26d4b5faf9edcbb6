"""What came of a run: what stands in its table, and how it went."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.fleet.table import VERDICTS
from flinders.report.fleet_view import SUMS_ALONE

if TYPE_CHECKING:
    from collections import Counter

    from flinders.fleet.counts import Counts
    from flinders.fleet.plan import Plan
    from flinders.fleet.tables import Asked


@dataclass(frozen=True, slots=True)
class Told:
    """What came of a run, as it stands in the table, and how it went.

    Attributes
    ----------
    output : str
    files, partitions : int
    units, rows, readings : int
        Units, their recordings, which are the rows of the table, and readings.
    failed_readings : int
        Of the readings those of recordings that failed: what cannot be read has as many as its footer says.
    verdicts, codes, findings, units_of_field : dict
        How many rows there are of each verdict, error code, finding and unit of field.
    worst_deg : dict
        ``median``, ``p95`` and ``largest`` of the worst heading error of those that are good or limited.
    left_out : dict
        Files of other kinds, by their endings.
    polish : bool
        Whether readings were gone through again, or the fits are from their sums alone.
    resumed : int
        Partitions that an earlier run had done.
    workers_lost : int
        Workers that died, or left the cluster.
    retried : int
        Partitions that were done again since their worker died; a cluster tells those alone that it gave up.
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
        """Every recording has a calibration."""
        return not self.codes

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        fields["units_per_s"] = self.units / self.seconds if self.seconds else None
        return fields if self.polish else {**fields, "sums_alone": SUMS_ALONE}


def told_of(
    out: str | os.PathLike[str],
    counted: Counts,
    plan: Plan,
    asked: Asked,
    *,
    resumed: int,
    workers_lost: int,
    retried: int,
    seconds: float,
) -> Told:
    """Put together what was read back of the table, and how the run went.

    Parameters
    ----------
    out : str or path
    counted : Counts
        Of the table that was written.
    plan : Plan
    asked : Asked
    resumed, workers_lost, retried, seconds
        As the attributes of `Told`.
    """
    worst = counted.worst_deg
    places = zip(("median", "p95", "largest"), np.percentile(worst, [50, 95, 100]) if len(worst) else (), strict=False)
    return Told(
        output=os.fspath(out),
        files=plan.files,
        partitions=len(plan.partitions),
        units=counted.units,
        rows=counted.rows,
        readings=counted.readings,
        failed_readings=counted.failed_readings,
        verdicts={name: counted.texts["verdict"][name] for name in VERDICTS if counted.texts["verdict"][name]},
        codes=_most_first(counted.texts["code"]),
        findings=_most_first(counted.texts["findings"]),
        units_of_field=_most_first(counted.texts["unit_of_field"]),
        worst_deg={name: float(value) for name, value in places},
        left_out=plan.left_out,
        polish=asked.polish,
        resumed=resumed,
        workers_lost=workers_lost,
        retried=retried,
        seconds=seconds,
    )


def _most_first(counts: Counter[str]) -> dict[str, int]:
    """The most frequent first, and nothing of what is empty."""
    return {name: count for name, count in sorted(counts.items(), key=lambda each: (-each[1], each[0])) if name}
