"""Robust statistics of residuals: standard deviation from a median, and reduced weights of large residuals.

Source: P. J. Huber, *Robust Statistics* (1981).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats

MAD_TO_SIGMA: Final = 1.4826
"""Ratio of the standard deviation of a normal distribution to the median of its absolute values."""

HUBER_SIGMAS: Final = 2.5
"""Residual in standard deviations from which the weight is reduced."""


def robust_sigma(residuals: Floats) -> float:
    """Standard deviation of residuals about zero, from the median of their absolute values.

    >>> robust_sigma(np.array([-1.0, 0.5, 1.0, 100.0]))
    1.4826
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))


def huber_weights(residuals: Floats, *, beyond: float = HUBER_SIGMAS) -> Floats:
    """Huber's weights of residuals in standard deviations: 1 up to `beyond`, then ``beyond / |r|``.

    >>> huber_weights(np.array([0.5, -5.0]))
    array([1. , 0.5])
    """
    weights: Floats = beyond / np.maximum(np.abs(residuals), beyond)
    return weights
