"""The inspection of the wheels of a release: what it says of libraries that are not as they have to be."""

from __future__ import annotations

import json
import re
import shutil
import sys
import tomllib
import zipfile
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import pytest
from release import wheels
from tests.sentences import assert_sentences

from flinders.native import build
from flinders.native.engine import engine

if TYPE_CHECKING:
    from pathlib import Path

FUNCTIONS = wheels.declared_functions()
EXPORTS = tuple(sorted(FUNCTIONS))
GOOD = {
    "manylinux_2_17_x86_64": wheels.Library("ELF", "X86_64", EXPORTS, ("libm.so.6", "libc.so.6"), (2, 17)),
    "manylinux_2_17_aarch64": wheels.Library("ELF", "AARCH64", EXPORTS, ("libm.so.6",), (2, 17)),
    "macosx_11_0_x86_64": wheels.Library("MACHO", "X86_64", EXPORTS, ("/usr/lib/libSystem.B.dylib",), (11, 0)),
    "macosx_11_0_arm64": wheels.Library("MACHO", "ARM64", EXPORTS, ("/usr/lib/libSystem.B.dylib",), (11, 0), True),
    "win_amd64": wheels.Library("PE", "AMD64", EXPORTS, ("KERNEL32.dll", "api-ms-win-crt-math-l1-1-0.dll")),
}


def said(tag: str, **changes: Any) -> str:
    return "; ".join(wheels.problems(replace(GOOD[tag], **changes), build.PLATFORMS[tag], FUNCTIONS))


def test_the_functions_of_the_header_are_those_of_the_library() -> None:
    header = (build.SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8")
    assert len(FUNCTIONS) == len(re.findall("^FLINDERS_API ", header, re.MULTILINE)) > 20
    assert all(hasattr(engine()._library, name) for name in FUNCTIONS)


def test_good_libraries_pass() -> None:
    assert GOOD.keys() == build.PLATFORMS.keys() == wheels.platforms().keys()
    assert {tag: said(tag) for tag in GOOD} == dict.fromkeys(GOOD, "")


@pytest.mark.parametrize(
    ("tag", "changes"),
    [
        ("manylinux_2_17_aarch64", {"machine": "X86_64"}),
        ("win_amd64", {"format": "ELF"}),
        ("manylinux_2_17_x86_64", {"system": (2, 29)}),
        ("manylinux_2_17_x86_64", {"libraries": ("libgcc_s.so.1",)}),
        ("win_amd64", {"libraries": ("VCRUNTIME140.dll",)}),
        ("win_amd64", {"exports": (*EXPORTS, "fl_start")}),
        ("win_amd64", {"exports": EXPORTS[1:]}),
        ("macosx_11_0_x86_64", {"system": (14, 0)}),
        ("macosx_11_0_arm64", {"is_signed": False}),
    ],
)
def test_a_library_that_is_not_as_it_has_to_be_is_named(tag: str, changes: dict[str, Any]) -> None:
    assert_sentences(said(tag, **changes))


def test_a_wheel_has_one_library_and_the_licences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wheels, "read_library", lambda _: GOOD["win_amd64"])
    path = tmp_path / "flinders-1-py3-none-win_amd64.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        for name in ("a.dll", "a.wasm", "LICENSE-zig", "LICENSE-wasi-libc", "LICENSE-musl", "LICENSE-mingw-w64"):
            wheel.writestr(f"flinders/native/compiled/{name}", "")
    assert wheels.inspect_wheel(path, "win_amd64", build.PLATFORMS["win_amd64"]) == []
    with zipfile.ZipFile(path, "w") as wheel:
        for name in ("a.dll", "b.dll", "LICENSE-zig", "LICENSE-wasi-libc", "LICENSE-musl"):
            wheel.writestr(f"flinders/native/compiled/{name}", "")
    assert_sentences(wheels.inspect_wheel(path, "win_arm64", build.PLATFORMS["win_amd64"]))


def test_the_headers_of_a_library_are_read(tmp_path: Path) -> None:
    pytest.importorskip("lief", reason="`uv run --with lief pytest tests/test_release.py` reads a library's headers")
    library = wheels.read_library(build.library())
    assert library.exports == EXPORTS
    assert "libm.so.6" in library.libraries or sys.platform != "linux"


@pytest.mark.skipif(
    shutil.which("uv") is None or not (wheels.ROOT / "uv.lock").exists(), reason="uv writes it, of what it has resolved"
)
def test_the_bill_of_materials_names_every_dependency_with_its_hashes(tmp_path: Path) -> None:
    wheels.write_bill_of_materials(tmp_path)
    bill = json.loads((tmp_path / "flinders.cdx.json").read_text(encoding="utf-8"))
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    assert bill["metadata"]["component"]["name"] == "flinders"
    parts = bill["components"]
    project = tomllib.loads((wheels.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = {name_of(each) for each in chain(project["dependencies"], *project["optional-dependencies"].values())}
    assert asked - {"flinders"} <= {part["name"] for part in parts}
    assert not {"pytest", "ruff", "mypy"} & {part["name"] for part in parts}
    hashes = [file["hashes"][0]["alg"] for part in parts for file in part["externalReferences"]]
    assert set(hashes) == {"SHA-256"}
    assert len(hashes) >= len(parts)


def name_of(dependency: str) -> str:
    """The name in ``pyarrow>=16; python_version > '3'``."""
    return re.split(r"[^\w-]", dependency, maxsplit=1)[0].lower()
