"""MAVLink telemetry logs (``.tlog``): what a ground station heard, each packet after the time it came.

RAW_IMU and SCALED_IMU hold the first compass of a vehicle, SCALED_IMU2 and SCALED_IMU3 the second and the third, in
whole mG. **ArduPilot puts corrected readings into all of them**, whatever RAW_IMU is called: its ``send_raw_imu`` and
``send_scaled_imu`` take ``compass.get_field``. They are un-applied with the parameters that the log holds, where the
ground station fetched them (PARAM_VALUE) while it was logging. Of other autopilots it is not known here, and readings
are as they were sent.

The packets are found here and unpacked by pymavlink, which also checks their sums. Its times are those of the
vehicle; the date is that of the ground station's clock.

Sources: https://mavlink.io/en/messages/common.html for messages and units; https://mavlink.io/en/guide/serialization.html
for packets; that a time of eight bytes, microseconds since 1970 with the highest byte first, stands before each packet
was seen in what pymavlink and QGroundControl write.
"""

from __future__ import annotations

import mmap
import re
import struct
from array import array
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.conventions.ardupilot import Parameters, compasses
from flinders.errors import ArrayError, NoMagnetometer, UnreadableInput, counted
from flinders.readers._ardupilot import IN_VEHICLE_AXES, History, device_id, mounting_told, stored, unused
from flinders.readers._beside import Beside
from flinders.readers._extras import needs
from flinders.readers._log import Instrument, Log, Position
from flinders.readers._source import refusal
from flinders.samples import BLOCK, Samples
from flinders.units import Unit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.readers._source import File

FORMAT: Final = "MAVLink telemetry"
DIALECT: Final = "pymavlink.dialects.v20.ardupilotmega"
TIME_SIZE: Final = 8
FIRST_VERSION, SECOND_VERSION = 0xFE, 0xFD
SIGNATURE_SIZE: Final = 13
EARLIEST_US, LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""Microseconds from 1970 to the years 2000 and 2100: no time of a packet lies beyond."""
MAY_BEGIN: Final = re.compile(rb"\x00[\x03-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""A time between those, and the first byte of a packet."""

HEARTBEAT, SYS_STATUS, PARAM_VALUE, RAW_IMU, GPS_RAW_INT, GLOBAL_POSITION_INT = 0, 1, 22, 27, 24, 33
COMPASS_MESSAGES: Final = {
    RAW_IMU: ("RAW_IMU", 1),
    26: ("SCALED_IMU", 1),
    116: ("SCALED_IMU2", 2),
    129: ("SCALED_IMU3", 3),
}
"""Number of a message: its name, and which compass it holds."""
WANTED: Final = frozenset({HEARTBEAT, SYS_STATUS, PARAM_VALUE, GPS_RAW_INT, GLOBAL_POSITION_INT, *COMPASS_MESSAGES})
ARDUPILOT: Final = 3
"""HEARTBEAT.autopilot of ArduPilot."""
GROUND_STATION: Final = 6
"""HEARTBEAT.type of a ground station."""
FIX: Final = 3
FIELDS: Final = ("xmag", "ymag", "zmag", "xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "temperature")
PLACE, CLOCK, SINCE, MAG, ACC, GYRO, TEMPERATURE = 0, 1, 2, slice(3, 6), slice(6, 9), slice(9, 12), 12
WIDTH: Final = 3 + len(FIELDS)
"""Numbers kept of a reading: its place in the log, s of the vehicle, s of the ground station since 1970, and fields."""


def sniff_tlog(head: bytes) -> bool:
    """Tell whether these are the first bytes of such a log: a time, a packet, and another unless they end there."""
    first = _packet(head, 0)
    return first is not None and (first.end + TIME_SIZE >= len(head) or head[first.end] == 0)


def open_tlog(file: File) -> Log:
    """Open a log: gather the readings, the parameters and the places that it holds.

    Raises
    ------
    MissingExtra
        Without pymavlink.
    UnreadableInput
        For a file that cannot be read, or holds no packets.
    NoMagnetometer
        For a log without readings of a compass.
    """
    heard = _Heard(needs(DIALECT, "mavlink", "a MAVLink telemetry log"))
    with _mapped(file) as content:
        heard.listen(content)
    if not heard.packets:
        raise UnreadableInput(f"{file.name} holds no MAVLink packets with their times: copy it again")
    found = [each for each in heard.readings if heard.table(each)[:, MAG].any()]
    if not found:
        raise NoMagnetometer(
            f"{file.name} is a MAVLink telemetry log without readings of a compass: have the vehicle send RAW_IMU or "
            "SCALED_IMU (stream RAW_SENSORS), or read its own log (.bin)"
        )
    order = list(COMPASS_MESSAGES)
    found.sort(key=lambda each: (each[0], order.index(each[1])))
    return Log(
        file.name,
        FORMAT,
        tuple(_instrument(file, heard, each, several=len({system for system, _ in found}) > 1) for each in found),
        position=heard.position or heard.fix,
        begun=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=min(heard.table(each)[0, SINCE] for each in found)),
        notes=_notes(heard, file.size),
    )


