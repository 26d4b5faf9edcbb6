"""Accelerometers and gyros in the form of each target: what is written is read by an independent hand, and used."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.targets.test_generated_code import C99, CPP, MAIN, built

import flinders
from flinders import simulate
from flinders.core.inertial import Inertial, TiltError, Triad
from flinders.errors import NotExportable, UsageError
from flinders.fitting.inertial_export import inertial_of
from flinders.targets import find, registry
from flinders.workflows.exporting import export

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

SQUARE: Final = np.diag([0.99, 1.015, 1.002])
SKEWED: Final = SQUARE + 0.01 * np.array([[0, 1, -1], [1, 0, 0.5], [-1, 0.5, 0]])
OFFSET: Final = np.array([0.21, -0.13, 0.3])
GYRO: Final = Triad(np.eye(3), np.array([0.011, -0.02, 0.004]), "rad/s")
READ: Final = np.random.default_rng(1).normal(scale=6.0, size=(50, 3))
HOLDING: Final = [name for name, row in registry().items() if row.inertial is not None and row.inertial.is_alone]


def sensors(matrix: Floats = SQUARE, unit: str = "m/s2") -> Inertial:
    triad = Triad(matrix, OFFSET, "m/s2")
    accelerometer = triad if unit == "m/s2" else triad.scale_readings(4096 / 9.80665, "counts")
    return Inertial(accelerometer, GYRO, TiltError(0.1, 0.12, 0.25))


@pytest.mark.parametrize("compiler", [C99, CPP], ids=["c99", "c++"])
def test_the_header(compiler: tuple[str, ...], tmp_path: Path) -> None:
    text = export(sensors(SKEWED), "c").text
    source = text + MAIN.format(number="float", call="flinders_correct_acceleration(v, v)")
    source = source.replace("int main", "static void unused(float *v) { flinders_correct_rate(v, v); }\nint main")
    source = source.replace("double x, y, z;", "double x, y, z; float t[3] = {0.0f, 0.0f, 0.0f}; unused(t);")
    npt.assert_allclose(built(tmp_path, source, compiler, READ), Triad(SKEWED, OFFSET, "m/s2").apply(READ), atol=1e-5)


def test_the_sketch_and_the_module(tmp_path: Path) -> None:
    wanted = Triad(SKEWED, OFFSET, "m/s2").apply(READ)
    text = export(sensors(SKEWED), "arduino", name="mast").text
    source = text + MAIN.format(number="float", call="mast_correctAcceleration(v[0], v[1], v[2])")
    npt.assert_allclose(built(tmp_path, source, CPP, READ), wanted, atol=1e-5)
    module: dict[str, Any] = {}
    exec(export(sensors(SKEWED), "micropython").text, module)
    npt.assert_allclose([module["correct_acceleration"](row) for row in READ.tolist()], wanted, atol=1e-5)
    npt.assert_allclose(module["correct_rate"]((0.011, -0.02, 0.004)), 0.0, atol=1e-9)


def test_fusion_gives_g_and_degrees_a_second() -> None:
    module: dict[str, Any] = {"np": np}
    exec(export(sensors(SKEWED), "fusion-python").text, module)
    for name, triad, out in (
        ("accelerometer", Triad(SKEWED, OFFSET, "m/s2"), 9.80665),
        ("gyroscope", GYRO, np.deg2rad(1.0)),
    ):
        misalignment, sensitivity, offset = (
            module[f"{name}_{part}"] for part in ("misalignment", "sensitivity", "offset")
        )
        npt.assert_allclose(((READ - offset) * sensitivity) @ misalignment.T, triad.apply(READ) / out, rtol=1e-5)
        npt.assert_allclose(np.diag(misalignment), 1.0)


@pytest.mark.parametrize("name", HOLDING)
def test_each_target_runs_its_own_formula_and_states_the_tilt(name: str) -> None:
    unit = "counts" if find(name).inertial.unit == "counts" else "m/s2"  # type: ignore[union-attr]
    made = export(sensors(0.999 * np.eye(3), unit), name).export
    assert made.fields["checked"]["tilt_deg"] < 0.05
    assert made.fields["checked"]["length_share"] < 0.002
    assert any("0.10°" in warning for warning in made.warnings)


@pytest.fixture(scope="module")
def aided() -> Fit:
    made = simulate.tumble(seed=1, motion="hand", n=1500)
    assert made.samples.acceleration is not None
    felt = made.samples.acceleration @ np.diag([1.03, 1.0, 1.0]) + np.array([0.2, 0.0, 0.0])
    return flinders.fit(replace(made.samples, acceleration=felt), aiding="dip")


def test_beside_a_magnetometer_nothing_of_its_export_changes(aided: Fit) -> None:
    for name in ("arduino", "yaml", "fusion"):
        plain, both = export(aided, name).text, export(aided, name, sensors=["accelerometer"]).text
        assert both.startswith(plain)
        assert len(both) > len(plain)
    plain, both = (
        json.loads(export(aided, "sensorlab", sensors=each, lossy=True).text) for each in ([], ["accelerometer"])
    )
    assert {key for key in plain if plain[key] != both[key]} == {"accel_zerog"}
    npt.assert_allclose(both["accel_zerog"], [0.2, 0.0, 0.0], atol=0.01)


def test_axes_that_were_mapped_are_those_of_the_recording() -> None:
    made = simulate.tumble(seed=1, motion="hand", n=1500).samples
    assert made.acceleration is not None
    recorded = made.acceleration + np.array([0.2, 0.0, -0.1])
    samples = flinders.Samples.of(made.field, unit="uT", axes="y,x,-z", time=made.time, acceleration=recorded)
    fit = flinders.fit(samples, aiding="dip")
    found = inertial_of(fit, find("fusion"), ["accelerometer"]).accelerometer
    across = inertial_of(fit, find("json"), ["accelerometer"]).accelerometer
    assert found is not None
    assert across is not None
    npt.assert_allclose(found.offset, [0.2, 0.0, -0.1], atol=0.015)
    npt.assert_allclose(across.apply(recorded[:5]), fit.calibration.axes.apply(found.apply(recorded[:5])))


def test_what_a_target_cannot_hold_is_refused(aided: Fit) -> None:
    with pytest.raises(NotExportable) as caught:
        export(aided, "sensorlab", sensors=["accelerometer"])
    tilt = caught.value.evidence["tilt_deg"]
    assert isinstance(tilt, float)
    assert tilt > 0.5
    assert json.loads(export(aided, "sensorlab", sensors=["accelerometer"], lossy=True).text)["accel_zerog"]
    with pytest.raises(UsageError):
        export(sensors(), "sensorlab")
    with pytest.raises(UsageError):
        export(sensors(), "rtimulib")
    with pytest.raises(UsageError):
        export(sensors(), "c", mounting="none")
    with pytest.raises(UsageError):
        export(aided, "c", sensors=["gyro"])
    with pytest.raises(UsageError):
        export(aided, "c", sensors=["thermometer"])
