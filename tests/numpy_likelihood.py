"""The likelihood in NumPy, as in the literature: reference for the engine.

`flinders.likelihood` and docs/model.md give the reason for each step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from tests.numpy_slow_noise import Series, averaged

from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.base import Correlation, Estimate
from flinders.estimators.covariance import Residuals, correlation_length
from flinders.estimators.likelihood import start_ellipsoid
from flinders.geometry.ellipsoid import PARAMETER_DERIVATIVES, Ellipsoid, subtract_centre, symmetric_matrix
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import MIN_NOISE, NormalEquations
from flinders.likelihood.identifiability import MIN_SOUND_EIGENVALUE, Support, spurious_information
from flinders.summary.coverage import CELL_CENTRES, cell_indices, corrected_directions

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

MAX_STRETCHES, STRETCH_READINGS = 12, 1024
"""Largest number of stretches of consecutive readings, and readings in each, by which correlation is estimated."""

MAX_ITERATED_READINGS, PART_READINGS = 20_000, 5_000
"""Largest number of readings that are all iterated on; for more, readings in the part whose fit comes first."""

MAX_SINGLE_STEP_SIGMAS: Final = 3.0
"""Largest step in standard deviations that all readings take from the fit of a part, without a second step."""

MAX_PASSES: Final = 3
"""Largest number of passes through a long recording. The first corrects the fit of the part; more are seldom needed."""

MAX_STEPS: Final = 50
"""Largest number of Gauss–Newton steps. Five are usual; directions that readings hardly determine need more."""

MAX_STEP_RATIO: Final = 0.3
"""Largest step relative to the radius; a longer one leaves the region where the surface is near its tangent."""

MAX_HALVINGS: Final = 30
"""Largest number of halvings of a step, after which a billionth of it is left."""

MIN_PRIOR_SHARE: Final = 1e-3
"""Upper bound of the prior's share of the information above which the share is computed exactly."""

MIN_STEP_RATIO, MIN_UNCORRECTED_STEP_RATIO = 1e-10, 1e-5
"""Smallest steps relative to the radius. With the second the corrected equation still takes one step."""

MIN_COST_GAIN, MAX_OMITTED_SIGMAS = 1e-3, 0.02
"""Limits below which a step is the last: its relative gain of χ², and what it omits, in standard deviations."""

FEW_INFORMATION_READINGS, MANY_INFORMATION_READINGS, MIN_NOISE_SHARE = 200, 2_000, 0.005
"""Readings for noise-induced information, and its share below which the smaller number is enough."""

MAX_SMALL_NOISE: Final = 0.08
"""Largest noise relative to the field for which a step may assume that residuals are small."""

MAX_COST_INCREASE: Final = 0.01
"""Largest increase of χ² by an accepted step: the root of the foot-point equation is not the minimum of Σ s²."""

MIN_AXIS_RATIO: Final = 1e-4
"""Smallest ratio of the shortest to the longest axis of an ellipsoid; a step to a flatter one is shortened."""


MIN_CORRELATED_READINGS: Final = 50
"""Smallest number of readings from which their correlation is estimated."""

DISTORTION_ANGLE: Final = np.deg2rad(30.0)
"""Angle in rad over which a distortion that depends on the direction stays similar."""

MIN_PROVEN_RATIO: Final = 3.0
"""Smallest ratio of the variance that visits share to its noise, for a distortion by direction to be proven."""

MIN_CELLS: Final = 20
"""Smallest number of cells with readings in which a distortion is searched that visits do not prove."""

DISTORTION_RATIOS: Final = 0.0625 * 4.0 ** np.arange(8)
"""Variances of a distortion that are tried, relative to that of white noise."""

MIN_GAIN_BITS, MIN_SLOW_GAIN_SHARE, MIN_AGREEMENT = 15.0, 0.6, 0.4
"""Needs of a distortion: bits over white noise, share of slow noise's bits, agreement of visits."""

FIELD_VARIATIONS: Final = np.array([0.0, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.016])
"""Variations of the field with the place that are tried, relative to its strength."""

PRIOR_PROBABILITIES: Final = np.array([0.02, 0.13, 0.2, 0.25, 0.25, 0.1, 0.05])
"""Prior probability of each of `FIELD_VARIATIONS`."""

