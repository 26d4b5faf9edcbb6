"""A vehicle on MAVLink: who it is, whether it is armed, and its parameters, one by one.

::

    vehicle = Vehicle.find(source)
    vehicle.get("COMPASS_OFS_X")
    vehicle.set(Held("COMPASS_OFS_X", -125.0))

The vehicle's own answer is the proof that a parameter is set.

Whole numbers travel as floats with ArduPilot, which holds them exactly up to 2²⁴ (device ids have 24 bits), and byte by
byte in the place of a float with PX4 (MAVLink's parameter protocol, "parameter encoding"). Signed links are not
supported.
"""

from __future__ import annotations

import struct
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.errors import LinkError, NotSent, UsageError
from flinders.readers._extras import needs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.live.sources import ByteSource

ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT in a vehicle's HEARTBEAT."""
AUTOPILOTS: Final = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
NO_AUTOPILOT: Final = 8
"""MAV_AUTOPILOT_INVALID: a ground station, a gimbal, a companion computer."""
AUTOPILOT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1, the component that is asked where others of the vehicle have heartbeats too."""
ARMED: Final = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
GROUND_STATION: Final = 6
"""MAV_TYPE_GCS, what we say we are."""
OUR_SYSTEM, OUR_COMPONENT = 255, 190

HEARTBEAT_S: Final = 6.0
"""Seconds that a vehicle has to show itself; they do once a second."""
LISTEN_S: Final = 1.5
"""Seconds that further vehicles on the same link are listened for."""
SILENT_S: Final = 5.0
"""Seconds without a heartbeat after which the link is lost."""
ANSWER_S: Final = 0.8
TRIES: Final = 4
BACKLOG: Final = 1000
"""Datagrams that are taken in before anything is set, at most."""
KINDS: Final = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of whole numbers, as `struct` packs them."""
REAL32: Final = 9


@dataclass(frozen=True, slots=True)
class Held:
    """A parameter as a vehicle holds it.

    Attributes
    ----------
    name : str
    value : float
    kind : int
        Its MAV_PARAM_TYPE.
    """

    name: str
    value: float
    kind: int = REAL32


