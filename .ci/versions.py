"""Tests the installed package with one version of Python and of NumPy: ``PYTHON .ci/versions.py``.

    PYTHON .ci/versions.py [--wheel FILE] [--numpy 2.0.0] [--pins FILE] [TESTS...]

The interpreter that runs this file is the one that is tested, on any system. It installs the wheel, or a build of
the checkout, into an environment of its own, and runs the demo and the tests of engine, readers and commands; with
`--smoke` it runs the demo alone, with the packages of the core. If `uv` is on the path, it installs with `uv`, else
with pip.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TESTS = ["tests/agreement", "tests/readers", "tests/cli"]
NOT_NEEDED = ("editables", "hatchling", "playwright", "uv", "ziglang", "flinders")
"""Packages of the test group that this check leaves out: they build the package or drive a browser."""


def run(*words: str | Path) -> None:
    """Run a program, and end with its exit code if it fails."""
    ended = subprocess.run(list(map(str, words)), cwd=ROOT, check=False)
    if ended.returncode:
        sys.exit(f"{words[0]} ended with {ended.returncode}")


def packages(numpy: str, *, smoke: bool) -> list[str]:
    """Packages besides Flinders itself."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tests = [line for line in project["dependency-groups"]["test"] if not line.startswith(NOT_NEEDED)]
    return [*([] if smoke else tests), *([f"numpy=={numpy}"] if numpy else [])]


def main() -> None:
    """Install, and test."""
    parser = argparse.ArgumentParser(description="Tests the installed package with this version of Python.")
    parser.add_argument("--wheel", type=Path, default=ROOT)
    parser.add_argument("--numpy", default="", help="its version, by default the newest")
    parser.add_argument("--pins", type=Path, help="versions of the other packages")
    parser.add_argument("--smoke", action="store_true")
    parser.add_argument("tests", nargs="*", default=TESTS)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        has_uv = shutil.which("uv") is not None
        environment = Path(folder) / "environment"
        run(sys.executable, "-m", "venv", *(["--without-pip"] if has_uv else []), environment)
        scripts = sysconfig.get_path("scripts", "venv", {"base": str(environment)})
        python = Path(scripts) / ("python.exe" if os.name == "nt" else "python")
        installer = (
            ["uv", "pip", "install", "--python", str(python)] if has_uv else [str(python), "-m", "pip", "install"]
        )
        pins = ["--constraint", asked.pins] if asked.pins else []
        extra = "" if asked.smoke else "[all]"
        run(
            *installer,
            "--quiet",
            *pins,
            f"flinders{extra} @ {asked.wheel.resolve().as_uri()}",
            *packages(asked.numpy, smoke=asked.smoke),
        )
        run(python, "-c", "import numpy, sys; print(f'Python {sys.version.split()[0]}, NumPy {numpy.__version__}')")
        run(python, "-m", "flinders", "demo", "--json")
        if not asked.smoke:
            run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *asked.tests)


if __name__ == "__main__":
    main()
