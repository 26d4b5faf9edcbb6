"""`flinders heading` and `flinders swing` as a user meets them: known headings in, the same out; mistakes are named."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import Ended, flinders_
from tests.waiting import PATIENCE_S

from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import Fitted, aiding_record
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.fitting.aiding import Aiding
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Fit
from flinders.geometry.angles import folded
from flinders.geometry.ellipsoid import symmetric
from flinders.geometry.rotation import rotations
from flinders.heading.attitude import magnetic_heading_deg
from flinders.heading.compass import Compass
from flinders.heading.error_propagation import deviation_covariance
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

PROGRAM = [sys.executable, "-c", "from flinders.cli import main; main(prog_name='flinders')"]
FIELD = 50.0 * np.array([0.5, 0.0, 0.75**0.5])
MATRIX = np.array([[1.04, 0.02, -0.01], [0.02, 0.95, 0.03], [-0.01, 0.03, 1.01]])
OFFSET = np.array([20.0, -15.0, 8.0])
ZURICH = ("--at", "47.37,8.54,400", "--date", "2026-06-01")
HEADER = "t_s,mx_uT,my_uT,mz_uT,ax,ay,az"


def turned(heading: Floats, roll: Floats | float = 0.0, pitch: Floats | float = 0.0) -> Floats:
    """(N, 3, 3) from north, east, down to the body."""
    h, r, p = np.deg2rad(np.broadcast_arrays(heading, roll, pitch))
    zero, one = np.zeros_like(h), np.ones_like(h)
    about_x = np.array([[one, zero, zero], [zero, np.cos(r), np.sin(r)], [zero, -np.sin(r), np.cos(r)]])
    about_y = np.array([[np.cos(p), zero, -np.sin(p)], [zero, one, zero], [np.sin(p), zero, np.cos(p)]])
    about_z = np.array([[np.cos(h), np.sin(h), zero], [-np.sin(h), np.cos(h), zero], [zero, zero, one]])
    body: Floats = np.einsum("ijn,jkn,kln->nil", about_x, about_y, about_z)
    return body


def log_of(body: Floats, *, start: float = 0.0, noise: float = 0.0) -> Floats:
    """Time, raw field in µT and specific force of these attitudes, ten readings a second."""
    rng = np.random.default_rng(3)
    raw = np.linalg.solve(MATRIX, (body @ FIELD).T).T + OFFSET + noise * rng.standard_normal((len(body), 3))
    force = body @ np.array([0.0, 0.0, -9.81]) + 0.05 * noise * rng.standard_normal((len(body), 3))
    return np.column_stack([start + 0.1 * np.arange(len(body)), raw, force])


def write(name: str, log: Floats, header: str = HEADER) -> str:
    rows = [",".join(f"{value:.6f}" for value in row) for row in log]
    with open(name, "w", encoding="utf-8") as file:  # noqa: PTH123
        file.write("\n".join([header, *rows, ""]))
    return name


def tumbling(count: int = 600) -> tuple[Floats, Floats]:
    """Headings and attitudes all round."""
    rng = np.random.default_rng(8)
    heading = rng.uniform(0.0, 360.0, count)
    return heading, turned(heading, rng.uniform(-180.0, 180.0, count), rng.uniform(-80.0, 80.0, count))


def assert_headings(ended: Ended, wanted: Floats, atol: float = 2e-3) -> None:
    """Those that were written are those that the vehicle had."""
    assert ended.code == 0, ended.err
    npt.assert_allclose(folded(ended.columns["heading_deg"] - wanted), 0.0, atol=atol)


def swinging(stops: Floats, *, noise: float = 0.2) -> Floats:
    """A log that rests ten seconds on each heading."""
    headings: list[float] = []
    for before, after in zip(stops, [*stops[1:], stops[-1]], strict=True):
        headings += [before] * 100 + np.linspace(before, after, max(int(abs(after - before) / 3.0), 1)).tolist()
    sway = np.arange(len(headings)) * 0.1
    return log_of(turned(np.array(headings), 5.0 * np.sin(sway), 4.0 * np.cos(0.7 * sway)), noise=noise)


def with_iron(log: Floats) -> Floats:
    """The same log with 1 µT of hard iron ahead and 0.5 to port, which is B = 2.29° and C = −1.15°."""
    bent = log.copy()
    bent[:, 1:4] += np.linalg.solve(MATRIX, [1.0, -0.5, 0.0])
    return bent


def calibrated(n: int) -> None:
    """A calibration of the same sensor from `n` noisy readings, with its uncertainty."""
    rng = np.random.default_rng(5)
    raw = np.linalg.solve(MATRIX, 50.0 * simulate.uniform(rng, n).T).T + OFFSET + 0.5 * rng.standard_normal((n, 3))
    fit(raw, unit=Unit.of("uT")).save("calibration.json", force=True)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with calibration.json, exact and without a covariance, and log.csv of all attitudes."""
    monkeypatch.chdir(tmp_path)
    Calibration(MATRIX, OFFSET, 50.0, True, raw=Unit.of("uT")).save("calibration.json")
    write("log.csv", log_of(tumbling()[1]))
    return tmp_path


