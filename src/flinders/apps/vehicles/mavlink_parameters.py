"""Set the compass parameters of a vehicle: all of them, or none.

`ParameterPlan` lists the changes before they are made::

    vehicle = Vehicle.find(source)
    plan = ParameterPlan.of(vehicle, calibration, compass=1)
    backup.write_text(plan.backup())
    plan.carry_out()

A plan is made only for a disarmed vehicle whose compass has the wanted device id. If a value is not confirmed, the link
is lost, the vehicle is armed or the program is stopped, the previous values are restored, and the error states which
of them the vehicle holds.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.apps.vehicles.mavlink import ARDUPILOT, KINDS, PX4, Parameter, Vehicle, is_same_float32
from flinders.apps.vehicles.targets import ardupilot, px4
from flinders.errors import LinkError, NotConfirmed, NotSent, UsageError
from flinders.targets import ExportOptions, find
from flinders.targets._mounting import MAX_TURN_DEG, apart_deg, in_words

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flinders.apps.vehicles.targets.autopilot import CompassParameters
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

TARGETS: Final = {ARDUPILOT: "ardupilot", PX4: "px4"}
PARAMETERS: Final[Mapping[int, type[CompassParameters]]] = {
    ARDUPILOT: ardupilot.ArduPilotParameters,
    PX4: px4.Px4Parameters,
}
MOUNTING_TRIES: Final = 3  # Largest number of requests for a parameter that old firmware lacks
MAX_READBACKS: Final = 4  # Largest number of readbacks of a value that differs from the one set
RECOVERY_S: Final = 30.0  # Longest wait for a lost vehicle before previous values are restored
AXES: Final = {
    ARDUPILOT: "it acts after COMPASS_ORIENT: the recording must be in the axes of the vehicle, as its logs are",
    PX4: "it acts before CAL_MAGn_ROT: the recording must be in the axes of the sensor, as sensor_mag of its logs is",
}
"""Sentence on the axes that a calibration must be in, by autopilot; its numbers do not show its axes."""


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """One parameter, before and after."""

    old: Parameter
    new: Parameter

    @property
    def is_none(self) -> bool:
        """Whether the vehicle holds the new value already."""
        return is_same_float32(self.old.value, self.new.value)


@dataclass(frozen=True, slots=True)
class ParameterPlan:
    """Changes to the parameters of a vehicle, not yet made."""

    vehicle: Vehicle
    compass: int  #: number of the compass: ArduPilot 1 to 3, PX4 0 to 3
    device_id: int  #: device id of this compass on the vehicle
    #: every parameter of the calibration, also those that the vehicle holds already
    changes: tuple[ParameterChange, ...]
    notes: tuple[str, ...] = ()  #: notes for the user, a sentence each

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        calibration: Calibration,
        *,
        compass: int | None = None,
        device_id: int | None = None,
        mounting: Floats | None = None,
        lossy: bool = False,
    ) -> Self:
        """Request the vehicle's parameters, and check that they may be changed.

        Parameters
        ----------
        vehicle : Vehicle
        calibration : Calibration
            For ArduPilot in the axes of the vehicle, for PX4 in the axes of the sensor, as in the logs of each. For
            ArduPilot, mapped axes are mapped back if the frame is ``vehicle``.
        compass : int, optional
            Number of the compass: ArduPilot 1 to 3, PX4 0 to 3. By default the compass with the device id, or else the
            first one.
        device_id : int, optional
            Device id of the compass; by default the one in the name of the calibration's sensor, if any.
        mounting : (3, 3) float, optional
            Mounting R of the compass during the recording, vehicle = R sensor; if given, a rotation of the calibration
            is written as a new mounting.
        lossy : bool
            Accept parameters that lose more than 0.5° of heading.

        Raises
        ------
        NotSent
            If the vehicle is armed, lacks the compass or its parameters, has a compass with another device id, or a
            compass whose mounting changed since the recording.
        UnitError, NotExportable
            If the parameters cannot hold the calibration, or if it is for PX4 and in the axes of the vehicle.
        LinkError
            If the link is lost.
        """
        refuse_armed(vehicle)
        wanted = device_of(calibration) if device_id is None else device_id
        number = (
            _find_compass(vehicle, wanted)
            if compass is None and wanted is not None
            else _compass_number(vehicle, compass)
        )
        scheme, present = _device_id(vehicle, number)
        known = vehicle.autopilot == ARDUPILOT and calibration.frame == "vehicle"
        asked = ExportOptions(compass=number, lossy=lossy, mounting=mounting)
        export = find(TARGETS[vehicle.autopilot]).render(calibration, asked=asked)
        wanted_values = _check_mounting(vehicle, number, mounting, export.fields["values"])
        notes = (
            *[AXES[vehicle.autopilot]] * (not known),
            *_refuse_another(vehicle, number, present, wanted),
            *export.warnings,
            *(note for note in export.fields["notes"] if "left out" in note or "is written with the numbers" in note),
        )
        changes = []
        for name, value in wanted_values.items():
            old = _settable_parameter(vehicle, _spellings(vehicle.autopilot, name)[scheme], value)
            changes.append(ParameterChange(old, replace(old, value=value)))
        return cls(vehicle, number, present, tuple(changes), notes)

    @property
    def pending(self) -> tuple[ParameterChange, ...]:
        """Changes whose value differs from the vehicle's."""
        return tuple(change for change in self.changes if not change.is_none)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "vehicle": self.vehicle.name,  # name of the vehicle
            "compass": self.compass,
            "device_id": self.device_id,
            # for each parameter its `name`, and its value `before` and `after`
            "parameters": [
                {"name": change.new.name, "before": change.old.value, "after": change.new.value}
                for change in self.changes
            ],
            "notes": self.notes,
        }

    def __str__(self) -> str:
        """Text with a line for each parameter: its value before and after."""
        width = max(len(change.new.name) for change in self.changes)
        lines = [f"{f'compass {self.compass}':<{width}}  {'before':>12}  {'after':>12}   (device {self.device_id})"]
        for change in self.changes:
            after = "the same" if change.is_none else f"{change.new.value:.6g}"
            lines.append(f"{change.new.name:<{width}}  {change.old.value:>12.6g}  {after:>12}")
        return "\n".join(lines)

    def backup(self) -> str:
        """Return the previous values as a parameter file for the vehicle's ground station.

        ArduPilot's ``NAME,value``, or the five columns of QGroundControl for PX4.
        """
        vehicle, lines = self.vehicle, []
        for old in (change.old for change in self.changes):
            cells = [old.name, _float32_text(old.value)]
            if vehicle.autopilot == PX4:
                cells = [str(vehicle.system), str(vehicle.component), *cells, str(old.kind)]
            lines.append(("\t" if vehicle.autopilot == PX4 else ",").join(cells))
        remark = f"# {vehicle.name}, compass {self.compass} (device {self.device_id}), before a calibration was sent"
        return "\n".join([remark, *lines, ""])

    def carry_out(
        self,
        *,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        back: float = RECOVERY_S,
    ) -> None:
        """Set the parameters one by one, then read all of them back; restore the previous values if a step fails.

        Parameters
        ----------
        stopped : callable
            Returns True to stop.
        say : callable
            Receives messages for the user while a lost vehicle is waited for.
        back : float, s
            Longest wait for a lost vehicle, to restore the previous values.

        Raises
        ------
        NotConfirmed
            If a step failed; the message states the cause and the values that the vehicle holds.
        """
        touched: list[ParameterChange] = []
        try:
            for change in self.pending:
                self.vehicle.listen()
                refuse_armed(self.vehicle)
                _refuse_stopped(stopped)
                touched.append(change)
                _set(self.vehicle, change.new)
            _refuse_stopped(stopped)
            self._verify()
        except (LinkError, NotSent, NotConfirmed) as error:
            raise NotConfirmed(f"{error.message}; {_put_back(self.vehicle, touched, say=say, back=back)}") from None
        except BaseException:
            _put_back(self.vehicle, touched, say=say, back=back)
            raise

    def _verify(self) -> None:
        """Read each parameter back and compare it with the plan."""
        for change in self.changes:
            parameter = None
            for _ in range(MAX_READBACKS):  # a late answer may belong to an earlier request
                parameter = self.vehicle.get(change.new.name)
                if parameter is None or is_same_float32(parameter.value, change.new.value):
                    break
            if parameter is None or not is_same_float32(parameter.value, change.new.value):
                answer = "is not answered" if parameter is None else f"is {_float32_text(parameter.value)}"
                raise NotConfirmed(f"{change.new.name} {answer} in place of {_float32_text(change.new.value)}")


