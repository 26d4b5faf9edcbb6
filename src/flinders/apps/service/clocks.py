"""Monotonic time for readings over months, despite clocks that are set or reset.

>>> machine = MachineClock(wall=lambda: 1.7e9, steady=lambda: 5.0)
>>> machine.of(np.array([10.0, 10.02])).tolist()                           # a board counts from its start
[1699999999.98, 1700000000.0]
>>> recorded = RecordedClock()
>>> recorded.of(np.array([10.0, 10.5])).tolist(), recorded.of(np.array([0.0, 0.5])).tolist()       # it was reset
([10.0, 10.5], [10.5, 11.0])
>>> recorded.remarks()
['the clock of the readings went back by 10.5 s: time continues from its last value']
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.readers._times import MIN_EPOCH_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

MAX_CLOCK_DIFFERENCE_S: Final = 2.0  # Largest difference of sensor and machine; beyond it the machine's clock is used
MIN_RESET_S: Final = 1.0  # Smallest step back of a clock that was reset; readings late by less are left out


def duration(seconds: float) -> str:
    """Write a duration in words.

    >>> duration(10.5), duration(5400), duration(864000)
    ('10.5 s', '1.5 h', '10 days')
    """
    if seconds < 600:
        return f"{seconds:.3g} s"
    return f"{seconds / 3600:.3g} h" if seconds < 172800 else f"{seconds / 86400:,.0f} days"


class MachineClock:
    """Time of arriving readings, in seconds from 1970, by the clock of this machine.

    Steps between readings are those of the sensor's own clock, as long as that agrees with the machine's clock. If the
    machine's clock is set forward, as after a start without a battery, this time follows; if it is set back, this time
    does not.

    Parameters
    ----------
    since : float, optional
        Time of the calibration's last reading; this clock begins no earlier.
    wall, steady : callable
        Functions that return seconds from 1970, and ascending seconds.
    """

    def __init__(
        self,
        since: float | None = None,
        *,
        wall: Callable[[], float] = time.time,
        steady: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wall, self._steady = wall, steady
        self._remarks: list[str] = []
        self._is_behind = False
        begun = wall()
        if since is not None and since > begun + MAX_CLOCK_DIFFERENCE_S:
            words = f"this machine's clock is {duration(since - begun)} before the state: time continues from the state"
            self._remarks.append(words)
            self._is_behind = True
        self._ahead = max(begun, since or begun) - steady()
        self._last = -math.inf if since is None else since
        self._shift: float | None = None

    @property
    def now(self) -> float:
        """Current time, in seconds from 1970."""
        wall, now = self._wall(), self._steady() + self._ahead
        if wall > now + MAX_CLOCK_DIFFERENCE_S:
            self._remarks.append(f"this machine's clock was set forward by {duration(wall - now)}")
            self._ahead += wall - now
            return wall
        if wall < now - MAX_CLOCK_DIFFERENCE_S and not self._is_behind:
            words = f"this machine's clock was set back by {duration(now - wall)}: time continues without the step"
            self._remarks.append(words)
        self._is_behind = wall < now - MAX_CLOCK_DIFFERENCE_S
        return now

    def of(self, times: Floats) -> Floats:
        """Convert (N,) times to seconds from 1970; they are by the sensor's clock, or times of arrival; N > 0."""
        now, newest = self.now, float(times[-1])
        if self._shift is None or abs(newest + self._shift - now) > MAX_CLOCK_DIFFERENCE_S:
            self._shift = now - newest
        moved = np.minimum(
            np.maximum.accumulate(np.maximum(times + self._shift, self._last)), now + MAX_CLOCK_DIFFERENCE_S
        )
        self._last = float(moved[-1])
        return moved

    def remarks(self) -> list[str]:
        """Events of the clock since the last call."""
        found, self._remarks = self._remarks, []
        return found


class RecordedClock:
    """Time of recorded readings; after a reset of their clock, time continues.

    Parameters
    ----------
    since : float, optional
        Time of the calibration's last reading; readings whose times do not count from 1970 continue from it.
    """

    now = None  # Between readings the current time is not known

    def __init__(self, since: float | None = None) -> None:
        self._since, self._last = since, math.nan
        self._shift = 0.0
        self._remarks: list[str] = []

    def of(self, times: Floats) -> Floats:
        """Convert (N,) times of a recording to times that never decrease; N > 0."""
        if math.isnan(self._last):
            first = float(times[0])
            if self._since is not None and first < min(self._since, MIN_EPOCH_S):
                self._shift = self._since - first
            self._last = first + self._shift
        steps = np.diff(times + self._shift, prepend=self._last)
        back = np.where(steps < -MIN_RESET_S, -steps, 0.0)
        if back.any():
            words = f"the clock of the readings went back by {duration(float(back.max()))}: time continues from"
            self._remarks.append(f"{words} its last value")
        moved: Floats = times + self._shift + np.cumsum(back)
        self._shift += float(back.sum())
        self._last = float(moved[-1])
        return moved

    def remarks(self) -> list[str]:
        """Events of the clock since the last call."""
        found, self._remarks = self._remarks, []
        return found
