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
from tests.heading_logs import (
    FIELD,
    HEADER,
    MATRIX,
    OFFSET,
    ZURICH,
    calibrated,
    log_of,
    tumbling,
    turned,
    with_rotation_error,
    write,
)
from tests.program import Ended, flinders_
from tests.sentences import assert_sentences
from tests.waiting import PATIENCE_S

from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import Fitted, aiding_record
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.fitting.calibrate import fit
from flinders.fitting.fit_file import fit_from
from flinders.geometry.angles import wrap_180
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.heading.attitude import magnetic_heading_deg
from flinders.heading.compass import Compass
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

PROGRAM = [sys.executable, "-c", "from flinders.cli import main; main(prog_name='flinders')"]


def assert_headings(ended: Ended, wanted: Floats, atol: float = 2e-3) -> None:
    """Those that were written are those that the vehicle had."""
    assert ended.code == 0, ended.err
    npt.assert_allclose(wrap_180(ended.columns["heading_deg"] - wanted), 0.0, atol=atol)


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


def test_headings_from_grid_north_are_the_convergence_behind(home: Path) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", "--grid", *ZURICH)
    columns, told = replace(ended, out=(home / "out.csv").read_text(encoding="utf-8")).columns, ended.json
    turn = wrap_180(columns["true_heading_deg"] - columns["grid_heading_deg"])
    npt.assert_allclose(turn, told["site"]["grid"]["convergence_deg"], atol=1.1e-3)
    assert told["site"]["grid"]["name"] == "UTM 32N"
    assert told["grid_declination_deg"] == told["site"]["grid_declination_deg"]
    assert_sentences(ended.said)
    without = flinders_("heading", "calibration.json", "log.csv", *ZURICH)
    assert "grid" not in without.said + without.out


@pytest.mark.parametrize(
    ("asked", "model"),
    [(["1985-06-01"], "IGRF-14"), (["2026", "--field-model", "wmmhr"], "WMMHR-2025"), (["2026"], "WMM-2025")],
)
def test_the_model_is_that_of_the_day_or_the_one_asked_for(home: Path, asked: list[str], model: str) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv", "--at", "47.38,8.54", "--date", *asked)
    assert f"{model} at 47.38" in ended.said


def test_true_headings_are_the_declination_further_on(home: Path) -> None:
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", *ZURICH)
    told = ended.json
    assert told["site"]["model"] == "WMM-2025"
    columns = Ended(0, (home / "out.csv").read_text(encoding="utf-8"), "").columns
    npt.assert_allclose(
        wrap_180(columns["true_heading_deg"] - columns["heading_deg"]), told["declination_deg"], atol=1.1e-3
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
    assert_sentences(ended.err)
    assert "z is up" not in ended.err


def test_a_level_sensor_that_is_upside_down_is_noticed(home: Path) -> None:
    log = log_of(turned(np.arange(0.0, 360.0, 2.0), 180.0))[:, :4]
    ended = flinders_("heading", "calibration.json", write("over.csv", log, "t_s,mx_uT,my_uT,mz_uT"), "--level")
    assert_sentences(ended.said)


def test_legacy_formulas_go_by_their_names(home: Path) -> None:
    exact, named, wrong = (
        flinders_("heading", "calibration.json", "log.csv", "--formula", name).columns["heading_deg"]
        for name in ("exact", "an4248", "an3192")
    )
    npt.assert_allclose(wrap_180(named - exact), 0.0, atol=1.1e-3)
    assert np.nanmax(np.abs(wrap_180(wrong - exact))) > 20.0
    assert_sentences(flinders_("heading", "calibration.json", "log.csv", "--formula", "an3192").err)


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
    assert_sentences(flinders_("heading", "calibration.json", "log.csv").err)


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
    assert_sentences(ended.err)


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
    "columns",
    [
        "-ax,-ay,-az",
        "ay,ax,-az",
        "-ax,-ay,az",
        "ax,ay,-az",
        "ay,az,ax",
    ],
)
def test_a_mistaken_axis_is_named_and_its_remedy_works(home: Path, columns: str) -> None:
    log = log_of(tumbling()[1], noise=0.2)
    places = [log[:, 4 + "xyz".index(name[-1])] * (-1.0 if name[0] == "-" else 1.0) for name in columns.split(",")]
    write("odd.csv", np.column_stack([log[:, :4], *places]))
    ended = flinders_("heading", "calibration.json", "odd.csv", "-o", "out.csv", *ZURICH)
    assert ended.code == 5
    assert_sentences(ended.said)
    assert not (home / "out.csv").exists()
    (axes,) = re.findall(r"--acceleration-axes[= ]([-xyz,]+[xyz])", ended.err)
    again = flinders_("heading", "calibration.json", "odd.csv", *ZURICH, f"--acceleration-axes={axes}")
    assert again.code == 3  # the dip is 3.4° less than in Zürich
    assert np.abs(wrap_180(again.columns["heading_deg"] - tumbling()[0])).mean() < 3.0


