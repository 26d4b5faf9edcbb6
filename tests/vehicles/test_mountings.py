"""A rotation of a calibration as a mounting: each firmware, with what is written for it, reads what it should.

Every firmware is written down here once more, line by line as its source has it, and gets what the sensor reads.
"""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import permutations, product
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders.apps.vehicles.targets.ardupilot import ORIENTATIONS
from flinders.apps.vehicles.targets.px4 import MOUNTINGS
from flinders.arrays import to_floats
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import ProvenanceRecord, SourceFile
from flinders.core.units import Unit
from flinders.errors import NotExportable, UsageError
from flinders.fitting.export import export_fit
from flinders.fitting.fit_file import fit_from
from flinders.targets import ExportOptions, find
from flinders.targets._mounting import angles, apart_deg, euler

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

SOFT = np.array([[1.10, 0.05, -0.02], [0.05, 0.91, 0.03], [-0.02, 0.03, 1.02]])
HARD = np.array([12.0, -31.0, 7.0])
READINGS = 60.0 * np.random.default_rng(3).normal(size=(50, 3))
NOW = {"ardupilot": "YAW_90", "px4": "6", "betaflight": "CW270FLIP", "inav": "CW90"}
"""How the compass was mounted when it was recorded."""


def about(axis: int, degrees: float) -> Floats:
    """Rotation about one axis."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turned = np.eye(3)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turned[one, one] = turned[two, two] = c
    turned[one, two], turned[two, one] = -s, s
    return turned


def right_angles() -> list[Floats]:
    """The 24 rotations by right angles."""
    signed = (
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    )
    return [matrix for matrix in signed if np.linalg.det(matrix) > 0]


def anyhow(count: int) -> list[Floats]:
    """Rotations of no particular angle, all over."""
    quaternions = np.random.default_rng(8).normal(size=(count, 4))
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    return list(np.moveaxis(rows, -1, 0))


def named(name: str) -> Floats:
    """A mounting of ArduPilot and PX4 by its name: roll first, then pitch, then yaw."""
    words = name.split("_")
    turned: Floats = np.eye(3)
    for word, value in zip(words[::2], words[1::2], strict=False):
        turned = about(["ROLL", "PITCH", "YAW"].index(word), float(value)) @ turned
    return turned


# firmware: what a sensor reads, in its own axes, to what the vehicle uses; `values` are what it holds


def ardupilot(values: Mapping[str, Any], raw: Floats) -> Floats:
    """AP_Compass_Backend::rotate_field and correct_field; AP_CustomRotation::init."""
    number = int(values.get("COMPASS_ORIENT", 2))
    assert number != 38
    custom = [values.get(f"CUST_ROT1_{axis}", 0.0) for axis in ("ROLL", "PITCH", "YAW")]
    turned: Floats = about(2, custom[2]) @ about(1, custom[1]) @ about(0, custom[0])
    if number == 101:
        assert values["CUST_ROT_ENABLE"] == 1
    else:
        turned = named(ORIENTATIONS[number][0])
    three = {name: np.array([values[f"COMPASS_{name}_{axis}"] for axis in "XYZ"]) for name in ("OFS", "DIA", "ODI")}
    xy, xz, yz = three["ODI"]
    iron = np.diag(three["DIA"]) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return to_floats(0.1 * ((10.0 * raw @ turned.T + three["OFS"]) * values["COMPASS_SCALE"]) @ iron.T)


def px4(values: Mapping[str, Any], raw: Floats) -> Floats:
    """Magnetometer::ParametersUpdate and Correct."""
    number = int(values.get("CAL_MAG0_ROT", 6))
    own = [values.get(f"CAL_MAG0_{axis}", 0.0) for axis in ("ROLL", "PITCH", "YAW")]
    assert (number == 100) == any(own)
    turned = about(2, own[2]) @ about(1, own[1]) @ about(0, own[0]) if any(own) else named(MOUNTINGS[number][0])
    offset, scale, beside = (
        np.array([values[f"CAL_MAG0_{axis}{group}"] for axis in "XYZ"]) for group in ("OFF", "SCALE", "ODIAG")
    )
    xy, xz, yz = beside
    iron = np.diag(scale) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return to_floats(100.0 * (raw / 100.0 - offset) @ (turned @ iron).T)


def switched(raw: Floats, name: str) -> Floats:
    """The eight cases of alignSensorViaRotation and applySensorAlignment."""
    x, y, z = raw.T
    return np.stack({
        "CW0": (x, y, z), "CW90": (y, -x, z), "CW180": (-x, -y, z), "CW270": (-y, x, z),
        "CW0FLIP": (-x, y, -z), "CW90FLIP": (y, x, -z), "CW180FLIP": (x, -y, -z), "CW270FLIP": (-y, -x, -z),
    }[name], axis=1)  # fmt: skip


def built(roll: float, pitch: float, yaw: float) -> Floats:
    """buildRotationMatrix and rotationMatrixFromAngles: the same entries in both."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(turns := np.deg2rad([roll, pitch, yaw])), np.sin(turns)
    return np.array([
        [cz * cy, -cy * sz, sy],
        [sz * cx + cz * sx * sy, cz * cx - sz * sx * sy, -sx * cy],
        [sz * sx - cz * cx * sy, cz * sx + sz * cx * sy, cy * cx],
    ])  # fmt: skip


