"""Interface of publishers, which send the output of an online calibration to other programs, such as over ROS 2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from flinders.workflows.online import OnlineCalibration


class Publisher(Protocol):
    """Publishes the newest readings of its feed, corrected, and the state of the calibration."""

    def publish(self, online: OnlineCalibration | None, now: float) -> None:
        """Publish new output at a time of the readings; `online` is None before the first reading."""
