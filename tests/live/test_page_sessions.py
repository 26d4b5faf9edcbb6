"""The session of the page agrees with the program beside it: what it takes, and how far a calibration is off."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks.level import Turned
from tests.javascript import run
from tests.page_session import PageSession

import flinders
from flinders import simulate
from flinders.apps.live.buffer import CAPACITY, rows_of
from flinders.apps.live.messages import MAX_DIP_DEG, Edits, refuse_out_of_range
from flinders.comparison.comparison import compare
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.errors import UsageError
from flinders.fitting.result import with_name
from flinders.native import build

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)


def test_the_page_holds_as_many_readings_as_the_server_and_assumes_its_dip() -> None:
    rules = run('return (await load("session.js")).RULES;', None)
    assert (rules["capacity"], rules["assumed_dip_deg"]) == (CAPACITY, ASSUMED_DIP_DEG)


@pytest.mark.parametrize(
    ("command", "edits", "is_taken"),
    [
        ({"type": "target", "deg": 180.0}, Edits(target_deg=180.0), True),
        ({"type": "target", "deg": 180.1}, Edits(target_deg=180.1), False),
        ({"type": "target", "deg": 0.0}, Edits(target_deg=0.0), False),
        ({"type": "dip", "deg": -MAX_DIP_DEG}, Edits(dip_deg=-MAX_DIP_DEG), True),
        ({"type": "dip", "deg": MAX_DIP_DEG + 0.1}, Edits(dip_deg=MAX_DIP_DEG + 0.1), False),
        ({"type": "exclude", "start_s": 3.0, "end_s": 2.0}, Edits(excluded=((3.0, 2.0),)), False),
    ],
)
def test_the_page_takes_no_command_that_its_server_would_refuse(
    command: dict[str, Any], edits: Edits, is_taken: bool
) -> None:
    session = PageSession()
    notices = session.requested(1.0, **command)
    assert [notice.severity for notice in notices] == ([] if is_taken else ["error"])
    assert (session.edits == edits) == is_taken
    assert (not notices) == is_within(edits)


def is_within(edits: Edits) -> bool:
    """Whether a server takes what was done."""
    try:
        refuse_out_of_range(edits)
    except UsageError:
        return False
    return True


def test_an_earlier_calibration_is_as_far_off_as_flinders_compare_says() -> None:
    sensor = simulate.Sensor.random(np.random.default_rng(3))
    moved = sensor.offset + np.array([1.0, 2.0, -3.0])
    changed = simulate.Sensor(offset=moved, matrix=sensor.matrix @ np.diag([1.0, 1.04, 1.0]))
    tumbles = [simulate.tumble(seed=9, sensor=each).samples for each in (sensor, changed)]
    before, now = map(flinders.fit, tumbles)
    session = PageSession()
    session.arrived(60.0, rows_of(tumbles[1]))
    session.requested(60.0, "dip", deg=-35.0)
    session.got_previous(60.0, with_name(before, "old.json"))
    session.fit()
    shown, worst = session.state.previous, compare(before, now, dip_deg=-35.0).heading_difference_deg.worst
    assert shown.change_deg == pytest.approx(worst, rel=1e-6)
    assert f"{worst:.1f}" in shown.words


def test_a_session_lets_an_accelerometer_show_a_slope() -> None:
    turn, _ = Turned(slope_deg=5.0).record(1, 300)
    worst = flinders.fit(turn.samples).heading_error_deg.worst
    shown = []
    for samples in (turn.samples, replace(turn.samples, acceleration=None)):
        session = PageSession()
        session.arrived(60.0, rows_of(samples))
        session.fit()
        shown.append(session.shown.view.heading_error_deg.worst)
    assert shown[0] == pytest.approx(worst, rel=1e-6)
    assert shown[1] < 0.3
    assert worst > 1.0
