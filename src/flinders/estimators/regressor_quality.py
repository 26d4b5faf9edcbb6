"""Quality of a recorded column as the regressor of a disturbance.

A column may be noisy, monotone in time, or collinear with others, and its effect may be nonlinear.

**Noise.** Least squares assumes that the disturbance c is known exactly. White noise e of its meter reduces the
estimated offset per unit P by the fraction var e / var c, without larger residuals r. The noise shows in fast changes
of c: with h = c − (mean of w neighbours), and the sensitivity q = n·P of a reading to the disturbance,

    ρ = −Σ r q h / Σ (q h)²

is the fraction of fast changes that readings do not follow: 0 for an exact meter, 1 for noise alone. Because P is too
small, readings follow real changes more than the fit does. With both effects

    var e = ρ var h / (1 − 1/w − (1 − ρ) var h / var c)

With several disturbances, and noise of the variance v in each, the normal matrix N contains V = Σ v ∂N/∂v from noise.
The estimate is then N⁻¹(N − V) times the truth. The error is largest if disturbances are correlated, because then
mostly noise distinguishes them. About the estimate P̂ with its covariance C, the truth has the covariance

    M C Mᵀ + (M − 1) P̂ P̂ᵀ (M − 1)ᵀ,        M = (N − V)⁻¹ N

**Monotonicity.** A disturbance that only rises, or is switched on once, is correlated with time: a drift of the offset,
or a motion of the sensor, would have the same effect. `monotonicity` is the fraction of its variance that a monotone
function of time explains.

Source: errors in variables as in Fuller, "Measurement Error Models" (1987), §1.1 and chapter 2; isotonic regression by
pooling adjacent violators, Barlow et al. (1972).

>>> rng = np.random.default_rng(1)
>>> drawn = np.repeat(rng.uniform(0.0, 20.0, 30), 40)
>>> readings = 0.5 * drawn + rng.normal(scale=0.2, size=1200)
>>> for noise in (0.0, 3.0):
...     logged = drawn + rng.normal(scale=noise, size=1200)
...     slope, level = np.polyfit(logged, readings, 1)
...     too_small = attenuation(logged, readings - slope * logged - level, np.full(1200, slope))
...     print(f"{slope:.2f} {too_small:.1%}")
0.50 0.0%
0.39 20.9%
>>> monotonicity(np.linspace(0.0, 1.0, 100) ** 2), round(monotonicity(np.sin(np.linspace(0.0, 20.0, 1000))), 1)
(1.0, 0.2)

**Linearity.** The model is x = … + P c. If the field is proportional to c², such as that of a motor to its throttle, a
straight line is correct on average, but not at both ends and in the middle. Let w be c² minus its regression on c, and
κ the (3,) vector of the quadratic effect κ w. Let Q be the derivative of the residuals r by κ, minus its regression on
the other columns of the fit. Then

    κ = (QᵀQ)⁻¹ Qᵀr,        χ² = rᵀQ B⁻¹ Qᵀr,        B = cov Qᵀr

with three degrees of freedom. B includes the correlation of residuals after removal of κ w. `curvature` is the largest
size of κ w relative to that of P c, over the range of the disturbance and at its reference: a sixth for a field that is
proportional to c² from 0 on.

When to use it: after a fit with a disturbance, on a bench or while turning. It gives no information for a disturbance
with only two values, or beyond the recorded range.

Source: the score test, C. R. Rao, *Large sample tests of statistical hypotheses concerning several parameters*, 1948.

>>> rng = np.random.default_rng(1)
>>> drawn = np.tile(np.linspace(0.0, 1.0, 200), 4)
>>> noise = rng.normal(scale=0.1, size=800)
>>> columns, rows = np.column_stack([np.ones(800), drawn]), [np.arange(800)]
>>> for made in (6.0 * drawn, 6.0 * drawn**2):
...     slope, level = np.polyfit(drawn, made + noise, 1)
...     left = Residuals(made + noise - slope * drawn - level, columns, rows)
...     print(round(curvature(drawn, left, np.ones((800, 1)), np.array([slope])), 2))
0.0
0.17
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.core.disturbance import is_column
from flinders.estimators.covariance import Residuals
from flinders.likelihood.robust import robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

MIN_CURVATURE_CHI_SQUARE: Final = 30.0
"""Smallest χ² of three degrees of freedom for a significant curvature: exceeded by chance once in a million."""

MIN_COLUMN_RATIO: Final = 1e-3
"""Smallest length of a column after regression, relative to its length before, for an estimate of a curvature."""

RANGE_QUANTILES: Final = (0.02, 0.98)
"""Quantiles of the values of a disturbance that define its range, so that spikes of the meter are ignored."""


def curvature(values: Floats, residuals: Residuals, sensitivity: Floats, per_unit: Floats) -> float:
    """Nonlinear part of a disturbance's effect, relative to the linear effect; 0 if not significant.

    Parameters
    ----------
    values : (N,) float
        Values of the disturbance at each residual minus its reference, in its unit.
    residuals : Residuals
        Residuals of a fit in the unit of the readings, with the (N, K) columns of all its parameters.
    sensitivity : (N, D) float
        Derivative of each residual by an offset along each of D axes.
    per_unit : (D,) float
        Effect of one unit of the disturbance, in the unit of the readings.

    Returns
    -------
    float
        Largest difference from a straight line, over the range of the disturbance and at its reference, divided by the
        linear effect at the far end of the range.
    """
    low, high = np.quantile(values, RANGE_QUANTILES)
    made = float(np.linalg.norm(per_unit) * max(abs(low), abs(high)))
    if not (made > 0.0 and high > low):
        return 0.0
    scaled = (values - low) / (high - low)
    line = np.polyfit(scaled, scaled**2, 1)
    bend = scaled**2 - np.polyval(line, scaled)
    whole = sensitivity * bend[:, np.newaxis]
    rest = whole - residuals.jacobian @ np.linalg.lstsq(residuals.jacobian, whole, rcond=None)[0]
    least = MIN_COLUMN_RATIO * np.linalg.norm(sensitivity, axis=0)
    if np.any(np.linalg.norm(whole, axis=0) < least) or np.any(np.linalg.norm(rest, axis=0) < least):
        return 0.0
    pulled = rest.T @ residuals.distances
    solution = np.linalg.pinv(rest.T @ rest, hermitian=True) @ pulled
    within = Residuals(residuals.distances - rest @ solution, rest, residuals.segments)
    chi_square = float(pulled @ np.linalg.pinv(within.scatter(within.autocovariance()), hermitian=True) @ pulled)
    if chi_square < MIN_CURVATURE_CHI_SQUARE:
        return 0.0
    ends = np.array([min(low, 0.0), max(high, 0.0), low + 0.5 * (high - low) * line[0]])  # the last is its vertex
    places = (ends - low) / (high - low)
    return float(np.linalg.norm(solution) * np.abs(places**2 - np.polyval(line, places)).max()) / made


WINDOW_LENGTHS: Final = (15, 45, 135)
"""Lengths in readings of the moving averages that are subtracted to obtain fast changes.

