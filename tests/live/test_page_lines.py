"""What boards print and text logs hold, read by the page's JavaScript and by the library: the same numbers.

The shapes are those of docs/line-shapes.toml, as files and piece by piece as they arrive from a port.
"""

from __future__ import annotations

import base64
from functools import cache, partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.core import test_stated_units
from tests.javascript import run
from tests.live.test_line_shapes import TUMBLE, with_noise
from tests.live.test_transcripts import REFUSED
from tests.readers import test_printed_lines, test_prints
from tests.sentences import assert_sentences
from tests.sketches import SHAPES, printed
from tests.trials import daily

import flinders
from flinders.apps.live.standalone import lines
from flinders.errors import FlindersError
from flinders.links.transcript import Transcript
from flinders.readers._names import meaning

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

UNREAD: Final = frozenset({
    "icm20948-linux-hex-words",
    "sensors in turn, refused",
    "units: a line above",
    "units: a remark above",
    "units: a cell above",
})  # fmt: skip
"""Prints that the page does not read, or otherwise: hexadecimal words, sensors without labels, units above a table."""
TIMES_OF_DAY: Final = frozenset({
    "a date before signs", "dates in a named column", "dates with a zone", "the day first", "the month first",
    "days and months that leave it open", "a date and a clock", "dates before commas", "stamps with the day first",
    "records with dates", "a date of two words", "stamps before tuples", "dates in the middle",
})  # fmt: skip
"""Texts of which the page takes the time of day, and no date."""
PIECE: Final = 37  # Bytes that arrive together
LATER_S: Final = 0.02
LARGEST: Final = 1 << 19  # Bytes of a recording that is compared
PROGRAM: Final = """
const { accelerationOf, readLog, LineReader } = await load("lines.js");
const { Unreadable } = await load("tables.js");
const attempt = (read) => {
    try {
        return read();
    } catch (error) {
        if (!(error instanceof Unreadable)) throw error;
        return { refusal: error.message };
    }
};
const ofFile = ({ name, content }) => {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const { field, time, unit, raw, acceleration } = readLog(given, name, bytes);
    return { field: [...field], time: time && [...time], unit, raw, acceleration: acceleration && [...acceleration] };
};
const ofWire = ({ pieces, later }) => {
    const reader = new LineReader(given);
    const rows = pieces.flatMap((piece, i) => reader.take(piece, i * later).rows);
    const [field, time] = [rows.flatMap(({ field }) => field), rows.map(({ time }) => time)];
    return { field, time, acceleration: accelerationOf(rows), unit: reader.unit };
};
return { files: given.files.map((file) => attempt(() => ofFile(file))), wires: given.wires.map(ofWire) };
"""
COLUMNS: Final = (
    "magADC[0]", "MAGNETIC FIELD Y (î¼T)", "gyro_z_dps", "Time (s)", "mag_x_cal", "mag1_x", "imu2.mag.x", "rm3100_y",
    "rm3100x", "imu_mx", "Bx", "b_y", "hz", "x", "Y", "T_C", "t", "timestamp_us", "header.stamp.secs", "accel_x_mps2",
    "ax", "linear acc x", "temperature", "temps", "current_A", "throttle_share", "motor1_current (mA)", "attitude_w",
    "igrf_total", "reference field (nT)", "mag_ref_x", "unit_x", "mag_unit_x", "covariance_mag_x", "heading",
    "B_meas_x", "b_model_x", "sensor_x", "reference_x",
    "x-axis (T)", "T(°)", "T [℃]", "GPS TOW", "iTOW", "UncalMagXMicroT", "时间", "mag_x(毫高斯)", "X Mag [x8006]",
    "latitude", "field strength z", "constructor", "X axis field (Gauss)", "µT x", "mag_filtered_z", "lis3mdl_raw_x",
    "angular_velocity.z", "day time", "elapsed (ms)", "UncalMagXMicroT", "magMicroT_x", "field1", "field 12",
    "field.0", "Clock:offsetTime", "time_offset", "offset time", "GPS TOW", "gps_time", "GPS time of week",
    "iTOW_ms", "",
)  # fmt: skip
"""Names of columns of many kinds, and of none."""


