"""Covariance of a fit: that of closed forms, and the effect of residuals correlated in time and direction.

The textbook covariance σ²(JᵀJ)⁻¹ assumes independent residuals. Residuals of real recordings are
correlated, because of gradients of the field along the path of the hand, magnetic parts of the body, and
nonlinearity of the sensor. The headings of four calibrations of one board differ by about three times what
this covariance claims.

The error of a fit depends on the scatter of Σ J s over residuals s. With correlated residuals it is

    B = Σᵢⱼ Jᵢ Jⱼᵀ C(tᵢ − tⱼ) + Σᵢⱼ Jᵢ Jⱼᵀ D(uᵢ, uⱼ)

C is the autocovariance of the residuals as a function of the lag. It is estimated from all residuals and
truncated where it is smaller than its noise; the products of Jacobians are those of the recording. D is a
distortion that depends on the direction. The size of the distortion is estimated from residuals in one
direction at different times. The distortion is modelled as smooth, without the part that an ellipsoid over all
directions would absorb.

A slow drift over minutes that is smaller than the noise of a single reading does not show in the autocovariance, but
can change a fit more than the noise does. It is detected by dividing the recording into a few blocks: the gradients
Σ J s of the blocks are then larger than B allows, and B is multiplied by the excess.

Residuals below `MIN_NOISE`, a millionth of the field, are rounding errors of exact readings or of single precision.
They depend on the arithmetic instead of the sensor, and are treated as white. The covariance claims at least this
noise.

References
----------
W. K. Newey, K. D. West, Econometrica 55 (1987) 703–708, for sums over lags; a Gaussian process on the sphere with
a squared exponential kernel for D; blocks as in R. T. Birge, Phys. Rev. 40 (1932) 207–227, by external and internal
consistency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude
from flinders.likelihood.equations import MIN_EIGENVALUE_RATIO, MIN_NOISE
from flinders.likelihood.identifiability import Support, spurious_information
from flinders.summary.coverage import corrected_directions
from flinders.summary.pooling import MIN_EIGENVALUE_SHARE, p_value_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

FULL_BASIS: Final = np.eye(9)
"""Basis of the parameters of a fit without constraints."""

ALIGNED_BASIS: Final = np.eye(9)[:, :6]
"""Basis of the parameters of a fit with a diagonal shape."""

SPHERE_BASIS: Final = np.concatenate([np.eye(9)[:, :3], np.eye(9)[:, 3:6].sum(axis=1, keepdims=True)], axis=1)
"""Basis of the parameters of a fit whose shape is a multiple of the identity."""


def algebraic_noise(readings: Readings, ellipsoid: Ellipsoid, unknowns: int) -> float:
    """Standard deviation of the distance from an ellipsoid, from the sums alone.

    With q(x) = |S⁻¹(x − b)|² − 1 and s ≈ q/|∇q| it is √(Σq² / Σ|∇q|²), corrected for the unknowns.

    Raises `NotAnEllipsoid` for a surface so far from its readings that only rounding remains.
    """
    moments = readings.summary.moments
    scale = ellipsoid.radius
    scatter = moments.about(ellipsoid.centre, scale)
    local = Ellipsoid(np.zeros(3), ellipsoid.shape / scale).as_quadric()
    form = np.linalg.matrix_power(np.linalg.inv(ellipsoid.shape / scale), 4)
    steepness = 4.0 * float(np.sum(form * scatter[6:9, 6:9]))
    freedom = max(moments.count - unknowns, 1.0) / moments.count
    if not steepness > 0.0:  # only rounding remains for a surface far from its readings
        raise NotAnEllipsoid()
    square = max(float(local @ scatter @ local), 0.0) / steepness / freedom
    return scale * float(np.sqrt(square))


def algebraic_covariance(readings: Readings, ellipsoid: Ellipsoid, noise: float, basis: Floats = FULL_BASIS) -> Floats:
    """(9, 9) covariance of a fit that minimises Σ q(x)², with any normalisation.

    q = |∇q| s, so to first order such a fit is a least-squares fit of the distances s with weights
    w = |∇q|². Its covariance is σ² N⁻¹ (Σ w² JJᵀ) N⁻¹ with N = Σ w JJᵀ, which is larger than that of the
    likelihood with equal weights. The sums are over the cells of the cloud. The standard deviation of an unobservable
    direction is the radius.

    `noise` is in the unit of the readings; `basis` is the (9, k) basis of the parameters of the method.
    """
    cloud = readings.summary.cloud
    directions = corrected_directions(cloud.means, ellipsoid)
    jacobian = magnitude.information(directions, ellipsoid) @ basis
    variance = max(noise, MIN_NOISE * ellipsoid.radius) ** 2
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


def unexplained_part(difference: Floats, covariance: Floats) -> Floats:
    """(P,) part of the difference d of two estimates that is not explained by its covariance C.

    By chance alone χ² = dᵀC⁻¹d has the mean P. The result is d √max(0, 1 − P/χ²), as in James–Stein shrinkage.
    """
    chi_square = float(difference @ np.linalg.pinv(covariance, rcond=1e-12, hermitian=True) @ difference)
    share = max(0.0, 1.0 - len(difference) / chi_square) if chi_square > 0.0 else 0.0
    beyond: Floats = difference * np.sqrt(share)
    return beyond


MAX_LAG: Final = 1000
"""Largest lag in readings: twenty seconds at 50 Hz, longer than a turn by hand."""

MIN_PAIR_SHARE: Final = 0.75
"""Smallest number of pairs of readings at a lag, relative to the number of readings; larger lags are not used."""

MIN_CORRELATION_ERRORS: Final = 2.0
"""Smallest significant correlation in standard errors."""

BLOCK_COUNT: Final = 8
"""Number of blocks of a recording in which slow drifts are searched; the blocks are also merged to four."""

DRIFT_PROBABILITY: Final = 0.02
"""p-value below which a slow drift counts as real."""


def correlation_length(autocovariance: Floats) -> float:
    """Correlation length 1 + 2 Σ C(k)/C(0): number of readings that are equivalent to one independent reading."""
    return 1.0 + 2.0 * float(autocovariance[1:].sum()) / max(float(autocovariance[0]), 1e-300)


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Distances from the surface in the order of recording."""

    distances: Floats  # (N,)
    jacobian: Floats  # (N, 9)
    segments: list[NDArray[np.int64]]  # list of (m,) int: indices of consecutive residuals

    def lag_one(self) -> float:
        """Correlation of consecutive residuals."""
        products = sum(float(self.distances[s][1:] @ self.distances[s][:-1]) for s in self.segments)
        return products / max(float(self.distances @ self.distances), 1e-300)

    def variance(self) -> Floats:
        """(1,) variance C(0) of the residuals, which is the whole autocovariance of white residuals."""
        return np.array([float(self.distances @ self.distances) / len(self.distances)])

    def autocovariance(self) -> Floats:
        """(K,) autocovariance C(0), C(1), … up to the lag at which it falls below its noise; C(0) if white."""
        total = len(self.distances)
        most = self._max_lag()
        if abs(self.lag_one()) < MIN_CORRELATION_ERRORS / np.sqrt(total) or most < 2:
            return self.variance()
        sums = np.zeros(most)
        for segment in self.segments:
            spectrum = np.fft.rfft(self.distances[segment], 2 * len(segment))
            products = np.fft.irfft(np.abs(spectrum) ** 2)[: min(most, len(segment))]
            sums[: len(products)] += products
        sunk = np.flatnonzero(sums < MIN_CORRELATION_ERRORS / np.sqrt(total) * sums[0])
        return sums[: sunk[0] if len(sunk) else most] / total

    def _max_lag(self) -> int:
        """Largest lag at which enough readings have a partner in their segment."""
        lengths = np.array([len(segment) for segment in self.segments])
        lags = np.arange(1, min(int(lengths.max()), MAX_LAG) + 1)
        partners = np.maximum(lengths - lags[:, np.newaxis], 0).sum(axis=1)
        return int(np.count_nonzero(partners >= MIN_PAIR_SHARE * lengths.sum()))

    def scatter(self, autocovariance: Floats) -> Floats:
        """(9, 9) scatter Σᵢⱼ JᵢJⱼᵀ C(i − j) of the gradient; products are computed at a few lags and interpolated."""
        white = autocovariance[0] * self.jacobian.T @ self.jacobian
        total = white.copy()
        lags, weights = quadrature(autocovariance)
        for lag, weight in zip(lags, weights, strict=True):
            for segment in self.segments:
                rows = self.jacobian[segment]
                product = rows[:-lag].T @ rows[lag:]
                total += weight * (product + product.T)
        return total if not lags else _raise_eigenvalues(total, white)

    def excess_variance(self, scatter: Floats) -> float:
        """Ratio of variances, at least 1: scatter of blocks over that expected from the (9, 9) scatter of the whole.

        Let gᵦ = Σ J s and Nᵦ = Σ JJᵀ of a block, N = Σ JJᵀ of the whole, and B the `scatter`. With T = Σ tr (N⁻¹Nᵦ)²,
        q = Σ gᵦᵀB⁻¹gᵦ has the mean 9 − T, because the parameters are fitted, and the variance 2 T. The result is the
        largest ratio of q to its mean, for eight and for four blocks, that chance does not explain.
        """
        values, vectors = _principal_axes(scatter)
        rows = self.jacobian @ (vectors / np.sqrt(values))  # in which B is the unit matrix
        blocks = np.array_split(np.arange(len(rows)), BLOCK_COUNT)
        gradients = np.stack([self.distances[block] @ rows[block] for block in blocks])
        squares = np.stack([rows[block].T @ rows[block] for block in blocks])
        inverse = np.linalg.inv(squares.sum(axis=0))
        return largest_excess(gradients, squares, inverse)


