"""Writes the folder of the page that needs no program: static files that any host serves under any path.

>>> sorted(name for name in contents() if "." in name and "/" not in name)
['flinders.wasm', 'index.html', 'page.json', 'sw.js']
>>> contents()["index.html"] == asset(f"{HERE}/index.html").encode()      # which is that of the live page
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
from flinders.apps.live.simulated import DIP_DEG, FIELD_UT, RATE_HZ, SAID, rocked_and_turned
from flinders.apps.live.standalone import engine, lines, targets
from flinders.core.calibration_file import VERSION as SCHEMA
from flinders.core.chips import chips
from flinders.core.files import licence, make_folder, reason, write_bytes
from flinders.core.geomag import newest_model
from flinders.errors import NoEngine, OutputError
from flinders.fitting import refreshing
from flinders.native import build
from flinders.report.html_file import style_of
from flinders.report.modules import asset, script
from flinders.simulate import Sensor, north_and_down, seen_from

TURNED: Final = (
    "{name} turns readings into the axes of the body, which this page does not do: flinders refresh renews it"
)
"""Why the page alone cannot renew a calibration."""
UNFIT: Final = {**refreshing.UNFIT, "turned": TURNED}
"""Why a calibration cannot be renewed on a page, by reason."""

VERSION: Final = version("flinders")
DATA: Final = "page.json"
HERE: Final = "apps/live/static"
"""Modules, page and style sheet of this package."""
SCENE: Final = "static/views/scene.js"
"""The 3-D view, without which the page works."""
SCRIPTS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    "static/page.js": (f"{HERE}/standalone/main.js", ()),
    "static/worker.js": (f"{HERE}/standalone/worker.js", ()),
    SCENE: ("static/views/scene.js", ("Scene",)),
}
"""Scripts of the folder: the module that each is joined from, and what it exports."""
REPORT: Final = "static/report.css"
"""Style of a report, the program's own."""
ASSETS: Final = ("index.html", "static/page.css", "static/theme.js", "static/compass.svg")
"""Files of the folder that are here as they are."""


def write(directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write the page.

    Parameters
    ----------
    directory : str or Path
        The folder, which is made. One that has an older page is written anew.
    force : bool
        Write beside files that are not of such a page, and over those of the same names.

    Returns
    -------
    list of Path
        The files, in order of name.

    Raises
    ------
    OutputError
        Where the folder has other files and `force` is not given; where a file cannot be written.
    NoEngine
        Where the engine has to be compiled for browsers, and cannot be.
    """
    folder = Path(directory)
    _refuse_others(folder, force=force)
    files = {folder / name: content for name, content in sorted(contents().items())}
    for path, content in files.items():
        make_folder(path.parent)
        write_bytes(content, path, force=True)
    return list(files)


def _refuse_others(folder: Path, *, force: bool) -> None:
    """Raise where a folder has files, and they are not of a page."""
    try:
        is_free = force or not folder.is_dir() or not any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {reason(error)}") from None
    if not is_free and not _is_page(folder / DATA):
        raise OutputError(
            f"{folder} has other files: give a folder of its own, or write it among them", hint={"force": True}
        )


def _is_page(path: Path) -> bool:
    """Whether a file is the data of a page."""
    try:
        data = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(data, dict) and "flinders_page" in data


def contents() -> dict[str, bytes]:
    """Every file of the folder by its name."""
    files = {
        DATA: json.dumps(page_data(), separators=(",", ":"), ensure_ascii=False).encode(),
        **_engine(),
        "LICENSE": licence().encode(),
        **_of_others(),
        **{name: asset(f"{HERE}/{name.removeprefix('static/')}").encode() for name in ASSETS},
        REPORT: style_of().encode(),
        **{name: text for name, entry in SCRIPTS.items() if (text := _script(*entry)) is not None},
    }
    return {**files, "sw.js": service_worker(files).encode()}


def _engine() -> dict[str, bytes]:
    """The engine for browsers, compiled where it is not there, and the licences of what was linked with it."""
    try:
        module = build.library(target=build.WEB)
    except build.NoCompiler as error:
        raise NoEngine(str(error)) from error
    licences = {path.name: path.read_bytes() for path in module.parent.glob("LICENSE-*")}
    return {"flinders.wasm": module.read_bytes(), **licences}


def _of_others() -> dict[str, bytes]:
    """The licence of three.js, where the 3-D view is there."""
    try:
        return {"LICENSE-three": asset("static/vendor/LICENSE").encode()}
    except FileNotFoundError:
        return {}


def _script(entry: str, exported: tuple[str, ...]) -> bytes | None:
    """A module with all that it imports; None where Flinders was installed without the 3-D view."""
    try:
        return script(entry, exported=exported).encode()
    except FileNotFoundError:
        return None


def page_data() -> dict[str, Any]:
    """All that both languages need, as rows of Python have it."""
    return {
        "flinders_page": 1,
        "version": VERSION,
        "model": newest_model(),
        "unfit": UNFIT,
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
    """What the page of `flinders live` takes of it, as JSON: its server reads, and writes calibrations."""
    targets = {"schema": SCHEMA}
    data = {
        "version": VERSION, "model": newest_model(), "unfit": UNFIT, "engine": engine.data(), "targets": targets,
        "bodies": bodies_data(),
    }  # fmt: skip
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False).encode()


def service_worker(files: dict[str, bytes]) -> str:
    """The script that makes the page work offline, with the files of this version."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode() + b"\0" + files[name] + b"\0")
    left_out = (SCENE, "index.html")
    names = ["./", *sorted(name for name in files if name not in left_out and not name.startswith("LICENSE"))]
    page = {"version": f"{VERSION} {digest.hexdigest()[:16]}", "files": names, "scene": SCENE}
    return f"const PAGE = {json.dumps(page)};\n{asset(f'{HERE}/standalone/sw.js')}"


# ---------------------------------------------------------------- the simulated sensor

SEED: Final = 1
"""Of the simulated sensor."""


def simulated_sensor() -> dict[str, Any]:
    """Sensor of `flinders live --simulate`: readings without noise, the noise to add, what is said when.

    Readings are second differences of x, y and z in 0.01 µT, which pack to a fifth.

    >>> played = simulated_sensor()
    >>> played["rate_hz"], len(played["steps_centi_ut"][0]), [at for at, _ in played["said"]]
    (50.0, 3800, [4.0, 16.0])
    """
    of_sensor, of_motion, unused = np.random.default_rng(SEED).spawn(3)
    sensor = Sensor.random(of_sensor)
    path = rocked_and_turned(of_motion)
    field = FIELD_UT * seen_from(path.attitudes, north_and_down(DIP_DEG))
    centi_ut = (100.0 * replace(sensor, noise=0.0).read(field, unused)).round().astype(int)
    return {
        "rate_hz": RATE_HZ,
        "noise_ut": sensor.noise,
        "steps_centi_ut": np.diff(centi_ut, n=2, axis=0, prepend=np.zeros((2, 3), int)).T.tolist(),
        "said": [list(each) for each in SAID],
    }
