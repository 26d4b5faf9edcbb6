"""Writes a calibration as a component: a folder for ESPHome, Zephyr, Arduino and PlatformIO, or MicroPython.

The calibration code is that of the targets `c` and `micropython`, with limits for disturbed readings and the standard
deviation of each heading; the files of each framework are in `components/`.

>>> from flinders import fit, simulate
>>> files = contents(COMPONENTS["zephyr"], fit(simulate.tumble(seed=1).samples))
>>> sorted(files)[:4]
['CMakeLists.txt', 'Kconfig', 'LICENSE', 'README.md']
>>> "flinders_correct" in files["include/flinders_compass_calibration.h"]
True
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Final

from flinders.core.files import licence_text, write_folder
from flinders.errors import NotExportable
from flinders.fitting.export import export_fit, limit_lines, refuse_unfit
from flinders.fitting.heading_model import heading_model_of
from flinders.fitting.measurement_noise import gates_of, noise_of
from flinders.fitting.verdict import headline_of
from flinders.geometry.plane import axis_order
from flinders.targets import find
from flinders.targets._code_text import digits
from flinders.targets._numbers import RECORDED, per_unit
from flinders.targets._target import words_of_unfollowed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit

FILES: Final = Path(__file__).parent / "components"
TEMPLATE: Final = ".in"
"""Suffix of a template, and of a Python file that belongs to the component and not to this package."""
VERSION: Final = version("flinders")
UNITS: Final = {"uT": "µT", "G": "gauss"}
"""Names of units in texts."""
AUTHORS: Final = "The Flinders developers"
SENTENCE: Final = "Heading of a magnetometer with its calibration by Flinders."
PARAGRAPH: Final = "Each heading comes with its standard deviation at this attitude, and disturbed fields are noticed."
KEYWORDS: Final = ("magnetometer", "compass", "calibration", "heading")


@dataclass(frozen=True, slots=True)
class Component:
    """Row of the table of components: a firmware framework, and how a calibration is written for it."""

    name: str  #: name for ``flinders component``
    use: str  #: framework, in words
    place: str  #: path of the calibration in the folder
    unit: str  #: unit of the readings that the component takes: ``uT``, ``G``, or that of the recording
    manifests: Callable[[], Mapping[str, str]]  #: returns manifest files by name
    next_step: str  #: instruction for the folder

    @property
    def is_python(self) -> bool:
        """Whether the component holds the calibration as a Python module, not as a C header."""
        return self.place.endswith(".py")


def write(component: Component, fit: Fit, directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write a fit as a component.

    Parameters
    ----------
    component : Component
        One of `COMPONENTS`.
    fit : Fit
        A fit with noise and uncertainty.
    directory : str or Path
        The folder, created if missing.
    force : bool
        Replace existing files.

    Returns
    -------
    list of Path
        The files, in order of name.

    Raises
    ------
    NotExportable
        For a refused fit, or one without noise or uncertainty.
    UnitError
        For counts of unknown scale if the component needs µT or gauss.
    OutputExists
        If a file exists and `force` is not given; then nothing is written.
    OutputError
        If a file cannot be written.
    """
    return write_folder(contents(component, fit), directory, force=force)


def contents(component: Component, fit: Fit) -> dict[str, str]:
    """Text of each file of a component, by name; raises the errors of `write` except those of files."""
    refuse_unfit(fit)
    _refuse_unstated(fit)
    folder, values = FILES / component.name, _values(component, fit)
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    made = {name.removesuffix(TEMPLATE): _fill_template(path, values) for name, path in files.items()}
    place = Path(component.place)
    export, _ = export_fit(fit, find("micropython" if component.is_python else "c"))
    made[component.place] = export.text
    if not component.is_python:
        made[(place.parent / "flinders_compass.h").as_posix()] = _fill_template(FILES / "flinders_compass.h.in", values)
    return {**made, **component.manifests(), "README.md": _readme(component, fit), "LICENSE": licence_text()}


def warnings(fit: Fit) -> list[str]:
    """Warnings on parts of a fit that a component omits, and on limits of the fit."""
    followed = fit.calibration.disturbances
    return [
        *(
            words_of_unfollowed(fit.calibration, each, f"the component does not compensate {each.name}")
            for each in followed
        ),
        *limit_lines(fit),
    ]


def _refuse_unstated(fit: Fit) -> None:
    """Refuse a fit without standard deviations; raises NotExportable."""
    if heading_model_of(fit) is None:
        raise NotExportable(
            f"{fit.provenance.name} does not state its noise and uncertainty, which a component needs for the error of "
            "each heading. Calibrate a recording, or export the code alone, for c",
            beyond=(),
        )


def _fill_template(path: Path, values: Mapping[str, str]) -> str:
    """Text of a file, with placeholders replaced by values."""
    text = path.read_text(encoding="utf-8")
    return Template(text).substitute(values) if path.suffix == TEMPLATE else text


def _values(component: Component, fit: Fit) -> dict[str, str]:
    """Values of a template's placeholders."""
    calibration, gates, plane = fit.calibration, gates_of(fit), fit.claim.plane
    given = calibration.raw.name if component.unit == RECORDED else component.unit
    off = "flinders_dip_is_off(compass.field, acceleration)"
    dip = f"\n        compass.disturbed = compass.disturbed || {off};" if gates is not None and gates.has_dip else ""
    level = (
        "static const float upright[3] = {0.0f, 0.0f, -1.0f};\n"
        "        compass.heading = flinders_heading(compass.field, upright, &compass.sigma);"
        if plane is None
        else "compass.heading = flinders_level_heading(compass.field, &compass.sigma);"
    )
    return {
        "version": VERSION,
        "result": calibration.unit,
        "given": given,
        "factor": digits(_factor(component, calibration), "f"),
        "down": "xyz"[axis_order(plane or "xy")[2]],
        "level": level,
        "strength": "flinders_strength_is_off(compass.field)" if gates is not None else "false",
        "dip": dip,
    }


