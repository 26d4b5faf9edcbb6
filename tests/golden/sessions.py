"""Shared parts of the golden tests: terminal sessions, numbers that are equal on all machines, sessions in the docs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

from click.testing import CliRunner

from flinders.cli import main

if TYPE_CHECKING:
    import pytest

Golden: TypeAlias = Callable[[str, str], None]

ROOT: Final = Path(__file__).resolve().parent.parent.parent
SHOWN: Final = re.compile(r"<!-- (tests/golden/files/cli/\S+) -->\n```console\n(.*?)```\n", re.DOTALL)


def session(*lines: str, code: int = 0) -> str:
    """Text that a terminal shows for command lines; the last one ends with `code`, those before it with 0."""
    shown = ""
    for place, line in enumerate(lines, 1):
        ended = CliRunner().invoke(main, line.split()[1:], prog_name="flinders")
        shown += f"$ {line}\n{ended.output}"
        assert ended.exit_code == (code if place == len(lines) else 0), shown
    return shown


def rounded(value: object) -> object:
    """Numbers rounded to four digits, which are equal on all machines."""
    if isinstance(value, dict):
        return {key: rounded(member) for key, member in value.items()}
    if isinstance(value, list):
        return [rounded(member) for member in value]
    return float(f"{value:.4g}") if isinstance(value, float) and math.isfinite(value) else value


def assert_sessions_are_real(page: str, request: pytest.FixtureRequest, *, least: int = 1) -> None:
    """Assert that each session in a page of the docs is that of its golden file; ``--regenerate`` renews the page."""
    path = ROOT / "docs" / page
    text = path.read_text(encoding="utf-8")

    def real(found: re.Match[str]) -> str:
        return f"<!-- {found[1]} -->\n```console\n{(ROOT / found[1]).read_text(encoding='utf-8')}```\n"

    renewed = SHOWN.sub(real, text)
    assert len(SHOWN.findall(text)) >= least
    if request.config.getoption("--regenerate", default=False):
        path.write_text(renewed, encoding="utf-8")
    else:
        assert text == renewed, f"docs/{page} shows another session than its golden files: `pytest --regenerate`"
