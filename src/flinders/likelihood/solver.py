"""Levenberg–Marquardt over observation terms that share a direction of the field: the one solver of joint fits.

Minimises over parameters θ and a direction v of the field for each window, moment or reading

    χ²(θ, v) = Σ r(θ, v)² + prior(θ)

with all residuals r in standard deviations. Each group of observations gives its normal equations with its directions
eliminated (a Schur complement, see `flinders.likelihood.observations`); a damped Gauss–Newton step δ solves

    (N + λ diag N) δ = g,        N = Σ JᵀJ + prior,        g = Σ Jᵀr + prior

and is taken where χ² does not grow; where it does, the damping λ does. The standard deviations follow from the
residuals, by a step of Fisher's scoring for components of variance after each step of the parameters. At the end
`bias_corrected` takes off the mean gradient that noise makes on the sphere of directions.

A problem brings its groups, its prior, and how it weighs residuals: `flinders.likelihood.joint` for a magnetometer and
aiding sensors, `flinders.likelihood.sensors` for several magnetometers on one body, `flinders.likelihood.pointing` for
a survey instrument.

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
    from flinders.likelihood.observations import Linearised

STEPS: Final = 60
"""Of Levenberg and Marquardt; ten are usual."""

SETTLED: Final = 1e-3
"""Standard deviations: a step shorter than this in all parameters is the last, unless a problem asks for less."""

LONGEST_STEP: Final = 0.5
"""Of the radius: a longer step is cut."""

INITIAL_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-12, 1e9
"""Beyond the last no step makes the fit better."""

NO_WORSE: Final = 1e-6
"""In χ², beside rounding: a step that costs less is taken."""

LEAST_CHANGE: Final = 0.2
"""Of a variance in one step: what is far off is approached."""

SAME: Final = 1e-2
"""Relative change of a standard deviation that is none."""

CORRECTED: Final = 8
"""Steps with the mean gradient of the noise removed."""

EASED: Final = 0.03
"""Standard deviations: such a step with it is the last, as the next would be shorter than `SETTLED`."""


Values: TypeAlias = Any
"""Parameters, their layout or weights of a group: the group and its problem know of which type."""


class ParameterSet(Protocol):
    """Values of the parameters."""

    @property
    def is_closed(self) -> bool:
        """Whether all surfaces are ellipsoids."""

    def moved(self, step: Floats, layout: Values) -> Self:
        """The values after a (P,) step."""

    def relative(self, step: Floats, layout: Values) -> float:
        """Length of a step in radii of the surfaces that it moves."""


class Observations(Protocol):
    """A group of observations, with directions of its own."""

    def at(self, at: Values) -> Self:
        """The same with what it has to calculate anew for other parameters."""

    def linearised(self, at: Values, directions: Floats, layout: Values, weights: Values) -> Linearised:
        """Normal equations, the directions eliminated."""

    def cost(self, at: Values, directions: Floats, weights: Values) -> float:
        """χ² of the group."""


P = TypeVar("P", bound=ParameterSet)
G = TypeVar("G", bound=Observations)
W = TypeVar("W")


@dataclass(frozen=True, slots=True, eq=False)
class Iterate(Generic[P, G, W]):
    """Where the iteration stands."""

    at: P
    groups: tuple[G, ...]  # with weights, trust and integrated rates as they are now
    directions: tuple[Floats, ...]  # (W, 3) of each group
    weights: W  # standard deviations of each kind of residual, and what else residuals are weighed by


class Problem(Protocol[P, G, W]):
    """Parameters that are to be found, what is thought of them before, and how residuals are weighed."""

    @property
    def layout(self) -> Values:
        """Columns of the Jacobian; `layout.size` is P."""

    @property
    def tolerance(self) -> float:
        """χ² by which a step may be worse."""

    @property
    def settled(self) -> float:
        """Standard deviations: a step shorter than this in all parameters is the last."""

    def prior_equations(self, at: P) -> NormalEquations:
        """Normal equations of the prior."""

    def reweighed(self, iterate: Iterate[P, G, W], equations: Equations) -> Iterate[P, G, W]:
        """The same, weighed as the residuals of the equations ask for."""


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Normal equations of all groups and of the prior, in standard deviations."""

    parts: tuple[Linearised, ...]  # one for each group
    matrix: Floats  # (P, P): N of the groups alone
    gradient: Floats  # (P,)
    bent: Floats  # (P,): mean gradient that noise makes on the sphere of directions
    prior: NormalEquations

    @classmethod
    def of(cls, problem: Problem[P, G, W], iterate: Iterate[P, G, W]) -> Self:
        """Linearise all groups."""
        parts = tuple(
            group.linearised(iterate.at, directions, problem.layout, iterate.weights)
            for group, directions in zip(iterate.groups, iterate.directions, strict=True)
        )
        size = problem.layout.size
        matrix, gradient, bent = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        for part in parts:
            matrix, gradient, bent = matrix + part.matrix, gradient + part.gradient, bent + part.bent
        return cls(parts, matrix, gradient, bent, problem.prior_equations(iterate.at))

    @property
    def cost(self) -> float:
        """χ² of everything."""
        return self.prior.cost + sum(part.cost for part in self.parts)

    @property
    def whole(self) -> NormalEquations:
        """N and g, with the prior."""
        return self.unbiased(-self.bent) + self.prior

    def unbiased(self, bias: Floats | float = 0.0) -> NormalEquations:
        """Normal equations of the groups alone, with the mean gradient of noise removed, and (P,) another one."""
        return NormalEquations(self.matrix, self.gradient - self.bent - bias, 0.0, 0)

    def noise_factors(self, parameters: Floats) -> Floats:
        """(K,) factors on the standard deviation of each kind of residual: a step of Fisher's scoring.

        Parameters
        ----------
        parameters : (K,) float
            How many parameters each kind of residual determines.
        """
        surplus = sum(part.squares - part.expected for part in self.parts) + parameters
        curvature = np.sum([part.curvature for part in self.parts], axis=0)
        change = np.linalg.lstsq(curvature, surplus, rcond=1e-6)[0]
        factors: Floats = np.sqrt(np.clip(1.0 + change, LEAST_CHANGE, 1.0 / LEAST_CHANGE))
        return factors

    def noise_factor(self, parameters: float) -> float:
        """Factor on the standard deviation of the first kind of residual alone: of their squares over their freedom."""
        squares = sum(float(part.squares[0]) for part in self.parts)
        expected = sum(float(part.expected[0]) for part in self.parts) - parameters
        return math.sqrt(squares / max(expected, 1.0))


