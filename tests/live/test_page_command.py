"""`flinders page`: which folders it writes into, and what it says where it does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flinders.apps.live.access import CSP
from flinders.apps.live.standalone import package
from flinders.cli import main
from flinders.report.modules import asset

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("ziglang", reason="no compiler for browsers")


def run(*options: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["page", *options])
    return done.exit_code, done.output


def test_it_makes_the_folder_and_writes_an_older_page_anew(tmp_path: Path) -> None:
    out = tmp_path / "a" / "b"
    code, printed = run("--output", str(out), "--json")
    assert code == 0, printed
    files = json.loads(printed)["files"]
    assert sorted(map(str, (path for path in out.rglob("*") if path.is_file()))) == sorted(files)
    (out / "static" / "worker.js").write_text("an older one", encoding="utf-8")
    code, printed = run("--output", str(out))
    assert code == 0, printed
    assert "an older one" not in (out / "static" / "worker.js").read_text(encoding="utf-8")


def test_other_files_are_left_alone_unless_that_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("my own page", encoding="utf-8")
    (tmp_path / "page.json").write_text("5", encoding="utf-8")
    code, printed = run("--output", str(tmp_path))
    assert code == 6
    assert "has other files" in printed
    assert "--force" in printed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "page.json"]
    code, printed = run("--output", str(tmp_path), "--force")
    assert code == 0, printed
    assert "Flinders" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "page").write_text("", encoding="utf-8")
    code, printed = run("--output", str(tmp_path / "page"))
    assert code == 6
    assert "Traceback" not in printed


def test_a_version_of_other_files_has_another_name() -> None:
    files = package.contents()
    other = {**files, "page.json": b"{}"}
    assert package.service_worker(files) == package.service_worker(dict(reversed(files.items())))
    assert package.service_worker(files) != package.service_worker(other)


def test_the_policy_of_the_live_page_is_stated_in_its_file_and_sent_with_it() -> None:
    stated = asset("apps/live/static/index.html").partition('Content-Security-Policy" content="')[2].partition('"')[0]
    assert stated == CSP.removesuffix("; frame-ancestors 'none'")
    assert "unsafe-" not in stated.replace("wasm-unsafe-eval", "")


def test_its_data_are_the_same_bytes_in_every_process() -> None:
    """Sets have another order in each; a service worker takes other bytes for another page."""
    written = "import sys; from flinders.apps.live.standalone import package; print(package.page_data())"
    told = {
        subprocess.run(
            [sys.executable, "-c", written], env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in ("1", "2")
    }
    assert len(told) == 1
