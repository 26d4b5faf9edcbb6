"""Whether a recorded column is fit to be the regressor of a disturbance.

It may be noisy, monotone in time, collinear with others, and what it makes may not be linear in it.

**Noise.** Least squares takes the disturbance as known. White noise e of its meter makes P too small, by the share
var e / var c, and no residual is larger for it. It shows in fast changes: with h = c − (mean of some about it), a
reading whose sensitivity to the disturbance is q = n·P leaves

    ρ = −Σ r q h / Σ (q h)²

which is the share of fast changes that readings do not follow: 0 for an exact meter, 1 where all of it is noise. As P
is too small, readings follow real changes more than the fit does; with both, and means of w,

    var e = ρ var h / (1 − 1/w − (1 − ρ) var h / var c)

With several disturbances it is the normal matrix N that grows, by V = Σ v ∂N/∂v: what was found is N⁻¹(N − V) of what
there is, and is off most where disturbances went along with each other, as little but noise distinguishes them there.
Around what was found, P̂ with its covariance C, the truth scatters by

    M C Mᵀ + (M − 1) P̂ P̂ᵀ (M − 1)ᵀ,        M = (N − V)⁻¹ N

**One way.** What only rises, or is switched on once, goes with time as well: an offset that drifts, or a sensor that
moved, would look the same. `monotonicity` is the share of its variance that a monotone function of time explains.

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

**Linearity.** The model is x = … + P c. Where the field goes with c², as that of a motor may with its throttle, a
straight line is right in the mean and off at both ends and in the middle. With w = c² less its straight line in c, r
what the fit leaves, and Q the columns by which κ w moves r, less what the fit's own columns J explain of them,

    κ = (QᵀQ)⁻¹ Qᵀr,        χ² = rᵀQ B⁻¹ Qᵀr,        B = cov Qᵀr

with three degrees of freedom, B allowing for residuals that are correlated once κ w is removed. `curvature` is the
size of κ w over that of P c, over the range of the disturbance and at its reference: a sixth for a field that goes with
c² from 0 on.

When to use it: after a fit that follows a disturbance, on a bench or while turning. It says nothing of a disturbance
that takes two values alone, nor of what happens beyond the range that was recorded.

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

PROVEN: Final = 30.0
"""χ² of three degrees of freedom beyond which a curve is no chance: once in a million."""

FLAT: Final = 1e-3
"""Share of a column that has to be left for anything to be told of it."""

ENDS: Final = (0.02, 0.98)
"""Quantiles between which a disturbance is looked at: a spike of its meter is no range."""


def curvature(values: Floats, residuals: Residuals, sensitivity: Floats, per_unit: Floats) -> float:
    """How far what a disturbance makes is off a straight line, as a share of what it makes; 0 where that may be chance.

    Parameters
    ----------
    values : (N,) float
        Of the disturbance at each residual less its reference, in its unit.
    residuals : Residuals
        What a fit leaves, in the unit of the readings, with (N, K) columns of all that it was fitted by.
    sensitivity : (N, D) float
        By how much each residual moves with an offset along each of D axes.
    per_unit : (D,) float
        What one unit of the disturbance makes, in the unit of the readings.

    Returns
    -------
    float
        Largest departure from the line over the range of the disturbance and at its reference, over what the line makes
        at the far end of that range.
    """
    low, high = np.quantile(values, ENDS)
    made = float(np.linalg.norm(per_unit) * max(abs(low), abs(high)))
    if not (made > 0.0 and high > low):
        return 0.0
    scaled = (values - low) / (high - low)
    line = np.polyfit(scaled, scaled**2, 1)
    bend = scaled**2 - np.polyval(line, scaled)
    whole = sensitivity * bend[:, np.newaxis]
    rest = whole - residuals.jacobian @ np.linalg.lstsq(residuals.jacobian, whole, rcond=None)[0]
    least = FLAT * np.linalg.norm(sensitivity, axis=0)
    if np.any(np.linalg.norm(whole, axis=0) < least) or np.any(np.linalg.norm(rest, axis=0) < least):
        return 0.0
    pulled = rest.T @ residuals.distances
    solution = np.linalg.pinv(rest.T @ rest, hermitian=True) @ pulled
    within = Residuals(residuals.distances - rest @ solution, rest, residuals.segments)
    chi_square = float(pulled @ np.linalg.pinv(within.scatter(within.autocovariance()), hermitian=True) @ pulled)
    if chi_square < PROVEN:
        return 0.0
    ends = np.array([min(low, 0.0), max(high, 0.0), low + 0.5 * (high - low) * line[0]])  # the last is its vertex
    places = (ends - low) / (high - low)
    return float(np.linalg.norm(solution) * np.abs(places**2 - np.polyval(line, places)).max()) / made


WINDOWS: Final = (15, 45, 135)
"""Readings whose mean is removed: what is left is fast. Real changes in it are followed, and do not count.

