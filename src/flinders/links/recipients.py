"""Interface of sources that accept a calibration of their readings, such as a vehicle.

>>> from flinders.links.feeds import NoSensor
>>> isinstance(NoSensor("session.csv"), Recipient)
False
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.calibration import Calibration


class Transfer(Protocol):
    """Changes in a recipient that make it use a calibration."""

    @property
    def suffix(self) -> str:
        """File name suffix for `backup`."""

    @property
    def is_done(self) -> bool:
        """Whether the recipient has the calibration already."""

    def backup(self) -> str:
        """Current values of the recipient, in the format of its own tools."""

    def carry_out(self, *, stopped: Callable[[], bool], say: Callable[[str], None]) -> str:
        """Write the changes and read them back, or restore the old values; return a sentence on the confirmation.

        Raises `NotConfirmed`, which states the values of the recipient.
        """


@runtime_checkable
class Recipient(Protocol):
    """A feed whose source accepts a calibration of its readings."""

    @property
    def name(self) -> str:
        """Name for messages."""

    @property
    def refusal(self) -> str:
        """Reason why no calibration is accepted now, such as an armed vehicle; empty if it is accepted."""

    def on_board(self, field_strength: float) -> Calibration | None:
        """The calibration on board, for readings of the feed, in µT; None if unknown."""

    def transfer(self, calibration: Calibration) -> Transfer:
        """Determine the changes without writing them.

        Raises `NotSent`, `NotExportable`, `UnitError` or `LinkError` if a transfer is impossible.
        """
