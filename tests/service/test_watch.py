"""`flinders watch`: learns while a vehicle works, and outlives kills, unplugged cables, full disks and odd clocks."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import tracemalloc
import tty
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.feeding import free_port
from tests.flight_log import dataflash
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.trials import nightly
from tests.waiting import wait_until
from tests.worlds import walked_days

from flinders import OnlineCalibration, Samples
from flinders.apps.service.sources import Source, of_recordings, of_wire
from flinders.apps.service.watching import Files, InitialSettings, Watch
from flinders.core.offset_walk import Walk
from flinders.errors import OutputError
from flinders.fitting.fit_file import load
from flinders.links.feeds import FeedEvent
from flinders.links.transports import ScriptedSource

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.apps.service.reports import Report
    from flinders.arrays import Floats

RATE_HZ: Final = 20
BEGUN_S: Final = 1.79e9
OFFSET: Final = np.array([12.0, -30.0, 8.0])
MOVED: Final = np.array([5.0, 3.0, -4.0])
POSIX: Final = pytest.mark.skipif(os.name != "posix", reason="signals and terminals of POSIX")


def driven(seconds: float, *, seed: int = 1, moved_s: float = math.inf) -> tuple[Floats, Floats]:
    """(N,) s and (N, 3) µT of a vehicle that turns, climbs and rolls; its offset may move."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE_HZ)
    time = np.arange(n) / RATE_HZ

    def wandering(sigma: float, every_s: float) -> Floats:
        steps = np.repeat(rng.normal(0.0, sigma, n), round(every_s * RATE_HZ))[:n]
        return np.asarray(np.cumsum(steps) / RATE_HZ)

    yaw, pitch, roll = wandering(0.4, 5.0), 0.4 * np.sin(wandering(0.5, 2.0)), 0.5 * np.sin(wandering(0.5, 2.0))
    north, down = 25.0, 42.0
    level = np.stack([north * np.cos(yaw), -north * np.sin(yaw), np.full(n, down)])
    along = np.cos(pitch) * level[0] - np.sin(pitch) * level[2]
    below = np.sin(pitch) * level[0] + np.cos(pitch) * level[2]
    field = np.stack(
        [along, np.cos(roll) * level[1] + np.sin(roll) * below, np.cos(roll) * below - np.sin(roll) * level[1]], axis=1
    )
    field = 1.04 * field + OFFSET + rng.normal(0.0, 0.2, (n, 3))
    field[time >= moved_s] += MOVED
    return time, field


def table(time: Floats, field: Floats, header: str = "time_s,mag_x_uT,mag_y_uT,mag_z_uT") -> str:
    rows = (",".join(f"{value:.3f}" for value in row) + "\n" for row in np.column_stack([time, field]).tolist())
    return f"{header}\n{''.join(rows)}"


DRIVE: Final = driven(600.0, moved_s=360.0)
"""Ten minutes, in which the offset moves once."""


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive.csv").write_text(drive())


def program(*words: str, **more: Any) -> subprocess.Popen[str]:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    return subprocess.Popen(
        [sys.executable, "-c", code, "watch", *words],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **more,
    )  # fmt: skip


@cache
def drive() -> str:
    return table(BEGUN_S + DRIVE[0], DRIVE[1])


def lines_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def without_source(lines: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{**line, "source": ""} for line in lines if line["kind"] != "source"]


# recordings


def test_a_drive_is_learnt_and_told_in_lines() -> None:
    ended = flinders_("watch", "--replay", "drive.csv")
    assert ended.code == 0, ended.err
    first, *_ = ended.out.splitlines()
    assert_sentences(first)
    assert_sentences(ended.out, about="learnt")
    assert "\x1b" not in ended.out
    assert "12,000 readings" in ended.err


def test_each_event_and_the_state_at_times_are_lines_of_json() -> None:
    lines = lines_of(flinders_("watch", "--replay", "drive.csv", "--json", "--every", "30").out)
    events = [line for line in lines if line["kind"] == "event"]
    states = [line for line in lines if line["kind"] == "state"]
    assert [event["event"] for event in events][:2] == ["learnt", "adopted"]
    assert "moved" in {event["event"] for event in events}
    steps = np.diff([state["time_s"] for state in states])
    assert len(states) == 21  # and one at the end
    assert abs(steps[:-1] - 30.0).max() <= 1.0
    assert states[-1]["verdict"] == "good"
    assert states[-1]["heading_error_deg"] < states[-1]["bound_deg"] < 1.0
    assert states[0]["unit"] == "uT"