The longer ones see a meter that holds its value; the longest stays far from the whole course, which every fit follows.
"""

LEFT: Final = 0.25
"""Share of a course that at least has to be slow."""

SIGNIFICANT: Final = 4.0
"""Standard deviations beyond which fast changes are missing."""

FURTHER: Final = 3.0
"""Standard deviations by which a longer window has to tell more than a shorter one: chance makes one of them most."""

MOST_NOISE: Final = 0.75
"""Share of what tells about a combination of disturbances that noise of their meters makes, at most."""

MEAN: Final = 0.75
"""Share of a mean square that is the square of the mean, of what lies anywhere between none and a largest value."""

STRETCHES: Final = 100
"""Means of which a course is made up."""


class Noise(NamedTuple):
    """What a meter adds to a disturbance."""

    #: in the square of the disturbance's unit; below zero where readings follow fast changes more than others, as they
    #: do where the meter is slow
    variance: float
    sigma: float  #: standard deviation of that
    own: float = np.inf  #: the most that the column itself allows for white noise and rounding, in that square

    @property
    def is_proven(self) -> bool:
        """No chance makes so much of it."""
        return self.variance > SIGNIFICANT * self.sigma

    @property
    def square(self) -> float:
        """Expected square of the variance: of what readings show of it, or else of what the column allows."""
        shown = self.variance**2 + self.sigma**2
        return shown if abs(self.variance) > SIGNIFICANT * self.sigma else min(shown, self.own**2)


def noise_of(values: Floats, residuals: Floats, sensitivity: Floats) -> Noise:
    """Noise of a meter, by the shortest window that tells as much of it as longer ones.

    Parameters
    ----------
    values : (N,) float
        Of the disturbance, in the order of recording.
    residuals : (N,) float
        What the fit leaves, in the unit of the readings.
    sensitivity : (N,) float
        By how much each of them moves with one unit of the disturbance.
    """
    noises = [_noise_by(window, values, residuals, sensitivity) for window in WINDOWS if 2 * window < len(values)]
    most = noises[0] if noises else Noise(0.0, 0.0)
    for one in noises[1:]:
        if abs(one.variance) > max(SIGNIFICANT * one.sigma, abs(most.variance) + FURTHER * one.sigma):
            most = one
    return most._replace(own=_white(values))


def _white(values: Floats) -> float:
    """Variance of white noise in (N,) values, at most: by second differences, robustly, as real changes are steps.

    >>> course = np.repeat([0.0, 9.0, 4.0], 2000) + np.random.default_rng(1).normal(scale=0.5, size=6000)
    >>> round(_white(course), 2)
    0.25
    """
    bends = np.diff(values, 2)
    return robust_sigma(bends) ** 2 / 6.0 if len(bends) else 0.0


def rounding(values: Floats, name: str = "") -> tuple[float, NDArray[np.intp]]:
    """Variance of what was rounded off (N,) values of a disturbance, and (N,) the number of the setting of each.

    The step is the smallest between two of them. What was rounded off is about the same for as long as one holds. Of a
    column of two values, by its `name`, they are states, and exact.

    >>> rounding(np.array([1.0, 3.0, 3.0, 4.0, 9.0]))
    (0.08333333333333333, array([0, 1, 1, 2, 3]))
    """
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    is_exact = len(steps) == 1 and bool(name) and is_column(name)
    step = float(steps.min()) if len(steps) and not is_exact else 0.0
    return step**2 / 12.0, np.append(0, np.cumsum(np.diff(values) != 0.0))


def _noise_by(window: int, values: Floats, residuals: Floats, sensitivity: Floats) -> Noise:
    """The same by what is left of means of so many readings."""
    half = window // 2
    fast = np.zeros(len(values))
    fast[half:-half] = values[half:-half] - np.convolve(values, np.full(window, 1.0 / window), mode="valid")
    moved = sensitivity * fast
    square = float(moved @ moved)
    if square <= 0.0:
        return Noise(0.0, 0.0)
    size, whole = float(np.mean(fast[half:-half] ** 2)), float(np.var(values))
    missing = -size * float(residuals @ moved) / square
    slow = max(1.0 - 1.0 / window - (size - missing) / whole, LEFT)
    return Noise(missing / slow, size * float(np.std(residuals)) / np.sqrt(square) / slow)


def pooled(noises: Sequence[Noise]) -> list[Noise]:
    """Noise of meters of one kind: what all show together, where they show it and do not differ.

    >>> [round(noise.variance, 2) for noise in pooled([Noise(0.9, 0.2), Noise(0.6, 0.2), Noise(1.1, 0.4)])]
    [0.79, 0.79, 0.79]
    >>> pooled([Noise(0.9, 0.1), Noise(0.0, 0.1)])
    [Noise(variance=0.9, sigma=0.1, own=inf), Noise(variance=0.0, sigma=0.1, own=inf)]
    """
    usable = [noise for noise in noises if noise.sigma > 0.0]
    if len(usable) < max(len(noises), 2):
        return list(noises)
    weights = np.array([noise.sigma**-2.0 for noise in usable])
    variances = np.array([noise.variance for noise in usable])
    mean, sigma = float(weights @ variances / weights.sum()), float(weights.sum() ** -0.5)
    spread, count = float(weights @ (variances - mean) ** 2), len(usable) - 1
    if mean < SIGNIFICANT * sigma or spread > count + FURTHER * np.sqrt(2.0 * count):
        return list(noises)
    return [Noise(mean, sigma, noise.own) for noise in noises]


class RegressorError(NamedTuple):
    """What the meter of one disturbance does to a solution."""

    noise: Noise
    rounded: float  #: variance of what was rounded off
    #: (K, r): its product with its transpose is what a unit of variance adds to the normal matrix of K parameters
    root: Floats


def widened(covariance: Floats, inverse: Floats, coefficients: Floats, meters: Sequence[RegressorError]) -> Floats:
    """(K, K) covariance of what was found, about what there is, with the noise of the meters.

    Noise that readings show moves all parameters at once, as above; how much of it there is, is known for each meter by
    itself. Where they show none, as much as may be there moves them the same way for all meters, by its mean.

    Parameters
    ----------
    covariance : (K, K) float
        With the disturbances as they were logged.
    inverse : (K, K) float
        Of the normal matrix.
    coefficients : (K,) float
        Parameters that the disturbances' columns are multiplied with; 0 for all others.

    Examples
    --------
    Half of what tells about the one parameter is noise:

    >>> half = RegressorError(Noise(1.0, 0.0), 0.0, np.array([[1.0]]))
    >>> widened(np.array([[0.01]]), np.array([[0.5]]), np.array([3.0]), [half])
    array([[9.04]])
    """
    shown = [np.sqrt(meter.noise.variance) * meter.root for meter in meters if meter.noise.is_proven]
    root = np.column_stack([np.zeros((len(coefficients), 0)), *shown])
    shares, turned = np.linalg.eigh(root.T @ inverse @ root)
    along = root @ turned
    grown = np.eye(len(coefficients)) + inverse @ along / (1.0 - np.minimum(shares, MOST_NOISE)) @ along.T
    moved = grown @ coefficients - coefficients
    wider: Floats = grown @ covariance @ grown.T + np.outer(moved, moved)
    pulled = np.zeros(len(coefficients))
    for meter in meters:
        off = grown @ inverse @ meter.root @ (meter.root.T @ coefficients)
        unknown = meter.noise.sigma**2 if meter.noise.is_proven else (1.0 - MEAN) * meter.noise.square
        wider += (unknown + (1.0 - MEAN) * meter.rounded**2) * np.outer(off, off)
        pulled += np.hypot(0.0 if meter.noise.is_proven else np.sqrt(meter.noise.square), meter.rounded) * off
    return wider + MEAN * np.outer(pulled, pulled)


def attenuation(values: Floats, residuals: Floats, sensitivity: Floats) -> float:
    """By which share an offset per unit is too small, as the meter is noisy; 0 where nothing of it shows.

    Of (N,) values, residuals and sensitivities as in `noise_of`.
    """
    noise, variance = noise_of(values, residuals, sensitivity), float(np.var(values))
    return min(noise.variance / variance, 1.0) if noise.is_proven and variance > 0.0 else 0.0


def monotonicity(values: Floats) -> float:
    """Share of the variance of (N,) values, in the order of recording, that a monotone function of time explains."""
    course = np.array([part.mean() for part in np.array_split(values, min(STRETCHES, len(values)))])
    total = float(np.var(values))
    if total <= 0.0:
        return 0.0
    return float(max(np.var(_rising(course)), np.var(_rising(-course)))) / total


def collinearity(values: Floats, others: Floats) -> float:
    """Share of the variance of (N,) values that a straight line in (N, K) other disturbances explains, 0 to 1.

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


