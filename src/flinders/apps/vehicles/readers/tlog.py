"""MAVLink telemetry logs (``.tlog``): what a ground station received, each packet after the time it came.

RAW_IMU and SCALED_IMU hold the first compass of a vehicle, SCALED_IMU2 and SCALED_IMU3 the second and the third, in
whole mG; HIGHRES_IMU that by which the vehicle steers, in gauss. **ArduPilot puts corrected readings into all of
them**, whatever RAW_IMU is called: its ``send_raw_imu`` and ``send_scaled_imu`` take ``compass.get_field``. They are
un-applied with the parameters that the log holds, where the ground station fetched them (PARAM_VALUE) while it was
logging, motor compensation with the current or the throttle that was sent. **PX4 puts vehicle_magnetometer into
HIGHRES_IMU**, which is corrected with CAL_MAG, less what its estimator learned in flight: of which compass is not
said, and readings are as they were sent. Of other autopilots it is not known here, and they are as well.

With a reading go acceleration, rate, current (SYS_STATUS), throttle (VFR_HUD) and, where readings are in the axes of
the vehicle, its attitude (ATTITUDE_QUATERNION or ATTITUDE, whichever was sent more often). Speed and course over
ground are those of the satellites (GPS_RAW_INT), else of the vehicle's estimate (GLOBAL_POSITION_INT).

The packets are found here and unpacked by pymavlink, which also checks their sums. Its times are those of the
vehicle; the date is that of the ground station's clock.

Sources: https://mavlink.io/en/messages/common.html for messages and units; PX4's
``src/modules/mavlink/streams/HIGHRES_IMU.hpp``; that ArduPilot's ``send_highres_imu`` takes the same field as the
others was not seen; https://mavlink.io/en/guide/serialization.html
for packets; that a time of eight bytes, microseconds since 1970 with the highest byte first, stands before each packet
was seen in what pymavlink and QGroundControl write.
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
    stored,
    unapplied,
    unused,
)
from flinders.apps.vehicles.targets.ardupilot import BY_CURRENT, BY_THROTTLE, OFF, ArduPilotParameters, compasses
from flinders.core.units import Unit
from flinders.errors import NoMagnetometer, UnreadableInput, counted
from flinders.foreign_errors import needs
from flinders.geometry.quaternions import of_angles
from flinders.readers._log import Instrument, Log, Position, first_position
from flinders.readers._names import CURRENT, THROTTLE
from flinders.readers._reader import Reader
from flinders.readers._resample import AttitudeSeries, TimeSeries, blocks, resampled, shares

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
"""Microseconds from 1970 to the years 2000 and 2100: no time of a packet lies beyond."""
MAY_BEGIN: Final = re.compile(rb"\x00[\x03-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""A time between those, and the first byte of a packet."""

