"""Feeds that are no wires: recordings played back, a simulated sensor, a vehicle's telemetry; and their recording."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.feeding import asked
from tests.page_session import PageSession
from tests.sentences import assert_raises, assert_sentences

from flinders import fit, simulate
from flinders.apps.live.buffer import rows_of
from flinders.apps.live.simulated import COMMENTS, ROCKING_S, SimulatedFeed
from flinders.apps.vehicles.mavlink import ARDUPILOT, PX4, Vehicle
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as Parameters
from flinders.apps.vehicles.telemetry import Telemetry
from flinders.core.samples import Samples
from flinders.errors import OutputError, UsageError
from flinders.links.feed_recording import RecordedFeed
from flinders.links.feeds import CHUNK_READINGS, FeedEvent, Replay
from flinders.links.recording_text import ResumedRecording
from flinders.links.sinks import FileSink
from flinders.links.transports import Udp
from flinders.readers import open_recording, read

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


TUMBLE = simulate.tumble(seed=1, n=1200).samples


class Clock:
    """Time that passes only where it is waited for."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def at_the_end(_: Samples, events: list[FeedEvent]) -> bool:
    return bool(events) and events[-1].kind == "ended"


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# recordings played back


def test_a_recording_played_back_is_what_was_recorded() -> None:
    feed = Replay(TUMBLE, speed=None)
    readings, events = asked(feed, at_the_end)
    for column in ("field", "time", "acceleration", "rate"):
        np.testing.assert_array_equal(getattr(readings, column), getattr(TUMBLE, column))
    assert [event.kind for event in events] == ["connected", "ended"]
    assert feed.next(0.0) is None


@pytest.mark.parametrize("speed", [1.0, 4.0, 0.5])
def test_it_takes_the_time_that_it_took_over_the_speed(speed: float) -> None:
    clock = Clock()
    feed = Replay(TUMBLE, speed=speed, clock=clock, sleep=clock.sleep)
    start, late = clock.now, 0.0
    assert isinstance(feed.next(0.1), FeedEvent)
    while not isinstance(found := feed.next(0.1), FeedEvent):
        if found is not None and found.time is not None:
            late = max(late, clock.now - start - found.time[0] / speed)
    assert clock.now - start == pytest.approx((1199 / 50) / speed, abs=0.01)
    assert late < 0.03


def test_pauses_and_clocks_that_jump_back_hold_nothing_up() -> None:
    times = [0.0, 0.1, 3600.0, 3600.1, 5.0, np.nan, 5.2]
    clock = Clock()
    feed = Replay(Samples.of(np.ones((7, 3)), unit="uT", time=times), clock=clock, sleep=clock.sleep)
    readings, _ = asked(feed, at_the_end)
    np.testing.assert_array_equal(readings.time, times)
    assert clock.now - 100.0 < 3.0


def test_a_recording_without_times_has_fifty_readings_a_second() -> None:
    clock = Clock()
    feed = Replay(Samples.of(np.ones((100, 3))), clock=clock, sleep=clock.sleep)
    readings, _ = asked(feed, at_the_end)
    assert readings.time is not None
    np.testing.assert_allclose(np.diff(readings.time), 0.02)
    assert readings.unit.inside == "counts"
    assert clock.now - 100.0 == pytest.approx(1.98, abs=0.15)


def test_readings_are_handed_on_in_blocks_and_none_twice() -> None:
    clock = Clock()
    feed = Replay(TUMBLE, clock=clock, sleep=clock.sleep)
    assert isinstance(feed.next(0.1), FeedEvent)
    clock.now += 1e6  # nobody asked for a long time
    blocks = [feed.next(0.1) for _ in range(3)]
    assert [len(block) for block in blocks if isinstance(block, Samples)] == [CHUNK_READINGS, CHUNK_READINGS, 200]


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_a_speed_is_positive(speed: float) -> None:
    with assert_raises(UsageError):
        Replay(TUMBLE, speed=speed)


def test_a_recording_without_times_says_at_what_rate_it_is_played() -> None:
    untimed = Samples.of(TUMBLE.field, unit="uT", source="log.csv")
    _, events = asked(Replay(untimed, speed=None), at_the_end)
    assert_sentences(events[0].words)
    assert_sentences(events[-1].words)
    _, events = asked(Replay(TUMBLE, speed=None), at_the_end)
    assert not [event for event in events if "no times" in event.words]