class Packet(NamedTuple):
    """Where a packet lies in a log.

    Attributes
    ----------
    message : int
        Its number.
    since : float, s
        Since 1970, by the clock of the ground station.
    start, end : int
        Of its bytes, without the time before them.
    """

    message: int
    since: float
    start: int
    end: int


@dataclass(slots=True, eq=False)
class _Heard:
    """What was gathered of a log.

    Attributes
    ----------
    dialect : module
        pymavlink's.
    readings : dict of array
        By system and number of the message: `WIDTH` numbers a reading.
    told : dict of list
        By system: place, name and value of each parameter that was told.
    autopilots : dict of int
        By system.
    currents : dict of array
        By system: s since 1970, and A, in turn.
    position, fix : Position, optional
        First of the vehicle's own, and of its GPS.
    packets, broken, strays, gaps : int
        How many there were, how many had a wrong sum, bytes that belong to none, and in how many places.
    """

    dialect: Any
    readings: dict[tuple[int, int], array[float]] = field(default_factory=dict)
    told: dict[int, list[tuple[int, str, float]]] = field(default_factory=dict)
    autopilots: dict[int, int] = field(default_factory=dict)
    currents: dict[int, array[float]] = field(default_factory=dict)
    position: Position | None = None
    fix: Position | None = None
    packets: int = 0
    broken: int = 0
    strays: int = 0
    gaps: int = 0

    def listen(self, content: mmap.mmap) -> None:
        """Go from packet to packet; after broken bytes, to the next that could be one."""
        decoder, at = self.dialect.MAVLink(None), 0
        wrong = (self.dialect.MAVError, struct.error, ValueError, IndexError, KeyError, TypeError)
        while at < len(content):
            packet = _packet(content, at)
            if packet is None:
                further = MAY_BEGIN.search(content, at + 1)
                after = further.start() if further else len(content)
                self.strays, self.gaps, at = self.strays + after - at, self.gaps + 1, after
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
        if number in COMPASS_MESSAGES:
            clock = 1e-6 * message.time_usec if number == RAW_IMU else 1e-3 * message.time_boot_ms
            fields = (getattr(message, name, 0) for name in FIELDS)
            self.readings.setdefault((system, number), array("d")).extend((packet.start, clock, packet.since, *fields))
        elif number == HEARTBEAT and message.type != GROUND_STATION:
            self.autopilots.setdefault(system, message.autopilot)
        elif number == PARAM_VALUE:
            self.told.setdefault(system, []).append((packet.start, message.param_id, message.param_value))
        elif number == SYS_STATUS and message.current_battery >= 0:
            self.currents.setdefault(system, array("d")).extend((packet.since, 0.01 * message.current_battery))
        elif number == GPS_RAW_INT and message.fix_type >= FIX:
            self.fix = self.fix or _position(message)
        elif number == GLOBAL_POSITION_INT:
            self.position = self.position or _position(message)

    def table(self, each: tuple[int, int]) -> Floats:
        """(N, `WIDTH`) readings of a system's message."""
        return np.frombuffer(self.readings[each]).reshape(-1, WIDTH)

    def current(self, system: int) -> Beside | None:
        """Current of a system's battery, unless it never says that any flows."""
        told = np.frombuffer(self.currents.get(system, array("d"))).reshape(-1, 2)
        return Beside.of(told[:, 0], told[:, 1:]) if told[:, 1].any() else None


@dataclass(frozen=True, slots=True, eq=False)
class _Compass:
    """What the readings of a compass are made of.

    Attributes
    ----------
    source : str
    table : (N, `WIDTH`) float
    version : (N,) int
        How many changes of parameters came before each.
    parameters : dict of Parameters
        By number of changes; empty where they are not known.
    current : Beside, optional
        By the clock of the ground station.
    """

    source: str
    table: Floats
    version: NDArray[np.intp]
    parameters: dict[int, Parameters]
    current: Beside | None

    def columns(self, as_logged: bool) -> Iterator[Samples]:
        """Go through the readings; see `Instrument`."""
        warm = self.table[:, TEMPERATURE].any()
        for start in range(0, len(self.table), BLOCK):
            rows = self.table[start : start + BLOCK]
            field = rows[:, MAG] if as_logged else self._raw(rows[:, MAG], self.version[start : start + BLOCK])
            yield Samples.of(
                field,
                unit="mG",
                time=rows[:, CLOCK],
                acceleration=rows[:, ACC],
                rate=1e-3 * rows[:, GYRO],
                temperature=0.01 * rows[:, TEMPERATURE] if warm else None,
                current=None if self.current is None else self.current.at(rows[:, SINCE])[:, 0],
                source=self.source,
            )

    def _raw(self, field: Floats, version: NDArray[np.intp]) -> Floats:
        """(N, 3) what the compass read, in mG and in the axes of the vehicle."""
        raw = field.copy()
        for each in set(version.tolist()) if self.parameters else ():
            rows = version == each
            try:
                raw[rows] = self.parameters[each].unapply(field[rows], motor_offset=np.zeros(3))
            except ArrayError as error:
                raise ArrayError(f"{self.source}: {error}; take the readings --as-logged") from None
        return raw


