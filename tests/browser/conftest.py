"""A real browser, which reaches nothing but the program that a test started, and whose complaints fail the test.

Without a browser these tests are skipped with a reason; where FLINDERS_BROWSER is ``required`` they fail.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np
import pytest
from benchmarks.stage import NAMES, chromium, chromium_path

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser


WEB: Final = Path(__file__).resolve().parents[2] / "web"
IS_REQUIRED: Final = os.environ.get("FLINDERS_BROWSER") == "required"
NPM_S: Final = 60.0
HEADER: Final = "t_s,mx_uT,my_uT,mz_uT"


def missing(what: str) -> NoReturn:
    """Skip, or fail where browser tests are required."""
    if IS_REQUIRED:
        pytest.fail(f"{what}, and FLINDERS_BROWSER is required", pytrace=False)
    pytest.skip(what)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        import playwright  # noqa: F401
    except ModuleNotFoundError:
        missing("playwright is not installed")
    if chromium_path() is None:
        missing(f"there is no browser here: install one of {', '.join(NAMES)}")
    with chromium() as found:
        yield found


@pytest.fixture(scope="session")
def tumble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of 60 s in µT: 3,000 readings of a sensor that is turned all round by hand."""
    samples = simulate.tumble(seed=3, noise=0.3).samples
    path = tmp_path_factory.mktemp("logs") / "tumble.csv"
    rows = np.column_stack([0.02 * np.arange(len(samples)), samples.field])
    np.savetxt(path, rows, fmt=("%.2f", "%.4f", "%.4f", "%.4f"), delimiter=",", header=HEADER, comments="")
    return path


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The source of axe-core, as web/package-lock.json has it."""
    installed = WEB / "node_modules" / "axe-core"
    lock = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))["packages"]["node_modules/axe-core"]
    if not installed.exists():
        installed = _fetched(tmp_path_factory.mktemp("axe"), lock)
    assert json.loads((installed / "package.json").read_text(encoding="utf-8"))["version"] == lock["version"]
    return (installed / "axe.min.js").read_text(encoding="utf-8")


def _fetched(folder: Path, lock: dict[str, Any]) -> Path:
    """Let npm fetch the one package, held to its content."""
    npm = shutil.which("npm")
    if npm is None:
        missing("axe-core is not in web/node_modules, and there is no npm to fetch it")
    package = {"name": "accessibility", "private": True, "dependencies": {"axe-core": lock["version"]}}
    packages = {"": package, "node_modules/axe-core": {**lock, "dev": False}}
    (folder / "package.json").write_text(json.dumps(package), encoding="utf-8")
    (folder / "package-lock.json").write_text(
        json.dumps({**package, "lockfileVersion": 3, "requires": True, "packages": packages}), encoding="utf-8"
    )
    try:
        done = subprocess.run(
            [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"],
            cwd=folder, capture_output=True, text=True, timeout=NPM_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        missing(f"npm did not fetch axe-core within {NPM_S:g} s")
    if done.returncode:
        missing(f"npm could not fetch axe-core: {done.stderr.strip()[-300:]}")
    return folder / "node_modules" / "axe-core"
