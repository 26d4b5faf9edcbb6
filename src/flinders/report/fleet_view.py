"""What a report of a fleet shows: counts, distributions and the units to look at first. Values; nothing is drawn here.

Counts add, so that a table of any length is gone through in parts:

>>> whole = Histogram.over(0.01, 100.0, 40).counted([0.2, 0.3, 5.0])
>>> parts = Histogram.over(0.01, 100.0, 40).counted([0.2]) + Histogram.over(0.01, 100.0, 40).counted([0.3, 5.0])
>>> whole.counts == parts.counts, whole.total
(True, 3)
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

STATES: Final = {
    "recalibrate": "the heading changed by more than the target, and by more than chance explains",
    "unsure": "changed by more than the target as far as was seen, or recorded too poorly to tell: record again",
    "changed": "changed by more than chance explains, and less than the target",
    "unordered": "nothing tells in what order it was recorded: put dates into the names of recordings",
    "steady": "did not change by more than chance explains",
    "single": "has one calibration alone",
    "none": "has no calibration",
}
"""What each state of a unit means, in the order of urgency."""
SUMS_ALONE: Final = (
    "outliers, drift and correlated residuals went unnoticed: headings are as good where there are none, but 3 "
    "times further off than claimed where residuals are correlated, and 10 times with 1 % of outliers"
)
"""What fits from sums alone, which tables of earlier releases may hold, have cost."""

PRINTED: Final = {"session": "claims_too_small", "walk_deg": "walk_deg_per_root_year"}
"""Names in JSON, where they are not those of the attributes."""
STEPS: Final = {
    "count": "step_count", "units": "step_units", "gaps": "gaps", "gap_chance": "step_chance", "largest": "steps",
}  # fmt: skip
"""What stands under ``steps`` in JSON, by the attribute."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Numbers counted in classes whose ends grow by one factor.

    Attributes
    ----------
    low, high : float
        Ends of the first and of the last class; what lies beyond is counted there.
    counts : tuple of int
    """

    low: float
    high: float
    counts: tuple[int, ...]

    @classmethod
    def over(cls, low: float, high: float, classes: int) -> Self:
        """Nothing counted yet."""
        return cls(low, high, (0,) * classes)

    @property
    def edges(self) -> tuple[float, ...]:
        """Ends of the classes, one more than there are classes."""
        return tuple(np.geomspace(self.low, self.high, len(self.counts) + 1).tolist())

    @property
    def total(self) -> int:
        """How many were counted."""
        return sum(self.counts)

    def counted(self, numbers: ArrayLike) -> Self:
        """With more numbers; those that are not known are left out."""
        values = np.asarray(numbers, float)
        values = values[np.isfinite(values)].clip(self.low, self.high)
        counts, _ = np.histogram(values, np.array(self.edges))
        return replace(self, counts=tuple((np.array(self.counts) + counts).tolist()))

    def share_above(self, limit: float) -> float:
        """Share of the numbers above a limit, to the width of a class."""
        above = sum(count for edge, count in zip(self.edges[1:], self.counts, strict=True) if edge > limit)
        return above / self.total if self.total else 0.0

    def quantile(self, share: float) -> float:
        """The number that a share of all lies below, to the width of a class; NaN where there is none.

        >>> round(Histogram.over(1.0, 100.0, 200).counted(np.linspace(1.0, 99.0, 981)).quantile(0.5))
        50
        """
        if not self.total:
            return float("nan")
        below = np.concatenate([[0.0], np.cumsum(self.counts) / self.total])
        return float(np.exp(np.interp(share, below, np.log(self.edges))))

    def __add__(self, other: Histogram) -> Histogram:
        counts = tuple(a + b for a, b in zip(self.counts, other.counts, strict=True))
        return Histogram(self.low, self.high, counts)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: median and tails."""
        return {
            "count": self.total,
            "median": self.quantile(0.5),
            "p95": self.quantile(0.95),
            "p99": self.quantile(0.99),
        }


