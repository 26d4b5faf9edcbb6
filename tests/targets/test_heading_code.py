"""Generated code gives headings whose standard deviations are those that the fit claims, at any attitude."""

from __future__ import annotations

import math
import subprocess
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.targets.test_generated_code import C99, CPP, built, micropython

from flinders import fit, simulate
from flinders.core.calibration import Calibration
from flinders.estimators.ellipse import Ellipse
from flinders.fitting.export import export_fit
from flinders.fitting.fit_file import load
from flinders.fitting.measurement_noise import noise_of
from flinders.geometry.ellipsoid import parameter_derivatives
from flinders.geometry.plane import down_direction
from flinders.geometry.rotation import rotations
from flinders.heading.attitude import level_heading_deg, magnetic_heading_deg
from flinders.heading.error_propagation import level_fields
from flinders.targets import find

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

KINDS: Final = ("good", "limited", "level", "aided", "mapped", "z-up")
MAIN: Final = """
#include <stdio.h>
int main(void) {{
    double r[6];
    while (scanf("%lf %lf %lf %lf %lf %lf", r, r + 1, r + 2, r + 3, r + 4, r + 5) == 6) {{
        float v[6], sigma, heading;
        int i;
        for (i = 0; i < 6; i++) v[i] = (float)r[i];
        heading = {call};
        printf("%.9g %.9g\\n", (double)heading, (double)sigma);
    }}
    return 0;
}}
"""
CALLS: Final = {
    ("c", "any"): "mast_heading(v, v + 3, &sigma)",
    ("c", "level"): "mast_level_heading(v, &sigma)",
    ("arduino", "any"): "mast_magneticHeading(v[0], v[1], v[2], v[3], v[4], v[5], sigma)",
    ("arduino", "level"): "mast_levelHeading(v[0], v[1], v[2], sigma)",
}


@cache
def found(kind: str) -> Fit:
    """Fits that differ in what they know."""
    good = simulate.tumble(seed=1).samples
    leaning = {"motion": "tilted", "n": 290}
    make: dict[str, Callable[[], Fit]] = {
        "good": lambda: fit(good),
        "limited": lambda: fit(simulate.tumble(seed=2, **leaning).samples),  # type: ignore[arg-type]
        "level": lambda: fit(simulate.tumble(seed=1, motion="level").samples),
        "aided": lambda: fit(good, aiding=("dip",)),
        "mapped": lambda: fit(good.field, unit="uT", axes="y,-x,z"),
        "z-up": lambda: fit(simulate.tumble(seed=2, **leaning).samples.field, unit="uT", axes="x,-y,-z"),  # type: ignore[arg-type]
    }
    return make[kind]()


def readings_of(fitted: Fit, across: Floats, up: Floats) -> Floats:
    """(N, 6) corrected fields in the north, with (N, 3) magnetic north `across`, and an accelerometer's readings."""
    dip = math.radians(60.0)
    field = fitted.calibration.field_strength * (math.cos(dip) * across - math.sin(dip) * up)
    return np.hstack([field, 9.81 * up]).astype(np.float32).astype(float)


def attitudes(fitted: Fit, count: int = 300) -> Floats:
    """(N, 6) readings at attitudes all over."""
    rng = np.random.default_rng(5)
    up = simulate.uniform_directions(rng, count)
    across = np.cross(up, simulate.uniform_directions(rng, count))
    return readings_of(fitted, across / np.linalg.norm(across, axis=1, keepdims=True), up)


def tilts(fitted: Fit, tilt_deg: float) -> Floats:
    """(1728, 6) readings of a vehicle tilted in 24 directions, at 72 headings of each."""
    down = math.copysign(1.0, fitted.claim.known_dip_deg)
    heading = np.radians(np.arange(0.0, 360.0, 5.0))
    north = np.stack([np.cos(heading), -down * np.sin(heading), np.zeros(72)], axis=1)
    rows = []
    for azimuth in np.radians(np.arange(0.0, 360.0, 15.0)):
        turn = rotations(math.radians(tilt_deg) * np.array([[math.cos(azimuth), math.sin(azimuth), 0.0]]))[0]
        rows.append(readings_of(fitted, north @ turn, np.tile([0.0, 0.0, -down], (72, 1)) @ turn))
    return np.vstack(rows)


