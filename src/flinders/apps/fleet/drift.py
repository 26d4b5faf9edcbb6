"""Drift of the units of a fleet, and change points, from several calibrations of each.

The newest calibration of a unit is compared with the one that the vehicle is assumed to carry, its first. Tables are
read twice, a bounded number of rows at a time: once for the variance between recordings of this fleet, then unit by
unit. Recordings without dates have a variance of their own; `flinders.apps.fleet.history` orders the recordings.

The rate of false alarms does not grow with the fleet. In a fleet of this size in which nothing moved, the probability
that any change, or any step, is reported is below `FALSE_ALARM_PROBABILITY`: an interval is tested at
`FALSE_ALARM_PROBABILITY` over the number of intervals, a unit at `FALSE_ALARM_PROBABILITY` over the number of units
(Bonferroni). docs/fleet/drift.md has the detectable changes.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.apps.fleet.change_points import MIN_PAIRS, YEAR_S, ChangePoint, PairSample, Variance, change_points
from flinders.apps.fleet.history import MAX_BATCHES, BatchRule, OffsetSeries, batch_rule, histories
from flinders.apps.fleet.overview import (
    STATES,
    BatchDrift,
    FleetDrift,
    Histogram,
    Undated,
    UnitDrift,
    UnitStep,
    outlying_batches,
)
from flinders.apps.fleet.results import VERDICTS
from flinders.comparison.pairs import Differences, differences, offset_heading_deg
from flinders.errors import UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.apps.fleet.history import Histories
    from flinders.arrays import Floats

FALSE_ALARM_PROBABILITY: Final = 0.01
"""Largest probability of a false alarm in a whole fleet, equal to that in a comparison of two calibrations."""
DIP_DEG: Final = 60.0
"""Dip of the field, in degrees, if the tables have none."""

Against = Literal["first", "previous"]


def drift_of(
    paths: Sequence[str | os.PathLike[str]],
    *,
    target_deg: float = 1.0,
    dip_deg: float | None = None,
    against: Against = "first",
    batch: str | None = None,
    most: int = 100,
    each: Callable[[Sequence[UnitDrift]], None] | None = None,
) -> FleetDrift:
    """Compare the calibrations of each unit of a fleet.

    Raises `UsageError` for a target that is not positive, a dip within a degree of the poles, or a batch that no unit
    has; `DocumentError` for a file that is no table of a fleet, or is not sorted by unit.

    Parameters
    ----------
    paths : sequence of path
        Tables of `flinders fleet`, sorted by unit; a unit may be in several.
    target_deg : float
        The worst heading difference that is good enough.
    dip_deg : float, optional
        Inclination of the field; by default that of the tables.
    against : str
        The calibration that a vehicle carries: that of its ``first`` recording, or the ``previous`` one.
    batch : str, optional
        Hardware batch, as for `flinders.apps.fleet.history.batch_rule`.
    most : int
        Largest number of listed units, and of listed steps.
    each : callable, optional
        Called with the results of some units at a time, in the order of their names.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if against not in ("first", "previous"):
        raise UsageError(f"against is {against!r}: need 'first' or 'previous'")
    rule = batch_rule(paths, batch)
    survey = _Survey.of(paths, rule)
    count = len({name for name, _ in survey.verdicts})
    if batch is not None and count > MAX_BATCHES:
        raise UsageError(f"batch {batch!r} gives more than {MAX_BATCHES:,} batches: choose one that many units share")
    dated, undated = _variances(survey)
    rules = _Rules(
        dated=dated,
        undated=undated,
        target_deg=target_deg,
        dip_deg=survey.dip_deg if dip_deg is None else dip_deg,
        is_dip_given=dip_deg is not None,
        against=against,
        change_p_value_limit=FALSE_ALARM_PROBABILITY / max(survey.changing, 1),
        step_p_value_limit=FALSE_ALARM_PROBABILITY / max(survey.intervals, 1),
    )
    results = _DriftTally(most)
    for history in histories(paths, rule=rule):
        units = _changes_of(history, rules)
        results.add(units, _steps_of(history, rules))
        if each is not None:
            each(units)
    return _fleet_drift(survey, rules, results, rule)


# ------------------------------------------------------------------------------------------------------------ survey


