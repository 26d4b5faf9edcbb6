"""What a method leaves out of its claim, seen beside the likelihood: residuals that hang together, a bias of its own.

A closed form claims what independent residuals would allow, and residuals of real recordings are not independent. A
sphere through the readings of an ellipsoid, or plain least squares on half a sphere, is wrong by far more than its
scatter says. The likelihood of the same readings is there to be asked: how residuals hang together it has found, and
both fits can be held against each other: what chance explains of the difference is taken off, the rest joins the claim.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate


def as_correlated(estimate: Estimate, likelihood: Estimate) -> Estimate:
    """Widen a claim that takes residuals for independent as much as that of the likelihood is widened.

    The factor is the mean over the variances of all nine parameters.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Of the same readings.
    """
    if estimate.correlation is not None or likelihood.correlation is None or likelihood.textbook is None:
        return estimate
    textbook = np.maximum(np.diag(likelihood.textbook), np.finfo(float).tiny)
    factor = max(1.0, float(np.mean(np.diag(likelihood.covariance) / textbook)))
    return replace(
        estimate,
        covariance=estimate.covariance * factor,
        textbook=estimate.covariance,
        correlation=likelihood.correlation,
    )


def with_bias(estimate: Estimate, likelihood: Estimate) -> Estimate:
    """Add what separates an estimate from the likelihood's to its covariance.

    With d the difference of (b, S) and P the sum of both covariances, χ² = dᵀP⁻¹d is nine on average where only
    chance is at work; the share max(0, 1 − 9/χ²) of ddᵀ is kept, as James and Stein shrink a mean.

    Parameters
    ----------
    estimate, likelihood : Estimate
        Of the same readings.
    """
    apart = estimate.ellipsoid.parameters - likelihood.ellipsoid.parameters
    chance = np.linalg.pinv(estimate.covariance + likelihood.covariance, rcond=1e-12, hermitian=True)
    surprise = float(apart @ chance @ apart)
    bias = apart * np.sqrt(max(0.0, 1.0 - len(apart) / surprise)) if surprise > 0.0 else np.zeros(9)
    covariance = estimate.covariance + np.outer(bias, bias)
    if likelihood.unobserved:  # where the readings leave it open, nobody knows how far off a method is
        covariance = covariance + likelihood.covariance
    return replace(estimate, covariance=covariance, bias=bias)
