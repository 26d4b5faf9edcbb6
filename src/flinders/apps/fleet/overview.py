"""What a report of a fleet shows: its table in numbers that fit on a page, and how its units changed.

Counts add, so that a table of any length is gone through in parts:

>>> whole = Histogram.over(0.01, 100.0, 40).counted([0.2, 0.3, 5.0])
>>> parts = Histogram.over(0.01, 100.0, 40).counted([0.2]) + Histogram.over(0.01, 100.0, 40).counted([0.3, 5.0])
>>> whole.counts == parts.counts, whole.total
(True, 3)

A batch stands out where its share of rows without a good verdict is more than chance explains:

>>> standing_out({"A": {"good": 950, "refused": 50}, "B": {"good": 60, "refused": 40}})
{'B': True}
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Container, Mapping

    from numpy.typing import ArrayLike

    from flinders.apps.fleet.not_good import NotGood

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


@dataclass(frozen=True, slots=True)
class Histogram:
    """Numbers counted in classes whose ends grow by one factor; what lies beyond counts in the outermost."""

    low: float  # end of the first class
    high: float  # end of the last class
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
        quantiles = {
            "median": 0.5,  # half are below
            "p95": 0.95,  # 95 of 100 are below
            "p99": 0.99,  # 99 of 100 are below
        }
        count = {"count": self.total}  # of numbers
        return count | {name: self.quantile(share) for name, share in quantiles.items()}


@dataclass(frozen=True, slots=True)
class FleetUnit:
    """One row that a table of the report shows."""

    unit: str
    recording: str
    verdict: str
    worst_deg: float
    offset: float  # length, as a share of the field
    noise: float  # as a share of the field
    radius: float
    unit_of_field: str
    findings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Overview:
    """A table of a fleet in numbers that fit on a page."""

    tables: tuple[str, ...]  # names of the files
    rows: int
    units: int
    verdicts: Mapping[str, int]  # rows of each
    heading_deg: Histogram  # worst heading error
    offset: Histogram  # length, as a share of the field
    noise: Histogram  # as a share of the field
    field: Mapping[str, Histogram]  # field strengths, by their unit
    findings: Mapping[str, int]  # rows that have each
    codes: Mapping[str, tuple[int, str, str]]  # of those refused or failed: rows, one of the units, what was said of it
    methods: Mapping[str, int]
    batches: Mapping[str, Mapping[str, int]]  # rows of each verdict; empty where no hardware batches are known
    batch_source: str  # where the batch is taken from, in words
    groups: Mapping[str, Mapping[str, Mapping[str, int]]]  # the same by each property that tells groups of units apart
    not_good: tuple[NotGood, ...]  # the first recordings that are not good, refused and failed ones first
    worst: Mapping[str, tuple[FleetUnit, ...]]  # rows with the largest "heading error", "offset" and "noise"
    target_deg: float


@dataclass(frozen=True, slots=True)
class UnitDrift:
    """How one unit's newest calibration differs from its reference; angles are at the worst level heading."""

    unit: str  # name of the unit
    batch: str  # its hardware batch; empty if it is not known
    state: str  # one of the states in docs/fleet/drift.md
    recordings: int  # of which there is a calibration
    reference: str  # name of the recording that it is compared with
    newest: str  # name of the newest recording
    reference_s: float  # when that was made, since 1970; NaN where no date is known
    newest_s: float  # when that was made, since 1970
    worst_deg: float  # difference in heading
    rms_deg: float  # over all headings
    sigma_deg: float  # 1 σ of the worst
    offset_deg: float  # of the change of the offset alone
    offset_sigma_deg: float  # 1 σ
    matrix_deg: float  # of the change of the matrix alone
    matrix_sigma_deg: float  # 1 σ
    offset_change: float  # how far the offset went, in `unit_of_field`
    p_value: float  # how often chance makes as much
    unit_of_field: str  # ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class UnitStep:
    """A step of a unit's offset between two recordings."""

    unit: str  #: name of the unit
    before: str  # name of the recording before the step
    after: str  #: name of the recording after the step
    before_s: float  # when that was made, since 1970; NaN where no date is known
    after_s: float  #: when that was made, since 1970
    worst_deg: float  # what it turns the heading by, at the worst heading
    offset_change: tuple[float, ...]  # x, y, z, in `unit_of_field`
    p_value: float  #: how often chance alone makes as much
    unit_of_field: str  #: ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class BatchDrift:
    """How the units of one hardware batch changed."""

    batch: str  # empty for the units of which it is not known
    units: int  #: of the batch
    states: Mapping[str, int]  # units in each state that some are in
    step_units: int  # units that have a step
    verdicts: Mapping[str, int]  # recordings of each
    stands_out: tuple[str, ...]  # of what it has more than chance explains: "changes", "steps", "verdicts" not good

    @property
    def changed(self) -> int:
        """Units that changed by more than chance explains."""
        return self.states.get("recalibrate", 0) + self.states.get("changed", 0)

    @property
    def not_good(self) -> tuple[int, int]:
        """Recordings without a good verdict, of how many."""
        return count_bad(self.verdicts), sum(self.verdicts.values())


