"""What is written for each target, put through the target's own formula as its sources have it, is the calibration.

The formulas stand here a second time, and take their numbers from the file that was written, rounded to what the target
keeps.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

from flinders import simulate
from flinders.arrays import Floats, to_floats
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import PER_UNIT, Unit
from flinders.errors import DocumentError, InputError, NotExportable, UnitError, UsageError
from flinders.targets import ExportOptions, find, motioncal, read_back, registry, vectornav
from flinders.targets._code_text import digits
from flinders.targets._comments import BLOCK, HASH, MARKUP, plain_ascii
from flinders.targets._mounting import euler
from flinders.targets._numbers import nearest_diagonal
from flinders.targets._target import AXES_WORDS, CAPACITY_WORDS, MOUNTING_KINDS
from flinders.targets.motioncal import symmetric_root

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.targets import Export, Target

ROWS = [row for row in registry().values() if not row.name.startswith("adis")]
"""The registers of the ADIS have tests of their own."""

UPRIGHT = ExportOptions(mounting=np.eye(3))
"""The sensor sits as the vehicle does, which a target of mountings has to be told."""

COUNT_UT = 0.15
"""µT in one count of the sensors below."""


def sensor(seed: int, unit: str = "mG", axes: str = "x,y,z", keeps: str = "all") -> Calibration:
    """A calibration with as much soft iron as the target keeps."""
    random = np.random.default_rng(seed)
    soft = {
        "all": np.eye(3) + random.normal(0, 0.08, (3, 3)),
        "diagonal": np.diag(random.uniform(0.8, 1.25, 3)),
        "offset": np.eye(3),
    }[keeps]
    matrix = (soft + soft.T) / 2
    raw = Unit.of("counts", COUNT_UT) if unit == "counts" else Unit.of(unit)
    return Calibration(matrix, random.normal(0, 25, 3), 48.0, True, raw=raw, axes=Axes.of(axes))


def readings(calibration: Calibration) -> Floats:
    """(1000, 3) what the sensor reads, µT, in the axes as recorded."""
    back = calibration.axes.apply(np.eye(3))
    field = simulate.uniform_directions(np.random.default_rng(9), 1000) * calibration.field_strength
    return calibration.unapply(field) @ back.T


def rendered(name: str, calibration: Calibration, **asked: Any) -> Export:
    return find(name).render(calibration, about=["from a test"], asked=ExportOptions(**asked))


# the formulas, each from its source (formats.md, section 3)


def f32(values: object) -> Floats:
    return np.asarray(values, np.float32).astype(np.float64)


def pairs(text: str, pattern: str) -> dict[str, float]:
    return {name: float(value) for name, value in re.findall(pattern, text, re.MULTILINE)}


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Floats:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def lists(text: str, count: int) -> Floats:
    """The last `count` numbers of some code, without its comments."""
    code = re.sub(r"/\*.*?\*/|^\s*[#%].*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    found = re.findall(r"(?<![\w.])-?\d+\.\d*(?:e[-+]?\d+)?(?=f?\b)", code)
    return f32([float(word) for word in found][-count:])


def motioncal_packet(export: Export, r: Floats) -> Floats:
    assert export.data is not None
    values = struct.unpack_from("<16f", export.data, 2)
    return to_floats((r - np.array(values[6:9])) @ symmetric(*values[10:16]).T)


def sensorlab(export: Export, r: Floats) -> Floats:
    p = json.loads(export.text)
    return to_floats((r - f32(p["mag_hardiron"])) @ f32(p["mag_softiron"]).reshape(3, 3).T)


def subtracted(export: Export, r: Floats) -> Floats:
    numbers = lists(export.text, 12)
    return to_floats((r - numbers[9:]) @ numbers[:9].reshape(3, 3).T)


def fusion_old(export: Export, r: Floats) -> Floats:
    numbers = lists(export.text, 12)
    return to_floats(r @ numbers[:9].reshape(3, 3).T - numbers[9:])


def zscilib(export: Export, r: Floats) -> Floats:
    numbers = lists(export.text, 12)
    return to_floats((r + numbers[9:]) @ numbers[:9].reshape(3, 3).T)


def rtimulib(export: Export, r: Floats) -> Floats:
    assert "CompassCalValid=true" in export.text
    assert "compassCalEllipsoidValid=true" in export.text
    p = {name: float(np.float32(value)) for name, value in pairs(export.text, r"^(\w+)=([-\d.]+)$").items()}
    low, high = (np.array([p[f"CompassCal{end}{axis}"] for axis in "XYZ"]) for end in ("Min", "Max"))
    delta = high - low
    matrix = np.array([[p[f"compassCalCorr{row}{column}"] for column in (1, 2, 3)] for row in (1, 2, 3)])
    scaled = (r - (low + high) / 2) * (delta.max() / delta)
    return to_floats((scaled - [p[f"compassCalOffset{axis}"] for axis in "XYZ"]) @ matrix.T)


def register23(export: Export, r: Floats) -> Floats:
    words = export.text.strip().partition("*")[0].split(",")
    assert words[:2] == ["$VNWRG", "23"]
    numbers = f32([float(word) for word in words[2:]])
    return to_floats((r - numbers[9:]) @ numbers[:9].reshape(3, 3).T)


def esphome(export: Export, r: Floats) -> Floats:
    found = re.findall(r"(-?[\d.]+(?:e-?\d+)?)f \* \(id\(field_strength_(.)\).state - \((\S+)f\)\)", export.text)
    assert [axis for _, axis, _ in found] == list("xyz") * 3
    rows = f32([float(gain) for gain, _, _ in found]).reshape(3, 3)
    offsets = f32([float(offset) for _, _, offset in found]).reshape(3, 3)
    return np.stack([np.sum(row * (r - offset), axis=1) for row, offset in zip(rows, offsets, strict=True)], axis=1)


def matlab(export: Export, r: Floats) -> Floats:
    """The two literals of the file, and its last line by hand: there is no Octave here to run it."""
    b, a = (re.search(rf"^  {name} = \[([^\]]*)\];$", export.text, re.MULTILINE) for name in "bA")
    assert a
    assert b
    assert "C = bsxfun(@minus, D, b) * A;" in export.text
    rows = np.array([[float(word) for word in row.split()] for row in a[1].split(";")])
    return to_floats((r - [float(word) for word in b[1].split()]) @ rows)


def micropython(export: Export, r: Floats) -> Floats:
    module: dict[str, Any] = {}
    exec(compile(export.text, "flinders_calibration.py", "exec"), module)
    return np.array([module["correct"](tuple(row)) for row in r])


def fixed(form: tuple[int, int]) -> Callable[[Export, Floats], Floats]:
    fraction, largest = form

    def run(export: Export, r: Floats) -> Floats:
        """In whole numbers of Python, which do not overflow, from the numbers in the header."""
        shift = int(re.findall(r"units of 2\^-(\d+)", export.text)[0])
        body = export.text.partition("flinders_matrix[3][3] = {")[2].partition("};")[0]
        rows = [[int(word) for word in row.split(",")] for row in re.findall(r"\{(.*?)\}", body)]
        offset = [int(word) for word in re.search(r"offset\[3\] = \{(.*?)\}", export.text)[1].split(",")]  # type: ignore[index]
        found = []
        for reading in np.rint(r).astype(int).tolist():
            moved = [(value << fraction) - b for value, b in zip(reading, offset, strict=True)]
            sums = [sum(a * d for a, d in zip(row, moved, strict=True)) for row in rows]
            found.append([(total + (1 << (shift + fraction - 1))) >> (shift + fraction) for total in sums])
        return to_floats(np.clip(np.array(found, float), -largest - 1, largest))

    return run


def plain(export: Export, r: Floats) -> Floats:
    p = json.loads(export.text) if export.text.startswith("{") else export.fields["values"]
    return to_floats((r - p["offset"]) @ np.array(p["matrix"]).T)


FORMULAS: dict[str, Callable[[Export, Floats], Floats]] = {
    "motioncal": motioncal_packet, "adafruit-eeprom": motioncal_packet, "sensorlab": sensorlab, "fusion": subtracted,
    "fusion-python": subtracted, "fusion-1.1": fusion_old, "rtimulib": rtimulib, "vectornav": register23,
    "esphome": esphome, "zscilib": zscilib, "matlab": matlab, "arduino": subtracted, "micropython": micropython,
    "c-q15": fixed((8, 2**15 - 1)), "c-q31": fixed((4, 2**23 - 1)), "json": plain, "yaml": plain,
}  # fmt: skip
"""The header in single precision is compiled and run elsewhere."""

BOUND_UT = {
    # half a unit (0.1 µT) of the reading times the largest gain, and half a unit of the result
    "c-q15": 3**0.5 * 0.1 * (0.5 * 1.5 + 0.5),
    "c-q31": 3**0.5 * 0.1 * (0.5 * 1.5 + 0.5),
}
"""What rounding allows, in µT; elsewhere that of single precision."""
SINGLE_UT = 1e-4


def test_every_formula_here_is_of_a_target() -> None:
    """A new target may have its own here as well; its golden file is reviewed in any case."""
    assert {*FORMULAS, "c"} <= {row.name for row in ROWS}


def assert_formula(name: str, formula: Callable[[Export, Floats], Floats], axes: str, bound: float) -> None:
    """A target's own formula gives the calibration within a bound in µT, on 1,000 readings all around."""
    row = find(name)
    for seed in range(3):
        keeps = row.keeps if row.keeps in {"diagonal", "offset"} else "all"
        given = sensor(seed, "counts" if row.unit == "counts" else "mG", axes, keeps)
        export = rendered(name, given)
        raw, own = readings(given), {"own": 1.0, "recorded": given.raw.scale, "counts": COUNT_UT}
        size = own.get(row.unit) or PER_UNIT[row.unit]
        gives = own[row.gives] if row.gives else size
        fed = given.axes.apply(raw) if row.acts == "mapped" else raw
        found = formula(export, fed / size) * gives
        if row.acts == "recorded":
            found = given.axes.apply(found)
        expected = given.apply(given.axes.apply(raw))
        if row.lengths:
            found = found * np.sum(found * expected) / np.sum(found**2)
        assert np.linalg.norm(found - expected, axis=1).max() <= bound
        assert export.fields["checked"]["worst"] <= bound


