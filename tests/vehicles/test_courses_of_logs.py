"""A calibration renewed by the courses of a vehicle in its own log."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.program import flinders_
from tests.readers.test_courses import DIP_DEG, FIELD_UT, drive
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.fitting.known_heading import stretches

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.core.samples import Samples
    from flinders.readers._resample import TimeSeries


def test_satellites_have_the_clock_of_the_readings_also_in_an_old_log(recordings: Callable[[str], Path]) -> None:
    """ArduCopter 3.3: TimeMS of a fix is the time of the satellites' week, and T that of the vehicle."""
    path = recordings("dronekit_log171_3mags/log171.bin")
    recording, samples = flinders.open_recording(path), flinders.read(path)
    velocity: TimeSeries = recording.velocity  # type: ignore[attr-defined]
    assert samples.time is not None
    assert velocity.time[-1] == pytest.approx(samples.time[-1], abs=1.0)
    assert 10.0 < np.abs(velocity.values).max() < 15.0
    assert [round(stretch.course_deg) for stretch in stretches(samples, velocity, slowest=2.0)] == [178]


SHAPES = {
    "PARM": (33, "<Q16sf", "QNf", "TimeUS,Name,Value"),
    "GPS": (34, "<QBIHBhiiiff", "QBIHBcLLeff", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs"),
    "MAG": (35, "<Qhhhhhh", "Qhhhhhh", "TimeUS,MagX,MagY,MagZ,OfsX,OfsY,OfsZ"),
}


def dataflash(samples: Samples, velocity: TimeSeries) -> bytes:
    """A drive as a log, in mG, with fixes at Zürich."""
    head = b"\xa3\x95"
    described = {"FMT": (128, "<BB4s16s64s", "BBnNZ", "Type,Length,Name,Format,Columns"), **SHAPES}
    parts = [
        head + b"\x80" + struct.pack("<BB4s16s64s", number, 3 + struct.calcsize(layout), *map(str.encode, words))
        for name, (number, layout, letters, labels) in described.items()
        for words in [(name, letters, labels)]
    ]

    def add(name: str, *values: float | bytes) -> None:
        number, layout, _, _ = SHAPES[name]
        parts.append(head + bytes([number]) + struct.pack(layout, *values))

    add("PARM", 0, b"COMPASS_OFS_X", 0.0)
    for time, (north, east) in zip(velocity.time.tolist(), velocity.values.tolist(), strict=True):
        course, speed = math.degrees(math.atan2(east, north)) % 360.0, math.hypot(north, east)
        place = (474_000_000, 85_000_000, 40_000)
        add("GPS", round(1e6 * time) + 1, 3, 388_800_000 + round(1000 * time), 2420, 12, 80, *place, speed, course)
    assert samples.time is not None
    for time, field in zip(samples.time.tolist(), np.rint(10.0 * samples.field).astype(int).tolist(), strict=True):
        add("MAG", round(1e6 * time) + 2, *field, 0, 0, 0)
    return b"".join(parts)


def test_the_courses_of_a_log_are_its_headings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = simulate.tumble(seed=2, field_strength=FIELD_UT, dip_deg=DIP_DEG)
    sensor = replace(first.sensor, offset=first.sensor.offset + np.array([12.0, -7.0, 4.0]))
    samples, velocity = drive(sensor, np.random.default_rng(4), crab_deg=0.0)
    (tmp_path / "tumble.bin").write_bytes(dataflash(first.samples, velocity))
    (tmp_path / "drive.bin").write_bytes(dataflash(samples, velocity))
    assert flinders_("calibrate", "tumble.bin", "-o", "calibration.json").code in {0, 3}
    ended = flinders_("refresh", "--previous", "calibration.json", "drive.bin", "--course", "--target", "4", "--json")
    assert ended.code in {0, 3}, ended.err
    found = np.array(ended.json["calibration"]["offset"])
    assert np.abs(found[:2] - sensor.offset[:2]).max() < 1.0
    wrong = flinders_("refresh", "--previous", "calibration.json", "drive.bin", "--crab", "2")
    assert_sentences(wrong.said)
    two = flinders_("refresh", "--previous", "calibration.json", "drive.bin", "--course", "--heading", "3")
    assert_sentences(two.said)
    (tmp_path / "still.csv").write_text("mag_x_mG,mag_y_mG,mag_z_mG\n" + "100,200,300\n" * 60, encoding="utf-8")
    none = flinders_("refresh", "--previous", "calibration.json", "still.csv", "--course")
    assert_sentences(none.said)
