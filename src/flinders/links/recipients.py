"""Sources of readings that take a calibration back, such as a vehicle: what whoever hands one over needs of them.

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
    """What would change in a recipient so that it uses a calibration."""

    @property
    def suffix(self) -> str:
        """Of a file with `backup`."""

    @property
    def is_done(self) -> bool:
        """It holds the calibration already."""

    def backup(self) -> str:
        """What it holds now, as its own tools load it."""

    def carry_out(self, *, stopped: Callable[[], bool], say: Callable[[str], None]) -> str:
        """Change it and read it back, or put all back as it was; says what is confirmed.

        Raises `NotConfirmed`, which says what the recipient holds.
        """


@runtime_checkable
class Recipient(Protocol):
    """A feed whose source takes a calibration of its readings."""

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def refusal(self) -> str:
        """Why it takes nothing now, such as that it is armed; empty where it does."""

    def on_board(self, field_strength: float) -> Calibration | None:
        """The calibration that it holds, for readings as the feed gives them, in µT; None where that is not known."""

    def transfer(self, calibration: Calibration) -> Transfer:
        """Ask what would change; nothing is changed.

        Raises `NotSent`, `NotExportable`, `UnitError` or `LinkError` where that is impossible.
        """