@pytest.mark.parametrize("axes", ["x,y,z", "x,-y,-z", "-z,x,-y"])
@pytest.mark.parametrize("name", FORMULAS)
def test_the_targets_own_formula_gives_the_calibration(name: str, axes: str) -> None:
    """With three mountings and three sensors."""
    assert_formula(name, FORMULAS[name], axes, BOUND_UT.get(name, SINGLE_UT))


# what does not fit


def test_lengths_are_those_that_a_target_wants() -> None:
    """B of MotionCal, whose matrix has determinant 1."""
    export = rendered("motioncal", sensor(1))
    matrix, radius = export.fields["values"]["matrix"], export.fields["values"]["field"]
    assert np.linalg.det(matrix) == pytest.approx(1, abs=1e-6)
    lengths = np.linalg.norm(motioncal_packet(export, readings(sensor(1))), axis=1)
    npt.assert_allclose(lengths, radius, rtol=1e-5)


def test_signs_worked_by_hand() -> None:
    """An offset of +10, −20, +30 µT: who adds, who subtracts, and in which unit."""
    given = Calibration(np.diag([1.25, 1.0, 0.8]), np.array([10.0, -20, 30]), 50.0, raw=Unit.of("uT"))
    assert "hardIronOffset = {10.0f, -20.0f, 30.0f};" in rendered("fusion", given).text
    assert "hardIronOffset = {12.5f, -20.0f, 24.0f};" in rendered("fusion-1.1", given).text
    assert "magn_b[3] = { -10.0, 20.0, -30.0 };" in rendered("zscilib", given).text