MIN_SPREAD_VARIANCE, HIDDEN_VARIANCE_FACTOR, PROVEN_NOISE_BITS, MAX_SCATTER_READINGS = 0.06, 3.0, 15.0, 200
"""Limits of the variation that few directions hide, and the readings by which its scatter is computed.

They are: the variance of directions above which these are spread; the factor on the hidden variance; the bits that
prove slow noise; the number of readings."""

MAX_FREEDOM_FACTOR: Final = 1.3
"""Largest correction for the nine fitted parameters; with few independent readings the sum is too uncertain."""


@dataclass(frozen=True, slots=True)
class NumpyLikelihood:
    """`flinders.estimators.likelihood.Likelihood` for readings in memory."""

    prior: float | None = prior.SOFT_IRON_SPREAD
    bias_correction: bool = True

    def estimate(self, readings: Readings) -> Estimate:
        """Fit readings in memory."""
        ellipsoid = start_ellipsoid(readings)
        some = _Some.of(
            readings.thin(PART_READINGS if len(readings) > MAX_ITERATED_READINGS else MAX_ITERATED_READINGS, "")
        )
        if not some.spread:  # all alike, as what the rails of a sensor leave of a turn can be
            raise NotAnEllipsoid(method="")
        estimate, ellipsoid = self._fitted(readings, some, ellipsoid)
        if estimate.support.unobserved and self.prior is None:
            raise Undetermined(estimate.support.unobserved)
        correlation = None
        covariance = estimate.covariance
        if not estimate.plain and len(readings) >= MIN_CORRELATED_READINGS:
            segments, moments, has_parts = segments_of(readings), moments_of(readings), len(readings.parts) > 0
            directions = foot_directions(np.concatenate(segments), ellipsoid)
            variance = HIDDEN_VARIANCE_FACTOR * expected_variation(
                np.concatenate(segments), directions, ellipsoid, segments
            )
            jacobian = magnitude.information(directions, ellipsoid)
            scatter, correlation, residuals = correlated(segments, len(readings), ellipsoid)
            covariance = estimate.widened(scatter, correlation)
            if not (correlation.is_white or estimate.support.unobserved):
                step, slow, explained, gain, strength = estimate.slowed(
                    residuals, moments, ellipsoid, has_parts=has_parts
                )
                likely = 0.0 if correlation.direction else likely_distortion(residuals, segments, ellipsoid, gain)
                if likely > 0.0:
                    scatter, correlation, residuals = correlated(segments, len(readings), ellipsoid, likely)
                    covariance = estimate.widened(scatter, correlation)
                    step, slow, explained, gain, strength = estimate.slowed(
                        residuals, moments, ellipsoid, has_parts=has_parts
                    )
                variance = max(variance, strength if gain >= PROVEN_NOISE_BITS else 0.0)
                covariance = raised(covariance, explained)
                if math.sqrt(estimate.variance) < MAX_SMALL_NOISE * float(ellipsoid.shape.trace()) / 3.0:
                    covariance += slow - explained
                    ellipsoid = _moved(ellipsoid, step)
            variation = estimate.support.project(variation_scatter(directions, jacobian, len(readings)))
            variation = estimate.covariance @ variation @ estimate.covariance / estimate.variance**2
            covariance = covariance + variance * variation
        return Estimate(
            ellipsoid,
            covariance,
            estimate.noise,
            "",
            prior_influence=self._prior_influence(estimate),
            correlation=correlation,
            textbook=estimate.covariance,
            used=estimate.likelihood.count,
            unobserved=estimate.support.unobserved,
        )

    def _fitted(self, readings: Readings, some: _Some, begun: Ellipsoid) -> tuple[_Posterior, Ellipsoid]:
        """The last step and its start; for many readings all are used at once if the step from a part is short."""
        is_long = len(some) < len(readings)
        if is_long:
            estimate = self._seen(readings.blocks(""), begun, some)
            step = self._unbiased(estimate).step()
            if _is_near(step, estimate.covariance, begun.radius):
                return estimate, _closed(begun, step)
        estimate = self._settled(some, begun)
        for _ in range(MAX_PASSES if is_long else 1):
            if is_long:
                estimate = self._seen(readings.blocks(""), estimate.ellipsoid, some)
            step = self._unbiased(estimate).step()
            ellipsoid = _closed(estimate.ellipsoid, step)
            if _is_small(step, estimate.covariance, ellipsoid.radius):
                break
        return estimate, ellipsoid

    def _settled(self, some: _Some, ellipsoid: Ellipsoid) -> _Posterior:
        """Iterate until steps vanish, or until no step improves the fit."""
        now = self._seen([some.field], ellipsoid, some)
        for _ in range(MAX_STEPS):
            step = now.equations.step()
            largest = float(np.abs(step).max()) / now.ellipsoid.radius
            is_last = now.is_last(step) if self.bias_correction else largest <= MIN_STEP_RATIO
            better = None if is_last else self._improved(now, step * min(1.0, MAX_STEP_RATIO / largest))
            if better is None:
                break
            now = better
        return now

    def _improved(self, now: _Posterior, step: Floats) -> _Posterior | None:
        """Take the longest of a step, half of it, a quarter … that keeps the surface closed and the fit as good.

        Along a direction that readings do not determine, their cost follows the noise only, and is not compared.
        """
        for _ in range(MAX_HALVINGS):
            moved = _moved(now.ellipsoid, step)
            if _is_closed(moved):
                tried = self._seen([now.some.field], moved, now.some, sound=now.sound or is_sound(now.support))
                if not tried.sound and now.support.unobserved:
                    return tried
                if tried.cost(now.variance) <= now.cost(now.variance) + MAX_COST_INCREASE:
                    return tried
            step = step / 2.0
        return None

    def _seen(self, blocks: Iterable[Floats], ellipsoid: Ellipsoid, some: _Some, *, sound: bool = False) -> _Posterior:
        """Linearize the likelihood and the prior at an ellipsoid."""
        linearized = magnitude.equations if self.bias_correction else exact_equations
        likelihood = linearized(blocks, ellipsoid)
        believed = NormalEquations.empty()
        if self.prior is not None:
            believed = prior.equations(ellipsoid, spread=self.prior) + prior.plausibility_equations(
                ellipsoid, some.middle, some.spread
            )
        return _Posterior(ellipsoid, likelihood, believed, some, plain=not self.bias_correction, sound=sound)

    def _unbiased(self, posterior: _Posterior) -> NormalEquations:
        """Subtract the mean gradient that noise causes, estimated from a part of the readings."""
        if not self.bias_correction:
            return posterior.equations
        share = posterior.likelihood.count / len(posterior.some)
        bent = share * magnitude.curvature(posterior.some.field, posterior.ellipsoid)
        return posterior.combined(replace(posterior.weighed, gradient=posterior.weighed.gradient - bent))

    def _prior_influence(self, posterior: _Posterior) -> float:
        """Largest share of the information about any combination of parameters that comes from the prior."""
        if self.prior is None:
            return 0.0
        believed = prior.equations(posterior.ellipsoid, spread=self.prior).matrix
        at_most = float(np.sum(posterior.covariance * believed))
        if at_most < MIN_PRIOR_SHARE:
            return at_most
        return float(np.clip(np.real(np.linalg.eigvals(posterior.covariance @ believed)).max(), 0.0, 1.0))


