"""Which units of a fleet have a compass that drifted, and where something was moved: several calibrations of each.

The newest calibration of a unit is held against the one that the vehicle is taken to carry, its first. Tables are gone
through twice and never held in memory: first for how offsets of this fleet scatter, then for each unit.

The rate of false alarms does not grow with the fleet. A change or a step is reported where chance makes as much in
fewer than `CHANCE` of whole fleets of this size in which nothing moved: a gap is tested at `CHANCE` over the number of
gaps, a unit at `CHANCE` over the number of units (Bonferroni). docs/drift.md has what that finds and what it misses.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.errors import UsageError
from flinders.fleet.changes import Changes, between, offset_heading_deg
from flinders.fleet.history import histories
from flinders.fleet.scatter import YEAR, Scatter, scatter_of
from flinders.fleet.steps import Lines, Step, steps_of
from flinders.report.fleet_view import STATES, Drift, Histogram, UnitDrift, UnitStep

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence

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
    most : int
        Units and steps that are listed.
    each : callable, optional
        Is handed what was found of all units, some at a time, in the order of their names.

    Raises
    ------
    UsageError
        For a target that is not positive, or a dip within a degree of the poles.
    DocumentError
        For a file that is no table of a fleet, or is not sorted by unit.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    if against not in ("first", "previous"):
        raise UsageError(f"against is {against!r}: need 'first' or 'previous'")
    seen = _survey(paths)
    rules = _Rules(
        scatter=scatter_of(*seen.joined()),
        target_deg=target_deg,
        dip_deg=seen.dip_deg if dip_deg is None else dip_deg,
        against=against,
        change_chance=CHANCE / max(seen.changing, 1),
        step_chance=CHANCE / max(seen.gaps, 1),
    )
    found = _Found(most)
    for history in histories(paths):
        units = _changes_of(history, rules)
        found.add(units, _steps_of(history, rules))
        if each is not None:
            each(units)
    return _told(seen, rules, found)


# ------------------------------------------------------------------------------------------------------------ survey


@dataclass(slots=True)
class _Survey:
    """What the first pass saw: how many there are, and a sample of pairs of recordings.

    Every `stride`-th unit is in the sample; where it grows too large, every second of those is left.
    """

    units: int = 0
    calibrations: int = 0
    left_out: int = 0
    gaps: int = 0
    changing: int = 0
    dip_deg: float = DIP_DEG
    stride: int = 1
    sample: list[tuple[int, Floats, Floats, Floats]] = field(default_factory=list)

    def add(self, history: Histories) -> None:
        """Count, and take pairs."""
        if not self.calibrations and len(history.dip_deg) and math.isfinite(history.dip_deg[0]):
            self.dip_deg = float(history.dip_deg[0])
        counts = np.diff(history.first)
        lines = _lines(history)
        for unit in np.flatnonzero(counts >= 2).tolist():
            if (self.units + unit) % self.stride == 0:
                self.sample.append((self.units + unit, *_pairs(lines, int(history.first[unit]), int(counts[unit]))))
        self.units += len(counts)
        self.calibrations += int(counts.sum())
        self.left_out += history.left_out
        self.gaps += int((counts - 1).clip(min=0).sum())
        self.changing += int(np.count_nonzero(counts >= 2))
        while sum(len(part[3]) for part in self.sample) > MOST_PAIRS and len(self.sample) > 1:
            self.stride *= 2
            self.sample = [part for part in self.sample if part[0] % self.stride == 0] or self.sample[:1]

    def joined(self) -> tuple[Floats, Floats, Floats]:
        """Changes (n, 3), claims (n, 3, 3) and seconds (n,) of all pairs of the sample."""
        if not self.sample:
            return np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0)
        _, changes, claimed, seconds = zip(*self.sample, strict=True)
        return np.concatenate(changes), np.concatenate(claimed), np.concatenate(seconds)


def _survey(paths: Sequence[str | os.PathLike[str]]) -> _Survey:
    seen = _Survey()
    for history in histories(paths):
        seen.add(history)
    return seen


def _lines(history: Histories) -> Lines:
    """Offsets as shares of the field of each unit's first recording."""
    calibrations = history.calibrations
    radius = calibrations.radius[history.first[history.line]] if len(calibrations) else np.empty(0)
    covariance = calibrations.covariance[:, :3, :3] / radius[:, np.newaxis, np.newaxis] ** 2
    return Lines(history.first, history.start_s, calibrations.offset / radius[:, np.newaxis], covariance)


