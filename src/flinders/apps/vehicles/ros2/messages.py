"""Messages of ROS 2 as types of Cyclone DDS; importing this needs `cyclonedds`.

Fields and their order are those of ``*.msg`` of common_interfaces and rcl_interfaces. Types are final, and written as
CDR version 1, which is all that the middleware of ROS 2 reads (eclipse-cyclonedds/cyclonedds, issue 1412).
Cyclone DDS evaluates annotations when a class is made, so this module has no ``from __future__ import annotations``.

>>> MagneticField_().magnetic_field_covariance[:2], MagneticField_.__idl_typename__
([0.0, 0.0], 'sensor_msgs.msg.dds_.MagneticField_')
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, byte, float64, int32, sequence, uint32

if TYPE_CHECKING:  # mypy cannot resolve the types of Cyclone DDS
    Nine = list[float]
else:
    Nine = array[float64, 9]


def _nine() -> list[float]:
    return [0.0] * 9


@dataclass
@final
@autoid("sequential")
class Time_(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):  # noqa: N801 - names of the wire
    """Message ``builtin_interfaces/Time``."""

    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
@final
@autoid("sequential")
class Header_(IdlStruct, typename="std_msgs.msg.dds_.Header_"):  # noqa: N801
    """Message ``std_msgs/Header``."""

    stamp: Time_ = field(default_factory=Time_)
    frame_id: str = ""


@dataclass
@final
@autoid("sequential")
class Vector3_(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):  # noqa: N801
    """Message ``geometry_msgs/Vector3``."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@final
@autoid("sequential")
class Quaternion_(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):  # noqa: N801
    """Message ``geometry_msgs/Quaternion``."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
@final
@autoid("sequential")
class MagneticField_(IdlStruct, typename="sensor_msgs.msg.dds_.MagneticField_"):  # noqa: N801
    """Message ``sensor_msgs/MagneticField``, in tesla."""

    header: Header_ = field(default_factory=Header_)
    magnetic_field: Vector3_ = field(default_factory=Vector3_)
    magnetic_field_covariance: Nine = field(default_factory=_nine)


@dataclass
@final
@autoid("sequential")
class Imu_(IdlStruct, typename="sensor_msgs.msg.dds_.Imu_"):  # noqa: N801
    """Message ``sensor_msgs/Imu``, in rad/s and m/s²."""

    header: Header_ = field(default_factory=Header_)
    orientation: Quaternion_ = field(default_factory=Quaternion_)
    orientation_covariance: Nine = field(default_factory=_nine)
    angular_velocity: Vector3_ = field(default_factory=Vector3_)
    angular_velocity_covariance: Nine = field(default_factory=_nine)
    linear_acceleration: Vector3_ = field(default_factory=Vector3_)
    linear_acceleration_covariance: Nine = field(default_factory=_nine)


@dataclass
@final
@autoid("sequential")
class KeyValue_(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):  # noqa: N801
    """Message ``diagnostic_msgs/KeyValue``."""

    key: str = ""
    value: str = ""


if TYPE_CHECKING:
    KeyValues = list[KeyValue_]
else:
    KeyValues = sequence[KeyValue_]


@dataclass
@final
@autoid("sequential")
class DiagnosticStatus_(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):  # noqa: N801
    """Message ``diagnostic_msgs/DiagnosticStatus``."""

    level: byte = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: KeyValues = field(default_factory=list)


if TYPE_CHECKING:
    Statuses = list[DiagnosticStatus_]
else:
    Statuses = sequence[DiagnosticStatus_]


@dataclass
@final
@autoid("sequential")
class DiagnosticArray_(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):  # noqa: N801
    """Message ``diagnostic_msgs/DiagnosticArray``."""

    header: Header_ = field(default_factory=Header_)
    status: Statuses = field(default_factory=list)


@dataclass
@final
@autoid("sequential")
class String_(IdlStruct, typename="std_msgs.msg.dds_.String_"):  # noqa: N801
    """Message ``std_msgs/String``."""

    data: str = ""


TYPE_HASHES: Final[dict[type[IdlStruct], str]] = {
    MagneticField_: "RIHS01_e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff",
    DiagnosticArray_: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    String_: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
}
"""Hash of each published type (REP-2016), shown by `ros2 topic info -v`."""
