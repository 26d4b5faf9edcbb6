"""Telemetry of a vehicle's compass: a feed of readings that also receives the calibration."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.vehicles.mavlink import ARDUPILOT, Vehicle
from flinders.apps.vehicles.mavlink_parameters import TARGETS, ParameterPlan
from flinders.apps.vehicles.readers.tlog import (
    COMPASS_MESSAGES,
    HIGHRES_IMU,
    IN_SI,
    RAW_IMU,
    WHOLE,
    reading,
)
from flinders.apps.vehicles.targets.ardupilot import COMPASSES, ArduPilotParameters, names
from flinders.core.samples import Samples
from flinders.errors import ArrayError, LinkError, NotSent, UsageError
from flinders.links.feeds import FeedEvent
from flinders.targets import find

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.links.feeds import Received
    from flinders.links.transports import ByteSource

ASK_AGAIN_S: Final = 3.0  # Time without a reading after which the request is repeated and advice is given
BATCH_S: Final = 0.03
"""Time in s within which arriving readings form one batch."""
FETCH_TRIES: Final = 4  # Largest number of requests for each parameter
REPORTED: Final = ("OFS_X", "OFS_Y", "OFS_Z", "DIA_X", "DIA_Y", "DIA_Z", "ODI_X", "ODI_Y", "ODI_Z")
"""Parameters of the calibration in force; older firmware lacks SCALE, which is read separately."""
SELECTION_S: Final = 1.0  # Time to wait for a better kind of message
GRAVITY: Final = 9.80665
RECOVERY_S: Final = 0.5  # Longest wait for a lost vehicle in each attempt
MOTOR_TRIES: Final = 2  # Largest number of requests for COMPASS_MOT, which some vehicles lack


class Telemetry:
    """Telemetry of a vehicle's compass: a `Feed`, and a `Recipient` of the calibration.

    RAW_IMU and SCALED_IMU hold the first compass, SCALED_IMU2 and SCALED_IMU3 the second and the third, in whole mG.
    **ArduPilot sends corrected readings in all of them**: the calibration in force is requested and removed.
    Of other autopilots, HIGHRES_IMU (gauss) is preferred and used as sent; PX4's is already corrected.
    A RAW_IMU that is not ArduPilot's is in counts, as the protocol defines. Whether PX4's SCALED_IMU is corrected is
    **unverified**. Messages are those of `flinders.apps.vehicles.readers.tlog`.

    Parameters
    ----------
    vehicle : Vehicle
    compass : int
        1 to 3, in ArduPilot's numbering.
    """

    def __init__(self, vehicle: Vehicle, compass: int = 1) -> None:
        if compass not in COMPASSES:
            raise UsageError(f"compass {compass}: MAVLink has messages for compass 1, 2 and 3")
        self._vehicle, self._compass = vehicle, compass
        self.name = f"compass {compass} of {vehicle.name}"
        self._messages = _ranked_messages(vehicle.autopilot, compass)
        self._start = self._heard = time.monotonic()
        self._parameters: ArduPilotParameters | None = None
        self._kinds: dict[int, float] = {}
        self._kind: int | None = None
        self._last: tuple[float, ...] = ()
        self._is_gone = self._is_over = self._is_advised = self._is_unsure = False
        self._device: int | None = None
        self._waiting: deque[FeedEvent] = deque([FeedEvent("connected", 0.0, f"{self.name}: {self._fetch()}")])
        self._ask()

    def next(self, timeout: float) -> Received:
        """As `Feed.next`."""
        if self._waiting:
            return self._waiting.popleft()
        if self._is_over:
            time.sleep(timeout)
            return None
        if self._is_gone:
            return self._come_back(timeout)
        rows: list[tuple[float, ...]] = []
        try:
            messages = self._vehicle.messages(min(timeout, BATCH_S))
            rows = [row for message in messages if (row := self._row(message)) is not None]
        except LinkError as error:
            self._is_gone = True
            self._waiting.append(FeedEvent("gone", self._now(), error.message))
        else:
            self._remind(bool(rows))
        return self._samples(np.array(rows)) if rows else None

    def close(self) -> None:
        """As `Feed.close`."""
        self._is_over = True
        self._vehicle.source.close()

    @property
    def target(self) -> str:
        """Name of the export target for this vehicle."""
        return TARGETS[self._vehicle.autopilot]

    @property
    def refusal(self) -> str:
        """As `Recipient.refusal`."""
        return "it sends nothing" if self._is_gone else "it is armed" if self._vehicle.armed else ""

    def on_board(self, field_strength: float) -> Calibration | None:
        """As `Recipient.on_board`; does not include a mounting."""
        return None if self._parameters is None else self._parameters.to_calibration(field_strength)

    def transfer(self, calibration: Calibration) -> VehicleTransfer:
        """As `Recipient.transfer`.

        Raises
        ------
        NotSent
            If the vehicle's own correction is unknown or was changed meanwhile, and as `ParameterPlan.of`.
        NotExportable, UnitError, LinkError
            As `ParameterPlan.of`.
        """
        before = self._parameters
        if before is None:
            raise NotSent(
                f"{self.name} sends readings that are corrected with values that it does not report, so a calibration "
                "from them cannot replace these values; calibrate from its log, and use flinders send"
            )
        self._fetch()
        if self._parameters is None or self._parameters.rows() != before.rows():
            raise NotSent(f"the parameters of {self.name} were changed by another program; nothing was sent")
        if self._has_motors():
            raise NotSent(
                f"{self.name} compensates for motors (COMPASS_MOT), which depends on the matrix on board: set "
                "COMPASS_MOTCT to 0, or send by hand and run CompassMot again"
            )
        plan = ParameterPlan.of(self._vehicle, calibration, compass=self._compass, device_id=self._device)
        self._device = plan.device_id
        return VehicleTransfer(plan, find(self.target).suffix, self._look_again)

    def _has_motors(self) -> bool:
        by = self._vehicle.get("COMPASS_MOTCT", tries=MOTOR_TRIES)
        if by is None or not by.value:
            return False
        axes = (self._vehicle.get(*names("MOT", self._compass, f"_{axis}"), tries=MOTOR_TRIES) for axis in "XYZ")
        return any(one is not None and one.value for one in axes)

    def _look_again(self) -> None:
        """Fetch the parameters again; if the link is lost, do it once the link is back."""
        self._is_unsure = True
        with contextlib.suppress(LinkError):
            self._fetch()
            self._is_unsure = False

    def _now(self) -> float:
        return time.monotonic() - self._start

    def _fetch(self) -> str:
        """Fetch the calibration in force, and return a sentence on how readings are treated."""
        if self._vehicle.autopilot != ARDUPILOT:
            return "readings as they are sent; whether they are raw or corrected is not known for this autopilot"
        values: dict[str, float] = {}
        for name in (*REPORTED, "SCALE"):
            group, _, axis = name.partition("_")
            known = names(group, self._compass, f"_{axis}" if axis else "")
            parameter = self._vehicle.get(*known, tries=FETCH_TRIES)
            if parameter is None and name in REPORTED:
                return f"corrected readings: the vehicle does not report its {known[0]}, so the correction stays"
            if parameter is not None:
                values[known[0]] = parameter.value
        self._parameters = ArduPilotParameters.read(values, self._compass)
        return f"its correction is removed: {self._parameters.words()}"

    def _ask(self) -> None:
        """Request the messages; no effect on a vehicle that already sends them."""
        self._heard = time.monotonic()
        with contextlib.suppress(LinkError):
            for message in self._messages:
                self._vehicle.ask_for(message)

    def _remind(self, has_readings: bool) -> None:
        """Repeat the request while no reading arrives, and add one event about it."""
        if has_readings:
            self._heard = time.monotonic()
        elif time.monotonic() - self._heard > ASK_AGAIN_S:
            self._ask()
            if not self._is_advised:
                self._is_advised = True
                wanted = " or ".join(COMPASS_MESSAGES[number][0] for number in self._messages)
                self._waiting.append(
                    FeedEvent(
                        "nothing",
                        self._now(),
                        f"{self.name} sends no {wanted} on request: check that it has this compass, and set its "
                        "stream RAW_SENSORS (SRn_RAW_SENS)",
                    )
                )

    def _come_back(self, timeout: float) -> FeedEvent | None:
        if not self._vehicle.come_back(min(timeout, RECOVERY_S)):
            return None
        self._is_gone = False
        if self._is_unsure:
            self._look_again()
        self._ask()
        return FeedEvent("back", self._now(), f"{self.name} is back")

    def _row(self, message: Any) -> tuple[float, ...] | None:  # noqa: ANN401 - pymavlink has no types
        """Reading in a message of the chosen kind; None for another kind, and for a repeated reading."""
        number = message.get_msgId()
        row = reading(number, message) if number in self._messages else ()
        if not any(row[1:4]) or number != self._chosen_kind(number) or row[:4] == self._last:
            return None
        self._last = row[:4]
        return row

    def _chosen_kind(self, number: int) -> int | None:
        """Kind of message to use: the best of those received within `SELECTION_S`."""
        if self._kind is None:
            self._kinds.setdefault(number, self._now())
            if number == self._messages[0] or self._now() - min(self._kinds.values()) > SELECTION_S:
                self._kind = min(self._kinds, key=self._messages.index)
        return self._kind

    def _samples(self, rows: Floats) -> Samples:
        clock, field, force, rate = rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:10]
        warm = np.where(rows[:, 10], rows[:, 10], np.nan)  # 0 if unknown
        units = IN_SI if self._kind == HIGHRES_IMU else WHOLE
        is_raw = self._kind == RAW_IMU and self._vehicle.autopilot != ARDUPILOT
        return Samples.of(
            self._raw(field),
            unit="counts" if is_raw else units.field,
            time=clock,
            acceleration=force if is_raw or units is IN_SI else 1e-3 * GRAVITY * force,
            rate=None if is_raw else units.rate * rate,
            temperature=units.temperature * warm if np.isfinite(warm).any() else None,
            source=self.name,
        )

    def _raw(self, field: Floats) -> Floats:
        """(N, 3) raw readings of the compass, mG."""
        if self._parameters is None:
            return field
        try:
            return self._parameters.unapply(field, motor_offset=np.zeros(3))
        except ArrayError as error:
            self._parameters = None
            self._waiting.append(FeedEvent("garbage", self._now(), f"{error.message}; readings are used as sent"))
            return field


@dataclass(frozen=True, slots=True)
class VehicleTransfer:
    """A `Transfer` of a parameter plan, after which the vehicle corrects its readings differently."""

    plan: ParameterPlan
    suffix: str
    look_again: Callable[[], None]  #: fetches the parameters again

    @property
    def is_done(self) -> bool:
        """As `Transfer.is_done`."""
        return not self.plan.pending

    def backup(self) -> str:
        """As `Transfer.backup`."""
        return self.plan.backup()

    def carry_out(self, *, stopped: Callable[[], bool], say: Callable[[str], None]) -> str:
        """As `Transfer.carry_out`; raises as `ParameterPlan.carry_out`."""
        try:
            self.plan.carry_out(stopped=stopped, say=say)
        finally:
            self.look_again()
        plan = self.plan
        done = f"compass {plan.compass} holds the calibration, all {len(plan.changes)} values read back"
        return f"{plan.vehicle.name}: {done}"


def _ranked_messages(autopilot: int, compass: int) -> tuple[int, ...]:
    """Messages with readings of a compass, the best first: RAW_IMU for ArduPilot, else the one in gauss."""
    known = [number for number, (_, which) in COMPASS_MESSAGES.items() if which == compass]
    if autopilot == ARDUPILOT:
        return tuple(number for number in known if number != HIGHRES_IMU)
    return tuple(sorted(known, key=lambda number: (number != HIGHRES_IMU, number == RAW_IMU)))


def opened(source: ByteSource, compass: int) -> Telemetry:
    """Find the vehicle on a link, and return the feed of one of its compasses. Raises as `Vehicle.find`."""
    return Telemetry(Vehicle.find(source), compass)
