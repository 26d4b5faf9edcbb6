"""What each target is given, to the letter, as docs/targets.md shows it; a new target adds its own golden file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.targets import registry

if TYPE_CHECKING:
    from tests.golden.sessions import Golden

    from flinders.targets import Target

ROWS = [row for row in registry().values() if row.docs == "targets.md"]


@pytest.fixture(autouse=True)
def calibrations(page_of_80_columns: None) -> None:
    """With soft iron all over, along the axes alone, and with next to none of it; in milligauss and in counts."""
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    along, hardly = np.diag([0.97, 1.05, 0.98]), np.diag([1.003, 1.0, 0.997])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(hardly, offset, 49.4, raw=Unit.of("mG")).save("round.json")
    Calibration(along, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("counts.json")
    Calibration(hardly, 10.01 * offset, 494.0, raw=Unit.of("counts")).save("round-counts.json")


def line(row: Target) -> str:
    """The command that shows a target."""
    name = "round" if row.keeps == "offset" else "calibration"
    if row.unit == "counts":
        name = "round-counts" if row.keeps == "offset" else "counts"
    command = f"flinders export --for {row.name} {name}.json"
    return f"{command} -o calibration{row.suffix}" if row.suffix == ".bin" else command


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_each_target(row: Target, golden: Golden) -> None:
    golden(f"cli/target-{row.name}.txt", session(line(row)))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("targets.md", request, least=len(ROWS))