def refuse_armed(vehicle: Vehicle) -> None:
    """Refuse an armed vehicle, which may be moving."""
    if vehicle.armed:
        raise NotSent(f"{vehicle.name} is armed: a compass is not changed under way; land, disarm, and send again")


def device_of(calibration: Calibration) -> int | None:
    """Device id in the name of the calibration's sensor; None without one.

    >>> from flinders.core.calibration import Calibration
    >>> device_of(Calibration.identity(sensor="sensor_mag 1 (device 396809)")), device_of(Calibration.identity())
    (396809, None)
    """
    match = re.search(r"\bdevice (\d+)\b", calibration.sensor or "")
    return int(match[1]) if match else None


def _spellings(autopilot: int, name: str) -> tuple[str, ...]:
    """Name of a parameter in each naming scheme of the firmware."""
    return (name,) if autopilot == PX4 else ardupilot.spellings(name)


def _check_mounting(
    vehicle: Vehicle, compass: int, mounting: Floats | None, values: Mapping[str, float]
) -> Mapping[str, float]:
    """Values to set; refuses a mounting that changed since the recording, unless the values contain the mounting."""
    kind = PARAMETERS[vehicle.autopilot]
    names = [name for name in values if name in kind.mounting_names(compass)]
    if mounting is None or not (names or vehicle.autopilot == ARDUPILOT):
        return values
    present = _mounting_now(vehicle, compass)
    now = kind.read(present, compass).own_mounting
    if now is None:
        raise NotSent(
            f"compass {compass} of {vehicle.name} has no known mounting parameter now but had one when the log was "
            "recorded; nothing was changed. Only an external compass has one: make a new recording"
        )
    values = _without_missing(values, present) if vehicle.autopilot == PX4 else _free_custom(vehicle, compass, values)
    new = kind.read({**present, **values}, compass).own_mounting if names else mounting
    if new is None or min(apart_deg(now, mounting), apart_deg(now, new)) > MAX_TURN_DEG:
        raise NotSent(
            f"compass {compass} of {vehicle.name} is mounted by {in_words(now)}, and was mounted by "
            f"{in_words(mounting)} during the recording; nothing was changed. Make a new recording, or restore the "
            "earlier mounting"
        )
    return values