def exact_equations(blocks: Iterable[Floats], ellipsoid: Ellipsoid) -> NormalEquations:
    """Normal equations with the gradient of Σ s² itself, whose root is the minimum of the Sampson cost."""
    inverse, total = np.linalg.inv(ellipsoid.shape), NormalEquations.empty()
    for block in blocks:
        y = inverse @ subtract_centre(block, ellipsoid.centre)
        length = np.linalg.norm(y, axis=0)
        unit = y / length
        normal = inverse @ unit
        steepness = np.linalg.norm(normal, axis=0)
        normal /= steepness
        turned, s = inverse @ normal, (length - 1.0) / steepness
        tangent = inverse @ (turned - unit * np.sum(unit * turned, axis=0)) / steepness
        grid = normal[:, np.newaxis] * y - s * (turned[:, np.newaxis] * normal + tangent[:, np.newaxis] * unit)
        jacobian = np.concatenate([normal - tangent * (s / length), grid.reshape(9, -1)]).T @ PARAMETER_DERIVATIVES
        total += NormalEquations(jacobian.T @ jacobian, jacobian.T @ s, float(s @ s), len(s))
    return total


def is_sound(support: Support) -> bool:
    """Whether all directions are well determined."""
    return bool(support.values[0] > MIN_SOUND_EIGENVALUE)


