"""The claim as parameters of EKF2 and EKF3, as imu_filter_madgwick's and as FusionCore's."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.apps.vehicles.targets.estimators import EKF2, EKF3, Estimator
from flinders.apps.vehicles.targets.ros import FUSIONCORE, ROBOT_LOCALIZATION
from flinders.core.units import PER_UNIT
from flinders.errors import NotExportable, UsageError
from flinders.fitting.measurement_noise import gates_of, noise_of
from flinders.targets import registry

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.fitting.result import Fit
    from flinders.targets._measurement_noise import MeasurementNoise

RECORDINGS: dict[str, dict[str, Any]] = {
    "good": {"motion": "hand"},
    "limited": {"motion": "tilted", "n": 300, "noise": 1.0},
    "level only": {"motion": "level", "n": 60, "noise": 2.0},
}
PARAMETERS = {"px4": EKF2, "ardupilot": EKF3}


@cache
def fitted(kind: str) -> Fit:
    """A fit of a kind; its field strength is known."""
    samples = simulate.tumble(seed=1, **RECORDINGS[kind]).samples
    return flinders.fit(samples, site=flinders.Site(strength=50.0))


def noise_stated(fit: Fit) -> MeasurementNoise:
    noise = noise_of(fit)
    assert noise is not None
    return noise


def parameters(text: str, target: str) -> dict[str, float]:
    """Names and values of a file, as the autopilot's own tools split it."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    split = [line.split("\t")[2:4] if target == "px4" else line.split(",") for line in lines if line.strip()]
    return {name: float(value) for name, value in split}


def ros_parameters(text: str) -> dict[str, Any]:
    """Names and values below ``ros__parameters``, which are JSON."""
    lines = [line.strip() for line in text.splitlines() if line.startswith("    ")]
    return {name: json.loads(value) for name, _, value in (line.partition(": ") for line in lines)}


@pytest.mark.parametrize("kind", RECORDINGS)
@pytest.mark.parametrize("target", PARAMETERS)
def test_the_estimator_states_the_error_of_its_yaw(target: str, kind: str) -> None:
    """With the value that is read back, unless the range of the parameter ends before."""
    fit, estimator = fitted(kind), PARAMETERS[target]
    noise = noise_stated(fit)
    written = parameters(flinders.export(fit, target, noise=True, lossy=True).text, target)
    sigma = written[estimator.heading_noise.name]
    at_the_end = sigma in estimator.heading_noise[1:]
    errs = math.hypot(noise.heading_calibration_deg, estimator.yaw.error_deg(sigma, noise.heading_reading_deg))
    assert at_the_end or estimator.yaw.stated_deg(sigma) == pytest.approx(errs, rel=0.01)
    field = math.hypot(noise.reading, noise.horizontal * math.radians(noise.heading_calibration_deg)) / PER_UNIT["G"]
    assert written[estimator.field_noise.name] == pytest.approx(max(field, estimator.field_noise.low), rel=0.01)


@pytest.mark.parametrize("estimator", [EKF2, EKF3], ids=lambda one: one.who)
def test_values_keep_to_their_ranges(estimator: Estimator) -> None:
    """Claims from next to nothing to half a turn."""
    for claimed in (1e-3, 0.1, 1.0, 10.0, 170.0):
        assert estimator.heading_noise.low <= estimator.heading_sigma(claimed, 0.5) <= estimator.heading_noise.high


def test_the_file_says_where_a_range_makes_a_number_larger() -> None:
    """Those of a good compass: ArduPilot takes no less than 0.05 rad and 0.01 G."""
    text = " ".join(flinders.export(fitted("good"), "ardupilot", noise=True).text.replace("#", "").split())
    for name, least in (("EK3_YAW_M_NSE", "0.050"), ("EK3_MAG_M_NSE", "0.010")):
        assert_sentences(text, about=f"{name} is written as {least}")


@pytest.mark.parametrize(
    ("estimator", "heading", "field"), [(EKF2, 1.05, 110.0), (EKF3, 1.2, 55.0)], ids=["EKF2", "EKF3"]
)
def test_the_notes_say_where_a_range_makes_a_number_smaller(estimator: Estimator, heading: float, field: float) -> None:
    """With the number that would be right."""
    noise = replace(noise_stated(fitted("good")), reading=field, heading_reading_deg=math.degrees(heading))
    noise = replace(noise, heading_calibration_deg=1e-4)
    assert estimator.values(noise) == {name: high for name, _, high in (estimator.heading_noise, estimator.field_noise)}
    notes = estimator.notes(noise, estimator.heading_noise.high)
    assert_sentences([each for each in notes if "its maximum" in each])


@pytest.mark.parametrize("target", PARAMETERS)
def test_noise_is_written_where_it_is_asked_for(target: str) -> None:
    """A calibration alone does not change how an estimator is tuned."""
    names = parameters(flinders.export(fitted("good"), target).text, target)
    assert not any(name.startswith(("EKF2", "EK3")) for name in names)


@pytest.mark.parametrize("target", PARAMETERS)
def test_the_compass_is_read_back_beside_it(target: str, tmp_path: Path) -> None:
    """The noise is no part of a calibration."""
    fit = fitted("good")
    flinders.export(fit, target, noise=True).save(tmp_path / "with.param")
    flinders.export(fit, target).save(tmp_path / "without.param")
    with_noise, without = (
        flinders_("import", str(tmp_path / name), "--field-strength", "50", "-o", "-")
        for name in ("with.param", "without.param")
    )
    assert with_noise.code == without.code == 0, with_noise.err
    assert json.loads(with_noise.out)["calibration"] == json.loads(without.out)["calibration"]