def test_status_metrics_and_adopted_calibration_are_files() -> None:
    files = ("--status", "status.json", "--prometheus", "flinders.prom", "--adopted", "adopted.json")
    assert flinders_("watch", "--replay", "drive.csv", *files).code == 0
    status = json.loads(Path("status.json").read_text())
    metrics = dict(
        line.rsplit(" ", 1) for line in Path("flinders.prom").read_text().splitlines() if not line.startswith("#")
    )
    assert float(metrics["flinders_heading_error_degrees"]) == pytest.approx(status["heading_error_deg"])
    assert float(metrics["flinders_good_until_timestamp_seconds"]) == pytest.approx(status["good_until_s"])
    assert metrics["flinders_readings_total"] == "12000"
    assert metrics['flinders_calibration_state{state="undisturbed"}'] == "1"
    for event, count in status["events"].items():
        assert metrics[f'flinders_events_total{{event="{event}"}}'] == str(count)
    assert float(metrics['flinders_offset_walk_per_root_hour{unit="uT"}']) == pytest.approx(status["walk"])
    adopted = load("adopted.json")
    assert adopted.verdict == "good"
    np.testing.assert_allclose(adopted.calibration.offset, OFFSET + MOVED, atol=0.5)
    assert sorted(path.name for path in Path().iterdir()) == [
        "adopted.json", "drive.csv", "flinders.prom", "status.json"
    ]  # fmt: skip


def test_each_adopted_calibration_is_in_a_folder_under_its_time() -> None:
    Path("calibrations").mkdir()
    lines = lines_of(flinders_("watch", "--replay", "drive.csv", "--adopted", "calibrations", "--json").out)
    times = [line["time"] for line in lines if line["event"] == "adopted"]
    names = [f"calibration-{re.sub('[-:]', '', time)}.json" for time in times]
    assert sorted(path.name for path in Path("calibrations").iterdir()) == names


def test_recordings_are_read_in_the_order_of_time() -> None:
    time, field = BEGUN_S + DRIVE[0], DRIVE[1]
    Path("b.csv").write_text(table(time[:5000], field[:5000]))
    Path("a.csv").write_text(table(time[5000:], field[5000:]))
    parts = flinders_("watch", "--replay", "a.csv", "b.csv", "--json").out
    whole = flinders_("watch", "--replay", "drive.csv", "--json").out
    assert without_source(lines_of(parts)) == without_source(lines_of(whole))


def test_recordings_without_a_date_follow_one_another() -> None:
    time, field = DRIVE
    Path("a.csv").write_text(table(time[:5000], field[:5000]))
    Path("b.csv").write_text(table(time[5000:] - time[5000], field[5000:]))
    lines = lines_of(flinders_("watch", "--replay", "a.csv", "b.csv", "--json").out)
    back = [line["words"] for line in lines if line["event"] == "clock"]
    assert_sentences(back)
    assert lines[-1]["readings"] == 12_000
    assert lines[-1]["verdict"] == "good"


def test_logs_of_a_vehicle_have_the_dates_of_its_satellites() -> None:
    time, field = DRIVE
    Path("b.bin").write_bytes(b"".join(dataflash(field[time < 120.0][::2])))
    Path("a.bin").write_bytes(b"".join(dataflash(field[time < 60.0][::2], week=2401)))
    whole = lines_of(flinders_("watch", "--replay", "a.bin", "b.bin", "--json").out)[-1]
    for log in ("b.bin", "a.bin"):
        parts = lines_of(flinders_("watch", "--replay", log, "--state", "drone.state", "--json").out)
        assert "known" not in {line["event"] for line in parts}
        assert parts[-1]["readings"] == {"b.bin": 1200, "a.bin": 600}[log]
    for key in ("time", "heading_error_deg", "walk"):
        assert parts[-1][key] == whole[key], key
    assert whole["time"].startswith("2026-01-15T12:00:")


