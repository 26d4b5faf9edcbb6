"""The ROS 2 package that is written: what it holds; and its node, run with a **stub of rclpy** and of its messages.

The stub has the calls that the node makes, as rclpy has them, and no middleware: that the node runs in ROS is not
tested here.
"""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar
from xml.etree import ElementTree

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences

from flinders import simulate
from flinders.apps.vehicles.ros2.corrected import corrected_field
from flinders.apps.vehicles.ros2.node_package import VERSION, contents
from flinders.core.calibration_file import loads
from flinders.fitting.fit_file import fit_from

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Message(SimpleNamespace):
    """A message with fields that are made when they are asked for, as those of rclpy have defaults."""

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401
        if name.startswith("__"):
            raise AttributeError(name)
        setattr(self, name, Message())
        return getattr(self, name)


class Publisher:
    def __init__(self, topic: str) -> None:
        self.topic, self.sent = topic, list[Any]()

    def publish(self, message: Any) -> None:  # noqa: ANN401
        self.sent.append(message)


class Node:
    """What `rclpy.node.Node` has, as far as the node uses it."""

    parameters: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name, self.publishers, self.said = name, dict[str, Publisher](), list[str]()

    def declare_parameter(self, name: str, default: object) -> SimpleNamespace:
        return SimpleNamespace(value=self.parameters.get(name, default))

    def create_publisher(self, _kind: type, topic: str, _qos: object) -> Publisher:
        self.publishers[topic] = Publisher(topic)
        return self.publishers[topic]

    def create_subscription(self, _kind: type, topic: str, take: Callable[[Any], None], _qos: object) -> None:
        self.subscribed, self.receive = topic, take

    def create_timer(self, _seconds: float, _call: Callable[[], None]) -> None:
        pass

    def get_clock(self) -> Any:  # noqa: ANN401
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=5, to_msg=lambda: "now"))

    def get_logger(self) -> Any:  # noqa: ANN401
        return SimpleNamespace(info=self.said.append)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "flinders_ros"
    ended = flinders_("ros-package", "-o", str(folder), "--json")
    assert (ended.code, len(ended.json["files"])) == (0, len(contents()))
    return folder


@pytest.fixture
def node_module(package: Path, monkeypatch: pytest.MonkeyPatch) -> Any:  # noqa: ANN401
    """The module of the node, with stubs in place of ROS."""
    policies = SimpleNamespace(TRANSIENT_LOCAL=1, RELIABLE=1)
    qos = {"QoSProfile": dict, "DurabilityPolicy": policies, "ReliabilityPolicy": policies}
    stubs: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {**qos, "qos_profile_sensor_data": None},
        "sensor_msgs.msg": {"MagneticField": Message},
        "std_msgs.msg": {"String": Message},
        "diagnostic_msgs.msg": dict.fromkeys(("DiagnosticArray", "DiagnosticStatus", "KeyValue"), Message),
    }
    for name, content in stubs.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("flinders_ros_node", package / "flinders_ros" / "node.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_package_is_one_that_colcon_builds(package: Path) -> None:
    root = ElementTree.parse(package / "package.xml").getroot()
    assert (root.findtext("name"), root.findtext("version")) == ("flinders_ros", VERSION)
    assert root.findtext("export/build_type") == "ament_python"
    assert (package / "resource" / "flinders_ros").read_text(encoding="utf-8") == ""
    for path in package.rglob("*.py"):
        compile(path.read_text(encoding="utf-8"), str(path), "exec")
    setup = (package / "setup.py").read_text(encoding="utf-8")
    assert f'version="{VERSION}"' in setup
    assert "flinders_ros.node:main" in setup
    assert flinders_("ros-package", "-o", str(package)).code == 6


def test_the_node_publishes_what_the_library_knows(
    node_module: Any,  # noqa: ANN401
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = tmp_path / "compass.state"
    monkeypatch.setattr(Node, "parameters", {"topic": "/mag", "state": str(state), "target_deg": 2.0})
    node = node_module.Calibrator()
    tumble = simulate.tumble(seed=1, n=1000).samples
    assert tumble.time is not None
    for at, (x, y, z) in zip(tumble.time.tolist(), (1e-6 * tumble.field).tolist(), strict=True):
        stamp = Message(sec=1_790_000_000 + int(at), nanosec=round(at % 1 * 1e9))
        header = Message(stamp=stamp, frame_id="mag")
        node.receive(Message(header=header, magnetic_field=Message(x=x, y=y, z=z)))
    topics = ("/imu/mag_corrected", "/diagnostics", "/imu/mag_corrected/calibration")
    corrected, status, calibration = (node.publishers[topic].sent for topic in topics)
    assert node.subscribed == "/mag"
    assert_sentences(node.said[0])
    last = fit_from(loads(calibration[-1].data))
    expected = corrected_field(last, tumble.field[-1:])
    vector = corrected[-1].magnetic_field
    npt.assert_allclose([vector.x, vector.y, vector.z], expected.field[0], rtol=1e-9)
    assert len(corrected[-1].magnetic_field_covariance) == 9
    assert (np.diag(np.reshape(corrected[-1].magnetic_field_covariance, (3, 3))) > 0.0).all()
    assert corrected[-1].header.frame_id == "mag"
    assert (status[0].status[0].level, status[-1].status[0].level) == (bytes([2]), bytes([0]))
    values = {each.key: each.value for each in status[-1].status[0].values}
    assert (values["verdict"], float(values["target_deg"])) == ("good", 2.0)
    node.save()
    again = node_module.Calibrator()
    assert again.online.state.verdict == "good"
