"""ArduPilot: its formula by hand, its mountings, its logs; a log written here comes back as it was measured."""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences

from flinders import simulate
from flinders.apps.vehicles.readers import dataflash
from flinders.apps.vehicles.readers import dataflash_format as _fmt
from flinders.apps.vehicles.readers.dataflash import READERS, open_dataflash
from flinders.apps.vehicles.targets import ardupilot
from flinders.apps.vehicles.targets.ardupilot import BY_CURRENT, ORIENTATIONS
from flinders.apps.vehicles.targets.ardupilot import ArduPilotParameters as Parameters
from flinders.apps.vehicles.targets.autopilot import parse
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import (
    ArrayError,
    InputError,
    NoMagnetometer,
    NotExportable,
    UnitError,
    UnreadableInput,
    UsageError,
)
from flinders.geometry import quaternions
from flinders.readers._source import File, find, on_disk
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.readers import Instrument, Log

MICROTESLA = Unit.of("uT")


def calibration(matrix: object, offset: object = (0, 0, 0), strength: float = 50.0, **more: object) -> Calibration:
    return Calibration(np.array(matrix, float), np.array(offset, float), strength, raw=MICROTESLA, **more)  # type: ignore[arg-type]


def turned(orientation: int) -> Floats:
    """The rotation of a COMPASS_ORIENT."""
    return euler(*ORIENTATIONS[orientation][1:])


# the formula


def vehicle(values: dict[str, float], reading: Iterable[float], drive: float = 0.0) -> list[float]:
    """The formula of `correct_field` one line after the other, from bare parameters of the first compass."""
    x, y, z = (value + values[f"COMPASS_OFS_{axis}"] for value, axis in zip(reading, "XYZ", strict=True))
    scale = values["COMPASS_SCALE"]
    if 1 / 1.5 <= scale <= 1.5:
        x, y, z = x * scale, y * scale, z * scale
    dx, dy, dz = (values[f"COMPASS_DIA_{axis}"] for axis in "XYZ")
    if dx == dy == dz == 0:
        dx = dy = dz = 1.0
    xy, xz, yz = (values[f"COMPASS_ODI_{axis}"] for axis in "XYZ")
    turned = [dx * x + xy * y + xz * z, xy * x + dy * y + yz * z, xz * x + yz * y + dz * z]
    on = values.get("COMPASS_MOTCT", 0) in (1, 2)
    return [one + on * drive * values.get(f"COMPASS_MOT_{axis}", 0.0) for one, axis in zip(turned, "XYZ", strict=True)]


EXAMPLE = parse("""
COMPASS_OFS_X,-97.5
COMPASS_OFS_Y,118
COMPASS_OFS_Z,213.25
COMPASS_DIA_X,0.9957
COMPASS_DIA_Y,1.0081
COMPASS_DIA_Z,1.0027
COMPASS_ODI_X,0.0183
COMPASS_ODI_Y,-0.0027
COMPASS_ODI_Z,-0.0042
COMPASS_SCALE,1.1
COMPASS_MOT_X,3.5
COMPASS_MOT_Y,-1
COMPASS_MOT_Z,0.25
COMPASS_MOTCT,2
""")


@pytest.mark.parametrize("change", [{}, {"COMPASS_SCALE": 0.0}, {"COMPASS_SCALE": 1.6}, {"COMPASS_MOTCT": 0.0},
                                    {f"COMPASS_DIA_{axis}": 0.0 for axis in "XYZ"}])  # fmt: skip
def test_readings_are_corrected_line_by_line_as_the_vehicle_does(change: dict[str, float]) -> None:
    values = EXAMPLE | change
    found = Parameters.read(values)
    for reading in simulate.uniform_directions(np.random.default_rng(1), 50) * 520:
        npt.assert_allclose(found.apply(reading, 12.5), vehicle(values, reading, 12.5), atol=1e-9)
        npt.assert_allclose(found.unapply(vehicle(values, reading, 12.5), 12.5), reading, atol=1e-9)


def test_a_formula_worked_by_hand() -> None:
    """(100 − 20) · 1.25 = 100 on x; 100 · 1 + 0.1 · 0 on x and 0.1 · 100 on y; and 3 mG/A · 2 A on x."""
    found = Parameters(
        offset=np.array([-20.0, 0, 0]),
        off_diagonal=np.array([0.1, 0, 0]),
        scale=1.25,
        motor=np.array([3.0, 0, 0]),
        motor_by=BY_CURRENT,
    )
    npt.assert_allclose(found.apply([100.0, 0, 0], 2.0), [106.0, 10.0, 0.0])


@pytest.mark.parametrize("seed", range(10))
def test_what_a_vehicle_does_with_what_is_written_is_the_calibration_to_a_float32(seed: int) -> None:
    sensor = simulate.Sensor.random(np.random.default_rng(seed))
    given = Calibration.from_ellipsoid(sensor.offset, sensor.matrix @ sensor.matrix.T * 45, raw=MICROTESLA)
    written = dict(Parameters.of(given).rows())
    raw = given.unapply(given.field_strength * simulate.uniform_directions(np.random.default_rng(seed), 100))
    for reading, expected in zip(10 * raw, 10 * given.apply(raw), strict=True):
        npt.assert_allclose(vehicle(written, reading), expected, atol=1e-3)
    held = Parameters.of(given).as_float32()
    assert dict(held.rows()) == written
    npt.assert_allclose(held.to_calibration(given.field_strength).apply(raw), given.apply(raw), atol=1e-4)


