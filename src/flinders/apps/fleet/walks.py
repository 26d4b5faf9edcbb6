"""Units whose calibrations keep themselves: how fast the offset of each walks, which walks faster, and which moved.

Each unit has a history of its offset (`flinders.OffsetHistory`). A step is what moved apart from the unit's own walk,
as in tables of a fleet. A unit walks faster than the others where its rate is beyond what they scatter by. Chance alone
reports a step, or a faster unit, of `CHANCE` of whole fleets in which nothing moved: an interval is tested at that over
the intervals of its unit and over the units, a rate at that over the units (Bonferroni).
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
from flinders.workflows.offset_history import OffsetHistory, histories_in
from flinders.workflows.walk import walk_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from flinders.core.offset_walk import Walk

CHANCE: Final = 0.01
"""Probability of a false alarm in a whole fleet."""
FEWEST: Final = 4
"""Units whose walk is known, below which none is said to walk faster than the others."""
NORMAL_MEDIAN: Final = 0.6745
"""Median of the size of a standard normal number."""
DAY_S: Final = 86400.0
LEAST_SIGMA: Final = 1e-6  # Of the field, that an offset is uncertain by

STATES: Final = {
    "moved": "the offset moved at once, apart from its walk, and turned the heading by more than the target",
    "faster": "the offset walks faster than those of the other units, by more than chance explains",
    "steady": "neither",
    "short": "too little time to tell how fast it walks",
}
"""What each state of a unit means, in the order of urgency."""


@dataclass(frozen=True, slots=True)
class UnitWalk:
    """How the offset of a unit went."""

    unit: str  # name of the unit
    state: str  # one of the states in docs/fleet/drift.md
    estimates: int  # of the offset that are two hours apart or more
    begin_s: float  # time of the first, by the clock of the readings, from 1970 where that is known
    end_s: float  # time of the last
    walk: float  # by which the offset moves in an hour, 1 σ, in `unit_of_field`; it grows with the root of time
    walk_low: float  # of its 95 % interval
    walk_high: float  # of that
    walk_deg: float  # 1 σ of a level heading, at the worst one, that it makes in a day
    p_value: float  # how often chance makes a unit of this fleet walk as fast
    steps: int  # in which the offset moved apart from its walk
    moved: int  # how often its calibration has said `moved`; magnets that stayed for a while are among these
    offset: tuple[float, ...]  # the newest: x, y, z, in `unit_of_field`
    offset_sigma: tuple[float, ...]  # 1 σ of each
    heading_error_deg: float  # that its calibration claims at the end
    unit_of_field: str  # ``uT`` or ``counts``


@dataclass(frozen=True, slots=True)
class FleetWalk:
    """How the offsets of a fleet went."""

    units: int  # all of them
    states: Mapping[str, int]  # units in each of `STATES`
    listed: tuple[UnitWalk, ...]  # by urgency, then the fastest first; no more than were asked for
    steps: tuple[UnitStep, ...]  # the largest, no more than were asked for
    step_count: int  # how many there are
    step_units: int  # units that have one
    intervals: int  # between estimates, each tested for a step
    false_alarm_probability: float  # how often chance alone reports a step of a fleet; and so of faster units
    typical_walk_deg: float  # median of `walk_deg` of the units
    walk_spread: float  # factor within which the units scatter about that, 1 σ, beyond what is not known of each
    target_deg: float  # step of the heading that is good enough
    dip_deg: float | None  # of the field that headings are judged at; None where that of each unit was used
    #: of one unit alone its `time_s`, `offset` and `sigma`, each a list
    history: Mapping[str, Sequence[Any]] | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        return asdict(self)


def walks_of(
    paths: Sequence[str | os.PathLike[str]],
    *,
    target_deg: float = 1.0,
    dip_deg: float | None = None,
    most: int = 100,
    each: Callable[[Sequence[UnitWalk]], None] | None = None,
) -> FleetWalk:
    """Compare the walks of units.

    Raises `UsageError` for a target that is not positive, `DocumentError` for what holds no history.

    Parameters
    ----------
    paths : sequence of path
        What `flinders watch` has written, see `flinders.workflows.offset_history.histories_in`.
    target_deg : float
        Step of the heading that is good enough.
    dip_deg : float, optional
        Inclination of the field; by default that of each unit.
    most : int
        Units and steps that are listed.
    each : callable, optional
        Called with all units, in the order of their names.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    found = histories_in(paths)
    units, steps, intervals = list[UnitWalk](), list[UnitStep](), 0
    for path, name in found.items():
        history = OffsetHistory.read(path, name=name)
        history = history if dip_deg is None else replace(history, dip_deg=dip_deg)
        estimates = history.estimates
        changes = _changes_of(estimates, CHANCE / len(found))
        moved = np.isin(np.arange(len(estimates.time_s)), [change.after + 1 for change in changes])
        walk = walk_of(estimates.time_s, estimates.offset, estimates.sigma, moved)
        of_unit = [_step(estimates, change) for change in changes]
        units.append(_unit_of(history, estimates, walk, of_unit, target_deg))
        steps += of_unit
        intervals += max(len(estimates.time_s) - 1, 0)
    units, typical, spread = _compared(sorted(units, key=lambda one: one.unit))
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
        false_alarm_probability=CHANCE,
        typical_walk_deg=typical,
        walk_spread=spread,
        target_deg=target_deg,
        dip_deg=dip_deg,
        history=_listed(estimates) if len(units) == 1 else None,
    )