class Vehicle:
    """A vehicle that was heard.

    Attributes
    ----------
    autopilot : int
        `ARDUPILOT` or `PX4`.
    system, component : int
        Its address.
    armed : bool
        As its last heartbeat said.
    """

    def __init__(self, source: ByteSource, *, answer: float = ANSWER_S, silent: float = SILENT_S) -> None:
        self._dialect = needs("pymavlink.dialects.v20.common", "mavlink", "a vehicle on MAVLink")
        self._source, self._answer, self._silent = source, answer, silent
        self._link: Any = self._dialect.MAVLink(source, srcSystem=OUR_SYSTEM, srcComponent=OUR_COMPONENT)
        self._link.robust_parsing = True
        self._is_old = False
        self._beaten = self._seen = 0.0
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
        """Wait for a vehicle.

        Parameters
        ----------
        source : ByteSource
        system : int, optional
            Its MAVLink system number, where there are several.
        wait, listen, answer, silent : float, s
            How long for the first heartbeat, for those of others, for an answer, and until the link counts as lost.

        Raises
        ------
        MissingExtra
            Without pymavlink.
        LinkError
            Where none is heard.
        UsageError
            Where there are several, and nobody said which.
        NotSent
            Where its autopilot is neither ArduPilot nor PX4.
        """
        found = cls(source, answer=answer, silent=silent)
        heard: dict[int, tuple[int, int, bool]] = {}
        until, first = time.monotonic() + wait, None
        while time.monotonic() < (until if first is None else min(first + listen, until + listen)):
            for message in found._arrived():
                if message.get_type() == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT:
                    one = (message.get_srcComponent(), message.autopilot, bool(message.base_mode & ARMED))
                    if one[0] == AUTOPILOT or heard.get(message.get_srcSystem(), one)[0] != AUTOPILOT:
                        heard[message.get_srcSystem()] = one
            if heard and (system is None or system in heard):
                first = time.monotonic() if first is None else first
                if system is not None:
                    break
        found._choose(heard, system)
        return found

    def _choose(self, heard: dict[int, tuple[int, int, bool]], system: int | None) -> None:
        """Settle on one of the vehicles that were heard."""
        there = ", ".join(map(str, sorted(heard)))
        if not heard or (system is not None and system not in heard):
            only = f" of system {system} (there is {there})" if heard else ""
            raise LinkError(
                f"no heartbeat{only} from {self._source.name}: see that the vehicle is on, that it sends MAVLink "
                "there, and that no ground station holds the port"
            )
        if system is None and len(heard) > 1:
            raise UsageError(f"{self._source.name} has several vehicles, systems {there}: say which with --system")
        self.system = sorted(heard)[0] if system is None else system
        self.component, self.autopilot, self.armed = heard[self.system]
        self._seen = time.monotonic()
        if self.autopilot not in AUTOPILOTS:
            raise NotSent(
                f"system {self.system} on {self._source.name} is autopilot {self.autopilot}: parameters are known of "
                "ArduPilot (3) and PX4 (12); write them with flinders export and set them by hand"
            )

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"{AUTOPILOTS.get(self.autopilot, 'vehicle')}, system {self.system}"

    def get(self, name: str) -> Held | None:
        """Ask for a parameter; None where the vehicle has none of this name, or does not answer.

        Raises
        ------
        LinkError
            Where the link is lost.
        """
        for attempt in range(TRIES):
            self._send(self._dialect.MAVLink_param_request_read_message(self.system, self.component, name.encode(), -1))
            for message in self._during(self._patience(attempt)):
                if self._is_about(message, name, "PARAM_VALUE"):
                    return Held(name, self._decoded(message), message.param_type)
                if self._is_about(message, name, "PARAM_ERROR"):
                    return None
        return None

    def set(self, held: Held) -> bool:
        """Set a parameter, and tell whether the vehicle answers with that value.

        Raises
        ------
        LinkError
            Where the link is lost.
        """
        for attempt in range(TRIES):
            encoded = self._encoded(held)
            self._send(
                self._dialect.MAVLink_param_set_message(
                    self.system, self.component, held.name.encode(), encoded, held.kind
                )
            )
            for message in self._during(self._patience(attempt)):
                if self._is_about(message, held.name, "PARAM_VALUE"):
                    if same(self._decoded(message), held.value):
                        return True
                    break  # a late answer to an earlier question, or it keeps its own value: once more
                if self._is_about(message, held.name, "PARAM_ERROR"):
                    return False
        return False

    def _patience(self, attempt: int) -> float:
        """Seconds that an answer is waited for: longer each time, as a slow link needs it."""
        return self._answer * (1 + attempt / 2)

    def listen(self) -> None:
        """Take in what has arrived, so that `armed` is up to date."""
        for _ in range(BACKLOG):
            content = self._source.read(0.0)
            if not content:
                return
            for _ in self._messages(content):
                pass

    def _is_about(self, message: Any, name: str, kind: str) -> bool:  # noqa: ANN401 - pymavlink has no types
        return bool(message.get_type() == kind and message.param_id.rstrip("\0") == name)

    def _decoded(self, message: Any) -> float:  # noqa: ANN401
        if self.autopilot == PX4 and message.param_type in KINDS:
            layout = KINDS[message.param_type]
            return float(struct.unpack_from(layout, struct.pack("<f", message.param_value))[0])
        return float(message.param_value)

    def _encoded(self, held: Held) -> float:
        if self.autopilot == PX4 and held.kind in KINDS:
            content = struct.pack(KINDS[held.kind], int(held.value)).ljust(4, b"\0")
            return float(struct.unpack("<f", content)[0])
        return float(held.value)

    def _send(self, message: Any) -> None:  # noqa: ANN401
        self._link.send(message, force_mavlink1=self._is_old)

    def _during(self, seconds: float) -> Iterator[Any]:
        """Yield the messages of this vehicle for so long.

        Raises
        ------
        LinkError
            Where its heartbeats have ended.
        """
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for message in self._arrived(max(min(0.05, until - time.monotonic()), 0.0)):
                if message.get_srcSystem() == self.system and message.get_srcComponent() == self.component:
                    yield message
            if time.monotonic() - self._seen > self._silent:
                raise LinkError(f"{self.name} on {self._source.name} has been silent for {self._silent:g} s")

    def _arrived(self, timeout: float = 0.05) -> Iterator[Any]:
        """Yield all messages that have arrived, and say once a second that we are here."""
        if time.monotonic() - self._beaten > 1.0:
            self._beaten = time.monotonic()
            self._send(self._dialect.MAVLink_heartbeat_message(GROUND_STATION, NO_AUTOPILOT, 0, 0, 4, 3))
        yield from self._messages(self._source.read(timeout))

    def _messages(self, content: bytes) -> Iterator[Any]:
        """Yield the messages in some bytes, and keep what they say of the vehicle."""
        for message in self._link.parse_buffer(content) or []:
            if message.get_type() == "BAD_DATA":
                continue
            if message.get_srcSystem() == self.system and message.get_srcComponent() == self.component:
                self._seen = time.monotonic()
                if message.get_type() == "HEARTBEAT":
                    self.armed = bool(message.base_mode & ARMED)
            self._is_old = message.get_msgbuf()[0] == 0xFE  # MAVLink 1: answer in kind
            yield message


def same(one: float, other: float) -> bool:
    """Tell whether two values are one float32."""
    return bool(np.float32(one) == np.float32(other))
