"""Which way up a sensor is used is told by a recording that leans as a vehicle's does, and by no other."""

from __future__ import annotations

import numpy as np
import pytest
from tests.worlds import judged

from flinders import simulate
from flinders.core.samples import Samples
from flinders.heading.error_propagation import level_error
from flinders.native.engine import engine
from flinders.summary.coverage import Coverage


@pytest.mark.parametrize(("seed", "readings"), [(6, 200), (17, 350)])
def test_the_first_seconds_of_a_tumble_claim_the_worse_of_both_ways_up(seed: int, readings: int) -> None:
    """They lean by chance; claimed for the side that they lean to, the error was up to seven times as large."""
    tumble = simulate.tumble(seed=seed, motion="hand")
    fit = judged(tumble.samples[:readings])
    both = [level_error(fit.calibration.ellipsoid, fit.claim.covariance, dip_deg=dip).worst for dip in (60.0, -60.0)]
    assert max(both) > 1.5 * min(both)
    assert fit.heading_error_deg.worst == pytest.approx(max(both), rel=0.01)


@pytest.mark.parametrize(("motion", "dip"), [("tilted", 60.0), ("level", 60.0), ("flight", 60.0), ("hemisphere", 60.0)])
def test_a_vehicle_shows_which_way_up_it_is(motion: str, dip: float) -> None:
    samples = simulate.tumble(seed=1, motion=motion).samples
    assert judged(samples).heading_error_deg.dip_deg == dip
    overturned = Samples.of(samples.field * [1.0, -1.0, -1.0], unit="uT")
    if motion != "level":  # a turn of one plane rests on the dip that is given
        assert judged(overturned).heading_error_deg.dip_deg == -dip


def test_all_directions_leave_the_sign_as_it_was_given() -> None:
    directions = simulate.fibonacci(1000)
    for part, dip in ((directions, 60.0), (directions[directions[:, 2] < 0.9 * np.cos(directions[:, 0])], -70.0)):
        assert engine().signed_dip(Coverage.of(part).counts, dip) == (dip, False)


@pytest.mark.parametrize(("top", "expected"), [(1.0, (60.0, False)), (0.2, (-60.0, True)), (-0.5, (-60.0, False))])
def test_directions_that_lean_by_little_leave_the_sign_open(top: float, expected: tuple[float, bool]) -> None:
    directions = simulate.fibonacci(400)
    assert engine().signed_dip(Coverage.of(directions[directions[:, 2] < top]).counts, 60.0) == expected
