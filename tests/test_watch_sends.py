"""A calibration that keeps itself on a vehicle: read over MAVLink, and handed to it, with proof (service, vehicles)."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.feeding import free_port
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.vehicles.test_send_mavlink import Autopilot, dialect

import flinders
from flinders import simulate
from flinders.apps.service.handover import Handover
from flinders.apps.service.sources import Source, of_feed
from flinders.apps.service.watching import Watch
from flinders.apps.vehicles import mavlink
from flinders.apps.vehicles.mavlink import Vehicle
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters
from flinders.apps.vehicles.targets.autopilot import parse
from flinders.apps.vehicles.telemetry import Telemetry
from flinders.errors import NotSent
from flinders.links.recipients import Recipient
from flinders.links.transports import Udp

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flinders.apps.service.reports import Report

TUMBLE: Final = simulate.tumble(seed=1)
SENSOR: Final = TUMBLE.sensor


class Flying(Autopilot):
    """A vehicle that also sends what its compass reads, corrected with the parameters that it holds now."""

    def __init__(self, port: int, **more: Any) -> None:
        self.tick = 0
        super().__init__(port, **more)

    def _crowd(self) -> None:
        """A reading with each heartbeat."""
        super()._crowd()
        self.tick += 1
        raw = 10.0 * TUMBLE.samples.field[self.tick % len(TUMBLE.samples)]
        x, y, z = np.rint(ArduPilotParameters.read(self.values, 1).apply(raw)).astype(int).tolist()
        self._send(dialect.MAVLink_raw_imu_message(50_000 * self.tick, 0, 0, -1000, 0, 0, 0, x, y, z))


@contextmanager
def flying(**more: Any) -> Iterator[tuple[Flying, Telemetry]]:
    source = Udp(0, "127.0.0.1")
    one = Flying(source.port, **more)
    try:
        yield one, Telemetry(Vehicle.find(source, listen=0.15, answer=0.25, silent=2.0))
    finally:
        one.stop()
        source.close()


def watched(source: Source, folder: Path, **more: Any) -> list[Report]:
    """What is told until a calibration was sent, or was not."""
    told: list[Report] = []
    online = flinders.OnlineCalibration(flinders.fit(flinders.Samples.of(10.0 * TUMBLE.samples.field, unit="mG")))
    assert source.recipient is not None

    def stopped() -> bool:
        return any(report.kind == "send" for report in told)

    watch = Watch(
        source, online, handover=Handover(source.recipient, str(folder), **more), tell=told.append, stopped=stopped
    )
    source.close, closed = lambda: None, source.close  # type: ignore[method-assign]
    watch.run()
    source.close = closed  # type: ignore[method-assign]
    return told


def more_of(source: Source, count: int = 10) -> list[flinders.Samples]:
    """Further readings."""
    found: list[flinders.Samples] = []
    while sum(map(len, found)) < count:
        received = source.next(0.1)
        found += [received] if isinstance(received, flinders.Samples) else []
    return found


def test_a_vehicle_gets_the_calibration_in_force_and_goes_on_being_read(tmp_path: Path) -> None:
    with flying() as (one, feed):
        assert isinstance(feed, Recipient)
        source = of_feed(feed, None)
        told = watched(source, tmp_path)
        after = np.concatenate([samples.field for samples in more_of(source)])
    (sent,) = (report for report in told if report.kind == "send")
    assert sent.event == "sent"
    assert "all 10 values" in (sent.words or "")
    assert_sentences(sent.words or "")
    held = ArduPilotParameters.read(one.values, 1)
    np.testing.assert_allclose(0.1 * -held.offset, SENSOR.offset, atol=0.5)
    (kept,) = tmp_path.iterdir()
    before = parse(kept.read_text())
    assert before == {name: one.before[name] for name in before}  # a ground station puts it back
    assert len(before) == 10
    apart = np.linalg.norm(after[:, np.newaxis] - TUMBLE.samples.field, axis=2).min(axis=1)
    assert apart.max() < 0.3  # readings are as raw as before
    assert told[-1].events["sent"] == 1


@pytest.mark.nightly
def test_an_armed_vehicle_gets_nothing(tmp_path: Path) -> None:
    with flying(armed=True) as (one, feed):
        told = watched(of_feed(feed, None), tmp_path)
    (waits,) = (report for report in told if report.kind == "send")
    assert (waits.event, "it is armed" in (waits.words or "")) == ("waits", True)
    assert one.sets == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly
def test_a_vehicle_that_does_not_take_it_is_left_as_it_was(tmp_path: Path) -> None:
    with flying(ignores=("COMPASS_ODI_Y",)) as (one, feed):
        told = watched(of_feed(feed, None), tmp_path)
    (failed,) = (report for report in told if report.kind == "send")
    assert failed.event == "not-sent"
    assert "values from before again" in (failed.words or "")
    assert "on board before is" in (failed.words or "")
    assert one.values == one.before


def test_what_somebody_else_changed_is_not_written_over(tmp_path: Path) -> None:
    with flying() as (one, feed):
        one.values["COMPASS_OFS_X"] = 77.0
        told = watched(of_feed(feed, None), tmp_path)
        assert [report.event for report in told if report.kind == "send"] == ["not-sent"]
        assert_sentences("".join(report.words or "" for report in told))
        assert one.sets == []
        assert -10.0 * (feed.on_board(50.0) or TUMBLE).offset[0] == 77.0  # type: ignore[union-attr]  # and is removed now


def test_a_vehicle_with_compensated_motors_or_corrected_readings_gets_nothing(tmp_path: Path) -> None:
    calibration = flinders.Calibration.identity(field_strength=50.0)
    with flying(mounted={"COMPASS_MOTCT": 2.0, "COMPASS_MOT_X": 3.0}) as (one, feed):
        with pytest.raises(NotSent, match="COMPASS_MOT"):
            feed.transfer(calibration)
        assert one.sets == []
    source = Udp(0, "127.0.0.1")
    px4 = Autopilot(source.port, kind=mavlink.PX4)
    try:
        feed = Telemetry(Vehicle.find(source, listen=0.15, answer=0.25, silent=2.0))
        assert feed.on_board(50.0) is None
        with assert_raises(NotSent):
            feed.transfer(calibration)
    finally:
        px4.stop()
        source.close()


def test_sending_is_refused_where_nothing_could_be_put_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    udp = ("watch", "--udp", str(free_port()))
    for words, said in (
        ((*udp, "--send", "."), "--send needs --mavlink"),
        ((*udp, "--send-interval", "60"), "--send-interval needs --send"),
        (("watch", "--mavlink", "udp:127.0.0.1:1", "--send", "nowhere"), "need an existing folder"),
    ):
        ended = flinders_(*words)
        assert (ended.code, said in ended.said) == (2, True), ended.err
