"""Generated code, compiled as strictly as can be and run, gives the calibration."""

from __future__ import annotations

import os
import shutil
import subprocess
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np
import numpy.testing as npt
import pytest
from tests.npm import package
from tests.trials import nightly

from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.targets import ExportOptions, find
from flinders.targets.code import Q15, Q31, FixedPoint, FixedPointFormat

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
    field = calibration.field_strength * simulate.uniform(np.random.default_rng(3), 1000)
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
    command = [*compiler, str(folder / "code.c"), "-o", str(folder / "code")]
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
    assert (
        "two calibrations have the names of flinders: write one of them with flinders export --name" in compiled.stderr
    )


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
        with pytest.raises(UsageError, match=r"need 1 to 31, such as name='mast'"):
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


def no_node(why: str) -> NoReturn:
    pytest.skip(why)


def test_the_module_runs_under_micropython(tmp_path: Path) -> None:
    """1,000 readings; micropython itself where it is installed, else its build for node."""
    calibration = given()
    recorded = as_recorded(calibration)
    lines = [f"print(*correct({tuple(row)}))" for row in recorded.tolist()]
    module, interpreter = tmp_path / "module.py", ["micropython"]
    module.write_text("\n".join(["import sys", text("micropython", calibration), *lines]), encoding="ascii")
    if not shutil.which("micropython"):
        if not shutil.which("node"):
            no_node("there is neither micropython nor node")
        (tmp_path / "npm").mkdir()
        found = package("@micropython/micropython-webassembly-pyscript", tmp_path / "npm", no_node)
        (tmp_path / "run.mjs").write_text(RUNNER, encoding="ascii")
        interpreter = ["node", str(tmp_path / "run.mjs"), str(found / "micropython.mjs")]
    ran = subprocess.run([*interpreter, str(module)], capture_output=True, text=True, check=True)
    out = np.array([[float(word) for word in line.split()] for line in ran.stdout.splitlines()])
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)


def test_the_arrays_for_python(tmp_path: Path) -> None:
    calibration = given("uT", "x,y,z")
    module: dict[str, Any] = {}
    exec(compile(text("fusion-python", calibration), "arrays.py", "exec"), module)
    recorded = as_recorded(calibration)
    out = (recorded - module["hard_iron_offset"]) @ module["soft_iron_matrix"].T
    npt.assert_allclose(out, expected(calibration, recorded), atol=1e-4)
