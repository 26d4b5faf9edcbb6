"""Tables as people keep them: dates, headers that do not fit, clocks and counters, a model beside the sensor."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._column_choice import choose
from flinders.readers._likeness import groups

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats

FIELD: Final = np.round(simulate.tumble(seed=5).samples.field[:600], 2)
RATE_HZ: Final = 50.0
STEPS: Final = np.random.default_rng(3).normal(size=FIELD.shape)
WARM: Final = np.round(20 + np.arange(len(FIELD)) % 7 / 10, 1)
TIMES: Final = np.arange(len(FIELD)) / RATE_HZ
RESTING: Final = np.round([[10.0, 20.0, -40.0]] + 0.3 * np.random.default_rng(2).normal(size=FIELD.shape), 2)
NEAR_MIDNIGHT: Final = datetime(2026, 3, 4, 23, 59, 55, 250000)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def written(form: str, header: str = "", field: Floats = FIELD, name: str = "log.csv", **columns: Floats) -> Path:
    """A table whose lines have such a form, of number, second, date and axes, and of other columns."""
    rows = enumerate(zip(TIMES.round(3).tolist(), field.tolist(), strict=True))
    lines = [
        form.format(
            n=n, t=t, x=x, y=y, z=z, body=f"{x},{y},{z}",
            when=NEAR_MIDNIGHT + timedelta(seconds=t), ms=(250 + round(1000 * t)) % 1000,
            **{key: column[n] for key, column in columns.items()},
        )
        for n, (t, (x, y, z)) in rows
    ]  # fmt: skip
    Path(name).write_text("\n".join([header, *lines] if header else lines) + "\n", encoding="utf-8")
    return Path(name)


def said(*line: str) -> str:
    ended = flinders_(*line)
    return " ".join((ended.out + ended.err).split())


# dates and times of day

STAMPS: Final = {
    "as pandas writes": ("timestamp,mx,my,mz", "{when:%Y-%m-%d %H:%M:%S.%f},{body}"),
    "with T and a zone": ("utc,mx,my,mz", "{when:%Y-%m-%dT%H:%M:%S.%f}+01:00,{body}"),
    "with Z behind the readings": ("mx,my,mz,time", "{body},{when:%Y-%m-%dT%H:%M:%S.%f}Z"),
    "day first with a decimal comma": ("mx;Datum;my;mz", "{x};{when:%d.%m.%Y %H:%M:%S,%f};{y};{z}"),
    "month first with AM": ("time,mx,my,mz", "{when:%m/%d/%Y %I:%M:%S.%f %p},{body}"),
    "names of months": ("time,mx,my,mz", "{when:%d-%b-%Y %H:%M:%S.%f},{body}"),
    "time of day": ("clock,mx,my,mz", "{when:%H:%M:%S.%f},{body}"),
    "minutes and seconds": ("time,mx,my,mz", "{when:%M:%S.%f},{body}"),
    "date and clock": ("date,time,mx,my,mz", "{when:%d.%m.%Y},{when:%H:%M:%S.%f},{body}"),
    "date before and clock behind": ("date,mx,my,mz,clock", "{when:%Y/%m/%d},{body},{when:%H:%M:%S.%f}"),
    "packed": ("timestamp,mx,my,mz", "{when:%Y%m%dT%H%M%S.%f}Z,{body}"),
    "in a column without a name": (",mx,my,mz", "{when:%Y-%m-%d %H:%M:%S.%f},{body}"),
    "whole seconds without a header": ("", "{when:%Y-%m-%d %H:%M:%S},{body}"),
    "without a header, behind": ("", "{body},{when:%d.%m.%Y %H:%M:%S.%f}"),
    "a comma before milliseconds": ("asctime,mx,my,mz", "{when:%Y-%m-%d %H:%M:%S},{ms:03d},{body}"),
}
"""Header and line of each."""


@pytest.mark.parametrize("name", STAMPS)
def test_a_date_or_time_of_day_is_the_time_over_midnight_too(name: str) -> None:
    header, form = STAMPS[name]
    path = written(form, header)
    samples = flinders.read(path)
    np.testing.assert_array_equal(samples.field, FIELD)
    if name.startswith("whole"):
        assert "left out" in str(flinders.open_recording(path))  # 50 readings to each
        return
    assert samples.time is not None
    np.testing.assert_allclose(samples.time - samples.time[0], TIMES, atol=1e-5)


@pytest.mark.parametrize(
    ("form", "begun"),
    [
        ("%d/%m/%Y %H:%M:%S.%f", "2026-03-04 23:59:55"),
        ("%m/%d/%Y %H:%M:%S.%f", "2026-03-04 23:59:55"),
        ("%y-%m-%d %H:%M:%S.%f", "2026-03-04 23:59:55"),
    ],
)
def test_the_whole_column_tells_the_day_from_the_month(form: str, begun: str) -> None:
    path = written(f"{{when:{form}}},{{body}}", "time,mx,my,mz")
    assert f"start {begun}" in said("info", str(path))


def test_the_last_lines_of_a_long_file_tell_the_day_from_the_month() -> None:
    times = (datetime(2026, 3, 4) + timedelta(seconds=10 * n) for n in range(17000))
    rows = [f"{time:%m/%d/%Y %H:%M:%S},{n % 7},{n % 5},{1 + n % 3}" for n, time in enumerate(times)]
    Path("long.csv").write_text("\n".join(["time,mx,my,mz", *rows]))
    time = flinders.read("long.csv").time
    assert time is not None
    np.testing.assert_array_equal(np.diff(time), 10.0)


def test_a_stamp_before_a_line_is_read_as_a_cell_is() -> None:
    path = written("{when:%m/%d/%Y %I:%M:%S.%f %p} -> X: {x} Y: {y} Z: {z}")
    assert "start 2026-03-04 23:59:55 UTC" in said("info", str(path))


def test_a_number_behind_a_time_of_day_and_a_comma_is_no_fraction_of_it() -> None:
    path = written("{when:%H:%M:%S},{body}")
    np.testing.assert_array_equal(flinders.read(path).field, FIELD)


@pytest.mark.parametrize("header", ["timestamp,mx,my,mz", "when,mx,my,mz", "mx,my,mz,Date"])
def test_a_column_that_is_called_a_time_and_is_not_read_is_told(header: str) -> None:
    name = next(each for each in header.split(",") if not each.startswith("m"))
    cells = [("yesterday {n}" if each == name else f"{{{each[1:]}}}") for each in header.split(",")]
    path = written(",".join(cells), header)
    assert f"! no time is read, {name} is left out" in said("info", str(path))


# headers

HEADERS: Final = {
    "a field without a name": ("t,mx,my,mz", "{t},{body},7", (1, 2, 3)),
    "words without a name": ("t,mx,my,mz", "{t},{body},ok", (1, 2, 3)),
    "three without names": ("t,mx,my,mz", "{t},{body},{rate[0]:.3f},{rate[1]:.3f},{rate[2]:.3f}", (1, 2, 3)),
    "row numbers": ("t mx my mz", '"{n}" {t} {x} {y} {z}', (2, 3, 4)),
    "a forgotten column": ("t,mx,my,mz", "{t},{warm},{body}", (2, 3, 4)),
    "a forgotten time": ("mx,my,mz", "{t},{body}", (1, 2, 3)),
    "a name too many": ("t,mx,my,mz,temp", "{t},{body}", (1, 2, 3)),
    "two commas at the end": ("t,mx,my,mz", "{t},{body},,", (1, 2, 3)),
    "a value of two words": ("t state mx my mz", "{t} turning left {x} {y} {z}", (3, 4, 5)),
    "a date of two words": ("time mx my mz", "{when:%Y-%m-%d %H:%M:%S.%f} {x} {y} {z}", (2, 3, 4)),
    "another delimiter": ("t mx my mz", "{t},{body}", (1, 2, 3)),
    "a remark above": ("log of today, lab 3\nt,mx,my,mz", "{t},{body},7", (1, 2, 3)),
}
"""Header, line, and the places of the magnetometer."""


@pytest.mark.parametrize("columns", [None, "mx,my,mz"])
@pytest.mark.parametrize("name", HEADERS)
def test_names_stand_where_values_agree_with_them(name: str, columns: str | None) -> None:
    header, form, cells = HEADERS[name]
    recording = flinders.open_recording(written(form, header, rate=STEPS, warm=WARM), columns=columns)
    assert isinstance(recording, flinders.readers.TextRecording)
    assert (recording.columns.field.cells, recording.columns.field.names) == (cells, ("mx", "my", "mz"))
    assert recording.columns.time is not None
    assert "no header" not in str(recording)


def test_it_is_said_how_many_names_and_fields_there_are() -> None:
    header, form, _ = HEADERS["a forgotten column"]
    told = str(flinders.open_recording(written(form, header, warm=WARM)))
    assert_sentences(told)


@pytest.mark.parametrize("columns", [None, "mx,my,mz"])
def test_where_values_leave_open_whose_the_names_are_nothing_is_taken(columns: str | None) -> None:
    path = written("{t},{other:.2f},{body}", "t,mx,my,mz", RESTING, other=20 * STEPS[:, 0])
    with assert_raises((NoMagnetometer, UsageError)) as refusal:
        flinders.open_recording(path, columns=columns)
    assert "no header" not in str(refusal.value)


def test_columns_may_be_asked_for_by_names_that_mean_nothing_and_do_not_fit() -> None:
    path = written("{t},{body},7", "t,a,b,c")
    np.testing.assert_array_equal(flinders.read(path, columns="a,b,c").field, FIELD)
    with assert_raises(NoMagnetometer):
        flinders.read(path)


def test_added_columns_are_named_at_the_end_of_such_a_header() -> None:
    path = written("{t},{body},7", "t,mx,my,mz")
    recording = flinders.open_recording(path)
    assert isinstance(recording, flinders.readers.TextRecording)
    lines = list(recording.corrected_lines(lambda field: field, add=True))
    assert lines[0] == "t,mx,my,mz,,mx_cal,my_cal,mz_cal\n"
    assert lines[1].count(",") == lines[0].count(",")


# clocks and counters

TWO: Final = {
    "a counter and a clock": ("{n},57645830{n:03d},{x},{y}", "3 and 4"),
    "a clock and a counter": ("{t},{n},{x},{y}", "3 and 4"),
    "a clock": ("{t},{x},{y}", "2 and 3"),
    "axes, a clock and a constant": ("{n},{x},{y},{t},7", "2 and 3"),
}


@pytest.mark.parametrize("name", TWO)
def test_beside_clocks_and_counters_two_columns_are_a_level_turn(name: str) -> None:
    form, left = TWO[name]
    path = written(form)
    with assert_raises(NoMagnetometer):
        flinders.open_recording(path)
    assert flinders_("calibrate", str(path)).code == 5
    level = flinders.open_recording(path, flat="xy")
    assert isinstance(level, flinders.readers.TextRecording)
    assert level.columns.field.cells == tuple(int(each) - 1 for each in left.split(" and "))


def test_a_time_before_three_axes_stays_one() -> None:
    samples = flinders.read(written("{t},{body}"))
    np.testing.assert_array_equal(samples.field, FIELD)
    assert samples.time is not None


# T

NUMBERS: Final = np.arange(float(len(FIELD)))
NO_TIMES: Final = {
    "stands still": 23.4 + 0 * NUMBERS,
    "falls": 40 - NUMBERS / 100,
    "goes to and fro": np.round(23 + np.sin(NUMBERS / 40), 1),
    "rises now and then": np.round(23 + NUMBERS / 400 + np.sin(NUMBERS / 11) / 50, 2),
}


@pytest.mark.parametrize("called", ["T", "T_r", "T_raw"])
@pytest.mark.parametrize("name", NO_TIMES)
def test_a_letter_that_does_not_rise_as_a_clock_does_is_a_temperature(name: str, called: str) -> None:
    path = written("{body},{warm}", f"mx,my,mz,{called}", warm=NO_TIMES[name])
    samples = flinders.read(path)
    assert samples.time is None
    assert samples.temperature is not None
    assert "digits" not in str(flinders.open_recording(path))


@pytest.mark.parametrize("clock", [NUMBERS / 50, 20 * NUMBERS, NUMBERS // 5 / 10, 1e6 + 20000 * NUMBERS])
def test_a_letter_that_rises_as_a_clock_does_is_the_time(clock: Floats) -> None:
    assert "time in T" in str(flinders.open_recording(written("{clock},{body}", "T,mx,my,mz", clock=clock)))


@pytest.mark.parametrize("counts", [2340 - NUMBERS, 2340 + NUMBERS % 2, 2340 + 0 * NUMBERS])
def test_counts_of_a_temperature_are_left_out(counts: Floats) -> None:
    path = written("{counts:.0f},{body}", "T_raw,mx,my,mz", counts=counts)
    assert_sentences(str(flinders.open_recording(path)))


# a model beside the sensor


@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize(
    ("sensor", "model"),
    [
        ("MagSensor", "MagneticField"), ("magnetometer", "magnetic_field"), ("compass", "field"),
        ("mag_measured", "mag_model"), ("B_meas", "B_ref"), ("raw", "field"), ("lis3mdl", "magnetic_field"),
    ],
)  # fmt: skip
def test_the_sensor_is_taken_and_the_model_is_named(sensor: str, model: str, *, is_first: bool) -> None:
    pairs = [(sensor, FIELD), (model, 900.0 * FIELD[::-1])]
    ordered = pairs if is_first else pairs[::-1]
    names = [f"{name}_{axis}" for name, _ in ordered for axis in "xyz"]
    chosen = choose(names, np.hstack([values for _, values in ordered]))
    assert chosen is not None
    assert chosen.field.names == tuple(f"{sensor}_{axis}" for axis in "xyz")
    assert model in " ".join(chosen.remarks())


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        (("MagSensor_x", "MagSensor y", "magsensor-z"), True),
        (("mag_x_uT", "mag_y_uT", "mag_z"), True),
        (("MagSensor_x", "MagSensr_y", "MagSensor_z"), False),
    ],
)
def test_names_that_do_not_match_to_the_letter_are_taken_or_named(names: Sequence[str], *, taken: bool) -> None:
    chosen = choose(["Bx", "By", "Bz", *names], np.hstack([900.0 * FIELD, FIELD]))
    assert chosen is not None
    assert (chosen.field.names == tuple(names)) == taken
    assert taken or names[1] in " ".join(chosen.remarks())


# columns that are offered

CLOSE: Final = {
    "seconds": (15 + TIMES // 1)[:, np.newaxis],
    "milliseconds": (1000 * TIMES % 1000)[:, np.newaxis],
    "microseconds of 16 bits": (np.arange(len(FIELD)) * 20000.0 % 65536)[:, np.newaxis],
    "counter": np.arange(float(len(FIELD)))[:, np.newaxis],
    "state": np.repeat([1.0, 2.0, 3.0], -(-len(FIELD) // 3))[: len(FIELD), np.newaxis],
    "constant": np.full((len(FIELD), 1), 7.0),
    "temperature": np.round(20 + np.cumsum(STEPS[:, :1], axis=0) / 50, 1),
    "rate": np.round(STEPS, 3),
    "bias": np.tile([20.25, -30.5, 10.75], (len(FIELD), 1)) + np.where(TIMES > 3, 0.25, 0.0)[:, np.newaxis],
    "gravity": np.round(FIELD[::-1] / 47 * 9.6 + [0.5, -0.4, 0.3], 3),
    "heading": np.round(np.degrees(np.arctan2(FIELD[:, 1], FIELD[:, 0])) % 360, 1)[:, np.newaxis],
    "strength": np.round(np.linalg.norm(FIELD, axis=1), 2)[:, np.newaxis],
}


@pytest.mark.parametrize(
    ("before", "behind"),
    [
        (("seconds", "milliseconds", "rate"), ("seconds", "milliseconds")),
        (("counter", "microseconds of 16 bits"), ("strength", "heading")),
        (("counter", "temperature"), ("state",)),
        (("counter", "gravity", "constant"), ("bias",)),
        (("state", "heading", "rate"), ("counter", "bias", "temperature")),
        ((), ("rate", "seconds", "strength")),
        (("constant",) * 25, ("counter",)),
    ],
)
def test_what_is_offered_is_the_magnetometer_wherever_it_starts(before: Sequence[str], behind: Sequence[str]) -> None:
    parts = [*(CLOSE[name] for name in before), FIELD, *(CLOSE[name] for name in behind)]
    first = 1 + sum(part.shape[1] for part in parts[: len(before)])
    values = np.hstack(parts)[:200]
    offered = [group.names for group in groups(values, range(values.shape[1])) if group.is_candidate]
    assert offered == [tuple(map(str, range(first, first + 3)))]


def test_an_offer_shows_the_first_line_with_its_columns_numbered() -> None:
    path = written("{t},{n},7,{body}")
    told = said("info", str(path))
    assert "(--columns 4,5,6)" in told
    x, y, z = FIELD[0].tolist()
    assert f"1: 0.0, 2: 0, 3: 7, 4: {x}, 5: {y}, 6: {z}" in told


# columns that were asked for


@pytest.mark.parametrize(
    ("header", "columns"), [("", "2,3,4"), ("time,a,b,c,d,e", "a,b,c"), ("time,a,b,c,d,e", "2,3,4")]
)
def test_a_calibration_remembers_the_columns_that_were_asked_for(header: str, columns: str) -> None:
    form = "{t},{body},{warm},5"
    monday = written(form, header, name="monday.csv", warm=WARM)
    tuesday = written(form, header, FIELD[::-1], "tuesday.csv", warm=WARM)
    assert flinders_("calibrate", str(monday), "--columns", columns, "--from", "1", "-o", "cal.json").code in {0, 3}
    (file,) = json.loads(Path("cal.json").read_text())["provenance"]["files"]
    assert (file["columns"]["field"], file["columns"]["width"]) == (columns.split(","), 6)
    assert file["rows"] < len(FIELD)
    for command in (["check"], ["heading", "--level"], ["apply"], ["refresh", "--previous"]):
        ended = flinders_(*command, "cal.json", str(tuesday))
        assert ended.code in {0, 3}, (command, ended.err)


@pytest.mark.parametrize("form", ["{body},{t},{warm},5", "{t},{body},5"])
def test_a_table_of_another_form_is_not_read_with_them(form: str) -> None:
    path = written("{t},{body},{warm},5", warm=WARM)
    assert flinders_("calibrate", str(path), "--columns", "2,3,4", "-o", "cal.json").code in {0, 3}
    assert flinders_("check", "cal.json", str(written(form, name="other.csv", warm=WARM))).code == 5


@pytest.mark.parametrize(("form", "clock"), [("{t},{body},1", "1"), ("{n},{body},{t}", "5")])
def test_columns_by_number_keep_the_clock(form: str, clock: str) -> None:
    path = written(form)
    assert len(flinders.read(path, columns="2,3,4", start=1.0)) == len(FIELD) - int(RATE_HZ)
    assert f"time in {clock}" in str(flinders.open_recording(path, columns="2,3,4"))
