"""A guided calibration for programs with a page or a display of their own: readings in, what to do next out.

It is the session of the live page (`flinders.live.session`) with its fits (`flinders.live.evaluation`), without its
server: no thread, no socket, no clock. Time is that of the readings.

>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> session = Session(target_deg=1.0, unit="uT")
>>> for block in tumble.blocks(rows=100):                             # as they arrive, two seconds at a time
...     state = session.add(block.field, time=block.time)
...     if state.is_done:
...         break
>>> state.phase, state.verdict, state.readings < len(tumble)
('good', 'good', True)
>>> session.add([[20.0, 0.0, 45.0]], time=[1e3]).readings == state.readings + 1
True
>>> session.finish().verdict
'good'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, get_args

from flinders.core.axes import Axes
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.fitting.calibrate import Request
from flinders.likelihood.site_field import Site
from flinders.live.buffer import rows_of
from flinders.live.evaluation import evaluate, finished
from flinders.live.messages import Goal, SourceState
from flinders.live.page_state import session_state
from flinders.live.session import SHARE, Arrived, FitDone, LiveSession, Series, begin_fit, step, wants_fit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.fitting.result import Fit
    from flinders.live.messages import Phase, Reason, SessionState
    from flinders.report.view import Triple, View

SOURCE: Final = SourceState("the session", "simulated", "connected", "")


@dataclass(frozen=True, slots=True)
class State:
    """What a session has come to."""

    page: SessionState  #: all that the live page is told of it, see docs/live.md
    view: View | None  #: all that the live page draws of the newest fit; None before the first
    fit: Fit | None  #: the newest fit, also one that is refused; None where there is none

    @property
    def phase(self) -> Phase:
        """``collecting``, ``good``, ``limited`` (good for what its findings say) or ``wrong`` (see `reasons`)."""
        return self.page.phase

    @property
    def is_done(self) -> bool:
        """The target is reached, by several fits in a row."""
        return self.phase in ("good", "limited")

    @property
    def words(self) -> str:
        """A sentence for the person who turns the sensor."""
        return self.page.words

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """What is wrong or worth knowing: code, advice and severity of each."""
        return self.page.reasons

    @property
    def readings(self) -> int:
        """How many have come."""
        return self.page.readings

    @property
    def verdict(self) -> str:
        """Of the newest fit: ``good``, ``limited`` or ``refused``; empty where there is none."""
        return "" if self.fit is None else self.fit.verdict

    @property
    def heading_error_deg(self) -> float:
        """Worst heading error to expect of a level vehicle, 1 σ; infinite where there is no fit."""
        return float("inf") if self.fit is None else self.fit.heading_error_deg.worst

    @property
    def coverage(self) -> float:
        """Share of the directions that were seen, 0 to 1."""
        return 0.0 if self.fit is None else self.fit.coverage.fraction

    @property
    def turn(self) -> str:
        """Where to turn next, in words; empty where that is not known, or turning would gain nothing."""
        return "" if self.view is None or self.view.guidance is None else self.view.guidance.words

    @property
    def direction(self) -> Triple | None:
        """Where the field should point next: a unit vector in corrected sensor axes."""
        return None if self.view is None or self.view.guidance is None else self.view.guidance.direction


class Session:
    """Readings that arrive, fitted as they do.

    Parameters
    ----------
    target_deg, dip_deg : float
        As for `flinders.fit`.
    goal : str
        What the calibration is for: ``heading`` of a level vehicle, or ``attitude``, any.
    unit, axes : str
        Of the readings, as `flinders.read` takes them.
    rate_hz : float
        Readings a second, where they come without times.
    every_s : float
        Seconds of readings from one fit to the next; a fit takes some 0.02 s, the guidance with it.

    Raises
    ------
    UsageError
        For a target, goal, unit or axes that cannot be used, and times that are not positive.
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
        Request.of(Site.stated(inclination_deg=dip_deg), target_deg=target_deg)
        self._unit, self._axes, self._rate_hz, self._every_s = Unit.of(unit), Axes.of(axes), rate_hz, every_s
        series = Series(unit=self._unit, axes=self._axes)
        self._session = LiveSession(source=SOURCE, live=series, target_deg=target_deg, dip_deg=dip_deg, goal=goal)

    def add(
        self, readings: ArrayLike, *, time: ArrayLike | None = None, acceleration: ArrayLike | None = None
    ) -> State:
        """Take readings in, fit all of them where a fit is due, and say what they come to.

        Parameters
        ----------
        readings : (N, 3) or (3,), in the session's unit
            The newest readings of the magnetometer, in its own axes.
        time : (N,) float, s, optional
            Of any clock; by default readings follow each other at ``rate_hz``.
        acceleration : (N, 3) float, optional
            Specific force; the live page shows the attitude by it.

        Raises
        ------
        ArrayError
            For another shape.
        """
        samples = Samples.of(
            readings, unit=self._unit, axes=self._axes, time=time, acceleration=acceleration, source=SOURCE.name
        )
        rows = rows_of(samples)
        if samples.time is None:
            rows[:, 0] = (self._session.live.buffer.total + rows[:, 0]) / self._rate_hz
        if len(rows):
            at = self._session.timeline(rows[:, 0])[1].at
            self._session, _ = step(self._session, Arrived(at, rows, self._unit))
            self._fit_if_due(at)
        return self.state

    def _fit_if_due(self, at: float) -> None:
        """Fit what has come, if the last fit is long enough ago."""
        if not wants_fit(self._session, at):
            return
        evaluated = evaluate(begin_fit(self._session))
        self._session, _ = step(self._session, FitDone(at, evaluated, seconds=self._every_s * SHARE))

    @property
    def state(self) -> State:
        """What the readings so far come to."""
        evaluated = self._session.shown.evaluated
        return State(session_state(self._session), evaluated.view, evaluated.fit)

    def finish(self) -> Fit:
        """Fit all readings.

        Raises
        ------
        FitError
            Where they give no calibration; `Refused` carries the fit where there is one that cannot be trusted.
        """
        return finished(self._session, None, {}).fit
