"""Columns that a calibration follows by their names: found, left out, refused; in files, tables and generated code."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.columns import KINDS, VEHICLES, counts
from click.testing import CliRunner, Result
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.cli._calibrate_options import split_recorded_names
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance
from flinders.diagnostics.attitude_following import predicted_share
from flinders.errors import DocumentError, FollowsAttitude, InputError, UsageError
from flinders.fitting.fit_file import load
from flinders.targets import find

if TYPE_CHECKING:
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

CHARGER = simulate.NamedColumn("charger", [4.0, 0.0, -1.5], states=("idle", "charging"), hold=2.0)
WHEEL = simulate.NamedColumn("wheel_speed_rpm", [0.002, 0.0, -0.003], highest=3000.0, hold=2.0)
NAMES = ("wheel_speed_rpm", "charger")


@pytest.fixture(scope="module")
def rover() -> Samples:
    samples = simulate.tumble(seed=5, n=1500, disturbances=[CHARGER, WHEEL]).samples
    weather = np.random.default_rng(5).normal(size=len(samples))
    return replace(samples, auxiliary={**samples.auxiliary, "humidity": weather})


@pytest.fixture(scope="module")
def fit(rover: Samples) -> Fit:
    return flinders.fit(rover, disturbances=("humidity", "charger", "wheel_speed_rpm"))


def test_columns_that_explain_readings_are_followed_and_others_are_named(fit: Fit) -> None:
    assert [one.name for one in fit.calibration.disturbances] == ["charger", "wheel_speed_rpm"]
    covariance = fit.evidence.disturbances.covariance
    assert covariance is not None
    for place, (one, true) in enumerate(zip(fit.calibration.disturbances, (CHARGER, WHEEL), strict=True)):
        rows = slice(9 + 3 * place, 12 + 3 * place)
        off = one.per_unit - np.asarray(true.per_unit)
        assert off @ np.linalg.solve(covariance[rows, rows], off) < 16.3  # once in a thousand
    assert fit.calibration.disturbances[0].states == ("idle", "charging")
    (left_out,) = (finding for finding in fit.findings if finding.code == "column-unused")
    assert left_out.values["name"] == "humidity"
    assert fit.verdict == "good"


def test_each_states_what_it_explains(rover: Samples, fit: Fit) -> None:
    """Within three standard deviations of what was put in."""
    known = {one.name: one for one in fit.evidence.disturbances.estimates}
    wheel = np.std(rover.auxiliary["wheel_speed_rpm"]) * np.linalg.norm(np.asarray(WHEEL.per_unit))
    assert abs(known["wheel_speed_rpm"].explained - wheel) < 3.0 * known["wheel_speed_rpm"].explained_sigma
    assert 0.5 < known["charger"].explained_share < known["wheel_speed_rpm"].explained_share < 1.0
    assert 0.0 < known["charger"].explained_share_sigma < 0.05
    assert known["humidity"].is_unused


def test_a_column_that_takes_an_axis_of_the_readings_is_refused_as_what_it_is() -> None:
    """Less so much of it, the readings lie in a plane, and an ellipsoid of any size goes through them."""
    tumble = simulate.tumble(seed=1, disturbances=[WHEEL])
    axis = tumble.samples.field[:, 1]
    followed = replace(tumble.samples, auxiliary={"servo": (0.05 * axis + 3.0).round(3)})
    with pytest.raises(FollowsAttitude):
        flinders.fit(followed, disturbances=("servo",))


@pytest.mark.parametrize("shape", [0, 1, 2])
def test_a_column_that_follows_attitude_is_refused(shape: int) -> None:
    tumble = simulate.tumble(seed=7, n=1500)
    matrix, offset = tumble.sensor.correction
    directions = (tumble.samples.field - offset) @ np.asarray(matrix).T / tumble.field_strength
    column = (directions[:, 0], directions[:, 1] ** 2, np.where(directions[:, 2] > 0.2, "open", "shut"))[shape]
    with pytest.raises(FollowsAttitude) as refused:
        flinders.fit(replace(tumble.samples, auxiliary={"servo": column}), disturbances=("servo",))
    assert refused.value.column == "servo"
    assert refused.value.share > 0.75


def test_a_slow_course_follows_no_direction() -> None:
    directions = simulate.uniform_directions(np.random.default_rng(2), 900)
    assert predicted_share(np.linspace(0.0, 1.0, 900), directions) < 0.2


@pytest.mark.parametrize("kind", KINDS)
def test_of_a_hundred_vehicles_at_least_95_come_out_as_they_have_to(kind: str, trials: Choose) -> None:
    vehicles = trials(VEHICLES, 1).count
    assert counts(kind, vehicles)[KINDS[kind][1]] >= 0.95 * vehicles


# values


def test_words_are_states_and_numbers_stay_numbers(rover: Samples, fit: Fit) -> None:
    charging = fit.calibration.apply(rover.field[0], charger="charging", wheel_speed_rpm=0.0)
    npt.assert_allclose(charging, fit.calibration.apply(rover.field[0], charger=1.0, wheel_speed_rpm=0.0))
    npt.assert_allclose(charging, fit.calibration.at(charger="charging").apply(rover.field[0]))
    raw = fit.calibration.unapply(charging, charger="charging", wheel_speed_rpm=0.0)
    npt.assert_allclose(raw, rover.field[0])
    with pytest.raises(UsageError, match="fault"):
        fit.calibration.apply(rover.field[0], charger="fault", wheel_speed_rpm=0.0)
    with pytest.raises(UsageError, match="charger"):
        fit.calibration.apply(rover.field[0], wheel_speed_rpm=0.0)
    with pytest.raises(UsageError, match="wheel_speed_rpm"):
        fit.calibration.apply(rover.field[0], charger="idle", wheel_speed=0.0)


@pytest.mark.parametrize("name", ["raw", "heading", "level", "columns", "corrected", " ", "currents"])
def test_names_that_apply_has_already_are_refused(name: str) -> None:
    with pytest.raises(UsageError):
        Disturbance(name, np.array([0.0, 0.0, 0.0]))


def test_columns_of_more_or_fewer_than_two_words_are_refused(rover: Samples) -> None:
    words = np.resize(["idle", "charging", "fault"], len(rover))
    with assert_raises(InputError):
        flinders.fit(replace(rover, auxiliary={"charger": words}), disturbances=("charger",))
    with pytest.raises(InputError, match="1 word"):
        flinders.fit(replace(rover, auxiliary={"charger": np.full(len(rover), "idle")}), disturbances=("charger",))


def test_known_names_come_before_columns_of_the_same_name() -> None:
    assert split_recorded_names(["rate,dip,current", "rate_hz"]) == (("rate", "dip"), ("current", "rate_hz"))


# files


def test_a_calibration_file_keeps_columns(tmp_path: Path, fit: Fit) -> None:
    fit.save(tmp_path / "calibration.json")
    again = load(tmp_path / "calibration.json")
    assert again.calibration == fit.calibration
    covariance = again.evidence.disturbances.covariance
    assert covariance is not None
    before = fit.evidence.disturbances.covariance
    assert before is not None
    npt.assert_allclose(covariance, before)
    content = json.loads((tmp_path / "calibration.json").read_text())
    assert content["schema"] == 1
    assert content["calibration"]["columns"]["charger"]["states"] == ["idle", "charging"]
    content["calibration"]["columns"]["current"] = content["calibration"]["columns"].pop("charger")
    (tmp_path / "odd.json").write_text(json.dumps(content))
    with pytest.raises(DocumentError):
        load(tmp_path / "odd.json")


def test_a_column_may_be_called_as_a_known_kind_is_in_files() -> None:
    both = (
        Disturbance("current", np.array([1.0, 0.0, 0.0]), highest=9.0),
        Disturbance("current_A", np.array([0.0, 1.0, 0.0]), highest=9.0),
    )
    calibration = replace(Calibration.identity(field_strength=50.0), disturbances=both)
    assert Calibration.from_document(calibration.to_document()) == calibration


def run(*words: str, code: int = 0) -> Result:
    ended = CliRunner().invoke(main, [str(word) for word in words])
    assert ended.exit_code == code, ended.output
    return ended


def test_the_commands_follow_columns(tmp_path: Path, rover: Samples, fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Table to calibration, and the table corrected by it, as in Python."""
    monkeypatch.chdir(tmp_path)
    simulate.write_csv(rover, "rover.csv")
    run("calibrate", "rover.csv", "--with", "wheel_speed_rpm,charger", "-o", "calibration.json")
    calibration = load("calibration.json").calibration
    assert calibration.isclose(fit.calibration, tolerance=1e-3)
    run("apply", "calibration.json", "rover.csv", "-o", "corrected.csv")
    field = flinders.read("corrected.csv", columns="mag_x_uT,mag_y_uT,mag_z_uT").field
    driven = {name: rover.auxiliary[name] for name in NAMES}
    npt.assert_allclose(field, calibration.apply(np.round(rover.field, 4), **driven), atol=2e-3)
    ended = run("apply", "calibration.json", "rover.csv", "--fix", "charger=broken", code=2)
    assert_sentences(ended.stderr)
    ended = run("calibrate", "rover.csv", "--with", "wheel_sped_rpm", code=5)
    assert "wheel_speed_rpm" in ended.stderr


