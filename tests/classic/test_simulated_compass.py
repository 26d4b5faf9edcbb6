"""A two-axis compass that is simulated, swung around."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

import flinders
from flinders.apps.classic.simulate_two_axis import Polar, TwoAxis, swing
from flinders.errors import ArrayError, UsageError


def test_a_swing_reads_what_the_formula_says() -> None:
    """x = o₁ + s₁ H cos ψ, y = o₂ − s₂ H sin(ψ + skew), every ten degrees from north on."""
    swung = swing(TwoAxis(scale=(1.2, 0.8), offset=(7.0, -3.0), skew_deg=6.0))
    heading = np.radians(np.arange(36) * 10.0)
    npt.assert_allclose(swung.samples.field[:, 0], 7 + 1.2 * 25 * np.cos(heading), atol=1e-9)
    npt.assert_allclose(swung.samples.field[:, 1], -3 - 0.8 * 25 * np.sin(heading + np.radians(6)), atol=1e-9)
    npt.assert_array_equal(swung.samples.field[:, 2], 0.0)


def test_its_noise_is_that_of_two_axes_and_seeded() -> None:
    compass = TwoAxis(noise=0.5)
    off = swing(compass, seed=1, points=5000).samples.field - swing(points=5000).samples.field
    npt.assert_allclose(off.std(axis=0), [0.5, 0.5, 0.0], rtol=0.05)
    npt.assert_array_equal(swing(compass, seed=2).samples.field, swing(compass, seed=2).samples.field)


@pytest.mark.parametrize("skew_deg", [-30.0, -4.0, 0.0, 4.0, 30.0])
def test_a_level_fit_recovers_the_compass(skew_deg: float) -> None:
    compass = TwoAxis(scale=(1.1, 0.9), offset=(10.0, -5.0), skew_deg=skew_deg)
    swung = swing(compass)
    found = flinders.fit(swung.samples, method="level", site=flinders.Site(strength=50.0)).calibration
    shape = 25.0 * np.linalg.inv(found.matrix)[:2, :2]
    again = TwoAxis.from_ellipse(found.offset[:2], shape, 25.0)
    npt.assert_allclose(again.offset, compass.offset, atol=1e-6)
    assert again.skew_deg == pytest.approx(skew_deg, abs=1e-6)
    assert again.scale[1] / again.scale[0] == pytest.approx(0.9 / 1.1)
    rose = Polar.of(swung, found.matrix, found.offset)
    assert np.abs(rose.corrected_error_deg).max() < 1e-6
    assert np.ptp(rose.corrected_radius) < 1e-6


@pytest.mark.parametrize(
    "options",
    [
        {"scale": (1.0, 0.0)},
        {"offset": (1.0, 2.0, 3.0)},
        {"skew_deg": 90.0},
        {"noise": -1.0},
    ],
)
def test_an_impossible_compass_is_refused(options: dict[str, Any]) -> None:
    with assert_raises((UsageError, ArrayError)):
        TwoAxis(**options)


@pytest.mark.parametrize("options", [{"points": 2}, {"dip_deg": 90.0}, {"field_strength": -1.0}])
def test_an_impossible_swing_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        swing(**options)
