"""Which units of a fleet have a compass that drifted, and where something was moved: several calibrations of each.

The newest calibration of a unit is held against the one that the vehicle is taken to carry, its first. Tables are gone
through twice and never held in memory: first for how offsets of this fleet scatter, then for each unit. Units whose
recordings have no dates are held against how those of such units scatter from one to the next; see
`flinders.fleet.dates` for what tells which came first.

The rate of false alarms does not grow with the fleet. A change or a step is reported where chance makes as much in
fewer than `CHANCE` of whole fleets of this size in which nothing moved: a gap is tested at `CHANCE` over the number of
gaps, a unit at `CHANCE` over the number of units (Bonferroni). docs/drift.md has what that finds and what it misses.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter, defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.comparison.batch import Changes, between, offset_heading_deg
from flinders.errors import UsageError
from flinders.fleet.change_points import ChangePoint, OffsetSeries, change_points
from flinders.fleet.hardware_batch import MOST, BatchRule, batch_rule
from flinders.fleet.history import histories
from flinders.fleet.results import VERDICTS
from flinders.fleet.variance import FEWEST, YEAR, Variance, estimate_variance
from flinders.report.fleet_figures import standing_out
from flinders.report.fleet_view import STATES, BatchDrift, Drift, Histogram, Undated, UnitDrift, UnitStep

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.fleet.history import Histories

CHANCE: Final = 0.01
"""How often chance alone reports anything of a fleet; as where two calibrations are compared."""
MOST_PAIRS: Final = 20_000
"""Pairs of recordings that the scatter of a fleet is found from."""
DIP_DEG: Final = 60.0

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
) -> Drift:
    """Say how each unit of a fleet changed.

    Parameters
    ----------
    paths : sequence of path
        Tables of `flinders fleet`, sorted by unit; a unit may be in several.
    target_deg : float
        The worst heading difference that is good enough.
    dip_deg : float, optional
        Inclination of the field; by default what the tables say.
    against : str
        The calibration that a vehicle carries: that of its ``first`` recording, or the ``previous`` one.
    batch : str, optional
        What tells the hardware batch, as `flinders.fleet.hardware_batch.batch_rule`.
    most : int
        Units and steps that are listed.
    each : callable, optional
        Is handed what was found of all units, some at a time, in the order of their names.

    Raises
    ------
    UsageError
        For a target that is not positive, a dip within a degree of the poles, or a batch that no unit has.
    DocumentError
        For a file that is no table of a fleet, or is not sorted by unit.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if against not in ("first", "previous"):
        raise UsageError(f"against is {against!r}: need 'first' or 'previous'")
    batches = batch_rule(paths, batch)
    seen = _survey(paths, batches)
    count = len({name for name, _ in seen.verdicts})
    if batch is not None and count > MOST:
        raise UsageError(f"batch {batch!r} tells more than {MOST:,} batches: choose what many units have in common")
    dated, undated = _scatters(seen)
    rules = _Rules(
        dated=dated,
        undated=undated,
        target_deg=target_deg,
        dip_deg=seen.dip_deg if dip_deg is None else dip_deg,
        is_dip_given=dip_deg is not None,
        against=against,
        change_chance=CHANCE / max(seen.changing, 1),
        step_chance=CHANCE / max(seen.gaps, 1),
    )
    found = _Found(most)
    for history in histories(paths, batches=batches):
        units = _changes_of(history, rules)
        found.add(units, _steps_of(history, rules))
        if each is not None:
            each(units)
    return _told(seen, rules, found, batches)


# ------------------------------------------------------------------------------------------------------------ survey


@dataclass(slots=True)
class _Pairs:
    """A sample of pairs of recordings: of every `stride`-th unit; where it grows too large, half of those are left."""

    stride: int = 1
    parts: list[tuple[int, Floats, Floats, Floats]] = field(default_factory=list)

    def add(self, number: int, lines: OffsetSeries, first: int, count: int) -> None:
        """Take in the unit of that number, of the whole fleet."""
        if number % self.stride == 0:
            self.parts.append((number, *_pairs(lines, first, count)))

    def bound(self) -> None:
        """Keep no more than `MOST_PAIRS`."""
        while sum(len(part[3]) for part in self.parts) > MOST_PAIRS and len(self.parts) > 1:
            self.stride *= 2
            self.parts = [part for part in self.parts if part[0] % self.stride == 0] or self.parts[:1]

    def joined(self) -> tuple[Floats, Floats, Floats]:
        """Changes (n, 3), claims (n, 3, 3) and times (n,) of all of them."""
        if not self.parts:
            return np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0)
        _, changes, claimed, times = zip(*self.parts, strict=True)
        return np.concatenate(changes), np.concatenate(claimed), np.concatenate(times)


