"""Components give what the fit claims, in the layout that their frameworks ask for."""

from __future__ import annotations

import importlib
import json
import math
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import click
import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.npm import package as npm_package
from tests.pypi import python_with
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.apps.board.cli import component as command_line
from flinders.apps.board.component import COMPONENTS, VERSION, contents, write
from flinders.cli import main
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import NotExportable, OutputExists, UnitError
from flinders.fitting.export import export_fit
from flinders.fitting.fit_file import fit_for
from flinders.targets import find

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

HERE: Final = Path(__file__).parents[1]
STRICT: Final = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-O1")
CORTEX: Final = (
    "-mcpu=cortex-m4",
    "-mthumb",
    "-mfloat-abi=hard",
    "-mfpu=fpv4-sp-d16",
    "-Os",
    "-Wall",
    "-Wextra",
    "-Werror",
)
ESPHOME: Final = "esphome==2026.6.5"
FILES: Final = {
    "arduino": {
        "examples/Heading/Heading.ino", "keywords.txt", "library.json", "library.properties", "src/FlindersCompass.h",
        "src/flinders_compass.h", "src/flinders_compass_calibration.h",
    },
    "esphome": {
        "example.yaml",
        *(
            f"components/flinders_compass/{name}"
            for name in (
                "__init__.py", "binary_sensor.py", "sensor.py", "flinders_compass.h", "flinders_compass_calibration.h",
                "flinders_compass_component.cpp", "flinders_compass_component.h",
            )
        ),
    },
    "micropython": {
        "examples/flinders_compass_simpletest.py", "flinders_compass/__init__.py", "flinders_compass/calibration.py",
        "package.json", "pyproject.toml", "requirements.txt",
    },
    "zephyr": {
        "CMakeLists.txt", "Kconfig", "include/flinders_compass.h", "include/flinders_compass_calibration.h",
        "include/flinders_compass_sensor.h", "src/flinders_compass_sensor.c", "zephyr/module.yml",
    },
}  # fmt: skip
ZEPHYR_MAIN: Final = """
#include <stdio.h>
#include "flinders_compass_sensor.h"
int main(void) {
    struct device both = {{{0}}, 0}, broken = {{{0}}, -5};
    struct flinders_reading now;
    double *m = both.axes[1], *a = both.axes[0];
    if (flinders_compass_fetch(&broken, &both, &now) != -5) return 1;
    if (flinders_compass_fetch(&both, &broken, &now) != -5) return 1;
    while (scanf("%lf %lf %lf %lf %lf %lf", m, m + 1, m + 2, a, a + 1, a + 2) == 6) {
        if (flinders_compass_fetch(&both, a[0] == 0 && a[1] == 0 ? NULL : &both, &now)) return 1;
        printf("%.9g %.9g %d\\n", (double)now.heading, (double)now.sigma, (int)now.disturbed);
    }
    return 0;
}
"""


def missing(why: str) -> NoReturn:
    pytest.skip(why)


def compiler(name: str) -> str:
    return shutil.which(name) or missing(f"no {name}")


@cache
def found(kind: str = "dip") -> Fit:
    """Fits with a limit of the dip, without one, of a level turn, and of counts of unknown scale."""
    if kind == "level":
        return flinders.fit(simulate.tumble(seed=1, motion="level").samples)
    samples = simulate.tumble(seed=1, n=600).samples
    if kind == "counts":
        return flinders.fit(np.rint(samples.field * 11.0))
    return flinders.fit(samples, aiding=("dip",) if kind == "dip" else ())


def readings(fitted: Fit, count: int = 100) -> Floats:
    """(N, 6) raw readings in µT and an accelerometer's, of which one in four is disturbed by 8 µT."""
    rng = np.random.default_rng(3)
    up = simulate.uniform_directions(rng, count)
    across = np.cross(up, simulate.uniform_directions(rng, count))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    field = fitted.calibration.field_strength * (0.5 * across - math.sqrt(0.75) * up)
    field[::4] += 8.0 * simulate.uniform_directions(rng, len(field[::4]))
    table: Floats = np.hstack([fitted.calibration.unapply(field), 9.81 * up])
    return table


