"""Likelihood: Gauss–Newton on the Sampson distance, down to the Cramér–Rao bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid
from flinders.estimators.algebraic import trace_fit
from flinders.estimators.consistent import adjusted
from flinders.estimators.estimate import Estimate, Readings
from flinders.quadric import Ellipsoid, symmetric
from flinders.terms import magnitude, prior
from flinders.terms.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats

ENOUGH: Final = 20_000
"""Readings on which the fit is iterated; the whole of a longer recording is gone through once, from there."""

PASSES: Final = 3
STEPS: Final = 50
LONGEST_STEP: Final = 0.3
SETTLED: Final = 1e-10
SHORTEST_AXIS: Final = 1e-4
"""Of the longest: a flatter surface is no ellipsoid that a sensor makes, and a step into it is cut short."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """General ellipsoid by maximum likelihood, corrected for the curvature of the surface.

    Minimises ``Σ s² / σ²`` plus the prior's cost, where s is the Sampson distance of a reading from the
    ellipsoid (see `flinders.terms.magnitude`), by Gauss–Newton steps on (b, S) with the Jacobian at
    the foot points, started from `Consistent`. Then the mean of the gradient that noise causes on a
    curved surface is subtracted. σ comes from the residuals.

    On readings of white noise its error is that of the Cramér–Rao bound (``python -m
    benchmarks.accuracy``). Use it whenever the readings themselves are there; `auto` does.

    Parameters
    ----------
    prior : float, optional
        Departure of the scaled shape from a sphere that is thought likely, see
        `flinders.terms.prior`; None leaves what was not seen free.
    bias_correction : bool
        False gives the minimum of the Sampson cost itself, for comparison with other software.

    References
    ----------
    .. [1] P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18 (1982) 97–108.
    .. [2] M. Kok, T. B. Schön, "Magnetometer calibration using inertial sensors", IEEE Sensors J. 16 (2016).

    Examples
    --------
    Half of the sphere is enough for an offset to about a hundredth of the field, and it says so:

    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> directions[:, 2] = np.abs(directions[:, 2])
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> found = Likelihood().estimate(Readings.of(field))
    >>> error = found.ellipsoid.centre - [20, 120, 90]
    >>> bool(np.all(np.abs(error) < 3 * np.sqrt(np.diag(found.covariance)[:3])))
    True
    """

    prior: float | None = prior.SPREAD
    bias_correction: bool = True

    name: ClassVar[str] = "likelihood"
    unknowns: ClassVar[int] = 10
    use: ClassVar[str] = "general ellipsoid at the statistical limit; needs the readings themselves"

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, StuckAxis
            See `Readings.require`.
        NotAnEllipsoid
            If no step leads to a closed surface.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        some = readings.thinned(ENOUGH, self.name)
        ellipsoid, equations = self._settled(some, start(readings))
        whole = len(some) == len(readings)
        for _ in range(1 if whole else PASSES):
            if not whole:
                equations = self._equations(readings.blocks(self.name), ellipsoid)
            variance = _variance(equations)
            posterior = self._with_prior(equations, variance, ellipsoid)
            step = self._corrected(posterior, some, ellipsoid).step()
            ellipsoid = _closed(ellipsoid, step)
            covariance = np.linalg.pinv(posterior.matrix, hermitian=True)
            if _is_small(step, covariance, ellipsoid.radius):
                break
        return Estimate(ellipsoid, covariance, float(np.sqrt(variance)), self.name, self._held(covariance, ellipsoid))

    def _corrected(self, posterior: NormalEquations, some: Floats, ellipsoid: Ellipsoid) -> NormalEquations:
        """Take off the mean of the gradient that noise causes; a part of the readings speaks for all."""
        if not self.bias_correction:
            return posterior
        share = posterior.count / len(some)
        return replace(posterior, gradient=posterior.gradient - share * magnitude.curvature(some, ellipsoid))

    def _held(self, covariance: Floats, ellipsoid: Ellipsoid) -> float:
        """Largest share of the information about any combination of parameters that comes from the prior."""
        if self.prior is None:
            return 0.0
        shares = np.linalg.eigvals(covariance @ prior.equations(ellipsoid, spread=self.prior).matrix)
        return float(np.clip(np.real(shares).max(), 0.0, 1.0))

    def _settled(self, readings: Floats, ellipsoid: Ellipsoid) -> tuple[Ellipsoid, NormalEquations]:
        """Iterate until the steps vanish; where a step makes the fit worse, go back half of it."""
        equations = self._equations([readings], ellipsoid)
        for _ in range(STEPS):
            step = self._with_prior(equations, _variance(equations), ellipsoid).step()
            largest = float(np.abs(step).max()) / ellipsoid.radius
            if largest < SETTLED:
                break
            step *= min(1.0, LONGEST_STEP / largest)
            ellipsoid, equations = self._improved(readings, ellipsoid, equations, step)
        return ellipsoid, equations

    def _improved(
        self, readings: Floats, ellipsoid: Ellipsoid, equations: NormalEquations, step: Floats
    ) -> tuple[Ellipsoid, NormalEquations]:
        """Take the longest of the step, its half, its quarter … that leaves the surface closed and the fit no worse."""
        for _ in range(30):
            moved = _moved(ellipsoid, step)
            if moved.semi_axes[0] > SHORTEST_AXIS * moved.semi_axes[2]:
                tried = self._equations([readings], moved)
                if tried.cost <= equations.cost * (1.0 + 1e-6):
                    return moved, tried
            step = step / 2.0
        return ellipsoid, equations

    def _equations(self, blocks: Iterable[Floats], ellipsoid: Ellipsoid) -> NormalEquations:
        return magnitude.equations(blocks, ellipsoid, exact=not self.bias_correction)

    def _with_prior(self, equations: NormalEquations, variance: float, ellipsoid: Ellipsoid) -> NormalEquations:
        """Equations in standard deviations of the noise, and the prior's."""
        weighed = NormalEquations(
            equations.matrix / variance, equations.gradient / variance, equations.cost / variance, equations.count
        )
        return weighed if self.prior is None else weighed + prior.equations(ellipsoid, spread=self.prior)


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


def _variance(equations: NormalEquations) -> float:
    """Noise variance of the residuals, kept above rounding so that exact readings can be fitted."""
    return max(equations.cost / max(equations.count - 9, 1), np.finfo(float).tiny ** 0.5)


def _closed(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    """Take a step, or as much of it as leaves the surface closed.

    Raises
    ------
    NotAnEllipsoid
        If hardly any of it does.
    """
    for _ in range(30):
        moved = _moved(ellipsoid, step)
        if moved.semi_axes[0] > SHORTEST_AXIS * moved.semi_axes[2]:
            return moved
        step = step / 2.0
    raise NotAnEllipsoid(tuple(float(axis / ellipsoid.radius) for axis in ellipsoid.semi_axes), Likelihood.name)


def _moved(ellipsoid: Ellipsoid, step: Floats) -> Ellipsoid:
    return Ellipsoid(ellipsoid.centre + step[:3], ellipsoid.shape + symmetric(step[3:]))
