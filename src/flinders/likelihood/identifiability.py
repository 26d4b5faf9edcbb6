"""Identifiability of the parameters: true information of the readings, and spurious information from noise.

A direction of parameter space is not observable if a change along it moves no reading off the surface: a shift
perpendicular to a ring of readings, or a change that keeps two rings of readings on the ellipsoid. The Jacobian of a
reading is evaluated at a point of the surface that noise moves sideways. The squares of these changes add N·(σ/R)² to
JᵀJ for N readings with noise σ on a radius R, although the true information is zero. The fit then follows the noise
with a small claimed uncertainty.

This spurious information can be computed: it is σ² times the sum of the squared derivatives of J along the surface. A
direction is counted as not observable if a large part of its information is spurious.

>>> ring = np.stack([np.cos(np.arange(60.0)), np.sin(np.arange(60.0)), np.zeros(60)], axis=1)
>>> ellipsoid = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> information = spurious_information(ring, ellipsoid)[2, 2]  # a shift of the centre along z
>>> round(float(information) * 50.0**2 / 60.0, 3)
1.0
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import PARAMETER_DERIVATIVES, Ellipsoid
from flinders.geometry.rotation import perpendicular_vectors
from flinders.likelihood.equations import MIN_EIGENVALUE_RATIO

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.equations import NormalEquations

MIN_SOUND_EIGENVALUE: Final = 0.1
"""Smallest eigenvalue of the scaled normal matrix from which all directions count as observable without a test."""

MAX_SPURIOUS_SHARE: Final = 1.0 / 3.0
"""Largest fraction of spurious information in the information on an observable direction."""


def spurious_information(directions: Floats, ellipsoid: Ellipsoid, counts: Floats | float = 1.0) -> Floats:
    """(9, 9) spurious information for a noise of 1: noise σ adds σ² times this matrix to the information Σ JJᵀ.

    It is Σ (∂J/∂t)(∂J/∂t)ᵀ over (K, 3) unit directions and their two tangents t, with the number of readings in each
    direction in `counts`.
    """
    pointing = directions.any(axis=1)  # a reading at the centre has no direction
    counts = np.broadcast_to(counts, len(directions))[pointing]
    total: Floats = np.sum(
        [rows.T * counts @ rows for rows in tangent_derivatives(directions[pointing], ellipsoid)], axis=0
    )
    return total


def tangent_derivatives(directions: Floats, ellipsoid: Ellipsoid) -> Iterator[Floats]:
    """Yield the (K, 9) derivative ∂J/∂t of the Jacobian at (K, 3) directions, for each of the two tangents t."""
    inverse = np.linalg.inv(ellipsoid.shape)
    u = directions.T
    normal = inverse @ u
    steepness = np.sqrt(np.einsum("ij,ij->j", normal, normal))
    normal = normal / steepness
    for tangent in perpendicular_vectors(normal.T).transpose(2, 1, 0):
        along = inverse @ tangent
        turned = inverse @ along
        bent = (turned - normal * np.einsum("ij,ij->j", normal, turned)) / steepness
        products = bent[:, np.newaxis] * u + normal[:, np.newaxis] * along
        yield np.concatenate([bent, products.reshape(9, -1)]).T @ PARAMETER_DERIVATIVES


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """Observable and unobservable directions of parameter space: eigenvectors of the scaled normal matrix."""

    scale: Floats  # (K,): root of the diagonal of the normal matrix
    values: Floats  # (K,): eigenvalues of the scaled matrix
    vectors: Floats  # (K, K): eigenvectors, in columns
    share: Floats  # (K,): fraction of spurious information in each direction

    @classmethod
    def of(cls, matrix: Floats, spurious: Callable[[], Floats]) -> Self:
        """Find the observable directions by the (K, K) normal matrix of residuals in standard deviations.

        `spurious` returns the (K, K) spurious information. It is not called for a well-conditioned matrix.
        """
        diagonal = np.diag(matrix)
        nothing = max(MIN_EIGENVALUE_RATIO * float(diagonal.max()), np.finfo(float).tiny)
        scale = np.sqrt(np.maximum(diagonal, nothing))
        scaled = matrix / np.outer(scale, scale)
        mute = diagonal <= nothing  # their off-diagonal entries are rounding
        scaled[mute] = scaled[:, mute] = 0.0
        values, vectors = np.linalg.eigh(scaled)
        share = np.zeros(len(values))
        if not values[0] > MIN_SOUND_EIGENVALUE:
            heard = np.where(mute, np.inf, scale)
            with np.errstate(over="ignore", invalid="ignore"):  # infinite information is wholly spurious
                noise = np.einsum("ij,ik,kj->j", vectors, spurious() / np.outer(heard, heard), vectors)
            noise = np.nan_to_num(noise, nan=np.inf, posinf=np.inf)
            observed = values > max(MIN_EIGENVALUE_RATIO * float(values[-1]), np.finfo(float).tiny)
            share = np.ones(len(values))
            share[observed] = np.clip(noise[observed], 0.0, values[observed]) / values[observed]
        return cls(scale, values, vectors, share)

    @property
    def is_observable(self) -> NDArray[np.bool_]:
        """(K,) whether each direction is observable."""
        return self.share < MAX_SPURIOUS_SHARE

    @property
    def unobserved(self) -> int:
        """Number of unobservable directions."""
        return int(np.count_nonzero(~self.is_observable))

    @property
    def directions(self) -> tuple[Floats, Floats]:
        """Basis of the observable directions, and basis of unit length of the unobservable ones, in parameters."""
        unobserved = self.vectors[:, ~self.is_observable] / self.scale[:, np.newaxis]
        lengths = np.sqrt(np.einsum("ij,ij->j", unobserved, unobserved))
        return self.vectors[:, self.is_observable] / self.scale[:, np.newaxis], unobserved / lengths

    def remove_unobservable(self, equations: NormalEquations) -> NormalEquations:
        """Remove the unobservable directions from the normal equations of this matrix."""
        if not self.unobserved:
            return equations
        basis = self.vectors[:, self.is_observable]
        scaled = basis * self.scale[:, np.newaxis]
        gradient = scaled @ (basis.T @ (equations.gradient / self.scale))
        return replace(equations, matrix=(scaled * self.values[self.is_observable]) @ scaled.T, gradient=gradient)

    def project(self, scatter: Floats) -> Floats:
        """(K, K) part of a covariance of the gradient in the observable directions."""
        basis = self.vectors[:, self.is_observable]
        onto = (basis * self.scale[:, np.newaxis]) @ (basis / self.scale[:, np.newaxis]).T
        part: Floats = onto @ scatter @ onto.T
        return part

    @property
    def information(self) -> Floats:
        """(K, K) information without its spurious part; the inverse is a covariance.

        Noise adds its share both to the normal matrix and to the covariance of the gradient. The information in a
        direction is therefore multiplied by (1 − share)².
        """
        scaled = self.vectors[:, self.is_observable] * self.scale[:, np.newaxis]
        information: Floats = (scaled * (self.values * (1.0 - self.share) ** 2)[self.is_observable]) @ scaled.T
        return information
