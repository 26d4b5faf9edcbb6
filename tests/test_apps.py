"""A package for one trade can be taken out: the library and its neighbours do without it."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Final

import pytest
from tests.sentences import assert_raises
from tests.trials import daily

import flinders
from flinders import estimators, readers, targets
from flinders.cli._commands import HEADINGS, ROWS
from flinders.core import plugins
from flinders.core.plugins import app_rows, apps
from flinders.errors import UsageError
from flinders.readers._asked_columns import parse_columns

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from types import ModuleType


def modules(package: ModuleType) -> list[str]:
    """Names of the public modules of a package."""
    return [module.name for module in iter_modules(package.__path__) if not module.name.startswith("_")]


SOURCE: Final = Path(__file__).resolve().parents[1] / "src" / "flinders"
REGISTRY: Final = {
    "cli/_commands.py", "core/lazy.py", "core/plugins.py", "estimators/__init__.py", "links/feeds.py",
    "readers/__init__.py", "readers/_courses.py", "readers/_known_texts.py", "targets/__init__.py",
}  # fmt: skip
"""Modules that import others of this library by name: tables, whose rows are modules."""
TESTS: Final = Path(__file__).parent
LIBRARY_TESTS: Final = sorted(
    {path.parent.relative_to(TESTS).parts[0] for path in TESTS.glob("*/**/test_*.py")} - {*apps(), "browser"}
)
"""Folders with tests of the library: all but those of packages, and `browser`, which covers several of them."""
USES: Final = {
    "board": "from flinders.apps.board.package import contents; assert contents()",
    "classic": "assert len(flinders.compare_methods(flinders.simulate.tumble(seed=1, n=300).samples).entries) > 10",
    "fleet": "assert flinders.fit_many({'A17': tumble}).verdict.tolist() == ['good']",
    "live": "assert flinders.Session(unit='uT').add(tumble.field, time=tumble.time).verdict == 'good'",
    "marine": (
        "columns = dict.fromkeys(('compass', 'magnetic'), 45.0 * numpy.arange(8)); "
        "assert flinders.swing(flinders.marine.SwingTable('', columns, ())).verdict == 'good'"
    ),
    "service": (
        "from flinders.apps.service import sources, watching; "
        "assert watching.Watch(sources.of_recordings([tumble])).run().verdict == 'good'"
    ),
    "survey": "assert flinders.fit_survey(flinders.survey.survey_shots(seed=3, shots=24).shots).verdict",
    "vehicles": "assert 'COMPASS_OFS_X' in flinders.export(fit, 'ardupilot').text",
}
"""What a user of each package does first."""
LIBRARY: Final = """
import pkgutil, importlib, numpy, flinders
for module in pkgutil.walk_packages(flinders.__path__, "flinders."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
tumble = flinders.simulate.tumble(seed=1).samples
fit = flinders.fit(tumble)
assert fit.verdict == "good"
from flinders.report.html import page
assert 'id="scene"' in page(fit, tumble)
from flinders.targets import registry
for name in registry():
    try:
        flinders.export(fit, name)
    except flinders.FlindersError:
        pass
from click.testing import CliRunner
from flinders.cli import main
for words in ([], *([name] for name in main.commands)):
    shown = CliRunner().invoke(main, [*words, "--help"])
    assert shown.exit_code == 0, (words, shown.output)
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A copy of the library, out of which packages are taken one after the other."""
    folder = tmp_path_factory.mktemp("copy")
    half_written = shutil.ignore_patterns("*.pyc.*")
    shutil.copytree(SOURCE, folder / "flinders", ignore=half_written)  # with what each case would compile anew
    yield folder
    shutil.rmtree(folder)


@pytest.mark.parametrize("gone", daily([(each,) for each in (apps(), *((app,) for app in apps()))], 3), ids="-".join)
def test_what_is_left_works(gone: tuple[str, ...], library: Path, tmp_path: Path) -> None:
    packages = library / "flinders" / "apps"
    for app in gone:
        (packages / app).rename(tmp_path / app)
    try:
        uses = "\n".join(USES[app] for app in apps() if app not in gone)
        script = f"{LIBRARY}\nassert flinders.__file__.startswith({str(library)!r})\n{uses}\n"
        environment = {**os.environ, "PYTHONPATH": str(library)}
        ended = subprocess.run(
            [sys.executable, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
    finally:
        for app in gone:
            (tmp_path / app).rename(packages / app)


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder with the library alone, without any package."""
    shutil.copytree(SOURCE, tmp_path / "flinders", ignore=shutil.ignore_patterns("__pycache__"))
    for app in apps():
        shutil.rmtree(tmp_path / "flinders" / "apps" / app)
    return tmp_path


def assert_pytest_passes(words: Sequence[str], library: Path, folder: Path) -> None:
    """Run pytest in a folder, with another copy of the library."""
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words],
        env={**os.environ, "PYTHONPATH": str(library)}, cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout[-4000:]