def test_a_real_recording_is_played_back(recordings: Callable[[str], Path]) -> None:
    path = recordings("michaelwro_fxos8700/mag-readings.txt")
    readings, _ = asked(Replay(open_recording(path, unit="uT"), speed=None), at_the_end)
    np.testing.assert_array_equal(readings.field, read(path, unit="uT").field)


# a simulated sensor


def test_the_simulated_sensor_is_calibrated_to_its_truth() -> None:
    feed = SimulatedFeed(seed=2, speed=None)
    readings, _ = asked(feed, lambda readings, _: len(readings) >= 3000)
    found = fit(readings).calibration
    matrix, offset = feed.sensor.correction
    np.testing.assert_allclose(found.offset, offset, atol=0.3)
    np.testing.assert_allclose(found.matrix / np.cbrt(np.linalg.det(found.matrix)),
                               matrix / np.cbrt(np.linalg.det(matrix)), atol=0.01)  # fmt: skip
    again, _ = asked(SimulatedFeed(seed=2, speed=None), lambda readings, _: len(readings) >= 3000)
    np.testing.assert_array_equal(again.field, readings.field)


@pytest.mark.nightly
def test_it_is_rocked_at_first_and_good_after_half_a_minute() -> None:
    """A newcomer sees what the page says while the calibration is not good, and a mistake by its name."""
    readings, events = asked(SimulatedFeed(seed=1, speed=None), lambda readings, _: len(readings) >= 1700)
    assert readings.time is not None
    assert readings.acceleration is not None
    session, good_s = PageSession(), math.inf
    for block in readings.blocks(rows=25):
        assert block.time is not None
        at = float(block.time[-1])
        session.arrived(at, rows_of(block), block.unit)
        session.fit()
        phase = session.state.phase
        assert phase == "collecting" or at >= ROCKING_S
        good_s = min(good_s, at if phase == "good" else math.inf)
    assert 25.0 < good_s < 32.0
    assert [event.at for event in events] == [0.0, *(at for at, _ in COMMENTS)]
    assert "a common mistake" in events[1].words


def test_it_goes_on_for_ever_without_a_jump() -> None:
    """Twice through what is drawn: forwards, backwards and on."""
    readings, _ = asked(SimulatedFeed(seed=4, speed=None), lambda readings, _: len(readings) >= 7000)
    assert readings.time is not None
    np.testing.assert_allclose(np.diff(readings.time), 0.02)
    steps = np.linalg.norm(np.diff(readings.field, axis=0), axis=1)
    assert steps.max() < 2.0 * np.quantile(steps, 0.99)


def test_it_keeps_time() -> None:
    clock = Clock()
    feed = SimulatedFeed(seed=1, clock=clock, sleep=clock.sleep)
    count = 0
    assert isinstance(feed.next(0.1), FeedEvent)
    while clock.now < 110.0:
        found = feed.next(0.05)
        count += len(found) if isinstance(found, Samples) else 0
    assert count == pytest.approx(500, abs=2)
    feed.close()
    assert isinstance(feed.next(0.0), FeedEvent)
    assert feed.next(0.0) is None


# their recording


def test_what_is_kept_reads_back() -> None:
    with FileSink("out.csv") as sink:
        feed = RecordedFeed(Replay(TUMBLE, speed=None), sink)
        readings, _ = asked(feed, at_the_end)
        feed.close()
    kept = read("out.csv")
    assert feed.name == "simulated hand"
    assert kept.unit.name == "uT"
    for column in ("field", "time", "acceleration", "rate"):
        np.testing.assert_allclose(getattr(kept, column), getattr(readings, column), rtol=1e-8, atol=1e-6)
    text = Path("out.csv").read_text(encoding="utf-8")
    assert text.startswith("# flinders ")
    assert_sentences(text, about="# 0.0 s: ")


