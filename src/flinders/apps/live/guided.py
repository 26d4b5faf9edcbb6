"""Guided calibration for programs with their own display: readings in, the next turn out.

Uses no thread, socket or clock: time is that of the readings. Each state has a fit of all readings so far with its
verdict, and the first turn of the path that reaches the target soonest.

>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> session = Session(target_deg=1.0, unit="uT")
>>> for block in tumble.blocks(rows=100):                             # as they arrive, two seconds at a time
...     state = session.add(block.field, time=block.time)
...     if state.is_done:
...         break
>>> state.verdict, state.readings < len(tumble)
('good', True)
>>> session.add([[20.0, 0.0, 45.0]], time=[1e3]).readings == state.readings + 1
True
>>> session.finish().verdict
'good'
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, get_args

import numpy as np

from flinders.apps.live.buffer import ReadingBuffer, Timeline, rows_of
from flinders.apps.live.messages import Goal
from flinders.core.axes import Axes
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import FitError, UsageError, count_text
from flinders.fitting.advice import guidance_for
from flinders.fitting.calibrate import fit
from flinders.fitting.request import Request
from flinders.fitting.result import Refused
from flinders.fitting.verdict import headline_of
from flinders.heading import path_planning
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.findings.poses import Frame
    from flinders.fitting.result import Fit

SOURCE: Final = "the session"
MAX_PATH_ERROR_DEG: Final = 10.0  # No path is planned from a fit whose error is larger in some direction
TURN_RATE_DEGPS: Final = 90.0  # Assumed turn rate of a hand, degrees a second, for the number of readings along a path
MIN_GOOD_FITS: Final = 3  # Consecutive fits within the target needed, since one may be by chance


@dataclass(frozen=True, slots=True)
class State:
    """State of a session after some readings."""

    readings: int  #: number received
    fit: Fit | None = None  #: the newest fit, also a refused one; None without a fit
    refusal: str = ""  #: reason if there is no fit
    turn: str = ""  #: next turn, in words; empty if unknown or without gain
    direction: tuple[float, float, float] | None = None  #: direction wanted for the field, in corrected sensor axes
    is_done: bool = False  #: the target is reached, by three fits in a row

    @property
    def words(self) -> str:
        """A sentence for the user who turns the sensor."""
        return self.refusal if self.fit is None else headline_of(self.fit).words

    @property
    def verdict(self) -> str:
        """Verdict of the newest fit: ``good``, ``limited`` or ``refused``; empty without a fit."""
        return "" if self.fit is None else self.fit.verdict

    @property
    def heading_error_deg(self) -> float:
        """Worst expected heading error of a level vehicle, 1 σ, degrees; infinite without a fit."""
        return float("inf") if self.fit is None else self.fit.heading_error_deg.worst

    @property
    def coverage(self) -> float:
        """Share of directions that readings cover, 0 to 1."""
        return 0.0 if self.fit is None else self.fit.evidence.coverage.fraction


class Session:
    """Calibration session: fits readings as they arrive.

    Parameters
    ----------
    target_deg, dip_deg : float
        As for `flinders.fit`.
    goal : str
        Use of the calibration: ``heading`` of a level vehicle, or any ``attitude``.
    unit, axes : str
        Unit and axes of the readings, as for `flinders.read`.
    rate_hz : float
        Rate of readings that have no times.
    every_s : float
        Seconds of readings from one fit to the next; a fit with guidance takes about 0.02 s.

    Raises
    ------
    UsageError
        For an invalid target, goal, unit or axes, and times that are not positive.
    """

    def __init__(
        self,
        *,
        target_deg: float = 1.0,
        dip_deg: float | None = None,
        goal: Goal = "heading",
        unit: str = "counts",
        axes: str = "x,y,z",
        rate_hz: float = 50.0,
        every_s: float = 0.5,
    ) -> None:
        if goal not in get_args(Goal):
            raise UsageError(f"goal is {goal!r}: need {' or '.join(get_args(Goal))}")
        if not (rate_hz > 0.0 and every_s > 0.0):
            raise UsageError(f"rate_hz is {rate_hz:g} and every_s {every_s:g}: need positive numbers")
        self._site, self._target_deg, self._goal = Site.merge_stated(inclination_deg=dip_deg), target_deg, goal
        Request.of(self._site, target_deg=target_deg)
        self._unit, self._axes, self._rate_hz, self._every_s = Unit.of(unit), Axes.of(axes), rate_hz, every_s
        self._frame: Frame = "sensor" if self._axes.is_identity else "vehicle"
        self._buffer, self._timeline = ReadingBuffer.empty(), Timeline()
        self._due_s, self._within, self._state = 0.0, 0, State(0)

    def add(
        self, readings: ArrayLike, *, time: ArrayLike | None = None, acceleration: ArrayLike | None = None
    ) -> State:
        """Add readings, fit all of them if a fit is due, and return the state.

        Parameters
        ----------
        readings : (N, 3) or (3,), in the session's unit
            The newest readings of the magnetometer, in its own axes.
        time : (N,) float, s, optional
            Times of any clock; by default at intervals of 1/``rate_hz``.
        acceleration : (N, 3) float, optional
            Specific force.

        Raises
        ------
        ArrayError
            For another shape.
        """
        samples = Samples.of(
            readings, unit=self._unit, axes=self._axes, time=time, acceleration=acceleration, source=SOURCE
        )
        rows = rows_of(samples)
        if samples.time is None:
            rows[:, 0] = (self._buffer.total + rows[:, 0]) / self._rate_hz
        rows[:, 0], self._timeline = self._timeline(rows[:, 0])
        self._buffer = self._buffer.with_rows(rows)
        self._state = replace(self._state, readings=self._buffer.total)
        if len(rows) and self._timeline.at >= self._due_s:
            self._due_s = self._timeline.at + self._every_s
            self._state = self._state_of_fit()
        return self._state

    def __repr__(self) -> str:
        state = self._state
        what = state.refusal or "no fit yet" if state.fit is None else repr(state.fit)
        return f"Session({count_text(state.readings, 'reading')}: {what})"

    @property
    def state(self) -> State:
        """State after the readings so far."""
        return self._state

    def finish(self) -> Fit:
        """Fit all readings.

        Raises
        ------
        FitError
            If there is no calibration; `Refused` carries a fit that cannot be trusted.
        """
        return fit(self._samples(), target_deg=self._target_deg, site=self._site)

    def _samples(self) -> Samples:
        buffer = self._buffer
        acceleration = buffer.acceleration if buffer.has_acceleration else None
        return Samples(
            field=buffer.field, unit=self._unit, axes=self._axes, time=buffer.time, acceleration=acceleration,
            source=SOURCE,
        )  # fmt: skip

    def _state_of_fit(self) -> State:
        """Fit all readings, and return the new state."""
        found: Fit | None
        try:
            found, refusal = self.finish(), ""
        except Refused as refused:
            found, refusal = refused.fit, ""
        except FitError as error:
            found, refusal = None, error.message
        turn, direction = self._turn(found)
        self._within = self._within + 1 if self._is_within(found) else 0
        return State(self._buffer.total, found, refusal, turn, direction, self._within >= MIN_GOOD_FITS)

    def _is_within(self, found: Fit | None) -> bool:
        """Whether a fit is good or limited, and its error for the goal within the target."""
        if found is None or found.verdict == "refused":
            return False
        worst = found.heading_error_deg.worst
        if self._goal == "attitude":
            worst = max(worst, guidance_for(found, "attitude").worst_deg)
        return worst <= self._target_deg

    def _turn(self, found: Fit | None) -> tuple[str, tuple[float, float, float] | None]:
        """Next turn, in words and as a direction of the field: the first of the path, else to the best direction."""
        route = self._route(found)
        if route is not None:
            x, y, z = route.waypoints[0].tolist()
            return route.words(self._frame), (x, y, z)
        if found is None or not found.claim.states_uncertainty or found.judgement.is_flat:
            return "", None
        advice = guidance_for(found, self._goal)
        x, y, z = advice.direction.tolist()
        return advice.words(self._frame), (x, y, z)

    def _route(self, found: Fit | None) -> path_planning.Route | None:
        """The path from the newest reading; None without gain."""
        if found is not None and found.claim.plane:
            return None
        belief = believe(found, self._buffer.field)
        here = np.zeros(3) if belief is None else belief.direction(self._buffer.latest[1:4])
        if belief is None or not here.any():
            return None
        dip_deg = ASSUMED_DIP_DEG if found is None else found.claim.dip_deg
        is_seen_from_below = found is not None and found.heading_error_deg.dip_deg * dip_deg < 0.0
        route = path_planning.plan(
            belief,
            here,
            target_deg=self._target_deg,
            goal=self._goal,
            dip_deg=dip_deg,
            down=np.array([0.0, 0.0, -1.0]) if is_seen_from_below else None,
            readings_per_deg=self._readings_per_deg(),
        )
        is_gain = len(route.waypoints) > 0 and (route.worst_deg > self._target_deg or belief.is_rough)
        return route if is_gain else None

    def _readings_per_deg(self) -> float:
        """Number of readings per degree of turn, at the assumed turn rate."""
        seconds = self._buffer.seconds - float(self._buffer.time[0])
        return (self._buffer.total - 1) / seconds / TURN_RATE_DEGPS if seconds > 0.0 else path_planning.READINGS_PER_DEG


def believe(found: Fit | None, readings: Floats) -> path_planning.Belief | None:
    """Belief from which a path is planned, after (N, 3) readings: from the claim of a fit, else a rough sphere.

    A refused fit is used too, unless its readings are flat or its error is larger than `MAX_PATH_ERROR_DEG`.
    """
    if found is None or found.judgement.is_flat or found.claim.direction_error_deg.worst > MAX_PATH_ERROR_DEG:
        return path_planning.rough_belief(readings)
    return path_planning.Belief.of(found.claim, found.evidence.noise, found.evidence.coverage)