def largest_excess(gradients: Floats, squares: Floats, inverse: Floats) -> float:
    """Largest significant ratio of q, as in `Residuals.excess_variance`, to its mean; at least 1.

    The ratio is computed for the blocks, for pairs of blocks, and so on.

    Parameters
    ----------
    gradients : (B, P) float
        Gradients of blocks of a recording, in a basis in which their expected scatter is the unit matrix.
    squares : (B, P, P) float
        Σ JJᵀ of the blocks, in the same basis.
    inverse : (P, P) float
        Inverse of the sum of `squares`.
    """
    largest = 1.0
    while len(gradients) >= 4:
        shares = inverse @ squares
        taken = float(np.sum(shares * np.swapaxes(shares, 1, 2)))
        observed, expected = float(np.sum(gradients**2)), gradients.shape[1] - taken
        freedom = max(round(expected**2 / taken), 1)
        if expected > 0.0 and p_value_of(observed * expected / taken, freedom) < DRIFT_PROBABILITY:
            largest = max(largest, observed / expected)
        gradients, squares = gradients[::2] + gradients[1::2], squares[::2] + squares[1::2]
    return largest


def _raise_eigenvalues(scatter: Floats, white: Floats) -> Floats:
    """Bound the eigenvalues of a scatter matrix from below, relative to the scatter of white residuals.

    A truncated autocovariance is not positive definite, and few independent readings give a noisy sum. In units of the
    white scatter, the eigenvalues are raised to at least one, and to at least a quarter of their mean.
    """
    values, vectors = _principal_axes(white)
    inverse = vectors / np.sqrt(values)
    inflation, turned = np.linalg.eigh(inverse.T @ scatter @ inverse)
    inflation = np.maximum(inflation, max(1.0, float(inflation.mean()) / 4.0))
    spread = white @ inverse @ turned
    bounded: Floats = spread * inflation @ spread.T
    return bounded