Readings follow real fast changes, so that these do not count as noise. Longer windows detect a meter that repeats its
last value. The longest window is much shorter than the recording, because a fit follows slow changes in any case.
"""

MIN_SLOW_SHARE: Final = 0.25
"""Smallest assumed fraction of slow changes in the variance of a disturbance."""

MIN_NOISE_SIGMAS: Final = 4.0
"""Smallest significant noise of a meter, in standard deviations."""

MIN_INCREASE_SIGMAS: Final = 3.0
"""Smallest increase of the estimated noise, in standard deviations, for which a longer window is used."""

MAX_NOISE_SHARE: Final = 0.75
"""Largest fraction of noise in the information on a combination of disturbances."""

UNIFORM_MEAN_SHARE: Final = 0.75
"""Ratio of the squared mean to the mean square of a value distributed uniformly between zero and a maximum."""

COURSE_MEANS: Final = 100
"""Number of means over time that represent a disturbance in the test for monotonicity."""


class Noise(NamedTuple):
    """Estimated noise of the meter of a disturbance."""

    #: variance of the noise, in the square of the disturbance's unit; negative if readings follow fast changes more
    #: than slow ones, as with a slow meter
    variance: float
    sigma: float  #: standard deviation of `variance`
    own: float = np.inf  #: upper limit of the variance of white noise and rounding, from the values of the column alone

    @property
    def is_proven(self) -> bool:
        """Whether the noise is significant."""
        return self.variance > MIN_NOISE_SIGMAS * self.sigma

    @property
    def square(self) -> float:
        """Expected square of the variance; limited by `own` if the noise is not significant."""
        shown = self.variance**2 + self.sigma**2
        return shown if abs(self.variance) > MIN_NOISE_SIGMAS * self.sigma else min(shown, self.own**2)


def noise_of(values: Floats, residuals: Floats, sensitivity: Floats) -> Noise:
    """Noise of a meter, by the shortest window of `WINDOW_LENGTHS` that shows as much noise as longer ones.

    Parameters
    ----------
    values : (N,) float
        Values of the disturbance, in the order of recording.
    residuals : (N,) float
        Residuals of the fit, in the unit of the readings.
    sensitivity : (N,) float
        Derivative of each residual by the disturbance.
    """
    noises = [
        _noise_in_window(window, values, residuals, sensitivity)
        for window in WINDOW_LENGTHS
        if 2 * window < len(values)
    ]
    most = noises[0] if noises else Noise(0.0, 0.0)
    for one in noises[1:]:
        if abs(one.variance) > max(MIN_NOISE_SIGMAS * one.sigma, abs(most.variance) + MIN_INCREASE_SIGMAS * one.sigma):
            most = one
    return most._replace(own=_max_white_noise(values))


def _max_white_noise(values: Floats) -> float:
    """Upper limit of the variance of white noise in (N,) values, from the median of squared second differences.

    >>> course = np.repeat([0.0, 9.0, 4.0], 2000) + np.random.default_rng(1).normal(scale=0.5, size=6000)
    >>> round(_max_white_noise(course), 2)
    0.25
    """
    bends = np.diff(values, 2)
    return robust_sigma(bends) ** 2 / 6.0 if len(bends) else 0.0


def rounding_variance(values: Floats, name: str = "") -> tuple[float, NDArray[np.intp]]:
    """Variance of the rounding error of (N,) values, and (N,) index of the stretch of equal values of each value.

    The resolution is the smallest difference of two values. The rounding error is about constant in a stretch of equal
    values. A column of the log, `name`, with only two values has two states, which are exact.

    >>> rounding_variance(np.array([1.0, 3.0, 3.0, 4.0, 9.0]))
    (0.08333333333333333, array([0, 1, 1, 2, 3]))
    """
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    is_exact = len(steps) == 1 and bool(name) and is_column(name)
    step = float(steps.min()) if len(steps) and not is_exact else 0.0
    return step**2 / 12.0, np.append(0, np.cumsum(np.diff(values) != 0.0))


def _noise_in_window(window: int, values: Floats, residuals: Floats, sensitivity: Floats) -> Noise:
    """Noise of a meter, from the changes that a moving average over `window` readings does not follow."""
    half = window // 2
    fast = np.zeros(len(values))
    fast[half:-half] = values[half:-half] - np.convolve(values, np.full(window, 1.0 / window), mode="valid")
    moved = sensitivity * fast
    square = float(moved @ moved)
    if square <= 0.0:
        return Noise(0.0, 0.0)
    size, whole = float(np.mean(fast[half:-half] ** 2)), float(np.var(values))
    missing = -size * float(residuals @ moved) / square
    slow = max(1.0 - 1.0 / window - (size - missing) / whole, MIN_SLOW_SHARE)
    return Noise(missing / slow, size * float(np.std(residuals)) / np.sqrt(square) / slow)


def pool_noise(noises: Sequence[Noise]) -> list[Noise]:
    """Noises of meters of one kind: their mean if it is significant and the noises agree, else unchanged.

    >>> [round(noise.variance, 2) for noise in pool_noise([Noise(0.9, 0.2), Noise(0.6, 0.2), Noise(1.1, 0.4)])]
    [0.79, 0.79, 0.79]
    >>> pool_noise([Noise(0.9, 0.1), Noise(0.0, 0.1)])
    [Noise(variance=0.9, sigma=0.1, own=inf), Noise(variance=0.0, sigma=0.1, own=inf)]
    """
    usable = [noise for noise in noises if noise.sigma > 0.0]
    if len(usable) < max(len(noises), 2):
        return list(noises)
    weights = np.array([noise.sigma**-2.0 for noise in usable])
    variances = np.array([noise.variance for noise in usable])
    mean, sigma = float(weights @ variances / weights.sum()), float(weights.sum() ** -0.5)
    spread, count = float(weights @ (variances - mean) ** 2), len(usable) - 1
    if mean < MIN_NOISE_SIGMAS * sigma or spread > count + MIN_INCREASE_SIGMAS * np.sqrt(2.0 * count):
        return list(noises)
    return [Noise(mean, sigma, noise.own) for noise in noises]


class RegressorError(NamedTuple):
    """Errors of the meter of one disturbance, and their effect on the normal matrix."""

    noise: Noise
    rounded: float  #: variance of the rounding error
    #: (K, r): root of the matrix that noise with a variance of 1 adds to the normal matrix of K parameters
    root: Floats


def widen_covariance(
    covariance: Floats, inverse: Floats, coefficients: Floats, meters: Sequence[RegressorError]
) -> Floats:
    """(K, K) covariance of an estimate about the truth, including the errors of the meters.

    Significant noise of a meter changes all parameters together, by the formula at the head of this module, with an
    independent uncertainty for each meter. If the noise is not significant, the mean of the possible noise is used, and
    the errors of all meters are added with the same sign.

    Parameters
    ----------
    covariance : (K, K) float
        Covariance for exact disturbances.
    inverse : (K, K) float
        Inverse of the normal matrix.
    coefficients : (K,) float
        Parameters that are coefficients of the disturbances; 0 for all others.
    meters : sequence of RegressorError
        Errors of the meter of each disturbance.

    Examples
    --------
    Half of the information on the only parameter is noise:

    >>> half = RegressorError(Noise(1.0, 0.0), 0.0, np.array([[1.0]]))
    >>> widen_covariance(np.array([[0.01]]), np.array([[0.5]]), np.array([3.0]), [half])
    array([[9.04]])
    """
    shown = [np.sqrt(meter.noise.variance) * meter.root for meter in meters if meter.noise.is_proven]
    root = np.column_stack([np.zeros((len(coefficients), 0)), *shown])
    shares, turned = np.linalg.eigh(root.T @ inverse @ root)
    along = root @ turned
    grown = np.eye(len(coefficients)) + inverse @ along / (1.0 - np.minimum(shares, MAX_NOISE_SHARE)) @ along.T
    moved = grown @ coefficients - coefficients
    wider: Floats = grown @ covariance @ grown.T + np.outer(moved, moved)
    pulled = np.zeros(len(coefficients))
    for meter in meters:
        off = grown @ inverse @ meter.root @ (meter.root.T @ coefficients)
        unknown = meter.noise.sigma**2 if meter.noise.is_proven else (1.0 - UNIFORM_MEAN_SHARE) * meter.noise.square
        wider += (unknown + (1.0 - UNIFORM_MEAN_SHARE) * meter.rounded**2) * np.outer(off, off)
        pulled += np.hypot(0.0 if meter.noise.is_proven else np.sqrt(meter.noise.square), meter.rounded) * off
    return wider + UNIFORM_MEAN_SHARE * np.outer(pulled, pulled)


def attenuation(values: Floats, residuals: Floats, sensitivity: Floats) -> float:
    """Fraction by which an estimated offset per unit is too small because of a noisy meter; 0 if not significant.

    Parameters are those of `noise_of`.
    """
    noise, variance = noise_of(values, residuals, sensitivity), float(np.var(values))
    return min(noise.variance / variance, 1.0) if noise.is_proven and variance > 0.0 else 0.0


def monotonicity(values: Floats) -> float:
    """Fraction of the variance of (N,) values, in the order of recording, that a monotone function of time explains."""
    course = np.array([part.mean() for part in np.array_split(values, min(COURSE_MEANS, len(values)))])
    total = float(np.var(values))
    if total <= 0.0:
        return 0.0
    return float(max(np.var(_isotonic(course)), np.var(_isotonic(-course)))) / total


def collinearity(values: Floats, others: Floats) -> float:
    """Fraction of the variance of (N,) values that a linear function of (N, K) other disturbances explains, 0 to 1.

    >>> drawn = np.random.default_rng(1).uniform(0.0, 20.0, (500, 3))
    >>> round(collinearity(drawn[:, 0], drawn[:, 1:]), 1), round(collinearity(drawn.sum(axis=1), drawn), 3)
    (0.0, 1.0)
    """
    about = values - values.mean()
    total = float(about @ about)
    if not (total > 0.0 and others.shape[1]):
        return 0.0
    centred = others - others.mean(axis=0)
    left = about - centred @ np.linalg.lstsq(centred, about, rcond=None)[0]
    return min(max(1.0 - float(left @ left) / total, 0.0), 1.0)


def shared_information(jacobian: Floats, regressors: Floats) -> float:
    """Largest fraction of the information on a disturbance that offset and shape could explain, 0 to 1.

    It is the largest squared canonical correlation between the (N, 3) columns of a disturbance, relative to its mean,
    and the (N, 9) columns of the ellipsoid. At 1 they cannot be distinguished.

    >>> rng = np.random.default_rng(1)
    >>> ellipsoid, unrelated = rng.normal(size=(500, 9)), rng.normal(size=(500, 3))
    >>> [round(shared_information(ellipsoid, columns), 1) for columns in (ellipsoid[:, :3], unrelated)]
    [1.0, 0.0]
    """
    ours, _ = np.linalg.qr(jacobian / _column_lengths(jacobian))
    theirs, _ = np.linalg.qr(regressors / _column_lengths(regressors))
    return float(np.clip(np.linalg.norm(ours.T @ theirs, ord=2) ** 2, 0.0, 1.0))


def _column_lengths(columns: Floats) -> Floats:
    """(K,) lengths of columns; 1 for a column of zeros."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes > 0.0, sizes, 1.0)


def _isotonic(course: Floats) -> Floats:
    """Isotonic regression: the non-decreasing values that are nearest to given values in least squares."""
    pools: list[tuple[float, int]] = []
    for value in course.tolist():
        mean, count = value, 1
        while pools and pools[-1][0] >= mean:
            before, size = pools.pop()
            mean, count = (before * size + mean * count) / (size + count), size + count
        pools.append((mean, count))
    return np.repeat([mean for mean, _ in pools], [count for _, count in pools])
