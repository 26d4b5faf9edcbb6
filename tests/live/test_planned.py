"""The table of plans that the page without a program has, and the answer of the program."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.live.test_live_server import OWN, running
from tests.sentences import assert_sentences
from tests.trials import daily

from flinders.apps.live.planned import NOISES_UT, bodies_data, planned_recording, planned_table
from flinders.simulate.bodies import BODIES

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.apps.live.planned import PlannedRecording


def test_the_table_has_each_body_at_each_noise() -> None:
    assert [(row.body, row.noise) for row in planned_table()] == [
        (body, noise) for body in BODIES for noise in NOISES_UT
    ]
    assert [name for name, _ in bodies_data()] == list(BODIES)


@pytest.mark.parametrize("row", daily(planned_table()))
def test_the_table_is_what_would_be_planned(row: PlannedRecording) -> None:
    """If not: ``python -m flinders.apps.live.planned``."""
    assert planned_recording(row.body, row.noise) == row


def test_the_program_answers_a_page(tmp_path: Path) -> None:
    with running(tmp_path) as bench:
        planned = bench.client.get("/plan", params={"body": "robot", "noise": "0.5"}, headers=OWN)
        refused = bench.client.get("/plan", params={"body": "robot", "noise": "-1"}, headers=OWN)
    assert_sentences(planned.json()["steps"])
    assert (refused.status_code, "above 0" in refused.json()["words"]) == (400, True)
