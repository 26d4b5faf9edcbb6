"""Telemetry logs, written here by pymavlink: what is certain of their readings, and what is taken off them."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest

from flinders import simulate
from flinders.conventions.ardupilot import Parameters
from flinders.errors import InputError, MissingExtra, NoMagnetometer, UnreadableInput
from flinders.readers import tlog
from flinders.readers._source import File
from flinders.readers.tlog import open_tlog, sniff_tlog

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
    raw = 480 * simulate.uniform(np.random.default_rng(5), 200)
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
    assert sniff_tlog(log.content[: 1 << 16])
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
    assert first.stored.words.startswith("COMPASS_OFS -97.5, 118, 213.25 mG")
    assert second.stored is None
    assert [(one.frame, one.autopilot, one.compass) for one in found.instruments] == [
        ("vehicle", "ardupilot", 1), ("vehicle", "ardupilot", 2),
    ]  # fmt: skip
    assert found.position is not None
    assert found.position.altitude_m == 488.0
    assert found.begun == datetime(2026, 3, 1, 12, 0, 0, 200_000, tzinfo=UTC)


def test_telemetry_says_what_is_certain_of_it(tmp_path: Path) -> None:
    without = heard(telemetry({})[0].content, tmp_path).instruments[0]
    assert without.stored is None
    assert any(
        "readings are corrected ones, and the log does not hold the parameters" in note for note in without.notes
    )
    other = heard(telemetry({}, autopilot=12)[0].content, tmp_path).instruments[0]
    assert any("is not known for this autopilot" in note for note in other.notes)
    driven = heard(telemetry(QUIET | {"COMPASS_MOT_X": 3.0, "COMPASS_MOTCT": 2.0})[0].content, tmp_path).instruments[0]
    assert any("COMPASS_MOT) stays on the readings" in note for note in driven.notes)


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
    assert any("belong to no packet: skipped" in note for note in found.notes)
    hit = bytearray(content)
    hit[content.index(b"COMPASS_SCALE")] = 0x51
    assert heard(bytes(hit), tmp_path).notes[0] == "1 packet with a wrong check sum left out"


@pytest.mark.parametrize("seed", range(30))
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
    assert not sniff_tlog(b"mx,my,mz\n1,2,3\n" * 20)
    assert not sniff_tlog(bytes(range(256)))
    with pytest.raises(UnreadableInput, match="holds no MAVLink packets"):
        heard(b"\x00\x05 nothing of it", tmp_path)
    silent = Heard()
    silent.add(silent.sender.heartbeat_encode(2, 3, 0, 0, 0))
    with pytest.raises(NoMagnetometer, match="without readings of a compass"):
        heard(silent.content, tmp_path)


def test_the_messages_that_are_asked_for_are_those_of_the_dialect() -> None:
    for number, (name, _) in tlog.COMPASS_MESSAGES.items():
        assert pymavlink.mavlink_map[number].msgname == name
    assert {"HEARTBEAT", "SYS_STATUS", "PARAM_VALUE", "GPS_RAW_INT", "GLOBAL_POSITION_INT"} <= {
        pymavlink.mavlink_map[number].msgname for number in tlog.WANTED
    }


def test_without_pymavlink_the_command_that_installs_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tlog, "DIALECT", "pymavlink_that_is_not_there")
    with pytest.raises(MissingExtra, match=r"pip install 'flinders\[mavlink\]'"):
        heard(telemetry(QUIET)[0].content, tmp_path)