def betaflight(values: Mapping[str, Any], raw: Floats) -> Floats:
    """compassUpdate since pull request 14849: angles with their signs reversed, the matrix transposed."""
    name = values.get("align_mag", NOW["betaflight"])
    if name == "CUSTOM":
        roll, pitch, yaw = (-int(values[f"mag_align_{axis}"]) / 10 for axis in ("roll", "pitch", "yaw"))
        return to_floats(raw @ built(roll, pitch, yaw) - values["mag_calibration"])
    return to_floats(switched(raw, name) - values["mag_calibration"])


def inav(values: Mapping[str, Any], raw: Floats) -> Floats:
    """compassInit and compassUpdate at 005b1ee7: angles that are not all 0 go before the name."""
    zero, gain = (np.array([values[f"{name}_{axis}"] for axis in "xyz"]) for name in ("magzero", "maggain"))
    corrected = np.trunc((raw - zero) * 1024 / gain)
    own = [values.get(f"align_mag_{axis}", 0) / 10 for axis in ("roll", "pitch", "yaw")]
    return corrected @ built(*own) if any(own) else switched(corrected, values.get("align_mag", NOW["inav"]))


FIRMWARE: dict[str, Callable[[Mapping[str, Any], Floats], Floats]] = {
    "ardupilot": ardupilot, "px4": px4, "betaflight": betaflight, "inav": inav,
}  # fmt: skip
IRON = {"ardupilot": SOFT, "px4": SOFT, "betaflight": np.eye(3), "inav": np.diag([1.1, 0.9, 1.0])}


def mounted(name: str) -> Floats:
    """(3, 3) the mounting in force at the time of the recording."""
    table = find(name).mountings
    assert table is not None
    return table.read(NOW[name])


def recorded(name: str, truth: Floats) -> Calibration:
    """What a fit finds for a sensor that is mounted by `truth`, and by `NOW` as the firmware has it."""
    now = mounted(name)
    raw = Unit.of("counts", 0.1) if name in ("betaflight", "inav") else Unit.of("uT")
    common: dict[str, Any] = {"field_strength": 50.0, "rotation": "estimated", "raw": raw}
    if find(name).acts == "mapped":  # readings are in the axes of the vehicle
        return Calibration(truth @ IRON[name] @ now.T, now @ HARD, frame="vehicle", **common)
    return Calibration(now.T @ truth @ IRON[name], HARD, **common)


@pytest.mark.parametrize("name", daily(FIRMWARE, 2))
def test_firmware_with_the_mounting_reads_what_it_should(name: str) -> None:
    """24 rotations by right angles and 100 others."""
    counts = name in ("betaflight", "inav")
    scale = 10.0 if counts else 1.0
    for truth in (*right_angles(), *anyhow(100)):
        export = find(name).render(recorded(name, truth), asked=ExportOptions(mounting=mounted(name)))
        used = FIRMWARE[name](export.fields["values"], scale * READINGS) / scale
        wanted = (READINGS - HARD) @ (truth @ IRON[name]).T
        if name == "inav":  # which makes corrected readings 1024 long
            used *= 500.0 / 1024.0
        # a tenth of a degree and whole counts, or float32
        npt.assert_allclose(used, wanted, atol=0.4 if counts else 2e-4)