def test_what_is_kept_is_continued() -> None:
    whole = Samples.of([[1, 2, 3]] * 10, unit="counts", time=np.arange(10.0), temperature=[20.0] * 9 + [np.nan])
    for rows in (slice(0, 5), slice(5, 10)):
        more = {"resumed": ResumedRecording.of("out.csv")} if rows.start else {}
        with FileSink("out.csv", resume=bool(rows.start)) as sink:
            asked(RecordedFeed(Replay(whole[rows], speed=None), sink, **more), at_the_end)
    kept = read("out.csv")
    assert kept.time is not None
    np.testing.assert_array_equal(kept.time, np.arange(10.0))
    assert kept.unit.inside == "counts"
    with FileSink("out.csv", resume=True) as sink:
        feed = RecordedFeed(Replay(TUMBLE, speed=None), sink, resumed=ResumedRecording.of("out.csv"))
        with assert_raises(OutputError):
            asked(feed, at_the_end)


# telemetry

dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")


class Sky:
    """A vehicle that sends heartbeats, and compass readings once it is asked for them."""

    def __init__(
        self,
        port: int,
        *,
        autopilot: int = ARDUPILOT,
        held: dict[str, float] | None = None,
        is_fine: bool = False,
        is_raw: bool = False,
    ) -> None:
        self.autopilot, self.held, self.is_fine, self.is_raw = autopilot, held or {}, is_fine, is_raw
        self.asked: set[int] = set()
        self.is_away = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.settimeout(0.01)
        self._link = dialect.MAVLink(self, srcSystem=1, srcComponent=1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def write(self, content: bytes) -> None:
        with suppress(ConnectionError):
            self._socket.send(content)

    def _live(self) -> None:
        tick = 0
        while not self._ended.is_set():
            if self.is_away:
                time.sleep(0.01)
                continue
            tick += 1
            if tick % 5 == 1:
                self._link.heartbeat_send(2, self.autopilot, 81, 0, 3, 3)
            self._measure(tick)
            with suppress(TimeoutError, ConnectionError):
                for message in self._link.parse_buffer(self._socket.recv(65535)) or []:
                    self._answer(message)

    def _measure(self, tick: int) -> None:
        if not self.asked:
            return
        force, rate, mag = (10, 20, -1000), (100, 0, -200), (200 + tick % 50, -30, 450)
        self._link.raw_imu_send(1000 * tick, *force, *rate, *mag, 0, 2150)
        if self.is_raw:
            return
        if self.is_fine:
            values = [(0.1, 0.2, -9.8), (0.1, 0.0, -0.2), (0.2, -0.03, 0.45)]
            flat = [number for triple in values for number in triple]
            self._link.highres_imu_send(1000 * tick, *flat, 0, 0, 0, 21.5, 0x1FF if tick % 2 else 0x3F)
        self._link.scaled_imu_send(tick, *force, *rate, *mag)
        self._link.scaled_imu2_send(tick, *force, *rate, 1, 2, 3)
        self._link.scaled_imu3_send(tick, *force, *rate, 0, 0, 0)

    def _answer(self, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types
        if message.get_type() == "COMMAND_LONG" and message.command == 511:
            self.asked.add(int(message.param1))
        if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in self.held:
            value = self.held[message.param_id]
            self._link.param_value_send(message.param_id.encode(), value, 9, 1, 0)

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


@contextmanager
def sky(**more: Any) -> Iterator[tuple[Sky, Vehicle]]:
    source = Udp(0, "127.0.0.1")
    one = Sky(source.port, **more)
    try:
        yield one, Vehicle.find(source, listen=0.1, answer=0.1, silent=0.4)
    finally:
        one.stop()
        source.close()


HELD = {
    **{f"COMPASS_OFS_{axis}": value for axis, value in zip("XYZ", (-20.5, 118.0, -43.0), strict=True)},
    **{f"COMPASS_DIA_{axis}": value for axis, value in zip("XYZ", (1.1, 1.0, 0.9), strict=True)},
    **{f"COMPASS_ODI_{axis}": value for axis, value in zip("XYZ", (0.1, 0.0, 0.0), strict=True)},
    "COMPASS_SCALE": 1.05,
}


def enough(readings: Samples, _: list[FeedEvent]) -> bool:
    return len(readings) >= 20


def test_ardupilots_readings_come_without_its_correction() -> None:
    with sky(held=HELD) as (one, vehicle):
        feed = Telemetry(vehicle)
        readings, events = asked(feed, enough)
        assert (one.asked, feed.target) == ({27, 26}, "ardupilot")
    assert events[0].kind == "connected"
    assert_sentences(events[0].words)
    corrected = Parameters.read(HELD).apply(10 * readings.field)  # what it sent, in mG
    np.testing.assert_allclose(corrected, np.round(corrected), atol=1e-3)
    np.testing.assert_allclose(corrected[:, 1:], [[-30, 450]] * len(readings), atol=1e-3)
    assert readings.unit.inside == "uT"
    assert readings.acceleration is not None
    assert readings.rate is not None
    np.testing.assert_allclose(readings.acceleration[0], np.array([0.01, 0.02, -1.0]) * 9.80665)
    np.testing.assert_allclose(readings.rate[0], [0.1, 0.0, -0.2])
    assert readings.time is not None
    assert (np.diff(readings.time) > 0).all()  # of two messages one is taken


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"autopilot": PX4},
        {"autopilot": PX4, "is_fine": True},
    ],
)
def test_what_is_not_known_is_left_as_it_is_sent_and_said(more: dict[str, Any]) -> None:
    with sky(**more) as (_, vehicle):
        readings, events = asked(Telemetry(vehicle), enough)
    assert_sentences(events[0].words)
    assert readings.unit.inside == "uT"
    np.testing.assert_allclose(readings.field[:, 1:], [[-3.0, 45.0]] * len(readings), rtol=1e-6)
    assert readings.rate is not None
    np.testing.assert_allclose(readings.rate, [[0.1, 0.0, -0.2]] * len(readings), rtol=1e-6)


