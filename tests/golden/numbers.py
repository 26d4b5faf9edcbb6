"""Golden tables of numbers: a test makes each row in an empty folder, and compares it with a reviewed JSON file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from click.testing import CliRunner
from tests.conftest import GOLDEN
from tests.worlds import write_field

from flinders.cli import main

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import pytest

    from flinders import simulate


def flinders(line: str, *codes: int) -> str:
    """Standard output of a command line that ends with one of `codes`, by default 0."""
    ended = CliRunner().invoke(main, line.split())
    assert ended.exit_code in (codes or (0,)), ended.output
    return ended.stdout


def record(name: str, tumble: simulate.Simulated) -> None:
    write_field(name, tumble.samples.field)


def lines(name: str) -> list[str]:
    return Path(name).read_text(encoding="utf-8").splitlines()


def assert_numbers(name: str, rows: Mapping[str, Callable[[], object]], request: pytest.FixtureRequest) -> None:
    """Assert that each row makes the numbers in the table; ``pytest --regenerate`` writes the whole table again."""
    folder, table = request.getfixturevalue("tmp_path"), GOLDEN / name
    numbers = {}
    for row, make in rows.items():
        (folder / row).mkdir()
        request.getfixturevalue("monkeypatch").chdir(folder / row)
        numbers[row] = make()
    if request.config.getoption("--regenerate", default=False):
        table.write_text(json.dumps(numbers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return
    reviewed = json.loads(table.read_text(encoding="utf-8"))
    assert list(numbers) == list(reviewed)
    for row, made in numbers.items():
        assert made == reviewed[row], f"{row}: `uv run pytest --regenerate`, then review the diff"