@dataclass(frozen=True, slots=True)
class FleetUnit:
    """One row that a table of the report shows.

    Attributes
    ----------
    unit, recording : str
    verdict, code, message : str
    worst_deg : float, degrees
    offset : float
        Length of the offset as a share of the field.
    noise : float
        As a share of the field.
    radius : float
    unit_of_field : str
    findings : tuple of str
    """

    unit: str
    recording: str
    verdict: str
    code: str
    message: str
    worst_deg: float
    offset: float
    noise: float
    radius: float
    unit_of_field: str
    findings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Overview:
    """A table of a fleet in numbers that fit on a page.

    Attributes
    ----------
    tables : tuple of str
        Names of the files.
    rows, units : int
    verdicts : mapping of str to int
        Rows of each verdict.
    heading_deg, offset, noise : Histogram
        Worst heading error in degrees; length of the offset and noise as shares of the field.
    field : mapping of str to Histogram
        Field strengths by their unit.
    findings : mapping of str to int
        Rows that have each.
    codes : mapping of str to (int, str, str)
        Rows that were refused or failed for each reason, one of the units, and what was said of it.
    methods : mapping of str to int
    batches : mapping of str to mapping of str to int
        Rows of each verdict in each hardware batch; empty where no batches are known.
    batch_of : str
        Where the batch is taken from, in words.
    worst : mapping of str to tuple of FleetUnit
        Rows that have the largest ``heading error``, ``offset`` and ``noise``.
    target_deg : float
    """

    tables: tuple[str, ...]
    rows: int
    units: int
    verdicts: Mapping[str, int]
    heading_deg: Histogram
    offset: Histogram
    noise: Histogram
    field: Mapping[str, Histogram]
    findings: Mapping[str, int]
    codes: Mapping[str, tuple[int, str, str]]
    methods: Mapping[str, int]
    batches: Mapping[str, Mapping[str, int]]
    batch_of: str
    worst: Mapping[str, tuple[FleetUnit, ...]]
    target_deg: float


@dataclass(frozen=True, slots=True)
class UnitDrift:
    """How one unit's newest calibration differs from its reference.

    Attributes
    ----------
    unit, batch, state : str
    recordings : int
        Of which there is a calibration.
    reference, newest : str
        The two recordings.
    reference_s, newest_s : float, s
        When they were made, since 1970; NaN where no date is known.
    worst_deg, rms_deg : float
        Difference in heading.
    sigma_deg : float
        1 σ of that at the worst heading.
    offset_deg, offset_sigma_deg, matrix_deg, matrix_sigma_deg : float
        Of the change of the offset, and of the matrix, alone; at the worst heading.
    moved : float, in `unit_of_field`
        How far the offset went.
    p_value : float
        How often chance makes as much.
    unit_of_field : str
    """

    unit: str
    batch: str
    state: str
    recordings: int
    reference: str
    newest: str
    reference_s: float
    newest_s: float
    worst_deg: float
    rms_deg: float
    sigma_deg: float
    offset_deg: float
    offset_sigma_deg: float
    matrix_deg: float
    matrix_sigma_deg: float
    moved: float
    p_value: float
    unit_of_field: str


@dataclass(frozen=True, slots=True)
class UnitStep:
    """A step of a unit's offset between two recordings.

    Attributes
    ----------
    unit : str
    before, after : str
        The recordings.
    before_s, after_s : float, s
        When they were made, since 1970; NaN where no date is known.
    worst_deg : float
        What the step turns the heading by, at the worst heading.
    moved : 3 float, in `unit_of_field`
    p_value : float
    unit_of_field : str
    """

    unit: str
    before: str
    after: str
    before_s: float
    after_s: float
    worst_deg: float
    moved: tuple[float, ...]
    p_value: float
    unit_of_field: str


