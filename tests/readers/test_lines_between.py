"""Lines that a print has beside its readings, labels with brackets, dates in lines, and texts that are known."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.errors import InputError, NoMagnetometer
from flinders.readers import open_recording
from flinders.readers._tokenizer import pattern_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

FIELD = np.round(simulate.tumble(seed=4).samples.field[::20][:150], 2)
GRAVITY = np.round(9.81 * FIELD / np.linalg.norm(FIELD, axis=1, keepdims=True), 2)
FORMS: dict[str, str] = {
    "labels": "X: {:.2f} Y: {:.2f} Z: {:.2f}",
    "a table": "{:.2f},{:.2f},{:.2f}",
    "tuples": "({:.2f}, {:.2f}, {:.2f})",
    "a line for each axis": "X: {:.2f}\nY: {:.2f}\nZ: {:.2f}",
    "a unit for each axis": "Mag X: {:.2f} uT Y: {:.2f} uT Z: {:.2f} uT",
    "time stamps": "14:03:00.250 -> {:.2f},{:.2f},{:.2f}",
}
BESIDE: dict[str, Callable[[int], list[str]]] = {
    "a heading": lambda n: [f"Heading: {n * 1.3:.1f}"],
    "a word": lambda _: ["OK"],
    "a ruler": lambda _: ["---"],
    "a voltage, one in ten": lambda n: [f"Batt: {3 + n / 100:.2f} V"] * (n % 10 == 0),
    "states": lambda n: [f"State: {('IDLE', 'RUN', 'STOP')[n % 3]}"],
    "a topic": lambda _: ["topic: /imu/mag"],
    "angles": lambda n: [f"Roll: {n:.1f} Pitch: {n / 2:.1f} Yaw: {n / 3:.1f}"],
    "several": lambda n: ["======", f"Heading: {n}", f"Batt: 3.{n % 10} V", "ready"],
    "a title that is none of a sensor": lambda _: ["New sample:"],
    "a heading now and then": lambda n: ["Satellites: 7"] * (n % 30 == 5),
}
LOST: dict[str, Callable[[str, int], str]] = {
    "cut off": lambda line, n: line[: len(line) // 2] if n % 4 == 1 else line,
    "cut off anywhere": lambda line, n: line[: 1 + n % (len(line) - 4)] if n % 3 == 1 else line,
    "the start lost": lambda line, n: line[5 + n % 9 :] if n % 4 == 1 else line,
    "the middle lost": lambda line, n: line[:6] + line[14:] if n % 3 == 1 else line,
    "a letter damaged": lambda line, n: f"{line[:6]}#{line[7:]}" if n % 3 == 1 else line,
    "a burst": lambda line, n: "".join(chr(33 + (n * 7 + 31 * k) % 90) for k in range(30)) if 50 <= n < 90 else line,
    "one line again and again": lambda line, n: "@@@@@@" if 50 <= n < 90 else line,
    "an error in its place": lambda line, n: "I2C read error" if n % 3 == 1 else line,
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "print.txt"


def read(path: Path, lines: Iterable[str], **options: Any) -> flinders.Samples:
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return flinders.read(path, **options)


def printed(form: str, beside: Callable[[int], list[str]]) -> list[str]:
    rows = enumerate(FIELD.tolist())
    return [line for n, row in rows for line in (*beside(n), *FORMS[form].format(*row).split("\n"))]


@pytest.mark.parametrize("form", daily(FORMS, 2))
@pytest.mark.parametrize("beside", BESIDE.values(), ids=BESIDE)
def test_lines_that_come_back_with_the_readings_are_counted_and_no_loss(
    form: str, beside: Callable[[int], list[str]], path: Path
) -> None:
    samples = read(path, printed(form, beside))
    np.testing.assert_allclose(samples.field / samples.unit.scale, FIELD, atol=1e-9)
    assert not any(entry.is_loss for entry in samples.skipped)
    assert sum(entry.rows for entry in samples.skipped) in (0, sum(len(beside(n)) for n in range(len(FIELD))))


@pytest.mark.parametrize("form", ["labels", "a table", "tuples"])
@pytest.mark.parametrize("damaged", LOST.values(), ids=LOST)
def test_lines_that_should_have_been_readings_are_lost(
    form: str, damaged: Callable[[str, int], str], path: Path
) -> None:
    whole = [FORMS[form].format(*row) for row in FIELD.tolist()]
    samples = read(path, [damaged(line, n) for n, line in enumerate(whole)])
    assert len(samples) < len(FIELD)
    assert all(entry.is_loss for entry in samples.skipped)


def test_accompanying_lines_are_no_finding_of_a_calibration_nor_of_a_check(path: Path, capsys: Any) -> None:  # noqa: ANN401
    path.write_text("\n".join(printed("labels", BESIDE["a heading"])), encoding="utf-8")
    saved = path.with_suffix(".json")
    for command in (["calibrate", str(path), "--unit", "uT", "-o", str(saved)], ["check", str(saved), str(path)]):
        with pytest.raises(SystemExit):
            main(command)
        said = capsys.readouterr()
        assert_sentences(said.err)
        assert "left out" not in said.out


REMARKS = (
    "(raw)",
    "[raw]",
    "(widgets)",
    "(LIS3MDL)",
    "(x,y,z)",
    "(calibrated)",
    "(±4 gauss)",
    "[16 bit]",
    "(body frame)",
)
VALUES = (
    "X={:.2f} Y={:.2f} Z={:.2f}",
    "{:.2f}, {:.2f}, {:.2f}",
    "[{:.2f}, {:.2f}, {:.2f}]",
    "X: {:.2f}, Y: {:.2f}, Z: {:.2f}",
)


@pytest.mark.parametrize("values", VALUES)
@pytest.mark.parametrize("remark", REMARKS)
def test_words_before_a_bracket_are_the_sensor_whatever_it_holds(remark: str, values: str, path: Path) -> None:
    pairs = zip(GRAVITY.tolist(), FIELD.tolist(), strict=True)
    samples = read(
        path,
        [
            f"{name} {remark}: {values.format(*row)}"
            for pair in pairs
            for name, row in zip(("Accel", "Mag"), pair, strict=True)
        ],
    )
    np.testing.assert_allclose(samples.field / samples.unit.scale, FIELD, atol=1e-9)
    assert samples.unit.name == "counts"
    assert samples.acceleration is not None


def test_a_word_that_changes_from_line_to_line_is_no_sensor(path: Path) -> None:
    lines = [f"point{chr(97 + n % 20)}: {VALUES[0].format(*row)}" for n, row in enumerate(FIELD.tolist())]
    np.testing.assert_allclose(read(path, lines).field, FIELD, atol=1e-9)


MOMENTS = (
    "2026-06-21 21:18:{:02d}", "2026-06-21T21:18:{:02d}.250Z", "21.06.2026 21:18:{:02d}", "6/21/2026 9:18:{:02d} PM",
    "Jun 21 21:18:{:02d}", "21 June 2026 21:18:{:02d}", "[21/Jun/2026:21:18:{:02d} +0200]",
)  # fmt: skip


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_log_of_events_is_no_magnetometer(moment: str, path: Path) -> None:
    with assert_raises(NoMagnetometer):
        read(path, [f"{moment.format(n)} INFO boot step {n} done" for n in range(40)])


@pytest.mark.parametrize("moment", MOMENTS)
def test_the_numbers_of_a_moment_are_no_readings(moment: str, path: Path) -> None:
    rows = list(enumerate(FIELD[:50].tolist()))
    for form in ("{0} {1}", "INFO at {0} {1}", "{1} at {0}"):
        samples = read(path, [form.format(moment.format(n), FORMS["labels"].format(*row)) for n, row in rows])
        np.testing.assert_allclose(samples.field, FIELD[:50], atol=1e-9)


TABLES = {
    "weather": ("date,temperature,humidity,wind", "2026-06-{:02d},{:.1f},{:.1f},{:.1f}"),
    "training": ("date;exercise;sets;reps;weight", "2026-06-{:02d};squat;{:.0f};{:.0f};{:.0f}"),
    "values": ("timestamp,v1,v2,v3", "14:03:{:02d},{:.1f},{:.1f},{:.1f}"),
}


@pytest.mark.parametrize(("header", "form"), TABLES.values(), ids=TABLES)
def test_a_table_with_a_header_is_never_read_as_a_print(header: str, form: str, path: Path) -> None:
    with assert_raises(NoMagnetometer):
        read(path, [header, *(form.format(1 + n % 28, *row) for n, row in enumerate(FIELD.tolist()))])


@pytest.mark.parametrize("form", ["x: {} y: 5 z: 3", "B: 3, 10, {}", "(7, 8, {})", 'GET {} "HTTP/1.1" 200 (10.0.0.1)'])
def test_constants_and_counters_are_no_magnetometer_in_a_print(form: str, path: Path) -> None:
    with pytest.raises(InputError):
        read(path, [form.format(n) for n in range(60)])


UNITS = (
    "x (in microteslas)", "X [uTeslas]", "x in µteslas", "x (micro Tesla)", "Geo-X (uT)", "geo_x_uT", "xmf (uT)",
    "Magnetic field x (IN MICRO-TESLAS)",
)  # fmt: skip


@pytest.mark.parametrize("name", UNITS)
def test_units_are_known_in_any_spelling_in_headers_and_prints(name: str, path: Path) -> None:
    names = [
        name.replace("x", axis, 1) if "x" in name.split("(", maxsplit=1)[0] else name.replace("X", axis.upper(), 1)
        for axis in "xyz"
    ]
    names = [
        each.replace("Magnetic field x", f"Magnetic field {axis}") for each, axis in zip(names, "xyz", strict=True)
    ]
    header = read(path, [";".join(names), *(";".join(map(str, row)) for row in FIELD.tolist())])
    assert header.unit.name == "uT"
    np.testing.assert_allclose(header.field, FIELD, atol=1e-9)
    lines = [", ".join(f"{each}: {value}" for each, value in zip(names, row, strict=True)) for row in FIELD.tolist()]
    labels = read(path, lines)
    np.testing.assert_allclose(labels.field / labels.unit.scale, FIELD, atol=1e-9)


VECTORNAV = {
    "YMR": "+168.712,-004.830,+012.000,{m},+00.271,-01.200,-09.468,+00.099393,+00.144748,-00.025401",
    "IMU": "{m},-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,+20.7,+084.322",
    "MAR": "{m},+00.271,-01.200,-09.468,+00.099393,+00.144748,-00.025401",
    "QMR": "+0.1,+0.2,+0.3,+0.9,{m},+00.271,-01.200,-09.468,+00.099393,+00.144748,-00.025401",
    "MAG": "{m}",
}


@pytest.mark.parametrize(("mark", "fields"), VECTORNAV.items(), ids=VECTORNAV)
def test_sentences_of_vectornav_are_read_in_gauss(mark: str, fields: str, path: Path) -> None:
    rows = [",".join(f"{value / 100:+08.4f}" for value in row) for row in FIELD.tolist()]
    lines = [f"$VN{mark},{fields.format(m=row)}*6E" for row in rows]
    samples = read(path, [line for each in lines for line in ("$VNDTV,0.01,0.1,0.2*3A", each)])
    assert samples.unit.name == "G"
    np.testing.assert_allclose(samples.field, FIELD, atol=1e-9)
    assert (samples.acceleration is None) == (mark == "MAG")


@pytest.mark.parametrize(("digits", "step"), [(19, 200_000_000), (16, 200_000), (13, 200)])
def test_points_of_influxdb_are_read_with_their_time(digits: int, step: int, path: Path) -> None:
    start = int("17".ljust(digits, "0"))
    points = [f"mag,host=a x={x},y={y},z={z} {start + n * step}" for n, (x, y, z) in enumerate(FIELD.tolist())]
    samples = read(path, [line for point in points for line in (point, f"cpu,host=a load=0.5 {start}")])
    np.testing.assert_allclose(samples.field, FIELD, atol=1e-9)
    assert samples.time is not None
    np.testing.assert_allclose(np.diff(samples.time), 0.2, atol=1e-6)


def test_points_of_several_devices_are_refused(path: Path) -> None:
    points = [f"mag,host={host} x={x},y={y},z={z}" for x, y, z in FIELD.tolist() for host in "ab"]
    with assert_raises(NoMagnetometer):
        read(path, points)


KNOWN = {
    "candump with a clock": (["(1600000000.123456) can0 123#DEADBEEF"] * 5, "candump of a CAN bus"),
    "candump for people": (["  can0  123   [3]  11 22 33", "  can0  124   [2]  DE AD"] * 5, "candump of a CAN bus"),
    "an observatory": (
        [
            " Format                 IAGA-2002                                    |",
            "DATE TIME DOY ABKH ABKD ABKZ ABKF |",
        ]
        + ["2026-01-01 00:00:00.000 001     11123.20    312.20  52000.10  53000.20"] * 5,
        "with D as an angle",
    ),
}


@pytest.mark.parametrize(("lines", "says"), KNOWN.values(), ids=KNOWN)
def test_a_known_text_without_readings_is_named(lines: list[str], says: str, path: Path) -> None:
    with pytest.raises(NoMagnetometer, match=says):
        read(path, lines)


def test_two_axes_behind_time_stamps_are_read(path: Path) -> None:
    lines = [f"16:01:{n % 60:02d}.000 -> {x:.2f},{y:.2f}" for n, (x, y, _) in enumerate(FIELD[:50].tolist())]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    (samples,) = open_recording(path, flat="xy").blocks()
    np.testing.assert_allclose(samples.field[:, :2], FIELD[:50, :2], atol=1e-9)
    assert samples.time is not None


@pytest.mark.parametrize(
    ("line", "pattern"),
    [
        ("16:01:19.000 <1/2/3/4>", "<{x}/{y}/{z}/{n4}>"),
        ("$PMAG,5.1 kn,1,2,3*3A", "$PMAG,{n1} kn,{x},{y},{z}"),
        ("2026-06-21 21:18:00 5 km/h 1 2", ""),
        ("heading 45 m 1 2 3", "heading {n1} m {x} {y} {z}"),
    ],
)
def test_a_pattern_takes_no_moment_check_sum_speed_or_angle_for_an_axis(line: str, pattern: str) -> None:
    assert pattern_of(line) == pattern


def test_json_names_accompanying_lines(path: Path, capsys: Any) -> None:  # noqa: ANN401
    path.write_text("\n".join(printed("labels", BESIDE["a word"])), encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["info", str(path), "--json"])
    assert "accompanying" in json.dumps(json.loads(capsys.readouterr().out))
