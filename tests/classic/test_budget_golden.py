"""What `flinders budget` and `flinders export` print, to the letter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session

from flinders.core.calibration import Calibration
from flinders.core.units import Unit

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def calibrations() -> None:
    """A calibration that fits the registers, and one of a field strength in another unit, which does not."""
    matrix = np.array([[0.91, 0.05, 0.1], [0.05, 1.19, -0.1], [0.1, -0.1, 0.94]])
    offset = np.array([-69.8, 68.9, -5.6])
    Calibration(matrix, offset, 49.4, raw=Unit.of("mG")).save("calibration.json")
    Calibration(2 * matrix, offset, 98.8, True, raw=Unit.of("mG")).save("doubled.json")


def test_budget(golden: Golden) -> None:
    lines = (
        "flinders budget heading --field 150mG --error 1deg",
        "flinders budget wire --current 0.2A --distance 1cm",
        "flinders budget wire --current 0.2A --field 150mG --error 1deg",
        "flinders budget pair --current 10A --separation 5mm --field 20uT --error 1deg",
        "flinders budget magnet --remanence 1.3T --volume 0.236cm3 --distance 30cm --field 20uT",
    )
    golden("cli/budget.txt", session(*lines))


def test_export(golden: Golden) -> None:
    golden("cli/export.txt", session("flinders export --for adis16480 calibration.json"))


def test_export_of_what_does_not_fit(golden: Golden) -> None:
    golden("cli/export-refused.txt", session("flinders export --for adis16480 doubled.json -o registers.txt", code=4))


@pytest.mark.parametrize("name", ["classic/budget.md", "classic/registers.md"])
def test_the_sessions_in_the_docs_are_real(name: str, request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real(name, request)
