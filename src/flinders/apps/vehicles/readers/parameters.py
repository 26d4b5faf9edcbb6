"""Parameters of a vehicle in its log: which were in force when, and readings without them.

>>> entries = [(10, "COMPASS_OFS_X", -90.0), (20, "COMPASS_OFS_X", -95.0), (30, "COMPASS_OFS_X", -95.0)]
>>> in_force = stages(entries, ("COMPASS",), "flight.bin")
>>> [in_force[stage][1] for stage in stage_of([5, 15, 25, 35], in_force)]
[{'COMPASS_OFS_X': -90.0}, {'COMPASS_OFS_X': -90.0}, {'COMPASS_OFS_X': -95.0}, {'COMPASS_OFS_X': -95.0}]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from flinders.apps.vehicles.targets.ardupilot import names, orientation_name
from flinders.apps.vehicles.targets.autopilot import USUAL_STRENGTH_UT
from flinders.errors import ArrayError, UnreadableInput
from flinders.readers._log import Stored

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters
    from flinders.apps.vehicles.targets.autopilot import CompassParameters
    from flinders.apps.vehicles.targets.px4 import Px4Parameters
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

Stages: TypeAlias = "Sequence[tuple[float, Mapping[str, float]]]"
"""From which place or time of the log on, and the parameters in force from there; the first from minus infinity."""

IN_VEHICLE_AXES: Final = ("vehicle", "vehicle")
"""The `Instrument.frames` of a compass of ArduPilot: nothing is turned back."""
ARDUPILOT: Final = ("COMPASS", "AHRS_ORIENTATION", "AHRS_EKF_TYPE", "CUST_ROT")
"""How the names of ArduPilot's parameters begin that matter."""
MOST_CHANGES: Final = 1000
"""Changes of compasses' parameters in one log; a calibration makes about twelve."""


def stages(
    entries: Iterable[tuple[float, str, float]], prefixes: tuple[str, ...], source: str, *, together: float = 0.0
) -> Stages:
    """Which parameters were in force from when on.

    A vehicle writes its parameters in the first seconds of a log: what it says of one first was in force before, too.

    Raises `UnreadableInput` for more than `MOST_CHANGES`.

    Parameters
    ----------
    entries : iterable of (float, str, float)
        Place in the log or time, ascending, name and value, each time that a parameter was written.
    prefixes : tuple of str
        How the names begin that matter.
    source : str
        Names the log in messages.
    together : float
        Changes within so much of a stage belong to it.
    """
    changes: list[tuple[float, dict[str, float]]] = [(-np.inf, {})]
    for place, name, value in entries:
        since, values = changes[-1]
        if not (name.startswith(prefixes) and np.isfinite(value)) or values.get(name) == value:
            continue
        if name not in values:
            for _, each in changes:
                each[name] = value
        elif place - since < together:
            values[name] = value
        else:
            changes.append((place, values | {name: value}))
        if len(changes) > MOST_CHANGES:
            raise UnreadableInput(
                f"{source} changes the parameters of its compasses more than {MOST_CHANGES:,} times, as no vehicle "
                "does: it is broken; copy it again"
            )
    return changes


def stage_of(where: ArrayLike, changes: Stages) -> NDArray[np.intp]:
    """(N,) the stage in force at each of (N,) places or times."""
    return np.searchsorted([since for since, _ in changes[1:]], np.asarray(where), side="right")


def unapplied(
    source: str,
    field: Floats,
    stage: NDArray[np.intp],
    parameters: Mapping[int, ArduPilotParameters] | Sequence[Px4Parameters],
    **columns: Floats,
) -> Floats:
    """(N, 3) what a compass read: each reading without the parameters of its stage.

    `columns`, (N, …), are more arguments of their `unapply`. Parameters that cannot be undone raise `ArrayError`.
    """
    raw = np.empty_like(field)
    for each in set(stage.tolist()):
        rows = stage == each
        more: dict[str, Any] = {name: values[rows] for name, values in columns.items()}
        try:
            raw[rows] = parameters[each].unapply(field[rows], **more)
        except ArrayError as error:
            raise ArrayError(
                f"{source}: {error.message}; take the readings as they were logged", hint={"as_logged": True}
            ) from None
    return raw


# what to say of a compass of ArduPilot


def stored(parameters: ArduPilotParameters, *, changes: int = 0) -> Stored | None:
    """What the readings were corrected with at the end, or nothing where that changes nothing."""
    if parameters.is_identity:
        return None
    return Stored(onboard(parameters), parameters.words(), changes=changes)


def onboard(parameters: CompassParameters) -> Calibration | None:
    """The calibration that parameters stand for; None where they flatten readings."""
    try:
        return parameters.to_calibration(USUAL_STRENGTH_UT)
    except ArrayError:
        return None


def mounting_words(parameters: ArduPilotParameters, values: Mapping[str, float]) -> str:
    """Say in which axes the readings are, and by what they were turned before."""
    name, turn = names("ORIENT", parameters.compass)[0], parameters.orientation
    if not parameters.external:
        name, turn = "AHRS_ORIENTATION", int(values.get("AHRS_ORIENTATION", 0))
    turned = "" if turn == 0 else f", turned by {name} {turn} ({orientation_name(turn)}) before they were logged"
    return (
        f"readings are in the axes of the vehicle (x forward, y right, z down){turned}; ArduPilot's offsets act "
        "in these axes, and nothing is turned back"
    )


def unused(values: Mapping[str, float], number: int) -> list[str]:
    """Say which parameter turns a compass off, where one does."""
    off = [name for name in names("USE", number) if values.get(name) == 0]
    return [f"the vehicle did not use it ({name} is 0)" for name in off[:1]]
