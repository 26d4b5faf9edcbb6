"""Calls of the engine for an online calibration, which is updated while readings arrive.

>>> online = Online().make_online()
>>> int(online["state"]), float(online["target_deg"])
(0, 1.0)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.native.layouts import ONLINE, ONLINE_CLAIM, empty_row
from flinders.native.library import Library, contiguous

MAX_STORED_READINGS: Final = ONLINE["time"].shape[0]
"""Number of readings that an online calibration stores."""

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.native.layouts import Records


class Online(Library):
    """Online calibrations: rows of `ONLINE`, which are changed in place."""

    def make_online(self) -> Records:
        """Make an empty row of `ONLINE`."""
        online = empty_row(ONLINE)
        self._library.flinders_online_begin(online)
        return online

    def online_activate(
        self, online: Records, parameters: ArrayLike, covariance: ArrayLike, *, noise: float, time: float
    ) -> None:
        """Activate (9,) offset and shape with their (9, 9) covariance, as known at a time in s."""
        self._require(
            self._library.flinders_online_know(online, contiguous(parameters), contiguous(covariance), noise, time)
        )

    def online_expect_walk(self, online: Records, walk: float, log_sigma: float) -> None:
        """Set the expected rate of the offset's random walk, per root hour, and 1 σ of the rate's natural logarithm."""
        self._require(self._library.flinders_online_expect_walk(online, walk, log_sigma))

    def online_add(self, online: Records, field: Floats, time: Floats) -> tuple[int, int]:
        """Add (N, 3) readings with (N,) times in s, up to the first reading with an event.

        Returns
        -------
        added : int
            Number of readings that were added.
        events : int
            Bits of the events.
        """
        readings, times = np.ascontiguousarray(field, np.float64), np.ascontiguousarray(time, np.float64)
        events, (workspace, size) = np.zeros(1, dtype=np.int32), self._workspace(MAX_STORED_READINGS)
        added = self._library.flinders_online_add(online, readings, times, len(readings), workspace, size, events)
        return int(added), int(events[0])

    def online_claim(self, online: Records, time: float) -> Records:
        """Make a row of `ONLINE_CLAIM`: the claim at a time in s, NaN without an active calibration."""
        claim = empty_row(ONLINE_CLAIM)
        self._library.flinders_online_claim_at(online, time, claim)
        return claim

    def online_good_s(self, online: Records) -> float:
        """Time in s for which the claim meets the target; NaN if it is too large now, infinite beyond ten years."""
        return float(self._library.flinders_online_good_s(online))

    def online_activate_latest(self, online: Records) -> None:
        """Activate the latest estimate."""
        self._library.flinders_online_adopt(online)

    def online_revert(self, online: Records) -> None:
        """Activate the previously active calibration again."""
        self._library.flinders_online_take_back(online)
