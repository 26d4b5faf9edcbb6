"""The likelihood in NumPy: the formulas that the engine is held to, written as they stand in the literature.

`flinders.likelihood` and docs/model.md say why each step is taken.
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

STRETCHES, STRETCH = 12, 1024
"""Stretches of consecutive readings, and readings in each, that tell how residuals are correlated."""

ENOUGH, SOME = 20_000, 5_000
"""Readings up to which the fit is iterated on all; a longer recording is gone through once, from a fit to some."""

NEAR: Final = 3.0
"""Standard deviations up to which a step of all readings from the start is the only one."""

PASSES: Final = 3
"""Through the whole of a long recording: one takes up what its part has left, and another is seldom needed."""

STEPS: Final = 50
"""Gauss–Newton steps; five are usual, more are taken along what is hardly seen."""

LONGEST_STEP: Final = 0.3
"""Of the radius: a longer step leaves the region in which the surface is like its tangent."""

HALVINGS: Final = 30
"""Of a step, after which a billionth of it is left, and none is worth taking."""

NOTHING: Final = 1e-3
"""Share of the information that the prior may have before it is looked at more closely than by an upper bound."""

SETTLED, SETTLED_BUT_FOR_ONE = 1e-10, 1e-5
"""Of the radius: steps shorter than this are not taken. The corrected equation is solved by one more step anyway."""

LEAST_GAIN, LEFT_OUT = 1e-3, 0.02
"""Of χ², and standard deviations: a step that gains no more, and leaves out no more, is the last."""

FEW_POINTS, MANY_POINTS, NEXT_TO_NOTHING = 200, 2_000, 0.005
"""Readings from which noise-induced information is computed, and the share of it below which the fewer will do."""

LARGE: Final = 0.08
"""Noise, of the field, from which on a step that takes residuals for small is not made."""

NO_WORSE: Final = 0.01
"""In χ²: a step that costs less is taken. The foot-point equation has its root beside the minimum of Σ s²."""

SHORTEST_AXIS: Final = 1e-4
"""Of the longest: a flatter surface is no ellipsoid that a sensor makes, and a step into it is cut short."""


FEW: Final = 50
"""Fewer readings than this say nothing of their correlation."""

SMOOTH: Final = np.deg2rad(30.0)
"""Angle over which a distortion that belongs to the direction stays alike."""

PROVEN: Final = 3.0
"""The same for a distortion that belongs to directions: what is not there would cost the claim much."""

FEWEST_CELLS: Final = 20
"""Cells with readings in which a distortion is looked for that visits do not prove."""

DISTORTIONS: Final = 0.0625 * 4.0 ** np.arange(8)
"""Its variance over that of white noise."""

PLAIN, AS_LIKELY, AGREEMENT = 15.0, 0.6, 0.4
"""Bits over white noise, share of those of slow noise, and of what it says different visits agree on."""

VARIATIONS: Final = np.array([0.0, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.016])
"""What is thought of the field's variation with the place beforehand, a share of its strength, …"""

PROBABLE: Final = np.array([0.02, 0.13, 0.2, 0.25, 0.25, 0.1, 0.05])
"""… and how probable each is."""

THIN, HIDDEN, TOLD, TAKEN = 0.06, 3.0, 15.0, 200
"""Least variance of spread directions; factor of the variance; bits of proven slow noise; readings looked at."""

MOST_FREEDOM: Final = 1.3
"""Correction for the nine fitted parameters, at most: with few independent readings the sum is too rough."""


