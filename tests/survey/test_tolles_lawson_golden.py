"""What `flinders tolles-lawson` prints, to the letter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.golden.sessions import assert_sessions_are_real, session

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def flights(page_of_80_columns: None) -> None:
    """A calibration flight of an aircraft, and one on other headings."""
    session("flinders simulate aircraft -o box.csv")
    session("flinders simulate aircraft -o lines.csv --headings 45,225 --seed 2")


def test_a_calibration_flight_and_a_survey(golden: Golden) -> None:
    fit = "flinders tolles-lawson box.csv -o coefficients.json"
    compensate = "flinders tolles-lawson lines.csv --coefficients coefficients.json -o compensated.csv"
    golden("cli/tolles-lawson.txt", session(fit, compensate))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("survey/tolles-lawson.md", request)