def _principal_axes(matrix: Floats) -> tuple[Floats, Floats]:
    """(k,) values and (9, k) vectors V with VᵀMV = diag(values), for a symmetric matrix M.

    The values are the eigenvalues of M scaled to a diagonal of ones, without those that are rounding errors.
    """
    diagonal = np.diag(matrix)
    observed = diagonal > MIN_EIGENVALUE_RATIO * float(diagonal.max())
    scale = np.sqrt(np.where(observed, diagonal, 1.0))
    values, vectors = np.linalg.eigh(np.where(np.outer(observed, observed), matrix, 0.0) / np.outer(scale, scale))
    independent = values > MIN_EIGENVALUE_SHARE * values[-1]
    return values[independent], vectors[:, independent] / scale[:, np.newaxis]


def quadrature(autocovariance: Floats) -> tuple[list[int], Floats]:
    """Lags and weights of a sum that approximates Σₖ C(k) M(k), with M linear between these lags."""
    last = len(autocovariance)
    if last < 2:
        return [], np.empty(0)
    lags = sorted({round(float(lag)) for lag in np.geomspace(1, last - 1, 20)})
    every = np.arange(1, last)
    hats = np.array([np.interp(every, lags, unit) for unit in np.eye(len(lags))])
    weights: Floats = hats @ autocovariance[1:]
    return lags, weights
