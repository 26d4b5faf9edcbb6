"""Sets the compass parameters of a vehicle, and leaves it with all of them or with none.

`ParameterPlan` is what would change::

    vehicle = Vehicle.find(source)
    plan = ParameterPlan.of(vehicle, calibration, compass=1)
    backup.write_text(plan.backup())
    plan.carry_out()

Before anything is set it is seen that the vehicle is disarmed and that the compass is the one that is meant. Where a
value is not confirmed, the link is lost, the vehicle is armed or the program is stopped, the values from before are put
back, and the error says which of them the vehicle holds.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.apps.vehicles.mavlink import ARDUPILOT, KINDS, PX4, Parameter, Vehicle, same
from flinders.apps.vehicles.targets import ardupilot, px4
from flinders.errors import LinkError, NotConfirmed, NotSent, UsageError
from flinders.targets import ExportOptions, find
from flinders.targets._mounting import MOST_TURN_DEG, apart_deg, in_words

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
MOUNTING_TRIES: Final = 3  # How often a parameter is asked for that old firmware does not have
READS: Final = 4  # How often a value is read back that is not the one that was set
BACK_S: Final = 30.0  # Seconds that a lost vehicle is waited for, to put the values from before back
AXES: Final = {
    ARDUPILOT: "it acts after COMPASS_ORIENT: the recording must be in the axes of the vehicle, as its logs are",
    PX4: "it acts before CAL_MAGn_ROT: the recording must be in the axes of the sensor, as sensor_mag of its logs is",
}
"""In which axes a calibration has to be; nobody can see it by the numbers."""


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """One parameter, before and after."""

    old: Parameter
    new: Parameter

    @property
    def is_none(self) -> bool:
        """The vehicle holds the value already."""
        return same(self.old.value, self.new.value)


@dataclass(frozen=True, slots=True)
class ParameterPlan:
    """What would change in a vehicle."""

    vehicle: Vehicle
    compass: int  #: as the vehicle counts: ArduPilot from 1 to 3, PX4 from 0 to 3
    device_id: int  #: of the compass that the vehicle has there
    #: every parameter of the calibration, also those that the vehicle holds already
    changes: tuple[ParameterChange, ...]
    notes: tuple[str, ...] = ()  #: what to know, a sentence each

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
        """Ask the vehicle what it holds, and see that it may be changed.

        Parameters
        ----------
        vehicle : Vehicle
        calibration : Calibration
            For ArduPilot in the axes of the vehicle, as its logs are; for PX4 in those of the sensor, as its are.
            Where its frame is ``vehicle``, axes that were mapped are taken back for ArduPilot.
        compass : int, optional
            As the vehicle counts: ArduPilot 1 to 3, PX4 0 to 3; without it the one with the device id, or the first.
        device_id : int, optional
            Of the compass that is meant; without it the one that the calibration's sensor names, if it does.
        mounting : (3, 3) float, optional
            How the compass was mounted when it was recorded, vehicle = R sensor: with it a rotation of the calibration
            goes into the mounting.
        lossy : bool
            Send also what leaves out more than 0.5° of heading.

        Raises
        ------
        NotSent
            Where the vehicle is armed, has no such compass or another one, lacks parameters, or its compass is mounted
            otherwise than when it was recorded.
        UnitError, NotExportable
            Where the parameters cannot hold the calibration, or for PX4 it is in the axes of the vehicle.
        LinkError
            Where the link is lost.
        """
        refuse_armed(vehicle)
        wanted = device_of(calibration) if device_id is None else device_id
        number = (
            _find_compass(vehicle, wanted) if compass is None and wanted is not None else _numbered(vehicle, compass)
        )
        scheme, present = _device_id(vehicle, number)
        known = vehicle.autopilot == ARDUPILOT and calibration.frame == "vehicle"
        asked = ExportOptions(compass=number, lossy=lossy, mounting=mounting)
        export = find(TARGETS[vehicle.autopilot]).render(calibration, asked=asked)
        wanted_values = _in_place(vehicle, number, mounting, export.fields["values"])
        notes = (
            *[AXES[vehicle.autopilot]] * (not known),
            *_refuse_another(vehicle, number, present, wanted),
            *export.warnings,
            *(note for note in export.fields["notes"] if "left out" in note or "is written with the numbers" in note),
        )
        changes = []
        for name, value in wanted_values.items():
            old = _settable(vehicle, _spellings(vehicle.autopilot, name)[scheme], value)
            changes.append(ParameterChange(old, replace(old, value=value)))
        return cls(vehicle, number, present, tuple(changes), notes)

    @property
    def pending(self) -> tuple[ParameterChange, ...]:
        """What is not so already."""
        return tuple(change for change in self.changes if not change.is_none)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "vehicle": self.vehicle.name,  # its name
            "compass": self.compass,
            "device_id": self.device_id,
            # `name`, value `before` and `after` of each
            "parameters": [
                {"name": change.new.name, "before": change.old.value, "after": change.new.value}
                for change in self.changes
            ],
            "notes": self.notes,
        }

    def __str__(self) -> str:
        """Each parameter before and after, a line each."""
        width = max(len(change.new.name) for change in self.changes)
        lines = [f"{f'compass {self.compass}':<{width}}  {'before':>12}  {'after':>12}   (device {self.device_id})"]
        for change in self.changes:
            after = "the same" if change.is_none else f"{change.new.value:.6g}"
            lines.append(f"{change.new.name:<{width}}  {change.old.value:>12.6g}  {after:>12}")
        return "\n".join(lines)

    def backup(self) -> str:
        """Write the values from before as a parameter file of the vehicle's ground station.

        ArduPilot's ``NAME,value``, or the five columns of QGroundControl for PX4.
        """
        vehicle, lines = self.vehicle, []
        for old in (change.old for change in self.changes):
            cells = [old.name, _spelled(old.value)]
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
        back: float = BACK_S,
    ) -> None:
        """Set the parameters one by one, then ask for all of them again; put the old ones back where any of it fails.

        Parameters
        ----------
        stopped : callable
            Tells whether to give up.
        say : callable
            Told what a person should know while it is waited for a lost vehicle.
        back : float, s
            How long that is waited, to put the old values back.

        Raises
        ------
        NotConfirmed
            Where it failed; says why, and what the vehicle holds.
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
        """Ask for each parameter again."""
        for change in self.changes:
            parameter = None
            for _ in range(READS):  # a late answer may be to an earlier question
                parameter = self.vehicle.get(change.new.name)
                if parameter is None or same(parameter.value, change.new.value):
                    break
            if parameter is None or not same(parameter.value, change.new.value):
                answer = "is not answered" if parameter is None else f"is {_spelled(parameter.value)}"
                raise NotConfirmed(f"{change.new.name} {answer} in place of {_spelled(change.new.value)}")