def texts() -> Iterator[tuple[str, Callable[[], str]]]:
    """Name of each print, and what makes its text: the shapes, those of other tests, and tables."""
    for shape in SHAPES:
        yield shape["name"], partial(shaped, shape)
    for name, (lines_of_reading, unit) in test_prints.READ.items():
        yield name, partial(booted, lines_of_reading, unit)
    for name, (line, _) in test_prints.REFUSED.items():
        yield name, partial(first_lines, line)
    for name, read in test_printed_lines.READ.items():
        yield name, partial("\n".join, ["booting", *read, ""])
    for name, (refused, _) in REFUSED.items():
        yield f"{name}, refused", partial("\n".join, [*refused, ""])
    yield from ((name, partial(str, table)) for name, table in TABLES.items())
    for name, (*_, columns, _) in test_stated_units.TABLES.items():
        if columns is None:
            yield f"units: {name}", partial(test_stated_units.table, name)
    for name, form in test_stated_units.BLOCKS.items():
        yield f"blocks of {name}", partial(test_stated_units.rows, form)


def shaped(shape: dict[str, Any]) -> str:
    return "\r\n".join([*with_noise(shape, printed(shape, TUMBLE)[0]), ""])


def booted(lines_of_reading: list[str], unit: str) -> str:
    readings = printed({"lines": lines_of_reading, "unit": unit}, TUMBLE)[0]
    return "\n".join(["starting", *chain.from_iterable(readings), ""])


def first_lines(line: str) -> str:
    """Each reading without its second line, in which `printed` finds the numbers."""
    readings = printed({"lines": [line, "{mx}{my}{mz}"], "unit": ""}, TUMBLE)[0]
    return "\n".join([*(first for first, _ in readings), ""])