@pytest.mark.nightly
def test_examples_of_the_library_need_no_package(bare: Path) -> None:
    words = [
        "-c", os.devnull, "--import-mode=importlib", "--doctest-modules",
        "-o", "doctest_optionflags=ELLIPSIS NORMALIZE_WHITESPACE NUMBER", "flinders",
    ]  # fmt: skip
    assert_pytest_passes(words, bare, bare)


@pytest.mark.nightly
def test_tests_of_the_library_need_no_package(bare: Path) -> None:
    assert_pytest_passes([f"tests/{name}" for name in LIBRARY_TESTS], bare, TESTS.parent)


def test_tests_of_the_library_import_no_package() -> None:
    """Neither a package of `flinders.apps`, nor its tests."""
    packages = tuple(f"{parent}.{app}" for parent in ("flinders.apps", "flinders", "tests") for app in apps())
    found = [
        f"{path.relative_to(TESTS)}: {name}"
        for folder in LIBRARY_TESTS
        for path in sorted((TESTS / folder).rglob("*.py"))
        for name in imported(ast.parse(path.read_text(encoding="utf-8")))
        if name.startswith(packages)
    ]
    assert found == []


def imported(tree: ast.Module) -> Iterator[str]:
    """Full names of the modules that a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("app", apps())
def test_no_module_hides_a_public_name(app: str) -> None:
    """An imported module is an attribute of its package, and would stand where a function of its name is."""
    public = getattr(import_module(f"flinders.apps.{app}"), "PUBLIC", {})
    hidden = {path.stem for path in (SOURCE / "apps" / app).iterdir()} & public.keys()
    assert hidden == {name for name, module in public.items() if name == module}


OWN: Final[dict[str, Collection[str]]] = {
    "PUBLIC": flinders._HOMES, "COMMANDS": ROWS, "SIMULATIONS": ("three-axis",), "READERS": modules(readers),
    "TARGETS": modules(targets), "METHODS": modules(estimators), "FEEDS": (), "PUBLISHERS": (), "COURSES": (),
    "KNOWN_TEXTS": (), "REMARKS": (), "CONTENTS": (),
}  # fmt: skip
"""Tables that packages add rows to, and keys of the library's own rows."""


def test_a_package_is_imported_as_an_attribute_and_by_its_full_name() -> None:
    """Type checkers follow both; a second name of the module would be found by neither them nor editors."""
    from flinders import board, classic, fleet, live, marine, service, survey, vehicles

    packages = (board, classic, fleet, live, marine, service, survey, vehicles)
    assert [each.__name__ for each in packages] == [f"flinders.apps.{app}" for app in apps()]
    assert find_spec("flinders.marine") is None


def test_a_command_of_a_package_is_named_where_the_package_is(monkeypatch: pytest.MonkeyPatch) -> None:
    with assert_raises(UsageError):
        parse_columns("1,2")
    monkeypatch.setattr(plugins, "app_rows", lambda _: ())
    with pytest.raises(UsageError, match=r"'4,5,6'$"):
        parse_columns("1,2")


def test_rows_name_known_tables_and_headings_and_no_key_twice() -> None:
    """Such a mistake in ``rows.py`` would take something away in silence."""
    rows = [import_module(f"flinders.apps.{app}.rows") for app in apps()]
    assert {
        name for row in rows for name, value in vars(row).items() if isinstance(value, dict) and name.isupper()
    } <= set(OWN)
    for table, own in OWN.items():
        keys = [*own, *(name for name, *_ in app_rows(table))]
        assert len(keys) == len(set(keys)), table
    assert {row[0] for table in ("COMMANDS", "SIMULATIONS") for _, _, row in app_rows(table)} <= set(HEADINGS)


def test_only_tables_import_modules_by_name() -> None:
    """Loops and steps upwards cannot hide from the contracts of ``lint-imports``."""
    importing = {
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*.py")
        if path.name != "foreign_errors.py"  # imports packages of others, by the names that readers and targets give
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if _imports_ours(node)
    }
    assert importing == REGISTRY


def _imports_ours(node: ast.AST) -> bool:
    """Whether `import_module` is called for a module that is not named right there, or is one of this library."""
    if not isinstance(node, ast.Call):
        return False
    names = [getattr(part, "id", "") for part in (node.func, *node.args)]
    literal = node.args[0].value if node.args and isinstance(node.args[0], ast.Constant) else "flinders"
    return "import_module" in names and str(literal).startswith("flinders")