def test_a_recording_in_axes_of_the_vehicle_gives_calibrations_for_them() -> None:
    time, field = DRIVE[0][:2000], DRIVE[1][:2000]
    rows = np.column_stack([1e6 * time, 10.0 * field]).round().astype(int).tolist()
    lines = ["loopIteration,time (us),magADC[0],magADC[1],magADC[2]", *(f"1,{','.join(map(str, row))}" for row in rows)]
    Path("blackbox.csv").write_text("\n".join(lines) + "\n")
    words = ("--state", "compass.state", "--adopted", "adopted.json", "--axes", "x,-y,-z")
    assert flinders_("watch", "--replay", "blackbox.csv", *words).code == 0
    calibration = load("adopted.json").calibration
    assert (calibration.frame, str(calibration.axes)) == ("vehicle", "x,-y,-z")
    Path("counts.csv").write_text(table(time, field, "time_s,mag_x_counts,mag_y_counts,mag_z_counts"))
    flinders_("watch", "--replay", "counts.csv", "--adopted", "sensor.json")
    for others in (("counts.csv", "blackbox.csv"), ("blackbox.csv", "--previous", "sensor.json")):
        refused = flinders_("watch", "--replay", *others)
        assert refused.code == 2
        assert_sentences(" ".join(refused.err.split()))


def test_a_pipe_gives_what_the_file_gives() -> None:
    piped = program("-", "--json")
    out, err = piped.communicate(Path("drive.csv").read_text(), timeout=120)
    assert piped.returncode == 0, err
    replayed = flinders_("watch", "--replay", "drive.csv", "--json").out
    assert without_source(lines_of(out)) == without_source(lines_of(replayed))


# a state that lasts