def levenberg_marquardt(problem: Problem[P, G, W], iterate: Iterate[P, G, W], steps: int = STEPS) -> Iterate[P, G, W]:
    """Take steps until they are small beside what is claimed, with the weights that residuals ask for.

    Parameters
    ----------
    problem : Problem
    iterate : Iterate
        Where to begin.
    steps : int, optional
        At most.

    Returns
    -------
    Iterate
        Where no step makes the fit better, or after so many.
    """
    damping = INITIAL_DAMPING
    for _ in range(steps):
        equations = Equations.of(problem, iterate)
        step, moved, damping = _accepted(problem, iterate, equations, damping)
        weighed = problem.reweighed(iterate if moved is None else moved, equations)
        is_small = moved is None or (_length(equations, step) < problem.settled**2 * len(step) and damping < 1.0)
        is_done = is_small and _is_same(weighed.weights, iterate.weights)
        iterate, damping = weighed, min(damping, 1.0)
        if is_done:
            break
    return iterate


def bias_corrected(
    problem: Problem[P, G, W],
    iterate: Iterate[P, G, W],
    bias: Floats | float = 0.0,
    observed: Callable[[Iterate[P, G, W], NormalEquations], NormalEquations] | None = None,
    steps: int = CORRECTED,
) -> tuple[Iterate[P, G, W], Equations]:
    """Take off the mean gradient that noise makes, by Gauss–Newton steps; also the equations at the end.

    Parameters
    ----------
    problem : Problem
    iterate : Iterate
        Where the solver came to rest.
    bias : (P,) float, optional
        Mean gradient beyond that which the groups know of.
    observed : callable, optional
        Takes out of the groups' normal equations at an iterate what noise alone pretends.
    steps : int, optional
        At most.
    """
    for _ in range(steps):
        equations = Equations.of(problem, iterate)
        plain = equations.unbiased(bias)
        whole = (plain if observed is None else observed(iterate, plain)) + equations.prior
        step = damped_step(whole.matrix, whole.gradient, 0.0)
        moved = stepped(problem, iterate, equations, step)
        if moved is None:
            break
        iterate = problem.reweighed(moved, equations)
        if _length(equations, step) < EASED**2:
            break
    return iterate, Equations.of(problem, iterate)


