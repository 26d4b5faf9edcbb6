"""Generated code, compiled as strictly as can be and run, gives the calibration."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np
import numpy.testing as npt
import pytest
from tests.npm import package
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly

from flinders import fit, simulate
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.linearization import Linearization
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.fitting.export import export_fit
from flinders.fitting.fit_file import load
from flinders.fitting.measurement_noise import gates_of
from flinders.report.html import python_of
from flinders.targets import ExportOptions, find
from flinders.targets._target import Gates
from flinders.targets.code import Q15, Q31, FixedPoint, FixedPointFormat, signed_squares

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.arrays import Floats

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-O1")
C99 = ("gcc", "-std=c99", *STRICT, "-Wconversion")
CPP = ("g++", "-std=c++11", "-x", "c++", *STRICT)

FUSION = """
typedef union { float array[3]; struct { float x, y, z; } axis; } FusionVector;
typedef union { float array[3][3]; struct { float xx, xy, xz, yx, yy, yz, zx, zy, zz; } element; } FusionMatrix;
"""
FUSION_USE = """
static void correct(const float r[3], float c[3]) {
    int i;
    for (i = 0; i < 3; i++) {
        const float *row = softIronMatrix.array[i];
        c[i] = row[0] * (r[0] NEW hardIronOffset.array[0]) + row[1] * (r[1] NEW hardIronOffset.array[1])
             + row[2] * (r[2] NEW hardIronOffset.array[2]) OLD hardIronOffset.array[i];
    }
}
"""
ZSL_USE = """
static void correct(const float r[3], float c[3]) {
    int i;
    for (i = 0; i < 3; i++) {
        c[i] = magn_K[3 * i] * (r[0] + magn_b[0]) + magn_K[3 * i + 1] * (r[1] + magn_b[1])
             + magn_K[3 * i + 2] * (r[2] + magn_b[2]);
    }
}
"""
MAIN = """
#include <stdio.h>
int main(void) {{
    double x, y, z;
    while (scanf("%lf %lf %lf", &x, &y, &z) == 3) {{
        {number} v[3];
        v[0] = ({number})x; v[1] = ({number})y; v[2] = ({number})z;
        {call};
        printf("%.9g %.9g %.9g\\n", (double)v[0], (double)v[1], (double)v[2]);
    }}
    return 0;
}}
"""


def given(unit: str = "mG", axes: str = "y,x,-z") -> Calibration:
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    raw = Unit.of("counts", 0.15) if unit == "counts" else Unit.of(unit)
    return Calibration(matrix, np.array([-69.8, 68.9, -5.6]), 49.4, True, raw=raw, axes=Axes.of(axes))


def as_recorded(calibration: Calibration) -> Floats:
    """(1000, 3) readings in the recorded unit and axes, whole numbers."""
    field = calibration.field_strength * simulate.uniform_directions(np.random.default_rng(3), 1000)
    back = calibration.axes.apply(np.eye(3))
    recorded: Floats = np.rint(calibration.unapply(field) @ back.T / calibration.raw.scale)
    return recorded


def expected(calibration: Calibration, recorded: Floats) -> Floats:
    """µT, in the calibration's axes."""
    return calibration.apply(calibration.axes.apply(recorded * calibration.raw.scale))


def built(folder: Path, source: str, compiler: tuple[str, ...], readings: Floats) -> Floats:
    """Compile, feed the readings, and take what comes out."""
    if shutil.which(compiler[0]) is None:
        message = f"no {compiler[0]}: install it to compile and run the generated code"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    (folder / "code.c").write_text(source, encoding="ascii")
    command = [*compiler, str(folder / "code.c"), "-o", str(folder / "code"), "-lm"]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stderr
    lines = "\n".join(" ".join(f"{value:.17g}" for value in row) for row in readings)
    ran = subprocess.run([str(folder / "code")], input=lines, capture_output=True, text=True, check=True)
    return np.array([[float(word) for word in line.split()] for line in ran.stdout.splitlines()])


def text(name: str, calibration: Calibration, called: str | None = None) -> str:
    return find(name).render(calibration, about=["from a */ test"], asked=ExportOptions(name=called)).text