def claimed_deg(fitted: Fit, readings: Floats) -> Floats:
    """(N,) standard deviations by the covariance of the claim in the magnetometer's own axes, in double precision."""
    claim, calibration = fitted.claim, fitted.calibration
    turn, shape, strength = calibration.rotation_matrix, calibration.ellipsoid.shape, calibration.field_strength
    field, down = readings[:, :3], -readings[:, 3:]
    east = np.cross(down / np.linalg.norm(down, axis=1, keepdims=True), field)
    across = strength * east / np.sum(east**2, axis=1, keepdims=True)
    level_across, directions = level_fields(claim.known_dip_deg, down_direction(claim.plane))
    common = parameter_derivatives(np.linalg.solve(shape, turn.T @ level_across), turn.T @ directions).mean(axis=0)
    vectors = np.linalg.solve(shape, turn.T @ across.T)
    rows = (
        parameter_derivatives(vectors, turn.T @ field.T / strength) - math.copysign(1.0, claim.known_dip_deg) * common
    )
    variance = np.einsum("ni,ij,nj->n", rows, claim.claimed_covariance, rows)
    variance += fitted.evidence.noise**2 * np.sum(vectors**2, axis=0)
    sigma: Floats = np.hypot(np.rad2deg(np.sqrt(variance)), claim.alignment_error_deg or 0.0)
    return sigma


def ran(name: str, fitted: Fit, readings: Floats, folder: Path, attitude: str = "any") -> Floats:
    """(N, 2) headings and standard deviations of compiled or interpreted code."""
    code = export_fit(fitted, find(name), name=None if name == "micropython" else "mast")[0].text
    if name == "micropython":
        module: dict[str, Any] = {}
        exec(code, module)
        if attitude == "level":
            return np.array([module["level_heading"](row[:3]) for row in readings.tolist()])
        return np.array([module["heading"](row[:3], row[3:]) for row in readings.tolist()])
    head = "#include <math.h>\n" if name == "arduino" else ""
    main = MAIN.format(call=CALLS[name, attitude])
    return built(folder, head + code + main, CPP if name == "arduino" else C99, readings)


def turned_deg(one: Floats, two: Floats) -> Floats:
    return (one - two + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["c", "arduino", "micropython"])
def test_headings_and_their_errors_at_any_attitude(name: str, kind: str, tmp_path: Path) -> None:
    """Compiled in single precision, 300 attitudes: within 1e-5 of the claim."""
    fitted = found(kind)
    readings = attitudes(fitted)
    out = ran(name, fitted, readings, tmp_path)
    npt.assert_allclose(turned_deg(out[:, 0], magnetic_heading_deg(readings[:, :3], readings[:, 3:])), 0.0, atol=1e-4)
    npt.assert_allclose(out[:, 1], claimed_deg(fitted, readings), rtol=1e-5)


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0])
@pytest.mark.parametrize("kind", ["good", "limited", "level", "z-up"])
def test_errors_of_a_turn_are_those_of_the_claim(kind: str, tilt_deg: float, tmp_path: Path) -> None:
    """Without noise they have the mean square and the maximum that the engine claims of a tilted vehicle."""
    fitted = found(kind)
    noise = noise_of(fitted)
    assert noise is not None
    quiet = replace(fitted, evidence=replace(fitted.evidence, noise=1e-9))
    sigma = ran("c", quiet, tilts(fitted, tilt_deg), tmp_path)[:, 1]
    claimed = fitted.claim.tilted_error(tilt_deg) if tilt_deg else fitted.claim.level_error()
    assert math.sqrt(np.mean(sigma**2)) == pytest.approx(claimed.rms, rel=1e-5 if kind != "level" else 1e-4)
    assert sigma.max() == pytest.approx(claimed.worst, rel=1e-5 if kind != "level" else 1e-4)
    if not tilt_deg:
        assert math.sqrt(np.mean(sigma**2)) == pytest.approx(noise.heading_calibration_deg, rel=1e-4)