# heading


def test_headings_are_those_that_the_vehicle_had(home: Path) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv")
    columns = ended.columns
    assert list(columns) == ["line", "time_s", "heading_deg", "roll_deg", "pitch_deg", "dip_deg", "strength"]
    assert_headings(ended, tumbling()[0])
    npt.assert_allclose(columns["dip_deg"], 60.0, atol=2e-3)
    npt.assert_allclose(columns["strength"], 1.0, atol=1e-4)
    npt.assert_allclose(columns["line"], np.arange(600) + 2)
    npt.assert_allclose(columns["time_s"], 0.1 * np.arange(600), atol=1e-6)
    assert "600 readings" in ended.err


def test_true_headings_are_the_declination_further_on(home: Path) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", *ZURICH)
    told = ended.json
    assert told["site"]["model"] == "WMM-2025"
    columns = Ended(0, (home / "out.csv").read_text(encoding="utf-8"), "").columns
    npt.assert_allclose(
        folded(columns["true_heading_deg"] - columns["heading_deg"]), told["declination_deg"], atol=1.1e-3
    )
    assert 3.0 < told["declination_deg"] < 4.0
    assert (columns["true_heading_deg"] < 360.0).all()
    assert told["readings"] == 600
    assert told["measured_dip_deg"] == pytest.approx(60.0, abs=1e-3)
    assert "declination 3." in ended.err


def test_a_heading_just_below_north_is_not_360(home: Path) -> None:
    write("log.csv", log_of(turned(np.full(120, 359.99999))))
    ended = flinders_("heading", "calibration.json", "log.csv", "--declination", "-0.0")
    assert set(ended.columns["heading_deg"]) == set(ended.columns["true_heading_deg"]) == {0.0}
    assert "360.000" not in ended.out


def test_the_day_comes_from_a_clock_that_counts_from_1970(home: Path) -> None:
    write("log.csv", log_of(tumbling()[1], start=1_600_000_000.0), HEADER.replace("t_s", "timestamp_s"))
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", "--at", "47.37,8.54")
    assert ended.json["site"]["model"] == "WMM-2020"
    assert ended.json["site"]["year"] == pytest.approx(2020.70, abs=0.01)
    assert "1600000059.9" in (home / "out.csv").read_text(encoding="utf-8")


def test_today_is_a_day(home: Path) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--at", "47,8", "--date", "today")
    assert ended.code in {2, 3}  # 2 from the year 2030 on, 3 as the dip there is not that of the log
    assert "WM" in ended.err or "World Magnetic Models" in ended.err


def test_a_level_sensor_needs_two_axes_and_no_accelerometer(home: Path) -> None:
    heading = np.arange(0.0, 360.0, 2.0)
    write("level.csv", log_of(turned(heading))[:, :4], "t_s,mx_uT,my_uT,mz_uT")
    ended = flinders_("heading", "calibration.json", "level.csv", "--level")
    assert list(ended.columns) == ["line", "time_s", "heading_deg", "strength"]
    assert_headings(ended, heading)
    assert "each degree of tilt turns a level heading by up to 1.7°" in ended.err
    assert "z is up" not in ended.err


def test_a_level_sensor_that_is_upside_down_is_noticed(home: Path) -> None:
    log = log_of(turned(np.arange(0.0, 360.0, 2.0), 180.0))[:, :4]
    ended = flinders_("heading", "calibration.json", write("over.csv", log, "t_s,mx_uT,my_uT,mz_uT"), "--level")
    assert "z is up and level headings run backwards" in ended.said


def test_legacy_formulas_go_by_their_names(home: Path) -> None:
    exact, named, wrong = (
        flinders_("heading", "calibration.json", "log.csv", "--formula", name).columns["heading_deg"]
        for name in ("exact", "an4248", "an3192")
    )
    npt.assert_allclose(folded(named - exact), 0.0, atol=1.1e-3)
    assert np.nanmax(np.abs(folded(wrong - exact))) > 20.0
    assert "an3192 is wrong" in flinders_("heading", "calibration.json", "log.csv", "--formula", "an3192").err


def test_the_heading_error_of_the_calibration_is_stated(home: Path) -> None:
    found = fit(simulate.tumble(seed=1).samples, site=Site(inclination_deg=60.0))
    found.save("calibration.json", force=True)
    body = tumbling()[1]
    raw = found.calibration.unapply(body @ FIELD)
    write("log.csv", np.column_stack([np.arange(600.0), raw, body @ np.array([0.0, 0.0, -1.0])]))
    told = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", "--dip", "60").json
    assert told["heading_error_deg"]["worst"] == pytest.approx(found.heading_error_deg.worst, rel=1e-6)
    assert told["tilted_heading_error_deg"]["worst"] >= 0.9 * told["heading_error_deg"]["worst"]
    assert "good to  0.0" in flinders_("heading", "calibration.json", "log.csv").err


def test_a_calibration_without_uncertainty_says_so(home: Path) -> None:
    assert "the calibration states no uncertainty" in flinders_("heading", "calibration.json", "log.csv").err


