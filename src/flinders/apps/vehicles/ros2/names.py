"""Names of ROS 2 on the wire: a topic ``/imu/mag`` is ``rt/imu/mag``, its type ``sensor_msgs::msg::dds_::…_``.

>>> dds_topic("imu/mag"), ros_topic("rt/imu/mag"), ros_topic("DCPSTopic")
('rt/imu/mag', '/imu/mag', None)
>>> dds_type("sensor_msgs/msg/Imu"), ros_type("sensor_msgs::msg::dds_::Imu_")
('sensor_msgs::msg::dds_::Imu_', 'sensor_msgs/msg/Imu')

Sources: ros2/rmw_cyclonedds, ``namespace_prefix.hpp`` (rt), ``make_fqtopic`` of ``rmw_node.cpp``, ``type_name.cpp``.
"""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING, Final

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

PREFIX: Final = "rt"
DOMAIN: Final = "ROS_DOMAIN_ID"
MAX_DOMAIN: Final = 232
"""Largest domain: beyond it, DDS ports 7400 + 250 · domain are above 65535."""
TOPIC: Final = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
TYPE: Final = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_")
MAGNETIC_FIELD: Final = "sensor_msgs/msg/MagneticField"
IMU: Final = "sensor_msgs/msg/Imu"


def full_name(topic: str) -> str:
    """Name of a topic from the root; `UsageError` for an invalid name.

    >>> full_name("imu/mag")
    '/imu/mag'
    """
    name = topic if topic.startswith("/") else f"/{topic}"
    if not TOPIC.fullmatch(name):
        raise UsageError(
            f"{topic!r} is no name of a ROS 2 topic: letters, digits and _ between slashes, as in /imu/mag, and no "
            "part begins with a digit"
        )
    return name


def dds_topic(topic: str) -> str:
    """Name of a topic on the wire; raises the errors of `full_name`."""
    return PREFIX + full_name(topic)


def ros_topic(name: str) -> str | None:
    """Topic of ROS 2 for a name on the wire; None for a name that is not a topic of ROS 2."""
    return name.removeprefix(PREFIX) if name.startswith(f"{PREFIX}/") else None


def dds_type(kind: str) -> str:
    """Name of a type ``package/msg/Name`` on the wire."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def ros_type(name: str) -> str:
    """Type of ROS 2 for a name on the wire; the name itself for other types."""
    match = TYPE.fullmatch(name)
    return "/".join(match.groups()) if match else name


def domain_id(environment: Mapping[str, str] = os.environ) -> int:
    """Domain in ``ROS_DOMAIN_ID``, by default 0; `UsageError` unless it is a number from 0 to 232.

    >>> domain_id({"ROS_DOMAIN_ID": "7"}), domain_id({})
    (7, 0)
    """
    text = environment.get(DOMAIN, "").strip() or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_DOMAIN):
        raise UsageError(f"{DOMAIN} is {text!r}: need the publisher's number, from 0 to {MAX_DOMAIN}")
    return int(text)