@pytest.mark.parametrize("compiler", [C99, CPP], ids=["c99", "c++"])
@pytest.mark.parametrize("unit", ["mG", "counts"])
def test_the_header_in_single_precision(unit: str, compiler: tuple[str, ...], tmp_path: Path) -> None:
    """Within 10⁻⁶ of the numbers that go into it: single precision, 1,000 readings."""
    calibration = given(unit)
    recorded = as_recorded(calibration)
    main = MAIN.format(number="float", call="flinders_correct(v, v)")
    out = built(tmp_path, text("c", calibration) + main, compiler, recorded)
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)


CURVE = Linearization(np.array([4e-4, -2e-4, 0.0]), np.array([1e-5, 0.0, -2e-5]), np.array([60.0, 50.0, 70.0]))


@pytest.mark.parametrize("axes", ["x,y,z", "y,x,-z"])
@pytest.mark.parametrize("unit", ["mG", "counts"])
def test_the_header_of_linearized_axes(unit: str, axes: str, tmp_path: Path) -> None:
    calibration = replace(given(unit, axes), linearization=CURVE)
    recorded = as_recorded(calibration)
    main = MAIN.format(number="float", call="flinders_correct(v, v)")
    out = built(tmp_path, text("c", calibration) + main, C99, recorded)
    npt.assert_allclose(out, expected(calibration, recorded), atol=2e-4)


def test_the_sketch_of_linearized_axes(tmp_path: Path) -> None:
    calibration = replace(given(), linearization=CURVE)
    recorded = as_recorded(calibration)
    main = MAIN.format(number="float", call="mast_correctMagnetometer(v[0], v[1], v[2])")
    out = built(tmp_path, text("arduino", calibration, "mast") + main, CPP, recorded)
    npt.assert_allclose(out, expected(calibration, recorded), atol=2e-4)


def test_python_of_linearized_axes() -> None:
    """The module for boards, and the lines with NumPy of the report."""
    calibration = replace(given(), linearization=CURVE)
    recorded = as_recorded(calibration)
    board: dict[str, Any] = {}
    exec(text("micropython", calibration), board)
    wanted = expected(calibration, recorded)
    npt.assert_allclose([board["correct"](row) for row in recorded[:100].tolist()], wanted[:100], atol=2e-4)
    lines: dict[str, Any] = {"raw": recorded}
    exec(python_of(calibration), lines)
    npt.assert_allclose(lines["corrected"], wanted, rtol=1e-9)


@pytest.mark.parametrize("compiler", [C99, CPP], ids=["c99", "c++"])
@pytest.mark.parametrize(("name", "number", "form"), [("c-q15", "int16_t", Q15), ("c-q31", "int32_t", Q31)])
def test_fixed_point_is_what_it_was_checked_as_to_the_bit(
    name: str, number: str, form: FixedPointFormat, compiler: tuple[str, ...], tmp_path: Path
) -> None:
    """Also where readings are beyond all bounds, and held there."""
    calibration = given("counts")
    recorded = np.vstack([as_recorded(calibration), np.array([[32767, -32768, 32767], [-32768, 32767, 0]])])
    if form is Q31:
        recorded = np.vstack([recorded, [[2**31 - 1, -(2**31), 2**23]]])
    main = MAIN.format(number=number, call="flinders_correct(v, v)")
    out = built(tmp_path, text(name, calibration) + main, compiler, recorded)
    npt.assert_array_equal(out, FixedPoint.of(calibration, form).apply(recorded))
    wanted = expected(calibration, recorded[:1000]) / 0.15
    assert np.abs(out[:1000] - wanted).max() < 0.51 + 0.05  # half a count, and the entries' rounding


def test_the_sketch(tmp_path: Path) -> None:
    calibration = given("uT")
    recorded = as_recorded(calibration)
    main = MAIN.format(number="float", call="correctMagnetometer(v[0], v[1], v[2])")
    out = built(tmp_path, text("arduino", calibration) + main, CPP, recorded)
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)


def other(unit: str = "counts") -> Calibration:
    """Another sensor of the same program."""
    return Calibration(np.diag([1.1, 0.9, 1.0]), np.array([12.0, -3.5, 30.1]), 49.4, True, raw=Unit.of(unit, 0.15))


HEADERS = [("c", "float"), ("c-q15", "int16_t"), ("c-q31", "int32_t")]