@dataclass(frozen=True, slots=True)
class NumpyLikelihood:
    """As `flinders.estimators.likelihood.Likelihood`, of readings in memory."""

    prior: float | None = prior.SOFT_IRON_SPREAD
    bias_correction: bool = True

    def estimate(self, readings: Readings) -> Estimate:
        """Fit readings in memory."""
        ellipsoid = start_ellipsoid(readings)
        some = _Some.of(readings.thin(SOME if len(readings) > ENOUGH else ENOUGH, ""))
        if not some.spread:  # all alike, as what the rails of a sensor leave of a turn can be
            raise NotAnEllipsoid(method="")
        estimate, ellipsoid = self._fitted(readings, some, ellipsoid)
        if estimate.support.unobserved and self.prior is None:
            raise Undetermined(estimate.support.unobserved)
        correlation = None
        covariance = estimate.covariance
        if not estimate.plain and len(readings) >= FEW:
            segments, moments, has_parts = segments_of(readings), moments_of(readings), len(readings.parts) > 0
            directions = foot_directions(np.concatenate(segments), ellipsoid)
            variance = HIDDEN * expected_variation(np.concatenate(segments), directions, ellipsoid, segments)
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
                variance = max(variance, strength if gain >= TOLD else 0.0)
                covariance = raised(covariance, explained)
                if math.sqrt(estimate.variance) < LARGE * float(ellipsoid.shape.trace()) / 3.0:
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
        """The last step and where it starts: by all of many readings at once where it is short, else behind a part."""
        is_long = len(some) < len(readings)
        if is_long:
            estimate = self._seen(readings.blocks(""), begun, some)
            step = self._unbiased(estimate).step()
            if _is_near(step, estimate.covariance, begun.radius):
                return estimate, _closed(begun, step)
        estimate = self._settled(some, begun)
        for _ in range(PASSES if is_long else 1):
            if is_long:
                estimate = self._seen(readings.blocks(""), estimate.ellipsoid, some)
            step = self._unbiased(estimate).step()
            ellipsoid = _closed(estimate.ellipsoid, step)
            if _is_small(step, estimate.covariance, ellipsoid.radius):
                break
        return estimate, ellipsoid

    def _settled(self, some: _Some, ellipsoid: Ellipsoid) -> _Posterior:
        """Iterate until the steps vanish or none makes the fit better."""
        now = self._seen([some.field], ellipsoid, some)
        for _ in range(STEPS):
            step = now.equations.step()
            largest = float(np.abs(step).max()) / now.ellipsoid.radius
            is_last = now.is_last(step) if self.bias_correction else largest <= SETTLED
            better = None if is_last else self._improved(now, step * min(1.0, LONGEST_STEP / largest))
            if better is None:
                break
            now = better
        return now

    def _improved(self, now: _Posterior, step: Floats) -> _Posterior | None:
        """Take the longest of a step, its half, its quarter … that leaves the surface closed and the fit no worse.

        Along a direction that the readings do not see, their cost only follows the noise and is not asked.
        """
        for _ in range(HALVINGS):
            moved = _moved(now.ellipsoid, step)
            if _is_closed(moved):
                tried = self._seen([now.some.field], moved, now.some, sound=now.sound or is_sound(now.support))
                if not tried.sound and now.support.unobserved:
                    return tried
                if tried.cost(now.variance) <= now.cost(now.variance) + NO_WORSE:
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
        """Take off the mean of the gradient that noise causes; a part of the readings speaks for all."""
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
        if at_most < NOTHING:
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
    """All directions are seen, none of them badly."""
    return bool(support.values[0] > MIN_SOUND_EIGENVALUE)


@dataclass(frozen=True, slots=True, eq=False)
class _Some:
    """Readings that are gone through again and again.

    Attributes
    ----------
    field : (M, 3) float
    middle : (3,) float
        Their mean.
    spread : float
        Root mean square distance from it.
    """

    field: Floats
    middle: Floats
    spread: float

    @classmethod
    def of(cls, field: Floats) -> Self:
        """Look at them once."""
        middle = np.einsum("ij->j", field) / len(field)
        square = float(np.einsum("ij,ij", field, field)) / len(field) - float(middle @ middle)
        return cls(field, middle, float(np.sqrt(max(square, 0.0))))

    def __len__(self) -> int:
        return len(self.field)