FIELD: Final = TUMBLE.field.round(3).tolist()
TABLES: Final = {
    name: "\n".join([*head, *(form.format(*row, t=1000 + 20 * n, n=n) for n, row in enumerate(FIELD)), ""])
    for name, (head, form) in {
        "units in a row": (["t;mx;my;mz", "ms;mG;mG;mG"], "{t};{0};{1};{2}"),
        "seconds and nanoseconds": (["secs,nsecs,mag_x_uT,mag_y_uT,mag_z_uT"], "{n},500000000,{0},{1},{2}"),
        "a time cut to a digit": (["t_s,mag_x_uT,mag_y_uT,mag_z_uT"], "1.7e9,{0},{1},{2}"),
        "three columns": ([], "{0}\t{1}\t{2}"),
        "time first": ([], "{t} {0} {1} {2}"),
        "quotes": (['"time","Mag X (mG)","Mag Y (mG)","Mag Z (mG)"'], '"{t}","{0}","{1}","{2}"'),
        "a reference beside it": (["ref_x,ref_y,ref_z,m_x,m_y,m_z"], "1,2,3,{0},{1},{2}"),
        "calibrated beside raw": (["mag_x_cal,mag_y_cal,mag_z_cal,mag_x_raw,mag_y_raw,mag_z_raw"], "1,2,3,{0},{1},{2}"),
        "a model's field beside it": (
            ["MagneticField_x,MagneticField_y,MagneticField_z,MagSensor_x,MagSensor y,magsensor-z"], "1,2,3,{0},{1},{2}"
        ),
        "measured beside a field": (["field_x,field_y,field_z,measured_x,measured_y,measured_z"], "1,2,3,{0},{1},{2}"),
        "a temperature named T": (["mx,my,mz,T"], "{0},{1},{2},23.4"),
        "ticks of no unit": (["ticks,mx,my,mz"], "{n}2000,{0},{1},{2}"),
        "a T that falls": (["T_raw,mx,my,mz"], "-{n},{0},{1},{2}"),
        "a T that rises": (["T,mx,my,mz"], "{n},{0},{1},{2}"),
        "dates in a named column": (["timestamp,mx,my,mz"], "2026-11-22 04:42:{n:02d}.250,{0},{1},{2}"),
        "dates with a zone": (["mx,my,mz,utc"], "{0},{1},{2},2026-11-22T04:42:{n:02d}+01:00"),
        "the day first": (["mx;my;datum;mz"], "{0};{1};22.11.26 04:42:{n:02d},5;{2}"),
        "the month first": (["time,mx,my,mz"], '"Nov 22, 2026 11:59:{n:02d} PM",{0},{1},{2}'),
        "days and months that leave it open": (["time,mx,my,mz"], "03/04/2026 4:42:{n:02d} AM,{0},{1},{2}"),
        "a date and a clock": (["mx,my,mz,time,date"], "{0},{1},{2},04:42:{n:02d}:125,22-Nov-2026"),
        "frames behind seconds": (["mx,my,mz,time"], "{0},{1},{2},04:42:{n:02d}:13"),
        "a time of day behind": ([], "{0} {1} {2} 4:42:{n:02d}"),
        "dates before commas": ([], "2026-11-22 04:42:{n:02d},{0},{1},{2}"),
        "stamps with the day first": ([], "22.11.2026 14:03:{n:02d} -> X: {0} Y: {1} Z: {2}"),
        "records with dates": ([], '{{"time": "2026-11-22T04:42:{n:02d}Z", "mag": {{"x": {0}, "y": {1}, "z": {2}}}}}'),
        "a name too many": (["t,mx,my,mz,temp"], "{t},{0},{1},{2}"),
        "two commas at the end": (["t,mx,my,mz"], "{t},{0},{1},{2},,"),
        "a value of two words": (["t mx my mz state"], "{t} {0} {1} {2} turning left"),
        "a date of two words": (["timestamp mx my mz"], "2026-11-22 04:42:{n:02d}.5 {0} {1} {2}"),
        "names with another delimiter": (["t mx my mz"], "{t},{0},{1},{2}"),
        "two magnetometers": (["mag1_x,mag1_y,mag1_z,mag2_x,mag2_y,mag2_z"], "{0},{1},{2},1,2,3"),
        "records of keys in keys": ([], '{{"t_ms": {t}, "mag": {{"x": {0}, "y": {1}, "z": {2}}}}}'),
        "records with a unit": ([], '{{"mx": {0}, "my": {1}, "mz": {2}, "unit": "uT", "t_ms": {t}}}'),
        "records of lists": ([], "[{0}, {1}, {2}]"),
        "a header in a comment": (["# mx my mz"], "{0} {1} {2}"),
        "stamps before a table": ([], "14:03:{n:02d}.250 -> {0},{1},{2}"),
        "stamps before tuples": ([], "[2026-11-22T14:03:{n:02d}Z] ({0}, {1}, {2})"),
        "gaps": (["mag_x,mag_y,mag_z", "1,2", "nan,1,2", "hello,1,2"], "{0},{1},{2}"),
        "headings and rulers between": ([], "X: {0} Y: {1} Z: {2}\nHeading: {n}\n---"),
        "a title of its own for each": ([], "New sample:\n({0}, {1}, {2})\nOK"),
        "remarks in brackets": ([], "Accel (raw): X=1 Y=2 Z={n}\nMag (raw): X={0} Y={1} Z={2}"),
        "a range in brackets": ([], "Mag (±4 gauss): {0}, {1}, {2}"),
        "numbers of sensors in brackets": ([], "Mag (1): {0}, {1}, {2}\nTemp [2]: {n}"),
        "labels of several sensors": ([], "Foo: X={0} Y={1} Z={2}\nBar: X=1 Y={n} Z=2"),
        "dates in the middle": ([], "INFO 21.06.2026 21:18:{n:02d} mag X: {0} Y: {1} Z: {2}"),
        "a log of events": ([], "2026-06-21 21:18:{n:02d} INFO boot step {n} done"),
        "a table of weather": (["date,temperature,humidity,wind"], "2026-06-21,{0},{1},{2}"),
        "a counter beside constants": ([], "x: {n} y: 5 z: 3"),
        "units in two words": (["x (in micro Teslas);y (in micro Teslas);z (in micro Teslas)"], "{0};{1};{2}"),
        "names of a phone": (["time,Geo-X,Geo-Y,Geo-Z"], "{t},{0},{1},{2}"),
        "sensors under a header each": (
            ["# ACC,t,AccX,AccY,AccZ", "# MAG,t_ms,MagXMicroT,MagYMicroT,MagZMicroT"],
            "ACC,{t},0.1,{n},9.8\nFix,GPS,52.1,9.8,{n},5,3\nMAG,{t},{0},{1},{2}",
        ),
        "records of sensors": (
            [], '{{"sensor": "Gyro", "x": 1, "y": 2, "z": {n}}}\n{{"sensor": "Mag", "x": {0}, "y": {1}, "z": {2}}}'
        ),
        "sensors without a magnetometer": ([], "{n}.5,ACC,{0},{1},{2}\n{n}.5,GYR,1,2,{n}"),
        "a log of Android": ([], "11-22 04:42:{n:02d}.813  2211  2245 D Mag: x={0} y={1} z={2}"),
        "a log of ESP-IDF": ([], "\x1b[0;32mI ({t}) QMC5883L: X: {0}, Y: {1}, Z: {2}\x1b[0m"),
        "a log of glog": ([], "I1122 04:42:{n:02d}.813 mag.cc:7] mag x={0} y={1} z={2}"),
        "an address of two bytes": ([], "{n},{0},{1},{2},b4:01,5,6"),
        "topics in slashes": (["t,/magnetic_field/x,/magnetic_field/y,/magnetic_field/z"], "{t},{0},{1},{2}"),
        "times of a week": (["GPS Week,GPS TOW,X Mag [x8006],Y Mag [x8006],Z Mag [x8006]"], "2437,{n}.5,{0},{1},{2}"),
        "a number of a sensor": (["kind,t,x,y,z"], "1,{t},0,9.8,0.{n}\n4,{t},{0},{1},{2}"),
        "a dump of a data base": ([], "INSERT INTO mag VALUES({n},'2026-11-22 04:42:{n:02d}',{0},{1},{2});"),
    }.items()
}  # fmt: skip
DEVICES: Final = {
    "numbers of devices": ("id,mx,my,mz", "{device},{0},{1},{2}", ["0", "1", "2"]),
    "addresses of devices": ("mag_x_uT;mag_y_uT;mag_z_uT;MAC", "{0};{1};{2};{device}", ["b4:01", "b4:02", "b4:a3"]),
    "words of devices": ("mx my mz node_name", "{0} {1} {2} {device}", ["stern", "bow", "mast"]),
    "records of devices": ("", '{{"dev": {{"sn": "{device}"}}, "mx": {0}, "my": {1}, "mz": {2}}}', ["A7", "A10"]),
    "instances of ArduPilot": ("timestamp,TimeUS,I,MagX,MagY,MagZ", "{n},{n}000,{device},{0},{1},{2}", ["0", "1"]),
}
"""Header and form of tables, and the words of their devices, which the page does not tell apart."""
MORE: Final = {
    "lists in JSON": '{"mx": [1, 2, 3], "my": [4, 5, 6], "mz": [7, 8, 9]}',
    "matrices of Octave": "# name: acc\n# columns: 3\n1 2 3\n# name: mag\n# columns: 3\n4 5 6\n",
    "points of InfluxDB": "mag,host=a x=1,y=2,z=3 17000000\n" * 9,
}
"""What `flinders calibrate` reads and the page does not."""
for name, (header, form, words) in DEVICES.items():
    rows = [form.format(*row, n=n, device=words[n % len(words)]) for n, row in enumerate(FIELD)]
    MORE[name] = "\n".join([header, *rows, ""])