@dataclass(frozen=True, slots=True, eq=False)
class _Some:
    """Readings through which a fit iterates.

    Attributes
    ----------
    field : (M, 3) float
    middle : (3,) float
        Mean reading.
    spread : float
        Root mean square distance of the readings from their mean.
    """

    field: Floats
    middle: Floats
    spread: float

    @classmethod
    def of(cls, field: Floats) -> Self:
        """Compute mean and spread of readings."""
        middle = np.einsum("ij->j", field) / len(field)
        square = float(np.einsum("ij,ij", field, field)) / len(field) - float(middle @ middle)
        return cls(field, middle, float(np.sqrt(max(square, 0.0))))

    def __len__(self) -> int:
        return len(self.field)


@dataclass(frozen=True, eq=False)
class _Posterior:
    """Normal equations of the readings and of the prior, linearized at an ellipsoid.

    Attributes
    ----------
    ellipsoid : Ellipsoid
        Ellipsoid at which they are linearized.
    likelihood : NormalEquations
        Equations of the readings, in their unit.
    prior : NormalEquations
        Equations of the prior, in standard deviations.
    some : _Some
        Readings from which averages over all are estimated.
    plain : bool
        Whether the claim ignores noise-induced information, as in textbooks.
    sound : bool
        Whether an earlier step has shown that all directions are well determined.
    """

    ellipsoid: Ellipsoid
    likelihood: NormalEquations
    prior: NormalEquations
    some: _Some
    plain: bool
    sound: bool = False

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the residuals."""
        return float(np.sqrt(max(self.likelihood.cost, 0.0) / max(self.likelihood.count - 9, 1)))

    @cached_property
    def variance(self) -> float:
        """Noise variance for the weights of readings; no sensor resolves a millionth of the field."""
        return max(self.noise, MIN_NOISE * self.ellipsoid.radius) ** 2

    @cached_property
    def weighed(self) -> NormalEquations:
        """The likelihood in standard deviations."""
        weight = 1.0 / self.variance
        return replace(
            self.likelihood,
            matrix=weight * self.likelihood.matrix,
            gradient=weight * self.likelihood.gradient,
            cost=weight * self.likelihood.cost,
        )

    @cached_property
    def support(self) -> Support:
        """Directions in parameter space that readings determine."""

        def spurious(most: int) -> Floats:
            points = self.some.field[:: max(1, len(self.some) // most)]
            share = self.likelihood.count / len(points)
            return share * spurious_information(corrected_directions(points, self.ellipsoid), self.ellipsoid)

        support = Support.of(self.weighed.matrix, lambda: spurious(FEW_INFORMATION_READINGS))
        if support.share.max() <= MIN_NOISE_SHARE:
            return support
        return Support.of(self.weighed.matrix, lambda: spurious(MANY_INFORMATION_READINGS))

    def combined(self, weighed: NormalEquations) -> NormalEquations:
        """Equations of the readings for the directions that they determine, plus those of the prior."""
        return self.prior + (weighed if self.sound else self.support.remove_unobservable(weighed))

    @cached_property
    def equations(self) -> NormalEquations:
        """Equations of readings and prior, in standard deviations."""
        return self.combined(self.weighed)

    @cached_property
    def covariance(self) -> Floats:
        """(9, 9) covariance of the parameters, in unit²."""
        seen = self.support.remove_unobservable(self.weighed).matrix if self.plain else self.support.information
        return replace(self.prior, matrix=self.prior.matrix + seen).inverse()

    def widened(self, scatter: Floats, correlation: Correlation) -> Floats:
        """(9, 9) covariance with the scatter that correlated residuals give the gradient."""
        if correlation.is_white:
            return self.covariance
        scatter = self.support.project(scatter) / self.variance**2
        covariance: Floats = self.covariance @ (self.prior.matrix + scatter) @ self.covariance
        return covariance

    def slowed(
        self, residuals: Residuals, moments: Floats, ellipsoid: Ellipsoid, *, has_parts: bool
    ) -> tuple[Floats, Floats, Floats, float, float]:
        """Result of `averaged`: generalised least squares with slow noise."""
        rows = np.column_stack([residuals.jacobian, residuals.distances])
        series = Series.of(rows, moments, residuals.segments, has_parts=has_parts)
        white = np.einsum("ni,n,nj->ij", series.rows, series.counts, series.rows)
        moved = ellipsoid.parameters - self.ellipsoid.parameters
        prior_gradient = self.prior.gradient - self.prior.matrix @ moved
        bent = np.linalg.solve(white[:9, :9], white[:9, 9] + self.variance * prior_gradient)
        support = self.support
        onto = (support.vectors * (1.0 - support.share)) @ support.vectors.T
        onto *= support.scale[:, None] / support.scale
        square = float(np.mean(residuals.distances**2))
        return averaged(series, bent, onto, self.prior.matrix, prior_gradient, square)

    def is_last(self, step: Floats) -> bool:
        """Whether a step is short enough to be the last."""
        radius, likelihood = self.ellipsoid.radius, self.likelihood
        largest, least = float(np.abs(step).max()), self.noise / math.sqrt(likelihood.count)
        if largest <= MIN_UNCORRECTED_STEP_RATIO * radius:
            return True
        is_bent = largest * (largest + self.noise) / radius > MAX_OMITTED_SIGMAS * least
        gains = float(step @ likelihood.matrix @ step) > MIN_COST_GAIN * likelihood.cost
        return not (is_bent or gains) and is_sound(self.support)

    def cost(self, variance: float) -> float:
        """χ² of the readings for a noise variance, plus χ² of the prior."""
        return self.likelihood.cost / variance + self.prior.cost


def segments_of(readings: Readings) -> list[Floats]:
    """Stretches of consecutive readings, spread over the recordings; all readings if they are few."""
    if len(readings) <= MAX_STRETCHES * STRETCH_READINGS:
        return [part.thin(len(part), "") for part in readings.single_recordings if len(part)]
    every = -(-len(readings) // MAX_STRETCHES)
    segments: list[Floats] = []
    seen = 0
    for part in readings.single_recordings:
        for block in part.blocks(""):
            segments += [block[begin : begin + STRETCH_READINGS] for begin in range(-seen % every, len(block), every)]
            seen += len(block)
    return segments


def moments_of(readings: Readings) -> Floats:
    """Places of the readings of those segments."""
    total = len(readings)
    if total <= MAX_STRETCHES * STRETCH_READINGS:
        return np.arange(total, dtype=np.float64)
    every, seen = -(-total // MAX_STRETCHES), 0
    places: list[Floats] = []
    for part in readings.single_recordings:
        for block in part.blocks(""):
            rows = np.arange(seen, seen + len(block), dtype=np.float64)
            places += [rows[begin : begin + STRETCH_READINGS] for begin in range(-seen % every, len(rows), every)]
            seen += len(block)
    return np.concatenate(places)


def raised(covariance: Floats, other: Floats) -> Floats:
    """(9, 9) covariance, raised to another one where it is smaller."""
    root = np.linalg.cholesky(other)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    half = root @ vectors
    larger: Floats = (half * np.maximum(values, 1.0)) @ half.T
    return larger


def _is_small(step: Floats, covariance: Floats, radius: float) -> bool:
    """Whether the second-order terms that a Gauss–Newton step omits are small compared with the uncertainty."""
    return bool(np.all(step**2 / radius <= 0.05 * np.sqrt(np.diag(covariance))))


def _is_near(step: Floats, covariance: Floats, radius: float) -> bool:
    """Whether a step is within the uncertainty, so that residuals before and after it are the same."""
    return bool(np.all(step**2 <= MAX_SINGLE_STEP_SIGMAS**2 * np.diag(covariance))) and _is_small(
        step, covariance, radius
    )


def _closed(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    """Ellipsoid after a step, or after the largest part of the step that keeps the surface closed.

    Raises
    ------
    NotAnEllipsoid
        If even a tiny part of the step opens the surface.
    """
    for _ in range(MAX_HALVINGS):
        moved = _moved(ellipsoid, step)
        if _is_closed(moved):
            return moved
        step = step / 2.0
    raise NotAnEllipsoid(tuple(float(axis / ellipsoid.radius) for axis in ellipsoid.semi_axes), "")


def _is_closed(ellipsoid: Ellipsoid) -> bool:
    axes = ellipsoid.semi_axes
    return bool(axes[0] > MIN_AXIS_RATIO * axes[2])


def _moved(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    return Ellipsoid(ellipsoid.centre + step[:3], ellipsoid.shape + symmetric_matrix(step[3:]))


def foot_directions(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 3) directions of the foot points of readings on the surface."""
    normals = magnitude.information(corrected_directions(readings, ellipsoid), ellipsoid)[:, :3]
    return corrected_directions(readings - magnitude.distances(readings, ellipsoid)[:, np.newaxis] * normals, ellipsoid)


