"""Contents of a fleet's report: counts and histograms of its table, and the drift of its units.

Counts add, so that a table of any length is read in parts:

>>> empty = Histogram.over(0.01, 100.0, 40)
>>> whole = empty.with_numbers([0.2, 0.3, 5.0])
>>> parts = empty.with_numbers([0.2]) + empty.with_numbers([0.3, 5.0])
>>> whole.counts == parts.counts, whole.total
(True, 3)

A batch stands out if its share of rows without a good verdict is significantly larger than that of the others:

>>> outlying_batches({"A": {"good": 950, "refused": 50}, "B": {"good": 60, "refused": 40}})
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
    "unsure": "seems to have changed by more than the target, but the recordings are too poor to decide: record again",
    "changed": "changed by more than chance explains, and less than the target",
    "unordered": "the order of its recordings is not known: put dates into the names of recordings",
    "steady": "did not change by more than chance explains",
    "single": "has only one calibration",
    "none": "has no calibration",
}
"""Meaning of each state of a unit, the most urgent first."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts of numbers in logarithmic classes; numbers beyond the ends count in the outermost classes."""

    low: float  # end of the first class
    high: float  # end of the last class
    counts: tuple[int, ...]

    @classmethod
    def over(cls, low: float, high: float, classes: int) -> Self:
        """Make a histogram without counts."""
        return cls(low, high, (0,) * classes)

    @property
    def edges(self) -> tuple[float, ...]:
        """Edges of the classes, one more than there are classes."""
        return tuple(np.geomspace(self.low, self.high, len(self.counts) + 1).tolist())

    @property
    def total(self) -> int:
        """Number of counted values."""
        return sum(self.counts)

    def with_numbers(self, numbers: ArrayLike) -> Self:
        """Histogram with more numbers counted; NaN and infinity are left out."""
        values = np.asarray(numbers, float)
        values = values[np.isfinite(values)].clip(self.low, self.high)
        counts, _ = np.histogram(values, np.array(self.edges))
        return replace(self, counts=tuple((np.array(self.counts) + counts).tolist()))

    def share_above(self, limit: float) -> float:
        """Share of the numbers above a limit, to the width of a class."""
        above = sum(count for edge, count in zip(self.edges[1:], self.counts, strict=True) if edge > limit)
        return above / self.total if self.total else 0.0

    def quantile(self, share: float) -> float:
        """Quantile: the number below which this share of all lies, to the width of a class; NaN without numbers.

        >>> round(Histogram.over(1.0, 100.0, 200).with_numbers(np.linspace(1.0, 99.0, 981)).quantile(0.5))
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
        """JSON-ready count, median and upper quantiles."""
        quantiles = {
            "median": 0.5,  # half of the values are below
            "p95": 0.95,  # 95 % of the values are below
            "p99": 0.99,  # 99 % of the values are below
        }
        count = {"count": self.total}  # number of values
        return count | {name: self.quantile(share) for name, share in quantiles.items()}


@dataclass(frozen=True, slots=True)
class FleetUnit:
    """One unit in a list of worst units of the report."""

    unit: str
    recording: str
    verdict: str
    worst_deg: float
    offset: float  # length, as a share of the field
    noise: float  # as a share of the field
    radius: float  # field strength, in `unit_of_field`
    unit_of_field: str
    findings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Overview:
    """Counts and histograms of a fleet's table."""

    tables: tuple[str, ...]  # names of the files
    rows: int
    units: int
    verdicts: Mapping[str, int]  # rows of each verdict
    heading_deg: Histogram  # worst heading error
    offset: Histogram  # length, as a share of the field
    noise: Histogram  # as a share of the field
    field: Mapping[str, Histogram]  # field strengths, by their unit
    findings: Mapping[str, int]  # rows with each finding
    codes: Mapping[str, tuple[int, str, str]]  # by error code: number of rows, one of the units, its message
    methods: Mapping[str, int]  # rows of each method
    batches: Mapping[str, Mapping[str, int]]  # rows by batch and verdict; empty if no hardware batches are known
    batch_source: str  # source of the batch, in words
    groups: Mapping[str, Mapping[str, Mapping[str, int]]]  # rows by property, its value and verdict
    not_good: tuple[NotGood, ...]  # the first recordings that are not good, refused and failed ones first
    worst: Mapping[str, tuple[FleetUnit, ...]]  # rows with the largest "heading error", "offset" and "noise"
    target_deg: float


