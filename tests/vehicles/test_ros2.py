"""Topics of ROS 2 over DDS: a publisher in another process, on the loopback interface, in a domain of its own."""

# ruff: noqa: ANN401 - messages and readers of Cyclone DDS have no types
from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.waiting import wait_until

import flinders
from flinders import Samples, simulate
from flinders.apps.vehicles.ros2 import feed as feeds
from flinders.apps.vehicles.ros2.corrected import corrected_field
from flinders.apps.vehicles.ros2.names import domain_id, full_name
from flinders.core.calibration_file import loads
from flinders.errors import LinkError, MissingExtra, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.measurement_noise import field_covariance
from flinders.links.feeds import FeedEvent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.apps.vehicles.ros2.feed import TopicFeed
    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

pytest.importorskip("cyclonedds")
ROOT: Final = Path(__file__).parents[2]
NETWORK: Final = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo'/></Interfaces></General>"
    "<Discovery><LeaseDuration>1s</LeaseDuration></Discovery></Domain></CycloneDDS>"
)
START_NS: Final = 1_790_000_000_123_456_789
MAG: Final = "/imu/mag"


WORKERS: Final = 16
DOMAINS: Final = iter(range(230 // WORKERS))


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, worker_id: str) -> int:
    """A domain that no test had, and whose first ports nobody has, on the loopback interface."""
    worker = 0 if worker_id == "master" else 1 + int(worker_id.removeprefix("gw")) % (WORKERS - 1)
    for row in DOMAINS:
        number = 1 + worker + WORKERS * row
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", 7410 + 250 * number))
            except OSError:
                continue
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("CYCLONEDDS_URI", NETWORK)
        return number
    pytest.skip("no domain is free")


class Driver:
    """A publisher in another process."""

    def __init__(self, domain: int) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.vehicles.ros2_publisher", str(domain)],
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.told = 0

    def tell(self, do: str, **how: Any) -> None:
        """Have something done, and do not wait for it."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": do, **how}) + "\n")
        self.process.stdin.flush()
        self.told += 1

    def do(self, do: str, **how: Any) -> None:
        """Have something done."""
        self.tell(do, **how)
        self.wait()

    def wait(self) -> None:
        """Wait until all is done."""
        assert self.process.stdout is not None
        while self.told:
            assert self.process.stdout.readline(), "the publisher has ended"
            self.told -= 1

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


@pytest.fixture
def driver(domain: int) -> Iterator[Driver]:
    driver = Driver(domain)
    try:
        driver.do("publish", topic=MAG)
        yield driver
    finally:
        driver.end()


def readings(n: int) -> Floats:
    """(N, 3) µT with three decimals, as a sensor gives them."""
    field: Floats = np.round(simulate.tumble(seed=1, n=n).samples.field, 3)
    return field


def in_tesla(field: Floats) -> list[list[float]]:
    rows: list[list[float]] = (1e-6 * field).tolist()
    return rows


def take(feed: TopicFeed, until: Callable[[list[Samples], list[FeedEvent]], bool]) -> tuple[list[Samples], list[Any]]:
    """Ask a feed until something is so."""
    samples: list[Samples] = []
    events: list[FeedEvent] = []

    def is_so() -> bool:
        received = feed.next(0.05)
        if isinstance(received, FeedEvent):
            events.append(received)
        elif received is not None:
            samples.append(received)
        return until(samples, events)

    wait_until(is_so, lambda: (events, sum(map(len, samples))))
    return samples, events


def kinds(events: list[FeedEvent]) -> list[str]:
    return [event.kind for event in events]


def record(driver: Driver, path: Path, n: int, rate_hz: float) -> None:
    field = readings(n)
    driver.tell("send", topic=MAG, rows=in_tesla(field), rate_hz=rate_hz, start_ns=START_NS)
    ended = flinders_("record", "--ros2", MAG, "--readings", str(n), "-o", str(path), "--json")
    assert (ended.code, ended.json["readings"], ended.json["disconnections"]) == (0, n, 0), ended.err
    samples = flinders.read(path)
    npt.assert_array_equal(samples.field, field)
    assert samples.time is not None
    npt.assert_allclose(samples.time, np.arange(n) / rate_hz, rtol=0.0, atol=1e-6)
    assert "lost" not in path.read_text(encoding="utf-8")


def test_a_recording_has_every_reading_of_a_topic_with_its_time(driver: Driver, tmp_path: Path) -> None:
    record(driver, tmp_path / "tumble.csv", 200, 400.0)


@pytest.mark.nightly
def test_a_minute_at_100_hz_loses_nothing(driver: Driver, tmp_path: Path) -> None:
    record(driver, tmp_path / "tumble.csv", 6000, 100.0)


def test_an_imu_of_the_same_frame_stands_beside_the_readings(driver: Driver, tmp_path: Path) -> None:
    driver.do("publish", topic="/imu/data", kind="Imu_")
    opened = feeds.open_feed(MAG, "imu/data")
    motions = np.column_stack([readings(40), 0.01 * readings(40)])
    driver.do("send", topic="/imu/data", rows=motions.tolist(), rate_hz=1000.0, start_ns=START_NS)
    driver.do("send", topic=MAG, rows=in_tesla(readings(40)), rate_hz=1000.0, start_ns=START_NS)
    samples, events = take(opened, lambda samples, _: sum(map(len, samples)) == 40)
    npt.assert_array_equal(np.concatenate([each.acceleration for each in samples]), motions[:, :3])
    npt.assert_array_equal(np.concatenate([each.rate for each in samples]), motions[:, 3:])
    assert kinds(events) == ["connected"]
    driver.do(
        "send", topic="/imu/data", rows=motions.tolist(), rate_hz=1000.0, start_ns=START_NS + 10**10, frame="base"
    )
    driver.do("send", topic=MAG, rows=in_tesla(readings(40)), rate_hz=1000.0, start_ns=START_NS)
    take(opened, lambda _, events: "garbage" in kinds(events))


def test_a_topic_that_is_not_there_is_answered_with_those_that_are(driver: Driver, tmp_path: Path) -> None:
    ended = flinders_("record", "--ros2", "/imu/magg", "-o", str(tmp_path / "a.csv"))
    assert (ended.code, MAG in ended.said) == (5, True), ended.err
    assert list(tmp_path.iterdir()) == []


def test_a_topic_of_another_type_is_refused_with_its_type(driver: Driver) -> None:
    driver.do("publish", topic="/imu/data", kind="Imu_")
    with pytest.raises(LinkError, match=r"sensor_msgs/msg/Imu.*/imu/mag"):
        feeds.open_feed("/imu/data")


def test_no_publisher_at_all_is_answered_with_what_has_to_be_the_same(
    domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flinders.apps.vehicles.ros2.participant.DISCOVERY_S", 0.1)
    with pytest.raises(LinkError, match=r"ROS_DOMAIN_ID.*multicast.*CYCLONEDDS_URI"):
        feeds.open_feed(MAG)


def test_a_network_that_cannot_be_used_is_said(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", NETWORK.replace("'lo'", "'no-such-interface'"))
    ended = flinders_("watch", "--ros2", MAG)
    assert (ended.code, "CYCLONEDDS_URI" in ended.err) == (5, True)


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("cyclonedds", "cyclonedds.domain"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match="pip install cyclonedds"):
        feeds.open_feed(MAG)


def test_a_topic_that_repeats_one_reading_is_said_once(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "MIN_REPEAT_S", 0.05)
    opened = feeds.open_feed(MAG)
    rows = in_tesla(readings(1)) * 250 + in_tesla(readings(2))
    driver.tell("send", topic=MAG, rows=rows, rate_hz=800.0, start_ns=START_NS)
    samples, events = take(opened, lambda samples, _: sum(map(len, samples)) == 252)
    assert kinds(events) == ["connected", "no-answer"]
    npt.assert_allclose(samples[-1].field[-1], readings(2)[-1], rtol=1e-15)


def test_readings_without_an_axis_are_left_out_and_told(driver: Driver) -> None:
    opened = feeds.open_feed(MAG)
    rows = [[1e-6, 2e-6, float("nan")]] * 30 + in_tesla(readings(1))
    driver.tell("send", topic=MAG, rows=rows, rate_hz=800.0, start_ns=START_NS)
    samples, events = take(opened, lambda samples, _: bool(samples))
    assert (sum(map(len, samples)), kinds(events)) == (1, ["connected", "no-answer"])


def test_a_driver_that_writes_microtesla_is_told_and_read_with_its_unit(driver: Driver) -> None:
    rows = readings(60)
    opened = feeds.open_feed(MAG)
    driver.tell("send", topic=MAG, rows=rows.tolist(), rate_hz=800.0, start_ns=START_NS)
    _, events = take(opened, lambda samples, _: sum(map(len, samples)) == 60)
    assert kinds(events) == ["connected", "unclear"]
    named = feeds.open_feed(MAG, unit="uT")
    driver.tell("send", topic=MAG, rows=rows.tolist(), rate_hz=800.0, start_ns=START_NS, matched=2)
    samples, events = take(named, lambda samples, _: sum(map(len, samples)) == 60)
    npt.assert_array_equal(np.concatenate([each.field for each in samples]), rows)
    assert kinds(events) == ["connected"]


def test_a_publisher_that_dies_is_gone_and_another_is_it_again(driver: Driver, domain: int) -> None:
    opened = feeds.open_feed(MAG)
    driver.do("send", topic=MAG, rows=in_tesla(readings(5)), rate_hz=400.0, start_ns=START_NS)
    take(opened, lambda samples, _: sum(map(len, samples)) == 5)
    driver.process.kill()
    assert kinds(take(opened, lambda _, events: bool(events))[1]) == ["gone"]
    other = Driver(domain)
    try:
        other.tell("publish", topic=MAG)
        other.tell("send", topic=MAG, rows=in_tesla(readings(5)), rate_hz=400.0, start_ns=START_NS)
        _, events = take(opened, lambda samples, events: bool(samples) and bool(events))
        assert kinds(events) == ["back"]
    finally:
        other.end()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["watch", "--serial", "/dev/ttyACM0", "--publish"], 2),
        (["watch", "--ros2", "imu mag"], 2),
        (["watch", "--ros2", MAG, "--columns", "x,y,z"], 2),
        (["record", "--imu-topic", MAG, "-o", "a.csv"], 2),
        (["record", "--ros2", MAG, "--pattern", "{x} {y} {z}", "-o", "a.csv"], 2),
        (["record", "--ros2", MAG, "--udp", "50100", "-o", "a.csv"], 2),
        (["live", "--imu-topic", MAG], 2),
    ],
)
def test_options_that_do_not_go_together_are_refused(words: list[str], code: int) -> None:
    assert flinders_(*words).code == code


def test_corrected_readings_do_not_go_to_the_topic_that_is_read(driver: Driver) -> None:
    assert flinders_("watch", "--ros2", MAG, "--publish", MAG).code == 2


def test_names_and_domains_are_checked() -> None:
    for name in ("/imu//mag", "/1imu", "/imu/mag/", "", "/ïmu"):
        with pytest.raises(UsageError):
            full_name(name)
    for number in ("233", "-1", "one"):
        with pytest.raises(UsageError):
            domain_id({"ROS_DOMAIN_ID": number})


# a calibration that keeps itself, published


@pytest.fixture(scope="module")
def fit() -> Fit:
    return flinders.fit(simulate.tumble(seed=1).samples)


def by_differences(fit: Fit, raw: Floats) -> Floats:
    """(3, 3) covariance of a corrected reading in µT², by differences of the correction itself."""
    centre, shape = fit.calibration.ellipsoid.centre, fit.calibration.ellipsoid.shape

    def corrected(parameters: Floats, reading: Floats) -> Floats:
        a, b, c, ab, ac, bc = parameters[3:]
        form = np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])
        found: Floats = fit.calibration.field_strength * np.linalg.solve(form, reading - parameters[:3])
        return found

    at = np.concatenate([centre, shape[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])
    steps = 1e-4 * np.eye(9)
    slopes = np.array([(corrected(at + step, raw) - corrected(at - step, raw)) / 2e-4 for step in steps]).T
    of_noise = np.array([corrected(at, raw + axis) - corrected(at, raw) for axis in np.eye(3)]).T
    covariance: Floats = slopes @ fit.claim.covariance @ slopes.T + fit.evidence.noise**2 * of_noise @ of_noise.T
    return covariance


def test_the_covariance_of_a_corrected_reading_is_that_of_its_derivatives(fit: Fit) -> None:
    raw = simulate.tumble(seed=2, n=20).samples.field
    found = corrected_field(fit, raw)
    fields = fit.calibration.apply(raw)
    npt.assert_allclose(1e6 * found.field, fields, rtol=1e-12)
    npt.assert_allclose(1e12 * found.covariance, field_covariance(fit, fields), rtol=1e-12)
    off = np.linalg.norm(fields, axis=1) / fit.calibration.field_strength - 1.0
    for one, covariance, away in zip(raw, found.covariance, off, strict=True):
        # the covariance is that on the sphere: a reading that is off it by 1 % has slopes that differ by as much
        npt.assert_allclose(1e12 * covariance, by_differences(fit, one), rtol=1e-3 + 4 * abs(away), atol=1e-5)


def test_corrected_readings_stay_in_the_axes_of_the_topic() -> None:
    samples = simulate.tumble(seed=1).samples
    plain = flinders.fit(samples.field, unit="uT")
    turned = flinders.fit(samples.field, unit="uT", axes="-y,z,-x")
    one, other = (corrected_field(each, samples.field[:50]) for each in (plain, turned))
    npt.assert_allclose(other.field, one.field, rtol=0.0, atol=1e-9)
    npt.assert_allclose(other.covariance, one.covariance, rtol=1e-3, atol=1e-18)


@contextmanager
def running(words: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A command in a process of its own, ended as by Ctrl-C."""
    command = [sys.executable, "-m", "flinders", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            said = process.communicate()[0]
        assert process.returncode == 0, said


class Listener:
    """Subscribes as a node of ROS 2 does by default: reliable."""

    def __init__(self, domain: int) -> None:
        from flinders.apps.vehicles.ros2.participant import Participant

        self.participant = Participant(domain)

    def subscribe(self, topic: str, message: Any, *, is_latched: bool = False) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader

        durability = Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile
        qos = Qos(
            Policy.Reliability.Reliable(0), durability, Policy.History.KeepLast(10_000),
            Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
        )  # fmt: skip
        return DataReader(self.participant._entity, self.participant._topic(topic, message), qos=qos)


def received(reader: Any, count: int = 1) -> list[Any]:
    found: list[Any] = []

    def is_there() -> bool:
        found.extend(message for message in reader.take(1000) if hasattr(message, "serialize"))
        return len(found) >= count

    wait_until(is_there)
    return found


def test_a_calibration_that_keeps_itself_is_published(driver: Driver, domain: int, fit: Fit, tmp_path: Path) -> None:
    from flinders.apps.vehicles.ros2.messages import DiagnosticArray_, MagneticField_, String_

    fit.save(tmp_path / "calibration.json")
    listener = Listener(domain)
    corrected = listener.subscribe("/compass", MagneticField_)
    diagnostics = listener.subscribe("/diagnostics", DiagnosticArray_)
    words = ["watch", "--ros2", MAG, "--publish", "compass", "--previous", str(tmp_path / "calibration.json")]
    field = readings(300)
    with running(words):
        wait_until(lambda: corrected.get_subscription_matched_status().current_count)
        wait_until(lambda: diagnostics.get_subscription_matched_status().current_count)
        driver.do("send", topic=MAG, rows=in_tesla(field), rate_hz=100.0, start_ns=START_NS)
        messages = received(corrected, 150)  # those of the first second wait for a claim
        calibration = received(listener.subscribe("/compass/calibration", String_, is_latched=True))[-1]
        status = received(diagnostics)[0].status[0]
    assert {each.header.frame_id for each in messages} == {"mag"}
    stamps = np.array([each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in messages])
    published = fit_from(loads(calibration.data))
    expected = corrected_field(published, field[(stamps - START_NS) // 10**7])
    vectors = [(each.magnetic_field.x, each.magnetic_field.y, each.magnetic_field.z) for each in messages]
    npt.assert_allclose(vectors, expected.field, rtol=1e-9)
    covariances = np.array([each.magnetic_field_covariance for each in messages]).reshape(-1, 3, 3)
    npt.assert_allclose(covariances[:80], expected.covariance[:80], rtol=1e-6, atol=1e-24)  # then the claim is newer
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()
    values = {each.key: each.value for each in status.values}
    assert (status.level, values["verdict"], values["doing"]) == (0, "good", "undisturbed")
    assert 0.0 < float(values["heading_error_deg"]) < 1.0


def test_a_live_page_records_a_topic(driver: Driver, tmp_path: Path) -> None:
    path = tmp_path / "session.csv"
    words = ["live", "--ros2", MAG, "--port", "0", "--no-open", "-o", str(path)]
    with running(words):
        driver.do("send", topic=MAG, rows=in_tesla(readings(50)), rate_hz=400.0, start_ns=START_NS)
        wait_until(lambda: path.exists() and len(path.read_text(encoding="utf-8").splitlines()) >= 53)
    npt.assert_array_equal(flinders.read(path).field, readings(50))


# agreement with rosbags, which has the types of all distributions


@pytest.mark.parametrize("distribution", ["HUMBLE", "JAZZY", "KILTED"])
def test_messages_are_written_as_those_of_a_distribution(distribution: str) -> None:
    typesys = pytest.importorskip("rosbags.typesys")
    from flinders.apps.vehicles.ros2 import messages as ours

    store = typesys.get_typestore(getattr(typesys.Stores, f"ROS2_{distribution}"))
    header = ours.Header_(ours.Time_(START_NS // 10**9, START_NS % 10**9), "imu_link")
    nine, vector = [float(each) for each in range(9)], ours.Vector3_(1e-5, -2e-5, 4e-5)
    examples = {
        "sensor_msgs/msg/MagneticField": ours.MagneticField_(header, vector, nine),
        "sensor_msgs/msg/Imu": ours.Imu_(header, ours.Quaternion_(0.1, 0.2, 0.3, 0.4), nine, vector, nine, vector),
        "diagnostic_msgs/msg/DiagnosticArray": ours.DiagnosticArray_(
            header, [ours.DiagnosticStatus_(2, "a", "b", "c", [ours.KeyValue_("key", "value")])]
        ),
        "std_msgs/msg/String": ours.String_("{}"),
    }
    for kind, message in examples.items():
        packed = bytes(message.serialize(use_version_2=False))
        theirs = store.deserialize_cdr(packed, kind)
        assert bytes(store.serialize_cdr(theirs, kind)) == packed
        if type(message) in ours.TYPE_HASHES:
            assert ours.TYPE_HASHES[type(message)] == store.hash_rihs01(kind)
    packed = bytes(examples["sensor_msgs/msg/MagneticField"].serialize(use_version_2=False))
    theirs = store.deserialize_cdr(packed, "sensor_msgs/msg/MagneticField")
    assert (theirs.header.frame_id, theirs.magnetic_field.z) == ("imu_link", 4e-5)
