"""What `flinders survey` prints, to the letter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import assert_sessions_are_real, session
from tests.survey.test_survey import in_counts, topodroid

from flinders.apps.survey.simulate_shots import survey_shots

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def shots(page_of_80_columns: None) -> None:
    """Shots of a DistoX as TopoDroid exports them, one of them beside an iron door."""
    simulated = in_counts(survey_shots(3, shots=24).shots)
    simulated.magnetic[13] += np.array([900.0, -700.0, 500.0])
    Path("shots.csv").write_text(topodroid(simulated), encoding="utf-8")


def test_a_calibration(golden: Golden) -> None:
    golden("cli/survey.txt", session("flinders survey shots.csv -o calibration.json --distox coefficients.bin"))


def test_a_check_of_an_earlier_one(golden: Golden) -> None:
    session("flinders survey shots.csv --distox coefficients.bin")
    golden("cli/survey-check.txt", session("flinders survey shots.csv --previous coefficients.bin"))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    assert_sessions_are_real("survey/survey.md", request, least=1)