def shared(jacobian: Floats, regressors: Floats) -> float:
    """Share of the information about a disturbance that offset and shape could explain, 0 to 1, at worst.

    The largest squared canonical correlation of (N, 3) columns of a disturbance, counted from its mean, with (N, 9)
    those of the ellipsoid: with 1 nothing tells them apart.

    >>> rng = np.random.default_rng(1)
    >>> ellipsoid = rng.normal(size=(500, 9))
    >>> round(shared(ellipsoid, ellipsoid[:, :3]), 1), round(shared(ellipsoid, rng.normal(size=(500, 3))), 1)
    (1.0, 0.0)
    """
    ours, _ = np.linalg.qr(jacobian / _sizes(jacobian))
    theirs, _ = np.linalg.qr(regressors / _sizes(regressors))
    return float(np.clip(np.linalg.norm(ours.T @ theirs, ord=2) ** 2, 0.0, 1.0))


def _sizes(columns: Floats) -> Floats:
    """(K,) lengths of columns; 1 for one of nothing."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes > 0.0, sizes, 1.0)


def _rising(course: Floats) -> Floats:
    """The nearest course that never falls, in least squares: neighbours that do are pooled."""
    pools: list[tuple[float, int]] = []
    for value in course.tolist():
        mean, count = value, 1
        while pools and pools[-1][0] >= mean:
            before, size = pools.pop()
            mean, count = (before * size + mean * count) / (size + count), size + count
        pools.append((mean, count))
    return np.repeat([mean for mean, _ in pools], [count for _, count in pools])