CASES: Final = dict(texts())
"""What makes each text: collecting the tests needs the names alone."""


@cache
def text_of(name: str) -> str:
    return CASES[name]()


def cut(text: str) -> list[str]:
    """The text in pieces of uneven length, then silence until the last line is read."""
    pieces = [text[start : start + PIECE] for start in range(0, len(text), PIECE)]
    return [*pieces, *[""] * 60]


@pytest.fixture(scope="module")
def by_page() -> dict[str, Any]:
    """What the page makes of each text, dropped and as it arrives."""
    contents = [{"name": "print.txt", "content": base64.b64encode(text_of(name).encode()).decode()} for name in CASES]
    wires = [{"pieces": cut(text_of(name)), "later": LATER_S} for name in CASES]
    done = run(PROGRAM, {"lines": lines.data(), "files": contents, "wires": wires})
    return {name: (file, wire) for name, file, wire in zip(CASES, done["files"], done["wires"], strict=True)}


@pytest.mark.parametrize("name", daily([name for name in CASES if name not in UNREAD], 3))
def test_a_dropped_text_gives_the_numbers_of_the_library(name: str, by_page: dict[str, Any], tmp_path: Path) -> None:
    """Or both refuse it."""
    path, found = tmp_path / "print.txt", by_page[name][0]
    path.write_text(text_of(name), encoding="utf-8", newline="")
    try:
        samples = flinders.read(path)
    except FlindersError:
        assert found.get("refusal"), found
        return
    assert found.get("field") == samples.field.ravel().tolist(), found.get("refusal")
    assert found["unit"] == samples.unit.inside
    assert found["raw"] == {"unit": samples.unit.name, "scale": samples.unit.scale}
    if samples.acceleration is None:
        assert found["acceleration"] is None
    else:  # null is NaN
        np.testing.assert_allclose(np.array(found["acceleration"], float), samples.acceleration.ravel(), rtol=1e-8)
    if name in TIMES_OF_DAY:
        np.testing.assert_allclose(np.diff(found["time"]), np.diff(np.asarray(samples.time)), atol=1e-6)
    else:
        assert found["time"] == (None if samples.time is None else samples.time.tolist())