@dataclass(frozen=True, eq=False)
class _Posterior:
    """What the readings and the prior say near an ellipsoid.

    Attributes
    ----------
    ellipsoid : Ellipsoid
        Where they were linearized.
    likelihood : NormalEquations
        Of the readings, in their unit.
    prior : NormalEquations
        In standard deviations.
    some : _Some
        Readings that stand for all where an average is asked for.
    plain : bool
        Claim what the textbook claims, without regard to noise-induced information.
    sound : bool
        A step before has shown that all directions are seen well.
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
        """Noise variance that the readings are weighed with: no sensor resolves a millionth of the field."""
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
        """Which directions the readings see."""

        def spurious(most: int) -> Floats:
            points = self.some.field[:: max(1, len(self.some) // most)]
            share = self.likelihood.count / len(points)
            return share * spurious_information(corrected_directions(points, self.ellipsoid), self.ellipsoid)

        support = Support.of(self.weighed.matrix, lambda: spurious(FEW_POINTS))
        if support.share.max() <= NEXT_TO_NOTHING:
            return support
        return Support.of(self.weighed.matrix, lambda: spurious(MANY_POINTS))

    def combined(self, weighed: NormalEquations) -> NormalEquations:
        """What the readings say of what they see, and the prior."""
        return self.prior + (weighed if self.sound else self.support.remove_unobservable(weighed))

    @cached_property
    def equations(self) -> NormalEquations:
        """Of both, in standard deviations."""
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
        """What `averaged` gives, of generalised least squares with slow noise."""
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
        """Whether the last step may be one as short as this."""
        radius, likelihood = self.ellipsoid.radius, self.likelihood
        largest, least = float(np.abs(step).max()), self.noise / math.sqrt(likelihood.count)
        if largest <= SETTLED_BUT_FOR_ONE * radius:
            return True
        is_bent = largest * (largest + self.noise) / radius > LEFT_OUT * least
        gains = float(step @ likelihood.matrix @ step) > LEAST_GAIN * likelihood.cost
        return not (is_bent or gains) and is_sound(self.support)

    def cost(self, variance: float) -> float:
        """χ² of the readings for a noise variance, and the prior's."""
        return self.likelihood.cost / variance + self.prior.cost