def refuse_armed(vehicle: Vehicle) -> None:
    """Refuse a vehicle that may be moving."""
    if vehicle.armed:
        raise NotSent(f"{vehicle.name} is armed: a compass is not changed under way; land, disarm, and send again")


def device_of(calibration: Calibration) -> int | None:
    """The device id in the name of the calibration's sensor, where there is one.

    >>> from flinders.core.calibration import Calibration
    >>> device_of(Calibration.identity(sensor="sensor_mag 1 (device 396809)")), device_of(Calibration.identity())
    (396809, None)
    """
    match = re.search(r"\bdevice (\d+)\b", calibration.sensor or "")
    return int(match[1]) if match else None


def _spellings(autopilot: int, name: str) -> tuple[str, ...]:
    """A name in each scheme."""
    return (name,) if autopilot == PX4 else ardupilot.spellings(name)


def _in_place(
    vehicle: Vehicle, compass: int, mounting: Floats | None, values: Mapping[str, float]
) -> Mapping[str, float]:
    """The values, where the compass is mounted as it was when it was recorded, or as they say."""
    kind = PARAMETERS[vehicle.autopilot]
    names = [name for name in values if name in kind.mounting_names(compass)]
    if mounting is None or not (names or vehicle.autopilot == ARDUPILOT):
        return values
    present = _mounting_now(vehicle, compass)
    now = kind.read(present, compass).own_mounting
    if now is None:
        raise NotSent(
            f"compass {compass} of {vehicle.name} has no mounting of its own, or one that is not known, and it had one "
            "when it was recorded, nothing was changed: only an external compass has one; record anew"
        )
    values = _without_missing(values, present) if vehicle.autopilot == PX4 else _free_custom(vehicle, compass, values)
    new = kind.read({**present, **values}, compass).own_mounting if names else mounting
    if new is None or min(apart_deg(now, mounting), apart_deg(now, new)) > MOST_TURN_DEG:
        raise NotSent(
            f"compass {compass} of {vehicle.name} is mounted by {in_words(now)}, and was by {in_words(mounting)} when "
            "it was recorded, nothing was changed: record anew, or set the mounting as it was"
        )
    return values


