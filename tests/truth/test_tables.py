"""Tables as people keep them: dates, headers that do not fit, clocks and counters, a model beside the sensor."""

from __future__ import annotations

import json
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.program import flinders_

import flinders
from flinders import simulate
from flinders.errors import NoMagnetometer, UsageError
from flinders.readers._columns import choose
from flinders.readers._likeness import groups

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flinders.arrays import Floats

FIELD: Final = np.round(simulate.tumble(seed=5).samples.field[:600], 2)
RATE_HZ: Final = 50.0
TIMES: Final = np.arange(len(FIELD)) / RATE_HZ
RESTING: Final = np.round([[10.0, 20.0, -40.0]] + 0.3 * np.random.default_rng(2).normal(size=FIELD.shape), 2)
NEAR_MIDNIGHT: Final = datetime(2026, 3, 4, 23, 59, 55, 250000)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def written(row: Callable[..., str], header: str = "", field: Floats = FIELD, name: str = "log.csv") -> Path:
    """A table of which `row` makes each line, of its number, its second and x, y, z."""
    rows = zip(range(len(field)), TIMES.round(3).tolist(), field.tolist(), strict=True)
    lines = [row(number, second, *axes) for number, second, axes in rows]
    Path(name).write_text("\n".join([header, *lines] if header else lines) + "\n", encoding="utf-8")
    return Path(name)


def said(*line: str) -> str:
    ended = flinders_(*line)
    return " ".join((ended.out + ended.err).split())


# dates and times of day

STAMPS: Final[dict[str, tuple[str, Callable[[datetime, str], str]]]] = {
    "as pandas writes": ("timestamp,mx,my,mz", lambda t, b: f"{t:%Y-%m-%d %H:%M:%S.%f},{b}"),
    "with T and a zone": ("utc,mx,my,mz", lambda t, b: f"{t:%Y-%m-%dT%H:%M:%S.%f}+01:00,{b}"),
    "with Z behind the readings": ("mx,my,mz,time", lambda t, b: f"{b},{t:%Y-%m-%dT%H:%M:%S.%f}Z"),
    "day first with a decimal comma": (
        "Datum;mx;my;mz",
        lambda t, b: f"{t:%d.%m.%Y %H:%M:%S,%f};{b.replace(',', ';').replace('.', ',')}",
    ),
    "month first with AM": ("time,mx,my,mz", lambda t, b: f"{t:%m/%d/%Y %I:%M:%S.%f %p},{b}"),
    "names of months": ("time,mx,my,mz", lambda t, b: f"{t:%d-%b-%Y %H:%M:%S.%f},{b}"),
    "time of day": ("clock,mx,my,mz", lambda t, b: f"{t:%H:%M:%S.%f},{b}"),
    "minutes and seconds": ("time,mx,my,mz", lambda t, b: f"{t:%M:%S.%f},{b}"),
    "date and clock": ("date,time,mx,my,mz", lambda t, b: f"{t:%d.%m.%Y},{t:%H:%M:%S.%f},{b}"),
    "date before and clock behind": ("date,mx,my,mz,clock", lambda t, b: f"{t:%Y/%m/%d},{b},{t:%H:%M:%S.%f}"),
    "packed": ("timestamp,mx,my,mz", lambda t, b: f"{t:%Y%m%dT%H%M%S.%f}Z,{b}"),
    "in a column without a name": (",mx,my,mz", lambda t, b: f"{t:%Y-%m-%d %H:%M:%S.%f},{b}"),
    "without a header": ("", lambda t, b: f"{t:%Y-%m-%d %H:%M:%S},{b}"),
    "without a header, behind": ("", lambda t, b: f"{b},{t:%d.%m.%Y %H:%M:%S.%f}"),
    "a comma before milliseconds": (
        "asctime,mx,my,mz", lambda t, b: f"{t:%Y-%m-%d %H:%M:%S},{t.microsecond // 1000:03d},{b}"
    ),
}  # fmt: skip
"""Header and line of each."""


@pytest.mark.parametrize("name", STAMPS)
def test_a_date_or_time_of_day_is_the_time_over_midnight_too(name: str) -> None:
    header, line = STAMPS[name]
    path = written(lambda _, s, *b: line(NEAR_MIDNIGHT + timedelta(seconds=s), ",".join(map(str, b))), header)
    samples = flinders.read(path)
    assert samples.time is not None
    whole = 1.0 if "%S},{b}" in repr(header) or name == "without a header" else 0.0
    np.testing.assert_allclose(samples.time - samples.time[0], TIMES, atol=max(whole, 1e-5))
    np.testing.assert_array_equal(samples.field, FIELD)
    assert "time in" in str(flinders.open_recording(path))