@dataclass(slots=True)
class _Survey:
    """First pass over the tables: counts, and samples of pairs of recordings, with and without dates."""

    units: int = 0
    calibrations: int = 0
    left_out: int = 0
    duplicates: int = 0
    intervals: int = 0
    changing: int = 0
    undated_units: int = 0
    dips: Counter[float] = field(default_factory=Counter)
    dated: PairSample = field(default_factory=PairSample)
    undated: PairSample = field(default_factory=PairSample)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)

    @classmethod
    def of(cls, paths: Sequence[str | os.PathLike[str]], rule: BatchRule) -> _Survey:
        """Read all tables, and count and sample."""
        survey = cls()
        for history in histories(paths, rule=rule):
            survey.add(history)
        return survey

    @property
    def dip_deg(self) -> float:
        """Most frequent dip of the recordings, in degrees; of equally frequent ones the largest."""
        return max(self.dips, key=lambda dip: (self.dips[dip], dip), default=DIP_DEG)

    def add(self, history: Histories) -> None:
        """Count the units of some histories, and sample their pairs of recordings."""
        self.dips.update(history.dip_deg[np.isfinite(history.dip_deg)].tolist())
        counts = np.diff(history.first)
        several = (counts >= 2) & history.is_known
        series = history.offsets
        for unit in np.flatnonzero(several).tolist():
            pairs = self.dated if history.is_dated[unit] else self.undated
            pairs.add(self.units + unit, series, int(history.first[unit]), int(counts[unit]))
        self.dated.bound()
        self.undated.bound()
        self.units += len(counts)
        self.calibrations += int(counts.sum())
        self.left_out += history.left_out
        self.duplicates += history.duplicates
        self.intervals += int((counts[several] - 1).sum())
        self.changing += int(np.count_nonzero(several))
        self.undated_units += int(np.count_nonzero(several & ~history.is_dated))
        for key, count in history.verdicts.items():
            if key in self.verdicts or len(self.verdicts) <= len(VERDICTS) * MAX_BATCHES:
                self.verdicts[key] += count


def _variances(survey: _Survey) -> tuple[Variance, Variance]:
    """Variances of recordings with and without dates; if one has too few pairs, the other's factor is taken."""
    dated, undated = survey.dated.variance(), survey.undated.variance()
    if undated.pairs < MIN_PAIRS <= dated.pairs:
        typical = survey.dated.typical_time()
        undated = replace(undated, factor=dated.factor, random_walk=dated.random_walk * math.sqrt(typical))
    elif dated.pairs < MIN_PAIRS <= undated.pairs:
        dated = replace(dated, factor=undated.factor)
    return dated, undated


# ------------------------------------------------------------------------------------------------------------- units


@dataclass(frozen=True, slots=True)
class _Rules:
    """Variances and limits that hold for all units."""

    dated: Variance
    undated: Variance
    target_deg: float
    dip_deg: float
    is_dip_given: bool
    against: Against
    change_p_value_limit: float
    step_p_value_limit: float

    def dips(self, recorded: Floats) -> Floats:
        """(n,) dip in degrees, with the sign of the sensor's mounting: the given dip, else that of the recording."""
        return np.where(np.isnan(recorded) | self.is_dip_given, self.dip_deg, recorded)


def _changes_of(history: Histories, rules: _Rules) -> list[UnitDrift]:
    """Compare the newest calibration of each unit with the one that the unit is assumed to carry."""
    counts = np.diff(history.first)
    several = np.flatnonzero((counts >= 2) & history.is_known)
    newest = history.first[several + 1] - 1
    carried = history.first[several] if rules.against == "first" else newest - 1
    calibrations = history.calibrations
    changes = differences(calibrations[carried], calibrations[newest], dip_deg=rules.dips(history.dip_deg[newest]))
    changes = changes.inflate(np.where(history.is_dated[several], rules.dated.factor, rules.undated.factor))
    states = _states(changes, rules)
    p_value = changes.p_value
    compared: dict[int, dict[str, Any]] = {}
    for at, unit in enumerate(several.tolist()):
        compared[unit] = {
            "state": states[at],
            "reference": history.recording[carried[at]],
            "newest": history.recording[newest[at]],
            "reference_s": float(history.date_s[carried[at]]),
            "newest_s": float(history.date_s[newest[at]]),
            "p_value": float(p_value[at]),
            "unit_of_field": history.unit_of_field[newest[at]],
        } | {kind: float(getattr(changes, kind)[at]) for kind in DIFFERENCE_FIELDS}
    names = enumerate(zip(history.unit.tolist(), history.batch.tolist(), counts.tolist(), strict=True))
    return [
        UnitDrift(unit=name, batch=batch, recordings=count, **compared.get(unit, _not_compared(count)))
        for unit, (name, batch, count) in names
    ]


