"""A fleet as one HTML file: what to do first, then how good its compasses are, and what was refused and why.

The file needs nothing else: no server, no network, and no script but that of the button for light and dark. Tables are
sorted by choosing one of several orders, which a browser does without a script. What comes from files is escaped, and a
Content-Security-Policy lets nothing run but the page's own script. Its size does not grow with the fleet.

Values that are shown come from `flinders.apps.fleet`. Counts add, so that a table of any length is gone through in
parts:

>>> whole = Histogram.over(0.01, 100.0, 40).counted([0.2, 0.3, 5.0])
>>> parts = Histogram.over(0.01, 100.0, 40).counted([0.2]) + Histogram.over(0.01, 100.0, 40).counted([0.3, 5.0])
>>> whole.counts == parts.counts, whole.total
(True, 3)

A batch stands out where its share of rows without a good verdict is more than chance explains:

>>> standing_out({"A": {"good": 950, "refused": 50}, "B": {"good": 60, "refused": 40}})
{'B': True}
>>> figure = distribution(whole, "degrees", target=1.0)
>>> figure.startswith("<svg"), "style=" in figure
(True, False)
"""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.units import label
from flinders.errors import counted, figures, percent
from flinders.findings import CATALOGUE, action
from flinders.findings.row import TUMBLE_STATED
from flinders.report.charts import Axis, Plot, chart, segment, text
from flinders.report.formatting import as_sentence, date_of, degrees
from flinders.report.html_file import html_file, script_of, style_of

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

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
        return _bad(self.verdicts), sum(self.verdicts.values())


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


# ----------------------------------------------------------------------------------------------------------- the page

VERDICTS: Final = {
    "good": "good",
    "limited": "good with limits",
    "refused": "refused: no calibration",
    "failed": "failed: could not be read",
}
CHANGES: Final = ("steady", "single", "none", "unordered", "unsure", "changed", "recalibrate")
"""States of units in the order of a bar; the last two are changes."""
SHOWN: Final = 4
"""Findings of a unit that are named; the others are counted."""
FAIR: Final = 0.02
"""Share of recordings without a calibration up to which a fleet is called good."""


def page(overview: Overview, drift: FleetDrift | None = None) -> str:
    """Write a fleet as one HTML file, with how its units changed where that is known."""
    given = {
        "overview": overview,
        "drift": drift,
        "notes": [] if drift is None else [as_sentence(words) for words in about_order(drift)],
        "fair": FAIR,
        "units": None if drift is None else _orders(drift),
        "unit_of_units": "" if drift is None else common_unit(drift.listed),
        "unit_of_steps": "" if drift is None else common_unit(drift.steps),
        "states": STATES,
        "figures": _figures(overview, drift),
        "verdicts": VERDICTS,
        "condition": TUMBLE_STATED,
        "changes": CHANGES,
        "most_findings": SHOWN,
        "catalogue": CATALOGUE,
        "odd_states": [] if drift is None else _odd(drift)[:10],
        "odd_batches": sorted(standing_out(overview.batches)),
        "date": date_of(datetime.now(UTC)),
        "release": version("flinders"),
    }
    style = style_of("apps/fleet/fleet.css")
    return html_file("apps/fleet/fleet.html.j2", given, style=style, script=script_of(), filters=FILTERS)


def when(seconds: float) -> str:
    """Write the day of a time since 1970; a dash where none is known."""
    if not math.isfinite(seconds):
        return "–"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d}"


def chance(p_value: float) -> str:
    """How often chance makes as much.

    >>> chance(3e-20), chance(0.0312), chance(2.5e-6)
    ('< 1e-12', '0.031', '2.5e-06')
    """
    return "< 1e-12" if p_value < 1e-12 else f"{p_value:.2g}"


# ------------------------------------------------------------------------------------------------------------- words


def common_unit(rows: Sequence[UnitDrift | UnitStep]) -> str:
    """The unit of field that all rows have, which then stands in the heading; empty where units differ."""
    units = {label(row.unit_of_field) for row in rows}
    return units.pop() if len(units) == 1 else ""


def about_order(drift: FleetDrift) -> list[str]:
    """Say of which units no dates or no order are known, and what was counted once; a sentence each."""
    remarks = []
    if drift.undated.units:
        remarks.append(
            f"no dates are known of {counted(drift.undated.units, 'unit')}: recordings are taken in the order of their "
            "names, nothing is told by the day, and a step may be drift over a long time"
        )
    if count := drift.states["unordered"]:
        some = ", ".join(drift.unordered[:5]) + (" and others" if count > 5 else "")
        remarks.append(
            f"the order of recordings is not known of {counted(count, 'unit')} ({some}): nothing is told of them; put "
            "dates into the names of recordings"
        )
    if drift.duplicates:
        remarks.append(
            f"{counted(drift.duplicates, 'row')} passed over: the same recordings stand in a table named later, or "
            "further down, and count once"
        )
    return remarks