def _pairs(lines: Lines, first: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Neighbours in time, and the first and the last, of one unit; a bounded number of them."""
    a = np.arange(first, first + count - 1)[:20]
    b = a + 1
    if count > 2:
        a, b = np.append(a, first), np.append(b, first + count - 1)
    claimed = lines.covariance[a] + lines.covariance[b]
    return lines.offset[b] - lines.offset[a], claimed, lines.time[b] - lines.time[a]


# ------------------------------------------------------------------------------------------------------------- units


@dataclass(frozen=True, slots=True)
class _Rules:
    """What all units are judged by."""

    scatter: Scatter
    target_deg: float
    dip_deg: float
    against: Against
    change_chance: float
    step_chance: float


def _changes_of(history: Histories, rules: _Rules) -> list[UnitDrift]:
    """Hold the newest calibration of each unit against the one that it is taken to carry."""
    counts = np.diff(history.first)
    several = np.flatnonzero(counts >= 2)
    newest = history.first[several + 1] - 1
    carried = history.first[several] if rules.against == "first" else newest - 1
    calibrations = history.calibrations
    changes = between(calibrations[carried], calibrations[newest], dip_deg=rules.dip_deg)
    changes = changes.widened(rules.scatter.session)
    states = _states(changes, rules)
    p_value = changes.p_value
    place = {unit: at for at, unit in enumerate(several.tolist())}
    found = []
    for unit, (name, count) in enumerate(zip(history.unit.tolist(), counts.tolist(), strict=True)):
        at = place.get(unit)
        if at is None:
            found.append(_alone(name, count))
            continue
        numbers = {kind: float(getattr(changes, kind)[at]) for kind in SHOWN}
        found.append(
            UnitDrift(
                unit=name,
                state=states[at],
                recordings=count,
                first_s=float(history.start_s[carried[at]]),
                last_s=float(history.start_s[newest[at]]),
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


def _alone(name: str, count: int) -> UnitDrift:
    nothing = dict.fromkeys(SHOWN, math.nan)
    return UnitDrift(
        unit=name,
        state="single" if count else "none",
        recordings=count,
        first_s=math.nan,
        last_s=math.nan,
        p_value=math.nan,
        unit_of_field="",
        **nothing,
    )


def _steps_of(history: Histories, rules: _Rules) -> list[UnitStep]:
    """Find change points of units whose recordings have times."""
    lines = _lines(history)
    timed = _timed(lines)
    steps = steps_of(timed, rules.scatter, chance=rules.step_chance)
    if not steps:
        return []
    after = np.array([step.after for step in steps])
    shape = history.calibrations.shape[after]
    radius = history.calibrations.radius[history.first[history.line[after]]]
    moved = np.stack([step.moved for step in steps]) * radius[:, np.newaxis]
    worst = offset_heading_deg(moved, shape, dip_deg=rules.dip_deg)
    return [_step(history, *found) for found in zip(steps, moved.tolist(), worst.tolist(), strict=True)]


def _timed(lines: Lines) -> Lines:
    """Without units of which a time is not known: those have no recordings in it."""
    if np.isfinite(lines.time).all():
        return lines
    line = np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first))
    untimed = np.unique(line[~np.isfinite(lines.time)])
    time = lines.time.copy()
    time[np.isin(line, untimed)] = 0.0
    covariance = lines.covariance.copy()
    covariance[np.isin(line, untimed)] = 1e12 * np.eye(3)  # so uncertain that no step is seen
    return replace(lines, time=time, covariance=covariance)


def _step(history: Histories, step: Step, moved: list[float], worst: float) -> UnitStep:
    at = step.after
    return UnitStep(
        unit=history.unit[history.line[at]],
        before=history.recording[at],
        after=history.recording[at + 1],
        before_s=float(history.start_s[at]),
        after_s=float(history.start_s[at + 1]),
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
    largest: list[tuple[float, str, float, UnitStep]] = field(default_factory=list)
    step_count: int = 0
    step_units: int = 0

    def add(self, units: Sequence[UnitDrift], steps: Sequence[UnitStep]) -> None:
        """Take in some units."""
        self.states.update(unit.state for unit in units)
        self.change_deg = self.change_deg.counted([unit.worst_deg for unit in units])
        for name, kept in (("recalibrate", self.urgent), ("unsure", self.unsure)):
            keyed = ((-unit.worst_deg, unit.unit, unit) for unit in units if unit.state == name)
            kept[:] = heapq.nsmallest(self.most, [*kept, *keyed], key=lambda item: item[:2])
        ordered = ((-step.worst_deg, step.unit, step.before_s, step) for step in steps)
        self.largest[:] = heapq.nsmallest(self.most, [*self.largest, *ordered], key=lambda item: item[:3])
        self.step_count += len(steps)
        self.step_units += len({step.unit for step in steps})


def _told(seen: _Survey, rules: _Rules, found: _Found) -> Drift:
    return Drift(
        units=seen.units,
        calibrations=seen.calibrations,
        left_out=seen.left_out,
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
        session=rules.scatter.session,
        walk_deg=rules.scatter.heading_deg(YEAR, dip_deg=rules.dip_deg),
        pairs=rules.scatter.pairs,
        target_deg=rules.target_deg,
        dip_deg=rules.dip_deg,
        against=rules.against,
    )