def _listed(estimates: OffsetHistory) -> dict[str, Sequence[Any]]:
    """The estimates of a unit."""
    return {name: getattr(estimates, name).tolist() for name in ("time_s", "offset", "sigma")}


def _urgency(one: UnitWalk) -> tuple[int, float, str]:
    """Key of the order in which units are listed."""
    return list(STATES).index(one.state), -one.walk_deg if math.isfinite(one.walk_deg) else math.inf, one.unit


def _unit_of(
    history: OffsetHistory, estimates: OffsetHistory, walk: Walk | None, steps: Sequence[UnitStep], target_deg: float
) -> UnitWalk:
    """What is known of a unit alone."""
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
    """Where the offset of a unit moved apart from its walk; none of one whose walk is not known."""
    walk = estimates.walk
    if walk is None:
        return []
    count, radius = len(estimates.time_s), estimates.radius
    sigma = np.maximum(estimates.sigma / radius, LEAST_SIGMA)
    covariance = np.square(sigma)[:, :, np.newaxis] * np.eye(3)
    series = OffsetSeries(np.array([0, count]), estimates.time_s, estimates.offset / radius, covariance)
    variance = Variance(random_walk=walk.rate / radius / math.sqrt(HOUR_S))
    return change_points(series, variance, chance=chance / (count - 1))


def _step(estimates: OffsetHistory, found: ChangePoint) -> UnitStep:
    """A step, as it is listed."""
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


def _compared(units: list[UnitWalk]) -> tuple[list[UnitWalk], float, float]:
    """Units with the chance that one of this fleet walks as fast, the median rate and the factor that they scatter by.

    Rates are compared by what they make of the heading.
    """
    rates = np.array([one.walk_deg for one in units])
    known = np.flatnonzero(np.isfinite(rates))
    if not len(known):
        return units, math.nan, math.nan
    middle = float(np.median(rates[known]))
    if len(known) < FEWEST:
        return units, middle, math.nan
    sigma = np.array([math.log(units[place].walk_high / units[place].walk_low) / 3.92 for place in known.tolist()])
    off = np.log(rates[known] / middle)
    scatter = float(np.median(np.abs(off))) / NORMAL_MEDIAN
    spread = math.sqrt(max(scatter**2 - float(np.median(sigma)) ** 2, 0.0))
    compared = list(units)
    for place, beyond in zip(known.tolist(), (off / np.hypot(sigma, spread)).tolist(), strict=True):
        one, chance = units[place], math.erfc(beyond / math.sqrt(2.0)) / 2.0
        is_faster = chance < CHANCE / len(units) and one.state == "steady"
        compared[place] = replace(one, p_value=chance, state="faster" if is_faster else one.state)
    return compared, middle, math.exp(spread)
