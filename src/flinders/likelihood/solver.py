"""Levenberg–Marquardt solver of joint fits, in which groups of readings have common directions of the field.

Minimises over parameters θ and a direction v of the field for each window, time or reading

    χ²(θ, v) = Σ r(θ, v)² + prior(θ)

with all residuals r in standard deviations. Each group of observations gives its normal equations with its directions
eliminated (a Schur complement, see `flinders.likelihood.observations`). A damped Gauss–Newton step δ solves

    (N + λ diag N) δ = g,        N = Σ JᵀJ + prior,        g = Σ Jᵀr + prior

The step is accepted if χ² does not grow; otherwise the damping λ is increased. After each step the standard deviations
are estimated from the residuals by Fisher scoring for variance components. At the end `correct_bias` subtracts the
mean gradient that comes from noise on the curved sphere of directions.

A problem defines its groups, its prior, and the weights of its residuals: `flinders.likelihood.joint` for a
magnetometer and aiding sensors, `flinders.likelihood.sensors` for several magnetometers on one body,
`flinders.likelihood.pointing` for a survey instrument.

Source: J. Nocedal, S. J. Wright, *Numerical Optimization* (2006) §10.3; B. Triggs et al., *Bundle Adjustment* (2000)
§6.1, for the Schur complement; R. I. Jennrich, M. D. Schluchter, Biometrics 42 (1986), for the scoring.

>>> damped_step(np.diag([4.0, 1.0]), np.array([4.0, 1.0]), damping=1.0)
array([0.5, 0.5])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, Self, TypeAlias, TypeVar

import numpy as np

from flinders.likelihood.equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.likelihood.observations import EliminatedEquations

MAX_STEPS: Final = 60
"""Largest number of Levenberg–Marquardt steps; ten are usual."""

LAST_STEP_SIGMAS: Final = 1e-3
"""Default of `Problem.last_step`: length of the last step in standard deviations, rms over the parameters."""

MAX_STEP: Final = 0.5
"""Largest step relative to the radius; a longer step is shortened."""

INITIAL_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-12, 1e9
"""Damping at the start, and its range; at the largest damping no step improves the fit."""

MAX_COST_INCREASE: Final = 1e-6
"""Largest increase of χ² by an accepted step, besides rounding."""

MIN_VARIANCE_FACTOR: Final = 0.2
"""Smallest factor by which one step changes an estimated variance; the largest factor is its inverse."""

MAX_SIGMA_CHANGE: Final = 1e-2
"""Largest relative change of a standard deviation at convergence."""

MAX_CORRECTION_STEPS: Final = 8
"""Largest number of steps with the mean gradient of the noise subtracted."""

LAST_CORRECTION_SIGMAS: Final = 0.03
"""Length in standard deviations of the last bias correction step; a next step would be below `LAST_STEP_SIGMAS`."""


Values: TypeAlias = Any
"""Type of parameters, their layout, or weights, which depends on the problem."""


class ParameterSet(Protocol):
    """Values of the parameters of a problem."""

    @property
    def is_closed(self) -> bool:
        """Whether all surfaces are ellipsoids."""

    def take_step(self, step: Floats, layout: Values) -> Self:
        """Values after a (P,) step."""

    def relative_step(self, step: Floats, layout: Values) -> float:
        """Largest change by a (P,) step, relative to the radii of the surfaces."""


class Observations(Protocol):
    """Group of observations, with its own directions of the field."""

    def at(self, at: Values) -> Self:
        """The group updated for other parameters."""

    def linearize(self, at: Values, directions: Floats, layout: Values, weights: Values) -> EliminatedEquations:
        """Normal equations, with the directions eliminated."""

    def cost(self, at: Values, directions: Floats, weights: Values) -> float:
        """χ² of the group."""


P = TypeVar("P", bound=ParameterSet)
G = TypeVar("G", bound=Observations)
W = TypeVar("W")


@dataclass(frozen=True, slots=True, eq=False)
class Iterate(Generic[P, G, W]):
    """State of the iteration."""

    at: P  # parameters
    groups: tuple[G, ...]  # with their current weights and integrated rates
    directions: tuple[Floats, ...]  # (W, 3) directions of each group
    weights: W  # standard deviations of each kind of residual, and other weights


class Problem(Protocol[P, G, W]):
    """Problem of the solver: free parameters, their prior, and the weights of residuals."""

    @property
    def layout(self) -> Values:
        """Columns of the Jacobian; `layout.size` is P."""

    @property
    def tolerance(self) -> float:
        """Largest increase of χ² by an accepted step."""

    @property
    def last_step(self) -> float:
        """Length of the last step in standard deviations."""

    def prior_equations(self, at: P) -> NormalEquations:
        """Normal equations of the prior."""

    def reweigh(self, iterate: Iterate[P, G, W], equations: Equations) -> Iterate[P, G, W]:
        """The iterate with new weights by its residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations of all groups and of the prior, in standard deviations."""

    parts: tuple[EliminatedEquations, ...]  # one for each group
    matrix: Floats  # (P, P): N of the groups without the prior
    gradient: Floats  # (P,): gradient of the groups without the prior
    bias_gradient: Floats  # (P,): mean gradient from noise, because the sphere of directions is curved
    prior: NormalEquations

    @classmethod
    def of(cls, problem: Problem[P, G, W], iterate: Iterate[P, G, W]) -> Self:
        """Linearize all groups."""
        parts = tuple(
            group.linearize(iterate.at, directions, problem.layout, iterate.weights)
            for group, directions in zip(iterate.groups, iterate.directions, strict=True)
        )
        size = problem.layout.size
        matrix, gradient, bias_gradient = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for part in parts:
            matrix, gradient = matrix + part.matrix, gradient + part.gradient
            bias_gradient = bias_gradient + part.bias_gradient
        return cls(parts, matrix, gradient, bias_gradient, problem.prior_equations(iterate.at))

    @property
    def cost(self) -> float:
        """χ² of all groups and the prior."""
        return self.prior.cost + sum(part.cost for part in self.parts)

    @property
    def with_prior(self) -> NormalEquations:
        """Normal equations with the prior, without bias correction."""
        return self.unbiased(-self.bias_gradient) + self.prior

    def unbiased(self, bias: Floats | float = 0.0) -> NormalEquations:
        """Normal equations of the groups without the prior, with `bias_gradient` and a (P,) `bias` subtracted."""
        return NormalEquations(self.matrix, self.gradient - self.bias_gradient - bias, 0.0, 0)

    def noise_factors(self, parameters: Floats) -> Floats:
        """(K,) factors of the standard deviations of each kind of residual, by a step of Fisher scoring.

        Parameters
        ----------
        parameters : (K,) float
            Number of parameters that each kind of residual determines.
        """
        surplus = sum(part.squares - part.expected for part in self.parts) + parameters
        curvature = np.sum([part.curvature for part in self.parts], axis=0)
        change = np.linalg.lstsq(curvature, surplus, rcond=1e-6)[0]
        factors: Floats = np.sqrt(np.clip(1.0 + change, MIN_VARIANCE_FACTOR, 1.0 / MIN_VARIANCE_FACTOR))
        return factors

    def noise_factor(self, parameters: float) -> float:
        """Factor for the standard deviation of the first kind of residual, from its squares and degrees of freedom.

        `parameters` is the number of parameters that this kind of residual determines.
        """
        squares = sum(float(part.squares[0]) for part in self.parts)
        expected = sum(float(part.expected[0]) for part in self.parts) - parameters
        return math.sqrt(squares / max(expected, 1.0))


def levenberg_marquardt(
    problem: Problem[P, G, W], iterate: Iterate[P, G, W], steps: int = MAX_STEPS
) -> Iterate[P, G, W]:
    """Iterate until steps are small in standard deviations; weights are estimated after each step.

    Parameters
    ----------
    problem : Problem
        Priors and weights.
    iterate : Iterate
        Start.
    steps : int, optional
        Largest number of steps.

    Returns
    -------
    Iterate
        State at convergence, or after the last step.
    """
    damping = INITIAL_DAMPING
    for _ in range(steps):
        equations = Equations.of(problem, iterate)
        step, moved, damping = _accept_step(problem, iterate, equations, damping)
        weighed = problem.reweigh(iterate if moved is None else moved, equations)
        is_small = moved is None or (_length(equations, step) < problem.last_step**2 * len(step) and damping < 1.0)
        is_done = is_small and _have_converged(weighed.weights, iterate.weights)
        iterate, damping = weighed, min(damping, 1.0)
        if is_done:
            break
    return iterate


def correct_bias(
    problem: Problem[P, G, W],
    iterate: Iterate[P, G, W],
    bias: Floats | float = 0.0,
    observed: Callable[[Iterate[P, G, W], NormalEquations], NormalEquations] | None = None,
    steps: int = MAX_CORRECTION_STEPS,
) -> tuple[Iterate[P, G, W], Equations]:
    """Correct the bias from noise by Gauss–Newton steps with the mean gradient subtracted.

    Parameters
    ----------
    problem : Problem
        Priors and weights.
    iterate : Iterate
        State at convergence of the solver.
    bias : (P,) float, optional
        Mean gradient in addition to that of the groups.
    observed : callable, optional
        Removes spurious information from the groups' normal equations at an iterate.
    steps : int, optional
        Largest number of steps.

    Returns
    -------
    Iterate, Equations
        Corrected state, and its equations.
    """
    for _ in range(steps):
        equations = Equations.of(problem, iterate)
        plain = equations.unbiased(bias)
        whole = (plain if observed is None else observed(iterate, plain)) + equations.prior
        step = damped_step(whole.matrix, whole.gradient, 0.0)
        moved = take_step(problem, iterate, equations, step)
        if moved is None:
            break
        iterate = problem.reweigh(moved, equations)
        if _length(equations, step) < LAST_CORRECTION_SIGMAS**2:
            break
    return iterate, Equations.of(problem, iterate)


def damped_step(matrix: Floats, gradient: Floats, damping: float) -> Floats:
    """(P,) damped step, for the (P, P) matrix scaled to diagonal 1."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    damped = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    try:
        step: Floats = np.linalg.solve(damped, gradient / scale) / scale
    except np.linalg.LinAlgError:  # an undetermined parameter stays
        step = np.linalg.lstsq(damped, gradient / scale, rcond=None)[0] / scale
    return step


