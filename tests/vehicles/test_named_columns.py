"""Columns of logs by the names they have there: fields of messages, at the times of the readings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders import simulate
from flinders.errors import InputError
from flinders.readers import open_log

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rosbags.rosbag2 import Writer
    from rosbags.typesys.store import Msg

    from flinders.core.samples import Samples

BEGIN = 1_600_000_000_000_000_000
WHEEL = simulate.NamedColumn("wheel", [0.3, 0.0, -0.4], highest=20.0)


def bag_of(path: Path, tumble: Samples) -> None:
    """A recording of ROS 2 whose wheel makes a field, with a battery, an odometry and the speeds of joints."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types

    def head(when: int) -> Msg:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(when, 1_000_000_000))
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu")

    def three(x: float, y: float = 0.0, z: float = 0.0) -> Msg:
        return types["geometry_msgs/msg/Vector3"](x, y, z)

    def written(bag: Writer, topic: str, kind: str) -> Callable[..., None]:
        connection = bag.add_connection(topic, kind, typestore=store)

        def write(when: int, **fields: Any) -> None:
            message = types[kind](header=head(when), **fields)
            bag.write(connection, when, store.serialize_cdr(message, kind))

        return write

    assert tumble.time is not None
    speeds = tumble.auxiliary["wheel"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        field = written(bag, "/mag", "sensor_msgs/msg/MagneticField")
        joints = written(bag, "/joint_states", "sensor_msgs/msg/JointState")
        battery = written(bag, "/battery", "sensor_msgs/msg/BatteryState")
        odometry = written(bag, "/odom", "nav_msgs/msg/Odometry")
        pose = types["geometry_msgs/msg/PoseWithCovariance"](
            types["geometry_msgs/msg/Pose"](
                types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            ),
            np.zeros(36),
        )
        for time, axes, speed in zip(tumble.time.tolist(), tumble.field.tolist(), speeds.tolist(), strict=True):
            when = BEGIN + round(1e9 * time)
            field(when, magnetic_field=three(*(1e-6 * axis for axis in axes)), magnetic_field_covariance=np.zeros(9))
            joints(
                when,
                name=["arm", "wheel_left"],
                position=np.zeros(2),
                velocity=np.array([0.0, speed]),
                effort=np.array([]),
            )
            twist = types["geometry_msgs/msg/Twist"](three(0.1 * speed), three(0.0))
            odometry(
                when,
                child_frame_id="base",
                pose=pose,
                twist=types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            )
            numbers = dict.fromkeys(("charge", "capacity", "design_capacity", "percentage", "temperature"), 0.0)
            battery(
                when,
                voltage=12.0,
                current=-speed,
                **numbers,
                power_supply_status=1,
                power_supply_health=1,
                power_supply_technology=1,
                present=True,
                cell_voltage=np.array([3.7, 3.8], np.float32),
                cell_temperature=np.array([], np.float32),
                location="",
                serial_number="",
            )


def test_fields_of_topics_are_columns(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    tumble = simulate.tumble(seed=4, n=100, disturbances=[WHEEL]).samples
    bag_of(tmp_path / "rover", tumble)
    factors = {"/joint_states.wheel_left.velocity": 1.0, "/odom.twist.twist.linear.x": 0.1, "/battery.current": -1.0}
    read = flinders.read(tmp_path / "rover", auxiliary=list(factors))
    for name, factor in factors.items():
        np.testing.assert_allclose(read.auxiliary[name], factor * tumble.auxiliary["wheel"], rtol=1e-6)
    with pytest.raises(InputError, match=r"wheel_left\.velocity"):
        flinders.read(tmp_path / "rover", auxiliary=["/joint_states.wheel_right.velocity"])


def test_fields_of_messages_of_a_flight_log_are_columns(recordings: Callable[[str], Path]) -> None:
    """The current of the battery is the column that is always read, by its own name."""
    path = recordings("dronekit_log171_3mags/log171.bin")
    block = next(open_log(path).instruments[0].with_auxiliary(["CURR.Curr", "CTUN.ThrOut"]).blocks())
    known = np.isfinite(block.auxiliary["CURR.Curr"])
    assert block.current is not None
    np.testing.assert_allclose(0.01 * block.auxiliary["CURR.Curr"][known], block.current[known], rtol=1e-6)  # whole cA
    with pytest.raises(InputError, match=r"CURR\.Volt"):
        flinders.read(path, auxiliary=["CURR.Current"])


@pytest.mark.parametrize("name", ["BAT.Curr", "batt", "throtle", "MAGX"])
def test_a_name_that_no_message_has_is_answered_with_those_of_the_log(
    recordings: Callable[[str], Path], name: str
) -> None:
    """The log has its current in CURR, as older firmware writes it."""
    with assert_raises(InputError):
        flinders.read(recordings("dronekit_log171_3mags/log171.bin"), auxiliary=[name])


def test_a_name_without_a_topic_is_answered_with_the_form_of_a_name(recordings: Callable[[str], Path]) -> None:
    pytest.importorskip("pyulog")
    with assert_raises(InputError):
        flinders.read(recordings("px4_pyulog_cubeorange/sample_log_small.ulg"), auxiliary=["batt"])


def test_fields_of_topics_of_px4_are_columns(recordings: Callable[[str], Path]) -> None:
    pytest.importorskip("pyulog")
    path = recordings("px4_pyulog_cubeorange/sample_log_small.ulg")
    name = "vehicle_attitude.q[0]"
    samples = flinders.read(path, auxiliary=[name])
    assert samples.attitude is not None
    there = np.isfinite(samples.auxiliary[name])
    assert there.any()
    with pytest.raises(InputError, match=r"vehicle_attitude\.q"):
        flinders.read(path, auxiliary=["vehicle_attitude.w"])
