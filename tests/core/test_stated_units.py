"""Units in names, in a column, in a line above or in the definition of a format, and of times that state none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.readers.test_json_arrangements import FIELD, ROWS, STEP_S, TIMES
from tests.sentences import assert_sentences

import flinders
from flinders.readers._names import meaning

if TYPE_CHECKING:
    from pathlib import Path

TABLES: Final = {
    "Chinese words": (
        ["时间\t磁场X(uT)\t磁场Y(uT)\t磁场Z(uT)"],
        "{t}\t{x}\t{y}\t{z}",
        "磁场X(uT),磁场Y(uT),磁场Z(uT)",
        "uT",
    ),
    "numbers of channels": (["t,v1 [nT],v2 [nT],v3 [nT]"], "{t},{x},{y},{z}", "v1 [nT],v2 [nT],v3 [nT]", "nT"),
    "words behind": (["t;a_mGauss;b_mGauss;c_mGauss"], "{t};{x};{y};{z}", "2,3,4", "mG"),
    "gravity in lower case": (["t;a (g);b (g);c (g)"], "{t};{x};{y};{z}", "2,3,4", "counts"),
    "an axis in words": (["elapsed (s),x-axis (T),y-axis (T),z-axis (T)"], "{t},{x},{y},{z}", None, "T"),
    "a Chinese unit": (["t,mag_x(毫高斯),mag_y(毫高斯),mag_z(毫高斯)"], "{t},{x},{y},{z}", None, "mG"),
    "a unit in a camel's name": (["t,UncalMagXMicroT,UncalMagYMicroT,UncalMagZMicroT"], "{t},{x},{y},{z}", None, "uT"),
    "a column of units": (["t,bx,by,bz,units"], "{t},{x},{y},{z},gauss", None, "G"),
    "a column of one unit, first": (["Unit\tt\tmx\tmy\tmz"], "nT\t{t}\t{x}\t{y}\t{z}", None, "nT"),
    "a column of two units": (["t,bx,by,bz,units"], "{t},{x},{y},{z},{odd}", None, "counts"),
    "a line above": (["Unit is milliGauss", "t mx my mz"], "{t} {x} {y} {z}", None, "mG"),
    "a remark above": (["# magnetic field units: micro Tesla", "t,mx,my,mz"], "{t},{x},{y},{z}", None, "uT"),
    "a cell above": (['"Unit","nT"', "t,mx,my,mz"], "{t},{x},{y},{z}", None, "nT"),
    "a line above of another sensor": (["Acc unit: mG", "t,mx,my,mz"], "{t},{x},{y},{z}", None, "counts"),
    "names before a line above": (["# unit: mG", "t,mx_uT,my_uT,mz_uT"], "{t},{x},{y},{z}", None, "uT"),
    "a topic of ROS": (
        ["__time," + ",".join(f"/imu/mag/magnetic_field/{a}" for a in "xyz")],
        "{t},{x},{y},{z}",
        None,
        "T",
    ),
    "the number of a field behind": (
        ["GPS TOW,X Mag [x8006],Y Mag [x8006],Z Mag [x8006]"],
        "{t},{x},{y},{z}",
        None,
        "counts",
    ),
}
"""Header, form of a row, columns that are asked for, unit that is right."""

FIELD_BLOCK: Final = "{name} {{{{\n  x: {{x}}\n  y: {{y}}\n  z: {{z}}\n}}}}\n"
BLOCKS: Final = {
    "tesla": FIELD_BLOCK.format(name="field_tesla"),
    "a stamp": "header {{\n  stamp {{\n    sec: {n}\n  }}\n}}\n" + FIELD_BLOCK.format(name="field_tesla") + "\n",
    "another sensor": "linear_acceleration {{\n  x: 1\n  y: 9\n  z: {n}\n}}\n" + FIELD_BLOCK.format(name="mag_tesla"),
}
"""Protocol buffers as text."""


def rows(form: str) -> str:
    return "".join(
        form.format(n=n, t=t, x=x, y=y, z=z, odd=("uT", "mG")[n % 2]) + "\n"
        for n, (t, (x, y, z)) in enumerate(zip(TIMES, FIELD.tolist(), strict=True))
    )


def table(name: str) -> str:
    head, form, _, _ = TABLES[name]
    return "\n".join([*head, rows(form)])


@pytest.mark.parametrize("name", TABLES)
def test_a_unit_that_is_stated_is_used(name: str, tmp_path: Path) -> None:
    *_, columns, unit = TABLES[name]
    path = tmp_path / "tumble.csv"
    path.write_text(table(name), encoding="utf-8")
    samples = flinders.read(path, columns=columns)
    assert samples.unit.name == unit
    np.testing.assert_allclose(samples.field / samples.unit.scale, FIELD, rtol=1e-9)
    assert samples.time is not None


@pytest.mark.parametrize("name", BLOCKS)
def test_names_of_blocks_are_those_of_their_fields(name: str, tmp_path: Path) -> None:
    path = tmp_path / "topic.txt"
    path.write_text(rows(BLOCKS[name]))
    samples = flinders.read(path)
    assert samples.unit.name == "T"
    np.testing.assert_allclose(samples.field / samples.unit.scale, FIELD, rtol=1e-9)
    assert {entry.reason for entry in samples.skipped} <= {"accompanying"}


@pytest.mark.parametrize("name", ["T(°)", "T(℃)", "T (°C)", "t [ºC]"])
def test_degrees_are_no_time(name: str) -> None:
    assert meaning(name).kind == "temperature"


@pytest.mark.parametrize("ticks", [2000, 1500, 700_000])
@pytest.mark.parametrize("head", ["SampleTimeFine,mag_x,mag_y,mag_z\n", ""])
def test_a_clock_whose_unit_would_turn_the_sensor_too_fast_is_no_time(head: str, ticks: int, tmp_path: Path) -> None:
    path = tmp_path / "ticks.csv"
    lines = [f"{12345678 + ticks * n},{x},{y},{z}" for n, (x, y, z) in enumerate(FIELD.tolist())]
    path.write_text(head + "\n".join(lines))
    samples = flinders.read(path)
    assert samples.time is None
    assert_sentences(str(flinders.open_recording(path)))


@pytest.mark.parametrize("name", ["t_us", "SampleTimeFine (us)", "t"])
def test_a_clock_whose_unit_is_stated_or_plain_is_the_time(name: str, tmp_path: Path) -> None:
    path = tmp_path / "ticks.csv"
    step = 200_000 if name == "t" else 2000
    lines = [f"{step * n},{x},{y},{z}" for n, (x, y, z) in enumerate(FIELD.tolist())]
    path.write_text("\n".join([f"{name},mx,my,mz", *lines]))
    time = flinders.read(path).time
    assert time is not None
    assert time[-1] == pytest.approx((ROWS - 1) * (STEP_S if name == "t" else 0.002))


@pytest.mark.parametrize("beside", [",{n}.5,,", ",,2{n},", ",,{n},-1"])
def test_rows_of_other_topics_are_no_loss(beside: str, tmp_path: Path) -> None:
    path = tmp_path / "topics.csv"
    path.write_text("t,acc,temp,note,mx,my,mz\n" + rows("{t},,,,{x},{y},{z}\n{t}" + beside + ",,,"))
    assert [(each.reason, each.rows) for each in flinders.read(path).skipped] == [("accompanying", ROWS)]


@pytest.mark.parametrize("lost", ["{t},0.1,,,", "{t},,,,", "{t},0.2,nan,nan,nan"])
def test_readings_that_are_missing_stay_a_loss(lost: str, tmp_path: Path) -> None:
    path = tmp_path / "lost.csv"
    path.write_text("t,ax,mx,my,mz\n" + rows("{t},0.1,{x},{y},{z}\n" + lost))
    assert [(each.reason, each.rows) for each in flinders.read(path).skipped] == [("not finite", ROWS)]