@pytest.mark.parametrize("kind", ["frame", "mapping", "parquet", "arrow", "hdf5"])
def test_tables_of_all_kinds_have_columns(tmp_path: Path, rover: Samples, kind: str) -> None:
    names: tuple[str, ...] = NAMES
    source: Any = rover.as_columns()
    if kind == "frame":
        source = pytest.importorskip("pandas").DataFrame(source)
    elif kind == "arrow":
        pytest.importorskip("pyarrow")
        source = rover.to_arrow()
    elif kind == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(rover.to_arrow(), tmp_path / "rover.parquet")
        source = tmp_path / "rover.parquet"
    elif kind == "hdf5":
        names = ("wheel_speed_rpm",)
        with pytest.importorskip("h5py").File(tmp_path / "rover.h5", "w") as file:
            for name, values in source.items():
                if name != "charger":
                    file[name] = values
        source = tmp_path / "rover.h5"
    read = flinders.read(source, auxiliary=names)
    for name in names:
        if name == "charger":
            assert read.auxiliary[name].tolist() == rover.auxiliary[name].tolist()
        else:
            npt.assert_allclose(read.auxiliary[name], rover.auxiliary[name])
    with assert_raises(InputError):
        flinders.read(source, auxiliary=["rover"])


def test_words_of_a_text_keep_their_lines(tmp_path: Path) -> None:
    """Where lines that are none stand between, quotes and gaps too."""
    rows = [f"{number}.0,{number + 1}.0,{number + 2}.5,{word}" for number, word in enumerate(["on", '"off"', "", "on"])]
    lines = ["mx_uT,my_uT,mz_uT,fan", *rows[:2], "# a remark", *rows[2:]]
    (tmp_path / "fan.csv").write_text("\n".join(lines * 1))
    assert flinders.read(tmp_path / "fan.csv", auxiliary=["fan"]).auxiliary["fan"].tolist() == ["on", "off", "", "on"]


