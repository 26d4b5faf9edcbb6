"""MAVLink telemetry logs (``.tlog``): the packets that a ground station received, each after its time of arrival.

RAW_IMU and SCALED_IMU hold the first compass of a vehicle, SCALED_IMU2 and SCALED_IMU3 the second and the third, in
whole mG; HIGHRES_IMU holds the compass in use, in gauss. **ArduPilot puts corrected readings into all of
them**, in spite of the name RAW_IMU: its ``send_raw_imu`` and ``send_scaled_imu`` take ``compass.get_field``. The
correction is removed with the parameters in the log, if the ground station fetched them (PARAM_VALUE) while logging;
motor compensation is removed with the current or the throttle that was sent. **PX4 puts vehicle_magnetometer into
HIGHRES_IMU**, which is corrected with CAL_MAG less the estimator's in-flight estimate. The message does not name the
compass, so its readings stay as sent. Readings of other autopilots, whose correction is unknown, stay as sent too.

A reading has acceleration, rate, current (SYS_STATUS), throttle (VFR_HUD) and, for readings in the axes of the vehicle,
its attitude (ATTITUDE_QUATERNION or ATTITUDE, the more frequent one). Speed and course over ground come from the
satellites (GPS_RAW_INT), else from the vehicle's estimate (GLOBAL_POSITION_INT).

This module finds the packets; pymavlink unpacks them and checks their sums. Times are those of the vehicle; the date is
that of the ground station's clock.

Sources: https://mavlink.io/en/messages/common.html for messages and units; PX4's
``src/modules/mavlink/streams/HIGHRES_IMU.hpp``; https://mavlink.io/en/guide/serialization.html for packets. Files of
pymavlink and QGroundControl show that a time stands before each packet: eight bytes, microseconds since 1970, the
highest byte first. It is **unverified** that ArduPilot's ``send_highres_imu`` takes the same field as the others.
"""

from __future__ import annotations

import math
import re
import struct
from array import array
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.apps.vehicles.readers.parameters import (
    ARDUPILOT,
    IN_VEHICLE_AXES,
    mounting_words,
    stage_of,
    stages,
    stored_correction,
    unapply_stages,
    unused_words,
)
from flinders.apps.vehicles.targets.ardupilot import BY_CURRENT, BY_THROTTLE, OFF, ArduPilotParameters, compasses
from flinders.core.units import Unit
from flinders.errors import NoMagnetometer, UnreadableInput, count_text
from flinders.foreign_errors import import_optional
from flinders.geometry.quaternions import from_angles
from flinders.readers._log import Instrument, Log, Position, first_position
from flinders.readers._names import CURRENT, THROTTLE
from flinders.readers._reader import Reader
from flinders.readers._resample import AttitudeSeries, TimeSeries, blocks, resample, throttle_shares

if TYPE_CHECKING:
    import mmap
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.readers._source import File

DIALECT: Final = "pymavlink.dialects.v20.ardupilotmega"
TIME_SIZE: Final = 8
FIRST_VERSION, SECOND_VERSION = 0xFE, 0xFD  # first byte of a packet of MAVLink 1 and 2
SIGNATURE_SIZE: Final = 13
EARLIEST_US, LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""Range of valid times of a packet: the years 2000 to 2100, in microseconds since 1970."""
PACKET_START: Final = re.compile(rb"\x00[\x03-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""Pattern of a valid time and the first byte of a packet."""