def _factor(component: Component, calibration: Calibration) -> float:
    """Number of units of the recording in one unit of the component's readings; raises UnitError for counts."""
    if component.unit == RECORDED:
        return 1.0
    return per_unit(calibration, component.unit, who=component.use) / calibration.raw.scale


def _readme(component: Component, fit: Fit) -> str:
    """README of the folder: content, accuracy of the headings, and use."""
    noise = noise_of(fit)
    good = [f"From {fit.provenance.name}: the calibration is {fit.verdict}. {headline_of(fit)[0]}"]
    if noise is not None:
        good.append(
            f"1 sigma of a level heading: {noise.heading_reading_deg:.2f}° of one reading, which averaging "
            f"reduces, and {noise.heading_calibration_deg:.2f}° of the calibration, which it does not."
        )
    if gates_of(fit) is None:
        good.append("It has no limits to detect a disturbed field.")
    followed = fit.calibration.disturbances
    good += [
        f"{words_of_unfollowed(fit.calibration, each, f'It does not compensate {each.name}')}." for each in followed
    ]
    given = fit.calibration.raw.name if component.unit == RECORDED else component.unit
    takes = (
        f"Readings are in {UNITS.get(given, given)}, in the axes of the recording. Acceleration is the reading "
        "of an accelerometer at rest in the axes of corrected readings, in any unit: with z down it is negative "
        "when level."
    )
    parts = [
        f"# Flinders compass for {component.use}", f"{SENTENCE} {PARAGRAPH}", "\n".join(good), takes,
        component.next_step,
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _no_manifests() -> dict[str, str]:
    """No manifest: ESPHome and Zephyr need only the files of the component's folder."""
    return {}


def _arduino() -> dict[str, str]:
    """`library.properties` of Arduino's library specification 1.5, rev. 2.2, and `library.json` of PlatformIO."""
    properties = {
        "name": "FlindersCompass", "version": VERSION, "author": AUTHORS, "maintainer": AUTHORS, "sentence": SENTENCE,
        "paragraph": PARAGRAPH, "category": "Sensors",
        "url": "",  # required field; the project has no address
        "architectures": "*", "includes": "FlindersCompass.h",
    }  # fmt: skip
    manifest = {
        "name": "FlindersCompass", "version": VERSION, "description": f"{SENTENCE} {PARAGRAPH}",
        "keywords": list(KEYWORDS), "authors": [{"name": AUTHORS, "maintainer": True}], "license": "BSD-3-Clause",
        "headers": "FlindersCompass.h", "frameworks": "*", "platforms": "*",
        "examples": [{"name": "Heading", "base": "examples/Heading", "files": ["Heading.ino"]}],
    }  # fmt: skip
    lines = "".join(f"{name}={value}\n" for name, value in properties.items())
    return {"library.properties": lines, "library.json": json.dumps(manifest, indent=2) + "\n"}


def _micropython() -> dict[str, str]:
    """`package.json` of mip, and `pyproject.toml` with `requirements.txt` as in bundles of CircuitPython."""
    names = [f"flinders_compass/{name}.py" for name in ("__init__", "calibration")]
    package = {"urls": [[name, name] for name in names], "deps": [], "version": VERSION}
    keywords = ", ".join(f'"{word}"' for word in (*KEYWORDS, "micropython", "circuitpython"))
    project = (
        '[build-system]\nrequires = ["setuptools", "wheel"]\n\n'
        f'[project]\nname = "circuitpython-flinders-compass"\nversion = "{VERSION}"\ndescription = "{SENTENCE}"\n'
        f'readme = "README.md"\nauthors = [{{name = "{AUTHORS}"}}]\nlicense = {{text = "BSD-3-Clause"}}\n'
        f'keywords = [{keywords}]\ndynamic = ["dependencies"]\n\n'
        '[tool.setuptools]\npackages = ["flinders_compass"]\n\n'
        '[tool.setuptools.dynamic]\ndependencies = {file = ["requirements.txt"]}\n'
    )
    return {"package.json": json.dumps(package, indent=2) + "\n", "pyproject.toml": project, "requirements.txt": ""}


COMPONENTS: Final = {
    row.name: row
    for row in (
        Component(
            "arduino", "Arduino and PlatformIO", "src/flinders_compass_calibration.h", RECORDED, _arduino,
            "Move the folder to your libraries (PlatformIO: `lib/` of the project), and open its example Heading.",
        ),
        Component(
            "esphome", "ESPHome", "components/flinders_compass/flinders_compass_calibration.h", "uT", _no_manifests,
            "Move `components` to the folder of the device's configuration, and add `example.yaml` to that.",
        ),
        Component(
            "micropython", "MicroPython and CircuitPython", "flinders_compass/calibration.py", RECORDED, _micropython,
            "Copy `flinders_compass` to `/lib` of the board, or host the folder and let `mip` install it.",
        ),
        Component(
            "zephyr", "Zephyr", "include/flinders_compass_calibration.h", "G", _no_manifests,
            "Name the folder in `ZEPHYR_EXTRA_MODULES` (or in `west.yml`), and set `CONFIG_FLINDERS_COMPASS=y`.",
        ),
    )
}  # fmt: skip
"""Components by name."""
