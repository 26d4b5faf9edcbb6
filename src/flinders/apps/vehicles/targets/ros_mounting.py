"""Mounting of a magnetometer on a robot: a fixed joint of URDF, and a static transform of ROS 2.

Both give the frame of the sensor in its parent's frame: a vector m in the frame of the sensor is R m in the parent's,

    R = R_z(yaw) R_y(pitch) R_x(roll)        ``rpy`` of a joint, in radians about the parent's axes
    R of (qx, qy, qz, qw)                    ``static_transform_publisher``

The parent is the frame of the accelerometer, gyro or attitude used to estimate the rotation.

>>> from flinders.core.calibration import Calibration
>>> from flinders.targets import find
>>> from flinders.targets._mounting import euler
>>> turned = Calibration(euler(0, 0, 90), [10.0, -20.0, 30.0], 50.0, rotation="estimated")
>>> print(*find("urdf").render(turned).text.splitlines()[-6:-2], sep=chr(10))
<joint name="magnetometer_joint" type="fixed">
  <parent link="imu_link"/>
  <child link="magnetometer_link"/>
  <origin xyz="0 0 0" rpy="0 0 1.570796327"/>
>>> str(read_urdf(find("urdf").render(turned).text.encode(), "robot.urdf").axes)
'-y,x,z'

Sources: urdfdom_headers, ``joint.h`` (parent_to_joint_origin_transform, the child's frame is that of the joint) and
``pose.h`` (setFromRPY); tf2_ros, ``static_transform_broadcaster_program.cpp``; geometry_msgs, ``TransformStamped``; REP
103: frames are right-handed, and those of a body have x forward, y left, z up.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from flinders.errors import DocumentError
from flinders.geometry.quaternions import from_matrix, rotate_vectors
from flinders.targets._code_text import name_prefix
from flinders.targets._comments import HASH, MARKUP
from flinders.targets._mounting import angles, euler
from flinders.targets._numbers import decode_text, numbers
from flinders.targets._placement import Placement, mounting_target, to_calibration
from flinders.targets._target import ExportOptions, TargetReader, Written
from flinders.targets.system_mounting import plain

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration

PARENT: Final = "imu_link"
NAME: Final = "magnetometer"
QUATERNION: Final = ("qx", "qy", "qz", "qw")
NOTES: Final = (
    (
        "the parent is the frame of the accelerometer, gyro or attitude used to estimate the rotation: replace "
        f"{PARENT} by its name. Frames of a body have x forward, y left, z up (REP 103); one with z down needs a frame "
        "of its own, such as base_link_frd"
    ),
    "the position of the sensor is unknown: fill in x, y and z in metres",
)


def write_urdf(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write a fixed joint and its link; raises `NotExportable` for a mirrored sensor."""
    placement = _placement(calibration, asked, "a joint of URDF")
    rpy = np.round(np.deg2rad(angles(placement.rotation)), 9) + 0.0
    name = name_prefix(NAME, asked.name)
    body = [
        f'<joint name="{name}_joint" type="fixed">',
        f'  <parent link="{PARENT}"/>',
        f'  <child link="{name}_link"/>',
        f'  <origin xyz="0 0 0" rpy="{" ".join(map(plain, rpy))}"/>',
        "</joint>",
        f'<link name="{name}_link"/>',
    ]
    return placement.write_rotation(euler(*np.rad2deg(rpy)), body, {"rpy": rpy}, notes=NOTES)