@pytest.mark.parametrize(
    ("form", "begun"),
    [
        ("%d/%m/%Y %H:%M:%S.%f", "2026-03-04 23:59:55"),
        ("%m/%d/%Y %H:%M:%S.%f", "2026-03-04 23:59:55"),
        ("%y-%m-%d %H:%M:%S.%f", "2026-03-04 23:59:55"),
    ],
)
def test_the_whole_column_tells_the_day_from_the_month(form: str, begun: str) -> None:
    path = written(
        lambda _, s, *b: f"{NEAR_MIDNIGHT + timedelta(seconds=s):{form}},{b[0]},{b[1]},{b[2]}", "time,mx,my,mz"
    )
    assert f"begun {begun}" in said("info", str(path))


def test_the_last_lines_of_a_long_file_tell_the_day_from_the_month() -> None:
    rows = [f"{datetime(2026, 3, 4) + timedelta(seconds=10 * n):%m/%d/%Y %H:%M:%S},{n % 7},{n % 5},{n % 3}"
            for n in range(17000)]  # fmt: skip
    Path("long.csv").write_text("\n".join(["time,mx,my,mz", *rows]))
    time = flinders.read("long.csv").time
    assert time is not None
    np.testing.assert_array_equal(np.diff(time), 10.0)


def test_a_stamp_before_a_line_is_read_as_a_cell_is() -> None:
    lines = [f"22.11.2026 04:{n // 60:02d}:{n % 60:02d} -> X: {x} Y: {y} Z: {z}" for n, (x, y, z) in enumerate(FIELD)]
    Path("stamped.txt").write_text("\n".join(lines))
    assert "begun 2026-11-22 04:00:00 UTC" in said("info", "stamped.txt")


def test_a_number_behind_a_time_of_day_and_a_comma_is_no_fraction_of_it() -> None:
    path = written(lambda n, _, x, y, z: f"04:{n // 60 % 60:02d}:{n % 60:02d},{x},{y},{z}")
    np.testing.assert_array_equal(flinders.read(path).field, FIELD)


@pytest.mark.parametrize("header", ["timestamp,mx,my,mz", "when,mx,my,mz", "mx,my,mz,Date"])
def test_a_column_that_is_called_a_time_and_is_not_read_is_told(header: str) -> None:
    name = next(each for each in header.split(",") if not each.startswith("m"))
    cells = [("yesterday {n}" if each == name else f"{{{each[1:]}}}") for each in header.split(",")]
    path = written(lambda n, _, x, y, z: ",".join(cells).format(n=n, x=x, y=y, z=z), header)
    assert f"! no time is read, {name} is left out" in said("info", str(path))


# headers

HEADERS: Final[dict[str, tuple[str, Callable[..., str], tuple[int, ...]]]] = {
    "a field without a name": ("t,mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z},7", (1, 2, 3)),
    "words without a name": ("t,mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z},ok", (1, 2, 3)),
    "three without names": (
        "t,mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z},{n % 5 / 8},{n % 3 / 8},{n % 7 / 8}", (1, 2, 3)
    ),
    "row numbers": ("t mx my mz", lambda n, t, x, y, z: f'"{n}" {t} {x} {y} {z}', (2, 3, 4)),
    "a forgotten column": ("t,mx,my,mz", lambda n, t, x, y, z: f"{t},{20 + n % 7 / 10},{x},{y},{z}", (2, 3, 4)),
    "a forgotten time": ("mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z}", (1, 2, 3)),
    "a name too many": ("t,mx,my,mz,temp", lambda n, t, x, y, z: f"{t},{x},{y},{z}", (1, 2, 3)),
    "two commas at the end": ("t,mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z},,", (1, 2, 3)),
    "a value of two words": ("t state mx my mz", lambda n, t, x, y, z: f"{t} turning left {x} {y} {z}", (3, 4, 5)),
    "a date of two words": (
        "time mx my mz", lambda n, t, x, y, z: f"2026-11-22 04:42:{t:06.3f} {x} {y} {z}", (2, 3, 4)
    ),
    "another delimiter": ("t mx my mz", lambda n, t, x, y, z: f"{t},{x},{y},{z}", (1, 2, 3)),
    "a remark above": ("log of today, lab 3\nt,mx,my,mz", lambda n, t, x, y, z: f"{t},{x},{y},{z},7", (1, 2, 3)),
}  # fmt: skip
"""Header, line, and the places of the magnetometer."""


