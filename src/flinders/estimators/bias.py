"""What a simpler model or a biased equation costs, seen beside the likelihood.

A sphere through the readings of an ellipsoid, or plain least squares on half a sphere, is wrong by far more than
its scatter says. Both fits are there, so the difference can be looked at; what chance explains of
it is taken off, and the rest joins the covariance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.errors import FitError
from flinders.estimators.auto import Auto
from flinders.quadric import upper

if TYPE_CHECKING:
    from flinders.estimators.estimate import Estimate
    from flinders.estimators.readings import Readings


def with_bias(estimate: Estimate, readings: Readings) -> Estimate:
    """Add what separates an estimate from `Auto`'s to its covariance.

    With d the difference of (b, S) and P the sum of both covariances, χ² = dᵀP⁻¹d is nine on average where only
    chance is at work; the share max(0, 1 − 9/χ²) of ddᵀ is kept, as James and Stein shrink a mean.

    Parameters
    ----------
    estimate : Estimate
    readings : Readings
        The same it was made from.
    """
    try:
        other = Auto().estimate(readings)
    except FitError:  # too few readings to see beyond the simpler model
        return estimate
    ours, theirs = estimate.ellipsoid, other.ellipsoid
    apart = np.concatenate([ours.centre - theirs.centre, upper(ours.shape - theirs.shape)])
    chance = np.linalg.pinv(estimate.covariance + other.covariance, rcond=1e-12, hermitian=True)
    surprise = float(apart @ chance @ apart)
    bias = apart * np.sqrt(max(0.0, 1.0 - len(apart) / surprise)) if surprise > 0.0 else np.zeros(9)
    covariance = estimate.covariance + np.outer(bias, bias)
    if other.unseen:  # where the readings leave it open, nobody knows how far off a method is
        covariance = covariance + other.covariance
    return replace(estimate, covariance=covariance, bias=bias)