# what does not fit


def test_the_diagonal_left_over_is_the_one_that_costs_least() -> None:
    matrix = sensor(5).matrix
    found = nearest_diagonal(matrix)
    left = [np.linalg.norm(np.diag(found * factor) @ np.linalg.inv(matrix) - np.eye(3)) for factor in (0.99, 1, 1.01)]
    assert left[1] < min(left[0], left[2])
    npt.assert_allclose(nearest_diagonal(np.diag([2.0, 1.0, 0.5])), [2.0, 1.0, 0.5])


def test_a_rotation_that_a_symmetric_matrix_cannot_hold_is_refused() -> None:
    given = replace(sensor(1), matrix=euler(0, 0, 5) @ sensor(1).matrix, rotation="estimated")
    with assert_raises(NotExportable, beyond=("matrix",)):
        rendered("motioncal", given)
    assert rendered("vectornav", given).fields["checked"]["worst_deg"] < 1e-4
    npt.assert_allclose(symmetric_root(given.matrix), symmetric_root(given.matrix).T)
    npt.assert_allclose(symmetric_root(given.matrix), sensor(1).matrix, atol=1e-9)


def test_whole_numbers_that_are_too_large_are_named() -> None:
    with assert_raises(NotExportable):
        rendered("c-q15", Calibration(np.eye(3), np.array([40000.0, 0, 0]), 500.0))


def test_whole_numbers_of_too_large_a_unit_are_refused() -> None:
    """50 µT in whole microtesla is a degree."""
    with assert_raises(NotExportable):
        rendered("c-q15", sensor(0, "uT"))
    fine = rendered("c-q15", Calibration(np.eye(3), np.zeros(3), 20.0, raw=Unit.of("nT")))
    assert fine.fields["checked"]["worst_deg"] < 0.003


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_units_that_cannot_be_had_are_told_with_what_to_do(row: Target) -> None:
    in_counts = Calibration(np.eye(3), np.array([10.0, 20, 30]), 400.0)
    if row.unit in {"own", "recorded", "counts"}:
        assert row.render(in_counts, asked=UPRIGHT).target == row.name
    else:
        with pytest.raises(UnitError, match="scale="):
            row.render(in_counts)
    if row.unit == "counts":
        with pytest.raises(UnitError, match="unit='counts'"):
            row.render(sensor(0))