@pytest.mark.parametrize(
    ("name", "number", "compiler"),
    [*((*each, C99) for each in HEADERS), *(nightly(*each, CPP) for each in HEADERS), ("arduino", "float", CPP)],
)
def test_two_sensors_in_one_program(name: str, number: str, compiler: tuple[str, ...], tmp_path: Path) -> None:
    """Both in one translation unit, and headers twice; each corrects as it does alone."""
    one, two = text(name, given("counts")), text(name, other(), "Mast, top")
    source = one + two + ("" if name == "arduino" else one + two)
    calls = ("flinders_correct(v, v)", "Mast_top_correct(v, v)")
    if name == "arduino":
        calls = ("correctMagnetometer(v[0], v[1], v[2])", "Mast_top_correctMagnetometer(v[0], v[1], v[2])")
    for calibration, call, alone in ((given("counts"), calls[0], one), (other(), calls[1], two)):
        recorded = as_recorded(calibration)
        main = MAIN.format(number=number, call=call)
        out = built(tmp_path, source + main, compiler, recorded)
        npt.assert_array_equal(out, built(tmp_path, alone + main, compiler, recorded))
        size = 0.15 if name in {"c-q15", "c-q31"} else 1.0
        npt.assert_allclose(out * size, expected(calibration, recorded), atol=0.1 if size < 1 else 1e-4)


@pytest.mark.parametrize("name", ["c", "c-q15", "c-q31"])
def test_two_headers_of_one_name_stop_the_compiler(name: str, tmp_path: Path) -> None:
    """An include guard alone would give the second sensor the numbers of the first."""
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    (tmp_path / "code.c").write_text(text(name, given("counts")) + text(name, other()), encoding="ascii")
    compiled = subprocess.run(
        ["gcc", "-std=c99", "-c", str(tmp_path / "code.c"), "-o", os.devnull],
        capture_output=True,
        text=True,
        check=False,
    )
    assert compiled.returncode != 0
    assert_sentences(compiled.stderr)


@pytest.mark.parametrize(
    ("called", "word"),
    [("mast", "mast"), ("Mast, top", "Mast_top"), ("2nd", "mag_2nd"), ("naïve-compass", "naive_compass"),
     ('a"; */ system(1);\n#include "x', "a_system_1_include_x"), ("int", "int"), ("__x__", "x")],
)  # fmt: skip
def test_names_of_people_become_names_of_code(called: str, word: str) -> None:
    for name in ("c", "c-q15", "c-q31", "matlab"):
        code = text(name, given("counts"), called)
        assert f"{word}_correct(" in code
        assert "flinders_correct" not in code
    assert f"#ifndef {word.upper()}_CALIBRATION_H" in text("c", given(), called)
    assert f"{word}_correctMagnetometer(" in text("arduino", given(), called)


@pytest.mark.parametrize("called", ["", " ", "µ", "_", "???", "x" * 32, "\x00"])
def test_names_of_which_nothing_or_too_much_is_left_are_refused(called: str) -> None:
    for name in ("c", "c-q15", "c-q31", "matlab", "arduino"):
        with assert_raises(UsageError):
            text(name, given("counts"), called)


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("fusion", FUSION, FUSION_USE.replace("NEW", "-").replace("OLD", "- 0.0f *")),
        ("fusion-1.1", FUSION, FUSION_USE.replace("NEW", "- 0.0f *").replace("OLD", "-")),
        ("zscilib", "typedef float zsl_real_t;\n", ZSL_USE),
    ],
)
def test_constants_for_libraries_in_c(name: str, before: str, after: str, tmp_path: Path) -> None:
    """With types laid out as theirs, and their formula; they work in the axes as recorded, in µT here."""
    calibration = given("uT", "x,y,z")
    recorded = as_recorded(calibration)
    main = MAIN.format(number="float", call="float c[3]; correct(v, c); v[0] = c[0]; v[1] = c[1]; v[2] = c[2]")
    lenient = ("gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-missing-braces")  # as Fusion's own examples need
    out = built(tmp_path, before + text(name, calibration) + after + main, lenient, recorded)
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)


RUNNER: Final = """
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";
const { loadMicroPython } = await import(pathToFileURL(process.argv[2]));
const micropython = await loadMicroPython({ stdout: (line) => console.log(line), linebuffer: true });
micropython.runPython(readFileSync(process.argv[3], "ascii"));
"""
"""Runs a file under MicroPython, which node can: Debian has no micropython since its twelfth release."""