@dataclass(frozen=True, slots=True)
class BatchDrift:
    """How the units of one hardware batch changed.

    Attributes
    ----------
    batch : str
        Empty for the units of which it is not known.
    units : int
    states : mapping of str to int
        Units in each state that some are in.
    stepped : int
        Units that have a step.
    verdicts : mapping of str to int
        Recordings of each verdict.
    stands_out : tuple of str
        What it has more of than the others, beyond what chance explains: ``changes``, ``steps``, and ``verdicts`` that
        are not good.
    """

    batch: str
    units: int
    states: Mapping[str, int]
    stepped: int
    verdicts: Mapping[str, int]
    stands_out: tuple[str, ...]

    @property
    def changed(self) -> int:
        """Units that changed by more than chance explains."""
        return self.states.get("recalibrate", 0) + self.states.get("changed", 0)

    @property
    def not_good(self) -> tuple[int, int]:
        """Recordings without a good verdict, of how many."""
        count = sum(self.verdicts.values())
        return count - self.verdicts.get("good", 0), count


@dataclass(frozen=True, slots=True)
class Undated:
    """Units whose recordings have an order and no dates, and how these scatter.

    Attributes
    ----------
    units : int
        With two calibrations or more.
    session : float
        Factor on claimed variances.
    walk_deg : float
        1 σ of the heading that slow drift makes from one recording to the next.
    pairs : int
        Of recordings that both rest on.
    """

    units: int
    session: float
    walk_deg: float
    pairs: int

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        printed = PRINTED | {"walk_deg": "walk_deg_per_root_recording"}
        return {printed.get(name, name): value for name, value in asdict(self).items()}


@dataclass(frozen=True, slots=True)
class FleetDrift:
    """How a fleet changed.

    Attributes
    ----------
    units, calibrations, left_out, passed_over : int
        Rows that give no calibration are left out; those that a later table has as well are passed over.
    states : mapping of str to int
        Units in each state of `STATES`.
    change_deg : Histogram
        Worst heading difference of units with two calibrations or more, in degrees.
    listed : tuple of UnitDrift
        Units to recalibrate and those unsure, the worst first; no more than were asked for.
    steps : tuple of UnitStep
        The largest steps, no more than were asked for.
    step_count, step_units, gaps : int
        All steps, the units that have one, and the gaps that were tested.
    step_chance, change_chance : float
        A gap, or a change, is reported where chance makes as much less often.
    chance : float
        How often chance alone reports anything of a fleet in which nothing moved; for changes and for steps each.
    session : float
        Factor on claimed variances, of units whose recordings have dates.
    walk_deg : float
        1 σ of the heading that their slow drift makes in a year.
    pairs : int
        Of recordings that both rest on.
    undated : Undated
        The same of units whose recordings have no dates.
    unordered : tuple of str
        Units whose order of recordings is not known, no more than were asked for.
    batches : tuple of BatchDrift
        By name; empty where no batches are known.
    batch_of : str
        Where the batch is taken from, in words.
    target_deg, dip_deg : float
    against : str
        ``first`` or ``previous``.
    """

    units: int
    calibrations: int
    left_out: int
    passed_over: int
    states: Mapping[str, int]
    change_deg: Histogram
    listed: tuple[UnitDrift, ...]
    steps: tuple[UnitStep, ...]
    step_count: int
    step_units: int
    gaps: int
    step_chance: float
    change_chance: float
    chance: float
    session: float
    walk_deg: float
    pairs: int
    undated: Undated
    unordered: tuple[str, ...]
    batches: tuple[BatchDrift, ...]
    batch_of: str
    target_deg: float
    dip_deg: float
    against: str

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        fields: dict[str, Any] = asdict(self) | {
            "change_deg": self.change_deg.as_dict(),
            "undated": self.undated.as_dict(),
        }
        fields["steps"] = {name: fields.pop(field) for name, field in STEPS.items()}
        fields["batches"] = {"told_by": fields.pop("batch_of"), "each": fields["batches"]}
        return {PRINTED.get(name, name): value for name, value in fields.items()}