@pytest.mark.parametrize("name", daily([name for name in CASES if name not in UNREAD], 3))
def test_what_arrives_gives_the_numbers_of_the_live_page(name: str, by_page: dict[str, Any]) -> None:
    """Time of arrival where the lines have none, and the same readings from the same pieces."""
    transcript, found = Transcript("the board"), by_page[name][1]
    taken = [transcript.take(piece.encode(), LATER_S * place) for place, piece in enumerate(cut(text_of(name)))]
    readings = [each.readings for each in taken if each.readings is not None]
    field = np.concatenate([each.field for each in readings]).ravel().tolist() if readings else []
    assert found["field"] == field
    if readings:
        times = np.concatenate([each.time for each in readings if each.time is not None])
        assert found["unit"] == readings[0].unit.inside
        felt = [each.acceleration for each in readings if each.acceleration is not None]
        own = found["acceleration"]
        assert (own is None) == (not felt)
        if felt:
            np.testing.assert_allclose(np.array(own, float), np.concatenate(felt).ravel(), rtol=1e-8)
        np.testing.assert_allclose(np.diff(np.array(found["time"], float)), np.diff(times), atol=1e-6)


@pytest.mark.nightly
def test_text_logs_of_the_shared_data_give_the_numbers_of_the_library(recordings: Callable[[str], Path]) -> None:
    """Every one that the library reads as text, but blackboxes, which may be corrected on board."""
    texts = {}
    for path in sorted(
        path for path in recordings(".").rglob("*") if path.suffix in {".csv", ".txt", ".tsv", ".dat", ".log"}
    ):
        if path.stat().st_size > LARGEST or "betaflight" in str(path.parent):
            continue
        try:
            texts[path] = flinders.read(path)
        except FlindersError:
            continue
    contents = [{"name": path.name, "content": base64.b64encode(path.read_bytes()).decode()} for path in texts]
    done = run(PROGRAM, {"lines": lines.data(), "files": contents, "wires": []})["files"]
    assert len(texts) >= 20
    for (path, samples), found in zip(texts.items(), done, strict=True):
        assert found.get("field") == samples.field.ravel().tolist(), (path, found.get("refusal"))
        assert found["time"] == (None if samples.time is None else samples.time.tolist()), path


