"""Interface of sources that accept a calibration of their own readings, such as a vehicle.

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
    """Changes to a recipient after which it uses a calibration."""

    @property
    def suffix(self) -> str:
        """Suffix of the file name for `backup`."""

    @property
    def is_done(self) -> bool:
        """Whether the recipient uses the calibration already."""

    def backup(self) -> str:
        """Present values of the recipient, in the format of its own tools."""

    def carry_out(self, *, stopped: Callable[[], bool], say: Callable[[str], None]) -> str:
        """Write the changes and read them back, or restore the old values; return a sentence that confirms them.

        Raises `NotConfirmed`, which states the values that the recipient has.
        """


@runtime_checkable
class Recipient(Protocol):
    """A feed whose source accepts a calibration of its readings."""

    @property
    def name(self) -> str:
        """Name of the source in messages."""

    @property
    def refusal(self) -> str:
        """Why no calibration is accepted now, such as that the vehicle is armed; empty if one is accepted."""

    def on_board(self, field_strength: float) -> Calibration | None:
        """Onboard calibration for readings of the feed, in µT; None if it is not known."""

    def transfer(self, calibration: Calibration) -> Transfer:
        """Determine the changes, without writing them.

        Raises `NotSent`, `NotExportable`, `UnitError` or `LinkError` if a transfer is impossible.
        """