@pytest.mark.parametrize("name", ["vectornav", "rtimulib", "c-q15"])
def test_rounding_that_leaves_nothing_of_a_reading_is_refused_also_with_lossy(name: str) -> None:
    """Six or seven decimals of 10⁻⁹ are zeros: no heading is left to be wrong."""
    with assert_raises(NotExportable):
        rendered(name, Calibration(1e-9 * np.eye(3), np.array([1.0, 2, 3]), 50.0, raw=Unit.of("uT")), lossy=True)


def test_a_matrix_that_is_symmetric_but_for_rounding_loses_nothing() -> None:
    whole = sensor(2)
    rounded = replace(whole, matrix=whole.matrix + 1e-13 * np.triu(np.ones((3, 3)), 1), rotation="composed")
    assert rendered("motioncal", rounded).warnings == ()


# what is written besides the numbers


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_comments_say_what_it_is_and_cannot_be_ended_from_outside(row: Target) -> None:
    keeps = row.keeps if row.keeps in {"diagonal", "offset"} else "all"
    given = sensor(0, "counts" if row.unit == "counts" else "mG", keeps=keeps)
    evil = "x */ int main; /* --> <evil/> \n set evil = 1\u2028evil: 1\x85evil\r\nevil\x1b[2J ??/ é"
    export = row.render(given, about=[f"from {evil}"], asked=UPRIGHT)
    assert export.text.isascii()
    assert "\x1b" not in export.text
    clean = row.render(given, about=["from x"], asked=UPRIGHT)
    if export.has_comments:
        assert "checked: its own formula" in export.text
        assert row.formula.split()[0] in export.text
        assert all(len(line) < 130 for line in export.text.splitlines() if "evil" in line)
    body = clean.text.splitlines()
    lines = export.text.splitlines()
    extra = [line for line in lines if "evil" in line]
    assert all(line.startswith(("# ", "% ", " * ", "  ")) for line in extra)
    assert lines[-3:] == body[-3:]
    assert "evil" not in re.sub(r"/\*.*?\*/|<!--.*?-->|^[#%].*?$", "", export.text, flags=re.DOTALL | re.MULTILINE)
    assert export.data == clean.data


def test_comments_of_all_kinds_are_closed_once() -> None:
    for comment, closing in ((BLOCK, "*/"), (MARKUP, "-->")):
        text = "\n".join(comment.lines(["a */ b --> c -----> */*/ /*/ <!-- d"]))
        assert text.count(closing) == 1
        assert text.endswith(closing)
    assert HASH.lines(["one\ntwo"]) == ["# one\\ntwo"]
    assert plain_ascii("48 µT ± 0.1°") == "48 uT +/- 0.1 deg"


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, 0.1, -1e-12, 123456789.0, 1e20])
def test_numbers_are_read_back_as_they_were(value: float) -> None:
    assert np.float32(digits(value)) == np.float32(value)
    assert re.fullmatch(r"-?\d+\.\d*(e[-+]?\d+)?|-?\d+e[-+]?\d+|-?\d+\.\d+", digits(value))


@pytest.mark.parametrize(
    ("program", "name"),
    [
        ("ekf2", "px4"),
        ("EKF3", "ardupilot"),
        ("robot_localization", "ros-madgwick"),
        ("imu_filter_madgwick", "ros-madgwick"),
        ("micropythn", "micropython"),
    ],
)
def test_the_program_around_a_target_is_answered_with_that_target(program: str, name: str) -> None:
    with pytest.raises(UsageError, match=f"did you mean '{name}'"):
        find(program)


def test_the_table_is_complete() -> None:
    for name, row in registry().items():
        assert row.name == name
        assert row.keeps in CAPACITY_WORDS
        assert row.acts in AXES_WORDS
        assert row.source
        assert row.storage
        assert row.unit in {*PER_UNIT, "counts", "own", "recorded"}


# there and back


READABLE = [row.name for row in registry().values() if row.reader and row.keeps not in MOUNTING_KINDS]


IN_COUNTS = [name for name in READABLE if find(name).unit == "counts"]


