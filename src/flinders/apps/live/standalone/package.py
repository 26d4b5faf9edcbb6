"""Writes the folder of the page without a server: static files for any host and path.

>>> sorted(name for name in contents() if "." in name and "/" not in name)
['flinders.wasm', 'index.html', 'page.json', 'sw.js']
>>> contents()["index.html"] == asset(f"{STATIC_FOLDER}/index.html").encode()      # the live page has the same file
True
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from flinders.apps.live.planned import bodies_data, planned_table
from flinders.apps.live.simulated import COMMENTS, DIP_DEG, FIELD_UT, RATE_HZ, rocking_then_tumble
from flinders.apps.live.standalone import engine, lines, targets
from flinders.core.calibration_file import VERSION as SCHEMA
from flinders.core.chips import chips
from flinders.core.files import licence_text, make_folder, reason_and_remedy, write_bytes
from flinders.core.geomag import newest_model
from flinders.core.language import ENGLISH_CODE, LANGUAGES, text_of
from flinders.errors import NoEngine, OutputError
from flinders.fitting import refreshing
from flinders.native import build
from flinders.report.html_file import style_of
from flinders.report.modules import asset, script
from flinders.simulate import Sensor, in_body_axes, north_and_down

ROTATION_REFUSAL: Final = (
    "{name} turns readings into the axes of the body, which this page cannot: renew it with flinders refresh"
)
"""Reason why the page cannot renew a calibration with a rotation."""
REFUSALS: Final = {**refreshing.UNFIT_REASONS, "turned": ROTATION_REFUSAL}
"""Sentences on calibrations that the page cannot renew, by reason."""

VERSION: Final = version("flinders")
DATA: Final = "page.json"
STATIC_FOLDER: Final = "apps/live/static"
"""Folder with the modules, the page and the style sheet of this package."""
SCENE: Final = "static/views/scene.js"
"""File of the 3-D view, which the page can do without."""
SCRIPTS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "static/page.js": (f"{STATIC_FOLDER}/standalone/main.js", ()),
    "static/worker.js": (f"{STATIC_FOLDER}/standalone/worker.js", ()),
    SCENE: ("static/views/scene.js", ("Scene",)),
}
"""Scripts of the folder: the module to join with its imports, and its exports."""
REPORT: Final = "static/report.css"
"""Style sheet of a report, shared with the program."""
TRANSLATIONS: Final = "languages/"
"""Folder of the translations; a language is loaded when the user selects it."""
ASSETS: Final = ("index.html", "static/page.css", "static/theme.js", "static/compass.svg")
"""Files that are copied unchanged."""


def write(directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write the page.

    Parameters
    ----------
    directory : str or Path
        The folder, created if missing. An older page in it is replaced.
    force : bool
        Write into a folder with other files, and overwrite files of the same names.

    Returns
    -------
    list of Path
        The files, in order of name.

    Raises
    ------
    OutputError
        If the folder has other files and `force` is not given, or a file cannot be written.
    NoEngine
        If the engine for browsers is missing and cannot be compiled.
    """
    folder = Path(directory)
    _refuse_others(folder, force=force)
    files = {folder / name: content for name, content in sorted(contents().items())}
    for path, content in files.items():
        make_folder(path.parent)
        write_bytes(content, path, force=True)
    return list(files)


def _refuse_others(folder: Path, *, force: bool) -> None:
    """Raise `OutputError` if a folder has files other than those of a page."""
    try:
        is_free = force or not folder.is_dir() or not any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {reason_and_remedy(error)}") from None
    if not is_free and not _is_page(folder / DATA):
        raise OutputError(
            f"{folder} has other files: name an empty folder, or add the page to this one", hint={"force": True}
        )