def take_step(
    problem: Problem[P, G, W], iterate: Iterate[P, G, W], equations: Equations, step: Floats
) -> Iterate[P, G, W] | None:
    """Iterate after a (P,) step, with its directions; None if a surface is not closed."""
    at = iterate.at.take_step(step, problem.layout)
    if not at.is_closed:
        return None
    groups = tuple(group.at(at) for group in iterate.groups)
    directions = tuple(
        part.follow(known, step) for part, known in zip(equations.parts, iterate.directions, strict=True)
    )
    return replace(iterate, at=at, groups=groups, directions=directions)


def _accept_step(
    problem: Problem[P, G, W], iterate: Iterate[P, G, W], equations: Equations, damping: float
) -> tuple[Floats, Iterate[P, G, W] | None, float]:
    """Step damped until χ² does not grow, the iterate after it or None if there is none, and the next damping."""
    whole, most = equations.with_prior, equations.cost * (1.0 + 1e-9) + problem.tolerance
    step: Floats = whole.gradient
    while damping < MAX_DAMPING:
        step = damped_step(whole.matrix, whole.gradient, damping)
        tried = take_step(problem, iterate, equations, _shorten(problem, iterate, step))
        if tried is not None and _cost(problem, tried) <= most:
            return step, tried, max(damping / 10.0, MIN_DAMPING)
        damping *= 8.0
    return step, None, damping


def _shorten(problem: Problem[P, G, W], iterate: Iterate[P, G, W], step: Floats) -> Floats:
    """Shorten a step so that no surface moves by more than `MAX_STEP` of its radius."""
    return step * min(1.0, MAX_STEP / max(iterate.at.relative_step(step, problem.layout), 1e-300))


def _cost(problem: Problem[P, G, W], iterate: Iterate[P, G, W]) -> float:
    """χ² of all groups and the prior."""
    return problem.prior_equations(iterate.at).cost + sum(
        group.cost(iterate.at, directions, iterate.weights)
        for group, directions in zip(iterate.groups, iterate.directions, strict=True)
    )


def _length(equations: Equations, step: Floats) -> float:
    """Squared length of a step in standard deviations."""
    return float(step @ (equations.matrix + equations.prior.matrix) @ step)


def _have_converged(weights: Values, before: Values) -> bool:
    """Whether all standard deviations have converged."""
    return bool(np.all(np.abs(np.log(np.divide(weights, before))) < MAX_SIGMA_CHANGE))
