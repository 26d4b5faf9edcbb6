"""A guided session from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.samples import Samples


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=1).samples


def test_a_session_leads_to_a_good_calibration_before_all_readings_have_come(samples: Samples) -> None:
    session = flinders.Session(unit="uT")
    states = [session.add(block.field, time=block.time) for block in samples[:1000].blocks(rows=25)]
    done = next(state for state in states if state.is_done)
    assert done.verdict == "good"
    assert 0.4 < done.coverage < 1.0
    assert done.readings < 500
    assert (states[0].is_done, states[0].heading_error_deg > 1.0) == (False, True)
    assert states[3].turn.startswith("turn it about ")
    assert np.linalg.norm(states[3].direction or ()) == pytest.approx(1.0)
    assert session.finish().calibration == flinders.fit(samples[:1000]).calibration


def test_a_session_without_times_counts_them_by_its_rate(samples: Samples) -> None:
    timed, counted = flinders.Session(unit="uT"), flinders.Session(unit="uT", rate_hz=50.0)
    for block in samples[:400].blocks(rows=10):
        one, other = timed.add(block.field, time=block.time), counted.add(block.field)
        assert (one.words, one.turn, one.verdict) == (other.words, other.turn, other.verdict)


def test_a_session_takes_readings_in_their_unit_one_by_one(samples: Samples) -> None:
    session = flinders.Session(unit="mG", axes="x,-y,-z", target_deg=5.0)
    for reading in samples.field[:300]:
        state = session.add(10.0 * reading)
    assert state.readings == 300
    expected = flinders.fit(samples.field[:300] * 10, unit="mG", axes="x,-y,-z").calibration
    assert session.finish().calibration.isclose(expected)
    assert session.finish().calibration.axes == expected.axes


def test_a_session_says_why_there_is_no_calibration() -> None:
    session = flinders.Session()
    assert (session.state.readings, session.state.words) == (0, "")
    still = session.add([[20.0, 0.0, 45.0]] * 200)
    assert (still.verdict, still.coverage, still.turn, still.direction, still.is_done) == ("", 0.0, "", None, False)
    assert "x = 20, y = 0, z = 45" in still.words
    with pytest.raises(flinders.FitError):
        session.finish()
    with assert_raises(UsageError):
        flinders.Session(target_deg=-1.0)
    with assert_raises(UsageError):
        flinders.Session(goal="height")  # type: ignore[arg-type]
    with assert_raises(UsageError):
        flinders.Session(rate_hz=0.0)
