"""A claim from few readings is as true as one from many: Student's t for the readings that the parameters leave."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.few_readings import ratio
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats


@pytest.mark.parametrize("method", ["auto", "consistent"])
@pytest.mark.parametrize("count", daily([10, 12, 15, 20, 40], 3))
def test_the_claim_of_few_readings_is_true(method: str, count: int, trials: Choose) -> None:
    """A true claim gives 1.2 in the median and 2.1 at 90 %."""
    chosen = trials(200, 12)
    ratios = [ratio(seed, method, count) for seed in chosen.seeds]
    assert np.median(ratios) < 1.4 ** (1.0 if chosen.widening == 1.0 else 2.0)
    assert np.quantile(ratios, 0.9) < 2.6 ** (1.0 if chosen.widening == 1.0 else 1.5)


@pytest.mark.parametrize("seed", [7, 8, 25, 33, 35])
def test_what_repeats_does_not_last(seed: int) -> None:
    """A log that is five times faster than its sensor: the noise of the different readings is white."""
    faster = np.repeat(simulate.tumble(seed=seed, n=300, motion="uniform").samples.field, 5, axis=0)
    assert flinders.fit(faster).verdict == "good"


def copied(field: Floats) -> Floats:
    """Ten copies of each reading, in no order."""
    return np.random.default_rng(1).permutation(np.tile(field, (10, 1)))


def judged(field: Floats) -> flinders.Fit:
    """The fit, also where it is refused."""
    try:
        return flinders.fit(Samples.of(field, unit="uT"))
    except Refused as refusal:
        return refusal.fit


def test_copies_in_no_order_claim_what_the_readings_claim(trials: Choose) -> None:
    """A place that is visited again by the same reading shows no structure."""
    for seed in trials(60, 8).seeds:
        field = simulate.tumble(seed, motion="uniform", n=500).samples.field
        alone, many = judged(field), judged(copied(field))
        assert "structure" not in {finding.code for finding in many.findings}
        assert many.heading_error_deg.worst == pytest.approx(alone.heading_error_deg.worst, rel=0.05)


def test_structure_shows_in_copies() -> None:
    recording = simulate.tumble(1, motion="uniform", n=1500)
    local = recording.samples.field - recording.sensor.offset
    x, y, z = (local / np.linalg.norm(local, axis=1)[:, np.newaxis]).T
    longer = local * (1.0 + 0.1 * x * y * z)[:, np.newaxis]
    for field in (longer, copied(longer)):
        assert "structure" in {finding.code for finding in judged(field).findings}
