"""Modules of the page, run by Node.js: a program gets data as JSON, and returns JSON."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import playwright

RUN_S: Final = 60.0


def node() -> str:
    """Path of Node.js: of the system, or else the one that Playwright installs."""
    return shutil.which("node") or str(Path(playwright.__file__).parent / "driver" / "node")


def modules() -> str:
    """Address of the folder ``standalone`` of the page."""
    return str(files("flinders.apps.live").joinpath("static", "standalone"))


def run(program: str, given: object) -> Any:  # noqa: ANN401 - as JSON
    """Run a program that may import from the folder ``standalone``.

    Parameters
    ----------
    program : str
        Body of a function of `given` and `load(name)`, which imports a module.
    given : object
        Data for JSON; bytes must be written in base64.
    """
    source = f"""
import {{ readFileSync }} from "node:fs";
import {{ pathToFileURL }} from "node:url";
const given = JSON.parse(readFileSync(0, "utf-8"));
const load = (name) => import(pathToFileURL({json.dumps(f"{modules()}/")} + name));
const result = await (async () => {{ {program} }})();
process.stdout.write(JSON.stringify(result));
"""
    done = subprocess.run(
        [node(), "--input-type=module", "--eval", source], input=json.dumps(given), capture_output=True, text=True,
        encoding="utf-8", timeout=RUN_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