def test_without_a_site_a_dip_upwards_is_mentioned(home: Path) -> None:
    log = log_of(tumbling()[1])
    log[:, 4:] *= -1.0
    write("odd.csv", log)
    ended = flinders_("heading", "calibration.json", "odd.csv")
    assert ended.code == 3
    assert_sentences(ended.said)
    assert ended.said.index("--acceleration-axes") < ended.said.index("good to")
    back = flinders_("heading", "calibration.json", "log.csv", "--acceleration-axes=-x,-y,-z")
    assert_sentences(back.said)
    mirrored = flinders_("heading", "calibration.json", "log.csv", "--acceleration-axes=x,y,-z")
    assert mirrored.code == 5
    assert_sentences(mirrored.said)
    assert "; or" not in mirrored.said
    assert flinders_("heading", "calibration.json", "odd.csv", "--dip", "-60").code == 0
    assert flinders_("heading", "calibration.json", "odd.csv", "--dip", "60").code == 5


ODD: dict[str, tuple[str, int]] = {
    "no such recording": ("calibration.json nix.csv", 5),
    "the wrong way round": ("log.csv calibration.json", 2),
    "two calibrations": ("calibration.json calibration.json", 2),
    "a calibration through a pipe": ("- log.csv", 2),
    "no place": ("calibration.json log.csv --at home --date 2026", 2),
    "no day": ("calibration.json log.csv --at 47,8", 2),
    "a day without a model": ("calibration.json log.csv --at 47,8 --date 2031-01-01", 2),
    "a day without a place": ("calibration.json log.csv --date 2026-01-01", 2),
    "a model without a place": ("calibration.json log.csv --field-model igrf", 2),
    "a model of other years": ("calibration.json log.csv --at 47,8 --date 2020 --field-model wmmhr", 2),
    "a grid without a place": ("calibration.json log.csv --grid", 2),
    "place and declination": ("calibration.json log.csv --at 47,8 --date 2026 --declination 3", 2),
    "level with a formula": ("calibration.json log.csv --level --formula an3192", 2),
    "level with an accelerometer": ("calibration.json log.csv --level --acceleration ax,ay,az", 2),
    "columns that there are not": ("calibration.json log.csv --acceleration bx,by,bz", 2),
    "the magnetometer twice": ("calibration.json log.csv --acceleration mx_uT,ay,az", 2),
    "axes that are none": ("calibration.json log.csv --acceleration-axes x,x,z", 2),
    "a formula that is none": ("calibration.json log.csv --formula best", 2),
    "two results to one place": ("calibration.json log.csv --json", 2),
    "over the recording": ("calibration.json log.csv -o log.csv --force", 2),
    "over a file": ("calibration.json log.csv -o there.csv", 6),
    "into nowhere": ("calibration.json log.csv -o nix/out.csv", 6),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_what_cannot_be_done_is_said(home: Path, name: str) -> None:
    words, code = ODD[name]
    (home / "there.csv").write_text("kept", encoding="utf-8")
    ended = flinders_("heading", *words.split())
    assert ended.code == code
    assert not ended.out or "--json" in words
    assert_sentences(ended.said)
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
        assert ended.code == 3
        assert_sentences(ended.err)


STUCK: dict[str, tuple[list[int], str]] = {
    "one axis": ([3], "--level"),
    "all axes": ([1, 2, 3], "--level"),
    "an accelerometer that never changes": ([4, 5, 6], "--dip=60"),
}


@pytest.mark.parametrize("name", STUCK)
def test_nothing_is_claimed_of_headings_by_a_sensor_that_is_stuck(home: Path, name: str) -> None:
    columns, option = STUCK[name]
    calibrated(500)
    log = log_of(tumbling()[1])
    log[:, columns] = log[0, columns]
    ended = flinders_("heading", "calibration.json", write("odd.csv", log), "-o", "out.csv", option)
    assert ended.code == 3, ended.err
    assert_sentences(ended.said)
    assert "headings run backwards" not in ended.said


def test_a_sensor_that_tumbles_is_not_level(home: Path) -> None:
    calibrated(500)
    ended = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--level")
    assert ended.code == 3
    assert_sentences(ended.said)


@pytest.mark.parametrize("value", [0.0, math.nan])
def test_an_accelerometer_that_shows_no_vertical_gives_no_heading(home: Path, value: float) -> None:
    calibrated(500)
    log = log_of(tumbling()[1])
    log[:, 4:] = value
    ended = flinders_("heading", "calibration.json", write("odd.csv", log), "-o", "out.csv")
    assert ended.code == 3
    assert_sentences(ended.said)


def test_an_axis_that_never_changes_is_named_when_readings_are_corrected(home: Path) -> None:
    log = log_of(tumbling()[1])
    log[:, 2] = 7.0
    ended = flinders_("apply", "calibration.json", write("odd.csv", log), "-o", "out.csv")
    assert ended.code == 3
    assert_sentences(ended.said)


def test_a_calibration_that_states_its_accuracy_notices_a_smaller_change_of_iron(home: Path) -> None:
    """2 µT in each axis is 4 % of spread where noise and claim make 1 %, and degrees of heading."""
    calibrated(500)
    log = log_of(tumbling()[1], noise=0.5)
    assert flinders_("heading", "calibration.json", write("same.csv", log)).code == 0
    log[:, 1:4] += 2.0
    for command in ("heading", "apply"):
        ended = flinders_(command, "calibration.json", write("odd.csv", log))
        assert ended.code == 3
        assert_sentences(ended.err)


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


def test_what_the_mounting_adds_is_said_with_the_headings(home: Path) -> None:
    calibrated(2000)
    plain = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json").json
    assert plain["mounting_error_deg"] is None
    with_rotation_error(0.0, 0.5)
    turned = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--json", "--force").json
    assert turned["mounting_error_deg"] == pytest.approx(0.5 * math.hypot(1.0, math.tan(math.radians(60.0))), rel=0.01)
    assert turned["heading_error_deg"]["worst"] == pytest.approx(plain["heading_error_deg"]["worst"], rel=1e-3)
    said = flinders_("heading", "calibration.json", "log.csv", "-o", "out.csv", "--force").said
    assert_sentences(said)


# real recordings


def test_an_accelerometer_that_reads_gravity_is_found_out(home: Path, recordings: Callable[[str], Path]) -> None:
    """The sign of this board's accelerometer is that of gravity; the site is in Germany."""
    sphere = str(recordings("sunsided_hmc5883l/full-sphere.csv"))
    assert flinders_("calibrate", sphere, "--unit", "G", "-o", "board.json").code in {0, 3}
    refused = flinders_("heading", "board.json", sphere, "-o", "out.csv", "--dip", "67")
    assert refused.code == 5
    assert_sentences(refused.err)
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
    assert_sentences(refused.err)


def test_a_magnetometer_that_is_turned_over_in_its_chip_is_found_out(
    home: Path, recordings: Callable[[str], Path]
) -> None:
    """The maker's own calibration, which is in the file, turns the sign of x over: one of the two is left-handed."""
    path = str(recordings("timspi_imu_gnss/imu_gnss_data.csv"))
    assert flinders_("calibrate", path, "--target", "8", "-o", "board.json").code in {0, 3}
    refused = flinders_("heading", "board.json", path, "-o", "out.csv")
    assert refused.code == 5
    assert_sentences(refused.err)
    ended = flinders_("heading", "board.json", path, "-o", "out.csv", "--acceleration-axes=x,-y,-z", "--json")
    assert ended.code == 3  # a dip upwards, without a site
    assert ended.json["measured_dip_scatter_deg"] < 8.0
    assert ended.json["measured_dip_deg"] < -40.0
    refused = flinders_("heading", "board.json", path, "-o", "other.csv", "--dip", "50")
    assert_sentences(refused.err)


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
        samples = replace(recording.samples, acceleration=force @ (np.eye(3) + symmetric_matrix(off)))
        headings = Compass(Calibration.identity(field_strength=50.0, raw=samples.unit)).read(samples)
        apart = wrap_180(headings.magnetic_deg - magnetic_heading_deg(samples.field, force))
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
        loaded = fit_from(calibration.to_document(fit=fitted))
        aiding = loaded.evidence.aiding
        assert aiding is not None
        off, matrix = aiding.acceleration_bias, aiding.acceleration_matrix
        compass = Compass(loaded.calibration, gravity=gravity, acceleration_bias=off, acceleration_matrix=matrix)
        apart = wrap_180(compass.read(samples).magnetic_deg - headings)
        assert np.abs(apart).max() < 0.01
        assert np.abs(wrap_180(Compass(calibration).read(samples).magnetic_deg - headings)).max() > 1.0
