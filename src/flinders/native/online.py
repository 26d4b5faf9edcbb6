"""Calls of the engine for a calibration that keeps itself.

>>> online = Online().online()
>>> int(online["state"]), float(online["target_deg"])
(0, 1.0)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.native.layouts import ONLINE, ONLINE_CLAIM, blank
from flinders.native.library import Library, row_of

EVIDENCE: Final = ONLINE["time"].shape[0]
"""Readings that are kept."""

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Online(Library):
    """A calibration that keeps itself: a row of `ONLINE`, changed in place."""

    def online(self) -> Records:
        """A row of `ONLINE` that knows nothing yet."""
        online = blank(ONLINE)
        self._library.flinders_online_begin(online)
        return online

    def online_know(
        self, online: Records, parameters: ArrayLike, covariance: ArrayLike, *, noise: float, time: float
    ) -> None:
        """Put offset and shape (9,) with their covariance (9, 9) in force, as they were known at a time, s."""
        self._require(self._library.flinders_online_know(online, row_of(parameters), row_of(covariance), noise, time))

    def online_expect_walk(self, online: Records, walk: float, log_sigma: float) -> None:
        """Let the rate at which the offset walks be known: unit per root hour, and 1 σ of its natural logarithm."""
        self._require(self._library.flinders_online_expect_walk(online, walk, log_sigma))

    def online_add(self, online: Records, field: Floats, time: Floats) -> tuple[int, int]:
        """Add readings (N, 3) with times (N,), s, up to the first at which something happened.

        Returns
        -------
        added : int
            How many were added.
        events : int
            Bits of what happened.
        """
        readings, times = np.ascontiguousarray(field, np.float64), np.ascontiguousarray(time, np.float64)
        events, (workspace, size) = np.zeros(1, dtype=np.int32), self._workspace(EVIDENCE)
        added = self._library.flinders_online_add(online, readings, times, len(readings), workspace, size, events)
        return int(added), int(events[0])

    def online_claim(self, online: Records, time: float) -> Records:
        """A row of `ONLINE_CLAIM`: what is claimed at a time, NaN where nothing is in force."""
        claim = blank(ONLINE_CLAIM)
        self._library.flinders_online_claim_at(online, time, claim)
        return claim

    def online_good_s(self, online: Records) -> float:
        """Seconds for which the claim stays within the target; NaN where it is not, infinite beyond ten years."""
        return float(self._library.flinders_online_good_s(online))

    def online_adopt(self, online: Records) -> None:
        """Put what is known latest in force."""
        self._library.flinders_online_adopt(online)

    def online_take_back(self, online: Records) -> None:
        """Put what was in force before in force again."""
        self._library.flinders_online_take_back(online)