DIFFERENCE_FIELDS: Final = (
    "worst_deg", "rms_deg", "sigma_deg", "offset_deg", "offset_sigma_deg", "matrix_deg", "matrix_sigma_deg",
    "offset_change",
)  # fmt: skip


def _states(changes: Differences, rules: _Rules) -> list[str]:
    """State of each compared unit, one of `COMPARED_STATES`."""
    beyond, far = changes.p_value < rules.change_p_value_limit, changes.worst_deg > rules.target_deg
    vague = changes.sigma_deg > rules.target_deg
    states: list[str] = np.select(
        [beyond & far, far | vague & ~beyond, beyond], ["recalibrate", "unsure", "changed"], "steady"
    ).tolist()
    return states


def _not_compared(recordings: int) -> dict[str, Any]:
    """Fields of a unit without a comparison: too few recordings, or in no known order."""
    texts = {"reference": "", "newest": "", "unit_of_field": ""}
    numbers = dict.fromkeys((*DIFFERENCE_FIELDS, "reference_s", "newest_s", "p_value"), math.nan)
    return {"state": "unordered" if recordings > 1 else "single" if recordings else "none", **texts, **numbers}


def _steps_of(history: Histories, rules: _Rules) -> list[UnitStep]:
    """Change points of units whose recordings have an order: over time, or from one recording to the next."""
    series = history.offsets
    steps = [
        step
        for units, variance in ((history.is_dated, rules.dated), (~history.is_dated, rules.undated))
        for step in _steps_in(series, np.flatnonzero(units & history.is_known), variance, rules.step_p_value_limit)
    ]
    if not steps:
        return []
    after = np.array([step.after for step in steps])
    shape = history.calibrations.shape[after]
    radius = history.calibrations.radius[history.first[history.line[after]]]
    moved = np.stack([step.moved for step in steps]) * radius[:, np.newaxis]
    worst = offset_heading_deg(moved, shape, dip_deg=rules.dips(history.dip_deg[after]))
    return [_step(history, *each) for each in zip(steps, moved.tolist(), worst.tolist(), strict=True)]


def _steps_in(series: OffsetSeries, units: NDArray[np.intp], variance: Variance, chance: float) -> list[ChangePoint]:
    """Find the change points of some of the units."""
    counts = np.diff(series.first)[units]
    first = np.concatenate([[0], np.cumsum(counts)])
    rows = np.arange(first[-1]) - np.repeat(first[:-1] - series.first[units], counts)
    selected = OffsetSeries(first, series.time[rows], series.offset[rows], series.covariance[rows])
    steps = change_points(selected, variance, chance=chance)
    return [replace(step, after=int(rows[step.after])) for step in steps]


def _step(history: Histories, step: ChangePoint, moved: list[float], worst: float) -> UnitStep:
    """Row of the list of change points."""
    at = step.after
    return UnitStep(
        unit=history.unit[history.line[at]],
        before=history.recording[at],
        after=history.recording[at + 1],
        before_s=float(history.date_s[at]),
        after_s=float(history.date_s[at + 1]),
        worst_deg=worst,
        offset_change=tuple(moved),
        p_value=step.p_value,
        unit_of_field=history.unit_of_field[at],
    )


# ----------------------------------------------------------------------------------------------------------- results


