"""Likelihood: Gauss–Newton on the Sampson distance, down to the Cramér–Rao bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final, Self

import numpy as np

from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.algebraic import trace_fit
from flinders.estimators.base import Estimate, Method
from flinders.estimators.consistent import adjusted
from flinders.estimators.covariance import FEW, Correlation, correlation_of
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.likelihood import magnitude, prior
from flinders.likelihood.equations import FINEST, NormalEquations
from flinders.likelihood.identifiability import Support, spurious_information
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings

ENOUGH: Final = 20_000
"""Readings on which the fit is iterated; the whole of a longer recording is gone through once, from there."""

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

GLANCE: Final = 2_000
"""Readings from which noise-induced information is computed, an average over their directions."""

NO_WORSE: Final = 0.01
"""In χ²: a step that costs less is taken. The foot-point equation has its root beside the minimum of Σ s²."""

SHORTEST_AXIS: Final = 1e-4
"""Of the longest: a flatter surface is no ellipsoid that a sensor makes, and a step into it is cut short."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """General ellipsoid by maximum likelihood, corrected for the curvature of the surface.

    Minimises ``Σ s² / σ²`` plus the prior's cost, where s is the Sampson distance of a reading from the
    ellipsoid (see `flinders.likelihood.magnitude`), by Gauss–Newton steps on (b, S) with the Jacobian at
    the foot points, started from `Consistent`. Then the mean of the gradient that noise causes on a
    curved surface is subtracted. σ comes from the residuals.

    On readings of white noise its error is that of the Cramér–Rao bound (``python -m
    benchmarks.accuracy``). Use it whenever the readings themselves are there; `auto` does.

    Parameters
    ----------
    prior : float, optional
        Departure of the scaled shape from a sphere that is thought likely, see
        `flinders.likelihood.prior`; None leaves what was not seen free.
    bias_correction : bool
        False gives the minimum of the Sampson cost itself, for comparison with other software.

    References
    ----------
    .. [1] P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18 (1982) 97–108.
    .. [2] M. Kok, T. B. Schön, "Magnetometer calibration using inertial sensors", IEEE Sensors J. 16 (2016).

    Examples
    --------
    Half of the sphere is enough for an offset to about a hundredth of the field, and it says so:

    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> directions[:, 2] = np.abs(directions[:, 2])
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> estimate = Likelihood().estimate(Readings.of(field))
    >>> error = estimate.ellipsoid.centre - [20, 120, 90]
    >>> bool(np.all(np.abs(error) < 3 * np.sqrt(np.diag(estimate.covariance)[:3])))
    True
    """

    prior: float | None = prior.SPREAD
    bias_correction: bool = True

    name: ClassVar[str] = "likelihood"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing."""
        prior.check(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NotAnEllipsoid
            If no step leads to a closed surface.
        Undetermined
            If readings leave parameters open, and there is no prior to hold them.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        return self.polish(readings, start(readings))

    def polish(self, readings: Readings, ellipsoid: Ellipsoid) -> Estimate:
        """Fit from a known start; raises as `estimate`."""
        some = _Some.of(readings.thinned(ENOUGH, self.name))
        if not some.spread:  # all alike, as what the rails of a sensor leave of a turn can be
            raise NotAnEllipsoid((0.0, 0.0, 0.0), self.name)
        estimate = self._settled(some, ellipsoid)
        long = len(some) < len(readings)
        for _ in range(PASSES if long else 1):
            if long:
                estimate = self._seen(readings.blocks(self.name), estimate.ellipsoid, some)
            step = self._unbiased(estimate).step()
            ellipsoid = _closed(estimate.ellipsoid, step)
            if _is_small(step, estimate.covariance, ellipsoid.radius):
                break
        if estimate.support.unobserved and self.prior is None:
            raise Undetermined(estimate.support.unobserved)
        correlation = None
        covariance = estimate.covariance
        if not estimate.plain and len(readings) >= FEW:
            correlation = correlation_of(readings.segments(self.name), len(readings), ellipsoid)
            covariance = estimate.widened(correlation)
        return Estimate(
            ellipsoid,
            covariance,
            estimate.noise,
            self.name,
            prior_influence=self._prior_influence(estimate),
            correlation=correlation,
            textbook=estimate.covariance,
            used=estimate.likelihood.count,
            unobserved=estimate.support.unobserved,
        )

    def _settled(self, some: _Some, ellipsoid: Ellipsoid) -> _Posterior:
        """Iterate until the steps vanish or none makes the fit better."""
        settled = SETTLED_BUT_FOR_ONE if self.bias_correction else SETTLED
        now = self._seen([some.field], ellipsoid, some)
        for _ in range(STEPS):
            step = now.equations.step()
            largest = float(np.abs(step).max()) / now.ellipsoid.radius
            better = self._improved(now, step * min(1.0, LONGEST_STEP / largest)) if largest > settled else None
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
                tried = self._seen([now.some.field], moved, now.some, sound=now.sound or now.support.is_sound)
                if not tried.sound and now.support.unobserved:
                    return tried
                if tried.cost(now.variance) <= now.cost(now.variance) + NO_WORSE:
                    return tried
            step = step / 2.0
        return None

    def _seen(self, blocks: Iterable[Floats], ellipsoid: Ellipsoid, some: _Some, *, sound: bool = False) -> _Posterior:
        """Linearise the likelihood and the prior at an ellipsoid."""
        likelihood = magnitude.equations(blocks, ellipsoid, exact=not self.bias_correction)
        believed = NormalEquations.empty()
        if self.prior is not None:
            believed = prior.equations(ellipsoid, spread=self.prior) + prior.sense(ellipsoid, some.middle, some.spread)
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
        Where they were linearised.
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
        return max(self.noise, FINEST * self.ellipsoid.radius) ** 2

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

        def spurious() -> Floats:
            points = self.some.field[:: max(1, len(self.some) // GLANCE)]
            share = self.likelihood.count / len(points)
            return share * spurious_information(directions_of(points, self.ellipsoid), self.ellipsoid)

        return Support.of(self.weighed.matrix, spurious)

    def combined(self, weighed: NormalEquations) -> NormalEquations:
        """What the readings say of what they see, and the prior."""
        return self.prior + (weighed if self.sound else self.support.keep(weighed))

    @cached_property
    def equations(self) -> NormalEquations:
        """Of both, in standard deviations."""
        return self.combined(self.weighed)

    @cached_property
    def covariance(self) -> Floats:
        """(9, 9) covariance of the parameters, in unit²."""
        seen = self.support.keep(self.weighed).matrix if self.plain else self.support.information
        return replace(self.prior, matrix=self.prior.matrix + seen).inverse()

    def widened(self, correlation: Correlation) -> Floats:
        """(9, 9) covariance with the scatter that correlated residuals give the gradient."""
        if correlation.is_white:
            return self.covariance
        scatter = self.support.projected(correlation.scatter) / self.variance**2
        covariance: Floats = self.covariance @ (self.prior.matrix + scatter) @ self.covariance
        return covariance

    def cost(self, variance: float) -> float:
        """χ² of the readings for a noise variance, and the prior's."""
        return self.likelihood.cost / variance + self.prior.cost


def start(readings: Readings) -> Ellipsoid:
    """An ellipsoid to begin with: consistent, else algebraic, else a sphere around the readings."""
    try:
        return adjusted(readings)[0]
    except NotAnEllipsoid:
        moments = readings.summary.moments
        origin, scale = moments.mean, moments.spread
    try:
        return Ellipsoid.from_quadric(trace_fit(moments.about(origin, scale))).in_frame(origin, scale)
    except NotAnEllipsoid:
        return Ellipsoid(origin, scale * np.eye(3))


def _is_small(step: Floats, covariance: Floats, radius: float) -> bool:
    """What a Gauss–Newton step leaves out, of second order in it, is small beside the uncertainty."""
    return bool(np.all(step**2 / radius <= 0.05 * np.sqrt(np.diag(covariance))))


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
    raise NotAnEllipsoid(tuple(float(axis / ellipsoid.radius) for axis in ellipsoid.semi_axes), Likelihood.name)


def _is_closed(ellipsoid: Ellipsoid) -> bool:
    axes = ellipsoid.semi_axes
    return bool(axes[0] > SHORTEST_AXIS * axes[2])


def _moved(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    return Ellipsoid(ellipsoid.centre + step[:3], ellipsoid.shape + symmetric(step[3:]))


METHOD: Final = Method(
    Likelihood,
    use="general ellipsoid at the statistical limit; needs the readings themselves",
    source="Sampson (1982); Kok and Schön (2016)",
)