@POSIX
def test_what_was_killed_goes_on_from_the_last_save() -> None:
    """Killed in the middle of what comes through a pipe: the same is known in the end, to the bit."""
    assert flinders_("watch", "--replay", "drive.csv", "--status", "whole.json").code == 0
    text = Path("drive.csv").read_text()
    killed = program("-", "--state", "compass.state", "--every", "10")
    assert killed.stdin is not None
    killed.stdin.write(text[: 2 * len(text) // 5])
    killed.stdin.flush()
    wait_until(Path("compass.state").exists)
    wait_until(lambda: OnlineCalibration.load("compass.state").state.time_s > BEGUN_S + 200.0)
    killed.kill()
    killed.communicate()
    saved = OnlineCalibration.load("compass.state").state.time_s
    assert BEGUN_S < saved < BEGUN_S + 300.0
    again = program("-", "--state", "compass.state", "--status", "again.json", "--json")
    out, err = again.communicate(text, timeout=120)
    assert again.returncode == 0, err
    assert "compass.state: continues" in err
    lines = lines_of(out)
    assert [line["event"] for line in lines].count("known") == 1  # what was taken before is left out
    events = [line for line in lines if line["kind"] == "event"]
    assert all(event["time_s"] >= saved for event in events)
    whole, result = json.loads(Path("whole.json").read_text()), json.loads(Path("again.json").read_text())
    for name in ("heading_error_deg", "bound_deg", "latest_deg", "walk", "good_until_s", "time_s"):
        assert result[name] == whole[name], name


@POSIX
@pytest.mark.parametrize("number", [signal.SIGTERM, nightly(signal.SIGINT)])
def test_a_signal_saves_and_ends(number: int) -> None:
    watch = program("-", "--state", "compass.state", "--status", "status.json", "--every", "10")
    assert watch.stdin is not None
    watch.stdin.write(Path("drive.csv").read_text())
    watch.stdin.flush()
    wait_until(Path("status.json").exists)
    watch.send_signal(number)
    _, err = watch.communicate(timeout=60)
    assert watch.returncode == 0, err
    assert OnlineCalibration.load("compass.state").state.doing != "learning"


def test_a_state_goes_on_where_it_ended() -> None:
    time, field = BEGUN_S + DRIVE[0], DRIVE[1]
    Path("monday.csv").write_text(table(time[:5000], field[:5000]))
    Path("tuesday.csv").write_text(table(time[5000:], field[5000:]))
    for day in ("monday", "tuesday"):
        words = ("--state", "compass.state", "--status", f"{day}.json")
        assert flinders_("watch", "--replay", f"{day}.csv", *words).code == 0
    flinders_("watch", "--replay", "drive.csv", "--status", "whole.json")
    result, whole = (json.loads(Path(name).read_text()) for name in ("tuesday.json", "whole.json"))
    assert result["heading_error_deg"] == whole["heading_error_deg"]


def test_a_state_of_another_release_goes_on_and_that_is_told() -> None:
    samples = Samples.of(DRIVE[1][:5000], unit="uT", time=BEGUN_S + DRIVE[0][:5000])
    Watch(of_recordings([samples]), files=Files("compass.state")).run()
    content = json.loads(Path("compass.state").read_text())
    content["record"] |= {"version": 99}
    Path("compass.state").write_text(json.dumps(content))
    ended = flinders_("watch", "--replay", "drive.csv", "--state", "compass.state", "--json")
    assert ended.code == 0, ended.err
    assert_sentences(ended.err)
    first, *_ = lines = lines_of(ended.out)
    assert (first["event"], first["verdict"]) == ("other-release", "good")
    assert lines[-1]["events"]["other-release"] == 1
    assert json.loads(Path("compass.state").read_text())["record"]["version"] != 99


@POSIX
def test_one_program_keeps_a_state_until_it_ends_in_whatever_way() -> None:
    watch = program("-", "--state", "compass.state", "--status", "status.json", "--every", "1")
    assert watch.stdin is not None
    watch.stdin.write(Path("drive.csv").read_text()[:20_000])
    watch.stdin.flush()
    wait_until(Path("compass.state.lock").exists)
    wait_until(lambda: Path("compass.state.lock").read_text() != "")
    again = flinders_("watch", "--replay", "drive.csv", "--state", "compass.state")
    assert again.code == 6
    assert f"process {watch.pid} on" in " ".join(again.err.split())
    watch.kill()
    watch.communicate()
    assert flinders_("watch", "--replay", "drive.csv", "--state", "compass.state").code == 0


def test_a_calibration_file_begins_and_may_be_locked() -> None:
    time, field = BEGUN_S + DRIVE[0], DRIVE[1]
    Path("before.csv").write_text(table(time[:6000], field[:6000]))
    flinders_("watch", "--replay", "before.csv", "--adopted", "calibration.json")
    words = ("watch", "--replay", "drive.csv", "--previous", "calibration.json", "--json")
    free, locked = lines_of(flinders_(*words).out), lines_of(flinders_(*words, "--lock").out)
    assert free[0]["doing"] != "learning"
    assert "learnt" not in {line["event"] for line in free}
    assert "adopted" in {line["event"] for line in free}
    assert "adopted" not in {line["event"] for line in locked}
    assert locked[-1]["is_locked"] is True
    assert locked[-1]["verdict"] == "refused"  # the offset moved, and the calibration in force did not
    assert locked[-1]["latest_deg"] < 1.0


def test_a_current_that_the_calibration_follows_is_taken_from_the_recording() -> None:
    time, field = BEGUN_S + DRIVE[0][:4000], DRIVE[1][:4000]
    current = 8.0 * (1.0 + np.sin(time / 5.0))
    flown = np.column_stack([field + current[:, None] * [0.3, -0.2, 0.1], current])
    columns = "time_s,mag_x_uT,mag_y_uT,mag_z_uT"
    Path("flown.csv").write_text(table(time, flown, f"{columns},current_a"))
    Path("later.csv").write_text(table(time + 600.0, flown, f"{columns},current_a"))
    Path("blind.csv").write_text(table(time + 600.0, flown[:, :3], columns))
    flinders_("calibrate", "flown.csv", "--with", "current", "--output", "start.json")
    words = ("--previous", "start.json", "--adopted", "kept.json", "--json")
    events = {line["event"] for line in lines_of(flinders_("watch", "--replay", "later.csv", *words).out)}
    assert not events & {"contradicted", "moved", "learnt"}
    if Path("kept.json").exists():
        assert "current" in json.loads(Path("kept.json").read_text())["correction"]["disturbances"]
    refused = flinders_("watch", "--replay", "blind.csv", *words)
    assert refused.code == 2
    assert_sentences(" ".join(refused.err.split()))


def test_an_earlier_history_tells_how_the_offset_walks(monkeypatch: pytest.MonkeyPatch) -> None:
    time, field, _, _ = walked_days(1, days=1.5, walk=0.1)
    Path("adopted").mkdir()
    Path("short.csv").write_text(table(DRIVE[0][:800], DRIVE[1][:800]))
    told: list[Report] = []
    samples = Samples.of(field, unit="uT", time=BEGUN_S + time)
    Watch(of_recordings([samples]), files=Files("old.state", "adopted"), every=600.0, tell=told.append).run()
    Path("lines").write_text("".join(f"{json.dumps(report.as_dict())}\n" for report in told))
    known: list[Walk | float | None] = []
    monkeypatch.setattr(InitialSettings, "calibration", _noting(known, InitialSettings.calibration))
    for history in ("old.state", "adopted", "lines"):
        ended = flinders_("watch", "--replay", "short.csv", "--history", history)
        assert_sentences(ended.said)
    assert flinders_("watch", "--replay", "short.csv", "--walk", "0.1", "--state", "new.state").code == 0
    *walks, number = known
    assert number == 0.1
    for walk in walks:
        assert isinstance(walk, Walk)
        assert walk.low / 1.5 < 0.1 < 1.5 * walk.high
    again = flinders_("watch", "--replay", "short.csv", "--history", "old.state", "--state", "new.state")
    assert_sentences(again.said)
    short = flinders_("watch", "--replay", "short.csv", "--history", "new.state")
    assert short.code == 2
    assert_sentences(short.said)
    Path("counts.csv").write_text(
        table(DRIVE[0][:800], DRIVE[1][:800], "time_s,mag_x_counts,mag_y_counts,mag_z_counts")
    )
    other = flinders_("watch", "--replay", "counts.csv", "--history", "old.state")
    assert other.code == 2
    assert_sentences(other.said)
    both = flinders_("watch", "--replay", "short.csv", "--history", "old.state", "--walk", "1")
    assert both.code == 2
    assert_sentences(both.said)


def _noting(known: list[Walk | float | None], begin: Any) -> Any:  # noqa: ANN401 - a method
    def calibration(begun: InitialSettings, *unit: Any) -> OnlineCalibration:
        known.append(begun.walk)
        return begin(begun, *unit)  # type: ignore[no-any-return]

    return calibration


# what goes wrong


class Board:
    """A board on a pseudo-terminal, under a name that stays."""

    def __init__(self) -> None:
        self.port = Path.cwd() / "ttyBOARD"
        self.plug()

    def plug(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port.unlink(missing_ok=True)
        self.port.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        self.port.unlink()
        os.close(self._slave)
        os.close(self.master)

    def send(self, field: Floats) -> None:
        for row in field.tolist():
            os.write(self.master, f"X: {row[0]:.2f} Y: {row[1]:.2f} Z: {row[2]:.2f} uT\r\n".encode())


@POSIX
def test_a_sensor_that_is_unplugged_is_waited_for() -> None:
    pytest.importorskip("serialx")
    board = Board()
    watch = program("--serial", str(board.port), "--state", "compass.state", "--json", "--every", "1")
    assert watch.stdout is not None
    told: list[dict[str, Any]] = []

    def until(event: str) -> None:
        for line in watch.stdout or ():
            told.append(json.loads(line))
            if told[-1]["event"] == event:
                return
        pytest.fail(f"{event} did not come: {told}")

    until("connected")
    board.send(DRIVE[1][:100])
    until("settled")
    board.unplug()
    until("gone")
    assert told[-1]["is_connected"] is False
    assert_sentences(told[-1]["words"])
    board.plug()
    until("back")
    assert told[-1]["disconnections"] == 1
    board.send(DRIVE[1][100:200])
    wait_until(Path("compass.state").exists)
    watch.send_signal(signal.SIGTERM)
    out, err = watch.communicate(timeout=60)
    assert watch.returncode == 0, err
    assert sum(line["event"] == "gone" for line in [*told, *lines_of(out)]) == 1
    assert abs(OnlineCalibration.load("compass.state").state.time_s - Path("compass.state").stat().st_mtime) < 30.0


class Px4(threading.Thread):
    """An autopilot that sends its first compass to a port."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._port, self.is_over = port, threading.Event()

    def run(self) -> None:
        dialect = pytest.importorskip("pymavlink.dialects.v20.common")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
            for number, (x, y, z) in enumerate((0.01 * DRIVE[1]).tolist()):
                gravity, turn, air = (0, 0, -9.8), (0, 0, 0), (0, 0, 0, 20)
                messages = [
                    dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3),
                    dialect.MAVLink_highres_imu_message(20_000 * number, *gravity, *turn, x, y, z, *air, 0x1FF),
                ]
                with suppress(ConnectionError):
                    wire.sendto(b"".join(message.pack(link) for message in messages), ("127.0.0.1", self._port))
                if self.is_over.wait(0.02):
                    return


@POSIX
@pytest.mark.nightly
def test_a_vehicle_is_watched_over_mavlink() -> None:
    pytest.importorskip("pymavlink")
    port = free_port()
    autopilot = Px4(port)
    autopilot.start()
    watch = program("--mavlink", f"udp:127.0.0.1:{port}", "--json", "--every", "1", "--status", "status.json")
    try:
        status = Path("status.json")
        wait_until(lambda: status.exists() and json.loads(status.read_text())["readings"] > 20)
    finally:
        watch.send_signal(signal.SIGTERM)
        out, err = watch.communicate(timeout=60)
        autopilot.is_over.set()
    assert watch.returncode == 0, err
    assert "PX4" in lines_of(out)[0]["words"]
    assert lines_of(out)[-1]["unit"] == "uT"  # of the walk; HIGHRES_IMU is in G


def test_garbage_is_counted() -> None:
    rows = table(*DRIVE).splitlines()
    garbage = [*rows[:3000], *["\x07\x08 ~~~ 1"] * 60, *rows[3000:]]
    ended = program("-", "--json", "--status", "status.json")
    out, _ = ended.communicate("\n".join(garbage) + "\n", timeout=120)
    assert ended.returncode == 0
    assert [line["event"] for line in lines_of(out)].count("garbage") == 1
    status = json.loads(Path("status.json").read_text())
    assert (status["readings"], status["not_understood"]) == (12_000, 60)


@POSIX
def test_a_full_disk_is_said_once_and_tried_again() -> None:
    limited = program(
        "--replay", "drive.csv", "--state", "compass.state", "--status", "status.json", "--every", "10",
        preexec_fn=limit_files, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    out, err = limited.communicate(timeout=120)
    assert limited.returncode == 6, err
    assert err.count("! compass.state: ") == 1
    assert "a first calibration was found" in out
    assert not Path("compass.state").exists()
    assert json.loads(Path("status.json").read_text())["readings"] == 12_000  # what is small enough goes on


def limit_files() -> None:
    """Let no file of this program grow beyond what a status has."""
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, 8_000))


def test_a_disk_with_room_again_gets_the_state(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    tries: list[str] = []
    save = OnlineCalibration.save

    def failing(online: OnlineCalibration, path: str) -> None:
        tries.append(path)
        if len(tries) < 3:
            raise OutputError(f"{path}: cannot be written: No space left on device")
        save(online, path)

    monkeypatch.setattr(OnlineCalibration, "save", failing)
    samples = Samples.of(DRIVE[1], unit="uT", time=DRIVE[0])
    Watch(of_recordings([samples]), files=Files(state="compass.state"), say=said.append).run()
    assert_sentences(said)
    assert OnlineCalibration.load("compass.state").state.time_s == DRIVE[0][-1]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], 2),
        (["drive.csv"], 2),
        (["--udp", "50100", "--replay", "drive.csv"], 2),
        (["--replay", "drive.csv", "--compass", "2"], 2),
        (["--replay", "missing.csv"], 5),
        (["--replay", "timeless.csv"], 5),
        (["--replay", "drive.csv", "--state", "drive.csv"], 2),
        (["--replay", "drive.csv", "--state", "a", "--status", "a"], 2),
        (["--replay", "drive.csv", "--state", "nowhere/a"], 6),
        (["--replay", "drive.csv", "--state", "timeless.csv"], 5),
        (["--replay", "drive.csv", "--status", "/dev/full"], 6),
        (["--replay", "drive.csv", "--state", "old.state", "--target", "0.5"], 2),
        (["--replay", "drive.csv", "--previous", "old.json", "--axes", "x,-y,-z"], 2),
        (["--replay", "counts.csv", "--previous", "old.json"], 2),
        (["--replay", "drive.csv", "--previous", "drive.csv"], 2),
    ],
)
def test_what_cannot_be_used_is_refused(words: list[str], code: int) -> None:
    if os.name != "posix" and "/dev/full" in words:
        pytest.skip("a device of Linux")
    time, field = DRIVE[0][:4000], DRIVE[1][:4000]
    Path("timeless.csv").write_text("mag_x_uT,mag_y_uT,mag_z_uT\n1,2,3\n4,5,6\n")
    Path("counts.csv").write_text(table(time, field, "time_s,mag_x_counts,mag_y_counts,mag_z_counts"))
    if "old.state" in words or "old.json" in words:
        samples = Samples.of(field, unit="uT", time=time)
        Watch(of_recordings([samples]), files=Files("old.state", "old.json")).run()
    ended = flinders_("watch", *words)
    assert ended.code == code, ended.err
    assert_sentences(" ".join((ended.out + ended.err).split()))


def test_a_pipe_that_brings_nothing_is_refused() -> None:
    ended = program("-")
    _, err = ended.communicate("", timeout=60)
    assert ended.returncode == 5
    assert_sentences(" ".join(err.split()))


# clocks, and what goes on for months


class Listed:
    """A feed of what a list holds."""

    name = "the list"

    def __init__(self, received: Iterator[Samples | FeedEvent | None]) -> None:
        self._received = received

    def next(self, _timeout: float) -> Samples | FeedEvent | None:
        return next(self._received, FeedEvent("ended", 0.0, "the list has ended"))

    def close(self) -> None:
        pass


class Stuck:
    """A clock that stands still."""

    now = None

    def of(self, times: Floats) -> Floats:
        return np.full(len(times), 7.0)

    def remarks(self) -> list[str]:
        return []


def test_readings_that_wait_are_bounded() -> None:
    blocks = (Samples.of(DRIVE[1][:2000], unit="uT", time=DRIVE[0][:2000]) for _ in range(20))
    watch = Watch(Source(Listed(blocks), Stuck()))
    assert watch.run().readings == 40_000
    blocks = (Samples.of(DRIVE[1][:2000], unit="uT", time=DRIVE[0][:2000]) for _ in range(20))
    watch = Watch(Source(Listed(blocks), Stuck()), tell=lambda _: None)
    most = 0
    learn = watch._learn

    def noting(samples: Samples) -> None:
        nonlocal most
        learn(samples)
        most = max(most, len(watch._time))

    watch._learn = noting  # type: ignore[method-assign]
    watch.run()
    assert most < 10_000


def test_a_live_source_is_on_the_time_of_this_machine_and_says_when_it_is_quiet() -> None:
    now = [0.0]
    told: list[Report] = []
    rows = [f"X: {x:.2f} Y: {y:.2f} Z: {z:.2f} uT\n".encode() for x, y, z in DRIVE[1][:40].tolist()]
    wire = ScriptedSource([b"".join(rows)])
    source = of_wire(wire, None)

    def stopped() -> bool:
        now[0] += 1.0 if wire.is_done else 0.0
        return now[0] > 30.0

    watch = Watch(source, tell=told.append, stopped=stopped, clock=lambda: now[0])
    report = watch.run()
    assert report.readings > 30
    assert abs(report.time_s - source.now) < 60.0  # type: ignore[operator]
    assert [each.event for each in told if each.kind == "source"].count("silent") == 1
    assert not report.is_connected


def test_what_a_watch_holds_does_not_grow() -> None:
    def blocks(count: int) -> Iterator[Samples]:
        for number in range(count):
            yield Samples.of(DRIVE[1][::5], unit="uT", time=DRIVE[0][::5] + 600.0 * number)

    sizes = []
    for count in (1, 1, 4):  # the first fills caches
        tracemalloc.start()
        watch = Watch(Source(Listed(blocks(count)), Stuckless()))
        watch.run()
        sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert sizes[2] < sizes[1] + 50_000


class Stuckless(Stuck):
    """A clock that goes as the readings do."""

    def of(self, times: Floats) -> Floats:
        return times
