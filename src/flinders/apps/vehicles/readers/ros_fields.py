"""Numbers in any message of a ROS recording, by topic and path of a field.

Examples: ``/battery.current`` is ``current`` of a ``sensor_msgs/BatteryState``, ``/odom.twist.twist.linear.x`` the
speed of a ``nav_msgs/Odometry``, and ``/servos.data[2]`` the third of several numbers. A joint of a
``sensor_msgs/JointState`` has a name: ``/joint_states.wheel_left.velocity``, likewise ``position`` and ``effort``.
Names of joints may have points, names of topics have none. A joint's name takes precedence over a path.

Times are those of the headers, else of recording, as for magnetometers.

>>> from types import SimpleNamespace as Message
>>> joints = Message(name=["arm.lift", "wheel"], velocity=[0.5, 20.0], position=[], effort=[])
>>> number(joints, "wheel.velocity"), number(joints, "arm.lift.velocity"), number(joints, "wheel.effort")
(20.0, 0.5, None)
>>> number(Message(twist=Message(linear=Message(x=1.5)), cells=[3.6, 3.7]), "twist.linear.x")
1.5
"""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.readers._resample import TimeSeries

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

OF_A_JOINT: Final = ("position", "velocity", "effort")
"""Lists of ``sensor_msgs/JointState`` with a number for each joint; each list may be empty."""
STEP: Final = re.compile(r"([A-Za-z]\w*)(?:\[(\d+)\])?", re.ASCII)
"""Pattern of one step of a path: a field, and the index in a list."""
MAX_LISTED_FIELDS: Final = 200
"""Largest number of fields that an error lists."""


@dataclass(slots=True, eq=False)
class Fields:
    """Wanted fields, collected message by message."""

    source: str
    is_first: bool  # messages are those of ROS 1
    decoder: Callable[[Any], Callable[[bytes, str], Any]]  # of a connection
    paths: dict[str, tuple[str, str]]  # topic and path, by the wanted name
    is_undefined: bool = False
    there: list[str] = field(default_factory=list)  # names of all fields of the wanted topics
    stamps: dict[str, array[int]] = field(default_factory=dict)  # times in ns, by name
    values: dict[str, array[float]] = field(default_factory=dict)
    _decoders: dict[int, Callable[[bytes, str], Any]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, source: str, names: Sequence[str], decoder: Callable[[Any], Callable[[bytes, str], Any]], *, is_first: bool
    ) -> Fields:
        """Return a collector of the fields with some names."""
        split = {name: name.partition(".") for name in names}
        paths = {name: (topic, path) for name, (topic, _, path) in split.items() if path}
        return cls(source, is_first, decoder, paths)

    def is_wanted(self, connection: Any) -> bool:  # noqa: ANN401 - rosbags' types are its own
        """Whether a topic has one of the wanted fields."""
        return any(connection.topic == topic for topic, _ in self.paths.values())

    def add(self, connection: Any, recorded: int, packed: bytes) -> None:  # noqa: ANN401
        """Add a message; `recorded` is the time of recording, ns."""
        if connection.id not in self._decoders:
            self._decoders[connection.id] = self.decoder(connection)
        message = self._decoders[connection.id](packed, connection.msgtype)
        if connection.topic not in self._topics_seen():
            self.there += [f"{connection.topic}.{path}" for path in paths_of(message)]
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        at = 0 if stamp is None else stamp.sec * 10**9 + stamp.nanosec
        for name, (topic, path) in self.paths.items():
            value = number(message, path) if topic == connection.topic else None
            if value is not None:
                self.stamps.setdefault(name, array("q")).append(at or recorded)
                self.values.setdefault(name, array("d")).append(value)

    def _topics_seen(self) -> set[str]:
        return {each.partition(".")[0] for each in self.there}

    def series(self, since: int) -> dict[str, TimeSeries]:
        """Series by name, with times in s since a stamp in ns."""
        made = {
            name: TimeSeries.of(
                (np.asarray(stamps, np.int64) - since) * 1e-9,
                np.asarray(self.values[name], np.float64)[:, np.newaxis],
            )
            for name, stamps in self.stamps.items()
        }
        return {name: series for name, series in made.items() if series is not None}


def number(message: Any, path: str) -> float | None:  # noqa: ANN401
    """Number at a path of a message, or at the name of a joint; None without one."""
    joint, _, what = path.rpartition(".")
    names = getattr(message, "name", None)
    if what in OF_A_JOINT and isinstance(names, list) and joint in names:
        values, place = getattr(message, what), names.index(joint)
        return float(values[place]) if place < len(values) else None
    at: Any = message
    for step in path.split("."):
        match = STEP.fullmatch(step)
        at = getattr(at, match[1], None) if match else None
        if match and match[2] is not None:
            at = at[int(match[2])] if hasattr(at, "__len__") and int(match[2]) < len(at) else None
    return float(at) if isinstance(at, int | float | np.number | np.bool_) else None


def paths_of(message: Any, before: str = "") -> list[str]:  # noqa: ANN401
    """Paths of the numbers of a message, at most `MAX_LISTED_FIELDS`; of a list, the path of its first member.

    >>> from types import SimpleNamespace as Message
    >>> paths_of(Message(current=1.0, cells=[3.6, 3.7], pose=Message(x=0.0), name="pack"))
    ['current', 'cells[0]', 'pose.x']
    """
    return list(_paths(message, before))[:MAX_LISTED_FIELDS]


def _paths(message: Any, before: str) -> Iterator[str]:  # noqa: ANN401
    names = getattr(message, "name", None)
    if isinstance(names, list) and names and isinstance(names[0], str):
        yield from (
            f"{before}{joint}.{what}" for joint in names for what in OF_A_JOINT if len(getattr(message, what, ()))
        )
        return
    for part, value in vars(message).items():
        if part in ("header", "__msgtype__"):
            continue
        if isinstance(value, int | float | np.number | np.bool_):
            yield f"{before}{part}"
        elif hasattr(value, "__dict__"):
            yield from _paths(value, f"{before}{part}.")
        elif hasattr(value, "__len__") and len(value) and isinstance(value[0], int | float | np.number):
            yield f"{before}{part}[0]"