def _is_page(path: Path) -> bool:
    """Whether a file is the data of a page."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(data, dict) and "flinders_page" in data


def contents() -> dict[str, bytes]:
    """Content of each file of the folder, by name."""
    files = {
        DATA: json.dumps(page_data(), separators=(",", ":"), ensure_ascii=False).encode(),
        **_engine(),
        "LICENSE": licence_text().encode(),
        **_licences(),
        **{name: asset(f"{STATIC_FOLDER}/{name.removeprefix('static/')}").encode() for name in ASSETS},
        REPORT: style_of().encode(),
        **{f"{TRANSLATIONS}{code}.json": text_of(code).encode() for code in LANGUAGES if code != ENGLISH_CODE},
        **{name: text for name, entry in SCRIPTS.items() if (text := _script(*entry)) is not None},
    }
    return {**files, "sw.js": service_worker(files).encode()}


def _engine() -> dict[str, bytes]:
    """The engine for browsers, compiled if missing, and the licences of linked code."""
    try:
        module = build.library(target=build.WEB_PLATFORM)
    except build.NoCompiler as error:
        raise NoEngine(str(error)) from error
    licences = {path.name: path.read_bytes() for path in module.parent.glob("LICENSE-*")}
    return {"flinders.wasm": module.read_bytes(), **licences}


def _licences() -> dict[str, bytes]:
    """The licence of three.js, if the 3-D view is installed."""
    try:
        return {"LICENSE-three": asset("static/vendor/LICENSE").encode()}
    except FileNotFoundError:
        return {}


def _script(entry: str, exported: tuple[str, ...]) -> bytes | None:
    """A module joined with its imports; None if Flinders was installed without the 3-D view."""
    try:
        return script(entry, exported=exported).encode()
    except FileNotFoundError:
        return None


def page_data() -> dict[str, Any]:
    """Data shared by Python and JavaScript, from Python's tables."""
    return {
        "flinders_page": 1,
        "version": VERSION,
        "model": newest_model(),
        "unfit": REFUSALS,
        "simulated": simulated_sensor(),
        "engine": engine.data(),
        "lines": lines.data(),
        "chips": chip_settings(),
        "targets": targets.data(),
        "bodies": bodies_data(),
        "plans": msgspec.to_builtins(planned_table()),
    }


def chip_settings() -> list[tuple[str, float]]:
    """Return usual settings of chips in words, each with the µT of its count, for readings around zero.

    >>> chip_settings()[0], ("QMC5883L ±8 G", 0.0333333) in chip_settings()
    (('HMC5843 ±1.0 G', 0.0769231), True)
    """
    return [
        (chip.name if setting.name == "fixed" else f"{chip.name} {setting.name}", setting.lsb_ut)
        for chip in chips()
        for setting in chip.settings
        if setting.zero == 0 and (setting.is_usual or setting is chip.settings[0])
    ]


@cache
def live_data() -> bytes:
    """Part of the data for the page of `flinders live`, as JSON; its server does the reading and exporting."""
    targets = {"schema": SCHEMA}
    data = {
        "version": VERSION, "model": newest_model(), "unfit": REFUSALS, "engine": engine.data(), "targets": targets,
        "bodies": bodies_data(),
    }  # fmt: skip
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False).encode()


def service_worker(files: dict[str, bytes]) -> str:
    """The script that makes the page work offline, with the files of this version."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode() + b"\0" + files[name] + b"\0")
    left_out = (SCENE, "index.html")
    unneeded = ("LICENSE", TRANSLATIONS)
    names = ["./", *sorted(name for name in files if name not in left_out and not name.startswith(unneeded))]
    page = {"version": f"{VERSION} {digest.hexdigest()[:16]}", "files": names, "scene": SCENE, "kept": TRANSLATIONS}
    return f"const PAGE = {json.dumps(page)};\n{asset(f'{STATIC_FOLDER}/standalone/sw.js')}"


# ---------------------------------------------------------------- the simulated sensor

SEED: Final = 1
"""Seed of the simulated sensor."""


def simulated_sensor() -> dict[str, Any]:
    """Sensor of `flinders live --simulate`: readings without noise, the noise to add, and timed comments.

    Readings are second differences of x, y and z in 0.01 µT, which compress to a fifth.

    >>> played = simulated_sensor()
    >>> played["rate_hz"], len(played["steps_centi_ut"][0]), [at for at, _ in played["said"]]
    (50.0, 3800, [4.0, 16.0])
    """
    of_sensor, of_motion, unused = np.random.default_rng(SEED).spawn(3)
    sensor = Sensor.random(of_sensor)
    path = rocking_then_tumble(of_motion)
    field = FIELD_UT * in_body_axes(path.attitudes, north_and_down(DIP_DEG))
    centi_ut = (100.0 * replace(sensor, noise=0.0).read(field, unused)).round().astype(int)
    return {
        "rate_hz": RATE_HZ,
        "noise_ut": sensor.noise,
        "steps_centi_ut": np.diff(centi_ut, n=2, axis=0, prepend=np.zeros((2, 3), int)).T.tolist(),
        "said": [list(each) for each in COMMENTS],
    }