def test_counts_of_other_autopilots_are_counts() -> None:
    with sky(autopilot=PX4, is_raw=True) as (_, vehicle):
        readings, _ = asked(Telemetry(vehicle), enough)
    assert readings.unit.inside == "counts"
    assert readings.rate is None
    np.testing.assert_array_equal(readings.field[:, 1:], [[-30, 450]] * len(readings))


def test_each_compass_has_messages_of_its_own() -> None:
    with sky() as (one, vehicle):
        readings, _ = asked(Telemetry(vehicle, compass=2), enough)
        assert one.asked == {116}
    np.testing.assert_allclose(readings.field[0], [0.1, 0.2, 0.3])
    with assert_raises(UsageError):
        Telemetry(vehicle, compass=4)


def test_a_compass_that_is_not_there_is_told() -> None:
    with sky() as (_, vehicle):
        feed = Telemetry(vehicle, compass=3)
        readings, events = asked(feed, lambda _, events: len(events) > 1)
    assert len(readings) == 0
    assert events[1].kind == "nothing"
    assert_sentences(events[1].words)


def test_a_vehicle_that_falls_silent_is_gone_and_comes_back() -> None:
    with sky(held=HELD) as (one, vehicle):
        feed = Telemetry(vehicle)
        asked(feed, enough)
        one.is_away = True
        _, events = asked(feed, lambda _, events: bool(events))
        assert events[-1].kind == "gone"
        assert_sentences(events[-1].words)
        one.is_away = False
        _, events = asked(feed, lambda _, events: bool(events))
        assert events[-1].kind == "back"
        readings, _ = asked(feed, enough)
    assert len(readings) >= 20


def test_telemetry_is_kept() -> None:
    with sky(held=HELD) as (_, vehicle), FileSink("out.csv") as sink:
        readings, _ = asked(RecordedFeed(Telemetry(vehicle), sink), enough)
    np.testing.assert_allclose(read("out.csv").field, readings.field, rtol=1e-8)
    assert_sentences(Path("out.csv").read_text(), about="compass 1")


def test_bytes_that_are_no_packets_do_no_harm() -> None:
    with sky(held=HELD) as (one, vehicle):
        feed = Telemetry(vehicle)
        for content in (b"\xfd" * 400, bytes(range(256)) * 8, struct.pack("<B", 0xFE), b""):
            one.write(content)
        readings, _ = asked(feed, enough)
    assert len(readings) >= 20