HEARTBEAT, SYS_STATUS, PARAM_VALUE, RAW_IMU, GPS_RAW_INT, GLOBAL_POSITION_INT = 0, 1, 22, 27, 24, 33
ATTITUDE, ATTITUDE_QUATERNION, VFR_HUD, HIGHRES_IMU = 30, 31, 74, 105
COMPASS_MESSAGES: Final = {
    RAW_IMU: ("RAW_IMU", 1),
    26: ("SCALED_IMU", 1),
    116: ("SCALED_IMU2", 2),
    129: ("SCALED_IMU3", 3),
    HIGHRES_IMU: ("HIGHRES_IMU", 1),
}
"""Number of a message: its name, and which compass it holds."""
PLACES: Final = (GLOBAL_POSITION_INT, GPS_RAW_INT)
"""Where the vehicle says that it is, and where its GPS does."""
UNKNOWN: Final = 0xFFFF
"""Speed or course of GPS_RAW_INT that is not known."""
WANTED: Final = frozenset({
    HEARTBEAT, SYS_STATUS, PARAM_VALUE, ATTITUDE, ATTITUDE_QUATERNION, VFR_HUD, *PLACES, *COMPASS_MESSAGES,
})  # fmt: skip
MAG_UPDATED: Final = 0b1_1100_0000
"""Bits of HIGHRES_IMU.fields_updated that say that its compass was read anew."""
AN_ARDUPILOT, A_PX4 = 3, 12
"""HEARTBEAT.autopilot."""
GROUND_STATION: Final = 6
"""HEARTBEAT.type of a ground station."""
FIX: Final = 3
FIELDS: Final = ("xmag", "ymag", "zmag", "xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "temperature")
PLACE, SINCE, CLOCK, MAG, ACC, GYRO, TEMPERATURE = 0, 1, 2, slice(3, 6), slice(6, 9), slice(9, 12), 12
WIDTH: Final = 3 + len(FIELDS)
"""Numbers kept of a reading: its place in the log, s of the ground station since 1970, s of the vehicle, and fields."""
ATTITUDE_FIELDS: Final = {ATTITUDE_QUATERNION: ("q1", "q2", "q3", "q4"), ATTITUDE: ("roll", "pitch", "yaw")}
"""What is kept of an attitude, after s of the vehicle and s of the ground station since 1970: w, x, y, z, or rad."""
SAME_CLOCK: Final = 1.0
"""Seconds by which the clocks of two messages may differ, seen from the ground station, and be the same."""


class Units(NamedTuple):
    """What the numbers of a message are in."""

    field: Unit
    rate: float  # rad/s of one
    temperature: float
    in_mg: float  # mG, in which ArduPilot's parameters are, of one of the field


WHOLE: Final = Units(Unit.of("mG"), 1e-3, 0.01, 1.0)
IN_SI: Final = Units(Unit.of("G"), 1.0, 1.0, 1000.0)
"""Those of HIGHRES_IMU; all others have whole numbers."""


def begins_with_packet(head: bytes) -> bool:
    """Tell whether these are the first bytes of such a log: a time, a packet, and another unless they end there."""
    first = _packet(head, 0)
    return first is not None and (first.end + TIME_SIZE >= len(head) or head[first.end] == 0)


def open_tlog(file: File) -> Log:
    """Open a log: gather the readings, the parameters and the places that it holds.

    Raises `MissingExtra` without pymavlink; `UnreadableInput` for a file that cannot be read, or holds no packets;
    `NoMagnetometer` for a log without readings of a compass.
    """
    telemetry = _Telemetry(needs(DIALECT, "mavlink", "a MAVLink telemetry log"))
    with file.mapped() as content:
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
    """The number of a message, s since 1970 by the ground station's clock, and where its bytes begin and end."""

    message: int
    since: float
    start: int
    end: int


def reading(number: int, message: Any) -> tuple[float, ...]:  # noqa: ANN401 - of a generated class
    """S of the vehicle and `FIELDS` of a reading; nothing where HIGHRES_IMU has the reading before once more."""
    if number == HIGHRES_IMU and not message.fields_updated & MAG_UPDATED:
        return ()
    in_micros = number in (RAW_IMU, HIGHRES_IMU)
    clock = 1e-6 * message.time_usec if in_micros else 1e-3 * message.time_boot_ms
    return (clock, *(getattr(message, name, 0) for name in FIELDS))


def _reading(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """`WIDTH` numbers of a reading."""
    own = reading(packet.message, message)
    return (packet.start, packet.since, *own) if own else ()


def _attitude(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Two clocks, and `ATTITUDE_FIELDS`."""
    fields = (getattr(message, name) for name in ATTITUDE_FIELDS[packet.message])
    return (1e-3 * message.time_boot_ms, packet.since, *fields)


def _battery(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """A, where it is known."""
    return (packet.since, 0.01 * message.current_battery) if message.current_battery >= 0 else ()


def _throttle(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    return packet.since, 0.01 * message.throttle


def _place(packet: Packet, message: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Degrees, metres, s since 1970, and m/s over ground, north and east, where there is a fix."""
    if packet.message == GPS_RAW_INT and message.fix_type < FIX:
        return ()
    velocity = _by_satellites(message) if packet.message == GPS_RAW_INT else (0.01 * message.vx, 0.01 * message.vy)
    return (1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt, packet.since, *velocity)


def _by_satellites(message: Any) -> tuple[float, float]:  # noqa: ANN401
    """Speed and course of GPS_RAW_INT as m/s, north and east; NaN where one is not known."""
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
"""The numbers that are taken of a message, and how many they are."""


@dataclass(slots=True, eq=False)
class _Telemetry:
    """What was gathered of a log."""

    dialect: Any  # pymavlink's
    # by system and number of the message: its numbers as `ROWS` takes them, one message after the other
    rows: dict[tuple[int, int], array[float]] = field(default_factory=dict)
    # by system: place, name and value, each time that a parameter was sent
    parameters: dict[int, list[tuple[int, str, float]]] = field(default_factory=dict)
    autopilots: dict[int, int] = field(default_factory=dict)  # by system
    packets: int = 0  # how many there were, how many had a wrong sum, bytes that belong to none, and in how many places
    broken: int = 0
    skipped: int = 0
    gaps: int = 0

    def gather(self, content: mmap.mmap) -> None:
        """Go from packet to packet; after broken bytes, to the next that could be one."""
        decoder, at = self.dialect.MAVLink(None), 0
        wrong = (self.dialect.MAVError, struct.error, ValueError, IndexError, KeyError, TypeError)
        while at < len(content):
            packet = _packet(content, at)
            if packet is None:
                further = MAY_BEGIN.search(content, at + 1)
                after = further.start() if further else len(content)
                self.skipped, self.gaps, at = self.skipped + after - at, self.gaps + 1, after
                continue
            at, self.packets = packet.end, self.packets + 1
            if packet.message in WANTED:
                try:
                    message = decoder.decode(bytearray(content[packet.start : packet.end]))
                except wrong:
                    self.broken += 1
                    at = packet.start  # the bytes in it may hold a packet
                else:
                    self.take(packet, message)

    def take(self, packet: Packet, message: Any) -> None:  # noqa: ANN401 - of a generated class
        """Keep what is needed of a message."""
        system, number = message.get_srcSystem(), packet.message
        if number in ROWS:
            if row := ROWS[number][0](packet, message):
                self.rows.setdefault((system, number), array("d")).extend(row)
        elif number == HEARTBEAT and message.type != GROUND_STATION:
            self.autopilots.setdefault(system, message.autopilot)
        elif number == PARAM_VALUE:
            self.parameters.setdefault(system, []).append((packet.start, message.param_id, message.param_value))

    def table(self, system: int, number: int) -> Floats:
        """(N, k) numbers of a system's message."""
        return np.frombuffer(self.rows.get((system, number), array("d"))).reshape(-1, ROWS[number][1])

    def drives(self, system: int) -> dict[str, TimeSeries]:
        """Current and throttle, as far as they were sent, by the ground station's clock."""
        battery, throttle = self.table(system, SYS_STATUS), self.table(system, VFR_HUD)
        drives = {
            CURRENT: TimeSeries.of(battery[:, 0], battery[:, 1:]) if battery[:, 1].any() else None,
            THROTTLE: TimeSeries.of(throttle[:, 0], shares(throttle[:, 1:])),
        }
        return {kind: series for kind, series in drives.items() if series is not None}

    @property
    def position(self) -> Position | None:
        """The first of a vehicle's own, else of a GPS."""
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
        """Attitude of a system, and which column of a table of readings its times are to be compared with."""
        rows = max((self.table(system, number) for number in ATTITUDE_FIELDS), key=len)
        if not len(rows):
            return None, SINCE
        attitude = rows[:, 2:] if rows.shape[1] == 6 else of_angles(rows[:, 2:])
        ahead = np.median(rows[:, 0] - rows[:, 1]) - np.median(table[:, CLOCK] - table[:, SINCE])
        is_same = bool(abs(ahead) < SAME_CLOCK)
        return AttitudeSeries.of(rows[:, 0 if is_same else 1], attitude), CLOCK if is_same else SINCE


# the compasses


@dataclass(frozen=True, slots=True, eq=False)
class _Compass:
    """What the readings of a compass are made of."""

    source: str
    table: Floats  # (N, `WIDTH`)
    units: Units
    stage: NDArray[np.intp]  # (N,): which parameters were in force at each
    parameters: dict[int, ArduPilotParameters]  # by stage; empty where they are not known
    drives: Mapping[str, TimeSeries]  # by the clock of the ground station
    attitude: AttitudeSeries | None
    attitude_by: int  # column of the table with the clock that the attitude goes by

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Go through the readings; see `Instrument`."""
        warm = self.table[:, TEMPERATURE].any()

        def rows(part: slice) -> dict[str, Any]:
            table = self.table[part]
            return {
                "field": table[:, MAG] if as_logged else self._raw(table, self.stage[part]),
                "time": table[:, CLOCK],
                "acceleration": table[:, ACC],
                "rate": self.units.rate * table[:, GYRO],
                "temperature": self.units.temperature * table[:, TEMPERATURE] if warm else None,
                **resampled(self.drives, table[:, SINCE]),
                **resampled({"attitude": self.attitude}, table[:, self.attitude_by]),
            }

        return blocks(self.source, self.units.field, len(self.table), rows)

    def drive(self, parameters: ArduPilotParameters) -> TimeSeries | None:
        """What a compass's motor compensation goes by, where it is on and that was sent."""
        kind = {BY_CURRENT: CURRENT, BY_THROTTLE: THROTTLE}.get(parameters.motor_by, "")
        return self.drives.get(kind) if parameters.has_disturbances else None

    def taken_off(self, parameters: ArduPilotParameters) -> ArduPilotParameters:
        """What is un-applied of them: all but a motor compensation that goes by what was not sent."""
        stays = parameters.has_disturbances and self.drive(parameters) is None
        return replace(parameters, motor_by=OFF) if stays else parameters

    def _raw(self, table: Floats, stage: NDArray[np.intp]) -> Floats:
        """(N, 3) what the compass read, in the axes of the vehicle; NaN where its motor compensation is not known."""
        if not self.parameters:
            return table[:, MAG]
        motor = np.zeros((len(table), 3))
        for each, parameters in self.parameters.items():
            if (drive := self.drive(parameters)) is not None:
                rows = stage == each
                motor[rows] = drive.at(table[rows, SINCE]) * parameters.motor
        in_mg = self.units.in_mg
        return unapplied(self.source, table[:, MAG] * in_mg, stage, self.parameters, motor_offset=motor) / in_mg


def _instrument(file: File, telemetry: _Telemetry, system: int, message: int, *, several: bool) -> Instrument:
    """Make an instrument of the readings in one kind of message."""
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
        stored=None if in_force is None else stored(compass.taken_off(in_force), changes=len(parameters) - 1),
        frames=IN_VEHICLE_AXES if is_turned else ("sensor", "sensor"),
        autopilot="ardupilot" if is_ardupilot else None,
        compass=number if is_ardupilot else None,
        device_id=last.device_id,
        mounting=last.mounting_angles if is_turned else None,
        beginning=float(table[0, CLOCK]),
        velocity=telemetry.velocity(system, table),
        readings=len(table),
        notes=(*remarks, *["readings were sent in whole mG, cut towards zero"] * (units is WHOLE)),
        file=file,
    )


def _remarks(
    compass: _Compass, in_force: ArduPilotParameters, values: Mapping[str, float], message: int
) -> Iterator[str]:
    """What to know about a compass whose parameters are in the log."""
    yield mounting_words(in_force, values)
    if message == RAW_IMU:
        yield "ArduPilot sends corrected readings in RAW_IMU, too"
    if changes := len(compass.parameters) - 1:
        yield f"its parameters changed {counted(changes, 'time')}: each reading has those of its time removed"
    elif in_force.is_identity:
        yield "no calibration was in force: readings are as they were measured"
    if in_force.has_disturbances:
        by = "current" if in_force.motor_by == BY_CURRENT else "throttle"
        if compass.drive(in_force) is None:
            yield f"its motor compensation (COMPASS_MOT) stays on the readings: the {by} it goes by is not in the log"
        else:
            yield (
                f"its motor compensation (COMPASS_MOT) is removed by the {by} that was sent, which is told less "
                "often than it acts: read the vehicle's own log (.bin) where the motors ran"
            )
    yield from unused(values, in_force.compass)


def _unknown(autopilot: int | None, message: int) -> Iterator[str]:
    """What to know about a compass whose parameters are not there."""
    if autopilot == AN_ARDUPILOT:
        yield (
            "readings are corrected ones, and the log does not hold the parameters (COMPASS_OFS) to take that off: "
            "fetch them in the ground station while it is logging, or read the vehicle's own log (.bin)"
        )
    elif autopilot == A_PX4 and message == HIGHRES_IMU:
        yield (
            "readings are in the axes of the vehicle, corrected with CAL_MAG of a compass that is not named, less what "
            "the estimator learned in flight: they are as they were sent, and a calibration of them comes on top; for "
            "parameters read the vehicle's own log (.ulg)"
        )
    else:
        yield "whether readings are raw or corrected is not known for this autopilot: they are as they were sent"


def _damage(telemetry: _Telemetry, size: int) -> Iterator[str]:
    """What of the file could not be read."""
    if telemetry.broken:
        yield f"{counted(telemetry.broken, 'packet')} with a wrong check sum left out"
    if telemetry.skipped:
        places = counted(telemetry.gaps, "place")
        yield f"{counted(telemetry.skipped, 'byte')} of {size:,} in {places} belong to no packet: skipped"


def _packet(content: bytes | mmap.mmap, at: int) -> Packet | None:
    """Find the time and the packet that begin here, or nothing where there are none."""
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
        "each compass that a ground station heard of, with the calibration removed where it heard that too",
        starts=(b"\x00",),  # of a time before the year 4000
        sniff=begins_with_packet,
        log=open_tlog,
        extra="mavlink",
    ),
)