def test_gaps_are_counted_and_leave_the_rest_in_place(home: Path) -> None:
    lines = (home / "log.csv").read_text(encoding="utf-8").splitlines()
    lines[5] = "0.4,nan,1,2,3,4,5"
    lines[7] = "broken"
    lines[9] = ",".join([*lines[9].split(",")[:4], "", "", ""])
    (home / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    ended = flinders_("heading", "calibration.json", "log.csv")
    columns = ended.columns
    assert columns["line"][:8].tolist() == [2, 3, 4, 5, 7, 9, 10, 11]
    assert np.isnan(columns["heading_deg"][6])
    assert np.isnan(columns["heading_deg"]).sum() == 1
    assert "1 not finite line (line 6" in ended.err
    assert "1 unreadable line (line 8" in ended.err
    assert "1 reading without a heading" in ended.err


def test_columns_of_the_accelerometer_can_be_named(home: Path) -> None:
    log = log_of(tumbling()[1])
    write("odd.csv", log, "t_s,mx_uT,my_uT,mz_uT,one,two,three")
    refused = flinders_("heading", "calibration.json", "odd.csv")
    assert refused.code == 5
    assert "(--acceleration, --level)" in refused.err
    for columns in ("one,two,three", "5,6,7"):
        ended = flinders_("heading", "calibration.json", "odd.csv", "--acceleration", columns)
        assert_headings(ended, tumbling()[0])
    write("bare.txt", log[:, 1:], "")
    ended = flinders_("heading", "calibration.json", "bare.txt", "--columns", "1,2,3", "--acceleration", "4,5,6")
    assert_headings(ended, tumbling()[0])


def test_a_stream_is_answered_line_by_line(home: Path) -> None:
    with subprocess.Popen(
        [*PROGRAM, "heading", "calibration.json", "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdin is not None
        assert running.stdout is not None
        lines = (home / "log.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        running.stdin.writelines(lines[:31])
        running.stdin.flush()
        got = [running.stdout.readline() for _ in range(31)]
        assert got[0].startswith("line,time_s,heading_deg")
        assert got[30].startswith("31,")
        running.stdin.write(lines[31])
        running.stdin.flush()
        assert running.stdout.readline().startswith("32,")
        running.stdin.close()
        assert running.wait(PATIENCE_S) == 0


@pytest.mark.parametrize(
    ("columns", "named"),
    [
        ("-ax,-ay,-az", "opposite sign (gravity, not specific force): map its axes (--acceleration-axes=-x,-y,-z"),
        (
            "ay,ax,-az",
            "its x and y are swapped, and its z has the wrong sign: map its axes (--acceleration-axes y,x,-z",
        ),
        ("-ax,-ay,az", "its x and y have the wrong sign: map its axes (--acceleration-axes=-x,-y,z"),
        ("ax,ay,-az", "one of the two is left-handed"),
        ("ay,az,ax", "its x, y and z go round: map its axes (--acceleration-axes z,x,y"),
    ],
)
def test_a_mistaken_axis_is_named_and_its_remedy_works(home: Path, columns: str, named: str) -> None:
    log = log_of(tumbling()[1], noise=0.2)
    places = [log[:, 4 + "xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0) for name in columns.split(",")]
    write("odd.csv", np.column_stack([log[:, :4], *places]))
    ended = flinders_("heading", "calibration.json", "odd.csv", "-o", "out.csv", *ZURICH)
    assert ended.code == 5
    assert named in ended.said
    assert not (home / "out.csv").exists()
    (axes,) = re.findall(r"--acceleration-axes[= ]([-xyz,]+[xyz])", ended.err)
    again = flinders_("heading", "calibration.json", "odd.csv", *ZURICH, f"--acceleration-axes={axes}")
    assert again.code == 3  # the dip is 3.4° less than in Zürich
    assert np.abs(folded(again.columns["heading_deg"] - tumbling()[0])).mean() < 3.0


def test_without_a_site_a_dip_upwards_is_mentioned(home: Path) -> None:
    log = log_of(tumbling()[1])
    log[:, 4:] *= -1.0
    write("odd.csv", log)
    ended = flinders_("heading", "calibration.json", "odd.csv")
    assert ended.code == 3
    assert "the field is seen to point up by 60°" in ended.said
    assert "headings run backwards: give --acceleration-axes=-x,-y,-z" in ended.said
    assert ended.said.index("headings run backwards") < ended.said.index("good to")
    back = flinders_("heading", "calibration.json", "log.csv", "--acceleration-axes=-x,-y,-z")
    assert "headings run backwards: leave --acceleration-axes out" in back.said
    mirrored = flinders_("heading", "calibration.json", "log.csv", "--acceleration-axes=x,y,-z")
    assert mirrored.code == 5
    assert "as they were recorded they do: leave their mapping out (--acceleration-axes)" in mirrored.said
    assert "; or" not in mirrored.said
    assert flinders_("heading", "calibration.json", "odd.csv", "--dip", "-60").code == 0
    assert flinders_("heading", "calibration.json", "odd.csv", "--dip", "60").code == 5


ODD: dict[str, tuple[str, int, str]] = {
    "no such recording": ("calibration.json nix.csv", 5, "does not exist"),
    "the wrong way round": ("log.csv calibration.json", 2, "it comes first: flinders heading calibration.json log.csv"),
    "two calibrations": ("calibration.json calibration.json", 2, "is a calibration too"),
    "a calibration through a pipe": ("- log.csv", 2, "must be a file"),
    "no place": ("calibration.json log.csv --at home --date 2026", 2, "such as 47.62,-122.35"),
    "no day": ("calibration.json log.csv --at 47,8", 2, "--date 2026-11-21"),
    "a day without a model": ("calibration.json log.csv --at 47,8 --date 2031-01-01", 2, "2010 to 2030"),
    "a day without a place": ("calibration.json log.csv --date 2026-01-01", 2, "--at LAT,LON too"),
    "place and declination": (
        "calibration.json log.csv --at 47,8 --date 2026 --declination 3", 2, "leave one of them out",
    ),
    "level with a formula": ("calibration.json log.csv --level --formula an3192", 2, "leave one of them out"),
    "level with an accelerometer": ("calibration.json log.csv --level --acceleration ax,ay,az", 2, "leave one of them"),
    "columns that there are not": ("calibration.json log.csv --acceleration bx,by,bz", 2, "no column 'bx'"),
    "the magnetometer twice": ("calibration.json log.csv --acceleration mx_uT,ay,az", 2, "read as the magnetometer"),
    "axes that are none": ("calibration.json log.csv --acceleration-axes x,x,z", 2, "x, y and z once each"),
    "a formula that is none": ("calibration.json log.csv --formula best", 2, "an4248"),
    "two results to one place": ("calibration.json log.csv --json", 2, "name a file with -o"),
    "over the recording": ("calibration.json log.csv -o log.csv --force", 2, "would be written over"),
    "over a file": ("calibration.json log.csv -o there.csv", 6, "overwrite it (--force)"),
    "into nowhere": ("calibration.json log.csv -o nix/out.csv", 6, "no such folder"),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_what_cannot_be_done_is_said(home: Path, name: str) -> None:
    words, code, said = ODD[name]
    (home / "there.csv").write_text("kept", encoding="utf-8")
    ended = flinders_("heading", *words.split())
    assert ended.code == code
    assert not ended.out or "--json" in words
    assert said in ended.said
    assert ended.err.splitlines()[-1].startswith("error: ")
    assert (home / "there.csv").read_text(encoding="utf-8") == "kept"


def test_another_sensor_is_refused_and_an_odd_field_is_mentioned(home: Path) -> None:
    log = log_of(tumbling()[1])
    log[:, 1:4] *= 20.0
    assert flinders_("heading", "calibration.json", write("far.csv", log)).code == 5
    log = log_of(tumbling()[1])
    log[:, 1:4] += 12.0
    for command in ("heading", "apply"):
        ended = flinders_(command, "calibration.json", write("odd.csv", log))
        assert (ended.code, "do not suit the calibration" in ended.err) == (3, True)


STUCK: dict[str, tuple[list[int], str, str, str]] = {
    "one axis": ([3], "--level", "never changes in 600 readings: z = ", "do not suit the calibration"),
    "all axes": ([1, 2, 3], "--level", "never changes in 600 readings: x = ", "do not suit the calibration"),
    "an accelerometer that never changes": (
        [4, 5, 6], "--dip=60", "the accelerometer never changes", "the accelerometer does not suit",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STUCK)
def test_nothing_is_claimed_of_headings_by_a_sensor_that_is_stuck(home: Path, name: str) -> None:
    columns, option, cause, unclaimed = STUCK[name]
    calibrated(500)
    log = log_of(tumbling()[1])
    log[:, columns] = log[0, columns]
    ended = flinders_("heading", "calibration.json", write("odd.csv", log), "-o", "out.csv", option)
    assert ended.code == 3, ended.err
    assert cause in ended.said
    assert "good to an unknown accuracy" in ended.said
    assert unclaimed in ended.said
    assert "headings run backwards" not in ended.said


def test_a_sensor_that_tumbles_is_not_level(home: Path) -> None:
    calibrated(500)
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--level")
    assert ended.code == 3
    assert "the sensor was tilted, as the vertical field shows" in ended.said
    assert "good to an unknown accuracy: the sensor was tilted" in ended.said


@pytest.mark.parametrize("value", [0.0, math.nan])
def test_an_accelerometer_that_shows_no_vertical_gives_no_heading(home: Path, value: float) -> None:
    calibrated(500)
    log = log_of(tumbling()[1])
    log[:, 4:] = value
    ended = flinders_("heading", "calibration.json", write("odd.csv", log), "-o", "out.csv")
    assert ended.code == 3
    assert "no reading has a heading: the acceleration is zero or missing" in ended.said
    assert "good to nothing: no reading has a heading" in ended.said


def test_an_axis_that_never_changes_is_named_when_readings_are_corrected(home: Path) -> None:
    log = log_of(tumbling()[1])
    log[:, 2] = 7.0
    ended = flinders_("apply", "calibration.json", write("odd.csv", log), "-o", "out.csv")
    assert (ended.code, "never changes in 600 readings: y = 7." in ended.said) == (3, True)


def test_a_calibration_that_states_its_accuracy_notices_a_smaller_change_of_iron(home: Path) -> None:
    """2 µT in each axis is 4 % of spread where noise and claim make 1 %, and degrees of heading."""
    calibrated(500)
    log = log_of(tumbling()[1], noise=0.5)
    assert flinders_("heading", "calibration.json", write("same.csv", log)).code == 0
    log[:, 1:4] += 2.0
    for command in ("heading", "apply"):
        ended = flinders_(command, "calibration.json", write("odd.csv", log))
        assert (ended.code, "do not suit the calibration" in ended.err) == (3, True)


@pytest.mark.parametrize(("share", "code"), [(0.05, 0), (0.2, 3)])
def test_outliers_do_not_make_a_calibration_unsuitable(home: Path, share: float, code: int) -> None:
    """A recording with a few of them gives a good calibration, which corrects the rest of its readings."""
    flinders_("simulate", "three-axis", "-o", "outliers.csv", "--seed", "3", "--outliers", f"{share}")
    assert flinders_("calibrate", "outliers.csv", "-o", "calibration.json", "--force").code == code
    assert flinders_("apply", "calibration.json", "outliers.csv").code == code


@pytest.mark.parametrize("motion", ["level", "sweep-xy", "tilted", "swayed"])
def test_a_calibration_suits_the_readings_that_it_was_made_from(home: Path, motion: str) -> None:
    """Also where what few attitudes leave unknown, as the axis across a level turn, spreads their strength."""
    flinders_("simulate", "three-axis", "-o", "own.csv", "--motion", motion, "--seed", "6")
    assert flinders_("calibrate", "own.csv", "-o", "calibration.json", "--force").code == 3
    assert flinders_("apply", "calibration.json", "own.csv").code == 0


# swing


STOPS = np.arange(0.0, 360.0, 45.0)
KNOWN = ("--headings", ",".join(f"{stop:g}" for stop in STOPS))
HO226 = "compass,deviation\n0,10.5\n45,20\n90,11.5\n135,1.2W\n180,5.5 W\n225,-8\n270,-12.5\n315,-6.8\n"


def test_the_example_of_ho226_from_a_table(home: Path) -> None:
    told = flinders_("swing", "-", "--json", stdin=HO226).json["deviation"]
    assert [f"{told['coefficients_deg'][name]:.4f}" for name in "ABCDE"] == [
        "1.0000", "11.9397", "7.9598", "5.0000", "1.5000",
    ]  # fmt: skip
    assert told["eight_points_deg"] == {"A": 1.0, "B": 12.0, "C": 8.0, "D": 5.0, "E": 1.5}


@pytest.mark.parametrize(
    "table",
    [
        "compass;magnetic\n0;1\n90;93\n180;182\n270;268\n45;47\n",
        "0 1\n90 93\n180 182\n270 268\n45 47\n",
        "known heading,compass reading\n1,0\n93,90\n182,180\n268,270\n47,45\n",
        "magnetic\tdeviation\n1\t1\n93\t3\n182\t2\n268\t-2\n47\t2\n",
        "Kompass;Compass reading;magnetic °\n0;0;1,0\n90;90;93,0\n180;180;182\n270;270;268\n45;45;47\n",
        "# a swing\ncompass,dev (deg),sigma\n0,1,0.5\n90,3,0.5\n180,2,0.5\n270,-2,0.5\n45,2,0.5\n",
    ],
)
def test_tables_are_read_as_they_are_written(home: Path, table: str) -> None:
    ended = flinders_("swing", "-", "--json", stdin=table)
    found = ended.json["deviation"]["swing"]
    npt.assert_allclose(found["compass_deg"], [0.0, 90.0, 180.0, 270.0, 45.0], atol=1e-9)
    npt.assert_allclose(found["deviation_deg"], [1.0, 3.0, 2.0, -2.0, 2.0], atol=1e-9)
    assert ended.code == (0 if "sigma" in table else 3)


def test_true_headings_become_magnetic_ones(home: Path) -> None:
    table = "compass,true\n" + "".join(f"{angle},{angle + 3.5}\n" for angle in range(0, 360, 45))
    ended = flinders_("swing", "-", "--json", *ZURICH, stdin=table)
    declination = ended.json["site"]["declination_deg"]
    assert ended.json["deviation"]["coefficients_deg"]["A"] == pytest.approx(3.5 - declination)
    assert "say where with --at" in flinders_("swing", "-", stdin=table).err
    assert "no true headings" in flinders_("swing", "-", *ZURICH, stdin=HO226).said


def test_card_and_curve_are_written(home: Path) -> None:
    (home / "swing.csv").write_text(HO226, encoding="utf-8")
    ended = flinders_("swing", "swing.csv", "-o", "card.csv", "--svg", "curve.svg", "--step", "10")
    assert ended.code == 0
    card = Ended(0, (home / "card.csv").read_text(encoding="utf-8"), "").columns
    assert list(card) == ["compass_deg", "deviation_deg", "sigma_deg", "magnetic_deg"]
    assert len(card["compass_deg"]) == 36
    npt.assert_allclose(folded(card["compass_deg"] + card["deviation_deg"] - card["magnetic_deg"]), 0.0, atol=2e-3)
    assert (home / "curve.svg").read_text(encoding="utf-8").count("<circle") == 8
    again = flinders_("swing", "swing.csv", "-o", "card.csv")
    assert again.code == 6
    printed = flinders_("swing", "swing.csv", "-o", "-")
    assert printed.out.startswith("compass_deg,")
    assert "least squares" in printed.err


def test_a_swing_from_a_recording_finds_the_iron_that_is_left(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    clean = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json")
    assert clean.code == 0, clean.err
    assert max(map(abs, clean.json["deviation"]["coefficients_deg"].values())) < 0.2
    assert clean.json["half_turns_pass"] is True
    assert len(clean.json["half_turns"]) == 4

    write("iron.csv", with_iron(swinging(STOPS)))
    iron = flinders_("swing", "calibration.json", "iron.csv", *KNOWN, "--json")
    assert iron.code == 3
    found = iron.json["deviation"]["coefficients_deg"]
    assert (found["B"], found["C"]) == (pytest.approx(2.29, abs=0.2), pytest.approx(-1.15, abs=0.2))
    alone = flinders_("swing", "calibration.json", "iron.csv")
    assert alone.code == 4
    assert "FAILS" in alone.out
    assert "hard iron is left (B +2." in " ".join(alone.out.split())
    assert flinders_("swing", "calibration.json", "iron.csv", "--target", "6").code == 0
    json_told = flinders_("swing", "calibration.json", "iron.csv", "--json").json
    assert json_told["hard_iron_deg"]["B"] == pytest.approx(2.29, abs=0.2)


def test_a_swing_says_what_its_calibration_claims_and_whether_that_holds(home: Path) -> None:
    calibrated(400)
    judged = Fit.load("calibration.json")
    assert judged.claim.states_uncertainty
    write("log.csv", swinging(STOPS))
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json["calibration"]
    claimed = deviation_covariance(judged.calibration.ellipsoid, judged.claim.covariance, dip_deg=told["dip_deg"])
    npt.assert_allclose(list(told["sigma_deg"].values()), np.sqrt(np.diag(claimed)), rtol=1e-3)
    assert told["dip_from"] == "measured"
    assert told["p_value"] > 0.01
    page = flinders_("swing", "calibration.json", "log.csv", *KNOWN).out
    assert "claimed" in page
    assert "iron has come or gone" not in page

    write("iron.csv", with_iron(swinging(STOPS)))
    bent = flinders_("swing", "calibration.json", "iron.csv", *KNOWN)
    assert "B to E are more than swing and calibration explain" in " ".join(bent.out.split())
    assert flinders_("swing", "calibration.json", "iron.csv", *KNOWN, "--json").json["calibration"]["p_value"] < 1e-6


def with_rotation_error(off_deg: float, claimed_deg: float) -> None:
    """Turn the calibration by so much about the body's x axis, with that claim about each axis."""
    known = Fit.load("calibration.json")
    turn = rotations(np.array([[np.radians(off_deg), 0.0, 0.0]]))[0]
    turned = replace(known.calibration, matrix=turn @ known.calibration.matrix, rotation="estimated")
    aiding = Aiding(rotation_covariance=np.radians(claimed_deg) ** 2 * np.eye(3))
    known = replace(known, evidence=replace(known.evidence, aiding=aiding)).with_calibration(turned)
    known.save("calibration.json", force=True)


def test_a_rotation_that_is_off_as_it_claims_explains_a_swing(home: Path) -> None:
    """2° about x turn a level compass by up to 3.5°."""
    calibrated(2000)
    write("log.csv", swinging(STOPS))
    with_rotation_error(2.0, 2.0)
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json
    assert abs(told["deviation"]["coefficients_deg"]["C"]) == pytest.approx(3.5, abs=0.2)
    assert told["calibration"]["sigma_deg"]["C"] == pytest.approx(2.0 * math.tan(math.radians(60.0)), rel=0.05)
    assert told["calibration"]["p_value"] > 0.05
    with_rotation_error(0.0, 0.1)
    narrow = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json
    assert narrow["calibration"]["p_value"] < 1e-6


def test_what_the_mounting_adds_is_said_with_the_headings(home: Path) -> None:
    calibrated(2000)
    plain = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json").json
    assert plain["mounting_error_deg"] is None
    with_rotation_error(0.0, 0.5)
    turned = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", "--force").json
    assert turned["mounting_error_deg"] == pytest.approx(0.5 * math.hypot(1.0, math.tan(math.radians(60.0))), rel=0.01)
    assert turned["heading_error_deg"]["worst"] == pytest.approx(plain["heading_error_deg"]["worst"], rel=1e-3)
    said = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--force").said
    assert "how the axes sit in the body adds 1.0° (1 σ)" in said


def test_a_calibration_without_uncertainty_claims_nothing_of_a_swing(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    assert flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json").json["calibration"] is None
    assert "claimed" not in flinders_("swing", "calibration.json", "log.csv", *KNOWN).out


def test_a_curve_that_is_not_known_to_the_target_or_runs_backwards_is_limited(home: Path) -> None:
    wild = "compass,deviation\n0,2\n45,48\n90,71\n135,52\n180,-3\n225,-50\n270,-68\n315,-51\n"
    ended = flinders_("swing", "-", stdin=wild)
    assert ended.code == 3
    page = " ".join(ended.out.split())
    assert "the curve is known to 2.13° (1 σ) at worst, the target is 1°" in page
    assert "one magnetic heading has several by compass" in page
    assert flinders_("swing", "-", "--sigma", "2", stdin=HO226).code == 3
    assert flinders_("swing", "-", "--sigma", "2", "--target", "2", stdin=HO226).code == 0


def test_a_compass_that_turns_the_other_way_makes_no_curve(home: Path) -> None:
    turned = "".join(f"{-heading % 360},{heading}\n" for heading in range(0, 360, 45))
    ended = flinders_("swing", "-", stdin="compass,magnetic\n" + turned)
    assert (ended.code, ended.out) == (4, "")
    assert "about any curve of five coefficients" in ended.err


def test_known_headings_may_be_true_ones(home: Path) -> None:
    write("log.csv", swinging(STOPS))
    told = flinders_("swing", "calibration.json", "log.csv", *KNOWN, "--json", *ZURICH).json
    assert told["deviation"]["coefficients_deg"]["A"] == pytest.approx(-told["site"]["declination_deg"], abs=0.2)


SWINGS: dict[str, tuple[str, str, int, str]] = {
    "an empty table": ("-", "", 5, "nothing was piped in"),
    "a header alone": ("-", "compass,magnetic\n", 5, "no headings below it"),
    "other columns": ("-", "speed,depth\n1,2\n", 5, "columns of standard input are speed, depth"),
    "no text": ("noise.bin", "", 5, "need two columns under a header"),
    "words": ("-", "compass,magnetic\n0,north\n", 5, "line 2 of standard input has no number"),
    "three columns": ("-", "1 2 3\n", 5, "3 columns and no header"),
    "four headings": ("-", "0 1\n90 92\n180 180\n270 268\n", 4, "4 different headings, five coefficients need"),
    "a step that does not go round": ("- --step 7", HO226, 2, "does not go round"),
    "headings for a table": ("- --headings 0,90", HO226, 2, "--headings is for a recording"),
    "three files": ("a b c", "", 2, "3 files were given"),
    "no file": ("", "", 2, "Missing argument"),
    "a calibration alone": ("calibration.json", "", 2, "give the recording of a swing after it"),
    "headings that are none": ("calibration.json log.csv --headings N,E", "", 2, "need degrees"),
    "a heading that goes round twice": (
        "calibration.json log.csv --headings 0,45,900",
        "",
        2,
        "number 3 of --headings",
    ),
    "a digit too many": ("-", HO226.replace("90,", "900,"), 2, "compass in line 4 of standard input is 900°"),
    "too many headings": ("calibration.json log.csv --headings 1,2,3,4,5,6", "", 4, "0 rests: name one for each"),
    "no half turn": ("calibration.json log.csv", "", 4, "no turn by 180°"),
    "a place without headings": ("calibration.json log.csv --at 47,8 --date 2026", "", 2, "give --headings too"),
    "a card without headings": ("calibration.json turn.csv -o card.csv", "", 2, "without known headings"),
    "two results to one place": ("- --json -o -", HO226, 2, "would both go to standard output"),
    "card and curve in one": ("- --svg x -o x", HO226, 2, "give them two names"),
    "over the table": ("swing.csv -o swing.csv --force", "", 2, "would be written over"),
    "sigma of nothing": ("- --sigma 0", HO226, 2, "above 0"),
}


@pytest.mark.parametrize("name", SWINGS)
def test_what_is_no_swing_is_said(home: Path, name: str) -> None:
    words, table, code, said = SWINGS[name]
    (home / "swing.csv").write_text(HO226, encoding="utf-8")
    write("turn.csv", swinging(np.array([0.0, 180.0])))
    (home / "noise.bin").write_bytes(bytes(range(256)) * 4)
    ended = flinders_("swing", *words.split(), stdin=table)
    assert ended.code == code
    assert not ended.out or "--json" in words
    assert said in ended.said
    assert not (home / "card.csv").exists()


# real recordings


def test_an_accelerometer_that_reads_gravity_is_found_out(home: Path, recordings: Callable[[str], Path]) -> None:
    """The sign of this board's accelerometer is that of gravity; the site is in Germany."""
    sphere = str(recordings("sunsided_hmc5883l/full-sphere.csv"))
    assert flinders_("calibrate", sphere, "--unit", "G", "-o", "board.json").code in {0, 3}
    refused = flinders_("heading", "board.json", sphere, "-o", "out.csv", "--dip", "67")
    assert refused.code == 5
    assert "map its axes (--acceleration-axes=-x,-y,-z)" in refused.err
    ended = flinders_(
        "heading", "board.json", sphere, "-o", "out.csv", "--dip", "67", "--acceleration-axes=-x,-y,-z", "--json"
    )
    assert ended.code == 0
    assert ended.json["measured_dip_deg"] == pytest.approx(66.0, abs=2.0)
    assert ended.json["measured_dip_scatter_deg"] < 4.0


def test_a_swapped_accelerometer_of_a_real_board_is_named(home: Path, recordings: Callable[[str], Path]) -> None:
    path = str(recordings("ckexplorer_acc_mag/acc_mag_log.csv"))
    assert flinders_("calibrate", path, "--unit", "G", "-o", "board.json").code in {0, 3}
    assert flinders_("heading", "board.json", path, "-o", "out.csv").code == 3  # a dip upwards
    refused = flinders_("heading", "board.json", path, "-o", "odd.csv", "--acceleration", "ay,ax,az", "--dip", "-18")
    assert refused.code == 5
    assert "its x and y are swapped: map its axes; one of the two" in refused.err


def test_a_magnetometer_that_is_turned_over_in_its_chip_is_found_out(
    home: Path, recordings: Callable[[str], Path]
) -> None:
    """The maker's own calibration, which is in the file, turns the sign of x over: one of the two is left-handed."""
    path = str(recordings("timspi_imu_gnss/imu_gnss_data.csv"))
    assert flinders_("calibrate", path, "--target", "8", "-o", "board.json").code in {0, 3}
    refused = flinders_("heading", "board.json", path, "-o", "out.csv")
    assert refused.code == 5
    assert "its y and z have the wrong sign: map its axes (--acceleration-axes x,-y,-z" in refused.err
    ended = flinders_("heading", "board.json", path, "-o", "out.csv", "--acceleration-axes=x,-y,-z", "--json")
    assert ended.code == 3  # a dip upwards, without a site
    assert ended.json["measured_dip_scatter_deg"] < 8.0
    assert ended.json["measured_dip_deg"] < -40.0
    refused = flinders_("heading", "board.json", path, "-o", "other.csv", "--dip", "50")
    assert "its x has the wrong sign: map its axes; one of the two is left-handed" in refused.err


def test_the_command_gives_what_the_library_gives(home: Path) -> None:
    log = log_of(tumbling()[1])
    calibration = Calibration.load("calibration.json")
    found = magnetic_heading_deg(calibration.apply(log[:, 1:4]), log[:, 4:])
    ended = flinders_("heading", "calibration.json", "log.csv")
    assert_headings(ended, found)


def test_the_scatter_of_the_dip_contains_what_gains_of_an_accelerometer_do_to_headings() -> None:
    """Gains off by 2 % and axes from square by a degree, 1 σ, of a compass that tilts by up to 35°."""
    ratios, rng = [], np.random.default_rng(1)
    for seed in range(20):
        recording = simulate.tumble(seed=seed, motion="tilted", n=400, sensor=simulate.Sensor(), noise=0.05)
        assert recording.attitudes is not None
        force = -9.81 * recording.attitudes[:, 2]
        off = rng.normal(0.0, [0.02] * 3 + [0.0087] * 3)
        samples = replace(recording.samples, acceleration=force @ (np.eye(3) + symmetric(off)))
        headings = Compass(Calibration.identity(field_strength=50.0, raw=samples.unit)).read(samples)
        apart = folded(headings.magnetic_deg - magnetic_heading_deg(samples.field, force))
        dip_deg, scatter_deg = headings.frames.dip_deg
        ratios.append(float(np.std(apart)) / (scatter_deg * math.tan(math.radians(dip_deg))))
    assert np.median(ratios) == pytest.approx(1.0, abs=0.2)
    assert max(ratios) < 1.5


def test_what_the_calibration_found_wrong_with_the_accelerometer_is_taken_off(home: Path) -> None:
    """In m/s² or in shares of gravity: its bias, its gains and its skewed axes tilt the vertical no longer."""
    headings = np.arange(0.0, 360.0, 1.0)
    body = turned(headings, 6.0, -12.0)
    bias, gains = np.array([0.3, -0.2, 0.1]), np.array([[1.02, 0.01, 0.0], [0.01, 0.98, 0.0], [0.0, 0.0, 1.0]])
    calibration = Calibration(np.eye(3), np.zeros(3), 50.0, raw=Unit.of("uT"))
    record = aiding_record(acceleration_bias=bias, acceleration_matrix=np.linalg.inv(gains))
    fitted = Fitted(method="likelihood", samples=360, aiding=record)
    for gravity in (9.80665, 1.0):
        force = body @ np.array([0.0, 0.0, -gravity]) @ gains
        samples = Samples.of(body @ FIELD, unit="uT", acceleration=force + bias * gravity / 9.80665)
        loaded = Fit.from_document(calibration.to_document(fit=fitted))
        aiding = loaded.evidence.aiding
        assert aiding is not None
        off, matrix = aiding.acceleration_bias, aiding.acceleration_matrix
        compass = Compass(loaded.calibration, gravity=gravity, acceleration_bias=off, acceleration_matrix=matrix)
        apart = folded(compass.read(samples).magnetic_deg - headings)
        assert np.abs(apart).max() < 0.01
        assert np.abs(folded(Compass(calibration).read(samples).magnetic_deg - headings)).max() > 1.0