def test_names_mean_the_same() -> None:
    program = """
const { Names } = await load("names.js");
const { revived } = await load("patterns.js");
const names = new Names(revived(given.lines));
return given.columns.map((name) => names.meaning(name));
"""
    found = run(program, {"lines": lines.data(), "columns": COLUMNS})
    for name, own in zip(COLUMNS, found, strict=True):
        kind, axis, unit, rank = meaning(name)
        unit = unit if kind not in ("currents", "throttles") else ""
        assert own == {"kind": kind, "axis": axis, "unit": unit, "rank": rank}, name


FOREIGN: Final = (
    ("flight.ulg", b"ULog\x01\x12\x35" + bytes(40)),
    ("flight.bin", b"\xa3\x95\x80\x80\x59FMT" + bytes(range(64))),
    ("data.mat", b"MATLAB 5.0 MAT-file\0\0\0\0" + bytes(120)),
    ("logo.png", b"\x89PNG\r\n\x1a\n" + bytes(40)),
    ("log.bbl", b"H Product:Blackbox flight data\n" + bytes(99)),
    ("index.html", b"<!DOCTYPE html><html>"),
    ("empty.txt", b""),
    ("calibration.json", b'{"flinders": "calibration", "schema": 1}'),
    ("words.txt", b"hello\nworld\n"),
    ("two.csv", b"1,2\n3,4\n5,6\n7,8\n"),
    ("six.csv", b"1,2,3,4,5,6\n" * 9),
    ("accelerometer.csv", b"ax,ay,az\n1,2,3\n4,5,6\n"),
    ("headed.csv", b"mag_x,mag_y,mag_z\n"),
    ("nan.csv", b"mag_x,mag_y,mag_z\nnan,nan,nan\nnan,nan,nan\n"),
    ("numbered.csv", b"1,10,20,30\n2,40,50,60\n" * 5),
    ("fields.csv", b"id,field1,field2,field3\n" + b"1,22.5,60,1013\n2,22.6,61,1013\n" * 9),
    ("thousands.csv", b"x;y;z\n1,234;345;5,678\n" * 9),
    ("blackbox.csv", b"time,magADC[0],magADC[1],magADC[2]\n1,2,3,4\n2,3,4,5\n"),
    ("pulses.csv", b"x_set,y_set,z_set,x_reset,y_reset,z_reset\n1,2,3,4,5,6\n"),
)
"""Name and content of files that are no text logs of a magnetometer."""


@pytest.mark.parametrize("name", MORE)
def test_what_only_the_program_reads_is_refused_with_its_commands(name: str) -> None:
    given = [{"name": "log.txt", "content": base64.b64encode(MORE[name].encode()).decode()}]
    (found,) = run(PROGRAM, {"lines": lines.data(), "files": given, "wires": []})["files"]
    assert_sentences(found["refusal"])


def test_other_files_are_refused_with_advice() -> None:
    given = [{"name": name, "content": base64.b64encode(content).decode()} for name, content in FOREIGN]
    found = run(PROGRAM, {"lines": lines.data(), "files": given, "wires": []})["files"]
    for (name, _), each in zip(FOREIGN, found, strict=True):
        assert_sentences(f"{name}: {each.get('refusal')}")
