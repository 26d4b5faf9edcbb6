"""What ArduPilot's logs have in common: the parameters that were in force, and how a compass was mounted.

>>> history = History.of([(10, "COMPASS_OFS_X", -90.0), (20, "COMPASS_OFS_X", -95.0), (30, "COMPASS_OFS_X", -95.0)])
>>> [history.at(change).get("COMPASS_OFS_X") for change in history.change([5, 15, 25, 35])]
[-90.0, -90.0, -95.0, -95.0]
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import ArrayError, UnreadableInput
from flinders.readers._log import Stored
from flinders.targets.ardupilot import names, orientation_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.targets.ardupilot import ArduPilotParameters

IN_VEHICLE_AXES: Final = ("vehicle", "vehicle")
"""The `Instrument.frames` of a compass: nothing is turned back."""

OF_INTEREST: Final = ("COMPASS", "AHRS_ORIENTATION", "AHRS_EKF_TYPE", "CUST_ROT")
"""How the names of the parameters begin that are kept."""

MOST_CHANGES: Final = 1000
"""Changes of a compass's parameters in one log; a calibration makes about twelve."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Parameters as they were at first, and each change of one.

    Attributes
    ----------
    first : dict of float
        By name. A vehicle writes its parameters in the first seconds of a log: what it says of one first was in force
        before, too.
    changes : tuple of (int, str, float)
        Place in the log, name, and the value from there on; ascending.
    """

    first: dict[str, float] = field(default_factory=dict)
    changes: tuple[tuple[int, str, float], ...] = ()

    @classmethod
    def of(cls, parameters: Iterable[tuple[int, str, float]], source: str = "log") -> History:
        """Take place, name and value of each time that a parameter was told.

        Raises
        ------
        UnreadableInput
            For more than `MOST_CHANGES`; `source` names the log.
        """
        first: dict[str, float] = {}
        last: dict[str, float] = {}
        changes: list[tuple[int, str, float]] = []
        for place, name, value in parameters:
            if not (name.startswith(OF_INTEREST) and np.isfinite(value)):
                continue
            first.setdefault(name, value)
            if last.setdefault(name, value) != value:
                changes.append((place, name, value))
                last[name] = value
            if len(changes) > MOST_CHANGES:
                raise UnreadableInput(
                    f"{source} changes the parameters of its compasses more than {MOST_CHANGES:,} times, as no vehicle "
                    "does: it is broken; copy it again"
                )
        return cls(first, tuple(changes))

    def change(self, where: ArrayLike) -> NDArray[np.intp]:
        """How many changes came before each of these places."""
        return np.searchsorted([place for place, _, _ in self.changes], np.asarray(where, np.int64), side="right")

    def at(self, changes: int) -> dict[str, float]:
        """What was in force after so many changes."""
        return self.first | {name: value for _, name, value in self.changes[:changes]}

    @property
    def last(self) -> dict[str, float]:
        """What was in force at the end."""
        return self.at(len(self.changes))


def unapplied(
    source: str,
    field: Floats,
    version: NDArray[np.intp],
    parameters: Mapping[int, ArduPilotParameters],
    motor_offset: Floats,
) -> Floats:
    """(N, 3) mG that a compass read: each reading without the parameters and the motor offset of its time."""
    raw = field.copy()
    for each in set(version.tolist()):
        rows = version == each
        try:
            raw[rows] = parameters[each].unapply(field[rows], motor_offset=motor_offset[rows])
        except ArrayError as error:
            raise ArrayError(f"{source}: {error}; take the readings --as-logged") from None
    return raw


def stored(parameters: ArduPilotParameters) -> Stored | None:
    """What the readings were corrected with, or nothing where that changes nothing."""
    if parameters.is_identity:
        return None
    return Stored(parameters.matrix, parameters.centre, words=parameters.words())


def mounting_told(parameters: ArduPilotParameters, values: dict[str, float], number: int) -> str:
    """Say in which axes the readings are, and by what they were turned before."""
    name, turn = names("ORIENT", number)[0], parameters.orientation
    if not parameters.external:
        name, turn = "AHRS_ORIENTATION", int(values.get("AHRS_ORIENTATION", 0))
    turned = "" if turn == 0 else f", turned by {name} {turn} ({orientation_name(turn)}) before they were logged"
    return (
        f"readings are in the axes of the vehicle (x forward, y right, z down){turned}; ArduPilot's offsets act "
        "in these axes, and nothing is turned back"
    )


def unused(values: dict[str, float], number: int) -> str:
    """Say which parameter turns a compass off, or nothing."""
    for name in names("USE", number):
        if values.get(name) == 0:
            return f"the vehicle did not use it ({name} is 0)"
    return ""