@dataclass(frozen=True, slots=True)
class Undated:
    """Units whose recordings have an order and no dates, and how these scatter."""

    units: int  # with two calibrations or more
    variance_factor: float  # factor on claimed variances
    random_walk_deg_per_root_recording: float  # 1 σ of the heading that slow drift makes from one recording to the next
    pairs: int  # of recordings that both rest on


@dataclass(frozen=True, slots=True)
class FleetDrift:
    """How a fleet changed."""

    units: int  #: in the tables
    calibrations: int  #: of all units
    without_calibration: int  # rows that give no calibration
    duplicates: int  # rows that a later table has as well
    states: Mapping[str, int]  # units in each of `STATES`
    change_deg: Histogram  # worst heading difference of units with two calibrations or more
    listed: tuple[UnitDrift, ...]  # to recalibrate, and unsure ones; the worst first, no more than were asked for
    steps: tuple[UnitStep, ...]  # the largest, no more than were asked for
    step_count: int  #: how many there are
    step_units: int  #: units that have one
    intervals: int  # between recordings, each tested for a step
    step_p_value_limit: float  # a step is reported below that
    change_p_value_limit: float  # a change is reported below that
    #: how often chance alone reports a change of a fleet in which nothing moved; and so of steps
    false_alarm_probability: float
    variance_factor: float  # factor on claimed variances, of units whose recordings have dates
    random_walk_deg_per_root_year: float  # 1 σ of the heading that their slow drift makes in a year
    pairs: int  # of recordings that both rest on
    undated: Undated  #: units whose recordings have no dates
    unordered: tuple[str, ...]  # units whose order of recordings is not known, no more than were asked for
    batches: tuple[BatchDrift, ...]  # by name; empty where none are known
    batch_source: str  # where the batch is taken from, in words
    target_deg: float  #: heading difference that is good enough
    dip_deg: float  #: of the field that it is judged at
    against: str  # "first" or "previous"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        return asdict(self) | {"change_deg": self.change_deg.as_dict()}


CHANCE: Final = 0.01


def standing_out(batches: Mapping[str, Mapping[str, int]]) -> dict[str, bool]:
    """Batches whose share without a good verdict is larger than that of all others, beyond what chance explains.

    Fisher's exact test of two shares, on the side of more, at `CHANCE` over the number of batches.
    """
    total = sum(sum(counts.values()) for counts in batches.values())
    bad = sum(count_bad(counts) for counts in batches.values())
    return {name: True for name, counts in batches.items() if _is_odd(counts, total, bad, len(batches))}


def _is_odd(counts: Mapping[str, int], total: int, bad: int, batches: int) -> bool:
    here, ours = sum(counts.values()), count_bad(counts)
    rest = total - here
    if not here or not rest or ours / here <= (bad - ours) / rest:
        return False
    return _as_many(ours, here, bad, total) < CHANCE / batches


def _as_many(ours: int, here: int, bad: int, total: int) -> float:
    """How often chance puts at least `ours` of the `bad` rows among `here` of `total`: the hypergeometric tail."""
    fine = total - bad
    first = math.exp(_choices(bad, ours) + _choices(fine, here - ours) - _choices(total, here))
    term = summed = 1.0
    for more in range(ours, min(here, bad)):
        term *= (bad - more) * (here - more) / ((more + 1.0) * (fine - here + more + 1.0))
        summed += term
        if term < 1e-12 * summed:
            break
    return first * summed


def _choices(many: int, few: int) -> float:
    """Logarithm of the binomial coefficient."""
    return math.lgamma(many + 1.0) - math.lgamma(few + 1.0) - math.lgamma(many - few + 1.0)


def count_bad(counts: Mapping[str, int], fine: Container[str] = ("good",)) -> int:
    """Rows of other kinds than the `fine` ones."""
    return sum(count for kind, count in counts.items() if kind not in fine)
