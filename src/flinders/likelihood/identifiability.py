"""What the readings really say, and what noise only pretends.

A direction of parameter space is invisible to the readings if no point moves off its surface along it: across
a ring, or along the pencil of ellipsoids through two rings. But each reading has noise, which shifts
the point at which the Jacobian is taken along the surface; squares of those shifts add up in JᵀJ to
information that is not there, N·(σ/R)² where the true one is zero, and the fit then follows the noise
with great confidence.

That noise-induced information is known: it is the sum of the squared derivatives of J along the surface,
times σ². A direction in which it is a good part of all there is counts as unseen.

>>> ring = np.stack([np.cos(np.arange(60.0)), np.sin(np.arange(60.0)), np.zeros(60)], axis=1)
>>> ellipsoid = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> across = spurious_information(ring, ellipsoid)[2, 2]            # a shift of the centre along z
>>> round(float(across) * 50.0**2 / 60.0, 3)
1.0
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.geometry.ellipsoid import GATHER, Ellipsoid
from flinders.geometry.rotation import across
from flinders.likelihood.equations import ROUNDING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.equations import NormalEquations

WELL_CONDITIONED: Final = 0.1
"""Smallest eigenvalue of the normal matrix in its own scale from which on nothing needs a closer look."""

UNSEEN: Final = 1.0 / 3.0
"""Share of a direction's information that noise may pretend before the direction counts as unseen."""


def spurious_information(directions: Floats, ellipsoid: Ellipsoid, counts: Floats | float = 1.0) -> Floats:
    """(9, 9) Σ (∂J/∂t)(∂J/∂t)ᵀ over (K, 3) unit directions and two tangents t: times σ², what noise adds to ΣJJᵀ."""
    pointing = directions.any(axis=1)  # a reading right in the centre has no direction
    counts = np.broadcast_to(counts, len(directions))[pointing]
    total: Floats = np.sum([rows.T * counts @ rows for rows in turning(directions[pointing], ellipsoid)], axis=0)
    return total


def turning(directions: Floats, ellipsoid: Ellipsoid) -> Iterator[Floats]:
    """Yield ∂J/∂t, (K, 9), of the Jacobian at (K, 3) directions for each of two tangents t."""
    inverse = np.linalg.inv(ellipsoid.shape)
    u = directions.T
    normal = inverse @ u
    steepness = np.sqrt(np.einsum("ij,ij->j", normal, normal))
    normal = normal / steepness
    for tangent in across(normal.T).transpose(2, 1, 0):
        along = inverse @ tangent
        turned = inverse @ along
        bent = (turned - normal * np.einsum("ij,ij->j", normal, turned)) / steepness
        products = bent[:, np.newaxis] * u + normal[:, np.newaxis] * along
        yield np.concatenate([bent, products.reshape(9, -1)]).T @ GATHER


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """Directions of parameter space, in the scale in which the normal matrix has ones on its diagonal."""

    scale: Floats  # (K,): root of that diagonal
    values: Floats  # (K,): eigenvalues of the scaled matrix
    vectors: Floats  # (K, K): their directions, in columns
    share: Floats  # (K,): of the information about each, what noise alone pretends

    @classmethod
    def of(cls, matrix: Floats, spurious: Callable[[], Floats]) -> Self:
        """Look at a normal matrix in standard deviations.

        `matrix`: (K, K); `spurious`: gives the (K, K) matrix of `spurious_information`, where asked: a well-conditioned
        matrix needs none.
        """
        diagonal = np.diag(matrix)
        nothing = max(ROUNDING * float(diagonal.max()), np.finfo(float).tiny)
        scale = np.sqrt(np.maximum(diagonal, nothing))
        scaled = matrix / np.outer(scale, scale)
        mute = diagonal <= nothing  # rounding must not tie them to the others
        scaled[mute] = scaled[:, mute] = 0.0
        values, vectors = np.linalg.eigh(scaled)
        share = np.zeros(len(values))
        if not values[0] > WELL_CONDITIONED:
            heard = np.where(mute, np.inf, scale)
            with np.errstate(over="ignore", invalid="ignore"):  # what is beyond all numbers is pretended as a whole
                noise = np.einsum("ij,ik,kj->j", vectors, spurious() / np.outer(heard, heard), vectors)
            noise = np.nan_to_num(noise, nan=np.inf, posinf=np.inf)
            observed = values > max(ROUNDING * float(values[-1]), np.finfo(float).tiny)
            share = np.ones(len(values))
            share[observed] = np.clip(noise[observed], 0.0, values[observed]) / values[observed]
        return cls(scale, values, vectors, share)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(K,) which directions the readings say something about."""
        return self.share < UNSEEN

    @property
    def unobserved(self) -> int:
        """How many they say nothing about."""
        return int(np.count_nonzero(~self.seen))

    @property
    def directions(self) -> tuple[Floats, Floats]:
        """(K, seen) and (K, unseen): bases of what is seen and, of unit length, of what is not, in parameters."""
        unobserved = self.vectors[:, ~self.seen] / self.scale[:, np.newaxis]
        lengths = np.sqrt(np.einsum("ij,ij->j", unobserved, unobserved))
        return self.vectors[:, self.seen] / self.scale[:, np.newaxis], unobserved / lengths

    def keep(self, equations: NormalEquations) -> NormalEquations:
        """Take the unseen directions out of the equations that this belongs to."""
        if not self.unobserved:
            return equations
        basis = self.vectors[:, self.seen]
        scaled = basis * self.scale[:, np.newaxis]
        gradient = scaled @ (basis.T @ (equations.gradient / self.scale))
        return replace(equations, matrix=(scaled * self.values[self.seen]) @ scaled.T, gradient=gradient)

    def projected(self, scatter: Floats) -> Floats:
        """(K, K) the part of a scatter of the gradient that lies in seen directions."""
        basis = self.vectors[:, self.seen]
        onto = (basis * self.scale[:, np.newaxis]) @ (basis / self.scale[:, np.newaxis]).T
        part: Floats = onto @ scatter @ onto.T
        return part

    @property
    def information(self) -> Floats:
        """(K, K) what remains of the matrix after the pretence; its inverse is a covariance.

        Noise adds its share to the matrix and to the scatter of the gradient: (1 − share)² is left.
        """
        scaled = self.vectors[:, self.seen] * self.scale[:, np.newaxis]
        information: Floats = (scaled * (self.values * (1.0 - self.share) ** 2)[self.seen]) @ scaled.T
        return information