def expected(fitted: Fit, table: Floats) -> Floats:
    """(N, 3) heading, standard deviation, and whether it is disturbed, by the module of the target `micropython`."""
    module: dict[str, Any] = {}
    exec(export_fit(fitted, find("micropython"))[0].text, module)
    rows = []
    for row in table.tolist():
        field = module["correct"](row[:3])
        is_off = "strength_is_off" in module and module["strength_is_off"](field)
        is_off = is_off or ("dip_is_off" in module and module["dip_is_off"](field, row[3:]))
        rows.append([*module["heading"](field, row[3:]), is_off])
    return np.array(rows, float)


def lines(table: Floats) -> str:
    return "".join(" ".join(f"{value:.7f}" for value in row) + "\n" for row in table)


def numbers(printed: str) -> Floats:
    return np.array([[float(word) for word in line.split()] for line in printed.splitlines()])


def same(out: Floats, wanted: Floats, within_deg: float = 0.01) -> None:
    npt.assert_allclose((out[:, 0] - wanted[:, 0] + 180.0) % 360.0 - 180.0, 0.0, atol=within_deg)
    npt.assert_allclose(out[:, 1], wanted[:, 1], rtol=1e-3)
    npt.assert_array_equal(out[:, 2], wanted[:, 2])


def test_the_command_takes_every_component() -> None:
    (kind,) = (each for each in command_line.command.params if each.name == "kind")
    assert isinstance(kind.type, click.Choice)
    assert tuple(kind.type.choices) == tuple(COMPONENTS)


@pytest.mark.parametrize("name", list(COMPONENTS))
def test_a_component_has_the_files_of_its_framework(name: str, tmp_path: Path) -> None:
    files = write(COMPONENTS[name], found(), tmp_path / "made")
    names = {file.relative_to(tmp_path / "made").as_posix() for file in files}
    assert names == FILES[name] | {"README.md", "LICENSE"}
    assert all("$" not in file.read_text(encoding="utf-8") for file in files)


def test_manifests_name_files_that_are_there() -> None:
    arduino, python = (contents(COMPONENTS[name], found()) for name in ("arduino", "micropython"))
    properties = dict(line.split("=", 1) for line in arduino["library.properties"].splitlines())
    manifest = json.loads(arduino["library.json"])
    assert properties["version"] == manifest["version"] == VERSION
    assert f"src/{properties['includes']}" in arduino
    assert f"src/{manifest['headers']}" in arduino
    example = manifest["examples"][0]
    assert all(f"{example['base']}/{file}" in arduino for file in example["files"])
    assert all(row.count("\t") == 1 for row in arduino["keywords.txt"].splitlines())
    package = json.loads(python["package.json"])
    assert {source for _, source in package["urls"]} == {
        name for name in python if name.startswith("flinders_compass/")
    }
    assert package["version"] == VERSION


# zephyr, over a stand-in for its API of sensors


def run_zephyr(fitted: Fit, table: Floats, folder: Path) -> Floats:
    write(COMPONENTS["zephyr"], fitted, folder / "module")
    (folder / "main.c").write_text(ZEPHYR_MAIN, encoding="ascii")
    includes = ["-I", str(HERE / "zephyr"), "-I", str(folder / "module" / "include")]
    sources = [str(folder / "main.c"), str(folder / "module" / "src" / "flinders_compass_sensor.c")]
    program = str(folder / "program")
    subprocess.run([compiler("gcc"), "-std=c99", *STRICT, *includes, *sources, "-o", program, "-lm"], check=True)
    done = subprocess.run([program], input=lines(table), capture_output=True, text=True, check=True)
    return numbers(done.stdout)


@pytest.mark.parametrize("kind", ["dip", "plain"])
def test_the_module_of_zephyr_takes_gauss(kind: str, tmp_path: Path) -> None:
    fitted = found(kind)
    table = readings(fitted)
    out = run_zephyr(fitted, table * [0.01, 0.01, 0.01, 1, 1, 1], tmp_path)
    wanted = expected(fitted, table)
    same(out, wanted, 0.05)  # a sensor_value has steps of a millionth of a gauss
    assert 0.1 < wanted[:, 2].mean() < 0.4


