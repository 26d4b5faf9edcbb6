"""Noise and covariance of the fits that minimise Σ q², from the sums and the cells of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude
from flinders.likelihood.equations import FINEST
from flinders.likelihood.identifiability import Support, spurious_information
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

EVERYTHING: Final = np.eye(9)
"""Basis of the parameters of a fit without constraints."""

AXES_ALIGNED: Final = np.eye(9)[:, :6]
"""Basis of the parameters where the shape is diagonal."""

SPHERICAL: Final = np.concatenate([np.eye(9)[:, :3], np.eye(9)[:, 3:6].sum(axis=1, keepdims=True)], axis=1)
"""Basis of the parameters where the shape is a multiple of the identity."""


def algebraic_noise(readings: Readings, ellipsoid: Ellipsoid, unknowns: int) -> float:
    """Standard deviation of the distance from an ellipsoid, from the sums alone.

    With q(x) = |S⁻¹(x − b)|² − 1 and s ≈ q/|∇q| it is √(Σq² / Σ|∇q|²), corrected for the unknowns.

    Raises
    ------
    NotAnEllipsoid
        For a surface so far from its readings that their sums do not tell.
    """
    moments = readings.summary.moments
    scale = ellipsoid.radius
    scatter = moments.about(ellipsoid.centre, scale)
    local = Ellipsoid(np.zeros(3), ellipsoid.shape / scale).as_quadric()
    form = np.linalg.matrix_power(np.linalg.inv(ellipsoid.shape / scale), 4)
    steepness = 4.0 * float(np.sum(form * scatter[6:9, 6:9]))
    freedom = max(moments.count - unknowns, 1.0) / moments.count
    if not steepness > 0.0:  # nothing but rounding is left of a surface far away from its readings
        raise NotAnEllipsoid((0.0, 0.0, 0.0))
    square = max(float(local @ scatter @ local), 0.0) / steepness / freedom
    return scale * float(np.sqrt(square))


def algebraic_covariance(readings: Readings, ellipsoid: Ellipsoid, noise: float, basis: Floats = EVERYTHING) -> Floats:
    """(9, 9) covariance of a fit that minimises Σ q(x)², whatever its normalisation.

    q = |∇q| s, so to first order such a fit is a least-squares fit of the distances s with weights
    w = |∇q|², and its covariance is σ² N⁻¹ (Σ w² JJᵀ) N⁻¹ with N = Σ w JJᵀ: larger than that of the
    likelihood, which weighs all distances alike. The sums run over the cells of the cloud. A direction that the
    readings do not see gets the radius for its standard deviation.

    Parameters
    ----------
    readings : Readings
    ellipsoid : Ellipsoid
    noise : float
        In the unit of the readings.
    basis : (9, k) float
        The parameters that the method adjusts.
    """
    cloud = readings.summary.cloud
    directions = directions_of(cloud.means, ellipsoid)
    jacobian = magnitude.information(directions, ellipsoid) @ basis
    variance = max(noise, FINEST * ellipsoid.radius) ** 2
    counted = jacobian.T * cloud.counts
    support = Support.of(
        counted @ jacobian / variance,
        lambda: basis.T @ spurious_information(directions, ellipsoid, cloud.counts) @ basis,
    )
    seen, unobserved = support.directions
    gradients = np.linalg.solve(ellipsoid.shape, directions.T) * ellipsoid.radius
    weights = np.einsum("ij,ij->j", gradients, gradients)
    rows = jacobian @ seen
    weighted = rows.T * (weights * cloud.counts)
    inverse = basis @ seen @ np.linalg.inv(weighted @ rows)
    open_ended = ellipsoid.radius * basis @ unobserved
    covariance: Floats = variance * inverse @ ((weighted * weights) @ rows) @ inverse.T + open_ended @ open_ended.T
    return covariance
