"""Parameters of a vehicle in its log: stages of constant parameters, and readings with their correction removed.

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
"""Start of each stage, as a place or time of the log, and the parameters in force from there; the first is at −inf."""

IN_VEHICLE_AXES: Final = ("vehicle", "vehicle")
"""`Instrument.frames` of a compass of ArduPilot: raw and corrected readings are in the vehicle's axes."""
ARDUPILOT: Final = ("COMPASS", "AHRS_ORIENTATION", "AHRS_EKF_TYPE", "CUST_ROT")
"""Prefixes of the relevant parameters of ArduPilot."""
MAX_CHANGES: Final = 1000
"""Largest number of changes of compass parameters in one log; a calibration makes about twelve."""


def stages(
    entries: Iterable[tuple[float, str, float]], prefixes: tuple[str, ...], source: str, *, together: float = 0.0
) -> Stages:
    """Split a log into stages of constant parameters.

    A vehicle writes its parameters in the first seconds of a log. The first value of each parameter holds from the
    beginning of the log.

    Raises `UnreadableInput` for more than `MAX_CHANGES`.

    Parameters
    ----------
    entries : iterable of (float, str, float)
        Place or time (ascending), name and value of each parameter message.
    prefixes : tuple of str
        Prefixes of the relevant names.
    source : str
        Name of the log in messages.
    together : float
        Changes within this time after the start of a stage belong to the stage.
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
        if len(changes) > MAX_CHANGES:
            raise UnreadableInput(
                f"{source} changes the parameters of its compasses more than {MAX_CHANGES:,} times; no vehicle does: "
                "the file is damaged, copy it again"
            )
    return changes


def stage_of(where: ArrayLike, changes: Stages) -> NDArray[np.intp]:
    """(N,) index of the stage in force at each of (N,) places or times."""
    return np.searchsorted([since for since, _ in changes[1:]], np.asarray(where), side="right")


def unapply_stages(
    source: str,
    field: Floats,
    stage: NDArray[np.intp],
    parameters: Mapping[int, ArduPilotParameters] | Sequence[Px4Parameters],
    **columns: Floats,
) -> Floats:
    """(N, 3) raw readings of a compass: the correction of its stage is removed from each reading.

    `columns`, (N, …), are further arguments of `unapply`. Raises `ArrayError` if a correction cannot be inverted.
    """
    raw = np.empty_like(field)
    for each in set(stage.tolist()):
        rows = stage == each
        more: dict[str, Any] = {name: values[rows] for name, values in columns.items()}
        try:
            raw[rows] = parameters[each].unapply(field[rows], **more)
        except ArrayError as error:
            raise ArrayError(
                f"{source}: {error.message}; use the readings as they were logged", hint={"as_logged": True}
            ) from None
    return raw


# description of a compass of ArduPilot


def stored_correction(parameters: ArduPilotParameters, *, changes: int = 0) -> Stored | None:
    """Correction that ArduPilot stored for a compass at its last reading; None if it corrects nothing."""
    if parameters.is_identity:
        return None
    return Stored(onboard(parameters), parameters.words(), changes=changes)


def onboard(parameters: CompassParameters) -> Calibration | None:
    """Calibration that corrects as some parameters do; None if their matrix is singular."""
    try:
        return parameters.to_calibration(USUAL_STRENGTH_UT)
    except ArrayError:
        return None


def mounting_words(parameters: ArduPilotParameters, values: Mapping[str, float]) -> str:
    """Sentence on the axes of the readings, and their rotation before logging."""
    name, turn = names("ORIENT", parameters.compass)[0], parameters.orientation
    if not parameters.external:
        name, turn = "AHRS_ORIENTATION", int(values.get("AHRS_ORIENTATION", 0))
    turned = "" if turn == 0 else f", turned by {name} {turn} ({orientation_name(turn)}) before they were logged"
    return (
        f"readings are in the axes of the vehicle (x forward, y right, z down){turned}; ArduPilot's offsets act "
        "in these axes, so the rotation is kept"
    )


def unused_words(values: Mapping[str, float], number: int) -> list[str]:
    """Sentence on the parameter that disables a compass; none if it is used."""
    off = [name for name in names("USE", number) if values.get(name) == 0]
    return [f"the vehicle did not use it ({name} is 0)" for name in off[:1]]