def test_limits_of_the_field_are_those_of_a_clean_reading() -> None:
    """EKF2_MAG_CHECK has the bits of the limits that are known: strength here, and the dip beside an accelerometer."""
    fit = fitted("good")
    gates = gates_of(fit)
    assert gates is not None
    written = parameters(flinders.export(fit, "px4", noise=True).text, "px4")
    assert written["EKF2_MAG_CHECK"] == 1
    assert gates.strength_limit / 100.0 <= written["EKF2_MAG_CHK_STR"] <= gates.strength_limit / 100.0 + 0.02
    body = flinders.fit(simulate.tumble(seed=2).samples, aiding=["dip"], site=flinders.Site(strength=50.0))
    aided = parameters(flinders.export(body, "px4", noise=True, lossy=True).text, "px4")
    assert aided["EKF2_MAG_CHECK"] == 3
    assert 0.0 < aided["EKF2_MAG_CHK_INC"] <= 90.0


def test_without_a_known_strength_no_limit_is_written() -> None:
    """Corrected readings are then of a length of their own, and a limit in gauss would be wrong."""
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    assert not any("CHK" in name for name in parameters(flinders.export(fit, "px4", noise=True).text, "px4"))


def test_a_calibration_without_a_claim_is_refused() -> None:
    """There is no noise to be written for one."""
    with pytest.raises(NotExportable):
        flinders.export(
            flinders.Calibration.identity(field_strength=50.0, raw=flinders.Unit.of("uT")), "px4", noise=True
        )


def test_a_target_without_an_estimator_is_refused(tmp_path: Path) -> None:
    """In Python and by the program, which names those that have one."""
    with pytest.raises(UsageError):
        flinders.export(fitted("good"), "c-q15", noise=True)
    fitted("good").save(tmp_path / "calibration.json")
    ended = flinders_("export", "--for", "c-q15", "--noise", str(tmp_path / "calibration.json"))
    assert ended.code == 2
    assert "px4-shell" in ended.err


def test_targets_that_always_write_the_noise_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their text depends on the claim without an option, and they refuse the option with other words."""
    fit, always = fitted("good"), {name for name, each in registry().items() if each.writes_noise}
    counted = flinders.fit(simulate.tumble(seed=1).samples.field * 10.0)

    def texts() -> dict[str, str]:
        of_counts = flinders.export(counted, "betaflight-model", mounting="0").text
        plain = sorted((always - {"betaflight-model"}) | {"c-q15", "vectornav", "esphome"})
        return {"betaflight-model": of_counts} | {name: flinders.export(fit, name, lossy=True).text for name in plain}

    stated = texts()
    monkeypatch.setattr("flinders.fitting.export.noise_of", lambda _: None)
    unstated = texts()
    assert {name for name in stated if stated[name] != unstated[name]} == always
    fit.save(tmp_path / "calibration.json")
    for name in ("fusioncore", "ros-pipeline"):
        ended = flinders_("export", "--for", name, "--noise", str(tmp_path / "calibration.json"))
        assert ended.code == 2
        assert_sentences(ended.err)


@pytest.mark.parametrize("kind", RECORDINGS)
def test_fusioncore_corrects_and_states_its_error(kind: str) -> None:
    """``soft_iron (m − hard_iron)`` and the noise, of the YAML that ROS 2 reads."""
    fit = fitted(kind)
    given = ros_parameters(flinders.export(fit, "fusioncore").text)
    matrix = np.array(given["magnetometer.soft_iron"]).reshape(3, 3)
    raw = np.array([[20.0, -30.0, 40.0], [1.0, 2.0, -3.0]])
    corrected = (raw * 1e-6 - np.array(given["magnetometer.hard_iron"])) @ matrix.T
    assert np.allclose(corrected * 1e6, fit.calibration.apply(raw), atol=1e-4)
    noise, sigma = noise_stated(fit), given["magnetometer.noise_rad"]
    errs = math.hypot(noise.heading_calibration_deg, FUSIONCORE.error_deg(sigma, noise.heading_reading_deg))
    assert FUSIONCORE.stated_deg(sigma) == pytest.approx(errs, rel=0.01)
    gates = gates_of(fit)
    assert ("magnetometer.field_tolerance" in given) == (gates is not None)
    if gates is not None:
        limit = given["magnetometer.field_tolerance"] * given["magnetometer.field_strength"]
        assert limit * 1e6 == pytest.approx(gates.strength_limit, rel=1e-6)


def test_robot_localization_states_the_error_of_what_madgwick_holds() -> None:
    """What an offset alone leaves out is in the noise of its orientation."""
    fit = fitted("good")
    exported = flinders.export(fit, "ros-madgwick", lossy=True).export
    sigma = ros_parameters(exported.text)["orientation_stddev"]
    errs = exported.fields["noise"]["heading_calibration_deg"]
    assert errs > 10.0 * fit.heading_error_deg.rms
    assert ROBOT_LOCALIZATION.stated_deg(sigma) == pytest.approx(errs, rel=0.01)