@dataclass(slots=True)
class _DriftTally:
    """Counts of all units, and the list of the worst of each kind."""

    most: int
    states: Counter[str] = field(default_factory=Counter)
    change_deg: Histogram = field(default_factory=lambda: Histogram.over(0.01, 180.0, 60))
    urgent: list[UnitDrift] = field(default_factory=list)
    unsure: list[UnitDrift] = field(default_factory=list)
    largest: list[UnitStep] = field(default_factory=list)
    step_count: int = 0
    step_units: int = 0
    unordered: list[str] = field(default_factory=list)
    batches: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    stepped: Counter[str] = field(default_factory=Counter)

    def add(self, units: Sequence[UnitDrift], steps: Sequence[UnitStep]) -> None:
        """Add some units."""
        self.states.update(unit.state for unit in units)
        self.change_deg = self.change_deg.with_numbers([unit.worst_deg for unit in units])
        for name, worst in (("recalibrate", self.urgent), ("unsure", self.unsure)):
            listed = [*worst, *(unit for unit in units if unit.state == name)]
            worst[:] = heapq.nsmallest(self.most, listed, key=lambda unit: (-unit.worst_deg, unit.unit))
        largest = [*self.largest, *steps]
        self.largest = heapq.nsmallest(self.most, largest, key=lambda step: (-step.worst_deg, step.unit, step.before))
        stepped = {step.unit for step in steps}
        self.step_count += len(steps)
        self.step_units += len(stepped)
        unordered = (unit.unit for unit in units if unit.state == "unordered")
        self.unordered += itertools.islice(unordered, self.most - len(self.unordered))
        for (batch, state), count in Counter((unit.batch, unit.state) for unit in units).items():
            if batch in self.batches or len(self.batches) <= MAX_BATCHES:
                self.batches[batch][state] += count
        self.stepped.update(unit.batch for unit in units if unit.unit in stepped)


def _fleet_drift(survey: _Survey, rules: _Rules, results: _DriftTally, rule: BatchRule) -> FleetDrift:
    """Make the result of a comparison from the counts and lists of all units."""
    undated = rules.undated
    return FleetDrift(
        units=survey.units,
        calibrations=survey.calibrations,
        without_calibration=survey.left_out,
        duplicates=survey.duplicates,
        states={state: results.states[state] for state in STATES},
        change_deg=results.change_deg,
        listed=(*results.urgent, *results.unsure)[: results.most],
        steps=tuple(results.largest),
        step_count=results.step_count,
        step_units=results.step_units,
        intervals=survey.intervals,
        step_p_value_limit=rules.step_p_value_limit,
        change_p_value_limit=rules.change_p_value_limit,
        false_alarm_probability=FALSE_ALARM_PROBABILITY,
        variance_factor=rules.dated.factor,
        random_walk_deg_per_root_year=rules.dated.heading_deg(YEAR_S, dip_deg=rules.dip_deg),
        pairs=rules.dated.pairs,
        undated=Undated(
            survey.undated_units, undated.factor, undated.heading_deg(1.0, dip_deg=rules.dip_deg), undated.pairs
        ),
        unordered=tuple(results.unordered),
        batches=_batches(survey, results, rule),
        batch_source=rule.words,
        target_deg=rules.target_deg,
        dip_deg=rules.dip_deg,
        against=rules.against,
    )


def _batches(survey: _Survey, results: _DriftTally, rule: BatchRule) -> tuple[BatchDrift, ...]:
    """Drift of each hardware batch; empty if there are too many, or if no unit has one."""
    names = sorted(results.batches)
    if not rule.are_useful(names, sum(survey.verdicts.values())):
        return ()
    verdicts: dict[str, dict[str, int]] = {name: {} for name in names}
    for (batch, verdict), count in survey.verdicts.items():
        verdicts[batch][verdict] = count
    judged = {name: sum(results.batches[name][state] for state in COMPARED_STATES) for name in names}
    odd = {
        "changes": outlying_batches(
            {name: _shares(judged[name], _changed_units(results.batches[name])) for name in names}
        ),
        "steps": outlying_batches({name: _shares(judged[name], results.stepped[name]) for name in names}),
        "verdicts": outlying_batches(verdicts),
    }
    return tuple(
        BatchDrift(
            batch=name,
            units=results.batches[name].total(),
            states={state: results.batches[name][state] for state in STATES if results.batches[name][state]},
            step_units=results.stepped[name],
            verdicts={verdict: verdicts[name][verdict] for verdict in VERDICTS if verdict in verdicts[name]},
            stands_out=tuple(kind for kind, those in odd.items() if name in those),
        )
        for name in names
    )


COMPARED_STATES: Final = ("recalibrate", "unsure", "changed", "steady")
"""States of units that were compared."""


def _changed_units(states: Mapping[str, int]) -> int:
    """Number of units that changed by more than chance explains."""
    return states["recalibrate"] + states["changed"]


def _shares(judged: int, odd: int) -> dict[str, int]:
    """Numbers of units that are ``good`` and ``odd``, as `outlying_batches` needs them."""
    return {"good": judged - odd, "odd": odd}
