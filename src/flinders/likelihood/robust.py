"""Robust statistics of residuals: their standard deviation from a median, and weights that large ones lose.

Source: P. J. Huber, *Robust Statistics* (1981).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

MAD_TO_SIGMA: Final = 1.4826
"""Standard deviation of a normal distribution over the median of its absolute values."""

HUBER: Final = 2.5
"""Standard deviations beyond which a residual counts less than its square."""


def robust_sigma(residuals: Floats) -> float:
    """Standard deviation of residuals about zero, from the median of their absolute values.

    >>> robust_sigma(np.array([-1.0, 0.5, 1.0, 100.0]))
    1.4826
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))


def huber(residuals: Floats, *, beyond: float = HUBER) -> Floats:
    """Weights of residuals in standard deviations.

    >>> huber(np.array([0.5, -5.0]))
    array([1. , 0.5])
    """
    weights: Floats = beyond / np.maximum(np.abs(residuals), beyond)
    return weights
