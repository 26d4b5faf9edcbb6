"""``flinders two-axis``: numbers of the recipe, and the method that suits an uneven turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.cli.test_completion import completed
from tests.findings.test_what_is_known import run
from tests.trials import nightly
from tests.worlds import write_field

from flinders.cli import main


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_swing_is_drawn_and_has_the_numbers_of_the_recipe() -> None:
    shown = run("simulate two-axis -o swing.csv --polar rose.svg").stdout
    assert Path("rose.svg").read_text(encoding="utf-8").count('class="point ') == 2 * 36
    recipe = run("two-axis swing.csv", 3).stdout
    for name in ("mean Hx", "mean Hy", "S11", "S12", "S21", "S22"):
        ours, theirs = (next(line for line in page.splitlines() if line.startswith(name)) for page in (shown, recipe))
        assert float(ours.split()[1 if name[0] == "S" else 2]) == pytest.approx(
            float(theirs.split()[1 if name[0] == "S" else 2]), abs=1e-5
        )


@pytest.mark.parametrize("uneven", [0.0, 0.05, 0.08, 0.2])
def test_a_turn_that_is_uneven_is_fitted_as_its_page_advises(
    uneven: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    share, rng = np.arange(400) / 400, np.random.default_rng(4)
    angle = 2 * np.pi * share + uneven * np.sin(2 * np.pi * share)
    field = np.column_stack([12 + 20 * np.cos(angle), 19 * np.sin(angle) - 9, np.full(400, 38.0)])
    write_field("turn.csv", field + rng.normal(scale=0.2, size=field.shape))
    shown = CliRunner().invoke(main, ["two-axis", "turn.csv"]).output
    assert "use --method ellipse" not in " ".join(shown.split())
    assert ("ellipse xy" in shown) == (uneven > 0.0)
    asked = " ".join(CliRunner().invoke(main, ["two-axis", "turn.csv", "--method", "two-axis"]).output.split())
    assert ("use --method ellipse" in asked) == (uneven > 0.0)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("flinders compa", ["plain,compare", "plain,compare-methods"]),
        nightly("flinders two-axis --method ell", ["plain,ellipse"]),
    ],
)
def test_a_shell_completes(words: str, expected: list[str]) -> None:
    assert completed(words) == expected