@pytest.mark.parametrize("orientation", [2, 12, 17, 38, 42])
def test_a_calibration_in_the_axes_of_the_sensor_is_turned_with_its_mounting(orientation: int) -> None:
    """Turned and then corrected by the vehicle is corrected by the calibration and then turned."""
    given = calibration([[1.1, 0.05, 0.02], [0.05, 0.9, 0], [0.02, 0, 1.02]], [12, -30, 7])
    turn = turned(orientation)
    found = Parameters.of(given, mounting=turn)
    raw = 10 * given.unapply(50 * simulate.uniform_directions(np.random.default_rng(2), 50))
    npt.assert_allclose(found.apply(raw @ turn.T), 10 * given.apply(raw / 10) @ turn.T, atol=1e-9)


def test_names_in_both_schemes() -> None:
    given = calibration(np.diag([1.1, 1.0, 0.9]), [10, 0, 0])
    found = replace(Parameters.of(given, compass=3), motor=np.array([1.0, 2.0, 3.0]), motor_by=BY_CURRENT)
    classic = dict(found.rows())
    numbered = {ardupilot.spellings(name)[1]: value for name, value in classic.items()}
    assert list(classic) == [
        "COMPASS_OFS3_X", "COMPASS_OFS3_Y", "COMPASS_OFS3_Z", "COMPASS_DIA3_X", "COMPASS_DIA3_Y", "COMPASS_DIA3_Z",
        "COMPASS_ODI3_X", "COMPASS_ODI3_Y", "COMPASS_ODI3_Z", "COMPASS_SCALE3",
        "COMPASS_MOT3_X", "COMPASS_MOT3_Y", "COMPASS_MOT3_Z", "COMPASS_MOTCT",
    ]  # fmt: skip
    assert classic["COMPASS_OFS3_X"] == -100.0
    assert numbered["COMPASS3_OFS_X"] == -100.0
    for values in (classic, numbered):
        assert ardupilot.compasses(values) == (3,)
        npt.assert_allclose(Parameters.read(values, 3).apply([1.0, 2.0, 3.0], 4.0), found.apply([1.0, 2.0, 3.0], 4.0))
    assert Parameters.read(classic, 1).is_identity


def test_values_that_are_not_finite_count_as_not_there() -> None:
    assert Parameters.read({"COMPASS_OFS_X": np.nan, "COMPASS_DIA_X": np.inf, "COMPASS_ORIENT": np.nan}).is_identity


# what does not fit


def test_offsets_longer_than_a_vehicle_arms_with_are_refused() -> None:
    Parameters.of(calibration(np.eye(3), [179.9, 0, 0]))
    with assert_raises(NotExportable, beyond=("COMPASS_OFS2",)) as caught:
        Parameters.of(calibration(np.eye(3), [180, 51, 0]), compass=2)
    assert caught.value.beyond == ("COMPASS_OFS2",)


@pytest.mark.parametrize(
    ("matrix", "name"),
    [
        (np.diag([2.6, 0.1, 0.3]), "COMPASS_DIA_Y"),
        (np.array([[1, 1.2, 0], [1.2, 1, 0], [0, 0, 1]]), "COMPASS_ODI_X"),
        (1.51 * np.eye(3), "COMPASS_SCALE"),
        (0.66 * np.eye(3), "COMPASS_SCALE"),
        (np.diag([1.0, 1.0, -2.5]), "COMPASS_SCALE"),
    ],
)
def test_values_that_the_vehicle_does_not_take_are_named(matrix: Floats, name: str) -> None:
    with pytest.raises(NotExportable, match=name) as caught:
        Parameters.of(calibration(matrix))
    assert name in caught.value.beyond
    wanted = caught.value.evidence["wanted"]
    assert isinstance(wanted, dict)
    assert name in wanted


def test_counts_and_compasses_that_there_are_not() -> None:
    with pytest.raises(UnitError, match="unit='mG'"):
        Parameters.of(Calibration(np.eye(3), np.zeros(3), 500.0))
    with pytest.raises(UsageError, match="compass 4"):
        Parameters.of(calibration(np.eye(3)), compass=4)
    with pytest.raises(UsageError, match="compass 4"):
        Parameters.read({}, 4)


def test_what_flattens_cannot_be_undone() -> None:
    flat = Parameters(diagonal=np.array([1.0, 1.0, 0.0]))
    with assert_raises(ArrayError):
        flat.unapply([1.0, 2.0, 3.0])


# mountings

ORIENTED = {
    1: lambda x, y, z: ((x - y) / 2**0.5, (x + y) / 2**0.5, z),
    2: lambda x, y, z: (-y, x, z),
    4: lambda x, y, z: (-x, -y, z),
    8: lambda x, y, z: (x, -y, -z),
    12: lambda x, y, z: (-x, y, -z),
    16: lambda x, y, z: (x, -z, y),
    20: lambda x, y, z: (x, z, -y),
    24: lambda x, y, z: (z, y, -x),
    25: lambda x, y, z: (-z, y, x),
    26: lambda x, y, z: (-y, -x, -z),
    27: lambda x, y, z: (y, x, -z),
    34: lambda x, y, z: (z, -y, x),
    36: lambda x, y, z: (z, -x, -y),
    37: lambda x, y, z: (-z, -x, y),
    38: lambda x, y, z: (
        0.143038972 * x + 0.368776487 * y - 0.918446381 * z,
        -0.332132778 * x - 0.856289421 * y - 0.395545503 * z,
        -0.932323801 * x + 0.361624570 * y,
    ),
    39: lambda x, y, z: ((x - z) / 2**0.5, y, (x + z) / 2**0.5),
    43: lambda x, y, z: (x, (y + z) / 2**0.5, (z - y) / 2**0.5),
}  # fmt: skip
"""Where each axis goes, as `Vector3::rotate` of ArduPilot has it for these numbers."""


@pytest.mark.parametrize("orientation", ORIENTED)
def test_mountings_turn_vectors_as_the_vehicle_does(orientation: int) -> None:
    vector = np.array([1.0, 2.0, 3.0])
    npt.assert_allclose(turned(orientation) @ vector, ORIENTED[orientation](*vector), atol=2e-8)