def correlated(
    segments: Sequence[Floats], count: int, ellipsoid: Ellipsoid, known: float = 0.0
) -> tuple[Floats, Correlation, Residuals]:
    """(9, 9) scatter of Σ J s over all readings, correlation of residuals, and the residuals of stretches.

    `known` is the standard deviation of a likely distortion, or 0.
    """
    lengths = np.array([len(segment) for segment in segments])
    readings = segments[0] if len(segments) == 1 else np.concatenate(segments)
    directions = foot_directions(readings, ellipsoid)
    residuals = Residuals(
        magnitude.distances(readings, ellipsoid),
        magnitude.information(directions, ellipsoid),
        np.split(np.arange(len(readings)), np.cumsum(lengths)[:-1]),
    )
    share = count / len(readings)
    if float(np.sqrt(np.mean(residuals.distances**2))) < MIN_NOISE * ellipsoid.radius:
        return share * residuals.scatter(residuals.variance()), Correlation(0.0, 1.0, 0.0), residuals
    autocovariance = residuals.autocovariance()
    time = correlation_length(autocovariance)
    sphere = _Sphere(directions, _principal_axes(directions), ellipsoid)
    direction = known or sphere.distortion(residuals.distances, apart=3 * len(autocovariance), time=time)
    scatter: Floats = np.zeros((9, 9))
    if direction > 0.0:
        scatter = scatter + share**2 * sphere.scatter(direction)
        left = residuals.distances - sphere.smoothed(residuals.distances, direction, time)
        residuals = Residuals(left, residuals.jacobian, residuals.segments)
        autocovariance = residuals.autocovariance()
    lag_one = residuals.lag_one()
    independent = len(readings) * share / time
    freedom = min(independent / max(independent - 9.0, 1.0), MAX_FREEDOM_FACTOR)
    in_time = freedom * residuals.scatter(autocovariance)
    excess_variance = 1.0 + share * (residuals.excess_variance(in_time) - 1.0)
    correlation = Correlation(lag_one, time, direction, excess_variance)
    return scatter + share * excess_variance * in_time, correlation, residuals


