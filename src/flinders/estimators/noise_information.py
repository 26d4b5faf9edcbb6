"""What noise alone pretends to tell in a joint fit, as `flinders.likelihood.identifiability` for the magnitude alone.

A reading's Jacobian is taken where its noise has put the field's direction q, and an accelerometer's noise stands in
the vertical d itself. Both move the Jacobian, and the squares of what they move add up in JᵀJ to information that is
not there. With the Jacobian J(q, d), the group's own direction taken off, it is

    Σ (∂J/∂ε)ᵀ (∂J/∂ε)

over the noises ε in standard deviations: two of q, from what its readings say of it, and two across d. Where parameters
are well seen that is nothing; a body that leans by a few degrees sees the bias of its accelerometer, and the offset
along its vertical, by so little that it counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.estimators.sandwich_covariance import projected
from flinders.likelihood.observations import inverse_of, rows_of
from flinders.likelihood.parameters import across, on_the_sphere

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.estimators.solver import Iterate, JointProblem
    from flinders.likelihood.observations import ObservationGroup

LOOKED_AT: Final = 2000
"""Readings that stand for all."""

MOST: Final = 0.9
"""Share of what a direction of parameters is told that noise may pretend: beyond, the prior alone speaks."""


def spurious_information_of(problem: JointProblem, iterate: Iterate) -> Floats:
    """(P, P) what noise adds to the normal matrix, in standard deviations."""
    size = problem.layout.size
    total = np.zeros((size, size))
    every = max(1, -(-sum(group.rows.size for group in iterate.groups) // LOOKED_AT))
    for group, directions in zip(iterate.groups, iterate.directions, strict=True):
        some, towards = group.every(every), directions[::every]
        seen = len(directions) / len(towards)
        for first, second in _moved(some, towards, problem, iterate):
            moved = 0.5 * (first - second).transpose(3, 1, 0, 2).reshape(size, -1)
            total += seen * (moved @ moved.T)
    return total


def without(matrix: Floats, spurious: Floats, believed: Floats) -> Floats:
    """(P, P) the normal matrix with the prior, less what noise pretends of it.

    Examples
    --------
    >>> without(np.diag([4.0, 4.0]), np.diag([1.0, 0.0]), np.eye(2)).round(9)
    array([[4., 0.],
           [0., 5.]])
    """
    whole = matrix + believed
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, 1e-15 * values[-1])) * scale[:, np.newaxis]  # whole = root rootᵀ
    inverse = np.linalg.inv(root)
    shares, ways = np.linalg.eigh(inverse @ spurious @ inverse.T)
    from_readings = np.einsum("ij,ik,kj->j", ways, inverse @ matrix @ inverse.T, ways)
    left = root @ ways
    less: Floats = (left * (1.0 - np.clip(shares, 0.0, MOST * from_readings))) @ left.T
    return less


def _moved(
    group: ObservationGroup, directions: Floats, problem: JointProblem, iterate: Iterate
) -> Iterator[tuple[Floats, Floats]]:
    """Yield Jacobians on both sides of where noise has put them, a standard deviation away, of each kind of noise."""

    def jacobian(group: ObservationGroup, directions: Floats) -> Floats:
        return projected(rows_of(group, iterate.at, directions, problem.layout, iterate.weights))[0]

    own = rows_of(group, iterate.at, directions, problem.layout, iterate.weights).own
    covariance = inverse_of(np.einsum("wkna,wknb->wab", own, own))
    values, vectors = np.linalg.eigh(covariance)
    for steps in np.moveaxis(vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis], 2, 0):
        yield jacobian(group, on_the_sphere(directions, steps)), jacobian(group, on_the_sphere(directions, -steps))
    if group.down is None or group.attitudes is not None:
        return
    sigma = iterate.weights.vertical / np.sqrt(max(1.0 - iterate.at.sine**2, 1e-3))
    alternating = np.where(np.arange(group.down.shape[1]) % 2, sigma, -sigma)[:, np.newaxis]  # each on its own
    observed = np.asarray(group.down.any(axis=2, keepdims=True))
    for aside in np.moveaxis(across(np.where(observed, group.down, [0.0, 0.0, 1.0])) * observed[..., np.newaxis], 3, 0):
        up, down = group.down + alternating * aside, group.down - alternating * aside
        yield jacobian(replace(group, down=up), directions), jacobian(replace(group, down=down), directions)