def _mounting_now(vehicle: Vehicle, compass: int) -> dict[str, float]:
    """Read the parameters of the vehicle that hold the mounting of a compass."""
    present = _present_values(vehicle, PARAMETERS[vehicle.autopilot].mounting_names(compass))
    orientation = present.get(ardupilot.names("ORIENT", compass)[0], 0.0)
    return {**present, **_present_values(vehicle, ardupilot.custom_names(int(orientation)))}


def _present_values(vehicle: Vehicle, names: Iterable[str]) -> dict[str, float]:
    """Values of the parameters that the vehicle has, by their names in the first naming scheme."""
    present = {}
    for name in names:
        parameter = vehicle.get(*_spellings(vehicle.autopilot, name), tries=MOUNTING_TRIES)
        if parameter is not None:
            present[name] = parameter.value
    return present


def _without_missing(values: Mapping[str, float], present: Mapping[str, float]) -> dict[str, float]:
    """Values without those mounting angles that are 0 and that old firmware lacks."""
    return {
        name: value
        for name, value in values.items()
        if value != 0.0 or name in present or not name.endswith(px4.ANGLES)
    }


def _free_custom(vehicle: Vehicle, compass: int, values: Mapping[str, float]) -> Mapping[str, float]:
    """Values that use ArduPilot's second custom rotation if another sensor on board uses the first."""
    if "CUST_ROT_ENABLE" not in values:
        return values
    others = ["AHRS_ORIENTATION", *(ardupilot.names("ORIENT", one)[0] for one in ardupilot.COMPASSES if one != compass)]
    used = set(_present_values(vehicle, others).values())
    free = next((number for number in ardupilot.CUSTOM if number not in used), None)
    if free is None:
        raise NotSent(
            f"{vehicle.name} uses CUST_ROT1 and CUST_ROT2 for other sensors; nothing was changed. Give one of these "
            "sensors a mounting by number, or send without a mounting and accept the loss of heading accuracy",
            hint={"lossy": True},
        )
    own = ardupilot.names("ORIENT", compass)[0]
    renamed = {name.replace("CUST_ROT1", ardupilot.CUSTOM[free]): value for name, value in values.items()}
    return {**renamed, own: float(free)}


def _settable_parameter(vehicle: Vehicle, name: str, value: float) -> Parameter:
    """Parameter with a new value, in the type that the vehicle uses; refuses a value that the type cannot hold."""
    old = vehicle.get(name)
    if old is None:
        raise NotSent(
            f"{vehicle.name} does not know {name}, nothing was changed: its firmware is older than this parameter, or "
            "names its parameters differently; update it, or set its own parameters by hand (flinders export)"
        )
    if old.kind in KINDS and not _fits(value, old.kind):
        raise NotSent(
            f"{vehicle.name} keeps {name} as a whole number (MAV_PARAM_TYPE {old.kind}), which cannot hold "
            f"{_float32_text(value)}: its firmware is unknown; nothing was changed. Set the values by "
            "hand (flinders export)"
        )
    return old


def _fits(value: float, kind: int) -> bool:
    """Whether an integer MAV_PARAM_TYPE can hold the value."""
    try:
        struct.pack(KINDS[kind], int(value))
    except struct.error:
        return False
    return float(value).is_integer()