# parameter files


def test_parameter_files_of_three_ground_stations() -> None:
    told = {"COMPASS_OFS_X": -12.5, "COMPASS_ORIENT": 6.0}
    assert parse("\ufeffCOMPASS_OFS_X,-12.5\r\nCOMPASS_ORIENT,6\r\n") == told
    of_mavproxy = "# MAVProxy\nCOMPASS_OFS_X    -12.500000\nCOMPASS_ORIENT   6\n\n"
    of_qgroundcontrol = (
        "# Vehicle-Id Component-Id Name Value Type\n1\t1\tCOMPASS_OFS_X\t-12.5\t9\n1\t1\tCOMPASS_ORIENT\t6\t4\n"
    )
    assert parse(of_mavproxy) == parse(of_qgroundcontrol) == told


@pytest.mark.parametrize(
    "line", ["COMPASS_OFS_X", "COMPASS_OFS_X,", "COMPASS_OFS_X,nan", "12,5", "offset 3", "x" * 500]
)
def test_a_line_that_is_no_parameter_is_named(line: str) -> None:
    with assert_raises(InputError):
        parse(f"COMPASS_OFS_Y,3\n{line}\n", "my.param")


# logs that are written here


class Written:
    """A DataFlash log in the making."""

    def __init__(self) -> None:
        self.content = b""
        self.formats: dict[str, tuple[int, str]] = {}
        self.describe("FMT", 128, "BBnNZ", "Type,Length,Name,Format,Columns")

    def describe(self, name: str, number: int, letters: str, labels: str) -> None:
        packed = "<BBB" + "".join({"n": "4s", "N": "16s", "Z": "64s", "L": "i", "c": "h", "C": "H", "e": "i", "E": "I",
                                   "M": "B"}.get(letter, letter) for letter in letters)  # fmt: skip
        self.formats[name] = number, packed
        self.add("FMT", number, struct.calcsize(packed), name.encode(), letters.encode(), labels.encode())

    def add(self, name: str, *values: Any) -> None:
        number, packed = self.formats[name]
        self.content += struct.pack(packed, 0xA3, 0x95, number, *values)


NEW_MAG = "TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S"