def read_urdf(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the joint of a piece of URDF whose name or child names a magnetometer, or its only joint.

    Raises `DocumentError` for another text, or for several such joints.
    """
    text = re.sub(r"<\?xml.*?\?>", "", decode_text(content, source), flags=re.DOTALL)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DocumentError(f"{source}: has a document type declaration (DOCTYPE): need URDF as plain XML")
    try:
        joints = list(ElementTree.fromstring(f"<piece>{text}</piece>").iter("joint"))  # no entities, see above
    except ElementTree.ParseError as error:
        raise DocumentError(f"{source}: {error}: need URDF as plain XML") from None
    named = [joint for joint in joints if "mag" in _names(joint)] if len(joints) > 1 else joints
    if len(named) != 1:
        raise DocumentError(f"{source}: {len(named)} joints of a magnetometer: need one, a fixed joint with its origin")
    origin = named[0].find("origin")
    words = ("0 0 0" if origin is None else origin.get("rpy", "0 0 0")).split()
    if len(words) != 3:
        raise DocumentError(f"{source}: rpy has {len(words)} numbers: need roll, pitch and yaw in radians")
    rpy = numbers(dict(zip(("roll", "pitch", "yaw"), words, strict=True)), ("roll", "pitch", "yaw"), source)
    return to_calibration(euler(*np.rad2deg(rpy)), source, strength=strength)


def _names(joint: ElementTree.Element) -> str:
    """Names of a joint and its child, in lower case."""
    child = joint.find("child")
    return f"{joint.get('name', '')} {'' if child is None else child.get('link', '')}".casefold()


def write_transform(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the command that publishes the transform; raises `NotExportable` for a mirrored sensor."""
    placement = _placement(calibration, asked, "a transform of ROS")
    w, x, y, z = np.round(from_matrix(placement.rotation), 9).tolist()
    quaternion = np.array([x, y, z, w]) + 0.0
    name = name_prefix(NAME, asked.name)
    turned = " ".join(f"--{key} {plain(value)}" for key, value in zip(QUATERNION, quaternion, strict=True))
    body = [
        "ros2 run tf2_ros static_transform_publisher --x 0 --y 0 --z 0 \\",
        f"  {turned} \\",
        f"  --frame-id {PARENT} --child-frame-id {name}_link",
    ]
    return placement.write_rotation(rotation_matrix(quaternion), body, {"quaternion": quaternion}, notes=NOTES)


def read_transform(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read the command, with a quaternion or with roll, pitch and yaw in radians.

    Raises `DocumentError` for another text.
    """
    text = decode_text(content, source)
    if "static_transform_publisher" not in text:
        raise DocumentError(f"{source}: need the command static_transform_publisher with its options")
    given = dict(re.findall(r"--(q[xyzw]|roll|pitch|yaw)[\s=]+(\S+)", text))
    if {"roll", "pitch", "yaw"} & given.keys():
        names: tuple[str, ...] = ("roll", "pitch", "yaw")
        rpy = numbers(dict.fromkeys(names, "0") | given, names, source)
        return to_calibration(euler(*np.rad2deg(rpy)), source, strength=strength)
    quaternion = numbers(dict(zip(QUATERNION, "0001", strict=True)) | given, QUATERNION, source)
    if not 0.99 < float(np.linalg.norm(quaternion)) < 1.01:
        raise DocumentError(f"{source}: the quaternion is {np.linalg.norm(quaternion):.3g} long: need 1")
    return to_calibration(rotation_matrix(quaternion), source, strength=strength)


def rotation_matrix(quaternion: Floats) -> Floats:
    """(3, 3) rotation of a quaternion x, y, z, w.

    >>> rotation_matrix(np.array([0.0, 0.0, 1.0, 0.0])) @ [1.0, 2.0, 3.0]
    array([-1., -2.,  3.])
    """
    return rotate_vectors(np.roll(quaternion / np.linalg.norm(quaternion), 1), np.eye(3)).T


def _placement(calibration: Calibration, asked: ExportOptions, who: str) -> Placement:
    """Return the mounting of the sensor; `NotExportable` if it is mirrored or unknown."""
    placement = Placement.of(calibration, asked, who=who)
    placement.refuse_mirror(who)
    return placement


TARGETS: Final = (
    mounting_target(
        name="urdf",
        use="ROS, fixed joint of URDF",
        suffix=".urdf",
        title="a joint of URDF",
        formula="v = Rz(yaw) Ry(pitch) Rx(roll) m",
        keeps="rotation",
        storage="decimal numbers, radians",
        source="urdfdom_headers, joint.h and pose.h; REP 103",
        comment=MARKUP,
        named=True,
        write=write_urdf,
        reader=TargetReader(rb"<joint\b", read_urdf, "a joint of URDF"),
    ),
    mounting_target(
        name="static-transform",
        use="ROS 2, static transform",
        suffix=".sh",
        title="a static transform of ROS 2",
        formula="v = R(q) m",
        keeps="rotation",
        storage="decimal numbers, a quaternion",
        source="tf2_ros, static_transform_broadcaster_program.cpp; REP 103",
        comment=HASH,
        named=True,
        write=write_transform,
        reader=TargetReader(rb"static_transform_publisher", read_transform, "a static transform of ROS 2"),
    ),
)