HEARTBEAT, SYS_STATUS, PARAM_VALUE, RAW_IMU, GPS_RAW_INT, GLOBAL_POSITION_INT = 0, 1, 22, 27, 24, 33
ATTITUDE, ATTITUDE_QUATERNION, VFR_HUD, HIGHRES_IMU = 30, 31, 74, 105
COMPASS_MESSAGES: Final = {
    RAW_IMU: ("RAW_IMU", 1),
    26: ("SCALED_IMU", 1),
    116: ("SCALED_IMU2", 2),
    129: ("SCALED_IMU3", 3),
    HIGHRES_IMU: ("HIGHRES_IMU", 1),
}
"""Name of a message and the number of its compass, by the message's number."""
PLACES: Final = (GLOBAL_POSITION_INT, GPS_RAW_INT)
"""Messages with the position, of the vehicle's estimator and of its GPS."""
UNKNOWN: Final = 0xFFFF
"""Value of an unknown speed or course in GPS_RAW_INT."""
WANTED: Final = frozenset({
    HEARTBEAT, SYS_STATUS, PARAM_VALUE, ATTITUDE, ATTITUDE_QUATERNION, VFR_HUD, *PLACES, *COMPASS_MESSAGES,
})  # fmt: skip
MAG_UPDATED: Final = 0b1_1100_0000
"""Bits of HIGHRES_IMU.fields_updated for a new reading of the compass."""
AN_ARDUPILOT, A_PX4 = 3, 12
"""Values of HEARTBEAT.autopilot for ArduPilot and PX4."""
GROUND_STATION: Final = 6
"""Value of HEARTBEAT.type for a ground station."""
FIX: Final = 3
FIELDS: Final = ("xmag", "ymag", "zmag", "xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "temperature")
PLACE, SINCE, CLOCK, MAG, ACC, GYRO, TEMPERATURE = 0, 1, 2, slice(3, 6), slice(6, 9), slice(9, 12), 12
WIDTH: Final = 3 + len(FIELDS)
"""Number of values of a reading: place in the log, times by ground station (s since 1970) and vehicle (s), `FIELDS`."""
ATTITUDE_FIELDS: Final = {ATTITUDE_QUATERNION: ("q1", "q2", "q3", "q4"), ATTITUDE: ("roll", "pitch", "yaw")}
"""Fields of an attitude, kept after the two times: quaternion w, x, y, z, or angles in rad."""
MAX_CLOCK_DIFFERENCE_S: Final = 1.0
"""Largest difference in s of the offsets of two messages from the ground station's clock, if they share a clock."""


class Units(NamedTuple):
    """Units of the numbers in a message."""

    field: Unit
    rate: float  # rad/s in one unit of the message
    temperature: float  # °C in one unit of the message
    in_mg: float  # mG, the unit of ArduPilot's parameters, in one unit of the field


WHOLE: Final = Units(Unit.of("mG"), 1e-3, 0.01, 1.0)
IN_SI: Final = Units(Unit.of("G"), 1.0, 1.0, 1000.0)
"""Units of HIGHRES_IMU; `WHOLE` are those of all other messages."""


def begins_with_packet(head: bytes) -> bool:
    """Whether a file begins with a time and a packet, followed by a second time if the bytes go on."""
    first = _packet(head, 0)
    return first is not None and (first.end + TIME_SIZE >= len(head) or head[first.end] == 0)


def open_tlog(file: File) -> Log:
    """Open a log: gather its readings, parameters and positions.

    Raises `MissingExtra` without pymavlink; `UnreadableInput` for a file that cannot be read, or holds no packets;
    `NoMagnetometer` for a log without readings of a compass.
    """
    telemetry = _Telemetry(import_optional(DIALECT, "mavlink", "a MAVLink telemetry log"))
    with file.mapped_bytes() as content:
        telemetry.gather(content)
    if not telemetry.packets:
        raise UnreadableInput(f"{file.name} holds no MAVLink packets with their times: copy it again")
    order = list(COMPASS_MESSAGES)
    streams = [each for each in telemetry.rows if each[1] in order and telemetry.table(*each)[:, MAG].any()]
    streams.sort(key=lambda each: (each[0], order.index(each[1])))
    if not streams:
        raise NoMagnetometer(
            f"{file.name} is a MAVLink telemetry log without readings of a compass: have the vehicle send RAW_IMU or "
            "SCALED_IMU (stream RAW_SENSORS), or read its own log (.bin)"
        )
    several = len({system for system, _ in streams}) > 1
    begun = min(telemetry.table(*each)[0, SINCE] for each in streams)
    damage = tuple(_damage(telemetry, file.size))
    return Log(
        file.name,
        "MAVLink telemetry",
        tuple(_instrument(file, telemetry, *each, several=several) for each in streams),
        position=telemetry.position,
        begun=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=begun),
        notes=damage,
        damage=damage,
    )