@dataclass(frozen=True, slots=True)
class UnitDrift:
    """Difference of one unit's newest calibration from its reference; angles are at the worst level heading."""

    unit: str  # name of the unit
    batch: str  # its hardware batch; empty if it is not known
    state: str  # one of the states in docs/fleet/drift.md
    recordings: int  # number of recordings with a calibration
    reference: str  # name of the recording that it is compared with
    newest: str  # name of the newest recording
    reference_s: float  # date of the reference recording, since 1970; NaN if it is not known
    newest_s: float  # date of the newest recording, since 1970; NaN if it is not known
    worst_deg: float  # largest difference in heading
    rms_deg: float  # RMS difference over all headings
    sigma_deg: float  # 1 σ of the largest difference
    offset_deg: float  # difference from the change of the offset alone
    offset_sigma_deg: float  # 1 σ of that difference
    matrix_deg: float  # difference from the change of the matrix alone
    matrix_sigma_deg: float  # 1 σ of that difference
    offset_change: float  # length of the change of the offset, in `unit_of_field`
    p_value: float  # probability of such a change, or a larger one, by chance
    unit_of_field: str  # ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class UnitStep:
    """A step of a unit's offset between two recordings."""

    unit: str  #: name of the unit
    before: str  # name of the recording before the step
    after: str  #: name of the recording after the step
    before_s: float  # date of the recording before, since 1970; NaN if it is not known
    after_s: float  #: date of the recording after, since 1970; NaN if it is not known
    worst_deg: float  # change of heading by the step, at the worst heading
    offset_change: tuple[float, ...]  # x, y, z, in `unit_of_field`
    p_value: float  #: probability of such a step, or a larger one, by chance
    unit_of_field: str  #: ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class BatchDrift:
    """Drift of the units of one hardware batch."""

    batch: str  # name of the batch; empty for units whose batch is not known
    units: int  #: number of units in the batch
    states: Mapping[str, int]  # number of units by state
    step_units: int  # units with a step
    verdicts: Mapping[str, int]  # recordings by verdict
    stands_out: tuple[str, ...]  # kinds that are significantly frequent: "changes", "steps", "verdicts" not good

    @property
    def changed_units(self) -> int:
        """Number of units that changed by more than chance explains."""
        return self.states.get("recalibrate", 0) + self.states.get("changed", 0)

    @property
    def not_good(self) -> tuple[int, int]:
        """Number of recordings without a good verdict, and number of all."""
        return count_bad(self.verdicts), sum(self.verdicts.values())


@dataclass(frozen=True, slots=True)
class Undated:
    """Units whose recordings have an order but no dates, and the scatter of these recordings."""

    units: int  # units with two calibrations or more
    variance_factor: float  # factor on claimed variances
    random_walk_deg_per_root_recording: float  # 1 σ change of heading by slow drift from one recording to the next
    pairs: int  # pairs of recordings from which both are estimated


@dataclass(frozen=True, slots=True)
class FleetDrift:
    """Result of a comparison of a fleet's calibrations over time: changed units, steps, and drift."""

    units: int  #: number of units in the tables
    calibrations: int  #: number of calibrations of all units
    without_calibration: int  # rows without a calibration
    duplicates: int  # rows of recordings that a later table has too
    states: Mapping[str, int]  # units in each of `STATES`
    change_deg: Histogram  # worst heading difference of units with two calibrations or more
    listed: tuple[UnitDrift, ...]  # the first units to recalibrate, then unsure ones, the worst first
    steps: tuple[UnitStep, ...]  # the largest steps
    step_count: int  #: number of all steps
    step_units: int  #: number of units with a step
    intervals: int  # number of intervals between recordings, each tested for a step
    step_p_value_limit: float  # a step with a smaller p value is reported
    change_p_value_limit: float  # a change with a smaller p value is reported
    #: probability of any reported change in a fleet in which nothing moved; the same for steps
    false_alarm_probability: float
    variance_factor: float  # factor on claimed variances, for units whose recordings have dates
    random_walk_deg_per_root_year: float  # 1 σ change of heading by slow drift in a year, for these units
    pairs: int  # pairs of recordings from which both are estimated
    undated: Undated  #: units whose recordings have no dates
    unordered: tuple[str, ...]  # the first units whose order of recordings is not known
    batches: tuple[BatchDrift, ...]  # drift by batch, sorted by name; empty if no batches are known
    batch_source: str  # source of the batch, in words
    target_deg: float  #: heading difference that is good enough
    dip_deg: float  #: dip of the field at which headings are compared
    against: str  # recording of each unit that the newest is compared with: "first" or "previous"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, as ``--json`` prints them."""
        return asdict(self) | {"change_deg": self.change_deg.as_dict()}


FALSE_ALARM_PROBABILITY: Final = 0.01
"""Probability that any batch stands out by chance."""


def outlying_batches(batches: Mapping[str, Mapping[str, int]]) -> dict[str, bool]:
    """Batches whose share without a good verdict is significantly larger than that of all others.

    One-sided Fisher's exact test of two shares, at `FALSE_ALARM_PROBABILITY` over the number of batches.
    """
    total = sum(sum(counts.values()) for counts in batches.values())
    bad = sum(count_bad(counts) for counts in batches.values())
    return {name: True for name, counts in batches.items() if _is_odd(counts, total, bad, len(batches))}


def _is_odd(counts: Mapping[str, int], total: int, bad: int, batches: int) -> bool:
    here, ours = sum(counts.values()), count_bad(counts)
    rest = total - here
    if not here or not rest or ours / here <= (bad - ours) / rest:
        return False
    return _tail_probability(ours, here, bad, total) < FALSE_ALARM_PROBABILITY / batches


def _tail_probability(ours: int, here: int, bad: int, total: int) -> float:
    """Probability by chance that at least `ours` of `here` rows are bad, if `bad` of all `total` rows are.

    It is the tail of the hypergeometric distribution.
    """
    fine = total - bad
    first = math.exp(_log_binomial(bad, ours) + _log_binomial(fine, here - ours) - _log_binomial(total, here))
    term = summed = 1.0
    for more in range(ours, min(here, bad)):
        term *= (bad - more) * (here - more) / ((more + 1.0) * (fine - here + more + 1.0))
        summed += term
        if term < 1e-12 * summed:
            break
    return first * summed


def _log_binomial(many: int, few: int) -> float:
    """Logarithm of the binomial coefficient."""
    return math.lgamma(many + 1.0) - math.lgamma(few + 1.0) - math.lgamma(many - few + 1.0)


def count_bad(counts: Mapping[str, int], fine: Container[str] = ("good",)) -> int:
    """Number of rows whose kind is not among the `fine` ones."""
    return sum(count for kind, count in counts.items() if kind not in fine)