@pytest.mark.parametrize("name", ["c", "arduino", "micropython"])
def test_level_headings_need_no_accelerometer(name: str, tmp_path: Path) -> None:
    """Also of readings with noise along z, which a level turn knows least of."""
    fitted = found("level")
    readings = tilts(fitted, 0.0)[:72]
    noisy = readings + np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    out = ran(name, fitted, noisy, tmp_path, "level")
    npt.assert_allclose(turned_deg(out[:, 0], level_heading_deg(readings[:, :3])), 0.0, atol=1e-4)
    npt.assert_allclose(out[:, 1], claimed_deg(fitted, readings), rtol=1e-5)


def test_level_headings_of_another_plane_begin_at_its_first_axis(tmp_path: Path) -> None:
    fitted = found("level")
    order = [2, 0, 1]  # x, y, z of the turn become y, z, x
    lying = fit(simulate.tumble(seed=1, motion="level").samples.field[:, order], unit="uT", method=Ellipse(plane="yz"))
    assert lying.claim.plane == "yz"
    readings = tilts(fitted, 0.0)[:72]
    out = ran("c", lying, readings[:, [2, 0, 1, 5, 3, 4]], tmp_path, "level")
    npt.assert_allclose(turned_deg(out[:, 0], level_heading_deg(readings[:, :3])), 0.0, atol=1e-4)
    assert math.sqrt(np.mean(out[:, 1] ** 2)) == pytest.approx(noise_deg(lying), rel=1e-3)


def noise_deg(fitted: Fit) -> float:
    """Both parts, over a level turn."""
    noise = noise_of(fitted)
    assert noise is not None
    return noise.heading_deg


@pytest.mark.parametrize("name", ["c", "arduino", "micropython"])
def test_a_vertical_field_has_no_heading(name: str, tmp_path: Path) -> None:
    """Within a degree; nor has one of which a number is missing, or without gravity."""
    strength, slanted = 49.4, np.radians([0.5, 1.5])
    fields = [[strength * math.sin(angle), 0.0, strength * math.cos(angle), 0.0, 0.0, -1.0] for angle in slanted]
    readings = np.array([*fields, [20.0, 0.0, 40.0, 0.0, 0.0, 0.0], [math.nan, 0.0, 40.0, 0.0, 0.0, -1.0]])
    npt.assert_array_equal(
        np.isnan(ran(name, found("good"), readings, tmp_path)).all(axis=1), [True, False, True, True]
    )


def test_a_larger_covariance_is_a_larger_error(tmp_path: Path) -> None:
    fitted = found("limited")
    quiet = replace(fitted, evidence=replace(fitted.evidence, noise=1e-9))
    doubled = replace(quiet, claim=replace(quiet.claim, covariance=4.0 * quiet.claim.covariance))
    readings = attitudes(fitted)
    one, two = (ran("c", each, readings, tmp_path)[:, 1] for each in (quiet, doubled))
    npt.assert_allclose(two, 2.0 * one, rtol=1e-5)
    loud = replace(quiet, evidence=replace(quiet.evidence, noise=2.0 * fitted.evidence.noise))
    assert ran("c", loud, readings, tmp_path)[:, 1].min() > 1.0


