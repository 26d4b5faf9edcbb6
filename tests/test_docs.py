"""Whatever a user can name is documented, and the README's example works as written."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest
from tests import key_tables
from tests.laws.test_equivariance import ROWS as EQUIVARIANCE

import flinders
from flinders.errors import FlindersError
from flinders.fitting.fit_json import json_of

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *(path for path in sorted(DOCS.rglob("*.md")) if "_build" not in path.parts)]


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def commands(group: click.Group, name: str) -> Iterator[tuple[str, click.Command]]:
    yield name, group
    for word, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def tree(error: type[FlindersError]) -> Iterator[type[FlindersError]]:
    yield error
    for child in error.__subclasses__():
        if child.__module__.startswith("flinders."):
            yield from tree(child)


def test_every_command_and_option_is_documented() -> None:
    from flinders.cli import main

    missing = []
    for name, command in commands(main, "flinders"):
        if name == "flinders":
            described = page("cli.md")
        else:
            described = page(f"cli/{name.split()[1]}.md")
            missing += [] if re.search(rf"^#+ `{name}`$", described, re.MULTILINE) else [name]
        for parameter in command.params:
            if isinstance(parameter, click.Option) and not parameter.hidden:
                spelled = [word for word in (*parameter.opts, *parameter.secondary_opts) if word.startswith("--")]
                missing += [f"{name} {word}" for word in spelled if not re.search(rf"`{word}[ =`]", described)]
    assert not missing, f"docs/cli/ does not describe {missing}"


def test_every_error_is_documented_with_its_exit_code() -> None:
    text = page("errors.md")
    rows = {error: f"| `{error.code}` | `{error.__name__}` | {error.exit_code} |" for error in tree(FlindersError)}
    missing = [row for row in rows.values() if row not in text]
    assert not missing, f"docs/errors.md lacks rows that begin {missing}"


def test_every_public_name_is_documented() -> None:
    text = page("api.md")
    missing = [name for name in dir(flinders) if f"`flinders.{name}`" not in text and not name.startswith("__")]
    assert not missing, f"docs/api.md does not name {missing}"


def test_the_sample_of_versions_has_every_optional_package() -> None:
    from flinders.cli._version import versions

    def optional(text: str) -> list[str]:
        lines = re.findall(r"^(?:optional|missing) +([^;\n]*)", text, re.MULTILINE)
        return sorted(entry.split()[0] for line in lines for entry in line.split(", "))

    assert optional(page("start/install.md")) == optional(versions())


def test_every_method_is_documented() -> None:
    from flinders.estimators import METHODS

    missing = [name for name in METHODS if f"\n**`{name}`** " not in page("methods.md")]
    assert not missing, f"docs/methods.md lacks paragraphs on {missing}"
    assert EQUIVARIANCE.keys() == METHODS.keys()


def test_every_refusal_with_plain_words_is_raised() -> None:
    from flinders.findings import REFUSALS

    raised = {error.code for error in tree(FlindersError)}
    assert {code for code, refusal in REFUSALS.items() if refusal.plain} <= raised


def test_every_public_key_stands_in_its_table(request: pytest.FixtureRequest) -> None:
    tables = key_tables.page()
    lacking = [line for line in tables.splitlines() if line.endswith("|  |")]
    assert not lacking, f"no comment in the code says what these keys mean: {lacking}"
    before, rest = page("keys.md").split("<!-- keys -->\n")
    shown, after = rest.split("<!-- end of keys -->\n")
    if request.config.getoption("--regenerate", default=False):
        text = f"{before}<!-- keys -->\n{tables}<!-- end of keys -->\n{after}"
        (DOCS / "keys.md").write_text(text, encoding="utf-8")
    else:
        assert shown == tables, "docs/keys.md: `uv run pytest --regenerate tests/test_docs.py`, then review the diff"


def test_the_table_of_a_fit_has_the_keys_that_are_printed() -> None:
    from flinders import simulate

    fit = flinders.fit(simulate.tumble(seed=1, n=400).samples)
    printed = json_of(fit)
    known = {key.name for key in key_tables.keys_of("fitting.fit_json:json_of")}
    assert printed.keys() <= known
    assert known - printed.keys() == {"aiding", "refreshed", "disturbances", "noise_uncompensated"}
    assert list(printed["coverage"]) == [key.name for key in key_tables.keys_of("summary.coverage:Coverage")]


def test_sentences_of_findings_are_for_python_the_command_line_and_pages_alike() -> None:
    from flinders.findings import CATALOGUE
    from flinders.findings.words import STEPS, Z_NOT_DOWN, Z_UNKNOWN

    sentences = [words for row in CATALOGUE.values() for words in (row.template, row.plain, row.remedy)]
    assert not [
        words for words in (*sentences, *STEPS.values(), Z_UNKNOWN, Z_NOT_DOWN) if re.search(r"--[a-z]|\w=\W", words)
    ]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_between_pages_lead_somewhere(path: Path) -> None:
    targets = re.findall(r"\]\((?!\w+:|#)([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8"))
    assert [target for target in targets if not (path.parent / target).exists()] == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_an_example_ends_before_its_fence(path: Path) -> None:
    """doctest reads Markdown as plain text and would take a fence right after an example for expected output."""
    blocks = re.findall(r"^```python\n(.*?)^```$", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert [block for block in blocks if ">>> " in block and not block.endswith("\n\n")] == []


def test_every_page_is_two_clicks_from_the_first_at_most() -> None:
    """The side bar lists the pages of the first page's tables of contents; each of these lists its own."""

    def listed(name: str) -> list[str]:
        trees = re.findall(r"^```\{toctree\}\n(?::.*\n)*\n((?:.+\n)*)```$", page(f"{name}.md"), re.MULTILINE)
        folder = posixpath.dirname(name)
        return [posixpath.join(folder, line) for tree in trees for line in tree.split()]

    first = listed("index")
    reached = {"index", *first, *(name for one in first for name in listed(one))}
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in PAGES if path.is_relative_to(DOCS)}
    assert pages - reached == set()


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 750


def test_the_readme_shows_what_the_demo_prints() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = re.findall(r"^```console\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)[0]
    printed = iter((ROOT / "tests/golden/files/cli/demo.txt").read_text(encoding="utf-8").splitlines())
    assert all(line in printed for line in shown.splitlines() if line != "…"), "lines in their order"


def test_the_example_of_the_readme_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from flinders import simulate

    rows = (",".join(f"{value:.4f}" for value in row) for row in simulate.tumble(seed=1).samples.field)
    (tmp_path / "tumble.csv").write_text("\n".join(["mx_uT,my_uT,mz_uT", *rows]) + "\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)
    scripts = [block for block in blocks if ">>> " not in block]
    assert scripts, "the README has no script in Python"
    for script in scripts:
        exec(compile(script, "README.md", "exec"), {"__name__": "readme"})
    assert (tmp_path / "calibration.json").exists()
