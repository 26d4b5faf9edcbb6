"""Axes that answer along a curve are found, by their amount, and nothing else is taken for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import daily

import flinders
from flinders import Samples
from flinders.diagnostics.systematic import nonlinearity_in
from flinders.native.engine import engine
from flinders.simulate import tumble

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

STRENGTH = 50.0


def curved(seed: int, *, quadratic: float = 0.0, cubic: float = 0.0, rows: int = 1000) -> Samples:
    """A tumble whose y axis reads too much."""
    samples = tumble(seed=seed, n=rows).samples
    field = np.array(samples.field)
    centre = engine().fit(field)["centre"]
    along = (field[:, 1] - centre[1]) / STRENGTH
    field[:, 1] += STRENGTH * (quadratic * along**2 + cubic * along**3)
    return Samples.of(field, unit="uT")


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.02, 0.0), (0.0, 0.05), (-0.015, 0.03)])
def test_the_terms_of_an_axis_are_found(quadratic: float, cubic: float) -> None:
    fit = flinders.fit(curved(3, quadratic=quadratic, cubic=cubic))
    found = fit.nonlinearity
    assert found is not None
    assert found.is_proven
    assert found.axis == "y"
    assert found.quadratic[1] == pytest.approx(quadratic, abs=0.006)
    assert found.cubic[1] == pytest.approx(cubic, abs=0.015)
    assert "nonlinear-axis" in {finding.code for finding in fit.findings}
    assert "structure" not in {finding.code for finding in fit.findings}
    assert fit.heading_error_deg.worst >= found.heading_deg


def test_the_claim_covers_what_the_axis_costs() -> None:
    """Without the terms the claim would be a tenth of the error."""
    truth, fit = flinders.fit(curved(5)), flinders.fit(curved(5, quadratic=0.02))
    turned = np.radians(np.arange(0.0, 360.0, 5.0))
    level = 50.0 * np.stack([0.5 * np.cos(turned), -0.5 * np.sin(turned), np.full(72, np.sqrt(0.75))], axis=1)
    raw = level @ np.linalg.inv(truth.calibration.matrix).T + truth.calibration.offset
    raw[:, 1] += 50.0 * 0.02 * ((raw[:, 1] - truth.calibration.offset[1]) / 50.0) ** 2
    corrected = fit.calibration.apply(raw)
    off = np.degrees(np.arctan2(-corrected[:, 1], corrected[:, 0]) - np.arctan2(-level[:, 1], level[:, 0]))
    off = (off + 180.0) % 360.0 - 180.0
    worst = float(np.abs(off - off.mean()).max())
    assert worst > 5.0 * (fit.textbook_heading_error_deg or fit.heading_error_deg).worst
    assert worst < 2.0 * fit.heading_error_deg.worst


@pytest.mark.parametrize("memory", daily([0, 20, 100], 2))
def test_noise_is_not_taken_for_it(memory: int, trials: Choose) -> None:
    """White noise, and slow noise of 20 and 100 readings, which its autocovariance alone would take for curves."""
    rng = np.random.default_rng(memory)
    chances = []
    for _ in trials(400, 60).seeds:
        directions = np.repeat(_directions(rng, 30), 20, axis=0) if memory else _directions(rng, 600)
        field = directions @ (50.0 * np.eye(3) + _symmetric(rng)) + rng.normal(scale=0.4, size=(600, 3))
        record = engine().fit(field + _slow(rng, 600, memory))
        found = None if record["status"] else nonlinearity_in(record)
        if found is not None:
            chances.append(found.p_value)
    assert len(chances) > 40
    assert np.mean(np.array(chances) < 0.05) < 0.2
    assert min(chances) > 1e-4


def _directions(rng: np.random.Generator, count: int) -> Floats:
    directions = rng.normal(size=(count, 3))
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _symmetric(rng: np.random.Generator) -> Floats:
    half = rng.normal(scale=4.0, size=(3, 3))
    return np.asarray(half + half.T) / 2.0


def _slow(rng: np.random.Generator, count: int, memory: int) -> Floats:
    """Ornstein-Uhlenbeck noise of 0.5 µT."""
    if not memory:
        return np.zeros((count, 3))
    keep, noise = np.exp(-1.0 / memory), np.empty((count, 3))
    noise[0] = rng.normal(scale=0.5, size=3)
    for row in range(1, count):
        noise[row] = keep * noise[row - 1] + rng.normal(scale=0.5 * np.sqrt(1.0 - keep**2), size=3)
    return noise