def _mounting_now(vehicle: Vehicle, compass: int) -> dict[str, float]:
    """The parameters that say how a compass is mounted."""
    present = _present(vehicle, PARAMETERS[vehicle.autopilot].mounting_names(compass))
    orientation = present.get(ardupilot.names("ORIENT", compass)[0], 0.0)
    return {**present, **_present(vehicle, ardupilot.custom_names(int(orientation)))}


def _present(vehicle: Vehicle, names: Iterable[str]) -> dict[str, float]:
    """The parameters of these names that a vehicle has, by the names of the first scheme."""
    present = {}
    for name in names:
        parameter = vehicle.get(*_spellings(vehicle.autopilot, name), tries=MOUNTING_TRIES)
        if parameter is not None:
            present[name] = parameter.value
    return present


def _without_missing(values: Mapping[str, float], present: Mapping[str, float]) -> dict[str, float]:
    """The values without angles of 0 that old firmware does not know."""
    return {
        name: value
        for name, value in values.items()
        if value != 0.0 or name in present or not name.endswith(px4.ANGLES)
    }


def _free_custom(vehicle: Vehicle, compass: int, values: Mapping[str, float]) -> Mapping[str, float]:
    """Values with the second custom rotation of ArduPilot where something else on board uses the first."""
    if "CUST_ROT_ENABLE" not in values:
        return values
    others = ["AHRS_ORIENTATION", *(ardupilot.names("ORIENT", one)[0] for one in ardupilot.COMPASSES if one != compass)]
    used = set(_present(vehicle, others).values())
    free = next((number for number in ardupilot.CUSTOM if number not in used), None)
    if free is None:
        raise NotSent(
            f"{vehicle.name} uses CUST_ROT1 and CUST_ROT2 for other sensors, nothing was changed: set one of these to "
            "a mounting by number, or send without a mounting, whatever that costs",
            hint={"lossy": True},
        )
    own = ardupilot.names("ORIENT", compass)[0]
    renamed = {name.replace("CUST_ROT1", ardupilot.CUSTOM[free]): value for name, value in values.items()}
    return {**renamed, own: float(free)}


def _settable(vehicle: Vehicle, name: str, value: float) -> Parameter:
    """A parameter that can take a value, as the vehicle holds it."""
    old = vehicle.get(name)
    if old is None:
        raise NotSent(
            f"{vehicle.name} does not know {name}, nothing was changed: its firmware is older than this parameter, or "
            "keeps compass numbers otherwise; update it, or set what it has by hand (flinders export)"
        )
    if old.kind in KINDS and not _fits(value, old.kind):
        raise NotSent(
            f"{vehicle.name} keeps {name} as a whole number (MAV_PARAM_TYPE {old.kind}), which cannot hold "
            f"{_spelled(value)}, nothing was changed: its firmware is not one that is known here; set the values by "
            "hand (flinders export)"
        )
    return old


def _fits(value: float, kind: int) -> bool:
    """Whether a whole number of a MAV_PARAM_TYPE can be the value."""
    try:
        struct.pack(KINDS[kind], int(value))
    except struct.error:
        return False
    return float(value).is_integer()


def _identity(autopilot: int, compass: int) -> Sequence[str]:
    """What the parameter with the device id of a compass is called."""
    return (f"CAL_MAG{compass}_ID",) if autopilot == PX4 else ardupilot.names("DEV_ID", compass)


