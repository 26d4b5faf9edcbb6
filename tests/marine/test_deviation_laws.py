"""Laws of the deviation of a compass, for any input."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from flinders.apps.marine.deviation import fit
from flinders.geometry.angles import wrap_180
from flinders.heading.harmonics import design

headings = st.floats(0.0, 359.999)
coefficients = arrays(np.float64, 5, elements=st.floats(-5.0, 5.0))


@given(coefficients)
def test_a_swing_finds_the_coefficients_that_it_was_made_with(truth: np.ndarray) -> None:
    around = np.arange(0.0, 360.0, 20.0)
    found = fit(around, design(around) @ truth)
    npt.assert_allclose(found.coefficients_deg, truth, atol=1e-9)
    npt.assert_allclose(wrap_180(found.compass(found.magnetic(around)) - around), 0.0, atol=1e-6)


@given(coefficients, headings)
def test_a_turned_compass_changes_a_alone(truth: np.ndarray, turned: float) -> None:
    around = np.arange(0.0, 360.0, 45.0)
    assume(abs(wrap_180(turned)) < 100.0)
    found = fit(around, design(around) @ truth + wrap_180(turned))
    npt.assert_allclose(found.coefficients_deg[1:], truth[1:], atol=1e-9)
