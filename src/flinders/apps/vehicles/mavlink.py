"""A vehicle on MAVLink: its identity, whether it is armed, and its parameters, read and set one by one.

::

    vehicle = Vehicle.find(source)
    vehicle.get("COMPASS_OFS_X")
    vehicle.set(Parameter("COMPASS_OFS_X", -125.0))

A parameter counts as set once the vehicle has answered with the new value.

ArduPilot sends whole numbers as floats, exact up to 2²⁴ (device ids have 24 bits); PX4 sends their bytes in place of
the float (MAVLink's parameter protocol, "parameter encoding"). Signed links are not supported.
"""

from __future__ import annotations

import contextlib
import struct
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.apps.vehicles.readers.tlog import (
    A_PX4,
    AN_ARDUPILOT,
    FIRST_VERSION,
    GROUND_STATION,
)
from flinders.errors import LinkError, NotSent, UsageError
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.links.transports import ByteSource

ARDUPILOT, PX4 = AN_ARDUPILOT, A_PX4
AUTOPILOTS: Final = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
NO_AUTOPILOT: Final = 8  # MAV_AUTOPILOT_INVALID: a ground station, a gimbal, a companion computer
AUTOPILOT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1: the component to address if several components of a vehicle send heartbeats."""
SET_MESSAGE_INTERVAL, RAW_SENSORS = 511, 1  # MAV_CMD, and MAV_DATA_STREAM of RAW_IMU and SCALED_IMU
ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
OUR_SYSTEM, OUR_COMPONENT = 255, 190

RATE_HZ: Final = 20.0  # Requested rate of readings
HEARTBEAT_S: Final = 6.0  # Longest wait for the first heartbeat; vehicles send one a second
LISTEN_S: Final = 1.5  # Time to listen for further vehicles on the same link
SILENT_S: Final = 5.0  # Time without a heartbeat after which the link counts as lost
ANSWER_S: Final = 0.8
TRIES: Final = 10
"""Largest number of requests for one answer. With 30 % of packets lost each way, one in a thousand is unanswered."""
MAX_OTHER_ANSWERS: Final = 4  # Number of answers with another value, after which the vehicle keeps that value
REOPEN_S: Final = 0.2  # Time between attempts to reopen a lost link
MAX_BACKLOG: Final = 1000  # Largest number of datagrams to process before a parameter is set
KINDS: Final = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of whole numbers, as `struct` packs them."""
REAL32: Final = 9


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a vehicle: name, value, and `kind`, its MAV_PARAM_TYPE."""

    name: str
    value: float
    kind: int = REAL32


class Vehicle:
    """A vehicle whose heartbeat was received.

    Attributes
    ----------
    name : str
        Name for messages to the user.
    source : ByteSource
    autopilot : int
        `ARDUPILOT` or `PX4`.
    system, component : int
        MAVLink address of the vehicle.
    armed : bool
        Whether the vehicle was armed in its last heartbeat.
    """

    def __init__(self, source: ByteSource, *, answer: float = ANSWER_S, silent: float = SILENT_S) -> None:
        self._dialect = import_optional("pymavlink.dialects.v20.common", "mavlink", "a vehicle on MAVLink")
        self.source, self._answer, self._silent = source, answer, silent
        self._link: Any = self._dialect.MAVLink(source, srcSystem=OUR_SYSTEM, srcComponent=OUR_COMPONENT)
        self._link.robust_parsing = True
        self._is_old = False
        self._heartbeat_sent = self._seen = 0.0
        self.autopilot = self.system = self.component = 0
        self.armed = False

    @classmethod
    def find(
        cls,
        source: ByteSource,
        *,
        system: int | None = None,
        wait: float = HEARTBEAT_S,
        listen: float = LISTEN_S,
        answer: float = ANSWER_S,
        silent: float = SILENT_S,
    ) -> Self:
        """Wait for a vehicle; `system` selects one of several on the link.

        Times are in s: `wait` is the longest wait for the first heartbeat, `listen` the time to listen for further
        vehicles, `answer` the wait for an answer, and `silent` the time without heartbeats after which a link is lost.

        Raises
        ------
        LinkError
            Without a heartbeat.
        UsageError
            For several vehicles without `system`.
        NotSent
            For an autopilot that is neither ArduPilot nor PX4.
        """
        vehicle = cls(source, answer=answer, silent=silent)
        heartbeats: dict[int, Any] = {}
        until, is_first = time.monotonic() + wait, True
        while time.monotonic() < until:
            for message in vehicle._receive():
                _note(heartbeats, message)
            if is_first and heartbeats and system in (None, *heartbeats):
                is_first, until = False, time.monotonic() + listen
            if system in heartbeats and heartbeats[system].get_srcComponent() == AUTOPILOT:
                break
        vehicle._choose(heartbeats, system)
        return vehicle

    def _choose(self, heartbeats: dict[int, Any], system: int | None) -> None:
        """Choose one of the vehicles whose heartbeats were received."""
        systems = ", ".join(map(str, sorted(heartbeats)))
        if not heartbeats or system not in (None, *heartbeats):
            only = f" of system {system} (there is {systems})" if heartbeats else ""
            raise LinkError(
                f"no heartbeat{only} from {self.source.name}: see that the vehicle is on, that it sends MAVLink "
                "there, and that no ground station holds the port"
            )
        if system is None and len(heartbeats) > 1:
            raise UsageError(f"{self.source.name} has several vehicles, systems {systems}: say which with --system")
        self.system = next(iter(heartbeats)) if system is None else system
        beat = heartbeats[self.system]
        self.component, self.autopilot, self.armed = beat.get_srcComponent(), beat.autopilot, _is_armed(beat)
        self._seen = time.monotonic()
        if self.autopilot not in AUTOPILOTS:
            raise NotSent(
                f"system {self.system} on {self.source.name} is autopilot {self.autopilot}: need ArduPilot (3) or "
                "PX4 (12); write the parameters with flinders export and set them by hand"
            )

    @property
    def name(self) -> str:
        """Name for messages."""
        return f"{AUTOPILOTS.get(self.autopilot, 'vehicle')}, system {self.system}"

    def get(self, *names: str, tries: int = TRIES) -> Parameter | None:
        """Request a parameter by the names it may have; None if the vehicle has none of them or does not answer.

        Raises `LinkError` if the link is lost.
        """
        unknown: set[str] = set()
        for attempt in range(tries):
            for name in names:
                self._ask("param_request_read", name.encode(), -1)
            for message in self.messages(self._answer_time(attempt)):
                name = _parameter_name(message, names)
                if name and message.get_type() == "PARAM_VALUE":
                    return Parameter(name, self._decode_value(message), message.param_type)
                if name:
                    unknown.add(name)
                if unknown == set(names):
                    return None
        return None

    def set(self, parameter: Parameter) -> float | None:
        """Set a parameter, and return the value in the vehicle's answer; None without an answer.

        The request is repeated while the vehicle answers with another value, since that may answer an earlier request.
        Raises `LinkError` if the link is lost.
        """
        answered, others = None, 0
        for attempt in range(TRIES):
            self._ask("param_set", parameter.name.encode(), self._encode_value(parameter), parameter.kind)
            for message in self.messages(self._answer_time(attempt)):
                if not _parameter_name(message, (parameter.name,)):
                    continue
                if message.get_type() == "PARAM_ERROR":
                    return answered
                answered, others = self._decode_value(message), others + 1
                if is_same_float32(answered, parameter.value) or others == MAX_OTHER_ANSWERS:
                    return answered
                break
        return answered

    def ask_for(self, message: int) -> None:
        """Request a message at `RATE_HZ`, by MAV_CMD and by the stream request of old ArduPilots; expects no answer."""
        self._ask("command_long", SET_MESSAGE_INTERVAL, 0, message, 1e6 / RATE_HZ, 0, 0, 0, 0, 0)
        self._ask("request_data_stream", RAW_SENSORS, round(RATE_HZ), 1)

    def come_back(self, seconds: float) -> bool:
        """Wait for a vehicle whose link was lost, and return whether its messages arrive again."""
        until, before = time.monotonic() + seconds, self._seen
        while time.monotonic() < until and self._seen == before:
            try:
                for _ in self._receive(0.1):
                    pass
            except LinkError:
                time.sleep(REOPEN_S)
                with contextlib.suppress(LinkError):
                    self.source.reopen()
        return self._seen > before

    def messages(self, seconds: float) -> Iterator[Any]:
        """Yield the messages of this vehicle for some seconds; `LinkError` if its heartbeats have stopped."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for message in self._receive(max(min(0.05, until - time.monotonic()), 0.0)):
                if self._is_from(message):
                    yield message
            if time.monotonic() - self._seen > self._silent:
                raise LinkError(f"{self.name} on {self.source.name} has been silent for {self._silent:g} s")

    def listen(self) -> None:
        """Process the messages that have arrived, so that `armed` is up to date."""
        for _ in range(MAX_BACKLOG):
            content = self.source.read(0.0)
            if not content:
                return
            for _ in self._messages(content):
                pass

    def _ask(self, kind: str, *fields: float | bytes) -> None:
        """Send a message to the address of the vehicle."""
        make = getattr(self._dialect, f"MAVLink_{kind}_message")
        self._send(make(self.system, self.component, *fields))

    def _answer_time(self, attempt: int) -> float:
        """Seconds to wait for an answer: longer in later attempts, for slow links."""
        return self._answer * min(1 + attempt / 2, 2)

    def _decode_value(self, message: Any) -> float:  # noqa: ANN401 - pymavlink has no types
        if self.autopilot == PX4 and message.param_type in KINDS:
            return float(struct.unpack_from(KINDS[message.param_type], struct.pack("<f", message.param_value))[0])
        return float(message.param_value)

    def _encode_value(self, parameter: Parameter) -> float:
        if self.autopilot == PX4 and parameter.kind in KINDS:
            content = struct.pack(KINDS[parameter.kind], int(parameter.value)).ljust(4, b"\0")
            return float(struct.unpack("<f", content)[0])
        return float(parameter.value)

    def _send(self, message: Any) -> None:  # noqa: ANN401
        self._link.send(message, force_mavlink1=self._is_old)

    def _receive(self, timeout: float = 0.05) -> Iterator[Any]:
        """Yield the messages that have arrived, and send a heartbeat once a second."""
        if time.monotonic() - self._heartbeat_sent > 1.0:
            self._heartbeat_sent = time.monotonic()
            self._send(self._dialect.MAVLink_heartbeat_message(GROUND_STATION, NO_AUTOPILOT, 0, 0, 4, 3))
        yield from self._messages(self.source.read(timeout))

    def _messages(self, content: bytes) -> Iterator[Any]:
        """Yield the messages in some bytes, and update the vehicle's state from them."""
        for message in self._link.parse_buffer(content) or []:
            if message.get_type() == "BAD_DATA":
                continue
            if self._is_from(message):
                self._seen = time.monotonic()
                self._is_old = message.get_msgbuf()[0] == FIRST_VERSION  # answer in the vehicle's version
                if message.get_type() == "HEARTBEAT":
                    self.armed = _is_armed(message)
            yield message

    def _is_from(self, message: Any) -> bool:  # noqa: ANN401
        return bool((message.get_srcSystem(), message.get_srcComponent()) == (self.system, self.component))


def _is_armed(heartbeat: Any) -> bool:  # noqa: ANN401
    return bool(heartbeat.base_mode & ARMED)


def _note(heartbeats: dict[int, Any], message: Any) -> None:  # noqa: ANN401
    """Store an autopilot's heartbeat under its system id; one from the component `AUTOPILOT` replaces any other."""
    if message.get_type() != "HEARTBEAT" or message.autopilot == NO_AUTOPILOT or message.type == GROUND_STATION:
        return
    before = heartbeats.get(message.get_srcSystem(), message)
    if message.get_srcComponent() == AUTOPILOT or before.get_srcComponent() != AUTOPILOT:
        heartbeats[message.get_srcSystem()] = message


def _parameter_name(message: Any, names: Sequence[str]) -> str:  # noqa: ANN401
    """Name of the parameter in a message if it is one of `names`, else empty."""
    if message.get_type() not in ("PARAM_VALUE", "PARAM_ERROR"):
        return ""
    name = str(message.param_id).rstrip("\0")
    return name if name in names else ""


def is_same_float32(one: float, other: float) -> bool:
    """Whether two values are the same float32; two NaN are the same."""
    return bool(np.array_equal(np.float32(one), np.float32(other), equal_nan=True))