@dataclass(slots=True)
class _Survey:
    """What the first pass saw: how many there are, and a sample of pairs of recordings with dates, and without."""

    units: int = 0
    calibrations: int = 0
    left_out: int = 0
    passed_over: int = 0
    gaps: int = 0
    changing: int = 0
    undated_units: int = 0
    dips: Counter[float] = field(default_factory=Counter)
    dated: _Pairs = field(default_factory=_Pairs)
    undated: _Pairs = field(default_factory=_Pairs)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)

    @property
    def dip_deg(self) -> float:
        """The one that most recordings were judged at; of two as frequent ones the steeper."""
        return max(self.dips, key=lambda dip: (self.dips[dip], dip), default=DIP_DEG)

    def add(self, history: Histories) -> None:
        """Count, and take pairs."""
        self.dips.update(history.dip_deg[np.isfinite(history.dip_deg)].tolist())
        counts = np.diff(history.first)
        several = (counts >= 2) & history.is_known
        lines = _lines(history)
        for unit in np.flatnonzero(several).tolist():
            pairs = self.dated if history.is_dated[unit] else self.undated
            pairs.add(self.units + unit, lines, int(history.first[unit]), int(counts[unit]))
        self.dated.bound()
        self.undated.bound()
        self.units += len(counts)
        self.calibrations += int(counts.sum())
        self.left_out += history.left_out
        self.passed_over += history.passed_over
        self.gaps += int((counts[several] - 1).sum())
        self.changing += int(np.count_nonzero(several))
        self.undated_units += int(np.count_nonzero(several & ~history.is_dated))
        for told, count in history.verdicts.items():
            if told in self.verdicts or len(self.verdicts) <= len(VERDICTS) * MOST:
                self.verdicts[told] += count


def _survey(paths: Sequence[str | os.PathLike[str]], batches: BatchRule) -> _Survey:
    seen = _Survey()
    for history in histories(paths, batches=batches):
        seen.add(history)
    return seen


def _lines(history: Histories) -> OffsetSeries:
    """Offsets as shares of the field of a unit's first recording; without dates time counts recordings."""
    calibrations = history.calibrations
    line = history.line
    radius = calibrations.radius[history.first[line]] if len(calibrations) else np.empty(0)
    covariance = calibrations.covariance[:, :3, :3] / radius[:, np.newaxis, np.newaxis] ** 2
    time = np.where(history.is_dated[line], history.date_s, np.arange(len(line)) - history.first[line])
    return OffsetSeries(history.first, time, calibrations.offset / radius[:, np.newaxis], covariance)