@pytest.mark.parametrize("name", [name for name in READABLE if name not in IN_COUNTS])
def test_what_was_written_is_read_back(name: str) -> None:
    """The correction comes back to single precision (VectorNav: to seven decimals), found by its content."""
    given = sensor(7, "mG", keeps=find(name).keeps if find(name).keeps in {"diagonal", "offset"} else "all")
    export = rendered(name, given)
    content = export.data if export.data is not None else export.text.encode()
    found, back = read_back(content, "file", strength=48.0)
    assert find(found).reader == find(name).reader
    raw = readings(given)
    out, expected = back.apply(raw), given.apply(raw)
    if find(name).lengths:
        out = out * np.sum(out * expected) / np.sum(out**2)
    assert np.linalg.norm(out - expected, axis=1).max() < SINGLE_UT
    assert read_back(content, "file", target=name, strength=48.0)[1].isclose(back)


def test_a_packet_made_elsewhere_is_read() -> None:
    """Laid out here by hand, with the CRC of a bitwise loop from the high end of the reflected polynomial."""
    body = b"\x75\x54" + struct.pack("<16f", *[0.0] * 6, 1.5, -2.5, 3.5, 48.0, 1.0, 1.1, 0.9, 0.01, 0.02, 0.03)
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc % 2 else crc >> 1
    packet = motioncal.MotionCalPacket.decode(body + struct.pack("<H", crc))
    npt.assert_allclose(packet.offset, [1.5, -2.5, 3.5])
    npt.assert_allclose(packet.matrix, [[1, 0.01, 0.02], [0.01, 1.1, 0.03], [0.02, 0.03, 0.9]], atol=1e-7)
    assert packet.strength == 48.0
    assert packet.encode() == body + struct.pack("<H", crc)


def test_every_flipped_bit_of_a_packet_is_noticed() -> None:
    data = rendered("motioncal", sensor(0)).data
    assert data is not None
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DocumentError):
            motioncal.MotionCalPacket.decode(bytes(damaged))


def test_a_file_of_one_compass_has_no_other() -> None:
    with assert_raises(UsageError):
        read_back(rendered("rtimulib", sensor(0)).text.encode(), "RTIMULib.ini", compass=1)


def test_settings_with_extremes_of_their_own_are_composed() -> None:
    """RTIMULib after its first step alone, or with an ellipsoid behind it: off and scale are those of the file."""
    text = rendered("rtimulib", sensor(1)).text
    text = re.sub("(CompassCalMinX)=.*", r"\1=-30.0", re.sub("(CompassCalMaxY)=.*", r"\1=60.0", text))
    _, back = read_back(text.encode(), "RTIMULib.ini")
    raw = readings(sensor(1))
    export = replace(rendered("rtimulib", sensor(1)), text=text)
    npt.assert_allclose(back.apply(raw), rtimulib(export, raw), atol=SINGLE_UT)
    _, first = read_back(text.replace("compassCalEllipsoidValid=true", "").encode(), "RTIMULib.ini")
    npt.assert_allclose(first.offset[:2], [(48 - 30) / 2, (60 - 48) / 2])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b'{"formula": "corrected = matrix (raw - offset)"}',
        b'{"formula": "corrected = matrix (raw - offset)", "unit": "uT", "matrix": 7}',
        b"\x75\x54\x00",
        b"\x75\x54" + bytes(66),
        b"$VNWRG,23,1,2*00",
        b"$VNWRG,23,1,2*XX",
        b"$VNWRG,24,1,2*XX",
        b"$VNWRG,23,1,0,0,0,1,0,0,0,nan,0,0,0*XX",
        b'{"mag_hardiron": [1, 2, 3]}',
        b'{"mag_hardiron": [1, 2, "x"], "mag_softiron": [1,0,0,0,1,0,0,0,1]}',
        b'{"mag_hardiron": ',
        b"CompassCalValid=false\n",
        b"CompassCalValid=true\n",
    ],
)
def test_files_that_are_damaged_or_none_are_refused_with_a_message(content: bytes) -> None:
    with assert_raises(InputError):
        read_back(content, "file")


def test_targets_that_cannot_be_read_back_say_which_can() -> None:
    with assert_raises(UsageError):
        read_back(b"function C = flinders_correct(D)", "flinders_correct.m", target="matlab")


def test_the_checksum_is_that_of_the_manual() -> None:
    """UM001 has $VNRRG,01*72 and $VNWRG,06,0*6C as examples."""
    assert f"{vectornav.checksum('VNRRG,01'):02X}" == "72"
    line = rendered("vectornav", sensor(0)).text.strip()
    body, _, stated = line[1:].partition("*")
    total = 0
    for letter in body:
        total ^= ord(letter)
    assert int(stated, 16) == total
