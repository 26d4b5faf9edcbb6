"""Random walks of the offsets of self-calibrating units: the rate of each, units that drift faster, and steps.

Each unit has a history of its offset (`flinders.OffsetHistory`). A step is a change of the offset beyond the unit's own
random walk, as in tables of a fleet. A unit is faster than the others if its rate is beyond their scatter.

In a fleet in which nothing moved, any step is reported with a probability of `FALSE_ALARM_PROBABILITY`, and so is any
faster unit. The level of a test is therefore that probability over the number of units, and for an interval also over
the number of intervals of its unit (Bonferroni).
"""

from __future__ import annotations

import heapq
import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.fleet.change_points import ChangePoint, Variance, change_points
from flinders.apps.fleet.history import OffsetSeries
from flinders.apps.fleet.overview import UnitStep
from flinders.comparison.pairs import offset_heading_deg
from flinders.core.offset_walk import HOUR_S
from flinders.errors import UsageError
from flinders.workflows.offset_history import OffsetHistory, find_histories
from flinders.workflows.walk import walk_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from flinders.core.offset_walk import Walk

FALSE_ALARM_PROBABILITY: Final = 0.01
"""Probability of a false alarm in a whole fleet."""
MIN_UNITS: Final = 4
"""Smallest number of units with known rates for which a unit can be faster than the others."""
NORMAL_MEDIAN: Final = 0.6745
"""Median of the absolute value of a standard normal variable."""
DAY_S: Final = 86400.0
MIN_SIGMA: Final = 1e-6
"""Smallest standard deviation of an offset, as a fraction of the field."""

STATES: Final = {
    "moved": "the offset changed at once, beyond its walk, and turned the heading by more than the target",
    "faster": "the offset walks faster than those of the other units, by more than chance explains",
    "steady": "neither moved nor faster",
    "short": "the history is too short to find how fast the offset walks",
}
"""Meaning of each state of a unit, the most urgent first."""


@dataclass(frozen=True, slots=True)
class UnitWalk:
    """Random walk and steps of the offset of a unit."""

    unit: str  # name of the unit
    state: str  # one of the states in docs/fleet/drift.md
    estimates: int  # number of estimates of the offset, two hours apart or more
    begin_s: float  # time of the first estimate, by the clock of the readings, from 1970 if that is known
    end_s: float  # time of the last estimate
    walk: float  # change of the offset in an hour, 1 σ, in `unit_of_field`; it grows with the root of time
    walk_low: float  # lower end of its 95 % interval
    walk_high: float  # upper end of its 95 % interval
    walk_deg: float  # 1 σ change of a level heading in a day by the walk, at the worst heading
    p_value: float  # probability that a unit of this fleet walks as fast by chance
    steps: int  # number of steps of the offset beyond its walk
    moved: int  # number of times that its calibration reported `moved`, which includes magnets that stayed for a while
    offset: tuple[float, ...]  # newest offset: x, y, z, in `unit_of_field`
    offset_sigma: tuple[float, ...]  # 1 σ of each axis
    heading_error_deg: float  # heading error that its calibration claims at the end
    unit_of_field: str  # ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class FleetWalk:
    """Random walks and steps of the offsets of a fleet."""

    units: int  # number of all units
    states: Mapping[str, int]  # units in each of `STATES`
    listed: tuple[UnitWalk, ...]  # the first units by urgency, then the fastest first
    steps: tuple[UnitStep, ...]  # the largest steps
    step_count: int  # number of all steps
    step_units: int  # number of units with a step
    intervals: int  # number of intervals between estimates, each tested for a step
    false_alarm_probability: float  # probability of any reported step in a fleet by chance; the same for faster units
    typical_walk_deg: float  # median of `walk_deg` of the units
    walk_spread: float  # factor by which the units scatter about that median, 1 σ, beyond their own uncertainty
    target_deg: float  # change of the heading that is good enough
    dip_deg: float | None  # dip of the field for headings; None if that of each unit was used
    #: for a single unit, its `time_s`, `offset` and `sigma`, each a list
    history: Mapping[str, Sequence[Any]] | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, as ``--json`` prints them."""
        return asdict(self)


def walks_of(
    paths: Sequence[str | os.PathLike[str]],
    *,
    target_deg: float = 1.0,
    dip_deg: float | None = None,
    most: int = 100,
    each: Callable[[Sequence[UnitWalk]], None] | None = None,
) -> FleetWalk:
    """Compare the random walks of units.

    Raises `UsageError` for a target that is not positive, `DocumentError` for a file without a history.

    Parameters
    ----------
    paths : sequence of path
        Files of `flinders watch`, see `flinders.workflows.offset_history.find_histories`.
    target_deg : float
        Change of the heading by a step that is good enough.
    dip_deg : float, optional
        Inclination of the field; by default that of each unit.
    most : int
        Largest number of listed units, and of listed steps.
    each : callable, optional
        Called with all units, in the order of their names.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    found = find_histories(paths)
    units, steps, intervals = list[UnitWalk](), list[UnitStep](), 0
    for path, name in found.items():
        history = OffsetHistory.read(path, name=name)
        history = history if dip_deg is None else replace(history, dip_deg=dip_deg)
        estimates = history.estimates
        changes = _changes_of(estimates, FALSE_ALARM_PROBABILITY / len(found))
        moved = np.isin(np.arange(len(estimates.time_s)), [change.after + 1 for change in changes])
        walk = walk_of(estimates.time_s, estimates.offset, estimates.sigma, moved)
        of_unit = [_step(estimates, change) for change in changes]
        units.append(_unit_of(history, estimates, walk, of_unit, target_deg))
        steps += of_unit
        intervals += max(len(estimates.time_s) - 1, 0)
    units, typical, spread = _compare_rates(sorted(units, key=lambda one: one.unit))
    if each is not None:
        each(units)
    return FleetWalk(
        units=len(units),
        states={state: sum(one.state == state for one in units) for state in STATES},
        listed=tuple(heapq.nsmallest(most, units, key=_urgency)),
        steps=tuple(heapq.nsmallest(most, steps, key=lambda step: (-step.worst_deg, step.unit, step.before_s))),
        step_count=len(steps),
        step_units=len({step.unit for step in steps}),
        intervals=intervals,
        false_alarm_probability=FALSE_ALARM_PROBABILITY,
        typical_walk_deg=typical,
        walk_spread=spread,
        target_deg=target_deg,
        dip_deg=dip_deg,
        history=_history_columns(estimates) if len(units) == 1 else None,
    )