@pytest.mark.parametrize("kind", ["plain", "level"])
def test_without_an_accelerometer_a_vehicle_is_level(kind: str, tmp_path: Path) -> None:
    fitted = found(kind)
    heading = np.radians(np.arange(5.0, 360.0, 10.0))
    field = np.stack([0.5 * np.cos(heading), -0.5 * np.sin(heading), np.full(36, math.sqrt(0.75))], axis=1)
    raw = fitted.calibration.unapply(fitted.calibration.field_strength * field)
    out = run_zephyr(fitted, np.hstack([raw * 0.01, np.zeros((36, 3))]), tmp_path)
    npt.assert_allclose(out[:, 0], np.degrees(heading), atol=0.01)
    assert not out[:, 2].any()
    npt.assert_allclose(out[:, 1], expected(fitted, np.hstack([raw, np.tile([0, 0, -1.0], (36, 1))]))[:, 1], rtol=1e-3)


@pytest.mark.tools
def test_the_module_of_zephyr_compiles_for_a_board(tmp_path: Path) -> None:
    """Over the stand-in, not over Zephyr."""
    write(COMPONENTS["zephyr"], found(), tmp_path)
    command = [
        compiler("arm-none-eabi-gcc"),
        "-std=c99",
        *CORTEX,
        "-I",
        str(HERE / "zephyr"),
        "-I",
        str(tmp_path / "include"),
    ]
    subprocess.run(
        [*command, "-c", str(tmp_path / "src/flinders_compass_sensor.c"), "-o", str(tmp_path / "o")], check=True
    )


