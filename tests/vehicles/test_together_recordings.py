"""What three compasses of one real flight make of each other: measured once, and held to that.

`python -m benchmarks.together --tables real` prints it. No truth is known; the calibration that ArduPilot had on board
for the external compass is the nearest to one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest

from flinders import open_log
from flinders.comparison.multi_sensor import fit_multi
from flinders.fitting.result import Fit, Refused

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.comparison.members import Member, MultiFit

ONBOARD_UT: Final = np.array([9.77916, -11.811, -21.318])
"""−COMPASS_OFS of the external compass, as the log has it: what its readings are about."""


@pytest.fixture(scope="module")
def flight(recordings: Callable[[str], Path]) -> MultiFit:
    log = open_log(recordings("dronekit_log171_3mags/log171.bin"))
    return fit_multi({each.name: each for each in log.instruments})


def fit_of(member: Member) -> Fit:
    found = member.fit.fit if isinstance(member.fit, Refused) else member.fit
    assert isinstance(found, Fit)
    return found


def test_the_compasses_inside_sit_as_the_one_outside_and_hear_the_current(flight: MultiFit) -> None:
    outside, *inside = flight.members
    found = fit_of(outside)
    assert found.heading_error_deg.worst < 1.0
    assert [one.code for one in found.findings if one.severity == "limits"] == ["disturbance-unmodelled"]
    for member in inside:
        assert member.axes == "x,y,z"
        assert member.misalignment_deg < 10.0
        assert member.scatter_deg > 10.0 * outside.scatter_deg
        assert "sensor-deviates-throughout" in {finding.code for finding in member.findings}


def test_each_is_known_better_than_by_itself(flight: MultiFit) -> None:
    for member in flight.members:
        alone = member.alone.fit if isinstance(member.alone, Refused) else member.alone
        assert isinstance(alone, Fit)
        assert fit_of(member).heading_error_deg.worst < 0.8 * alone.heading_error_deg.worst


def test_the_offset_of_the_external_one_is_near_that_on_board(flight: MultiFit) -> None:
    npt.assert_allclose(fit_of(flight["MAG"]).calibration.offset, ONBOARD_UT, atol=2.5)


def test_clocks_of_one_log_agree(flight: MultiFit) -> None:
    assert [member.delay_s for member in flight.members] == [0.0, 0.0, 0.0]