@pytest.mark.parametrize("columns", [None, "mx,my,mz"])
@pytest.mark.parametrize("name", HEADERS)
def test_names_stand_where_values_agree_with_them(name: str, columns: str | None) -> None:
    header, line, cells = HEADERS[name]
    recording = flinders.open_recording(written(line, header), columns=columns)
    assert isinstance(recording, flinders.readers.TextRecording)
    assert (recording.columns.field.cells, recording.columns.field.names) == (cells, ("mx", "my", "mz"))
    assert recording.columns.time is not None
    assert "no header" not in str(recording)


def test_it_is_said_how_many_names_and_fields_there_are() -> None:
    header, line, _ = HEADERS["a forgotten column"]
    written_as = str(flinders.open_recording(written(line, header)))
    assert "a header of 4 names over 5 fields (mx, my, mz of columns 3, 4, 5)" in written_as


@pytest.mark.parametrize("columns", [None, "mx,my,mz"])
def test_where_values_leave_open_whose_the_names_are_nothing_is_taken(columns: str | None) -> None:
    other = np.round(20 * np.random.default_rng(1).normal(size=len(FIELD)), 2).tolist()
    path = written(lambda n, t, x, y, z: f"{t},{other[n]},{x},{y},{z}", "t,mx,my,mz", RESTING)
    with pytest.raises((NoMagnetometer, UsageError), match="a header of 4 names over 5 fields") as refusal:
        flinders.open_recording(path, columns=columns)
    assert "no header" not in str(refusal.value)


def test_columns_may_be_asked_for_by_names_that_mean_nothing_and_do_not_fit() -> None:
    path = written(lambda n, t, x, y, z: f"{t},{x},{y},{z},7", "t,a,b,c")
    np.testing.assert_array_equal(flinders.read(path, columns="a,b,c").field, FIELD)
    with pytest.raises(NoMagnetometer, match="a header of 4 names over 5 fields"):
        flinders.read(path)


def test_added_columns_are_named_at_the_end_of_such_a_header() -> None:
    path = written(lambda n, t, x, y, z: f"{t},{x},{y},{z},7", "t,mx,my,mz")
    recording = flinders.open_recording(path)
    assert isinstance(recording, flinders.readers.TextRecording)
    lines = list(recording.corrected_lines(lambda field: field, add=True))
    assert lines[0] == "t,mx,my,mz,,mx_cal,my_cal,mz_cal\n"
    assert lines[1].count(",") == lines[0].count(",")


# clocks and counters

TWO: Final[dict[str, tuple[Callable[..., str], str]]] = {
    "a counter and a clock": (lambda n, t, x, y, _: f"{n},{-5764 + 20 * n},{x},{y}", "3 and 4"),
    "a clock and a counter": (lambda n, t, x, y, _: f"{t},{n + 7},{x},{y}", "3 and 4"),
    "a clock": (lambda n, t, x, y, _: f"{t},{x},{y}", "2 and 3"),
    "axes, a clock and a state": (lambda n, t, x, y, _: f"{n},{x},{y},{1000 * n + n % 3},7", "2 and 3"),
}


@pytest.mark.parametrize("name", TWO)
def test_beside_clocks_and_counters_two_columns_are_a_level_turn(name: str) -> None:
    line, left = TWO[name]
    path = written(line)
    with pytest.raises(NoMagnetometer, match=f"columns {left} of log.csv.*flinders two-axis"):
        flinders.open_recording(path)
    assert flinders_("calibrate", str(path)).code == 5
    assert flinders.open_recording(path, flat="xy").columns.field.cells == tuple(
        int(each) - 1 for each in left.split(" and ")
    )


def test_a_time_before_three_axes_stays_one() -> None:
    samples = flinders.read(written(lambda n, t, x, y, z: f"{t},{x},{y},{z}"))
    np.testing.assert_array_equal(samples.field, FIELD)
    assert samples.time is not None


# T