def _orders(drift: FleetDrift) -> list[tuple[str, list[UnitDrift]]]:
    """The listed units in each order that they can be seen in."""
    listed = list(drift.listed)
    return [
        ("urgency", listed),
        ("change", sorted(listed, key=lambda one: -one.worst_deg)),
        ("sureness", sorted(listed, key=lambda one: -one.worst_deg / max(one.sigma_deg, 1e-12))),
        ("name", sorted(listed, key=lambda one: one.unit)),
    ]


def _odd(drift: FleetDrift) -> list[BatchDrift]:
    """Batches that stand out by how their units changed."""
    return [one for one in drift.batches if {"changes", "steps"} & set(one.stands_out)]


def _figures(overview: Overview, drift: FleetDrift | None) -> dict[str, Any]:
    """Figures, and rows of the maps of batches, by name; None of those that nothing is known for."""
    shown: dict[str, Any] = {
        "batches": batch_rows(overview.batches, ("good",), standing_out(overview.batches)),
        "change": None,
        "batch_states": None,
        "distributions": _distributions(overview),
    }
    if drift is not None and drift.batches:
        states = {one.batch: one.states for one in drift.batches}
        shown["batch_states"] = batch_rows(states, CHANGES[:-2], {one.batch for one in _odd(drift)})
    if drift is not None and drift.change_deg.total:
        shown["change"] = distribution(drift.change_deg, "degrees", target=drift.target_deg)
    return shown


def _distributions(overview: Overview) -> list[tuple[str, str, str]]:
    """Title, words and figure of each number that a fleet has a distribution of."""
    fields = [
        (f"Field strength, {label(unit)}", counts, label(unit), "", None) for unit, counts in overview.field.items()
    ]
    listed = [
        ("Worst heading error", overview.heading_deg, "degrees, 1 σ", "°", overview.target_deg),
        ("Offset", overview.offset, "length, in field strengths", "", None),
        ("Noise", overview.noise, "% of the field", " %", None),
        *fields,
    ]
    return [
        (title, quantile_words(counts, unit), distribution(counts, words, target=target, factor=_factor(unit)))
        for title, counts, words, unit, target in listed
        if counts.total
    ]


def _factor(unit: str) -> float:
    """By which shown numbers are larger than those counted."""
    return 100.0 if unit == " %" else 1.0


def _share(value: float) -> str:
    """Write a share as a percentage; a dash where none is known."""
    return "–" if not math.isfinite(value) else f"{value:.1%}" if value < 1.0 else f"{value:.1f} ×"


# -------------------------------------------------------------------------------------------------------------- figures

WIDE, HIGH = 400, 190
MOST_BATCHES: Final = 240
"""Batches on the map; of more, those with the largest share without a good verdict."""
CHANCE: Final = 0.01
SEEN: Final = 0.004
"""Least share of a bar that is drawn: of a million, one that failed is seen."""


def distribution(histogram: Histogram, words: str, *, target: float | None = None, factor: float = 1.0) -> str:
    """Numbers counted on a logarithmic axis, with their median, and what is above the target in another colour.

    `words` stand below the axis, whose numbers are larger by `factor` than those counted.
    """
    low, high = _ends(histogram)
    edges, counts = histogram.edges[low : high + 1], histogram.counts[low:high]
    plot = Plot(16, 22, WIDE - 28, 124, Axis(edges[0], edges[-1], np.log), Axis(0.0, max(counts, default=1) or 1))
    is_above = [target is not None and first * last > target**2 for first, last in itertools.pairwise(edges)]
    parts = [plot.columns(_decades(edges[0], edges[-1], factor), gap=27)]
    for kind, is_kind in (("bar", False), ("bar above", True)):
        here = [count if above == is_kind else 0 for count, above in zip(counts, is_above, strict=True)]
        parts.append(plot.bars(kind, edges, here, least=0.8))
    parts.append(plot.level(0.0, "zero"))
    if target is not None and edges[0] < target < edges[-1]:
        x = plot.x(target)
        parts += [segment("aim", x, plot.top - 6, x, plot.bottom), text(x, plot.top - 10, "target", kind="name")]
    middle = histogram.quantile(0.5)
    if math.isfinite(middle):
        parts.append(text(plot.x(min(max(middle, edges[0]), edges[-1])), plot.bottom + 14, "▲", kind="name"))
    return chart(WIDE, HIGH, f"Distribution: {words}", *parts, text(plot.middle, HIGH - 4, words))


