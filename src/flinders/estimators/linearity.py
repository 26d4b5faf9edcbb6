"""Whether what a disturbance makes is a straight line in it.

The model is x = … + P c. Where the field goes with c², as that of a motor may with its throttle, a straight line is
right in the mean and off at both ends and in the middle. With w = c² less its straight line in c, r what the fit
leaves, and Q the columns by which κ w moves r, less what the fit's own columns J explain of them,

    κ = (QᵀQ)⁻¹ Qᵀr,        χ² = rᵀQ B⁻¹ Qᵀr,        B = cov Qᵀr

with three degrees of freedom, B allowing for residuals that hang together once κ w is taken off. `curvature` is the
size of κ w over that of P c, over the range of the disturbance and at its reference: a sixth for a field that goes with
c² from 0 on.

When to use it: after a fit that follows a disturbance, on a bench or while turning. It says nothing of a disturbance
that takes two values alone, nor of what happens beyond the range that was recorded.

Source: the score test, C. R. Rao, *Large sample tests of statistical hypotheses concerning several parameters*, 1948.

>>> rng = np.random.default_rng(1)
>>> drawn = np.tile(np.linspace(0.0, 1.0, 200), 4)
>>> noise = rng.normal(scale=0.1, size=800)
>>> columns, rows = np.column_stack([np.ones(800), drawn]), [np.arange(800)]
>>> for made in (6.0 * drawn, 6.0 * drawn**2):
...     slope, level = np.polyfit(drawn, made + noise, 1)
...     left = Residuals(made + noise - slope * drawn - level, columns, rows)
...     print(round(curvature(drawn, left, np.ones((800, 1)), np.array([slope])), 2))
0.0
0.17
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.autocorrelation import Residuals

if TYPE_CHECKING:
    from flinders.arrays import Floats

PROVEN: Final = 30.0
"""χ² of three degrees of freedom beyond which a curve is no chance: once in a million."""

FLAT: Final = 1e-3
"""Share of a column that has to be left for anything to be told of it."""

ENDS: Final = (0.02, 0.98)
"""Quantiles between which a disturbance is looked at: a spike of its meter is no range."""


def curvature(values: Floats, residuals: Residuals, sensitivity: Floats, per_unit: Floats) -> float:
    """How far what a disturbance makes is off a straight line, as a share of what it makes; 0 where that may be chance.

    Parameters
    ----------
    values : (N,) float
        Of the disturbance at each residual less its reference, in its unit.
    residuals : Residuals
        What a fit leaves, in the unit of the readings, with (N, K) columns of all that it was fitted by.
    sensitivity : (N, D) float
        By how much each residual moves with an offset along each of D axes.
    per_unit : (D,) float
        What one unit of the disturbance makes, in the unit of the readings.

    Returns
    -------
    float
        Largest departure from the line over the range of the disturbance and at its reference, over what the line makes
        at the far end of that range.
    """
    low, high = np.quantile(values, ENDS)
    made = float(np.linalg.norm(per_unit) * max(abs(low), abs(high)))
    if not (made > 0.0 and high > low):
        return 0.0
    scaled = (values - low) / (high - low)
    line = np.polyfit(scaled, scaled**2, 1)
    bend = scaled**2 - np.polyval(line, scaled)
    whole = sensitivity * bend[:, np.newaxis]
    rest = whole - residuals.jacobian @ np.linalg.lstsq(residuals.jacobian, whole, rcond=None)[0]
    least = FLAT * np.linalg.norm(sensitivity, axis=0)
    if np.any(np.linalg.norm(whole, axis=0) < least) or np.any(np.linalg.norm(rest, axis=0) < least):
        return 0.0
    pulled = rest.T @ residuals.distances
    solution = np.linalg.pinv(rest.T @ rest, hermitian=True) @ pulled
    within = Residuals(residuals.distances - rest @ solution, rest, residuals.segments)
    chi_square = float(pulled @ np.linalg.pinv(within.scatter(within.autocovariance()), hermitian=True) @ pulled)
    if chi_square < PROVEN:
        return 0.0
    ends = np.array([min(low, 0.0), max(high, 0.0), low + 0.5 * (high - low) * line[0]])  # the last is its vertex
    places = (ends - low) / (high - low)
    return float(np.linalg.norm(solution) * np.abs(places**2 - np.polyval(line, places)).max()) / made
