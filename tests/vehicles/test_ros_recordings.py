"""Recordings of ROS: bags, folders and topics; and real logs, which can be opened."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner, Result
from tests.samples import write_ros
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.arrays import Floats
from flinders.cli import main
from flinders.errors import UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats


ROWS = 300


@pytest.fixture(scope="module")
def tumble() -> Floats:
    """(N, 7): time in s, field in mG, acceleration."""
    samples = simulate.tumble(seed=3).samples[:ROWS]
    acceleration = np.random.default_rng(3).normal(size=(ROWS, 3))
    return np.column_stack([np.arange(ROWS) / 50.0, 10.0 * samples.field, acceleration])


def test_a_bag_is_in_tesla_unless_its_driver_wrote_another_unit(tmp_path: Path, tumble: Floats) -> None:
    bag = tmp_path / "walk.bag"
    write_ros(bag, tumble)
    np.testing.assert_allclose(flinders.read(bag).field, tumble[:, 1:4] / 10.0, rtol=1e-9)
    assert flinders.open_recording(bag, unit="G").unit.name == "G"


def test_a_recording_of_ros_2_is_a_folder(tmp_path: Path, tumble: Floats) -> None:
    """Its files belong together: the folder is the recording, and its description is what a calibration knows it by."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    field = types["sensor_msgs/msg/MagneticField"]
    folder = tmp_path / "walk"
    with Writer(folder, version=9) as bag:
        topic = bag.add_connection("/imu/mag", field.__msgtype__, typestore=store)
        for time, *axes in tumble[:, :4].tolist():
            when = round(1e9 * time) + 1_600_000_000_000_000_000
            stamp = types["builtin_interfaces/msg/Time"](*divmod(when, 1_000_000_000))
            vector = types["geometry_msgs/msg/Vector3"](*(1e-7 * axis for axis in axes))
            head = types["std_msgs/msg/Header"](stamp=stamp, frame_id="imu")
            message = field(header=head, magnetic_field=vector, magnetic_field_covariance=np.zeros(9))
            bag.write(topic, when, store.serialize_cdr(message, field.__msgtype__))
    for path in (folder, folder / "metadata.yaml", next(folder.glob("*.db3"))):
        np.testing.assert_allclose(flinders.read(path).field, tumble[:, 1:4] / 10.0, rtol=1e-9)
    saved = tmp_path / "calibration.json"
    ended = CliRunner().invoke(main, ["calibrate", str(folder), "-o", str(saved)])
    assert ended.exit_code in {0, 3}, ended.output
    (file,) = json.loads(saved.read_text())["provenance"]["files"]
    assert file["name"] == "walk"
    assert file["rows"] == ROWS
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {")
    with assert_raises(UnreadableInput):
        flinders.read(folder)


def test_every_real_log_can_be_opened(recordings: Callable[[str], Path]) -> None:
    logs = ("dronekit_log171_3mags/log171.bin", "px4_pyulog_cubeorange/sample_log_small.ulg")
    for name in (*logs, "ros1_imu_tools_bags/phidgets_imu_upside_down.bag"):
        log = flinders.open_log(recordings(name))
        assert log.instruments
        assert all(len(block) for block in log.instruments[0].blocks())


def run(line: str, code: int = 0, stdin: bytes | None = None) -> Result:
    ended = CliRunner().invoke(main, line.split(), input=stdin)
    assert ended.exit_code == code, ended.output
    return ended


def test_a_topic_and_all_sensors_of_a_bag_contradict_each_other(recordings: Callable[[str], Path]) -> None:
    pytest.importorskip("rosbags")
    bag = recordings("ros1_imu_tools_bags/phidgets_imu_upside_down.bag")
    ended = run(f"calibrate {bag} --sensor all --topic /imu/mag", code=2)
    assert_sentences(ended.stderr)