def _history_columns(estimates: OffsetHistory) -> dict[str, Sequence[Any]]:
    """Times, offsets and standard deviations of a unit, as lists."""
    return {name: getattr(estimates, name).tolist() for name in ("time_s", "offset", "sigma")}


def _urgency(one: UnitWalk) -> tuple[int, float, str]:
    """Key of the order in which units are listed."""
    return list(STATES).index(one.state), -one.walk_deg if math.isfinite(one.walk_deg) else math.inf, one.unit


def _unit_of(
    history: OffsetHistory, estimates: OffsetHistory, walk: Walk | None, steps: Sequence[UnitStep], target_deg: float
) -> UnitWalk:
    """Random walk and steps of one unit, before it is compared with the other units."""
    is_moved = any(step.worst_deg > target_deg for step in steps)
    rate, low, high = (math.nan,) * 3 if walk is None else (walk.rate, walk.low, walk.high)
    newest = -1 if len(history.time_s) else None
    return UnitWalk(
        unit=history.name,
        state="moved" if is_moved else "short" if walk is None else "steady",
        estimates=len(estimates.time_s),
        begin_s=math.nan if newest is None else float(history.time_s[0]),
        end_s=math.nan if newest is None else float(history.time_s[newest]),
        walk=rate,
        walk_low=low,
        walk_high=high,
        walk_deg=math.nan if walk is None else walk.heading_deg(DAY_S, radius=history.radius, dip_deg=history.dip_deg),
        p_value=math.nan,
        steps=len(steps),
        moved=len(history.moved_s),
        offset=(math.nan,) * 3 if newest is None else tuple(history.offset[newest].tolist()),
        offset_sigma=(math.nan,) * 3 if newest is None else tuple(history.sigma[newest].tolist()),
        heading_error_deg=history.heading_error_deg,
        unit_of_field=history.unit,
    )


def _changes_of(estimates: OffsetHistory, chance: float) -> list[ChangePoint]:
    """Change points of the offset of a unit beyond its walk; empty if the walk is not known."""
    walk = estimates.walk
    if walk is None:
        return []
    count, radius = len(estimates.time_s), estimates.radius
    sigma = np.maximum(estimates.sigma / radius, MIN_SIGMA)
    covariance = np.square(sigma)[:, :, np.newaxis] * np.eye(3)
    series = OffsetSeries(np.array([0, count]), estimates.time_s, estimates.offset / radius, covariance)
    variance = Variance(random_walk=walk.rate / radius / math.sqrt(HOUR_S))
    return change_points(series, variance, chance=chance / (count - 1))


def _step(estimates: OffsetHistory, found: ChangePoint) -> UnitStep:
    """Make the row of a change point for the list of steps."""
    moved, sphere = found.moved * estimates.radius, estimates.radius * np.eye(3)
    worst = offset_heading_deg(moved[np.newaxis], sphere[np.newaxis], dip_deg=np.array([estimates.dip_deg]))
    return UnitStep(
        unit=estimates.name,
        before="",
        after="",
        before_s=float(estimates.time_s[found.after]),
        after_s=float(estimates.time_s[found.after + 1]),
        worst_deg=float(worst[0]),
        offset_change=tuple(moved.tolist()),
        p_value=found.p_value,
        unit_of_field=estimates.unit,
    )


def _compare_rates(units: list[UnitWalk]) -> tuple[list[UnitWalk], float, float]:
    """Units with their p value, the median rate in degrees of heading, and the factor by which rates scatter.

    Rates are compared by the change of heading in a day.
    """
    rates = np.array([one.walk_deg for one in units])
    known = np.flatnonzero(np.isfinite(rates))
    if not len(known):
        return units, math.nan, math.nan
    middle = float(np.median(rates[known]))
    if len(known) < MIN_UNITS:
        return units, middle, math.nan
    sigma = np.array([math.log(units[place].walk_high / units[place].walk_low) / 3.92 for place in known.tolist()])
    off = np.log(rates[known] / middle)
    scatter = float(np.median(np.abs(off))) / NORMAL_MEDIAN
    spread = math.sqrt(max(scatter**2 - float(np.median(sigma)) ** 2, 0.0))
    compared = list(units)
    for place, beyond in zip(known.tolist(), (off / np.hypot(sigma, spread)).tolist(), strict=True):
        one, chance = units[place], math.erfc(beyond / math.sqrt(2.0)) / 2.0
        is_faster = chance < FALSE_ALARM_PROBABILITY / len(units) and one.state == "steady"
        compared[place] = replace(one, p_value=chance, state="faster" if is_faster else one.state)
    return compared, middle, math.exp(spread)