# limits by which a disturbed reading is told

GATES = Gates(strength_limit=2.5, dip_deg=-61.0, dip_limit_deg=4.0)
GATED_MAIN = """
#include <stdio.h>
int main(void) {{
    double r[6];
    while (scanf("%lf %lf %lf %lf %lf %lf", r, r + 1, r + 2, r + 3, r + 4, r + 5) == 6) {{
        float v[6];
        int i;
        for (i = 0; i < 6; i++) v[i] = (float)r[i];
        printf("%d %d\\n", (int){strength}, (int){dip});
    }}
    return 0;
}}
"""


def near_the_limits() -> Floats:
    """(N, 6) corrected readings and what an accelerometer reads, around the limits of `GATES`, and one that is none."""
    rng = np.random.default_rng(2)
    up = simulate.uniform_directions(rng, 2000)
    across = np.cross(up, simulate.uniform_directions(rng, 2000))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    dip = np.deg2rad(-61.0 + rng.uniform(-8.0, 8.0, 2000))[:, np.newaxis]
    field = (49.4 + rng.uniform(-5.0, 5.0, 2000))[:, np.newaxis] * (np.cos(dip) * across - np.sin(dip) * up)
    return np.vstack([np.hstack([field, 9.8 * up]), np.full(6, np.nan)])


def gated(name: str, called: str | None = None) -> str:
    return find(name).render(given(), asked=ExportOptions(name=called, gates=GATES)).text


def expected_gates(readings: Floats) -> Floats:
    """(N, 2) whether strength and dip are off, by the angles themselves."""
    field, up = readings[:, :3], readings[:, 3:]
    length = np.linalg.norm(field, axis=1)
    dip_deg = -np.rad2deg(np.arcsin(np.sum(field * up, axis=1) / (length * np.linalg.norm(up, axis=1))))
    within = np.stack([np.abs(length - 49.4) <= 2.5, np.abs(dip_deg + 61.0) <= 4.0], axis=1)
    return 1.0 - within


@pytest.mark.parametrize(
    ("name", "compiler", "strength", "dip"),
    [
        ("c", C99, "mast_strength_is_off(v)", "mast_dip_is_off(v, v + 3)"),
        ("c", CPP, "mast_strength_is_off(v)", "mast_dip_is_off(v, v + 3)"),
        (
            "arduino", CPP, "mast_strengthIsOff(v[0], v[1], v[2])",
            "mast_dipIsOff(v[0], v[1], v[2], v[3], v[4], v[5])",
        ),
    ],
)  # fmt: skip
def test_compiled_limits_tell_readings_apart(
    name: str, compiler: tuple[str, ...], strength: str, dip: str, tmp_path: Path
) -> None:
    readings = near_the_limits()
    out = built(tmp_path, gated(name, "mast") + GATED_MAIN.format(strength=strength, dip=dip), compiler, readings)
    npt.assert_array_equal(out, expected_gates(readings))
    assert 0.3 < out.mean() < 0.7


def test_limits_in_python_tell_readings_apart() -> None:
    module: dict[str, Any] = {}
    exec(gated("micropython"), module)
    readings = near_the_limits()
    out = [[module["strength_is_off"](row[:3]), module["dip_is_off"](row[:3], row[3:])] for row in readings.tolist()]
    npt.assert_array_equal(out, expected_gates(readings))


@pytest.mark.parametrize("limits", [(-88.0, -90.0), (88.0, 90.0)])
def test_a_dip_next_to_the_poles_has_one_limit(limits: tuple[float, float]) -> None:
    dip, pole = limits
    low, high = signed_squares(Gates(1.0, dip, 4.0))
    assert low < np.sin(np.deg2rad(pole)) < high
    assert (low, high)[dip > 0] in (-4.0, 4.0)


