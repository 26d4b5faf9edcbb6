"""Covariance of a fit: that of the closed forms, and what autocorrelated residuals add to it, in time and direction.

The textbook covariance σ²(JᵀJ)⁻¹ takes residuals for independent. Those of real recordings are not: the
field has gradients along the path of the hand, the body is near, the sensor is not linear. Four
calibrations of one board differ in heading by about three times what the textbook claims.

What a fit's error depends on is the scatter of Σ J s over residuals s. With correlated residuals it is

    B = Σᵢⱼ Jᵢ Jⱼᵀ C(tᵢ − tⱼ) + Σᵢⱼ Jᵢ Jⱼᵀ D(uᵢ, uⱼ)

C is the autocovariance of the residuals, a function of one lag, estimated from all of them and cut off
where it sinks into its own noise; the products of Jacobians are those of the recording. D is a
distortion that belongs to the direction, not to the moment: its size is what residuals in one
direction have in common at different times, and it is taken for smooth, without the part
that an ellipsoid fitted all around would absorb.

What creeps over minutes below the noise of a single reading has no autocovariance that rises above its own noise, and
yet moves a fit more than the noise does. It shows when the recording is cut in a few blocks: their gradients
Σ J s are then larger than B lets them be, and B is enlarged by as much.

Residuals below `FINEST`, a millionth of the field, are those of rounding: of exact readings, or of readings kept in
single precision. They follow the arithmetic and not the sensor, and are taken for white. The covariance claims no
less noise than that, so that nothing is gained by them either.

References
----------
W. K. Newey, K. D. West, Econometrica 55 (1987) 703–708, for sums over lags; a Gaussian process on the sphere with
a squared exponential kernel for D; blocks as in R. T. Birge, Phys. Rev. 40 (1932) 207–227, external beside internal
consistency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude
from flinders.likelihood.equations import FINEST, ROUNDING
from flinders.likelihood.identifiability import Support, spurious_information
from flinders.summary.coverage import directions_of
from flinders.summary.pooling import DEPENDENT, chance_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

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

    Raises `NotAnEllipsoid` for a surface so far from its readings that their sums do not tell.
    """
    moments = readings.summary.moments
    scale = ellipsoid.radius
    scatter = moments.about(ellipsoid.centre, scale)
    local = Ellipsoid(np.zeros(3), ellipsoid.shape / scale).as_quadric()
    form = np.linalg.matrix_power(np.linalg.inv(ellipsoid.shape / scale), 4)
    steepness = 4.0 * float(np.sum(form * scatter[6:9, 6:9]))
    freedom = max(moments.count - unknowns, 1.0) / moments.count
    if not steepness > 0.0:  # nothing but rounding is left of a surface far away from its readings
        raise NotAnEllipsoid()
    square = max(float(local @ scatter @ local), 0.0) / steepness / freedom
    return scale * float(np.sqrt(square))


def algebraic_covariance(readings: Readings, ellipsoid: Ellipsoid, noise: float, basis: Floats = EVERYTHING) -> Floats:
    """(9, 9) covariance of a fit that minimises Σ q(x)², whatever its normalisation.

    q = |∇q| s, so to first order such a fit is a least-squares fit of the distances s with weights
    w = |∇q|², and its covariance is σ² N⁻¹ (Σ w² JJᵀ) N⁻¹ with N = Σ w JJᵀ: larger than that of the
    likelihood, which weighs all distances alike. The sums run over the cells of the cloud. A direction that the
    readings do not see gets the radius for its standard deviation.

    `noise`: in the unit of the readings; `basis`: (9, k), the parameters that the method adjusts.
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


def beyond_chance(difference: Floats, covariance: Floats) -> Floats:
    """(P,) what of a difference d of two estimates its covariance C does not explain.

    Where only chance is at work χ² = dᵀC⁻¹d is P on average; √max(0, 1 − P/χ²) of d is left, as James and Stein shrink
    a mean.
    """
    chi_square = float(difference @ np.linalg.pinv(covariance, rcond=1e-12, hermitian=True) @ difference)
    share = max(0.0, 1.0 - len(difference) / chi_square) if chi_square > 0.0 else 0.0
    beyond: Floats = difference * np.sqrt(share)
    return beyond


LONGEST_LAG: Final = 1000
"""Readings: twenty seconds at 50 Hz, longer than a turn by hand takes."""

PARTNERS: Final = 0.75
"""Of the readings: with fewer pairs than that a lag is not looked at, as their sum falls short of it."""

SIGNIFICANT: Final = 2.0
"""Standard errors beyond which a correlation is one."""

BLOCKS: Final = 8
"""Blocks of a recording, put together to four, that tell what creeps."""

BY_CHANCE: Final = 0.02
"""Creeping that chance makes more often than this is not one."""


def time_of(autocovariance: Floats) -> float:
    """Readings that say as much as one independent reading: 1 + 2 Σ C(k)/C(0)."""
    return 1.0 + 2.0 * float(autocovariance[1:].sum()) / max(float(autocovariance[0]), 1e-300)


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Distances from the surface in the order of recording."""

    distances: Floats  # (N,)
    jacobian: Floats  # (N, 9)
    segments: list[NDArray[np.int64]]  # list of (m,) int: places of consecutive ones

    def lag_one(self) -> float:
        """Correlation of one with the next."""
        products = sum(float(self.distances[s][1:] @ self.distances[s][:-1]) for s in self.segments)
        return products / max(float(self.distances @ self.distances), 1e-300)

    def variance(self) -> Floats:
        """(1,) C(0) alone: the autocovariance of white residuals."""
        return np.array([float(self.distances @ self.distances) / len(self.distances)])

    def autocovariance(self) -> Floats:
        """(K,) C(0), C(1), … up to where it sinks into its noise; C(0) alone where residuals are white."""
        total = len(self.distances)
        most = self._longest_lag()
        if abs(self.lag_one()) < SIGNIFICANT / np.sqrt(total) or most < 2:
            return self.variance()
        sums = np.zeros(most)
        for segment in self.segments:
            spectrum = np.fft.rfft(self.distances[segment], 2 * len(segment))
            products = np.fft.irfft(np.abs(spectrum) ** 2)[: min(most, len(segment))]
            sums[: len(products)] += products
        sunk = np.flatnonzero(sums < SIGNIFICANT / np.sqrt(total) * sums[0])
        return sums[: sunk[0] if len(sunk) else most] / total

    def _longest_lag(self) -> int:
        """The largest lag at which enough readings still have a partner in their stretch, however short some are."""
        lengths = np.array([len(segment) for segment in self.segments])
        lags = np.arange(1, min(int(lengths.max()), LONGEST_LAG) + 1)
        partners = np.maximum(lengths - lags[:, np.newaxis], 0).sum(axis=1)
        return int(np.count_nonzero(partners >= PARTNERS * lengths.sum()))

    def scatter(self, autocovariance: Floats) -> Floats:
        """(9, 9) Σᵢⱼ JᵢJⱼᵀ C(i − j), the products of Jacobians interpolated between a few lags."""
        white = autocovariance[0] * self.jacobian.T @ self.jacobian
        total = white.copy()
        lags, weights = quadrature(autocovariance)
        for lag, weight in zip(lags, weights, strict=True):
            for segment in self.segments:
                rows = self.jacobian[segment]
                product = rows[:-lag].T @ rows[lag:]
                total += weight * (product + product.T)
        return total if not lags else _not_below(total, white)

    def excess_variance(self, scatter: Floats) -> float:
        """Factor by which blocks of the recording scatter more than a scatter (9, 9) of the whole allows; at least 1.

        With gᵦ = Σ J s and Nᵦ = Σ JJᵀ of a block, N and B of the whole, q = Σ gᵦᵀB⁻¹gᵦ has the mean
        9 − Σ tr (N⁻¹Nᵦ)² about a fit, and twice that sum for its variance. Eight and four blocks are
        looked at; the largest q over its mean that chance does not explain counts.
        """
        values, vectors = _principal(scatter)
        rows = self.jacobian @ (vectors / np.sqrt(values))  # in which B is the unit matrix
        blocks = np.array_split(np.arange(len(rows)), BLOCKS)
        gradients = np.stack([self.distances[block] @ rows[block] for block in blocks])
        squares = np.stack([rows[block].T @ rows[block] for block in blocks])
        inverse = np.linalg.inv(squares.sum(axis=0))
        return largest_excess(gradients, squares, inverse)


