"""A claim from few readings is as true as one from many: Student's t for the readings that the parameters leave."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.fitting.result import Refused
from flinders.heading.error_propagation import level_turn

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

FIELD: Final = 48.0


def poses(rng: np.random.Generator, count: int) -> Floats:
    """(count, 3) directions all around, about as even as a surveyor makes them."""
    turned = simulate.fibonacci(count) @ simulate.turns(rng.standard_normal((1, 3)))[0]
    apart = turned + 0.2 * rng.standard_normal(turned.shape)
    even: Floats = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    return even


def iron(rng: np.random.Generator, method: str) -> Floats:
    """(3, 3) what a sensor makes of a field: mild soft iron, or none for a method that knows of none."""
    mixed = rng.uniform(-0.1, 0.1, (3, 3))
    return np.eye(3) if method == "sphere" else np.eye(3) + mixed + mixed.T


def ratio(seed: int, method: str, count: int) -> float:
    """True over claimed worst level heading error."""
    rng = np.random.default_rng([seed, count])
    shape, offset = iron(rng, method), rng.uniform(-50.0, 50.0, 3)
    field = FIELD * poses(rng, count) @ shape + offset + 0.2 * rng.standard_normal((count, 3))
    try:
        fit = flinders.fit(Samples.of(field, unit="uT"), method=method)
    except Refused as refusal:
        fit = refusal.fit
    heading, directions = level_turn(fit.heading_error_deg.dip_deg)
    x, y, _ = fit.calibration.matrix @ (FIELD * shape @ directions + (offset - fit.calibration.offset)[:, np.newaxis])
    off = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.degrees(np.abs(off - off.mean()).max())) / fit.heading_error_deg.worst


@pytest.mark.parametrize("method", ["auto", "consistent", "sphere"])
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
