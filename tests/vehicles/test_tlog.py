"""Telemetry logs, written here by pymavlink: what is certain of their readings, and what is removed them."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

from flinders import simulate
from flinders.apps.vehicles.readers import tlog
from flinders.apps.vehicles.readers.tlog import begins_with_packet, open_tlog
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as Parameters
from flinders.errors import InputError, MissingExtra, NoMagnetometer, UnreadableInput
from flinders.geometry import quaternions
from flinders.readers._source import File

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.readers import Instrument, Log

pymavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")

QUIET = {
    "COMPASS_OFS_X": -97.5, "COMPASS_OFS_Y": 118.0, "COMPASS_OFS_Z": 213.25,
    "COMPASS_DIA_X": 0.9957, "COMPASS_DIA_Y": 1.0081, "COMPASS_DIA_Z": 1.0027,
    "COMPASS_ODI_X": 0.0183, "COMPASS_ODI_Y": -0.0027, "COMPASS_ODI_Z": -0.0042, "COMPASS_SCALE": 1.1,
}  # fmt: skip


def all_of(instrument: Instrument, column: str = "field") -> Floats:
    return np.concatenate([getattr(block, column) for block in instrument.columns(False)])


class Heard:
    """A telemetry log in the making, by pymavlink."""

    def __init__(self, system: int = 1) -> None:
        self.content = b""
        self.at = datetime(2026, 3, 1, 12, tzinfo=UTC).timestamp()
        self.sender = pymavlink.MAVLink(None, srcSystem=system, srcComponent=1)

    def add(self, message: Any, seconds: float = 0.0, *, first_version: bool = False) -> None:  # noqa: ANN401 - of a generated class
        packed = message.pack(self.sender, force_mavlink1=first_version)
        self.at += seconds
        self.content += struct.pack(">Q", round(self.at * 1e6)) + packed


def telemetry(values: dict[str, float], *, first_version: bool = False, autopilot: int = 3) -> tuple[Heard, Floats]:
    log = Heard()
    send = log.sender
    log.add(send.heartbeat_encode(6, 8, 0, 0, 0), first_version=first_version)
    log.add(send.heartbeat_encode(2, autopilot, 0, 0, 0), first_version=first_version)
    for name, value in values.items():
        log.add(send.param_value_encode(name.encode(), value, 9, len(values), 0), first_version=first_version)
    log.add(send.gps_raw_int_encode(0, 3, 473977418, 85455938, 488000, 0, 0, 0, 0, 9), first_version=first_version)
    raw = 480 * simulate.uniform_directions(np.random.default_rng(5), 200)
    for step, reading in enumerate(raw):
        mag = np.trunc(Parameters.read(values).apply(reading)).astype(int).tolist()
        log.add(send.sys_status_encode(0, 0, 0, 0, 12000, 10 * step, 90, 0, 0, 0, 0, 0, 0), first_version=first_version)
        log.add(send.raw_imu_encode(200_000 * step, 0, 0, -1000, step, 0, 0, *mag), 0.2, first_version=first_version)
        log.add(send.scaled_imu2_encode(200 * step, 0, 0, -1000, 0, 0, 0, *(int(v) for v in reading)),
                first_version=first_version)  # fmt: skip
        log.add(send.scaled_imu3_encode(200 * step, 0, 0, 0, 0, 0, 0, 0, 0, 0), first_version=first_version)
    return log, raw


def heard(content: bytes, folder: Path) -> Log:
    path = folder / "flight.tlog"
    path.write_bytes(content)
    return open_tlog(File("flight.tlog", path, len(content)))


@pytest.mark.parametrize("first_version", [True, False])
def test_telemetry_of_ardupilot_is_un_applied_with_the_parameters_it_holds(first_version: bool, tmp_path: Path) -> None:
    log, raw = telemetry(QUIET, first_version=first_version)
    assert begins_with_packet(log.content[: 1 << 16])
    found = heard(log.content, tmp_path)
    first, second = found.instruments
    assert (first.name, second.name, first.readings) == ("RAW_IMU", "SCALED_IMU2", 200)
    assert np.abs(10 * all_of(first) - raw).max() < 1.0
    npt.assert_allclose(10 * all_of(second), np.trunc(raw), atol=1e-9)
    npt.assert_allclose(all_of(first, "time"), 0.2 * np.arange(200), atol=1e-9)
    npt.assert_allclose(all_of(first, "rate")[:, 0], 1e-3 * np.arange(200), atol=1e-9)
    npt.assert_allclose(all_of(first, "acceleration")[:, 2], -1000)
    npt.assert_allclose(all_of(first, "current")[:-1], 0.1 * np.arange(199) + 0.1, atol=1e-6)
    assert first.stored is not None
    assert_sentences(first.stored.words)
    assert second.stored is None
    assert [(one.frame, one.autopilot, one.compass) for one in found.instruments] == [
        ("vehicle", "ardupilot", 1), ("vehicle", "ardupilot", 2),
    ]  # fmt: skip
    assert found.position is not None
    assert found.position.altitude_m == 488.0
    assert found.start_time == datetime(2026, 3, 1, 12, 0, 0, 200_000, tzinfo=UTC)


@pytest.mark.parametrize("by", ["satellites", "estimate"])
def test_velocity_over_ground_goes_by_the_clock_of_the_readings(by: str, tmp_path: Path) -> None:
    """GPS_RAW_INT has cm/s and hundredths of a degree, GLOBAL_POSITION_INT cm/s; the ground station hears both late."""
    log = Heard()
    send, unknown = log.sender, 0xFFFF
    for step in range(50):
        log.at += 0.2
        log.add(send.raw_imu_encode(200_000 * step, 0, 0, -1000, 0, 0, 0, 200, 10, 400))
        speed, course = (1000, 100 * step) if by == "satellites" else (unknown, unknown)
        place = (473977418, 85455938, 488000)
        log.add(send.gps_raw_int_encode(0, 3, *place, 0, 0, speed, course, 9))
        log.add(send.gps_raw_int_encode(0, 1, *place, 0, 0, 7, 7, 9))
        log.add(send.global_position_int_encode(200 * step, *place, 0, 300, -400, 0, 0))
    (one,) = heard(log.content, tmp_path).instruments
    assert one.velocity is not None
    npt.assert_allclose(one.velocity.time, 0.2 * np.arange(50), atol=1e-5)
    along = np.deg2rad(np.arange(50.0))
    expected = 10.0 * np.column_stack([np.cos(along), np.sin(along)]) if by == "satellites" else [[3.0, -4.0]] * 50
    npt.assert_allclose(one.velocity.values, expected, atol=1e-6)


def test_telemetry_says_what_is_certain_of_it(tmp_path: Path) -> None:
    without = heard(telemetry({})[0].content, tmp_path).instruments[0]
    assert without.stored is None
    assert_sentences(without.notes)
    other = heard(telemetry({}, autopilot=12)[0].content, tmp_path).instruments[0]
    assert_sentences(other.notes)
    driven = heard(telemetry(QUIET | {"COMPASS_MOT_X": 3.0, "COMPASS_MOTCT": 1.0})[0].content, tmp_path).instruments[0]
    assert_sentences(driven.notes)
    assert "COMPASS_MOT" not in driven.describe()


@pytest.mark.parametrize(("by", "kind"), [("current", 2.0), ("throttle", 1.0)])
def test_motor_compensation_is_taken_off_by_what_was_sent(by: str, kind: float, tmp_path: Path) -> None:
    """Whole mG, cut after it: 1 mG through the matrix; currents in 10 mA, throttles in per cent: 0.2 mG more."""
    values = QUIET | {"COMPASS_MOT_X": 20.0, "COMPASS_MOT_Y": -5.0, "COMPASS_MOT_Z": 7.0, "COMPASS_MOTCT": kind}
    log = Heard()
    send = log.sender
    log.add(send.heartbeat_encode(2, 3, 0, 0, 0))
    for name, value in values.items():
        log.add(send.param_value_encode(name.encode(), value, 9, len(values), 0))
    raw = 480 * simulate.uniform_directions(np.random.default_rng(6), 200)
    for step, reading in enumerate(raw):
        drive = step % 100 / 100 if by == "throttle" else 10.0 + 5.0 * np.sin(0.1 * step)
        if by == "throttle":
            log.add(send.vfr_hud_encode(0, 0, 0, step % 100, 0, 0))
        else:
            log.add(send.sys_status_encode(0, 0, 0, 0, 12000, round(100 * drive), 90, 0, 0, 0, 0, 0, 0))
        mag = np.trunc(Parameters.read(values).apply(reading, drive)).astype(int).tolist()
        log.add(send.raw_imu_encode(200_000 * step, 0, 0, -1000, step, 0, 0, *mag))
        log.at += 0.2
    (found,) = heard(log.content, tmp_path).instruments
    assert np.abs(10 * all_of(found) - raw).max() < 1.5
    assert_sentences(found.notes)
    assert "; COMPASS_MOT 20, -5, 7 mG" in found.describe()
    assert np.abs(10 * all_of(found) - raw).mean() < 0.6


def test_readings_whose_motor_compensation_is_not_known_are_left_out_and_counted(tmp_path: Path) -> None:
    values = QUIET | {"COMPASS_MOT_X": 20.0, "COMPASS_MOTCT": 2.0}
    log, _ = telemetry(values)
    late = Heard()
    late.at = log.at + 10.0
    for step in range(5):
        late.add(late.sender.raw_imu_encode(60_000_000 + 200_000 * step, 0, 0, 0, 0, 0, 0, 100, 0, -400), 0.2)
    found = heard(log.content + late.content, tmp_path).instruments[0]
    (block,) = found.columns(False)
    assert [(one.reason, one.rows, one.lines[0]) for one in block.skipped] == [("not finite", 6, 200)]
    assert len(block) == 199


EARTH = np.array([210.0, 41.0, -580.0])
"""North, east, down, in mG."""


def flown(kind: str, *, compass: str = "RAW_IMU", autopilot: int = 3, unix: bool = False) -> Heard:
    """Telemetry of a vehicle that turns in the field of `EARTH`, with its attitude 20 ms after each reading."""
    log = Heard()
    send = log.sender
    log.add(send.heartbeat_encode(2, autopilot, 0, 0, 0))
    for name, value in {"COMPASS_OFS_X": -97.0, "COMPASS_OFS_Y": 0.0}.items() if autopilot == 3 else ():
        log.add(send.param_value_encode(name.encode(), value, 9, 2, 0))
    since = 1_700_000_000_000_000 if unix else 0

    def angles(seconds: float) -> Floats:
        return np.array([2.0 * np.sin(seconds), 0.7 * np.cos(0.7 * seconds), 0.5 * seconds])

    for step in range(100):
        micros = 1_000_000 + 100_000 * step
        body = quaternions.rotate_vectors(quaternions.inverse(quaternions.from_angles(angles(1e-6 * micros))), EARTH)
        if compass == "HIGHRES_IMU":
            gauss = (1e-3 * body).tolist()
            packet = send.highres_imu_encode(since + micros, 0, 0, -9.8, 0, 0, 0.1, *gauss, 0, 0, 0, 25.0, 0x1FFF)
            log.add(packet, 0.08)
            log.add(send.highres_imu_encode(since + micros + 9, 0, 0, -9.8, 0, 0, 0, *gauss, 0, 0, 0, 25.0, 0x3F))
        else:
            held = np.trunc(body + ([-97.0, 0, 0] if autopilot == 3 else 0)).astype(int).tolist()
            log.add(send.raw_imu_encode(since + micros, 0, 0, -1000, 0, 0, 0, *held), 0.08)
        now = angles(1e-6 * micros + 0.02)
        if kind == "ATTITUDE":
            log.add(send.attitude_encode(micros // 1000 + 20, *now, 0, 0, 0), 0.02)
        else:
            quaternion = quaternions.from_angles(now).tolist()
            log.add(send.attitude_quaternion_encode(micros // 1000 + 20, *quaternion, 0, 0, 0), 0.02)
    return log


@pytest.mark.parametrize("kind", ["ATTITUDE", "ATTITUDE_QUATERNION"])
@pytest.mark.parametrize("unix", [False, True])
def test_readings_turned_by_the_attitude_are_the_field_of_the_site(kind: str, unix: bool, tmp_path: Path) -> None:
    """Also where the two count time from different beginnings: then by the clock of the ground station."""
    (found,) = heard(flown(kind, unix=unix).content, tmp_path).instruments
    turned = 10 * quaternions.rotate_vectors(all_of(found, "attitude"), all_of(found))
    known = np.isfinite(turned[:, 0])
    assert known.sum() >= 98
    assert np.abs(turned[known] - EARTH).max() < 9.0
    assert np.abs(turned[known] - EARTH).mean() < 3.0


def test_highres_imu_of_px4_is_an_instrument_of_its_own_in_gauss_without_its_repeats(tmp_path: Path) -> None:
    (found,) = heard(flown("ATTITUDE", compass="HIGHRES_IMU", autopilot=12).content, tmp_path).instruments
    assert (found.name, found.unit.name, found.frame, found.readings) == ("HIGHRES_IMU", "G", "vehicle", 100)
    assert found.stored is None
    turned = quaternions.rotate_vectors(all_of(found, "attitude"), all_of(found))[1:]
    npt.assert_allclose(turned, np.tile(EARTH / 10, (99, 1)), atol=0.4)
    npt.assert_allclose(all_of(found, "acceleration"), [[0, 0, -9.8]] * 100, atol=1e-6)
    npt.assert_allclose(all_of(found, "rate")[:, 2], 0.1, atol=1e-7)
    npt.assert_allclose(all_of(found, "temperature"), 25.0)
    assert_sentences(found.notes)
    assert not any("whole mG" in note for note in found.notes)


def test_highres_imu_of_ardupilot_is_un_applied_and_of_others_nothing_is_claimed(tmp_path: Path) -> None:
    (ours,) = heard(flown("ATTITUDE", compass="HIGHRES_IMU").content, tmp_path).instruments
    known = all_of(ours, "attitude")[1:]
    body = quaternions.rotate_vectors(quaternions.inverse(known), EARTH)
    npt.assert_allclose(10 * all_of(ours)[1:], body + np.array([97.0, 0, 0]), atol=4.0)
    (other,) = heard(flown("ATTITUDE", compass="HIGHRES_IMU", autopilot=5).content, tmp_path).instruments
    (block,) = other.columns(False)
    assert (other.frame, block.attitude) == ("sensor", None)
    assert_sentences(other.notes)


def test_two_vehicles_in_one_telemetry_log_have_compasses_and_parameters_of_their_own(tmp_path: Path) -> None:
    log, raw = telemetry(QUIET)
    other = Heard(system=7)
    for _ in range(3):
        other.add(other.sender.scaled_imu_encode(5, 0, 0, 0, 0, 0, 0, 100, 200, 300), 0.1)
    found = heard(log.content + other.content, tmp_path)
    assert [one.name for one in found.instruments] == [
        "RAW_IMU (system 1)", "SCALED_IMU2 (system 1)", "SCALED_IMU (system 7)",
    ]  # fmt: skip
    npt.assert_allclose(10 * all_of(found.instruments[2]), [[100, 200, 300]] * 3)
    assert np.abs(10 * all_of(found.instruments[0]) - raw).max() < 1.0


def test_telemetry_with_broken_bytes_goes_on_behind_them(tmp_path: Path) -> None:
    content = telemetry(QUIET)[0].content
    found = heard(content[:5000] + b"\x00\x05 lost \xfe" + content[5000:], tmp_path)
    assert 198 <= len(all_of(found.instruments[0])) <= 200
    assert_sentences(found.notes)
    hit = bytearray(content)
    hit[content.index(b"COMPASS_SCALE")] = 0x51
    assert_sentences(heard(bytes(hit), tmp_path).notes[0])


@pytest.mark.parametrize("seed", daily(range(30), 3))
def test_telemetry_that_was_cut_and_hit_anywhere_is_read_or_refused(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(telemetry(QUIET)[0].content[:9000])
    del content[rng.integers(1, len(content)) :]
    for place in rng.integers(0, len(content), rng.choice([0, 1, 20, 400])):
        content[place] = rng.integers(256)
    try:
        found = heard(bytes(content), tmp_path)
    except InputError:
        return
    assert all(np.isfinite(all_of(one)).all() for one in found.instruments)


def test_what_is_no_telemetry_is_refused(tmp_path: Path) -> None:
    assert not begins_with_packet(b"mx,my,mz\n1,2,3\n" * 20)
    assert not begins_with_packet(bytes(range(256)))
    with assert_raises(UnreadableInput):
        heard(b"\x00\x05 nothing of it", tmp_path)
    silent = Heard()
    silent.add(silent.sender.heartbeat_encode(2, 3, 0, 0, 0))
    with assert_raises(NoMagnetometer):
        heard(silent.content, tmp_path)


def test_the_messages_that_are_asked_for_are_those_of_the_dialect() -> None:
    for number, (name, _) in tlog.COMPASS_MESSAGES.items():
        assert pymavlink.mavlink_map[number].msgname == name
    others = {"HEARTBEAT", "SYS_STATUS", "PARAM_VALUE", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ATTITUDE",
              "ATTITUDE_QUATERNION", "VFR_HUD"}  # fmt: skip
    assert others <= {pymavlink.mavlink_map[number].msgname for number in tlog.WANTED}


def test_without_pymavlink_the_command_that_installs_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tlog, "DIALECT", "pymavlink_that_is_not_there")
    with assert_raises(MissingExtra):
        heard(telemetry(QUIET)[0].content, tmp_path)
