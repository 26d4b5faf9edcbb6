"""Term of the magnitude: corrected readings have the same length in all directions.

A reading x has y = S⁻¹(x − b), which would be a unit vector u without noise. Its distance from the
ellipsoid, to first order and in the unit of the readings, is the Sampson distance

    s = (|y| − 1) / |S⁻¹ y/|y||

With the surface normal n = S⁻¹u/|S⁻¹u| a change of parameters moves the surface towards x by
n·δb + nᵀ δS u, which gives the Jacobian. The Jacobian is evaluated at the first-order foot point of x on
the ellipsoid, where it contains no noise of first order.

A bias of second order remains: because the surface is curved, noise moves readings outwards on average, by
E[s] = ½ σ² ∇²s. `curvature` gives Σ J ½∇²s, which the solver subtracts. Without this correction the bias of a
long recording would be many times the claimed uncertainty.

Source: P. D. Sampson (1982), Computer Graphics and Image Processing 18; bias of estimating
equations as in Kukush, Markovsky, Van Huffel (2004) §2.

>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> distances(np.array([[50.5, 0.0, 0.0], [0.0, 49.0, 0.0]]), sphere)
array([ 0.5, -1. ])
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.samples import BLOCK_ROWS
from flinders.geometry.ellipsoid import PARAMETER_DERIVATIVES, Ellipsoid, parameter_derivatives, subtract_centre
from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats

# Rows of a block are n, n_i u_j and s; the last column of the products is that of s.
_DERIVATIVES: Final = np.zeros((13, 10))
_DERIVATIVES[:12, :9] = PARAMETER_DERIVATIVES
_DERIVATIVES[12, 9] = 1.0


def equations(blocks: Iterable[Floats], ellipsoid: Ellipsoid) -> NormalEquations:
    """Normal equations of blocks of (m, 3) readings, linearized at an ellipsoid."""
    inverse = np.linalg.inv(ellipsoid.shape)
    total = np.zeros((10, 10))
    count = 0
    for block in blocks:
        for start in range(0, len(block), BLOCK_ROWS):
            rows = _rows(block[start : start + BLOCK_ROWS], ellipsoid.centre, inverse)
            total += _DERIVATIVES.T @ (rows @ rows.T) @ _DERIVATIVES
            count += rows.shape[1]
    return NormalEquations(total[:9, :9], total[:9, 9], float(total[9, 9]), count)


def distances(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N,) Sampson distances of (N, 3) readings, in their unit; positive outside of the ellipsoid."""
    inverse = np.linalg.inv(ellipsoid.shape)
    return _distances(inverse @ subtract_centre(readings, ellipsoid.centre), inverse)[0]


def curvature(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(9,) mean gradient Σ J ½∇²s over (N, 3) readings from a noise of 1; it grows with σ².

    On the surface ∇²s = (tr K − k₁)/√k₁ − 2 (k₂ − k₁²)/k₁^{3/2} with K = S⁻², k₁ = uᵀKu, k₂ = |Ku|².
    """
    inverse, scale = np.linalg.inv(ellipsoid.shape), ellipsoid.scale
    u = inverse @ subtract_centre(readings, ellipsoid.centre)
    u = u[:, np.any(u != 0.0, axis=0)]  # a reading at the centre has no direction
    u /= _lengths(u)
    inverse = inverse * scale  # a power of two: keeps powers of K within range without rounding
    metric = inverse @ inverse
    normal = inverse @ u
    bent = metric @ u
    k1, k2 = _dot(normal, normal), _dot(bent, bent)
    steepness = np.sqrt(k1)
    laplacian = (np.trace(metric) - k1) / steepness - 2.0 * (k2 - k1 * k1) / (k1 * steepness)
    normal *= 0.5 * laplacian / steepness
    gradient: Floats = np.concatenate([normal.sum(axis=1), (normal @ u.T).ravel()]) @ PARAMETER_DERIVATIVES
    return gradient / scale


def information(directions: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(K, 9) Jacobian at (K, 3) unit directions: displacement of the surface in each direction by each parameter."""
    normals = np.linalg.inv(ellipsoid.shape) @ directions.T
    normals /= _lengths(normals)
    return parameter_derivatives(normals, directions.T)


def _rows(readings: Floats, centre: Floats, inverse: Floats) -> Floats:
    """(13, m) normals n, products n_i u_j, and distances s of one block of (m, 3) readings."""
    rows = np.empty((13, len(readings)))
    y = inverse @ subtract_centre(readings, centre)
    s, normal = _distances(y, inverse)
    foot = y - inverse @ normal * s
    foot /= _lengths(foot)
    normal = inverse @ foot
    normal /= _lengths(normal)
    rows[:3] = normal
    np.multiply(normal[:, np.newaxis], foot, out=rows[3:12].reshape(3, 3, -1))
    rows[12] = s
    return rows


def _distances(y: Floats, inverse: Floats) -> tuple[Floats, Floats]:
    """(m,) distances s and (3, m) normals n from (3, m) y = S⁻¹(x − b)."""
    length = _lengths(y)
    normal = inverse @ (y / length)
    steepness = _lengths(normal)
    normal /= steepness
    return (length - 1.0) / steepness, normal


def _dot(a: Floats, b: Floats) -> Floats:
    products: Floats = np.einsum("ij,ij->j", a, b)
    return products


def _lengths(vectors: Floats) -> Floats:
    """(m,) lengths of (3, m) vectors, at least 1e-150 to allow division."""
    return np.maximum(np.sqrt(_dot(vectors, vectors)), 1e-150)
