"""Survey instruments: what is true of a simulated one is found, what cannot be fitted is refused, and files agree."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.apps import survey
from flinders.apps.survey.calibration import SurveyFit, check_shots, fit_survey
from flinders.apps.survey.instrument import PROCEDURE, Shots, SurveyCalibration, pointing_angles
from flinders.apps.survey.pointing_error import AZIMUTHS_DEG, INCLINATIONS_DEG, attitudes_of, invert_quadratic
from flinders.apps.survey.simulate_shots import survey_shots, true_angles
from flinders.apps.survey.targets import distox_coefficients, mag_cal_json, of_distox, of_mag_cal
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import ArrayError, DocumentError, FitError, InputError, NotExportable, UnreadableInput, UsageError
from flinders.geometry.angles import wrap_180

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tests.trials import Choose

    from flinders.apps.survey.instrument import Pointing
    from flinders.apps.survey.simulate_shots import SimulatedSurvey

COUNTS = 24000


@cache
def simulated(shots: int = 24, seed: int = 4) -> SimulatedSurvey:
    return survey_shots(seed, shots=shots)


@cache
def fitted() -> SurveyFit:
    return fit_survey(simulated().shots)


def in_counts(shots: Shots) -> Shots:
    """As a DistoX sends them."""
    return replace(shots, magnetic=np.round(COUNTS * shots.magnetic), gravity=np.round(COUNTS * shots.gravity))


def topodroid(shots: Shots, *, grouped: bool = True) -> str:
    """What TopoDroid exports."""
    assert shots.groups is not None
    groups = (shots.groups + 1) * grouped
    rows = np.column_stack([shots.numbers, shots.gravity, shots.magnetic, groups])
    lines = [", ".join(f"{value:.0f}" for value in row) + ", 0.00, 0.00, 0.00, 0.0000, 0" for row in rows]
    return "\n".join(["# 2026.11.27 created by TopoDroid v 6.3.0", "", "# cave", *lines, "# error 0.3", ""])


def test_azimuth_and_inclination_are_within_what_is_claimed() -> None:
    poses = product(range(0, 360, 45), (-30, 20), (0, 100))
    attitudes = attitudes_of(*np.array(list(poses), float).T)
    true, seen = true_angles(attitudes), fitted().calibration.angles(*simulated().read(attitudes))
    assert np.abs(wrap_180(seen.azimuth_deg - true.azimuth_deg)).max() < 4.0 * fitted().azimuth_error_deg.worst
    assert np.abs(seen.inclination_deg - true.inclination_deg).max() < 4.0 * fitted().inclination_error_deg.worst
    assert fitted().verdict == "good"
    assert fitted().dip_deg == pytest.approx(63.0, abs=0.3)


def test_directions_that_nobody_wrote_down_are_found() -> None:
    alone = fit_survey(replace(simulated().shots, groups=None))
    npt.assert_array_equal(alone.shots.groups, simulated().shots.groups)
    npt.assert_allclose(alone.calibration.magnetometer.matrix, fitted().calibration.magnetometer.matrix, atol=1e-9)


@pytest.mark.parametrize("pointing", ["y", "z"])
def test_a_laser_along_another_axis_gives_the_same_angles(pointing: Pointing) -> None:
    to_own = {"y": Axes.of("y,x,-z"), "z": Axes.of("y,z,x")}[pointing]  # of forward, right and down
    shots = simulated().shots
    turned = replace(
        shots, magnetic=to_own.apply(shots.magnetic), gravity=to_own.apply(shots.gravity), pointing=pointing
    )
    for one, other in zip(fit_survey(turned).shots.angles, fitted().shots.angles, strict=True):
        npt.assert_allclose(wrap_180(one - other), 0.0, atol=1e-6)


def test_a_shot_that_contradicts_the_others_is_left_out_and_named() -> None:
    magnetic = simulated().shots.magnetic.copy()
    magnetic[9] += [0.05, -0.04, 0.03]
    fit = fit_survey(replace(simulated().shots, magnetic=magnetic))
    assert np.flatnonzero(fit.shots.excluded).tolist() == [9]
    (finding,) = [finding for finding in fit.findings if finding.code == "shots-contradict"]
    assert finding.severity == "note"
    assert finding.number == pytest.approx(1 / 24)
    assert "shot 10" in finding.advice
    npt.assert_allclose(fit.azimuth_error_deg.rms, fitted().azimuth_error_deg.rms, rtol=0.4)


@pytest.mark.parametrize(("target_deg", "severity"), [(0.1, "limits"), (0.01, "refuses")])
def test_an_error_beyond_the_target_limits_or_refuses(target_deg: float, severity: str) -> None:
    fit = fit_survey(simulated().shots, target_deg=target_deg)
    assert [(finding.code, finding.severity) for finding in fit.findings] == [("pointing-error", severity)]


@pytest.mark.nightly
def test_the_direction_to_shoot_next_lowers_the_error_as_is_said() -> None:
    """The claim of more shots is as was expected before, but for the noise in what is claimed."""
    few, more = fit_survey(simulated(24, seed=7).shots), fit_survey(simulated(56, seed=7).shots)
    errors = [few.azimuth_error_deg.rms, *(each.azimuth_error_deg for each in few.next_directions)]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] > 0.8 * more.azimuth_error_deg.rms


def unrolled(shots: Shots) -> Shots:
    """One shot in each of 12 directions."""
    attitudes = attitudes_of(PROCEDURE[:12, 0], PROCEDURE[:12, 1], np.linspace(0.0, 300.0, 12))
    magnetic, gravity = simulated().read(attitudes)
    return replace(shots[np.arange(24) < 12], magnetic=magnetic, gravity=gravity, groups=None)


REFUSED: Final[dict[str, Callable[[Shots], Shots]]] = {
    "11 shots": lambda shots: shots[np.arange(24) < 11],
    "more readings than shots": lambda shots: Shots(np.tile(shots.magnetic, (21, 1)), np.tile(shots.gravity, (21, 1))),
    "axes that do not fit": lambda shots: replace(shots, gravity=shots.gravity[:, [1, 0, 2]]),
    "unrolled": unrolled,
    "pointing along y": lambda shots: replace(shots, pointing="y"),
    "gravity all alike": lambda shots: replace(shots, gravity=np.ones((24, 3))),
}


@pytest.mark.parametrize("name", REFUSED)
def test_shots_that_show_no_calibration_are_refused(name: str) -> None:
    with assert_raises(FitError):
        fit_survey(REFUSED[name](simulated().shots))


def test_arrays_of_shots_are_checked() -> None:
    with assert_raises(ArrayError):
        Shots(np.ones((3, 3)), np.ones((2, 3)))
    with assert_raises(UsageError):
        Shots(np.ones((3, 3)), np.ones((3, 3)), pointing="w")  # type: ignore[arg-type]


def test_a_calibration_file_gives_the_same_angles_and_serves_as_that_of_the_magnetometer(tmp_path: Path) -> None:
    fitted().save(tmp_path / "calibration.json")
    loaded = SurveyCalibration.load(tmp_path / "calibration.json")
    shots = simulated().shots
    for one, other in zip(loaded.angles(shots.magnetic, shots.gravity), fitted().shots.angles, strict=True):
        npt.assert_array_equal(one, other)
    alone = flinders.load(tmp_path / "calibration.json")
    assert alone.calibration == fitted().calibration.magnetometer
    assert alone.heading_error_deg.rms == fitted().azimuth_error_deg.rms
    alone.calibration.save(tmp_path / "alone.json")
    with assert_raises(DocumentError):
        SurveyCalibration.load(tmp_path / "alone.json")


def test_coefficients_of_a_distox_do_what_its_firmware_calculates() -> None:
    """By the formula of TopoDroid: A g / 24000 + B, with steps of 1/16384 and 1/24000."""
    shots = in_counts(simulated().shots)
    calibration = fit_survey(shots).calibration
    content = distox_coefficients(calibration)
    words = np.frombuffer(content[:48], "<i2").reshape(2, 3, 4)
    for rows, readings, sensor in zip(
        words, (shots.gravity, shots.magnetic), (calibration.accelerometer, calibration.magnetometer), strict=True
    ):
        corrected = readings / 24000.0 @ (rows[:, 1:] / 16384.0).T + rows[:, 0] / 24000.0
        npt.assert_allclose(corrected, sensor.apply(readings) / sensor.field_strength, atol=3e-4)
    assert len(content) == 52
    back = of_distox(content).angles(shots.magnetic, shots.gravity)
    level = np.abs(back.inclination_deg) < 45.0
    there = calibration.angles(shots.magnetic, shots.gravity)
    npt.assert_allclose(wrap_180(back.azimuth_deg - there.azimuth_deg)[level], 0.0, atol=0.03)


QUADRATIC: Final = (0.025, -0.012, 0.018)
"""Of gravity at 1 g, as large as a DistoX can hold and half of it."""


def bent(shots: Shots, quadratic: tuple[float, float, float] = QUADRATIC) -> Shots:
    """As an accelerometer reads gravity that is curved so, axis by axis."""
    return replace(shots, gravity=invert_quadratic(shots.gravity, np.array(quadratic)))


@cache
def unbent() -> SurveyFit:
    return fit_survey(bent(simulated().shots), non_linear=True)


def test_quadratic_terms_of_a_distox_do_what_topodroid_calculates() -> None:
    """h + N (h² − ½) stands for h = g / 24000; N is the signed byte plus one, over 2796."""
    shots = in_counts(bent(simulated().shots))
    calibration = fit_survey(shots, non_linear=True).calibration
    content = distox_coefficients(calibration)
    rows, scaled = np.frombuffer(content[:24], "<i2").reshape(3, 4), shots.gravity / 24000.0
    terms = (np.frombuffer(content[48:51], "i1") + 1.0) / 2796.0
    npt.assert_allclose(terms, QUADRATIC, atol=0.003)
    straight = scaled + terms * (scaled**2 - 0.5)
    down = straight @ (rows[:, 1:] / 16384.0).T + rows[:, 0] / 24000.0
    field = calibration.magnetometer.apply(shots.magnetic)
    there = calibration.angles(shots.magnetic, shots.gravity)
    npt.assert_allclose(pointing_angles(field, down).inclination_deg, there.inclination_deg, atol=0.02)
    back = of_distox(content).angles(shots.magnetic, shots.gravity)
    npt.assert_allclose(back.inclination_deg, there.inclination_deg, atol=0.02)


def test_a_curved_accelerometer_is_calibrated_as_claimed(trials: Choose) -> None:
    claim, squares = trials(200, 4), []
    for seed in range(claim.count):
        quadratic = np.random.default_rng([seed, 9]).uniform(-0.03, 0.03, 3)
        instrument = simulated(24, seed)
        fit = fit_survey(bent(instrument.shots, (*quadratic.tolist(),)), non_linear=True)
        attitudes = attitudes_of(
            *(axis.ravel() for axis in np.meshgrid(AZIMUTHS_DEG, INCLINATIONS_DEG, [0.0, 120.0, 240.0]))
        )
        magnetic, gravity = instrument.read(attitudes)
        seen, true = fit.calibration.angles(magnetic, invert_quadratic(gravity, quadratic)), true_angles(attitudes)
        off = np.stack([seen.azimuth_deg - true.azimuth_deg, seen.inclination_deg - true.inclination_deg])
        claims = [fit.azimuth_error_deg.rms, fit.inclination_error_deg.rms]
        squares.append(np.mean(wrap_180(off) ** 2, axis=1) / np.square(claims))
    npt.assert_allclose(np.sqrt(np.mean(squares, axis=0)), 1.0, atol=min(0.2 * claim.widening, 0.5))


def test_what_is_curved_is_wrong_without_quadratic_terms_and_costs_little_with_them() -> None:
    straight = fit_survey(bent(simulated().shots))
    assert straight.azimuth_error_deg.rms > 2.0 * unbent().azimuth_error_deg.rms
    npt.assert_allclose(unbent().calibration.quadratic, QUADRATIC, atol=0.005)
    assert unbent().azimuth_error_deg.rms < 1.3 * fitted().azimuth_error_deg.rms


def test_quadratic_terms_stay_with_the_axes_of_the_accelerometer_and_in_its_file(tmp_path: Path) -> None:
    to_own = Axes.of("y,x,-z")  # of forward, right and down
    shots = bent(simulated().shots)
    turned = replace(shots, magnetic=to_own.apply(shots.magnetic), gravity=to_own.apply(shots.gravity), pointing="y")
    fit = fit_survey(turned, non_linear=True)
    npt.assert_allclose(
        fit.calibration.quadratic, to_own.apply(np.array([unbent().calibration.quadratic]))[0], rtol=1e-4
    )
    fit.save(tmp_path / "calibration.json")
    loaded = SurveyCalibration.load(tmp_path / "calibration.json")
    assert loaded.quadratic == fit.calibration.quadratic
    for one, other in zip(loaded.angles(turned.magnetic, turned.gravity), unbent().shots.angles, strict=True):
        npt.assert_allclose(wrap_180(one - other), 0.0, atol=1e-4)


def test_numbers_too_large_for_a_distox_are_made_smaller_together() -> None:
    weak = replace(in_counts(simulated().shots), magnetic=np.round(8000 * simulated().shots.magnetic))
    calibration = fit_survey(weak).calibration
    words = np.frombuffer(distox_coefficients(calibration)[:48], "<i2").reshape(2, 3, 4)
    assert np.abs(words[1]).max() == 32767
    both = (calibration, of_distox(distox_coefficients(calibration)))
    there, back = (one.angles(weak.magnetic, weak.gravity) for one in both)
    npt.assert_allclose(back.inclination_deg, there.inclination_deg, atol=0.03)


@pytest.mark.parametrize(
    "content",
    [
        bytes(51),
        bytes(48),
    ],
)
def test_other_bytes_are_no_coefficients(content: bytes) -> None:
    with assert_raises(DocumentError):
        of_distox(content)


def test_what_an_instrument_cannot_hold_is_not_written() -> None:
    identity = SurveyCalibration.identity("y")
    with assert_raises(NotExportable):
        distox_coefficients(identity)
    with assert_raises(NotExportable):
        mag_cal_json(SurveyCalibration.identity(), dip_deg=60.0, noise=0.1, gravity_noise=0.1)
    with assert_raises(NotExportable, beyond=("quadratic",)):
        distox_coefficients(replace(SurveyCalibration.identity(), quadratic=(0.0, 1e-5, 0.0)))
    with assert_raises(NotExportable):
        mag_cal_json(replace(identity, quadratic=(0.0, 1e-5, 0.0)), dip_deg=60.0, noise=0.1, gravity_noise=0.1)
    tesla = replace(SurveyCalibration.identity(), magnetometer=Calibration.identity(raw=Unit.of("uT")))
    with assert_raises(NotExportable):
        distox_coefficients(tesla)


def test_mag_cal_corrects_as_we_do() -> None:
    """By its formula: readings mapped by axes, less the centre, times the transform."""
    axes = Axes.of("x,y,-z")
    calibration = SurveyCalibration(
        replace(fitted().calibration.magnetometer, axes=axes), fitted().calibration.accelerometer, "y"
    )
    text = mag_cal_json(calibration, dip_deg=63.0, noise=0.002, gravity_noise=0.002)
    mag = json.loads(text)["mag"]
    assert mag["axes"] == "+X+Y-Z"
    readings = simulated().shots.magnetic
    sensor = calibration.magnetometer
    corrected = (readings - mag["centre"]) @ np.array(mag["transform"])
    npt.assert_allclose(corrected, sensor.apply(readings) / sensor.field_strength, atol=1e-12)
    back = of_mag_cal(text)
    assert back.magnetometer.axes == axes
    npt.assert_allclose(back.magnetometer.apply(readings), corrected, atol=1e-12)
    assert of_mag_cal(json.dumps({"calib": json.loads(text)})).pointing == "y"


PLAIN_SENSOR: Final = {"axes": "+X+Y+Z", "transform": np.eye(3).tolist(), "centre": [0.0, 0.0, 0.0]}
"""A sensor in JSON of mag-cal that changes nothing."""


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        "[1]",
        json.dumps({key: {**PLAIN_SENSOR, "rbfs": [[0.1], [0.0], [0.0]]} for key in ("mag", "grav")}),
    ],
    ids=["empty", "list", "radial basis functions"],
)
def test_other_json_is_no_calibration_of_mag_cal(content: str) -> None:
    with assert_raises(DocumentError):
        of_mag_cal(content)


def test_shots_of_topodroid_are_read_without_deleted_ones_and_those_of_no_group(tmp_path: Path) -> None:
    shots = in_counts(simulated().shots)
    text = topodroid(shots).replace(", 0\n", ", 1\n", 1)
    lines = text.splitlines()
    lines[4] = ", ".join([*lines[4].split(", ")[:7], "0"])
    (tmp_path / "calib.csv").write_text("\n".join(lines), encoding="utf-8")
    read = flinders.read_shots(tmp_path / "calib.csv")
    assert read.numbers == tuple(range(3, 25))
    npt.assert_array_equal(read.gravity, shots.gravity[2:])
    npt.assert_array_equal(read.magnetic, shots.magnetic[2:])
    (tmp_path / "bare.csv").write_text(topodroid(shots, grouped=False), encoding="utf-8")
    bare = flinders.read_shots(tmp_path / "bare.csv")
    assert (len(bare), bare.groups) == (24, None)


def test_shots_of_mag_cal_are_read_with_the_axes_of_both_sensors(tmp_path: Path) -> None:
    content = {"mag": [[1.0, 2.0, 3.0]], "grav": [[4.0, 5.0, 6.0]]}
    (tmp_path / "sap6.json").write_text(json.dumps(content), encoding="utf-16")
    shots = flinders.read_shots(tmp_path / "sap6.json", axes="x,y,-z", acceleration_axes="-y,-x,z")
    assert (shots.magnetic.tolist(), shots.gravity.tolist(), shots.pointing) == ([[1, 2, -3]], [[-5, -4, 6]], "y")


def test_each_reading_of_a_table_is_a_shot_and_gravity_the_opposite_of_specific_force(tmp_path: Path) -> None:
    rows = "".join(f"{value},0.5,-9.8,30,{value},40\n" for value in range(20, 45))
    (tmp_path / "table.csv").write_text(f"ax,ay,az,mx_uT,my_uT,mz_uT\n{rows}", encoding="utf-8")
    shots = flinders.read_shots(tmp_path / "table.csv")
    assert (shots.gravity[0].tolist(), shots.magnetic[0].tolist()) == ([-20.0, -0.5, 9.8], [30.0, 20.0, 40.0])
    assert (shots.unit, shots.pointing) == (Unit.of("uT"), "x")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", "# created by TopoDroid\n1, 2, 3\n"),
        ("a.csv", "# created by TopoDroid\n1, 2, 3, 4, 5, 6, 7, nan\n"),
        ("a.csv", "# created by TopoDroid\n# nothing\n"),
        ("a.json", '{"mag": [[1, 2]], "grav": [[1, 2, 3]]}'),
        ("a.json", '{"grav": [[1, 2, 3]]}'),
        ("a.json", '{"mag": [], "grav": '),
        ("a.csv", "mx,my,mz\n" + "1,2,3\n" * 20),
    ],
)
def test_what_holds_no_shots_is_refused_with_its_name(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with assert_raises(InputError):
        flinders.read_shots(tmp_path / name)


@pytest.mark.parametrize("content", ["hello world\nno table at all\n", "a,b,c,d\n1,2,3,4\n2,3,4,9\n3,5,6,7\n"])
def test_what_may_be_no_shots_is_refused_without_options_that_shots_do_not_have(tmp_path: Path, content: str) -> None:
    path = tmp_path / "notes.txt"
    path.write_text(content, encoding="utf-8")
    with assert_raises(InputError) as caught:
        flinders.read_shots(path)
    assert not caught.value.hint
    assert flinders_("survey", str(path)).said == f"error: {caught.value}"


def test_a_missing_file_and_standard_input_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableInput):
        flinders.read_shots(tmp_path / "none.csv")
    with assert_raises(UsageError):
        flinders.read_shots("-")


def test_a_calibration_in_each_of_its_formats_is_held_against_shots(tmp_path: Path) -> None:
    """A calibration file and coefficients of a DistoX: the same shots are as far from their means."""
    fit = fit_survey(in_counts(simulated().shots))
    (tmp_path / "distox.bin").write_bytes(distox_coefficients(fit.calibration))
    fit.save(tmp_path / "calibration.json")
    shots = tmp_path / "shots.csv"
    shots.write_text(topodroid(in_counts(simulated().shots)), encoding="utf-8")
    known = survey.check_survey(in_counts(simulated().shots), fit.calibration).rms_deg
    for name in ("distox.bin", "calibration.json"):
        assert survey.check_survey(shots, tmp_path / name).rms_deg == pytest.approx(known, abs=0.02), name
    (tmp_path / "none.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DocumentError, match=r"none\.json"):
        survey.load_survey(tmp_path / "none.json")


def test_the_command_writes_what_it_checks_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shots.csv").write_text(topodroid(in_counts(simulated().shots)), encoding="utf-8")
    ended = flinders_("survey", "shots.csv", "-o", "calibration.json", "--distox", "coefficients.bin", "--json")
    assert (ended.code, ended.json["verdict"], len(ended.json["shots"])) == (0, "good", 24)
    spread = [
        flinders_("survey", "shots.csv", "--previous", name, "--json").json["rms_deg"]
        for name in ("calibration.json", "coefficients.bin")
    ]
    npt.assert_allclose(spread, check_shots(simulated().shots, fitted().calibration).rms_deg, atol=0.01)
    refused = flinders_("survey", "shots.csv", "-o", "other.json", "--target", "0.01")
    assert (refused.code, (tmp_path / "other.json").exists()) == (4, False)
    assert flinders_("survey", "shots.csv", "--mag-cal", "other.json").code == 4
    both = flinders_("survey", "shots.csv", "--previous", "calibration.json", "-o", "other.json", "--target", "1")
    assert_sentences(both.err)
    assert not (tmp_path / "other.json").exists()