def likely_distortion(residuals: Residuals, segments: Sequence[Floats], ellipsoid: Ellipsoid, slow: float) -> float:
    """Standard deviation of a likely distortion, if slow noise gains `slow` bits; 0 if none is likely."""
    directions = foot_directions(np.concatenate(segments), ellipsoid)
    sphere = _Sphere(directions, _principal_axes(directions), ellipsoid)
    return sphere.likely(residuals.distances, apart=3 * len(residuals.autocovariance()), slow=slow)


def expected_variation(readings: Floats, directions: Floats, ellipsoid: Ellipsoid, segments: Sequence[Floats]) -> float:
    """Variance of a smooth variation over directions, if these are few; else 0."""
    spread = np.linalg.eigvalsh(np.cov(directions.T))[0]
    if spread > MIN_SPREAD_VARIANCE:
        return 0.0
    ends = np.cumsum([len(segment) for segment in segments])[:-1]
    distances = magnitude.distances(readings, ellipsoid)
    residuals = Residuals(distances, np.empty((0, 9)), np.split(np.arange(len(readings)), ends))
    sphere = _Sphere(directions, _principal_axes(directions), ellipsoid)
    bits = sphere.likelihoods_of_variation(distances, correlation_length(residuals.autocovariance()))
    weights = PRIOR_PROBABILITIES * np.exp2(bits - bits.max())
    return float(weights @ FIELD_VARIATIONS**2 / weights.sum()) * ellipsoid.radius**2


def variation_scatter(directions: Floats, jacobian: Floats, count: int) -> Floats:
    """(9, 9) scatter of Σ J s over all readings, for residuals with such a variation of unit variance."""
    taken = (
        np.arange(min(len(directions), MAX_SCATTER_READINGS))
        * len(directions)
        // min(len(directions), MAX_SCATTER_READINGS)
    )
    rows = jacobian[taken]
    scatter: Floats = (count / len(taken)) ** 2 * rows.T @ _alike(directions[taken], directions[taken]) @ rows
    return scatter