@pytest.mark.tools
def test_kconfig_of_zephyr_is_read_by_kconfiglib(tmp_path: Path) -> None:
    write(COMPONENTS["zephyr"], found(), tmp_path)
    (tmp_path / "top").write_text(
        f'config SENSOR\n\tbool "sensors"\n\nosource "{tmp_path}/Kconfig"\n', encoding="ascii"
    )
    (tmp_path / "conf").write_text("CONFIG_SENSOR=y\nCONFIG_FLINDERS_COMPASS=y\n", encoding="ascii")
    script = (
        "import kconfiglib, sys; top = kconfiglib.Kconfig(sys.argv[1]); top.load_config(sys.argv[2]);"
        "print(top.syms['FLINDERS_COMPASS'].str_value, top.warnings)"
    )
    command = [*python_with("kconfiglib==14.1.0", missing), "-c", script, str(tmp_path / "top"), str(tmp_path / "conf")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "y []\n"


CMAKE: Final = """
cmake_minimum_required(VERSION 3.13)
project(stand_in C)
set(CONFIG_FLINDERS_COMPASS y)
macro(zephyr_include_directories)
  include_directories(${ARGN} STAND_IN)
endmacro()
macro(zephyr_library)
endmacro()
macro(zephyr_library_sources)
  add_library(compass STATIC ${ARGN})
endmacro()
add_subdirectory(module)
"""


@pytest.mark.tools
def test_cmake_of_zephyr_builds_with_its_functions(tmp_path: Path) -> None:
    """With stand-ins for the functions of Zephyr's build."""
    write(COMPONENTS["zephyr"], found(), tmp_path / "module")
    (tmp_path / "CMakeLists.txt").write_text(CMAKE.replace("STAND_IN", str(HERE / "zephyr")), encoding="utf-8")
    cmake = compiler("cmake")
    subprocess.run([cmake, "-S", str(tmp_path), "-B", str(tmp_path / "b")], check=True, capture_output=True)
    subprocess.run([cmake, "--build", str(tmp_path / "b")], check=True, capture_output=True)
    assert list((tmp_path / "b").rglob("libcompass.a"))


# arduino and platformio


def test_the_example_for_arduino_prints_headings(tmp_path: Path) -> None:
    """Over `tests/arduino`."""
    fitted = found()
    write(COMPONENTS["arduino"], fitted, tmp_path)
    sketch = tmp_path / "examples" / "Heading" / "Heading.ino"
    command = [compiler("g++"), "-std=c++11", *STRICT, "-Wno-unused-variable", "-I", str(HERE / "arduino")]
    command += [
        "-I",
        str(tmp_path / "src"),
        "-include",
        "Arduino.h",
        "-x",
        "c++",
        str(sketch),
        "-o",
        str(tmp_path / "sketch"),
        "-lm",
    ]
    subprocess.run(command, check=True)
    table = readings(fitted)
    done = subprocess.run([str(tmp_path / "sketch")], input=lines(table), capture_output=True, text=True, check=False)
    rows = [line.split() for line in done.stdout.splitlines()]
    out = np.array([[float(row[0]), float(row[2]), len(row) == 4] for row in rows], float)
    wanted = expected(fitted, table)
    assert len(out) == len(wanted)
    npt.assert_allclose((out[:, 0] - wanted[:, 0] + 180) % 360 - 180, 0.0, atol=0.051)
    npt.assert_allclose(out[:, 1], wanted[:, 1], atol=0.0051)
    npt.assert_array_equal(out[:, 2], wanted[:, 2])


@pytest.mark.tools
@pytest.mark.parametrize(
    "command", [("arm-none-eabi-g++", *CORTEX), ("avr-g++", "-mmcu=atmega328p", *STRICT)], ids=["cortex", "avr"]
)
def test_the_library_for_arduino_compiles_for_a_board(command: tuple[str, ...], tmp_path: Path) -> None:
    write(COMPONENTS["arduino"], found("level"), tmp_path)
    source = tmp_path / "use.cpp"
    source.write_text(
        "#include <FlindersCompass.h>\nfloat out[2];\nvoid use(const float *v) {\n"
        "  FlindersCompass compass;\n  out[0] = compass.readLevel(v[0], v[1], v[2]).sigma;\n"
        "  out[1] = compass.read(v[0], v[1], v[2], v[3], v[4], v[5]).heading;\n}\n",
        encoding="ascii",
    )
    includes = ["-I", str(tmp_path / "src"), "-c", str(source), "-o", str(tmp_path / "o")]
    subprocess.run([compiler(command[0]), *command[1:], "-std=c++11", *includes], check=True)


@pytest.mark.tools
def test_platformio_takes_the_manifest(tmp_path: Path) -> None:
    """Its own schema; the list of licences, which it would fetch, is given."""
    write(COMPONENTS["arduino"], found(), tmp_path)
    script = (
        "import sys; from platformio.package.manifest.schema import ManifestSchema as S;"
        "from platformio.package.manifest.parser import ManifestParserFactory as F;"
        "S.load_spdx_licenses = staticmethod(lambda *_: {'licenses': [{'licenseId': 'BSD-3-Clause'}]});"
        "[print(S().load_manifest(F.new_from_file(path).as_dict())['name']) for path in sys.argv[1:]]"
    )
    files = [str(tmp_path / name) for name in ("library.json", "library.properties")]
    command = [*python_with("platformio==6.2.0", missing), "-c", script, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["FlindersCompass", "FlindersCompass"], done.stderr


# micropython and circuitpython


@pytest.fixture
def package(tmp_path: Path) -> Iterator[Path]:
    """The package in a folder that Python imports from."""
    write(COMPONENTS["micropython"], found(), tmp_path)
    sys.path.insert(0, str(tmp_path))
    yield tmp_path
    sys.path.remove(str(tmp_path))
    for name in [name for name in sys.modules if name.partition(".")[0] == "flinders_compass"]:
        del sys.modules[name]


def test_the_package_for_micropython_runs_in_python(package: Path) -> None:
    compass = importlib.import_module("flinders_compass").Compass()
    table = readings(found())
    rows = [compass.read(row[:3], row[3:]) for row in table.tolist()]
    out = np.array([[row.heading, row.sigma, row.is_disturbed] for row in rows], float)
    npt.assert_allclose(out, expected(found(), table), rtol=1e-12)
    assert (package / "flinders_compass" / "calibration.py").is_file()


def test_a_compass_takes_another_stored_calibration(package: Path) -> None:
    """A module of the target `micropython`, here of a level turn."""
    assert package.is_dir()
    module = importlib.import_module("types").ModuleType("level")
    exec(export_fit(found("level"), find("micropython"))[0].text, vars(module))
    compass = importlib.import_module("flinders_compass").Compass(module)
    raw = found("level").calibration.unapply(np.array([0.0, -24.0, 42.0])).tolist()
    now = compass.read(raw)
    assert (now.heading, now.sigma) == module.level_heading(now.field)
    assert now.heading == pytest.approx(90.0, abs=0.01)


MICROPYTHON: Final = """
import {{ readFileSync }} from "node:fs";
import {{ pathToFileURL }} from "node:url";
const {{ loadMicroPython }} = await import(pathToFileURL("{built}"));
const micropython = await loadMicroPython({{ stdout: (line) => console.log(line), linebuffer: true }});
micropython.FS.mkdirTree("/lib/flinders_compass");
for (const name of ["__init__.py", "calibration.py"]) {{
  micropython.FS.writeFile(`/lib/flinders_compass/${{name}}`, readFileSync(`{folder}/flinders_compass/${{name}}`));
}}
micropython.runPython(readFileSync("{script}", "ascii"));
"""


@pytest.mark.tools
def test_the_package_runs_under_micropython(tmp_path: Path) -> None:
    """In its build for node, from /lib."""
    write(COMPONENTS["micropython"], found(), tmp_path)
    (tmp_path / "npm").mkdir()
    built = npm_package("@micropython/micropython-webassembly-pyscript", tmp_path / "npm", missing)
    table = readings(found(), 40)
    script = tmp_path / "script.py"
    calls = [f"show({row[:3]}, {row[3:]})" for row in table.tolist()]
    head = (
        "import sys\nsys.path.append('/lib')\nfrom flinders_compass import Compass\ncompass = Compass()\n"
        "def show(m, a):\n    now = compass.read(m, a)\n    print(now.heading, now.sigma, int(now.is_disturbed))\n"
    )
    script.write_text(head + "\n".join(calls), encoding="ascii")
    text = MICROPYTHON.format(built=built / "micropython.mjs", folder=tmp_path, script=script)
    (tmp_path / "run.mjs").write_text(text, encoding="utf-8")
    done = subprocess.run([compiler("node"), str(tmp_path / "run.mjs")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]
    same(
        np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()]),
        expected(found(), table),
    )


@pytest.mark.tools
def test_a_bundle_of_circuitpython_takes_the_package(tmp_path: Path) -> None:
    """Adafruit's build tools, as they make bundles of sources."""
    write(COMPONENTS["micropython"], found(), tmp_path / "Flinders_Compass")
    script = (
        "import sys; from circuitpython_build_tools.build import get_package_info as info;"
        "known = info(sys.argv[1], 'adafruit_');"
        "print(known['module_name'], sorted(f.name for f in known['package_files'] + known['py_files']))"
    )
    command = [
        *python_with("circuitpython-build-tools==1.16.0", missing),
        "-c",
        script,
        str(tmp_path / "Flinders_Compass"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["flinders_compass", "['__init__.py',", "'calibration.py']"], done.stderr


# esphome

DEVICE: Final = """\
esphome:
  name: boat
host:
logger:
packages:
  compass: !include example.yaml
"""
SENSOR: Final = """\
  - platform: template
    id: {name}
    lambda: return {value:.6f};
    update_interval: 50ms
"""
PRINTING: Final = """\
    {name}:
      name: printed {name}
      on_value:
        - lambda: 'printf("{name} %.6f\\n", x); fflush(stdout);'
"""


def device(fitted: Fit, row: Floats, folder: Path) -> list[str]:
    """A device of one reading, and the command of ESPHome."""
    command = [*python_with(ESPHOME, missing), "-m", "esphome"]
    write(COMPONENTS["esphome"], fitted, folder)
    names = [f"{sensor}_{axis}" for sensor in ("mag", "accel") for axis in "xyz"]
    example = folder / "example.yaml"
    text = (
        example.read_text(encoding="utf-8").replace("  # accel", "  accel").replace("interval: 1s", "interval: 100ms")
    )
    example.write_text(text, encoding="utf-8")
    sensors = "".join(SENSOR.format(name=name, value=value) for name, value in zip(names, row, strict=True))
    printing = "".join(PRINTING.format(name=name) for name in ("heading", "heading_sigma"))
    shown = f"  - platform: flinders_compass\n{printing}"
    (folder / "device.yaml").write_text(f"{DEVICE}sensor:\n{sensors}{shown}", encoding="utf-8")
    return command


@pytest.mark.tools
def test_esphome_takes_the_configuration(tmp_path: Path) -> None:
    command = device(found(), readings(found())[1], tmp_path)
    done = subprocess.run(
        [*command, "config", "device.yaml"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (tmp_path / "example.yaml").write_text("flinders_compass:\n  field_strength_x: mag_x\n", encoding="utf-8")
    done = subprocess.run(
        [*command, "config", "device.yaml"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2  # two axes are missing


@pytest.mark.tools
@pytest.mark.nightly
def test_esphome_runs_the_component(tmp_path: Path) -> None:
    """ESPHome's own core for this machine, compiled without PlatformIO: it publishes heading and standard deviation."""
    row = readings(found())[1]
    command = [*device(found(), row, tmp_path), "compile", "--only-generate", "device.yaml"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    build = tmp_path / ".esphome" / "build" / "boat"
    flags = ["-std=gnu++20", "-DUSE_HOST", "-DESPHOME_LOG_LEVEL=ESPHOME_LOG_LEVEL_NONE", "-fno-exceptions", "-w"]
    sources = map(str, sorted((build / "src").rglob("*.cpp")))
    program = str(build / "program")
    subprocess.run(
        [compiler("g++"), *flags, "-I", str(build / "src"), *sources, "-o", program, "-lpthread"], check=True
    )
    with subprocess.Popen([program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        shown = dict(line.split() for line, _ in zip(process.stdout, range(8), strict=False))
        process.kill()
    wanted = expected(found(), row[np.newaxis])[0]
    assert float(shown["heading"]) == pytest.approx(wanted[0], abs=0.01)
    assert float(shown["heading_sigma"]) == pytest.approx(wanted[1], rel=1e-3)


# what is refused


def test_a_calibration_without_uncertainty_is_refused() -> None:
    known = Calibration(np.eye(3), np.zeros(3), 50.0, raw=Unit.of("uT"))
    for component in COMPONENTS.values():
        with pytest.raises(NotExportable):
            contents(component, fit_for(known))


def test_counts_of_unknown_scale_are_for_readings_as_recorded() -> None:
    for name in ("esphome", "zephyr"):
        with pytest.raises(UnitError):
            contents(COMPONENTS[name], found("counts"))
    assert (
        "FLINDERS_HEADING_SIGMA_READING"
        in contents(COMPONENTS["arduino"], found("counts"))[COMPONENTS["arduino"].place]
    )


def test_files_are_replaced_only_if_asked(tmp_path: Path) -> None:
    write(COMPONENTS["zephyr"], found(), tmp_path)
    with pytest.raises(OutputExists):
        write(COMPONENTS["zephyr"], found(), tmp_path)
    write(COMPONENTS["zephyr"], found(), tmp_path, force=True)


def test_the_command_writes_a_component(tmp_path: Path) -> None:
    found().save(tmp_path / "calibration.json")
    asked = [
        "component",
        "--for",
        "esphome",
        str(tmp_path / "calibration.json"),
        "-o",
        str(tmp_path / "made"),
        "--json",
    ]
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["component"] == "esphome"
    assert len(answer["files"]) == len(FILES["esphome"]) + 2
    assert CliRunner().invoke(main, asked).exit_code == 6


def test_what_a_component_does_not_follow_is_said_with_its_cost(tmp_path: Path) -> None:
    motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3], amperes=20.0)
    flown = flinders.fit(simulate.tumble(seed=3, disturbances=[motors]).samples, disturbances=("current",))
    flown.save(tmp_path / "flown.json")
    asked = ["component", "--for", "arduino", str(tmp_path / "flown.json"), "-o", str(tmp_path / "made")]
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 0, done.output
    assert_sentences(done.output, about="0 A")
    readme = (tmp_path / "made" / "README.md").read_text(encoding="utf-8")
    assert_sentences(readme, about="current")
    assert_sentences(readme, about="axes of the recording")