def shares(counts: Mapping[str, int], kinds: Sequence[str] = tuple(VERDICTS)) -> list[tuple[str, float, float]]:
    """Kind, place and width of each part of a bar that is 1000 wide, the kinds in their order.

    >>> shares({"refused": 1, "good": 3})
    [('good', 0.0, 750.0), ('refused', 750.0, 250.0)]
    """
    known = [kind for kind in kinds if counts.get(kind)]
    total = sum(counts[kind] for kind in known)
    widths = [max(counts[kind] / total, SEEN) for kind in known]
    whole = sum(widths) or 1.0
    ends = [1000.0 * end / whole for end in itertools.accumulate(widths, initial=0.0)]
    return [(kind, x, end - x) for kind, (x, end) in zip(known, itertools.pairwise(ends), strict=True)]


def listed_counts(counts: Mapping[str, int], kinds: Sequence[str] = tuple(VERDICTS)) -> str:
    """How many there are of each kind, in words.

    >>> listed_counts({"refused": 2, "good": 1500})
    '1,500 good, 2 refused'
    """
    return ", ".join(f"{counts[kind]:,} {kind}" for kind in kinds if counts.get(kind))


def batch_rows(
    batches: Mapping[str, Mapping[str, int]], fine: Container[str], odd: Container[str]
) -> list[tuple[str, Mapping[str, int], str, bool]]:
    """Name, counts, share of what is not fine, and whether it stands out, of each batch that is shown."""
    return [
        (name, batches[name], percent(_bad(batches[name], fine), sum(batches[name].values())), name in odd)
        for name in shown_batches(batches, fine)
    ]


def shown_batches(batches: Mapping[str, Mapping[str, int]], fine: Container[str] = ("good",)) -> list[str]:
    """Names of the batches that the map has room for, sorted."""

    def spoilt(name: str) -> float:
        return _bad(batches[name], fine) / max(sum(batches[name].values()), 1)

    worst = sorted(batches, key=lambda name: (-spoilt(name), name))[:MOST_BATCHES]
    return sorted(worst)


def standing_out(batches: Mapping[str, Mapping[str, int]]) -> dict[str, bool]:
    """Batches whose share without a good verdict is larger than that of all others, beyond what chance explains.

    Fisher's exact test of two shares, on the side of more, at `CHANCE` over the number of batches.
    """
    total = sum(sum(counts.values()) for counts in batches.values())
    bad = sum(_bad(counts) for counts in batches.values())
    return {name: True for name, counts in batches.items() if _is_odd(counts, total, bad, len(batches))}


def _is_odd(counts: Mapping[str, int], total: int, bad: int, batches: int) -> bool:
    here, ours = sum(counts.values()), _bad(counts)
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


def _bad(counts: Mapping[str, int], fine: Container[str] = ("good",)) -> int:
    return sum(count for kind, count in counts.items() if kind not in fine)


def _ends(histogram: Histogram) -> tuple[int, int]:
    """First class that holds something, and the one after the last; a third of a decade wide at the least."""
    filled = [place for place, count in enumerate(histogram.counts) if count]
    low, high = (filled[0], filled[-1] + 1) if filled else (0, len(histogram.counts))
    least = math.ceil(len(histogram.counts) / math.log10(histogram.high / histogram.low) / 3.0)
    while high - low < min(least, len(histogram.counts)):
        low, high = max(low - 1, 0), min(high + 1, len(histogram.counts))
    return max(low - 1, 0), min(high + 1, len(histogram.counts))


def _decades(low: float, high: float, factor: float) -> list[tuple[float, str]]:
    """Round numbers of each decade from `low` to `high`, and what stands at each: `factor` times that."""
    first, last = low * factor, high * factor
    decades = range(math.floor(math.log10(first)), math.ceil(math.log10(last)) + 1)
    fine = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
    steps = fine if high / low < 8.0 else (1.0, 2.0, 5.0) if high / low < 300.0 else (1.0,)
    values = (step * 10.0**decade for decade in decades for step in steps)
    return [(value / factor, f"{value:,.6g}") for value in values if first <= value <= last]


def quantile_words(histogram: Histogram, unit: str) -> str:
    """Median and 95th percentile in words.

    >>> quantile_words(Histogram.over(0.01, 100.0, 400).counted([0.5] * 9 + [2.0] * 91), "°")
    'median 2.0°, 95 % below 2.0°'
    """
    if not histogram.total:
        return "none is known"
    middle, most = (figures(_factor(unit) * histogram.quantile(share)) for share in (0.5, 0.95))
    return f"median {middle}{unit}, 95 % below {most}{unit}"


FILTERS: Final = {
    "counted": counted, "figures": figures, "degrees": degrees, "day": when, "share": _share, "label": label,
    "chance": chance, "percent": percent, "shares": shares, "listed": listed_counts, "action": action,
}  # fmt: skip
"""How the page writes numbers."""
