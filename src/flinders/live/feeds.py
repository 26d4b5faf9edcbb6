"""Feeds: readings of a running sensor, and what happens to it in between; a recording is one, played back.

>>> from flinders import simulate
>>> feed = Replay(simulate.tumble(seed=1).samples, speed=None)     # as fast as it is asked
>>> feed.next(0.1).words
'simulated hand, played back as fast as possible'
>>> [len(feed.next(0.1)) for _ in range(6)], feed.next(0.1).kind
([500, 500, 500, 500, 500, 500], 'ended')
>>> samples = Samples.of([[217, 4, -586]], unit="mG", time=[0.1], acceleration=[[0, 0, 9.8]])
>>> readings_of(samples)
[Reading(time=0.1, field=(21.7, 0.4, -58.6), unit='uT', acceleration=(0.0, 0.0, 9.8), rate=None, temperature=None)]
>>> samples_of(readings_of(samples)).field
array([[ 21.7,   0.4, -58.6]])
>>> print(FeedEvent("gone", 12.5, "/dev/ttyACM0 is gone: check the cable"))
12.5 s: /dev/ttyACM0 is gone: check the cable

A feed knows no thread and no event loop: one thread asks, and each question takes at most its timeout. `Recorder` is
one, for what arrives as lines; so are `Telemetry` and `SimulatedFeed`. `flinders.live.recorder.RecordedFeed` records
those that are no lines. `FeedThread` asks, and queues the answers, whatever the server is doing meanwhile.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from flinders.core.samples import Samples
from flinders.core.units import MICROTESLA, Unit
from flinders.errors import FlindersError, UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Recording

AT_ONCE: Final = 500
"""Readings handed on together at most."""
ASSUMED_HZ: Final = 50.0
"""Readings a second of a recording without times."""
LONGEST_GAP_S: Final = 2.0
"""Seconds that a pause of a recording takes when it is played back, at most."""
SHORTEST_S: Final = 1e-4
"""Least wait."""


Vector: TypeAlias = tuple[float, float, float]

Kind: TypeAlias = Literal["connected", "settled", "nothing", "garbage", "lost", "gone", "back", "ended"]
"""It is there; how its lines are written is known; nothing usable has come for a while; lines that are not like the
first ones; this machine was too busy to take all; it went away; it is there again; nothing more will come."""


class Reading(NamedTuple):
    """One reading.

    Attributes
    ----------
    time : float, s
        By the sensor's clock where it has one, else since the start.
    field : (3,) float, in `unit`
        As measured, in the axes of the sensor; finite.
    unit : str
        ``uT``, or ``counts`` where no scale is known.
    acceleration : (3,) float, optional
        Specific force in any unit.
    rate : (3,) float, rad/s, optional
    temperature : float, °C, optional
    """

    time: float
    field: Vector
    unit: str
    acceleration: Vector | None = None
    rate: Vector | None = None
    temperature: float | None = None


@dataclass(frozen=True, slots=True)
class FeedEvent:
    """Something that happened to a source of readings.

    Attributes
    ----------
    kind : str
        As `Kind`.
    at : float, s
        Since the start.
    words : str
        For people.
    """

    kind: Kind
    at: float
    words: str

    def __str__(self) -> str:
        return f"{self.at:.1f} s: {self.words}"


def readings_of(samples: Samples) -> list[Reading]:
    """Take samples apart; without a time they are 0 s apart, and auxiliary values that are not finite become None."""
    times = np.zeros(len(samples)) if samples.time is None else samples.time
    auxiliary = zip(
        _vectors(samples.acceleration, len(samples)),
        _vectors(samples.rate, len(samples)),
        [None] * len(samples) if samples.temperature is None else samples.temperature.tolist(),
        strict=True,
    )
    return [
        Reading(time, (x, y, z), samples.unit.inside, acceleration, rate, _finite(temperature))
        for time, (x, y, z), (acceleration, rate, temperature) in zip(
            times.tolist(), samples.field.tolist(), auxiliary, strict=True
        )
    ]


def samples_of(readings: Sequence[Reading], source: str = "live") -> Samples:
    """Put readings together, ready for a fit; what only some of them have is NaN in the others.

    Raises
    ------
    UnitError
        For readings in more than one unit.
    """
    inside = {reading.unit for reading in readings} or {MICROTESLA}
    unit = Unit.of(inside.pop())
    if inside:
        raise UnitError(f"{source} has readings in {unit.inside} and in {inside.pop()}: take those in one unit")
    return Samples.of(
        [reading.field for reading in readings] or np.empty((0, 3)),
        unit=unit,
        time=[reading.time for reading in readings],
        acceleration=_column([reading.acceleration for reading in readings]),
        rate=_column([reading.rate for reading in readings]),
        temperature=_alone([reading.temperature for reading in readings]),
        source=source,
    )


def _vectors(rows: Floats | None, count: int) -> list[Vector | None]:
    if rows is None:
        return [None] * count
    return [(x, y, z) if math.isfinite(x + y + z) else None for x, y, z in rows.tolist()]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _column(rows: list[Vector | None]) -> list[Vector] | None:
    nothing = (math.nan, math.nan, math.nan)
    return [row or nothing for row in rows] if any(row is not None for row in rows) else None


def _alone(values: list[float | None]) -> list[float] | None:
    there = any(value is not None for value in values)
    return [math.nan if value is None else value for value in values] if there else None


class Feed(Protocol):
    """A source of readings.

    Attributes
    ----------
    name : str
        For messages: ``/dev/ttyACM0``, ``tumble.csv``.
    """

    @property
    def name(self) -> str:
        """For messages."""

    def next(self, timeout: float) -> list[Reading] | FeedEvent:
        """Return what has come: readings, in order, or one event; nothing where nothing came in `timeout` seconds.

        After an event ``ended`` nothing comes, and each question is answered with nothing.

        Raises
        ------
        FlindersError
            For what cannot be waited out; a source that is gone for a while is an event.
        """

    def close(self) -> None:
        """Let go of the source; closing twice does no harm."""


class Replay:
    """Plays a recording back, in the time that it took or faster.

    Parameters
    ----------
    recording : Recording
        Anything that `flinders.open_recording` opens, or samples.
    speed : float, optional
        So many times as fast as it was recorded; None for as fast as it is asked. Pauses of more than two seconds are
        shortened to two. A recording without times is taken to have 50 readings a second.
    clock, sleep : callable
        Seconds, ascending; and wait.

    Raises
    ------
    UsageError
        For a speed that is not positive.
    """

    def __init__(
        self,
        recording: Recording,
        *,
        speed: float | None = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if speed is not None and not 0 < speed < np.inf:
            raise UsageError(f"speed is {speed:g}: need a number above 0, or none for as fast as possible")
        self.name = recording.source
        self._speed, self._clock, self._sleep = speed, clock, sleep
        self._blocks: Iterator[Samples] = recording.blocks()
        self._readings: list[Reading] = []
        self._due: Floats = np.zeros(0)
        self._played, self._last, self._count = 0.0, np.nan, 0
        self._start = clock()
        self._is_announced = self._is_over = False

    def next(self, timeout: float) -> list[Reading] | FeedEvent:
        """As `Feed.next`.

        Raises
        ------
        InputError
            Where the recording cannot be read to its end.
        """
        if not self._is_announced:
            self._is_announced, self._start = True, self._clock()
            how = "as fast as possible" if self._speed is None else f"at {self._speed:g} times its speed"
            return FeedEvent("connected", 0.0, f"{self.name}, played back {how}")
        if not self._readings and not self._is_over:
            self._load()
        if self._is_over:
            return self._ended(timeout)
        ready = AT_ONCE if self._speed is None else self._ready(timeout)
        taken, self._readings, self._due = self._readings[:ready], self._readings[ready:], self._due[ready:]
        return taken

    def close(self) -> None:
        """As `Feed.close`."""
        self._readings, self._is_over = [], True

    def _load(self) -> None:
        """Take the next block, and say when each of its readings is due."""
        block = next(self._blocks, None)
        if block is None:
            self._is_over = True
            return
        counted = (self._count + np.arange(len(block))) / ASSUMED_HZ
        times = counted if block.time is None else block.time
        self._count += len(block)
        steps = np.diff(times, prepend=self._last if np.isfinite(self._last) else times[0])
        steps = np.clip(np.nan_to_num(steps), 0.0, LONGEST_GAP_S)
        self._due = self._played + np.cumsum(steps) / (self._speed or 1.0)
        self._played, self._last = float(self._due[-1]), float(times[-1])
        self._readings = [
            reading._replace(time=at) for reading, at in zip(readings_of(block), times.tolist(), strict=True)
        ]

    def _ready(self, timeout: float) -> int:
        """Count the readings that are due, after waiting for the first of them."""
        wait = float(self._due[0]) - (self._clock() - self._start)
        if wait > 0:
            self._sleep(max(min(wait, timeout), SHORTEST_S))
        ready = int(np.searchsorted(self._due, self._clock() - self._start, side="right"))
        return min(ready, AT_ONCE)

    def _ended(self, timeout: float) -> list[Reading] | FeedEvent:
        if self._blocks is not _NOTHING:
            self._blocks = _NOTHING
            return FeedEvent("ended", self._clock() - self._start, f"{self.name} has been played to its end")
        self._sleep(timeout)
        return []


_NOTHING: Final[Iterator[Samples]] = iter(())


Result = TypeVar("Result")

ASK_S: Final = 0.05
"""Longest wait of one question."""
REST_S: Final = 0.045
"""From an answer to the next question, where little came: what comes meanwhile is then read in one go. A little below a
twentieth of a second, so that pages get twenty updates in each."""
LITTLE: Final = 40
"""Readings of an answer; a faster sensor is asked again at once, before what the system keeps for it is full."""
FULL: Final = 250_000
"""Readings that wait to be taken, at most: a recording played back as fast as possible waits for the server then."""
FULL_S: Final = 0.01
STOPPING_S: Final = 10.0
"""Seconds that a feed has to let go: longer than any of them waits for a host."""


class FeedThread(threading.Thread):
    """Asks a feed until it has ended, or is told to stop; what else is to be done on its thread is a job between two.

    Parameters
    ----------
    feed : Feed

    Attributes
    ----------
    tell : callable
        Called on the feed's thread when something is in the queue.

    Examples
    --------
    >>> from flinders import simulate
    >>> thread = FeedThread(Replay(simulate.tumble(seed=1, n=100).samples, speed=None))
    >>> thread.start()
    >>> thread.join()
    >>> [type(received).__name__ for received in thread.taken()]
    ['FeedEvent', 'list', 'FeedEvent']
    """

    def __init__(self, feed: Feed) -> None:
        super().__init__(name="feed", daemon=True)
        self.tell: Callable[[], object] = lambda: None
        self._feed = feed
        self._queue: deque[list[Reading] | FeedEvent] = deque()
        self._jobs: deque[Callable[[], None]] = deque()
        self._stopping = threading.Event()
        self._is_over = False
        self._put = self._got = 0

    def run(self) -> None:
        """Ask; a feed that fails for good is one that has gone, and its reason is told."""
        try:
            while not self._stopping.is_set() and not self._is_over:
                self._do_jobs()
                if self._put - self._got >= FULL:
                    self._stopping.wait(FULL_S)
                else:
                    self._ask()
        except FlindersError as error:
            self._queue.append(FeedEvent("gone", 0.0, str(error)))
        except Exception as error:  # noqa: BLE001 - a thread that ends without a word would look like a silent sensor
            self._queue.append(
                FeedEvent("gone", 0.0, f"internal error: {type(error).__name__}: {error}; please report it")
            )
        finally:
            self._is_over = True
            self._do_jobs()
            with contextlib.suppress(FlindersError):
                self._feed.close()

    def taken(self) -> list[list[Reading] | FeedEvent]:
        """All that has come since this was last called, in order."""
        received = []
        while self._queue:
            received.append(self._queue.popleft())
            self._got += _size(received[-1])
        return received

    def do(self, job: Callable[[], Result]) -> Future[Result]:
        """Do something on the feed's thread, soon; where that has ended, at once."""
        future: Future[Result] = Future()

        def done() -> None:
            try:
                future.set_result(job())
            except BaseException as error:  # noqa: BLE001 - belongs to whoever waits for the result
                future.set_exception(error)

        self._jobs.append(done)
        if self._is_over:
            self._do_jobs()
        return future

    def stop(self) -> None:
        """Ask no more, and wait until the feed has written what it holds."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOPPING_S)

    def _ask(self) -> None:
        received = self._feed.next(ASK_S)
        if received:
            self._put += _size(received)
            self._queue.append(received)
            self.tell()
        if isinstance(received, FeedEvent):
            self._is_over = received.kind == "ended"
        elif 0 < len(received or ()) < LITTLE:
            self._stopping.wait(REST_S)

    def _do_jobs(self) -> None:
        while True:
            try:
                job = self._jobs.popleft()
            except IndexError:
                return
            job()


def _size(received: list[Reading] | FeedEvent) -> int:
    return 1 if isinstance(received, FeedEvent) else len(received)
