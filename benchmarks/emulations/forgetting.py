"""Least squares with exponential forgetting: the consistent ellipsoid from weighted sums.

A reading that is a readings old has the weight exp(−a/m), for a memory of m readings: the sums Σ wᵢ xᵢʲyᵢᵏzᵢˡ replace
those of `flinders.estimators.consistent`. This is equivalent to a recursion that multiplies all sums by exp(−1/m)
before each new reading.

The offset moves by 30 in the middle of a recording:

>>> from flinders import Samples
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(6000, 3))
>>> field = 50.0 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + rng.normal(size=(6000, 3))
>>> field[3000:, 0] += 30.0
>>> for memory in (None, 300.0):
...     print(forgetting(Samples(field), memory).centre.round(0) + 0.0)
[15.  0.  0.]
[30.  0.  0.]

L. Ljung, "System Identification" (2nd ed. 1999), 11.2.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.estimators.consistent import fit_adjusted
from flinders.estimators.data import Readings
from flinders.summary.moments import Moments
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.geometry.ellipsoid import Ellipsoid


def forgetting(samples: Samples, memory: float | None = None) -> Ellipsoid:
    """Ellipsoid of the weighted sums at the end of the recording.

    Parameters
    ----------
    samples : Samples
    memory : float, optional
        Number of readings after which a weight has fallen to 1/e; None for equal weights.

    Raises
    ------
    NotAnEllipsoid
        If the quadric is open.
    """
    ages = np.arange(len(samples))[::-1]
    weights = np.exp(-ages / memory) if memory else np.ones(len(samples))
    return fit_adjusted(Readings(replace(Summary.empty(), moments=Moments.of(samples.field, weight=weights))))[0]
