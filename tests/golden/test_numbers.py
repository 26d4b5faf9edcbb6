"""Numbers that the program writes, in one reviewed table: ``tests/golden/files/numbers.json``.

A row is a JSON document or the lines of a CSV file, rounded where machines differ. `ROWS` says what makes each.
``pytest --regenerate tests/golden/test_numbers.py`` writes the whole table anew.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from click.testing import CliRunner
from tests.conftest import GOLDEN
from tests.golden.sessions import rounded
from tests.worlds import table_text

from flinders import simulate
from flinders.apps.marine.deviation import fit
from flinders.apps.marine.swing_pages import card
from flinders.cli import main
from flinders.geometry.angles import folded

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

TABLE: Final = GOLDEN / "numbers.json"
DECIMAL: Final = re.compile(r"-?\d+\.\d+(e-?\d+)?")
EVERYTHING: Final = (
    "simulate three-axis -o rough.csv --motion flight --readings 60 --rate 10 --tilt 20 --noise 0.3 --resolution 0.15 "
    "--saturation 90 --outliers 0.1 --stationary 0.2 --motor 0.2 --drift 0.1 --step 3 --magnet 100 "
    "--gyro-bias 0.01,0,-0.02 --soft-iron 0.1 --hard-iron 40 --field-strength 48 --dip 65 --seed 3"
)
"""A recording with every disturbance that can be simulated."""


def flinders(line: str, *codes: int) -> str:
    """Standard output of a command line that ends with one of `codes`, 0 where none is given."""
    ended = CliRunner().invoke(main, line.split())
    assert ended.exit_code in (codes or (0,)), ended.output
    return ended.stdout


def record(name: str, tumble: simulate.Simulated) -> None:
    text = table_text("mag_x_uT,mag_y_uT,mag_z_uT", tumble.samples.field)
    Path(name).write_text(text, encoding="utf-8")


def lines(name: str) -> list[str]:
    return Path(name).read_text(encoding="utf-8").splitlines()


def demo() -> object:
    return rounded(json.loads(flinders("demo --json", 0, 3)))


def comparison() -> object:
    sensor = simulate.tumble(seed=2, motion="uniform").sensor
    for name, seed in (("monday", 3), ("tuesday", 4)):
        record(f"{name}.csv", simulate.tumble(seed=seed, motion="uniform", sensor=sensor))
        flinders(f"calibrate {name}.csv -o {name}.json", 0, 3)
    return rounded(json.loads(flinders("compare monday.json tuesday.json --json", 0, 4)))


def evaluation() -> object:
    """Names of the numbers; `test_evaluation` asks for what they are."""
    flinders("simulate three-axis -o tumble.csv --seed 7")
    flinders("calibrate tumble.csv -o calibration.json", 0, 3)
    return list(json.loads(flinders("evaluate calibration.json tumble.truth.json --json")))


def recording() -> object:
    flinders(EVERYTHING)
    return lines("rough.csv")


def truth() -> object:
    flinders(EVERYTHING)
    found = json.loads(Path("rough.truth.json").read_text(encoding="utf-8"))
    return rounded({**found, "version": "1.2.3"})


def swing() -> object:
    flinders("simulate two-axis -o swing.csv")
    return lines("swing.csv")


def rose() -> object:
    flinders("simulate two-axis -o swing.csv --polar rose.csv")
    return lines("rose.csv")


def deviation_card() -> object:
    around = np.arange(0.0, 360.0, 30.0)
    return card(fit(around, folded(2.0 * np.sin(np.deg2rad(around)) - 1.0), sigma_deg=0.5), 45.0).splitlines()


def convergence() -> object:
    """Every seventh step and the last, to four digits."""
    record("tumble.csv", simulate.tumble(seed=2, motion="hand", n=1000))
    flinders("calibrate tumble.csv --method ekf --convergence steps.csv")
    header, *steps = (DECIMAL.sub(lambda number: f"{float(number[0]):.4g}", line) for line in lines("steps.csv"))
    return [header, *steps[::7], steps[-1]]


ROWS: Final[dict[str, Callable[[], object]]] = {
    "demo --json": demo,
    "compare --json": comparison,
    "evaluate --json, names": evaluation,
    "simulate three-axis, recording": recording,
    "simulate three-axis, truth": truth,
    "simulate two-axis, recording": swing,
    "simulate two-axis, rose": rose,
    "swing, card": deviation_card,
    "calibrate --convergence, ekf": convergence,
}


def test_numbers_are_those_of_the_table(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers = {}
    for name, row in ROWS.items():
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        numbers[name] = row()
    if request.config.getoption("--regenerate", default=False):
        TABLE.write_text(json.dumps(numbers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return
    reviewed = json.loads(TABLE.read_text(encoding="utf-8"))
    assert list(numbers) == list(reviewed)
    for name, made in numbers.items():
        assert made == reviewed[name], f"{name}: `uv run pytest --regenerate`, then review the diff"
