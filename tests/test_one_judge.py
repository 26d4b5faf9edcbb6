"""There is one judge: Python, many at once, the page without a program and a board give one verdict in one wording.

A limit stands in one row. Where it changes there, it changes everywhere.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from benchmarks import firmware
from benchmarks.page_verdict import case_of, thinned
from click.testing import CliRunner
from tests import bindings
from tests.bindings import Said

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Samples
from flinders.native import build

if TYPE_CHECKING:
    from collections.abc import Callable

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)
pytestmark = pytest.mark.skipif(build.system_compiler() is None, reason="no C compiler")

ROOT: Final = Path(__file__).parents[1]
ROW: Final = 'rule=Rule("hole_deg", (Grade("limits", 60.0),)),'
"""The rule of `coverage` as its row has it."""
SHARED: Final = (
    "pichim_betaflight/CalCareful_2282320.csv",
    "michaelwro_fxos8700/mag-readings.txt",
    "tomisuarez_qmc5883l/noisy_raw_data.csv",
)
"""A good recording, one whose field changed meanwhile, and one with much noise and soft iron.

Where residuals last, a board claims less or more than the library, which models slow noise."""


def as_arrived(samples: Samples) -> Samples:
    """The readings as a session has them, which the page has: with times."""
    return case_of(thinned(samples, firmware.READINGS)).samples


def with_gap(half_angle_deg: float) -> Samples:
    """A tumble without readings in a cap of the sphere."""
    tumble = simulate.tumble(seed=1, n=300)
    matrix, offset = tumble.sensor.correction
    corrected = (tumble.samples.field - offset) @ np.transpose(matrix)
    height = corrected[:, 2] / np.linalg.norm(corrected, axis=1)
    return Samples(tumble.samples.field[height < np.cos(np.radians(half_angle_deg))])


def said_by_a_copy(row: str, folder: Path, samples: Samples) -> dict[str, Said]:
    """What the bindings of a copy of the package say that has another rule of `coverage`, and is else as it was."""
    package = folder / "flinders"
    shutil.copytree(Path(flinders.__file__).parent, package, ignore=shutil.ignore_patterns("compiled", "__pycache__"))
    rows = package / "findings" / "fit.py"
    text = rows.read_text(encoding="utf-8")
    assert text.count(ROW) == 1
    rows.write_text(text.replace(ROW, row), encoding="utf-8")
    np.save(folder / "readings.npy", samples.field)
    paths = os.pathsep.join(map(str, (folder, ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths, "FLINDERS_NATIVE_BUILD": str(folder / "compiled")}
    for program in (["flinders.findings.c_tables"], ["tests.bindings", str(folder / "readings.npy")]):
        done = subprocess.run(
            [sys.executable, "-m", *program], env=environment, cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    return {name: Said(*each) for name, each in json.loads(done.stdout).items()}


def test_a_limit_that_changes_in_its_row_changes_everywhere(tmp_path: Path) -> None:
    samples = with_gap(50.0)
    before = bindings.said(samples)
    after = said_by_a_copy(ROW.replace("60.0", "40.0"), tmp_path, samples)
    assert [said.findings.get("coverage") for said in before.values()] == 4 * [None]
    assert [said.findings.get("coverage") for said in after.values()] == 4 * ["limits"]
    assert {said.verdict_among(said.checked) for said in before.values()} == {"good"}
    assert {said.verdict_among(said.checked) for said in after.values()} == {"limits"}
    assert "coverage" in after["page"].advice
    assert after["page"].advice == after["python"].advice


def agree(program: Said, other: Said) -> None:
    """Hold a binding to Python in all that it looks for."""
    assert other.among(other.checked) == other.findings
    assert other.findings == program.among(other.checked)
    assert other.verdict_among(other.checked) == program.verdict_among(other.checked)


def test_the_demo_gets_one_verdict_in_one_set_of_words() -> None:
    done = CliRunner().invoke(main, ["demo", "--json"])
    samples = simulate.tumble(seed=1).samples
    program, (page,), (many,) = bindings.python(samples), bindings.page([samples]), bindings.many([samples])
    for other in (many, page):
        agree(program, other)
    assert page.advice == program.advice
    assert [(each["code"], each["severity"]) for each in json.loads(done.stdout)["findings"]] == list(
        program.findings.items()
    )


def test_recordings_get_one_verdict_in_one_set_of_words(recordings: Callable[[str], Path]) -> None:
    demo = as_arrived(simulate.tumble(seed=1).samples)
    shared = [as_arrived(flinders.read(recordings(name))) for name in SHARED]
    each = [demo, *shared]
    pages, boards = bindings.page(each), bindings.board(each)
    manies = bindings.many([demo]) + bindings.many(shared)
    programs = [bindings.python(samples) for samples in each]
    for program, page, board, many in zip(programs, pages, boards, manies, strict=True):
        for other in (page, board, many):
            agree(program, other)
        assert page.advice == program.advice
    assert [program.verdict_among(program.checked) for program in programs] == ["good", "good", "limits", "limits"]
    assert all({"heading-error", "coverage", "noise"} <= set(board.checked) for board in boards)
