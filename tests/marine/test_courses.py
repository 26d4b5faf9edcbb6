"""Courses in logs of boats renew a calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.boats import DECLINATION, START, Boat, nmea0183_of, nmea2000_of, signalk_of
from tests.program import flinders_
from tests.readers.test_courses import DIP_DEG, FIELD_UT, drive
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.apps.marine.compass_log import read_courses
from flinders.errors import UnreadableInput
from flinders.geometry.angles import wrap_360

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flinders.core.samples import Samples
    from flinders.readers._resample import TimeSeries


def boat_of(velocity: TimeSeries) -> Boat:
    """A boat that moves so; its compass does not matter."""
    north, east = velocity.values.T
    course = wrap_360(np.rad2deg(np.arctan2(east, north)) - DECLINATION)
    return Boat(velocity.time, course, course, course, np.hypot(north, east))


def table(samples: Samples, start: float) -> str:
    """Readings as a table, whose clock begins at so many seconds since 1970."""
    assert samples.time is not None
    rows = zip(samples.time + start, *samples.field.T, strict=True)
    return "time_s,mag_x_uT,mag_y_uT,mag_z_uT\n" + "\n".join(",".join(f"{cell:.3f}" for cell in row) for row in rows)


@pytest.mark.parametrize("lines", [nmea0183_of, nmea2000_of, signalk_of])
def test_the_log_of_a_boat_gives_the_headings_of_readings_beside_it(
    lines: Callable[[Boat], Iterator[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first = simulate.tumble(seed=2, field_strength=FIELD_UT, dip_deg=DIP_DEG)
    sensor = replace(first.sensor, offset=first.sensor.offset + np.array([12.0, -7.0, 4.0]))
    samples, velocity = drive(sensor, np.random.default_rng(4), crab_deg=0.0)
    (tmp_path / "boat.log").write_text("\n".join(lines(boat_of(velocity))), encoding="utf-8")
    (tmp_path / "compass.csv").write_text(table(samples, START), encoding="utf-8")
    flinders.fit(first.samples, site=flinders.Site(strength=FIELD_UT)).save("calibration.json")
    asked = ("refresh", "--previous", "calibration.json", "--course-log", "boat.log", "--target", "4", "--json")
    ended = flinders_(*asked, "compass.csv")
    assert ended.code in {0, 3}, ended.err
    assert_sentences(ended.err)
    assert np.abs(np.array(ended.json["calibration"]["offset"])[:2] - sensor.offset[:2]).max() < 1.0
    (tmp_path / "unstamped.csv").write_text(table(samples, 0.0), encoding="utf-8")
    assert_sentences(flinders_(*asked, "unstamped.csv").said)
    (tmp_path / "later.csv").write_text(table(samples, START + 3600.0), encoding="utf-8")
    assert_sentences(flinders_(*asked, "later.csv").said)


def test_a_log_without_courses_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "boat.nmea"
    (tmp_path / "table.csv").write_text("compass,true\n1,2\n", encoding="utf-8")
    with assert_raises(UnreadableInput):
        read_courses(tmp_path / "table.csv")
    stamped = "\n".join(f"{1000 * second + 1780308000000};N;$HCHDG,98.3,,,," for second in range(9))
    path.write_text(stamped, encoding="utf-8")
    with assert_raises(UnreadableInput):
        read_courses(path)
