"""What others get of a calibration that goes on, beside the source that it learns from, such as topics of ROS 2."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Protocol

from flinders.core.plugins import app_modules
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.workflows.online import OnlineCalibration


class Publisher(Protocol):
    """Publishes the readings that its feed handed on last, corrected, and what is known of the calibration."""

    def publish(self, online: OnlineCalibration | None, now: float) -> None:
        """Publish what is new at a time of the readings; there is no calibration before the first reading."""


def publisher_kind(name: str) -> Callable[..., Publisher]:
    """Look up by its name what publishes: ``opened`` of its module, of a feed and what is named.

    Raises `UsageError` where no package of `flinders.apps` does.
    """
    module = app_modules("PUBLISHERS").get(name)
    if module is None:
        raise UsageError(f"this installation publishes nothing for {name}: install flinders anew")
    opened: Callable[..., Publisher] = import_module(module).opened
    return opened
