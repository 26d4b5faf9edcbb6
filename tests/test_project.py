"""The project agrees with itself: one version, one set of commands, light imports, no foreign hosts."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import flinders

ROOT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PINS = (ROOT / "requirements-dev.txt").read_text(encoding="utf-8")
MAIN_COMMAND = "python3 -m venv .venv && .venv/bin/pip install -q '.[live]' && .venv/bin/flinders demo"
TEST_COMMAND = "python3 -m venv .uv && .uv/bin/pip install -q uv && .uv/bin/uv run --group test pytest"

# Sites that prose may refer to. Nobody fetches packages or data from them.
# The last ones are reserved for examples (RFC 2606 and 5737), or filled in when the program runs.
KNOWN_SITES = (
    "keepachangelog.com|semver.org|doi.org|github.com|distributed.dask.org|json-schema.org|www.w3.org|mavlink.io|ptb.de|"
    "betaflight.com|flinders-compass.github.io|pypi.org|www.contributor-covenant.org|docs.astral.sh|"
    r"localhost|127\.0\.0\.1|\[::1\]|evil\.example|192\.0\.2\.\d+|HOST|\{[^}]*\}"
)


def own_files() -> list[Path]:
    """All files that git tracks or would track."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout: nothing says which files are the project's own")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
    ).stdout.decode()
    return [path for name in listed.split("\0") if name and (path := ROOT / name).is_file()]


def python(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], check=False, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_version_is_the_same_everywhere() -> None:
    newest = re.search(r"^## \[(\d[^\]]*)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    recipe = (ROOT / "release" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    packed = re.search(r"^  version: (\S+)$", recipe, re.MULTILINE)
    assert newest
    assert cited
    assert packed
    versions = {newest[1], cited[1], packed[1], flinders.__version__, metadata.version("flinders")}
    assert versions == {PYPROJECT["project"]["version"]}


def test_no_file_names_a_host_or_a_place_on_a_machine() -> None:
    host = re.compile(rf"(?:https?|ftp)://(?!(?:{KNOWN_SITES})(?![\w.-]))")
    place = re.compile(r"(?<![\w.])/(?:work|root|home/\w+|opt/fl)/|file:///\w")
    wrong = []
    for path in own_files():
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError:
            continue
        wrong += [
            f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}"
            for number, line in enumerate(lines, 1)
            if host.search(line) or place.search(line)
        ]
    assert not wrong, "\n".join(wrong)


def test_the_address_of_the_project_is_the_same_everywhere() -> None:
    urls = PYPROJECT["project"]["urls"]
    known = (urls["Source"], urls["Documentation"].rstrip("/"))
    named = re.compile(r"https:/{2}[\w-]*(?:flinders|github\.com/[\w-]+/flinders)\b[\w.-]*(?:/flinders)?")
    files = [path for path in own_files() if path.suffix in {".cff", ".json", ".md", ".toml", ".yml", ".yaml"}]
    text = "\n".join(path.read_text(encoding="utf-8") for path in files if "golden" not in path.parts)
    assert {found for found in named.findall(text) if not found.startswith(known)} == set()


def test_a_release_pins_the_installer_as_ci_does() -> None:
    assert (ROOT / "release" / "uv.txt").read_text(encoding="utf-8") in PINS


def test_every_pin_has_its_hashes() -> None:
    pins = [entry.split("\n") for entry in PINS.replace("\\\n", "\n").strip().split("\n\n")]
    lines = [line.strip() for entry in pins for line in entry if line.strip()]
    names = [index for index, line in enumerate(lines) if not line.startswith("--hash=sha256:")]
    assert names
    for here, following in zip(names, [*names[1:], len(lines)], strict=True):
        assert re.fullmatch(r"[a-z0-9-]+==\S+(?: ; .+)?", lines[here]), lines[here]
        assert following > here + 1, f"{lines[here]} has no hash"


def package(requirement: str) -> str:
    return re.split(r"[<>=!~ ;\[]", requirement, maxsplit=1)[0].lower()


def test_every_dependency_is_pinned() -> None:
    project, groups = PYPROJECT["project"], PYPROJECT["dependency-groups"]
    lists = [project["dependencies"], *project["optional-dependencies"].values(), *groups.values()]
    asked = {package(line) for listed in lists for line in listed if isinstance(line, str)} - {"flinders"}
    missing = asked - set(re.findall(r"^([a-z0-9-]+)==", PINS, re.MULTILINE))
    assert not missing, f"renew requirements-dev.txt (see CONTRIBUTING.md): {missing}"


def test_the_first_command_installs_what_the_program_needs_and_nothing_else() -> None:
    """The library and the live page; with all that they need these are 19 packages, 72 MB."""
    assert PYPROJECT["tool"]["uv"]["default-groups"] == ["live"]
    core = {package(line) for line in PYPROJECT["project"]["dependencies"]}
    assert core == {"click", "jinja2", "msgspec", "numpy", "pygeomag", "rich"}
    page = {package(line) for line in PYPROJECT["project"]["optional-dependencies"]["live"]}
    assert page == {"h11", "segno", "starlette", "uvicorn", "websockets"}


def test_readme_has_the_two_commands_and_ci_runs_them() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for command in (MAIN_COMMAND, TEST_COMMAND):
        assert re.search(rf"^{re.escape(command)}(?:\s|$)", readme, re.MULTILINE)
        assert re.search(rf"^\s+{re.escape(command)}$", ci, re.MULTILINE)


def test_import_flinders_does_not_import_scipy() -> None:
    loaded = python("-c", "import sys, flinders; print(*sorted(sys.modules))").split()
    assert "flinders" in loaded
    assert "scipy" not in loaded


def test_help_does_not_import_numpy() -> None:
    code = "import sys, flinders.cli as cli; cli.main(['--help'], standalone_mode=False); print(*sorted(sys.modules))"
    loaded = python("-c", code).split()
    assert "flinders.cli" in loaded
    assert "numpy" not in loaded


def test_flinders_fit_is_a_function_after_every_submodule_was_imported() -> None:
    code = """
import importlib, pkgutil, flinders
for module in pkgutil.walk_packages(flinders.__path__, "flinders."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
assert callable(flinders.fit) and not hasattr(flinders.fit, "__path__"), flinders.fit
"""
    python("-c", code)