class _Sphere:
    """Residuals by direction, in cells of the sphere.

    Parameters
    ----------
    directions : (N, 3) float
    axes : (3, 3) float
        Axes of the cells, in rows.
    ellipsoid : Ellipsoid
    """

    def __init__(self, directions: Floats, axes: Floats, ellipsoid: Ellipsoid) -> None:
        cells = cell_indices(directions @ axes.T)
        self.cells: NDArray[np.int64] = cells
        self._axes = axes
        counts = np.bincount(cells, minlength=len(CELL_CENTRES)).astype(float)
        self.seen = np.flatnonzero(counts)
        self.counts = counts[self.seen]
        sums = np.stack(
            [np.bincount(cells, weights=axis, minlength=len(CELL_CENTRES)) for axis in directions.T], axis=1
        )
        middles = sums[self.seen] / np.linalg.norm(sums[self.seen], axis=1, keepdims=True)
        self._middles = middles
        self._ellipsoid = ellipsoid

    @cached_property
    def jacobian(self) -> Floats:
        """(seen, 9) Jacobian in the middle of each cell with readings."""
        return magnitude.information(self._middles, self._ellipsoid)

    @cached_property
    def _kernel(self) -> Floats:
        centres: Floats = CELL_CENTRES @ self._axes
        return _kernel(self._middles, self.jacobian, centres, magnitude.information(centres, self._ellipsoid))

    def distortion(self, residuals: Floats, *, apart: int, time: float) -> float:
        """Standard deviation of the part that residuals of one direction share at different times; 0 if unproven.

        Products of the sums of different visits do not contain the noise of either.
        """
        cross, pairs = self._visits(residuals, apart)
        shared_variance = float(np.sum(cross / self.counts))
        noise = float(np.mean(residuals**2)) * time * np.sqrt(2.0 * float(np.sum(pairs / self.counts**2)))
        if shared_variance <= MIN_PROVEN_RATIO * noise:
            return 0.0
        expected = float(np.sum(pairs * self._left_over() / self.counts))
        return float(np.sqrt(shared_variance / expected)) if expected > 0.0 else 0.0

    def scatter(self, direction: float) -> Floats:
        """(9, 9) Σ JJᵀD over all pairs of readings, for a distortion of that standard deviation."""
        weighted = self.jacobian * self.counts[:, np.newaxis]
        scatter: Floats = direction**2 * weighted.T @ self._kernel @ weighted
        return scatter

    def smoothed(self, residuals: Floats, direction: float, time: float) -> Floats:
        """(N,) the most probable distortion at each reading."""
        means = np.bincount(self.cells, weights=residuals, minlength=len(CELL_CENTRES))[self.seen] / self.counts
        noise = float(np.mean(residuals**2)) * time / self.counts
        prior = direction**2 * self._kernel
        everywhere = np.zeros(len(CELL_CENTRES))
        everywhere[self.seen] = prior @ np.linalg.solve(prior + np.diag(noise), means)
        at_each: Floats = everywhere[self.cells]
        return at_each

    def likely(self, residuals: Floats, *, apart: int, slow: float) -> float:
        """Standard deviation of a distortion about as likely as slow noise that gains `slow` bits; else 0."""
        if len(self.seen) < MIN_CELLS:
            return 0.0
        means = np.bincount(self.cells, weights=residuals, minlength=len(CELL_CENTRES))[self.seen] / self.counts
        none, _ = self._likelihood(residuals, means, 0.0)
        most, white = max(self._likelihood(residuals, means, ratio) for ratio in DISTORTION_RATIOS)
        if most - none <= max(MIN_GAIN_BITS, MIN_SLOW_GAIN_SHARE * slow):
            return 0.0
        cross, pairs = self._visits(residuals, apart)
        left = self._left_over()
        variance = float(np.sum(self.counts * means**2 - white) / np.sum(self.counts * left))
        agreement = float(np.sum(cross / self.counts)) - MIN_AGREEMENT * variance * float(
            np.sum(pairs * left / self.counts)
        )
        return math.sqrt(variance) if variance > 0.0 and agreement > 0.0 else 0.0

    def _likelihood(self, residuals: Floats, means: Floats, ratio: float) -> tuple[float, float]:
        """Base-2 logarithm of the restricted likelihood of a distortion with white noise, and the noise variance."""
        inverse = np.linalg.inv(ratio * _alike(self._middles, self._middles) + np.diag(1.0 / self.counts))
        normal, gradient = self.jacobian.T @ inverse @ self.jacobian, self.jacobian.T @ inverse @ means
        rest = float(np.sum(residuals**2) - np.sum(self.counts * means**2) + means @ inverse @ means)
        rest -= float(gradient @ np.linalg.solve(normal, gradient))
        freedom = len(residuals) - 9.0
        logarithm = float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(inverse)[1]) / math.log(2.0)
        return -(logarithm + freedom * math.log2(rest / freedom)) / 2.0, rest / freedom

    def likelihoods_of_variation(self, residuals: Floats, time: float) -> Floats:
        """(7,) base-2 logarithms of restricted likelihoods of `FIELD_VARIATIONS`; 0 if there are too few directions."""
        freedom = len(residuals) / time - 9.0
        if len(self.seen) <= 9 or freedom <= 9.0:
            return np.zeros(len(FIELD_VARIATIONS))
        ratios = (FIELD_VARIATIONS * self._ellipsoid.radius) ** 2 / np.mean(residuals**2)
        means = np.bincount(self.cells, weights=residuals, minlength=len(CELL_CENTRES))[self.seen] / self.counts
        counts = self.counts / time
        within = float(np.sum(residuals**2)) / time - float(np.sum(counts * means**2))
        bits = []
        for ratio in ratios:
            inverse = np.linalg.inv(ratio * _alike(self._middles, self._middles) + np.diag(1.0 / counts))
            normal, gradient = self.jacobian.T @ inverse @ self.jacobian, self.jacobian.T @ inverse @ means
            rest = within + float(means @ inverse @ means - gradient @ np.linalg.solve(normal, gradient))
            logarithm = float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(inverse)[1]) / math.log(2.0)
            bits.append(-(logarithm + freedom * math.log2(rest / freedom)) / 2.0)
        return np.array(bits)

    def _visits(self, residuals: Floats, apart: int) -> tuple[Floats, Floats]:
        """(seen,) products of the sums of different visits to each cell, of residuals and of readings.

        A visit is a stretch of readings in a cell; visits are separated by more than `apart` readings.
        """
        order = np.argsort(self.cells, kind="stable")
        cells = self.cells[order]
        begins = np.concatenate([[True], (cells[1:] != cells[:-1]) | (np.diff(order) > apart)])
        visit = np.cumsum(begins) - 1
        at = cells[begins]
        cross = self._between_visits(at, np.asarray(np.bincount(visit, weights=residuals[order]), float))
        return cross, self._between_visits(at, 1.0 * np.bincount(visit))

    def _between_visits(self, cells: NDArray[np.intp], sums: Floats) -> Floats:
        """(seen,) Σ over pairs of different visits to a cell of the products of their sums."""
        whole, squares = (np.bincount(cells, weights=part, minlength=len(CELL_CENTRES)) for part in (sums, sums**2))
        products: Floats = np.asarray(whole**2 - squares, float)[self.seen]
        return products

    def _left_over(self) -> Floats:
        """(seen,) variance that a distortion of unit size leaves in the residuals of a fit to these readings."""
        weighted = self.jacobian.T * self.counts
        fitted = self.jacobian @ np.linalg.pinv(weighted @ self.jacobian, rcond=1e-10, hermitian=True) @ weighted
        rest = np.eye(len(self.seen)) - fitted
        variance: Floats = np.einsum("ij,jk,ik->i", rest, self._kernel, rest)
        return variance


def _principal_axes(directions: Floats) -> Floats:
    """(3, 3) principal axes of directions in rows; third moments give their signs, so that they turn with readings."""
    axes = np.linalg.eigh(directions.T @ directions)[1]
    axes = axes * np.where(np.sum((directions @ axes) ** 3, axis=0) < 0.0, -1.0, 1.0)
    return axes.T


def _kernel(middles: Floats, jacobian: Floats, centres: Floats, everywhere: Floats) -> Floats:
    """(K, K) covariance of a smooth function on the sphere, less what an ellipsoid fitted all around absorbs."""
    inside = _alike(middles, middles)
    across = _alike(middles, centres)
    absorbed = jacobian @ np.linalg.solve(everywhere.T @ everywhere, everywhere.T)
    mixed = absorbed @ across.T
    kernel: Floats = inside - mixed - mixed.T + absorbed @ _alike(centres, centres) @ absorbed.T
    return kernel


def _alike(some: Floats, others: Floats) -> Floats:
    angles = np.arccos(np.clip(some @ others.T, -1.0, 1.0))
    likeness: Floats = np.exp(-0.5 * (angles / DISTORTION_ANGLE) ** 2)
    return likeness