# on a bench


def test_a_bench_tells_the_offset_of_a_state(rover: Samples, fit: Fit) -> None:
    words = np.repeat(np.resize(["idle", "charging"], 8), 50)
    shift = 4.0 * (words == "charging")[:, np.newaxis] * [1.0, 0.0, 0.0]
    noise = np.random.default_rng(1).normal(scale=0.2, size=(400, 3))
    field = np.array([20.0, -5.0, 43.0]) + shift + noise
    bench = flinders.Samples.of(field, unit="uT", time=np.arange(400) / 50.0, auxiliary={"charger": words})
    made = flinders.fit_bench(bench, fit.calibration.at(), ["charger"])
    (one,) = made.calibration.disturbances
    assert one.states == ("idle", "charging")
    npt.assert_allclose(one.per_unit, [4.0, 0.0, 0.0], atol=0.1)


# in generated code


@pytest.fixture(scope="module")
def odd() -> Calibration:
    """A calibration that follows columns of names that are none in code."""
    followed = (
        Disturbance("/charger.state */ x", np.array([4.0, 0.0, -1.5]), highest=1.0, states=("idle", "charging")),
        Disturbance("for", np.array([0.0, 0.3, 0.1]), 2.0, 0.0, 9.0),
        Disturbance("FOR", np.array([0.1, 0.0, 0.0]), 0.0, 0.0, 9.0),
    )
    matrix = np.array([[0.9, 0.05, 0.1], [0.05, 1.2, -0.1], [0.1, -0.1, 0.94]])
    return Calibration(matrix, np.array([10.0, 20.0, 30.0]), 50.0, disturbances=followed)


def expected(odd: Calibration) -> Floats:
    values: dict[str, Any] = {"/charger.state */ x": "charging", "for": 5.0, "FOR": 3.0}
    return odd.apply([60.0, 5.0, 40.0], **values)


def test_a_module_chooses_by_state(odd: Calibration) -> None:
    module: dict[str, Any] = {}
    exec(find("micropython").render(odd).text, module)
    npt.assert_allclose(module["correct_at"]((60.0, 5.0, 40.0), 1, 3.0, 5.0), expected(odd), rtol=1e-6)


@pytest.mark.tools
@pytest.mark.skipif(shutil.which("g++") is None, reason="no compiler")
@pytest.mark.parametrize("target", ["c", "arduino"])
def test_compiled_code_chooses_by_state(tmp_path: Path, odd: Calibration, target: str) -> None:
    call = (
        "correctMagnetometerAt(v[0], v[1], v[2], 1, 3, 5)"
        if target == "arduino"
        else "flinders_correct_at(v, 1, 3, 5, v)"
    )
    given, shown = "float v[3] = {60, 5, 40};", 'printf("%g %g %g", v[0], v[1], v[2]);'
    main_c = f"#include <stdio.h>\nint main(void) {{ {given} {call}; {shown} }}"
    source = tmp_path / "code.cpp"
    source.write_text(find(target).render(odd).text + "\n" + main_c)
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", str(source), "-o", str(tmp_path / "code")], check=True)
    printed = subprocess.run([str(tmp_path / "code")], capture_output=True, text=True, check=True).stdout
    npt.assert_allclose([float(each) for each in printed.split()], expected(odd), rtol=1e-4)


def test_plain_json_is_read_back(odd: Calibration) -> None:
    target = find("json")
    assert target.reader is not None
    assert target.reader.read(target.render(odd).text.encode(), "x.json").disturbances == odd.disturbances
