"""Lines of a wire become readings as the lines of a file do, and a recording as it was printed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.readers.test_printed_lines import FIELD, GRAVITY, axes, read, words
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.errors import InputError, NoMagnetometer
from flinders.links.recording_text import escape_bytes
from flinders.links.transcript import Transcript
from flinders.readers import TextRecording

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


def test_escaped_bytes_can_be_restored() -> None:
    assert escape_bytes(b"\xff\x00 42 \\") == "\\xff\\x00 42 \\\\"
    assert escape_bytes(b"\xff\x00 42 \\").encode().decode("unicode_escape").encode("latin-1") == b"\xff\x00 42 \\"


def test_a_board_that_prints_of_several_is_read_of_the_first_and_said() -> None:
    lines = [f'{{"node": {row % 3}, "mx": {row}, "my": 2, "mz": 3}}\n' for row in range(90)]
    transcript = Transcript("the gateway")
    taken = [transcript.take(line.encode(), at / 50) for at, line in enumerate(lines)]
    field = np.concatenate([each.readings.field for each in taken if each.readings is not None])
    np.testing.assert_array_equal(field[:, 0], range(0, 90, 3))
    (event,) = (event for each in taken for event in each.events if event.kind == "several")
    assert_sentences(event.words)
    assert "".join(each.text for each in taken).count(",2,3\n") == 90


TURNS = np.column_stack([np.ones(len(FIELD)), FIELD / 50])
QUATERNIONS = TURNS / np.linalg.norm(TURNS, axis=1, keepdims=True)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "print.txt"


REFUSED = {
    "acceleration by label": ([f"Accel {axes(row)}" for row in GRAVITY], "acceleration and no magnetometer"),
    "acceleration by unit": ([f"{axes(row)} m/s^2" for row in GRAVITY], "acceleration and no magnetometer"),
    "orientation": ([f"Orientation {axes(row)}" for row in GRAVITY], "and no magnetometer"),
    "angles": (["Yaw: {:.1f} Pitch: {:.1f} Roll: {:.1f}".format(*row) for row in GRAVITY], "and no magnetometer"),
    "places": (["Lat: {:.5f} Lon: {:.5f} Alt: {:.1f}".format(*row) for row in GRAVITY], "columns="),
    "offsets": (["Hard iron offset: {:.2f} {:.2f} {:.2f}".format(*row) for row in FIELD], "no readings|columns="),
    "sensors in turn": (
        [str(tuple(row)) for both in zip(GRAVITY.tolist(), FIELD.tolist(), strict=True) for row in both],
        "no readings are recognised",
    ),
    "two kinds of three numbers": (
        [
            line
            for a, m in zip(GRAVITY, FIELD, strict=True)
            for line in ("<{}|{}|{}>".format(*a), "({}, {}, {})".format(*m))
        ],
        "no readings are recognised",
    ),
    "a label of more than three": (
        [f"MAG, {100 * n}, 0, " + ", ".join(map(str, row)) for n, row in enumerate(FIELD.tolist())],
        "may be the magnetometer.*columns='4,5,6'",
    ),
    "signs behind letters": ([axes(row).replace(": ", "") for row in FIELD], "no readings are recognised"),
    "angles behind a label": (["ypr\t{:.2f}\t{:.2f}\t{:.2f}".format(*row) for row in FIELD], "columns="),
    "angles in a tuple": ([f"Heading: {tuple(row)}" for row in FIELD.tolist()], "and no magnetometer"),
    "acceleration of the world": (["aworld {:.0f} {:.0f} {:.0f}".format(*row) for row in FIELD], "columns='2,3,4'"),
    "positions": ([f"pos {axes(row)}" for row in FIELD], "and no magnetometer"),
    "a quaternion with names": (
        ["w,x,y,z", *("{:.4f},{:.4f},{:.4f},{:.4f}".format(*row) for row in QUATERNIONS)],
        "w, x, y, z .a quaternion",
    ),
    "millimetres": (["x={:.1f}mm y={:.1f}mm z={:.1f}mm".format(*row) for row in FIELD], "no readings are recognised"),
    "labels that change": ([f"a{n:06x}: mag {int(row[0])} 2 3" for n, row in enumerate(FIELD)], "columns="),
    "sensors in turn by a key": (
        [
            json.dumps({"sensor": sensor, **dict(zip("xyz", row, strict=True))})
            for both in zip(GRAVITY.tolist(), FIELD.tolist(), strict=True)
            for sensor, row in zip(("accelerometer", "gyroscope"), both, strict=True)
        ],
        "names the sensor of each line, such as 'accelerometer': keep the lines of the magnetometer",
    ),
    "decimal commas": ([axes(row).replace(".", ",") for row in FIELD], "say which are the magnetometer"),
}


@pytest.mark.parametrize(("lines", "says"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_magnetometer_is_not_read_as_one(lines: list[str], says: str, path: Path) -> None:
    with pytest.raises(InputError, match=says):
        read(path, lines)
    transcript = Transcript("the board")
    taken = transcript.take("\n".join([*lines, ""]).encode(), at=1.0)
    assert taken.readings is None


def test_readings_that_begin_like_comments_are_read_by_a_pattern_which_the_refusal_names(path: Path) -> None:
    lines = ["#M-R={:.2f},{:.2f},{:.2f}".format(*row) for row in FIELD]
    with assert_raises(InputError, "unreadable"):
        read(path, lines)
    np.testing.assert_allclose(read(path, lines, pattern="#M-R={x},{y},{z}").field, FIELD, atol=1e-9)
    transcript = Transcript("the board")
    transcript.take("\n".join([*lines, ""]).encode(), at=1.0)
    assert_sentences(transcript.nothing())


def recorded(lines: Iterable[str]) -> str:
    """What the recorder writes of these lines."""
    transcript = Transcript("the board", is_framed=True)
    return transcript.take("\n".join(lines).encode(), at=1.0).text


BOTH = np.hstack([GRAVITY, FIELD]).round(2).tolist()


def test_a_table_with_words_before_its_numbers_is_recorded(path: Path) -> None:
    text = recorded(["$IMU," + ",".join(map(str, row)) for row in BOTH])
    assert text.startswith("t_s,c1,c2,c3,c4,c5,c6,c7\n")
    np.testing.assert_allclose(read(path, text.splitlines(), columns="c5,c6,c7").field, FIELD, atol=1e-9)


def test_a_message_with_numbers_does_not_settle_how_readings_are_written(path: Path) -> None:
    transcript = Transcript("the board", is_framed=True)
    transcript.take(b"range is 2 4 8 gauss", at=0.0)
    transcript.take(b"", at=2.0)
    text = transcript.take("\n".join(f"{axes(row)} uT" for row in FIELD).encode(), at=3.0).text
    np.testing.assert_allclose(read(path, text.splitlines()).field, FIELD, atol=1e-9)


def test_the_sensors_of_a_header_of_two_lines_are_recorded(path: Path) -> None:
    lines = ["Acc,,,Mag,,", "x,y,z,x,y,z", *(",".join(map(str, row)) for row in BOTH)]
    np.testing.assert_allclose(read(path, recorded(lines).splitlines()).field, FIELD, atol=1e-9)


def test_numbers_of_columns_count_what_is_printed_also_live() -> None:
    """Nine numbers without names: the recording has a time before them."""
    gravity = [(0.1 * number, -9.0, 3.0) for number in range(len(FIELD))]
    lines = [
        ",".join(f"{value:.2f}" for value in (*g, *g, *row)) for g, row in zip(gravity, FIELD.tolist(), strict=True)
    ]
    transcript = Transcript("the board", columns="7,8,9", unit="uT")
    taken = transcript.take("".join(f"{line}\n" for line in lines).encode(), at=1.0)
    assert taken.readings is not None
    np.testing.assert_allclose(taken.readings.field, np.round(FIELD[1:], 2), atol=1e-9)
    assert any("c7, c8, c9" in event.words for event in taken.events)


@pytest.mark.parametrize("first", [1000, 9700])
def test_a_decimal_time_before_hexadecimal_words_stays_decimal_when_recorded(first: int, path: Path) -> None:
    text = recorded([f"{first + 20 * n} {words(row)}" for n, row in enumerate(FIELD)])
    found = read(path, text.splitlines())
    np.testing.assert_array_equal(found.field, np.trunc(8 * FIELD))
    assert found.time is not None
    np.testing.assert_allclose(np.diff(found.time), 0.02)


@pytest.mark.parametrize("form", ["{:8.2f}{:8.2f}{:8.2f}", "0.5 {:8.2f}{:8.2f}{:8.2f} 7"])
def test_decimals_that_fill_columns_of_a_fixed_width_are_read_apart(form: str, path: Path) -> None:
    """``2995.10-5044.85``: a minus takes the place of the space; also in `record`, and corrected by `apply`."""
    lines = [form.format(*row) for row in 100 * FIELD]
    columns = "2,3,4" if form.startswith("0.5") else None
    found = read(path, lines, columns=columns)
    np.testing.assert_allclose(found.field, 100 * FIELD, atol=0.006)
    recording = flinders.open_recording(path, columns=columns)
    assert isinstance(recording, TextRecording)
    path.with_name("half.txt").write_text("".join(recording.corrected_lines(lambda field: field / 2)))
    np.testing.assert_allclose(flinders.read(path.with_name("half.txt"), columns=columns).field, 50 * FIELD, atol=0.006)
    transcript = Transcript("the board", is_framed=True, columns=columns)
    taken = transcript.take("".join(f"{line}\n" for line in lines).encode(), at=0.0)
    assert taken.readings is not None
    np.testing.assert_allclose(taken.readings.field, 100 * FIELD, atol=0.006)


@pytest.mark.parametrize("mark", ["{} ", "{}: ", "[{}] ", "S{}, ", "Sensor {}: "])
def test_numbers_of_sensors_before_readings_do_not_merge_two_sensors(mark: str, path: Path) -> None:
    lines = [mark.format(n % 2 + 1) + " ".join(f"{value:.2f}" for value in row) for n, row in enumerate(FIELD)]
    with assert_raises(NoMagnetometer):
        read(path, lines)
    transcript = Transcript("the board", is_framed=True)
    taken = transcript.take("\n".join(lines).encode(), at=1.0)
    assert taken.readings is None
    assert all(f"{row[0]:.2f}" in taken.text for row in FIELD)


def test_a_number_that_stands_apart_from_a_label_is_that_of_a_sensor(path: Path) -> None:
    lines = [f"Mag {n % 2 + 1}: {axes(row)}" for n, row in enumerate(FIELD)]
    np.testing.assert_array_equal(read(path, lines, sensor="2").field, FIELD[1::2])
    text = recorded(lines)
    np.testing.assert_array_equal(read(path, text.splitlines(), sensor="2").field, FIELD[1::2])


def test_m_is_the_magnetometer_where_b_may_be_a_bias(path: Path) -> None:
    lines = ["bx,by,bz,mx,my,mz", *(f"1,2,3,{row[0]},{row[1]},{row[2]}" for row in FIELD)]
    np.testing.assert_array_equal(read(path, lines).field, FIELD)
    np.testing.assert_array_equal(read(path, recorded(lines).splitlines()).field, FIELD)


@pytest.mark.parametrize("sign", [",", "\t", " "])
def test_a_row_of_units_is_recorded_as_units_and_is_no_reading(sign: str, path: Path) -> None:
    names, units = sign.join(["mx", "my", "mz"]), sign.join(["mG"] * 3)
    lines = [names, units, *(sign.join(f"{value:.2f}" for value in row) for row in FIELD)]
    transcript = Transcript("the board", is_framed=True)
    taken = transcript.take("".join(f"{line}\n" for line in lines).encode(), at=0.0)
    assert (transcript.statistics.readings, transcript.statistics.unknown) == (len(FIELD), 0)
    path.write_text(taken.text, encoding="utf-8")
    found = flinders.read(path)
    assert found.unit.name == "mG"
    np.testing.assert_allclose(found.field, FIELD / 10)
    assert taken.readings is not None
    np.testing.assert_allclose(taken.readings.field, FIELD / 10)