def segments_of(readings: Readings) -> list[Floats]:
    """Some consecutive readings, spread over the recordings; all of them where they are not too many."""
    if len(readings) <= STRETCHES * STRETCH:
        return [part.thin(len(part), "") for part in readings.single_recordings if len(part)]
    every = -(-len(readings) // STRETCHES)
    segments: list[Floats] = []
    seen = 0
    for part in readings.single_recordings:
        for block in part.blocks(""):
            segments += [block[begin : begin + STRETCH] for begin in range(-seen % every, len(block), every)]
            seen += len(block)
    return segments


def moments_of(readings: Readings) -> Floats:
    """Places of the readings of those segments."""
    total = len(readings)
    if total <= STRETCHES * STRETCH:
        return np.arange(total, dtype=np.float64)
    every, seen = -(-total // STRETCHES), 0
    places: list[Floats] = []
    for part in readings.single_recordings:
        for block in part.blocks(""):
            rows = np.arange(seen, seen + len(block), dtype=np.float64)
            places += [rows[begin : begin + STRETCH] for begin in range(-seen % every, len(rows), every)]
            seen += len(block)
    return np.concatenate(places)


def raised(covariance: Floats, other: Floats) -> Floats:
    """A covariance (9, 9), raised to another where it is below that."""
    root = np.linalg.cholesky(other)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    half = root @ vectors
    larger: Floats = (half * np.maximum(values, 1.0)) @ half.T
    return larger


def _is_small(step: Floats, covariance: Floats, radius: float) -> bool:
    """What a Gauss–Newton step leaves out, of second order in it, is small beside the uncertainty."""
    return bool(np.all(step**2 / radius <= 0.05 * np.sqrt(np.diag(covariance))))


def _is_near(step: Floats, covariance: Floats, radius: float) -> bool:
    """A step is no longer than what is not known: residuals before it are those behind it."""
    return bool(np.all(step**2 <= NEAR**2 * np.diag(covariance))) and _is_small(step, covariance, radius)


def _closed(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    """Take a step, or as much of it as leaves the surface closed.

    Raises
    ------
    NotAnEllipsoid
        If hardly any of it does.
    """
    for _ in range(HALVINGS):
        moved = _moved(ellipsoid, step)
        if _is_closed(moved):
            return moved
        step = step / 2.0
    raise NotAnEllipsoid(tuple(float(axis / ellipsoid.radius) for axis in ellipsoid.semi_axes), "")


def _is_closed(ellipsoid: Ellipsoid) -> bool:
    axes = ellipsoid.semi_axes
    return bool(axes[0] > SHORTEST_AXIS * axes[2])


def _moved(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    return Ellipsoid(ellipsoid.centre + step[:3], ellipsoid.shape + symmetric_matrix(step[3:]))


def foot_directions(readings: Floats, ellipsoid: Ellipsoid) -> Floats:
    """(N, 3) directions of the foot points of readings on the surface."""
    normals = magnitude.information(corrected_directions(readings, ellipsoid), ellipsoid)[:, :3]
    return corrected_directions(readings - magnitude.distances(readings, ellipsoid)[:, np.newaxis] * normals, ellipsoid)


def correlated(
    segments: Sequence[Floats], count: int, ellipsoid: Ellipsoid, known: float = 0.0
) -> tuple[Floats, Correlation, Residuals]:
    """Scatter (9, 9) of Σ J s over all readings, how residuals are correlated, and these, of stretches of readings.

    `known`: standard deviation of a distortion that is likely, or 0.
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
    freedom = min(independent / max(independent - 9.0, 1.0), MOST_FREEDOM)
    in_time = freedom * residuals.scatter(autocovariance)
    excess_variance = 1.0 + share * (residuals.excess_variance(in_time) - 1.0)
    correlation = Correlation(lag_one, time, direction, excess_variance)
    return scatter + share * excess_variance * in_time, correlation, residuals


def likely_distortion(residuals: Residuals, segments: Sequence[Floats], ellipsoid: Ellipsoid, slow: float) -> float:
    """Standard deviation of a distortion that is likely where slow noise gains so many bits; 0 where there is none."""
    directions = foot_directions(np.concatenate(segments), ellipsoid)
    sphere = _Sphere(directions, _principal_axes(directions), ellipsoid)
    return sphere.likely(residuals.distances, apart=3 * len(residuals.autocovariance()), slow=slow)


def expected_variation(readings: Floats, directions: Floats, ellipsoid: Ellipsoid, segments: Sequence[Floats]) -> float:
    """Variance of what varies smoothly over directions, where these are thinly spread; else 0."""
    spread = np.linalg.eigvalsh(np.cov(directions.T))[0]
    if spread > THIN:
        return 0.0
    ends = np.cumsum([len(segment) for segment in segments])[:-1]
    distances = magnitude.distances(readings, ellipsoid)
    residuals = Residuals(distances, np.empty((0, 9)), np.split(np.arange(len(readings)), ends))
    sphere = _Sphere(directions, _principal_axes(directions), ellipsoid)
    bits = sphere.likelihoods_of_variation(distances, correlation_length(residuals.autocovariance()))
    weights = PROBABLE * np.exp2(bits - bits.max())
    return float(weights @ VARIATIONS**2 / weights.sum()) * ellipsoid.radius**2


def variation_scatter(directions: Floats, jacobian: Floats, count: int) -> Floats:
    """(9, 9) scatter of Σ J s over all readings, of residuals that vary so with unit variance."""
    taken = np.arange(min(len(directions), TAKEN)) * len(directions) // min(len(directions), TAKEN)
    rows = jacobian[taken]
    scatter: Floats = (count / len(taken)) ** 2 * rows.T @ _alike(directions[taken], directions[taken]) @ rows
    return scatter


class _Sphere:
    """Residuals by direction, in cells of the sphere.

    Parameters
    ----------
    directions : (N, 3) float
    axes : (3, 3) float
        In which the cells are, in rows.
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
        """(seen, 9) Jacobian in the middle of each seen cell."""
        return magnitude.information(self._middles, self._ellipsoid)

    @cached_property
    def _kernel(self) -> Floats:
        centres: Floats = CELL_CENTRES @ self._axes
        return _kernel(self._middles, self.jacobian, centres, magnitude.information(centres, self._ellipsoid))

    def distortion(self, residuals: Floats, *, apart: int, time: float) -> float:
        """Standard deviation of what residuals of one direction have in common at different times; 0 where unproven.

        Products of the sums of different visits have no part in the noise of either.
        """
        cross, pairs = self._visits(residuals, apart)
        shared_variance = float(np.sum(cross / self.counts))
        noise = float(np.mean(residuals**2)) * time * np.sqrt(2.0 * float(np.sum(pairs / self.counts**2)))
        if shared_variance <= PROVEN * noise:
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
        """Standard deviation of a distortion that is about as likely as slow noise, of so many bits; else 0."""
        if len(self.seen) < FEWEST_CELLS:
            return 0.0
        means = np.bincount(self.cells, weights=residuals, minlength=len(CELL_CENTRES))[self.seen] / self.counts
        none, _ = self._likelihood(residuals, means, 0.0)
        most, white = max(self._likelihood(residuals, means, ratio) for ratio in DISTORTIONS)
        if most - none <= max(PLAIN, AS_LIKELY * slow):
            return 0.0
        cross, pairs = self._visits(residuals, apart)
        left = self._left_over()
        variance = float(np.sum(self.counts * means**2 - white) / np.sum(self.counts * left))
        agreement = float(np.sum(cross / self.counts)) - AGREEMENT * variance * float(
            np.sum(pairs * left / self.counts)
        )
        return math.sqrt(variance) if variance > 0.0 and agreement > 0.0 else 0.0

    def _likelihood(self, residuals: Floats, means: Floats, ratio: float) -> tuple[float, float]:
        """Restricted likelihood, to the base 2, of a distortion beside white noise, and the variance of that noise."""
        inverse = np.linalg.inv(ratio * _alike(self._middles, self._middles) + np.diag(1.0 / self.counts))
        normal, gradient = self.jacobian.T @ inverse @ self.jacobian, self.jacobian.T @ inverse @ means
        rest = float(np.sum(residuals**2) - np.sum(self.counts * means**2) + means @ inverse @ means)
        rest -= float(gradient @ np.linalg.solve(normal, gradient))
        freedom = len(residuals) - 9.0
        logarithm = float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(inverse)[1]) / math.log(2.0)
        return -(logarithm + freedom * math.log2(rest / freedom)) / 2.0, rest / freedom

    def likelihoods_of_variation(self, residuals: Floats, time: float) -> Floats:
        """(7,) restricted likelihoods of `VARIATIONS`, to the base 2; all 0 where too few directions are seen."""
        freedom = len(residuals) / time - 9.0
        if len(self.seen) <= 9 or freedom <= 9.0:
            return np.zeros(len(VARIATIONS))
        ratios = (VARIATIONS * self._ellipsoid.radius) ** 2 / np.mean(residuals**2)
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

        Visits are stretches of readings there, separated by more than `apart` readings.
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
    """(3, 3) principal axes of directions in rows, to the side of their third moments: they turn with the readings."""
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
    likeness: Floats = np.exp(-0.5 * (angles / SMOOTH) ** 2)
    return likeness
