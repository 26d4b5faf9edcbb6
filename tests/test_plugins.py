"""The package of docs/plugins.md, installed beside Flinders, reads its files and writes for its device."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.sentences import assert_sentences

from flinders import simulate

PAGE = Path(__file__).resolve().parent.parent / "docs" / "plugins.md"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder of packages with the module of the page, and the metadata that pip makes of its pyproject.toml."""
    blocks = dict(re.findall(r"^```(python|toml)\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL))
    project = tomllib.loads(blocks["toml"])["project"]
    name, version = project["name"].replace("-", "_"), project["version"]
    metadata = tmp_path / f"{name}-{version}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n", "utf-8")
    lines: list[str] = []
    for group, entries in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{key} = {value}" for key, value in entries.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines), "utf-8")
    (tmp_path / f"{name}.py").write_text(blocks["python"], "utf-8")
    return tmp_path


def ran(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The program with the packages of a folder installed."""
    return subprocess.run(
        [sys.executable, "-m", "flinders", *words],
        cwd=site,
        env={**os.environ, "PYTHONPATH": str(site)},
        check=False,
        capture_output=True,
        encoding="utf-8",
    )


def test_a_plugin_reads_its_format_and_writes_for_its_target(site: Path) -> None:
    readings = simulate.tumble(seed=1).samples.field
    (site / "tumble.acme").write_bytes(b"ACME" + np.round(readings * 10).astype(">i2").tobytes())
    fitted = ran(site, "calibrate", "tumble.acme", "-o", "calibration.json", "--json")
    assert fitted.returncode == 0, fitted.stderr
    assert json.loads(fitted.stdout)["verdict"] == "good"
    exported = ran(site, "export", "--for", "acme", "--lossy", "calibration.json")
    assert exported.returncode == 0, exported.stderr
    numbers = [float(word) for word in exported.stdout.splitlines()[-1].split()]
    np.testing.assert_allclose(numbers[:3], json.loads(fitted.stdout)["calibration"]["offset"], atol=0.005)


def test_the_version_lists_plugins(site: Path) -> None:
    assert re.search(r"^plugins +acme-flinders 1.0$", ran(site, "--version").stdout, re.MULTILINE)


def test_a_plugin_that_cannot_be_imported_is_named(site: Path) -> None:
    (site / "acme_flinders.py").write_text("import no_such_module\n", "utf-8")
    ended = ran(site, "targets")
    assert ended.returncode == 70
    assert_sentences(ended.stderr)


def test_a_plugin_with_rows_of_another_kind_is_refused(site: Path) -> None:
    (site / "acme_flinders.py").write_text("READERS = TARGETS = ['acme']\n", "utf-8")
    assert_sentences(ran(site, "targets").stderr)


def test_a_plugin_may_not_take_the_name_of_another_target(site: Path) -> None:
    module = site / "acme_flinders.py"
    module.write_text(module.read_text("utf-8").replace('name="acme"', 'name="px4"'), "utf-8")
    assert_sentences(ran(site, "targets").stderr)
