"""What others get of a calibration that goes on, beside the source that it learns from, such as topics of ROS 2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from flinders.workflows.online import OnlineCalibration


class Publisher(Protocol):
    """Publishes the readings that its feed handed on last, corrected, and what is known of the calibration."""

    def publish(self, online: OnlineCalibration | None, now: float) -> None:
        """Publish what is new at a time of the readings; there is no calibration before the first reading."""