def _numbered(vehicle: Vehicle, compass: int | None) -> int:
    """Let through the number of a compass; the first where none is given."""
    kind = PARAMETERS[vehicle.autopilot]
    numbers = kind.compasses
    if compass is not None and compass not in numbers:
        raise UsageError(f"compass {compass}: {kind.who} counts them from {numbers[0]} to {numbers[-1]}")
    return numbers[0] if compass is None else compass


def _device_id(vehicle: Vehicle, compass: int) -> tuple[int, int]:
    """Which scheme of names the vehicle has, and the device id of a compass, 0 where there is none."""
    names = _identity(vehicle.autopilot, compass)
    parameter = vehicle.get(*names)
    if parameter is not None and math.isfinite(parameter.value):
        return names.index(parameter.name), int(parameter.value) % 2**32  # PX4 keeps it as a number with a sign
    raise NotSent(
        f"{vehicle.name} does not answer what compass {compass} is ({names[0]}), nothing was changed: check --compass "
        "and the link"
    )


def _find_compass(vehicle: Vehicle, wanted: int) -> int:
    """Which compass has this device id."""
    device_ids: dict[int, int] = {}
    for compass in PARAMETERS[vehicle.autopilot].compasses:
        with contextlib.suppress(NotSent):  # a vehicle with fewer
            device_ids[compass] = _device_id(vehicle, compass)[1]
            if device_ids[compass] == wanted:
                return compass
    listed = ", ".join(f"{compass}: {device or 'none'}" for compass, device in device_ids.items())
    raise NotSent(
        f"{vehicle.name} has no compass with device id {wanted} ({listed}), nothing was changed: the calibration is "
        "for another vehicle or compass; say --device-id, or calibrate this one"
    )


def _refuse_another(vehicle: Vehicle, compass: int, present: int, wanted: int | None) -> tuple[str, ...]:
    """See that the compass is the one that is meant."""
    if present == 0:
        raise NotSent(
            f"{vehicle.name} has no compass {compass} ({_identity(vehicle.autopilot, compass)[0]} is 0), nothing was "
            "changed: say another --compass, or start the vehicle with it connected"
        )
    if wanted is None:
        return (f"nobody said which compass the calibration is for: compass {compass} has device id {present}",)
    if wanted != present:
        raise NotSent(
            f"compass {compass} of {vehicle.name} has device id {present}, and the calibration is for {wanted}, "
            "nothing was changed: say another --compass, or --device-id where the compass was replaced on purpose"
        )
    return ()


def _set(vehicle: Vehicle, new: Parameter) -> None:
    """Set a parameter."""
    answered = vehicle.set(new)
    if answered is None or not same(answered, new.value):
        why = "does not answer" if answered is None else f"says {_spelled(answered)}"
        raise NotConfirmed(f"{vehicle.name} did not confirm {new.name} as {_spelled(new.value)}: it {why}")


def _refuse_stopped(stopped: Callable[[], bool]) -> None:
    """Give up where that was asked for."""
    if stopped():
        raise NotConfirmed("stopped before all was sent")


def _put_back(vehicle: Vehicle, touched: list[ParameterChange], *, say: Callable[[str], None], back: float) -> str:
    """Set the old values again, and say what the vehicle holds; a link that is lost is waited for."""
    if not touched:
        return "nothing was changed"
    left, until = list(reversed(touched)), time.monotonic() + back
    refused: list[ParameterChange] = []
    while left:
        try:
            answered = vehicle.set(left[0].old)
        except LinkError as error:
            say(f"! {error.message}; waiting up to {back:g} s for it, to put the values from before back")
            if not vehicle.come_back(until - time.monotonic()):
                break
            continue
        if answered is None or not same(answered, left[0].old.value):
            refused.append(left[0])
        left.pop(0)
    if not left and not refused:
        return f"the vehicle holds the values from before again (all {len(touched)} that were touched, confirmed)"
    names = [change.old.name for change in touched if change in refused or change in left]
    return (
        f"and the values from before could not be put back for {', '.join(names)}: DO NOT ARM before they are loaded "
        "from the file"
    )


def _spelled(value: float) -> str:
    """Write a value so that it is the same float32 when it is read."""
    return f"{int(value)}" if float(value).is_integer() and abs(value) < 1e9 else f"{value:.9g}"
