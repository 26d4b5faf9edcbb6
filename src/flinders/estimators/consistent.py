"""Consistent: the adjusted least squares of Kukush, Markovsky and Van Huffel. One pass, no bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.estimators.base import Estimate, Method
from flinders.estimators.covariance import algebraic_covariance
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.summary.moments import EXPONENTS, packed, unpacked

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

STEPS: Final = 50
"""As many as bisection alone would need; Newton's method needs five."""


def _heat() -> Floats:
    """(35, 35) matrix of −½∇² on monomials: what each loses for each unit of noise variance.

    exp(−½σ²∇²) turns xᵏ into the Hermite polynomial tₖ with E[tₖ(x + n)] = xᵏ: t₂ = x² − σ²,
    t₃ = x³ − 3σ²x, t₄ = x⁴ − 6σ²x² + 3σ⁴. On polynomials of degree four it ends after two terms.
    """
    index = {tuple(e): i for i, e in enumerate(EXPONENTS.tolist())}
    heat = np.zeros((35, 35))
    for row, exponents in enumerate(EXPONENTS.tolist()):
        for axis, power in enumerate(exponents):
            if power >= 2:
                lower = [e - 2 * (i == axis) for i, e in enumerate(exponents)]
                heat[row, index[tuple(lower)]] -= 0.5 * power * (power - 1)
    return heat


HEAT: Final = _heat()
_HEAT_TWICE: Final = 0.5 * HEAT @ HEAT


@dataclass(frozen=True, slots=True)
class Consistent:
    """General ellipsoid from sums corrected for noise, whose variance is found on the way.

    Finds the σ² at which the smallest eigenvalue of the corrected scatter matrix
    ``Ψ(σ²) = Σ φφᵀ`` with every product of monomials replaced by its Hermite polynomial is zero; the
    eigenvector is the quadric. Newton's method on σ²: a handful of 10 × 10 eigenproblems, whatever the
    length of the recording.

    Use it where there are only sums (a fleet, a stream, a saved `Summary`), and as the start of
    `Likelihood`. It has no bias where plain least squares is off by degrees, and falls short of
    the likelihood's accuracy where coverage is partial.

    References
    ----------
    .. [1] A. Kukush, I. Markovsky, S. Van Huffel, "Consistent estimation in an implicit quadratic
       measurement error model", Comput. Statist. Data Anal. 47 (2004); Numer. Math. 98 (2004) 177–194.

    Examples
    --------
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

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NotAnEllipsoid
            If the quadric is open.
        """
        readings.require(self.unknowns, self.name)
        ellipsoid, noise = adjusted(readings)
        return Estimate(ellipsoid, algebraic_covariance(readings, ellipsoid, noise), noise, self.name)


def adjusted(readings: Readings) -> tuple[Ellipsoid, float]:
    """Give the ellipsoid and the noise, in the unit of the readings.

    Raises
    ------
    NotAnEllipsoid
        If the quadric is open.
    """
    moments = readings.summary.moments
    origin, scale = moments.mean, moments.spread
    coefficients, variance = adjusted_quadric(moments.about(origin, scale))
    ellipsoid = Ellipsoid.from_quadric(coefficients, method=Consistent.name).in_frame(origin, scale)
    return ellipsoid, scale * float(np.sqrt(variance))


def adjusted_quadric(scatter: Floats) -> tuple[Floats, float]:
    """Give (10,) coefficients and the noise variance σ² for a scatter matrix of centred and scaled readings.

    The smallest eigenvalue falls as σ² grows, from the misfit of plain least squares at zero to
    minus something where σ² exceeds the thinnest extent of the cloud; Newton steps stay inside.
    """
    sums = packed(scatter)
    plain = scatter
    first, second = unpacked(HEAT @ sums), unpacked(_HEAT_TWICE @ sums)
    low, high = 0.0, float(np.linalg.eigvalsh(scatter[6:9, 6:9])[0] / scatter[9, 9])
    variance = 0.0
    coefficients = np.zeros(10)
    for _ in range(STEPS):
        values, vectors = np.linalg.eigh(plain + variance * first + variance**2 * second)
        coefficients = vectors[:, 0]
        if values[0] > 0.0:
            low = variance
        else:
            high = variance
        slope = float(coefficients @ (first + 2.0 * variance * second) @ coefficients)
        proposed = variance - values[0] / slope if slope < 0.0 else high
        if not low <= proposed <= high:
            proposed = (low + high) / 2.0
        if abs(proposed - variance) <= 1e-14 + 1e-11 * variance:
            break
        variance = proposed
    return coefficients, max(variance, 0.0)


METHOD: Final = Method(
    Consistent,
    use="general ellipsoid without bias from sums alone: streams, fleets, saved summaries",
    source="Kukush, Markovsky and Van Huffel (2004)",
)