NO_TIMES: Final = {
    "stands still": lambda n: 23.4,
    "falls": lambda n: 40 - n / 100,
    "goes to and fro": lambda n: round(23 + np.sin(n / 40), 1),
    "rises now and then": lambda n: round(23 + n / 400 + np.sin(n / 11) / 50, 2),
}


@pytest.mark.parametrize("called", ["T", "T_r", "T_raw"])
@pytest.mark.parametrize("name", NO_TIMES)
def test_a_letter_that_does_not_rise_as_a_clock_does_is_a_temperature(name: str, called: str) -> None:
    path = written(lambda n, t, x, y, z: f"{x},{y},{z},{NO_TIMES[name](n)}", f"mx,my,mz,{called}")
    samples = flinders.read(path)
    assert samples.time is None
    assert samples.temperature is not None
    assert "digits" not in str(flinders.open_recording(path))


@pytest.mark.parametrize(
    "clock", [lambda n: n / 50, lambda n: 20 * n, lambda n: n // 5 / 10, lambda n: 1e6 + 20000 * n]
)
def test_a_letter_that_rises_as_a_clock_does_is_the_time(clock: Callable[[int], float]) -> None:
    path = written(lambda n, t, x, y, z: f"{clock(n)},{x},{y},{z}", "T,mx,my,mz")
    assert "time in T" in str(flinders.open_recording(path))


@pytest.mark.parametrize("counts", [lambda n: 2340 - n, lambda n: 2340 + n % 2, lambda n: 2340])
def test_counts_of_a_temperature_are_left_out(counts: Callable[[int], int]) -> None:
    path = written(lambda n, t, x, y, z: f"{counts(n)},{x},{y},{z}", "T_raw,mx,my,mz")
    assert "left out T_raw (it does not rise as a time does)" in str(flinders.open_recording(path))


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

STEPS: Final = np.random.default_rng(3).normal(size=FIELD.shape)
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
    path = written(lambda n, t, x, y, z: f"{t},{n},{n % 7},{x},{y},{z}")
    told = said("info", str(path))
    assert "add --columns 4,5,6" in told
    x, y, z = FIELD[0].tolist()
    assert f"1: 0.0, 2: 0, 3: 0, 4: {x}, 5: {y}, 6: {z}" in told


# columns that were asked for


@pytest.mark.parametrize(
    ("header", "columns"), [("", "2,3,4"), ("time,a,b,c,d,e", "a,b,c"), ("time,a,b,c,d,e", "2,3,4")]
)
def test_a_calibration_remembers_the_columns_that_were_asked_for(header: str, columns: str) -> None:
    def line(n: int, t: float, x: float, y: float, z: float) -> str:
        return f"{t},{x},{y},{z},{n % 3},5"

    monday, tuesday = written(line, header, name="monday.csv"), written(line, header, FIELD[::-1], "tuesday.csv")
    assert flinders_("calibrate", str(monday), "--columns", columns, "--from", "1", "-o", "cal.json").code in {0, 3}
    (file,) = json.loads(Path("cal.json").read_text())["provenance"]["files"]
    assert (file["columns"]["field"], file["columns"]["width"]) == (columns.split(","), 6)
    assert file["rows"] < len(FIELD)
    for command in (["check"], ["heading", "--level"], ["apply"], ["refresh", "--previous"]):
        ended = flinders_(*command[:1], *command[1:], "cal.json", str(tuesday))
        assert ended.code in {0, 3}, (command, ended.err)
        assert "columns 2, 3, 4" in ended.err or "columns a, b, c" in ended.err or command == ["apply"]
    other = written(lambda n, t, x, y, z: f"{x},{y},{z},{t},{n % 3},5", header, name="other.csv")
    assert (flinders_("check", "cal.json", str(other)).code == 5) == (not header)


@pytest.mark.parametrize(
    "line", [lambda n, t, x, y, z: f"{t},{x},{y},{z},1", lambda n, t, x, y, z: f"{n},{x},{y},{z},{t}"]
)
def test_columns_by_number_keep_the_clock(line: Callable[..., str]) -> None:
    samples = flinders.read(written(line), columns="2,3,4", start=1.0)
    assert samples.time is not None
    assert re.search(r"time in [15]", str(flinders.open_recording("log.csv", columns="2,3,4")))
    assert len(samples) == len(FIELD) - int(RATE_HZ)
