"""Runs an online calibration on a source; writes events at once, and the state periodically.

Readings are processed in whole seconds of their own time, so that a replayed recording gives the same lines as the live
sensor.

>>> from flinders import simulate
>>> from flinders.apps.service.sources import of_recordings
>>> watch = Watch(of_recordings([simulate.tumble(seed=1).samples]), tell=lambda report: print(report.line()))
>>> watch.run().verdict
4.8 s  a first calibration was found  heading error 0.92°, ...
'good'
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter, deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from flinders.apps.service.clocks import duration
from flinders.apps.service.kept import RetriedFile
from flinders.apps.service.reports import Report, date_of, moment, words_of
from flinders.apps.service.sources import disturbance_values, raw_readings, raw_unit
from flinders.core.files import write_text
from flinders.errors import UnitError
from flinders.links.feeds import FeedEvent
from flinders.workflows.offset_history import adoption_file_name
from flinders.workflows.online import OnlineCalibration

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.apps.service.handover import Handover
    from flinders.apps.service.publishing import Publisher
    from flinders.apps.service.reports import Kind
    from flinders.apps.service.sources import Source
    from flinders.arrays import Floats
    from flinders.core.offset_walk import Walk
    from flinders.core.samples import Samples
    from flinders.core.units import Unit
    from flinders.errors import OutputError
    from flinders.fitting.result import Fit
    from flinders.workflows.online_events import OnlineEvent, OnlineState

WAIT_S: Final = 0.1  # Longest wait for readings, and so the delay to notice the end
PERIOD_S: Final = 60.0
MAX_BATCH: Final = 8192  # Largest number of readings of one second to process together
MAX_DELAY_S: Final = 2.0  # Longest time that readings wait for the end of their second
MAX_SILENCE_S: Final = 10.0  # Time without a reading after which it is reported
PAGE_S: Final = 2.0  # Shortest time between two versions of the page, as a recording may have many events in it
MAX_PAGE_REPORTS: Final = 30  # Largest number of events of the source and changed verdicts on the page


@dataclass(frozen=True, slots=True)
class InitialSettings:
    """Settings of a new calibration.

    ``start``, ``axes``, ``target_deg``, ``dip_deg`` and ``walk`` are as for `OnlineCalibration`; ``walk_unit`` is the
    unit of the walk, if known. The calibration has the unit and frame of the first reading.
    """

    start: Fit | None = None
    axes: str = "x,y,z"
    target_deg: float = 1.0
    dip_deg: float | None = None
    walk: Walk | float | None = None
    walk_unit: str | None = None

    def calibration(self, unit: Unit, frame: str = "sensor") -> OnlineCalibration:
        """Return a new calibration for readings in a unit and in axes of the sensor or the vehicle.

        Raises `UnitError` if the walk is in another unit.
        """
        if self.walk_unit not in (None, unit.inside):
            raise UnitError(
                f"the random walk is in {self.walk_unit}, readings are in {unit.name}: use the history of this sensor"
            )
        return OnlineCalibration(
            self.start,
            unit=unit,
            axes=self.axes,
            frame=frame,
            target_deg=self.target_deg,
            dip_deg=self.dip_deg,
            walk=self.walk,
        )


@dataclass(frozen=True, slots=True)
class Files:
    """Output files; None for those not written."""

    state: str | None = None  # for `OnlineCalibration.load`
    adopted: str | None = None  # calibration file, or folder of them
    status: str | None = None  # JSON
    prometheus: str | None = None  # text for the node exporter
    page: str | None = None  # HTML


class Watch:
    """An online calibration on the readings of a source, with its outputs.

    Parameters
    ----------
    source : Source
    calibration : OnlineCalibration or InitialSettings
        The calibration to continue, or settings of a new one, which begins with the first reading.
    files : Files
    every : float, s
        Period of writing files and reporting the state, by the readings' time.
    is_locked : bool
        Whether the calibration in force stays, despite newer estimates.
    handover, publisher : Handover and Publisher, optional
        Sender of calibrations that come into force; publisher of corrected readings.
    tell : callable
        Receives reports of events, and periodic states.
    say : callable
        Receives messages for the user.
    stopped : callable
        Returns True to end.
    clock : callable
        Returns ascending seconds.
    """

    def __init__(
        self,
        source: Source,
        calibration: OnlineCalibration | InitialSettings | None = None,
        *,
        files: Files | None = None,
        every: float = PERIOD_S,
        is_locked: bool = False,
        handover: Handover | None = None,
        publisher: Publisher | None = None,
        tell: Callable[[Report], object] = lambda _: None,
        say: Callable[[str], object] = lambda _: None,
        stopped: Callable[[], bool] = lambda: False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source, self._files, self._every = source, files or Files(), every
        self._begun = calibration if isinstance(calibration, InitialSettings) else InitialSettings()
        self._online = calibration if isinstance(calibration, OnlineCalibration) else None
        self._is_locked, self._tell, self._say, self._stopped, self._clock = is_locked, tell, say, stopped, clock
        self._unit, since = unit_of(calibration or self._begun), since_of(calibration or self._begun)
        self._since = -math.inf if since is None else since  # readings up to this time were processed by an earlier run
        if self._online is not None:
            self._online.is_locked = is_locked
        self._field, self._time = np.empty((0, 3)), np.empty(0)
        self._driving: dict[str, Floats] = {}
        self._heard = clock()
        self._due = math.nan
        self._verdict = "refused" if self._online is None else self._online.state.verdict
        self._readings, self._disconnections = 0, 0
        self._events: Counter[str] = Counter()
        self._is_connected, self._is_over, self._is_quiet = True, False, False
        self._advised: set[str] = set()
        self._adopted: tuple[Fit, float] | None = None
        self._handover, self._publisher = handover, publisher
        self._told: deque[Report] = deque(maxlen=MAX_PAGE_REPORTS)
        self._page_at, self._is_page_due = -math.inf, True
        written = self._files
        named = (written.state, written.adopted, written.status, written.prometheus, written.page)
        self._state, self._calibration, self._status, self._metrics, self._page = (
            RetriedFile(name or "", say) for name in named
        )

    def run(self) -> Report:
        """Run until the source ends or `stopped` returns True; writes the state at the end in any case.

        Raises
        ------
        OutputError
            If the state cannot be written at the end.
        FlindersError
            Errors of the source.
        """
        try:
            if self._online is not None and self._online.is_converted:
                self._note(self._online.history[-1:])
            while not self._is_over and not self._stopped():
                self._take(self._source.next(WAIT_S))
                if self._publisher is not None:
                    self._publisher.publish(self._online, self._now())
                self._hand_over()
                self._show()
            self._flush()
        finally:
            self._write()
            self._show(is_last=True)
            with contextlib.suppress(OSError):
                self._source.close()
        report = self.report()
        self._tell(report)
        if (failure := self.failure) is not None:
            raise failure
        return report

    @property
    def readings(self) -> int:
        """Number of processed readings."""
        return self._readings

    @property
    def failure(self) -> OutputError | None:
        """Error of writing the state or the calibration; None if both are on the disk."""
        return self._state.failure or self._calibration.failure

    def report(
        self, kind: Kind = "state", event: str | None = None, words: str | None = None, *, now: float | None = None
    ) -> Report:
        """Make a report on the state at a time, by default now."""
        now = self._now() if now is None else now
        online = self._online
        state = self._state_at(now)
        until = math.nan if online is None else online.good_until_s
        return Report(
            kind,
            event,
            words,
            time_s=now,
            time=date_of(now),
            doing="learning" if state is None else state.doing,
            verdict="refused" if state is None else state.verdict,
            heading_error_deg=None if state is None else state.heading_error_deg,
            bound_deg=None if state is None else state.bound_deg,
            latest_deg=None if state is None else state.latest_deg,
            age_s=None if state is None else state.age_s,
            walk=None if state is None else state.walk,
            offset=None if state is None else state.offset,
            offset_sigma=None if state is None else state.offset_sigma,
            radius=None if state is None else state.radius,
            unit=None if self._unit is None else self._unit.inside,
            target_deg=self._begun.target_deg if state is None else state.target_deg,
            good_until_s=until,
            good_until=date_of(until),
            is_locked=self._is_locked,
            readings=self._readings,
            events=dict(self._events),
            not_understood=self._source.not_understood,
            disconnections=self._disconnections,
            is_connected=self._is_connected and not self._is_quiet,
            source=self._source.name,
        )

    @property
    def _newest(self) -> float:
        """Time of the newest processed reading; NaN without one."""
        return math.nan if self._online is None else self._online.time_s

    def _now(self) -> float:
        """Current time by the source's clock if it runs without readings, else the time of the newest reading."""
        times = [each for each in (self._newest, self._source.now) if each is not None and math.isfinite(each)]
        return max(times, default=math.nan)

    def _state_at(self, now: float) -> OnlineState | None:
        online = self._online
        if online is None:
            return None
        return online.at(now) if math.isfinite(now) else online.state

    def _take(self, received: Samples | FeedEvent | None) -> None:
        for words in self._source.remarks():
            self._tell_of_source("clock", words)
        if isinstance(received, FeedEvent):
            self._handle_event(received)
        elif received is not None:
            self._heard = self._clock()
            if self._is_quiet:
                self._is_quiet = False
                self._tell_of_source("readings", "readings come again")
            self._learn(received)
        elif self._source.now is not None:
            self._wait()

    def _learn(self, samples: Samples) -> None:
        """Add readings, and process those of whole seconds."""
        if self._online is None:
            self._unit = self._unit or raw_unit(samples)
            self._online = self._begun.calibration(self._unit, samples.frame)
            self._online.is_locked = self._is_locked
        assert self._unit is not None
        assert samples.time is not None
        is_new = samples.time > self._since
        if not is_new.all():
            if "known" not in self._advised:
                self._advised.add("known")
                self._tell_of_source("known", f"readings until {moment(self._since)} were processed before: left out")
            samples = samples[is_new]
        if not len(samples):
            return
        self._since = -math.inf
        readings = raw_readings(samples, self._unit)
        assert samples.time is not None
        self._field = np.concatenate([self._field, readings])
        self._time = np.concatenate([self._time, samples.time])
        self._driving = {
            name: np.concatenate([self._driving.get(name, np.empty(0)), disturbance_values(samples, name)])
            for name in self._online.disturbances
        }
        seconds = np.floor(self._time)
        ends = (np.flatnonzero(np.diff(seconds)) + 1).tolist()
        if len(self._time) - (ends[-1] if ends else 0) > MAX_BATCH:
            ends.append(len(self._time))
        self._learn_to(ends)

    def _learn_to(self, ends: list[int]) -> None:
        """Process waiting readings, in pieces that end at the indices `ends`."""
        for start, end in zip([0, *ends], ends, strict=False):
            self._learn_piece(slice(start, end))
        if ends:
            self._field, self._time = self._field[ends[-1] :], self._time[ends[-1] :]
            self._driving = {name: values[ends[-1] :] for name, values in self._driving.items()}

    def _flush(self) -> None:
        """Process all waiting readings."""
        if len(self._time):
            self._learn_to([len(self._time)])

    def _learn_piece(self, rows: slice) -> None:
        assert self._online is not None
        times, driving = self._time[rows], {name: values[rows] for name, values in self._driving.items()}
        happened = self._online.add(self._field[rows], time=times, **driving)
        self._readings += len(times)
        self._note(happened)
        self._tick(float(times[-1]))

    def _note(self, happened: tuple[OnlineEvent, ...]) -> None:
        """Report events, and a verdict that changed without an event."""
        assert self._online is not None
        for event in happened:
            self._events[event.code] += 1
            if event.code == "adopted":
                self._adopt(event.time_s)
            report = self.report("event", event.code, words_of(event.code), now=self._newest)
            error = event.heading_error_deg
            self._is_page_due = True
            self._tell(replace(report, time_s=event.time_s, time=date_of(event.time_s), heading_error_deg=error))
        self._tell_of_verdict(self._newest, is_told=bool(happened))

    def _tell_of_verdict(self, now: float, *, is_told: bool = False) -> None:
        """Report a verdict that changed with time."""
        state = self._state_at(now)
        verdict = "refused" if state is None else state.verdict
        if verdict != self._verdict and not is_told:
            self._events[verdict] += 1
            self._tell_and_keep(self.report("event", verdict, words_of(verdict), now=now))
        self._verdict = verdict

    def _wait(self) -> None:
        """Process waiting readings when no further ones arrive, and advance time."""
        quiet = self._clock() - self._heard
        if quiet > MAX_DELAY_S:
            self._flush()
        if quiet > MAX_SILENCE_S and not self._is_quiet and self._is_connected and self._readings:
            self._is_quiet = True
            self._tell_of_source(
                "silent", f"no reading for {duration(MAX_SILENCE_S)}: check that the sensor is on and prints"
            )
        now = self._now()
        if math.isfinite(now) and quiet > MAX_DELAY_S:
            self._tell_of_verdict(now)
            self._tick(now)

    def _tick(self, now: float) -> None:
        """Write files and report the state if due."""
        if not now < self._due:
            if not math.isnan(self._due):
                self._write()
                self._tell(self.report(now=now))
            self._due = now + self._every - math.fmod(now, self._every)

    def _adopt(self, time_s: float) -> None:
        """Store an adopted calibration, and write it to its file if one is named."""
        assert self._online is not None
        fit = self._online.fit
        if fit is not None and self._files.adopted is not None:
            self._adopted = fit, time_s
            self._write_adopted()

    def _write_adopted(self) -> None:
        """Write the adopted calibration, unless already written."""
        path = self._files.adopted
        if path is None or self._adopted is None:
            return
        fit, time_s = self._adopted
        file = Path(path) / adoption_file_name(time_s) if Path(path).is_dir() else Path(path)
        if self._calibration.write(lambda: fit.save(file, force=True)):
            self._adopted = None

    def _hand_over(self) -> None:
        """Send the calibration in force if due, and report the outcome."""
        if self._handover is None or self._online is None:
            return
        happened = self._handover.send_if_due(self._online, self._now())
        if happened is None:
            return
        event, words = happened
        self._events[event] += event != "waits"
        self._tell_and_keep(self.report("send", event, words))

    def _show(self, *, is_last: bool = False) -> None:
        """Write the page if it has changed; the last page does not reload itself."""
        path = self._files.page
        if path is None or not (is_last or (self._is_page_due and self._clock() - self._page_at >= PAGE_S)):
            return
        self._page_at, self._is_page_due = self._clock(), False
        from flinders.apps.service.watch_page import page

        kept = (self._state, self._calibration, self._status, self._metrics)
        text = page(
            self.report(),
            self._online,
            told=list(self._told),
            troubles=[file.failure.message for file in kept if file.failure is not None],
            not_sent="" if self._handover is None else self._handover.failure,
            every=None if is_last else self._every,
        )
        self._page.write(lambda: write_text(text, path, force=True))

    def _write(self) -> None:
        """Write all files except the page, and mark the page as due."""
        online, files = self._online, self._files
        self._is_page_due = True
        if (path := files.state) is not None and online is not None:
            self._state.write(lambda: online.save(path))
        self._write_adopted()
        if files.status is None and files.prometheus is None:
            return
        report = self.report()
        if (status := files.status) is not None:
            text = msgspec.json.format(msgspec.json.encode(report.as_dict()), indent=2).decode()
            self._status.write(lambda: write_text(text + "\n", status, force=True))
        if (metrics := files.prometheus) is not None:
            self._metrics.write(lambda: write_text(report.prometheus(), metrics, force=True))

    def _handle_event(self, event: FeedEvent) -> None:
        """Report an event of the source."""
        match event.kind:
            case "ended":
                self._is_over = True
                return
            case "gone":
                self._is_connected = False
                self._disconnections += 1
                self._flush()
            case "back":
                self._is_connected = True
            case "garbage" | "unclear" | "no-answer" | "lost":
                if event.kind in self._advised:
                    return
                self._advised.add(event.kind)
        self._tell_of_source(event.kind, self._words_of(event))

    def _words_of(self, event: FeedEvent) -> str:
        """Sentence on an event of the source, without the recorder's words on recording."""
        lines = self._source.statistics
        match event.kind:
            case "gone":
                return f"{event.words}. Waiting for its return"
            case "garbage":
                return "lines of another format than the first ones are left out and counted"
            case "unclear":
                header = "" if lines is None or lines.form is None else f", three of {lines.form.header}"
                return f"the magnetometer's columns are ambiguous: name them{header}, and the unit"
        return event.words

    def _tell_of_source(self, event: str, words: str) -> None:
        self._tell_and_keep(self.report("source", event, words))

    def _tell_and_keep(self, report: Report) -> None:
        """Report an event that is not in the calibration's history, and store the report for the page."""
        self._told.append(report)
        self._is_page_due = True
        self._tell(report)


def unit_of(calibration: OnlineCalibration | InitialSettings) -> Unit | None:
    """Unit of a calibration's readings; None if the first reading decides."""
    if isinstance(calibration, OnlineCalibration):
        return calibration.unit
    return None if calibration.start is None else calibration.start.calibration.raw


def frame_in(calibration: OnlineCalibration | InitialSettings) -> str | None:
    """Axes of a calibration's readings, ``sensor`` or ``vehicle``; None if the first reading decides."""
    if isinstance(calibration, OnlineCalibration):
        return calibration.frame if calibration.state.doing != "learning" else None
    return None if calibration.start is None else calibration.start.calibration.frame


def since_of(calibration: OnlineCalibration | InitialSettings) -> float | None:
    """Time of the last reading of a calibration to continue; None for a new calibration."""
    reached = calibration.time_s if isinstance(calibration, OnlineCalibration) else math.nan
    return reached if math.isfinite(reached) else None