def _pairs(lines: OffsetSeries, first: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Neighbours in time, and the first and the last, of one unit; a bounded number of them."""
    a = np.arange(first, first + count - 1)[:20]
    b = a + 1
    if count > 2:
        a, b = np.append(a, first), np.append(b, first + count - 1)
    claimed = lines.covariance[a] + lines.covariance[b]
    return lines.offset[b] - lines.offset[a], claimed, lines.time[b] - lines.time[a]


def _scatters(seen: _Survey) -> tuple[Variance, Variance]:
    """How recordings with dates scatter, over time, and those without, from one to the next.

    Where there are too few of one kind, the other tells what claims are worth: that does not hang on dates.
    """
    dated, undated = estimate_variance(*seen.dated.joined()), estimate_variance(*seen.undated.joined())
    if undated.pairs < FEWEST <= dated.pairs:
        typical = float(np.median(seen.dated.joined()[2]))
        undated = replace(undated, session=dated.session, walk=dated.walk * math.sqrt(typical))
    elif dated.pairs < FEWEST <= undated.pairs:
        dated = replace(dated, session=undated.session)
    return dated, undated


# ------------------------------------------------------------------------------------------------------------- units


@dataclass(frozen=True, slots=True)
class _Rules:
    """What all units are judged by."""

    dated: Variance
    undated: Variance
    target_deg: float
    dip_deg: float
    is_dip_given: bool
    against: Against
    change_chance: float
    step_chance: float

    def dips(self, recorded: Floats) -> Floats:
        """(n,) the dip that each is judged at: the one that was given, else what its recording was judged at.

        Its sign says which way up the sensor sits, and need not be that of the unit beside it.
        """
        return np.where(np.isnan(recorded) | self.is_dip_given, self.dip_deg, recorded)


def _changes_of(history: Histories, rules: _Rules) -> list[UnitDrift]:
    """Hold the newest calibration of each unit against the one that it is taken to carry."""
    counts = np.diff(history.first)
    several = np.flatnonzero((counts >= 2) & history.is_known)
    newest = history.first[several + 1] - 1
    carried = history.first[several] if rules.against == "first" else newest - 1
    calibrations = history.calibrations
    changes = between(calibrations[carried], calibrations[newest], dip_deg=rules.dips(history.dip_deg[newest]))
    changes = changes.widened(np.where(history.is_dated[several], rules.dated.session, rules.undated.session))
    states = _states(changes, rules)
    p_value = changes.p_value
    place = {unit: at for at, unit in enumerate(several.tolist())}
    found = []
    for unit, (name, batch, count) in enumerate(
        zip(history.unit.tolist(), history.batch.tolist(), counts.tolist(), strict=True)
    ):
        at = place.get(unit)
        if at is None:
            found.append(_alone(name, batch, count))
            continue
        numbers = {kind: float(getattr(changes, kind)[at]) for kind in SHOWN}
        found.append(
            UnitDrift(
                unit=name,
                batch=batch,
                state=states[at],
                recordings=count,
                reference=history.recording[carried[at]],
                newest=history.recording[newest[at]],
                reference_s=float(history.date_s[carried[at]]),
                newest_s=float(history.date_s[newest[at]]),
                p_value=float(p_value[at]),
                unit_of_field=history.unit_of_field[newest[at]],
                **numbers,
            )
        )
    return found


SHOWN: Final = (
    "worst_deg", "rms_deg", "sigma_deg", "offset_deg", "offset_sigma_deg", "matrix_deg", "matrix_sigma_deg", "moved",
)  # fmt: skip


def _states(changes: Changes, rules: _Rules) -> list[str]:
    """Say of each change what it means."""
    beyond, far = changes.p_value < rules.change_chance, changes.worst_deg > rules.target_deg
    vague = changes.sigma_deg > rules.target_deg
    states: list[str] = np.select(
        [beyond & far, far | vague & ~beyond, beyond], ["recalibrate", "unsure", "changed"], "steady"
    ).tolist()
    return states


def _alone(name: str, batch: str, count: int) -> UnitDrift:
    """A unit of which nothing can be held against each other: too few recordings, or in no order."""
    nothing = dict.fromkeys(SHOWN, math.nan)
    return UnitDrift(
        unit=name,
        batch=batch,
        state="unordered" if count > 1 else "single" if count else "none",
        recordings=count,
        reference="",
        newest="",
        reference_s=math.nan,
        newest_s=math.nan,
        p_value=math.nan,
        unit_of_field="",
        **nothing,
    )


def _steps_of(history: Histories, rules: _Rules) -> list[UnitStep]:
    """Find change points of units whose recordings have an order: over time, or from one recording to the next."""
    lines = _lines(history)
    steps = [
        step
        for units, scatter in ((history.is_dated, rules.dated), (~history.is_dated, rules.undated))
        for step in _steps_in(lines, np.flatnonzero(units & history.is_known), scatter, rules.step_chance)
    ]
    if not steps:
        return []
    after = np.array([step.after for step in steps])
    shape = history.calibrations.shape[after]
    radius = history.calibrations.radius[history.first[history.line[after]]]
    moved = np.stack([step.moved for step in steps]) * radius[:, np.newaxis]
    worst = offset_heading_deg(moved, shape, dip_deg=rules.dips(history.dip_deg[after]))
    return [_step(history, *found) for found in zip(steps, moved.tolist(), worst.tolist(), strict=True)]


def _steps_in(lines: OffsetSeries, units: NDArray[np.intp], scatter: Variance, chance: float) -> list[ChangePoint]:
    """Find change points of some of the units."""
    counts = np.diff(lines.first)[units]
    first = np.concatenate([[0], np.cumsum(counts)])
    rows = np.arange(first[-1]) - np.repeat(first[:-1] - lines.first[units], counts)
    some = OffsetSeries(first, lines.time[rows], lines.offset[rows], lines.covariance[rows])
    steps = change_points(some, scatter, chance=chance)
    return [replace(step, after=int(rows[step.after])) for step in steps]


def _step(history: Histories, step: ChangePoint, moved: list[float], worst: float) -> UnitStep:
    at = step.after
    return UnitStep(
        unit=history.unit[history.line[at]],
        before=history.recording[at],
        after=history.recording[at + 1],
        before_s=float(history.date_s[at]),
        after_s=float(history.date_s[at + 1]),
        worst_deg=worst,
        moved=tuple(moved),
        p_value=step.p_value,
        unit_of_field=history.unit_of_field[at],
    )


# ------------------------------------------------------------------------------------------------------- what is told


@dataclass(slots=True)
class _Found:
    """Counts of all units, and those that are listed: the worst of each kind."""

    most: int
    states: Counter[str] = field(default_factory=Counter)
    change_deg: Histogram = field(default_factory=lambda: Histogram.over(0.01, 180.0, 60))
    urgent: list[tuple[float, str, UnitDrift]] = field(default_factory=list)
    unsure: list[tuple[float, str, UnitDrift]] = field(default_factory=list)
    largest: list[tuple[float, str, str, UnitStep]] = field(default_factory=list)
    step_count: int = 0
    step_units: int = 0
    unordered: list[str] = field(default_factory=list)
    batches: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    stepped: Counter[str] = field(default_factory=Counter)

    def add(self, units: Sequence[UnitDrift], steps: Sequence[UnitStep]) -> None:
        """Take in some units."""
        self.states.update(unit.state for unit in units)
        self.change_deg = self.change_deg.counted([unit.worst_deg for unit in units])
        for name, kept in (("recalibrate", self.urgent), ("unsure", self.unsure)):
            keyed = ((-unit.worst_deg, unit.unit, unit) for unit in units if unit.state == name)
            kept[:] = heapq.nsmallest(self.most, [*kept, *keyed], key=lambda item: item[:2])
        ordered = ((-step.worst_deg, step.unit, step.before, step) for step in steps)
        self.largest[:] = heapq.nsmallest(self.most, [*self.largest, *ordered], key=lambda item: item[:3])
        stepped = {step.unit for step in steps}
        self.step_count += len(steps)
        self.step_units += len(stepped)
        unordered = (unit.unit for unit in units if unit.state == "unordered")
        self.unordered += itertools.islice(unordered, self.most - len(self.unordered))
        for (batch, state), count in Counter((unit.batch, unit.state) for unit in units).items():
            if batch in self.batches or len(self.batches) <= MOST:
                self.batches[batch][state] += count
        self.stepped.update(unit.batch for unit in units if unit.unit in stepped)


def _told(seen: _Survey, rules: _Rules, found: _Found, batches: BatchRule) -> Drift:
    undated = rules.undated
    return Drift(
        units=seen.units,
        calibrations=seen.calibrations,
        left_out=seen.left_out,
        passed_over=seen.passed_over,
        states={state: found.states[state] for state in STATES},
        change_deg=found.change_deg,
        listed=tuple(item[-1] for item in [*found.urgent, *found.unsure][: found.most]),
        steps=tuple(item[-1] for item in found.largest),
        step_count=found.step_count,
        step_units=found.step_units,
        gaps=seen.gaps,
        step_chance=rules.step_chance,
        change_chance=rules.change_chance,
        chance=CHANCE,
        session=rules.dated.session,
        walk_deg=rules.dated.heading_deg(YEAR, dip_deg=rules.dip_deg),
        pairs=rules.dated.pairs,
        undated=Undated(
            seen.undated_units, undated.session, undated.heading_deg(1.0, dip_deg=rules.dip_deg), undated.pairs
        ),
        unordered=tuple(found.unordered),
        batches=_batches(seen, found, batches),
        batch_of=batches.words,
        target_deg=rules.target_deg,
        dip_deg=rules.dip_deg,
        against=rules.against,
    )


def _batches(seen: _Survey, found: _Found, batches: BatchRule) -> tuple[BatchDrift, ...]:
    """How each batch changed; none where there are too many, or where names tell none."""
    names = sorted(found.batches)
    if not batches.are_useful(names, sum(seen.verdicts.values())):
        return ()
    verdicts: dict[str, dict[str, int]] = {name: {} for name in names}
    for (batch, verdict), count in seen.verdicts.items():
        verdicts[batch][verdict] = count
    judged = {name: sum(found.batches[name][state] for state in JUDGED) for name in names}
    odd = {
        "changes": standing_out({name: _shares(judged[name], _changed(found.batches[name])) for name in names}),
        "steps": standing_out({name: _shares(judged[name], found.stepped[name]) for name in names}),
        "verdicts": standing_out(verdicts),
    }
    return tuple(
        BatchDrift(
            batch=name,
            units=found.batches[name].total(),
            states={state: found.batches[name][state] for state in STATES if found.batches[name][state]},
            stepped=found.stepped[name],
            verdicts={verdict: verdicts[name][verdict] for verdict in VERDICTS if verdict in verdicts[name]},
            stands_out=tuple(kind for kind, those in odd.items() if name in those),
        )
        for name in names
    )


JUDGED: Final = ("recalibrate", "unsure", "changed", "steady")
"""States of units that were held against themselves."""


def _changed(states: Mapping[str, int]) -> int:
    return states["recalibrate"] + states["changed"]


def _shares(judged: int, odd: int) -> dict[str, int]:
    return {"good": judged - odd, "odd": odd}
