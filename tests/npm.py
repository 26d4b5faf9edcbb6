"""Packages of npm that only tests need: from web/node_modules, or else downloaded, by web/package-lock.json."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import NoReturn

WEB: Final = Path(__file__).resolve().parents[1] / "web"
NPM_S: Final = 60.0


def package(name: str, folder: Path, missing: Callable[[str], NoReturn]) -> Path:
    """Folder of a package that web/package-lock.json names; if it is missing, npm downloads it.

    Parameters
    ----------
    name : str
    folder : Path
        Empty folder for the download.
    missing : callable
        Called with the reason why the package is missing; it ends the test.
    """
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))["packages"][f"node_modules/{name}"]
    installed = WEB / "node_modules" / name
    if not installed.exists():
        installed = _fetched(name, lock, folder, missing)
    assert json.loads((installed / "package.json").read_text(encoding="utf-8"))["version"] == lock["version"]
    return installed


def _fetched(name: str, lock: dict[str, Any], folder: Path, missing: Callable[[str], NoReturn]) -> Path:
    """Download one package with npm, and check its hash."""
    npm = shutil.which("npm")
    if npm is None:
        missing(f"{name} is not in web/node_modules, and there is no npm to fetch it")
    wanted = {"name": "wanted", "private": True, "dependencies": {name: lock["version"]}}
    packages = {"": wanted, f"node_modules/{name}": {**lock, "dev": False}}
    (folder / "package.json").write_text(json.dumps(wanted), encoding="utf-8")
    (folder / "package-lock.json").write_text(
        json.dumps({**wanted, "lockfileVersion": 3, "requires": True, "packages": packages}), encoding="utf-8"
    )
    try:
        done = subprocess.run(
            [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"],
            cwd=folder, capture_output=True, text=True, timeout=NPM_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        missing(f"npm did not fetch {name} within {NPM_S:g} s")
    if done.returncode:
        missing(f"npm could not fetch {name}: {done.stderr.strip()[-300:]}")
    return folder / "node_modules" / name