def flight(values: dict[str, float] = EXAMPLE, *, rows: int = 400) -> tuple[Written, Floats, Floats]:
    """A log of two compasses, an accelerometer and a battery, what the first read in mG, and the times in s."""
    log = Written()
    log.describe("PARM", 129, "QNff", "TimeUS,Name,Value,Default")
    log.describe("MAG", 130, "QBhhhhhhhhhBI", NEW_MAG)
    log.describe("IMU", 131, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz")
    log.describe("BAT", 132, "QBfffff", "TimeUS,Instance,Volt,VoltR,Curr,CurrTot,EnrgTot")
    log.describe("ORGN", 133, "QBLLe", "TimeUS,Type,Lat,Lng,Alt")
    log.describe("GPS", 134, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.describe("MSG", 135, "QZ", "TimeUS,Message")
    log.add("MSG", 0, b"ArduRover V4.5.7 (0123abcd)")
    raw = 480 * simulate.uniform_directions(np.random.default_rng(3), rows)
    times = 10.0 + 0.1 * np.arange(rows)
    for name, value in values.items():
        log.add("PARM", 1, name.encode(), value, 0.0)
    log.add("ORGN", 2, 0, -353622590, 1491658710, 59700)
    log.add("GPS", 9_000_000, 0, 1, 0, 0, 0, 99, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0)
    log.add("GPS", 9_000_000, 0, 3, 86_418_000, 2300, 9, 99, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0)
    for time, reading in zip(times, raw, strict=True):
        micros, amps = int(time * 1e6), time - 10.0
        corrected = np.trunc(vehicle(values, reading, amps)).astype(int)
        offsets = [int(values[f"COMPASS_OFS_{axis}"]) for axis in "XYZ"]
        motor = [int(amps * values[f"COMPASS_MOT_{axis}"]) for axis in "XYZ"]
        log.add("IMU", micros - 20_000, 0, time, 0.0, 0.0, 0.0, 0.0, -9.81, 0, 0, 31.5, 1, 1, 1000, 1000)
        log.add("IMU", micros - 20_000, 1, 77.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, 1, 1, 1000, 1000)
        log.add("BAT", micros - 10_000, 0, 12.0, 12.0, amps, 0.0, 0.0)
        log.add("BAT", micros - 10_000, 1, 12.0, 12.0, 99.0, 0.0, 0.0)
        log.add("MAG", micros, 0, *corrected, *offsets, *motor, 1, micros % 2**32)
        log.add("MAG", micros, 1, *np.trunc(reading).astype(int), 0, 0, 0, 0, 0, 0, 1, micros % 2**32)
    return log, raw, times


def opened(content: bytes, folder: Path, name: str = "flight.bin") -> Log:
    path = folder / name
    path.write_bytes(content)
    return open_dataflash(File(name, path, len(content)))


def all_of(instrument: Instrument, column: str = "field", *, as_logged: bool = False) -> Floats:
    return np.concatenate([getattr(block, column) for block in instrument.columns(as_logged)])


def test_what_the_compass_read_comes_back_to_the_whole_mg_that_was_logged(tmp_path: Path) -> None:
    """m, MOT x and OFS are cut to whole mG; the parameter gives OFS back, the rest stays: 2 mG through I⁻¹/SCALE."""
    log, raw, times = flight()
    found = opened(log.content, tmp_path)
    first, second = found.instruments
    assert (first.name, second.name, first.unit.name) == ("MAG 0", "MAG 1", "mG")
    off = 10 * all_of(first) - raw
    assert np.abs(off).max() < 1.9
    assert np.abs(off).max() > 0.5
    npt.assert_allclose(10 * all_of(second), np.trunc(raw), atol=1e-9)
    npt.assert_allclose(all_of(first, "time"), times, atol=1e-6)
    assert second.stored is None
    assert_sentences(second.notes)
    assert first.stored is not None
    assert first.stored.calibration is not None
    npt.assert_allclose(first.stored.calibration.offset, [9.75, -11.8, -21.325])
    assert_sentences(first.stored.words)
    assert_sentences(first.stored.words)
    assert_sentences(first.notes)
    corrected = [vehicle(EXAMPLE, reading, time - 10) for reading, time in zip(raw, times, strict=True)]
    npt.assert_array_equal(10 * all_of(first, as_logged=True).round(9), np.trunc(corrected))


def test_what_stands_beside_a_reading_is_of_its_time_and_of_the_first_sensor(tmp_path: Path) -> None:
    log, _, times = flight()
    first = opened(log.content, tmp_path).instruments[0]
    until_next = 0.5 * np.diff(times)  # a rate is the mean to the next reading: of a steady rise, that half-way
    until_next[-1] = 0.0  # the gyro was not recorded up to the last one
    npt.assert_allclose(all_of(first, "rate")[:-1, 0], times[:-1] + 0.02 + until_next, atol=1e-5)
    npt.assert_allclose(all_of(first, "acceleration")[:-1], [[0, 0, -9.81]] * (len(times) - 1), rtol=1e-6)
    npt.assert_allclose(all_of(first, "temperature")[:-1], 31.5)
    npt.assert_allclose(all_of(first, "current")[:-1], times[:-1] - 9.99, atol=1e-5)


EARTH = np.array([210.0, 41.0, -580.0])
"""North, east, down, in mG, of a site in the south."""


def turning(rows: int = 100) -> tuple[Floats, Floats]:
    """Times in s, ten a second, and attitudes of a vehicle that rolls, pitches and turns all the while."""
    times = 10.0 + 0.1 * np.arange(rows)
    angles = np.column_stack([2.0 * np.sin(times), 0.7 * np.cos(0.7 * times), 0.5 * times])
    return times, quaternions.from_angles(angles)


def flown(
    *messages: str, values: dict[str, float] = EXAMPLE, primary: Sequence[int] = ()
) -> tuple[Written, Floats, Floats]:
    """A log in which a vehicle turns in the field of `EARTH`, with its attitude in some messages, 5 ms off its compass.

    The second core of an estimator is wrong by 40°, unless it is the `primary` at the time; EKF 2 is wrong by 20°.
    """
    log = Written()
    log.describe("PARM", 129, "QNff", "TimeUS,Name,Value,Default")
    log.describe("MAG", 130, "QBhhhhhhhhhBI", NEW_MAG)
    log.describe("XKQ", 140, "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4")
    log.describe("NKQ", 141, "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4")
    log.describe("XKF4", 142, "QBb", "TimeUS,C,PI")
    log.describe("ATT", 143, "QcccccCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Spare,DesYaw,Yaw,ErrYaw,AEKF")
    log.describe("AHR2", 144, "QccCfLLffff", "TimeUS,Roll,Pitch,Yaw,Alt,Lat,Lng,Q1,Q2,Q3,Q4")
    for name, value in values.items():
        log.add("PARM", 1, name.encode(), value, 0.0)
    times, attitudes = turning()
    wrong = quaternions.from_angles([[0.0, 0.0, np.deg2rad(40.0)], [0.0, 0.0, np.deg2rad(20.0)]])
    raw = quaternions.rotate_vectors(quaternions.inverse(attitudes), EARTH)
    for place, (time, reading) in enumerate(zip(times, raw, strict=True)):
        micros = round(1e6 * time)
        at = time - 5e-3
        early = round(1e6 * at)
        angles = np.array([2.0 * np.sin(at), 0.7 * np.cos(0.7 * at), 0.5 * at])
        attitude = quaternions.from_angles(angles)
        used = primary[place] if len(primary) else 0
        if len(primary):
            log.add("XKF4", early, 0, used)
        for core in (0, 1):
            if "XKQ" in messages:
                told = attitude if core == used else quaternions.product(wrong[0], attitude)
                log.add("XKQ", early, core, *told)
            if "NKQ" in messages:
                log.add("NKQ", early, core, *quaternions.product(wrong[1], attitude))
        roll, pitch, yaw = np.rad2deg(angles)
        rounded = [round(100 * one) for one in ((roll + 180) % 360 - 180, pitch, yaw % 360)]
        if "ATT" in messages:
            log.add("ATT", early, 0, rounded[0], 0, rounded[1], 0, 0, rounded[2], 0, 0)
        if "AHR2" in messages:
            log.add("AHR2", early, rounded[0], rounded[1], (rounded[2] + 1500) % 36000, 0.0, 0, 0, 1.0, 0.0, 0.0, 0.0)
        corrected = np.trunc(vehicle(values, reading)).astype(int)
        offsets = [int(values[f"COMPASS_OFS_{axis}"]) for axis in "XYZ"]
        log.add("MAG", micros, 0, *corrected, *offsets, 0, 0, 0, 1, micros % 2**32)
    return log, raw, times


def site(instrument: Instrument, *, as_logged: bool = False) -> Floats:
    """(N, 3) µT: what the compass read, turned into north, east, down, without what has no attitude."""
    found = quaternions.rotate_vectors(all_of(instrument, "attitude"), all_of(instrument, as_logged=as_logged))
    kept: Floats = found[np.isfinite(found[:, 0])]
    return kept


@pytest.mark.parametrize("messages", [("XKQ", "NKQ", "ATT", "AHR2"), ("ATT", "AHR2"), ("ATT",)], ids="+".join)
def test_readings_turned_by_the_attitude_are_the_field_of_the_site(messages: tuple[str, ...], tmp_path: Path) -> None:
    """Whole mG cost 2 mG, and a straight line of 0.1 s between two attitudes 0.6°, which are 6 mG."""
    log, _, _ = flown(*messages)
    (found,) = opened(log.content, tmp_path).instruments
    turned = 10 * site(found)
    assert len(turned) >= 99
    assert np.abs(turned - EARTH).max() < 9.0
    assert np.abs(turned - EARTH).mean() < 2.0
    raw = 10 * all_of(found)
    assert raw.std(axis=0).min() > 100
    (written,) = opened(as_text(log.content).encode(), tmp_path, "flight.log").instruments
    npt.assert_allclose(all_of(written, "attitude"), all_of(found, "attitude"), atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_attitudes_of_a_log_that_was_hit_anywhere_are_attitudes_or_not_known(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(flown("XKQ" if seed % 2 else "ATT")[0].content)
    for place in rng.integers(2000, len(content), 100):
        content[place] = rng.integers(256)
    for instrument in opened(bytes(content), tmp_path).instruments:
        length = np.linalg.norm(all_of(instrument, "attitude"), axis=1)
        npt.assert_allclose(length[np.isfinite(length)], 1.0, atol=1e-12)


def controllers(names: Callable[[int], str], *, instance: bool) -> Written:
    """A flight with four speed controllers, of which each draws one A more than that before it."""
    log, _, times = flight(rows=60)
    for number in range(4):
        if names(number) not in log.formats:
            log.describe(
                names(number), 150 + number, "QBff" if instance else "Qff", f"TimeUS,{'Instance,' * instance}RPM,Curr"
            )
    for time in times:
        for number in range(4):
            log.add(names(number), int(1e6 * time), *([number] if instance else []), 5000.0, number + time)
    return log


@pytest.mark.parametrize("instance", [True, False])
def test_each_motor_has_the_current_that_its_speed_controller_says(instance: bool, tmp_path: Path) -> None:
    log = controllers(lambda number: "ESC" if instance else f"ESC{number + 1}", instance=instance)
    found = all_of(opened(log.content, tmp_path).instruments[0], "currents")
    npt.assert_allclose(found, np.arange(4) + (10.0 + 0.1 * np.arange(60))[:, np.newaxis], atol=1e-4)


def test_outputs_are_throttles_of_the_motors_that_parameters_name(tmp_path: Path) -> None:
    """Motors 1 and 2 are on outputs 2 and 1; output 3 is a servo; before arming nothing goes out."""
    functions = {"SERVO1_FUNCTION": 34.0, "SERVO2_FUNCTION": 33.0, "SERVO3_FUNCTION": 4.0, "MOT_PWM_MIN": 1100.0}
    for values, wanted in ((functions | {"MOT_PWM_MAX": 1900.0}, [0.75, 0.25]), ({}, None)):
        log, _, times = flight(EXAMPLE | values, rows=60)
        log.describe("RCOU", 150, "QHHH", "TimeUS,C1,C2,C3")
        for place, time in enumerate(times):
            log.add("RCOU", int(1e6 * time), *((0, 1000, 1500) if place < 20 else (1300, 1700, 1500)))
        (block,) = opened(log.content, tmp_path).instruments[0].columns(False)
        if wanted is None:
            assert block.throttles is None
            continue
        assert block.throttles is not None
        npt.assert_allclose(block.throttles[20:], [wanted] * 40, atol=1e-9)
        npt.assert_array_equal(np.isnan(block.throttles[:19]), True)


def test_characters_where_numbers_belong_are_no_numbers(tmp_path: Path) -> None:
    log, _, times = flight(rows=20)
    log.describe("CTUN", 150, "QZ", "TimeUS,ThO")
    log.describe("XKQ", 151, "QNffff", "TimeUS,C,Q1,Q2,Q3,Q4")
    log.describe("MAG2", 152, "QZhh", "TimeUS,MagX,MagY,MagZ")
    for time in times:
        log.add("CTUN", int(1e6 * time), b"full")
        log.add("XKQ", int(1e6 * time), b"first", 1.0, 0.0, 0.0, 0.0)
        log.add("MAG2", int(1e6 * time), b"north", 1, 2)
    for content, name in ((log.content, "flight.bin"), (as_text(log.content).encode(), "flight.log")):
        first, *_, last = opened(content, tmp_path, name).instruments
        (block,) = first.columns(False)
        assert (block.throttle, block.attitude) == (None, None)
        assert last.name == "MAG2"
        assert all(len(each) == 0 for each in last.columns(False))


def test_the_estimator_that_the_parameters_name_is_taken(tmp_path: Path) -> None:
    log, _, _ = flown("XKQ", "NKQ", values=EXAMPLE | {"AHRS_EKF_TYPE": 2.0})
    turned = 10 * site(opened(log.content, tmp_path).instruments[0])
    bearing = np.rad2deg(np.arctan2(turned[:, 1], turned[:, 0]) - np.arctan2(EARTH[1], EARTH[0]))
    npt.assert_allclose(bearing, 20.0, atol=2.0)


def test_the_core_that_is_used_is_followed_when_it_changes(tmp_path: Path) -> None:
    log, _, _ = flown("XKQ", primary=[0] * 40 + [1] * 60)
    turned = 10 * site(opened(log.content, tmp_path).instruments[0])
    assert len(turned) >= 99
    assert np.abs(turned - EARTH).max() < 9.0


@pytest.mark.parametrize(
    ("letters", "label", "full"), [("f", "ThO", 1.0), ("f", "ThO", 100.0), ("h", "ThrOut", 1000.0)]
)
def test_a_throttle_is_a_share_whatever_it_was_written_in(
    letters: str, label: str, full: float, tmp_path: Path
) -> None:
    log, _, times = flight(rows=50)
    log.describe("CTUN", 150, f"Q{letters}", f"TimeUS,{label}")
    for place, time in enumerate(times):
        told = full * place / 50
        log.add("CTUN", int(1e6 * time), told if letters == "f" else int(told))
    found = all_of(opened(log.content, tmp_path).instruments[0], "throttle")
    npt.assert_allclose(found, np.arange(50) / 50, atol=1e-6)


def test_a_throttle_backwards_is_not_known_and_one_that_never_moves_is_none(tmp_path: Path) -> None:
    log, _, times = flight(rows=20)
    log.describe("THR", 150, "Qf", "TimeUS,ThrOut")
    for place, time in enumerate(times):
        log.add("THR", int(1e6 * time), -40.0 if place < 10 else 60.0)
    found = all_of(opened(log.content, tmp_path).instruments[0], "throttle")
    npt.assert_allclose(found, [np.nan] * 10 + [0.6] * 10)
    still, _, times = flight(rows=20)
    still.describe("THR", 150, "Qf", "TimeUS,ThrOut")
    for time in times:
        still.add("THR", int(1e6 * time), 0.0)
    assert all(block.throttle is None for block in opened(still.content, tmp_path).instruments[0].columns(False))


def test_place_date_and_firmware(tmp_path: Path) -> None:
    """GPS week 2300 begins on 2024-02-04; 86,418 s later, less 18 leap seconds, and 1 s from the fix to the reading."""
    found = opened(flight()[0].content, tmp_path)
    assert found.position is not None
    assert (round(found.position.latitude_deg, 6), round(found.position.longitude_deg, 6)) == (-35.362259, 149.165871)
    assert found.position.altitude_m == 597.0
    assert found.start_time == datetime(2024, 2, 5, 0, 0, 1, tzinfo=UTC)
    assert_sentences(found.notes)


def test_motor_compensation_alone_is_taken_off_and_said(tmp_path: Path) -> None:
    """Whole mG twice: of the reading and of MOT x."""
    bare = {name: 1.0 if "DIA" in name else 0.0 for name in EXAMPLE} | {"COMPASS_MOT_X": 30.0, "COMPASS_MOTCT": 2.0}
    log, raw, _ = flight(bare)
    first = opened(log.content, tmp_path).instruments[0]
    assert np.abs(10 * all_of(first) - raw).max() < 2.0
    assert_sentences(first.describe())


def test_parameters_that_change_are_those_of_their_time(tmp_path: Path) -> None:
    """The first half was corrected with SCALE 1.1, the second with OFS_X 50 and SCALE 0.9."""
    first, raw, _ = flight()
    later = EXAMPLE | {"COMPASS_OFS_X": 50.0, "COMPASS_SCALE": 0.9}
    second, again, _ = flight(later)
    told = second.content.index(struct.pack("<BBBQ16s", 0xA3, 0x95, 129, 1, b"COMPASS_OFS_X"))
    compass = opened(first.content + second.content[told:], tmp_path).instruments[0]
    off = 10 * all_of(compass) - np.concatenate([raw, again])
    assert np.abs(off).max() < 2.3
    assert_sentences(compass.notes)
    assert compass.stored is not None
    assert compass.stored.calibration is not None
    assert compass.stored.calibration.offset[0] == -5.0
    assert compass.stored.changes == 1


def test_offsets_learned_in_flight_are_taken_from_the_messages(tmp_path: Path) -> None:
    log = Written()
    log.describe("MAG", 130, "QBhhhhhhhhhBI", NEW_MAG)
    log.describe("PARM", 129, "QNf", "TimeUS,Name,Value")
    log.add("PARM", 1, b"COMPASS_OFS_X", 10.5)
    for step, offset in enumerate((10, 10, 11, 12)):
        log.add("MAG", 100_000 * step, 0, 300 + offset, 0, 0, offset, 0, 0, 0, 0, 0, 1, 0)
    compass = opened(log.content, tmp_path).instruments[0]
    npt.assert_allclose(10 * all_of(compass)[:, 0], [299.5, 299.5, 300.0, 300.0])
    assert any("changed 2 times" in note for note in compass.notes)
    assert_sentences(compass.notes)


def test_old_logs_have_a_name_for_each_compass_and_milliseconds(tmp_path: Path) -> None:
    log = Written()
    labels = "TimeMS,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOfsX,MOfsY,MOfsZ,Health"
    for number, name in enumerate(("MAG", "MAG2", "MAG3"), 130):
        log.describe(name, number, "IhhhhhhhhhB", labels)
        log.add(name, 11477, number, 4, -586, 10, 0, 0, 0, 0, 2, 1)
    found = opened(log.content, tmp_path)
    assert [one.name for one in found.instruments] == ["MAG", "MAG2", "MAG3"]
    npt.assert_allclose(
        [10 * all_of(one)[0] for one in found.instruments], [[n - 10, 4, -588] for n in (130, 131, 132)]
    )
    assert all_of(found.instruments[0], "time")[0] == pytest.approx(11.477)
    assert found.position is None
    assert found.start_time is None
    assert_sentences(found.notes)


def test_readings_of_an_unhealthy_compass_are_left_out(tmp_path: Path) -> None:
    log = Written()
    log.describe("MAG", 130, "QBhhhhhhhhhBI", NEW_MAG)
    for step in range(6):
        log.add("MAG", 100_000 * step, 0, step, 0, 0, 0, 0, 0, 0, 0, 0, int(step % 3 != 0), 0)
    compass = opened(log.content, tmp_path).instruments[0]
    npt.assert_allclose(10 * all_of(compass)[:, 0], [1, 2, 4, 5])
    assert_sentences(compass.notes)


def test_a_log_as_text_is_the_same_log(tmp_path: Path) -> None:
    log, _, _ = flight(rows=50)
    binary = opened(log.content, tmp_path)
    text = as_text(log.content)
    listed = opened(text.encode(), tmp_path, "flight.log")
    assert READERS[0].accepts(text.encode())
    for one, other in zip(binary.instruments, listed.instruments, strict=True):
        assert str(one).split(":", 1)[1] == str(other).split(":", 1)[1]
        for column in ("field", "time", "acceleration", "rate", "current"):
            npt.assert_allclose(all_of(one, column), all_of(other, column), rtol=1e-6, atol=1e-9)
    assert (listed.start_time, listed.notes) == (binary.start_time, binary.notes)
    assert listed.position is not None
    assert binary.position is not None
    assert listed.position.latitude_deg == pytest.approx(binary.position.latitude_deg, abs=1e-9)
    broken = text.replace("\nMAG, ", "\nMAG, what, ", 1) + "MAG, 1\nno line of a log\n"
    assert_sentences(opened(broken.encode(), tmp_path, "broken.log").notes[-1])


def as_text(content: bytes) -> str:
    """The lines that a ground station makes of a log."""
    names = ("FMT", "PARM", "MAG", "IMU", "BAT", "ORGN", "GPS", "MSG", "XKQ", "NKQ", "XKF4", "ATT", "AHR2", "CTUN",
             "MAG2")  # fmt: skip
    tables = _fmt.read_packed(np.frombuffer(content, np.uint8), names).tables
    lines: list[tuple[int, str]] = []
    for name, table in tables.items():
        cells = [
            table.texts(label) if letter in "nNZ" else [f"{value:.9g}" for value in table.column(label).tolist()]
            for label, (letter, *_) in table.fields.items()
        ]
        lines += [(int(at), ", ".join((name, *row))) for at, *row in zip(table.where, *cells, strict=True)]
    return "\n".join(line for _, line in sorted(lines)) + "\n"


def test_messages_are_found_whatever_the_size_of_the_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = flight(rows=100)[0].content
    content = content[:9000] + b"\xa3\x95\x82 broken" + content[9000:]
    whole = _fmt.read_packed(np.frombuffer(content, np.uint8), dataflash.WANTED)
    assert whole.gaps == 1
    for chunk in (300, 1000, 4097):
        monkeypatch.setattr(_fmt, "CHUNK", chunk)
        found = _fmt.read_packed(np.frombuffer(content, np.uint8), dataflash.WANTED)
        assert (found.skipped, list(found.tables)) == (whole.skipped, list(whole.tables))
        for name, table in whole.tables.items():
            npt.assert_array_equal(found[name].where, table.where)


def test_broken_bytes_cost_the_message_before_them_and_those_they_hit(tmp_path: Path) -> None:
    content = flight(rows=100)[0].content
    ends = _fmt.read_packed(np.frombuffer(content, np.uint8), ["MAG"])["MAG"].where
    found = opened(content[: ends[50]] + b"\xa3\x95\x00\xff\xa3" + content[ends[50] :], tmp_path)
    assert [len(all_of(one)) for one in found.instruments] == [100, 100]
    assert_sentences(found.notes[-1])
    hit = bytearray(content)
    hit[ends[50] + 1] = 0
    assert sum(len(all_of(one)) for one in opened(bytes(hit), tmp_path).instruments) == 199


@pytest.mark.parametrize("seed", range(40))
def test_a_log_that_was_cut_and_hit_anywhere_is_read_or_refused(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    content = bytearray(flight(rows=60)[0].content)
    del content[rng.integers(1, len(content)) :]
    for place in rng.integers(0, len(content), rng.choice([0, 1, 20, 400])):
        content[place] = rng.integers(256)
    try:
        found = opened(bytes(content), tmp_path)
    except InputError:
        return
    assert all(np.isfinite(all_of(one)).all() for one in found.instruments)


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (b"\xa3\x95\x80" * 1000, UnreadableInput),
        (b"\xa3\x95", UnreadableInput),
        (Written().content, NoMagnetometer),
        (b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", NoMagnetometer),
    ],
)
def test_what_holds_no_readings_is_refused(content: bytes, error: type[InputError], tmp_path: Path) -> None:
    with assert_raises(error):
        opened(content, tmp_path)


def test_a_matrix_that_flattens_names_the_way_out(tmp_path: Path) -> None:
    log, _, _ = flight(EXAMPLE | {"COMPASS_DIA_Z": 0.0, "COMPASS_ODI_Y": 0.0, "COMPASS_ODI_Z": 0.0}, rows=3)
    compass = opened(log.content, tmp_path).instruments[0]
    with assert_raises(ArrayError):
        all_of(compass)
    assert len(all_of(compass, as_logged=True)) == 3


@pytest.mark.parametrize(
    ("was", "becomes"), [(b"Name,Value", b"Nbme,Value"), (b"QNff\0", b"Qfff\0")], ids=["label", "letter"]
)
def test_parameters_whose_description_is_broken_are_left_out(was: bytes, becomes: bytes, tmp_path: Path) -> None:
    log, _, _ = flight(rows=3)
    sound = opened(log.content, tmp_path, "sound.bin").instruments[0]
    broken = opened(log.content.replace(was, becomes, 1), tmp_path).instruments[0]
    npt.assert_array_equal(all_of(broken, as_logged=True), all_of(sound, as_logged=True))


def test_parameters_that_never_rest_are_refused(tmp_path: Path) -> None:
    """Each change costs a pass over the readings: a file made of changes must not take for ever."""
    log, _, _ = flight(rows=3)
    for step in range(1002):
        log.add("PARM", 1, b"COMPASS_OFS_X", step, 0.0)
    with assert_raises(UnreadableInput):
        opened(log.content, tmp_path)


def test_a_packed_log_is_read_as_the_log(tmp_path: Path) -> None:
    log, _, _ = flight(rows=20)
    (tmp_path / "flight.bin.gz").write_bytes(gzip.compress(log.content))
    packed = open_dataflash(on_disk(find(tmp_path / "flight.bin.gz")))
    npt.assert_array_equal(all_of(packed.instruments[0]), all_of(opened(log.content, tmp_path).instruments[0]))


# a log that was recorded


def test_three_compasses_of_a_quadcopter_and_what_was_in_force(recordings: Callable[[str], Path]) -> None:
    """Counts, units and un-applied calibration as its provenance states them: raw = S⁻¹ m − OFS."""
    log = open_dataflash(on_disk(find(recordings("dronekit_log171_3mags/log171.bin"))))
    assert [(one.name, one.readings, one.unit.name) for one in log.instruments] == [
        ("MAG", 2384, "mG"), ("MAG2", 2384, "mG"), ("MAG3", 2383, "mG"),
    ]  # fmt: skip
    assert [one.mounting for one in log.instruments] == [(90.0, 68.8, -66.7), None, None]  # the others are internal
    stored = {
        "MAG": ([-97.79, 118.11, 213.18], [0.995731, 1.008149, 1.002741], [0.018288, -0.002727, -0.004213]),
        "MAG2": ([-141.84, -67.99, -255.97], [0.950696, 1.050159, 1.006841], [-0.017186, 0.017152, -0.011334]),
    }
    for one, spread in zip(log.instruments, (0.127, 0.227, 0.172), strict=True):
        table = np.genfromtxt(recordings(f"dronekit_log171_3mags/log171_{one.name}.csv"), delimiter=",", names=True)
        logged = np.column_stack([table[f"mag_{axis}_mG"] for axis in "xyz"])
        npt.assert_allclose(10 * all_of(one, as_logged=True), logged, atol=1e-9)
        npt.assert_allclose(all_of(one, "time"), table["t_s"], atol=1e-9)
        npt.assert_allclose(all_of(one, "current"), table["curr_A"], atol=0.0051)
        raw = 10 * all_of(one)
        if one.name in stored:
            offset, diagonal, (xy, xz, yz) = stored[one.name]
            matrix = np.diag(diagonal) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
            npt.assert_allclose(raw, logged @ np.linalg.inv(matrix).T - offset, atol=0.005)
        else:
            assert one.stored is None
            npt.assert_allclose(raw, logged, atol=1e-9)
        lengths = np.linalg.norm(raw, axis=1)
        assert lengths.std() / lengths.mean() == pytest.approx(spread, abs=0.001)
    level = all_of(log.instruments[0], "acceleration")[:50].mean(axis=0)
    npt.assert_allclose(level, [-0.07, -0.63, -9.58], atol=0.05)  # z down: −g on z
    assert log.position is not None
    assert (log.position.latitude_deg, log.position.longitude_deg) == pytest.approx((-35.362259, 149.165871), abs=2e-4)
    assert log.start_time is not None
    assert log.start_time.date().isoformat() == "2015-11-21"
    assert_sentences(log.instruments[0].notes[0])
    assert_sentences(log.instruments[1].notes[0])
    assert_sentences(log.instruments[2].notes)


def test_the_field_of_a_real_flight_is_constant_in_north_east_down(recordings: Callable[[str], Path]) -> None:
    """On board corrected and turned by ATT: median field 62.4 µT, 69.1° upwards, declination 10.8° E.

    The model has 58.2 µT, 66.0° and 12.4° E there: the scale of the calibration on board is not known, and yaw came
    from this compass. What is held constant here is down, by roll and pitch: its median absolute deviation is 0.46 µT,
    where the z of the vehicle scatters by 3.0. In flips of 400°/s, and times in whole ms, it is more: 3.2 µT standard.
    """
    log = open_dataflash(on_disk(find(recordings("dronekit_log171_3mags/log171.bin"))))
    compass = log.instruments[0]
    attitude, throttle = all_of(compass, "attitude"), all_of(compass, "throttle")
    assert np.isfinite(attitude).all(axis=1).mean() == pytest.approx(0.995, abs=0.001)
    npt.assert_allclose([np.nanmin(throttle), np.nanmax(throttle)], [0.0, 0.619])
    table = np.genfromtxt(recordings("dronekit_log171_3mags/log171_MAG.csv"), delimiter=",", names=True)
    for name, angle in zip(("roll_deg", "pitch_deg"), _roll_and_pitch(attitude), strict=True):
        off = (angle - table[name] + 180) % 360 - 180
        assert np.nanmedian(np.abs(off)) < 0.01
    ned = site(compass, as_logged=True)
    north, east, down = middle = np.median(ned, axis=0)
    assert np.linalg.norm(middle) == pytest.approx(62.4, abs=0.1)
    assert np.rad2deg(np.arctan2(down, np.hypot(north, east))) == pytest.approx(-68.9, abs=0.3)
    assert np.rad2deg(np.arctan2(east, north)) == pytest.approx(10.8, abs=0.3)
    scatter = 1.4826 * np.median(np.abs(ned - middle), axis=0)
    assert scatter[2] == pytest.approx(0.46, abs=0.05)
    assert ned.std(axis=0)[2] == pytest.approx(3.25, abs=0.1)
    logged = all_of(compass, as_logged=True)
    assert np.std(logged[:, 2]) > 4 * ned.std(axis=0)[2]


def _roll_and_pitch(attitude: Floats) -> tuple[Floats, Floats]:
    """Degrees, from where the vehicle has down."""
    x, y, z = quaternions.rotate_vectors(quaternions.inverse(attitude), np.array([0.0, 0.0, 1.0])).T
    return np.rad2deg(np.arctan2(y, z)), np.rad2deg(np.arctan2(-x, np.hypot(y, z)))
