"""Pooling of several estimates of the same parameters, with a test of whether they contradict each other.

Each recording of a sensor gives an estimate and its claimed covariance. If the claims are true, the
scatter of the estimates about their weighted mean agrees with these covariances. A larger scatter means
something changed between the recordings; the excess is added to the uncertainty of the mean, as in the random-effects
model of a meta-analysis.

>>> north, south = np.array([0.0, 0.0]), np.array([3.0, 0.0])
>>> together = pool([north, south], [np.diag([0.01, 0.01])] * 2)
>>> together.mean, together.p_value < 1e-6
(array([1.5, 0. ]), True)
>>> together.scatter.round(1)                              # 3 apart: a variance of 3²/2 from one to the next
array([[4.5, 0. ],
       [0. , 0. ]])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats

MIN_EIGENVALUE_SHARE: Final = 1e-13
"""Smallest relative eigenvalue of a correlation matrix; below it a combination of parameters counts as fixed."""

MIN_SIGMA_SHARE: Final = 1e-12
"""Smallest standard deviation of a free parameter, relative to the largest; rounding leaves about 1e-16."""


@dataclass(frozen=True, slots=True, eq=False)
class PooledEstimate:
    """Pooled mean of n estimates of K parameters."""

    mean: Floats  #: (K,): mean weighted by the inverse covariances
    covariance: Floats  #: (K, K): covariance of the mean if all claims are true
    scatter: Floats  #: (K, K): covariance of the changes between recordings, beyond the claims; rank at most n − 1
    chi_square: float  #: chi-square of the estimates about their mean, by their claimed covariances
    freedom: int  #: degrees of freedom of `chi_square`
    count: int  #: n: number of estimates

    @property
    def p_value(self) -> float:
        """Probability of an equal or larger chi-square by chance."""
        return p_value_of(self.chi_square, self.freedom)

    @property
    def prediction_scatter(self) -> Floats:
        """(K, K) covariance to add for the next recording if the mean is used there: S (1 + 1/n), S being `scatter`."""
        return self.scatter * (1.0 + 1.0 / self.count)


def pool(estimates: Sequence[Floats], covariances: Sequence[Floats]) -> PooledEstimate:
    """Pool independent estimates by their claimed covariances.

    With Λᵢ = Pᵢ⁻¹, Λ their mean and dᵢ = θᵢ − θ̄, chi-square is Σ dᵢᵀΛᵢdᵢ, with ν = (n − 1)·K degrees of freedom. The
    scatter is max(0, 1 − ν/χ²) Σ DᵢDᵢᵀ/(n − 1) with Dᵢ = Λ⁻¹Λᵢdᵢ. A recording without information on a parameter does
    not contribute to its scatter. The factor 1 − ν/χ² removes the part that chance explains, as in James–Stein
    shrinkage.

    Parameters
    ----------
    estimates : sequence of (K,) float
        θᵢ: parameters estimated from recording i.
    covariances : sequence of (K, K) float
        Pᵢ: claimed covariance of θᵢ. They may be singular, but all in the same directions.

    References
    ----------
    R. DerSimonian, N. Laird, "Meta-analysis in clinical trials", Controlled Clinical Trials 7 (1986) 177–188.
    """
    origin, scale, precisions, voices = _precisions(estimates, covariances)
    whole = precisions.mean(axis=0)
    inverse = _inverse(whole)
    mean = inverse @ voices.mean(axis=0)
    count, rank = len(estimates), int(np.linalg.matrix_rank(whole, tol=MIN_EIGENVALUE_SHARE * _largest(whole)))
    apart = (np.stack(estimates) - origin) / scale - mean
    chi_square, freedom = float(np.einsum("ni,nij,nj", apart, precisions, apart)), (count - 1) * rank
    beyond = np.einsum("ij,njk,nk->ni", inverse, precisions, apart)
    excess = max(0.0, 1.0 - freedom / chi_square) if chi_square > 0.0 else 0.0
    scatter = excess * beyond.T @ beyond / max(count - 1, 1)
    squares = np.outer(scale, scale)
    return PooledEstimate(
        origin + mean * scale, inverse / count * squares, scatter * squares, chi_square, freedom, count
    )


def differences_from_others(
    estimates: Sequence[Floats], covariances: Sequence[Floats]
) -> Iterator[tuple[Floats, Floats]]:
    """Yield the difference of each estimate from the weighted mean of the others, and its claimed covariance.

    >>> off, covariance = next(differences_from_others([np.array([1.0]), np.array([0.0])], [np.eye(1), np.eye(1)]))
    >>> off, covariance
    (array([1.]), array([[2.]]))
    """
    origin, scale, precisions, voices = _precisions(estimates, covariances)
    squares = np.outer(scale, scale)
    for i, (estimate, covariance) in enumerate(zip(estimates, covariances, strict=True)):
        # summed again: subtraction of a dominant estimate would leave only rounding errors
        rest = np.arange(len(estimates)) != i
        others = _inverse(precisions[rest].sum(axis=0))
        mean = others @ voices[rest].sum(axis=0)
        yield estimate - origin - mean * scale, covariance + others * squares


def chi_square_of(difference: Floats, covariance: Floats) -> tuple[float, int]:
    """Chi-square of a (K,) difference, and its degrees of freedom: the directions of positive variance."""
    squares, ranks = chi_squares(difference[np.newaxis], covariance[np.newaxis])
    return float(squares[0]), int(ranks[0])


def chi_squares(differences: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """(n,) chi-squares and (n,) degrees of freedom of (n, K) differences with (n, K, K) covariances."""
    sigma = np.sqrt(np.einsum("nii->ni", covariances).clip(min=0.0))
    is_free = sigma > MIN_SIGMA_SHARE * sigma.max(axis=1, keepdims=True)
    scale = np.where(is_free, sigma, 1.0)
    values, axes = np.linalg.eigh(covariances / (scale[:, :, np.newaxis] * scale[:, np.newaxis]))
    is_independent = values > MIN_EIGENVALUE_SHARE * values[:, -1:]
    along = np.einsum("nji,nj->ni", axes, np.where(is_free, differences / scale, 0.0))
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        squares = np.where(is_independent, along**2 / values, 0.0).sum(axis=1)
    return squares, is_independent.sum(axis=1).astype(float)


def p_value_of(chi_square: float, freedom: int, others: float = math.inf) -> float:
    """Probability of an equal or larger chi-square by chance.

    The cube root of chi-square is nearly normal: Wilson and Hilferty, The distribution of chi-square, PNAS 17 (1931)
    684-688. The error is below 0.006 from three degrees of freedom on, and below 0.002 if p is below 0.1. If the
    variance is itself estimated, chi-square over its degrees of freedom has an F distribution: Paulson, An approximate
    normalization of the analysis of variance distribution, Ann. Math. Stat. 13 (1942) 233-235.

    Parameters
    ----------
    chi_square : float
        Sum of squares divided by the variance.
    freedom : int
        Degrees of freedom of `chi_square`.
    others : float
        Degrees of freedom of the estimate of the variance; infinite for a known variance.

    Examples
    --------
    >>> round(p_value_of(16.919, 9), 3), p_value_of(0.0, 9), p_value_of(1.0, 0)
    (0.05, 1.0, 1.0)
    >>> round(p_value_of(4 * 2.866, 4, others=20.0), 3)
    0.05
    """
    if freedom == 0 or chi_square <= 0.0:
        return 1.0
    if math.isinf(chi_square):
        return 0.0
    root = (chi_square / freedom) ** (1.0 / 3.0)
    ours, theirs = 2.0 / (9.0 * freedom), 2.0 / (9.0 * others)
    normal = ((1.0 - theirs) * root - (1.0 - ours)) / math.sqrt(theirs * root * root + ours)
    return math.erfc(normal / math.sqrt(2.0)) / 2.0


def _precisions(estimates: Sequence[Floats], covariances: Sequence[Floats]) -> tuple[Floats, Floats, Floats, Floats]:
    """(K,) origin and (K,) scale of new coordinates; in these, (n, K, K) inverses Λᵢ and (n, K) products Λᵢθᵢ."""
    scale = np.sqrt(np.mean([np.diag(covariance) for covariance in covariances], axis=0))
    scale[scale == 0.0] = 1.0
    precisions = np.stack([_inverse(covariance / np.outer(scale, scale)) for covariance in covariances])
    local = (np.stack(estimates) - estimates[0]) / scale
    return estimates[0], scale, precisions, np.einsum("nij,nj->ni", precisions, local)


def _inverse(matrix: Floats) -> Floats:
    """Pseudo-inverse of a symmetric matrix; eigenvalues below `MIN_EIGENVALUE_SHARE` of the largest count as zero."""
    return np.linalg.pinv(matrix, rcond=MIN_EIGENVALUE_SHARE, hermitian=True)


def _largest(matrix: Floats) -> float:
    """Largest eigenvalue of a symmetric matrix."""
    return float(np.linalg.eigvalsh(matrix)[-1])
