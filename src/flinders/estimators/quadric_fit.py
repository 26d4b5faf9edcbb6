"""Common parts of fits that minimise Σ q(x)²: the frame, the solution under constraints, and the claim.

q(x) = xᵀQx + l·x + d is linear in its ten coefficients c, and Σ q² = cᵀMc with the scatter M of the monomials. Linear
constraints are written as c = fixed + free·z, and z is estimated by least squares.

>>> from flinders.estimators.data import Readings
>>> corners = np.array([[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1.0]])
>>> frame = Frame.of(Readings.of(10.0 * corners + [1.0, 2.0, 3.0]))
>>> frame.to_ellipsoid(fit_constrained(frame.scatter, CONSTRAINT_BASES["sphere"]), "sphere").centre.round(6)
array([1., 2., 3.])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.estimators.base import Estimate
from flinders.estimators.covariance import FULL_BASIS, algebraic_covariance, algebraic_noise
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

CONSTRAINT_BASES: Final[dict[str, Floats]] = {
    "free": np.eye(6),
    "aligned": np.eye(6)[:, :3],
    "xy": np.eye(6)[:, [0, 2]] + np.eye(6)[:, [1, 1]] * [1.0, 0.0],
    "xz": np.eye(6)[:, [0, 1]] + np.eye(6)[:, [2, 2]] * [1.0, 0.0],
    "yz": np.eye(6)[:, [1, 0]] + np.eye(6)[:, [2, 2]] * [1.0, 0.0],
    "sphere": np.eye(6)[:, :3].sum(axis=1, keepdims=True),
}
"""(6, k) basis of the entries 11, 22, 33, 12, 13, 23 of a symmetric matrix, by the name of the constraint on it.

The same constraint holds for Q and for the shape of the ellipsoid.
"""

_TRACE: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Scatter of scaled readings, (reading − origin) / scale, for well-conditioned equations."""

    origin: Floats  # (3,): origin, in the unit of the readings
    scale: float  # scale, in the unit of the readings
    scatter: Floats  # (10, 10): M: sums of products of x², y², z², xy, xz, yz, x, y, z and 1

    @classmethod
    def of(cls, readings: Readings, origin: Floats | None = None, scale: float | None = None) -> Self:
        """Make the frame of readings, by default with their mean as origin and their spread as scale."""
        moments = readings.summary.moments
        origin = moments.mean if origin is None else origin
        scale = moments.spread if scale is None else scale
        return cls(origin, scale, moments.about(origin, scale))

    def to_ellipsoid(self, coefficients: Floats, method: str) -> Ellipsoid:
        """Ellipsoid of (10,) coefficients in this frame, in the unit of the readings.

        Raises `NotAnEllipsoid` if the quadric is open.
        """
        return Ellipsoid.from_quadric(coefficients, method=method).in_frame(self.origin, self.scale)


def least_squares(scatter: Floats, fixed: Floats, free: Floats) -> Floats:
    """(10,) coefficients c = fixed + free·z that minimise cᵀMc, for (10,) `fixed` and (10, k) `free`."""
    normal, right = free.T @ scatter @ free, -free.T @ scatter @ fixed
    coefficients: Floats = fixed + free @ np.linalg.lstsq(normal, right, rcond=1e-15)[0]
    return coefficients


def fit_constrained(scatter: Floats, entries: Floats, *, centred: bool = False) -> Floats:
    """(10,) coefficients c that minimise cᵀMc with tr Q = 3, where Q has the (6, k) basis `entries`.

    With `centred` the centre is the origin, l = 0.
    """
    trace = _TRACE @ entries
    traceless = entries[:, 1:] - entries[:, :1] * (trace[1:] / trace[0])
    linear = np.eye(4)[:, 3:] if centred else np.eye(4)
    free = np.zeros((10, traceless.shape[1] + linear.shape[1]))
    free[:6, : traceless.shape[1]], free[6:, traceless.shape[1] :] = traceless, linear
    return least_squares(scatter, np.append(_TRACE, np.zeros(4)), free)


def make_estimate(readings: Readings, ellipsoid: Ellipsoid, method: str, basis: Floats = FULL_BASIS) -> Estimate:
    """Make the estimate of a fit that minimises Σ q(x)², with a claim for the parameters of the (9, k) basis."""
    noise = algebraic_noise(readings, ellipsoid, basis.shape[1])
    return Estimate(ellipsoid, algebraic_covariance(readings, ellipsoid, noise, basis), noise, method)