@pytest.mark.parametrize("name", FIRMWARE)
def test_rotations_by_right_angles_are_set_by_number_or_name_where_there_is_one(name: str) -> None:
    by_angles = 0
    for truth in right_angles():
        export = find(name).render(recorded(name, truth), asked=ExportOptions(mounting=mounted(name)))
        values = export.fields["values"]
        by_angles += any("CUST_ROT" in one for one in values) or 100 in values.values() or "CUSTOM" in values.values()
        by_angles += name == "inav" and any(values.get(f"align_mag_{axis}") for axis in ("roll", "pitch", "yaw"))
    assert by_angles == {"ardupilot": 0, "px4": 0, "betaflight": 16, "inav": 16}[name]


@pytest.mark.parametrize("name", FIRMWARE)
def test_small_rotations_are_left_out_and_larger_ones_are_asked_about(name: str) -> None:
    now = mounted(name)
    small, large = (recorded(name, euler(0, 0, angle) @ now) for angle in (0.2, 0.4))
    for asked in (ExportOptions(), ExportOptions(mounting=now)):
        export = find(name).render(small, asked=asked)
        assert_sentences(export.warnings)
    with assert_raises(NotExportable, beyond=("matrix",)):
        find(name).render(large)
    assert any("mounting" in note for note in find(name).render(large, asked=ExportOptions(lossy=True)).fields["notes"])
    held = find(name).render(large, asked=ExportOptions(mounting=now)).fields
    assert held["checked"]["worst_deg"] < 0.25
    assert_sentences(held["notes"])


def test_the_log_says_how_the_compass_was_mounted() -> None:
    truth = euler(3.0, -8.0, 40.0)
    found = recorded("ardupilot", truth)
    file = SourceFile(
        name="f.bin", sha256="0" * 64, bytes=1, rows=1, autopilot="ardupilot", mounting=angles(mounted("ardupilot"))
    )
    fit = fit_of(found, file)
    values = export_fit(fit, find("ardupilot"))[0].fields["values"]
    turned = euler(*(values[f"CUST_ROT1_{axis}"] for axis in ("ROLL", "PITCH", "YAW")))
    assert apart_deg(turned, truth) < 1e-4
    other = fit_of(found, file, msgspec.structs.replace(file, mounting=(0.0, 0.0, 0.0)))
    with pytest.raises(NotExportable, match="mounting="):  # two logs that do not agree
        export_fit(other, find("ardupilot"))
    assert export_fit(other, find("ardupilot"), mounting="YAW_90")[0].fields["values"] == values


def fit_of(found: Calibration, *files: SourceFile) -> Fit:
    document = found.to_document(
        provenance=ProvenanceRecord(flinders="1", date=datetime(2026, 3, 1, tzinfo=UTC), files=files)
    )
    return fit_from(document)


@pytest.mark.parametrize(
    ("name", "words", "wanted"),
    [
        ("ardupilot", "8", euler(180, 0, 0)),
        ("ardupilot", "roll_180", euler(180, 0, 0)),
        ("ardupilot", "Rotation_Yaw_90", euler(0, 0, 90)),
        ("px4", "ROTATION_YAW_90", euler(0, 0, 90)),
        ("px4", "0,90,45", euler(0, 90, 45)),
        ("inav", "0,0,90", euler(0, 0, -90)),
        ("inav", "cw90", euler(0, 0, -90)),
        ("betaflight", " 0, 0, 90 ", euler(0, 0, 90)),
    ],
)
def test_mountings_are_read_as_the_firmware_has_them(name: str, words: str, wanted: Floats) -> None:
    table = find(name).mountings
    assert table is not None
    npt.assert_allclose(table.read(words), wanted, atol=1e-12)


@pytest.mark.parametrize("words", ["", "44", "-1", "UPSIDE_DOWN", "1,2", "1,2,x", "nan,0,0", "0,0,0,0"])
def test_what_is_no_mounting_is_refused_with_what_is(words: str) -> None:
    with assert_raises(UsageError):
        flinders.export(recorded("ardupilot", np.eye(3)), "ardupilot", mounting=words)


def test_targets_without_mountings_take_none() -> None:
    with assert_raises(UsageError):
        flinders.export(recorded("px4", np.eye(3)), "c", mounting="0")