def clean(tumble: simulate.Simulated, rng: np.random.Generator, count: int) -> tuple[Floats, Floats]:
    """New readings of a simulated sensor, all over, and a vertical of each that is good to 1° about each axis."""
    up = simulate.uniform_directions(rng, count)
    across = np.cross(up, simulate.uniform_directions(rng, count))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    dip = np.deg2rad(tumble.dip_deg)
    field = tumble.field_strength * (np.cos(dip) * across - np.sin(dip) * up)
    leaning = up + np.deg2rad(1.0) * rng.normal(size=(count, 3))
    raw = field @ tumble.sensor.matrix.T + tumble.sensor.offset + tumble.sensor.noise * rng.normal(size=(count, 3))
    return raw, leaning / np.linalg.norm(leaning, axis=1, keepdims=True)


@pytest.mark.nightly
@pytest.mark.parametrize("trials", [3, nightly(20)])
def test_a_clean_reading_is_beyond_its_limits_as_seldom_as_is_said(trials: int) -> None:
    """Calibrations of 3,000 readings, and 100,000 new ones of the same sensor: at most once in 10,000."""
    beyond = np.zeros(2)
    for seed in range(trials):
        tumble = simulate.tumble(seed=seed)
        found = fit(tumble.samples, aiding=("dip",))
        gates = gates_of(found)
        assert gates is not None
        raw, up = clean(tumble, np.random.default_rng(1000 + seed), 100_000)
        corrected = found.calibration.apply(raw)
        length = np.linalg.norm(corrected, axis=1)
        dip_deg = -np.rad2deg(np.arcsin(np.sum(corrected * up, axis=1) / length))
        beyond[0] += np.count_nonzero(np.abs(length - found.calibration.field_strength) > gates.strength_limit)
        beyond[1] += np.count_nonzero(np.abs(dip_deg - gates.dip_deg) > gates.dip_limit_deg)
    most = 1e-4 * 100_000 * trials
    assert np.all(beyond <= most + 3 * np.sqrt(most))
    assert np.all(beyond > 0)  # they are no wider than they need to be


@pytest.mark.parametrize("noise", [math.nan, 60.0])
def test_a_fit_that_knows_too_little_gives_no_limits(noise: float) -> None:
    found = fit(simulate.tumble(seed=1, n=500).samples)
    assert gates_of(replace(found, evidence=replace(found.evidence, noise=noise))) is None


def test_the_limits_of_a_file_are_those_of_its_fit(tmp_path: Path) -> None:
    found = fit(simulate.tumble(seed=1).samples, aiding=("dip",))
    found.save(tmp_path / "cal.json")
    (file, _), (direct, _) = export_fit(load(tmp_path / "cal.json"), find("c")), export_fit(found, find("c"))
    assert file.fields["values"]["strength_limit"] == pytest.approx(direct.fields["values"]["strength_limit"], rel=1e-6)
    assert file.fields["values"]["dip_limit_deg"] == pytest.approx(direct.fields["values"]["dip_limit_deg"], rel=1e-6)
    assert_sentences(file.fields["notes"])


def no_node(why: str) -> NoReturn:
    pytest.skip(why)


def micropython(folder: Path) -> list[str]:
    """The command that runs a file under MicroPython: itself where it is installed, else its build for node."""
    if shutil.which("micropython"):
        return ["micropython"]
    if not shutil.which("node"):
        no_node("there is neither micropython nor node")
    (folder / "npm").mkdir()
    found = package("@micropython/micropython-webassembly-pyscript", folder / "npm", no_node)
    (folder / "run.mjs").write_text(RUNNER, encoding="ascii")
    return ["node", str(folder / "run.mjs"), str(found / "micropython.mjs")]


def test_the_module_runs_under_micropython(tmp_path: Path) -> None:
    """1,000 readings."""
    calibration = given()
    recorded = as_recorded(calibration)
    lines = [f"print(*correct({tuple(row)}))" for row in recorded.tolist()]
    module = tmp_path / "module.py"
    module.write_text("\n".join(["import sys", text("micropython", calibration), *lines]), encoding="ascii")
    ran = subprocess.run([*micropython(tmp_path), str(module)], capture_output=True, text=True, check=True)
    out = np.array([[float(word) for word in line.split()] for line in ran.stdout.splitlines()])
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)


def test_the_arrays_for_python(tmp_path: Path) -> None:
    calibration = given("uT", "x,y,z")
    module: dict[str, Any] = {}
    exec(compile(text("fusion-python", calibration), "arrays.py", "exec"), module)
    recorded = as_recorded(calibration)
    out = (recorded - module["hard_iron_offset"]) @ module["soft_iron_matrix"].T
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)