# the packets


class Packet(NamedTuple):
    """Number of a message, time in s since 1970 by the ground station's clock, and bounds in bytes."""

    message: int
    since: float
    start: int
    end: int


def reading(number: int, message: Any) -> tuple[float, ...]:  # noqa: ANN401 - of a generated class
    """Time in s by the vehicle's clock, and `FIELDS`, of a reading; empty if HIGHRES_IMU repeats the previous one."""
    if number == HIGHRES_IMU and not message.fields_updated & MAG_UPDATED:
        return ()
    in_micros = number in (RAW_IMU, HIGHRES_IMU)
    clock = 1e-6 * message.time_usec if in_micros else 1e-3 * message.time_boot_ms
    return (clock, *(getattr(message, name, 0) for name in FIELDS))


def _reading(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Row of a reading: its `WIDTH` numbers; empty for a repeated reading."""
    own = reading(packet.message, message)
    return (packet.start, packet.since, *own) if own else ()


def _attitude(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Time in s by the vehicle's clock and by the ground station's clock, and `ATTITUDE_FIELDS`."""
    fields = (getattr(message, name) for name in ATTITUDE_FIELDS[packet.message])
    return (1e-3 * message.time_boot_ms, packet.since, *fields)


def _battery(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Time in s and current in A; empty if the current is unknown."""
    return (packet.since, 0.01 * message.current_battery) if message.current_battery >= 0 else ()


def _throttle(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    return packet.since, 0.01 * message.throttle


def _place(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Position in degrees and m, time in s since 1970, and velocity in m/s north and east; empty without a fix."""
    if packet.message == GPS_RAW_INT and message.fix_type < FIX:
        return ()
    velocity = _satellite_velocity(message) if packet.message == GPS_RAW_INT else (0.01 * message.vx, 0.01 * message.vy)
    return (1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt, packet.since, *velocity)


def _satellite_velocity(message: Any) -> tuple[float, float]:  # noqa: ANN401
    """Velocity of GPS_RAW_INT, m/s north and east; NaN if speed or course is unknown."""
    if UNKNOWN in (message.vel, message.cog):
        return math.nan, math.nan
    speed, course = 0.01 * message.vel, math.radians(0.01 * message.cog)
    return speed * math.cos(course), speed * math.sin(course)


ROWS: Final = {
    **dict.fromkeys(COMPASS_MESSAGES, (_reading, WIDTH)),
    **{number: (_attitude, 2 + len(names)) for number, names in ATTITUDE_FIELDS.items()},
    **dict.fromkeys(PLACES, (_place, 6)),
    SYS_STATUS: (_battery, 2),
    VFR_HUD: (_throttle, 2),
}
"""Function that returns the row of a message, and the width of the row, by the message's number."""


@dataclass(slots=True, eq=False)
class _Telemetry:
    """Rows, parameters and counts gathered from a log."""

    dialect: Any  # pymavlink's
    # rows of each kind of message, one after the other (see `ROWS`), by system and number of the message
    rows: dict[tuple[int, int], array[float]] = field(default_factory=dict)
    # place, name and value of each parameter message, by system
    parameters: dict[int, list[tuple[int, str, float]]] = field(default_factory=dict)
    autopilots: dict[int, int] = field(default_factory=dict)  # HEARTBEAT.autopilot, by system
    packets: int = 0  # number of all packets
    broken: int = 0  # number of packets with a wrong check sum
    skipped: int = 0  # number of bytes outside packets
    gaps: int = 0  # number of places with such bytes

    def gather(self, content: mmap.mmap) -> None:
        """Follow packets one by one; after damaged bytes, continue at the next possible start."""
        decoder, at = self.dialect.MAVLink(None), 0
        wrong = (self.dialect.MAVError, struct.error, ValueError, IndexError, KeyError, TypeError)
        while at < len(content):
            packet = _packet(content, at)
            if packet is None:
                further = PACKET_START.search(content, at + 1)
                after = further.start() if further else len(content)
                self.skipped, self.gaps, at = self.skipped + after - at, self.gaps + 1, after
                continue
            at, self.packets = packet.end, self.packets + 1
            if packet.message in WANTED:
                try:
                    message = decoder.decode(bytearray(content[packet.start : packet.end]))
                except wrong:
                    self.broken += 1
                    at = packet.start  # a packet may begin within the broken one
                else:
                    self.take(packet, message)

    def take(self, packet: Packet, message: Any) -> None:  # noqa: ANN401 - of a generated class
        """Add the row of a message to the rows of its kind, or a parameter to the parameters."""
        system, number = message.get_srcSystem(), packet.message
        if number in ROWS:
            if row := ROWS[number][0](packet, message):
                self.rows.setdefault((system, number), array("d")).extend(row)
        elif number == HEARTBEAT and message.type != GROUND_STATION:
            self.autopilots.setdefault(system, message.autopilot)
        elif number == PARAM_VALUE:
            self.parameters.setdefault(system, []).append((packet.start, message.param_id, message.param_value))

    def table(self, system: int, number: int) -> Floats:
        """(N, k) rows of a system's message."""
        return np.frombuffer(self.rows.get((system, number), array("d"))).reshape(-1, ROWS[number][1])

    def drives(self, system: int) -> dict[str, TimeSeries]:
        """Series of current and throttle that a system sent, timed by the ground station's clock."""
        battery, throttle = self.table(system, SYS_STATUS), self.table(system, VFR_HUD)
        drives = {
            CURRENT: TimeSeries.of(battery[:, 0], battery[:, 1:]) if battery[:, 1].any() else None,
            THROTTLE: TimeSeries.of(throttle[:, 0], throttle_shares(throttle[:, 1:])),
        }
        return {kind: series for kind, series in drives.items() if series is not None}

    @property
    def position(self) -> Position | None:
        """First position of a vehicle's estimator, else of a GPS."""
        tables = [self.table(*each) for number in PLACES for each in self.rows if each[1] == number]
        places = (first_position(*table[:, :3].T, fixed=np.ones(len(table), bool)) for table in tables)
        return next((each for each in places if each is not None), None)

    def velocity(self, system: int, table: Floats) -> TimeSeries | None:
        """Velocity over ground of a system, by the clock of a table of readings."""
        ahead = float(np.median(table[:, CLOCK] - table[:, SINCE]))
        fixes = (self.table(system, number) for number in reversed(PLACES))
        velocities = (TimeSeries.of(each[:, 3] + ahead, each[:, 4:]) for each in fixes)
        return next((each for each in velocities if each is not None), None)

    def attitude(self, system: int, table: Floats) -> tuple[AttitudeSeries | None, int]:
        """Attitude of a system, and the column of a table of readings with the clock of the attitude."""
        rows = max((self.table(system, number) for number in ATTITUDE_FIELDS), key=len)
        if not len(rows):
            return None, SINCE
        attitude = rows[:, 2:] if rows.shape[1] == 6 else from_angles(rows[:, 2:])
        ahead = np.median(rows[:, 0] - rows[:, 1]) - np.median(table[:, CLOCK] - table[:, SINCE])
        is_same = bool(abs(ahead) < MAX_CLOCK_DIFFERENCE_S)
        return AttitudeSeries.of(rows[:, 0 if is_same else 1], attitude), CLOCK if is_same else SINCE


# the compasses


@dataclass(frozen=True, slots=True, eq=False)
class _Compass:
    """Rows of a compass, and the parameters that corrected them."""

    source: str
    table: Floats  # (N, `WIDTH`)
    units: Units
    stage: NDArray[np.intp]  # (N,): stage of the parameters in force at each
    parameters: dict[int, ArduPilotParameters]  # by stage; empty if unknown
    drives: Mapping[str, TimeSeries]  # by the clock of the ground station
    attitude: AttitudeSeries | None
    attitude_by: int  # column of the table with the clock of the attitude

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Yield the readings in blocks, raw or as logged; see `Instrument`."""
        warm = self.table[:, TEMPERATURE].any()

        def rows(part: slice) -> dict[str, Any]:
            table = self.table[part]
            return {
                "field": table[:, MAG] if as_logged else self._raw(table, self.stage[part]),
                "time": table[:, CLOCK],
                "acceleration": table[:, ACC],
                "rate": self.units.rate * table[:, GYRO],
                "temperature": self.units.temperature * table[:, TEMPERATURE] if warm else None,
                **resample(self.drives, table[:, SINCE]),
                **resample({"attitude": self.attitude}, table[:, self.attitude_by]),
            }

        return blocks(self.source, self.units.field, len(self.table), rows)

    def drive(self, parameters: ArduPilotParameters) -> TimeSeries | None:
        """Current or throttle of the motor compensation; None if it is off or the series was not sent."""
        kind = {BY_CURRENT: CURRENT, BY_THROTTLE: THROTTLE}.get(parameters.motor_by, "")
        return self.drives.get(kind) if parameters.has_disturbances else None

    def removable(self, parameters: ArduPilotParameters) -> ArduPilotParameters:
        """Parameters whose correction can be removed: without motor compensation if no current or throttle was sent."""
        stays = parameters.has_disturbances and self.drive(parameters) is None
        return replace(parameters, motor_by=OFF) if stays else parameters

    def _raw(self, table: Floats, stage: NDArray[np.intp]) -> Floats:
        """(N, 3) raw readings in the axes of the vehicle; NaN if the motor compensation is unknown."""
        if not self.parameters:
            return table[:, MAG]
        motor = np.zeros((len(table), 3))
        for each, parameters in self.parameters.items():
            if (drive := self.drive(parameters)) is not None:
                rows = stage == each
                motor[rows] = drive.at(table[rows, SINCE]) * parameters.motor
        in_mg = self.units.in_mg
        return unapply_stages(self.source, table[:, MAG] * in_mg, stage, self.parameters, motor_offset=motor) / in_mg


def _instrument(file: File, telemetry: _Telemetry, system: int, message: int, *, several: bool) -> Instrument:
    """Make an instrument from the readings in one kind of message."""
    name, number = COMPASS_MESSAGES[message]
    table = telemetry.table(system, message)
    changes = stages(telemetry.parameters.get(system, ()), ARDUPILOT, file.name)
    values, stage = changes[-1][1], stage_of(table[:, PLACE], changes)
    known = number in compasses(values)
    parameters = (
        {each: ArduPilotParameters.read(changes[each][1], number) for each in set(stage.tolist())} if known else {}
    )
    autopilot = telemetry.autopilots.get(system)
    is_ardupilot = known or autopilot == AN_ARDUPILOT
    last = ArduPilotParameters.read(values, number) if is_ardupilot else ArduPilotParameters()
    is_turned = is_ardupilot or (autopilot == A_PX4 and message == HIGHRES_IMU)
    units = IN_SI if message == HIGHRES_IMU else WHOLE
    attitude = telemetry.attitude(system, table) if is_turned else (None, SINCE)
    compass = _Compass(file.name, table, units, stage, parameters, telemetry.drives(system), *attitude)
    in_force = parameters[int(stage[-1])] if known else None
    remarks = _remarks(compass, in_force, values, message) if in_force else _unknown(autopilot, message)
    return Instrument(
        file.name,
        f"{name} (system {system})" if several else name,
        units.field,
        compass.columns,
        stored=None
        if in_force is None
        else stored_correction(compass.removable(in_force), changes=len(parameters) - 1),
        frames=IN_VEHICLE_AXES if is_turned else ("sensor", "sensor"),
        autopilot="ardupilot" if is_ardupilot else None,
        compass=number if is_ardupilot else None,
        device_id=last.device_id,
        mounting=last.mounting_angles if is_turned else None,
        beginning=float(table[0, CLOCK]),
        velocity=telemetry.velocity(system, table),
        readings=len(table),
        notes=(*remarks, *["readings were sent in whole mG, truncated towards zero"] * (units is WHOLE)),
        file=file,
    )


def _remarks(
    compass: _Compass, in_force: ArduPilotParameters, values: Mapping[str, float], message: int
) -> Iterator[str]:
    """Yield notes on a compass whose parameters are in the log."""
    yield mounting_words(in_force, values)
    if message == RAW_IMU:
        yield "ArduPilot sends corrected readings in RAW_IMU, too"
    if changes := len(compass.parameters) - 1:
        times = count_text(changes, "time")
        yield f"its parameters changed {times}: from each reading, those in force then are removed"
    elif in_force.is_identity:
        yield "no calibration was in force: readings are raw"
    if in_force.has_disturbances:
        by = "current" if in_force.motor_by == BY_CURRENT else "throttle"
        if compass.drive(in_force) is None:
            yield f"its motor compensation (COMPASS_MOT) stays on the readings: the log lacks the {by}"
        else:
            yield (
                f"its motor compensation (COMPASS_MOT) is removed with the {by} in the telemetry, which is slower "
                "than the compensation: read the vehicle's own log (.bin) if the motors ran"
            )
    yield from unused_words(values, in_force.compass)


def _unknown(autopilot: int | None, message: int) -> Iterator[str]:
    """Yield notes on a compass whose parameters are not in the log."""
    if autopilot == AN_ARDUPILOT:
        yield (
            "readings are corrected, and the log lacks the parameters (COMPASS_OFS) to undo that: "
            "fetch them in the ground station while logging, or read the vehicle's own log (.bin)"
        )
    elif autopilot == A_PX4 and message == HIGHRES_IMU:
        yield (
            "readings are in the axes of the vehicle, corrected with CAL_MAG of an unnamed compass and with the "
            "estimator's in-flight estimate. They are used as sent; a calibration from them adds to that correction. "
            "For parameters, read the vehicle's own log (.ulg)"
        )
    else:
        yield "whether readings are raw or corrected is not known for this autopilot: they are used as sent"


def _damage(telemetry: _Telemetry, size: int) -> Iterator[str]:
    """Yield notes on parts of the file that could not be read."""
    if telemetry.broken:
        yield f"{count_text(telemetry.broken, 'packet')} with a wrong check sum left out"
    if telemetry.skipped:
        places = count_text(telemetry.gaps, "place")
        yield f"{count_text(telemetry.skipped, 'byte')} of {size:,} in {places} belong to no packet: skipped"


def _packet(content: bytes | mmap.mmap, at: int) -> Packet | None:
    """Return the packet whose time begins at byte `at`; None if there is none."""
    head = content[at : at + TIME_SIZE + 10]
    since = int.from_bytes(head[:TIME_SIZE], "big")
    if len(head) < TIME_SIZE + 8 or not EARLIEST_US < since < LATEST_US:
        return None
    magic, length, start = head[TIME_SIZE], head[TIME_SIZE + 1], at + TIME_SIZE
    if magic == FIRST_VERSION:
        message, end = head[TIME_SIZE + 5], start + 8 + length
    elif magic == SECOND_VERSION:
        message = int.from_bytes(head[TIME_SIZE + 7 : TIME_SIZE + 10], "little")
        end = start + 12 + length + SIGNATURE_SIZE * (head[TIME_SIZE + 2] & 1)
    else:
        return None
    return Packet(message, 1e-6 * since, start, end) if end <= len(content) else None


READERS: Final = (
    Reader(
        "tlog",
        "MAVLink telemetry",
        (".tlog",),
        "each compass in the telemetry, with the calibration in force removed if its parameters were fetched",
        starts=(b"\x00",),  # of a time before the year 4000
        sniff=begins_with_packet,
        log=open_tlog,
        extra="mavlink",
    ),
)