def damped_step(matrix: Floats, gradient: Floats, damping: float) -> Floats:
    """(P,) the damped step, in a scale in which the (P, P) matrix has ones on its diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    damped = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    try:
        step: Floats = np.linalg.solve(damped, gradient / scale) / scale
    except np.linalg.LinAlgError:  # nothing speaks for one of them, and it stays
        step = np.linalg.lstsq(damped, gradient / scale, rcond=None)[0] / scale
    return step


def stepped(
    problem: Problem[P, G, W], iterate: Iterate[P, G, W], equations: Equations, step: Floats
) -> Iterate[P, G, W] | None:
    """Where a step of the parameters leads, directions with it; None where a surface is not closed."""
    at = iterate.at.moved(step, problem.layout)
    if not at.is_closed:
        return None
    groups = tuple(group.at(at) for group in iterate.groups)
    directions = tuple(
        part.follow(known, step) for part, known in zip(equations.parts, iterate.directions, strict=True)
    )
    return replace(iterate, at=at, groups=groups, directions=directions)


def _accepted(
    problem: Problem[P, G, W], iterate: Iterate[P, G, W], equations: Equations, damping: float
) -> tuple[Floats, Iterate[P, G, W] | None, float]:
    """A step damped until χ² does not grow, where it leads, or None where no damping helps, and the next damping."""
    whole, most = equations.whole, equations.cost * (1.0 + 1e-9) + problem.tolerance
    step: Floats = whole.gradient
    while damping < MOST_DAMPING:
        step = damped_step(whole.matrix, whole.gradient, damping)
        tried = stepped(problem, iterate, equations, _cut(problem, iterate, step))
        if tried is not None and _cost(problem, tried) <= most:
            return step, tried, max(damping / 10.0, LEAST_DAMPING)
        damping *= 8.0
    return step, None, damping


def _cut(problem: Problem[P, G, W], iterate: Iterate[P, G, W], step: Floats) -> Floats:
    """A step that moves no surface by more than a part of its size."""
    return step * min(1.0, LONGEST_STEP / max(iterate.at.relative(step, problem.layout), 1e-300))


def _cost(problem: Problem[P, G, W], iterate: Iterate[P, G, W]) -> float:
    """χ² of everything."""
    return problem.prior_equations(iterate.at).cost + sum(
        group.cost(iterate.at, directions, iterate.weights)
        for group, directions in zip(iterate.groups, iterate.directions, strict=True)
    )


def _length(equations: Equations, step: Floats) -> float:
    """Squared length of a step in standard deviations."""
    return float(step @ (equations.matrix + equations.prior.matrix) @ step)


def _is_same(weights: Values, before: Values) -> bool:
    """No standard deviation has changed."""
    return bool(np.all(np.abs(np.log(np.divide(weights, before))) < SAME))
