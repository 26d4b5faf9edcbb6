"""Consistent: the adjusted least squares of Kukush, Markovsky and Van Huffel, in one pass and without bias."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from flinders.errors import NotAnEllipsoid
from flinders.estimators.base import Estimate, Method
from flinders.estimators.covariance import algebraic_covariance
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True)
class Consistent:
    """General ellipsoid from sums that are corrected for noise; the noise is estimated, too.

    The corrected scatter matrix is ``Ψ(σ²) = Σ φφᵀ`` with each product of monomials replaced by its Hermite
    polynomial. The estimate of σ² is the value at which the smallest eigenvalue of Ψ is zero; its eigenvector
    is the quadric. Newton's method on σ² needs a few 10 × 10 eigenproblems, regardless of the length of the
    recording.

    Use it if there are only sums (a fleet, a stream, a saved `Summary`), and as the start of `Likelihood`.
    The bias of plain least squares can be degrees of heading; this method has none. With partial coverage it is
    less accurate than the likelihood.

    References
    ----------
    .. [1] A. Kukush, I. Markovsky, S. Van Huffel, "Consistent estimation in an implicit quadratic
       measurement error model", Comput. Statist. Data Anal. 47 (2004); Numer. Math. 98 (2004) 177–194.

    Examples
    --------
    >>> import numpy as np
    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(100_000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=2.0, size=directions.shape)
    >>> estimate = Consistent().estimate(Readings.of(field))
    >>> estimate.ellipsoid.centre.round(1), estimate.ellipsoid.semi_axes.round(1), round(estimate.noise, 1)
    (array([ 20., 120.,  90.]), array([45., 50., 55.]), 2.0)
    """

    name: ClassVar[str] = "consistent"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if the
        quadric is open.
        """
        readings.require(self.unknowns, self.name)
        ellipsoid, noise = fit_adjusted(readings)
        sigma = noise * math.sqrt(len(readings) / max(len(readings) - METHOD.parameters, 1))
        return Estimate(ellipsoid, algebraic_covariance(readings, ellipsoid, sigma), noise, self.name)


def fit_adjusted(readings: Readings) -> tuple[Ellipsoid, float]:
    """Ellipsoid and noise, in the unit of the readings, by adjusted least squares.

    Raises `NotAnEllipsoid` if the quadric is open.
    """
    moments = readings.summary.moments
    record = engine().solve(moments.sums, unit=moments.unit)
    if record["status"]:
        raise NotAnEllipsoid(method=Consistent.name)
    return Ellipsoid(record["centre"].copy(), symmetric_matrix(record["shape"])), float(record["noise"])


METHOD: Final = Method(
    Consistent,
    use="general ellipsoid without bias from sums alone: streams, fleets, saved summaries",
    source="Kukush, Markovsky and Van Huffel (2004)",
)
