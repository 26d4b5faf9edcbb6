"""The program in C of docs/engine.md compiles without a warning, and says what `flinders.fit` says."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.findings import first_causes
from flinders.findings.catalogue import CATALOGUE
from flinders.heading.guidance import guide
from flinders.native import build

if TYPE_CHECKING:
    from flinders.arrays import Floats

pytestmark = pytest.mark.skipif(build.system_compiler() is None, reason="no C compiler")

PAGE: Final = (Path(__file__).parents[2] / "docs" / "engine.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, library = tmp_path_factory.mktemp("engine"), build.library()
    (source,) = re.findall(r"^```c\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (folder / "calibrate.c").write_text(source, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{build.SOURCE_FOLDER}", f"-Wl,-rpath,{library.parent}"]
    command = [*build.compiler(), *flags, "calibrate.c", str(library), "-lm", "-o", "calibrate"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "calibrate"


def printed(program: Path, field: Floats) -> str:
    text = "".join(f"{x:.4f},{y:.4f},{z:.4f}\n" for x, y, z in field.tolist())
    return subprocess.run([str(program)], input=text, capture_output=True, text=True, check=False).stdout


@pytest.mark.parametrize(
    "world",
    [
        {"seed": 1, "n": 600},
        {"seed": 2, "motion": "tilted"},
        {"seed": 3, "n": 800, "motion": "hemisphere", "outliers": 0.03},
    ],
    ids=["all around", "tilted", "outliers"],
)
def test_it_says_what_python_says(program: Path, world: dict[str, object]) -> None:
    field = np.round(simulate.tumble(**world).samples.field, 4)  # type: ignore[arg-type]
    fit = flinders.fit(field, unit="uT")
    verdict, *findings, turn = printed(program, field).splitlines()
    assert (verdict.split(":")[0], f"{fit.heading_error_deg.worst:.3f} degrees" in verdict) == (fit.verdict, True)
    assert_sentences(verdict)
    assert [line.partition(": ")[0] for line in findings] == [each.code for each in first_causes(fit.findings)]
    for line in findings:
        code, _, action = line.partition(": ")
        row = CATALOGUE[code]
        assert action[:12] == (row.fleet_action or row.action)[:12]
    advice = guide(
        fit.calibration.ellipsoid,
        fit.claim.covariance,
        noise=fit.evidence.noise,
        coverage=fit.evidence.coverage,
        dip_deg=fit.claim.known_dip_deg,
    )
    assert float(turn.split()[-2]) == pytest.approx(advice.after_deg, rel=0.02)


def test_the_page_shows_what_it_prints(program: Path) -> None:
    field = simulate.tumble(seed=2, motion="tilted").samples.field
    (shown,) = re.findall(r"^```text\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert printed(program, field) == shown


def test_too_few_readings_are_refused_in_words(program: Path) -> None:
    assert_sentences(printed(program, np.ones((3, 3))))