def test_the_constants_are_those_of_the_fit() -> None:
    values = export_fit(found("good"), find("c"))[0].fields["values"]
    noise = noise_of(found("good"))
    assert noise is not None
    assert values["heading_sigma_reading_deg"] == noise.heading_reading_deg
    assert values["heading_sigma_calibration_deg"] == noise.heading_calibration_deg
    module: dict[str, Any] = {}
    exec(export_fit(found("good"), find("micropython"))[0].text, module)
    assert module["FIELD_SIGMA_READING"] == pytest.approx(noise.reading, rel=1e-6)
    assert module["FIELD_SIGMA_CALIBRATION"] == pytest.approx(noise.calibration, rel=1e-6)
    assert "level_heading" not in module


@pytest.mark.parametrize("kind", ["limited", "level", "aided"])
def test_the_headings_of_a_file_are_those_of_its_fit(kind: str, tmp_path: Path) -> None:
    fitted = found(kind)
    fitted.save(tmp_path / "calibration.json")
    readings = attitudes(fitted)
    out = ran("micropython", load(tmp_path / "calibration.json"), readings, tmp_path)
    npt.assert_allclose(out[:, 1], ran("micropython", fitted, readings, tmp_path)[:, 1], rtol=1e-4)


@pytest.mark.parametrize("name", ["c", "arduino", "micropython"])
def test_a_calibration_without_uncertainty_has_no_heading_code(name: str) -> None:
    known = Calibration(np.eye(3), np.zeros(3), 50.0, raw=found("good").calibration.raw)
    assert "atan2" not in find(name).render(known).text


@pytest.mark.parametrize("name", ["c-q15", "c-q31"])
def test_code_in_whole_numbers_has_no_headings(name: str) -> None:
    assert "atan2" not in export_fit(found("good"), find(name), lossy=True)[0].text


def errors_deg(tumble: simulate.Simulated, fitted: Fit, readings: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """(N,) errors of the headings of a sensor in fields of `readings`, and their standard deviations by the code."""
    module: dict[str, Any] = {}
    exec(export_fit(fitted, find("micropython"))[0].text, module)
    true = readings[:, :3] * tumble.field_strength / fitted.calibration.field_strength
    raw = (true @ tumble.sensor.matrix.T + tumble.sensor.offset + noise).tolist()
    acceleration = readings[:, 3:].tolist()
    pairs = [module["heading"](module["correct"](field), up) for field, up in zip(raw, acceleration, strict=True)]
    heading, sigma = np.array(pairs).T
    return turned_deg(heading, magnetic_heading_deg(readings[:, :3], readings[:, 3:])), sigma


def test_headings_are_as_far_off_as_their_errors_say() -> None:
    """Of 30 calibrations of 250 leaning readings each, whose claim is wide: 40 new readings of the same sensor."""
    ratios = []
    for seed in range(30):
        tumble = simulate.tumble(seed=seed, motion="tilted", n=250)
        fitted, rng = fit(tumble.samples), np.random.default_rng(1000 + seed)
        mounting = errors_deg(tumble, fitted, tilts(fitted, 0.0)[:72], np.zeros(3))[0].mean()
        error, sigma = errors_deg(tumble, fitted, attitudes(fitted, 40), tumble.sensor.noise * rng.normal(size=(40, 3)))
        ratios.append((error - mounting) / sigma)
    assert 0.7 < math.sqrt(np.mean(np.square(ratios))) < 1.1


@pytest.mark.tools
def test_headings_under_micropython(tmp_path: Path) -> None:
    """MicroPython itself where it is installed, else its build for node."""
    fitted = found("good")
    readings = attitudes(fitted, 50)
    calls = [f"print(*heading({tuple(row[:3])}, {tuple(row[3:])}))" for row in readings.tolist()]
    module = tmp_path / "module.py"
    code = export_fit(fitted, find("micropython"))[0].text
    module.write_text("\n".join(["import sys", code, *calls]), encoding="ascii")
    out = subprocess.run([*micropython(tmp_path), str(module)], capture_output=True, text=True, check=True).stdout
    sigma = np.array([float(line.split()[1]) for line in out.splitlines()])
    npt.assert_allclose(sigma, claimed_deg(fitted, readings), rtol=1e-5)