def _identity(autopilot: int, compass: int) -> Sequence[str]:
    """Name, in each naming scheme, of the parameter with the device id of a compass."""
    return (f"CAL_MAG{compass}_ID",) if autopilot == PX4 else ardupilot.names("DEV_ID", compass)


def _compass_number(vehicle: Vehicle, compass: int | None) -> int:
    """Number of the compass, by default the first; `UsageError` if the autopilot has no such number."""
    kind = PARAMETERS[vehicle.autopilot]
    numbers = kind.compasses
    if compass is not None and compass not in numbers:
        raise UsageError(f"compass {compass}: {kind.who} counts them from {numbers[0]} to {numbers[-1]}")
    return numbers[0] if compass is None else compass


def _device_id(vehicle: Vehicle, compass: int) -> tuple[int, int]:
    """Index of the vehicle's naming scheme, and the device id of a compass, 0 without a compass."""
    names = _identity(vehicle.autopilot, compass)
    parameter = vehicle.get(*names)
    if parameter is not None and math.isfinite(parameter.value):
        return names.index(parameter.name), int(parameter.value) % 2**32  # PX4 stores a signed number
    raise NotSent(
        f"{vehicle.name} does not answer for the device id of compass {compass} ({names[0]}); nothing was changed: "
        "check --compass and the link"
    )


def _find_compass(vehicle: Vehicle, wanted: int) -> int:
    """Number of the compass with this device id."""
    device_ids: dict[int, int] = {}
    for compass in PARAMETERS[vehicle.autopilot].compasses:
        with contextlib.suppress(NotSent):  # a vehicle with fewer compasses
            device_ids[compass] = _device_id(vehicle, compass)[1]
            if device_ids[compass] == wanted:
                return compass
    listed = ", ".join(f"{compass}: {device or 'none'}" for compass, device in device_ids.items())
    raise NotSent(
        f"{vehicle.name} has no compass with device id {wanted} ({listed}); nothing was changed. The calibration is "
        "for another vehicle or compass; give --device-id, or calibrate this compass"
    )


def _refuse_another(vehicle: Vehicle, compass: int, present: int, wanted: int | None) -> tuple[str, ...]:
    """Refuse a compass whose device id is not the wanted one; return a note if no id was given."""
    if present == 0:
        raise NotSent(
            f"{vehicle.name} has no compass {compass} ({_identity(vehicle.autopilot, compass)[0]} is 0); nothing was "
            "changed. Choose another --compass, or start the vehicle with the compass connected"
        )
    if wanted is None:
        return (f"the calibration names no device id: compass {compass} of the vehicle has {present}",)
    if wanted != present:
        raise NotSent(
            f"compass {compass} of {vehicle.name} has device id {present}, and the calibration is for {wanted}; "
            "nothing was changed. Choose another --compass, or give --device-id if the compass was replaced on purpose"
        )
    return ()


def _set(vehicle: Vehicle, new: Parameter) -> None:
    """Set a parameter; `NotConfirmed` if the vehicle answers otherwise or not at all."""
    answered = vehicle.set(new)
    if answered is None or not is_same_float32(answered, new.value):
        why = "does not answer" if answered is None else f"answered {_float32_text(answered)}"
        raise NotConfirmed(f"{vehicle.name} did not confirm {new.name} as {_float32_text(new.value)}: it {why}")


def _refuse_stopped(stopped: Callable[[], bool]) -> None:
    """Raise `NotConfirmed` once the caller wants to stop."""
    if stopped():
        raise NotConfirmed("stopped before all parameters were sent")


def _put_back(vehicle: Vehicle, touched: list[ParameterChange], *, say: Callable[[str], None], back: float) -> str:
    """Restore the previous values, and wait for a lost link; return a sentence on the values that the vehicle holds."""
    if not touched:
        return "nothing was changed"
    left, until = list(reversed(touched)), time.monotonic() + back
    refused: list[ParameterChange] = []
    while left:
        try:
            answered = vehicle.set(left[0].old)
        except LinkError as error:
            say(f"! {error.message}; waiting up to {back:g} s for it, to restore the previous values")
            if not vehicle.come_back(until - time.monotonic()):
                break
            continue
        if answered is None or not is_same_float32(answered, left[0].old.value):
            refused.append(left[0])
        left.pop(0)
    if not left and not refused:
        return f"the previous values are restored (all {len(touched)} that were changed, confirmed)"
    names = [change.old.name for change in touched if change in refused or change in left]
    return (
        f"and the previous values of {', '.join(names)} could not be restored: DO NOT ARM before they are loaded "
        "from the file"
    )


def _float32_text(value: float) -> str:
    """Write a value with enough digits for the same float32."""
    return f"{int(value)}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.9g}"