def largest_excess(gradients: Floats, squares: Floats, inverse: Floats) -> float:
    """Largest q over its mean that chance does not explain, of blocks, of pairs of them and so on; at least 1.

    Parameters
    ----------
    gradients : (B, P) float
        Of blocks of a recording, in a basis in which their scatter should be the unit matrix.
    squares : (B, P, P) float
        Their Σ JJᵀ.
    inverse : (P, P) float
        That of the sum of the squares.
    """
    largest = 1.0
    while len(gradients) >= 4:
        shares = inverse @ squares
        taken = float(np.sum(shares * np.swapaxes(shares, 1, 2)))
        observed, expected = float(np.sum(gradients**2)), gradients.shape[1] - taken
        freedom = max(round(expected**2 / taken), 1)
        if expected > 0.0 and chance_of(observed * expected / taken, freedom) < BY_CHANCE:
            largest = max(largest, observed / expected)
        gradients, squares = gradients[::2] + gradients[1::2], squares[::2] + squares[1::2]
    return largest


def _not_below(scatter: Floats, white: Floats) -> Floats:
    """Keep a scatter matrix from claiming more than white residuals would, or much more than it does on average.

    An autocovariance that is cut off is not positive definite, and few independent readings make a noisy sum: in
    units of the white scatter no eigenvalue may be below one, or below a quarter of their mean.
    """
    values, vectors = _principal(white)
    inverse = vectors / np.sqrt(values)
    inflation, turned = np.linalg.eigh(inverse.T @ scatter @ inverse)
    inflation = np.maximum(inflation, max(1.0, float(inflation.mean()) / 4.0))
    spread = white @ inverse @ turned
    bounded: Floats = spread * inflation @ spread.T
    return bounded


def _principal(matrix: Floats) -> tuple[Floats, Floats]:
    """(k,) and (9, k): VᵀMV is diag(values) for a symmetric M, over the directions that rounding leaves of it."""
    diagonal = np.diag(matrix)
    observed = diagonal > ROUNDING * float(diagonal.max())
    scale = np.sqrt(np.where(observed, diagonal, 1.0))
    values, vectors = np.linalg.eigh(np.where(np.outer(observed, observed), matrix, 0.0) / np.outer(scale, scale))
    independent = values > DEPENDENT * values[-1]
    return values[independent], vectors[:, independent] / scale[:, np.newaxis]


def quadrature(autocovariance: Floats) -> tuple[list[int], Floats]:
    """Lags at which products are taken, and their weights: Σₖ C(k) M(k) with M linear between them."""
    last = len(autocovariance)
    if last < 2:
        return [], np.empty(0)
    lags = sorted({round(float(lag)) for lag in np.geomspace(1, last - 1, 20)})
    every = np.arange(1, last)
    hats = np.array([np.interp(every, lags, unit) for unit in np.eye(len(lags))])
    weights: Floats = hats @ autocovariance[1:]
    return lags, weights