def _instrument(file: File, heard: _Heard, each: tuple[int, int], *, several: bool) -> Instrument:
    """Make an instrument of the readings in one kind of message."""
    system, (name, number) = each[0], COMPASS_MESSAGES[each[1]]
    table, history = heard.table(each), History.of(heard.told.get(system, ()), file.name)
    version = history.change(table[:, PLACE])
    known = number in compasses(history.last)
    parameters = {one: Parameters.read(history.at(one), number) for one in set(version.tolist())} if known else {}
    compass = _Compass(file.name, table, version, parameters, heard.current(system))
    in_force = parameters[int(version[-1])] if parameters else None
    is_ardupilot = known or heard.autopilots.get(system) == ARDUPILOT
    told = (
        _told(in_force, history.last, each[1], len(parameters) - 1)
        if in_force
        else _unknown(heard.autopilots.get(system))
    )
    return Instrument(
        file.name,
        f"{name} (system {system})" if several else name,
        Unit.of("mG"),
        compass.columns,
        stored=None if in_force is None else stored(in_force),
        frames=IN_VEHICLE_AXES if is_ardupilot else ("sensor", "sensor"),
        autopilot="ardupilot" if is_ardupilot else None,
        compass=number if is_ardupilot else None,
        device_id=device_id(history.last, number) if is_ardupilot else None,
        beginning=float(table[0, CLOCK]),
        readings=len(table),
        notes=(*told, "readings were sent in whole mG, cut towards zero"),
        file=file,
    )


def _told(in_force: Parameters, values: dict[str, float], message: int, changes: int) -> Iterator[str]:
    """What to know about a compass whose parameters are in the log."""
    number = COMPASS_MESSAGES[message][1]
    yield mounting_told(in_force, values, number)
    if message == RAW_IMU:
        yield "ArduPilot sends corrected readings in RAW_IMU, too"
    if changes:
        yield f"its parameters changed {counted(changes, 'time')}: each reading has those of its time taken off"
    elif in_force.is_identity:
        yield "no calibration was in force: readings are as they were measured"
    if in_force.motor.any() and in_force.motor_by:
        yield "its motor compensation (COMPASS_MOT) stays on the readings: what it depends on is not in the log"
    if off := unused(values, number):
        yield off


def _unknown(autopilot: int | None) -> Iterator[str]:
    """What to know about a compass whose parameters are not there."""
    if autopilot == ARDUPILOT:
        yield (
            "readings are corrected ones, and the log does not hold the parameters (COMPASS_OFS) to take that off: "
            "fetch them in the ground station while it is logging, or read the vehicle's own log (.bin)"
        )
    else:
        yield "whether readings are raw or corrected is not known for this autopilot: they are as they were sent"


def _notes(heard: _Heard, size: int) -> tuple[str, ...]:
    """What to know about the file."""
    notes = []
    if heard.broken:
        notes.append(f"{counted(heard.broken, 'packet')} with a wrong check sum left out")
    if heard.strays:
        places = counted(heard.gaps, "place")
        notes.append(f"{counted(heard.strays, 'byte')} of {size:,} in {places} belong to no packet: skipped")
    return tuple(notes)


def _position(message: Any) -> Position | None:  # noqa: ANN401 - of a generated class
    """Where a message says that the vehicle is, unless it says nothing."""
    latitude, longitude = 1e-7 * message.lat, 1e-7 * message.lon
    usable = (message.lat or message.lon) and abs(latitude) <= 90 and abs(longitude) <= 180
    return Position(latitude, longitude, 1e-3 * message.alt) if usable else None


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


@contextmanager
def _mapped(file: File) -> Iterator[mmap.mmap]:
    """Have the bytes of a file without reading them in."""
    with ExitStack() as opened:
        try:
            stream = opened.enter_context(file.path.open("rb"))
            content = opened.enter_context(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
        except (OSError, ValueError) as error:
            raise refusal(file.name, error) from None
        yield content
